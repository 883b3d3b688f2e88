"""Coarse meshes with smooth normals are lit as the smooth surface that they stand for, without black facets.

Balls of few facets against closed forms about the smooth normal, which is the way from the middle: I cos / d2 under a
point light, S cos under a sun, pi (1 + cos 0) / 2 L under a whole sky, open on all sides; the furnace of a room that
shines as its ball does. Facets at the terminator, which turn away from the light, are lit where the smooth surface is.
A sheet that stands between the facets and the smooth surface lets no light of its other side through, and the case of
../shared/scenes/own/cases/i3.glb is right, where it is here.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

SUN, RINGS = 10.0, 5
PLAIN = ('--samples-probe', 0, '--denoise', 'none', '--no-stitch', '--no-export')


def ball(scene, material, radius=1.0, rings=RINGS):
    """Of 2 x rings x rings facets about the origin; its layout has a chart for each pair of facets."""
    points, layout, normals, triangles = [], [], [], []
    wide, high = 2 * rings, rings
    for i in range(rings):
        for k in range(2 * rings):
            first = len(points)
            for di, dk in ((0, 0), (1, 0), (1, 1), (0, 1)):
                a, b = math.pi * (i + di) / rings, math.pi * (k + dk) / rings
                normal = (math.sin(a) * math.cos(b), math.cos(a), -math.sin(a) * math.sin(b))
                points.append([radius * c for c in normal])
                normals.append(normal)
                layout.append(((k + 0.06 + 0.88 * dk) / wide, (i + 0.06 + 0.88 * di) / high))
            triangles += [(first, first + 1, first + 2)] * (i < rings - 1)
            triangles += [(first, first + 2, first + 3)] * (i > 0)
    with np.errstate(invalid='ignore'):  # corners at the poles that no triangle has
        scene.mesh('ball', points, layout, triangles, material)
    accessor = scene.document['meshes'][-1]['primitives'][0]['attributes']['NORMAL']
    view = scene.document['bufferViews'][scene.document['accessors'][accessor]['bufferView']]
    data = np.asarray(normals, np.float32).tobytes()
    scene.blob[view['byteOffset']:view['byteOffset'] + len(data)] = data


def bake(kiln, checks, scene, name, *options, density=8):
    path = scene if isinstance(scene, str) else scene.write(os.path.join(kiln.scratch, name + '.glb'))
    found = kiln.bake(path, '--texels-per-metre', density, *PLAIN, *options)
    if not checks.baked(found):
        return None, None, None
    points, own = found.points, found.points.of(found.index('ball'))
    position = points.position[own]
    return found, own, position / np.linalg.norm(position, axis=1)[:, None]


def judge(checks, table, name, process, got, want, cosine, allowed):
    """Where the smooth surface faces the light by a cosine of 0.02, no texel has less than half of its light."""
    low = (cosine > 0.02) & (cosine < 0.1)
    dark = int((got[low] < 0.5 * want[low]).sum())
    off = math.sqrt(float(((got - want) ** 2).mean())) / want.mean()
    checks.that(dark == 0 and low.sum() > 10, '%s: %d of %d texels at the terminator are dark' %
                (name, dark, low.sum()), process)
    checks.that(off < allowed, '%s: off by %.2g of the mean, rms' % (name, off), process)
    checks.that(not got[cosine < -0.05].any(), '%s: light beyond the terminator' % name, process)
    table.row(name, '%d of %d' % (dark, low.sum()), '%.2e' % off)


def check_point(kiln, checks, table):
    """Also the shared case, of 16 x 8 faces on a floor, but with --few."""
    lamp, power = np.array([3.0, 4.0, -1.0]), 100.0
    scene = glb.Scene()
    ball(scene, scene.material('grey', (0.5,) * 3))
    scene.light('lamp', {'type': 'point', 'intensity': power}, translation=list(map(float, lamp)))
    shared = os.path.join(harness.SHARED, 'own', 'cases', 'i3.glb')
    for name, given in (('point light', scene), ('i3', shared)):
        if isinstance(given, str) and (kiln.few or not os.path.exists(given)):
            continue
        found, own, smooth = bake(kiln, checks, given, 'point', '--samples-direct', 64, '--bounces', 0)
        if found is None:
            return
        to = lamp - found.points.position[own]
        distance = np.linalg.norm(to, axis=1)
        cosine = (to * smooth).sum(1) / distance
        judge(checks, table, name, found.process, found.points.total[own, 1],
              power * np.maximum(cosine, 0) / distance ** 2, cosine, 0.01)
        found.remove()


def check_sun(kiln, checks, table):
    scene = glb.Scene()
    ball(scene, scene.material('grey', (0.5,) * 3))
    turn = math.radians(110)  # about x: -z becomes (0, -sin, -cos)
    scene.light('sun', {'type': 'directional', 'intensity': SUN},
                rotation=[-math.sin(turn / 2), 0, 0, math.cos(turn / 2)])
    cosines = lambda smooth: smooth @ np.array([0, math.sin(turn), math.cos(turn)])
    found, own, smooth = bake(kiln, checks, scene, 'sun', '--samples-direct', 64, '--bounces', 0)
    if found is None:
        return
    judge(checks, table, 'sun', found.process, found.points.total[own, 1], SUN * np.maximum(cosines(smooth), 0),
          cosines(smooth), 0.01)
    found.remove()


def check_sky(kiln, checks, table):
    scene = glb.Scene()
    ball(scene, scene.material('grey', (0.5,) * 3))
    scene.environment((1.0, 1.0, 1.0))
    found, own, _ = bake(kiln, checks, scene, 'sky', '--samples-direct', 256, '--bounces', 0, '--ambient-occlusion', 1,
                         density=3)
    if found is None:
        return
    light, area = found.points.total[own, 1], found.points.area[own]
    mean = float((light * area).sum() / area.sum())
    opening = found.points.quantities['ambient_occlusion'][own]
    checks.that(abs(mean / math.pi - 1) < 0.02, 'sky: mean %g instead of pi' % mean, found.process)
    checks.that(opening.min() > 0.97, 'sky: %g of a place is open' % opening.min(), found.process)
    table.row('sky', 'open %.4f' % opening.min(), '%+.2e' % (mean / math.pi - 1))
    found.remove()


def check_furnace(kiln, checks, table):
    scene = glb.Scene()
    glowing = scene.material('glowing', (0.5,) * 3, (1.0,) * 3)
    ball(scene, glowing)
    glb.box(scene, 'room', (-2, -2, -2), (2, 2, 2), glowing, range(6))
    found, own, _ = bake(kiln, checks, scene, 'furnace', '--samples-direct', 64, '--samples-bounce', 32,
                         '--samples-indirect', 64, '--bounces', 12, density=3)
    if found is None:
        return
    light, area = found.points.total[own, 1], found.points.area[own]
    mean = float((light * area).sum() / area.sum()) / (2 * math.pi)
    checks.that(abs(mean - 1) < 0.02, 'furnace: mean %g of what is right' % mean, found.process)
    table.row('furnace', '', '%+.2e' % (mean - 1))
    found.remove()


def check_sheet(kiln, checks, table):
    """The facet at +x lies 0.905 from the middle, the smooth surface 1: between them a sheet, a lamp behind it."""
    scene = glb.Scene()
    ball(scene, scene.material('grey', (0.5,) * 3))
    sheet = scene.material('sheet', (0, 0, 0), double_sided=True)
    scene.quad('sheet', [(0.93, -3, 3), (0.93, -3, -3), (0.93, 3, -3), (0.93, 3, 3)], sheet)
    scene.light('lamp', {'type': 'point', 'intensity': 100.0}, translation=[3, 0, 0])
    found, own, smooth = bake(kiln, checks, scene, 'sheet', '--samples-direct', 64, '--bounces', 0, density=12)
    if found is None:
        return
    position, light = found.points.position[own], found.points.total[own, 1]
    size = math.sqrt(float(found.points.area[own].max()))
    before = (position[:, 0] < 0.93 - 0.5 * size) & (smooth[:, 0] > 0.5)
    checks.that(before.sum() > 20 and not light[before].any(), 'sheet: light of %g through it, on %d of %d texels' %
                (light[before].max() if before.any() else 0, (light[before] > 0).sum(), before.sum()), found.process)
    table.row('sheet', '%d texels' % before.sum(), '%g' % light[before].max())
    found.remove()


def main():
    every = {'point': check_point, 'sun': check_sun, 'sky': check_sky, 'furnace': check_furnace, 'sheet': check_sheet}
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--only', action='append', choices=every, help='these cases'),
        lambda p: p.add_argument('--few', action='store_true', help='a point light over one ball'))
    kiln.few = arguments.few
    checks = harness.Checks()
    table = harness.Table(('light', 14), ('dark there', 16), ('off', 12))
    for name in arguments.only or every:
        every[name](kiln, checks, table)
    checks.end()


if __name__ == '__main__':
    main()
