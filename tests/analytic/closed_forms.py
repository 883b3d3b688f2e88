"""Bakes every scene that has a closed-form answer and compares.

Two criteria hold at each point, and both must be met: the relative error is within the case's tolerance (tol_rel of
expected.json), and the difference is within 4 standard errors plus what texels and rounding explain. A closed form
speaks of a point, a texel is a mean over its area: the value at a point is that of the quadratic whose means over 3 x 3
texels fit best, and the grid's part is by how much 5 x 5 texels say otherwise. The standard error is the bake's own,
pooled over the surrounding texels because each is estimated from few sub-nets; with bounces, all points gather from the
same radiosity, whose error the energy ledger knows. That the criteria can fail is tested at every point: an answer
moved by 1 % (2.5 tolerances where that is more) must be refused.

With --thin, for devices too slow for all samples, the tolerance is widened by 4 standard errors: what the fewer samples
may be off by. The bound in standard errors, the refusal of answers that are off, and all that is not noise stay as they
are.
"""
import json
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

STANDARD_ERRORS = 4.0
ROUNDING = 2e-6  # float32 positions and sums: of the strongest irradiance of a case
RADIOSITY_ROUNDING = 2.0 ** -13  # of a hit's radiosity as it is kept between bounces

UNIFORM_SHARE = 0.99

# Lightmap side and samples of each case: enough for its tolerance, and quick.
DEFAULT = {'size': 24, 'direct': 4096, 'indirect': 64, 'bounce': 4, 'bounces': 0}
ALL = {'bounces': None, 'indirect': 4096, 'bounce': 64}  # all bounces
SETTINGS = {
    'par_near_1e-3': {'direct': 16384},
    'par_near_1e-5': {'direct': 16384},
    'perp_rect': {'size': 56},
    'disk_over_plane': {'size': 40, 'direct': 8192},
    'triangle_light': {'size': 56},
    'penumbra_occluder': {'direct': 65536},
    'penumbra_alphamask': {'direct': 32768},
    'textured_emitter': {'direct': 16384},
    'spot_cone': {'size': 300, 'direct': 16},
    'point_over_plane': {'size': 100, 'direct': 64},
    'point_range': {'size': 200, 'direct': 16},
    'point_inverse_square': {'size': 9, 'direct': 64},
    'directional_cosine': {'size': 9, 'direct': 64},
    'sky_long_wall': {'size': 56},
    'strip_light': {'size': 48},
    'sky_roof_opening': {'size': 16, 'direct': 524288},
    'furnace_cube_rho0': {'direct': 16384},
    'furnace_cube_rho0.5': {'direct': 16384, **ALL},
    'furnace_cube_rho0.9': {'direct': 16384, **ALL},
    'furnace_cube_rho0.99': {'direct': 16384, **ALL},
    'furnace_rgb_objects': {'direct': 32768, **ALL, 'indirect': 16384, 'bounce': 1024},
    # a texel in an edge sees few texels of the other wall, whose own noise must be small then
    'furnace_two_albedos': {'size': 24, 'direct': 32768, **ALL, 'bounce': 2048},
    'concentric_spheres': {'size': 64, 'direct': 2048, **ALL, 'indirect': 1024},
    'hollow_sphere_patch': {'size': 48, 'direct': 512, **ALL},
    # light is at one plane at a time, so a tail in proportion to the last bounce would be split wrongly: none is left
    'infinite_planes': {'size': 25, 'direct': 16384, **ALL, 'bounces': 24},
    'one_bounce_patch': {'size': 30, 'direct': 16, 'bounces': 1, 'indirect': 131072, 'bounce': 16},
    'leak_box': {'size': 32, 'direct': 64, **ALL},
    'cube_point_mean_rho0': {'size': 96, 'direct': 64},
    'cube_point_mean_rho0.5': {'size': 64, 'direct': 64, **ALL, 'indirect': 256},
    'cube_point_mean_rho0.9': {'size': 64, 'direct': 64, **ALL, 'indirect': 256},
}


# Objects that stand on another: their undersides touch it, see nothing, and are not part of the closed form.
STANDING = {('furnace_rgb_objects', 'block')}
# What they stand on, and where (low and high corner): texels under them and beside their edges are buried in part,
# their lightmap value is filled from neighbours or a mean over what is left.
UNDER = {('furnace_rgb_objects', 'room'): ((0.5, 0.0, 0.5), (1.5, 0.0, 1.5))}
# Spheres (centre, radius) whose layout is too tight for the lightmap's side: some texels belong to two charts.
SPHERES = {'concentric_spheres': {'inner': ((0, 0, 0), 0.5), 'outer': ((0, 0, 0), 1.5)},
           'furnace_rgb_objects': {'ball': ((2.5, 1.2, 3.0), 0.8)}}


# Of a ball with shading normals a part of each hemisphere lies below the facet and stays dark: the closed form is about
# facets.
FLAT = {'furnace_rgb_objects'}


# Many samples, and only one object is compared: of the others, which cast shadows, a few texels are enough (but where
# they have holes: texels are to be smaller than those, or the energy ledger is off). With a smaller share of its square
# than this a layout would be made anew.
FEW = 0.1
LONE = {'sky_roof_opening': 'receiver', 'penumbra_occluder': 'receiver', 'disk_over_plane': 'receiver'}


class Judgement:
    """What became of a case: worst relative error and worst difference in standard errors, and what failed."""

    def __init__(self, thin):
        self.points, self.relative, self.errors, self.failures, self.rows = 0, 0.0, 0.0, [], []
        self.thin = thin  # samples are fewer than the tolerances were made for

    def tolerance(self, tolerance, want, error):
        want, error = np.broadcast_arrays(want, error)
        return tolerance + (STANDARD_ERRORS * float((error[want > 0] / want[want > 0]).max(initial=0.0)) if self.thin
                            else 0.0)

    def point(self, where, got, want, error, explained, tolerance):
        """`got`, `want`: RGB. `error`: standard error of each channel; `explained`: what the grid and rounding may be
        off by."""
        self.points += 1
        got, want = np.asarray(got, float), np.asarray(want, float)
        tolerance = self.tolerance(tolerance, want, error)
        relative, errors, good = judge(got, want, error, explained, tolerance)
        self.relative, self.errors = max(self.relative, relative), max(self.errors, errors)
        if not good:
            self.failures.append('%s: got %s, closed form %s: off by %.2e (tolerance %.1e) or %.1f standard errors' % (
                where, got, want, relative, tolerance, errors))
        elif want.max() > 0:
            for moved in (1 + max(0.01, 2.5 * tolerance), 1 - max(0.01, 2.5 * tolerance)):
                if judge(got, want * moved, error, explained, tolerance)[2]:
                    self.failures.append('%s: an answer %+.1f %% off would pass too' % (where, 100 * (moved - 1)))


def judge(got, want, error, explained, tolerance):
    """(worst relative error, worst difference in standard errors beyond what is explained, both criteria met). Where
    the answer is 0 only rounding is allowed."""
    difference = np.abs(got - want)
    lit = want > 0
    relative = float((difference[lit] / want[lit]).max()) if lit.any() else 0.0
    beyond = np.maximum(difference - explained, 0)
    spread = np.broadcast_to(np.asarray(error, float), difference.shape)
    errors = float(np.where(beyond > 0, beyond / np.maximum(spread, 1e-300), 0).max())
    return relative, min(errors, 9999.0), relative <= tolerance and errors <= STANDARD_ERRORS


def setting(case, name):
    return dict(DEFAULT, **SETTINGS.get(case['id'], {}))[name]


def options(case, kiln):
    s = dict(DEFAULT, **SETTINGS.get(case['id'], {}))
    result = ['--lightmap-size', s['size'], '--samples-direct', kiln.samples(s['direct']), '--samples-bounce',
              kiln.samples(s['bounce']),
              '--samples-indirect', kiln.samples(s['indirect']), '--samples-probe', 0]
    if s['bounces'] is not None:
        result += ['--bounces', s['bounces']]
    if 'environment' in case:
        result += ['--environment', ','.join('%g' % c for c in case['environment']['radiance'])]
    return result


def channel_errors(luminance_error, irradiance):
    """The bake knows the standard error of the luminance; each channel has its share of it."""
    luminance = float(np.dot(irradiance, harness.LUMINANCE))
    return luminance_error * np.asarray(irradiance) / luminance if luminance > 0 else np.full(3, luminance_error)


def common_error(case, bake):
    """Relative standard error that all points share: the radiosity they gather from, by the energy ledger."""
    energy = bake.run['energy']
    power = float(harness.LUMINANCE @ np.array(energy['emitted']))
    return energy['error'] / power if setting(case, 'bounces') != 0 and power > 0 else 0.0


def rounding(case, bake, want, scale):
    """What rounding may be off by. `scale`: the strongest irradiance nearby. Radiosity is rounded once a bounce, and
    what one bounce is off by goes through all later ones: as often as light arrives on the whole for each time that it
    comes directly."""
    if setting(case, 'bounces') == 0:
        return ROUNDING * scale
    power = lambda irradiance: float(bake.points.area @ irradiance @ harness.LUMINANCE)
    return ROUNDING * scale + RADIOSITY_ROUNDING * power(bake.points.total) / power(bake.points.direct) * np.asarray(
        want)


def pooled_error(bake, name, u, v):
    """Root mean square of the standard errors of the 5 x 5 texels round (u, v)."""
    points, lightmap = bake.points, bake.lightmap(name)
    own = points.of(bake.index(name))
    near = (np.abs(points.x[own] + 0.5 - u * lightmap.width) <= 2.6) & (
        np.abs(points.y[own] + 0.5 - v * lightmap.height) <= 2.6)
    if not near.any():
        raise ValueError('no valid surface point near')
    return math.sqrt(float(np.mean(points.error[own[near]] ** 2)))


def reconstruct(lightmap, u, v, reach):
    """Irradiance at (u, v): of the quadratic whose means over (2 reach + 1)^2 texels fit best. (RGB, weights' root sum
    of squares.)"""
    x, y = u * lightmap.width - 0.5, v * lightmap.height - 0.5
    side = 2 * reach + 1
    x0 = min(max(int(round(x)) - reach, 0), lightmap.width - side)
    y0 = min(max(int(round(y)) - reach, 0), lightmap.height - side)
    dy, dx = np.mgrid[0:side, 0:side].astype(float)
    dx, dy = (dx + x0 - x).ravel(), (dy + y0 - y).ravel()
    weights = np.linalg.pinv(np.stack([np.ones_like(dx), dx, dy, dx * dx + 1 / 12, dx * dy, dy * dy + 1 / 12], 1))[0]
    texels = lightmap.irradiance[y0:y0 + side, x0:x0 + side].reshape(-1, 3)
    return weights @ texels, math.sqrt(float(weights @ weights))


def at_layout(bake, name, u, v):
    """(RGB, standard error of each channel, what the grid explains) at layout coordinate (u, v)."""
    lightmap = bake.lightmap(name)
    got, weight = reconstruct(lightmap, u, v, 1)
    grid = np.abs(got - reconstruct(lightmap, u, v, 2)[0])
    return got, weight * channel_errors(pooled_error(bake, name, u, v), got), grid


def lambert(point, normal, polygon, radiance):
    """Irradiance from a polygon that lies wholly above the horizon (Lambert 1760), counter-clockwise seen from the
    point."""
    arms = [np.asarray(c, float) - point for c in polygon]
    arms = [a / np.linalg.norm(a) for a in arms]
    total = 0.0
    for a, b in zip(arms, arms[1:] + arms[:1]):
        edge = np.cross(a, b)
        length = np.linalg.norm(edge)
        if length > 0:
            total += math.atan2(length, float(np.dot(a, b))) * float(np.dot(normal, edge)) / length
    return radiance * abs(total) / 2


def fitted(points, own, position, normal):
    """Irradiance at a place that lies on no known layout coordinate: a quadratic in the tangent plane through the
    nearest surface points that face the same way. (RGB, standard error of the luminance, by how much twice as many
    points say otherwise.)"""
    own = own[points.normal[own] @ normal > 0.95]
    if len(own) < 12:
        raise ValueError('only %d surface points face the right way' % len(own))
    distance = np.linalg.norm(points.position[own] - position, axis=1)
    own = own[np.argsort(distance, kind='stable')]

    def fit(own):
        offset = points.position[own] - position
        tangent = np.cross(normal, [1.0, 0, 0] if abs(normal[0]) < 0.6 else [0, 1.0, 0])
        tangent /= np.linalg.norm(tangent)
        scale = np.linalg.norm(offset, axis=1).max()
        s, t = offset @ tangent / scale, offset @ np.cross(normal, tangent) / scale
        texel = points.area[own] / scale ** 2 / 12  # a mean over a square texel
        weights = np.linalg.pinv(np.stack([np.ones_like(s), s, t, s * s + texel, s * t, t * t + texel], 1))[0]
        return weights @ points.total[own], math.sqrt(float(np.sum((weights * points.error[own]) ** 2)))

    got, error = fit(own[:24])
    return got, error, np.abs(got - fit(own[:48])[0])


def compare_samples(case, bake, judgement, scale):
    shared = common_error(case, bake)
    for sample in case['samples']:
        if sample['node'] is None or case['id'] == 'grazing':
            continue  # by their own: see PATCHES, compare_grazing
        where = '%s %s' % (sample['node'], sample.get('uv1', sample['p']))
        try:
            if 'uv1' in sample:
                got, error, grid = at_layout(bake, sample['node'], *sample['uv1'])
            else:
                got, error, grid = fitted(bake.points, bake.points.of(bake.index(sample['node'])),
                                          np.array(sample['p']), np.array(sample['n']))
                error = channel_errors(error, got)
        except ValueError as problem:
            judgement.failures.append('%s: %s' % (where, problem))
            continue
        own_scale = max(sample['E']) if case['id'] == 'point_inverse_square' else scale
        judgement.point(where, got, sample['E'], np.hypot(error, shared * got),
                        grid + rounding(case, bake, sample['E'], own_scale), case['tol_rel'])


def compare_means(case, bake, judgement):
    for name, want in case.get('mean_E', {}).items():
        own = bake.points.of(bake.index(name))
        area = bake.points.area[own]
        got = area @ bake.points.total[own] / area.sum()
        # as if all erred together: an upper bound
        error = channel_errors(float(area @ bake.points.error[own] / area.sum()), got)
        judgement.point('mean over ' + name, got, np.full(3, want), np.hypot(error, common_error(case, bake) * got),
                        rounding(case, bake, np.full(3, want), want), case['tol_rel'])


def compare_uniform(case, bake, judgement):
    """Irradiance that is the same everywhere: 99 % of all points meet both criteria (the standard error is pooled over
    the object, whose noise is larger in contacts than elsewhere), and the mean over the points is within a third of the
    tolerance."""
    wanted = {}
    if 'uniform_E' in case:
        wanted = {name: np.broadcast_to(np.asarray(case['uniform_E'], float), 3) for name in bake.names()}
    for key, value in case.get('uniform', {}).items():
        wanted[key[:-len('_E')]] = np.full(3, value)
    for name, want in wanted.items():
        own = bake.points.of(bake.index(name))
        if (case['id'], name) in STANDING:
            own = own[bake.points.normal[own, 1] > -0.9]
        if name in SPHERES.get(case['id'], {}):  # a texel that charts share has its middle far below the surface
            centre, radius = SPHERES[case['id']][name]
            own = own[np.linalg.norm(bake.points.position[own] - np.array(centre), axis=1) > 0.97 * radius]
        if (case['id'], name) in UNDER:
            low, high = (np.array(corner) for corner in UNDER[case['id'], name])
            texel = math.sqrt(float(bake.points.area[own].max()))
            own = own[((bake.points.position[own] < low - 1e-3 - 0.5 * texel * (high > low)) |
                       (bake.points.position[own] > high + 1e-3 + 0.5 * texel * (high > low))).any(1)]
        got = bake.points.total[own]
        error = math.sqrt(float(np.mean(bake.points.error[own] ** 2))) / float(want @ harness.LUMINANCE)
        error = math.hypot(error, common_error(case, bake)) * want
        relative = (np.abs(got - want) / want).max(1)
        errors = (np.maximum(np.abs(got - want) - rounding(case, bake, want, want.max()), 0) / error).max(1)
        tolerance = judgement.tolerance(case['tol_rel'], want, error)
        good = (relative <= tolerance) & (errors <= STANDARD_ERRORS)
        judgement.points += len(own)
        judgement.relative = max(judgement.relative, float(np.quantile(relative, UNIFORM_SHARE)))
        judgement.errors = max(judgement.errors, float(np.quantile(errors, UNIFORM_SHARE)))
        if len(own) == 0 or good.mean() < UNIFORM_SHARE:
            judgement.failures.append(
                '%s: %.2f %% of %d points are within %.1e and 4 standard errors, mean ratio %s' % (
                name, 100 * good.mean() if len(own) else 0, len(own), tolerance, got.mean(0) / want if len(own)
                else '-'))
        off = float(np.abs(got.mean(0) / want - 1).max()) if len(own) else 1.0
        if off > case['tol_rel'] / 3:
            judgement.failures.append('%s: the mean over points is off by %.1e, a third of the tolerance is %.1e' %
                                      (name, off, case['tol_rel'] / 3))
        moved = want * (1 + max(0.01, 2.5 * tolerance))
        if ((np.abs(got - moved) / moved).max(1) <= tolerance).mean() >= UNIFORM_SHARE:
            judgement.failures.append('%s: an answer moved by 2.5 tolerances would pass too' % name)


def compare_dark(case, bake, judgement):
    """Nothing at all may come into a closed box."""
    own = bake.points.of(bake.index('inside'))
    judgement.points += len(own)
    if len(own) == 0 or bake.points.total[own].any() or bake.lightmap('inside').irradiance.any():
        judgement.failures.append('inside: light came into the closed box, largest value %g over %d points' % (
            max(bake.points.total[own].max(initial=0), bake.lightmap('inside').irradiance.max()), len(own)))


GRAZING_EMITTER = [(-0.5, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.01, 0.0), (-0.5, 0.01, 0.0)]


def compare_grazing(case, bake, judgement):
    """The lightmap's texels are metres long there: each is compared with the closed form's mean over the same texel."""
    up = np.array([0.0, 1.0, 0.0])
    radiance = grazing_radiance(case)
    lightmap = bake.lightmap('receiver')
    nodes, weights = np.polynomial.legendre.leggauss(24)
    for sample in case['samples']:
        row = min(int(sample['uv1'][1] * lightmap.height), lightmap.height - 1)
        form = lambert(np.array(sample['p']), up, GRAZING_EMITTER, radiance)
        if abs(form / sample['E'][0] - 1) > 1e-3 * case['tol_rel'] * max(sample['p'][2], 1.0):  # it cancels far away
            judgement.failures.append('the closed form of the test itself is off at %s' % sample['p'])
        if row == 0 or any(row == r for r in judgement.rows):
            continue  # the light's own row: see grazing_patches
        judgement.rows.append(row)
        column = lightmap.width // 2
        low, high = 1000.0 * row / lightmap.height, 1000.0 * (row + 1) / lightmap.height
        left, right = 2.0 * column / lightmap.width - 1, 2.0 * (column + 1) / lightmap.width - 1
        mean = 0.0
        for a, wa in zip(nodes, weights):
            for b, wb in zip(nodes, weights):
                place = np.array([(left + right + a * (right - left)) / 2, 0, (low + high + b * (high - low)) / 2])
                mean += wa * wb / 4 * lambert(place, up, GRAZING_EMITTER, radiance)
        got = lightmap.irradiance[row, column]
        v = (row + 0.5) / lightmap.height
        error = channel_errors(pooled_row_error(bake, 'receiver', row), got)
        judgement.point('receiver row %d (v = %g)' % (row, v), got, np.full(3, mean), error, ROUNDING * mean,
                        case['tol_rel'])


def grazing_radiance(case):
    at_1m = case['samples'][3]
    return at_1m['E'][0] / lambert(np.array(at_1m['p']), np.array([0.0, 1.0, 0.0]), GRAZING_EMITTER, 1.0)


def pooled_row_error(bake, name, row):
    points = bake.points
    own = points.of(bake.index(name))
    own = own[points.y[own] == row]
    return math.sqrt(float(np.mean(points.error[own] ** 2)))


def grazing_patches(scene, case):
    """The same emitter and the same points, each on a receiver of its own, a fiftieth of its distance wide."""
    black, light = scene.material('black'), scene.material('light', radiance=(grazing_radiance(case),) * 3)
    scene.quad('emitter', GRAZING_EMITTER, light)
    for i, sample in enumerate(case['samples']):
        (x, _, z), h = sample['p'], sample['p'][2] / 100
        scene.quad('patch%d' % i, [(x - h, 0, z + h), (x + h, 0, z + h), (x + h, 0, z - h), (x - h, 0, z - h)], black)
    return case['samples']


SPHERE_CENTRE = np.array([0.0, 2.0, 0.0])


def sphere_patches(scene, case):
    """The points that lie in mid-air under the sphere, each on a small receiver. They share one place, so each is
    turned about the sphere's centre by some degrees, which changes nothing for a sphere."""
    scene.load(harness.own_scene('analytic', case['file']))
    black = scene.material('patch')
    samples = [s for s in case['samples'] if s['node'] is None]
    for i, sample in enumerate(samples):
        angle = math.radians(7.0 * (i - 3))
        turn = np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]])
        p, n = turn @ (np.array(sample['p']) - SPHERE_CENTRE) + SPHERE_CENTRE, turn @ np.array(sample['n'])
        s = np.array([0.0, 0.0, 1.0])
        t, h = np.cross(n, s), 0.005
        scene.quad('patch%d' % i, [p - h * s - h * t, p + h * s - h * t, p + h * s + h * t, p - h * s + h * t], black)
    return samples


# Cases some of whose points lie on no surface, or where a texel says nothing about a point: what puts receivers there.
PATCHES = {'grazing': grazing_patches, 'sphere_light': sphere_patches}


def bake_patches(kiln, case):
    scene = glb.Scene()
    samples = PATCHES[case['id']](scene, case)
    judgement = Judgement(kiln.thin > 1)
    path = scene.write(os.path.join(kiln.scratch, case['id'] + '-patches.glb'))
    bake = kiln.bake(path, '--denoise', 'none', '--lightmap-size', 9, '--samples-direct', kiln.samples(4096),
                     '--samples-probe', 0,
                     '--bounces', 0)
    if bake.process.status == 0:
        for i, sample in enumerate(samples):
            try:
                got, error, grid = at_layout(bake, 'patch%d' % i, 0.5, 0.5)
            except ValueError as problem:
                judgement.failures.append('%s: %s' % (sample, problem))
                continue
            judgement.point('%s facing %s' % (sample['p'], sample['n']), got, sample['E'], error,
                            grid + ROUNDING * max(sample['E']),
                            case['tol_rel'])
    return bake, judgement


def bake_case(kiln, case):
    scene = harness.own_scene('analytic', case['file'])
    judgement = Judgement(kiln.thin > 1)
    if case['id'] in FLAT:
        scene = glb.without_normals(scene, os.path.join(kiln.scratch, case['id'] + '-flat.glb'))
    if case['id'] in LONE:
        scene = glb.with_few_texels(scene, os.path.join(kiln.scratch, case['id'] + '-lone.glb'), {LONE[case['id']]},
                                    FEW)
    bake = kiln.bake(scene, '--denoise', 'none', *options(case, kiln))
    if bake.process.status != 0:
        return bake, judgement
    scale = max([max(s['E']) for s in case['samples']], default=0.0)
    try:
        if case['id'] == 'leak_box':
            compare_dark(case, bake, judgement)
        else:
            compare_samples(case, bake, judgement, scale)
            compare_means(case, bake, judgement)
            compare_uniform(case, bake, judgement)
        if case['id'] == 'grazing':
            compare_grazing(case, bake, judgement)
        if judgement.points == 0:
            judgement.failures.append('nothing was compared')
    except (ValueError, KeyError, OSError) as problem:
        judgement.failures.append('cannot be compared: %s: %s' % (type(problem).__name__, problem))
    return bake, judgement


def report(checks, table, name, bake, judgement, totals):
    if checks.baked(bake):
        totals[0] += judgement.points
        totals[1] += bake.process.seconds
        text, kept = harness.energy(bake.run)
        table.row(name, judgement.points, '%.1e' % judgement.relative, '%.2f' % judgement.errors,
                  '%.1f' % bake.process.seconds, text)
        checks.that(not judgement.failures, '%s: %s' % (name, '\n        '.join(judgement.failures[:6])), bake.process)
        checks.that(kept, '%s: energy is not kept: %s' % (name, text), bake.process)
    bake.remove()


def main():
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--only', metavar='ID', action='append', help='these cases'))
    path = harness.own_scene('analytic', 'expected.json')
    if path is None:
        harness.skip('neither tests/data/analytic nor ../shared/scenes/own/analytic is here.')
    with open(path) as f:
        cases = json.load(f)['cases']
    checks, totals = harness.Checks(), [0, 0.0]
    table = harness.Table(('case', 24), ('points', 7), ('rel. error', 11), ('std. errors', 11), ('seconds', 8),
                          ('energy', 36))
    for case in cases:
        if case.get('optional') or case['file'] is None or (arguments.only and case['id'] not in arguments.only):
            continue
        bake, judgement = bake_case(kiln, case)
        report(checks, table, case['id'], bake, judgement, totals)
        if case['id'] in PATCHES:
            bake, judgement = bake_patches(kiln, case)
            report(checks, table, case['id'] + ', patches', bake, judgement, totals)
    print('%d points in %.0f s' % tuple(totals))
    checks.end()


if __name__ == '__main__':
    main()
