"""Kiln and Blender's Cycles bake caustics of `kiln generate cornell-spheres`: processor time of each to 2 % error.

  /usr/bin/python3 tests/bench/cycles_caustics.py --kiln build/release/kiln [--density D] [--caustics land|merge|vcm]

Walls and floor are baked, with one bounce between them; lamp, mirror and ball of glass only send light. The texels that
count are those wholly inside charts where light that comes by mirror and glass is at least a quarter of the mean of all
light. The error is nrmse over these: the root mean square difference of all their light over its mean, against two long
bakes by kiln, whose own noise is taken off (cycles.py). Cycles bakes the same texels in one atlas, type DIFFUSE, direct
and indirect, with reflective and refractive caustics, no clamping, no filter of gloss.

Both are baked with a few sample counts, each four times the one before. Where the last is not at 2 % yet, the time
follows from the square of its error. So it does for Cycles: it finds caustics of a lamp when a path from the texel
meets that by chance. Few do, with much light each: until many have, errors come out too small, and the ratio with them.
Times are seconds of the processor (user and system): of the whole process with import and files for kiln, of the bake
operator alone for Cycles. Needs Debian's package blender.
"""
import os
import shutil
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import cycles  # noqa: E402
import measure  # noqa: E402
import harness  # noqa: E402

TARGET, BOUNCES, FACTOR = 0.02, 1, 4
OBJECTS = '{light: {role: caster-only}, mirror_ball: {role: caster-only}, glass_ball: {role: caster-only}}'
LONG = ('--samples-direct', 512, '--samples-bounce', 64, '--samples-indirect', 512)


class Baker:
    """What cycles.run_cycles asks for, and kiln's bakes of the scene."""

    def __init__(self, kiln, options):
        self.kiln, self.threads, self.density = kiln, options.threads, options.density
        self.scene = cycles.Scene(measure.made(kiln, 'cornell-spheres'), 0)
        bakes = [self.bake('land', seed, '--photons', options.reference_photons, *LONG) for seed in (98, 99)]
        self.atlas = cycles.Atlas(bakes[0], False)
        counted = self.atlas.counted(bakes)
        self.laid_out = os.path.join(bakes[0].directory, 'scene.glb')
        self.references = [self.atlas.light(b, counted) for b in bakes]
        inside = self.atlas.blank(kind=bool)
        for name, mask in counted.items():
            self.atlas.of(inside, name)[mask] = True
        caustic = np.mean([self.atlas.light(b, counted, 'caustic.') for b in bakes], 0) @ harness.LUMINANCE
        light = np.mean(self.references, 0) @ harness.LUMINANCE
        self.counted, self.region = counted, inside & (caustic >= 0.25 * light[inside].mean())
        self.scale = float(np.mean([r[self.region].mean() for r in self.references]))
        print('%d of %d texels have caustics of a quarter of the mean light or more, which are %.0f %% of their light' %
              (self.region.sum(), inside.sum(), 100 * caustic[self.region].mean() / light[self.region].mean()))

    def bake(self, caustics, seed, *samples):
        return measure.must(self.kiln.bake(
            self.scene.path, '--texels-per-metre', self.density, '--materials', 'auto', '--caustics', caustics,
            '--bounces', BOUNCES, '--threads', self.threads, '--objects', OBJECTS, '--denoise', 'none',
            '--samples-probe', 0, '--seed', seed, *samples, timeout=7200))

    def error(self, image):
        return cycles.error(image[self.region], [r[self.region] for r in self.references], self.scale)


def row(table, baker, samples, image, ladder, seconds):
    error = baker.error(image)
    ladder.append((error, seconds))
    table.row(table.who, samples, '%.2f %%' % (100 * error), '%.4f' % (image[baker.region].mean() / baker.scale),
              '%.2f' % seconds)


def by_kiln(baker, options, table):
    """[(error, processor seconds)], each of FACTOR times the photons of the one before, until the target is reached."""
    ladder, photons = [], options.photons
    for seed in range(1, options.rungs + 1):
        bake = baker.bake(options.caustics, seed, '--photons', photons, '--samples-direct', 256, '--samples-bounce', 16,
                          '--samples-indirect', 256)
        row(table, baker, '%d photons' % photons, baker.atlas.light(bake, baker.counted), ladder,
            bake.process.processor)
        bake.remove()
        photons *= FACTOR
        if ladder[-1][0] <= TARGET:
            break
    return ladder


def by_cycles(baker, options, table):
    folder = os.path.join(baker.kiln.scratch, 'cycles')
    os.makedirs(folder, exist_ok=True)
    runs = [(options.samples * FACTOR**k, k + 1) for k in range(options.cycles_rungs)]
    records, images, _ = cycles.run_cycles(baker, folder, runs, bounces=BOUNCES, whole=True)
    ladder = []
    for (samples, _), record, image in zip(runs, records, images):
        row(table, baker, '%d samples' % samples, image, ladder, record['processor'])
    return ladder


def to_target(who, ladder):
    """Seconds to the target: between rungs; of the first that has it; or as many times the last one's as the error's
    square is too large."""
    error, seconds = ladder[-1]
    if error > TARGET:
        seconds *= (error / TARGET) ** 2
    elif len(ladder) > 1 and ladder[-2][0] > TARGET:
        seconds = measure.at_error(ladder[-2:], TARGET)
    print('%s: %.4g s of the processor to %.0f %%%s' %
          (who, seconds, 100 * TARGET, ', by the square of the last error' if error > TARGET else ''))
    return seconds


def main():
    options, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--density', type=float, default=8, help='texels/m'),
        lambda p: p.add_argument('--caustics', choices=('land', 'merge', 'vcm'), default='land'),
        lambda p: p.add_argument('--photons', type=int, default=2000, help='an iteration of the first bake by kiln'),
        lambda p: p.add_argument('--reference-photons', type=int, default=2000000, help='of each long bake'),
        lambda p: p.add_argument('--rungs', type=int, default=5, help='bakes by kiln at most'),
        lambda p: p.add_argument('--samples', type=int, default=256, help='of the first bake by Cycles'),
        lambda p: p.add_argument('--cycles-rungs', type=int, default=3, help='bakes by Cycles'),
        lambda p: p.add_argument('--threads', type=int, default=1, help='of both'))
    if shutil.which('blender') is None:
        harness.skip("blender is not installed (Debian's package blender)")
    baker = Baker(kiln, options)
    table = harness.Table(('baker', 8), ('', 18), ('error', 9), ('mean', 8), ('seconds', 9))
    ladders = []
    for table.who, bake in (('kiln', by_kiln), ('Cycles', by_cycles)):
        ladders.append(bake(baker, options, table))
    kilns, cycles_own = (to_target(who, ladder) for who, ladder in zip(('kiln', 'Cycles'), ladders))
    print('Cycles takes %.3g times as long as kiln by %s' % (cycles_own / kilns, options.caustics))


if __name__ == '__main__':
    main()
