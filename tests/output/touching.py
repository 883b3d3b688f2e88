"""Lightmaps of objects that touch: their surface goes on from one object to the next, and so does the light on it.

  /usr/bin/python3 tests/output/touching.py --kiln build/release/kiln [--backend vulkan]

Floors of two and of four coarse objects below one lamp, whose layouts are turned and whose edges have other lengths,
are baked with and without --no-stitch. At places along the common edges the light is read on both sides as a bilinear
filter does. The step between them, in units of the stated error there, must nearly vanish, the light must not change on
the whole, nor much on the surface where the layout has a margin, and the same bytes must come from 1, 3 and 4 ranks,
and from 2 and 3 where all lightmaps are in bands. Objects 1 mm apart, at a right angle, back to back, and one upon the
other keep their bits.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

OPTIONS = ('--texels-per-metre', 8, '--samples-direct', 16, '--samples-bounce', 4, '--samples-indirect', 32,
           '--samples-probe', 0, '--no-export', '--error-map')
# Of a layout, for the corners (x0, z1) (x1, z1) (x1, z0) (x0, z0): without a margin, and with one.
WHOLE = ((0, 1), (1, 1), (1, 0), (0, 0))
PADDED = ((0.1, 0.9), (0.9, 0.9), (0.9, 0.1), (0.1, 0.1))
FLOORS = {'two': (WHOLE, ((0, 0, 1, 1, 0), (1, 0, 2, 1, 1))),
          'four': (WHOLE, ((0, 0, 2, 1, 0), (0, 1, 1, 2, 1), (1, 1, 2, 1.5, 2), (1, 1.5, 2, 2, 3))),
          'two, padded': (PADDED, ((0, 0, 1, 1, 0), (1, 0, 2, 1, 1))),
          'four, padded': (PADDED, ((0, 0, 2, 1, 0), (0, 1, 1, 2, 1), (1, 1, 2, 1.5, 2), (1, 1.5, 2, 2, 3)))}
# How far the surface may move, of the step: where borders lie between texels, and where they cut them.
MOVED = {'two, padded': 0.02, 'four, padded': 0.15}


def begin():
    """A lamp above, and a red wall beside, for indirect light."""
    scene = glb.Scene()
    lamp, red = scene.material('lamp', radiance=(20, 20, 20)), scene.material('red', (0.8, 0.2, 0.2))
    scene.quad('lamp', [(0.5, 1.6, 0.5), (0.9, 1.6, 0.5), (0.9, 1.6, 0.9), (0.5, 1.6, 0.9)], lamp)
    scene.quad('wall', [(-0.5, 0, 2), (-0.5, 0, 0), (-0.5, 2, 0), (-0.5, 2, 2)], red)
    return scene, scene.material('grey', (0.5, 0.5, 0.5))


def floor(path, layout, tiles):
    scene, grey = begin()
    for i, (x0, z0, x1, z1, turn) in enumerate(tiles):
        scene.quad('floor%d' % i, [(x0, 0, z1), (x1, 0, z1), (x1, 0, z0), (x0, 0, z0)], grey,
                   layout[turn:] + layout[:turn])
    return scene.write(path)


class Tile:
    """The lightmap of one tile of a floor."""

    def __init__(self, bake, number, corners, tile):
        self.corners = corners
        self.x0, self.z0, self.x1, self.z1, self.turn = tile
        entry = bake.run['objects'][bake.index('floor%d' % number)]
        channels, _ = harness.read_exr(os.path.join(bake.directory, entry['lightmap']))
        self.light = sum(f * channels[c].astype(float) for f, c in zip(harness.LUMINANCE, 'RGB'))
        self.error = channels['error.Y'].astype(float)
        self.surface = channels['validity.Y'] > 0

    def layout(self, x, z):
        """Texture coordinates of a place: its shares along both sides, from the first corner on."""
        first, second, last = (np.array(self.corners[(k + self.turn) % 4], float) for k in (0, 1, 3))
        s, t = (x - self.x0) / (self.x1 - self.x0), (self.z1 - z) / (self.z1 - self.z0)
        return first + s * (second - first) + t * (last - first)

    def read(self, values, x, z):
        """As a bilinear filter does."""
        height, width = values.shape
        u, v = self.layout(x, z) * (width, height) - 0.5
        total = 0.0
        for row, b in ((np.floor(v), 1 - v + np.floor(v)), (np.floor(v) + 1, v - np.floor(v))):
            for column, a in ((np.floor(u), 1 - u + np.floor(u)), (np.floor(u) + 1, u - np.floor(u))):
                total += a * b * values[int(np.clip(row, 0, height - 1)), int(np.clip(column, 0, width - 1))]
        return total

    def has(self, x, z):
        return self.x0 - 1e-9 <= x <= self.x1 + 1e-9 and self.z0 - 1e-9 <= z <= self.z1 + 1e-9


def places(tiles):
    """(first tile, second tile, x, z) along all common edges, but for the corners."""
    for i, a in enumerate(tiles):
        for j, b in enumerate(tiles[:i]):
            low, high = np.maximum(a[:2], b[:2]), np.minimum(a[2:4], b[2:4])
            if (high - low < 0).any() or not (high - low > 0).any():
                continue
            for t in np.linspace(0.03, 0.97, 48):
                yield (i, j, *(low + t * (high - low)))


def steps(bake, layout, tiles):
    """Root mean square of the step, and of its stated error."""
    maps = [Tile(bake, i, layout, tile) for i, tile in enumerate(tiles)]
    off = [maps[i].read(maps[i].light, x, z) - maps[j].read(maps[j].light, x, z) for i, j, x, z in places(tiles)]
    noise = [np.hypot(maps[i].read(maps[i].error, x, z), maps[j].read(maps[j].error, x, z))
             for i, j, x, z in places(tiles)]
    return float(np.sqrt(np.mean(np.square(off)))), float(np.sqrt(np.mean(np.square(noise))))


def surfaces(bake, layout, tiles):
    """The light of all surface texels, and the area that each stands for."""
    maps = [Tile(bake, i, layout, tile) for i, tile in enumerate(tiles)]
    return (np.concatenate([m.light[m.surface] for m in maps]),
            np.concatenate([np.full(m.surface.sum(), (m.x1 - m.x0) * (m.z1 - m.z0) / m.surface.sum()) for m in maps]))


def check_steps(checks, kiln, table):
    for name, (layout, tiles) in FLOORS.items():
        scene = floor(os.path.join(kiln.scratch, name + '.glb'), layout, tiles)
        for how in ('none', 'regression'):
            raw, smooth = (kiln.bake(scene, *OPTIONS, '--denoise', how, *more) for more in (('--no-stitch',), ()))
            if not checks.baked(raw) or not checks.baked(smooth):
                continue
            before, noise = steps(raw, layout, tiles)
            after, _ = steps(smooth, layout, tiles)
            (old, area), (new, _) = surfaces(raw, layout, tiles), surfaces(smooth, layout, tiles)
            change, moved = area @ new / (area @ old) - 1, float(np.sqrt(np.mean(np.square(new - old))))
            table.row(name, how, '%.2f' % (before / noise), '%.2f' % (after / noise), '%+.1e' % change,
                      '%.3f' % (moved / before))
            checks.that(before > 0.5 * noise, 'the floor of %s has no step to smooth' % name)
            checks.that(after < 0.1 * before, 'floor of %s, --denoise %s: a step of %.3g is left of %.3g' % (
                name, how, after, before), smooth.process)
            checks.that(abs(change) < 1e-3, 'floor of %s, --denoise %s: the light changes by %.2g' % (
                name, how, change), smooth.process)
            checks.that(moved < MOVED.get(name, 0.5) * before, 'floor of %s, --denoise %s: the texels of the surface '
                        'move by %.3g of the step' % (name, how, moved / before))


def check_ranks(checks, kiln):
    scene = floor(os.path.join(kiln.scratch, 'ranks.glb'), *FLOORS['four, padded'])
    first = None
    for ranks, threads, divide in ((1, 2, False), (3, 1, False), (4, 1, False), (2, 1, True), (3, 1, True)):
        kiln.environment.pop('KILN_DIVIDE_FROM', None)
        if divide:
            kiln.environment['KILN_DIVIDE_FROM'] = '1'
        bake = kiln.bake(scene, *OPTIONS, '--threads', threads, ranks=ranks)
        if checks.baked(bake):
            first = first or harness.lightmap_hashes(bake)
            checks.that(harness.lightmap_hashes(bake) == first,
                        'lightmaps of %d ranks are not the same bytes%s' % (ranks, ', in bands' if divide else ''),
                        bake.process)
    kiln.environment.pop('KILN_DIVIDE_FROM', None)


def pixels(bake):
    found = {}
    for entry in bake.run['objects']:
        channels, _ = harness.read_exr(os.path.join(bake.directory, entry['lightmap']))
        found.update({(entry['name'], name): array.tobytes() for name, array in channels.items()})
    return found


def apart(path, corners):
    """Two quads that do not go on in each other."""
    scene, grey = begin()
    for i, four in enumerate(corners):
        scene.quad('floor%d' % i, four, grey)
    return scene.write(path)


def check_apart(checks, kiln):
    first = [(0, 0, 1), (1, 0, 1), (1, 0, 0), (0, 0, 0)]
    cases = {'1 mm apart': [(1.001, 0, 1), (2, 0, 1), (2, 0, 0), (1.001, 0, 0)],
             'a step of 1 mm': [(1, 0.001, 1), (2, 0.001, 1), (2, 0.001, 0), (1, 0.001, 0)],
             'at a right angle': [(1, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1)],
             'back to back': [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)],
             'turned over beside it': [(1, 0, 0), (2, 0, 0), (2, 0, 1), (1, 0, 1)],
             'upon it': [(0, 0, 1), (1, 0, 1), (1, 0, 0), (0, 0, 0)]}
    for name, second in cases.items():
        scene = apart(os.path.join(kiln.scratch, 'apart.glb'), (first, second))
        raw, smooth = (kiln.bake(scene, *OPTIONS, '--denoise', 'none', *more) for more in (('--no-stitch',), ()))
        if checks.baked(raw) and checks.baked(smooth):
            checks.that(pixels(raw) == pixels(smooth), 'objects %s: --stitch changes their light' % name,
                        smooth.process)


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('floor', 12), ('denoise', 10), ('step / noise before', 19), ('after', 6), ('all light', 9),
                          ('moved', 6))
    check_steps(checks, kiln, table)
    check_ranks(checks, kiln)
    check_apart(checks, kiln)
    checks.end()


if __name__ == '__main__':
    main()
