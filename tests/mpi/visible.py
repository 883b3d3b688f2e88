"""Nodes that receive only the radiosity of what their points see: the same bits, fewer bytes.

same       the same bits as when all is sent: ranks, nodes, forms, partition by objects, points that move, adaptive
           samples, light by direction; and with an empty visibility grid (KILN_SIGHT=none), where everything that rays
           meet is asked for late
bytes      8 x 8 rooms on 16 nodes: at most a quarter of the bytes, with those of the grid
grid       kiln.h5 has the same grid from any ranks, symmetric; rooms that share a door see each other, not all do
resume     killed and stopped while points wait to be computed again; continued on other numbers of ranks: same results
"""
import os
import random
import signal
import sys

import h5py
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'resume')]
import harness  # noqa: E402
import resume  # noqa: E402
from same_result import Result, differences  # noqa: E402

VISIBLE = ('--exchange-points', 'visible')
SMALL = ('--texels-per-metre', 2, '--samples-direct', 8, '--samples-bounce', 4, '--samples-indirect', 16,
         '--samples-probe', 4, '--threads', 1, '--denoise', 'none', '--no-export')
CELLS = ('--cell-size', 1)
MORE = ('--directional', 'sh1', '--error-map', '--bounces', 2, *CELLS)
# Ranks, ranks a node, whether the grid is empty, whether answers must lack something, further options. The bits of two
# bakes are compared where these have the same first element.
WAYS = ((4, 1, False, False, ('compact', *CELLS)), (3, 1, True, True, ('compact', *CELLS)),
        (5, 2, True, True, ('compact', *CELLS, '--rebalance', 'always')), (1, 'all', False, False, ('compact', *CELLS)),
        (4, 1, False, False, ('compact', '--partition', 'objects')), (4, 2, True, True, ('full', *CELLS)))
MORE_WAYS = ((3, 1, True, True, ('full',)),)
VULKAN_WAYS = ((2, 1, True, True, ('compact', *CELLS, '--verify-fraction', 0.3)),)


def rooms(checks, kiln, columns, rows):
    path = os.path.join(kiln.scratch, 'rooms%dx%d.glb' % (columns, rows))
    made = kiln.command('generate', 'rooms', '-o', path, '--columns', columns, '--rows', rows, '--quiet')
    return path if checks.that(made.status == 0, 'no scene', made) else None


def sight(kiln, empty):
    kiln.environment.pop('KILN_SIGHT', None)
    if empty:
        kiln.environment['KILN_SIGHT'] = 'none'


def try_ways(checks, kiln, scene, ways, options=()):
    """Each way against a bake of one rank that knows nothing of visibility."""
    table = harness.Table(('ranks', 6), ('a node', 7), ('grid', 6), ('exchange', 9), ('received', 10), ('of all', 10),
                          ('points again', 13), ('result', 10))
    first = {}
    for ranks, node, empty, lacks, (form, *more) in ways:
        sight(kiln, False)
        if form not in first:
            plain = kiln.bake(scene, *SMALL, *options, '--exchange', form, ranks=0, timeout=120)
            if not checks.baked(plain):
                return
            first[form] = Result(plain)
            plain.remove()
        sight(kiln, empty)
        bake = kiln.bake(scene, *SMALL, *options, *VISIBLE, '--exchange', form, '--shared-memory-ranks', node, *more,
                         ranks=ranks, timeout=120)
        what = '%d ranks, %s a node, %s grid, %s' % (ranks, node, 'empty' if empty else 'whole', (form, *more))
        if checks.baked(bake):
            mpi, found = bake.run['mpi'], differences(first[form], Result(bake))
            checks.that(not found, '%s: not the same bits as when all is sent: %s' % (what, '; '.join(found)),
                        bake.process)
            again, all_bytes = mpi['visible']['points_computed_again'], mpi['visible']['received_between_nodes_of_all']
            checks.that(again > 0 or not lacks, '%s: no point was computed again' % what, bake.process)
            checks.that((all_bytes > 0) == (node != 'all'), '%s: %d bytes would have gone between nodes' %
                        (what, all_bytes), bake.process)
            table.row(ranks, node, 'empty' if empty else 'whole', form, mpi['received_between_nodes'], all_bytes, again,
                      'same' if not found else 'DIFFERENT')
        bake.remove()
    sight(kiln, False)


def try_same(checks, kiln, full):
    scene = rooms(checks, kiln, 3, 2)
    if scene is None:
        return
    if kiln.backend == 'vulkan':
        try_ways(checks, kiln, scene, VULKAN_WAYS)
        return
    try_ways(checks, kiln, scene, WAYS)
    if full:
        try_ways(checks, kiln, scene, WAYS + ((3, 1, False, False, ('full', *CELLS)),), ('--target-error', 0.1))
    try_ways(checks, kiln, scene, MORE_WAYS, MORE)
    refused = kiln.bake(scene, *SMALL, *VISIBLE, '--tracing-range', 1)
    checks.that(refused.process.status == 64 and '--tracing-range' in refused.process.stderr,
                'with radiance probes: ended with %d' % refused.process.status, refused.process)
    kiln.environment['KILN_SIGHT'] = 'some'
    refused = kiln.bake(scene, *SMALL)
    checks.that(refused.process.status == 64 and 'KILN_SIGHT' in refused.process.stderr,
                'a grid that is none: ended with %d' % refused.process.status, refused.process)
    sight(kiln, False)


def try_bytes(checks, kiln):
    scene = rooms(checks, kiln, 8, 8)
    if scene is None:
        return
    bake = kiln.bake(scene, *SMALL, *VISIBLE, '--samples-probe', 0, '--cell-size', 0.4, '--exchange', 'compact',
                     '--rebalance', 'never', '--shared-memory-ranks', 1, ranks=16, timeout=300)
    if not checks.baked(bake):
        return
    mpi = bake.run['mpi']
    received, grid = mpi['received_between_nodes'], mpi['visible']['grid_bytes_sent']
    share = (received + grid) / mpi['visible']['received_between_nodes_of_all']
    print('8 x 8 rooms, 16 nodes: %d bytes, %d of the grid: %.1f %% of all; %d points again' % (
        received, grid, 100 * share, mpi['visible']['points_computed_again']))
    checks.that(0 < share <= 0.25, '%.1f %% of the bytes of a whole exchange' % (100 * share), bake.process)
    bake.remove()


def read_grid(bake):
    """(first point, object, matrix of who sees whom) of the patches of kiln.h5."""
    with h5py.File(os.path.join(bake.directory, 'kiln.h5'), 'r') as f:
        for name in ('point', 'first', 'seen'):
            assert {'units', 'description'} <= set(f['visibility'][name].attrs)
        point, first, seen = (np.asarray(f['visibility'][name], np.int64) for name in ('point', 'first', 'seen'))
    matrix = np.zeros((len(point),) * 2, bool)
    matrix[np.repeat(np.arange(len(point)), np.diff(first)), seen] = True
    return point, np.asarray(bake.points.object)[point], matrix, len(seen)


def try_grid(checks, kiln):
    scene, grids = rooms(checks, kiln, 3, 2), []
    if scene is None:
        return
    for ranks, more in ((0, CELLS), (3, CELLS), (0, ('--partition', 'objects'))):
        bake = kiln.bake(scene, *SMALL, *VISIBLE, *more, '--bounces', 1, ranks=ranks, timeout=120)
        if not checks.baked(bake):
            return
        grids.append(read_grid(bake))
        point, room, matrix, pairs = grids[-1]
        checks.that(len(point) > 50 and point[0] == 0 and (np.diff(point) > 0).all(),
                    '%s: patches begin at %s' % (more, point), bake.process)
        checks.that(pairs == matrix.sum() and (matrix == matrix.T).all(), '%s: the grid is not symmetric' % (more,),
                    bake.process)
        # rooms 0 1 2 / 3 4 5: those that share a door see each other; few patches see those in other corners
        sees = np.array([[matrix[np.ix_(room == a, room == b)].mean() for b in range(6)] for a in range(6)])
        row, column = np.arange(6) // 3, np.arange(6) % 3
        doors = np.abs(row[:, None] - row) + np.abs(column[:, None] - column)
        for far, low, high in ((0, 0.2, 1), (1, 0.05, 0.9), (3, 0, 0.02)):
            checks.that((sees[doors == far] >= low).all() and (sees[doors == far] <= high).all(),
                        '%s: rooms %d doors apart see %s of each other' % (more, far, sees[doors == far]), bake.process)
        bake.remove()
    checks.that((grids[0][0] == grids[1][0]).all() and (grids[0][2] == grids[1][2]).all(),
                'three ranks find another grid than one')


def same_light(folder):
    """resume.result without the number of rays: what waits to be computed again when a bake ends has had its rays."""
    return {key: value for key, value in resume.result(folder).items() if key != 'rays'}


def try_resume(checks, kiln):
    tool = resume.Tool(kiln.path, kiln.scratch)
    longer = ('--lightmap-size', 32, '--samples-bounce', 8, '--cell-size', 0.1, '--exchange', 'compact', *VISIBLE)
    whole = tool.bake(tool.folder(), '--checkpoint-every', 0, *longer, threads=2)
    if not checks.that(whole.status == 0, 'the reference ended with %d' % whole.status, whole):
        return
    reference = same_light(whole.command[whole.command.index('-o') + 1])
    dice = random.Random(int(os.environ.get('KILN_SEED', '7')))
    os.environ['KILN_SIGHT'] = 'none'
    for before, after, kill in ((3, 2, False), (2, 3, True)):
        apart = ('--shared-memory-ranks', 1)
        folder, wanted = tool.folder(), dice.randrange(3, 7)
        process = tool.start(folder, *resume.OFTEN, *longer, *apart, ranks=before)
        number = lambda: max([int(g[-6:]) for g in resume.generations(folder)], default=0)
        resume.wait_for(lambda: number() >= wanted or process.poll() is not None)
        victims = resume.ranks_of(process)
        if checks.that(len(victims) == before, '%d ranks: over before generation %d' % (before, wanted)):
            os.kill(dice.choice(victims), signal.SIGKILL if kill else signal.SIGUSR1)
        status = resume.finish(process)
        checks.that(status not in (None, 0) if kill else status == resume.STOPPED,
                    '%d ranks: interrupted, it ended with %s: %s' % (before, status, resume.text(folder)[-400:]))
        what = '%d ranks %s at generation %d, then %d' % (before, 'killed' if kill else 'stopped', wanted, after)
        again = tool.bake(folder, *longer, *apart, ranks=after)
        checks.that('going on from checkpoint' in again.stderr, '%s: does not go on' % what, again)
        if checks.that(again.status == 0, '%s: ended with %d' % (what, again.status), again):
            found = resume.differences(reference, same_light(folder))
            checks.that(not found, '%s: not the same bits: %s' % (what, found), again)
    del os.environ['KILN_SIGHT']


def main():
    add = lambda parser: (parser.add_argument('parts', nargs='*'),
                          parser.add_argument('--full', action='store_true', help='a bake with a target error too'))
    arguments, kiln = harness.start(__doc__, add)
    checks = harness.Checks()
    parts = {'same': lambda: try_same(checks, kiln, arguments.full), 'bytes': lambda: try_bytes(checks, kiln),
             'grid': lambda: try_grid(checks, kiln), 'resume': lambda: try_resume(checks, kiln)}
    for part in arguments.parts or parts:
        parts[part]()
    checks.end()


if __name__ == '__main__':
    main()
