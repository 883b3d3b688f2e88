"""The end of a bake, phase by phase: seconds of writing lightmaps and kiln.h5, of the export and of the preview.

  /usr/bin/python3 tests/bench/writing.py --kiln build/release/kiln [--against PROGRAM] [--texels-per-metre 40]
      [--threads 1] [--ranks 0] [--turns 3] [SCENE ...] [-- OPTIONS]

Few samples, so that little else is done. Each phase's least time of so many turns, which go to the programs by turns:
by the clock, and of the processor, of all threads and ranks (a program that does not report that has a dash). `ahead`
is what was packed beside the passes, whose processor time is not in that of kiln.h5. The last rows are the whole bake,
and the bytes that it left. Without a scene: the Cornell box.
"""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

CHEAP = ('--samples-direct', 1, '--samples-bounce', 1, '--samples-indirect', 1, '--bounces', 1, '--samples-probe', 0,
         '--denoise', 'none', '--preview')
PHASES = ('lightmaps', 'kiln.h5', 'scene.glb', 'preview')


def least(a, b):
    return b if a is None else a if b is None else min(a, b)


def once(kiln, scene, arguments, options):
    """{row: (seconds by the clock, of the processor)} of a bake, and its bytes."""
    bake = measure.must(kiln.bake(scene, *CHEAP, '--texels-per-metre', arguments.texels_per_metre, '--threads',
                                  arguments.threads, *options, ranks=arguments.ranks, timeout=3600))
    rows = {p['name']: (p['seconds']['max'], p.get('processor_seconds')) for p in bake.run['phases']
            if p['name'] in PHASES}
    ahead = bake.run.get('beside_passes', {}).get('points')
    if ahead:
        rows['ahead'] = ahead['seconds'], ahead['processor_seconds']
    rows['whole'] = bake.process.seconds, bake.process.processor
    sizes = [os.path.getsize(os.path.join(folder, name)) for folder, _, names in os.walk(bake.directory)
             for name in names]
    points = bake.run['points']['count']
    bake.remove()
    return rows, sum(sizes), points


def main():
    def more(parser):
        parser.add_argument('--against', metavar='PROGRAM')
        parser.add_argument('--texels-per-metre', type=float, default=40)
        parser.add_argument('--threads', type=int, default=1)
        parser.add_argument('--ranks', type=int, default=0)
        parser.add_argument('--turns', type=int, default=3)
        parser.add_argument('scenes', nargs='*')
    options = []
    if '--' in sys.argv:
        options = sys.argv[sys.argv.index('--') + 1:]
        del sys.argv[sys.argv.index('--'):]
    arguments, kiln = harness.start(__doc__, more)
    programs = [kiln] + ([harness.Kiln(arguments.against, os.path.join(kiln.scratch, 'against'))]
                         if arguments.against else [])
    for scene in arguments.scenes or [measure.made(kiln, 'cornell')]:
        best, bytes_left = [{} for _ in programs], [0] * len(programs)
        for _ in range(arguments.turns):
            for i, program in enumerate(programs):
                rows, bytes_left[i], points = once(program, scene, arguments, options)
                for name, pair in rows.items():
                    best[i][name] = tuple(map(least, best[i].get(name, (None, None)), pair))
        print('%s, %d points' % (os.path.basename(scene), points))
        table = harness.Table(('phase', 10), *[(side + head, 15) for side in ('', 'against ')[:len(programs)]
                                               for head in ('s', 'cpu s')])
        for name in PHASES[:2] + ('ahead',) + PHASES[2:] + ('whole',):
            if any(name in b for b in best):
                table.row(name, *['-' if value is None else '%.3f' % value for b in best
                                  for value in b.get(name, (None, None))])
        table.row('MB left', *[cell for size in bytes_left for cell in ('%.2f' % (1e-6 * size), '')])


if __name__ == '__main__':
    main()
