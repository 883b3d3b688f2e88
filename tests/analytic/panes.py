"""What lets light through buries nothing: floors below single-sided panes that face up.

Each floor lies below the back of a pane so wide that all rays which ask whether a place is buried meet it. Under a sun
of 10 a blended pane leaves 10 (1 - alpha), whatever alpha is, also tilted or with two sides; one of a texture what
the texture says there; a mask leaves 10 or nothing. All places of these floors are valid, and probes below panes are
where the grid has them. What opaque sheets cover stays buried, also where their material's texture has holes that the
sheets do not show; so does what stands in a box below a pane.
"""
import math
import os
import sys

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402
from glass import DOWN, SUN, texture  # noqa: E402

HALF, HEIGHT, WIDE = 0.5, 0.3, 1.5  # of a floor, of the pane above it, of half the pane
ATLAS = 8  # texels across of the textures


def sheet(scene, name, x, material, slope=0.0, height=HEIGHT, part=(0.0, 0.0, 1.0, 1.0)):
    """A pane that faces up, its texture's u along x; `part` of the texture: its least and greatest u and v."""
    left, right = height - slope * WIDE, height + slope * WIDE
    u0, v0, u1, v1 = part
    scene.quad(name, [(x - WIDE, left, WIDE), (x + WIDE, right, WIDE), (x + WIDE, right, -WIDE),
                      (x - WIDE, left, -WIDE)], material, ((u0, v1), (u1, v1), (u1, v0), (u0, v0)))


def make(scene, name, mode=None, alpha=1.0, image=None, double_sided=False, transmission=None):
    number = scene.material(name, (1, 1, 1) if transmission else (0, 0, 0), double_sided=double_sided)
    material = scene.document['materials'][number]
    material['pbrMetallicRoughness']['baseColorFactor'][3] = alpha
    if mode is not None:
        material['alphaMode'] = mode
    if image is not None:
        material['pbrMetallicRoughness']['baseColorTexture'] = {'index': image}
    if transmission is not None:
        material['extensions'] = {'KHR_materials_transmission': {'transmissionFactor': transmission}}
        scene.used.add('KHR_materials_transmission')
    return number


def build(path):
    """The scene, and of each floor the light at (x, z) from its middle."""
    scene, light = glb.Scene(), {}
    black, stripes, steps = scene.material('black'), np.full((ATLAS, ATLAS, 4), 255), np.full((ATLAS, ATLAS, 4), 255)
    stripes[:, ::2, 3] = 0
    steps[..., 3] = np.linspace(100, 255, ATLAS)
    stripes, steps = texture(scene, stripes), texture(scene, steps)
    column = lambda x: np.clip(((x + WIDE) / (2 * WIDE) * ATLAS).astype(int), 0, ATLAS - 1)

    def add(name, through, material, **options):
        x = 4.0 * len(light)
        scene.quad(name, [(x - HALF, 0, HALF), (x + HALF, 0, HALF), (x + HALF, 0, -HALF), (x - HALF, 0, -HALF)], black)
        sheet(scene, 'over ' + name, x, material, **options)
        light[name] = x, through

    for alpha in (0.3, 0.5, 0.9):
        add('blend%g' % alpha, lambda x, a=alpha: 1 - a + 0 * x, make(scene, 'blend%g' % alpha, 'BLEND', alpha))
    add('tilted', lambda x: 0.3 + 0 * x, make(scene, 'tilted', 'BLEND', 0.7), slope=0.15)
    add('two sides', lambda x: 0.2 + 0 * x, make(scene, 'two sides', 'BLEND', 0.8, double_sided=True))
    add('thin glass', lambda x: 0.5 + 0 * x, make(scene, 'thin glass', transmission=0.5))
    add('steps', lambda x: 1 - np.round(np.linspace(100, 255, ATLAS)).astype(int)[column(x)] / 255,
        make(scene, 'steps', 'BLEND', image=steps))
    add('mask', lambda x: np.where(column(x) % 2 == 0, 1.0, 0.0), make(scene, 'mask', 'MASK', image=stripes))
    # buried: below what shows none of its texture's holes; below an opaque sheet; in a box, below a pane
    whole = ((ATLAS - 0.7) / ATLAS, 0.4, (ATLAS - 0.3) / ATLAS, 0.6)
    add('covered', None, make(scene, 'whole mask', 'MASK', image=stripes), part=whole)
    add('roofed', None, black)
    add('in a box', None, make(scene, 'inner pane', 'BLEND', 0.9))
    x = light['in a box'][0]
    glb.box(scene, 'box', (x - 1.6, -1, -1.6), (x + 1.6, 1, 1.6), black)
    scene.light('sun', {'type': 'directional', 'intensity': SUN}, rotation=DOWN)
    return scene.write(path), light


def check_floors(kiln, checks, table):
    path, light = build(os.path.join(kiln.scratch, 'panes.glb'))
    bake = kiln.bake(path, '--texels-per-metre', 8, '--samples-direct', 16, '--bounces', 0, '--materials', 'diffuse',
                     '--samples-probe', 0, '--denoise', 'none')
    if not checks.baked(bake):
        return
    points = bake.points
    for name, (x, through) in light.items():
        own = points.of(bake.index(name))
        every = np.flatnonzero(points.object == bake.index(name))
        if through is None:
            checks.that(len(own) == 0, '%s: %d of %d points are valid' % (name, len(own), len(every)), bake.process)
            table.row(name, 'buried', len(own))
            continue
        checks.that(len(own) == len(every) > 50, '%s: %d of %d points are valid' % (name, len(own), len(every)),
                    bake.process)
        got, size = points.direct[own, 0], math.sqrt(float(np.median(points.area[own])))
        inside = (np.arange(64) + 0.5) / 64 - 0.5  # a texel's share of each step or stripe
        want = SUN * through(points.position[own, 0, None] - x + size * inside).mean(1)
        steps = name in ('mask', 'steps')
        off = np.abs(got - want).max()
        checks.that(off <= (0.13 * SUN if steps else 2e-5), '%s: a texel is off by %g' % (name, off), bake.process)
        checks.that(abs(got.mean() - want.mean()) <= (0.01 * SUN if steps else 1e-5), '%s: mean %g instead of %g' %
                    (name, got.mean(), want.mean()), bake.process)
        table.row(name, '%.4f' % want.mean(), '%.4f' % got.mean())
    bake.remove()


def check_probes(kiln, checks, table):
    """A grid of probes, most of them below wide panes of 0.6, one over the other."""
    scene = glb.Scene()
    black, pane = scene.material('black'), make(scene, 'pane', 'BLEND', 0.6)
    scene.quad('floor', [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], black)
    for height in (1.1, 2.2):
        # no probe's ray goes through a diagonal, where it would meet both triangles
        scene.quad('pane%g' % height, [(-2, height, 2), (2.3, height, 2), (2.3, height, -2), (-2, height, -2)], pane)
    scene.light('sun', {'type': 'directional', 'intensity': SUN}, rotation=DOWN)
    bake = kiln.bake(scene.write(os.path.join(kiln.scratch, 'probes.glb')), '--texels-per-metre', 2, '--samples-direct',
                     16, '--bounces', 0, '--materials', 'diffuse', '--samples-probe', 256, '--probe-spacing', 0.5)
    if not checks.baked(bake):
        return
    with h5py.File(os.path.join(bake.directory, 'volume.hdf'), 'r') as f:
        group = f['VTKHDF']
        data = {name: item[...].astype(float) for name, item in group['PointData'].items()}
        origin, spacing = group.attrs['Origin'], group.attrs['Spacing']
    validity = data['validity']
    checks.that(validity.min() == 1, 'validity of probes below panes: %g at least' % validity.min(), bake.process)
    height = origin[1] + spacing[1] * np.arange(validity.shape[1])
    middle = data['irradiance_posy'][1:-1, :, 1:-1, 0].mean((0, 2))
    want = SUN * 0.4 ** ((height < 1.1).astype(float) + (height < 2.2))
    inner = (height > 0.05) & (np.abs(height - 1.1) > 0.05) & (np.abs(height - 2.2) > 0.05)
    off = np.abs(middle - want)[inner].max()
    checks.that(off < 1e-3, 'light at probes from above: %s instead of %s' % (middle, want), bake.process)
    table.row('probes', '%d of them' % validity.size, 'off %.1e' % off)
    bake.remove()


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('floor', 16), ('right', 14), ('found', 12))
    check_floors(kiln, checks, table)
    check_probes(kiln, checks, table)
    checks.end()


if __name__ == '__main__':
    main()
