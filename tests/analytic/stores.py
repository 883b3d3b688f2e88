"""Octrees have the light of lightmaps, and need no texture coordinates.

A furnace is one within 1 %; every object of the Cornell box has the mean light that it has with lightmaps, within 1 %
and the error of the means; a wall between two rooms keeps the dark one below 1e-4 of the lit one, whether it stands
along the leaves or askew, thick or a sheet, and light goes through a gap below it; and three ranks, small cells and the
other partition give each leaf the same bits as one rank.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402
import walls  # noqa: E402

CORNELL = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
OCTREE = ('--store', 'octree', '--samples-probe', 0)
RADIANCE, ALBEDO = 1.0, 0.5  # of the furnace


def mean_of(points, index):
    chosen = points.of(index)
    light, area = points.total[chosen, 1], points.area[chosen]
    mean = np.average(light, weights=area)
    return mean, np.sqrt((points.error[chosen] ** 2 * area ** 2).sum()) / area.sum()


def furnace(kiln, checks, table):
    path = os.path.join(kiln.scratch, 'furnace.glb')
    made = kiln.command('generate', 'furnace', '--albedo', ALBEDO, '-o', path)
    checks.that(made.status == 0, made.sentence(), made)
    bake = kiln.bake(path, *OCTREE, '--leaf-size', 0.11, '--samples-direct', kiln.samples(256), '--samples-bounce',
                     kiln.samples(64), '--samples-indirect', kiln.samples(256), '--bounces', 'all')
    if not checks.baked(bake):
        return
    light = math.pi * RADIANCE / (1 - ALBEDO)
    mean = np.average(bake.points.total[:, 1], weights=bake.points.area)
    checks.that(abs(mean / light - 1) < 0.01, 'furnace: mean %g, should be %g' % (mean, light), bake.process)
    checks.that(bake.points.valid.all(), 'furnace: buried leaves', bake.process)
    checks.that(abs(bake.points.area.sum() / 6 - 1) < 1e-6, 'furnace: area %g' % bake.points.area.sum(), bake.process)
    checks.that('lightmap' not in bake.run['objects'][0] or bake.run['objects'][0]['lightmap'] is None,
                'furnace: a lightmap is named', bake.process)
    table.row('furnace', bake.points.count, '%.4f' % (mean / light))
    bake.remove()


def cornell(kiln, checks, table):
    options = ('--samples-probe', 0, '--texels-per-metre', 5, '--samples-direct', kiln.samples(256),
               '--samples-bounce', kiln.samples(64), '--samples-indirect', kiln.samples(256), '--bounces', 3,
               '--denoise', 'none')
    bakes = [kiln.bake(CORNELL, *options, '--store', store) for store in ('lightmap', 'octree')]
    if not all(checks.baked(b) for b in bakes):
        return
    for index, name in enumerate(bakes[0].names()):
        (a, error_a), (b, error_b) = (mean_of(bake.points, index) for bake in bakes)
        checks.that(abs(b / a - 1) < 0.01 + 4 * (error_a + error_b) / a, '%s: %g, with lightmaps %g' % (name, b, a),
                    bakes[1].process)
        table.row(name, len(bakes[1].points.of(index)), '%.4f' % (b / a))
    for bake in bakes:
        bake.remove()


def wall(kiln, checks, degrees, thickness, leaf, gap=0.0):
    """Light of the dark part over that of the lit one."""
    bake = kiln.bake(walls.room(os.path.join(kiln.scratch, 'room.glb'), degrees, thickness, gap), *OCTREE,
                     '--leaf-size', leaf, '--samples-direct', kiln.samples(64), '--samples-bounce', kiln.samples(32),
                     '--samples-indirect', kiln.samples(64))
    if not checks.baked(bake):
        return None
    points, sums = bake.points, [0.0, 0.0]
    for name in walls.SHELL:
        chosen = points.of(bake.index(name))
        across = (points.position[chosen, 0] - walls.WALL -
                  points.position[chosen, 2] * math.tan(math.radians(degrees)))
        light = points.total[chosen, 1] * points.area[chosen]
        sums[0] += light[across < -3 * leaf].sum()
        sums[1] += light[across > 3 * leaf].sum()
    found = sums[1] / sums[0], bake.run['points']['divided'], bake.process
    bake.remove()
    return found


def sealed(kiln, checks, table):
    for degrees, thickness, leaf in ((0, 0.01, 0.17), (17, 0.01, 0.17), (45, 0, 0.12)):
        found = wall(kiln, checks, degrees, thickness, leaf)
        if found is None:
            continue
        name = 'wall: %g degrees, %g mm' % (degrees, 1000 * thickness)
        checks.that(found[0] <= 1e-4, '%s: dark / lit is %g' % (name, found[0]), found[2])
        table.row(name, found[1], '%.1e' % found[0])
    found = wall(kiln, checks, 0, 0.01, 0.17, gap=0.2)
    if found is not None:
        checks.that(found[0] > 1e-3, 'above a gap: dark / lit is %g' % found[0], found[2])


def by_leaf(bake):
    """All values of each leaf, in an order that is the same for any order of points."""
    p = bake.points
    order = np.lexsort((p.side, p.facing, *p.leaf.T, p.object))
    return [values[order].tobytes() for values in (p.object, p.leaf, p.facing, p.position, p.area, p.total, p.error)]


def same(kiln, checks):
    options = (CORNELL, *OCTREE, '--leaf-size', 0.4, '--samples-direct', 32, '--samples-bounce', 8,
               '--samples-indirect', 16, '--bounces', 2)
    first = kiln.bake(*options)
    if not checks.baked(first):
        return
    for ranks, more in ((3, ()), (0, ('--cell-size', 0.7)), (2, ('--partition', 'objects', '--threads', 1))):
        bake = kiln.bake(*options, *more, ranks=ranks)
        if checks.baked(bake):
            checks.that(by_leaf(bake) == by_leaf(first), 'ranks %d %s: other bits' % (ranks, ' '.join(map(str, more))),
                        bake.process)
        bake.remove()
    first.remove()


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('what', 28), ('leaves', 8), ('ratio', 8))
    furnace(kiln, checks, table)
    cornell(kiln, checks, table)
    if kiln.backend == 'embree':  # of a device the look-ups count
        sealed(kiln, checks, table)
        same(kiln, checks)
    checks.end()


if __name__ == '__main__':
    main()
