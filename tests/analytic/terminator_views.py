"""Pictures of coarse meshes with smooth normals show the smooth surface, without black facets at the terminator.

Balls of 10 x 5 facets, by each method of views that traces paths from the camera: under a point light, I cos / d2, and
a sun, S cos, by the cosine with the normal between the corners' at each pixel; under a whole white sky, which is open
everywhere; and in the furnace of a room that shines as its ball does. A ball of rough metal has as much light as one of
many facets, facet by facet. Pictures of a sun by several methods are the same but for noise.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import exr  # noqa: E402
import glb  # noqa: E402
import harness  # noqa: E402
import terminator  # noqa: E402

SIZE, ANGLE = 48, 24.0  # pixels; degrees, of the field of view
EYE = np.array([5.0, 2.0, 3.0])
ALBEDO, SUN = 0.5, 10.0
METHODS = ('path', 'bdpt', 'vcm')


def facets(rings=terminator.RINGS):
    """Corners of all triangles of terminator.ball, (n, 3, 3); they are their normals, too."""
    place = lambda i, k: (math.sin(math.pi * i / rings) * math.cos(math.pi * k / rings), math.cos(math.pi * i / rings),
                          -math.sin(math.pi * i / rings) * math.sin(math.pi * k / rings))
    found = []
    for i in range(rings):
        for k in range(2 * rings):
            a, b, c, d = place(i, k), place(i + 1, k), place(i + 1, k + 1), place(i, k + 1)
            found += [(a, b, c)] * (i < rings - 1) + [(a, c, d)] * (i > 0)
    return np.array(found)


def seen():
    """What the middle of each pixel shows of the ball: position, normal between those of the corners, and whether it
    and its neighbours show the ball."""
    forward = -EYE / np.linalg.norm(EYE)
    right = np.cross(forward, (0, 1, 0))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    at = ((np.arange(SIZE) + 0.5) / SIZE * 2 - 1) * math.tan(math.radians(ANGLE) / 2)
    ray = forward + at[None, :, None] * right - at[:, None, None] * up
    a, b, c = np.moveaxis(facets(), 1, 0)
    normal = np.cross(b - a, c - a)
    steep = ray @ normal.T
    with np.errstate(divide='ignore', invalid='ignore'):
        t = ((a - EYE) * normal).sum(1) / steep
    place = EYE + t[..., None] * ray[:, :, None, :]
    area = (normal ** 2).sum(1)
    v = (np.cross(b - a, place - a) * normal).sum(-1) / area
    u = (np.cross(place - a, c - a) * normal).sum(-1) / area
    hit = (steep < 0) & (u > -1e-9) & (v > -1e-9) & (u + v < 1 + 1e-9)
    which = hit.argmax(-1)
    take = lambda of: np.take_along_axis(of, which[..., None], -1)[..., 0]
    u, v, t = take(u)[..., None], take(v)[..., None], take(t)[..., None]
    smooth = (1 - u - v) * a[which] + u * b[which] + v * c[which]
    smooth /= np.linalg.norm(smooth, axis=-1, keepdims=True)
    whole = hit.any(-1)
    inner = whole.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            inner &= np.roll(whole, step, axis)
    return EYE + t * ray, smooth, inner


def view(kiln, checks, path, method, samples, *options):
    out = os.path.join(kiln.scratch, 'view.exr')
    eye = ','.join('%g' % x for x in EYE)
    process = kiln.command('view', path, '--method', method, '--from=' + eye, '--to=0,0,0', '--field-of-view', ANGLE,
                           '--width', SIZE, '--height', SIZE, '--samples-pixel', samples, '-o', out, '--quiet',
                           '--backend', kiln.backend, *options)
    if process.status == harness.NO_DEVICE:
        harness.skip(process.sentence())
    good = checks.that(process.status == 0, '%s ends with %d' % (method, process.status), process)
    return (exr.rgb(out)[..., 1].astype(float) if good else None), process


def sun(scene):
    turn = math.radians(110)  # about x: -z becomes (0, -sin, -cos)
    scene.light('sun', {'type': 'directional', 'intensity': SUN},
                rotation=[-math.sin(turn / 2), 0, 0, math.cos(turn / 2)])
    return np.array([0, math.sin(turn), math.cos(turn)])


def check_lamps(kiln, checks, table, methods, save):
    lamp, power = np.array([-1.0, 4.0, 3.0]), 100.0
    position, smooth, inner = seen()
    for light in ('point light', 'sun'):
        scene = glb.Scene()
        terminator.ball(scene, scene.material('grey', (ALBEDO,) * 3))
        if light == 'sun':
            cosine, strength = smooth @ sun(scene), SUN
        else:
            scene.light('lamp', {'type': 'point', 'intensity': power}, translation=list(map(float, lamp)))
            to = lamp - position
            distance = np.linalg.norm(to, axis=-1)
            cosine, strength = (to * smooth).sum(-1) / distance, power / distance ** 2
        path = scene.write(os.path.join(kiln.scratch, 'lamp.glb'))
        want = ALBEDO / math.pi * strength * np.maximum(cosine, 0)
        for method in methods:
            samples = save(64 if method == 'path' else 256)
            got, process = view(kiln, checks, path, method, samples)
            if got is not None:  # rounding lets facets in one plane see one another, by 1e-9 of the light
                got[got < 1e-6 * want.max()] = 0.0
                terminator.judge(checks, table, '%s, %s' % (light, method), process, got[inner], want[inner],
                                 cosine[inner], 0.02 if method == 'path' else 1.0 / math.sqrt(samples))


def check_sky(kiln, checks, table, methods, save):
    scene = glb.Scene()
    terminator.ball(scene, scene.material('grey', (ALBEDO,) * 3))
    scene.environment((1.0, 1.0, 1.0))
    path = scene.write(os.path.join(kiln.scratch, 'sky.glb'))
    judge_even(kiln, checks, table, 'sky', path, methods, save(128), ALBEDO, 0.01)


def check_furnace(kiln, checks, table, methods, save):
    scene = glb.Scene()
    glowing = scene.material('glowing', (ALBEDO,) * 3, (1.0,) * 3)
    terminator.ball(scene, glowing)
    glb.box(scene, 'room', (-7, -7, -7), (7, 7, 7), glowing, range(6))
    path = scene.write(os.path.join(kiln.scratch, 'furnace.glb'))
    judge_even(kiln, checks, table, 'furnace', path, methods, save(32), 1 / (1 - ALBEDO), 0.01)  # off by 0.002 at most


def judge_even(kiln, checks, table, name, path, methods, samples, want, allowed):
    _, _, inner = seen()
    for method in methods:
        got, process = view(kiln, checks, path, method, samples, '--bounces', 'all')
        if got is None:
            continue
        off = got[inner].mean() / want - 1
        checks.that(abs(off) < allowed, '%s, %s: off by %g' % (name, method, off), process)
        table.row('%s, %s' % (name, method), '', '%+.2e' % off)


def check_metal(kiln, checks, table, methods, save):
    """Under a sun; blocks of 4 x 4 pixels where half a ball of many facets has light."""
    pictures = {}
    for rings in (terminator.RINGS, 48):
        scene = glb.Scene()
        terminator.ball(scene, glb.gloss(scene, 'metal', (0.8,) * 3, metallic=1.0, roughness=0.8), rings=rings)
        sun(scene)
        path = scene.write(os.path.join(kiln.scratch, 'metal.glb'))
        for method in methods if rings == terminator.RINGS else methods[:1]:
            pictures[rings, method] = view(kiln, checks, path, method, save(64 if method == 'path' else 256))
    fine = pictures[48, methods[0]][0]
    _, _, inner = seen()
    for method in methods:
        got, process = pictures[terminator.RINGS, method]
        if got is None or fine is None:
            continue
        low = inner & (fine < 0.1 * fine.max()) & (fine > 0.02 * fine.max())
        dark = int((got[low] < 0.25 * fine[low]).sum())
        off = got[inner].sum() / fine[inner].sum() - 1
        checks.that(dark <= 0.02 * low.sum() and low.sum() > 20, 'metal, %s: %d of %d pixels are dark' %
                    (method, dark, low.sum()), process)
        checks.that(abs(off) < 0.05, 'metal, %s: off by %g' % (method, off), process)
        table.row('metal, %s' % method, '%d of %d' % (dark, low.sum()), '%+.2e' % off)


def main():
    every = {'lamps': check_lamps, 'sky': check_sky, 'furnace': check_furnace, 'metal': check_metal}
    add = lambda p: (p.add_argument('--only', action='append', choices=every, help='these cases'),
                     p.add_argument('--method', action='append', choices=METHODS, help='these methods'))
    arguments, kiln = harness.start(__doc__, add)
    checks = harness.Checks()
    table = harness.Table(('light', 24), ('dark there', 16), ('off', 12))
    for name in arguments.only or every:
        every[name](kiln, checks, table, arguments.method or METHODS, kiln.samples)
    checks.end()


if __name__ == '__main__':
    main()
