"""A sun under a sky: pilots decide how many samples the sun has (shaders/shared/sun_pilot.h).

A plate lies half under a roof, whose edge runs through the middle of a column of texels' left quarter, under a sun
straight above and a sky too dim to count. The sun's share of a texel is then known: 0, 3/4 or 1.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

SUN, TEXELS, SAMPLES = 2.0, 32, 64
DOWN = [-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]  # a quarter turn about x: -z becomes -y


def scene_of(path):
    scene = glb.Scene()
    black = scene.material('black')
    scene.quad('plate', [(0, 0, TEXELS), (TEXELS, 0, TEXELS), (TEXELS, 0, 0), (0, 0, 0)], black)
    scene.quad('roof', [(-99, 3, -99), (-99, 3, 99), (16.25, 3, 99), (16.25, 3, -99)], black)
    scene.light('sun', {'type': 'directional', 'intensity': SUN}, rotation=DOWN)
    return scene.write(path)


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    bake = kiln.bake(scene_of(os.path.join(kiln.scratch, 'sun.glb')), '--environment', '1e-6,1e-6,1e-6',
                     '--lightmap-size', TEXELS, '--samples-direct', SAMPLES, '--bounces', 0, '--samples-probe', 0,
                     '--denoise', 'none', '--no-stitch')
    if checks.baked(bake):
        points = bake.points
        plate = points.position[:, 1] < points.position[:, 1].mean()
        light, x = points.direct[plate, 1] / SUN, points.position[plate, 0]
        edge = np.abs(x - 16.5) < 0.5
        error = float(np.sqrt(np.mean((light[edge] - 0.75) ** 2)))
        lit = np.where(x > 16.5, 1.0, 0.0)
        off = float(np.abs(light - lit)[~edge].max())
        checks.that(edge.sum() == TEXELS and off < 1e-5, 'beside the edge: off by %g' % off, bake.process)
        # 64 samples, which the sun had without a pilot, are off by 0.0028
        checks.that(error < 0.0018 and abs(float(light[edge].mean()) - 0.75) < 0.004,
                    'at the edge: mean %g, error %g' % (light[edge].mean(), error), bake.process)
        rays = bake.run['rays']['direct']
        few, many = int(points.valid.sum()) * SAMPLES, 3 * TEXELS * 4 * SAMPLES
        checks.that(few <= rays <= few + many, '%d rays of %d to %d' % (rays, few, few + many), bake.process)
        print('edge: mean %.4f, error %.4f; beside it %.1e; %d rays' % (light[edge].mean(), error, off, rays))
    checks.end()


if __name__ == '__main__':
    main()
