"""Ambient occlusion, bent normals and light by direction, against closed forms; as kiln.h5, lightmaps and views have
them.

A plate over a floor covers what of the cosine-weighted hemisphere its form factor says, and nothing when it is farther
away than --ambient-occlusion; of a wide plate, what is nearer than that. Beside a long wall the bent normal is tilted
away from it. Light of one lamp, and of an even sky, has spherical harmonics of its own.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import exr  # noqa: E402
import glb  # noqa: E402
import harness  # noqa: E402
import png  # noqa: E402

UNORM = 0.5 / 65535  # by which a fraction is rounded
Y0, Y1 = 0.28209479177387814, 0.4886025119029199


def flat(scene, name, material, low, high, y, up=True):
    """A rectangle from (x, z) `low` to `high`, facing up or down."""
    (a, b), (c, d) = low, high
    corners = [(a, y, d), (c, y, d), (c, y, b), (a, y, b)]
    scene.quad(name, corners if up else corners[::-1], material)


def disc(scene, name, material, radius, y, sides=256):
    """A regular polygon that faces down, of the same area as a disc."""
    radius *= math.sqrt(2 * math.pi / sides / math.sin(2 * math.pi / sides))
    angles = 2 * math.pi * np.arange(sides) / sides
    rim = np.stack([radius * np.cos(angles), np.full(sides, y), radius * np.sin(angles)], 1)
    positions = np.concatenate([[(0, y, 0)], rim])
    layout = 0.5 + 0.45 * positions[:, [0, 2]] / radius
    scene.mesh(name, positions, layout, [(0, 1 + i, 1 + (i + 1) % sides) for i in range(sides)], material)


def form_factor(points, half, height):
    """Of a square plate with corners (+-half, +-half), as a horizontal surface `height` below it sees it (Howell,
    configuration factor of a differential element to a parallel rectangle, a corner over the element)."""
    total = 0.0
    for sx in (-1, 1):
        for sz in (-1, 1):
            a, b = (half - sx * points[:, 0]) / height, (half - sz * points[:, 2]) / height
            total = total + (a / np.sqrt(1 + a * a) * np.arctan(b / np.sqrt(1 + a * a)) +
                             b / np.sqrt(1 + b * b) * np.arctan(a / np.sqrt(1 + b * b))) / (2 * math.pi)
    return total


def few_sigma(values, want):
    """Whether values agree with what is wanted but for noise: (largest difference, difference of the means)."""
    off = values - want
    return float(np.abs(off).max()), float(abs(off.mean()))


def bake(kiln, scene, name, *options, size=12, samples=4096):
    return kiln.bake(scene.write(os.path.join(kiln.scratch, name + '.glb')), '--lightmap-size', size, '--bounces', 0,
                     '--samples-direct', 16, '--samples-bounce', 16, '--samples-indirect', kiln.samples(samples),
                     '--samples-probe', 0, '--no-export', *options)


def of(found, name, quantity, side=0):
    chosen = found.points.of(found.index(name), side)
    return found.points.position[chosen], found.points.quantities[quantity][chosen]


def noise(kiln, samples=4096):
    """What a fraction may be off by in a texel, and in the mean over an object. Directions are in strata, so that it is
    less than for independent ones."""
    count = kiln.samples(samples)
    return 0.6 / math.sqrt(count) + UNORM, 0.1 / math.sqrt(count) + UNORM


def check_plate(kiln, checks, table):
    """A square plate 1 m above a floor, a disc 1 m above another, and a plate that faces away: backs cover, too."""
    scene = glb.Scene()
    grey = scene.material('grey', (0.5,) * 3)
    flat(scene, 'floor', grey, (-1, -1), (1, 1), 0)
    flat(scene, 'plate', grey, (-0.5, -0.5), (0.5, 0.5), 1, False)
    square = bake(kiln, scene, 'plate', '--ambient-occlusion', 'inf')
    bakes = [('square plate', square)]
    if not kiln.few:
        bakes += more_plates(kiln)
    texel, mean = noise(kiln)
    for what, found in bakes:
        if not checks.baked(found):
            continue
        position, value = of(found, 'floor', 'ambient_occlusion')
        covered = 0.75 ** 2 / (0.75 ** 2 + 1) if what == 'disc' else form_factor(position, 0.5, 1.0)
        worst, off = few_sigma(value, 1 - covered)
        checks.that(worst < texel and off < mean, '%s: open share off by up to %.1e, in the mean by %.1e' %
                    (what, worst, off), found.process)
        moved = 1.02 if kiln.thin == 1 else 1.1
        checks.that(few_sigma(value, 1 - moved * covered)[1] > mean, '%s: an answer %.0f %% off would pass too' %
                    (what, 100 * (moved - 1)))
        table.row(what, 'worst texel %.1e, mean %.1e' % (worst, off))
    if checks.baked(square):
        check_files(kiln, checks, square)
    for _, found in bakes:
        found.remove()


def more_plates(kiln):
    """(name, bake) of the disc and of the plate that faces away."""
    scene = glb.Scene()
    grey = scene.material('grey', (0.5,) * 3)
    flat(scene, 'floor', grey, (-0.05, -0.05), (0.05, 0.05), 0)
    disc(scene, 'disc', grey, 0.75, 1)
    round_ = bake(kiln, scene, 'disc', '--ambient-occlusion', 'inf', size=4)
    scene = glb.Scene()
    grey = scene.material('grey', (0.5,) * 3)
    flat(scene, 'floor', grey, (-1, -1), (1, 1), 0)
    flat(scene, 'plate', grey, (-0.5, -0.5), (0.5, 0.5), 1)
    back = bake(kiln, scene, 'back', '--ambient-occlusion', 1000)
    return [('disc', round_), ('back of a plate', back)]


def check_distance(kiln, checks, table):
    """What is farther away than the distance does not count; of a wide plate at height h, what is nearer than M covers
    1 - (h / M)^2."""
    scene = glb.Scene()
    grey = scene.material('grey', (0.5,) * 3)
    flat(scene, 'floor', grey, (-0.1, -0.1), (0.1, 0.1), 0)
    flat(scene, 'plate', grey, (-20, -20), (20, 20), 1, False)
    texel, mean = noise(kiln)
    every = ((2.0, 0.25), (0.999, 1.0), ('inf', None))
    for distance, want in every[:1] if kiln.few else every:
        found = bake(kiln, scene, 'wide', '--ambient-occlusion', distance, size=6)
        if checks.baked(found):
            position, value = of(found, 'floor', 'ambient_occlusion')
            worst, off = few_sigma(value, 1 - form_factor(position, 20, 1) if want is None else want)
            exact = distance == 0.999
            checks.that(worst <= (0 if exact else texel) and off <= (0 if exact else mean),
                        'wide plate, %s m: off by up to %.1e, in the mean by %.1e' % (distance, worst, off),
                        found.process)
            table.row('wide plate, %s m' % distance, 'worst texel %.1e, mean %.1e' % (worst, off))
        found.remove()


def beside_wall(distance, height):
    """Mean direction of what is open, weighted by the cosine, beside an endless wall: (away from it, up)."""
    phi = (np.arange(20000) + 0.5) / 20000 * math.pi - math.pi / 2
    theta = np.arctan(distance / (height * np.cos(phi)))  # the wall covers what is farther from the zenith
    step = math.pi / 20000
    away = 2 / 3 - float(np.sum(np.cos(phi) * np.sin(theta) ** 3)) * step / 3
    up = math.pi / 3 + float(np.sum(1 - np.cos(theta) ** 3)) * step / 3
    return away / math.pi, up / math.pi


def check_wall(kiln, checks, table):
    scene = glb.Scene()
    grey = scene.material('grey', (0.5,) * 3, double_sided=True)
    flat(scene, 'floor', grey, (0.01, -0.1), (1.01, 0.1), 0)
    scene.quad('wall', [(0, -1, 2000), (0, -1, -2000), (0, 1, -2000), (0, 1, 2000)], grey)
    found = bake(kiln, scene, 'wall', '--ambient-occlusion', 'inf', '--sides', 'two', size=16)
    if not checks.baked(found):
        return
    texel, mean = noise(kiln)
    position, bent = of(found, 'floor', 'bent_normal')
    _, below = of(found, 'floor', 'bent_normal', 1)
    want = np.array([(*beside_wall(x, 1.0), 0.0) for x in position[:, 0]])
    want /= np.linalg.norm(want, axis=1, keepdims=True)
    tilt = lambda v: np.degrees(np.arctan2(v[:, 0], np.abs(v[:, 1])))
    off = tilt(bent) - tilt(want)
    limit, limit_mean = math.degrees(3 * texel), math.degrees(3 * mean)
    checks.that(float(np.abs(np.linalg.norm(bent, axis=1) - 1).max()) < 1e-6, 'bent normals are no unit vectors')
    checks.that(float(np.abs(off).max()) < limit and abs(float(off.mean())) < limit_mean,
                'beside a wall: tilted by up to %.2f degrees too much or little, in the mean %.3f' %
                (np.abs(off).max(), off.mean()), found.process)
    checks.that(float(np.abs(bent[:, 2]).max()) < 3 * texel, 'beside a wall: tilted along it by %.4f' %
                np.abs(bent[:, 2]).max(), found.process)
    # right at the wall half of the hemisphere is open: atan(2 / pi)
    nearest = tilt(want)[position[:, 0].argmin()]
    checks.that(abs(nearest - 32.48) < 2.0, 'the closed form of the test itself says %.2f degrees' % nearest)
    below_off = tilt(below) - tilt(want)  # as deep as the wall is high: the same from below
    checks.that(bool((below[:, 1] < 0).all()) and len(below) == len(bent) and
                float(np.abs(below_off).max()) < limit, 'the back beside a wall: %s' % below[:3], found.process)
    table.row('beside a wall', 'worst texel %.2f degrees, mean %.3f' % (np.abs(off).max(), off.mean()))
    found.remove()


def harmonics(direction):
    """(n, 4): 00, 1-1, 10, 11."""
    x, y, z = direction.T
    return np.stack([np.full(len(x), Y0), Y1 * y, Y1 * z, Y1 * x], 1)


def irradiance(sh, normal):
    """(n, 3) about `normal`, by sh (n, 12)."""
    weights = harmonics(normal) * ([math.pi] + [2 * math.pi / 3] * 3)
    return np.einsum('ni,nic->nc', weights, sh.reshape(-1, 4, 3))


def check_lamp(kiln, checks, table):
    """A point light over a floor that reflects nothing, and below a sheet, whose back has the light."""
    colour = np.array([1.0, 0.5, 0.25])
    for what, y, side in (('lamp', 0.0, 0), ('lamp below a sheet', 4.0, 1)):
        scene = glb.Scene()
        flat(scene, 'floor', scene.material('black', double_sided=True), (-1, -1), (1, 1), y)
        scene.light('lamp', {'type': 'point', 'intensity': 8.0, 'color': list(colour)}, translation=[0.3, 2.0, -0.2])
        for directional in ('sh1', 'dominant') if not kiln.few else ('dominant',) if side else ('sh1',):
            found = bake(kiln, scene, 'lamp', '--directional', directional, '--sides', 'two', size=16, samples=256)
            if not checks.baked(found):
                continue
            position, value = of(found, 'floor', 'sh' if directional == 'sh1' else 'dominant', side)
            way = np.array([0.3, 2.0, -0.2]) - position
            distance = np.linalg.norm(way, axis=1)
            way /= distance[:, None]
            if directional == 'sh1':
                light = 8.0 * colour / distance[:, None] ** 2
                want = np.einsum('nl,nc->nlc', harmonics(way), light).reshape(-1, 12)
                scale = np.abs(want).max()
            else:
                want, scale = np.concatenate([way, np.ones((len(way), 1))], 1), 1.0
            worst = float(np.abs(value - want).max()) / scale
            # a value is a mean over the texel, 12.5 cm wide
            checks.that(len(value) > 0 and worst < 0.003, '%s, %s: off by up to %.1e' % (what, directional, worst),
                        found.process)
            dark = of(found, 'floor', 'sh' if directional == 'sh1' else 'dominant', 1 - side)[1]
            checks.that(not dark.any(), '%s, %s: the dark side has %g' % (what, directional, np.abs(dark).max()),
                        found.process)
            table.row('%s, %s' % (what, directional), 'worst %.1e of the largest' % worst)
            found.remove()


def check_sky(kiln, checks, table):
    """An even sky over a tilted plane, and a furnace: about the normal the harmonics have the lightmap's irradiance."""
    scene = glb.Scene()
    scene.quad('floor', [(0, 0, 1), (1, 0.5, 1), (1, 0.5, 0), (0, 0, 0)], scene.material('black'))
    scene.environment((3.0, 2.0, 1.0))
    sky = None if kiln.few else bake(kiln, scene, 'sky', '--directional', 'sh1', size=6)
    scene = glb.Scene()
    glb.box(scene, 'room', (-1, -1, -1), (1, 1, 1), scene.material('wall', (0.5,) * 3, (2.0,) * 3), range(6))
    furnace = kiln.bake(scene.write(os.path.join(kiln.scratch, 'furnace.glb')), '--lightmap-size', 24, '--directional',
                        'sh1', '--samples-direct', kiln.samples(1024), '--samples-bounce', 32, '--samples-indirect',
                        kiln.samples(1024), '--samples-probe', 0, '--no-export')
    for what, found, name, want, limit in (('sky', sky, 'floor', math.pi * np.array([3.0, 2.0, 1.0]), 1e-3),
                                           ('furnace', furnace, 'room', np.full(3, 4 * math.pi), 0.02)):
        if found is None or not checks.baked(found):
            continue
        chosen = found.points.of(found.index(name))
        by_sh = irradiance(found.points.quantities['sh'][chosen], found.points.normal[chosen])
        worst = float(np.abs(by_sh / want - 1).max())
        mean = float(np.abs(by_sh.mean(0) / found.points.total[chosen].mean(0) - 1).max())
        limit *= math.sqrt(kiln.thin)
        checks.that(worst < limit and mean < limit / 5, '%s: irradiance by sh is off by up to %.1e, in the mean %.1e' %
                    (what, worst, mean), found.process)
        table.row(what, 'irradiance by sh: worst texel %.1e, mean %.1e' % (worst, mean))
        found.remove()


def check_files(kiln, checks, found):
    """Layers of the lightmaps, what other commands say of them, and pictures on a fixed scale."""
    lightmap = found.lightmap('floor')
    chosen = found.points.of(found.index('floor'))
    for name, channels in (('ambient_occlusion', 'Y'), ('bent_normal', 'XYZ')):
        layers = np.stack([lightmap.channels['%s.%s' % (name, c)] for c in channels], -1)
        there = layers[found.points.y[chosen], found.points.x[chosen]]
        values = found.points.quantities[name][chosen].reshape(len(chosen), -1)
        checks.that(float(np.abs(there - values).max()) < 1e-6, 'the layer %s is not what kiln.h5 has' % name)
    checks.that('world space' in lightmap.attributes['kiln:bentNormal'] and 'cosine' in
                lightmap.attributes['kiln:ambientOcclusion'], 'attributes of the lightmap: %s' % lightmap.attributes)
    for words in (('verify', found.directory), ('report', found.directory),
                  ('compare', found.directory, found.directory)):
        process = kiln.command(*words)
        checks.that(process.status == 0, 'kiln %s ended with %d' % (words[0], process.status), process)
    eye = ('--from=0,0.5,0', '--to=0,0,0.001', '--width', 40, '--height', 40, '--field-of-view', 40)
    for name, low, high in (('ambient_occlusion', 0.0, 1.0), ('bent_normal', -1.0, 1.0)):
        path = os.path.join(kiln.scratch, name)
        for kind in ('.exr', '.png'):
            process = kiln.command('view', found.directory, '--show', name, '-o', path + kind, *eye)
            checks.that(process.status == 0, 'kiln view --show %s ended with %d' % (name, process.status), process)
        want = 255 * (exr.rgb(path + '.exr') - low) / (high - low)
        off = float(np.abs(png.read(path + '.png') - want).max())
        checks.that(off <= 0.51, 'the picture of %s is not on its scale: off by %g' % (name, off))
        process = kiln.command('view', found.directory, '--show', name, '-o', path + '.png', '--exposure', 1)
        checks.that(process.status == 64 and 'fixed scale' in process.stderr, '--exposure for %s is taken' % name,
                    process)


def two_charts(scene, name, material):
    """A floor of 2 m in two charts, with a seam through its middle."""
    positions, layout, triangles = [], [], []
    for k in range(2):
        a, u = 4 * k, 0.05 + 0.5 * k
        positions += [(k - 1, 0, 1), (k, 0, 1), (k, 0, -1), (k - 1, 0, -1)]
        layout += [(u, 0.95), (u + 0.4, 0.95), (u + 0.4, 0.05), (u, 0.05)]
        triangles += [(a, a + 1, a + 2), (a, a + 2, a + 3)]
    scene.mesh(name, positions, layout, triangles, material)


def check_texels(kiln, checks, table):
    """A floor with a crate, under which texels are filled, and with a seam, which is smoothed: vectors are unit vectors
    in every texel."""
    scene = glb.Scene()
    grey = scene.material('grey', (0.5,) * 3)
    two_charts(scene, 'floor', grey)
    glb.box(scene, 'crate', (-0.4, 0, -0.4), (0.4, 0.6, 0.4), grey)
    scene.light('lamp', {'type': 'point', 'intensity': 5.0}, translation=[0.6, 0.8, 0.3])
    scene.environment((0.1, 0.1, 0.1))
    found = kiln.bake(scene.write(os.path.join(kiln.scratch, 'crate.glb')), '--lightmap-size', 48, '--quality', 'draft',
                      '--samples-probe', 0, '--no-export', '--ambient-occlusion', 1, '--directional', 'dominant')
    if not checks.baked(found):
        return
    layers = found.lightmap('floor').channels
    filled = layers['validity.Y'] == 0.5
    seam = found.run['objects'][found.names().index('floor')]['seam_before']
    checks.that(bool(filled.any()) and seam > 0, 'the floor has %d filled texels, its seam differs by %g' %
                (filled.sum(), seam), found.process)
    for name in ('bent_normal', 'dominant'):
        length = np.sqrt(sum(layers['%s.%s' % (name, axis)].astype(float) ** 2 for axis in 'XYZ'))
        worst = float(np.abs(length - 1).max())
        checks.that(worst < 1e-6, '%s has a length of %g to %g' % (name, length.min(), length.max()), found.process)
        table.row('texels of a floor', '%s: length off by %.1e at most' % (name, worst))
    for name in ('ambient_occlusion.Y', 'dominant.directionality'):
        values = layers[name]
        checks.that(values.min() >= 0 and values.max() <= 1 and values[filled].min() > 0.05, '%s: %g to %g, filled %g' %
                    (name, values.min(), values.max(), values[filled].min()), found.process)
    found.remove()


def main():
    every = {'plate': check_plate, 'distance': check_distance, 'wall': check_wall, 'lamp': check_lamp,
             'sky': check_sky, 'texels': check_texels}
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--only', action='append', choices=every, help='these cases'),
        lambda p: p.add_argument('--few', action='store_true', help='what rays do, once: not what the host does, '
                                 'nor the same with other numbers'))
    kiln.few = arguments.few
    chosen = [name for name in every if not arguments.few or name != 'texels']
    checks = harness.Checks()
    table = harness.Table(('case', 28), ('found', 60))
    for name in arguments.only or chosen:
        every[name](kiln, checks, table)
    checks.end()


if __name__ == '__main__':
    main()
