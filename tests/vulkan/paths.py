"""--method path, bdpt and vcm on a Vulkan device against Embree.

- bdpt and vcm follow the same paths by the same random numbers, so they come to the same light but for rounding: of
  99 % of the texels within 1e-4, relative to at least a thousandth of the mean; the sum of all within 1e-4.
- path weighs its techniques otherwise: power of each object within 5 standard errors, those of all light below 4 %.
- The same bits from other dispatches, memory and ranks, and from a device that was lost.
- The light of a closed furnace within 5 standard errors, and those below 1 %.
- With --full also a mirror, glass and lamps without size (kernels with gloss take a software
  device minutes to make).
"""
import json
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi')]
import harness  # noqa: E402
import same_result  # noqa: E402

CORNELL = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
PLAIN = ('--samples-probe', 0, '--no-export', '--denoise', 'none', '--watchdog', 0)  # kernels take long to be made
FEW = (*PLAIN, '--samples-direct', 16)
BOX = (*FEW, '--texels-per-metre', 2, '--bounces', 2)
SAME = ('bdpt', 'vcm')


def on(kiln, backend, scene, *options, **more):
    kiln.backend = backend
    return kiln.bake(scene, *options, **more)


def both(kiln, checks, scene, *options):
    bakes = [on(kiln, backend, scene, *options, timeout=3600) for backend in ('embree', 'vulkan')]
    return bakes if all([checks.baked(bake) for bake in bakes]) else None


def light(bake):
    """Light but for what the direct pass brings, area and error of each point, in one order."""
    p = bake.points
    order = np.lexsort((p.x, p.y, p.side, p.object))
    return p.indirect[order], p.area[order], p.error[order], p.object[order]


def check_same(kiln, checks, table, what, scene, *options):
    """Texel by texel; gives Vulkan's bake, or None."""
    bakes = both(kiln, checks, scene, *options)
    if bakes is None:
        return None
    (wanted, area, _, _), (found, _, _, _) = map(light, bakes)
    off = (np.abs(found - wanted) / np.maximum(wanted, 1e-3 * wanted.mean())).max(axis=1)
    apart, sum_ = (off > 1e-4).mean(), (found.T @ area).sum() / (wanted.T @ area).sum() - 1
    rays = [bake.run['rays']['paths'] for bake in bakes]
    table.row(what, *rays, '%.1e' % np.median(off), '%.1e' % off.max(), '%.4f' % apart, '%+.1e' % sum_)
    checks.that(apart <= 0.01 and abs(sum_) < (1e-4 if apart == 0 else 1e-3),
                '%s: %g of the texels are apart, all by %g' % (what, apart, sum_), bakes[1].process)
    checks.that(0 < off.max(), '%s: the same bits: Embree did both' % what, bakes[1].process)
    bakes[0].remove()
    return bakes[1]


def powers(bake):
    found, area, error, of = light(bake)
    sets = [of == i for i in np.unique(of)] + [of == of]
    return np.array([[(found[s] @ LUMINANCE * area[s]).sum() for s in sets],
                     [np.sqrt(((error[s] * area[s]) ** 2).sum()) for s in sets]])


def check_powers(kiln, checks, what, scene, *options):
    bakes = both(kiln, checks, scene, *options)
    if bakes is None:
        return
    (one, one_error), (other, other_error) = map(powers, bakes)
    error = np.hypot(one_error, other_error)
    off = (other - one) / error
    print('%s: %.5g and %.5g W, standard error %.2g; objects at most %.2f errors apart' %
          (what, one[-1], other[-1], error[-1], np.abs(off).max()))
    checks.that(np.abs(off).max() < 5, '%s: objects are %s errors apart' % (what, off), bakes[1].process)
    checks.that(error[-1] < 0.04 * one[-1], '%s: too few samples' % what, bakes[1].process)
    for bake in bakes:
        bake.remove()


def check_same_bits(kiln, checks, method, samples):
    """Over dispatches of a millisecond with little memory, ranks, and a loss."""
    options = (*BOX, '--method', method, '--samples-indirect', samples)
    bake = on(kiln, 'vulkan', CORNELL, *options)
    if not checks.baked(bake):
        return
    wanted = same_result.points(bake)
    checks.that(bake.run['backend']['name'] == 'vulkan', 'run.json says %s' % bake.run['backend'], bake.process)
    for ranks, more, environment in ((0, ('--device-memory', 0.26), {'KILN_DISPATCH_TIME': '1'}),
                                     (3, ('--threads', 1), {}), (0, (), {'KILN_GPU_FAULT': 'lost:250'})):
        kiln.environment.update(environment)
        bake = on(kiln, 'vulkan', CORNELL, *options, *more, ranks=ranks)
        for key in environment:
            del kiln.environment[key]
        if checks.baked(bake):
            checks.that(same_result.points(bake) == wanted,
                        '%s, %d ranks, %s %s: other bits' % (method, ranks, more, environment), bake.process)
            checks.that((bake.run['backend']['recoveries'] > 0) == ('KILN_GPU_FAULT' in environment),
                        'recoveries: %s' % environment, bake.process)
            bake.remove()


def check_furnace(kiln, checks, method):
    with open(harness.own_scene('analytic', 'expected.json')) as file:
        case = {case['id']: case for case in json.load(file)['cases']}['furnace_cube_rho0.5']
    bake = on(kiln, 'vulkan', harness.own_scene('analytic', case['file']), *PLAIN, '--samples-direct', 256,
              '--lightmap-size', 6, '--method', method, '--samples-indirect', 256)
    if checks.baked(bake):
        p, wanted = bake.points, (np.ones(3) * case['uniform_E']) @ LUMINANCE
        area = p.area / p.area.sum()
        off = (p.total @ LUMINANCE * area).sum() / wanted - 1
        error = np.sqrt((p.error * area) @ (p.error * area)) / wanted
        print('furnace by %s: off by %+.2e, standard error %.1e' % (method, off, error))
        checks.that(abs(off) < 5 * error < 0.05, 'the furnace by %s is off by %g, error %g' % (method, off, error),
                    bake.process)
        bake.remove()


def check_more(kiln, checks, table):
    spheres = os.path.join(kiln.scratch, 'spheres.glb')
    checks.that(kiln.command('generate', 'cornell-spheres', '-o', spheres).status == 0, 'generate')
    zoo = os.path.join(harness.REPOSITORY, 'tests', 'data', 'punctual_zoo.glb')
    for method in SAME:
        for what, scene, options in (('spheres', spheres, ('--materials', 'auto', '--bounces', 1)),
                                     ('lamps without size', zoo, ('--bounces', 1, '--environment', '0.3,0.4,0.5'))):
            bake = check_same(kiln, checks, table, '%s, %s' % (method, what), scene, *FEW, '--texels-per-metre', 2,
                              '--method', method, '--samples-indirect', 8, *options)
            if bake is not None:
                bake.remove()
    check_powers(kiln, checks, 'path, spheres', spheres, *FEW, '--texels-per-metre', 2, '--method', 'path',
                 '--samples-indirect', 512, '--materials', 'auto', '--bounces', 1)
    check_powers(kiln, checks, 'path, lamps without size', zoo, *FEW, '--texels-per-metre', 2, '--method', 'path',
                 '--samples-indirect', 128, '--bounces', 1, '--environment', '0.3,0.4,0.5')


def main():
    arguments, kiln = harness.start(__doc__, lambda p: p.add_argument('--full', action='store_true'))
    kiln.environment['KILN_VULKAN_VALIDATION'] = os.environ.get('KILN_VULKAN_VALIDATION', '1')
    checks = harness.Checks()
    table = harness.Table(('scene', 28), ('rays', 9), ('Vulkan', 9), ('median', 8), ('worst', 8), ('apart', 7),
                          ('all', 9))
    for method in SAME:
        bake = check_same(kiln, checks, table, method + ', Cornell box', CORNELL, *BOX, '--method', method,
                          '--samples-indirect', 8)
        if bake is not None:
            bake.remove()
    check_powers(kiln, checks, 'path, Cornell box', CORNELL, *BOX, '--method', 'path', '--samples-indirect', 128)
    for method in ('path', *SAME):
        check_same_bits(kiln, checks, method, 8)
        check_furnace(kiln, checks, method)
    if arguments.full:
        check_more(kiln, checks, table)
    checks.end()


if __name__ == '__main__':
    main()
