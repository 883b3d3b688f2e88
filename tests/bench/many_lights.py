"""What 10,000 emissive triangles cost against one lamp (two triangles), at equal error; the aim is at most 4.

  /usr/bin/python3 tests/bench/many_lights.py --kiln build/release/kiln

The hall of `kiln generate lights` with one lamp and with 100 x 50: the same power in both. Direct light alone. The
error is nrmse of the hall and its pillars against a converged bake of the same scene; the time is that of the direct
pass, put down to the points of hall and pillars alone (the lamps' own see no lamp). The cost at the target error is
read off a ladder of sample counts.
"""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

LADDER = (8, 16, 32, 64, 128, 256, 512)
CONVERGED = 32768


def bake(kiln, scene, samples, seed):
    return measure.must(kiln.bake(scene, '--bounces', 0, '--texels-per-metre', 1.5, '--samples-direct', samples,
                                  '--samples-bounce', 1,
                                  '--samples-indirect', 1, '--samples-probe', 0, '--seed', seed, timeout=3600))


def receivers(b):
    return [n for n in b.names() if n != 'lamps']


def climb(kiln, table, name, scene):
    """[(error, microseconds a point), ...]"""
    converged = bake(kiln, scene, CONVERGED, 99)
    reference = measure.values(converged, receivers(converged))
    converged.remove()
    ladder = []
    for samples in LADDER:
        errors, costs = [], []
        for seed in range(3):
            b = bake(kiln, scene, samples, seed)
            got = measure.values(b, receivers(b))
            errors.append(measure.nrmse(got, reference))
            costs.append(1e6 * measure.tracing_seconds(b) / len(got))
            b.remove()
        ladder.append((sorted(errors)[1], sorted(costs)[1]))
        table.row(name, samples, len(reference), '%.3f %%' % (100 * ladder[-1][0]), '%.2f' % ladder[-1][1])
    return ladder


def main():
    _, kiln = harness.start(__doc__)
    table = harness.Table(('lamps', 12), ('samples', 8), ('points', 8), ('nrmse', 10), ('us a point', 11))
    one = climb(kiln, table, 'one', measure.made(kiln, 'lights', '--columns', 1, '--rows', 1))
    many = climb(kiln, table, '5000', measure.made(kiln, 'lights', '--columns', 100, '--rows', 50))
    for target in (0.05, 0.02, 0.01):
        a, b = measure.at_error(one, target), measure.at_error(many, target)
        print('at %.0f %% error: one lamp %.2f us a point, 5000 lamps (10,000 triangles) %.2f us: ratio %.2f (aim: at '
              'most 4)' % (
            100 * target, a, b, b / a))


if __name__ == '__main__':
    main()
