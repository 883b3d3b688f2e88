"""Interiors as Blender exports them, baked by kiln and by Blender's Cycles: each object's mean irradiance, texel by
texel the same places.

  cycles.py --kiln KILN [--interiors sunny,flat,furnished] [--side 192] [--cycles-samples 96] [--single-sided]

cycles_blender.py makes them, and says what is in them. The exporter writes "doubleSided": true on every material;
--single-sided exports them without, Cycles bakes the same. Units: the exporter makes 683 lux of a lamp's W/m2 and
leaves glowing materials as they are. Means are over the texels that Cycles covers and in which kiln has a valid surface
point, weighted by kiln's areas; objects whose mean is under a thousandth of the interior's brightest are compared with
that. Both bakers bounce as often. Lightmaps are fine, for kiln's light has their resolution: at a quarter of it (48
texels a side) the dim side of a wall is 8 % too bright, and a table by a sunlit floor 3 % too dark. Cycles bakes with
two seeds: half of what they differ by, an estimate of the noise in their mean, is said beside. The aim is 1 %.
"""
import json
import math
import os
import shutil
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402

HERE = os.path.dirname(os.path.abspath(__file__))
TOLERANCE, BOUNCES, LUMENS = 0.01, 8, 683.0
SAMPLES = ('--samples-direct', 128, '--samples-bounce', 32, '--samples-indirect', 256, '--samples-probe', 0,
           '--bounces', BOUNCES, '--no-tail')


def blender(interior, folder, side, samples, flags):
    return harness.run(['blender', '--background', '-noaudio', '--factory-startup', '--python-exit-code', '1',
                        '--python',
                        os.path.join(HERE, 'cycles_blender.py'), '--', interior, folder, str(side), str(samples),
                        str(BOUNCES), *flags], timeout=7200)


def compare(checks, table, interior, bake, folder, unit):
    """A row an object."""
    points, rows = bake.points, []
    for index, name in enumerate(bake.names()):
        pair = [harness.read_exr(os.path.join(folder, '%s_%d.exr' % (name.replace(' ', '_'), seed)))[0]
                for seed in (1, 2)]
        cycles = [math.pi * np.stack([c[k] for k in 'RGB'], -1).astype(float) @ harness.LUMINANCE for c in pair]
        # Cycles bakes fronts
        covered, all_own = pair[0]['A'] > 0.5, np.flatnonzero((points.object == index) & (points.side == 0))
        own = all_own[points.valid[all_own]]
        own = own[covered[points.y[own], points.x[own]]]
        weight = points.area[own] / points.area[own].sum()
        ours, theirs = points.total[own] @ harness.LUMINANCE / unit, [weight @ c[points.y[own], points.x[own]]
                                                                      for c in cycles]
        buried = 1 - points.area[own].sum() / points.area[all_own].sum()
        rows.append((name, len(own), buried, weight @ ours, sum(theirs) / 2, abs(theirs[0] - theirs[1]) / 2))
    brightest = max(theirs for _, _, _, _, theirs, _ in rows)
    for name, count, buried, ours, theirs, noise in rows:
        difference = (ours - theirs) / max(theirs, 1e-3 * brightest)
        table.row('%s/%s' % (interior, name), count, '%.1f %%' % (100 * buried), '%.5f' % theirs, '%.5f' % ours,
                  '%+.2f %%' % (100 * difference),
                  '%.2f %%' % (100 * noise / max(theirs, 1e-9)))
        checks.that(abs(difference) <= TOLERANCE,
                    '%s: the mean of %s is %+.2f %% off' % (interior, name, 100 * difference))


def main():
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--interiors', default='sunny,flat,furnished'),
        lambda p: p.add_argument('--side', type=int, default=192),
        lambda p: p.add_argument('--cycles-samples', type=int, default=96),
        lambda p: p.add_argument('--single-sided', action='store_true'),
        lambda p: p.add_argument('--cycles', metavar='FOLDER',
                                 help="keep Cycles' bakes in this folder, and use what is there"))
    if shutil.which('blender') is None:
        harness.skip("blender is not installed (Debian's package blender)")
    checks = harness.Checks()
    table = harness.Table(('interior/object', 26), ('texels', 7), ('left out', 8), ('Cycles W/m2', 12), ('kiln', 10),
                          ('difference', 10), ('seeds', 8))
    flags = ['--single-sided'] if arguments.single_sided else []
    for interior in arguments.interiors.split(','):
        folder = os.path.join(arguments.cycles or kiln.scratch, interior + ('_single' if flags else ''))
        os.makedirs(folder, exist_ok=True)
        baked = os.path.exists(os.path.join(folder, 'done'))
        p = blender(interior, folder, arguments.side, arguments.cycles_samples,
                    flags + (['--no-bake'] if baked else []))
        made = [l for l in p.stdout.splitlines() if l.startswith('MADE ')]
        if not checks.that(p.status == 0 and made, '%s: blender ended with %d' % (interior, p.status), p):
            print(p.stdout[-2000:])
            continue
        open(os.path.join(folder, 'done'), 'w').close()
        unit = 1.0 if interior == 'furnished' else LUMENS
        sky = json.loads(made[0][5:])['sky'] * unit
        bake = kiln.bake(os.path.join(folder, 'scene.glb'), *SAMPLES, '--denoise', 'none', '--lightmap-size',
                         arguments.side, '--environment', '%g,%g,%g' % (sky, sky, sky), timeout=3600)
        if checks.baked(bake):
            compare(checks, table, interior, bake, folder, unit)
    checks.end()


if __name__ == '__main__':
    main()
