"""--method radiosity --order unshot: the patches with the most unshot power send first.

- It goes to the light of lockstep with all bounces, with fewer pairs; with lamps as patches and windows of texels too.
- With as many pairs as lockstep it is nearer to that light; what is unshot in the end is at most what is asked for, and
  the ledger has it as left over, so that energy is kept.
- The same bits on 1, 3 and 4 ranks, in other cells, while points move, after interruptions, and with what patches see
  kept in a cache.
- What it has no use for is refused.
"""
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi'), HERE]
import harness  # noqa: E402
import patches  # noqa: E402
import same_result  # noqa: E402

UNSHOT = ('--order', 'unshot')
FEW = (*patches.PLAIN, '--method', 'radiosity', '--samples-direct', 16, '--samples-indirect', 64)
BOX = (*FEW, '--texels-per-metre', 1.5)


def pairs(bake):
    return sum(bake.run['rays'][key] for key in ('bounces', 'rounds', 'emitters'))


def off(bake, wanted):
    found, light = (b.points.total @ harness.LUMINANCE for b in (bake, wanted))
    area = wanted.points.area
    return np.sqrt((found - light) ** 2 @ area / (light ** 2 @ area)), found @ area / (light @ area) - 1


def check_light(kiln, checks, table, *options):
    """Of all bounces. Gives lockstep's and the rounds'."""
    lockstep, rounds = (kiln.bake(patches.CORNELL, *BOX, *options, *more) for more in ((), UNSHOT))
    if not checks.baked(lockstep) or not checks.baked(rounds):
        return None
    what = 'all bounces ' + ' '.join(map(str, options))
    rms, sum_ = off(rounds, lockstep)
    share = pairs(rounds) / pairs(lockstep)
    table.row(what, '%.3f' % share, '%.2e' % rms, '%+.2e' % sum_)
    checks.that(1e-6 < rms < 5e-3 and abs(sum_) < 1e-3, '%s: off by %g, the sum by %g' % (what, rms, sum_),
                rounds.process)
    checks.that(share < 0.7, '%s: %g of the pairs of lockstep' % (what, share), rounds.process)
    return lockstep


def check_pairs(kiln, checks, table, wanted):
    ways = [kiln.bake(patches.CORNELL, *BOX, '--bounces', 3, *more) for more in ((), UNSHOT)]
    if all([checks.baked(bake) for bake in ways]):
        (lockstep, _), (rounds, sum_) = (off(bake, wanted) for bake in ways)
        share = pairs(ways[1]) / pairs(ways[0])
        table.row('3 bounces', '%.3f' % share, '%.2e' % rounds, '%+.2e' % sum_)
        checks.that(share < 1.01 and rounds < 0.5 * lockstep, 'off by %g, lockstep by %g' % (rounds, lockstep),
                    ways[1].process)


def check_end(kiln, checks):
    bake = kiln.bake(patches.CORNELL, *FEW, '--texels-per-metre', 2, *UNSHOT, '--order', 'unshot:0.01')
    if not checks.baked(bake):
        return
    reflected = sum(np.array(step['reflected']) @ harness.LUMINANCE for step in bake.run['bounces'])
    left = np.array(bake.run['energy']['left_over']) @ harness.LUMINANCE / reflected
    checks.that(0.005 < left <= 0.01 and abs(bake.run['tail']['error'] / left - 1) < 1e-6,
                '%g of all is left over, and %s is said' % (left, bake.run['tail']), bake.process)
    said = [bake.run['job'][key] for key in ('order', 'unshot_left')]
    checks.that(said == ['unshot', 0.01], 'run.json has other settings: %s' % said, bake.process)
    checks.energy(bake, '--order unshot:0.01')


def check_same(kiln, checks):
    few = (*BOX, '--bounces', 2, *UNSHOT)
    ways = ((0, ()), (0, ('--visibility-cache', 1, '--cell-size', 0.7)), (0, ('--visibility-cache', 1e-5)),
            (3, ('--threads', 1, '--rebalance', 'always')), (4, ('--threads', 1)))
    bakes = [kiln.bake(patches.CORNELL, *few, *more, ranks=ranks) for ranks, more in ways]
    if not all([checks.baked(bake) for bake in bakes]):
        return
    found = [same_result.points(bake) for bake in bakes]
    for (ranks, more), points in zip(ways[1:], found[1:]):
        checks.that(points == found[0], '%d ranks, %s: other bits' % (ranks, ' '.join(map(str, more))))
    rays = [bake.run['rays']['rounds'] for bake in bakes]
    checks.that(rays[1] == 0 < rays[2] < rays[0] == rays[3], 'rays of rounds: %s' % rays)
    patches.check_interrupted(kiln, checks, few, found[0])


def check_refusals(kiln, checks):
    for more in ((*UNSHOT, '--clamp'), (*UNSHOT, '--undersample', 'random'), (*UNSHOT, '--subdivide', 0.1),
                 (*UNSHOT, '--patches', 'links'), (*UNSHOT, '--gather', 'even'), ('--unshot-left', 0.1)):
        process = kiln.bake(patches.CORNELL, '--method', 'radiosity', *more).process
        checks.that(process.status == 64 and ': ' in process.sentence(), '%s was not refused' % (more, ), process)
    process = kiln.bake(patches.CORNELL, *UNSHOT).process
    checks.that(process.status == 64 and '--order' in process.stderr, '--method cells takes --order', process)


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('Cornell box', 50), ('pairs', 8), ('rms', 10), ('sum', 10))
    wanted = check_light(kiln, checks, table)
    if wanted is not None:
        check_pairs(kiln, checks, table, wanted)
    check_light(kiln, checks, table, '--lights', 'patches')
    check_light(kiln, checks, table, '--undersample', 'mipmap:2')
    check_end(kiln, checks)
    check_same(kiln, checks)
    check_refusals(kiln, checks)
    checks.end()


if __name__ == '__main__':
    main()
