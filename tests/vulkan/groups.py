"""--light-groups and --sky-patches on a Vulkan device.

A room with a lamp, a screen that is cut into blocks, a smooth ball, a pane with holes and a sky in patches. Groups
change no bit of the bake, add up to it within 4 standard errors and far less, and are Embree's but for rounding; so at
probes. With --full any number of ranks, small chunks and a device that is lost give the same bits; so does a bake that
keeps its rays, and one that is relit from them traces none.
"""
import os
import sys

import h5py
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi')]
import glb  # noqa: E402
import harness  # noqa: E402
import png  # noqa: E402

OPTIONS = ('--texels-per-metre', 3, '--samples-direct', 16, '--samples-bounce', 16, '--samples-indirect', 64,
           '--samples-probe', 32, '--probe-spacing', 1, '--materials', 'diffuse', '--no-export', '--denoise', 'none',
           '--bounces', 2)
SMALL, SHORT = ('--device-memory', 0.26), {'KILN_DISPATCH_TIME': 1}  # options and variables


def room(path):
    scene = glb.Scene()
    wall = scene.material('wall', (0.7, 0.7, 0.6))
    pane = scene.material('pane', (0.4, 0.5, 0.4))
    screen = scene.material('screen', (0.2, 0.2, 0.2), radiance=(5, 4, 3))
    scene.document['materials'][pane].update(alphaMode='BLEND')
    scene.document['materials'][pane]['pbrMetallicRoughness']['baseColorFactor'][3] = 0.5
    scene.document['images'] = [{'uri': png.data_uri(np.full((4, 4, 3), 255, np.uint8))}]
    scene.document['textures'] = [{'source': 0}]
    scene.document['materials'][screen]['emissiveTexture'] = {'index': 0}
    glb.box(scene, 'room', (0, 0, 0), (2, 2, 3), wall, inward=range(5))
    glb.ball(scene, 'ball', (0.6, 0.4, 0.7), 0.35, scene.material('ball', (0.8, 0.2, 0.2), double_sided=True), rings=8)
    glb.box(scene, 'lamp', (0.8, 1.7, 0.8), (1.2, 1.8, 1.2), scene.material('glow', (0.2, 0.2, 0.2), (5, 4, 3)))
    scene.quad('screen', ((0.3, 0.5, 0.01), (1.7, 0.5, 0.01), (1.7, 1.3, 0.01), (0.3, 1.3, 0.01)), screen,
               layout=((0, 1), (1, 1), (1, 0), (0, 0)))
    scene.quad('pane', ((1.2, 0.2, 1.9), (1.8, 0.2, 1.9), (1.8, 1.2, 1.7), (1.2, 1.2, 1.7)), pane)
    scene.environment((0.5, 0.6, 0.9))
    return scene.write(path)


def read(bake):
    found = {}

    def visit(name, item):
        if isinstance(item, h5py.Dataset):
            found[name] = item[()]
    with h5py.File(os.path.join(bake.directory, 'kiln.h5')) as file:
        file.visititems(visit)
    with h5py.File(os.path.join(bake.directory, 'volume.hdf')) as file:
        file.visititems(lambda name, item: visit('volume/' + name, item))
    return found


def other_bits(found, wanted):
    return sorted(key for key in wanted if key not in found or found[key].tobytes() != wanted[key].tobytes())


def check_sum(checks, found, errors, process):
    total = found['irradiance/total'].astype(float)
    parts = sum(values.astype(float) for key, values in found.items() if key.startswith('groups/'))
    off = np.abs(parts - total)
    checks.that((off @ harness.LUMINANCE <= 4 * errors + 1e-6 * total.mean()).mean() > 0.999,
                'groups do not add up within 4 standard errors', process)
    checks.that(off.max() < 1e-3 * total.mean(), 'groups add up to the bake but for %g of the mean' %
                (off.max() / total.mean()), process)
    probes = found['volume/VTKHDF/PointData/irradiance_sh'].astype(float)
    parts = sum(values[..., :27].astype(float) for key, values in found.items() if key.startswith('volume/groups/'))
    checks.that(np.abs(parts - probes).max() < 1e-3 * np.abs(probes).mean(), 'at probes: by %g of the mean' %
                (np.abs(parts - probes).max() / np.abs(probes).mean()), process)


def check_near(checks, found, wanted, process):
    """A ray that meets the other of two surfaces in one place, and a sample at the edge of a block, may differ."""
    mean, probes = wanted['irradiance/total'].mean(), np.abs(wanted['volume/VTKHDF/PointData/irradiance_sh']).mean()
    checks.that(found.keys() == wanted.keys(), 'other groups than by Embree', process)
    for key in wanted:
        if key.startswith('volume/groups'):
            off = np.abs(found[key].astype(float) - wanted[key]).mean()
            checks.that(off < 1e-3 * probes, '%s: off by %g of the mean' % (key, off / probes), process)
        if not key.startswith('groups'):
            continue
        off = np.abs(found[key].astype(float) - wanted[key]).max(axis=-1)
        checks.that((off > 1e-4 * mean).mean() < 0.01, '%s: %g of the points are not as by Embree' %
                    (key, (off > 1e-4 * mean).mean()), process)
        checks.that(abs(found[key].mean() - wanted[key].mean()) < 1e-4 * mean, '%s: %g on the mean, by Embree %g' %
                    (key, found[key].mean(), wanted[key].mean()), process)


def check_ways(checks, kiln, scene, groups, wanted):
    for what, ranks, options, fault in (('three ranks, small chunks', 3, SMALL, SHORT),
                                        ('rays that are kept, a lost device', 0, ('--keep-transport', 'rows'),
                                         {'KILN_GPU_FAULT': 'lost:150'})):
        with kiln.under(**fault):
            bake = kiln.bake(scene, *OPTIONS, *groups, *options, ranks=ranks)
        if checks.baked(bake):
            off = other_bits(read(bake), wanted)
            checks.that(not off, '%s: other bits: %s' % (what, off[:4]), bake.process)
            checks.that(fault is SHORT or bake.run['backend']['recoveries'] > 0, '%s: not lost' % what, bake.process)
    with kiln.under(**SHORT):
        kept = kiln.bake(scene, *OPTIONS, *SMALL, '--keep-transport', 'rows')
    if not checks.baked(kept):
        return
    folder = os.path.join(kiln.scratch, 'relit')
    process = kiln.command('relight', kept.directory, *groups, '--quiet', '--no-preview', '-o', folder)
    relit = harness.Bake(folder, process)
    if checks.baked(relit):
        off = other_bits(read(relit), wanted)
        checks.that(not off, 'relit: other bits: %s' % off[:4], process)
        checks.that(relit.run['relight']['rays_traced'] == 0, 'relit: %s' % relit.run['relight'], process)


def main():
    def add(p):
        p.add_argument('--full', action='store_true', help='all of it')
    arguments, kiln = harness.start(__doc__, add)
    kiln.backend = 'vulkan'
    checks = harness.Checks()
    scene = room(os.path.join(kiln.scratch, 'room.glb'))
    path = os.path.join(kiln.scratch, 'groups.yaml')
    with open(path, 'w', encoding='utf-8') as file:
        file.write('lamp: {materials: [glow]}\nscreen: {materials: [screen], blocks: [3, 2]}\n')
    groups = ('--light-groups', path, '--sky-patches', 145)
    plain = kiln.bake(scene, *OPTIONS)
    told = kiln.bake(scene, *OPTIONS, *groups)
    if not all(map(checks.baked, (plain, told))):
        checks.end()
    wanted = read(told)
    checks.that(told.run['backend']['name'] == 'vulkan' and 'gather of groups' in told.run['backend']['kernels'],
                'not on the device: %s' % told.run['backend'], told.process)
    checks.that(sum(key.startswith('groups/') for key in wanted) == 1 + 6 + 145 + 2, 'groups: %s' % sorted(wanted))
    checks.that(not other_bits(wanted, read(plain)), 'groups change %s' % other_bits(wanted, read(plain)), told.process)
    check_sum(checks, wanted, told.points.error, told.process)
    if arguments.full:
        check_ways(checks, kiln, scene, groups, wanted)
    kiln.backend = 'embree'
    embree = kiln.bake(scene, *OPTIONS, *groups)
    if checks.baked(embree):
        check_near(checks, wanted, read(embree), told.process)
    checks.end()


if __name__ == '__main__':
    main()
