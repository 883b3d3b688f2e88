"""No kernel leaves its buffers, and none uses what was never written: bakes with guarded buffers (KILN_VULKAN_GUARD,
see worker/backend/vulkan/gpu/gpu.h) come to their end, with the same bits as without. The cases run every kernel of a
bake of diffuse surfaces, in every layout of the BVH, with every kind of light, with and without alpha and glass, smooth
normals, points that are partly buried, groups of lights and kept rows. Of whole materials there is water only: a
software device takes more than ten minutes to make the kernels of rough glass. On such a device only; all else is
skipped.
"""
import concurrent.futures
import hashlib
import os
import sys

import h5py

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'analytic'))
import glass  # noqa: E402
import harness  # noqa: E402
import same_bits  # noqa: E402

# More than one slice of a probe's samples, quarters that differ by a sample, choices of lights with few samples and
# with many.
OPTIONS = ('--quality', 'draft', '--samples-direct', 19, '--samples-indirect', 21, '--samples-probe', 18)
BOUNCE = ('--samples-bounce', 4)  # which patches have none of
# What is kept changes no bit of it.
RADIOSITY = ('--texels-per-metre', 1, '--method', 'radiosity', '--lights', 'patches', '--bounces', 2)
SKY = 'sky.hdr'
GLASS = 'glass.glb'  # made when wanted
WATER = 'cornell_water.glb'
GROUPS = 'groups.yaml'
CASES = (  # scene, options of all its bakes, guarded bakes: guard, ranks, more options and variables
    ('two_rooms.glb', ('--texels-per-metre', 2), (('after', 0, ()), ('after', 2, ('KILN_DISPATCH_TIME=1',)))),
    ('two_rooms.glb', ('--texels-per-metre', 2, '--guide', 'auto', '--bounces', 3),
     (('after', 0, ('KILN_DISPATCH_TIME=1',)), ('before', 0, ()))),
    ('cornell.glb', ('--texels-per-metre', 3),
     (('before', 0, ('KILN_TRAVERSAL=four',)), ('after', 0, ('--verify-fraction', 0.2)))),
    ('penumbra_alphamask.glb', ('--lightmap-max', 16, '--environment', SKY), (('after', 0, ('KILN_TRAVERSAL=four',)),)),
    ('cornell.glb', RADIOSITY, (('after', 0, ('--visibility-cache', 4e-5)), ('before', 2, ('--visibility-cache', 1)))),
    ('punctual_zoo.glb', ('--lightmap-max', 12, '--environment', '0.1,0.2,0.3'), (('after', 0, ()),)),
    ('textured_emitter.glb', ('--lightmap-max', 16), (('after', 0, ()),)),
    ('many_lights.glb', ('--lightmap-max', 4), (('after', 0, ()),)),
    (GLASS, ('--lightmap-size', 6, '--environment', '0.1,0.2,0.3', '--materials', 'diffuse'),
     (('after', 2, ()), ('before', 0, ('KILN_TRAVERSAL=eight',)))),
    ('punctual_zoo.glb', ('--lightmap-max', 12, '--environment', '0.1,0.2,0.3', '--light-groups', GROUPS,
                          '--keep-transport', 'rows'), (('after', 0, ()), ('before', 2, ()))),
    (WATER, ('--lightmap-max', 6), (('after', 0, ()),)),
)


def scene_path(kiln, name):
    if name == GLASS:
        return glass.all_kinds(os.path.join(kiln.scratch, name))
    places = (os.path.join(harness.REPOSITORY, 'jobs'), harness.DATA, os.path.join(harness.DATA, 'analytic'))
    places = (*places, os.path.join(harness.SHARED, 'own'))
    return next((os.path.join(p, name) for p in places if os.path.exists(os.path.join(p, name))), None)


def write_sky(path, width=12, height=6):
    """A Radiance image that is bright in one place."""
    pixels = bytearray((40, 60, 90, 128) * (width * height))
    pixels[4 * (width + 3):4 * (width + 4)] = bytes((200, 180, 150, 133))
    with open(path, 'wb') as f:
        f.write(b'#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n' % (height, width) + pixels)


def software_device(kiln):
    found = [d for d in kiln.command('info', '--devices', '--json', '--quiet').json()['vulkan'] if d['software']
             and d['fit']]
    if not found:
        harness.skip('there is no software Vulkan device here.')
    return found[0]['device']


def bits(bake):
    """{what: hash} of points, lightmaps and the volume."""
    found = same_bits.bits(bake)
    with h5py.File(os.path.join(bake.directory, 'volume.hdf'), 'r') as f:
        for name, data in f['VTKHDF/PointData'].items():
            found['volume ' + name] = hashlib.sha256(data[...].tobytes()).hexdigest()
    return found


def run_case(kiln, checks, device, case):
    name, options, ways = case
    options = OPTIONS + (() if options == RADIOSITY else BOUNCE) + tuple(
        os.path.join(kiln.scratch, o) if o in (SKY, GROUPS) else o
        for o in options) + ('--device', device, '--threads', 1)
    if SKY in case[1]:
        write_sky(os.path.join(kiln.scratch, SKY))
    if GROUPS in case[1]:
        with open(os.path.join(kiln.scratch, GROUPS), 'w', encoding='utf-8') as f:
            f.write('sun: {lights: [sun]}\npoints: {lights: ["pt*"]}\n')
    scene = scene_path(kiln, name)
    if scene is None:
        print('%s is not here' % name, flush=True)
        return
    kiln.environment['KILN_VULKAN_GUARD'] = '0'
    plain = kiln.bake(scene, *options)
    if not checks.baked(plain):
        return
    wanted = bits(plain)
    for guard, ranks, more in ways:
        variables = dict(o.split('=') for o in map(str, more) if o.startswith('KILN_'))
        kiln.environment.update(variables, KILN_VULKAN_GUARD=guard)
        bake = kiln.bake(scene, *options, *(o for o in more if str(o).split('=')[0] not in variables), ranks=ranks)
        for name_of in variables:
            del kiln.environment[name_of]
        if not checks.baked(bake):
            continue
        found = bits(bake)
        other = [k for k in wanted if found.get(k) != wanted[k]]
        checks.that(not other, '%s, guarded %s %s: other bits in %s' % (name, guard, more, ', '.join(other)),
                    bake.process)
        print('%-24s %-6s %d %-28s %.1f s, without guard %.1f s' %
              (name, guard, ranks, ' '.join(map(str, more)), bake.process.seconds,
                                                                    plain.process.seconds), flush=True)


def main():
    arguments, kiln = harness.start(__doc__)
    device, checks = software_device(kiln), harness.Checks()
    folders = [os.path.join(kiln.scratch, str(i)) for i in range(len(CASES))]
    for folder in folders:
        os.makedirs(folder, exist_ok=True)
    # a bake this small compiles shaders most of the time, on one core
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda folder, case: run_case(harness.Kiln(arguments.kiln, folder, 'vulkan'), checks, device,
                                                    case), folders, CASES))
    checks.end()


if __name__ == '__main__':
    main()
