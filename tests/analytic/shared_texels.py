"""Charts that share texels: light of one place does not appear at another.

One mesh is two closed rooms, a bright one and a dim one, whose walls lie side by side in its UV set. Each is a furnace:
all walls emit L and have albedo 1/2, so that E is 2 pi L everywhere. At a coarse density walls of both share texels,
and the dim room would reflect the bright one's light. kiln packs the charts anew, in each of these cases: sizes by
density and by number, a small instance of a mesh whose large one has texels enough, and overlapping charts. Rooms whose
inside is the back of double-sided sheets have a lightmap that nobody sees, of half as many texels a side, and light as
well. A layout that is fine enough is kept. `--shared-texels keep` keeps any: then light is wrong, and the note goes.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

BRIGHT, DIM = 30.0, 1.0
SIDE = 2.0  # m
FLOOR = 2 * np.pi


def faces(low, first, gap, outward):
    """Six quads of a room's inside, or of its outside; cell 2 i + first of 4 x 3 each, `gap` apart."""
    positions, layout, triangles = [], [], []
    for i, face in enumerate(glb.FACES):
        a, cell = len(positions), 2 * i + first
        # cells of both rooms lie side by side in each row and each column
        column, row = (cell + cell // 4) % 4, cell // 4
        positions += [np.array(low) + SIDE * np.array(c) for c in face]
        layout += [(0.005 + 0.99 * (column + s * (1 - 4 * gap) + 2 * gap) / 4,
                    0.005 + 0.99 * (row + t * (1 - 3 * gap) + 1.5 * gap) / 3)
                   for s, t in ((0, 1), (1, 1), (1, 0), (0, 0))]
        order = [(a, a + 1, a + 2), (a, a + 2, a + 3)]
        triangles += order if outward else [t[::-1] for t in order]
    return positions, layout, triangles


def rooms(path, gap=0.02, backs=False, instance=None):
    """instance: the scale of a second node of the mesh."""
    scene = glb.Scene()
    for name, low, first, radiance in (('rooms', (0, 0, 0), 0, BRIGHT), ('dim', (4, 0, 0), 1, DIM)):
        material = scene.material(name, (0.5,) * 3, (radiance,) * 3, double_sided=backs)
        scene.mesh(name, *faces(low, first, gap, backs), material)
    document = scene.document
    document['meshes'][0]['primitives'] += document['meshes'].pop()['primitives']
    document['nodes'].pop()
    document['scenes'][0]['nodes'].pop()
    if instance is not None:
        scene.node({'name': 'small', 'mesh': 0, 'scale': [instance] * 3, 'translation': [0, 10, 0]})
    if backs:
        scene.quad('witness', [(4.6, 1, 1.4), (5.4, 1, 1.4), (5.4, 1, 0.6), (4.6, 1, 0.6)], scene.material('black'))
        document['nodes'][-1]['extras'] = {'kiln-role': 'receiver-only'}
    return scene.write(path)


def bake(kiln, scene, direct, *options):
    return kiln.bake(scene, '--samples-direct', direct, '--samples-bounce', kiln.samples(64),
                     '--samples-indirect', kiln.samples(128), '--bounces', 12, '--tail', '--samples-probe', 0,
                     '--denoise', 'none', '--environment', 'none', *options)


def dim_light(found, name, scale=1.0):
    """The least and the most E of the dim room's points, and their mean, as factors on what is right."""
    points, chosen = found.points, found.points.of(found.index(name))
    if name != 'witness':
        chosen = chosen[points.position[chosen, 0] > 3 * scale]
    # kiln's own layouts have slivers at the rims of texels, which lie in the edges of the rooms
    chosen = chosen[points.area[chosen] > 1e-4 * points.area[chosen].max()]
    e = points.total[chosen, 1] / (FLOOR * DIM)
    return e.min(), e.max(), float(np.average(e, weights=points.area[chosen]))


def check(kiln, checks, table, what, scene, options, name='rooms', scale=1.0, wrong=False, anew=True,
          direct=1024):
    found = bake(kiln, scene, direct, *options)
    if not checks.baked(found):
        return
    least, most, mean = dim_light(found, name, scale)
    shared = found.run['points']['shared']
    info = kiln.command('info', scene, *options, '--json')
    packed = any(m['layout'] == 'repacked' for m in info.json()['meshes'])
    table.row(what, shared, 'anew' if packed else 'kept', '%.3f' % least, '%.3f' % most, '%.4f' % mean)
    if wrong:
        checks.that(mean > 2 and shared > 0 and not packed, '%s: the fault does not show: mean %g, %d shared' %
                    (what, mean, shared), found.process)
    else:
        checks.that(shared == 0 and packed == anew, '%s: %d texels are shared, %s' % (what, shared, info.stdout[-400:]),
                    found.process)
        checks.that(abs(mean - 1) < 0.01 and least > 0.95 and most < 1.05,
                    '%s: E / right is %g, from %g to %g' % (what, mean, least, most), found.process)
    found.remove()


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('case', 24), ('shared', 6), ('layout', 6), ('least', 7), ('most', 7), ('mean', 7))
    path = os.path.join(kiln.scratch, 'rooms.glb')
    plain = rooms(path)
    check(kiln, checks, table, '1 texel/m', plain, ('--texels-per-metre', 1))
    check(kiln, checks, table, 'lightmap of 16', plain, ('--lightmap-size', 16))
    check(kiln, checks, table, '1 texel/m, kept', plain, ('--texels-per-metre', 1, '--shared-texels', 'keep'),
          wrong=True)
    if kiln.backend == 'embree':
        check(kiln, checks, table, '10 texels/m', plain, ('--texels-per-metre', 10), anew=False)
        check(kiln, checks, table, 'overlap', rooms(path, gap=-0.004), ('--texels-per-metre', 4))
        check(kiln, checks, table, 'small instance', rooms(path, instance=0.25), ('--texels-per-metre', 10),
              name='small', scale=0.25)
        check(kiln, checks, table, 'backs', rooms(path, backs=True), ('--texels-per-metre', 8), name='witness',
              anew=False)
    checks.end()


if __name__ == '__main__':
    main()
