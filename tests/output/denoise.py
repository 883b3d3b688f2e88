"""Denoised lightmaps of the Cornell box, against raw ones and a bake of 64 times the samples.

  /usr/bin/python3 tests/output/denoise.py --kiln build/release/kiln [--backend vulkan] [--full]

Indirect light with the samples of `preview` must have 3.2 times less error, which is worth ten times the samples.
With --full: a bake that has converged must not lose more than 2 %. kiln.h5 holds the same with and without; the same
bytes come from 1, 3 and 4 ranks. Of the texels 93 to 98.5 % lie within two stated errors; an error is 0 only where
that of raw light is. Where direct light changes by more than a tenth of its mean from texel to texel, at the edges of
shadows, the error does not rise. With --backend vulkan the lightmaps are compared with Embree's instead.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402

OPTIONS = ('--texels-per-metre', 10, '--samples-probe', 0, '--no-export', '--error-map', '--no-stitch')
PREVIEW = ('--quality', 'preview', '--samples-direct', 64)
MORE = ('--samples-direct', 1024, '--samples-bounce', 16, '--samples-indirect', 8192, '--seed', 5)
HIGH = ('--samples-direct', 512, '--samples-bounce', 32, '--samples-indirect', 1024)


def layers(bake):
    """{what: array} of all lightmaps in a row; `counts`: gathered, and covered by half at least."""
    parts = {}
    for entry in bake.run['objects']:
        channels, _ = harness.read_exr(os.path.join(bake.directory, entry['lightmap']))
        found = {name: sum(f * channels['%s.%s' % (name, c)].astype(float)
                           for f, c in zip(harness.LUMINANCE, 'RGB')) for name in ('direct', 'indirect')}
        found.update(error=channels['error.Y'], gathered=channels['validity.Y'] == 1,
                     counts=(channels['validity.Y'] == 1) & (channels['coverage.Y'] > 0.5))
        for name, array in found.items():
            parts.setdefault(name, []).append(array.ravel())
    return {name: np.concatenate(arrays) for name, arrays in parts.items()}


def away(got, reference, what):
    """Root mean square of the difference over the mean of the total."""
    counts = got['counts'] & reference['counts']
    mean = (reference['direct'] + reference['indirect'])[counts].mean()
    return float(np.sqrt(np.mean((got[what] - reference[what])[counts] ** 2)) / mean)


def edges(bake):
    """Where direct light changes much from a texel to the next one of the same object."""
    masks = []
    for entry in bake.run['objects']:
        channels, _ = harness.read_exr(os.path.join(bake.directory, entry['lightmap']))
        light, good = channels['direct.G'].astype(float), channels['validity.Y'] == 1
        mask = np.zeros(light.shape, bool)
        for axis in (0, 1):
            steps = np.abs(np.diff(light, axis=axis)) > 0.1 * light[good].mean()
            both = steps & np.logical_and(*(good[tuple(slice(*(ends if k == axis else (None, None))) for k in (0, 1))]
                                            for ends in ((None, -1), (1, None))))
            for ends in ((None, -1), (1, None)):
                mask[tuple(slice(*(ends if k == axis else (None, None))) for k in (0, 1))] |= both
        masks.append(mask.ravel())
    return np.concatenate(masks)


def same_points(a, b):
    return all(np.array_equal(getattr(a.points, name), getattr(b.points, name))
               for name in ('direct', 'indirect', 'total', 'error', 'valid'))


def method(bake):
    return harness.read_exr(os.path.join(bake.directory, bake.run['objects'][0]['lightmap']))[1].get('kiln:denoise')


def gains(checks, kiln, scene):
    """The layers of the bake with many samples; None if a bake failed."""
    raw = kiln.bake(scene, *OPTIONS, *PREVIEW, '--denoise', 'none')
    clean = kiln.bake(scene, *OPTIONS, *PREVIEW)
    best = kiln.bake(scene, *OPTIONS, *MORE, '--denoise', 'none')
    if not all([checks.baked(b) for b in (raw, clean, best)]):
        return None
    checks.that((method(raw), method(clean)) == ('none', 'regression'), 'the attribute says %s of the raw lightmap, '
                'and %s of the denoised one' % (method(raw), method(clean)))
    checks.that(same_points(raw, clean), 'kiln.h5 is not the same with and without denoising')
    r, c, b = layers(raw), layers(clean), layers(best)
    for what, least in (('indirect', 3.2), ('direct', 1.5)):
        ratio = away(r, b, what) / away(c, b, what)
        print('%s light at preview: %.3f %% raw, %.3f %% denoised: %.2f times less' % (
            what, 100 * away(r, b, what), 100 * away(c, b, what), ratio))
        checks.that(ratio >= least, 'the error of %s light falls by %.2f, not by %.1f' % (what, ratio, least))
    edge = edges(best) & b['counts'] & r['counts']
    raw_edge, clean_edge = (float(np.sqrt(np.mean((x['direct'] - b['direct'])[edge] ** 2))) for x in (r, c))
    print('direct light at %d edges of shadows: error %.4g raw, %.4g denoised' % (edge.sum(), raw_edge, clean_edge))
    checks.that(edge.sum() > 100 and clean_edge <= raw_edge, 'the error at edges of shadows rises from %.4g to %.4g' % (
        raw_edge, clean_edge))
    gathered = r['gathered']
    checks.that(np.isfinite(c['error']).all(), 'a stated error is no number')
    checks.that((c['error'][gathered & (r['error'] > 0)] > 0).all(), 'a stated error is 0 where that of the raw is not')
    off = c['direct'] + c['indirect'] - b['direct'] - b['indirect']
    said, was, true = (float(np.sqrt(np.mean(x[c['counts']] ** 2))) for x in (c['error'], r['error'], off))
    within = 100 * float((np.abs(off) < 2 * np.hypot(c['error'], b['error']))[c['counts'] & b['counts']].mean())
    print('stated error: %.4g raw, %.4g denoised, where %.4g is true; %.1f %% within two' % (was, said, true, within))
    checks.that(0.7 < said / true < 1.5 and said < was / 2, 'the stated error is %.4g, of raw light %.4g, the true one '
                '%.4g' % (said, was, true))
    checks.that(93 < within < 98.5, '%.1f %% of the texels lie within two stated errors' % within)
    left = clean.run['denoise']
    checks.that(left['method'] == 'regression' and left['seconds'] > 0 and 0 < left['variance_left_indirect'] < 0.3,
                'run.json says %s' % left)
    return b


def keeps_converged(checks, kiln, scene, b):
    converged = [kiln.bake(scene, *OPTIONS, *HIGH, '--denoise', how) for how in ('none', 'regression')]
    if all([checks.baked(x) for x in converged]):
        for what in ('direct', 'indirect'):
            pair = [away(layers(x), b, what) for x in converged]
            print('%s light, converged: %.4f %% raw, %.4f %% denoised' % (what, 100 * pair[0], 100 * pair[1]))
            checks.that(pair[1] <= 1.02 * pair[0], 'the error of converged %s light rises from %.4g to %.4g' % (
                what, *pair))


def same_over_ranks(checks, kiln, scene):
    first = None
    for ranks, threads in ((0, 1), (3, 1), (4, 2)):
        bake = kiln.bake(scene, *OPTIONS, '--quality', 'draft', '--threads', threads, ranks=ranks)
        if checks.baked(bake):
            first = first or harness.lightmap_hashes(bake)
            checks.that(harness.lightmap_hashes(bake) == first,
                        'lightmaps of %d ranks are not the same bytes' % ranks, bake.process)


def not_of_a_reference(checks, kiln, scene):
    bake = kiln.bake(scene, '--texels-per-metre', 2, '--samples-probe', 0, '--no-export', '--quality', 'reference',
                     '--samples-direct', 4, '--samples-bounce', 4, '--samples-indirect', 4)
    if checks.baked(bake):
        checks.that(method(bake) == 'none' and bake.run['denoise']['method'] == 'none',
                    'a bake at --quality reference is denoised by itself')


def as_embree(checks, kiln, scene):
    """The same samples, but for rounding: what differs are a few hits, and with them choices of scales."""
    bakes = []
    for backend in ('vulkan', 'embree'):
        kiln.backend = backend
        bakes.append(kiln.bake(scene, *OPTIONS, '--texels-per-metre', 6, '--quality', 'draft'))
    if all([checks.baked(b) for b in bakes]):
        v, e = (layers(b) for b in bakes)
        off = np.abs(v['direct'] + v['indirect'] - e['direct'] - e['indirect'])[v['counts'] & e['counts']]
        error = np.hypot(v['error'], e['error'])[v['counts'] & e['counts']]
        share = float((off <= 3 * error).mean())
        print('within 3 stated errors of Embree: %.4f' % share)
        checks.that(share > 0.997, 'only %.4f of texels lie within 3 stated errors of Embree\'s' % share)


def main():
    arguments, kiln = harness.start(__doc__, lambda parser: parser.add_argument('--full', action='store_true',
                                                                                help='a converged bake too'))
    checks = harness.Checks()
    scene = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
    if arguments.backend == 'vulkan':
        as_embree(checks, kiln, scene)
    else:
        best = gains(checks, kiln, scene)
        if arguments.full and best is not None:
            keeps_converged(checks, kiln, scene, best)
        same_over_ranks(checks, kiln, scene)
        not_of_a_reference(checks, kiln, scene)
    return checks.end()


if __name__ == '__main__':
    sys.exit(main())
