"""Kahl's RTRad and kiln on RTRad's own scene: a statue in a Cornell box, lightmaps of 2048 x 2048, two bounces.

  /usr/bin/python3 tests/bench/rtrad.py --kiln build/release/kiln --backend vulkan

RTRad's published figure is 2.96 s (RTX 2070 Super) for 1024 directions a texel: one list for all texels, even over the
hemisphere, and the lamp is lit texels that rays happen to meet. kiln's error is nrmse of irradiance against a converged
bake, and of direct light against the closed form where nothing is in the lamp's way. There the error of 1024 directions
is reckoned too: those of a Fibonacci spiral, as even as any, meet the lamp or do not.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import glb  # noqa: E402
import harness  # noqa: E402

SCENE = ('third_party', 'noncommercial', 'rtrad_cornelllucy.glb')
DIRECTIONS = 1024
LADDER = ((16, 16, 64), (64, 16, 128), (128, 16, 128), (256, 16, 256), (1024, 16, 256))
KINDS = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}


def array(scene, index):
    accessor = scene.document['accessors'][index]
    view = scene.document['bufferViews'][accessor['bufferView']]
    at = view.get('byteOffset', 0) + accessor.get('byteOffset', 0)
    width = {'SCALAR': 1, 'VEC3': 3}[accessor['type']]
    return np.frombuffer(bytes(scene.blob), KINDS[accessor['componentType']], accessor['count'] * width,
                         at).reshape(-1, width)


def turned(node, positions):
    x, y, z, w = node.get('rotation', (0, 0, 0, 1))
    turn = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    return positions * node.get('scale', (1, 1, 1)) @ turn.T + node.get('translation', (0, 0, 0))


def lamp_triangles(path):
    """The emitting triangles, (n, 3, 3) in metres, all of radiance 1."""
    scene = glb.Scene()
    scene.load(path)
    lamps = []
    for node in scene.document['nodes']:
        for p in scene.document['meshes'][node['mesh']]['primitives']:
            if any(scene.document['materials'][p['material']].get('emissiveFactor', (0,))):
                corners = turned(node, array(scene, p['attributes']['POSITION']).astype(np.float64))
                lamps.append(corners[array(scene, p['indices']).reshape(-1, 3).astype(np.int64)])
    return np.concatenate(lamps)


def closed_form(lamps, position, normal):
    """Irradiance of triangles of radiance 1 that reach below no point's horizon (Lambert 1760)."""
    total = np.zeros(len(position))
    for triangle in lamps:
        to = triangle[None] - position[:, None]
        to /= np.linalg.norm(to, axis=2, keepdims=True)
        form = np.zeros(len(position))
        for a, b in ((0, 1), (1, 2), (2, 0)):
            across = np.cross(to[:, a], to[:, b])
            angle = np.arccos(np.clip((to[:, a] * to[:, b]).sum(1), -1, 1))
            form += angle * (across * normal).sum(1) / np.maximum(np.linalg.norm(across, axis=1), 1e-30)
        total += np.abs(form) / 2
    return total


def met(lamps, position, direction):
    """Whether rays, (n, 3) from (3,), meet a lamp."""
    hit = np.zeros(len(direction), bool)
    for a, b, c in lamps:
        e1, e2, to = b - a, c - a, position - a
        p = np.cross(direction, e2)
        det = p @ e1
        det = np.where(np.abs(det) < 1e-12, 1e-12, det)
        u, q = p @ to / det, np.cross(to, e1)
        v, t = direction @ q / det, (e2 @ q) / det
        hit |= (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return hit


def by_directions(lamps, position, normal):
    """Irradiance from DIRECTIONS even directions of the hemisphere, the same at all points."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = k / DIRECTIONS, np.pi * (3 - np.sqrt(5)) * k
    local = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], 1)
    found = np.empty(len(position))
    for i, (x, n) in enumerate(zip(position, normal)):
        t = np.cross(n, (0, 1, 0) if abs(n[0]) > 0.9 else (1, 0, 0))
        t /= np.linalg.norm(t)
        found[i] = 2 * np.pi / DIRECTIONS * (z * met(lamps, x, local @ np.stack([t, np.cross(n, t), n]))).sum()
    return found


class Unoccluded:
    """Points that see the whole lamp, and what direct light there is exactly."""

    def __init__(self, path, points):
        lamps = lamp_triangles(path)
        some = np.sort(np.random.default_rng(1).choice(np.flatnonzero(points.valid),
                                                       min(40000, int(points.valid.sum())), replace=False))
        x, n = points.position[some], points.normal[some]
        above = (((lamps.reshape(-1, 3)[None] - x[:, None]) * n[:, None]).sum(2) > -1e-4).all(1)
        exact = closed_form(lamps, x, n)
        seen = np.flatnonzero(above & (np.abs(points.direct[some][:, 0] - exact) < 0.003 * exact))[:2000]
        self.points, self.exact = some[seen], exact[seen]
        self.directions = self.error(by_directions(lamps, x[seen], n[seen]))

    def error(self, got):
        return float(np.sqrt(np.mean((got - self.exact) ** 2)) / self.exact.mean())

    def error_of(self, points):
        return self.error(points.direct[self.points][:, 0])


def main():
    add = lambda p: (p.add_argument('--side', type=int, default=2048, help='texels of a lightmap'),
                     p.add_argument('--converged', type=int, default=16384))
    arguments, kiln = harness.start(__doc__, add)
    path = harness.need_shared(*SCENE)
    bake = lambda direct, bounce, final, seed: measure.must(
        kiln.bake(path, '--lightmap-size', arguments.side, '--bounces', 2, '--samples-probe', 0,
        '--samples-direct', direct, '--samples-bounce', bounce, '--samples-indirect', final, '--seed', seed,
        timeout=3600))
    converged = bake(max(256, arguments.converged // 8), max(64, arguments.converged // 16), arguments.converged, 99)
    reference = measure.values(converged)
    unoccluded = Unoccluded(path, converged.points)
    print('direct light at %d points that see the whole lamp: %d directions are off by %.3f %%, the converged bake by '
          '%.3f %%' % (
        len(unoccluded.points), DIRECTIONS, 100 * unoccluded.directions, 100 * unoccluded.error_of(converged.points)))
    converged.remove()
    table = harness.Table(('direct', 6), ('bounce', 6), ('final', 6), ('points', 9), ('passes s', 9),
                          ('whole lamp', 11), ('all points', 11))
    for direct, bounce, final in LADDER:
        b = bake(direct, bounce, final, 0)
        table.row(direct, bounce, final, b.points.count, '%.3f' % measure.tracing_seconds(b),
                  '%.3f %%' % (100 * unoccluded.error_of(b.points)),
                  '%.3f %%' % (100 * measure.nrmse(measure.values(b), reference)))
        b.remove()


if __name__ == '__main__':
    main()
