"""Methods that share no more than the scene come to the same light, within 5 standard errors, which several seeds tell.

    agreement.py --kiln PATH views     pictures by path, bdpt, vcm and sppm: means, and means of 16 blocks
    agreement.py --kiln PATH texels    caustics in texels by gather, land, merge and vcm: power on each object, and on
                                       all

Without --full one scene, with few samples; --full: the six scenes of SCENES and SmallVCM's four. --scene NAME: that one
(several times: those), as in --full. A table has each mean with its standard error, and how far the two methods that
agree least are from each other.
"""
import collections
import itertools
import os
import sys

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import exr  # noqa: E402
import harness  # noqa: E402
import small_vcm  # noqa: E402

LIMIT, SEEDS = 5.0, 6  # standard errors
PIXELS, BLOCKS = 32, 4  # along a side
METHODS, WAYS = ('path', 'bdpt', 'vcm', 'sppm'), ('gather', 'land', 'merge', 'vcm')
# Nothing that begins at the eye, or at a texel, meets a lamp without extent: path and gather lack what it sends by
# mirrors and glass. bdpt lacks that where it is seen in a mirror or through glass; `matt` says of positions (n, 3)
# which show all of it. Radius: of merging in views, m, small enough for its bias to stay below the noise. Density:
# texels/m.
Scene = collections.namedtuple('Scene', 'file options lamps_have_extent matt radius density')


def everywhere(position):
    return np.ones(len(position), bool)


def beside_balls(position):
    """Surfaces of SmallVCM's scenes with small balls that are no ball's: these stand on the floor."""
    floor, third = small_vcm.LOW[1], 2.0 * (small_vcm.HIGH[0] - small_vcm.LOW[0]) / 7.0
    middle = (small_vcm.LOW[2] + small_vcm.HIGH[2]) / 2
    centres = [(x, floor + small_vcm.SMALL, middle) for x in (small_vcm.LOW[0] + third, small_vcm.HIGH[0] - third)]
    return np.min([np.linalg.norm(position - c, axis=1) for c in centres], axis=0) > 1.02 * small_vcm.SMALL


def level(position):
    """Floor and ceiling of `kiln generate mirrors`, a room 2 m high whose walls are mirrors."""
    return (position[:, 1] < 1e-3) | (position[:, 1] > 2 - 1e-3)


def scene_of(file=None, options=(), lamps_have_extent=True, matt=everywhere, radius=0.02, density=2):
    return Scene(file, options, lamps_have_extent, matt, radius, density)


SCENES = {'cornell-spheres': scene_of(), 'cornell-water': scene_of(),
          'mirrors': scene_of(lamps_have_extent=False, matt=level), 'prism': scene_of(lamps_have_extent=False),
          'veach_ajar': scene_of('veach_ajar.glb', radius=0.06),
          'dining_room': scene_of('dining_room.glb', radius=0.06)}
SCENES.update({'smallvcm-' + name: scene_of(options=small_vcm.CAMERA, radius=radius)
               for name, radius in (('lamp', 0.01), ('sky', 0.04))})
SCENES.update({'smallvcm-' + name: scene_of(options=small_vcm.CAMERA, lamps_have_extent=False, matt=beside_balls)
               for name in ('sun', 'point')})


def path_of(kiln, name):
    """The file of a scene, written or generated on first use."""
    if SCENES[name].file is not None:
        return os.path.join(harness.SHARED, 'third_party', SCENES[name].file)
    path = os.path.join(kiln.scratch, name + '.glb')
    if not os.path.exists(path):
        if name.startswith('smallvcm-'):
            small_vcm.write(path, name.split('-')[1])
        else:
            kiln.command('generate', name, '-o', path, '--quiet')
    return path


def compare(checks, what, found, enough):
    """`found`: {method: array (seeds, quantities)}, the first quantity being the mean of all, which has to be known to
    `enough` of itself; by sppm, which is noisy in small pictures, to three times that. Each two agree in each quantity.
    Standard errors of the quantities after the first come from few values each: their own mean square holds them up.
    """
    means, errors = {}, {}
    for method, values in found.items():
        variance = values.var(0, ddof=1) / len(values)
        variance[1:] = (variance[1:] + variance[1:].mean()) / 2
        means[method], errors[method] = values.mean(0), np.sqrt(variance)
    worst = []
    for one, other in itertools.combinations(found, 2):
        error = np.hypot(errors[one], errors[other])
        off = np.where(error > 0, np.abs(means[one] - means[other]) / np.maximum(error, 1e-30), 0)
        worst.append((off.max(), off[0], one, other))
        checks.that(off.max() < LIMIT, '%s: %s and %s differ by %.1f standard errors of all light and by %.1f of a part'
                    % (what, one, other, off[0], off[1:].max()))
    for method in found:
        known = errors[method][0] / means[method][0]
        checks.that(known < (3 if method == 'sppm' else 1) * enough, '%s: the mean by %s, %.4g, is only known to %.3f' %
                    (what, method, means[method][0], known))
    print('%-16s' % what, *('%s %.4g +- %.2g' % (method, means[method][0], errors[method][0]) for method in found),
          '| %.1f of all, %.1f of a part: %s, %s' % (max(w[1] for w in worst), *max(worst)[:1], *max(worst)[2:]),
          sep='  ', flush=True)


# ---- views ----

def picture(kiln, name, method, samples, seed, *more):
    scene, out = SCENES[name], os.path.join(kiln.scratch, 'view.exr')
    merged = ('--merge-radius', scene.radius) if method in ('vcm', 'sppm') else ()
    process = kiln.command('view', path_of(kiln, name), '--backend', kiln.backend, '--method', method, '--materials',
                           'auto', '--samples-pixel', samples, '--seed', seed, '--width', PIXELS, '--height', PIXELS,
                           '-o', out, '--quiet', *scene.options, *merged, *more)
    assert process.status == 0, process.line() + '\n' + process.stderr
    return exr.read(out).channels


def matt_pixels(kiln, name):
    """Those that see only surfaces on which bdpt finds all light: by several samples of each."""
    layers = picture(kiln, name, 'path', 16, 0, '--aov', '--width', 4 * PIXELS, '--height', 4 * PIXELS)
    position = np.stack([layers['position.' + axis] for axis in 'XYZ'], -1).reshape(-1, 3)
    seen = SCENES[name].matt(position).reshape(PIXELS, 4, PIXELS, 4)
    return seen.all((1, 3))


def blocks(light, mask):
    """The mean of the pixels in the mask, and those of the blocks that have some."""
    side = PIXELS // BLOCKS
    cut = lambda a: a.reshape(BLOCKS, side, BLOCKS, side).swapaxes(1, 2).reshape(BLOCKS**2, -1)
    count, total = cut(mask).sum(1), cut(light * mask).sum(1)
    return np.append(total.sum() / count.sum(), total[count > side] / count[count > side])


def try_views(checks, kiln, names, full):
    samples = dict(zip(METHODS, (256, 48, 48, 64) if full else (64, 8, 8, 8)))
    for name in names:
        length = ('--path-length', 10 if full else 5) if name.startswith('smallvcm-') else ('--bounces', 2)
        every = np.ones((PIXELS, PIXELS), bool)
        complete = METHODS if SCENES[name].lamps_have_extent else ('vcm', 'sppm')
        light = {method: [np.stack([layers[c] for c in 'RGB'], -1) @ harness.LUMINANCE for layers in
                          (picture(kiln, name, method, samples[method], seed, *length) for seed in range(SEEDS))]
                 for method in METHODS[1 if complete != METHODS else 0:]}
        compare(checks, name, {m: np.array([blocks(l, every) for l in light[m]]) for m in complete}, 0.04)
        if complete != METHODS:
            mask = matt_pixels(kiln, name)
            compare(checks, name + ', matt', {m: np.array([blocks(l, mask) for l in light[m]]) for m in light}, 0.04)


# ---- texels ----

def powers(kiln, name, way, samples, seed, full):
    """Power of caustics, W by luminance: of all, and on each object."""
    photons = {'land': (samples, 4), 'merge': (samples, 4), 'vcm': (samples // 2, 4)}.get(way)
    options = ('--photons', photons[0], '--iterations', photons[1]) if photons else ()
    rays = {'gather': 2048 if full else 512, 'vcm': 64}.get(way, 4)
    bake = kiln.bake(path_of(kiln, name), '--texels-per-metre', SCENES[name].density, '--materials', 'auto',
                     '--caustics', way, '--bounces', 0, '--samples-probe', 0, '--denoise', 'none', '--samples-direct',
                     4, '--samples-bounce', 2, '--samples-indirect', rays, '--seed', seed, '--no-preview',
                     '--no-export', *options)
    assert bake.process.status == 0, bake.process.line() + '\n' + bake.process.stderr
    with h5py.File(os.path.join(bake.directory, 'kiln.h5')) as file:
        power = file['irradiance/caustic'][...] @ harness.LUMINANCE * file['points/area'][...]
        objects = file['points/object'][...]
    bake.remove()
    return np.append(power.sum(), np.bincount(objects, power))


def try_texels(checks, kiln, names, full):
    for name in names:
        ways = WAYS if SCENES[name].lamps_have_extent else WAYS[1:]
        samples = 100000 if full else 20000
        found = {way: np.array([powers(kiln, name, way, samples, seed, full) for seed in range(SEEDS)])
                 for way in ways}
        compare(checks, name, found, 0.1)


PARTS = {'views': (try_views, ['smallvcm-lamp']), 'texels': (try_texels, ['smallvcm-sky'])}


def main():
    arguments, kiln = harness.start(
        __doc__, lambda parser: parser.add_argument('part', choices=sorted(PARTS)),
        lambda parser: parser.add_argument('--full', action='store_true', help='every scene, with more samples'),
        lambda parser: parser.add_argument('--scene', action='append', choices=sorted(SCENES), help='this scene'))
    checks, (attempt, few) = harness.Checks(), PARTS[arguments.part]
    names = arguments.scene or (list(SCENES) if arguments.full else few)
    for name in list(names):
        if SCENES[name].file is not None and not os.path.exists(path_of(kiln, name)):
            print('%s is not in ../shared/scenes/third_party: left out' % name)
            names.remove(name)
    attempt(checks, kiln, names, arguments.full or arguments.scene is not None)
    checks.end()


if __name__ == '__main__':
    main()
