"""Whether stated errors are true: bakes of many seeds against the standard errors that they state.

  /usr/bin/python3 tests/bench/errors.py --kiln build/release/kiln [--seeds 24] [--quality draft]
                                         [--texels-per-metre X] [--target X] [--options '...']
                                         [--denoise [--times 64]] [SCENE ...]

Without scenes: the Cornell box, three rooms, and a zoo of punctual lights. Values are luminances of kiln.h5, which
holds what was gathered, before denoising. z of a texel in one bake is its value less the mean of the bakes by other
seeds, over the root of the squared stated error and the squared standard error of that mean. A table has what share of
all texels of all bakes lies within 1, 2, 3, 3.2 (68.3, 95.4, 99.7, 99.9 % of a normal distribution), the 99th
percentile of |z|, and the root mean square of the true deviation (over seeds) over that of the stated error: above 1
the bakes promise too much. Texels that are buried with any seed are left out, and those that neither change by more
than rounding with the seed nor state such an error.

--target X bakes with `--target-error X` and prints of the true deviation over what is allowed the 5th, 50th and 95th
percentile of all texels, the shares below 0.5, within 0.5 to 1.0 and above 1.0, and the processor seconds of a bake.
The deviation is the root mean square over seeds and over 5 x 5 texels of the same object; allowed is X of a texel's
light, or of a tenth of the mean light where that is more.

--denoise looks at lightmaps instead, denoised: at their texels that were gathered and that the layout covers by half at
least. Their deviation is that from a bake of `--times` as many samples that is not denoised, so that a bias counts, and
z is it over the root of the squared stated errors of both. "bias": the part of the squared deviation that all seeds
have in common.

The rows of objects are the same for the mean of each object, weighted by area. Its stated error is mean_error of
run.json, where that is, else that of texels with independent errors. It is of three degrees of freedom, of which 95 %
lie within 3.2 (Student's t). The rows of direct and indirect light are of the errors that a texel's own rays state,
without the noise of the bounces.
"""
import os
import shlex
import sys

import h5py
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import denoise  # noqa: E402
import measure  # noqa: E402
import harness  # noqa: E402

ROUNDING = 1e-6  # of a value
POOLED = 2  # texels to each side
LIGHTS = (('total', 'error'), ('direct', 'error_direct'), ('indirect', 'error_indirect'))


class Seed:
    """What one bake says, points by object, side and texel: (value, stated error) of each light; object means."""

    def __init__(self, bake):
        p = bake.points
        order = np.lexsort((p.x, p.y, p.side, p.object))
        self.valid, self.area, self.object = p.valid[order], p.area[order], p.object[order]
        self.side, self.y, self.x = p.side[order], p.y[order], p.x[order]
        self.processor = bake.process.processor
        with h5py.File(os.path.join(bake.directory, 'kiln.h5'), 'r') as f:
            group = f['irradiance']
            self.lights = {name: ((group[name][...].astype(np.float64) @ harness.LUMINANCE)[order],
                                  group[error][...].astype(np.float64)[order])
                           for name, error in LIGHTS if error in group}
        self.mean_errors = np.array([o.get('mean_error', np.nan) for o in bake.run['objects']])


def deviations(values, stated):
    """|z| of all values, the deviations and the stated errors they are of; a row a seed."""
    seeds = len(values)
    others = (values.sum(0) - values) / (seeds - 1)
    off = values - others
    spread = values.var(0, ddof=1)
    # of the mean of the others: the sum of squares of all less what the one adds to it
    variance = np.maximum(0.0, ((seeds - 1) * spread - off ** 2 * (seeds - 1) / seeds) / (seeds - 2)) / (seeds - 1)
    scale = np.sqrt(stated ** 2 + variance)
    rounding = ROUNDING * np.abs(values).max(0)
    counts = np.broadcast_to((spread > rounding ** 2) | (stated > rounding).any(0), off.shape)
    with np.errstate(divide='ignore', invalid='ignore'):
        z = np.where(scale > 0, np.abs(off) / scale, np.where(off == 0, 0.0, np.inf))
    true = np.sqrt(spread[counts[0]].mean()) if counts.any() else 0.0
    said = np.sqrt((stated ** 2)[counts].mean()) if counts.any() else 0.0
    return z[counts], true / said if said > 0 else np.inf


def show(table, scene, what, values, stated):
    z, ratio = deviations(values, stated)
    if len(z) == 0:
        return
    table.row(scene, what, '%d' % (len(z) // len(values)),
              *('%.1f %%' % (100 * (z < k).mean()) for k in (1, 2, 3, 3.2)),
              '%.2f' % np.percentile(z, 99), '%.2f' % ratio, '')


def object_means(seeds, light, valid):
    """(means, stated errors), a row a seed, a column an object that has area."""
    area, which = seeds[0].area * valid, seeds[0].object
    count = int(which.max()) + 1
    whole = np.bincount(which, area, count)
    lit = whole > 0
    means, stated = [], []
    for s in seeds:
        value, error = s.lights[light]
        mean = np.bincount(which, area * value, count)[lit] / whole[lit]
        independent = np.sqrt(np.bincount(which, (area * error) ** 2, count)[lit]) / whole[lit]
        known = np.full(count, np.nan)
        if light == 'total':
            known[:len(s.mean_errors)] = s.mean_errors[:count]
        means.append(mean)
        stated.append(np.where(np.isfinite(known[lit]), known[lit] * mean, independent))
    return np.array(means), np.array(stated)


def pooled(values, seed, valid):
    """Means of `values` (of the valid points of `seed`) over the points of the same object and side that are at most
    POOLED texels away."""
    side, y, x = (a[valid].astype(np.int64) for a in (seed.object * 2 + seed.side, seed.y, seed.x))
    key = lambda j, i: (side * (1 << 20) + j + POOLED) * (1 << 20) + i + POOLED
    own = key(y, x)
    order = np.argsort(own, kind='stable')
    ranked = own[order]
    total, count = np.zeros(len(values)), np.zeros(len(values))
    for dy in range(-POOLED, POOLED + 1):
        for dx in range(-POOLED, POOLED + 1):
            wanted = key(y + dy, x + dx)
            place = np.minimum(np.searchsorted(ranked, wanted), len(ranked) - 1)
            there = ranked[place] == wanted
            total[there] += values[order[place[there]]]
            count += there
    return total / count


def against_target(table, name, seeds, valid, target):
    """The row of a scene that was baked with a target."""
    values = np.array([s.lights['total'][0][valid] for s in seeds])
    light, area = values.mean(0), seeds[0].area[valid]
    allowed = target * np.maximum(light, 0.1 * (light * area).sum() / area.sum())
    ratio = np.sqrt(pooled(values.var(0, ddof=1) / allowed ** 2, seeds[0], valid))
    table.row(name, '%d' % valid.sum(), *('%.2f' % np.percentile(ratio, p) for p in (5, 50, 95)),
              *('%.1f %%' % (100 * share.mean()) for share in (ratio < 0.5, (ratio >= 0.5) & (ratio <= 1), ratio > 1)),
              '%.1f' % np.mean([s.processor for s in seeds]))


def study(table, kiln, name, path, density, arguments):
    seeds = []
    target = ('--target-error', arguments.target) if arguments.target else ()
    for seed in range(1, arguments.seeds + 1):
        bake = measure.must(kiln.bake(path, '--quality', arguments.quality, '--samples-direct',
                                      denoise.SAMPLES[arguments.quality][0], '--texels-per-metre', density,
                                      '--error-map', '--denoise', 'none', '--samples-probe', 0, '--no-export',
                                      '--seed', seed, *target, *shlex.split(arguments.options), timeout=3600))
        seeds.append(Seed(bake))
        bake.remove()
    valid = np.all([s.valid for s in seeds], 0) & (seeds[0].area > 0)
    if arguments.target:
        against_target(table, name, seeds, valid, arguments.target)
        return
    for light in seeds[0].lights:
        values, stated = (np.array([s.lights[light][i][valid] for s in seeds]) for i in (0, 1))
        show(table, name, light, values, stated)
    for light in seeds[0].lights:
        show(table, name, light + ' of objects', *object_means(seeds, light, valid))


def against_reference(table, scene, maps, reference):
    """The row of denoised lightmaps: layers by seed, and those of the reference."""
    values, stated = (np.array([value(m) for m in maps]) for value in (lambda m: m['direct'] + m['indirect'],
                                                                       lambda m: m['error'].astype(np.float64)))
    truth, known = reference['direct'] + reference['indirect'], reference['error'].astype(np.float64)
    off, scale = values - truth, np.sqrt(stated ** 2 + known ** 2)
    counts = np.all([m['counts'] for m in maps], 0) & reference['counts']
    counts &= (scale > ROUNDING * truth).all(0) | (np.abs(off) > ROUNDING * truth).any(0)
    with np.errstate(divide='ignore', invalid='ignore'):
        z = np.where(scale > 0, np.abs(off) / scale, np.where(off == 0, 0.0, np.inf))[:, counts]
    true = np.mean((off ** 2 - known ** 2)[:, counts])
    bias = np.mean((off.mean(0) ** 2 - off.var(0, ddof=1) / len(off) - known ** 2)[counts])
    table.row(scene, 'denoised', '%d' % counts.sum(), *('%.1f %%' % (100 * (z < k).mean()) for k in (1, 2, 3, 3.2)),
              '%.2f' % np.percentile(z, 99), '%.2f' % np.sqrt(max(true, 0) / np.mean(stated[:, counts] ** 2)),
              '%.0f %%' % (100 * max(bias, 0) / true))


def study_denoised(table, kiln, name, path, density, arguments):
    options = ('--quality', arguments.quality, '--samples-direct', denoise.SAMPLES[arguments.quality][0],
               '--texels-per-metre', density, '--error-map', '--samples-probe', 0, '--no-export',
               *shlex.split(arguments.options))
    names = ('--samples-direct', '--samples-bounce', '--samples-indirect')
    more = [text for name_, count in zip(names, denoise.SAMPLES[arguments.quality])
            for text in (name_, min(count * arguments.times, 65536))]
    maps = []
    for how in [('--seed', 1001, '--denoise', 'none', *more)] + [
            ('--seed', seed, '--denoise', 'regression') for seed in range(1, arguments.seeds + 1)]:
        bake = measure.must(kiln.bake(path, *options, *how, timeout=3600))
        maps.append(denoise.layers(bake))
        bake.remove()
    against_reference(table, name, maps[1:], maps[0])


def own_scenes(kiln):
    """(name, path, texels per metre)"""
    return [('cornell', os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb'), 8),
            ('rooms', measure.made(kiln, 'rooms', '--columns', 3, '--rows', 1), 4),
            ('zoo', os.path.join(harness.DATA, 'punctual_zoo.glb'), 3)]


def main():
    def more(parser):
        parser.add_argument('--seeds', type=int, default=24)
        parser.add_argument('--quality', default='draft')
        parser.add_argument('--texels-per-metre', type=float, default=0,
                            help='0: 4, and each scene of the own set has its own')
        parser.add_argument('--target', type=float, default=0)
        parser.add_argument('--denoise', action='store_true')
        parser.add_argument('--times', type=int, default=64)
        parser.add_argument('--options', default='', help='more options for kiln bake, in one string')
        parser.add_argument('scenes', nargs='*')

    arguments, kiln = harness.start(__doc__, more)
    if arguments.seeds < 3:
        sys.exit('--seeds must be 3 at least: the spread of the others is asked for')
    scenes = [(os.path.splitext(os.path.basename(s))[0], s, 4) for s in arguments.scenes] or own_scenes(kiln)
    if arguments.target:
        table = harness.Table(('scene', 14), ('texels', 8), ('5th', 6), ('median', 7), ('95th', 6), ('below 0.5', 10),
                              ('0.5 to 1.0', 10), ('above', 8), ('processor s', 12))
    else:
        table = harness.Table(('scene', 14), ('light', 20), ('count', 8), ('in 1', 8), ('in 2', 8), ('in 3', 8),
                              ('in 3.2', 8), ('p99 of z', 9), ('true/said', 10), ('bias', 6))
    for name, path, density in scenes:
        how = study_denoised if arguments.denoise else study
        how(table, kiln, name, path, arguments.texels_per_metre or density, arguments)


if __name__ == '__main__':
    main()
