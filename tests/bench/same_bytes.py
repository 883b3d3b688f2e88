"""Whether two builds of kiln bake the same values: to be run around a change that should not change any result.

    same_bytes.py BEFORE AFTER [--set quick|full] [--backend embree|vulkan] [--ranks 1,3] [--record FILE]
                  [--only TEXT]

Every scene is baked with both programs; --record keeps what BEFORE gave, for the next time. Datasets of kiln.h5 and
volume.hdf and channels of lightmaps are compared bit by bit, however they are compressed, and the preview chunk by
chunk; what names versions and times is not: attributes of HDF5 files, run.json, the version in lightmaps and texts in
the preview. Prints a line a bake; exits with 1 when any differs. `full` takes all analytic scenes, those with
references, the Cornell box, a city, Sponza and the interiors beside the repository.
"""
import argparse
import glob
import hashlib
import json
import os
import subprocess
import sys
import tempfile

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import exr  # noqa: E402
import harness  # noqa: E402

DRAFT = ['--quality', 'draft', '--bounces', '3', '--samples-direct', '16', '--samples-probe', '16', '--quiet']
GATHER = ['--samples-bounce', '16', '--samples-indirect', '16'] # of methods that have them
SMALL = ['--lightmap-max', '48']
# Third-party scenes: texels a metre that give some 10,000 points.
OTHERS = {'crytek_sponza.glb': 0.5, 'dining_room.glb': 4, 'classroom.glb': 3, 'veach_ajar.glb': 3, 'godot_room.glb': 3}
# Ways of a bake that take code of their own, on one scene: every option that changes what is computed.
WAYS = [['--schedule', 'equal'], ['--exchange', 'full'], ['--exchange', 'compact'], ['--bounces', 'all'],
        ['--partition', 'objects'], ['--error-map'], ['--half'], ['--guide', 'auto'], ['--environment', '0.3,0.4,0.5'],
        ['--target-error', '0.1'], ['--indirect-scale', '2'], ['--final-scale', '2'],
        ['--tracing-range', '0.5', '--samples-radiance-probe', '64'], ['--exchange-points', 'visible'],
        ['--ambient-occlusion', '1', '--directional', 'sh1'], ['--store', 'octree'], ['--store', 'vertex'],
        ['--keep-transport', 'rows'], ['--environment', '0.3,0.4,0.5', '--sky-patches', '145'],
        ['--indirect-scale', '2', '--error-map'], ['--tracing-range', '0.5', '--indirect-scale', '2'],
        ['--method', 'path'], ['--method', 'bdpt'], ['--method', 'vcm'],
        ['--method', 'radiosity'], ['--method', 'radiosity', '--patches', 'links'],
        ['--method', 'radiosity', '--order', 'unshot'], ['--method', 'radiosity', '--gather', 'even'],
        ['--method', 'radiosity', '--patches', 'links', '--keep-transport', 'links']]
# The same on a scene with water and a glossy floor: ways of its caustics.
GLOSSY = [['--caustics', which] for which in ('none', 'gather', 'land', 'merge', 'vcm')] + [
    ['--caustics', 'vcm', '--error-map'], ['--caustics', 'merge', '--target-error', '0.3', '--iterations', 'all'],
    ['--caustics', 'vcm', '--mis', 'power'], ['--materials', 'diffuse'], ['--method', 'vcm']]


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
    for way in GLOSSY:
        photons = ['--photons', '50000'] if way[-1] not in ('none', 'gather', 'diffuse', 'vcm') else []
        yield harness.own_scene('cornell_water.glb'), ['--texels-per-metre', '6', *photons, *way]
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


def chunks(path):
    """The chunks of a PNG file, but texts."""
    with open(path, 'rb') as file:
        data = file.read()
    at = 8
    while at < len(data):
        end = at + 12 + int.from_bytes(data[at:at + 4], 'big')
        if data[at + 4:at + 8] not in (b'tEXt', b'iTXt', b'zTXt'):
            yield data[at:end]
        at = end


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
        attributes.pop('kiln:version', None)
        found[os.path.relpath(path, folder)] = hashlib.md5(repr(sorted(attributes.items())).encode()).hexdigest()
        for name, values in channels.items():
            found[os.path.relpath(path, folder) + ':' + name] = hashlib.md5(values.tobytes()).hexdigest()
    for path in glob.glob(os.path.join(folder, '*.png')):
        found[os.path.relpath(path, folder)] = hashlib.md5(b''.join(chunks(path))).hexdigest()
    return found


def bake(kiln, scene, folder, options, ranks):
    gather = GATHER if '--method' not in options else []
    command = [kiln, 'bake', scene, '-o', folder, *DRAFT, *gather, *options]
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
    parser.add_argument('--record', help='JSON file of the hashes that BEFORE gave: read, and added to')
    parser.add_argument('--only', default='', help='bakes whose scene and options have this text')
    arguments = parser.parse_args()
    differing = bakes = 0
    recorded = {}
    if arguments.record and os.path.exists(arguments.record):
        with open(arguments.record, encoding='utf-8') as file:
            recorded = json.load(file)
    with tempfile.TemporaryDirectory() as folder:
        for count, (scene, options) in enumerate(scenes(arguments.set, folder, arguments.before)):
            options = [*options, '--backend', arguments.backend]
            name = ' '.join((os.path.basename(scene), *options))
            if arguments.only not in name:
                continue
            if name not in recorded:
                recorded[name] = bake(arguments.before, scene, os.path.join(folder, 'before%d' % count), options, 1)
            before = recorded[name]
            for ranks in map(int, arguments.ranks.split(',')):
                place = os.path.join(folder, 'after%d_%d' % (count, ranks))
                after = bake(arguments.after, scene, place, options, ranks)
                bakes += 1
                if before[0] == 0 and after[0] == 0:
                    names = sorted(set(before[1]) | set(after[1]))
                    off = [n for n in names if before[1].get(n) != after[1].get(n)]
                    print('%-60s %d ranks  %3d arrays and files, %d differ  %s' % (
                        name, ranks, len(names), len(off), ' '.join(off[:4])), flush=True)
                    differing += bool(off)
                else:
                    print('%-60s %d ranks  ended with %d and %d: %.200s' % (
                        name, ranks, before[0], after[0], after[1]), flush=True)
                    differing += before[0] != after[0]
    if arguments.record:
        with open(arguments.record, 'w', encoding='utf-8') as file:
            json.dump(recorded, file)
    print('%d of %d bakes differ' % (differing, bakes))
    sys.exit(differing > 0)


if __name__ == '__main__':
    main()
