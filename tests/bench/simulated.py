"""Whether the simulation of `kiln plan` holds on a few ranks: what the busiest rank works, over what one rank does.

  /usr/bin/python3 tests/bench/simulated.py --kiln build/release/kiln [--ranks 1,2,4,8] [--texels-per-metre 24]
      [--turns 2] [SCENE] [-- OPTIONS]
  /usr/bin/python3 tests/bench/simulated.py --kiln build/release/kiln --writer build/release/tests/write_synthetic
      [--side 1024] [--ranks 1,2,4,8]

Ranks have one thread each, and may be more than there are cores: what counts is the time of the processor that a rank
takes outside of MPI (waits.c), as if nobody waited; the least of so many turns. "Simulated" is what `kiln plan` says of
the slowest rank. With --writer, the same of writing kiln.h5 alone, from made-up light of two lightmaps: "simulated" is
the share of what one rank takes, and what rank 0 does alone by `kiln plan`; the last columns are the memory that rank 0
takes, and whether the file has the bytes of that of one rank.
"""
import hashlib
import os
import subprocess
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402


def must(process):
    if process.status != 0:
        sys.exit('%s\nended with %d: %s' % (process.line(), process.status, process.sentence()))
    return process


def made_shim(kiln):
    path = os.path.join(kiln.scratch, 'waits.so')
    source = os.path.join(os.path.dirname(os.path.abspath(__file__)), 'waits.c')
    subprocess.run(['mpicc', '-O2', '-shared', '-fPIC', '-o', path, source], check=True)
    return path


def worked(kiln, scene, ranks, options, shim):
    """Seconds of the processor of each rank outside of MPI."""
    lines = os.path.join(kiln.scratch, 'waits')
    kiln.environment.update({'WAITS': lines, 'LD_PRELOAD': shim, 'OMP_WAIT_POLICY': 'passive'})
    bake = measure.must(kiln.bake(scene, *options, '--preview', ranks=ranks, timeout=3600))
    del kiln.environment['LD_PRELOAD']
    bake.remove()
    with open(lines) as file:
        found = [list(map(float, line.split())) for line in file]
    os.remove(lines)
    assert len(found) == ranks, found
    return [own - inside for _, own, inside in found]


def planned(kiln, scene, ranks, options):
    return must(kiln.command('plan', scene, '--json', '--ranks', ranks, '--ranks-per-node', ranks,
                             *options)).json()


def bakes(kiln, scene, arguments, options):
    shim, first = made_shim(kiln), None
    options = ['--texels-per-metre', arguments.texels_per_metre, '--threads', 1, *options]
    table = harness.Table(('ranks', 6), ('busiest, s', 11), ('all, s', 9), ('efficiency', 11), ('simulated, s', 13),
                          ('efficiency', 11), ('of measured', 12))
    for ranks in map(int, arguments.ranks.split(',')):
        turns = [worked(kiln, scene, ranks, options, shim) for _ in range(arguments.turns)]
        turn = min(turns, key=max)
        told = min(planned(kiln, scene, ranks, options)['seconds']['total'] for _ in range(arguments.turns))
        first = first or (max(turn), told)
        table.row(ranks, '%.2f' % max(turn), '%.2f' % sum(turn), '%.1f %%' % (100 * first[0] / ranks / max(turn)),
                  '%.2f' % told, '%.1f %%' % (100 * first[1] / ranks / told), '%.2f' % (told / max(turn)))


def written(kiln, writer, side, ranks):
    """Rows of a run: rank, seconds, bytes; and the hash of the file and its size."""
    folder = os.path.join(kiln.scratch, 'points')
    os.makedirs(folder, exist_ok=True)
    run = must(harness.run(['mpirun', '--bind-to', 'none', '-n', str(ranks), writer, folder, 'points-%d' % side], 3600,
                           {**kiln.environment, 'OMP_NUM_THREADS': '1'}))
    with open(os.path.join(folder, 'kiln.h5'), 'rb') as file:
        data = file.read()
    return [list(map(float, line.split())) for line in run.stdout.splitlines()], hashlib.sha256(data).digest()


def writing(kiln, scene, arguments):
    import h5py
    plan = planned(kiln, scene, 2, ['--threads', 1])
    alone, first = plan['strong_scaling'][-1]['write_alone'] / plan['strong_scaling'][-1]['points'], None
    table = harness.Table(('ranks', 6), ('rank 0, s', 10), ('busiest, s', 11), ('all, s', 8), ('simulated, s', 13),
                          ('of measured', 12), ('rank 0, MB', 11), ('bytes', 6))
    for ranks in map(int, arguments.ranks.split(',')):
        turns = [written(kiln, arguments.writer, arguments.side, ranks) for _ in range(arguments.turns)]
        rows, digest = min(turns, key=lambda turn: max(row[1] for row in turn[0]))
        if first is None:
            with h5py.File(os.path.join(kiln.scratch, 'points', 'kiln.h5')) as file:
                points = len(file['points/valid'])
            print('%d points' % points)
            first = rows[0][1], digest
        told = (first[0] - alone * points) / ranks + alone * points
        busiest = max(row[1] for row in rows)
        table.row(ranks, '%.3f' % rows[0][1], '%.3f' % busiest, '%.3f' % sum(row[1] for row in rows), '%.3f' % told,
                  '%.2f' % (told / busiest), '%.0f' % (1e-6 * rows[0][2]), 'same' if digest == first[1] else 'OTHER')


def main():
    def more(parser):
        parser.add_argument('--ranks', default='1,2,4,8')
        parser.add_argument('--texels-per-metre', type=float, default=24)
        parser.add_argument('--turns', type=int, default=2)
        parser.add_argument('--writer', metavar='PROGRAM')
        parser.add_argument('--side', type=int, default=1024)
        parser.add_argument('scene', nargs='?')
    options = []
    if '--' in sys.argv:
        options = sys.argv[sys.argv.index('--') + 1:]
        del sys.argv[sys.argv.index('--'):]
    arguments, kiln = harness.start(__doc__, more)
    scene = arguments.scene or measure.made(kiln, 'cornell')
    if arguments.writer:
        writing(kiln, scene, arguments)
    else:
        bakes(kiln, scene, arguments, options)


if __name__ == '__main__':
    main()
