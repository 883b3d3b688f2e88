"""A dark room behind a wall has no light, whatever the texels.

A closed room with a lamp is divided by a wall from floor to ceiling: 1 cm thick with two faces, or a sheet without
thickness, along the texels or askew. Texels of floor, ceiling and walls lie on both sides of it. In the dark part there
may be 1e-4 of the light of the lit part, at any size of the texels (goal; in fact there is none). Texels that the wall
divides are counted in run.json; with a gap below the wall, light goes through and no texel of the floor is divided.
What stands within a thick wall has no light: texels have as much light in all as the lamp sends.

A closed room without a lamp, one of whose walls reaches a little past the ceiling into the light outdoors, is dark
where that wall and the ceiling meet, too, though most of a texel there is outdoors. Of a board that a wall is built
round, texels have the light of the part that is seen.

Under the sky, on the ground beside a hollow wall, no texel is dark: the wall's inside is no room, though it is high and
long and sees no sky.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

WALL = 0.1  # x of the middle of the wall at z = 0
SHELL = ('floor', 'ceiling', 'back', 'front', 'left', 'right')


def room(path, degrees, thickness, gap=0.0, shelf=False):
    """A room of 4 x 2 x 2 m. thickness 0: a double-sided sheet. shelf: a board in the wall, 3 cm of which are in the
    lit part; the rest lies in a cavity."""
    scene = glb.Scene()
    white, lamp = scene.material('white', (0.7, 0.7, 0.7)), scene.material('lamp', (0, 0, 0), (1, 1, 1))
    low, high = (-2, 0, -1), (2, 2, 1)

    def corners(*chosen):
        return [tuple((low, high)[int(c)][a] for a, c in enumerate(bits)) for bits in chosen]
    for name, bits in zip(SHELL, (('001', '101', '100', '000'), ('010', '110', '111', '011'),
                                  ('000', '100', '110', '010'), ('101', '001', '011', '111'),
                                  ('001', '000', '010', '011'), ('100', '101', '111', '110'))):
        scene.quad(name, corners(*bits), white)
    scene.quad('lamp', [(-1.25, 1.99, -.25), (-.75, 1.99, -.25), (-.75, 1.99, .25), (-1.25, 1.99, .25)], lamp)
    slope, cosine = math.tan(math.radians(degrees)), math.cos(math.radians(degrees))

    def place(height, z, side):
        return (WALL + z * slope + side * thickness / 2 / cosine, height, z)
    paper = white if thickness > 0 else scene.material('paper', (0.7, 0.7, 0.7), double_sided=True)
    scene.quad('dark face', [place(gap, 1, 1), place(gap, -1, 1), place(2, -1, 1), place(2, 1, 1)], paper)
    if thickness > 0:
        scene.quad('lit face', [place(gap, -1, -1), place(gap, 1, -1), place(2, 1, -1), place(2, -1, -1)], paper)
    for name, low_x, y in (('board', WALL - 0.03, 1.0), ('over', WALL, 1.06), ('under', WALL, 0.94)) if shelf else ():
        scene.quad(name, [(low_x, y, 0.3), (WALL + 0.4, y, 0.3), (WALL + 0.4, y, -0.3), (low_x, y, -0.3)], paper)
    return scene.write(path)


def bake_room(kiln, checks, degrees, thickness, texels, gap=0.0, more=()):
    """Mean light of the dark part over that of the lit part, and how many texels the wall divides; None: no bake."""
    bake = kiln.bake(room(os.path.join(kiln.scratch, 'room.glb'), degrees, thickness, gap), '--lightmap-size', texels,
                     '--samples-direct', kiln.samples(64), '--samples-bounce', kiln.samples(32), '--samples-indirect',
                     kiln.samples(64), '--samples-probe', 0, '--denoise', 'none', *more)
    if not checks.baked(bake):
        return None
    points, sides = bake.points, ([], [])
    for name in SHELL:
        chosen = points.of(bake.index(name))
        across = (points.position[chosen, 0] - WALL - points.position[chosen, 2] * math.tan(math.radians(degrees)))
        for side, there in ((0, across < -6 / texels), (1, across > 6 / texels)):
            sides[side].append(points.total[chosen[there], 1] * points.area[chosen[there]])
    lit, dark = (np.concatenate(s).sum() for s in sides)
    found = dark / lit, bake.run['points']['divided'], bake.process
    bake.remove()
    return found


def check_light(kiln, checks, table):
    """Light of texels in all against the lamp's, traced. Within the wall, which is 10 cm thick, lie 1.4 % of the lit
    areas; what lies before it in a texel that is mostly behind has a neighbour's light, which is 0.2 % too much."""
    bake = kiln.bake(room(os.path.join(kiln.scratch, 'room.glb'), 0, 0.1), '--lightmap-size', 12, '--samples-direct',
                     kiln.samples(256), '--bounces', 0, '--samples-probe', 0, '--denoise', 'none')
    if not checks.baked(bake):
        return
    light = bake.run['energy']['first_light']['direct']
    off, error = light['difference'] / light['traced'][1], light['error'] / light['traced'][1]
    checks.that(abs(off) < 0.004 and 0 < error < 0.001,
                'light in texels is off by %.2g of the lamp\'s, error %.2g' % (off, error), bake.process)
    table.row('0 degrees, 100 mm', 12, bake.run['points']['divided'], 'light %+.2g' % off)
    bake.remove()


def room_with_rim(path, rim):
    """A closed room of 4 x 2 x 2 m of double-sided sheets; the left wall goes on for `rim` m above the ceiling."""
    scene = glb.Scene()
    paper = scene.material('paper', (0.7, 0.7, 0.7), double_sided=True)
    low, high = (-2, 0, -1), (2, 2, 1)
    for name, bits in zip(SHELL, (('001', '101', '100', '000'), ('010', '110', '111', '011'),
                                  ('000', '100', '110', '010'), ('101', '001', '011', '111'),
                                  ('001', '000', '010', '011'), ('100', '101', '111', '110'))):
        corners = [[(low, high)[int(c)][a] for a, c in enumerate(b)] for b in bits]
        if name == 'left':
            corners = [[x, y + rim if y > 1 else y, z] for x, y, z in corners]
        scene.quad(name, [tuple(c) for c in corners], paper)
    return scene.write(path)


def check_rim(kiln, checks, table):
    """The texels of the left wall that the ceiling cuts: by the heights of others, where they begin and end."""
    for density in (4.4, 5.2):
        bake = kiln.bake(room_with_rim(os.path.join(kiln.scratch, 'room.glb'), 0.16), '--texels-per-metre', density,
                         '--environment', '1,1,1', '--samples-direct', 16, '--bounces', 1, '--samples-probe', 0,
                         '--denoise', 'none')
        if not checks.baked(bake):
            return
        points, wall = bake.points, bake.points.of(bake.index('left'))
        height = points.position[:, 1]
        inner = wall[(height[wall] > 0.3) & (height[wall] < 1.6)]
        axis = max((points.x, points.y), key=lambda a: abs(np.corrcoef(a[inner], height[inner])[0, 1]))
        size, first = np.polyfit(axis[inner], height[inner], 1)
        middle = first + size * axis[wall]
        is_cut = np.abs(middle - 2) < 0.49 * abs(size)
        rim = middle[is_cut].max() + abs(size) / 2 - 2
        light = points.total[wall[is_cut]].max()
        checks.that(rim > 0.6 * abs(size), 'only %.2f of a texel is outdoors' % (rim / abs(size)), bake.process)
        checks.that(is_cut.sum() <= bake.run['points']['divided'] and light == 0,
                    'of %d texels at a rim %d are divided, the light there is %g' %
                    (is_cut.sum(), bake.run['points']['divided'], light), bake.process)
        table.row('rim, %.2f of a texel' % (rim / abs(size)), '%.2f m' % abs(size), is_cut.sum(), '%.1e' % light)
        bake.remove()


def check_shelf(kiln, checks, table):
    """What is seen of a board is no rim: its texels have the lit part's light though the board goes on in the wall."""
    bake = kiln.bake(room(os.path.join(kiln.scratch, 'room.glb'), 0, 0, shelf=True), '--texels-per-metre', 25,
                     '--samples-direct', 16, '--bounces', 0, '--samples-probe', 0, '--denoise', 'none')
    if not checks.baked(bake):
        return
    points, board = bake.points, bake.points.of(bake.index('board'))
    x = points.position[board, 0]
    rim, deep = board[x < WALL], board[x > WALL + 0.02]
    checks.that(len(rim) > 10 and len(deep) > 10 * len(rim) / 2 and
                points.total[rim, 1].min() > 0 and points.total[deep].max() == 0,
                'of a board %d points lie in the lit part, the light there is %g at least; in the wall %d, %g at most' %
                (len(rim), points.total[rim, 1].min() if len(rim) else 0, len(deep),
                 points.total[deep].max() if len(deep) else 0), bake.process)
    table.row('board', '0.04 m', len(rim), '%.1e' % points.total[deep].max())
    bake.remove()


def hollow_wall(path, width, height=2.7, length=4.0):
    """A square of ground, on which a wall of double-sided sheets with a lid stands in the middle."""
    scene = glb.Scene()
    paper = scene.material('paper', (0.7, 0.7, 0.7), double_sided=True)
    x, z = width / 2, length / 2
    scene.quad('ground', [(-3, 0, 3), (3, 0, 3), (3, 0, -3), (-3, 0, -3)], paper)
    for name, at in (('left', -x), ('right', x)):
        scene.quad(name, [(at, 0, z), (at, 0, -z), (at, height, -z), (at, height, z)], paper)
    for name, at in (('near', z), ('far', -z)):
        scene.quad(name, [(-x, 0, at), (x, 0, at), (x, height, at), (-x, height, at)], paper)
    scene.quad('lid', [(-x, height, z), (x, height, z), (x, height, -z), (-x, height, -z)], paper)
    return scene.write(path)


def check_hollow(kiln, checks, table):
    """The lightmap of the ground beside hollow walls: beside a wide one half of the sky is seen, or nearly."""
    for width, density in ((0.18, 8.1), (0.25, 7.3), (0.3, 6.1), (0.3, 3.7)):
        bake = kiln.bake(hollow_wall(os.path.join(kiln.scratch, 'hollow.glb'), width), '--texels-per-metre', density,
                         '--environment', '1,1,1', '--samples-direct', 64, '--bounces', 0, '--samples-probe', 0,
                         '--denoise', 'none')
        if not checks.baked(bake):
            return
        ground = bake.lightmap('ground')
        side = 6 / ground.width
        x = np.abs((np.arange(ground.width) + 0.5) * side - 3)
        seen = ground.irradiance[:, x - side / 2 > width / 2 - 0.45 * side, 1]
        least = seen[ground.height // 8:-ground.height // 8].min()
        checks.that(least > 0.5, 'beside a hollow wall of %g m the ground has %g, of %g in the open' %
                    (width, least, math.pi), bake.process)
        table.row('hollow, %g m' % width, '%.2f m' % side, bake.run['points']['divided'], '%.2f' % least)
        bake.remove()


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('wall', 24), ('texels', 8), ('divided', 8), ('dark / lit', 12))
    walls = ((0, 0.01, 12), (0, 0.01, 24), (0, 0, 12), (17, 0.01, 12), (17, 0, 24), (45, 0.01, 24), (45, 0, 12))
    # the walls are found by the host: of a device the look-ups count
    for degrees, thickness, texels in walls if kiln.backend == 'embree' else ((45, 0, 12),):
        found = bake_room(kiln, checks, degrees, thickness, texels)
        if found is None:
            continue
        name = '%g degrees, %g mm' % (degrees, 1000 * thickness)
        checks.that(found[0] <= 1e-4, '%s, %d texels: dark / lit is %g' % (name, texels, found[0]), found[2])
        checks.that(found[1] >= 4 * texels, '%s, %d texels: only %d are divided' % (name, texels, found[1]), found[2])
        table.row(name, texels, found[1], '%.1e' % found[0])
    if kiln.backend == 'embree':
        check_light(kiln, checks, table)
        check_rim(kiln, checks, table)
        check_shelf(kiln, checks, table)
        check_hollow(kiln, checks, table)
    found = bake_room(kiln, checks, 0, 0.01, 12, gap=0.2)
    if found is not None:
        checks.that(found[0] > 1e-3 and found[1] <= 3 * 12, 'above a gap: dark / lit is %g, %d texels are divided' %
                    found[:2], found[2])
        table.row('above a gap', 12, found[1], '%.1e' % found[0])
    checks.end()


if __name__ == '__main__':
    main()
