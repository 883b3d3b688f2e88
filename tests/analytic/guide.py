"""Gathers that are guided (--guide auto) have the light of those that are not, and less noise where light is far.

- A room that is lit through the gap below a wall: the dark part has the same light within 1 % in the mean, and with the
  same rays half of the squared error relative to each texel's light at most. Energy is kept.
- A closed furnace of albedo 0.8 has pi e / (1 - rho) within 1 %.
- A dark room behind a wall has 1e-4 of the light of the lit one at most (walls.py).
- The same bits on 1 and 3 ranks, with cells of another size, by objects, with what is seen alone sent.
- Without bounces to learn from, and where light comes from all over, the bits of a bake without a guide.

With --backend vulkan the first, guided there and by Embree not, and the same bits after the device was lost and,
without --few, on ranks in dispatches of any size.
"""
import math
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi'), HERE]
import extremes  # noqa: E402
import harness  # noqa: E402
import same_result  # noqa: E402
import walls  # noqa: E402

FEW = ('--samples-probe', 0, '--no-export', '--no-preview', '--denoise', 'none')


def lit_through_gap(kiln, *more, size=48, bounce=32, indirect=64, ranks=0):
    """A bake of the room."""
    scene = walls.room(os.path.join(kiln.scratch, 'gap.glb'), 0, 0.01, gap=0.3)
    return kiln.bake(scene, *FEW, '--lightmap-size', size, '--samples-direct', 64, '--samples-bounce', bounce,
                     '--samples-indirect', indirect, '--bounces', 4, *more, ranks=ranks)


def in_the_dark(bake):
    """Indirect light, W/m2, and area of the texels behind the wall, in the order of their texels."""
    p = bake.points
    order = np.lexsort((p.x, p.y, p.side, p.object))
    chosen = order[(p.position[order, 0] > walls.WALL + 0.1) & p.valid[order].astype(bool)]
    return p.indirect[chosen] @ harness.LUMINANCE, p.area[chosen]


def check_gap(kiln, checks, table):
    backend = kiln.backend
    guided = lit_through_gap(kiln, '--guide', 'auto', '--seed', 1)
    kiln.backend = 'embree'
    bakes = [lit_through_gap(kiln, '--guide', 'none', '--seed', 1), guided,
             lit_through_gap(kiln, '--seed', 2, bounce=128, indirect=1024)]
    kiln.backend = backend
    if not all([checks.baked(bake) for bake in bakes]):
        return
    (plain, area), (guided, _), (want, _) = [in_the_dark(bake) for bake in bakes]
    errors = [math.sqrt(np.mean((light / want - 1)**2)) for light in (plain, guided)]
    sums = [(light @ area) / (want @ area) - 1 for light in (plain, guided)]
    table.row('lit through a gap', '%+.2e' % sums[0], '%.2e' % errors[0])
    table.row('the same, guided', '%+.2e' % sums[1], '%.2e' % errors[1])
    checks.that(abs(sums[1]) < 0.01, 'lit through a gap: the mean is off by %g' % sums[1], bakes[1].process)
    checks.that(errors[1]**2 < 0.5 * errors[0]**2, 'lit through a gap: error %g, %g without' % (errors[1], errors[0]),
                bakes[1].process)
    checks.energy(bakes[1], 'lit through a gap')
    for bake in bakes:
        bake.remove()


def check_furnace(kiln, checks, table):
    rho = 0.8
    want = math.pi / (1 - rho)
    scene = extremes.furnace(os.path.join(kiln.scratch, 'furnace.glb'), rho)
    bakes = [kiln.bake(scene, '--texels-per-metre', 8, *FEW, '--samples-direct', 256, '--samples-bounce', 16,
                       '--samples-indirect', 64, '--guide', guide) for guide in ('auto', 'none')]
    if not all([checks.baked(bake) for bake in bakes]):
        return
    p = bakes[0].points
    mean, worst = (p.total[:, 1] @ p.area) / p.area.sum() / want - 1, np.abs(p.total[:, 1] / want - 1).max()
    table.row('furnace', '%+.2e' % mean, '%.2e' % worst)
    checks.that(abs(mean) < 0.01 and worst < 0.03, 'furnace: the mean is off by %g, a texel by %g' % (mean, worst),
                bakes[0].process)
    checks.that(same_result.points(bakes[0]) == same_result.points(bakes[1]), 'furnace: a guide where light is even',
                bakes[0].process)


def check_wall(kiln, checks, table, degrees, thickness, texels):
    found = walls.bake_room(kiln, checks, degrees, thickness, texels, more=('--guide', 'auto'))
    if found is not None:
        table.row('wall, %g degrees, %g mm' % (degrees, 1000 * thickness), '%.1e' % found[0], '')
        checks.that(found[0] <= 1e-4, 'wall, %g degrees: dark / lit is %g' % (degrees, found[0]), found[2])


def check_same(kiln, checks):
    few = {'size': 24, 'bounce': 8, 'indirect': 16}
    guide = ('--guide', 'auto')
    ways = ((0, guide), (3, (*guide, '--threads', 1)), (1, (*guide, '--partition', 'objects')),
            (0, (*guide, '--cell-size', 0.35)),
            (3, (*guide, '--exchange-points', 'visible', '--shared-memory-ranks', 1)), (0, ()),
            (0, (*guide, '--bounces', 1)), (0, ('--bounces', 1)))
    bakes = [lit_through_gap(kiln, *more, ranks=ranks, **few) for ranks, more in ways]
    if not all([checks.baked(bake) for bake in bakes]):
        return
    points = [same_result.points(bake) for bake in bakes]
    for (ranks, more), found in zip(ways[1:5], points[1:5]):
        checks.that(found == points[0], 'guided, %d ranks, %s: other bits' % (ranks, ' '.join(map(str, more))))
    checks.that(points[5] != points[0], 'a guide gives the same bits as none: the comparison sees nothing')
    checks.that(points[6] == points[7], 'other bits where there was nothing to learn from')


def check_device(kiln, checks, ways):
    few = {'size': 24, 'bounce': 8, 'indirect': 16}
    first = lit_through_gap(kiln, '--guide', 'auto', **few)
    if not checks.baked(first):
        return
    for ranks, more, fault in ways:
        with kiln.under(**fault):
            bake = lit_through_gap(kiln, '--guide', 'auto', *more, ranks=ranks, **few)
        if not checks.baked(bake):
            continue
        checks.that(same_result.points(bake) == same_result.points(first),
                    'guided, %d ranks, %s, %s: other bits' % (ranks, ' '.join(map(str, more)), fault), bake.process)
        found = bake.run['backend']
        checks.that((found['recoveries'] > 0) == ('KILN_GPU_FAULT' in fault) and
                    (found['verified_texels'] > 0) == (not ranks), 'recovered %d times, %d texels compared' %
                    (found['recoveries'], found['verified_texels']), bake.process)


def main():
    arguments, kiln = harness.start(__doc__, lambda parser: parser.add_argument('--few', action='store_true',
                                                                                help='fewer kernels to make'))
    checks = harness.Checks()
    table = harness.Table(('scene', 28), ('sum', 10), ('rms or worst', 14))
    check_gap(kiln, checks, table)
    if kiln.backend == 'vulkan':
        on_ranks = 3, (), {'KILN_DISPATCH_TIME': 1}
        lost = 0, ('--verify-fraction', 1), {'KILN_GPU_FAULT': 'lost:200'}
        check_device(kiln, checks, [lost] if arguments.few else [on_ranks, lost])
        checks.end()
        return
    check_furnace(kiln, checks, table)
    for degrees, thickness, texels in ((0, 0.01, 24), (17, 0, 24)):
        check_wall(kiln, checks, table, degrees, thickness, texels)
    check_same(kiln, checks)
    for more in (('--schedule', 'equal'), ('--store', 'octree'), ('--indirect-scale', '4'), ('--final-scale', '2')):
        refused = kiln.bake(os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb'), '--guide', 'auto', *more)
        checks.that(refused.process.status == 64 and '--guide' in refused.process.stderr,
                    '%s was not refused: %d' % (more, refused.process.status), refused.process)
    checks.end()


if __name__ == '__main__':
    main()
