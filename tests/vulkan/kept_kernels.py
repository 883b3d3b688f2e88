"""Kernels that were compiled for a device are found by the runs that follow.

- The first bake finds none and leaves a file for each kernel that it compiles, and one empty mark of its kind
  (coordinator/files/kernel_cache.h), which the next one leaves as it is.
- The next one finds them, but for a truncated file, one with a changed byte, and another kernel's file in the place of
  one: these kernels are compiled, and their files are whole again.
- Both have the same bits, though the kernels of the second are made by threads beside the loading of the scene
  (KILN_KERNEL_MAKERS), as those of a GPU are: run.json and the timeline say when that was.
- Either way run.json names the five that took longest.

Mesa's lavapipe gives the head of a cache alone, so how much is gained is not seen here.
"""
import json
import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), HERE]
import harness  # noqa: E402
from same_bits import bits  # noqa: E402

SCENE = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
FEW = ('--samples-direct', 4, '--samples-bounce', 2, '--samples-indirect', 8, '--samples-probe', 0, '--bounces', 1,
       '--texels-per-metre', 1, '--no-export', '--denoise', 'none')


def read(path):
    with open(path, 'rb') as f:
        return f.read()


def contents(folder, suffix):
    return {name: read(os.path.join(folder, name)) for name in sorted(os.listdir(folder)) if name.endswith(suffix)}


def write(path, data):
    with open(path, 'wb') as f:
        f.write(data)


def damage(folder, files):
    """Three files that are not whole, of as many kinds."""
    truncated, changed, foreign, other = sorted(files)[:4]
    write(os.path.join(folder, truncated), files[truncated][:-3])
    write(os.path.join(folder, changed), files[changed][:-1] + bytes([files[changed][-1] ^ 1]))
    write(os.path.join(folder, foreign), files[other])
    return 3


def check_slowest(checks, b):
    slowest = b.run['beside_loading']['kernels']['slowest']
    seconds = [kernel['seconds'] for kernel in slowest]
    checks.that(len(slowest) == 5 and min(seconds) > 0 and seconds == sorted(seconds, reverse=True),
                'seconds of the slowest: %s' % slowest, b.process)
    made = {(kernel['name'], tuple(kernel['constants'])) for kernel in slowest}
    checks.that(len(made) == 5 and all(len(constants) >= 14 for _, constants in made) and
                {name for name, _ in made} <= set(b.run['backend']['kernels']), 'the slowest: %s' % slowest, b.process)


def check_loading(checks, b, timeline):
    loading = b.run['beside_loading']
    device, kernels = loading['device'], loading['kernels']
    checks.that(0 < device['seconds'] and device['waited_seconds'] <= device['seconds'] and kernels['count'] >= 5 and
                kernels['seconds'] > 0 and loading['first_pass_after'] > 0 and
                0 <= loading['bvh']['waited_seconds'] <= loading['bvh']['seconds'],
                'beside_loading: %s' % loading, b.process)
    with open(timeline) as f:
        names = [event['name'] for event in json.load(f)['traceEvents'] if event.get('cat') == 'beside the loading']
    checks.that(names == ['start of the device', 'BVH', 'kernels'], 'in the timeline: %s' % names)


def main():
    _, kiln = harness.start(__doc__)
    checks, kiln.backend, folder = harness.Checks(), 'vulkan', os.path.join(kiln.scratch, 'some', 'kernels')
    wanted, timeline = None, os.path.join(kiln.scratch, 'timeline.json')

    def bake(what, kernels, found, compiled):
        """`found` and `compiled`: how many kernels; None: any number but none."""
        nonlocal wanted
        kiln.kernels = kernels
        b = kiln.bake(SCENE, *FEW, '--trace', timeline)
        if not checks.baked(b):
            checks.end()
        backend = b.run['backend']
        for name, number in (('kernels_kept', found), ('kernels_compiled', compiled)):
            right = backend[name] > 0 if number is None else backend[name] == number
            checks.that(right, '%s: %s is %d' % (what, name, backend[name]), b.process)
        check_slowest(checks, b)
        wanted = wanted or bits(b)
        checks.that(bits(b) == wanted, what + ': other bits', b.process)
        if 'KILN_KERNEL_MAKERS' in kiln.environment:
            check_loading(checks, b, timeline)
        b.remove()
        return backend['kernels_compiled']

    count = bake('first', folder, 0, None)
    files, marks = contents(folder, '.kernel'), contents(folder, '.kind')
    checks.that(len(files) == count, '%d files of %d kernels' % (len(files), count))
    checks.that(list(marks.values()) == [b''] and len(os.listdir(folder)) == count + 1,
                'other files: %s' % os.listdir(folder))
    damaged = damage(folder, files)
    kiln.environment['KILN_KERNEL_MAKERS'] = 'all'
    bake('second', folder, count - damaged, damaged)
    checks.that(contents(folder, '.kernel') == files, 'damaged files were not replaced')
    checks.that(contents(folder, '.kind') == marks, 'other marks: %s' % os.listdir(folder))
    checks.end()


if __name__ == '__main__':
    main()
