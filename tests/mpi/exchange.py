"""What ranks share and what they send each other: memory of a node, the exchange in all its forms, its accuracy, the
timeline.

layouts    the same bits however ranks are put together into nodes (equal, unequal, one rank each) and however small a
           message must be
memory     n ranks of a node hold geometry, map and radiosity once: as counted by the allocator, and as the kernel
           counts pages
accuracy   4 bytes a point between bounces are as good as 8: error against a reference, and the mean of a furnace
trace      --trace gives a file that tools can load, with all ranks and all kinds of events
"""
import json
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402
from same_result import Result, differences  # noqa: E402

SMALL = ('--lightmap-size', 32, '--samples-direct', 8, '--samples-bounce', 4, '--samples-indirect', 16,
         '--samples-probe', 16, '--threads', 1)


# Ranks, ranks a node, limit of a message ('': none), form. Left out but for --full: what differs from a neighbour in
# one value only.
LAYOUTS = ((1, 'all', '', 'compact'), (4, 'all', '', 'compact'), (5, 2, 100, 'compact'),
           (7, 3, 1000, 'compact'),
           (3, 1, 7, 'compact'), (1, 'all', '', 'full'), (5, 2, '', 'full'))
MORE_LAYOUTS = ((4, 2, '', 'compact'), (5, 2, '', 'compact'), (8, 1, '', 'compact'), (4, 1, 333, 'full'))


def try_layouts(checks, kiln, scene, layouts):
    table = harness.Table(('ranks', 6), ('a node', 7), ('limit', 6), ('exchange', 9), ('seconds', 8),
                          ('sent between nodes', 19), ('result', 10))
    first = {}
    for ranks, node, limit, form in layouts:
        with kiln.under(KILN_EXCHANGE_LIMIT=limit):
            bake = kiln.bake(scene, *SMALL, '--shared-memory-ranks', node, '--exchange', form, ranks=ranks, timeout=120)
        if checks.baked(bake):
            result, sent = Result(bake), bake.run['mpi']['received_between_nodes']
            found = differences(first.setdefault(form, result), result)
            checks.that(not found, '%d ranks, %s a node, limit %s: not the same as before: %s' %
                        (ranks, node, limit, '; '.join(found)), bake.process)
            checks.that((sent > 0) == (node != 'all'), '%d ranks, %s a node: %d bytes went between nodes' %
                        (ranks, node, sent), bake.process)
            table.row(ranks, node, limit, form, '%.1f' % bake.process.seconds, sent, 'same' if not found
                      else 'DIFFERENT')
        bake.remove()
    if len(first) == 2:
        checks.that(len(differences(first['compact'], first['full'])) > 0,
                    'both forms give the same bits: --exchange does nothing')


def try_memory(checks, kiln):
    """Geometry of some 30 MB: what the allocator keeps of freed memory is little beside it. The private copies that
    --shared-memory-ranks 1 makes show what is saved."""
    scene = os.path.join(kiln.scratch, 'city.glb')
    made = kiln.command('generate', 'city', '-o', scene, '--triangles', 400000, '--quiet')
    if not checks.that(made.status == 0, 'no scene', made):
        return
    table = harness.Table(('ranks', 6), ('a node', 7), ('MB shared', 10), ('MB of all ranks', 16), ('seconds', 8))
    held, shared = {}, {}
    for ranks, node in ((1, 'all'), (4, 'all'), (4, 1)):
        bake = kiln.bake(scene, '--texels-per-metre', 0.7, '--samples-direct', 1, '--samples-bounce', 1,
                         '--samples-indirect', 1, '--samples-probe', 0, '--denoise', 'none', '--no-export',
                         '--no-preview', '--bounces', 2, '--threads', 1, '--shared-memory-ranks', node,
                         ranks=ranks, timeout=200)
        if not checks.baked(bake):
            return
        memory = bake.run['memory']
        shared[ranks, node], held[ranks, node] = memory['shared_node'], sum(memory['proportional_per_rank'])
        table.row(ranks, node, '%.1f' % (memory['shared_node'] / 1e6),
                  '%.1f' % (sum(memory['proportional_per_rank']) / 1e6), '%.1f' % bake.process.seconds)
        bake.remove()
    ratio = shared[4, 'all'] / shared[1, 'all']
    checks.that(ratio <= 1.25, '4 ranks of a node hold %.2f times what one holds: more than 1.25' % ratio)
    if held[1, 'all'] == 0:
        print('the kernel does not say how much is shared: not compared')
        return
    saved = held[4, 1] - held[4, 'all']
    checks.that(saved >= 0.8 * 3 * shared[1, 'all'],
                'the ranks hold %.1f MB less than with copies of their own, not 3 times %.1f MB' % (
        saved / 1e6, shared[1, 'all'] / 1e6))
    print('4 ranks: %.3f times one rank\'s memory; %.1f MB less than with copies of their own' % (ratio, saved / 1e6))


def sorted_total(bake):
    """Luminance of all points in an order that is always the same, NaN where a point is buried (which the seed may
    settle)."""
    p = bake.points
    order = np.lexsort((p.x, p.y, p.object))
    return np.where(np.asarray(p.valid)[order] > 0, np.asarray(p.total, np.float64)[order] @ harness.LUMINANCE, np.nan)


def try_accuracy(checks, kiln, cornell, seeds, full):
    """The difference that the form makes, against the error that both have."""
    furnace = os.path.join(kiln.scratch, 'furnace.glb')
    made = kiln.command('generate', 'furnace', '-o', furnace, '--albedo', 0.9, '--quiet')
    if not checks.that(made.status == 0, 'no furnace', made):
        return
    table = harness.Table(('scene', 18), ('seeds', 6), ('nrmse, 4 bytes', 15), ('8 bytes', 10),
                          ('mean, 4 against 8', 18))
    for name, scene, options in (('cornell_original', cornell, ('--lightmap-size', 24)),
                                 ('furnace 0.9', furnace, ('--lightmap-size', 16)))[:2 if full else 1]:
        fixed = (*options, '--samples-direct', 64, '--samples-bounce', 16, '--samples-probe', 0)
        best = kiln.bake(scene, *fixed, '--samples-indirect', 2048, '--samples-bounce', 256, '--samples-direct', 1024,
                         '--exchange', 'full', '--seed', 99)
        if not checks.baked(best):
            continue
        truth, error, means = sorted_total(best), {}, {}
        for form in ('compact', 'full'):
            squares = []
            for seed in range(seeds):
                bake = kiln.bake(scene, *fixed, '--samples-indirect', 256, '--exchange', form, '--seed', seed)
                if not checks.baked(bake):
                    return
                total = sorted_total(bake)
                squares.append(np.nanmean((total - truth) ** 2))
                means.setdefault(form, []).append(np.nanmean(total) / np.nanmean(truth))
                bake.remove()
            error[form] = float(np.sqrt(np.mean(squares)) / np.nanmean(truth))
        off = np.subtract(means['compact'], means['full'])
        ratio, bias = error['compact'] / error['full'], float(off.mean())
        noise = float(off.std(ddof=1) / np.sqrt(len(off)))
        checks.that(abs(ratio - 1) < 0.02, '%s: the error with 4 bytes is %.4f times that with 8' % (name, ratio))
        checks.that(abs(bias) < max(4 * noise, 2e-5),
                    '%s: the mean with 4 bytes is off by %+.1e of that with 8, noise %.1e' % (name, bias, noise))
        table.row(name, len(off), '%.4f %%' % (100 * error['compact']), '%.4f %%' % (100 * error['full']),
                  '%+.1e +- %.1e' % (bias, noise))
        best.remove()


def try_trace(checks, kiln, scene):
    path = os.path.join(kiln.scratch, 'trace.json')
    bake = kiln.bake(scene, *SMALL, '--shared-memory-ranks', 2, '--trace', path, ranks=3)
    if not checks.baked(bake) or not checks.that(os.path.exists(path), 'there is no trace', bake.process):
        return
    with open(path, encoding='utf-8') as f:
        events = json.load(f)['traceEvents']
    complete = [e for e in events if e['ph'] == 'X']
    checks.that({e['pid'] for e in complete} == {0, 1, 2},
                'ranks in the trace: %s' % sorted({e['pid'] for e in complete}))
    for kind in ('phase', 'pass', 'batch', 'exchange'):
        ranks = {e['pid'] for e in complete if e['cat'] == kind}
        checks.that(ranks == {0, 1, 2}, '%s: in the trace of ranks %s only' % (kind, sorted(ranks)))
    end = 1e6 * bake.run['seconds'] + 1e6
    checks.that(all(e['ts'] >= 0 and e['dur'] >= 0 and e['ts'] + e['dur'] <= end for e in complete),
                'events lie outside the run')
    for rank in range(3):
        row = sorted((e['ts'], e['ts'] + e['dur']) for e in complete if e['pid'] == rank and e['cat'] == 'batch')
        checks.that(all(a[1] <= b[0] + 1 for a, b in zip(row, row[1:])), 'batches of rank %d overlap' % rank)
        points = sum(e['args']['count'] for e in complete if e['pid'] == rank and e['cat'] == 'batch')
        points += bake.run['balance']['stolen_points']['from_rank'][rank]
        passes = len([e for e in complete if e['pid'] == rank and e['cat'] == 'pass'])
        checks.that(points == passes * bake.run['balance']['points_per_rank'][rank],
                    'batches of rank %d have %d points in %d passes' % (rank, points, passes))
    share = bake.run['mpi']['waiting_share']
    checks.that(0 <= share['min'] <= share['avg'] <= share['max'] <= 1, 'share of waiting: %s' % share)
    print('trace: %d events of 3 ranks; %.1f %% of the time was spent waiting and exchanging' %
          (len(complete), 100 * share['avg']))
    bake.remove()
    nowhere = kiln.bake(scene, *SMALL, '--trace', os.path.join(kiln.scratch, 'no', 'such', 'folder.json'), ranks=2)
    checks.that(nowhere.process.status == 73 or 'folder.json' in nowhere.process.stderr,
                'a trace that cannot be written: ended with %d' %
                nowhere.process.status, nowhere.process)


def main():
    add = lambda parser: (parser.add_argument('parts', nargs='*'),
                          parser.add_argument('--full', action='store_true',
                                              help='every layout, twice as many seeds, accuracy in two scenes'))
    arguments, kiln = harness.start(__doc__, add)
    cornell = harness.own_scene('cornell_original.glb')
    if cornell is None:
        harness.skip('neither tests/data nor ../shared/scenes/own is here.')
    checks = harness.Checks()
    layouts, seeds = (LAYOUTS + MORE_LAYOUTS, 6) if arguments.full else (LAYOUTS, 3)
    parts = {'layouts': lambda: try_layouts(checks, kiln, cornell, layouts), 'memory': lambda: try_memory(checks, kiln),
             'accuracy': lambda: try_accuracy(checks, kiln, cornell, seeds, arguments.full),
             'trace': lambda: try_trace(checks, kiln, cornell)}
    for part in arguments.parts or parts:
        parts[part]()
    checks.end()


if __name__ == '__main__':
    main()
