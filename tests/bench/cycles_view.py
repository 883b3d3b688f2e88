"""Kiln and Blender's Cycles draw the same pictures of mirror, glass and metal: how far apart their means are.

  /usr/bin/python3 tests/bench/cycles_view.py --kiln build/release/kiln [--samples N] [--cycles N] [SCENE ...]

The box of `kiln generate cornell-spheres` with its two balls as `balls` (a mirror and glass with a body), `mirrors`
(both mirrors) and `metal` (both rough metal of a colour), by `kiln view --method bdpt --materials auto` and by Cycles
with the same materials, without clamping. Each row has the mean radiance of the picture, and of its lower half, where
balls and floor are, by kiln and by Cycles, and by how much they differ, with the standard error of the difference, from
the spread between two seeds of each in 8 x 8 blocks of pixels. Needs Debian's package blender.
"""
import json
import math
import os
import shutil
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import exr  # noqa: E402
import gltf_file  # noqa: E402
import harness  # noqa: E402

HERE = os.path.dirname(os.path.abspath(__file__))
BLOCKS = 8
MIRROR = {'baseColorFactor': [0.95, 0.95, 0.95, 1.0], 'metallicFactor': 1.0, 'roughnessFactor': 0.0}
METAL = {'baseColorFactor': [0.9, 0.6, 0.3, 1.0], 'metallicFactor': 1.0, 'roughnessFactor': 0.4}
SCENES = {'balls': {}, 'mirrors': {'glass': MIRROR}, 'metal': {'glass': METAL, 'mirror': METAL}}


def must(run):
    if run.status != 0:
        sys.exit('%s\nended with %d: %s' % (run.line(), run.status, run.sentence()))
    return run


def scene(kiln, name):
    """The box, with materials put in the place of others."""
    source, path = measure.made(kiln, 'cornell-spheres'), os.path.join(kiln.scratch, name + '.glb')
    file = gltf_file.File(source)
    for material in file.json['materials']:
        if material['name'] in SCENES[name]:
            material.pop('extensions', None)
            material['pbrMetallicRoughness'] = SCENES[name][material['name']]
    gltf_file.write_glb(path, file.json, file.binary)
    return path


def by_kiln(kiln, path, options, seed):
    picture = os.path.join(kiln.scratch, 'kiln.exr')
    run = must(kiln.command('view', path, '--method', 'bdpt', '--materials', 'auto', '--samples-pixel',
                                options.samples, '--width', options.side, '--height', options.side, '--seed', seed,
                                '--threads', options.threads, '--quiet', '-o', picture, timeout=3600))
    return exr.rgb(picture), run.processor


def by_cycles(kiln, path, options, seed):
    plan, picture = os.path.join(kiln.scratch, 'plan.json'), os.path.join(kiln.scratch, 'cycles.exr')
    with open(plan, 'w', encoding='utf-8') as f:
        json.dump({'scene': path, 'output': picture, 'width': options.side, 'height': options.side,
                   'samples': options.cycles, 'seed': seed, 'threads': options.threads}, f)
    run = must(harness.run(['blender', '--background', '-noaudio', '--factory-startup', '--python-exit-code',
                                    '1', '--python', os.path.join(HERE, 'cycles_view_blender.py'), '--', plan],
                                   timeout=3600))
    line = next(l for l in run.stdout.splitlines() if l.startswith('VIEW '))
    return exr.rgb(picture), json.loads(line[5:])['processor']


def blocks(picture):
    side = picture.shape[0] // BLOCKS
    luminance = picture[:side * BLOCKS, :side * BLOCKS] @ np.array([0.2126, 0.7152, 0.0722])
    return luminance.reshape(BLOCKS, side, BLOCKS, side).mean((1, 3))


def row(table, name, part, bakers):
    """One region of a picture: means, difference and its standard error, by two seeds of each."""
    means = [np.mean([b[part].mean() for b in both]) for both in bakers]
    error = math.sqrt(sum(float(((both[0][part] - both[1][part]) ** 2).mean()) / 4.0 / both[0][part].size
                          for both in bakers))
    table.row(name, '%.5f' % means[0], '%.5f' % means[1], '%+.2f %%' % (100 * (means[0] / means[1] - 1)),
              '%.2f %%' % (100 * error / means[1]))


def main():
    options, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--samples', type=int, default=256, help='paths of a pixel, by kiln'),
        lambda p: p.add_argument('--cycles', type=int, default=1024, help='the same by Cycles'),
        lambda p: p.add_argument('--side', type=int, default=96, help='pixels'),
        lambda p: p.add_argument('--threads', type=int, default=1, help='of both'),
        lambda p: p.add_argument('scenes', nargs='*', choices=[*SCENES, []]))
    if not shutil.which('blender'):
        harness.skip('blender is not installed (Debian\'s package blender)')
    table = harness.Table(('picture', 20), ('kiln', 9), ('Cycles', 9), ('difference', 10), ('its error', 9))
    for name in options.scenes or SCENES:
        path, seconds, pictures = scene(kiln, name), [0.0, 0.0], ([], [])
        for seed in (1, 2):
            for i, draw in enumerate((by_kiln, by_cycles)):
                picture, processor = draw(kiln, path, options, seed)
                pictures[i].append(blocks(picture))
                seconds[i] += processor
        row(table, name, np.s_[:, :], pictures)
        row(table, name + ', lower half', np.s_[BLOCKS // 2:, :], pictures)
        print('%s: %.1f s of the processor by kiln, %.1f s by Cycles' % (name, *seconds))


if __name__ == '__main__':
    main()
