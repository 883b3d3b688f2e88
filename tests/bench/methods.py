"""Which method of light for which scene: processor time to an error, for each.

  /usr/bin/python3 tests/bench/methods.py --kiln build/release/kiln [--target 0.01] [--only SCENE] [--reference 4096]
                   [--methods cells,links]

Each method bakes each scene on a ladder: rays of the final gather for those that gather by rays, windows or the error
of a link for those that ask patches. Its lightmaps, as published (denoised), are compared with a bake by paths with
many samples and another seed, at the same texels, not denoised: root mean square of the difference of light from other
surfaces over the mean of all light, over the texels wholly inside charts. Direct light is much the same for all.
Printed are time and error of every rung, the time at which the target is reached (by powers between the rungs), and the
least error of a method that did not reach it. Times are processor times of whole commands with one thread.
"""
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, '..', 'analytic')]
import directions  # noqa: E402
import measure  # noqa: E402
import harness  # noqa: E402

COMMON = ('--samples-probe', 0, '--no-export', '--no-preview', '--threads', 1, '--materials', 'diffuse')
RAYS = [('--quality', q) for q in ('draft', 'preview', 'production')]
PATCHES = ('--quality', 'preview', '--method', 'radiosity')
METHODS = {
    'cells': RAYS,
    'cells, guide': [(*r, '--guide', 'auto') for r in RAYS],
    'pairs': [PATCHES],
    'mipmap windows': [(*PATCHES, '--undersample', 'mipmap:%d' % w) for w in (8, 4, 2)],
    'links': [(*PATCHES, '--patches', 'links:%g' % e) for e in (0.06, 0.03, 0.015)],
    'mixed': [(*PATCHES, '--gather', 'mixed:%d' % n) for n in (32, 128, 512)],
    'path': [('--quality', 'preview', '--method', 'path', '--samples-indirect', n) for n in (32, 128, 512)],
}


def scenes(kiln):
    """{name: (file, texels a metre)}"""
    own = {'cornell': (os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb'), 4),
           'spheres': (measure.made(kiln, 'cornell-spheres'), 4),
           'sun room': (directions.sun_room(os.path.join(kiln.scratch, 'sun.glb')), 6)}
    sponza = os.path.join(harness.SHARED, 'third_party', 'crytek_sponza.glb')
    return {**own, 'sponza': (sponza, 0.35)} if os.path.exists(sponza) else own


def light(bake):
    """(light from other surfaces, all light), of the texels wholly inside charts, (n, 3) each."""
    found = [[], []]
    for name in bake.names():
        layers = bake.lightmap(name).channels
        inside = (layers['coverage.Y'] == 1) & (layers['validity.Y'] == 1)
        for values, prefix in zip(found, ('indirect.', '')):
            values.append(np.stack([layers[prefix + c][inside] for c in 'RGB'], 1))
    return [np.concatenate(values).astype(np.float64) for values in found]


def off(bake, reference):
    found = light(bake)[0]
    return np.sqrt(np.mean((found - reference[0]) ** 2)) / reference[1].mean()


def reached(ladder, target):
    """Time at an error of `target`; None where no rung has it."""
    if min(error for error, _ in ladder) > target:
        return None
    if ladder[0][0] <= target or len(ladder) < 2:
        return min(cost for error, cost in ladder if error <= target)
    return measure.at_error(ladder, target)


def main():
    add = (lambda p: p.add_argument('--target', type=float, default=0.01, help='error'),
           lambda p: p.add_argument('--only', help='one scene'),
           lambda p: p.add_argument('--methods', type=lambda text: text.split(','), help='some of: %s' % list(METHODS)),
           lambda p: p.add_argument('--reference', type=int, default=4096, help='paths of a texel in the reference'))
    arguments, kiln = harness.start(__doc__, *add)
    table = harness.Table(('scene', 10), ('method', 16), ('points', 8), ('rungs: s, error', 50), ('to target, s', 14))
    for name, (path, density) in scenes(kiln).items():
        if arguments.only not in (None, name):
            continue
        common = (*COMMON, '--texels-per-metre', density)
        many = arguments.reference
        reference = measure.must(kiln.bake(path, *common, '--method', 'path', '--samples-indirect', many,
                                           '--samples-direct', many, '--seed', 1, '--denoise', 'none', timeout=7200))
        wanted = light(reference)
        for method in arguments.methods or METHODS:
            rungs = METHODS[method]
            ladder = []
            for rung in rungs:
                bake = measure.must(kiln.bake(path, *common, *rung, timeout=7200))
                ladder.append((off(bake, wanted), bake.process.processor))
                bake.remove()
            time = reached(ladder, arguments.target)
            table.row(name, method, reference.run['points']['count'],
                      ', '.join('%.3g s %.2f %%' % (cost, 100 * error) for error, cost in ladder),
                      '%.3g' % time if time is not None else 'least %.2f %%' % (100 * min(e for e, _ in ladder)))
            sys.stdout.flush()
        reference.remove()


if __name__ == '__main__':
    main()
