"""Bidirectional views by the measures of two theses: Rodrigues, "Vertex connection and merging on GPUs" (2021), and
Sun, "Bidirectional path tracing for caustics" (2020).

  /usr/bin/python3 tests/bench/bidirectional.py --kiln build/release/kiln [--backend vulkan] [--share S] [SCENE ...]

Rodrigues draws cornell-spheres, classroom, dining_room and veach_ajar with 1920 x 1080 pixels; Sun draws water with
1280 x 720 and paths of four rays. Pictures here have the share S of these sides (default: 0.05, for a CPU). Scenes that
are not beside the checkout are left out; the name water means `kiln generate cornell-water` with Sun's size.

Of each scene and method (path, bdpt, vcm) one row has, by `kiln bench converge`: milliseconds of a picture of one path
a pixel, of each further path, and of a million pixels at that rate; of Rodrigues' scenes the time of a further path at
his size over that of his frame (RTX 2080); dB (PSNR of 8-bit pictures) and 1 / SSIM - 1 of the last view; dB gained for
each doubling of the time and of the paths, over the first and over the second half of the views. Unbiased paths gain
3.01 for each doubling, less where a few pixels rule; a method on a plateau gains less in the second half. Then how many
times as long path tracing takes for the error that each other method ends with, or as it ends with itself where that is
more. The reference is the mean of two pictures of `--reference-paths` by `--reference-method` (vcm finds all light in
scenes where lamps without extent stand before mirrors, bdpt in others). They say its own error, which is taken off all
errors; views that are nearer to it than 3 dB do not count. Times are by the clock: on a machine that others use only
gains by paths mean something. Of water the last rows have frames a second and the most memory that the process held; a
GPU's own is not in it.
"""
import collections
import json
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import exr  # noqa: E402
import harness  # noqa: E402

METHODS = ('path', 'bdpt', 'vcm')
# size; milliseconds of a frame of Rodrigues' vertex connection and merging, and of his bidirectional path tracing
Picture = collections.namedtuple('Picture', 'size published options')
FULL, SUNS = (1920, 1080), (1280, 720)
PICTURES = {'cornell-spheres': Picture(FULL, {'bdpt': 49.2, 'vcm': 51.1, 'path': 3.7}, ()),
            'classroom': Picture(FULL, {'bdpt': 72.9, 'vcm': 75.7, 'path': 12.7}, ()),
            'dining_room': Picture(FULL, {'bdpt': 28.9, 'vcm': 29.7, 'path': 4.8}, ()),
            'veach_ajar': Picture(FULL, {'bdpt': 63.9, 'vcm': 68.4, 'path': 14.2}, ()),
            'water': Picture(SUNS, {}, ('--path-length', 4))}
GENERATED = {'cornell-spheres': 'cornell-spheres', 'water': 'cornell-water'}


def must(run):
    if run.status != 0:
        sys.exit('%s\nended with %d: %s' % (run.line(), run.status, run.sentence()))
    return run


def scene_of(kiln, name):
    if name in GENERATED:
        return measure.made(kiln, GENERATED[name])
    path = os.path.join(harness.SHARED, 'third_party', name + '.glb')
    return path if os.path.exists(path) else None


def options_of(kiln, name, options):
    width, height = (max(8, round(side * options.share)) for side in PICTURES[name].size)
    return ('--materials', 'auto', '--backend', kiln.backend, '--threads', options.threads, '--width', width,
            '--height', height, *PICTURES[name].options), width * height


def reference(kiln, scene, how, options, folder):
    """(file, the power of its own error relative to white, as of 10^(-dB/10))."""
    halves = [os.path.join(folder, 'half%d.exr' % seed) for seed in (0, 1)]
    for seed, half in enumerate(halves):
        must(kiln.command('view', scene, '--method', options.reference_method, '--samples-pixel',
                          options.reference_paths, '--seed', 1000 + seed, '-o', half, '--quiet', *how, timeout=7200))
    mean = (exr.rgb(halves[0]) + exr.rgb(halves[1])) / 2
    path = os.path.join(folder, 'reference.exr')
    exr.write(path, dict(zip('RGB', np.moveaxis(mean, -1, 0))))
    apart = must(kiln.command('compare', *halves, '--json')).json()['picture_psnr']
    return path, 10 ** (-apart / 10) / 4


def slope(views, key):
    """dB for each doubling, by least squares."""
    x, y = np.log2([view[key] for view in views]), [view['db'] for view in views]
    return float(np.polyfit(x, y, 1)[0]) if len(views) > 1 else math.nan


def time_of(views, db):
    """Seconds to so many dB: (seconds, whether that is the most that is known of it)."""
    for a, b in zip(views, views[1:]):
        if b['db'] >= db > a['db']:
            return a['seconds'] * (b['seconds'] / a['seconds']) ** ((db - a['db']) / (b['db'] - a['db'])), True
    return views[-1]['seconds'], False


def known(method, own):
    """The views whose error is known, with `db` of theirs alone."""
    views = []
    for view in method['views']:
        power = 10 ** (-view['picture_psnr'] / 10) if view['picture_psnr'] is not None else 0.0
        if power > 2 * own:
            views.append({**view, 'db': -10 * math.log10(power - own)})
    return views


def row(table, name, method, views, pixels):
    """What one method does in one scene."""
    one, last = method['views'][0], method['views'][-1]
    further = (last['seconds'] - one['seconds']) / max(1, last['paths'] - one['paths'])
    published = PICTURES[name].published.get(method['method'])
    at_full = further * math.prod(PICTURES[name].size) / pixels * 1000
    half = len(views) // 2 + 1
    gains = ['%.2f/%.2f' % (slope(part, 'seconds'), slope(part, 'paths')) for part in (views[:half], views[half - 1:])]
    table.row(name, method['method'], last['paths'], '%.0f' % (1000 * one['seconds']), '%.1f' % (1000 * further),
              '%.0f' % (1e9 * further / pixels), '%.3g' % (at_full / published) if published else '',
              '%.2f' % views[-1]['db'], '%.4f' % views[-1]['picture_dissimilarity'], *gains)


def against_paths(found):
    """How many times as long path tracing takes for what each method ends with."""
    if 'path' not in found:
        return
    for method, views in found.items():
        if method != 'path':
            db = min(views[-1]['db'], found['path'][-1]['db'])
            took, there = time_of(found['path'], db)
            mine, _ = time_of(views, db)
            print('  %s has %.2f dB in %.3g s, path tracing in %s%.3g s: %.3g times' %
                  (method, db, mine, '' if there else '>= ', took, took / mine))


def compare(kiln, table, name, scene, options):
    folder = os.path.join(kiln.scratch, name)
    os.makedirs(folder, exist_ok=True)
    how, pixels = options_of(kiln, name, options)
    file, own = reference(kiln, scene, how, options, folder)
    out = must(kiln.command('bench', 'converge', scene, *METHODS, '--reference', file, '--doublings',
                            options.doublings, '--max-time', options.max_time, '-o', os.path.join(folder, 'converge'),
                            '--json', '--quiet', *how, timeout=7200)).json()
    found = {}
    for method in out['methods']:
        if not method['views']:
            print('%s, %s: refused: %s' % (name, method['method'], method['refused']))
            continue
        views = known(method, own)
        if views:
            found[method['method']] = views
            row(table, name, method, views, pixels)
    print('  the reference\'s own error: %.1f dB' % (-10 * math.log10(own)))
    against_paths(found)
    return how, pixels


def frames(kiln, name, scene, how, pixels):
    """Frames a second, and memory, of each method at the picture's own size."""
    for method in METHODS:
        run = must(kiln.command('view', scene, '--method', method, '--samples-pixel', 1, '--json', '--quiet', '-o',
                                os.path.join(kiln.scratch, 'frame.exr'), *how, timeout=3600))
        seconds = json.loads(run.stdout)['seconds']
        print('  %s by %s: %.3g frames a second of %d pixels, %.3g of 1280 x 720 at that rate; %.0f MB' %
              (name, method, 1 / seconds, pixels, pixels / seconds / math.prod(SUNS), run.peak_bytes / 1e6))


def main():
    options, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--share', type=float, default=0.05, help='of the sides of pictures'),
        lambda p: p.add_argument('--doublings', type=int, default=8),
        lambda p: p.add_argument('--max-time', type=float, default=30, help='seconds of a view'),
        lambda p: p.add_argument('--reference-paths', type=int, default=1024, help='of each of its two halves'),
        lambda p: p.add_argument('--reference-method', choices=METHODS, default='bdpt'),
        lambda p: p.add_argument('--threads', type=int, default=1),
        lambda p: p.add_argument('scenes', nargs='*', choices=[*PICTURES, []]))
    table = harness.Table(('scene', 16), ('method', 6), ('paths', 6), ('ms first', 9), ('ms a path', 9),
                          ('a megapixel', 11), ('over his', 8), ('dB', 6), ('1/SSIM-1', 8), ('dB a doubling', 13),
                          ('and late', 11))
    for name in options.scenes or PICTURES:
        scene = scene_of(kiln, name)
        if scene is None:
            print('%s is not in ../shared/scenes/third_party: left out' % name)
            continue
        how, pixels = compare(kiln, table, name, scene, options)
        if name == 'water':
            frames(kiln, name, scene, how, pixels)


if __name__ == '__main__':
    main()
