"""Ranks that are behind, and what the others do about it: the same bits whoever computes what.

same       with work stealing and without, on several numbers of ranks and nodes, one rank made slow (KILN_SLOW_RANK):
           same results, and run.json and the timeline say that work really moved
cuts       points repartitioned after every pass (--rebalance always) on several numbers of ranks and nodes, and where a
           slow rank makes it pay: same results, and the slow rank has fewer points in the end
resume     stopped, and killed, while work is stolen and points are repartitioned; continued on other numbers of ranks:
           same results
"""
import json
import os
import random
import shutil
import signal
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'resume')]
import harness  # noqa: E402
import resume  # noqa: E402
from same_result import Result, differences  # noqa: E402

SMALL = ('--backend', 'embree', '--lightmap-size', 40, '--cell-size', 1, '--samples-direct', 64, '--samples-bounce', 16,
         '--samples-indirect', 64,
         '--bounces', 3, '--samples-probe', 16, '--threads', 1, '--watchdog', 20)
# than resume.OPTIONS: for there to be something to interrupt
LONGER = ('--samples-bounce', 64, '--samples-indirect', 768)
MORE = 5  # bakes at most that are stopped until one was while work was stolen: that ranks are behind is up to chance
HELP = 'batch of another rank'


def slow(rank, factor):
    os.environ['KILN_SLOW_RANK'] = '%d:%d' % (rank, factor)


def try_same(checks, kiln, scene):
    table = harness.Table(('ranks', 6), ('a node', 7), ('exchange', 9), ('how', 12), ('seconds', 8),
                          ('points that moved', 18), ('result', 10))
    first = {}
    for ranks, node, form, on in ((1, 'all', 'auto', True), (2, 'all', 'auto', True), (2, 'all', 'auto', False),
                                  (3, 'all', 'auto', True),
                                  (5, 'all', 'auto', True), (1, 'all', 'compact', True), (5, 3, 'compact', True)):
        slow(1, 5)
        bake = kiln.bake(scene, *SMALL, '--shared-memory-ranks', node, '--exchange', form, '--work-stealing' if on
                         else '--no-work-stealing', ranks=ranks, timeout=120)
        if not checks.baked(bake):
            continue
        what = '%d ranks, %s a node, exchange %s, %s' % (
            ranks, node, form, 'work stealing' if on else 'no work stealing')
        given, passes = bake.run['balance']['stolen_points'], [b['stolen_points'] for b in bake.run['bounces']]
        moved, expected = sum(passes), on and ranks > 1
        found = differences(first.setdefault(form, Result(bake)), Result(bake))
        checks.that(not found, '%s: not the same as before: %s' % (what, '; '.join(found)), bake.process)
        checks.that(given['on'] == expected and (moved > 0) == expected, '%s: %s, %s points moved in the passes' %
                    (what, given, passes), bake.process)
        checks.that(sum(given['from_rank']) == moved == sum(given['by_rank']),
                    '%s: what is given is not what is taken: %s, %s' % (
            what, given, passes), bake.process)
        checks.that(not expected or given['from_rank'][1] > 0.2 * bake.run['balance']['points_per_rank'][1],
                    '%s: only %s was stolen from the slow rank' % (what, given), bake.process)
        table.row(ranks, node, form, 'stealing' if on else 'none', '%.1f' % bake.process.seconds, moved,
                  'same' if not found else 'DIFFERENT')
        bake.remove()
    os.environ['KILN_SLOW_RANK'] = 'slow'
    refused = kiln.bake(scene, *SMALL)
    checks.that(refused.process.status == 64 and 'KILN_SLOW_RANK' in refused.process.stderr,
                'a slowness that is none: ended with %d' %
                refused.process.status, refused.process)
    del os.environ['KILN_SLOW_RANK']


def try_cuts(checks, kiln, scene):
    table = harness.Table(('ranks', 6), ('a node', 7), ('by', 8), ('exchange', 9), ('rebalance', 9), ('seconds', 8),
                          ('points a rank', 36), ('result', 10))
    first = {}
    for ranks, node, partition, form, limit, when in ((1, 'all', 'cells', 'auto', '', 'always'),
                                                      (3, 'all', 'cells', 'auto', '', 'always'),
                                                      (5, 2, 'objects', 'auto', 77, 'always'),
                                                      (2, 1, 'cells', 'auto', '', 'auto'),
                                                      (2, 1, 'cells', 'auto', '', 'never'),
                                                      (1, 'all', 'cells', 'compact', '', 'auto'),
                                                      (4, 2, 'cells', 'compact', '', 'always')):
        slow(1, 20 if ranks == 2 else 5)
        with kiln.under(KILN_EXCHANGE_LIMIT=limit):
            bake = kiln.bake(scene, *SMALL, '--shared-memory-ranks', node, '--partition', partition, '--exchange', form,
                             '--rebalance', when, ranks=ranks, timeout=120)
        if not checks.baked(bake):
            continue
        what = '%d ranks, %s a node, by %s, exchange %s, rebalance %s' % (ranks, node, partition, form, when)
        points, judged = bake.run['balance']['points_per_rank'], [b['rebalance'] for b in bake.run['bounces']]
        moves = sum(j is not None and j['moved'] for j in judged)
        found = differences(first.setdefault(form, Result(bake)), Result(bake))
        checks.that(not found, '%s: not the same as before: %s' % (what, '; '.join(found)), bake.process)
        checks.that(sum(points) == bake.run['points']['count'], '%s: the ranks have %s points, not %d' %
                    (what, points, bake.run['points']['count']),
                    bake.process)
        if when == 'auto' and ranks > 1:  # alone on its node, nobody can help the slow one
            checks.that(moves > 0 and points[1] < 0.7 * points[0],
                        '%s: %d moves, %s: %s' % (what, moves, points, judged), bake.process)
            checks.that(all(j is None or j['moved'] == (j['predicted_gain'] > 2 * j['predicted_cost'] > 0)
                            for j in judged), '%s: %s' % (what, judged))
        else:
            checks.that((moves > 0) == (when == 'always' and ranks > 1), '%s: %d moves: %s' % (what, moves, judged),
                        bake.process)
        table.row(ranks, node, partition, form, when, '%.1f' % bake.process.seconds, ' '.join(map(str, points)),
                  'same' if not found else 'DIFFERENT')
        bake.remove()
    try_trial(checks, kiln, scene)
    os.environ.pop('KILN_SLOW_RANK', None)


def try_trial(checks, kiln, scene):
    """Before the first pass a few tile runs are tried: the slow rank has fewer points from then on, all bits stay."""
    slow(1, 5)
    options = (*SMALL, '--schedule', 'equal', '--bounces', 1, '--samples-probe', 0, '--shared-memory-ranks', 1)
    alone = kiln.bake(scene, *options, timeout=120)
    bake = kiln.bake(scene, *options, '--rebalance', 'always', ranks=3, timeout=120)
    if checks.baked(alone) and checks.baked(bake):
        tried, found = bake.run['balance']['trial'], differences(Result(alone), Result(bake))
        checks.that(alone.run['balance']['trial'] is None, 'one rank tried what points cost')
        checks.that(tried is not None and tried['seconds'] > 0 and tried['rebalance']['moved'] and
                    tried['rebalance']['points'] > 0, 'before the first pass: %s' % tried, bake.process)
        checks.that(not found, 'after a trial not the same: %s' % '; '.join(found), bake.process)


def given_before_saving(path):
    """How many checkpoints of a timeline were written after help in the same pass had begun. Those inside a pass, for
    passes end after them."""
    with open(path, encoding='utf-8') as f:
        events = [e for e in json.load(f)['traceEvents'] if e['ph'] == 'X']
    helps = [e for e in events if e['cat'] == HELP]
    saves = [e for e in events if e['cat'] == 'checkpoint' and e['pid'] == 0]
    passes = [e for e in events if e['cat'] == 'pass' and e['pid'] == 0]
    begin = lambda save: max([p['ts'] for p in passes if p['ts'] < save['ts'] < p['ts'] + p['dur']], default=None)
    return sum(begin(s) is not None and any(begin(s) <= h['ts'] < s['ts'] for h in helps) for s in saves)


def try_resume(checks, kiln):
    tool = resume.Tool(kiln.path, kiln.scratch)
    whole = tool.bake(tool.folder(), '--checkpoint-every', 0, *LONGER, threads=2)
    if not checks.that(whole.status == 0, 'the reference ended with %d' % whole.status, whole):
        return
    reference = resume.result(whole.command[whole.command.index('-o') + 1])
    seed = int(os.environ.get('KILN_SEED', str(random.randrange(1 << 30))))
    dice = random.Random(seed)
    print('seed %d (KILN_SEED=%d repeats it)' % (seed, seed))
    amid = 0
    for run, (before, after, kill) in enumerate([(3, 2, False), (2, 1, False), (3, 1, True)] + MORE * [(3, 2, False)]):
        if run >= 3 and amid > 0:
            break
        trace = os.path.join(kiln.scratch, 'trace.json')
        slow(1, 5)
        for wanted in (dice.randrange(3, 8), 2, 1):  # a busy machine has time for few checkpoints
            folder = tool.folder()
            process = tool.start(folder, *resume.OFTEN, *LONGER, '--trace', trace, '--rebalance', 'always',
                                 ranks=before)
            number = lambda: max([int(g[-6:]) for g in resume.generations(folder)], default=0)
            resume.wait_for(lambda: number() >= wanted or process.poll() is not None, 120)
            victims = resume.ranks_of(process)
            if len(victims) == before:
                break
            resume.finish(process)
        if checks.that(len(victims) == before, '%d ranks: over before generation %d' % (before, wanted)):
            os.kill(dice.choice(victims), signal.SIGKILL if kill else signal.SIGUSR1)
        status = resume.finish(process)
        checks.that(status not in (None, 0) if kill else status == resume.STOPPED,
                    '%d ranks: interrupted, it ended with %s: %s' % (
            before, status, resume.text(folder)[-400:]))
        amid += 0 if kill else given_before_saving(trace)
        del os.environ['KILN_SLOW_RANK']
        what = '%d ranks %s at generation %d, then %d' % (before, 'killed' if kill else 'stopped', wanted, after)
        again = tool.bake(folder, *LONGER, ranks=after, threads=3 - after)
        checks.that('going on from checkpoint' in again.stderr, '%s: does not go on' % what, again)
        resume.same(checks, tool, reference, folder, again, what)
        print(what)
        shutil.rmtree(folder, ignore_errors=True)
    checks.that(amid > 0, 'no checkpoint was written while work was stolen')
    print('%d checkpoints were written in passes in which work had been stolen' % amid)


def main():
    arguments, kiln = harness.start(__doc__, lambda parser: parser.add_argument('parts', nargs='*'))
    cornell = harness.own_scene('cornell_original.glb')
    if cornell is None:
        harness.skip('neither tests/data nor ../shared/scenes/own is here.')
    checks = harness.Checks()
    for part in arguments.parts or ('same', 'cuts', 'resume'):
        {'same': lambda: try_same(checks, kiln, cornell), 'cuts': lambda: try_cuts(checks, kiln, cornell),
         'resume': lambda: try_resume(checks, kiln)}[part]()
    checks.end()


if __name__ == '__main__':
    main()
