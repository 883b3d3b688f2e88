"""Bounces at a part of the resolution (--indirect-scale) lose little and let nothing through.

- A closed furnace of albedo 0.8 has pi e / (1 - rho) within 1 % on the average, each texel within 3 %, at 2, 4 and
  8.
- A dark room behind a wall has 1e-4 of the light of the lit one at most (walls.py), at 4 and 8: along the texels,
  between them, askew.
- In the Cornell box at 4, with the same rays in the final gather, indirect light is off by less than 2 % of its mean
  (1 % in fact), its sum by less than 0.3 %; bounces have a tenth of the rays at most, and energy is kept.
- The same bits on 1, 3 ranks, with cells of another size, by objects. Vulkan has the light of Embree within noise.
"""
import math
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi'), HERE]
import extremes  # noqa: E402
import harness  # noqa: E402
import same_result  # noqa: E402
import walls  # noqa: E402

FEW = ('--samples-probe', 0, '--no-export', '--denoise', 'none')


def check_furnace(kiln, checks, table, scale, option='--indirect-scale'):
    rho = 0.8
    want = math.pi / (1 - rho)
    bake = kiln.bake(extremes.furnace(os.path.join(kiln.scratch, 'furnace.glb'), rho), '--texels-per-metre', 8, *FEW,
                     '--samples-direct', kiln.samples(256), '--samples-bounce', 16, '--samples-indirect', 64,
                     option, scale)
    if not checks.baked(bake):
        return
    p = bake.points
    mean, worst = (p.total[:, 1] @ p.area) / p.area.sum() / want - 1, np.abs(p.total[:, 1] / want - 1).max()
    table.row('furnace', scale, '%+.2e' % mean, '%.2e' % worst)
    checks.that(abs(mean) < 0.01 and worst < 0.03, 'furnace, %s %d: the mean is off by %g, a texel by %g' %
                (option, scale, mean, worst), bake.process)
    checks.energy(bake, 'furnace, %s %d' % (option, scale))
    bake.remove()


def check_wall(kiln, checks, table, degrees, thickness, texels, scale, option='--indirect-scale'):
    found = walls.bake_room(kiln, checks, degrees, thickness, texels, more=(option, scale))
    if found is None:
        return
    name = 'wall, %g degrees, %g mm' % (degrees, 1000 * thickness)
    table.row(name, scale, '%.1e' % found[0], '')
    checks.that(found[0] <= 1e-4, '%s, at %d: dark / lit is %g' % (name, scale, found[0]), found[2])


def cornell(kiln, scale, *more, ranks=0, option='--indirect-scale'):
    return kiln.bake(os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb'), *FEW, '--bounces', 5, option,
                     scale, *more, ranks=ranks)


def luminances(bake):
    """Indirect light, W/m2, and area of the points, in the order of their texels."""
    p = bake.points
    order = np.lexsort((p.x, p.y, p.object))
    return p.indirect[order] @ harness.LUMINANCE, p.area[order]


def check_cornell(kiln, checks, table):
    many = ('--lightmap-size', 64, '--samples-direct', 64, '--samples-bounce', 128, '--samples-indirect', 64)
    full, part = cornell(kiln, 1, *many), cornell(kiln, 4, *many)
    if not (checks.baked(full) and checks.baked(part)):
        return
    (a, area), (b, _) = luminances(full), luminances(part)
    mean = a @ area / area.sum()
    rms, sum_ = math.sqrt((a - b)**2 @ area / area.sum()) / mean, (b @ area) / (a @ area) - 1
    rays = part.run['rays']['bounces'] / full.run['rays']['bounces']
    table.row('Cornell box', 4, '%+.2e' % sum_, '%.2e' % rms)
    checks.that(rms < 0.01 and abs(sum_) < 0.003, 'Cornell box at 4: off by %g, the sum by %g' % (rms, sum_))
    checks.that(0.05 < rays < 0.1, 'Cornell box at 4: bounces have %g of the rays' % rays, part.process)
    checks.that(rms > 1e-5, 'Cornell box: 4 is no other bake than 1', part.process)
    checks.energy(part, 'Cornell box at 4')
    full.remove()
    part.remove()


def check_same(kiln, checks, option='--indirect-scale'):
    few = ('--lightmap-size', 32, '--samples-direct', 16, '--samples-bounce', 16, '--samples-indirect', 16)
    ways = ((0, ()), (3, ('--threads', 1)), (1, ('--partition', 'objects')), (0, ('--cell-size', 0.3)),
            (0, ('--exchange', 'compact')))
    bakes = [cornell(kiln, 4, *few, *more, ranks=ranks, option=option) for ranks, more in ways]
    if not all([checks.baked(bake) for bake in bakes]):
        return
    points = [same_result.points(bake) for bake in bakes]
    for (ranks, more), found in zip(ways[1:4], points[1:4]):
        checks.that(found == points[0], '%s 4, %d ranks, %s: other bits' % (option, ranks, ' '.join(map(str, more))))
    checks.that(points[4] != points[0], 'another form of radiosity gives the same bits: the comparison sees nothing')


def check_vulkan(kiln, checks, table, option='--indirect-scale', steps='bounces'):
    """`kiln` has the Vulkan backend: against Embree."""
    few = ('--lightmap-size', 24, '--samples-direct', 64, '--samples-bounce', 64, '--samples-indirect', 64)
    device = cornell(kiln, 4, *few, option=option)
    host = cornell(kiln, 4, *few, '--backend', 'embree', option=option)
    if not (checks.baked(device) and checks.baked(host)):
        return
    (a, area), (b, _) = luminances(host), luminances(device)
    rms, sum_ = math.sqrt((a - b)**2 @ area / area.sum()) / (a @ area / area.sum()), (b @ area) / (a @ area) - 1
    table.row('Cornell box, Vulkan', 4, '%+.2e' % sum_, '%.2e' % rms)
    checks.that(rms < 0.01 and abs(sum_) < 1e-3, 'Vulkan, %s 4: off by %g, the sum by %g' % (option, rms, sum_),
                device.process)
    rays = device.run['rays'][steps] / host.run['rays'][steps]
    checks.that(abs(rays - 1) < 0.01, 'Vulkan has %g of the rays' % rays, device.process)


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('scene', 28), ('scale', 6), ('sum', 10), ('rms or worst', 14))
    if kiln.backend == 'vulkan':
        check_furnace(kiln, checks, table, 4)
        check_vulkan(kiln, checks, table)
        checks.end()
    for scale in (2, 4, 8):
        check_furnace(kiln, checks, table, scale)
    for degrees, thickness, texels, scale in ((0, 0.01, 24, 4), (0, 0, 20, 4), (0, 0, 20, 8), (17, 0.01, 24, 8),
                                              (45, 0, 12, 4)):
        check_wall(kiln, checks, table, degrees, thickness, texels, scale)
    check_cornell(kiln, checks, table)
    check_same(kiln, checks)
    for more in (('--schedule', 'equal'), ('--store', 'octree')):
        refused = kiln.bake(os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb'), '--indirect-scale', 4, *more)
        checks.that(refused.process.status == 64 and '--indirect-scale' in refused.process.stderr,
                    '%s was not refused: %d' % (more, refused.process.status), refused.process)
    checks.end()


if __name__ == '__main__':
    main()
