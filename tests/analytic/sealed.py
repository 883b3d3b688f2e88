"""Rooms that are sealed have no light of the sky outside, exactly, wherever they are seen from inside.

Walls, floor and ceiling are sheets or boxes that reach past each other, or past the floor: texels lie on both sides of
a wall, and a corner's texel on four. In every bounce what is inside has no light, at any size of the texels, of sheets
with one side and with two, of six meshes and of one, askew too. What is outside has light. Views from the middle of the
room are black: no texel that is read beside a wall shows the light outdoors.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import exr  # noqa: E402
import glb  # noqa: E402
import harness  # noqa: E402

SIZE = np.array((5.03, 2.71, 4.07))
ASKEW = np.array(((0.92, 0.12, 0.37), (0.0, 0.95, -0.31), (-0.39, 0.29, 0.88)))
ASKEW = np.linalg.qr(ASKEW)[0] * np.sign(np.linalg.det(np.linalg.qr(ASKEW)[0]))


def rectangle(axis, at, low, high, way):
    """Corners of a rectangle across an axis that faces along it (way 1) or back (-1)."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    corners = np.zeros((4, 3))
    corners[:, axis] = at
    corners[:, u] = (low[u], high[u], high[u], low[u])
    corners[:, v] = (low[v], low[v], high[v], high[v])
    return corners if way > 0 else corners[::-1]


def wall(axis, at, out, low, high, thickness):
    """A sheet that faces inwards, or the six faces of a box behind that."""
    low, high = np.array(low, float), np.array(high, float)
    if thickness == 0:
        return [rectangle(axis, at, low, high, -out)]
    low[axis], high[axis] = sorted((at, at + out * thickness))
    return [rectangle(a, (low, high)[end][a], low, high, 2 * end - 1) for a in range(3) for end in (0, 1)]


def room(path, over=0.15, sunk=0.0, thickness=0.0, two_sided=False, joined=False, turn=np.eye(3)):
    scene = glb.Scene()
    white = scene.material('white', (0.7, 0.7, 0.7), double_sided=two_sided)
    low, high = -over * np.ones(3), SIZE + over
    low[1], high[1] = -sunk, SIZE[1] + sunk
    faces = []
    for axis in range(3):
        for out in (-1, 1):
            for corners in wall(axis, 0 if out < 0 else SIZE[axis], out, low, high, thickness):
                faces.append(corners @ turn.T)
    if joined:  # all charts on one square of the layout: kiln makes another one
        positions = np.concatenate(faces)
        triangles = [(4 * i + a, 4 * i + b, 4 * i + c) for i in range(len(faces)) for a, b, c in ((0, 1, 2), (0, 2, 3))]
        scene.mesh('room', positions, np.zeros((len(positions), 2)), triangles, white)
    else:
        for i, corners in enumerate(faces):
            scene.quad('face %d' % i, [tuple(c) for c in corners], white)
    return scene.write(path)


def inside(bake, turn):
    """Which points can be seen from inside."""
    points = bake.points
    before = (points.position + 1e-3 * points.normal) @ turn
    return points.valid & ((before > 0) & (before < SIZE)).all(1)


def brightest_view(kiln, checks, bake, turn):
    """The brightest pixel of views from the room's middle into its corners, the frames of one path."""
    path, image = (os.path.join(kiln.scratch, name) for name in ('corners.csv', 'view.exr'))
    corners = ((0, 0, 0), SIZE, (0, SIZE[1], SIZE[2]), (SIZE[0], 0, 0))
    with open(path, 'w', encoding='utf-8') as file:
        file.write('from.x,from.y,from.z,to.x,to.y,to.z\n')
        for corner in corners:
            file.write(','.join('%.9g' % x for x in (*(turn @ (SIZE / 2)), *(turn @ np.array(corner, float)))) + '\n')
    process = kiln.command('view', bake.directory, '--path', path, '--frames', len(corners), '--width', 120, '--height',
                           90, '--field-of-view', 100, '--backend', kiln.backend, '-o', image, '--quiet')
    if not checks.that(process.status == 0, 'the views ended with %d' % process.status, process):
        return math.nan
    return max(float(exr.rgb('%s-%04d.exr' % (image[:-4], i + 1)).max()) for i in range(len(corners)))


def check(kiln, checks, table, name, path, density, turn=np.eye(3), open_outside=True, view=True):
    bake = kiln.bake(path, '--environment', '1,1,1', '--texels-per-metre', density, '--samples-direct', 16,
                     '--samples-bounce', 4, '--samples-indirect', 16, '--bounces', 3, '--samples-probe', 0)
    if not checks.baked(bake):
        return
    points, seen = bake.points, inside(bake, turn)
    light, without = points.total[seen].max(), points.total[~seen & points.valid]
    checks.that(seen.sum() > 0.9 * density**2 * 2 * (SIZE[0] * SIZE[1] + SIZE[1] * SIZE[2] + SIZE[2] * SIZE[0]),
                '%s, %g texels/m: only %d points are seen from inside' % (name, density, seen.sum()), bake.process)
    checks.that(light == 0, '%s, %g texels/m: the light inside is %g' % (name, density, light), bake.process)
    checks.that(not open_outside or without.mean() > 0.5, '%s: no light outside' % name, bake.process)
    shown = brightest_view(kiln, checks, bake, turn) if view else 0.0
    checks.that(shown == 0, '%s, %g texels/m: a view from inside shows %g' % (name, density, shown), bake.process)
    table.row(name, '%g' % density, seen.sum(), bake.run['points']['divided'], '%.1e' % light, '%.1e' % shown)
    bake.remove()


def main():
    arguments, kiln = harness.start(__doc__, lambda p: p.add_argument('--few', action='store_true',
                                                                      help='a room and two cases'))
    checks = harness.Checks()
    table = harness.Table(('room', 24), ('texels/m', 9), ('points', 8), ('divided', 8), ('light', 8), ('view', 8))
    path = os.path.join(kiln.scratch, 'room.glb')
    few = kiln.backend == 'vulkan'
    rooms = (('sheets', {}), ('sheets, two sides', {'two_sided': True}), ('sheets, askew', {'turn': ASKEW}),
             ('boxes of 5 cm', {'thickness': 0.05}), ('walls reach down', {'over': 0.0, 'sunk': 0.1}),
             ('one mesh', {'joined': True}), ('one mesh, boxes', {'joined': True, 'thickness': 0.05}))
    for name, how in rooms[1:2] if arguments.few else rooms[:2] if few else rooms:
        for density in (4,) if few else (4, 10):
            check(kiln, checks, table, name, room(path, **how), density, how.get('turn', np.eye(3)))
    folder = os.path.join(harness.SHARED, 'own', 'cases')
    cases = ('sealed_over', 'sealed_sunk', 'sealed_exact')[:2 if arguments.few else 3]
    for case in cases if os.path.isdir(folder) else ():
        for density in (4,) if few else (4, 10, 25):
            check(kiln, checks, table, case, os.path.join(folder, case + '.glb'), density,
                  open_outside=case != 'sealed_exact', view=density < 25)
    checks.end()


if __name__ == '__main__':
    main()
