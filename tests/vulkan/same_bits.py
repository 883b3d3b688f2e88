"""The Vulkan backend gives the same bits whatever the size of its dispatches, the memory it may use, the layout of the
BVH and the number of ranks, on one kind of device; and after the device was lost or short of memory. One that cannot be
made anew ends the bake with 69 and a sentence.
"""
import hashlib
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

OPTIONS = ('--samples-direct', 64, '--samples-bounce', 4, '--samples-indirect', 24, '--samples-probe', 16)
WAYS = (  # name, ranks, options, environment: what --full does on every scene
    ('dispatches of 1 ms', 0, (), {'KILN_DISPATCH_TIME': '1'}),
    ('dispatches of 1 s', 0, (), {'KILN_DISPATCH_TIME': '1000'}),
    ('verified', 0, ('--verify-fraction', 0.2), {}),
    ('little memory', 0, ('--device-memory', 0.26), {}),
    ('four-wide BVH', 0, (), {'KILN_TRAVERSAL': 'four'}),
    ('four-wide BVH built on the device', 0, (), {'KILN_TRAVERSAL': 'four', 'KILN_TREE': 'device'}),
    ('eight-wide BVH built on the device', 0, (), {'KILN_TREE': 'device'}),
    ('2 ranks', 2, (), {}),
    ('3 ranks, dispatches of 2 ms', 3, (), {'KILN_DISPATCH_TIME': '2'}),
    ('lost', 0, (), {'KILN_GPU_FAULT': 'lost:150'}),
    ('lost later', 0, (), {'KILN_GPU_FAULT': 'lost:300'}),
    ('short of memory', 0, (), {'KILN_GPU_FAULT': 'memory:120'}),
)
# Without --full: several ways at once, each once, on the scene named. Bits have to stay, so one bake may vary as much
# as it likes; on a software device it takes four seconds to compile kernels and hardly any to bake.
CORNELL, LIGHTS, SIDES = 'cornell', 'lights', 'sides'
SOME = (
    (SIDES, '1 ms, four-wide BVH, short of memory', 0, (),
     {'KILN_DISPATCH_TIME': '1', 'KILN_GPU_FAULT': 'memory:120', 'KILN_TRAVERSAL': 'four'}),
    (SIDES, 'verified, little memory, four-wide BVH built on the device', 0,
     ('--verify-fraction', 0.2, '--device-memory', 0.26), {'KILN_TREE': 'device', 'KILN_TRAVERSAL': 'four'}),
    (SIDES, '2 ranks, lost, dispatches of 1 ms', 2, (), {'KILN_DISPATCH_TIME': '1', 'KILN_GPU_FAULT': 'lost:150'}),
)


def bits(bake):
    """{what: hash} of all that is a result: points by object and texel, and lightmaps."""
    p = bake.points
    order = np.lexsort((p.x, p.y, p.side, p.object))
    found = {n: hashlib.sha256(np.ascontiguousarray(getattr(p, n)[order]).tobytes()).hexdigest()
             for n in ('direct', 'indirect', 'total', 'error', 'valid')}
    for name in bake.names():
        found[name] = hashlib.sha256(np.ascontiguousarray(bake.lightmap(name).irradiance).tobytes()).hexdigest()
    return found


def try_scene(checks, kiln, path, options, ways):
    """Bakes in each way, with the same bits as in none."""
    first = kiln.bake(path, *options)
    if not checks.baked(first):
        return
    wanted, scene = bits(first), os.path.basename(path)
    for name, ranks, more, environment in ways:
        kiln.environment.update(environment)
        bake = kiln.bake(path, *options, *more, ranks=ranks)
        for key in environment:
            del kiln.environment[key]
        if not checks.baked(bake):
            continue
        found = bits(bake)
        other = [k for k in wanted if found.get(k) != wanted[k]]
        checks.that(not other, '%s, %s: other bits in %s' % (scene, name, ', '.join(other)), bake.process)
        compared = bake.run['backend']['verified_texels']
        checks.that((compared > 0) == ('--verify-fraction' in more), '%s: %d texels were compared' % (name, compared),
                    bake.process)
        if 'KILN_GPU_FAULT' in environment:
            checks.that(bake.run['backend']['recoveries'] > 0, '%s: nothing was recovered from' % name, bake.process)
        print('%-18s %-36s %.1f s' % (scene, name, bake.process.seconds), flush=True)
        bake.remove()


def main():
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--full', action='store_true', help='every way, on every scene'))
    kiln.backend = 'vulkan'
    kiln.environment['KILN_VULKAN_VALIDATION'] = os.environ.get('KILN_VULKAN_VALIDATION', '1')
    checks = harness.Checks()
    cornell = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
    for scene, path, density in ((CORNELL, cornell, 4), (LIGHTS, harness.own_scene('punctual_zoo.glb'), 2),
                                 (SIDES, glb.partition_room(os.path.join(kiln.scratch, 'two_sides.glb'), False), 2)):
        ways = WAYS if arguments.full else [w[1:] for w in SOME if w[0] == scene]
        if ways:
            try_scene(checks, kiln, path, OPTIONS + ('--texels-per-metre', density), ways)
    for fault in ('lost:150:1', 'memory:120:1') if arguments.full else ('lost:150:1',):
        kiln.environment['KILN_GPU_FAULT'] = fault
        bake = kiln.bake(path, *OPTIONS, '--texels-per-metre', 2)  # its kernels are compiled already
        said = bake.process.sentence()
        checks.that(bake.process.status == harness.NO_DEVICE and 'made anew 3 times without success' in said,
                    '%s: ended with %d: %s' % (fault, bake.process.status, said), bake.process)
        bake.remove()
    checks.end()


if __name__ == '__main__':
    main()
