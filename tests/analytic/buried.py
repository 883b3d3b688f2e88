"""What lies in a box that stands on a floor is buried; what is in a room whose walls have two faces is not.

The box's bottom and the floor are in one place, and rounding would decide which of them a ray from within the box
meets. So would it decide between the two faces of each wall, of which the ones outside are cut otherwise, or alike.
Boxes are turned, so that places round otherwise in each. With --few, for slow devices, one scene of each kind.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

OPTIONS = ('--samples-direct', 1, '--samples-probe', 0, '--bounces', 0, '--denoise', 'none', '--no-export')


def turned(corners, angle, middle):
    c, s = math.cos(angle), math.sin(angle)
    return [(middle[0] + c * x + s * z, y, middle[1] - s * x + c * z) for x, y, z in corners]


def lamp(scene, name, half, height, angle, middle, material):
    flat = [(-half, height, -half), (half, height, -half), (half, height, half), (-half, height, half)]
    scene.quad(name, turned(flat, angle, middle), material)


def check_boxes(kiln, checks, table):
    """Lamps in and beside 16 boxes, which are turned otherwise each. The lamps face the floor, but of their four rays
    three meet walls. The floor comes first in the scene, or last."""
    for first in (True,) if kiln.few else (True, False):
        scene, rng = glb.Scene(), np.random.default_rng(1)
        grey, shining = scene.material('grey', (0.5,) * 3), scene.material('lamp', (0, 0, 0), (1, 1, 1))
        floor = lambda: scene.quad('floor', [(0, 0, 16), (16, 0, 16), (16, 0, 0), (0, 0, 0)], grey)
        if first:
            floor()
        for k in range(16):
            middle, angle = (2 + 4 * (k % 4), 2 + 4 * (k // 4)), 0.37 * k
            box = [[np.array(c) * (0.8, 3, 0.8) - (0.4, 0, 0.4) for c in face] for face in glb.FACES]
            for i, face in enumerate(box):
                scene.quad('box %d %d' % (k, i), turned(face, angle, middle), grey)
            for i in range(3):
                height = float(rng.uniform(0.8, 2.9))
                lamp(scene, 'in %d %d' % (k, i), 0.1, height, angle, middle, shining)
                lamp(scene, 'out %d %d' % (k, i), 0.1, height, angle, (middle[0] + 2, middle[1] + i - 1), shining)
        if not first:
            floor()
        name = 'boxes on a floor' if first else 'floor under boxes'
        bake = kiln.bake(scene.write(os.path.join(kiln.scratch, name + '.glb')), '--texels-per-metre', 10, *OPTIONS)
        if checks.baked(bake):
            kind = np.array([n.split()[0] for n in bake.names()])[bake.points.object]
            inside, outside = kind == 'in', kind == 'out'
            lit, dark = int(bake.points.valid[inside].sum()), int((~bake.points.valid[outside]).sum())
            checks.that(inside.sum() > 100 and lit == 0, '%s: %d of %d points in boxes are not buried' %
                        (name, lit, inside.sum()), bake.process)
            checks.that(outside.sum() > 100 and dark == 0, '%s: %d of %d points beside boxes are buried' %
                        (name, dark, outside.sum()), bake.process)
            table.row(name, '%d of %d' % (inside.sum() - lit, inside.sum()), '%d of %d' % (dark, outside.sum()))
        bake.remove()


def check_room(kiln, checks, table):
    """Each wall has a face outside too, cut into 3 x 3 or like the one inside. The ceiling sees a lamp's back."""
    for cuts in (3,) if kiln.few else (3, 1):
        scene = glb.Scene()
        grey, shining = scene.material('grey', (0.5,) * 3), scene.material('lamp', (0, 0, 0), (1, 1, 1))
        middle, angle, size = (1.3, -0.7), 0.5, np.array((3.1, 2.3, 4.2))
        for i, face in enumerate(glb.FACES):
            corners = turned([(np.array(c) - 0.5) * size for c in face], angle, middle)
            scene.quad('out %d' % i, corners, grey, cuts=cuts)
            scene.quad('in %d' % i, corners[::-1], grey)
        lamp(scene, 'lamp', 0.3, 0.7, angle, middle, shining)
        name = 'walls cut %d x %d' % (cuts, cuts)
        bake = kiln.bake(scene.write(os.path.join(kiln.scratch, 'room%d.glb' % cuts)), '--texels-per-metre', 6,
                         *OPTIONS)
        if checks.baked(bake):
            kind = np.array([n.split()[0] for n in bake.names()])[bake.points.object]
            inside = kind != 'out'
            dark = int((~bake.points.valid[inside]).sum())
            checks.that(inside.sum() > 500 and dark == 0, '%s: %d of %d points in the room are buried' %
                        (name, dark, inside.sum()), bake.process)
            table.row(name, '', '%d of %d' % (dark, inside.sum()))
        bake.remove()


def main():
    arguments, kiln = harness.start(__doc__, lambda p: p.add_argument('--few', action='store_true',
                                                                      help='one scene of each kind'))
    kiln.few = arguments.few
    checks = harness.Checks()
    table = harness.Table(('scene', 20), ('buried inside', 14), ('buried in the open', 18))
    check_boxes(kiln, checks, table)
    check_room(kiln, checks, table)
    checks.end()


if __name__ == '__main__':
    main()
