"""The irradiance volume against the two closed forms for probes.

A probe in empty space under one directional light: harmonics of bands 0 to 2 turn E0 max(0, cos t) into E0 (1/4 + cos t
/ 2 + 5/16 P2(cos t)), negative beyond the terminator; the irradiance along the six axes is not from harmonics and must
be exact. A probe under half a sky: pi L (1 + cos t) / 2, which harmonics hold exactly. The half sky is a black bowl
whose rim is level with the probe.

Probes inside of a pillar: those near its sides are moved out of it, those within are filled, and none is dark.

Then light at points between probes: in a dark room behind a wall of 1 cm there is none, whatever the wall's slope
against the grid of probes, and in front of the wall there is.
"""
import json
import math
import os
import sys

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

SPACING = 2.0 / 3.0  # the scenes are cubes of 2 m: 3 x 3 x 3 probes, the middle one at the origin
SAMPLES = 16384


def speck(scene, name, at, material):
    """A triangle too small to be seen from the origin: it only gives the scene its extent."""
    x, y, z = at
    scene.mesh(name, [(x, y, z), (x - math.copysign(1e-3, x), y, z), (x, y, z - math.copysign(1e-3, z))],
               [(0, 0), (1, 0), (0, 1)],
               [(0, 1, 2)], material)


def directional(path, strength):
    scene = glb.Scene()
    black = scene.material('black', double_sided=True)
    speck(scene, 'low', (-1, -1, -1), black)
    speck(scene, 'high', (1, 1, 1), black)
    half = math.sqrt(0.5)
    scene.light('sun', {'type': 'directional', 'intensity': strength, 'color': [1, 1, 1]}, rotation=[-half, 0, 0, half])
    return scene.write(path)


def bowl(path):
    scene = glb.Scene()
    black = scene.material('black', double_sided=True)
    scene.quad('floor', [(-1, -1, 1), (1, -1, 1), (1, -1, -1), (-1, -1, -1)], black)
    for i, (a, b) in enumerate((((-1, -1), (1, -1)), ((1, -1), (1, 1)), ((1, 1), (-1, 1)), ((-1, 1), (-1, -1)))):
        scene.quad('wall%d' % i, [(a[0], -1, a[1]), (b[0], -1, b[1]), (b[0], 0, b[1]), (a[0], 0, a[1])], black)
    speck(scene, 'high', (1, 1, 1), black)
    return scene.write(path)


def turned(angle):
    """Turns by that about y, and by half of it about z; as a matrix, and as a quaternion."""
    y, z = math.sin(angle / 2), math.sin(angle / 4)
    y, w = np.array([0, y, 0]), math.sqrt(1 - y * y)
    z, v = np.array([0, 0, z]), math.sqrt(1 - z * z)
    q = np.append(w * z + v * y + np.cross(y, z), w * v - y @ z)
    x, s = q[:3], q[3]
    matrix = [2 * (x @ e) * x + (s * s - x @ x) * e + 2 * s * np.cross(x, e) for e in np.eye(3)]
    return np.array(matrix).T, q


def two_rooms(path, angle):
    """Two rooms without a surface in common, cubes of 1 m, 1 cm apart at x = 0. A lamp is in that of x < 0."""
    scene = glb.Scene()
    white, lamp = scene.material('white', (0.7, 0.7, 0.7)), scene.material('lamp', (0, 0, 0), (10, 10, 10))
    glb.box(scene, 'lit', (-1.005, 0, -0.5), (-0.005, 1, 0.5), white, range(6))
    glb.box(scene, 'dark', (0.005, 0, -0.5), (1.005, 1, 0.5), white, range(6))
    scene.quad('lamp', [(-0.6, 0.99, -0.1), (-0.4, 0.99, -0.1), (-0.4, 0.99, 0.1), (-0.6, 0.99, 0.1)], lamp)
    matrix, rotation = turned(angle)
    for node in scene.document['nodes']:
        node['rotation'] = [float(c) for c in rotation]
    return scene.write(path), matrix


def harmonics(n):
    x, y, z = n
    return np.array([0.282095, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y, 1.092548 * y * z,
                     0.315392 * (3 * z * z - 1),
                     1.092548 * x * z, 0.546274 * (x * x - y * y)])


class Volume:
    def __init__(self, path):
        with h5py.File(path, 'r') as f:
            group = f['VTKHDF']
            self.origin, self.spacing = np.array(group.attrs['Origin']), np.array(group.attrs['Spacing'])
            self.data = {name: item[...].astype(float) for name, item in group['PointData'].items()}

    def at_origin(self, name):
        i = np.rint(-self.origin / self.spacing).astype(int)
        assert np.allclose(self.origin + i * self.spacing, 0, atol=1e-6), 'no probe stands at the origin'
        return self.data[name][i[2], i[1], i[0]]


def close(checks, what, got, want, allowed, process):
    got = np.asarray(got, float)
    good = checks.that(bool((np.abs(got - want) <= allowed).all()),
                       '%s: got %s, want %.6f +- %.1e' % (what, got, want, allowed), process)
    return float(np.abs(got - want).max()), good


def compare(checks, table, kiln, bake, name, angles, axes, scale, tolerance):
    """`angles`: {degrees from +y: irradiance of the harmonics}; `axes`: {axis: irradiance}."""
    process = bake.process
    volume = Volume(os.path.join(bake.directory, 'volume.hdf'))
    coefficients = volume.at_origin('irradiance_sh').reshape(9, 3)
    for angle, want in angles.items():
        t = math.radians(angle)
        for azimuth in (0.3, 2.0, 4.4):
            n = (math.sin(t) * math.cos(azimuth), math.cos(t), math.sin(t) * math.sin(azimuth))
            off, _ = close(checks, '%s, coefficients at %g degrees' % (name, angle), harmonics(n) @ coefficients, want,
                           tolerance * scale, process)
            asked = kiln.command('probe', bake.directory, 0, 0, 0, *['%.9g' % c for c in n], '--json')
            if checks.that(asked.status == 0, '%s: kiln probe ended with %d' % (name, asked.status), asked):
                off2, _ = close(checks, '%s, kiln probe at %g degrees' % (name, angle), asked.json()['irradiance'],
                                max(want, 0.0),
                                tolerance * scale, asked)
        table.row(name, 'harmonics, %g degrees' % angle, '%.5f' % want, '%.1e' % (off / scale))
    for axis, want in axes.items():
        off, _ = close(checks, '%s, axis %s' % (name, axis), volume.at_origin('irradiance_' + axis), want,
                       tolerance * scale, process)
        table.row(name, 'axis ' + axis, '%.5f' % want, '%.1e' % (off / scale))


def buried(checks, table, kiln):
    """A room of 2 m round a pillar of 1.1 x 2 x 1.1 m: albedo 0.5 and emission 1 everywhere make a radiance of 2, so
    E = 2 pi wherever a probe stands and whichever way it looks."""
    scene = glb.Scene()
    glow = scene.material('glow', (0.5, 0.5, 0.5), (1, 1, 1))
    glb.box(scene, 'room', (-1, -1, -1), (1, 1, 1), glow, range(6))
    glb.box(scene, 'pillar', (-0.55, -1, -0.55), (0.55, 1, 0.55), glow)
    bake = kiln.bake(scene.write(os.path.join(kiln.scratch, 'pillar.glb')), '--texels-per-metre', 4, '--bounces', 8,
                     '--samples-direct', 64, '--samples-bounce', 16, '--samples-probe', 256, '--probe-spacing', 0.2)
    if not checks.baked(bake):
        return
    volume = Volume(os.path.join(bake.directory, 'volume.hdf'))
    at = [volume.origin[a] + volume.spacing[a] * np.arange(volume.data['state'].shape[2 - a]) for a in range(3)]
    z, y, x = np.meshgrid(at[2], at[1], at[0], indexing='ij')
    depth = 0.55 - np.maximum(abs(x), abs(z))  # m, below 0 outside
    state = volume.data['state']
    checks.that(bool((state[depth < 0] == 0).all()), 'probes outside of the pillar are in place', bake.process)
    near = (depth > 0) & (depth < 0.08)
    checks.that(bool((state[near] == 1).all()), 'probes near its sides are moved', bake.process)
    checks.that(bool((state[depth > 0.1] == 2).all()), 'probes within are filled', bake.process)
    checks.that(all((state == s).any() for s in (0, 1, 2)), 'there are such probes', bake.process)
    offset = volume.data['offset']
    moved = np.maximum(abs(x + offset[..., 0]), abs(z + offset[..., 2]))[state == 1]
    checks.that(bool((moved > 0.55).all()), 'moved probes stand outside', bake.process)
    checks.that(bool((abs(offset) <= 0.1).all()) and not offset[state != 1].any(), 'within their box', bake.process)
    light = volume.data['irradiance_sh'][..., 0] * 0.282095 / (2 * math.pi)
    checks.that(bool((abs(light - 1) < 0.1).all()),
                'a probe has %.3f to %.3f of the light' % (light.min(), light.max()), bake.process)
    table.row('pillar', 'mean of all probes', '1', '%.1e' % abs(light.mean() - 1))


def walls(checks, table, kiln, angle):
    """Irradiance on both sides of the wall: `behind` it there is 1 % of what is before it, at most, from 1 cm on."""
    name = 'rooms at %g degrees' % angle
    scene, matrix = two_rooms(os.path.join(kiln.scratch, 'rooms%g.glb' % angle), math.radians(angle))
    bake = kiln.bake(scene, '--texels-per-metre', 4, '--bounces', 1, '--samples-direct', 16, '--samples-probe', 64,
                     '--probe-spacing', 0.2)
    if not checks.baked(bake):
        return
    worst, lit, unseen = 0.0, [], 0
    for height, aside in ((0.5, 0.0), (0.04, 0.1), (0.96, 0.46), (0.3, -0.47)):
        for away in (0.01, 0.05, 0.1):
            found = []
            for side in (-1, 1):
                place, normal = matrix @ (side * (0.005 + away), height, aside), matrix @ (-side, 0, 0)
                asked = kiln.command('probe', bake.directory, *place.round(6), *normal.round(9), '--json')
                if not checks.that(asked.status == 0, '%s: kiln probe ended with %d' % (name, asked.status), asked):
                    return
                found.append(max(asked.json()['irradiance']))
                unseen += asked.json()['seen'] <= 0
            lit.append(found[0])
            worst = max(worst, found[1] / max(found[0], 1e-9))
    checks.that(worst <= 0.01, '%s: behind the wall there is %.3g of what is before it' % (name, worst), bake.process)
    checks.that(min(lit) > 0.2 * max(lit), '%s: before the wall there is from %g to %g' % (name, min(lit), max(lit)),
                bake.process)
    checks.that(unseen == 0, '%s: %d places are not seen by any probe' % (name, unseen), bake.process)
    table.row(name, 'behind a wall of 1 cm', '0', '%.1e' % worst)


def main():
    _, kiln = harness.start(__doc__)
    path = harness.own_scene('analytic', 'expected.json')
    if path is None:
        harness.skip('neither tests/data/analytic nor ../shared/scenes/own/analytic is here.')
    with open(path) as f:
        cases = {c['id']: c for c in json.load(f)['cases']}
    checks = harness.Checks()
    table = harness.Table(('case', 20), ('what', 26), ('closed form', 12), ('off / E0', 10))
    options = ['--lightmap-size', 4, '--bounces', 0, '--samples-direct', 16, '--samples-probe', SAMPLES,
               '--probe-spacing', '%.9f' % SPACING]

    strength = cases['probe_directional']['probe'][0]['exact']
    bake = kiln.bake(directional(os.path.join(kiln.scratch, 'directional.glb'), strength), *options)
    if checks.baked(bake):
        angles = {p['angle_deg']: p['sh_l2'] for p in cases['probe_directional']['probe']}
        axes = {'posy': strength, 'negy': 0.0, 'posx': 0.0, 'negx': 0.0, 'posz': 0.0, 'negz': 0.0}
        compare(checks, table, kiln, bake, 'probe_directional', angles, axes, strength, 1e-4)

    sky = {p['angle_deg']: p['exact_and_sh_l1'] for p in cases['probe_half_sky']['probe']}
    radiance = sky[0] / math.pi
    bake = kiln.bake(bowl(os.path.join(kiln.scratch, 'bowl.glb')), *options, '--environment',
                     '%g,%g,%g' % ((radiance,) * 3))
    if checks.baked(bake):
        axes = {'posy': sky[0], 'negy': 0.0, 'posx': sky[90], 'negx': sky[90], 'posz': sky[90], 'negz': sky[90]}
        compare(checks, table, kiln, bake, 'probe_half_sky', sky, axes, sky[0], 5e-3)

    buried(checks, table, kiln)
    for angle in (0, 30) if kiln.backend == 'embree' else (30,):  # what is kept behind walls is the host's work
        walls(checks, table, kiln, angle)
    checks.end()


if __name__ == '__main__':
    main()
