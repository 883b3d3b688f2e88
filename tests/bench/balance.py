"""What ranks gain by work stealing and by repartitioning: time of all passes over the same with neither, in turn.

  /usr/bin/python3 tests/bench/balance.py --kiln build/release/kiln [--ranks 2] [--threads 1] [--repeats 5] [SCENE]

Two cases: a scene whose points cost unequally much (a carved statue in a box), and the same with one rank that takes
three times as long for everything. Points are repartitioned between ranks that are each alone on a node, and compared
with such. The median ratio of the repeats counts; "even" is what the sum of all ranks' work would take if it were
spread evenly; "planned" is the ratio that `kiln plan` predicts (light and moves).
"""
import os
import statistics
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

WAYS = {'neither': ('--no-work-stealing', '--rebalance', 'never'), 'stealing': ('--rebalance', 'never'),
        'neither, alone': ('--shared-memory-ranks', 1, '--rebalance', 'never'),
        'repartitioned, alone': ('--shared-memory-ranks', 1, '--rebalance', 'auto')}
BASE = {'neither': 'neither', 'stealing': 'neither', 'neither, alone': 'neither, alone',
        'repartitioned, alone': 'neither, alone'}
WORK = ('direct light', 'bounces', 'final gather')


def per_rank(bake, names):
    phases = {p['name']: p['per_rank'] for p in bake.run['phases']}
    return [sum(values) for values in zip(*(phases[n] for n in names))]


def planned(kiln, scene, ranks, options):
    """Seconds of light and moves."""
    p = kiln.command('plan', scene, '--json', '--ranks', ranks, '--ranks-per-node', ranks, *options)
    if p.status != 0:
        sys.exit('%s\nended with %d: %s' % (p.line(), p.status, p.sentence()))
    return sum(p.json()['seconds'][name] for name in ('direct', 'bounces', 'final', 'move'))


def main():
    def more(parser):
        parser.add_argument('--ranks', type=int, default=2)
        parser.add_argument('--threads', type=int, default=1)
        parser.add_argument('--repeats', type=int, default=5)
        parser.add_argument('scene', nargs='?')
    arguments, kiln = harness.start(__doc__, more)
    scene = arguments.scene or measure.made(kiln, 'cornell-statue')
    options = ('--threads', arguments.threads, '--quality', 'draft', '--samples-direct', 64, '--lightmap-max', 192,
               '--bounces', 4, '--samples-probe', 0)
    table = harness.Table(('case', 16), ('way', 15), ('seconds', 8), ('over neither', 12), ('planned', 8), ('even', 6),
                          ('waiting', 8), ('points moved', 12))
    for case, slow in (('uneven scene', '0:1'), ('one rank slow', '1:3')):
        os.environ['KILN_SLOW_RANK'] = slow
        seconds, plans, even, waiting, moved = ({way: [] for way in WAYS} for _ in range(5))
        for _ in range(arguments.repeats):
            for way, how in WAYS.items():
                plans[way].append(planned(kiln, scene, arguments.ranks, (*options, *how)))
                b = measure.must(kiln.bake(scene, *options, *how, ranks=arguments.ranks, timeout=3600))
                work = per_rank(b, WORK)
                seconds[way].append(max(per_rank(b, WORK + ('waiting', 'exchange'))))
                even[way].append(statistics.mean(work))
                waiting[way].append(b.run['mpi']['waiting_share']['avg'])
                moved[way].append(
                    sum(p['stolen_points'] + (p['rebalance'] or {'points': 0, 'moved': False})['points'] * (
                    p['rebalance'] or {'moved': False})['moved'] for p in b.run['bounces']))
                b.remove()
        for way in WAYS:
            ratio, plan = (statistics.median(a / b for a, b in zip(s[way], s[BASE[way]])) for s in (seconds, plans))
            table.row(case, way, '%.2f' % statistics.median(seconds[way]), '%.2f' % ratio, '%.2f' % plan,
                      '%.2f' % statistics.median(even[way]),
                      '%.1f %%' % (100 * statistics.median(waiting[way])), int(statistics.median(moved[way])))


if __name__ == '__main__':
    main()
