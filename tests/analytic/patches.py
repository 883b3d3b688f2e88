"""--method radiosity: light between patches, pair by pair.

- View factors: opposed and perpendicular rectangles within 0.2 % at every place, their means within 0.05 %; the mean
  over a hollow sphere of which some faces emit within 0.2 %.
- Closed furnaces: every texel within 0.1 %, with nodes of several texels, in rounds and by voxels too.
- In the Cornell box, the finer the texels, the nearer the light of each object is to what paths find, which have no
  bias; where blocks stand on the floor no texel is far off rays.
- The same bits on 1, 3 and 4 ranks, by objects, and after an interruption.
- Energy is kept.
- Nodes of several texels: furnaces as exact; in the Cornell box fewer rays, and light that is off by little, the less
  the smaller the nodes are; no node has texels of two charts.
- --albedo-scale scales one bounce; --clamp takes light away.
- What it has no use for is refused, and so are its options beside other methods.
"""
import json
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi'), HERE]
import closed_forms  # noqa: E402
import glb  # noqa: E402
import harness  # noqa: E402
import same_result  # noqa: E402

CORNELL = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
PLAIN = ('--samples-probe', 0, '--no-export', '--denoise', 'none')
PATCHES = (*PLAIN, '--method', 'radiosity', '--lights', 'patches')


def cases():
    with open(harness.own_scene('analytic', 'expected.json')) as file:
        return {case['id']: case for case in json.load(file)['cases']}


def bake_case(kiln, case, *options):
    return kiln.bake(harness.own_scene('analytic', case['file']), *PATCHES, *options)


def mean(bake, name):
    own = bake.points.of(bake.index(name))
    area = bake.points.area[own]
    return area @ bake.points.total[own] / area.sum()


def check_rectangles(kiln, checks, table, case, size):
    bake = bake_case(kiln, case, '--lightmap-size', size, '--bounces', 0, '--samples-indirect', 256)
    if not checks.baked(bake):
        return
    worst = 0.0
    for sample in case['samples']:
        got = closed_forms.at_layout(bake, sample['node'], *sample['uv1'])[0]
        off = np.abs(got / sample['E'] - 1).max()
        worst = max(worst, off)
        checks.that(off < 0.002, '%s at %s: off by %g' % (case['id'], sample['uv1'], off), bake.process)
    off = max(np.abs(mean(bake, name) / want - 1).max() for name, want in case['mean_E'].items())
    table.row(case['id'], '%.2e' % worst, '%.2e' % off)
    checks.that(off < 5e-4, '%s: the mean is off by %g' % (case['id'], off), bake.process)
    checks.that(worst > 1e-6, '%s: exact to the last digit, so nothing was compared' % case['id'], bake.process)
    bake.remove()


def check_sphere(kiln, checks, table, case):
    """All that is emitted comes to the shell and to the patch: its mean over both."""
    bake = bake_case(kiln, case, '--lightmap-size', 40, '--bounces', 0)
    if checks.baked(bake):
        p, own = bake.points, np.flatnonzero(bake.points.valid)
        got = p.area[own] @ p.total[own, 0] / p.area[own].sum() / (case['samples'][0]['E'][0] * (1 - 0.8)) - 1
        table.row(case['id'], '', '%.2e' % got)
        checks.that(abs(got) < 2e-3, '%s: the mean is off by %g' % (case['id'], got), bake.process)
        bake.remove()


def check_furnace(kiln, checks, table, case, *options):
    bake = bake_case(kiln, case, '--lightmap-size', 12, '--samples-indirect', 64, *options)
    if not checks.baked(bake):
        return
    p, worst = bake.points, 0.0
    total = p.total[p.valid]
    wanted = np.broadcast_to(np.asarray(case['uniform_E'], float), 3)
    worst = np.abs(total / wanted - 1).max()
    table.row(' '.join(map(str, (case['id'], *options))), '%.2e' % worst, '')
    checks.that(worst < 1e-3, '%s: off by %g' % (case['id'], worst), bake.process)
    bake.remove()


def indirect(bake):
    """Power of indirect light on each object."""
    p = bake.points
    power = p.indirect @ harness.LUMINANCE * p.area
    return np.array([power[p.object == i].sum() for i in range(len(bake.names()))])


def check_convergence(kiln, checks, table):
    """Of each object and their sum, relative to all light; the sums of many texels have little noise."""
    options = ('--bounces', 2, '--samples-direct', 64)
    paths = kiln.bake(CORNELL, *PLAIN, *options, '--texels-per-metre', 4, '--method', 'path', '--samples-indirect', 256)
    if not checks.baked(paths):
        return
    wanted, off = indirect(paths), []
    for density in (1, 2, 4):
        bake = kiln.bake(CORNELL, *PLAIN, *options, '--texels-per-metre', density, '--method', 'radiosity')
        if not checks.baked(bake):
            return
        found = indirect(bake)
        off.append(np.abs(found - wanted).sum() / wanted.sum())
        table.row('Cornell box, %d texels/m' % density, '%.2e' % off[-1], '%+.2e' % (found.sum() / wanted.sum() - 1))
        checks.energy(bake, 'Cornell box at %d texels/m' % density)
        bake.remove()
    checks.that(off[0] > off[1] > off[2] and off[2] < 0.01, 'finer texels: off by %s' % off)
    paths.remove()


def check_glass(kiln, checks, table):
    """What lets all light through sends none, but has light of its own."""
    path = os.path.join(kiln.scratch, 'spheres.glb')
    kiln.command('generate', 'cornell-spheres', '-o', path)
    options = (*PLAIN, '--materials', 'diffuse', '--bounces', 2, '--samples-direct', 64, '--texels-per-metre', 2)
    bakes = [kiln.bake(path, *options, *more)
             for more in ((), ('--method', 'radiosity'), ('--method', 'radiosity', '--patches', 'links'))]
    if not all([checks.baked(bake) for bake in bakes]):
        return
    wanted, *found = (indirect(bake) for bake in bakes)
    for name, light in zip(('pairs', 'links'), found):
        off = np.abs(light / wanted - 1)
        table.row('ball of glass, %s' % name, '%.2e' % off.max(), '%+.2e' % (light.sum() / wanted.sum() - 1))
        checks.that(off.max() < 0.05, 'objects about a ball of glass, %s: off by %s' % (name, off), bakes[1].process)
    for bake in bakes:
        bake.remove()


def check_contact(kiln, checks, table):
    """Where blocks stand on the floor and walls meet, texels are cut: none is far off what rays find there."""
    options = (*PLAIN, '--bounces', 1, '--samples-direct', 64, '--texels-per-metre', 3.5)
    rays = kiln.bake(CORNELL, *options, '--schedule', 'equal', '--samples-indirect', 1024)
    bake = kiln.bake(CORNELL, *options, '--method', 'radiosity', '--samples-indirect', 128)
    if not checks.baked(rays) or not checks.baked(bake):
        return
    wanted, found = (b.points.indirect @ harness.LUMINANCE for b in (rays, bake))
    for name in ('floor', 'right_green', 'back'):
        own = bake.points.of(bake.index(name))
        own = own[bake.points.valid[own]]
        off = found[own] - wanted[own]
        worst, rms = np.abs(off / wanted[own]).max(), np.sqrt(np.mean(off ** 2)) / wanted[own].mean()
        table.row('contact: ' + name, '%.2e' % worst, '%.2e' % rms)
        checks.that(worst < 0.6 and rms < 0.06, 'texels of %s are off by %g, %g at most' % (name, rms, worst),
                    bake.process)


def check_nodes(kiln, checks, table):
    options = (*PLAIN, '--bounces', 1, '--samples-direct', 64, '--texels-per-metre', 4, '--method', 'radiosity')
    ways = ((), ('--undersample', 'stride'), ('--undersample', 'random'), ('--undersample', 'mipmap'),
            ('--undersample', 'mipmap:2'), ('--subdivide', 0.02), ('--subdivide', 0.2))
    bakes = [kiln.bake(CORNELL, *options, *more) for more in ways]
    if not all([checks.baked(bake) for bake in bakes]):
        return
    area, wanted = bakes[0].points.area, bakes[0].points.indirect @ harness.LUMINANCE
    rays, off = [bake.run['rays']['bounces'] for bake in bakes], {}
    for more, bake in zip(ways[1:], bakes[1:]):
        found = bake.points.indirect @ harness.LUMINANCE
        rms = np.sqrt((found - wanted) ** 2 @ area / (wanted ** 2 @ area))
        off[more], sum_ = rms, found @ area / (wanted @ area) - 1
        table.row(' '.join(map(str, more)), '%.2e' % rms, '%+.2e' % sum_)
        checks.that(abs(sum_) < 0.03 and 1e-4 < rms < 0.15,
                    '%s: the sum is off by %g, texels by %g' % (more, sum_, rms), bake.process)
    checks.that(off[ways[4]] < off[ways[3]] < min(off[ways[1]], off[ways[2]]), 'windows: %s' % off)
    checks.that(off[ways[5]] < off[ways[6]], 'subdivision: %s' % off)
    checks.that(max(rays[1:4]) < 0.2 * rays[0] and rays[4] < 0.4 * rays[0] and rays[6] < rays[5] < 0.9 * rays[0],
                'rays: %s' % rays)
    for bake in bakes:
        bake.remove()


def check_charts(kiln, checks):
    """A lamp over a square; far away another, of the same object and in the same window of its lightmap."""
    scene, corners = glb.Scene(), np.array([(-0.5, 2, 0.5), (-0.5, 2, -0.5), (0.5, 2, -0.5), (0.5, 2, 0.5)])
    layout = np.array([(0, 1), (0, 0), (0.4375, 0), (0.4375, 1)])
    scene.mesh('lamps', np.concatenate([corners, corners + (20, 0, 0)]), np.concatenate([layout, layout + (0.5625, 0)]),
               [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)], scene.material('light', radiance=(1, 1, 1)))
    scene.quad('floor', [(-0.5, 0, 0.5), (0.5, 0, 0.5), (0.5, 0, -0.5), (-0.5, 0, -0.5)],
               scene.material('grey', (0.5, ) * 3))
    path = scene.write(os.path.join(kiln.scratch, 'lamps.glb'))
    options = (*PATCHES, '--lightmap-size', 16, '--bounces', 0, '--samples-direct', 1)
    ways = ((), ('--undersample', 'mipmap:64'), ('--subdivide', '1000:64'))
    bakes = [kiln.bake(path, *options, *more) for more in ways]
    if all([checks.baked(bake) for bake in bakes]):
        light = [mean(bake, 'floor')[0] for bake in bakes]
        checks.that(abs(light[0] / 0.216 - 1) < 0.02 and np.allclose(light, light[0], rtol=0.02),
                    'nodes across charts: %s' % light, bakes[1].process)


def check_scaled(kiln, checks):
    options = (*PLAIN, '--bounces', 1, '--samples-direct', 16, '--texels-per-metre', 2, '--method', 'radiosity')
    bright = ('--lights', 'patches', '--bounces', 0)  # a lamp's patch brings far more than 0.05
    ways = ((), ('--albedo-scale', 0.5), bright, (*bright, '--clamp'))
    bakes = [kiln.bake(CORNELL, *options, *more) for more in ways]
    full, half, free, clamped = bakes
    if all([checks.baked(bake) for bake in bakes]):
        checks.that(np.allclose(half.points.indirect, 0.5 * full.points.indirect, rtol=1e-6, atol=0),
                    '--albedo-scale 0.5 is not half of one bounce', half.process)
        checks.energy(half, '--albedo-scale 0.5')
        said = [tuple(bake.run['job'][key] for key in ('lights', 'clamp', 'albedo_scale')) for bake in bakes]
        wanted = [('sampled', False, 1), ('sampled', False, 0.5), ('patches', False, 1), ('patches', True, 1)]
        checks.that(said == wanted, 'run.json has other settings: %s' % said, half.process)
        ratio = clamped.points.direct.sum() / free.points.direct.sum()
        checks.that(0.001 < ratio < 0.9, '--clamp leaves %g of the direct light' % ratio, clamped.process)


def check_triangle(kiln, checks, table):
    """A floor outdoors under a lamp of one triangle, which few of the rays that close rows meet, or none: patches bring
    what samples of the lamp do."""
    scene = glb.Scene()
    scene.quad('floor', [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], scene.material('white', (0.5,) * 3))
    scene.mesh('lamp', [(-0.5, 2, -0.5), (0.5, 2, -0.5), (0, 2, 0.6)], [(0, 0), (1, 0), (0.5, 1)], [(0, 1, 2)],
               scene.material('lamp', (0, 0, 0), (10,) * 3))
    path = scene.write(os.path.join(kiln.scratch, 'triangle.glb'))
    few = (*PLAIN, '--method', 'radiosity', '--texels-per-metre', 4, '--bounces', 0, '--samples-direct', 256,
           '--samples-indirect', 64)
    true = kiln.bake(path, *few, '--lights', 'sampled')
    for more in ((), ('--patches', 'links')):
        bake = kiln.bake(path, *few, '--lights', 'patches', *more)
        if not checks.baked(true) or not checks.baked(bake):
            return
        floor = true.points.of(true.index('floor'))
        found, wanted = bake.points.total[floor, 1], true.points.total[floor, 1]
        worst, mean = np.abs(found / wanted - 1).max(), found.sum() / wanted.sum() - 1
        table.row(' '.join(('triangle', *more)), '%.2e' % worst, '%+.2e' % mean)
        checks.that(worst < 0.02 and abs(mean) < 0.005, 'under a triangle: the mean is off by %g, a texel by %g' %
                    (mean, worst), bake.process)


def check_same(kiln, checks):
    check_same_bits(kiln, checks)
    check_same_bits(kiln, checks, '--undersample', 'random')


def check_same_bits(kiln, checks, *nodes):
    few = (*PATCHES, '--texels-per-metre', 2, '--bounces', 2, '--samples-indirect', 32, '--samples-direct', 16,
           *nodes)
    ways = ((0, ()), (3, ('--threads', 1)), (4, ('--threads', 1)), (1, ('--partition', 'objects')),
            (0, ('--cell-size', 0.7)))
    bakes = [kiln.bake(CORNELL, *few, *more, ranks=ranks) for ranks, more in ways]
    if not all([checks.baked(bake) for bake in bakes]):
        return
    found = [same_result.points(bake) for bake in bakes]
    for (ranks, more), points in zip(ways[1:], found[1:]):
        checks.that(points == found[0], '%d ranks, %s: other bits' % (ranks, ' '.join(map(str, more))))
    check_interrupted(kiln, checks, few, found[0])
    sampled = kiln.bake(CORNELL, *few, '--lights', 'sampled')
    checks.that(checks.baked(sampled) and same_result.points(sampled) != found[0],
                'lamps that are sampled give the same bits as patches: the comparison sees nothing')


def check_interrupted(kiln, checks, few, wanted):
    """A rank that is slow reaches its time limit, and the same command goes on: twice at least."""
    folder, times = os.path.join(kiln.scratch, 'interrupted'), 0
    command = [kiln.path, 'bake', CORNELL, '-o', folder, '--quiet', '--no-preview', '--backend', 'embree',
               *map(str, few), '--threads', '1', '--max-time']
    process = harness.run(command + ['0.1'], environment={**kiln.environment, 'KILN_SLOW_RANK': '0:8'})
    while process.status == 75 and times < 20:
        times += 1
        process = harness.run(command + [str(0.1 * 1.3 ** times)],
                              environment={**kiln.environment, 'KILN_SLOW_RANK': '0:8'})
    checks.that(process.status == 0 and times >= 2, 'interrupted %d times, ended with %d' % (times, process.status),
                process)
    if process.status == 0:
        checks.that(same_result.points(harness.Bake(folder, process)) == wanted, 'after interruptions: other bits',
                    process)


def check_refusals(kiln, checks):
    refused = [('radiosity', more) for more in (
        ('--error-map', ), ('--target-error', 0.1), ('--schedule', 'equal'), ('--schedule', 'lean'),
        ('--samples-bounce', 4), ('--indirect-scale', 4), ('--materials', 'full'), ('--caustics', 'gather'),
        ('--tracing-range', 1), ('--exchange-points', 'visible'), ('--merge-radius', 0.1), ('--sampling-window', 2),
        ('--node-max', 2), ('--undersample', 'mipmap', '--subdivide', 0.1),
        ('--undersample', 'mipmap', '--store', 'octree'))]
    refused += [('cells', ('--lights', 'patches')), ('path', ('--lights', 'patches')), ('cells', ('--clamp', )),
                ('cells', ('--undersample', 'stride')), ('cells', ('--subdivide', 0.1))]
    for method, more in refused:
        process = kiln.bake(CORNELL, '--method', method, *more).process
        checks.that(process.status == 64 and more[0] in process.stderr and ': ' in process.sentence(),
                    '%s beside --method %s was not refused: %d, %s' % (more, method, process.status, process.stderr))


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('scene', 44), ('worst', 10), ('mean', 10))
    known = cases()
    check_rectangles(kiln, checks, table, known['par_rect'], 24)
    check_rectangles(kiln, checks, table, known['perp_rect'], 56)
    check_sphere(kiln, checks, table, known['hollow_sphere_patch'])
    check_furnace(kiln, checks, table, known['furnace_cube_rho0.5'])
    check_furnace(kiln, checks, table, known['furnace_cube_rho0.9'])
    for more in (('--undersample', 'stride'), ('--undersample', 'random'), ('--undersample', 'mipmap'),
                 ('--subdivide', 0.5), ('--order', 'unshot'), ('--visibility', 'voxels')):
        check_furnace(kiln, checks, table, known['furnace_cube_rho0.5'], *more)
    check_convergence(kiln, checks, table)
    check_contact(kiln, checks, table)
    check_triangle(kiln, checks, table)
    check_glass(kiln, checks, table)
    check_nodes(kiln, checks, table)
    check_charts(kiln, checks)
    check_scaled(kiln, checks)
    check_same(kiln, checks)
    check_refusals(kiln, checks)
    checks.end()


if __name__ == '__main__':
    main()
