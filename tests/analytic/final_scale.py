"""A final gather at a part of the resolution (--final-scale) loses little and lets nothing through.

- A closed furnace of albedo 0.8 has pi e / (1 - rho) within 1 % on the average, each texel within 3 %, at 2 and 4.
- A dark room behind a wall has 1e-4 of the light of the lit one at most (walls.py): along the texels, between them,
  askew.
- In the Cornell box, with many rays, indirect light is off by less than 2 % of its mean at 2 and 4 % at 4, its sum by
  less than 0.5 %, no texel by more than a half; the gather has less than half and less than a third of the rays of
  lightmaps of 48 texels. Energy is kept.
- Together with --indirect-scale likewise.
- The same bits on 1, 3 ranks, with cells of another size, by objects. Vulkan has the light of Embree within noise.
- What measures errors is refused.
"""
import math
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), HERE]
import harness  # noqa: E402
import scale  # noqa: E402

OPTION = '--final-scale'


def check_cornell(kiln, checks, table):
    many = ('--lightmap-size', 48, '--samples-direct', 64, '--samples-bounce', 32, '--samples-indirect', 1024)
    bakes = [(k, more, scale.cornell(kiln, k, *many, *more, option=OPTION))
             for k, more in ((1, ()), (2, ()), (4, ()), (4, ('--indirect-scale', 4)))]
    if not all([checks.baked(bake) for _, _, bake in bakes]):
        return
    full = bakes[0][2]
    a, area = scale.luminances(full)
    mean = a @ area / area.sum()
    for k, more, part in bakes[1:]:
        b, _ = scale.luminances(part)
        rms, sum_ = math.sqrt((a - b)**2 @ area / area.sum()) / mean, (b @ area) / (a @ area) - 1
        worst = np.abs(b - a).max() / mean
        rays = part.run['rays']['final'] / full.run['rays']['final']
        name = 'Cornell box %s' % ' '.join(map(str, more))
        table.row(name, k, '%+.2e' % sum_, '%.2e' % rms)
        checks.that(rms < 0.01 * k and abs(sum_) < 0.005 and worst < 0.5,
                    '%s at %d: off by %g, the sum by %g, a texel by %g' % (name, k, rms, sum_, worst))
        checks.that(rays < (0.5 if k == 2 else 1 / 3), '%s at %d: %g of the rays' % (name, k, rays), part.process)
        checks.that(rms > 1e-4, '%s: %d is no other bake than 1' % (name, k), part.process)
        checks.energy(part, '%s at %d' % (name, k))
    for _, _, bake in bakes:
        bake.remove()


def check_refusals(kiln, checks):
    for more in (('--error-map', ), ('--target-error', 0.1), ('--schedule', 'equal'), ('--store', 'octree')):
        refused = kiln.bake(os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb'), OPTION, 4, *more)
        checks.that(refused.process.status == 64 and OPTION in refused.process.stderr,
                    '%s was not refused: %d' % (more, refused.process.status), refused.process)


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('scene', 32), ('scale', 6), ('sum', 10), ('rms or worst', 14))
    if kiln.backend == 'vulkan':
        scale.check_vulkan(kiln, checks, table, OPTION, 'final')
        checks.end()
    for k in (2, 4):
        scale.check_furnace(kiln, checks, table, k, OPTION)
    for degrees, thickness, texels, k in ((0, 0.01, 24, 4), (0, 0, 20, 4), (17, 0.01, 24, 2), (45, 0, 12, 4)):
        scale.check_wall(kiln, checks, table, degrees, thickness, texels, k, OPTION)
    check_cornell(kiln, checks, table)
    scale.check_same(kiln, checks, OPTION)
    check_refusals(kiln, checks)
    checks.end()


if __name__ == '__main__':
    main()
