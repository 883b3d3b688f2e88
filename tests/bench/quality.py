"""Whether --quality means what it says: the true error of published lightmaps, for each preset, over seeds.

  /usr/bin/python3 tests/bench/quality.py --kiln build/release/kiln [--presets preview,8%] [--seeds 4]
      [--references DIR] [--options '...'] [--csv FILE] [SCENE ...]

Without scenes: the Cornell box and three rooms. --quality N% asks for an error that 95 % of the texels stay below: of
the light of the lightmap file against a bake of many more samples by another seed, both averaged over the 5 x 5 texels
around each texel that were gathered and that lie in the same lightmap, over that average of the reference or a
twentieth of the object's mean, whichever is more. References are bakes of their own; --references keeps them for the
next time. Columns: the error asked for, the true one (mean over seeds, least and most), the one that the bake states,
processor seconds and seconds of the whole process.
"""
import csv
import os
import shlex
import shutil
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import denoise  # noqa: E402
import measure  # noqa: E402
import harness  # noqa: E402

PLAIN = ('--samples-probe', 0, '--no-export', '--no-preview')
REFERENCE = ('--samples-direct', 2048, '--samples-bounce', 256, '--samples-indirect', 8192, '--denoise', 'none',
             '--seed', 1000, *PLAIN)
AROUND = 2  # texels to each side
DARK = 1 / 20  # of the object's mean
SHARE = 0.95


def box(values):
    """Sums over the texels around each texel."""
    padded = np.pad(values, AROUND)
    sums = np.pad(padded.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    n = 2 * AROUND + 1
    return sums[n:, n:] - sums[:-n, n:] - sums[n:, :-n] + sums[:-n, :-n]


def maps(directory):
    """{lightmap: (luminance, which texels count)} of a bake's folder."""
    bake, found = harness.Bake(directory), {}
    for entry in bake.run['objects']:
        if entry['lightmap']:
            channels, _ = harness.read_exr(os.path.join(directory, entry['lightmap']))
            rgb = np.stack([channels[c] for c in 'RGB'], -1).astype(np.float64)
            found[entry['lightmap']] = (rgb @ denoise.LUMINANCE,
                                        (channels['validity.Y'] == 1) & (channels['coverage.Y'] > 0.5))
    return found


def errors(got, reference):
    """Errors of all texels that count, of all lightmaps."""
    found = []
    for name, (light, counts) in got.items():
        truth, counted = reference[name]
        counts = counts & counted
        if not counts.any():
            continue
        number = box(counts.astype(np.float64))[counts]
        off = box(np.where(counts, light - truth, 0.0))[counts] / number
        near = box(np.where(counts, truth, 0.0))[counts] / number
        allowed = np.maximum(near, DARK * truth[counts].mean())
        found.append(np.where(off == 0, 0.0, np.abs(off) / np.maximum(allowed, 1e-30)))
    return np.concatenate(found)


def reference_of(kiln, scene, options, folder):
    """Maps of the reference, baked once."""
    name = '-'.join([os.path.splitext(os.path.basename(scene))[0]] + [str(o).strip('-') for o in options])
    directory = os.path.join(folder, name.replace('/', '_'))
    if not os.path.exists(os.path.join(directory, 'run.json')):
        bake = measure.must(kiln.bake(scene, *REFERENCE, *options, timeout=36000))
        shutil.rmtree(directory, ignore_errors=True)
        shutil.copytree(bake.directory, directory)
        bake.remove()
    return maps(directory)


def bench(kiln, scene, arguments, table, rows):
    options = shlex.split(arguments.options)
    folder = arguments.references or os.path.join(kiln.scratch, 'references')
    truth = reference_of(kiln, scene, options, folder)
    for preset in arguments.presets.split(','):
        reached, stated, processor, seconds, asked = [], [], [], [], 0.0
        for seed in range(arguments.seeds):
            bake = measure.must(kiln.bake(scene, '--quality', preset, '--seed', seed, *PLAIN, *options, timeout=36000))
            reached.append(float(np.quantile(errors(maps(bake.directory), truth), SHARE)))
            asked = bake.run['error'].get('asked', 0.0)
            stated.append(bake.run['error'].get('published', float('nan')))
            processor.append(bake.process.processor)
            seconds.append(bake.process.seconds)
            bake.remove()
        row = (os.path.basename(scene), preset, '%.3g' % (100 * asked), '%.2f' % (100 * np.mean(reached)),
               '%.2f' % (100 * min(reached)), '%.2f' % (100 * max(reached)), '%.2f' % (100 * np.mean(stated)),
               '%.1f' % np.mean(processor), '%.1f' % np.mean(seconds))
        table.row(*row)
        rows.append(row)


def main():
    def more(parser):
        parser.add_argument('--presets', default='draft,preview,production,20%,8%,3%')
        parser.add_argument('--seeds', type=int, default=4)
        parser.add_argument('--references', metavar='DIR')
        parser.add_argument('--options', default='')
        parser.add_argument('--csv', metavar='FILE')
        parser.add_argument('scenes', nargs='*', metavar='SCENE')
    arguments, kiln = harness.start(__doc__, more)
    columns = ('scene', 'preset', 'asked %', 'true %', 'least', 'most', 'stated %', 'processor s', 's')
    table, rows = harness.Table(*((c, 20 if c == 'scene' else 11) for c in columns)), []
    for scene in arguments.scenes or (measure.made(kiln, 'cornell'), measure.made(kiln, 'rooms')):
        bench(kiln, scene, arguments, table, rows)
    if arguments.csv:
        with open(arguments.csv, 'w', newline='') as file:
            csv.writer(file).writerows([columns, *rows])


if __name__ == '__main__':
    main()
