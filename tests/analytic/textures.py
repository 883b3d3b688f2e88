"""Textures: what they come to over the surface that they lie on, whatever the lightmap's texels have to do with theirs.

`albedo`: the mean albedo of a quad is that of its texture where this is repeated a whole number of times, for regular
textures above all, at any texel size: filters, wrap modes, transforms of coordinates, holes, a metal's mask. Two closed
rooms with such walls hold E = pi / (1 - mean albedo) times their radiance (../shared/scenes/own/cases).

`lamps`: a floor under a quad whose textures of emission and alpha cut it up, against the integral over its texels:
light that is cut away, bright spots in the dark, turned and repeated ones, spots under a mask. Power and floor, by
every method that samples lamps.

`views`: what a camera sees of a lamp that a mask cuts up, and of what it lights, against a lamp of as many quads.
"""
import math
import os
import sys

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import exr  # noqa: E402
import glb  # noqa: E402
import harness  # noqa: E402
import png  # noqa: E402

NEAREST, LINEAR = 9728, 9729
REPEAT, CLAMP, MIRROR = 10497, 33071, 33648
STANDARD_ERRORS = 4.0


def linear(code):
    """Of an 8-bit sRGB code."""
    c = np.asarray(code, float) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def texture(scene, pixels, filtered=LINEAR, wrap=REPEAT, **transform):
    """Adds a picture; returns what a material refers to it by. `transform`: of KHR_texture_transform."""
    document = scene.document
    for part, entry in (('images', {'uri': png.data_uri(pixels)}),
                        ('samplers', {'magFilter': filtered, 'minFilter': filtered, 'wrapS': wrap, 'wrapT': wrap})):
        document.setdefault(part, []).append(entry)
    document.setdefault('textures', []).append({'source': len(document['images']) - 1,
                                                'sampler': len(document['samplers']) - 1})
    info = {'index': len(document['textures']) - 1}
    if transform:
        scene.used.add('KHR_texture_transform')
        info['extensions'] = {'KHR_texture_transform': transform}
    return info


def stripes(width, period, lit, height=4):
    """Columns: of every `period`, the first `lit` are white."""
    columns = np.where(np.arange(width) % period < lit, 255, 0)
    return np.repeat(np.repeat(columns[None, :, None], height, 0), 3, 2)


def checker(width, side):
    at = np.arange(width) // side
    return np.repeat(np.where((at[:, None] + at[None, :]) % 2 == 0, 255, 0)[:, :, None], 3, 2)


def noise(width, height, channels=3):
    return np.random.default_rng(1).integers(0, 256, (height, width, channels))


def dots(width, period):
    """White with holes but for a square of three texels in each `period`."""
    at = np.arange(width) % period < 3
    alpha = np.where(at[:, None] & at[None, :], 255, 0)
    return np.dstack([np.where(alpha > 0, 255, 60)] * 3 + [alpha])


# name: pixels, settings of the texture, what of the material is not plain, mean albedo (None: of the pixels)
ALBEDOS = {
    'stripes_3': (stripes(48, 3, 1), {'filtered': NEAREST, 'scale': [7, 1]}, {}, None),
    'stripes_3_linear': (stripes(48, 3, 1), {'scale': [7, 1]}, {}, None),
    'stripes_8_few': (stripes(64, 8, 2), {'scale': [1, 1]}, {}, None),
    'checker_1': (checker(64, 1), {'filtered': NEAREST}, {}, None),
    'checker_32_mirrored': (checker(512, 32), {'wrap': MIRROR, 'scale': [2, 4]}, {}, None),
    'odd_size': (noise(97, 61), {'scale': [3, 2]}, {}, None),
    'turned': (noise(64, 64), {'rotation': math.pi / 2, 'scale': [3, 3]}, {}, None),
    'clamped': (checker(16, 2), {'wrap': CLAMP, 'filtered': NEAREST}, {}, None),
    'fine': (noise(1024, 1024), {}, {}, None),
    'holes': (dots(64, 16), {'filtered': NEAREST}, {'alphaMode': 'MASK'}, 1.0),
    'metal_beside': (noise(64, 48), {'filtered': NEAREST, 'scale': [2, 3]}, {'metal': True, 'base': True}, None),
    'metal': (stripes(48, 3, 1), {'filtered': NEAREST, 'scale': [7, 1]}, {'metal': True}, None),
}


def albedo_scene(path):
    """Quads of 3 x 3 m side by side under one material each."""
    scene = glb.Scene()
    rights = {}
    for i, (name, (pixels, settings, more, right)) in enumerate(ALBEDOS.items()):
        material = scene.material(name, (1, 1, 1))
        rough = scene.document['materials'][material]['pbrMetallicRoughness']
        mean = linear(np.asarray(pixels)[:, :, :3]).mean((0, 1)) if right is None else np.full(3, right)
        if more.get('base'):  # under a metal that goes with its blue
            rough['baseColorTexture'] = texture(scene, pixels, **settings)
            mean = (linear(pixels) * (1 - pixels[:, :, 2:] / 255)).mean((0, 1))
            rough['metallicFactor'] = 1.0
            rough['metallicRoughnessTexture'] = texture(scene, pixels, **settings)
        elif more.get('metal'):  # where the blue channel says so there is no diffuse part
            rough['metallicFactor'] = 1.0
            rough['metallicRoughnessTexture'] = texture(scene, pixels, **settings)
            mean = 1 - np.asarray(pixels)[:, :, :3].mean((0, 1)) / 255
        else:
            rough['baseColorTexture'] = texture(scene, pixels, **settings)
        if 'alphaMode' in more:
            scene.document['materials'][material]['alphaMode'] = more['alphaMode']
        x = 4 * i
        scene.quad(name, [(x, 0, 3), (x + 3, 0, 3), (x + 3, 0, 0), (x, 0, 0)], material)
        rights[name] = mean
    scene.environment((1, 1, 1))
    return scene.write(path), rights


def test_albedo(kiln, checks, _):
    path, rights = albedo_scene(os.path.join(kiln.scratch, 'albedo.glb'))
    for density in (1, 3.3, 10):
        more = ('--materials', 'diffuse') if density > 5 else ()
        bake = kiln.bake(path, '--texels-per-metre', density, '--samples-direct', 1, '--bounces', 0,
                         '--samples-probe', 0, '--denoise', 'none', *more)
        if not checks.baked(bake):
            continue
        with h5py.File(os.path.join(bake.directory, 'kiln.h5'), 'r') as f:
            albedo = f['points/albedo'][...].astype(float)
        for name, right in rights.items():
            of = bake.points.object == bake.index(name)
            area = bake.points.area[of]
            found = (albedo[of] * area[:, None]).sum(0) / area.sum()
            # texels without surface have the albedo of what is not there; diffuse materials a metal's mean
            if name == 'holes' and density > 1 or name == 'metal_beside' and more:
                continue
            # what is looked up, not averaged, is off by chance: 256 looks a texel
            bound = STANDARD_ERRORS * 0.5 / 16 / math.sqrt(of.sum()) if name == 'metal' else 2e-4
            off = float(np.abs(found - right).max())
            checks.that(off < bound, '%s at %g texels/m: mean albedo %s, right %s' % (name, density, found, right),
                        bake.process)
        bake.remove()


def test_furnace(kiln, checks, _):
    for name, mean in (('alb_lin32', 1 - math.pi / 5.632), ('alb_chk64', 0.5)):
        path = harness.need_shared('own', 'cases', name + '.glb')
        for density in (4, 7.3):
            bake = kiln.bake(path, '--texels-per-metre', density, '--samples-direct', 512, '--samples-bounce', 32,
                             '--samples-indirect', 32, '--denoise', 'none', '--samples-probe', 0)
            if not checks.baked(bake):
                continue
            points = bake.points
            found = float((points.total[:, 1] * points.area).sum() / points.area.sum())
            right = math.pi / (1 - mean)
            checks.that(abs(found / right - 1) < 0.002, '%s at %g texels/m: E %.4f, right %.4f'
                        % (name, density, found, right), bake.process)
            bake.remove()


# ---- lamps ----

HEIGHT, RADIANCE, FLOOR = 1.0, 40.0, 0.5  # m above the floor, W/m2/sr, the floor's albedo


def holes(seed=3):
    return np.where(np.random.default_rng(seed).random((8, 8)) < 0.4, 255, 0)


def spots(size, count, seed=5):
    """Black, but for single texels."""
    picture = np.zeros((size, size, 3), int)
    at = np.random.default_rng(seed).integers(size // 4, size * 3 // 4, (count, 2))
    picture[at[:, 0], at[:, 1]] = 255
    return picture


def grey(alpha):
    return np.dstack([np.full(alpha.shape, 128)] * 3 + [alpha])


SMOOTH = np.random.default_rng(7).integers(40, 256, (6, 5))
# name: side of the lamp, m; emission; its settings; alpha (None: opaque); its settings; mode; strength
LAMPS = {
    'mask': (1, None, {}, holes(), {'filtered': NEAREST}, 'MASK', 1),
    'blend': (1, None, {}, SMOOTH, {}, 'BLEND', 1),
    'picture': (1, noise(16, 16), {}, None, {}, None, 1),
    'masked_picture': (1, noise(16, 16), {}, holes(), {'filtered': NEAREST}, 'MASK', 1),
    'spots': (4, spots(512, 3), {}, None, {}, None, 1e4),
    'spots_nearest': (4, spots(2048, 3), {'filtered': NEAREST}, None, {}, None, 1e4),
    'spots_turned': (4, spots(256, 2), {'rotation': 0.5, 'scale': [1.7, 1.7]}, None, {}, None, 1e4),
    'spots_repeated': (2, spots(64, 1), {'scale': [3, 5], 'wrap': MIRROR}, None, {}, None, 1e3),
    'spots_masked': (4, spots(512, 5), {'filtered': NEAREST}, holes(4), {'filtered': NEAREST}, 'MASK', 1e4),
}


def transformed(s, t, settings):
    """KHR_texture_transform: scale, then rotation."""
    scale, turn = settings.get('scale', (1, 1)), settings.get('rotation', 0.0)
    u, v = s * scale[0], t * scale[1]
    return math.cos(turn) * u + math.sin(turn) * v, -math.sin(turn) * u + math.cos(turn) * v


def look(pixels, u, v, settings):
    """Channels of a picture at (u, v), filtered and wrapped; its colours linear."""
    pixels = np.asarray(pixels)
    value = np.dstack([linear(pixels[:, :, :3]), pixels[:, :, 3:] / 255.0])
    height, width = value.shape[:2]

    def wrapped(i, n):
        if settings.get('wrap') == MIRROR:
            i = i % (2 * n)
            return np.where(i < n, i, 2 * n - 1 - i)
        return i % n

    x, y = u * width, v * height
    if settings.get('filtered', LINEAR) == NEAREST:
        return value[wrapped(np.floor(y).astype(int), height), wrapped(np.floor(x).astype(int), width)]
    left, top = np.floor(x - 0.5).astype(int), np.floor(y - 0.5).astype(int)
    fx, fy = (x - 0.5 - left)[..., None], (y - 0.5 - top)[..., None]
    at = lambda i, j: value[wrapped(j, height), wrapped(i, width)]
    return ((at(left, top) * (1 - fx) + at(left + 1, top) * fx) * (1 - fy) +
            (at(left, top + 1) * (1 - fx) + at(left + 1, top + 1) * fx) * fy)


def lamp_cells(case, across):
    """Places (s, t) on the lamp, and what they send: radiance (green) x share of the area."""
    _, emission, settings, alpha, of_alpha, mode, strength = case
    at, step = [], 256
    for j in range(0, across, step):
        t, s = np.meshgrid((np.arange(j, min(j + step, across)) + 0.5) / across, (np.arange(across) + 0.5) / across,
                           indexing='ij')
        sent = np.full(s.shape, RADIANCE * strength)
        if emission is not None:
            sent = sent * look(emission, *transformed(s, t, settings), settings)[..., 1]
        lit = sent > 0
        s, t, sent = s[lit], t[lit], sent[lit]
        if alpha is not None:
            opacity = look(grey(alpha), *transformed(s, t, of_alpha), of_alpha)[..., 3]
            sent = sent * (np.where(opacity >= 0.5, 1.0, 0.0) if mode == 'MASK' else opacity)
        at.append(np.stack([s, t, sent / across ** 2])[:, sent > 0])
    return np.concatenate(at, 1)


def lamp_right(case):
    """Mean E over the floor of 2 x 2 m, and the power."""
    side, across = case[0], 512 if case[1] is None or len(case[1]) < 64 else 2048
    s, t, sent = lamp_cells(case, across)
    power = math.pi * sent.sum() * side ** 2
    # gathered in squares of the lamp, from whose bright middle the floor is lit
    squares = 64
    index = (t * squares).astype(int) * squares + (s * squares).astype(int)
    weight = np.bincount(index, sent, squares ** 2)
    x, z = (np.bincount(index, sent * c, squares ** 2)[weight > 0] / weight[weight > 0] for c in (s, t))
    weight = weight[weight > 0] * side ** 2
    x, z = (x - 0.5) * side, (z - 0.5) * side
    n = 32
    g = (np.arange(n) + 0.5) / n * 2 - 1
    mean = 0.0
    for fx in g:
        r2 = (x[None, :] - fx) ** 2 + (z[None, :] - g[:, None]) ** 2 + HEIGHT ** 2
        mean += (weight[None, :] * HEIGHT ** 2 / r2 ** 2).sum() / n ** 2
    return mean, power


def lamp_scene(path, case):
    side, emission, settings, alpha, of_alpha, mode, strength = case
    scene = glb.Scene()
    scene.quad('floor', [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], scene.material('floor', (FLOOR,) * 3))
    material = scene.material('lamp', (0, 0, 0), (RADIANCE * strength,) * 3)
    description = scene.document['materials'][material]
    if emission is not None:
        description['emissiveTexture'] = texture(scene, emission, **settings)
    if alpha is not None:
        description['alphaMode'] = mode
        description['pbrMetallicRoughness']['baseColorTexture'] = texture(scene, grey(alpha), **of_alpha)
    h = side / 2
    scene.quad('lamp', [(-h, HEIGHT, -h), (h, HEIGHT, -h), (h, HEIGHT, h), (-h, HEIGHT, h)], material,
               layout=((0, 0), (1, 0), (1, 1), (0, 1)))
    return scene.write(path)


PATHS = ('--samples-indirect', 4, '--bounces', 0, '--method')
METHODS = {'cells': ('--bounces', 0), 'path': (*PATHS, 'path'), 'bdpt': (*PATHS, 'bdpt'), 'vcm': (*PATHS, 'vcm'),
           'radiosity': ('--method', 'radiosity', '--bounces', 1)}


def check_lamp(kiln, checks, name, method):
    case = LAMPS[name]
    path = lamp_scene(os.path.join(kiln.scratch, name + '.glb'), case)
    right, power = RIGHTS.get(name) or RIGHTS.setdefault(name, lamp_right(case))
    bake = kiln.bake(path, '--lightmap-size', 12, '--samples-direct', 256, '--denoise', 'none', '--samples-probe', 0,
                     *METHODS[method])
    if not checks.baked(bake):
        return
    points, of = bake.points, bake.points.of(bake.index('floor'))
    area = points.area[of] / points.area[of].sum()
    found = float((points.direct[of, 1] * area).sum())
    error = float(math.sqrt((np.square(points.error[of] * area)).sum()))
    emitted = bake.run['energy']['emitted'][1]
    checks.that(abs(found - right) < STANDARD_ERRORS * error + 0.004 * right,
                '%s by %s: floor %.4f +- %.4f, right %.4f' % (name, method, found, error, right), bake.process)
    checks.that(error < 0.02 * right, '%s by %s: error %.4f of %.4f' % (name, method, error, right), bake.process)
    checks.that(abs(emitted / power - 1) < 0.005, '%s by %s: %.4f W, right %.4f W' % (name, method, emitted, power),
                bake.process)
    lamps = bake.run['energy']['lamps_with_textures']
    checks.that(abs(lamps['sampled'][1] - emitted) < STANDARD_ERRORS * lamps['error'] + 0.01 * emitted,
                '%s by %s: samples find %s of %.4f W' % (name, method, lamps, emitted), bake.process)
    print('%-16s %-10s E %8.4f right %8.4f (%+.2f %%, error %.2f %%)  W %8.3f right %8.3f'
          % (name, method, found, right, 100 * (found / right - 1), 100 * error / right, emitted, power), flush=True)
    bake.remove()


RIGHTS = {}


def test_lamps(kiln, checks, few):
    for name in ('masked_picture', 'spots') if few else LAMPS:
        check_lamp(kiln, checks, name, 'cells')
    for method in METHODS:
        if method != 'cells' and kiln.backend == 'embree':
            check_lamp(kiln, checks, 'masked_picture', method)
    if few:
        return
    for name, right, power in (('l_mask', 0.404, 7.85), ('l_twin', 0.404, 7.85), ('h_2048_4', 8.704, 62.83)):
        bake = kiln.bake(harness.need_shared('own', 'cases', name + '.glb'), '--lightmap-size', 16, '--samples-direct',
                         64, '--bounces', 0, '--denoise', 'none', '--samples-probe', 0)
        if checks.baked(bake):
            points, of = bake.points, bake.points.of(bake.index('floor'))
            found = float((points.direct[of, 1] * points.area[of]).sum() / points.area[of].sum())
            emitted = bake.run['energy']['emitted'][1]
            checks.that(abs(found / right - 1) < 0.01 and abs(emitted / power - 1) < 0.002,
                        '%s: floor %.4f, right %.4f; %.4f W, right %.4f W' % (name, found, right, emitted, power),
                        bake.process)
            bake.remove()


def test_patches(kiln, checks, _):
    """Lamps as patches: what a mask leaves sends what the same quads send; bright spots are their texels' integral."""
    floors = {}
    for name in ('l_mask', 'l_twin', 'h_2048_4'):
        bake = kiln.bake(harness.need_shared('own', 'cases', name + '.glb'), '--lightmap-size', 24, '--method',
                         'radiosity', '--lights', 'patches', '--bounces', 1, '--denoise', 'none', '--samples-probe', 0)
        if checks.baked(bake):
            points, of = bake.points, bake.points.of(bake.index('floor'))
            floors[name] = float((points.direct[of, 1] * points.area[of]).sum() / points.area[of].sum())
            bake.remove()
            run = bake.process
    if len(floors) == 3:
        checks.that(abs(floors['l_mask'] / floors['l_twin'] - 1) < 2e-3, 'patches: %s' % floors, run)
        # four lamps of 5 mm stand for their texels of 44 cm
        checks.that(abs(floors['h_2048_4'] / 8.704 - 1) < 0.08, 'patches: %s' % floors, run)


# ---- views ----

def view_scene(path, mask):
    """A lamp of quads, or of one with a mask, over a floor and before a wall."""
    cells = np.where(np.random.default_rng(2).random((4, 4)) < 0.5, 255, 0)
    scene = glb.Scene()
    white = scene.material('white', (0.8,) * 3)
    scene.quad('floor', [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], white)
    scene.quad('wall', [(-1, 0, -1), (1, 0, -1), (1, 2, -1), (-1, 2, -1)], white)
    lamp = scene.material('lamp', (0, 0, 0), (10,) * 3)
    if mask:
        scene.document['materials'][lamp]['alphaMode'] = 'MASK'
        scene.document['materials'][lamp]['pbrMetallicRoughness']['baseColorTexture'] = texture(
            scene, grey(cells), NEAREST)
    pieces = [(0, 0, 4)] if mask else [(i, j, 1) for j in range(4) for i in range(4) if cells[j, i]]
    for n, (i, j, side) in enumerate(pieces):
        x, z, w = i / 4 - 0.5, j / 4 - 0.5, side / 4
        scene.quad('lamp%d' % n, [(x, 1, z), (x + w, 1, z), (x + w, 1, z + w), (x, 1, z + w)], lamp,
                   layout=((0, 0), (1, 0), (1, 1), (0, 1)))
    return scene.write(path)


def test_views(kiln, checks, _):
    methods = ('path', 'light', 'bdpt', 'vcm') if kiln.backend == 'embree' else ('path',)
    for method in methods:
        means = []
        for name in ('mask', 'twin'):
            path = view_scene(os.path.join(kiln.scratch, name + '.glb'), name == 'mask')
            picture = os.path.join(kiln.scratch, '%s-%s.exr' % (name, method))
            run = harness.run([kiln.path, 'view', path, '-o', picture, '--quiet', '--method', method, '--backend',
                               kiln.backend, '--width', '32', '--height', '32', '--samples-pixel',
                               '64' if kiln.thin == 1 else '16', '--from', '0,0.7,1.8', '--to', '0,0.6,0',
                               '--field-of-view', '70', '--bounces', '2'])
            if run.status != 0:
                checks.that(False, run.stderr, run)
                return
            green = exr.rgb(picture)[:, :, 1]
            means.append((float(green[:12].mean()), float(green[16:].mean())))
        (lamp, floor), (of_quads, under_quads) = means
        checks.that(abs(lamp / of_quads - 1) < 0.02 and abs(floor / under_quads - 1) < 0.02,
                    'by %s: the lamp %.4f, of quads %.4f; the floor %.4f, %.4f'
                    % (method, lamp, of_quads, floor, under_quads), run)


TESTS = {'albedo': test_albedo, 'furnace': test_furnace, 'lamps': test_lamps, 'patches': test_patches,
         'views': test_views}


def main():
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--only', action='append', choices=TESTS, help='these'),
        lambda p: p.add_argument('--few', action='store_true', help='two lamps, by one method'))
    checks = harness.Checks()
    for name, test in TESTS.items():
        if arguments.only is None or name in arguments.only:
            test(kiln, checks, arguments.few)
    checks.end()


if __name__ == '__main__':
    main()
