"""--method radiosity --gather cosine, even, circles, mixed: light by rays that read single patches.

- Closed furnaces: every texel within 0.1 %.
- A room that the sun lights by an opening in its roof: all ways agree in the mean, and rays to bright patches have at
  most half the error of as many by the cosine.
- The same bits on 1, 3 and 4 ranks, with other cells, and by objects.
- What only pairs of patches have is refused, and so are directions for pairs.
"""
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi'), HERE]
import glb  # noqa: E402
import harness  # noqa: E402
import same_result  # noqa: E402

CORNELL = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
PLAIN = ('--samples-probe', 0, '--no-export', '--denoise', 'none', '--method', 'radiosity')
WAYS = ('cosine', 'even', 'circles', 'mixed')
DOWN = [-0.6532815, 0.2705981, 0.2705981, 0.6532815]  # -z to steeply down


def check_furnaces(kiln, checks, table):
    for name, scale in (('furnace_cube_rho0.5', 2), ('furnace_cube_rho0.9', 10)):
        for way in WAYS:
            bake = kiln.bake(harness.own_scene('analytic', name + '.glb'), *PLAIN, '--lights', 'patches', '--gather',
                             way + ':64', '--lightmap-size', 12)
            if checks.baked(bake):
                total = bake.points.total[bake.points.valid]
                off = np.abs(total / (3 * np.pi * scale) - 1).max()
                table.row(name + ' ' + way, '%.2e' % off, '')
                checks.that(off < 1e-3, '%s, %s: off by %g' % (name, way, off), bake.process)
                bake.remove()


def sun_room(path):
    """4 x 3 x 4 m, with an opening of 0.8 x 0.8 m in the roof, under a sun that comes in askew."""
    scene = glb.Scene()
    grey = scene.material('grey', (0.5, ) * 3)
    scene.quad('floor', [(0, 0, 4), (4, 0, 4), (4, 0, 0), (0, 0, 0)], grey)
    scene.quad('north', [(0, 0, 0), (4, 0, 0), (4, 3, 0), (0, 3, 0)], grey)
    scene.quad('south', [(4, 0, 4), (0, 0, 4), (0, 3, 4), (4, 3, 4)], grey)
    scene.quad('west', [(0, 0, 4), (0, 0, 0), (0, 3, 0), (0, 3, 4)], grey)
    scene.quad('east', [(4, 0, 0), (4, 0, 4), (4, 3, 4), (4, 3, 0)], grey)
    for name, (x0, x1, z0, z1) in (('roof_a', (0, 1.6, 0, 4)), ('roof_b', (2.4, 4, 0, 4)),
                                   ('roof_c', (1.6, 2.4, 0, 1.6)), ('roof_d', (1.6, 2.4, 2.4, 4))):
        scene.quad(name, [(x0, 3, z0), (x1, 3, z0), (x1, 3, z1), (x0, 3, z1)], grey)
    scene.light('sun', {'type': 'directional', 'intensity': 100.0}, rotation=DOWN)
    return scene.write(path)


def check_sun_room(kiln, checks, table):
    path = sun_room(os.path.join(kiln.scratch, 'sun.glb'))
    options = (*PLAIN, '--texels-per-metre', 4, '--bounces', 1, '--samples-direct', 64)
    many = kiln.bake(path, *options, '--gather', 'cosine:8192')
    if not checks.baked(many):
        return
    own, wanted, error = many.points.valid, many.points.indirect[many.points.valid, 0], {}
    for way in WAYS:
        bake = kiln.bake(path, *options, '--gather', way + ':128')
        if not checks.baked(bake):
            return
        got = bake.points.indirect[own, 0]
        error[way], bias = np.sqrt(np.mean((got - wanted) ** 2)) / wanted.mean(), got.mean() / wanted.mean() - 1
        table.row('sun room ' + way, '%.2e' % error[way], '%.2e' % bias)
        checks.that(abs(bias) < 6 * error[way] / np.sqrt(len(got)) + 1e-3, '%s: the mean is off by %g' % (way, bias),
                    bake.process)
    checks.that(error['mixed'] < 0.5 * error['cosine'], 'rays to bright patches have %g of the error by the cosine' %
                (error['mixed'] / error['cosine']))


def check_few(kiln, checks, table):
    """With as few directions as circles take, all indirect light of the Cornell box is right."""
    options = (*PLAIN, '--texels-per-metre', 2, '--bounces', 2, '--samples-direct', 64)
    many, few = (kiln.bake(CORNELL, *options, '--gather', '%s:%d' % (way, count))
                 for way, count in (('cosine', 2048), ('circles', 64)))
    if checks.baked(many) and checks.baked(few):
        power = [(b.points.indirect @ harness.LUMINANCE * b.points.area)[b.points.valid].sum() for b in (many, few)]
        table.row('Cornell box circles', '', '%+.2e' % (power[1] / power[0] - 1))
        checks.that(abs(power[1] / power[0] - 1) < 0.02, '64 circles: off by %g' % (power[1] / power[0] - 1),
                    few.process)


def check_same(kiln, checks):
    for way, lights in (('mixed', 'sampled'), ('even', 'patches')):
        few = (*PLAIN, '--gather', way + ':32', '--lights', lights, '--texels-per-metre', 2, '--bounces', 2,
               '--samples-direct', 16)
        ways = ((0, ()), (3, ('--threads', 1)), (4, ('--threads', 1)), (1, ('--partition', 'objects')),
                (0, ('--cell-size', 0.7)))
        bakes = [kiln.bake(CORNELL, *few, *more, ranks=ranks) for ranks, more in ways]
        if all([checks.baked(bake) for bake in bakes]):
            found = [same_result.points(bake) for bake in bakes]
            for (ranks, more), points in zip(ways[1:], found[1:]):
                checks.that(points == found[0], '%s, %d ranks, %s: other bits' % (way, ranks, ' '.join(map(str, more))))


def check_refusals(kiln, checks):
    for more in (('--directions', 8), ('--clamp', '--gather', 'even'),
                 ('--undersample', 'mipmap', '--gather', 'mixed'), ('--gather', 'circles:5000'),
                 ('--gather', 'circles:32')):
        process = kiln.bake(CORNELL, *PLAIN, *more).process
        checks.that(process.status == 64 and ': ' in process.sentence(), '%s was not refused' % (more, ), process)
    process = kiln.bake(CORNELL, '--gather', 'even').process
    checks.that(process.status == 64 and '--gather' in process.stderr, '--gather beside cells was not refused', process)


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('scene', 44), ('error', 10), ('mean', 10))
    check_furnaces(kiln, checks, table)
    check_sun_room(kiln, checks, table)
    check_few(kiln, checks, table)
    check_same(kiln, checks)
    check_refusals(kiln, checks)
    checks.end()


if __name__ == '__main__':
    main()
