"""Adaptive samples of direct light, in the penumbrae of the Cornell box: less error than the equal schedule at as many
samples, no bias, true standard errors, and the same bits for any cells."""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402

SCENE = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
SAMPLES, SEEDS = 64, 3


def direct(kiln, checks, *options):
    """(luminance of direct light, its standard error, area) of all points by object and texel, and run.json. Which
    points are buried changes with the seed a little: those that are have NaN."""
    bake = kiln.bake(SCENE, '--texels-per-metre', 12, '--bounces', 0, '--samples-probe', 0, '--denoise', 'none',
                     '--no-export', *options)
    if not checks.baked(bake):
        checks.end()
    p, run = bake.points, bake.run
    order = np.lexsort((p.x, p.y, p.object))
    light = np.where(p.valid, p.direct @ harness.LUMINANCE, np.nan)
    bake.remove()
    return (light[order], p.error[order], p.area[order]), run


def series(kiln, checks, first, count, *options):
    """Bakes of several seeds: (values, errors), a row a bake; areas; the last run.json."""
    found = [direct(kiln, checks, '--seed', first + i, *options) for i in range(count)]
    return (np.array([f[0][0] for f in found]), np.array([f[0][1] for f in found]), found[0][0][2], found[-1][1])


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('schedule', 10), ('rms', 10), ('mean', 12), ('rays', 12))
    reference, _, area, _ = series(kiln, checks, 100, 2, '--schedule', 'equal', '--samples-direct', 8 * SAMPLES)
    rms, mean, spread, rays = {}, {}, {}, {}
    bakes = {name: series(kiln, checks, 1, SEEDS, '--schedule', name, '--samples-direct', SAMPLES)
             for name in ('lean', 'equal')}
    valid = np.isfinite(np.vstack([reference, bakes['lean'][0], bakes['equal'][0]])).all(0)
    weight, reference = area[valid] / area[valid].sum(), reference[:, valid]
    converged = reference.mean(0)
    for name, (values, errors, _, run) in bakes.items():
        values, errors = values[:, valid], errors[:, valid]
        off = values - converged
        rms[name] = float(np.sqrt(((off ** 2) @ weight).mean()) / (converged @ weight))
        means = values @ weight / (converged @ weight) - 1
        mean[name], spread[name] = float(means.mean()), float(means.std(ddof=1)) / SEEDS ** 0.5
        rays[name] = sum(run['rays'].values())
        table.row(name, '%.4f %%' % (100 * rms[name]), '%+.4f %%' % (100 * mean[name]), '%d' % rays[name])
        kinds = [(b['kind'], b['samples']) for b in run['bounces']]
        checks.that(kinds == ([('pilot', 16), ('direct', SAMPLES - 16)] if name == 'lean' else [('direct', SAMPLES)]),
                    '%s: the steps are %s' % (name, kinds))
        noisy = (errors > 0) & (np.abs(off) > 1e-6)
        within = float((np.abs(off) < 2 * errors)[noisy].mean())
        checks.that(within > 0.9, '%s: %.1f %% of texels are within two standard errors' % (name, 100 * within))
    reference_means = reference @ weight / (converged @ weight)
    doubt = (spread['lean'] ** 2 + float(reference_means.var(ddof=1)) / len(reference)) ** 0.5
    checks.that(abs(mean['lean']) < 4 * doubt, 'the mean is off by %g, %g standard errors' %
                (mean['lean'], abs(mean['lean']) / doubt))
    checks.that(rms['lean'] < 0.8 * rms['equal'], 'lean has %.2f of the error of equal' % (rms['lean'] / rms['equal']))
    checks.that(rays['lean'] < 1.4 * rays['equal'],
                'lean has %.2f of the rays of equal' % (rays['lean'] / rays['equal']))
    one, other = (direct(kiln, checks, '--seed', 1, '--samples-direct', SAMPLES, *more)[0]
                  for more in (('--cell-size', 0.37), ('--partition', 'objects')))
    checks.that(all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other)), 'cells change the result')
    checks.end()


if __name__ == '__main__':
    main()
