"""What caustics cost of the processor, and their error: one program, or one beside another.

  /usr/bin/python3 tests/bench/caustics.py --kiln AFTER [--before BEFORE] [--only SCENE] [--options '...']

Each scene is baked without bounces with the default caustics, by one thread. Printed are the processor seconds more
than without caustics, and of the layer `caustic` in kiln.h5 the root mean square and the mean of the difference, and
the difference of the means, over the mean; against a bake of another seed with eight times the rays and four times the
paths. Where single paths are bright the root mean square hangs on which have been met.
"""
import argparse
import os
import subprocess
import sys
import tempfile

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402
from study import child  # noqa: E402

INTERIORS = os.path.join(harness.SHARED, 'third_party')
COMMON = ['--threads', '1', '--backend', 'embree', '--bounces', '0', '--samples-direct', '4', '--samples-probe', '0',
          '--no-preview', '--no-export', '--denoise', 'none', '--no-resume', '--quiet']
MANY = ['--seed', '77', '--samples-indirect', '1024', '--photons', '131072']


def scenes(kiln, folder):
    """{name: path and options}"""
    spheres = os.path.join(folder, 'spheres.glb')
    subprocess.run([kiln, 'generate', 'cornell-spheres', '-o', spheres, '--quiet'], check=True)
    return {'spheres': [spheres, '--texels-per-metre', '4'],
            'full': [spheres, '--texels-per-metre', '3', '--materials', 'full'],
            'ajar': [os.path.join(INTERIORS, 'veach_ajar.glb'), '--texels-per-metre', '4'],
            'dining': [os.path.join(INTERIORS, 'dining_room.glb'), '--texels-per-metre', '1.5'],
            'classroom': [os.path.join(INTERIORS, 'classroom.glb'), '--texels-per-metre', '1']}


def bake(kiln, scene, folder, *more):
    """Processor seconds, and luminances of the layer, if there is one."""
    os.environ['OMP_WAIT_POLICY'] = 'passive'
    seconds = child.run([kiln, 'bake', *scene, '-o', folder, *COMMON, *more]).must('the bake').processor
    with h5py.File(os.path.join(folder, 'kiln.h5')) as file:
        name = 'irradiance/caustic'
        return seconds, file[name][()] @ np.array([0.2126, 0.7152, 0.0722]) if name in file else None


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument('--kiln', required=True)
    parser.add_argument('--before')
    parser.add_argument('--only')
    parser.add_argument('--options', default='')
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for name, scene in scenes(args.kiln, folder).items():
            if args.only not in (None, name) or not os.path.exists(scene[0]):
                continue
            out = os.path.join(folder, name)
            reference = bake(args.kiln, scene, out, *MANY)[1]
            for kiln in filter(None, (args.before, args.kiln)):
                without = bake(kiln, scene, out, '--caustics', 'none')[0]
                seconds, light = bake(kiln, scene, out, *args.options.split())
                off = (light - reference) / reference.mean()
                print('%-9s %6.2f s  rms %.4f  mean %.4f  sum %+.4f  %s'
                      % (name, seconds - without, np.sqrt((off**2).mean()), abs(off).mean(), off.mean(), kiln))


if __name__ == '__main__':
    main()
