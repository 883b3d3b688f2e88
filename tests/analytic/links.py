"""--method radiosity --patches links: light between points and nodes of a tree (worker/pass/links.h).

- Closed furnaces: every texel within 0.1 %.
- In the Cornell box the light goes to that of all pairs as --link-error goes to 0, with fewer rays; at the default it
  is off by no more than that, and its links take 256 bytes a point at most.
- The same bits on 1, 3 and 4 ranks, in other cells, and after an interruption.
- Energy is kept at the default and at 0; at 0.1 about a hundredth of the power is lost. What links have no use for is
  refused.
"""
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi'), HERE]
import harness  # noqa: E402
import patches  # noqa: E402
import same_result  # noqa: E402

LINKS = ('--patches', 'links')


def check_error(kiln, checks, table):
    """Light of texels against all pairs: root of the mean square, over that of the light."""
    options = (*patches.PLAIN, '--bounces', 2, '--samples-direct', 64, '--samples-indirect', 64, '--texels-per-metre',
               4, '--method', 'radiosity')
    ways = ((), (*LINKS, '--link-error', 0), LINKS, (*LINKS, '--link-error', 0.1))
    bakes = [kiln.bake(patches.CORNELL, *options, *more) for more in ways]
    if not all([checks.baked(bake) for bake in bakes]):
        return
    area, wanted, off = bakes[0].points.area, bakes[0].points.indirect @ harness.LUMINANCE, []
    rays = [bake.run['rays']['bounces'] for bake in bakes]
    count, size = (np.array([bake.run['links'][key] for bake in bakes[1:]]) / len(area) for key in ('count', 'bytes'))
    print('links a point: %s, bytes: %s' % (count.round(), size.round()))
    checks.that(size[1] <= 256, 'links take %s bytes a point at the default' % size[1])
    checks.that('links' not in bakes[0].run and np.all(np.diff(count) < 0) and np.all(np.diff(size) < 0),
                'links a point: %s, bytes: %s' % (count, size))
    for more, bake in zip(ways[1:], bakes[1:]):
        found = bake.points.indirect @ harness.LUMINANCE
        off.append(np.sqrt((found - wanted) ** 2 @ area / (wanted ** 2 @ area)))
        table.row(' '.join(map(str, more)), '%.2e' % off[-1], '%+.2e' % (found @ area / (wanted @ area) - 1))
        if more != ways[3]:
            checks.energy(bake, ' '.join(map(str, more)))
    checks.that(off[0] < off[1] < 0.015 and off[1] < off[2], 'links: off by %s' % off)
    checks.that(rays[3] < rays[2] < rays[1] < rays[0], 'rays: %s' % rays)


def check_refusals(kiln, checks):
    for more in ((*LINKS, '--clamp'), (*LINKS, '--undersample', 'mipmap'), (*LINKS, '--subdivide', 0.1),
                 ('--link-error', 0.1)):
        process = kiln.bake(patches.CORNELL, '--method', 'radiosity', *more).process
        checks.that(process.status == 64 and ': ' in process.sentence(), '%s was not refused' % (more, ), process)


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('scene', 44), ('worst', 10), ('mean', 10))
    known = patches.cases()
    patches.check_furnace(kiln, checks, table, known['furnace_cube_rho0.5'], *LINKS)
    patches.check_furnace(kiln, checks, table, known['furnace_cube_rho0.9'], *LINKS, '--link-error', 0.05)
    check_error(kiln, checks, table)
    patches.check_same_bits(kiln, checks, *LINKS)
    check_refusals(kiln, checks)
    checks.end()


if __name__ == '__main__':
    main()
