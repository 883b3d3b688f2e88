"""The lean schedule (cheap bounces, one final gather) against equal rays in every bounce, at equal error: rays and
time.

  /usr/bin/python3 tests/bench/schedule.py --kiln build/release/kiln [SCENE]

Error is nrmse of irradiance over all points against a converged bake, all bounces (a tail after the last in both).
"""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

COMMON = ('--texels-per-metre', 8, '--samples-direct', 1024, '--samples-probe', 0)
LADDER = {'lean': ((4, 32), (8, 64), (16, 128), (16, 256), (16, 512)),
          'equal': ((16, 16), (32, 32), (64, 64), (128, 128), (256, 256))}


def bake(kiln, scene, schedule, bounce, indirect, seed):
    return measure.must(kiln.bake(scene, *COMMON, '--schedule', schedule, '--samples-bounce', bounce,
                                  '--samples-indirect', indirect,
                                  '--seed', seed, timeout=3600))


def gather_cost(b):
    """(rays a point, microseconds a point) of everything but direct light, which is the same in both."""
    passes = [p for p in b.run['bounces'] if p['kind'] not in ('direct', 'pilot')]
    return sum(p['samples'] for p in passes), 1e6 * sum(p['seconds'] for p in passes) / b.points.count


def main():
    arguments, kiln = harness.start(__doc__, lambda p: p.add_argument('scene', nargs='?'))
    scene = arguments.scene or measure.made(kiln, 'cornell')
    converged = bake(kiln, scene, 'lean', 256, 16384, 99)
    reference = measure.values(converged)
    converged.remove()
    table = harness.Table(('schedule', 10), ('bounce', 8), ('final', 8), ('nrmse', 10), ('rays a point', 13),
                          ('us a point', 11))
    rays, times = {}, {}
    for schedule, ladder in LADDER.items():
        rays[schedule], times[schedule] = [], []
        for bounce, indirect in ladder:
            b = bake(kiln, scene, schedule, bounce, indirect, 0)
            error, (r, t) = measure.nrmse(measure.values(b), reference), gather_cost(b)
            b.remove()
            rays[schedule].append((error, r))
            times[schedule].append((error, t))
            table.row(schedule, bounce if schedule == 'lean' else '-', indirect, '%.3f %%' % (100 * error), r,
                      '%.2f' % t)
    for target in (0.02, 0.01):
        a, b = (measure.at_error(rays[s], target) for s in ('equal', 'lean'))
        c, d = (measure.at_error(times[s], target) for s in ('equal', 'lean'))
        print('at %.0f %% error: equal %.0f rays and %.1f us a point, lean %.0f and %.1f: %.1f times fewer rays, %.1f '
              'times faster' % (
            100 * target, a, c, b, d, a / b, c / d))


if __name__ == '__main__':
    main()
