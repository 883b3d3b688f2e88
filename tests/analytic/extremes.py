"""Closed forms where numbers and shapes get extreme.

In a closed furnace everything emits e and reflects rho, so that E = pi e / (1 - rho) everywhere. Near rho = 1 the light
of a thousand bounces counts, and at 1 it has no end. Two coincident opposite faces that divide it change nothing.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402


def furnace(path, rho, emission=1.0, sheets=()):
    scene = glb.Scene()
    wall = scene.material('wall', (rho,) * 3, (emission,) * 3)
    glb.box(scene, 'room', (-1, -1, -1), (1, 1, 1), wall, range(6))
    for name, corners in sheets:
        scene.quad(name, corners, wall)
    return scene.write(path)


TOWARDS = ('towards +x', [(0, -1, 1), (0, -1, -1), (0, 1, -1), (0, 1, 1)])
AWAY = ('towards -x', [(0, -1, -1), (0, -1, 1), (0, 1, 1), (0, 1, -1)])  # cut along the other diagonal
AWAY_SAME = ('towards -x, same diagonal', [(0, -1, 1), (0, 1, 1), (0, 1, -1), (0, -1, -1)])


def check_coincident(kiln, checks, table):
    """Two coincident opposite sheets in either order; and one sheet alone, whose back loses light, as a control."""
    rho, e = 0.5, 1.0
    want = math.pi * e / (1 - rho)
    every = ((AWAY, TOWARDS), (TOWARDS,), (TOWARDS, AWAY), (TOWARDS, AWAY_SAME))
    for sheets in every[:1] if kiln.few else every:
        what = 'sheets: ' + ', then '.join(name for name, _ in sheets)
        bake = kiln.bake(furnace(os.path.join(kiln.scratch, 'coincident.glb'), rho, e, sheets), '--texels-per-metre', 4,
                         '--samples-direct', kiln.samples(512), '--samples-bounce', 64,
                         '--samples-indirect', kiln.samples(256), '--samples-probe', 0, '--no-preview')
        process = bake.process
        if not checks.baked(bake):
            continue
        energy, points, two = bake.run['energy'], bake.points, len(sheets) == 2
        blocked = energy['blocked'][1] / energy['emitted'][1]
        found = bake.run['backend']['because']['coincident_opposite_faces']
        checks.that(found == two, '%s: coincident faces found: %s' % (what, found), process)
        checks.that(blocked <= 1e-6 if two else blocked > 0.1, '%s: %g of the light met backs' % (what, blocked),
                    process)
        worst = 0.0
        for name in bake.names() if two else ():
            chosen = points.of(bake.index(name))
            mean = float(np.average(points.total[chosen, 1], weights=points.area[chosen]))
            checks.that(abs(mean / want - 1) < 3e-3, '%s, %s: %g, not %g' % (what, name, mean, want), process)
            worst = max(worst, abs(mean / want - 1))
        table.row(what[:50], 'off by %.3f %% at most, met from behind %.1e' % (100 * worst, blocked))
        bake.remove()


def check_tail(kiln, checks, table):
    """Bounces go on until the tail is known."""
    for rho in (0.999,) if kiln.few else (0.99, 0.999, 1.0):
        what = 'furnace of albedo %g' % rho
        bake = kiln.bake(furnace(os.path.join(kiln.scratch, 'tail.glb'), rho), '--texels-per-metre', 6,
                         '--samples-direct', kiln.samples(64), '--samples-bounce', 8,
                         '--samples-indirect', kiln.samples(128), '--samples-probe', 0)
        process = bake.process
        if not checks.baked(bake):
            continue
        tail, points = bake.run['tail'], bake.points
        notes = ' '.join(bake.run['notes'])
        checks.that(tail['diverges'] == (rho == 1) and ('diverge' in notes) == (rho == 1),
                    '%s: diverges %s, %s' % (what, tail['diverges'], notes), process)
        if rho < 1:
            mean = float(np.average(points.total[points.valid, 1], weights=points.area[points.valid]))
            off = mean * (1 - rho) / math.pi - 1
            checks.that(abs(off) < 3e-3 and 0 < tail['error'] <= 2e-3 and 'converged' not in notes,
                        '%s: off by %.3f %%, %.3f %% said' % (what, 100 * off, 100 * tail['error']), process)
            table.row(what, 'off by %+.3f %% after %d bounces' % (100 * off, bake.run['indirect_bounces']))
        bake.remove()


def check_left(kiln, checks, table):
    """The equal schedule ends at 254 bounces, and says what it has left out: q^255 of all light."""
    rho = 0.99
    bake = kiln.bake(furnace(os.path.join(kiln.scratch, 'left.glb'), rho), '--texels-per-metre', 6,
                     '--samples-direct', 64, '--schedule', 'equal', '--samples-indirect', 16, '--samples-probe', 0)
    if not checks.baked(bake):
        return
    said, want = bake.run['tail']['error'], rho ** 255
    points = bake.points
    mean = float(np.average(points.total[points.valid, 1], weights=points.area[points.valid]))
    off = mean * (1 - rho) / math.pi - 1
    checks.that(abs(said / want - 1) < 0.05 and abs(off + want) < 3e-3 and
                'not converged' in ' '.join(bake.run['notes']),
                'equal schedule: off by %g, %g said to be left, not %g' % (off, said, want), bake.process)
    table.row('equal schedule, albedo %g' % rho,
              'off by %+.2f %%, %.2f %% said to be left out' % (100 * off, 100 * said))
    bake.remove()


def check_ledger(kiln, checks, table):
    """Radiance below the smallest float that keeps its digits: most of the light is missing, which is said."""
    # a GPU may keep what Embree takes for 0, and then has the right light
    for radiance, off in ((1e-38, (True,) if kiln.backend == 'embree' else (False, True)), (1e-3, (False,))):
        what = 'ledger at radiance %g' % radiance
        bake = kiln.bake(furnace(os.path.join(kiln.scratch, 'ledger.glb'), 0.5, radiance), '--texels-per-metre', 4,
                         '--samples-direct', kiln.samples(256), '--samples-bounce', 16,
                         '--samples-indirect', kiln.samples(64), '--samples-probe', 0)
        if not checks.baked(bake):
            continue
        notes = [n for n in bake.run['notes'] if 'ledger' in n]
        share = bake.run['energy']['relative_residual']
        checks.that((share > 0.01) in off and len(notes) == (share > 0.01) and all('so faint' in n for n in notes),
                    '%s: off by %g, %s' % (what, share, notes), bake.process)
        table.row(what, notes[0][:60] if notes else 'off by %.2f %%' % (100 * share))
        bake.remove()


def check_warnings(kiln, checks, table):
    """What the importer leaves out is said in the bake, one line a kind, and stands in run.json."""
    scene = glb.Scene()
    grey = scene.material('grey', (0.5,) * 3)
    scene.quad('floor', [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], grey)
    scene.quad('far', [(3e7, 0, 8), (3e7 + 8, 0, 8), (3e7 + 8, 0, 0), (3e7, 0, 0)], grey, cuts=8)
    directory = os.path.join(kiln.scratch, 'warnings')
    process = kiln.command('bake', scene.write(os.path.join(kiln.scratch, 'flat.glb')), '-o', directory,
                           '--backend', kiln.backend, '--no-preview', '--lightmap-size', 16, '--samples-probe', 0)
    bake = harness.Bake(directory, process)
    if not checks.baked(bake):
        return
    for place, text in (('stderr', process.stderr), ('run.json', ' '.join(bake.run['scene']['warnings']))):
        for words in ('triangles without area', 'coarser than a tenth of a texel', 'there is no light'):
            checks.that(text.count(words) == 1, '%s says %r %d times' % (place, words, text.count(words)), process)
    table.row('warnings of the importer', '%d in run.json' % len(bake.run['scene']['warnings']))
    bake.remove()


def check_hard_spot(kiln, checks, table):
    """A cone of 0.5 rad with a hard edge, 2 m above a floor: I cos^3 / h^2 inside, 0 outside."""
    scene = glb.Scene()
    scene.quad('floor', [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], scene.material('grey', (0.5,) * 3))
    half = math.sqrt(0.5)
    scene.light('spot', {'type': 'spot', 'intensity': 8.0, 'spot': {'innerConeAngle': 0.5, 'outerConeAngle': 0.5}},
                translation=[0, 2, 0], rotation=[-half, 0, 0, half])
    bake = kiln.bake(scene.write(os.path.join(kiln.scratch, 'spot.glb')), '--texels-per-metre', 16, '--samples-direct',
                     16, '--samples-probe', 0, '--bounces', 0)
    if not checks.baked(bake):
        return
    points = bake.points
    angle = np.arctan(np.hypot(points.position[:, 0], points.position[:, 2]) / 2)
    margin = 0.03  # a texel
    inside, outside = angle < 0.5 - margin, angle > 0.5 + margin
    worst = float(np.abs(points.direct[inside, 1] / (2 * np.cos(angle[inside]) ** 3) - 1).max())
    warnings = ' '.join(bake.run['scene']['warnings'])
    checks.that(inside.any() and worst < 0.01 and float(points.direct[outside].max()) == 0.0 and
                'same inner and outer' in warnings,
                'hard cone: off by %g inside, %g outside; %s' % (worst, points.direct[outside].max(), warnings),
                bake.process)
    table.row('cone with a hard edge', 'worst texel off by %.2f %%' % (100 * worst))
    bake.remove()


def check_strips(kiln, checks, table):
    """A lamp of radiance 1, 100 m long and ever narrower, 1 m above a floor of 2 m: E in closed form along the lamp, by
    64 midpoints across it."""
    for width in (1e-4,) if kiln.few else (0.05, 0.02, 0.002, 1e-4):
        scene = glb.Scene()
        black = scene.material('floor')
        scene.quad('floor', [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], black)
        low, high = 0.1 - width / 2, 0.1 + width / 2
        scene.quad('lamp', [(low, 1, -50), (high, 1, -50), (high, 1, 50), (low, 1, 50)],
                   scene.material('lamp', (0, 0, 0), (1, 1, 1)))
        bake = kiln.bake(scene.write(os.path.join(kiln.scratch, 'strip.glb')), '--lightmap-size', 24,
                         '--samples-direct', 256, '--samples-probe', 0, '--bounces', 0)
        if not checks.baked(bake):
            continue
        points = bake.points
        floor = points.of(bake.index('floor'))
        x, z = points.position[floor][:, 0], points.position[floor][:, 2]
        want = np.zeros(len(floor))
        low, high = float(np.float32(low)), float(np.float32(high))
        for at in low + (np.arange(64) + 0.5) / 64 * (high - low):
            square = (at - x) ** 2 + 1
            for end in (50 - z, 50 + z):
                want += (high - low) / 64 * (end / (2 * square * (square + end ** 2)) +
                                             np.arctan(end / np.sqrt(square)) / (2 * square ** 1.5))
        off = points.direct[floor, 1] / want - 1
        rms = float(np.sqrt((off ** 2).mean()))
        checks.that(len(floor) > 500 and rms < 3e-3, 'strip %g m wide: rms %.2f %%' % (width, 100 * rms), bake.process)
        table.row('strip %g m wide' % width, 'rms %.2f %%' % (100 * rms))
        bake.remove()


def check_near_light(kiln, checks, table):
    """A light nearer than its texels are wide is named; one that is farther, or behind the floor, is not."""
    for height, near in ((0.001, True), (0.3, False), (-0.001, False)):
        scene = glb.Scene()
        scene.quad('floor', [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], scene.material('grey', (0.5,) * 3))
        scene.light('lamp', {'type': 'point', 'intensity': 1.0}, translation=[0.1, height, 0])
        bake = kiln.bake(scene.write(os.path.join(kiln.scratch, 'near.glb')), '--lightmap-size', 16,
                         '--samples-direct', 4, '--samples-probe', 0, '--bounces', 0)
        if not checks.baked(bake):
            continue
        said = [w for w in bake.run['scene']['warnings'] if 'nearer than its texels' in w]
        checks.that(len(said) == near and all("'floor'" in w and '0.001 m' in w and '(0.125 m)' in w for w in said),
                    'a light %g m above texels of 0.125 m: %s' % (height, said), bake.process)
        bake.remove()
    table.row('a light nearer than a texel is wide', 'named, and only that')


def check_density(kiln, checks, table):
    """A room that gets its light through gaps between texels is named where its light hangs on the texels, and a
    furnace, whose light is the same at any density, is not. The same on any number of ranks."""
    path = os.path.join(kiln.scratch, 'slit.glb')
    scene = glb.Scene()
    white, lamp = scene.material('white', (0.8,) * 3), scene.material('lamp', (0,) * 3, (10,) * 3)
    for name, low, high, open_face in (('lit', -4, 0, 1), ('beyond', 0, 4, 0)):
        for i, face in enumerate(glb.FACES):
            corners = [tuple(np.array((low, 0, 0)) + np.array(c) * (high - low, 2.5, 4)) for c in face][::-1]
            if not all(c[0] == 0 for c in corners):
                scene.quad('%s %d' % (name, i), corners, white)
    for name, low, high in (('below', 0, 1.2), ('above', 1.3, 2.5)):
        corners = [(0, low, 0), (0, low, 4), (0, high, 4), (0, high, 0)]
        scene.quad(name + ' lit', corners[::-1], white)
        scene.quad(name + ' beyond', corners, white)
    scene.quad('lamp', [(-3, 2.4, 1), (-2, 2.4, 1), (-2, 2.4, 2), (-3, 2.4, 2)], lamp)
    scene.write(path)
    options = ('--texels-per-metre', 1, '--samples-probe', 0, '--quality', 'draft', '--threads', 1, '--check-density')
    found = []
    for ranks in (0, 2) if kiln.backend == 'embree' else (0,):
        bake = kiln.bake(path, *options, ranks=ranks)
        if not checks.baked(bake):
            return
        density, notes = bake.run['density'], [n for n in bake.run['notes'] if 'texels twice as fine' in n]
        named = [o['name'] for o in density['objects']] if density['checked'] else []
        checks.that(any('beyond' in n for n in named) and len(notes) == 1 and named[0] in notes[0],
                    'a room behind a slit: %s, %s' % (density, notes), bake.process)
        found.append(([o['mean_at_half_density'] for o in bake.run['objects']], density.get('objects')))
        bake.remove()
    checks.that(all(f == found[0] for f in found), 'two ranks find other means at half density than one')
    bake = kiln.bake(furnace(os.path.join(kiln.scratch, 'even.glb'), 0.5), *options)
    if checks.baked(bake):
        checks.that(bake.run['density']['checked'] and not bake.run['density']['objects'],
                    'a furnace: %s' % bake.run['density'], bake.process)
        bake.remove()
    table.row('rooms joined by a slit', 'named where texels are too coarse; a furnace is not')


def check_buried(kiln, checks, table):
    """Which texels are buried hangs on the scene alone, not on the seed: a floor on which boxes stand askew."""
    scene, valid = glb.Scene(), []
    grey = scene.material('grey', (0.5,) * 3)
    scene.quad('floor', [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], grey)
    for i in range(9):
        turn, x, z = 0.3 + 0.37 * i, 0.6 * (i % 3 - 1) + 0.013, 0.6 * (i // 3 - 1) + 0.017
        low, high = np.array((-0.2, -0.1, -0.2)), np.array((0.2, 0.3, 0.2))
        for f, face in enumerate(glb.FACES):
            corners = [low + np.array(c) * (high - low) for c in face]
            scene.quad('box %d %d' % (i, f), [(x + c[0] * math.cos(turn) + c[2] * math.sin(turn), c[1],
                                               z - c[0] * math.sin(turn) + c[2] * math.cos(turn))
                                              for c in corners], grey)
    scene.write(os.path.join(kiln.scratch, 'askew.glb'))
    for seed in (1, 2):
        bake = kiln.bake(os.path.join(kiln.scratch, 'askew.glb'), '--texels-per-metre', 48, '--samples-direct', 1,
                         '--bounces', 0, '--no-export', '--samples-probe', 0, '--denoise', 'none', '--seed', seed)
        if not checks.baked(bake):
            return
        valid.append(bake.points.valid[bake.points.object == bake.index('floor')])
        bake.remove()
    buried, differ = int((~valid[0]).sum()), int((valid[0] != valid[1]).sum())
    checks.that(1000 < buried < 4000, '%d of %d texels of the floor are buried' % (buried, len(valid[0])))
    checks.that(differ == 0, '%d texels are buried with one seed and not with another' % differ)
    table.row('buried texels', '%d, the same with another seed' % buried)


def check_doubled(kiln, checks, table):
    """Two floors in one place that face the same way are named and lit alike; back to back they are neither."""
    floor = [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]
    every = ((floor[1:] + floor[:1], True), (floor, True), (floor[::-1], False))
    for second, doubled in every[:1] if kiln.few else every:
        scene = glb.Scene()
        grey = scene.material('grey', (0.5,) * 3)
        scene.quad('floor', floor, grey)
        scene.quad('carpet', second, grey)
        scene.quad('lamp', [(-1, 1, -1), (1, 1, -1), (1, 1, 1), (-1, 1, 1)], scene.material('lamp', (0,) * 3, (1,) * 3))
        bake = kiln.bake(scene.write(os.path.join(kiln.scratch, 'doubled.glb')), '--lightmap-size', 8,
                         '--samples-direct', 64, '--samples-probe', 0, '--bounces', 0, '--no-export')
        if not checks.baked(bake):
            return
        said = [w for w in bake.run['scene']['warnings'] if 'are there twice' in w]
        named = [w for w in said if "'floor' and 'carpet'" in w and w.startswith('at least')]
        checks.that(len(said) == len(named) == doubled,
                    'two floors in one place: %s' % said, bake.process)
        ledger = [n for n in bake.run['notes'] if 'ledger' in n]
        checks.that(len(ledger) == doubled and all('are there twice' in n for n in ledger),
                    'two floors in one place: %s' % ledger, bake.process)
        means = [o['mean'] for o in bake.run['objects'][:2]]
        checks.that(not doubled or abs(means[0] / means[1] - 1) < 0.01, 'two floors in one place have %s' % means)
        bake.remove()
    table.row('two floors in one place', 'named, and lit alike')


def main():
    every = {'coincident': check_coincident, 'tail': check_tail, 'left': check_left, 'ledger': check_ledger,
             'warnings': check_warnings, 'hard_spot': check_hard_spot, 'near_light': check_near_light,
             'density': check_density,
             'buried': check_buried, 'doubled': check_doubled,
             'strips': check_strips}
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--only', action='append', choices=every, help='these cases'),
        lambda p: p.add_argument('--few', action='store_true', help='what rays do, once: not what the host does, '
                                 'nor the same with other numbers'))
    kiln.few = arguments.few
    host = ('left', 'ledger', 'warnings', 'near_light', 'density')
    chosen = [name for name in every if not arguments.few or name not in host]
    checks = harness.Checks()
    table = harness.Table(('case', 36), ('found', 60))
    for name in arguments.only or chosen:
        every[name](kiln, checks, table)
    checks.end()


if __name__ == '__main__':
    main()
