"""Whether two builds of kiln bake the same values: to be run around a change that should not change any result.

    same_bytes.py BEFORE AFTER [--set quick|full] [--backend embree|vulkan] [--ranks 1,3]

Every scene is baked with both programs. Datasets of kiln.h5 and volume.hdf and channels of lightmaps are compared bit
by bit, however they are compressed, and the preview as a file; attributes of HDF5 files and run.json, which name
versions and times, are not. Prints a line a bake; exits with 1 when any differs. `full` takes all analytic scenes,
those with references, the Cornell box, a city, Sponza and the interiors beside the repository.
"""
import argparse
import glob
import hashlib
import os
import subprocess
import sys
import tempfile

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import exr  # noqa: E402
import harness  # noqa: E402

DRAFT = ['--quality', 'draft', '--bounces', '3', '--samples-direct', '16', '--samples-bounce', '16',
         '--samples-indirect', '16', '--samples-probe', '16', '--quiet']
SMALL = ['--lightmap-max', '48']
# Third-party scenes: texels a metre that give some 10,000 points.
OTHERS = {'crytek_sponza.glb': 0.5, 'dining_room.glb': 4, 'classroom.glb': 3, 'veach_ajar.glb': 3, 'godot_room.glb': 3}
# Ways of a bake that take code of their own, on one scene: every option that changes what is computed.
WAYS = [['--schedule', 'equal'], ['--exchange', 'full'], ['--exchange', 'compact'], ['--bounces', 'all'],
        ['--partition', 'objects'], ['--error-map'], ['--half'], ['--guide', 'auto'], ['--environment', '0.3,0.4,0.5']]


def scenes(which, folder, kiln):
    """Pairs of a scene's path and the options it is baked with."""
    cornell = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
    yield cornell, ['--texels-per-metre', '8']
    for name in ('many_lights', 'punctual_zoo', 'two_rooms'):
        yield harness.own_scene(name + '.glb'), SMALL
    if which == 'quick':
        return
    for way in WAYS:
        yield cornell, ['--texels-per-metre', '5', *way]
    city = os.path.join(folder, 'city.glb')
    subprocess.run([kiln, 'generate', 'city', '--triangles', '20000', '-o', city], check=True,
                   stderr=subprocess.DEVNULL)
    yield city, ['--lightmap-max', '16']
    for path in sorted(glob.glob(os.path.join(harness.DATA, 'analytic', '*.glb'))):
        yield path, SMALL
    for path in sorted(glob.glob(os.path.join(harness.SHARED, 'own', 'features', '*.glb'))):
        yield path, SMALL
    for name, density in OTHERS.items():
        path = os.path.join(harness.SHARED, 'third_party', name)
        if os.path.exists(path):
            yield path, ['--texels-per-metre', str(density)]


def hashes(folder):
    """What a bake left: names and hashes of values."""
    found = {}
    for name in ('kiln.h5', 'volume.hdf'):
        path = os.path.join(folder, name)
        if not os.path.exists(path):
            continue
        with h5py.File(path) as file:
            def add(where, item, name=name):
                if isinstance(item, h5py.Dataset):
                    values = item[()]
                    data = repr(values).encode() if item.dtype.kind == 'O' else np.ascontiguousarray(values).tobytes()
                    found[name + '/' + where] = hashlib.md5(data).hexdigest()
            file.visititems(add)
    for path in glob.glob(os.path.join(folder, '**', '*.exr'), recursive=True):
        channels, attributes = exr.read(path)
        found[os.path.relpath(path, folder)] = hashlib.md5(repr(sorted(attributes.items())).encode()).hexdigest()
        for name, values in channels.items():
            found[os.path.relpath(path, folder) + ':' + name] = hashlib.md5(values.tobytes()).hexdigest()
    for path in glob.glob(os.path.join(folder, '*.png')):
        with open(path, 'rb') as file:
            found[os.path.relpath(path, folder)] = hashlib.md5(file.read()).hexdigest()
    return found


def bake(kiln, scene, folder, options, ranks):
    command = [kiln, 'bake', scene, '-o', folder, *DRAFT, *options]
    if ranks > 1:
        command = ['mpirun', '-n', str(ranks), *command]
    done = subprocess.run(command, env={**harness.MPI_ENVIRONMENT, **os.environ}, stdin=subprocess.DEVNULL,
                          capture_output=True, text=True)
    return (done.returncode, hashes(folder) if done.returncode == 0 else done.stderr.strip())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('before')
    parser.add_argument('after')
    parser.add_argument('--set', choices=('quick', 'full'), default='quick')
    parser.add_argument('--backend', default='embree')
    parser.add_argument('--ranks', default='1', help='numbers of ranks of AFTER; BEFORE always runs on one')
    arguments = parser.parse_args()
    differing = bakes = 0
    with tempfile.TemporaryDirectory() as folder:
        for count, (scene, options) in enumerate(scenes(arguments.set, folder, arguments.before)):
            options = [*options, '--backend', arguments.backend]
            before = bake(arguments.before, scene, os.path.join(folder, 'before%d' % count), options, 1)
            for ranks in map(int, arguments.ranks.split(',')):
                place = os.path.join(folder, 'after%d_%d' % (count, ranks))
                after = bake(arguments.after, scene, place, options, ranks)
                bakes += 1
                if before[0] == 0 and after[0] == 0:
                    names = sorted(set(before[1]) | set(after[1]))
                    off = [n for n in names if before[1].get(n) != after[1].get(n)]
                    print('%-28s %d ranks  %3d arrays and files, %d differ  %s' % (
                        os.path.basename(scene), ranks, len(names), len(off), ' '.join(off[:4])), flush=True)
                    differing += bool(off)
                else:
                    print('%-28s %d ranks  ended with %d and %d' % (
                        os.path.basename(scene), ranks, before[0], after[0]), flush=True)
                    differing += before[0] != after[0]
    print('%d of %d bakes differ' % (differing, bakes))
    sys.exit(differing > 0)


if __name__ == '__main__':
    main()
