"""Times that kiln says before the light against those that its bakes take, phase by phase.

  /usr/bin/python3 tests/bench/expected.py --kiln build/release/kiln [--backends embree,vulkan] [--options '...']
      [--first] [--csv FILE] [SCENE ...]

SCENE is a path, or NAME=PATH; without scenes the Cornell box and three rooms are baked. For each scene and backend a
bake with the options; with --first on `vulkan` a bake before it, with an empty folder of kernels, and then one that
finds them. Each row is a phase: seconds expected when the backend was chosen, with the scene open (`choice`), seconds
expected before the light (`expected` in run.json: what was over by then is as measured), seconds of the slowest rank,
and the ratios. The aim for whole bakes is a factor of 1.5 either way. The last table is the geometric mean of
taken / expected of each phase over all bakes of a backend: what a rate of coordinator/bake/reckon/rates.c is off by.
"""
import csv
import math
import os
import shlex
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

AIM = 1.5
LEAST = 0.1  # s, below which a phase says nothing
ROWS = {'exchange': None, 'waiting': None, 'checkpoints': None, 'volume.hdf': 'other', 'scene.glb': 'other'}


def taken(run):
    """Seconds of the phases as they are reckoned. Waiting for kernels is a phase of its own, which a bake counts where
    it waits: it is taken from the phases in the order of the passes."""
    seconds = {}
    for phase in run['phases']:
        name = ROWS.get(phase['name'], phase['name'])
        if name is not None:
            seconds[name] = seconds.get(name, 0.0) + phase['seconds']['max']
    waited = run['beside_loading']['kernels']['waited_seconds'] if run.get('beside_loading') else 0.0
    seconds['kernels'] = waited
    for name in ('validity', 'direct light', 'caustics', 'bounces', 'final gather', 'probes', 'denoising'):
        part = min(waited, seconds.get(name, 0.0))
        seconds[name] = seconds.get(name, 0.0) - part
        waited -= part
    return seconds


def compare(name, backend, bake, rows):
    run, whole = bake.run, bake.process.seconds
    chosen, said = run['backend']['choice'][backend], run['expected']
    print('\n%s, %s, %d points: %.1f s whole, %.1f expected by the choice (%.2f), %.1f before the light (%.2f)%s' % (
        name, backend, run['points']['count'], whole, chosen['total'], whole / chosen['total'], said['total'],
        whole / said['total'],
        '' if 1 / AIM <= whole / chosen['total'] <= AIM else ': OUTSIDE THE AIM'))
    table = harness.Table(('phase', 16), ('choice', 9), ('before', 9), ('taken', 9), ('taken/choice', 12))
    seconds = taken(run)
    for phase in sorted(set(seconds) | set(said) - {'total'}, key=lambda p: -seconds.get(p, 0.0)):
        t, c, e = seconds.get(phase, 0.0), chosen.get(phase, 0.0), said.get(phase, 0.0)
        if max(t, c) >= 0.01:
            table.row(phase, '%.2f' % c, '%.2f' % e, '%.2f' % t, '%.2f' % (t / c) if c > 0 else '-')
        rows.append((name, backend, run['points']['count'], phase, c, e, t))
    rows.append((name, backend, run['points']['count'], 'whole', chosen['total'], said['total'], whole))


def summary(rows):
    table = harness.Table(('backend', 8), ('phase', 16), ('bakes', 6), ('taken/choice', 12), ('least', 7), ('most', 7))
    for backend, phase in sorted({(r[1], r[3]) for r in rows}):
        ratios = [t / c for _, b, _, p, c, _, t in rows
                  if (b, p) == (backend, phase) and c > 0 and t > 0 and max(c, t) >= LEAST]
        if ratios:
            mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
            table.row(backend, phase, len(ratios), '%.2f' % mean, '%.2f' % min(ratios), '%.2f' % max(ratios))


def baked(kiln, path, backend, kernels, options):
    """A whole bake, with its preview."""
    kiln.number += 1
    directory = os.path.join(kiln.scratch, 'bake%d' % kiln.number)
    return measure.must(harness.Bake(directory, kiln.command(
        'bake', path, '-o', directory, '--quiet', '--backend', backend, '--kernel-cache', kernels, *options,
        timeout=3600)))


def bench(kiln, name, path, arguments, rows):
    for backend in arguments.backends.split(','):
        for which in ('first', 'kept') if arguments.first and backend == 'vulkan' else ('',):
            kernels = os.path.join(kiln.scratch, 'kernels-' + name if which else 'kernels')
            bake = baked(kiln, path, backend, kernels, shlex.split(arguments.options))
            compare(' '.join(filter(None, (name, which))), backend, bake, rows)
            bake.remove()


def main():
    def more(parser):
        parser.add_argument('--backends', default='embree')
        parser.add_argument('--options', default='')
        parser.add_argument('--first', action='store_true')
        parser.add_argument('--csv', metavar='FILE')
        parser.add_argument('scenes', nargs='*', metavar='SCENE')
    arguments, kiln = harness.start(__doc__, more)
    scenes = [s.split('=', 1) if '=' in s else (os.path.basename(s), s) for s in arguments.scenes]
    rows = []
    for name, path in scenes or [('cornell', measure.made(kiln, 'cornell')),
                                 ('rooms', measure.made(kiln, 'rooms', '--columns', 3, '--rows', 1))]:
        bench(kiln, name, path, arguments, rows)
    print()
    summary(rows)
    if arguments.csv:
        with open(arguments.csv, 'w', newline='') as file:
            writer = csv.writer(file)
            writer.writerow(('scene', 'backend', 'points', 'phase', 'choice_s', 'before_s', 'taken_s'))
            writer.writerows(rows)


if __name__ == '__main__':
    main()
