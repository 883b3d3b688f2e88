"""Interiors with doubleSided on every material, baked as they are and with what that means written out: every triangle
that is no part of a solid gets a twin, turned round and moved back by a hair, and all are single-sided. Objects' means
must agree.

Run by hand: python3 tests/reference/sides_third_party.py --kiln build/release/kiln [--scene NAME ...]
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

TYPES = {5126: np.float32, 5125: np.uint32, 5123: np.uint16, 5121: np.uint8}
HAIR = 1e-5  # of the scene's size


def read(scene, index):
    accessor = scene.document['accessors'][index]
    view = scene.document['bufferViews'][accessor['bufferView']]
    count = {'SCALAR': 1, 'VEC2': 2, 'VEC3': 3, 'VEC4': 4}[accessor['type']]
    kind = np.dtype(TYPES[accessor['componentType']])
    at = view.get('byteOffset', 0) + accessor.get('byteOffset', 0)
    stride = view.get('byteStride', kind.itemsize * count)
    return np.array(np.ndarray((accessor['count'], count), kind, bytes(scene.blob), at, (stride, kind.itemsize)))


def is_lamp(material):
    return any(c > 0 for c in material.get('emissiveFactor', [0, 0, 0]))


def solids(positions, triangles):
    """For each triangle whether its piece is closed and turned outwards (worker/scene/solids.h), by another way: sorted
    corners."""
    _, welded = np.unique(positions + 0.0, axis=0, return_inverse=True)
    corners = welded.reshape(-1)[triangles]
    parent = np.arange(len(corners))

    def root(i):
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        return i

    balance, first = {}, {}
    for t, c in enumerate(corners):
        for a, b in ((c[0], c[1]), (c[1], c[2]), (c[2], c[0])):
            if a == b:
                continue
            key = (min(a, b), max(a, b))
            balance[key] = balance.get(key, 0) + (1 if a < b else -1)
            parent[root(t)] = root(first.setdefault(key, t))
    roots = np.array([root(t) for t in range(len(corners))])
    opened = {root(first[k]) for k, n in balance.items() if n}
    p = positions.astype(float) - positions[0]
    volume = np.einsum('ij,ij->i', p[triangles[:, 0]], np.cross(p[triangles[:, 1]], p[triangles[:, 2]]))
    return np.array([r not in opened and volume[roots == r].sum() > 0 for r in roots])


def flagged(path, copy):
    scene = glb.Scene()
    scene.load(path)
    for material in scene.document['materials']:
        if not is_lamp(material):
            material['doubleSided'] = True
    return scene.write(copy)


def written_out(path, copy):
    scene = glb.Scene()
    scene.load(path)
    materials, meshes = scene.document['materials'], scene.document['meshes']
    for material in materials:
        if not is_lamp(material):
            material['doubleSided'] = False
    largest = max(float(np.ptp(read(scene, p['attributes']['POSITION']), 0).max()) for m in meshes
                  for p in m['primitives'])
    twins = {}
    for number, mesh in list(enumerate(meshes)):
        parts = mesh['primitives']
        if any(is_lamp(materials[p['material']]) for p in parts):
            continue
        shift, positions, triangles = 0, [], []
        for p in parts:
            positions.append(read(scene, p['attributes']['POSITION']))
            triangles.append(read(scene, p['indices']).reshape(-1, 3).astype(np.int64) + shift)
            shift += len(positions[-1])
        solid = solids(np.concatenate(positions), np.concatenate(triangles))
        kept, at, before = [], 0, 0
        for p, position, all_triangles in zip(parts, positions, triangles):
            chosen = all_triangles[~solid[at:at + len(all_triangles)]] - before
            at, before = at + len(all_triangles), before + len(position)
            if len(chosen) == 0:
                continue
            flat = position[chosen].reshape(-1, 3).astype(float)
            normal = np.cross(flat[1::3] - flat[0::3], flat[2::3] - flat[0::3])
            normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
            moved = (flat - HAIR * largest * np.repeat(normal, 3, 0)).astype(np.float32).reshape(-1, 3, 3)[
                :, ::-1].reshape(-1, 3)
            attributes = {'POSITION': scene.accessor(moved, 'VEC3', 5126, 34962)}
            scene.document['accessors'][-1].update(min=moved.min(0).tolist(), max=moved.max(0).tolist())
            for name in ('TEXCOORD_0', 'TEXCOORD_1'):
                if name in p['attributes']:
                    uv = read(scene, p['attributes'][name])[chosen][:, ::-1].reshape(-1, 2).astype(np.float32)
                    attributes[name] = scene.accessor(uv, 'VEC2', 5126, 34962)
            indices = scene.accessor(np.arange(len(moved), dtype=np.uint32), 'SCALAR', 5125, 34963)
            kept.append({'attributes': attributes, 'indices': indices, 'material': p['material'], 'mode': 4})
        if kept:
            meshes.append({'name': mesh.get('name', '') + '_twin', 'primitives': kept})
            twins[number] = len(meshes) - 1
    for node in list(scene.document['nodes']):
        if node.get('mesh') in twins:
            child = {'name': node.get('name', 'node') + '_twin', 'mesh': twins[node['mesh']]}
            scene.document['nodes'].append(child)
            node.setdefault('children', []).append(len(scene.document['nodes']) - 1)
    return scene.write(copy)


def means(bake):
    p, found = bake.points, {}
    for index, name in enumerate(bake.names()):
        chosen = p.of(index)
        if name.endswith('_twin') or len(chosen) == 0:
            continue
        weight = p.area[chosen] / p.area[chosen].sum()
        all_front = (p.object == index) & (p.side == 0)
        found[name] = (float((p.total[chosen] @ harness.LUMINANCE * weight).sum()),
                       math.sqrt(((p.error[chosen] * weight) ** 2).sum()),
                       1 - float(p.valid[all_front].mean()), len(chosen))
    return found


def main():
    def more(parser):
        parser.add_argument('--scene', action='append')
        parser.add_argument('--samples', type=int, default=1024)

    options, kiln = harness.start(__doc__, more)
    checks = harness.Checks()
    for name in options.scene or ('veach_ajar', 'dining_room', 'classroom'):
        source, seeds = harness.need_shared('third_party', name + '.glb'), (0, 1, 2)
        table = harness.Table((name, 24), ('points', 8), ('as it is', 10), ('written out', 12), ('apart', 8),
                              ('errors', 7))
        runs = []
        for make in (flagged, written_out):
            scene = make(source, os.path.join(kiln.scratch, 'scene.glb'))
            found = []
            # what seeds say of an object's mean is its true error: noise of the bounces is shared by neighbours
            for seed in seeds:
                bake = kiln.bake(scene, '--samples-direct', 64, '--samples-bounce', 64, '--samples-indirect',
                                 options.samples, '--samples-probe', 0,
                                 '--seed', seed, '--texels-per-metre', 8, '--lightmap-max', 256, timeout=1800)
                if not checks.baked(bake):
                    checks.end()
                found.append(means(bake))
                bake.remove()
            runs.append(found)
        wrong = 0
        for what in runs[0][0]:
            if what not in runs[1][0] or runs[0][0][what][3] < 16:
                continue
            value = [np.array([f[what][0] for f in found]) for found in runs]
            a, b = value[0].mean(), value[1].mean()
            error = math.sqrt(sum((v.var(ddof=1) / len(v)) for v in value)) + 1e-9
            error = max(error, math.hypot(runs[0][0][what][1], runs[1][0][what][1]) / math.sqrt(len(seeds)))
            off = abs(a - b) / error
            # Student's t of few seeds has long tails; a hair of distance is seen at 1 %
            wrong += off > 4 and abs(a / b - 1) > 0.01
            table.row(what[:24], runs[0][0][what][3], '%.4g' % a, '%.4g' % b, '%+.2f %%' % (100 * (a / b - 1)),
                      '%.1f' % off)
        checks.that(wrong == 0, '%s: %d objects are apart by more than 4 standard errors and 1 %%' % (name, wrong))
    checks.end()


if __name__ == '__main__':
    main()
