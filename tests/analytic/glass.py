"""Light through surfaces that are partly there: panes of two triangles, blended and of thin glass, under a sun, before
an emitter, under a sky, and between a point and the surface that it gathers from; and points that are partly holes.

Shadow rays bring the product of what they go through, so that under a sun and before an emitter the answer is exact,
the same on every texel, for any number of samples. Rays of a bounce meet a pane by chance: the answer is within 4
standard errors, which the spread over texels confirms.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402
import png  # noqa: E402
from closed_forms import lambert  # noqa: E402
from probes import Volume  # noqa: E402

SUN = 10.0
DOWN = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]  # a quarter turn about x: -z becomes -y
EXACT = 2e-6
UP = np.array([0.0, 1.0, 0.0])


def texture(scene, rgba):
    """Number of a new texture, nearest filter, with this image."""
    while len(scene.blob) % 4:
        scene.blob.append(0)
    data = png.encoded(rgba)
    scene.document['bufferViews'].append({'buffer': 0, 'byteOffset': len(scene.blob), 'byteLength': len(data)})
    scene.blob += data
    images, samplers, textures = (scene.document.setdefault(k, []) for k in ('images', 'samplers', 'textures'))
    images.append({'mimeType': 'image/png', 'bufferView': len(scene.document['bufferViews']) - 1})
    samplers.append({'magFilter': 9728, 'minFilter': 9728, 'wrapS': 33071, 'wrapT': 33071})
    textures.append({'source': len(images) - 1, 'sampler': len(samplers) - 1})
    return len(textures) - 1


def pane(scene, name, color=(0, 0, 0), alpha=None, transmission=None, transmission_texture=None, base_texture=None,
         mask=False):
    """A double-sided material that lets light through."""
    number = scene.material(name, color, double_sided=True)
    material = scene.document['materials'][number]
    if alpha is not None or mask:
        material['alphaMode'] = 'MASK' if mask else 'BLEND'
        material['pbrMetallicRoughness']['baseColorFactor'][3] = 1.0 if alpha is None else alpha
    if base_texture is not None:
        material['pbrMetallicRoughness']['baseColorTexture'] = {'index': base_texture}
    if transmission is not None:
        extension = material.setdefault('extensions',
                                        {})['KHR_materials_transmission'] = {'transmissionFactor': transmission}
        scene.used.add('KHR_materials_transmission')
        if transmission_texture is not None:
            extension['transmissionTexture'] = {'index': transmission_texture}
    return number


def flat(scene, name, x, z, half, y, material, up=True, cuts=1):
    corners = [(x - half, y, z + half), (x + half, y, z + half), (x + half, y, z - half), (x - half, y, z - half)]
    scene.quad(name, corners if up else corners[::-1], material, cuts=cuts)


def box(scene, name, low, high, material):
    """Six panes."""
    (a, b, c), (d, e, f) = low, high
    for i, corners in enumerate(([(a, b, f), (d, b, f), (d, e, f), (a, e, f)],
                                 [(d, b, c), (a, b, c), (a, e, c), (d, e, c)],
                                 [(d, b, f), (d, b, c), (d, e, c), (d, e, f)],
                                 [(a, b, c), (a, b, f), (a, e, f), (a, e, c)],
                                 [(a, e, f), (d, e, f), (d, e, c), (a, e, c)],
                                 [(a, b, c), (d, b, c), (d, b, f), (a, b, f)])):
        scene.quad('%s%d' % (name, i), corners, material)


class Sorted:
    pass


def sorted_points(bake):
    """The points in an order that does not depend on cells."""
    p, result = bake.points, Sorted()
    order = np.lexsort((p.x, p.y, p.object))
    result.total, result.error = p.total[order], p.error[order]
    return result


class Cases:
    def __init__(self, kiln, checks):
        self.kiln, self.checks = kiln, checks
        self.table = harness.Table(('case', 34), ('largest difference', 19), ('seconds', 8), ('energy', 36))

    def bake(self, name, scene, *options, ranks=0, probes=0):
        if '--materials' not in options:  # light that goes straight through
            options += ('--materials', 'diffuse')
        path = scene.write(os.path.join(self.kiln.scratch, name.replace(' ', '-') + '.glb'))
        bake = self.kiln.bake(path, '--samples-probe', probes, *options, ranks=ranks)
        return bake if self.checks.baked(bake) else None

    def exact(self, bake, name, want, tolerance=EXACT):
        """Every texel of the object has this direct irradiance. Gives the largest relative difference."""
        want = np.asarray(want, float)
        own = bake.points.of(bake.index(name))
        got = bake.points.direct[own]
        off = float(np.abs(got - want).max() / want.max()) if len(own) else math.inf
        self.checks.that(off <= tolerance, '%s: %s to %s instead of %s' % (name, got.min(0), got.max(0), want),
                         bake.process)
        return off

    def by_chance(self, bake, name, want):
        """The object's mean is within 4 standard errors, by the spread over its texels, and no texel's own error is
        unlike that spread."""
        want = np.asarray(want, float)
        own = bake.points.of(bake.index(name))
        got, errors = bake.points.total[own], bake.points.error[own]
        spread = got.std(0, ddof=1)
        off = np.abs(got.mean(0) - want) / np.maximum(4 * spread / math.sqrt(len(own)), 1e-5 * want.max())
        luminance = (got @ harness.LUMINANCE).std(ddof=1)
        self.checks.that(bool((off <= 1).all()), '%s: mean %s instead of %s, spread of texels %s' %
                         (name, got.mean(0), want, spread), bake.process)
        self.checks.that(luminance <= 2 * math.sqrt(float(np.mean(errors ** 2))),
                         '%s: texels spread by %g, their standard errors are %g' % (
            name, luminance, math.sqrt(float(np.mean(errors ** 2)))), bake.process)
        self.checks.that(bool((np.abs(got.mean(0) / want - 1) <= 0.02).all()), '%s: mean %s is more than 2 %% off %s' %
                         (name, got.mean(0), want), bake.process)
        return float(np.abs(got.mean(0) / want - 1).max())

    def row(self, name, bake, off):
        self.table.row(name, '%.1e' % off, '%.1f' % bake.process.seconds, harness.energy(bake.run)[0])
        self.checks.energy(bake, name)
        bake.remove()


GLASS = {'clear': (1, 1, 1), 'green': (0.25, 0.9, 0.5), 'red': (0.8, 0.02, 0.0)}


def under_a_sun(cases):
    """Floors below panes of two triangles each: blended ones, tinted glass, one whose texture makes half of it glass,
    two above each other."""
    scene = glb.Scene()
    black = scene.material('black')
    half = np.zeros((2, 2, 4), int) + 255
    half[:, 1, :3] = 0  # the right half transmits nothing
    halves = texture(scene, half)
    want, x = {}, 0.0

    def add(name, through, *panes):
        nonlocal x
        flat(scene, 'floor_' + name, x, 0.0, 0.5, 0.0, black)
        for i, material in enumerate(panes):
            flat(scene, 'pane_%s_%d' % (name, i), x, 0.0, 0.9, 1.0 + i, material, up=i % 2 == 0)
        want['floor_' + name] = SUN * np.asarray(through, float) * np.ones(3)
        x += 2.0

    for alpha in (0.1, 0.4, 0.6, 0.9):
        add('blend%g' % alpha, 1 - alpha, pane(scene, 'blend%g' % alpha, (0.7, 0.2, 0.1), alpha=alpha))
    for name, color in GLASS.items():
        add(name, color, pane(scene, name, color, transmission=1.0))
    green = np.array(GLASS['green'])
    add('both', 0.3 + 0.7 * 0.6 * green, pane(scene, 'both', green, alpha=0.7, transmission=0.6))
    two = pane(scene, 'two', green, transmission=0.8)
    add('two', (0.8 * green) ** 2 * 0.5, two, two, pane(scene, 'grey', (1, 1, 1), alpha=0.5))
    flat(scene, 'floor_left', x - 0.4, 0.0, 0.3, 0.0, black)
    flat(scene, 'floor_right', x + 0.4, 0.0, 0.3, 0.0, black)
    flat(scene, 'pane_half', x, 0.0, 0.9, 1.0,
         pane(scene, 'half', green, transmission=0.5, transmission_texture=halves))
    want['floor_left'] = SUN * 0.5 * green
    want['floor_right'] = np.zeros(3)
    scene.light('sun', {'type': 'directional', 'intensity': SUN}, rotation=DOWN)
    options = ('--lightmap-size', 8, '--samples-direct', 4, '--bounces', 1, '--samples-indirect', 64)
    bake = cases.bake('under a sun', scene, *options)
    if bake is None:
        return
    if cases.kiln.backend == 'embree':
        again = cases.bake('under a sun', scene, *options, '--threads', 1, '--cell-size', 1.5, ranks=3)
        same = again is not None and all(np.array_equal(getattr(sorted_points(bake), k),
                                                        getattr(sorted_points(again), k)) for k in ('total', 'error'))
        cases.checks.that(same, 'three ranks, other cells: not the same bits', bake.process)
    off = 0.0
    for name, value in want.items():
        if value.max() > 0:
            off = max(off, cases.exact(bake, name, value))
        else:
            own = bake.points.of(bake.index(name))
            cases.checks.that(len(own) > 0 and not bake.points.direct[own].any(), '%s: light came through' % name,
                              bake.process)
    cases.row('under a sun', bake, off)


def around_an_emitter(cases):
    """An emitter in a box of green glass, seen from below; the closed form without glass, times the tint."""
    scene = glb.Scene()
    light = [(-0.2, 2.0, -0.2), (0.2, 2.0, -0.2), (0.2, 2.0, 0.2), (-0.2, 2.0, 0.2)]
    scene.quad('light', light, scene.material('light', radiance=(20, 20, 20)))
    color = np.array(GLASS['green'])
    box(scene, 'glass', (-0.4, 1.8, -0.4), (0.4, 2.2, 0.4), pane(scene, 'green', color, transmission=1.0))
    flat(scene, 'patch', 0.3, 0.1, 0.0005, 0.0, scene.material('black'))
    bake = cases.bake('around an emitter', scene, '--lightmap-size', 9, '--samples-direct', cases.kiln.samples(4096),
                      '--bounces', 1,
                      '--samples-indirect', 16)
    if bake is not None:
        form = lambert(np.array([0.3, 0.0, 0.1]), UP, light, 20.0)
        cases.row('around an emitter', bake, cases.exact(bake, 'patch', form * color, 1e-3))


def under_a_sky(cases):
    """In a box of glass under a sky of radiance 2 every direction above crosses one pane: on a floor, and for the probe
    in the middle."""
    scene = glb.Scene()
    scene.environment((2, 2, 2))
    color = np.array(GLASS['green'])
    flat(scene, 'floor', 0.0, 0.0, 0.5, -0.5, scene.material('black'))
    box(scene, 'glass', (-1, -1, -1), (1, 1, 1), pane(scene, 'green', color, alpha=0.75, transmission=1.0))
    bake = cases.bake('under a sky', scene, '--lightmap-size', 8, '--samples-direct', cases.kiln.samples(4096),
                      '--bounces', 0, '--probe-spacing', 2 / 3,
                      probes=cases.kiln.samples(16384))
    if bake is None:
        return
    want = 2 * math.pi * (0.25 + 0.75 * color)
    off = cases.exact(bake, 'floor', want, 1e-3)
    up = Volume(os.path.join(bake.directory, 'volume.hdf')).at_origin('irradiance_posy')
    cases.checks.that(bool((np.abs(up / want - 1) < 5e-3).all()), 'the probe has %s from above instead of %s' %
                      (up, want), bake.process)
    cases.row('under a sky', bake, off)


def between_surfaces(cases):
    """A sunlit floor seen from patches that look down at it, each in a box of its own, through which no sun comes to
    what it sees."""
    scene = glb.Scene()
    albedo, slope = 0.5, 60.0
    black = scene.material('black')
    floor = [(-0.5, 0, 0.5), (0.5, 0, 0.5), (0.5, 0, -0.5), (-0.5, 0, -0.5)]
    scene.quad('floor', floor, scene.material('floor', (albedo,) * 3))
    boxes = {'bare': None, 'blend': (dict(alpha=0.4), 0.6),
             'green': (dict(color=GLASS['green'], transmission=1.0), GLASS['green']),
             'red_blend': (dict(color=GLASS['red'], alpha=0.75, transmission=1.0),
                           0.25 + 0.75 * np.array(GLASS['red']))}
    want = {}
    radiance = albedo * SUN * math.cos(math.radians(slope)) / math.pi
    for i, (name, what) in enumerate(boxes.items()):
        at = np.array([-0.3 + 0.2 * i, 1.0, 0.0])
        flat(scene, name, *at[[0, 2]], 0.02, at[1], black, up=False)
        want[name] = lambert(at, -UP, floor[::-1], radiance) * np.ones(3)
        if what is not None:
            box(scene, 'box_' + name, at - 0.08, at + 0.08, pane(scene, name, **what[0]))
            want[name] = want[name] * what[1]
    # the sun from +z, 60 degrees off the zenith: shadows fall 1.6 m and more to -z, beside the floor
    angle = math.radians(90 - slope) / 2
    scene.light('sun', {'type': 'directional', 'intensity': SUN},
                rotation=[-math.sin(angle), 0.0, 0.0, math.cos(angle)])
    bake = cases.bake('between surfaces', scene, '--lightmap-size', 16, '--samples-direct', 16, '--bounces', 1,
                      '--samples-bounce', 4,
                      '--samples-indirect', cases.kiln.samples(4096))
    if bake is not None:
        cases.row('between surfaces', bake, max(cases.by_chance(bake, name, value) for name, value in want.items()))


def fresnel(cosine, index=1.5):
    """What a boundary of that index reflects of unpolarised light; an array of cosines will do."""
    other = np.sqrt(1 - (1 - cosine ** 2) / index ** 2)
    across, along = (cosine - index * other) / (cosine + index * other), (other - index * cosine) / (
        other + index * cosine)
    return (across ** 2 + along ** 2) / 2


def smooth(scene, name, *arguments, index=None, **options):
    """A pane that is a mirror too."""
    number = pane(scene, name, *arguments, transmission=1.0, **options)
    material = scene.document['materials'][number]
    material['pbrMetallicRoughness']['roughnessFactor'] = 0.0
    if index is not None:
        material['extensions']['KHR_materials_ior'] = {'ior': index}
        scene.used.add('KHR_materials_ior')
    return number


def tilted(scene, name, x, slope, material):
    """A pane over the floor at x that meets what comes straight down at that angle, degrees."""
    run, rise = 0.9, 0.9 * math.tan(math.radians(slope))
    scene.quad(name, [(x - run, 2 - rise, 0.9), (x + run, 2 + rise, 0.9), (x + run, 2 + rise, -0.9),
                      (x - run, 2 - rise, -0.9)], material)


def smooth_panes(cases):
    """Smooth panes let through what they do not reflect, by the angle, where materials are taken with their gloss: what
    a sun sends, straight and at 60 degrees, and, gathered through a level pane, a floor. Holes let all through."""
    scene = glb.Scene()
    scene.used.add('KHR_materials_transmission')
    black = scene.material('black')
    half = np.zeros((2, 2, 4), int) + 255
    half[:, 1, 3] = 0  # the right half is a hole
    half = texture(scene, half)
    green = np.array(GLASS['green'])
    kept = {'level': 1 - fresnel(1.0), 'slope': 1 - fresnel(0.5), 'green': green * (1 - fresnel(0.5, 1.3)),
            'two': (1 - fresnel(1.0)) * (1 - fresnel(0.5))}
    for i, (name, slope) in enumerate((('level', 0), ('slope', 60), ('green', 60), ('two', 60))):
        x = 3.0 * i
        flat(scene, name, x, 0.0, 0.5, 0.0, black)
        material = smooth(scene, name, green if name == 'green' else (1, 1, 1), index=1.3 if name == 'green' else None)
        tilted(scene, 'pane_' + name, x, slope, material)
        if name == 'two':
            flat(scene, 'pane_level_two', x, 0.0, 0.6, 0.2, material, up=False)
    flat(scene, 'left', 12 - 0.4, 0.0, 0.3, 0.0, black)
    flat(scene, 'right', 12 + 0.4, 0.0, 0.3, 0.0, black)
    tilted(scene, 'pane_half', 12.0, 0, smooth(scene, 'half', (1, 1, 1), mask=True, base_texture=half))
    kept.update(left=1 - fresnel(1.0), right=1.0)
    scene.light('sun', {'type': 'directional', 'intensity': SUN}, rotation=DOWN)
    for materials in ('auto', 'diffuse'):
        bake = cases.bake('smooth panes ' + materials, scene, '--lightmap-size', 8, '--samples-direct', 4, '--bounces',
                          0, '--materials', materials)
        if bake is not None:
            cases.row('smooth panes, ' + materials, bake, max(
                cases.exact(bake, name, SUN * (share if materials == 'auto' else green if name == 'green' else 1.0)
                            * np.ones(3)) for name, share in kept.items()))


def through_a_pane(cases):
    """A sunlit floor, and a patch that looks down at it through a level smooth pane, which shades none of it."""
    scene = glb.Scene()
    albedo, slope = 0.5, 60.0
    floor = [(-0.5, 0, 0.5), (0.5, 0, 0.5), (0.5, 0, -0.5), (-0.5, 0, -0.5)]
    scene.quad('floor', floor, scene.material('floor', (albedo,) * 3))
    flat(scene, 'patch', 0.0, 0.0, 0.01, 0.8, scene.material('black'), up=False)
    flat(scene, 'pane', 0.0, 0.0, 0.2, 0.75, smooth(scene, 'pane', (1, 1, 1)))
    angle = math.radians(90 - slope) / 2
    scene.light('sun', {'type': 'directional', 'intensity': SUN},
                rotation=[-math.sin(angle), 0.0, 0.0, math.cos(angle)])
    nodes, weights = np.polynomial.legendre.leggauss(64)
    squares = (nodes[:, None] ** 2 + nodes[None, :] ** 2) / 4 + 0.64
    cosines = 0.8 / np.sqrt(squares)
    want = albedo * SUN * math.cos(math.radians(slope)) / math.pi * float(
        (np.outer(weights, weights) / 4 * cosines ** 2 / squares * (1 - fresnel(cosines))).sum())
    bake = cases.bake('through a pane', scene, '--lightmap-size', 16, '--samples-direct', 16, '--bounces', 1,
                      '--materials', 'auto', '--samples-bounce', 4, '--samples-indirect', cases.kiln.samples(4096))
    if bake is not None:
        cases.row('through a pane', bake, cases.by_chance(bake, 'patch', np.ones(3) * want))


def with_holes(cases):
    """A sheet of one texel, half of it a hole, beside an emitter: the texel's irradiance is the mean over what is
    there, and no energy is lost. Its holes are finer than texels, so that the mean over all of it is 1.3 times as
    much."""
    scene = glb.Scene()
    image = np.zeros((16, 16, 4), int) + 255
    image[:, 8:, 3] = 0
    corners = [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]
    scene.quad('sheet', corners, pane(scene, 'sheet', (0.5,) * 3, mask=True, base_texture=texture(scene, image)))
    light = [(0.5, 0.7, -0.5), (1.5, 0.7, -0.5), (1.5, 0.7, 0.5), (0.5, 0.7, 0.5)]
    scene.quad('light', light, scene.material('light', radiance=(10, 10, 10)))
    scene.quad('ground', [(-4, -1, 4), (4, -1, 4), (4, -1, -4), (-4, -1, -4)], scene.material('ground', (0.5,) * 3))
    bake = cases.bake('with holes', scene, '--lightmap-size', 2, '--samples-direct', cases.kiln.samples(16384),
                      '--bounces', 0)
    if bake is None:
        return
    nodes, weights = np.polynomial.legendre.leggauss(24)
    mean = lambda low, high: sum(wa * wb / 4 * lambert(np.array([(low + high + a * (high - low)) / 2, 0, b]), UP, light,
                                                       10.0)
                                 for a, wa in zip(nodes, weights) for b, wb in zip(nodes, weights))
    want = mean(-1, 0)
    own = bake.points.of(bake.index('sheet'))
    left = own[bake.points.x[own] == 0]
    off = float(np.abs(bake.points.total[left].mean(0) / want - 1).max())
    cases.checks.that(off < 5e-3, 'sheet: %s instead of %g' % (bake.points.total[left].mean(0), want), bake.process)
    cases.row('with holes', bake, off)


def fine_stripes(cases):
    """Sheets of 2 x 2 texels, each under 64 stripes of its texture, which get wider towards an emitter: beside holes,
    and of more opacity than what is beside them. A texel's irradiance is the mean over what is there, weighted by
    opacity; with two seeds it is off by no more than its stated error says."""
    pixels, rows = 1024, 6
    stripe = np.arange(pixels) // 8
    inside = np.arange(pixels) % 8 < 1 + stripe * 6 // stripe.max()
    light = [(0.5, 0.7, -0.5), (1.5, 0.7, -0.5), (1.5, 0.7, 0.5), (0.5, 0.7, 0.5)]
    nodes, weights = np.polynomial.legendre.leggauss(rows)
    falls = np.array([sum(w / 2 * lambert(np.array([2 * (i + 0.5) / pixels - 1, 0, (z - 1) / 2]), UP, light, 10.0)
                          for z, w in zip(nodes, weights)) for i in range(pixels)])
    for name, alpha in ('holes', np.where(inside, 255, 0)), ('blended', np.where(inside, 204, 51)):
        scene, image = glb.Scene(), np.zeros((4, pixels, 4), int) + 255
        image[:, :, 3] = alpha
        material = pane(scene, 'sheet', mask=name == 'holes', alpha=1.0, base_texture=texture(scene, image))
        flat(scene, 'sheet', 0, 0, 1, 0, material)
        scene.quad('light', light, scene.material('light', radiance=(10, 10, 10)))
        want = (alpha * falls).reshape(2, -1).sum(1) / alpha.reshape(2, -1).sum(1)
        most, samples = 0.0, cases.kiln.samples(16384)
        for seed in (1, 2) if cases.kiln.backend == 'embree' else (1,):
            bake = cases.bake('fine stripes ' + name, scene, '--lightmap-size', 2, '--bounces', 0, '--seed', seed,
                              '--samples-direct', samples)
            if bake is None:
                return
            own = bake.points.of(bake.index('sheet'))
            mean = want[bake.points.x[own]]
            off, stated = bake.points.total[own][:, 0] / mean - 1, bake.points.error[own] / mean
            error = math.sqrt(float(np.mean(stated ** 2)))
            cases.checks.that(len(own) == 4 and bool((np.abs(off) <= 4 * error).all()),
                              '%s, seed %d: off by %s, stated errors %s' % (name, seed, off, stated), bake.process)
            cases.checks.that(error < 0.01 * math.sqrt(16384 / samples),
                              '%s, seed %d: stated errors %s' % (name, seed, stated), bake.process)
            most, seconds = max(most, float(np.abs(off).max())), bake.process.seconds
            bake.remove()
        # no look at the energy: how much of a texel is there is known from 256 looks, to a hundredth or so
        cases.table.row('fine stripes, ' + name, '%.1e' % most, '%.1f' % seconds, '')


def all_kinds(path):
    """A scene with every kind of surface that lets light through, lit by a lamp and whatever else is asked for: for
    other tests."""
    scene = glb.Scene()
    yy, xx = np.mgrid[0:16, 0:16]
    image = np.zeros((16, 16, 4), int) + 220
    image[..., 3] = 255 * ((xx // 3 + yy // 4) % 2)
    leaf, ramp = texture(scene, image), image.copy()
    ramp[..., 3] = 16 * xx
    ramp[..., 0] = 15 * yy
    ramp = texture(scene, ramp)
    flat(scene, 'floor', 0.0, 0.0, 2.0, 0.0, scene.material('floor', (0.6, 0.5, 0.4)))
    flat(scene, 'leaf', -1.2, 0.2, 0.7, 0.8, pane(scene, 'leaf', (0.6, 0.7, 0.3), mask=True, base_texture=leaf))
    flat(scene, 'blend', 0.2, -1.1, 0.7, 0.9, pane(scene, 'blend', (0.9, 0.6, 0.3), alpha=0.8, base_texture=ramp),
         up=False)
    flat(scene, 'green', 0.9, 0.8, 0.8, 1.1,
         pane(scene, 'green', GLASS['green'], transmission=0.7, transmission_texture=ramp), cuts=3)
    box(scene, 'box', (-0.6, 0.1, 0.5), (0.1, 0.7, 1.2), pane(scene, 'red', GLASS['red'], alpha=0.7, transmission=0.8))
    scene.light('lamp', {'type': 'point', 'intensity': 30.0}, translation=[0.2, 2.0, 0.1])
    return scene.write(path)


def main():
    every = {case.__name__: case
             for case in (under_a_sun, around_an_emitter, under_a_sky, between_surfaces, smooth_panes, through_a_pane,
                          with_holes, fine_stripes)}
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--only', action='append', choices=every, help='these cases'))
    checks = harness.Checks()
    cases = Cases(kiln, checks)
    for name in arguments.only or every:
        every[name](cases)
    checks.end()


if __name__ == '__main__':
    main()
