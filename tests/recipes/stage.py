"""What the tests of recipes share: a bake of a scene whose lightmap layout was taken away, places on its surfaces, and
the light there by another way.

The light at a place, independent of the layout that kiln made, of the lightmaps and of scene.glb: the scene as it was
is baked again, with its own second UV set if it has one, another seed and other texels, and the surface points of
kiln.h5 near the place (position and normal in the world, irradiance) are what is interpolated: no UV and no image takes
part. Those of the same object within 2.5 texels, not more than 0.2 texels off the place's plane, facing its way; a
plane through their irradiance, weighted by a Gaussian of 0.8 texels.
"""
import json
import os
import struct
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

RECIPES = os.path.join(harness.REPOSITORY, 'jobs', 'recipes')
COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {'SCALAR': 1, 'VEC2': 2, 'VEC3': 3, 'VEC4': 4}


def strip(path, copy, sets=('TEXCOORD_1',)):
    """Writes the scene without its lightmap layout."""
    scene = glb.Scene()
    scene.load(path)
    for mesh in scene.document['meshes']:
        for primitive in mesh['primitives']:
            for name in sets:
                primitive['attributes'].pop(name, None)
    return scene.write(copy)


class Scene:
    """A .glb's triangles in the world, by node."""

    def __init__(self, path):
        with open(path, 'rb') as f:
            data = f.read()
        length = struct.unpack_from('<I', data, 12)[0]
        self.document, self.blob = json.loads(data[20:20 + length]), data[28 + length:]
        self.corners, self.node = [], []
        for root in self.document['scenes'][self.document.get('scene', 0)]['nodes']:
            self._walk(root, np.eye(4))
        self.node = np.concatenate([np.full(len(c), n) for c, n in zip(self.corners, self.node)])
        self.corners = np.concatenate(self.corners)
        self.cross = np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
        self.area = np.linalg.norm(self.cross, axis=1) / 2

    def name(self, node):
        return self.document['nodes'][node].get('name', '')

    def _accessor(self, index):
        a = self.document['accessors'][index]
        view, kind, width = self.document['bufferViews'][a['bufferView']], np.dtype(
            COMPONENTS[a['componentType']]), WIDTHS[a['type']]
        start = view.get('byteOffset', 0) + a.get('byteOffset', 0)
        stride = view.get('byteStride', kind.itemsize * width)
        return np.ndarray((a['count'], width), kind, self.blob, start, (stride, kind.itemsize))

    def _walk(self, index, above):
        node = self.document['nodes'][index]
        world = above @ transform(node)
        if 'mesh' in node:
            for p in self.document['meshes'][node['mesh']]['primitives']:
                if p.get('mode', 4) != 4:
                    continue
                position = self._accessor(p['attributes']['POSITION']).astype(float) @ world[:3, :3].T + world[:3, 3]
                order = self._accessor(p['indices']).ravel() if 'indices' in p else np.arange(len(position))
                corners = position[order.reshape(-1, 3)]
                self.corners.append(corners[:, ::-1] if np.linalg.det(world[:3, :3]) < 0 else corners)
                self.node.append(index)
        for child in node.get('children', ()):
            self._walk(child, world)


def transform(node):
    if 'matrix' in node:
        return np.array(node['matrix'], float).reshape(4, 4).T
    x, y, z, w = node.get('rotation', (0, 0, 0, 1))
    m = np.eye(4)
    m[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    m[:3, :3] *= np.array(node.get('scale', (1, 1, 1)), float)
    m[:3, 3] = node.get('translation', (0, 0, 0))
    return m


class Reference:
    """Irradiance at places from the surface points of a bake: see the top."""

    def __init__(self, bake):
        self.points, self.names = bake.points, np.array(bake.names())
        self.names = np.array([n.split('/')[0] for n in self.names])

    def at(self, position, normal, name):
        """(E, least, most, texel) of luminance and colour at a place, or None where no texel is near: `least` and
        `most` are those of the points around it, E a (3,) array."""
        p = self.points
        own = np.flatnonzero(p.valid & (p.side == 0) & (self.names[p.object] == name) & (p.normal @ normal > 0.8))
        if len(own) == 0:
            return None
        away = p.position[own] - position
        distance = np.linalg.norm(away, axis=1)
        texel = np.sqrt(np.quantile(p.area[own[np.argsort(distance)[:25]]], 0.75))
        near = (distance < 2.5 * texel) & (np.abs(away @ normal) < 0.2 * texel)
        if near.sum() < 5 or distance[near].min() > texel:
            return None
        away, distance, e = away[near], distance[near], p.total[own[near]]
        tangent = np.linalg.svd(normal[None, :])[2][1:]
        design = np.c_[np.ones(len(away)), away @ tangent.T / texel]
        weight = np.exp(-0.25 * (distance / (0.8 * texel)) ** 2)[:, None]  # its square root, as least squares wants it
        fit = np.linalg.lstsq(design * weight, e * weight, rcond=1e-3)[0][0]
        around = e[distance < 1.6 * texel]
        return fit, around.min(0), around.max(0), texel


def places(scene, reference, count, seed):
    """`count` random places on the scene's surfaces, by area, where the reference has an answer: a list of dicts, and
    how many were asked for in vain (buried, or on objects without a texel near)."""
    rng, found, vain = np.random.default_rng(seed), [], 0
    share = np.cumsum(scene.area) / scene.area.sum()
    while len(found) < count and vain < 20 * count:
        t = int(np.searchsorted(share, rng.random()))
        a, b = rng.random(2)
        a, b = (1 - a, 1 - b) if a + b > 1 else (a, b)
        corner = scene.corners[t]
        position = corner[0] + a * (corner[1] - corner[0]) + b * (corner[2] - corner[0])
        normal = scene.cross[t] / (2 * scene.area[t])
        answer = reference.at(position, normal, scene.name(scene.node[t]))
        if answer is None:
            vain += 1
            continue
        found.append(dict(position=position, normal=normal, name=scene.name(scene.node[t]), E=answer[0],
                          least=answer[1], most=answer[2],
                          texel=answer[3]))
    return found, vain


def reach_of(scene):
    """How far above a place a camera may stand: little, for what is above must not hide it."""
    return 1e-4 * float(np.linalg.norm(np.ptp(scene.corners.reshape(-1, 3), axis=0)))


def judge(checks, table, engine, found, seen, tolerance, shares):
    """Compares what an engine saw, [{irradiance, hit}], with the reference, by luminance. A place is even where the
    points around it differ by a tenth at most: what is seen there must be within `tolerance` of the reference. At the
    others, edges of shadows, contacts and what is hardly larger than a texel, a texel's size shows: it must lie between
    the darkest and the brightest point around, give or take `tolerance`. `shares`: how many of either must. Places
    where the engine sees another surface do not count, but may be few only."""
    lum = lambda e: float(harness.LUMINANCE @ e)
    floor = 1e-3 * float(np.mean([lum(f['E']) for f in found]))
    even, steep, hidden, off = [], [], 0, []
    for f, s in zip(found, seen):
        if s['irradiance'] is None or s['hit'] is None or np.linalg.norm(np.array(s['hit']) - f['position']) > f[
            'texel'] / 20:
            hidden += 1
            continue
        e, r, least, most = lum(s['irradiance']), lum(f['E']), lum(f['least']), lum(f['most'])
        if most - least <= 0.1 * r:
            even.append((e - r) / max(r, floor))
            good = abs(e - r) <= tolerance * r + floor
        else:
            good = least * (1 - tolerance) - floor <= e <= most * (1 + tolerance) + floor
            steep.append(good)
        if not good:
            off.append('   %s at %s: seen %.5g, reference %.5g, around it %.5g to %.5g' %
                       (f['name'], np.round(f['position'], 4), e, r, least, most))
    d = np.array(even)
    within, between = float(np.mean(np.abs(d) <= tolerance)) if even else 0.0, float(np.mean(steep)) if steep else 1.0
    percent = lambda x: '%.1f %%' % (100 * x)
    table.row(engine, len(found), hidden, len(even), percent(within), '%.2f %%' % (100 * np.median(np.abs(d))),
              '%+.2f %%' % (100 * d.mean()),
              len(steep), percent(between))
    print('\n'.join(off[:8]))
    checks.that(hidden <= 0.1 * len(found), '%s: %d of %d places are hidden or not drawn' %
                (engine, hidden, len(found)))
    checks.that(len(even) > 0 and within >= shares[0], '%s: only %.1f %% of the even places are within %.0f %%' %
                (engine, 100 * within, 100 * tolerance))
    checks.that(between >= shares[1], '%s: only %.1f %% of the steep places lie between what is around them' %
                (engine, 100 * between))


def table():
    return harness.Table(('engine', 34), ('places', 6), ('hidden', 6), ('even', 4), ('within 2 %', 10), ('median', 7),
                         ('mean', 8), ('steep', 5),
                         ('between', 8))
