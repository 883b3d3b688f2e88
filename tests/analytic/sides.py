"""The two sides of double-sided surfaces, each with light of its own.

A sealed box with the sun outside is black inside, whichever way its faces are turned; an opaque sheet casts its shadow
and both of its sides have what a formula says; in a furnace both sides of a sheet are as bright as the walls; and a
sheet is the same as two single-sided ones back to back.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

def sealed(path, inward):
    scene = glb.Scene()
    grey = scene.material('grey', (0.5, 0.5, 0.5), double_sided=True)
    glb.box(scene, 'box', (-1, -1, -1), (1, 1, 1), grey, inward)
    glb.box(scene, 'crate', (-0.3, -0.7, -0.3), (0.3, -0.1, 0.3), grey)
    half = math.sqrt(0.5)
    scene.light('sun', {'type': 'directional', 'intensity': 1000.0},
                rotation=[-half * 0.9, 0.3, 0.1, math.sqrt(1 - 0.405 - 0.1)])
    scene.environment((100, 100, 100))
    return scene.write(path)


def check_sealed(kiln, checks, table):
    for name, inward in (('outwards', ()), ('inwards', range(6)), ('both ways', (0, 2, 4))):
        bake = kiln.bake(sealed(os.path.join(kiln.scratch, 'sealed.glb'), inward), '--texels-per-metre', 6,
                         '--samples-direct', kiln.samples(64),
                         '--samples-bounce', 16, '--samples-indirect', kiln.samples(128), '--samples-probe', 16)
        process = bake.process
        if not checks.baked(bake):
            continue
        points = bake.points
        luminance = points.total @ harness.LUMINANCE
        crate = points.object == bake.index('crate')
        inside = float(luminance[crate].max())
        outside = float(luminance[~crate].max())
        buried = 1 - points.valid[crate & (points.side == 0)].mean()
        checks.that(outside > 300 and inside <= 1e-6 * outside, 'sealed box, %s: %g inside, %g outside' %
                    (name, inside, outside), process)
        # only where every face is turned outwards is the crate inside matter
        checks.that(buried == (1.0 if not inward else 0.0), 'sealed box, %s: %.0f %% of the crate is buried' %
                    (name, 100 * buried), process)
        checks.energy(bake, 'sealed box, ' + name)
        table.row('sealed box, ' + name, 'inside / outside %.1e' % (inside / outside))
        bake.remove()


def sheet(path):
    """A sheet of 4 m between a sun above and a point light 1 m below its middle; a floor of 0.4 m 1.5 m below, in its
    shadow."""
    scene = glb.Scene()
    grey = scene.material('grey', (0.5, 0.5, 0.5), double_sided=True)
    scene.quad('sheet', [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], grey)
    half = math.sqrt(0.5)
    scene.light('sun', {'type': 'directional', 'intensity': 7.0}, rotation=[-half, 0, 0, half])
    return scene, grey, path


def check_shadow(kiln, checks, table):
    scene, grey, path = sheet(os.path.join(kiln.scratch, 'shadow.glb'))
    scene.quad('floor', [(-0.2, -1.5, 0.2), (0.2, -1.5, 0.2), (0.2, -1.5, -0.2), (-0.2, -1.5, -0.2)], grey)
    bake = kiln.bake(scene.write(path), '--texels-per-metre', 8, '--samples-direct', 16, '--samples-bounce', 16,
                     '--samples-indirect', 64,
                     '--samples-probe', 0)
    if not checks.baked(bake):
        return
    points = bake.points
    floor, top = points.object == bake.index('floor'), points.of(bake.index('sheet'))
    checks.that(float(points.total[floor].max()) == 0.0, 'the floor below an opaque sheet gets %g' %
                points.total[floor].max(), bake.process)
    checks.that(np.allclose(points.total[top], 7.0, rtol=1e-4), 'above the sheet: %s' % points.total[top].mean(0),
                bake.process)
    bake.remove()


def check_both_sides(kiln, checks, table):
    scene, _, path = sheet(os.path.join(kiln.scratch, 'sheet.glb'))
    scene.light('lamp', {'type': 'point', 'intensity': 5.0}, translation=[0, -1, 0])
    bake = kiln.bake(scene.write(path), '--texels-per-metre', 16, '--samples-direct', 64, '--samples-indirect', 16,
                     '--samples-probe', 0, '--sides', 'two')
    process = bake.process
    if not checks.baked(bake):
        return
    entry = bake.run['objects'][0]
    maps = [harness.Lightmap(os.path.join(bake.directory, entry[key])) for key in ('lightmap', 'lightmap_back')]
    x = (np.arange(maps[0].width) + 0.5) / maps[0].width * 4 - 2
    distance = np.sqrt(1 + x[None, :] ** 2 + x[:, None] ** 2)
    below = 5.0 / distance ** 3  # at texels' centres; their mean differs by the second derivative
    worst = float(np.abs(maps[1].irradiance[:, :, 1] / below - 1).max())
    checks.that(np.allclose(maps[0].irradiance, 7.0, rtol=1e-4),
                'the front of the sheet: %s' % maps[0].irradiance.mean((0, 1)), process)
    checks.that(worst < 0.004, 'the back of the sheet is off by up to %.2f %%' % (100 * worst), process)
    table.row('sheet, both sides', 'worst texel of the back %.2f %%' % (100 * worst))
    bake.remove()


def check_furnace(kiln, checks, table):
    """Everything emits e and reflects rho, so that E = pi e / (1 - rho) everywhere."""
    rho, e = 0.5, 2.0
    scene = glb.Scene()
    wall = scene.material('wall', (rho,) * 3, (e,) * 3)
    paper = scene.material('paper', (rho,) * 3, (e,) * 3, double_sided=True)
    glb.box(scene, 'room', (-1, -1, -1), (1, 1, 1), wall, range(6))
    scene.quad('sheet', [(-0.6, -0.2, 0.5), (0.5, 0.1, 0.6), (0.6, 0.3, -0.5), (-0.5, 0.0, -0.6)], paper)
    bake = kiln.bake(scene.write(os.path.join(kiln.scratch, 'furnace.glb')), '--texels-per-metre', 8,
                     '--samples-direct', kiln.samples(256),
                     '--samples-bounce', 32, '--samples-indirect', kiln.samples(256), '--samples-probe', 0)
    process = bake.process
    if not checks.baked(bake):
        return
    points, want = bake.points, math.pi * e / (1 - rho)
    for what, chosen in (('front', points.of(bake.index('sheet'))), ('back', points.of(bake.index('sheet'), 1)),
                         ('walls', points.of(bake.index('room')))):
        weight = points.area[chosen] / points.area[chosen].sum()
        mean = float((points.total[chosen, 1] * weight).sum())
        error = float(np.sqrt(((points.error[chosen] * weight) ** 2).sum()))
        checks.that(len(chosen) > 0 and abs(mean / want - 1) < max(2e-3, 4 * error / want),
                    'furnace, %s: %g, not %g' % (what, mean, want), process)
        table.row('furnace, ' + what, '%+.3f %%' % (100 * (mean / want - 1)))
    checks.energy(bake, 'furnace')
    bake.remove()


def check_twin(kiln, checks, table):
    """Means of what both scenes have, by place."""
    found = []
    for twin in (False, True):
        bake = kiln.bake(glb.partition_room(os.path.join(kiln.scratch, 'partition.glb'), twin), '--texels-per-metre', 8,
                         '--samples-direct', kiln.samples(128),
                         '--samples-bounce', kiln.samples(128), '--samples-indirect', kiln.samples(512),
                         '--samples-probe', 0, '--sides', 'two')
        if not checks.baked(bake):
            return
        points = bake.points
        far = bake.index('dark') if twin else bake.index('lit')
        places = {'lit side': points.of(bake.index('lit')), 'dark side': points.of(far, 0 if twin else 1),
                  'dark room': points.of(bake.index('room'))[points.position[points.of(bake.index('room')), 0] > 0.1]}
        means = {}
        for name, chosen in places.items():
            weight = points.area[chosen] / points.area[chosen].sum()
            means[name] = ((points.total[chosen] * weight[:, None]).sum(0),
                           math.sqrt(((points.error[chosen] * weight) ** 2).sum()))
        found.append(means)
        process = bake.process
        bake.remove()
    for name in found[0]:
        (a, da), (b, db) = found[0][name], found[1][name]
        # what neighbours share of the bounces' noise is not in the stated error: half a per cent is left for it
        allowed = 4 * math.hypot(da, db) + 0.005 * b.max()
        checks.that(bool((np.abs(a - b) <= allowed).all()) and b.min() > 0, 'partition, %s: %s, twin %s' % (name, a, b),
                    process)
        table.row('partition, ' + name, '%s against its twin %s' % (np.round(a, 4), np.round(b, 4)))


def main():
    every = {'sealed': check_sealed, 'shadow': check_shadow, 'both_sides': check_both_sides, 'furnace': check_furnace,
             'twin': check_twin}
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--only', action='append', choices=every, help='these cases'))
    checks = harness.Checks()
    table = harness.Table(('case', 28), ('found', 60))
    for name in arguments.only or every:
        every[name](kiln, checks, table)
    checks.end()


if __name__ == '__main__':
    main()
