"""What denoising gains: error and time of lightmaps with and without it, against a bake of many more samples.

  /usr/bin/python3 tests/bench/denoise.py --kiln build/release/kiln [--quality preview] [--reference DIR]
                                          [--times 64] [SCENE ...]

Without scenes: the Cornell box and three rooms. The reference is a bake of `--times` as many samples by another seed,
or the finished bake in DIR, which must have the same lightmaps (one scene only). Errors are over gathered texels that
the layout covers by half at least. nrmse: root mean square over the mean of the total. relative: root mean square of
the error over (total + 2 % of the mean), which weighs dark texels as much as bright ones. "samples": how many times as
many a raw bake would need for the same nrmse.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

LUMINANCE = np.array((0.2126, 0.7152, 0.0722))
SAMPLES = {'draft': (64, 4, 32), 'preview': (64, 8, 128), 'production': (256, 16, 512)}


def layers(bake):
    """Luminance of direct and of indirect light, stated error, and which texels count, of all lightmaps in a row."""
    parts = {name: [] for name in ('direct', 'indirect', 'error', 'counts')}
    for entry in bake.run['objects']:
        if not entry['lightmap']:
            continue
        channels, _ = harness.read_exr(os.path.join(bake.directory, entry['lightmap']))
        for name in ('direct', 'indirect'):
            rgb = np.stack([channels['%s.%s' % (name, c)] for c in 'RGB'], -1)
            parts[name].append((rgb.astype(np.float64) @ LUMINANCE).ravel())
        parts['error'].append(channels.get('error.Y', np.zeros(rgb.shape[:2])).ravel())
        parts['counts'].append(((channels['validity.Y'] == 1) & (channels['coverage.Y'] > 0.5)).ravel())
    return {name: np.concatenate(arrays) for name, arrays in parts.items()}


def errors(got, reference):
    """{what: (nrmse, relative)}"""
    counts = got['counts'] & reference['counts']
    total = (reference['direct'] + reference['indirect'])[counts]
    mean = total.mean()
    found = {}
    for what in ('direct', 'indirect', 'total'):
        value = [b['direct'] + b['indirect'] if what == 'total' else b[what] for b in (got, reference)]
        off = (value[0] - value[1])[counts]
        found[what] = (np.sqrt(np.mean(off ** 2)) / mean, np.sqrt(np.mean((off / (total + 0.02 * mean)) ** 2)))
    return found


def bench(kiln, scene, arguments, table):
    options = ('--quality', arguments.quality, '--samples-direct', SAMPLES[arguments.quality][0], '--samples-probe', 0,
               '--no-export', '--error-map')
    names = ('--samples-direct', '--samples-bounce', '--samples-indirect')
    if arguments.reference:
        best = harness.Bake(arguments.reference)
    else:
        more = [text for name, count in zip(names, SAMPLES[arguments.quality])
                for text in (name, min(count * arguments.times, 65536))]
        best = measure.must(kiln.bake(scene, *options, *more, '--denoise', 'none', '--seed', 7, timeout=36000))
    reference, raw = layers(best), None
    for how in ('none', 'regression'):
        bake = measure.must(kiln.bake(scene, *options, '--denoise', how, timeout=36000))
        found, seconds = errors(layers(bake), reference), bake.run['denoise']['seconds']
        raw = raw or found
        for what, (nrmse, relative) in found.items():
            table.row(os.path.basename(scene), what, how, '%.3f %%' % (100 * nrmse), '%.2f %%' % (100 * relative),
                      '%.1f' % ((raw[what][0] / nrmse) ** 2), '%.2f' % seconds,
                      '%.1f' % (1e6 * seconds / bake.run['points']['count']), '%.1f' % bake.run['seconds'])
        bake.remove()


def main():
    def more(parser):
        parser.add_argument('--quality', choices=tuple(SAMPLES), default='preview')
        parser.add_argument('--reference', metavar='DIR')
        parser.add_argument('--times', type=int, default=64)
        parser.add_argument('scenes', nargs='*', metavar='SCENE')
    arguments, kiln = harness.start(__doc__, more)
    table = harness.Table(('scene', 20), ('light', 8), ('denoise', 10), ('nrmse', 8), ('relative', 8), ('samples', 7),
                          ('s', 7), ('s / million', 11), ('bake s', 7))
    for scene in arguments.scenes or (measure.made(kiln, 'cornell'), measure.made(kiln, 'rooms')):
        bench(kiln, scene, arguments, table)


if __name__ == '__main__':
    main()
