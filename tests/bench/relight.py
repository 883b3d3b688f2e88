"""What a state of kiln relight --states costs, next to a bake: processor time of one thread.

    relight.py --kiln PROGRAM [--scene cornell|sponza] [--density TEXELS] [--reference SAMPLES]

Bakes the scene with its rays kept and nothing done to its maps, then relights it: one state, and sixteen together.
Prints the bake's time, what loading took, solving and writing of a state, how often solving goes into the bake, and how
much a state of sixteen takes of one alone. With --reference also the error of both against a bake of so many samples:
root mean square of the luminance over its mean.
"""
import argparse
import json
import os
import sys
import tempfile

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402
from study import child  # noqa: E402

SCENES = {
    'cornell': (os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb'), 12, [],
                lambda x: {'materials': {'*': {'emission-scale': x}}}),
    'sponza': (os.path.join(harness.SHARED, 'third_party', 'crytek_sponza.glb'), 2, ['--environment', '1,1,1'],
               lambda x: {'environment': {'scale': x}})}
PLAIN = ['--quality', 'preview', '--samples-direct', '64', '--samples-probe', '0', '--no-stitch', '--denoise', 'none',
         '--no-export', '--no-preview', '--backend', 'embree', '--materials', 'diffuse', '--threads', '1', '--quiet']


def run(kiln, *arguments):
    os.environ['OMP_WAIT_POLICY'] = 'passive'
    return child.run([kiln, *arguments]).must('kiln %s' % arguments[0]).processor


def light(folder):
    with h5py.File(os.path.join(folder, 'kiln.h5'), 'r') as file:
        return file['irradiance/total'][()].astype(float) @ [0.2126, 0.7152, 0.0722]


def error(folder, reference):
    return np.sqrt(np.mean((light(folder) - reference) ** 2)) / reference.mean()


def relight(kiln, kept, states, folder):
    with open(folder + '.yaml', 'w') as file:
        json.dump(states, file)
    run(kiln, 'relight', kept, '--states', folder + '.yaml', '-o', folder, '--threads', '1', '--quiet')
    with open(os.path.join(folder, 'states.json')) as file:
        return json.load(file)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--kiln', required=True)
    parser.add_argument('--scene', choices=SCENES, default='cornell')
    parser.add_argument('--density', type=float)
    parser.add_argument('--reference', type=int, help='samples of a texel in the bake that errors are taken from')
    given = parser.parse_args()
    scene, density, options, change = SCENES[given.scene]
    options = [scene, '--texels-per-metre', str(given.density or density), *PLAIN, *options]
    with tempfile.TemporaryDirectory() as top:
        kept = os.path.join(top, 'kept')
        run(given.kiln, 'bake', *options, '--keep-transport', 'rows', '-o', kept)
        bake = run(given.kiln, 'bake', *options, '-o', os.path.join(top, 'bake'))
        one = relight(given.kiln, kept, {'s': change(0.5)}, os.path.join(top, 'one'))
        many = relight(given.kiln, kept, {f's{i}': change(0.5 + 0.1 * i) for i in range(16)}, os.path.join(top, 'many'))
        alone = one['states'][0]['solve_processor_seconds']
        among = many['states'][0]['solve_processor_seconds']
        print('%s: bake %.2f s; load %.2f s; one state %.4f s, of 16 %.4f s; writing %.3f s a state' %
              (given.scene, bake, one['load_processor_seconds'], alone, among,
               np.mean([s['write_processor_seconds'] for s in many['states']])))
        print('bake over one state %.1f, over one of 16 %.1f; one of 16 over one alone %.2f; %.1f MB resident' %
              (bake / alone, bake / among, among / alone, many['resident_bytes'] / 1e6))
        if given.reference:
            samples = str(given.reference)
            text = os.path.join(top, 'changes.yaml')
            with open(text, 'w') as file:
                json.dump(change(0.5), file)
            edited = [*options, '--changes', text]
            run(given.kiln, 'bake', *edited, '--samples-direct', samples, '--samples-bounce', samples,
                '--samples-indirect', samples, '--seed', '11', '-o', os.path.join(top, 'reference'))
            run(given.kiln, 'bake', *edited, '--seed', '5', '-o', os.path.join(top, 'edited'))
            reference = light(os.path.join(top, 'reference'))
            print('error of a bake %.4f, of a state %.4f' % (error(os.path.join(top, 'edited'), reference),
                                                             error(os.path.join(top, 'one', 's'), reference)))


if __name__ == '__main__':
    main()
