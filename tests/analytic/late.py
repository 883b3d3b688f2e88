"""Late bounces, which leave out tiles where little is left: a white box with a slit in its lid, beside a street
under a sky. Against as many bounces that leave nothing out: the same light outside, less rays; against many more
bounces: the light in the box. The same bits for any cells and ranks, and the same light from both
backends. Small closed boxes beside a large street, which the scene's powers do not show: against 1 / (1 - albedo); and
one that keeps its light for too long, which is said. A dark room behind a bright one. The insides of a solid, which are
no result.

  /usr/bin/python3 tests/analytic/late.py --kiln build/release/kiln [--backend vulkan [--few]]

--few: late bounces on two ranks, against Embree, and no longer bakes; for slow devices.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

OPTIONS = ('--texels-per-metre', 6, '--samples-probe', 0, '--no-export', '--denoise', 'none', '--samples-direct', 16,
           '--samples-bounce', 4, '--samples-indirect', 16)
LEFT = 5e-4  # of a tile's light, when it is left out; KILN_LATE_LEFT
FIRST = 9    # the first late bounce
SLIT = 0.05  # m
GAP = 0.003  # m, between two rooms
IN_BOX = 0.02  # of its light that may be off: tiles' errors with which bounces end


def pocket(path):
    """A street of 12 m, its walls 3 m high, of albedo 0.9; a box of 1 m, open on top by a slit, of albedo 0.98."""
    scene = glb.Scene()
    scene.environment((1, 1, 1))
    grey, white = scene.material('grey', (0.9, 0.9, 0.9)), scene.material('white', (0.98, 0.98, 0.98))
    scene.quad('floor', [(0, 0, 3), (12, 0, 3), (12, 0, 0), (0, 0, 0)], grey)
    scene.quad('wall', [(0, 0, 0), (12, 0, 0), (12, 3, 0), (0, 3, 0)], grey)
    scene.quad('other wall', [(12, 0, 3), (0, 0, 3), (0, 3, 3), (12, 3, 3)], grey)
    low = np.array((-3.0, 0.0, 0.0))
    for i, face in enumerate(glb.FACES):
        corners = low + np.array(face[::-1], float)
        if i != 4:
            scene.quad('side %d' % i, corners, white)
            continue
        for name, begin, end in (('left', 0, 0.5 - SLIT / 2), ('right', 0.5 + SLIT / 2, 1)):
            part = corners.copy()
            part[:, 0] = low[0] + np.where(part[:, 0] > low[0] + 0.5, end, begin)
            scene.quad('lid ' + name, part, white)
    return scene.write(path)


def closed(path, *boxes):
    """A street of 40 m, and closed boxes of half a metre with (albedo, radiance of the lid) beside it."""
    scene = glb.Scene()
    scene.environment((0.1, 0.1, 0.1))
    grey = scene.material('grey', (0.9, 0.9, 0.9))
    scene.quad('floor', [(0, 0, 6), (40, 0, 6), (40, 0, 0), (0, 0, 0)], grey)
    scene.quad('wall', [(0, 0, 0), (40, 0, 0), (40, 6, 0), (0, 6, 0)], grey)
    scene.quad('other wall', [(40, 0, 6), (0, 0, 6), (0, 6, 6), (40, 6, 6)], grey)
    for b, (albedo, radiance) in enumerate(boxes):
        white = scene.material('white %d' % b, (albedo,) * 3)
        lid = scene.material('lid %d' % b, (albedo,) * 3, (radiance,) * 3)
        for i, face in enumerate(glb.FACES):
            corners = np.array((-3.0, 0.0, 2.0 * b)) + 0.5 * np.array(face[::-1], float)
            scene.quad('box %d side %d' % (b, i), corners, lid if i == 4 else white)
    return scene.write(path)


def gained(bake, box):
    """All light in a closed box over the direct light."""
    p = bake.points
    inside = np.isin(p.object, [i for i, n in enumerate(bake.names()) if n.startswith('box %d ' % box)])
    mean = lambda light: light[inside] @ harness.LUMINANCE @ p.area[inside]
    return mean(p.total) / mean(p.direct)


def check_closed(kiln, checks):
    options = ('--texels-per-metre', 8, '--samples-probe', 0, '--no-export', '--denoise', 'none', '--samples-direct',
               64, '--samples-bounce', 8, '--samples-indirect', 32)
    off = 0.04  # of all light: noise of few texels, and what the tail may be off by
    boxes = ((0.96, 0.02), (0.9, 0.1))
    scene = closed(os.path.join(kiln.scratch, 'closed.glb'), *boxes)
    bakes = [kiln.bake(scene, *options, ranks=ranks) for ranks in (0, 3)]
    if all([checks.baked(bake) for bake in bakes]):
        for b, (albedo, _) in enumerate(boxes):
            found = gained(bakes[0], b) * (1 - albedo)
            print('closed box of albedo %g: %.4f of its light, %d bounces' %
                  (albedo, found, bakes[0].run['indirect_bounces']))
            checks.that(abs(found - 1) < off, 'a closed box of albedo %g has %g of its light' % (albedo, found))
        checks.that(np.array_equal(*(indirect(bake)[0] for bake in bakes)), 'closed boxes: 3 ranks have other bits')
        said = [n for n in bakes[0].run['notes'] if 'converged' in n]
        checks.that(said == [], 'closed boxes: %s' % said)
    # the brighter box hides the ratio of the darker one for longer than bounces go on
    albedo = 0.998
    bake = kiln.bake(closed(os.path.join(kiln.scratch, 'long.glb'), (albedo, 5e-4), (0.995, 5)), *options)
    if checks.baked(bake):
        said = [n for n in bake.run['notes'] if 'small closed places' in n]
        found, stated = gained(bake, 0) * (1 - albedo), bake.run['tail']['tile_error']
        print('closed box of albedo %g: %.4f of its light, %d bounces, stated error %.3f' %
              (albedo, found, bake.run['indirect_bounces'], stated))
        checks.that(len(said) == 1 and abs(abs(found - 1) - stated) < 0.1,
                    'a box that keeps its light for long has %g of it, stated error %g, %s' % (found, stated, said))


def check_pocket(kiln, checks):
    """A closed box of a white material that is a part of the street's floor: bounces end when its mean is known, and
    a note names object and material."""
    scene = glb.Scene()
    scene.environment((0.1, 0.1, 0.1))
    grey, plaster = scene.material('grey', (0.6, 0.6, 0.6)), scene.material('plaster', (0.99, 0.99, 0.99))
    lid = scene.material('lid', (0.6, 0.6, 0.6), (0.02, 0.02, 0.02))
    scene.quad('floor', [(0, 0, 6), (20, 0, 6), (20, 0, 0), (0, 0, 0)], grey)
    for i, face in enumerate(glb.FACES):
        # the lamp under the lid is hidden in the box, and most of its light is taken by nothing
        corners = np.array((-3.0, 0.0, 0.0)) + 0.3 * np.array(face[::-1], float)
        scene.quad('side %d' % i, corners, plaster)
    scene.quad('lamp', np.array((-2.9, 0.29, 0.1)) + 0.02 * np.array([(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]), lid)
    scene.quad('wall', [(0, 0, 0), (20, 0, 0), (20, 6, 0), (0, 6, 0)], grey)
    document = scene.document
    document['meshes'][0]['primitives'] += [p for m in document['meshes'][1:7] for p in m['primitives']]
    for primitive in document['meshes'][0]['primitives']:
        primitive['attributes'].pop('TEXCOORD_1')
    document['scenes'][0]['nodes'] = [0, 7, 8]
    path = scene.write(os.path.join(kiln.scratch, 'pocket of floor.glb'))
    options = ('--texels-per-metre', 6, '--samples-probe', 0, '--no-export', '--denoise', 'none', '--samples-direct',
               64, '--samples-bounce', 8, '--samples-indirect', 64)
    ended, long = kiln.bake(path, *options), kiln.bake(path, *options, '--bounces', 200)
    if not all([checks.baked(bake) for bake in (ended, long)]):
        return
    means = [b.points.total[b.points.object == 0] @ harness.LUMINANCE @ b.points.area[b.points.object == 0]
             for b in (ended, long)]
    tail, said = ended.run['tail'], [n for n in ended.run['notes'] if 'small closed places' in n]
    print('pocket of an object: %d bounces, its mean off by %+.2e, stated %.2e; a tile by %.2f' %
          (ended.run['indirect_bounces'], means[0] / means[1] - 1, tail['object_error'], tail['tile_error']))
    checks.that(ended.run['indirect_bounces'] < 40, 'a pocket asks for %d bounces' % ended.run['indirect_bounces'],
                ended.process)
    checks.that(abs(means[0] / means[1] - 1) < 0.01, 'the mean is off by %g' % (means[0] / means[1] - 1), ended.process)
    checks.that(len(said) == 1 and "'floor'" in said[0] and "'plaster'" in said[0], 'said: %s' % said, ended.process)


def rooms(path):
    """A room of albedo 0.9 with a lamp, with a gap in one wall, and a dark room of albedo 0.5 behind it."""
    scene = glb.Scene()
    white, grey = scene.material('white', (0.9, 0.9, 0.9)), scene.material('grey', (0.5, 0.5, 0.5))
    lamp = scene.material('lamp', (0.5, 0.5, 0.5), (10, 10, 10))
    for name, low, material, slit in (('bright', (0, 0, 0), white, 1), ('dark', (2, 0, 0), grey, 0)):
        for i, face in enumerate(glb.FACES):
            corners = 2 * np.array(face[::-1], float)
            if not np.all(corners[:, 0] == 2 * slit):
                scene.quad('%s %d' % (name, i), corners + low, material)
                continue
            for side, begin, end in (('left', 0, 1 - GAP / 2), ('right', 1 + GAP / 2, 2)):
                part = corners.copy()
                part[:, 2] = np.where(part[:, 2] > 1, end, begin)
                scene.quad('%s %s' % (name, side), part + low, material)
    scene.quad('lamp', np.array((0.5, 1.9, 0.5)) + 0.5 * np.array([(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]), lamp)
    return scene.write(path)


def check_dark(kiln, checks):
    """A dark room, whose light falls faster from bounce to bounce than that of the bright room: bounces go on until its
    mean is known, too."""
    path = rooms(os.path.join(kiln.scratch, 'rooms.glb'))
    options = ('--texels-per-metre', 12, '--samples-probe', 0, '--no-export', '--denoise', 'none', '--samples-direct',
               16, '--samples-bounce', 256, '--samples-indirect', 256)
    ended, long = kiln.bake(path, *options), kiln.bake(path, *options, '--bounces', 60)
    if not all([checks.baked(bake) for bake in (ended, long)]):
        return
    off = {o['name']: o['mean'] / p['mean'] - 1 for o, p in zip(ended.run['objects'], long.run['objects'])}
    dark = [off[name] for name in off if name.startswith('dark')]
    print('dark room: %d bounces, %s, off by %+.4f in the mean, %+.4f at most' %
          (ended.run['indirect_bounces'], ended.run['tail']['ratio'][0], np.mean(dark), max(dark, key=abs)))
    checks.that(max(map(abs, dark)) < 0.003, 'a dark room is off by %g' % max(dark, key=abs), ended.process)


def check_solid(kiln, checks):
    """A closed white box whose triangles are double-sided, with a lamp in it: its insides are published by nothing, and
    ask for no bounces. Published, they do."""
    scene = glb.Scene()
    scene.environment((0.1, 0.1, 0.1))
    grey, lid = scene.material('grey', (0.6, 0.6, 0.6)), scene.material('lid', (0.6, 0.6, 0.6), (0.5, 0.5, 0.5))
    white = scene.material('white', (0.99, 0.99, 0.99), double_sided=True)
    scene.quad('floor', [(0, 0, 6), (20, 0, 6), (20, 0, 0), (0, 0, 0)], grey)
    scene.quad('wall', [(0, 0, 0), (20, 0, 0), (20, 6, 0), (0, 6, 0)], grey)
    for i, face in enumerate(glb.FACES):
        scene.quad('side %d' % i, np.array((2.0, 0.5, 2.0)) + 0.5 * np.array(face, float), white)
    scene.quad('lamp', np.array((2.2, 0.7, 2.2)) + 0.06 * np.array([(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]), lid)
    path = scene.write(os.path.join(kiln.scratch, 'solid.glb'))
    options = ('--texels-per-metre', 6, '--samples-probe', 0, '--no-export', '--denoise', 'none', '--samples-direct',
               64, '--samples-bounce', 8, '--samples-indirect', 64)
    ended, shown = kiln.bake(path, *options), kiln.bake(path, *options, '--sides', 'two')
    long = kiln.bake(path, *options, '--bounces', 60, '--tail')
    if not all([checks.baked(bake) for bake in (ended, shown, long)]):
        return
    bounces, longer = (bake.run['indirect_bounces'] for bake in (ended, shown))
    fronts = [o['mean'] / p['mean'] - 1 for o, p in zip(ended.run['objects'], long.run['objects'])]
    off = max(map(abs, fronts[:8]))
    print('insides of a solid: %d bounces, %d where they are published; fronts off by %.2e' % (bounces, longer, off))
    checks.that(bounces < 24, 'insides that nothing publishes ask for %d bounces' % bounces, ended.process)
    checks.that(longer > bounces + 8, 'insides that are published have only %d bounces' % longer, shown.process)
    checks.that(off < 0.005, 'fronts are off by %g' % off, ended.process)


def indirect(bake):
    """(luminance of indirect light, area, whether it is in the box) of all points by object and texel."""
    p = bake.points
    order = np.lexsort((p.x, p.y, p.object))
    return (p.indirect[order] @ harness.LUMINANCE, p.area[order], p.position[order][:, 0] < -1)


def off_by(bake, other):
    """{part: (mean, rms)} of what a bake's light is off by: each texel's final gather has the same rays in both."""
    (found, area, inside), (expected, _, _) = indirect(bake), indirect(other)
    result = {}
    for name, part in (('in the box', inside), ('outside', ~inside)):
        off = found[part] - expected[part]
        result[name] = (float(off @ area[part] / (expected[part] @ area[part])),
                        float(np.sqrt(np.mean(off ** 2)) / expected[part].mean()))
    return result


def late_share(late, full):
    """Rays of late bounces over those of as many that leave nothing out."""
    samples = np.array([(b['bounce'], b['samples']) for b in full.run['bounces'] if b['kind'] == 'bounce'])
    share = samples[samples[:, 0] >= FIRST, 1].sum() / samples[:, 1].sum()
    return 1 - (1 - late.run['rays']['bounces'] / full.run['rays']['bounces']) / share


def compare(checks, late, full, converged):
    share, off = late_share(late, full), off_by(late, full)
    before, after = off_by(full, converged), off_by(late, converged)
    print('rays of late bounces: %.3f' % share)
    for name in off:
        print('%-12s against full %+.2e, rms %.2e; against converged %+.2e, rms %.2e (full %+.2e, rms %.2e)' %
              (name, *off[name], *after[name], *before[name]))
    checks.that(share < 0.9, 'late bounces have %.2f of the rays' % share)
    mean, rms = off['outside']
    checks.that(0 < rms < LEFT and abs(mean) < LEFT, 'outside, light is off by %g, rms %g' % (mean, rms))
    checks.that(abs(after['outside'][0]) < abs(before['outside'][0]) + 4 * LEFT,
                'outside, light is off by %g, with full bounces %g' % (after['outside'][0], before['outside'][0]))
    checks.that(abs(after['in the box'][0]) < IN_BOX, 'in the box, light is off by %g' % after['in the box'][0])


def main():
    arguments, kiln = harness.start(__doc__, lambda p: p.add_argument('--few', action='store_true'))
    checks = harness.Checks()
    scene = pocket(os.path.join(kiln.scratch, 'pocket.glb'))
    late = kiln.bake(scene, *OPTIONS)
    if not checks.baked(late):
        checks.end()
    bounces = late.run['indirect_bounces']
    print('%d bounces, %d rays of them; tail %s' % (bounces, late.run['rays']['bounces'], late.run['tail']))
    checks.that(bounces > FIRST + 4, 'there are %d bounces, too few for late ones' % bounces)
    if not arguments.few:
        full = kiln.bake(scene, *OPTIONS, '--bounces', bounces, '--tail')
        converged = kiln.bake(scene, *OPTIONS, '--bounces', 10 * bounces, '--tail')
        if checks.baked(full) and checks.baked(converged):
            compare(checks, late, full, converged)
    ways = ((2, ('--partition', 'objects', '--threads', 1)), (0, ('--cell-size', 0.37)), (3, ()))
    for ranks, options in ways[:1] if arguments.few else ways:
        bake = kiln.bake(scene, *OPTIONS, *options, ranks=ranks)
        if checks.baked(bake):
            checks.that(np.array_equal(indirect(bake)[0], indirect(late)[0]), '%d ranks, %s: other bits' %
                        (ranks, options))
            checks.that(bake.run['indirect_bounces'] == bounces, 'other bounces')
    check_closed(kiln, checks)
    check_pocket(kiln, checks)
    check_dark(kiln, checks)
    check_solid(kiln, checks)
    if kiln.backend == 'vulkan':
        kiln.backend = 'embree'
        bake = kiln.bake(scene, *OPTIONS)
        if checks.baked(bake):
            a, b = indirect(bake)[0], indirect(late)[0]
            off = float(np.sqrt(np.mean((a - b) ** 2)) / a.mean())
            checks.that(off < 0.01 and abs(b.mean() / a.mean() - 1) < 1e-3, 'backends differ by %g' % off)
            rays = [x.run['rays']['bounces'] for x in (late, bake)]
            checks.that(abs(rays[0] / rays[1] - 1) < 0.02, 'rays of bounces: %d on Vulkan, %d on Embree' % tuple(rays))
    checks.end()


if __name__ == '__main__':
    main()
