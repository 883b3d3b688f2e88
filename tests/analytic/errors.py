"""Whether stated errors are true, and --target-error is kept: the Cornell box, small, with several seeds.

  /usr/bin/python3 tests/analytic/errors.py --kiln build/release/kiln [--backend vulkan]

A bake with --error-map is the mean of four parts. Between 93 and 98 % of the texels must lie within two standard
errors of the mean over all seeds, and the objects' means within 3.2 of theirs (Student's t with 3 degrees of freedom)
in 93 %. One sample must state an error, too. Cells change no bit. With --target-error 0.1 the deviation over seeds,
pooled, must be below it nearly everywhere; three ranks give the same bits. With --max-time the bake ends with what it
has.
"""
import hashlib
import os
import sys

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402

SEEDS = 8
OPTIONS = ('--lightmap-size', 12, '--samples-probe', 0, '--no-export', '--denoise', 'none', '--bounces', 3)
FEW = ('--samples-direct', 16, '--samples-bounce', 8, '--samples-indirect', 32)
TARGET = ('--samples-direct', 8, '--samples-bounce', 4, '--samples-indirect', 32, '--target-error', 0.1)
STOPPED = 75
DARK = 0.1  # of the mean: texels that are darker need no smaller errors than such


def points(bake):
    """Values, stated errors, what the parts found, areas, objects: in the order of objects and texels."""
    p = bake.points
    order = np.lexsort((p.x, p.y, p.side, p.object))
    with h5py.File(os.path.join(bake.directory, 'kiln.h5'), 'r') as f:
        light = f['irradiance']
        return (light['total'][...].astype(float)[order] @ harness.LUMINANCE, light['error'][...].astype(float)[order],
                light['parts'][...].astype(float)[order], p.area[order], p.object[order])


def bake_all(kiln, scene, seeds, *options):
    bakes = [points(kiln.bake(scene, *OPTIONS, *options, '--seed', seed + 1)) for seed in range(seeds)]
    return [np.array(of) for of in zip(*bakes)]


def objects_t(values, parts, area, objects):
    """Deviation of each object's mean in each bake over the error that its parts state."""
    found = []
    for number in np.unique(objects[0]):
        weight = np.where(objects == number, area, 0.0)
        mean = (values * weight).sum(1) / weight.sum(1)
        each = (parts * weight[:, :, None]).sum(1) / weight.sum(1)[:, None]
        error = each.std(1, ddof=1) / np.sqrt(each.shape[1])
        found.append((mean - mean.mean()) * np.sqrt(SEEDS / (SEEDS - 1)) / error)
    return np.abs(np.array(found))


def try_vulkan(checks, kiln, scene):
    """The same samples, but for rounding."""
    bakes = []
    for kiln.backend in ('vulkan', 'embree'):
        bakes.append(kiln.bake(scene, *OPTIONS, '--error-map', *FEW))
    if all([checks.baked(bake) for bake in bakes]):
        (a, error, *_), (b, *_) = map(points, bakes)
        share = 100 * (np.abs(a - b) <= 0.1 * error + 1e-6 * b.mean()).mean()
        print('%.2f %% of texels within a tenth of a stated error of Embree' % share)
        checks.that(share > 97, 'only %.2f %% of texels are as with Embree' % share)


def try_errors(checks, kiln, scene):
    values, errors, parts, area, objects = bake_all(kiln, scene, SEEDS, '--error-map', *FEW)
    lit = (values > 0).all(0)
    z = np.abs(values - values.mean(0))[:, lit] * np.sqrt(SEEDS / (SEEDS - 1)) / errors[:, lit]
    t = objects_t(values, parts, area, objects)
    within, means = 100 * (z < 2).mean(), 100 * (t < 3.2).mean()
    print('%.1f %% of texels within 2 stated errors, %.1f %% of the means of objects within 3.2' % (within, means))
    checks.that(93 <= within <= 98, '%.1f %% of texels within 2 stated errors' % within)
    checks.that(means >= 93, '%.1f %% of the means of objects within 3.2 stated errors' % means)
    checks.that(np.allclose(parts.mean(2), values, rtol=1e-4, atol=1e-6), 'the parts are not what the total is of')


def try_one_sample(checks, kiln, scene):
    bake = kiln.bake(scene, *OPTIONS, '--error-map', '--samples-direct', 1, '--samples-bounce', 1, '--samples-indirect',
                     1)
    stated = bake.run['error']['mean_relative']
    checks.that(stated > 0.1, 'one sample: %.2g %% is stated' % (100 * stated))
    checks.that(all(entry['mean_error'] > 0 for entry in bake.run['objects']), 'one sample: a mean without an error')


def digest(bake):
    joined = hashlib.sha256()
    for entry in bake.run['objects']:
        with open(os.path.join(bake.directory, entry['lightmap']), 'rb') as file:
            joined.update(file.read())
    return joined.hexdigest()


def try_cells(checks, kiln, scene):
    """Cells cut tiles, of whose points errors are pooled, and change nothing; nor do three ranks."""
    bakes = [kiln.bake(scene, *OPTIONS, '--lightmap-size', 20, '--error-map', *FEW, '--cell-size', size, ranks=ranks)
             for size, ranks in ((9, 0), (0.4, 0), (0.7, 3))]
    if all([checks.baked(bake) for bake in bakes]):
        checks.that(len({digest(bake) for bake in bakes}) == 1, '--error-map: other cells give other bits',
                    bakes[1].process)


def try_target(checks, kiln, scene):
    values, errors, *_ = bake_all(kiln, scene, SEEDS // 2, *TARGET)
    lit = (values > 0).all(0)
    mean = values.mean(0)
    wanted = 0.1 * np.maximum(mean, DARK * mean[lit].mean())
    deviation = values.std(0, ddof=1)
    kept = 100 * (deviation[lit] < 1.6 * wanted[lit]).mean()  # of four values: 1.6 is the 95th percentile
    rms = np.sqrt(((deviation / wanted)[lit] ** 2).mean())
    print('--target-error: %.1f %% of texels keep it; root mean square %.2f of it' % (kept, rms))
    checks.that(kept >= 95 and 0.5 < rms < 1.0, '--target-error: %.1f %% kept, rms %.2f of it' % (kept, rms))
    one = kiln.bake(scene, *OPTIONS, *TARGET, '--error-map')
    checks.that(one.run['error']['above_target'] <= 0.05 and one.run['error']['rounds'] > 1, str(one.run['error']))
    three = kiln.bake(scene, *OPTIONS, *TARGET, '--error-map', ranks=3)
    checks.that(digest(one) == digest(three), '--target-error: three ranks give other bits')
    short = kiln.bake(scene, *OPTIONS, *TARGET, '--target-error', 1e-4, '--max-time', 4)
    if short.process.status != STOPPED:  # a round took much longer than the one before
        checks.that(short.run['error']['above_target'] > 0.05, '--max-time with a target: %s' % short.run['error'])


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    scene = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
    if kiln.backend == 'vulkan':
        try_vulkan(checks, kiln, scene)
    else:
        try_errors(checks, kiln, scene)
        try_one_sample(checks, kiln, scene)
        try_cells(checks, kiln, scene)
        try_target(checks, kiln, scene)
    return checks.end()


if __name__ == '__main__':
    sys.exit(main())
