"""Times that kiln says before the light against those that its bakes take, phase by phase.

  /usr/bin/python3 tests/bench/expected.py --kiln build/release/kiln [--backends embree,vulkan] [--options '...']
      [--first] [--texels N] [--folder DIR ...] [--short] [--csv FILE] [SCENE ...]

SCENE is a path, NAME=PATH, or the name of one of the nine scenes of quality_scenes.py, which are baked with the light
that they have there; without scenes all of these that are found, in ../shared/scenes/third_party and the folders of
--folder. --texels makes each about so dense; else it has the density of the options. For each scene and backend a bake
with the options; with --first on `vulkan` a bake before it, with an empty folder of kernels, and then one that finds
them; backend `auto` bakes with what is chosen. Each row is a phase: seconds expected when the backend was chosen, with
the scene open (`choice`), seconds expected before the light (`expected` in run.json: what was over by then is as
measured), seconds of the slowest rank, and the ratios; --short leaves these rows out. The aim for whole bakes is a
factor of 1.5 either way of what was expected before the light.

Then a row a bake: whole seconds, and over them those expected by the choice, before the light by a trial, and after the
first round; rounds and error by the trial and in the end; processor seconds over threads, where other programs take
time. The last table is the geometric mean of taken / expected before the light of each phase over all bakes of a
backend: what a rate of coordinator/bake/reckon/rates.c is off by.
"""
import csv
import math
import os
import shlex
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402
import quality  # noqa: E402
import quality_scenes  # noqa: E402

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


def compare(name, backend, bake, arguments, rows, wholes):
    run, whole = bake.run, bake.process.seconds
    chosen, said = run['backend']['choice'][backend], run['expected']
    print('\n%s, %s, %d points: %.1f s whole, %.1f expected by the choice (%.2f), %.1f before the light (%.2f)%s' % (
        name, backend, run['points']['count'], whole, chosen['total'], whole / chosen['total'], said['total'],
        whole / said['total'],
        '' if 1 / AIM <= whole / said['total'] <= AIM else ': OUTSIDE THE AIM'))
    table = harness.Table(('phase', 16), ('choice', 9), ('before', 9), ('taken', 9), ('taken/before', 12))
    seconds = taken(run)
    for phase in sorted(set(seconds) | set(said) - {'total'}, key=lambda p: -seconds.get(p, 0.0)):
        t, c, e = seconds.get(phase, 0.0), chosen.get(phase, 0.0), said.get(phase, 0.0)
        if max(t, c) >= 0.01 and not arguments.short:
            table.row(phase, '%.2f' % c, '%.2f' % e, '%.2f' % t, '%.2f' % (t / e) if e > 0 else '-')
        rows.append((name, backend, run['points']['count'], phase, c, e, t))
    rows.append((name, backend, run['points']['count'], 'whole', chosen['total'], said['total'], whole))
    wholes.append((name, backend, whole, bake.process.processor / run['threads'], run))


def whole_table(wholes):
    """A row a bake; times expected over those taken, and what the rounds were to be and were."""
    table = harness.Table(('scene', 16), ('backend', 7), ('s', 7), ('of cores', 8), ('choice', 6), ('before', 6),
                          ('then', 6), ('rounds', 8), ('error, %', 12))
    for name, backend, whole, cores, run in wholes:
        foretold, error = run.get('foretold', {}), run['error']
        then = foretold.get('total_after_first_round')
        table.row(name, backend, '%.2f' % whole, '%.2f' % cores,
                  '%.2f' % (run['backend']['choice'][backend]['total'] / whole),
                  '%.2f' % (run['expected']['total'] / whole), '%.2f' % (then / whole) if then else '-',
                  '%s, %s' % (foretold.get('rounds', '-'), error.get('rounds', '-')),
                  '%.2g, %.2g' % (100 * foretold.get('error', 0.0), 100 * error.get('published', 0.0)))


def summary(rows):
    table = harness.Table(('backend', 8), ('phase', 16), ('bakes', 6), ('taken/before', 12), ('least', 7), ('most', 7))
    for backend, phase in sorted({(r[1], r[3]) for r in rows}):
        ratios = [t / e for _, b, _, p, _, e, t in rows
                  if (b, p) == (backend, phase) and e > 0 and t > 0 and max(e, t) >= LEAST]
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


def bench(kiln, name, path, arguments, options, rows, wholes):
    for backend in arguments.backends.split(','):
        for which in ('first', 'kept') if arguments.first and backend == 'vulkan' else ('',):
            kernels = os.path.join(kiln.scratch, 'kernels-' + name if which else 'kernels')
            bake = baked(kiln, path, backend, kernels, options)
            used = 'vulkan' if bake.run['backend']['name'] == 'vulkan' else 'embree'
            compare(' '.join(filter(None, (name, which))), used, bake, arguments, rows, wholes)
            bake.remove()


def ready(kiln, name, folders):
    """(name, path, options) of a scene, by its name or path; None: it has no file."""
    if name in quality_scenes.SCENES:
        found = quality_scenes.SCENES[name].ready(kiln, folders)
        return found and (name, *found)
    label, path = name.split('=', 1) if '=' in name else (os.path.basename(name), name)
    return label, path, ()


def more(parser):
    parser.add_argument('--options', default='')
    parser.add_argument('--texels', type=int, default=0)
    parser.add_argument('--folder', action='append', default=['../shared/scenes/third_party'], metavar='DIR')
    parser.add_argument('scenes', nargs='*', metavar='SCENE')


def scenes_of(kiln, arguments):
    """(name, path, options) of all scenes, one after the other."""
    for name in arguments.scenes or quality_scenes.SCENES:
        found = ready(kiln, name, arguments.folder)
        if found is None:
            print('%s: no folder has its file' % name)
            continue
        label, path, options = found
        if arguments.texels > 0:
            options = (*options, '--texels-per-metre', quality.density_of(kiln, path, arguments.texels))
        yield label, path, (*options, *shlex.split(arguments.options))


def main():
    def own(parser):
        parser.add_argument('--backends', default='embree')
        parser.add_argument('--first', action='store_true')
        parser.add_argument('--short', action='store_true')
        parser.add_argument('--csv', metavar='FILE')
    arguments, kiln = harness.start(__doc__, more, own)
    rows, wholes = [], []
    for name, path, options in scenes_of(kiln, arguments):
        bench(kiln, name, path, arguments, options, rows, wholes)
    print()
    whole_table(wholes)
    print()
    summary(rows)
    if arguments.csv:
        with open(arguments.csv, 'w', newline='') as file:
            writer = csv.writer(file)
            writer.writerow(('scene', 'backend', 'points', 'phase', 'choice_s', 'before_s', 'taken_s'))
            writer.writerows(rows)


if __name__ == '__main__':
    main()
