"""The Cornell box with one lightmap layout shared by all its meshes, so that two bakers can fill the same texels.

Measurements are those published by the Cornell University Program of Computer Graphics. Charts lie on a grid of 1/128
of the atlas with two steps between them: at any side that is a multiple of 128 every chart's edge is a texel's edge,
and each texel is wholly inside a chart or wholly outside all of them.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402

STEP = 1.0 / 128.0
METRES = 0.01
WIDTH, HEIGHT, DEPTH = 552.8, 548.8, 559.2
LAMP_X, LAMP_Z = (213.0, 343.0), (227.0, 332.0)


class Part:
    """A mesh in the making."""

    def __init__(self, name, material):
        self.name, self.material = name, material
        self.positions, self.layout, self.triangles, self.charts = [], [], [], []

    def panel(self, corners, chart, s=(0.0, 1.0), t=(0.0, 1.0), hole=None):
        """A parallelogram (counter-clockwise from its front) cut at `s` and `t` along its first and last edge, without
        the pane `hole`, onto `chart` = (x, y, width, height) in steps."""
        a, b, _, d = (np.array(c, float) * METRES for c in corners)
        x, y, w, h = chart
        base, across = len(self.positions), len(s)
        for v in t:
            for u in s:
                self.positions.append(a + u * (b - a) + v * (d - a))
                self.layout.append(((x + u * w) * STEP, (y + (1 - v) * h) * STEP))
        for j in range(len(t) - 1):
            for i in range(across - 1):
                if (i, j) != hole:
                    k = base + j * across + i
                    self.triangles += [(k, k + 1, k + across + 1), (k, k + across + 1, k + across)]
        self.charts.append(chart)


def build(lamp_cuts):
    """([Part], Scene)."""
    scene = glb.Scene()
    white = scene.material('white', (0.725, 0.710, 0.680))
    red = scene.material('red', (0.630, 0.065, 0.050))
    green = scene.material('green', (0.140, 0.450, 0.091))
    lamp = scene.material('lamp', (0, 0, 0), (17.0, 12.0, 4.0))
    X, Y, Z = WIDTH, HEIGHT, DEPTH
    parts = []

    def part(name, material):
        parts.append(Part(name, material))
        return parts[-1]

    part('floor', white).panel([(0, 0, 0), (0, 0, Z), (X, 0, Z), (X, 0, 0)], (1, 1, 32, 32))
    part('ceiling', white).panel([(0, Y, 0), (X, Y, 0), (X, Y, Z), (0, Y, Z)], (35, 1, 32, 32),
                                 (0, LAMP_X[0] / X, LAMP_X[1] / X, 1),
                                 (0, LAMP_Z[0] / Z, LAMP_Z[1] / Z, 1), hole=(1, 1))
    part('back', white).panel([(X, 0, Z), (0, 0, Z), (0, Y, Z), (X, Y, Z)], (69, 1, 32, 32))
    part('left', red).panel([(X, 0, 0), (X, 0, Z), (X, Y, Z), (X, Y, 0)], (1, 35, 32, 32))
    part('right', green).panel([(0, 0, Z), (0, 0, 0), (0, Y, 0), (0, Y, Z)], (35, 35, 32, 32))
    for name, foot, h, row, tall in (('short', [(130, 65), (82, 225), (240, 272), (290, 114)], 165, 69, 10),
                                     ('tall', [(423, 247), (265, 296), (314, 456), (472, 406)], 330, 81, 19)):
        block = part(name, white)
        block.panel([(x, h, z) for x, z in foot], (1, row, 10, 10))
        for i in range(4):
            (ax, az), (bx, bz) = foot[i], foot[(i + 1) % 4]
            block.panel([(ax, 0, az), (bx, 0, bz), (bx, h, bz), (ax, h, az)], (13 + 12 * i, row, 10, tall))
    cuts = tuple(i / lamp_cuts for i in range(lamp_cuts + 1))
    (x0, x1), (z0, z1) = LAMP_X, LAMP_Z
    part('lamp', lamp).panel([(x0, Y, z0), (x1, Y, z0), (x1, Y, z1), (x0, Y, z1)], (1, 102, 8, 6), cuts, cuts)
    for p in parts:
        scene.mesh(p.name, p.positions, p.layout, p.triangles, p.material)
    return parts, scene


def write(path, lamp_cuts=8):
    """Writes the scene; returns {mesh: [chart, ...]} of those that reflect, charts in steps of 1/128."""
    parts, scene = build(lamp_cuts)
    scene.write(path)
    return {p.name: p.charts for p in parts if p.name != 'lamp'}


def mask(charts, side, ceiling_hole=True):
    """{mesh: (side, side) of bool}: texels wholly inside its charts, and on the surface: the ceiling has a hole for the
    lamp."""
    scale = side // 128
    result = {}
    for name, rects in charts.items():
        m = np.zeros((side, side), bool)
        for x, y, w, h in rects:
            m[y * scale:(y + h) * scale, x * scale:(x + w) * scale] = True
        if name == 'ceiling' and ceiling_hole:
            x, y, w, h = rects[0]
            u = [(x + w * f / WIDTH) * scale for f in LAMP_X]
            v = [(y + h * (1 - f / DEPTH)) * scale for f in reversed(LAMP_Z)]
            m[int(np.floor(v[0])):int(np.ceil(v[1])), int(np.floor(u[0])):int(np.ceil(u[1]))] = False
        result[name] = m
    return result
