"""--method radiosity: error against pairs of patches, bounce by bounce and by rounds of unshot light; and what voxels
cost and lose.

  /usr/bin/python3 tests/bench/unshot.py --kiln build/release/kiln --density 3

Errors are of all light, rms relative to its root mean square, against lockstep with all bounces and rays. Pairs are
rays between patches; seconds are of the processor, with start and files.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

CORNELL = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
FEW = ('--method', 'radiosity', '--samples-probe', 0, '--no-export', '--denoise', 'none', '--samples-direct', 64,
       '--samples-indirect', 64, '--threads', 1)


def baked(kiln, table, wanted, scene, options, *more):
    bake = measure.must(kiln.bake(scene, *options, *more))
    found, area = bake.points.total @ harness.LUMINANCE, bake.points.area
    light = found if wanted is None else wanted
    off = np.sqrt((found - light) ** 2 @ area / (light ** 2 @ area))
    rays = bake.run['rays']
    table.row(' '.join(map(str, more)), '%.3g' % (rays['bounces'] + rays['rounds']), '%.2e' % off,
              '%+.2e' % (found @ area / (light @ area) - 1), '%.2f' % bake.process.processor)
    bake.remove()
    return found


def main():
    add = lambda p: p.add_argument('--density', type=float, default=3, help='texels per metre')
    arguments, kiln = harness.start(__doc__, add)
    kiln.environment['OMP_WAIT_POLICY'] = 'passive'
    options = (*FEW, '--texels-per-metre', arguments.density)
    for name, scene in (('Cornell box', CORNELL), ('cornell-spheres', measure.made(kiln, 'cornell-spheres'))):
        print(name)
        table = harness.Table(('options', 42), ('pairs', 10), ('rms', 10), ('sum', 10), ('processor s', 12))
        wanted = baked(kiln, table, None, scene, options)
        for bounces in (1, 2, 3, 4, 6):
            for more in ((), ('--order', 'unshot')):
                baked(kiln, table, wanted, scene, options, '--bounces', bounces, *more)
        baked(kiln, table, wanted, scene, options, '--order', 'unshot')
        wanted = baked(kiln, table, None, scene, options, '--bounces', 1)
        for voxels in (32, 64, 128, 256):
            baked(kiln, table, wanted, scene, options, '--bounces', 1, '--visibility', 'voxels:%d' % voxels)


if __name__ == '__main__':
    main()
