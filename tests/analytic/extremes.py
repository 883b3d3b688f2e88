"""Closed forms where numbers and shapes get extreme.

In a closed furnace everything emits e and reflects rho, so that E = pi e / (1 - rho) everywhere; two coincident opposite
faces that divide it change nothing, in either order. Near rho = 1 the light of a thousand bounces counts, and at 1 it
has no end.
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


def check_coincident(kiln, checks, table):
    """The two sheets have different diagonals, so that no triangle has a twin with the same corners."""
    rho, e = 0.5, 1.0
    sheets = [('towards +x', [(0, -1, 1), (0, -1, -1), (0, 1, -1), (0, 1, 1)]),
              ('towards -x', [(0, -1, -1), (0, -1, 1), (0, 1, 1), (0, 1, -1)])]
    want = math.pi * e / (1 - rho)
    for order in (sheets, sheets[::-1]):
        what = 'coincident faces, first %s' % order[0][0]
        bake = kiln.bake(furnace(os.path.join(kiln.scratch, 'coincident.glb'), rho, e, order), '--texels-per-metre', 4,
                         '--samples-direct', kiln.samples(512), '--samples-bounce', 64,
                         '--samples-indirect', kiln.samples(256), '--samples-probe', 0, '--no-preview')
        process = bake.process
        if not checks.baked(bake):
            continue
        energy, points = bake.run['energy'], bake.points
        blocked = energy['blocked'][1] / energy['emitted'][1]
        checks.that(blocked <= 1e-6, '%s: %g of the light met backs' % (what, blocked), process)
        checks.that(points.valid.mean() > 0.99, '%s: %g of the points are valid' % (what, points.valid.mean()), process)
        worst = 0.0
        for name in bake.names():
            chosen = points.of(bake.index(name))
            mean = float(np.average(points.total[chosen, 1], weights=points.area[chosen]))
            checks.that(abs(mean / want - 1) < 3e-3, '%s, %s: %g, not %g' % (what, name, mean, want), process)
            worst = max(worst, abs(mean / want - 1))
        table.row(what, 'off by %.3f %% at most, met from behind %.1e' % (100 * worst, blocked))
        bake.remove()


def check_tail(kiln, checks, table):
    """Bounces go on until the tail is known."""
    for rho in (0.99, 0.999, 1.0):
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
    checks.that(abs(said / want - 1) < 0.05 and abs(off + want) < 3e-3 and 'not converged' in ' '.join(bake.run['notes']),
                'equal schedule: off by %g, %g said to be left, not %g' % (off, said, want), bake.process)
    table.row('equal schedule, albedo %g' % rho, 'off by %+.2f %%, %.2f %% said to be left out' % (100 * off, 100 * said))
    bake.remove()


def main():
    every = {'coincident': check_coincident, 'tail': check_tail, 'left': check_left}
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--only', action='append', choices=every, help='these cases'))
    checks = harness.Checks()
    table = harness.Table(('case', 36), ('found', 60))
    for name in arguments.only or every:
        every[name](kiln, checks, table)
    checks.end()


if __name__ == '__main__':
    main()
