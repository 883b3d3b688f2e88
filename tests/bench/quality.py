"""Whether --quality means what it says: the true error of published lightmaps, for each preset, over seeds.

  /usr/bin/python3 tests/bench/quality.py --csv tests/bench/quality.csv --readme README.md
      [--kiln build/release/kiln] [--backend embree|vulkan|auto] [--folder DIR ...] [--scenes NAME|FILE,...]
      [--qualities draft,preview,8%] [--seeds 4] [--texels preset|N] [--reference-samples D,B,I] [--references DIR]
      [--bakes DIR] [--limit SECONDS] [--options '...'] [--again]
  /usr/bin/python3 tests/bench/quality.py --csv tests/bench/quality.csv --table [--readme README.md]

Without --scenes: the nine of quality_scenes.py; files are looked for in ../shared/scenes/third_party and in the folders
of --folder and of the variable KILN_SCENES, and a scene without its file is left out. The program is --kiln, or the
variable KILN; python3 with numpy and h5py is all else that it takes, so the bench runs on a machine that has no build.

--quality N% asks for an error that 95 % of the texels stay below: of the light of the lightmap file against long bakes,
both averaged over the 5 x 5 texels around each texel that were gathered and that lie in the same lightmap, over that
average of the truth or a twentieth of the object's mean, whichever is more. The truth is the mean of two bakes by other
seeds, with --reference-samples and without denoising; half of what they differ by, measured like an error, is the noise
of the truth, which is in the true error, too. --references and --bakes keep the folders of long bakes and of the first
seed's. --texels N makes all bakes of a scene about so dense, as an error in percent needs it; else a preset's density
is its own, and each has its own long bakes.

A row of the csv is one bake: error asked, true and stated, seconds of the whole process and of processors, without
probes, scene.glb and preview. A bake that is there already, of the same program (by its file's hash), machine, density,
seed and samples of the truth, is not made again without --again. --limit ends a bake that takes longer; there is no row
of it then, and its scene has no further presets. README.md holds the table that --table prints.
"""
import argparse
import hashlib
import math
import os
import shlex
import shutil
import subprocess
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import denoise  # noqa: E402
import measure  # noqa: E402
import harness  # noqa: E402
import quality_scenes  # noqa: E402
import quality_table  # noqa: E402

PLAIN = ('--samples-probe', 0, '--no-export', '--no-preview')
REFERENCE_SEEDS = (1000, 1001)
AROUND = 2  # texels to each side
DARK = 1 / 20  # of the object's mean
SHARE = 0.95
LONG = 36000  # seconds


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


def error(got, reference):
    """What SHARE of the errors stay below."""
    return float(np.quantile(errors(got, reference), SHARE))


class Truth:
    """The mean of two long bakes, and its noise."""

    def __init__(self, first, second):
        self.maps = {name: ((light + second[name][0]) / 2, counts & second[name][1])
                     for name, (light, counts) in first.items()}
        self.noise = error(first, self.maps)


def truth_of(kiln, name, path, options, arguments):
    """The truth of a scene at the density that `options` ask for."""
    samples = [text for pair in zip(('--samples-direct', '--samples-bounce', '--samples-indirect'),
                                    arguments.reference_samples.split(',')) for text in pair]
    found = []
    for seed in REFERENCE_SEEDS:
        words = '-'.join([name, *(os.path.basename(str(o)).strip('-') for o in (*options, *samples)), str(seed)])
        directory = os.path.join(arguments.references, words)
        if not os.path.exists(os.path.join(directory, 'run.json')):
            bake = measure.must(kiln.bake(path, *options, *samples, '--denoise', 'none', '--seed', seed, *PLAIN,
                                          timeout=LONG))
            shutil.rmtree(directory, ignore_errors=True)
            shutil.copytree(bake.directory, directory)
            bake.remove()
        found.append(maps(directory))
    return Truth(*found)


def points_of(kiln, path, *options):
    """(surface points, square metres) of a scene"""
    process = kiln.command('info', path, '--json', *options, timeout=LONG)
    if process.status != 0:
        sys.exit('%s\nended with %d: %s' % (process.line(), process.status, process.sentence()))
    surface = process.json()['surface']
    return surface['points'], surface['area']


def density_of(kiln, path, texels):
    """Texels per metre for about so many texels."""
    density = math.sqrt(texels / points_of(kiln, path)[1])
    for _ in range(2):
        density *= math.sqrt(texels / points_of(kiln, path, '--texels-per-metre', '%.9g' % density)[0])
    return '%.3g' % density


def machine_of(kiln):
    """Words for what bakes: the GPU, if one is asked for and there is a fit one, and the processor."""
    words = '%d cores' % len(os.sched_getaffinity(0))
    with open('/proc/cpuinfo') as file:
        words = next((line.split(':')[1].strip() for line in file if line.startswith('model name')), '') + ', ' + words
    if kiln.backend == 'embree':
        return words
    devices = [d['name'] for d in kiln.command('info', '--devices', '--json').json()['vulkan'] if d['fit']]
    return ', '.join([*devices[:1], words])


def version_of(path):
    """The program's version, and the beginning of its file's hash."""
    with open(path, 'rb') as file:
        return '%s+%s' % (subprocess.run([path, '--version'], capture_output=True, text=True).stdout.split()[-1],
                          hashlib.sha256(file.read()).hexdigest()[:8])


class Bench:
    def __init__(self, kiln, arguments):
        self.kiln, self.arguments = kiln, arguments
        self.machine, self.version = arguments.machine or machine_of(kiln), version_of(kiln.path)
        self.known = set() if arguments.again else {quality_table.key(r) for r in quality_table.read(arguments.csv)}
        self.table = harness.Table(('scene', 20), ('preset', 11), ('seed', 5), ('asked %', 8), ('true %', 8),
                                   ('stated %', 9), ('noise %', 8), ('processor s', 12), ('s', 8))

    def row(self, scene, preset, seed):
        """What a row begins with, by which it is found again."""
        return {'version': self.version, 'machine': self.machine, 'scene': scene.title, 'light': scene.light,
                'preset': preset, 'texels': self.arguments.texels, 'seed': seed,
                'reference': self.arguments.reference_samples.replace(',', ' ')}

    def bake(self, name, path, options, row, truth):
        """Bakes once and writes the row; False if that took too long."""
        arguments = self.arguments
        bake = self.kiln.bake(path, *options, '--seed', row['seed'], *PLAIN, timeout=arguments.limit)
        if bake.process.timed_out:
            print('%s, %s: more than %.0f s' % (row['scene'], row['preset'], arguments.limit), flush=True)
            bake.remove()
            return False
        run = measure.must(bake).run
        reached = error(maps(bake.directory), truth.maps)
        row.update({'points': run['points']['count'], 'texels_per_metre': '%.4g' % run['scene']['texels_per_metre'],
                    'asked': '%.4g' % run['error'].get('asked', math.nan), 'true': '%.5f' % reached,
                    'stated': '%.5f' % run['error'].get('published', math.nan),
                    'rounds': run['error'].get('rounds', 1), 'seconds': '%.2f' % bake.process.seconds,
                    'processor_seconds': '%.2f' % bake.process.processor, 'reference_noise': '%.5f' % truth.noise})
        self.table.row(row['scene'], row['preset'], row['seed'],
                       *('%.2f' % (100 * float(row[c])) for c in ('asked', 'true', 'stated', 'reference_noise')),
                       row['processor_seconds'], row['seconds'])
        if arguments.csv:
            quality_table.add(arguments.csv, row)
        if arguments.bakes and row['seed'] == 0:
            shutil.copytree(bake.directory, os.path.join(arguments.bakes, '%s-%s' % (name, row['preset'])),
                            dirs_exist_ok=True)
        bake.remove()
        return True

    def scene(self, name, scene, path, options):
        """All presets of a scene."""
        arguments, truths = self.arguments, {}
        options = (*options, *shlex.split(arguments.options))
        if arguments.texels != 'preset':
            options += ('--texels-per-metre', density_of(self.kiln, path, int(arguments.texels)))
        for preset in arguments.qualities.split(','):
            rows = [self.row(scene, preset, seed) for seed in range(arguments.seeds)]
            rows = [row for row in rows if quality_table.key(row) not in self.known]
            dense = ('--quality', preset) if arguments.texels == 'preset' else ()
            if rows and dense not in truths:
                truths[dense] = truth_of(self.kiln, name, path, (*options, *dense), arguments)
            for row in rows:
                if not self.bake(name, path, (*options, '--quality', preset), row, truths[dense]):
                    return


def scenes_of(arguments):
    """{name: scene} of --scenes: names, or files with the light they have."""
    known, found = quality_scenes.SCENES, {}
    for name in arguments.scenes.split(',') if arguments.scenes else known:
        base = os.path.splitext(os.path.basename(name))[0]
        if name not in known and not os.path.exists(name):
            sys.exit('%s is no file, and none of %s' % (name, ', '.join(known)))
        found[base] = known.get(name) or quality_scenes.Scene(base, 'its light', file=os.path.abspath(name))
    return found


def options_of(parser):
    parser.add_argument('--csv', metavar='FILE')
    parser.add_argument('--readme', metavar='FILE', help='the page whose table is made of the csv')
    parser.add_argument('--table', action='store_true', help='print the table of the csv, and bake nothing')
    parser.add_argument('--scenes', default='')
    parser.add_argument('--folder', action='append', default=[])
    parser.add_argument('--qualities', default='draft,preview,production,reference')
    parser.add_argument('--seeds', type=int, default=4)
    parser.add_argument('--texels', default='preset')
    parser.add_argument('--reference-samples', default='1024,64,4096')
    parser.add_argument('--references', metavar='DIR')
    parser.add_argument('--bakes', metavar='DIR')
    parser.add_argument('--limit', type=float, default=LONG)
    parser.add_argument('--machine', metavar='WORDS')
    parser.add_argument('--options', default='')
    parser.add_argument('--again', action='store_true')


def run_all(arguments, kiln):
    if arguments.texels == 'preset' and not set(arguments.qualities.split(',')) <= set(quality_table.TITLES):
        sys.exit('an error in percent has no density of its own: give --texels N with it')
    arguments.references = arguments.references or os.path.join(kiln.scratch, 'references')
    folders = [*arguments.folder, *filter(None, os.environ.get('KILN_SCENES', '').split(':')),
               os.path.join(harness.SHARED, 'third_party')]
    bench = Bench(kiln, arguments)
    for name, scene in scenes_of(arguments).items():
        ready = scene.ready(kiln, folders)
        if ready is None:
            print('%s: there is no %s in %s' % (scene.title, scene.file, ', '.join(folders)), flush=True)
        else:
            bench.scene(name, scene, *ready)


def main():
    os.environ.setdefault('KILN_VULKAN_VALIDATION', '0')
    if '--table' in sys.argv:  # takes no program
        parser = argparse.ArgumentParser()
        options_of(parser)
        arguments = parser.parse_args()
    else:
        arguments, kiln = harness.start(__doc__, options_of)
        run_all(arguments, kiln)
    if arguments.csv:
        rows = quality_table.read(arguments.csv)
        print(quality_table.table(rows))
        if arguments.readme:
            quality_table.put(arguments.readme, rows)


if __name__ == '__main__':
    main()
