"""The Vulkan backend against Embree: the same random numbers, so the same answers but for rounding and for which of two
surfaces in one place a ray meets. Scenes made of such surfaces (nasty_valid.glb has a floor twice) are left out:
rounding decides what is seen there. What is buried is the same for every point that both have in one place.

A scene is baked by both. For 99.99 % of the surface points the luminance of the irradiance may differ by 5 standard
errors of the point at most, and the area-weighted mean by 0.001. The standard error is the larger of kiln's own and of
what one ray of the mean brightness brings: where all samples agree kiln's is 0, but one ray that meets the other of two
touching surfaces shows. Where more points differ, as many (or twice as many as) must do so when Embree changes its
instruction set, which rounds otherwise too. Sample counts 64 and 4096; the second at a coarser lightmap, so that
software devices come to an end.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402

# Points that a bake is to have, by samples a point; --full has as many as the scene itself asks for.
POINTS = {64: 6000, 4096: 250}
# Texels of several metres hold a room's whole furniture: surfaces in one place, of which rounding picks one, are then
# in every texel.
POINTS_LEAST = {'crytek_sponza.glb': 6000}
# Light paths: as many as a bake sends by itself take a software device minutes.
PATHS = ['--photons', 4000, '--iterations', 2]
# Rays that are refracted many times take long on a software device.
POINTS_MOST = {'cornell_water.glb': 600}
# So many points may lie in one bake alone, or elsewhere in their texels: four lamps of many_lights.glb touch pillars
APART = 16
# at 4096 samples on a software device; left out there but for --full
SLOW = ('many_lights.glb', 'cornell_spheres.glb', 'crytek_sponza.glb')
OWN = ('cornell_original.glb', 'two_rooms.glb', 'punctual_zoo.glb', 'many_lights.glb', 'cornell_water.glb',
       'cornell_layers.glb', 'cornell_shapes_narrow.glb',
       'cornell_huge_1e6.glb', 'cornell_tiny_1e-6.glb', 'cornell_offset_1e5.glb', 'cornell_spheres.glb')


def scenes(wanted, own_only):
    found = [('cornell', os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb'))]
    found += [(name, harness.own_scene(name)) for name in OWN]
    if not own_only:
        found.append(('crytek_sponza.glb', os.path.join(harness.SHARED, 'third_party', 'crytek_sponza.glb')))
    return [(n, p) for n, p in found if p and os.path.exists(p) and (not wanted or n in wanted)]


def density(kiln, path, points):
    """Texels per metre for about so many points: the scene's own density, scaled."""
    p = kiln.command('info', path, '--json', '--quiet')
    if p.status != 0:
        return None
    info = p.json()
    return info['texels_per_metre']['median'] * (points / max(1, info['surface']['points'])) ** 0.5


def beyond(a, b, samples):
    """How many of the points that are valid in both differ by more than 5 standard errors, of how many, and the worst,
    in those."""
    # slivers lie within rounding of an edge: rounding decides what they see
    valid = a.valid & b.valid & (a.area > 1e-3 * np.median(a.area))
    x, y = (p.total[valid] @ harness.LUMINANCE for p in (a, b))
    one_ray = float((x * a.area[valid]).sum() / a.area[valid].sum()) / samples
    error = np.maximum(np.maximum(a.error, b.error)[valid], one_ray)
    off = np.abs(x - y) / np.maximum(5 * error, 1e-30)
    return int((off > 1).sum()), len(x), float(off.max(initial=0))


class Some:
    """Some of a bake's points, in order."""

    def __init__(self, points, chosen):
        self.valid, self.area = points.valid[chosen], points.area[chosen]
        self.total, self.error = points.total[chosen], points.error[chosen]


def common(a, b):
    """The points that both bakes have, in one place. Where a wall only touches a texel, rounding decides whether it
    divides it."""
    keys = [list(zip(p.object, p.side, p.x, p.y, p.part)) for p in (a, b)]
    place = {key: i for i, key in enumerate(keys[1])}
    pairs = np.array([(i, place[key]) for i, key in enumerate(keys[0]) if key in place])
    apart = np.linalg.norm(a.position[pairs[:, 0]] - b.position[pairs[:, 1]], axis=1)
    pairs = pairs[apart <= 0.01 * np.sqrt(np.median(a.area))]
    return Some(a, pairs[:, 0]), Some(b, pairs[:, 1])


def compare(checks, name, samples, embree, vulkan, again, table):
    a, b = common(embree.points, vulkan.points)
    apart = max(embree.points.count, vulkan.points.count) - len(a.valid)
    other = int((a.valid != b.valid).sum())
    checks.that(apart <= APART, '%s: %d of %d points are in one bake alone' %
                (name, apart, len(a.valid)), vulkan.process)
    checks.that(other == 0, '%s: of %d points %d are buried in one bake alone' % (name, len(a.valid), other),
                vulkan.process)
    count, points, worst = beyond(a, b, samples)
    allowed, own = max(1e-4 * points, 1), '-'
    if count > allowed:
        other = again()
        own = beyond(*common(embree.points, other.points), samples)[0]
        allowed = max(allowed, 2 * own)
        other.remove()
    valid = a.valid & b.valid
    means = [float((p.total @ harness.LUMINANCE * p.area)[valid].sum()) for p in (a, b)]
    ratio = means[1] / means[0] if means[0] > 0 else 1.0
    text = harness.energy(vulkan.run)[0]
    table.row(name, samples, points, apart, other, count, own, '%.2f' % worst, '%.6f' % ratio,
              '%.1f' % vulkan.process.seconds, '%.1f' % embree.process.seconds, text)
    checks.that(count <= allowed, '%s, %d samples: %d of %d points differ by more than 5 standard errors' %
                (name, samples, count, points), vulkan.process)
    checks.that(abs(ratio - 1) <= 1e-3, '%s, %d samples: mean ratio %.6f' % (name, samples, ratio), vulkan.process)
    checks.that(harness.energy(vulkan.run)[1] or not harness.energy(embree.run)[1],
                '%s: energy is not kept: %s' % (name, text), vulkan.process)


def main():
    add = lambda p: (p.add_argument('scenes', nargs='*', help='only these'),
                     p.add_argument('--full', action='store_true', help="the scenes' own density"),
                     p.add_argument('--own', action='store_true', help='no scene of others, which are large'),
                     p.add_argument('--points', type=int, help='so many points instead'),
                     p.add_argument('--samples', type=int, nargs='*', default=[64, 4096]))
    arguments, kiln = harness.start(__doc__, add)
    checks = harness.Checks()
    table = harness.Table(('scene', 26), ('samples', 7), ('points', 8), ('apart', 5), ('buried', 6), ('beyond', 6),
                          ('Embree', 6), ('worst/5s', 8), ('mean ratio', 10), ('vulkan s', 8), ('embree s', 8),
                          ('energy of vulkan', 36))
    for samples in arguments.samples:
        for name, path in scenes(arguments.scenes, arguments.own):
            if samples > 1000 and name in SLOW and not (arguments.full or arguments.points or arguments.scenes):
                continue
            options = ['--samples-direct', samples, '--samples-bounce', max(4, samples // 16), '--samples-indirect',
                       samples, '--samples-probe', 0, *([] if arguments.full else PATHS)]
            points = min(arguments.points, POINTS_MOST.get(name, arguments.points)) if arguments.points else \
                max(POINTS.get(samples, 1000), POINTS_LEAST.get(name, 0))
            wanted = None if arguments.full else density(kiln, path, points)
            if wanted:
                options += ['--texels-per-metre', '%.9g' % wanted]
            bakes = {}
            for backend in ('vulkan', 'embree'):
                kiln.backend = backend
                bakes[backend] = kiln.bake(path, *options, timeout=1200)
            if all([checks.baked(b) for b in bakes.values()]):
                again = lambda: kiln.bake(path, *options, '--instruction-set', 'sse2', timeout=1200)
                compare(checks, name, samples, bakes['embree'], bakes['vulkan'], again, table)
            for b in bakes.values():
                b.remove()
    checks.end()


if __name__ == '__main__':
    main()
