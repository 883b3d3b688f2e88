"""--method radiosity on a Vulkan device against Embree: the same pairs, so the same light but for rounding, and for
rays that pass by an edge, which rounding may decide otherwise.

- The Cornell box, lamps as patches: the same number of rays but for 1e-4 of them; light of 99 % of the texels within
  1e-5, relative to at least a thousandth of the mean; the sum of all light within 1e-6 where no texel is apart.
- The same for windows of texels, joined texels and clamps.
- The same by rays in the place of pairs, with those to bright patches; cached pairs and voxels are refused.
- Smooth normals, and layers that let light through.
- The same bits from other dispatches, memory and ranks, and from a device that was lost.
- A closed furnace within 0.1 %.
- run.json says which device it was.
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
MORE = ('cornell_spheres.glb', 'cornell_layers.glb')  # where they are
FEW = ('--samples-probe', 0, '--no-export', '--denoise', 'none', '--method', 'radiosity', '--samples-direct', 16,
       '--samples-indirect', 32)
BOX = (*FEW, '--lights', 'patches', '--texels-per-metre', 2, '--bounces', 2)
NODES = (('--undersample', 'mipmap', '--sampling-window', 2), ('--subdivide', 0.2), ('--clamp', '--albedo-scale', 0.9),
         ('--order', 'unshot'))
RAYS = (('--gather', 'even', '--directions', 64), ('--gather', 'cosine'))
MIXED = ('--gather', 'mixed', '--directions', 64)
REFUSED = (('--visibility-cache', 1), ('--visibility', 'voxels'))


def on(kiln, backend, scene, *options, **more):
    kiln.backend = backend
    return kiln.bake(scene, *options, **more)


def light(bake):
    """What came by patches: lamps that are sampled belong to the direct pass, which has tests of its own."""
    p = bake.points
    order = np.lexsort((p.x, p.y, p.side, p.object))
    of_patches = p.total if bake.run['job']['lights'] == 'patches' else p.indirect
    return of_patches[order], p.area[order], p.valid[order]


def compare(kiln, checks, table, what, scene, *options, both=False):
    """Bakes by both; gives Vulkan's, or `both`, or None."""
    embree, vulkan = (on(kiln, backend, scene, *options) for backend in ('embree', 'vulkan'))
    if not checks.baked(embree) or not checks.baked(vulkan):
        return None
    (wanted, area, valid), (found, _, same) = light(embree), light(vulkan)
    rays = [sum(bake.run['rays'][key] for key in ('bounces', 'rounds', 'emitters')) for bake in (embree, vulkan)]
    off = (np.abs(found - wanted) / np.maximum(wanted, 1e-3 * wanted.mean())).max(axis=1)
    apart, sum_ = (off > 1e-5).mean(), (found.T @ area).sum() / (wanted.T @ area).sum() - 1
    table.row(what, rays[0], rays[1] - rays[0], '%.1e' % np.median(off), '%.1e' % off.max(), int((off > 1e-5).sum()),
              '%+.1e' % sum_)
    checks.that((valid == same).all() and abs(rays[1] / rays[0] - 1) < 1e-4 and apart <= 0.01 and
                abs(sum_) < (1e-6 if apart == 0 else 1e-4),
                '%s: %d and %d rays, %g of the texels are apart, at most by %g, all by %g' %
                (what, *rays, apart, off.max(), sum_), vulkan.process)
    checks.that(0 < off.max(), '%s: the same bits: Embree did both' % what, vulkan.process)
    if both:
        return embree, vulkan
    embree.remove()
    return vulkan


def check_same_bits(kiln, checks, wanted, options=(), box=BOX,
                    ways=((0, ('--dispatch-time', 1, '--device-memory', 0.26), {}), (3, ('--threads', 1), {}),
                          (0, (), {'KILN_GPU_FAULT': 'lost:250'}))):
    for ranks, more, environment in ways:
        kiln.environment.update(environment)
        bake = on(kiln, 'vulkan', CORNELL, *box, *options, *more, ranks=ranks)
        for key in environment:
            del kiln.environment[key]
        if checks.baked(bake):
            checks.that(same_result.points(bake) == wanted, '%d ranks, %s %s: other bits' % (ranks, more, environment),
                        bake.process)
            checks.that((bake.run['backend']['recoveries'] > 0) == bool(environment), 'recoveries: %s' % environment,
                        bake.process)
            bake.remove()


def check_refused(kiln, checks):
    for more in REFUSED:
        bake = on(kiln, 'vulkan', CORNELL, *BOX, *more)
        checks.that(bake.process.status == 64 and 'traces with Embree' in bake.process.stderr,
                    '%s: %d: %s' % (more, bake.process.status, bake.process.sentence()), bake.process)


def check_furnace(kiln, checks, *options):
    with open(harness.own_scene('analytic', 'expected.json')) as file:
        case = {case['id']: case for case in json.load(file)['cases']}['furnace_cube_rho0.5']
    bake = on(kiln, 'vulkan', harness.own_scene('analytic', case['file']), *FEW, '--lights', 'patches',
              '--lightmap-size', 12, *options)
    if checks.baked(bake):
        off = np.abs(bake.points.total[bake.points.valid] / np.asarray(case['uniform_E'], float) - 1).max()
        checks.that(off < 1e-3, 'the furnace is off by %g' % off, bake.process)


def main():
    add = lambda p: p.add_argument('--traversal', default='auto', help='of the Vulkan backend')
    arguments, kiln = harness.start(__doc__, add)
    kiln.environment['KILN_VULKAN_VALIDATION'] = os.environ.get('KILN_VULKAN_VALIDATION', '1')
    checks = harness.Checks()
    table = harness.Table(('scene', 44), ('rays', 9), ('more', 5), ('median', 8), ('worst', 8), ('apart', 5),
                          ('all', 9))
    box = compare(kiln, checks, table, 'Cornell box', CORNELL, *BOX, '--traversal', arguments.traversal)
    if box is not None:
        said = box.run['backend']
        checks.that(said['name'] == 'vulkan' and 'pairs of patches' in said['kernels'], 'run.json says %s' % said)
        check_same_bits(kiln, checks, same_result.points(box))
    mixed = compare(kiln, checks, table, ' '.join(map(str, MIXED)), CORNELL, *BOX, *MIXED)
    if mixed is not None:
        check_same_bits(kiln, checks, same_result.points(mixed), MIXED,
                        ways=((3, ('--threads', 1), {}), (0, ('--dispatch-time', 1), {'KILN_GPU_FAULT': 'lost:250'})))
    for more in NODES + RAYS:
        compare(kiln, checks, table, ' '.join(map(str, more)), CORNELL, *BOX, *more)
    for name in filter(harness.own_scene, MORE):
        compare(kiln, checks, table, name, harness.own_scene(name), *FEW, '--texels-per-metre', 2, '--bounces', 1)
    check_furnace(kiln, checks)
    check_refused(kiln, checks)
    checks.end()


if __name__ == '__main__':
    main()
