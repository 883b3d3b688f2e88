"""--method radiosity --patches links: light between points and nodes of a tree (worker/pass/links.h).

- Closed furnaces: every texel within 0.1 %.
- In the Cornell box the light goes to that of all pairs as links' error goes to 0, with fewer rays; at the default it
  is off by no more than that, and its links take 256 bytes a point at most.
- The same bits on 1, 3 and 4 ranks, in other cells, and after an interruption.
- A sealed box in a lit room is black, whatever the error. Materials that are not diffuse are refused.
- In coarse Sponza no texel has light that rays do not find (where the scene is there).
- Energy is kept, and the mean of light stays within 0.8 %, also at 0.1: the nearer part of a node counts as what it
  sends, not as the mean. What links have no use for is refused.
"""
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi'), HERE]
import glb  # noqa: E402
import harness  # noqa: E402
import patches  # noqa: E402
import same_result  # noqa: E402

LINKS = ('--patches', 'links')


def check_error(kiln, checks, table):
    """Light of texels against all pairs: root of the mean square, over that of the light."""
    options = (*patches.PLAIN, '--bounces', 2, '--samples-direct', 64, '--samples-indirect', 64, '--texels-per-metre',
               4, '--method', 'radiosity')
    ways = ((), (*LINKS, '--patches', 'links:0'), LINKS, (*LINKS, '--patches', 'links:0.1'))
    mean = []
    bakes = [kiln.bake(patches.CORNELL, *options, *more) for more in ways]
    if not all([checks.baked(bake) for bake in bakes]):
        return
    area, wanted, off = bakes[0].points.area, bakes[0].points.indirect @ harness.LUMINANCE, []
    rays = [bake.run['rays']['bounces'] for bake in bakes]
    count, size = (np.array([bake.run['links'][key] for bake in bakes[1:]]) / len(area) for key in ('count', 'bytes'))
    print('links a point: %s, bytes: %s' % (count.round(), size.round()))
    checks.that(size[1] <= 256, 'links take %s bytes a point at the default' % size[1])
    checks.that('links' not in bakes[0].run and np.all(np.diff(count) < 0) and np.all(np.diff(size) < 0),
                'links a point: %s, bytes: %s' % (count, size))
    for more, bake in zip(ways[1:], bakes[1:]):
        found = bake.points.indirect @ harness.LUMINANCE
        off.append(np.sqrt((found - wanted) ** 2 @ area / (wanted ** 2 @ area)))
        mean.append(found @ area / (wanted @ area) - 1)
        table.row(' '.join(map(str, more)), '%.2e' % off[-1], '%+.2e' % mean[-1])
        checks.energy(bake, ' '.join(map(str, more)))
    checks.that(max(map(abs, mean)) < 0.008, 'the mean of light is off by %s' % mean)
    checks.that(off[0] < off[1] < 0.015 and off[1] < off[2], 'links: off by %s' % off)
    checks.that(rays[3] < rays[2] < rays[1] < rays[0], 'rays: %s' % rays)


def check_refusals(kiln, checks):
    for more in ((*LINKS, '--clamp'), (*LINKS, '--undersample', 'mipmap'), (*LINKS, '--subdivide', 0.1),
                 ('--link-error', 0.1)):
        process = kiln.bake(patches.CORNELL, '--method', 'radiosity', *more).process
        checks.that(process.status == 64 and ': ' in process.sentence(), '%s was not refused' % (more, ), process)


def inside_charts(bake, layer):
    """Luminance of a layer in all texels that lie wholly inside charts."""
    found = []
    for name in bake.names():
        planes = bake.lightmap(name).channels
        inside = (planes['coverage.Y'] == 1) & (planes['validity.Y'] == 1)
        found.append(np.stack([planes[layer + c][inside] for c in 'RGB'], 1).astype(np.float64) @ harness.LUMINANCE)
    return np.concatenate(found)


def check_tilted(kiln, checks, full):
    """Shading normals that lean away from coarse texels' surface, and texels of several charts beside each other: as
    published, links are as near to rays as their texels let them, and no texel has light that rays do not find. At
    0.2, which takes half of the time; with --full at the default."""
    sponza = os.path.join(harness.SHARED, 'third_party', 'crytek_sponza.glb')
    if not os.path.exists(sponza):
        return
    common = (sponza, *patches.PLAIN, '--quality', 'preview', '--texels-per-metre', 0.35, '--bounces', 1,
              '--materials', 'diffuse')
    rays = kiln.bake(*common, '--samples-indirect', 256, '--denoise', 'none')
    error = () if full else ('--patches', 'links:0.2')
    links = kiln.bake(*common, '--method', 'radiosity', *LINKS, *error, '--denoise', 'auto')
    if not all([checks.baked(bake) for bake in (rays, links)]):
        return
    found, wanted = (inside_charts(bake, 'indirect.') for bake in (links, rays))
    off = np.sqrt(np.mean((found - wanted) ** 2)) / inside_charts(rays, '').mean()
    print('Sponza: off by %.3f of the mean light, most %.3f and %.3f by rays' % (off, found.max(), wanted.max()))
    checks.that(off < 0.06 and found.max() < 2 * wanted.max(),
                'tilted normals: off by %.3f, most %.3f for %.3f' % (off, found.max(), wanted.max()))
    stated = links.run['error']['mean_relative']  # rows that are closed by far do not rule it
    checks.that(stated < 0.3, 'the stated error is %g of the mean light' % stated)


def sealed_box(path):
    """A box of five sheets on the floor of a lit room, nothing in it."""
    scene = glb.Scene()
    white, lamp = scene.material('white', (0.7,) * 3), scene.material('lamp', (0, 0, 0), (20,) * 3)
    paper = scene.material('paper', (0.7,) * 3, double_sided=True)
    glb.box(scene, 'room', (0, 0, 0), (4, 2.5, 4), white, range(6))
    scene.quad('lamp', [(1.5, 2.45, 1.5), (2.5, 2.45, 1.5), (2.5, 2.45, 2.5), (1.5, 2.45, 2.5)], lamp)
    for name, corners in (('a', ('100', '101', '111', '110')), ('b', ('201', '200', '210', '211')),
                          ('c', ('200', '100', '110', '210')), ('d', ('101', '201', '211', '111')),
                          ('e', ('111', '211', '210', '110'))):
        scene.quad(name, [(float(x), 0.8 * float(y), 1 + float(z)) for x, y, z in corners], paper)
    return scene.write(path)


def check_sealed(kiln, checks, table):
    """No node has points of within and without, and none shares a ray with one beyond the wall."""
    path = sealed_box(os.path.join(kiln.scratch, 'sealed.glb'))
    for error in (0.015, 0.1, 0.7) if kiln.backend == 'embree' else (0.1,):
        bake = kiln.bake(path, *patches.PLAIN, '--method', 'radiosity', '--patches', 'links:%g' % error, '--bounces', 3,
                         '--texels-per-metre', 8, '--samples-direct', 16, '--samples-indirect', 64, '--no-stitch')
        if not checks.baked(bake):
            return
        points, edge = bake.points, 0.5 / 8
        x, y, z = points.position.T
        light = points.total @ harness.LUMINANCE
        floor = points.valid & (y < 0.01) & (np.abs(x - 1.5) < 0.5 - edge) & (np.abs(z - 1.5) < 0.5 - edge)
        backs = points.valid & (points.side == 1)
        checks.that(floor.sum() > 30 and backs.sum() > 50 and not light[floor | backs].any(),
                    'links of %g: in a sealed box the light is %g at most' % (error, light[floor | backs].max()),
                    bake.process)
        table.row('sealed box, links:%g' % error, '%g' % light[floor | backs].max(), '')
        bake.remove()


def check_materials(kiln, checks):
    """What is not diffuse is not left out in silence: auto is refused, and --materials diffuse is not."""
    scene = glb.Scene()
    glb.box(scene, 'room', (0, 0, 0), (1, 1, 1), scene.material('white', (0.7,) * 3), range(6))
    scene.quad('mirror', [(0.2, 0.2, 0.01), (0.8, 0.2, 0.01), (0.8, 0.8, 0.01), (0.2, 0.8, 0.01)],
               glb.gloss(scene, 'silver', (0.9,) * 3, 1.0, 0.0))
    path = scene.write(os.path.join(kiln.scratch, 'mirror.glb'))
    for method in (('--method', 'radiosity'), ('--method', 'radiosity', *LINKS)):
        process = kiln.bake(path, *patches.PLAIN, *method, '--texels-per-metre', 4).process
        checks.that(process.status == 64 and "'silver': metal" in process.sentence() and
                    '--materials diffuse' in process.sentence(), 'a mirror was not refused', process)
        checks.baked(kiln.bake(path, *patches.PLAIN, *method, '--texels-per-metre', 4, '--materials', 'diffuse',
                               '--bounces', 1, '--samples-direct', 16, '--samples-indirect', 16))


def main():
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--full', action='store_true', help='Sponza at the default error'))
    checks = harness.Checks()
    table = harness.Table(('scene', 44), ('worst', 10), ('mean', 10))
    known = patches.cases()
    patches.check_furnace(kiln, checks, table, known['furnace_cube_rho0.5'], *LINKS)
    patches.check_furnace(kiln, checks, table, known['furnace_cube_rho0.9'], *LINKS, '--patches', 'links:0.05')
    check_error(kiln, checks, table)
    check_sealed(kiln, checks, table)
    patches.check_same_bits(kiln, checks, *LINKS)
    check_tilted(kiln, checks, arguments.full)
    check_refusals(kiln, checks)
    check_materials(kiln, checks)
    checks.end()


if __name__ == '__main__':
    main()
