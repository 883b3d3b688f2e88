"""Devices without doubles: kernels in floats, whose code is in a file beside the program.

- A bake on a device that is taken for such (KILN_DOUBLES=none) has the light of one on the same device with doubles,
  but for rounding.
- The file is found in the program's folder, or in ../lib/kiln of that. Where it is missing, or of another build, the
  bake ends with 69 and a sentence, and a device with doubles does not ask for it.
"""
import os
import shutil
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402

SCENE = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
FEW = ('--samples-direct', 4, '--samples-bounce', 2, '--samples-indirect', 8, '--samples-probe', 0, '--bounces', 1,
       '--texels-per-metre', 1, '--no-export', '--denoise', 'none')
FILE = 'kiln-float.kernels'
# Light of a texel in floats: single rays that meet another side of an edge are more than rounding.
MEDIAN, MEAN = 1e-5, 2e-3


def compare(checks, kiln):
    """Light by floats and by doubles, of which neither may have the other's bits."""
    light = {}
    for doubles in ('', 'none'):
        kiln.environment['KILN_DOUBLES'] = doubles
        b = kiln.bake(SCENE, *FEW)
        if not checks.baked(b):
            checks.end()
        checks.that(('no doubles' in b.run['backend']['device']) == (doubles == 'none'),
                    'device: %s' % b.run['backend']['device'], b.process)
        p = b.points
        light[doubles] = p.total[np.lexsort((p.x, p.y, p.side, p.object))]
        b.remove()
    away = np.abs(light['none'] - light['']) / light[''].mean()
    print('floats are away by %.2g in the middle, %.2g in the mean' % (np.median(away), away.mean()))
    checks.that(0 < away.mean() < MEAN and np.median(away) < MEDIAN, 'floats have other light')


def move(checks, kiln):
    """The program in a folder of its own, with the file in several places."""
    built = os.path.dirname(os.path.realpath(kiln.path))
    program, lib = os.path.join(kiln.scratch, 'usr', 'bin'), os.path.join(kiln.scratch, 'usr', 'lib', 'kiln')
    for folder in (program, lib):
        os.makedirs(folder)
    shutil.copy(kiln.path, program)
    kiln.path = os.path.join(program, os.path.basename(kiln.path))

    def bake(what, doubles, sentence):
        kiln.environment['KILN_DOUBLES'] = doubles
        b = kiln.bake(SCENE, *FEW)
        if sentence is None:
            checks.baked(b)
        else:
            checks.that(b.process.status == 69 and FILE in b.process.sentence() and sentence in b.process.sentence(),
                        '%s: %d, %s' % (what, b.process.status, b.process.sentence()), b.process)
        b.remove()

    bake('missing', 'none', 'is neither in ' + program)
    bake('missing, and not asked for', '', None)
    whole = os.path.join(lib, FILE)
    shutil.copy(os.path.join(built, FILE), whole)
    bake('in lib', 'none', None)
    with open(whole, 'r+b') as file:
        file.seek(1000)
        byte = file.read(1)
        file.seek(1000)
        file.write(bytes([byte[0] ^ 1]))
    bake('changed', 'none', 'is not of this build')
    with open(os.path.join(program, FILE), 'wb') as file:
        file.write(b'KILNSPV1')
    bake('foreign', 'none', 'is not of this build')


def main():
    _, kiln = harness.start(__doc__)
    checks, kiln.backend = harness.Checks(), 'vulkan'
    compare(checks, kiln)
    move(checks, kiln)
    checks.end()


if __name__ == '__main__':
    main()
