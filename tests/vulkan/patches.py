"""--method radiosity on a Vulkan device against Embree: the same pairs, so the same light but for rounding, and for
rays that pass by an edge, which rounding may decide otherwise.

- The Cornell box, lamps as patches: the same number of rays but for 1e-4 of them; light of 99 % of the texels within
  1e-5, relative to at least a thousandth of the mean; the sum of all light within 1e-6 where no texel is apart.
- The same for windows of texels, joined texels and clamps.
- The same by rays in the place of pairs, with those to bright patches.
- By a grid of voxels the same pairs see each other as on Embree. A cache saves the same rays as there, and its bits are
  those of rays, with room for all pairs and for some, with glass between patches, over 3 ranks whose points move, in
  rounds, and from a device that was lost.
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
sys.path[:0] = [os.path.join(HERE, '..', folder) for folder in ('common', 'mpi', 'analytic')]
import harness  # noqa: E402
import same_result  # noqa: E402
import visibility  # noqa: E402

CORNELL = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
MORE = ('cornell_spheres.glb', 'cornell_layers.glb')  # where they are
FEW = ('--samples-probe', 0, '--no-export', '--denoise', 'none', '--method', 'radiosity', '--samples-direct', 16,
       '--samples-indirect', 32)
BOX = (*FEW, '--lights', 'patches', '--texels-per-metre', 2, '--bounces', 2)
NODES = (('--undersample', 'mipmap:2'), ('--subdivide', 0.2), ('--clamp', '--albedo-scale', 0.9),
         ('--order', 'unshot'))
RAYS = (('--gather', 'even:64'), ('--gather', 'cosine'))
MIXED = ('--gather', 'mixed:64')
VOXELS = ('--visibility', 'voxels:32')
ALL, SOME = ('--visibility-cache', 1), ('--visibility-cache', 4e-5)


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
                    ways=((0, ('--device-memory', 0.26), {'KILN_DISPATCH_TIME': '1'}), (3, ('--threads', 1), {}),
                          (0, (), {'KILN_GPU_FAULT': 'lost:250'}))):
    for ranks, more, environment in ways:
        kiln.environment.update(environment)
        bake = on(kiln, 'vulkan', CORNELL, *box, *options, *more, ranks=ranks)
        for key in environment:
            del kiln.environment[key]
        if checks.baked(bake):
            checks.that(same_result.points(bake) == wanted, '%d ranks, %s %s: other bits' % (ranks, more, environment),
                        bake.process)
            checks.that((bake.run['backend']['recoveries'] > 0) == ('KILN_GPU_FAULT' in environment),
                        'recoveries: %s' % environment, bake.process)
            bake.remove()


def check_cache(kiln, checks, what, bake, rays):
    """Of a bake with kept visibility, and the rays of bounces of one without."""
    said = bake.run.get('visibility_cache')
    checks.that(said is not None and rays - bake.run['rays']['bounces'] == said['rays_saved'] > 0,
                '%s: %d rays without, %s of it' % (what, rays, said), bake.process)
    return said


def check_few(kiln, checks, table):
    """A cache and voxels: rays and light as on Embree, and with a cache as without."""
    compare(kiln, checks, table, 'voxels', CORNELL, *BOX, *VOXELS)
    both = compare(kiln, checks, table, 'cache', CORNELL, *BOX, *ALL, both=True)
    rays = on(kiln, 'embree', CORNELL, *BOX)
    if both is None or not checks.baked(rays):
        return
    found, wanted = light(both[0])[0], light(rays)[0]
    off = np.abs(found - wanted).max()
    checks.that(off == 0, 'on Embree a cache changes light by %g' % off, both[0].process)
    said = [bake.run['visibility_cache'] for bake in both]
    checks.that(all(said[0][key] == said[1][key] for key in ('cached', 'open', 'shut', 'pairs', 'rays_saved')),
                'of the cache it is said %s' % said, both[1].process)


def check_visibility(kiln, checks, table, wanted, rays):
    """The Cornell box's bits by rays alone, and its rays of bounces."""
    ways = ((0, (), {}),)
    lost = ((0, (), {'KILN_DISPATCH_TIME': '1', 'KILN_GPU_FAULT': 'lost:250'}),
            (3, ('--threads', 1, '--rebalance', 'always'), {}))
    for options, more in ((SOME, ways + lost), (ALL, lost)):
        check_same_bits(kiln, checks, wanted, options, ways=more)
    said = []
    for options in (ALL, SOME):
        bake = on(kiln, 'vulkan', CORNELL, *BOX, *options)
        if checks.baked(bake):
            said.append(check_cache(kiln, checks, options, bake, rays))
    if len(said) == 2:
        checks.that(said[0]['cached'] == 1 > said[1]['cached'] > 0 and said[1]['bytes'] <= SOME[1] * 2 ** 30 and
                    0 < said[1]['rays_saved'] < said[0]['rays_saved'], 'all and some: %s' % said)
    voxels = compare(kiln, checks, table, 'voxels', CORNELL, *BOX, *VOXELS)
    if voxels is not None:
        checks.that(same_result.points(voxels) != wanted, 'voxels: the bits of rays', voxels.process)
        check_same_bits(kiln, checks, same_result.points(voxels), VOXELS + ALL, ways=ways + lost[1:])
    glass = visibility.with_glass(os.path.join(kiln.scratch, 'glass.glb'))
    for scene, more in ((glass, ()), (CORNELL, ('--order', 'unshot')), (CORNELL, ('--undersample', 'random'))):
        check_scene(kiln, checks, scene, *more)


def check_scene(kiln, checks, scene, *options):
    plain = on(kiln, 'vulkan', scene, *BOX, *options)
    for more in (SOME, ALL):
        bake = on(kiln, 'vulkan', scene, *BOX, *options, *more)
        if checks.baked(plain) and checks.baked(bake):
            checks.that(same_result.points(bake) == same_result.points(plain),
                        '%s %s %s: other bits than by rays' % (scene, options, more), bake.process)
            rays = [sum(b.run['rays'][key] for key in ('bounces', 'rounds', 'emitters')) for b in (plain, bake)]
            checks.that(rays[1] < rays[0], '%s %s %s: %s rays' % (scene, options, more, rays), bake.process)


def check_furnace(kiln, checks, *options):
    with open(harness.own_scene('analytic', 'expected.json')) as file:
        case = {case['id']: case for case in json.load(file)['cases']}['furnace_cube_rho0.5']
    bake = on(kiln, 'vulkan', harness.own_scene('analytic', case['file']), *FEW, '--lights', 'patches',
              '--lightmap-size', 12, *options)
    if checks.baked(bake):
        off = np.abs(bake.points.total[bake.points.valid] / np.asarray(case['uniform_E'], float) - 1).max()
        checks.that(off < 1e-3, 'the furnace is off by %g' % off, bake.process)


def main():
    def add(parser):
        parser.add_argument('--few', action='store_true', help='voxels and a cache alone')

    arguments, kiln = harness.start(__doc__, add)
    kiln.environment['KILN_VULKAN_VALIDATION'] = os.environ.get('KILN_VULKAN_VALIDATION', '1')
    checks = harness.Checks()
    table = harness.Table(('scene', 44), ('rays', 9), ('more', 5), ('median', 8), ('worst', 8), ('apart', 5),
                          ('all', 9))
    if arguments.few:
        check_few(kiln, checks, table)
        checks.end()
        return
    box = compare(kiln, checks, table, 'Cornell box', CORNELL, *BOX)
    if box is not None:
        said = box.run['backend']
        checks.that(said['name'] == 'vulkan' and 'pairs of patches' in said['kernels'], 'run.json says %s' % said)
        check_same_bits(kiln, checks, same_result.points(box))
        check_visibility(kiln, checks, table, same_result.points(box), box.run['rays']['bounces'])
    mixed = compare(kiln, checks, table, ' '.join(map(str, MIXED)), CORNELL, *BOX, *MIXED)
    if mixed is not None:
        check_same_bits(kiln, checks, same_result.points(mixed), MIXED,
                        ways=((3, ('--threads', 1), {}),
                              (0, (), {'KILN_DISPATCH_TIME': '1', 'KILN_GPU_FAULT': 'lost:250'})))
    for more in NODES + RAYS:
        compare(kiln, checks, table, ' '.join(map(str, more)), CORNELL, *BOX, *more)
    for name in filter(harness.own_scene, MORE):
        compare(kiln, checks, table, name, harness.own_scene(name), *FEW, '--texels-per-metre', 2, '--bounces', 1)
    check_furnace(kiln, checks)
    checks.end()


if __name__ == '__main__':
    main()
