"""Cornell box, 4 bounces: kiln and Blender's Cycles bake the same texels on the same cores in turn; time of each to 1 %
error.

  /usr/bin/python3 tests/bench/cycles.py --kiln build/release/kiln [--full]

The error is nrmse, the root mean square difference over the mean, over texels wholly inside charts and not under what
stands on them, of each baker against its own converged result. kiln's bakes are raw and denoised, each with the least
samples of a ladder that reach 1 %. Cycles bakes irradiance over pi into a float EXR (DIFFUSE without colour), its noise
falls with the square root of the samples: without --full it is measured at fewer samples than it needs and the time
scaled; with --full it runs all of them. Cycles' time is its bake operator alone; kiln's is the whole process with
import and output, and its passes alone beside it. Needs Debian's package blender.
"""
import json
import math
import os
import shutil
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import cornell_atlas  # noqa: E402
import measure  # noqa: E402
import harness  # noqa: E402

TARGET = 0.01
LADDER = ((16, 4, 16), (16, 4, 32), (64, 4, 32), (64, 4, 64), (64, 8, 128), (64, 8, 256), (128, 8, 512),
          (256, 16, 1024), (512, 32, 2048))  # direct, bounce, indirect
HOW = {'none': 'raw', 'regression': 'denoised'}
CONVERGED = (2048, 64, 8192)


def cycles(scene, folder, side, threads, runs):
    """Bakes [(samples, seed), ...]; a list of (record, pixels in W/m2)."""
    here = os.path.dirname(os.path.abspath(__file__))
    p = harness.run(['blender', '--background', '-noaudio', '--factory-startup', '--python',
                     os.path.join(here, 'cycles_bake.py'), '--', scene,
                     folder, str(side), '4', str(threads)] + ['%d:%d' % r for r in runs], timeout=7200)
    records = [json.loads(l[5:]) for l in p.stdout.splitlines() if l.startswith('BAKE ')]
    if len(records) != len(runs):
        sys.exit('blender made %d of %d bakes:\n%s' % (len(records), len(runs), (p.stdout + p.stderr)[-2000:]))
    result = []
    for record in records:
        channels, _ = harness.read_exr(record['file'])
        result.append((record, math.pi * np.stack([channels[c] for c in 'RGB'], -1).astype(float)))
    return result


def kiln_pixels(bake, masks):
    return np.concatenate([bake.lightmap(name).irradiance[m] for name, m in masks.items()])


def kiln_bake(kiln, scene, side, threads, samples, seed, denoise='none'):
    direct, bounce, indirect = samples
    return measure.must(kiln.bake(scene, '--bounces', 4, '--lightmap-size', side, '--threads', threads,
                                  '--samples-direct', direct,
                                  '--samples-bounce', bounce, '--samples-indirect', indirect, '--samples-probe', 0,
                                  '--seed', seed, '--denoise', denoise,
                                  timeout=3600))


def kiln_to_target(kiln, scene, side, threads, seed, denoise, masks, reference, table):
    """Seconds of the whole process, and of its passes, with the least samples of the ladder that reach the target."""
    for k in LADDER:
        bake = kiln_bake(kiln, scene, side, threads, k, seed, denoise)
        error, passes = measure.nrmse(kiln_pixels(bake, masks), reference), measure.tracing_seconds(bake)
        table.row('kiln ' + HOW[denoise], '%d/%d/%d' % k, '%.3f %%' % (100 * error), '%.2f' % bake.process.seconds,
                  '%.2f' % passes, '')
        seconds = bake.process.seconds
        bake.remove()
        if error <= TARGET:
            return seconds, passes
    sys.exit('kiln did not reach 1 %')


def main():
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--full', action='store_true',
                                          help='run Cycles to 1 %%, not a part of the way'),
        lambda p: p.add_argument('--side', type=int, default=256, help='of the atlas, texels (a multiple of 128)'),
        lambda p: p.add_argument('--lamp-cuts', type=int, default=8,
                                 help='the lamp is N x N quads; large lamps bias Cycles'),
        lambda p: p.add_argument('--cycles-samples', type=int, default=1024),
        lambda p: p.add_argument('--repeats', type=int, default=3))
    if shutil.which('blender') is None:
        harness.skip("blender is not installed (Debian's package blender)")
    threads, side = len(os.sched_getaffinity(0)), arguments.side
    scene = os.path.join(kiln.scratch, 'cornell_atlas.glb')
    masks = cornell_atlas.mask(cornell_atlas.write(scene, arguments.lamp_cuts), side)
    converged = kiln_bake(kiln, scene, side, threads, CONVERGED, 99)
    points = converged.points
    for name, m in masks.items():
        open_texels = np.zeros_like(m)
        own = points.of(converged.index(name))
        open_texels[points.y[own], points.x[own]] = True
        m &= open_texels
    reference = kiln_pixels(converged, masks)
    print('%d texels count, %d threads' % (sum(int(m.sum()) for m in masks.values()), threads))
    samples = 3550 if arguments.full else arguments.cycles_samples
    own = cycles(scene, kiln.scratch, side, threads, [(2 * samples, 100), (2 * samples, 101)])
    inside = np.any(list(masks.values()), axis=0)
    halves = [pixels[inside] for _, pixels in own]
    cycles_reference = (halves[0] + halves[1]) / 2
    noise = measure.nrmse(halves[0], halves[1]) / 2  # of the mean of two

    table = harness.Table(('baker', 13), ('samples', 16), ('nrmse', 10), ('process s', 10), ('bake s', 8),
                          ('bake s at 1 %', 14))
    kiln_seconds, cycles_seconds = {how: [] for how in HOW}, []
    for repeat in range(arguments.repeats):
        for how in HOW:
            kiln_seconds[how].append(kiln_to_target(kiln, scene, side, threads, repeat, how, masks, reference, table))
        (record, pixels), = cycles(scene, kiln.scratch, side, threads, [(samples, repeat + 1)])
        raw = measure.nrmse(pixels[inside], cycles_reference)
        error = math.sqrt(max(raw ** 2 - noise ** 2, 0.0))
        cycles_seconds.append(record['seconds'] * (error / TARGET) ** 2)
        table.row('cycles', samples, '%.3f %%' % (100 * error), '', '%.1f' % record['seconds'],
                  '%.1f' % cycles_seconds[-1])
    print("means: kiln %.5f, Cycles %.5f W/m2 (ratio %.4f)" %
          (reference.mean(), cycles_reference.mean(), reference.mean() / cycles_reference.mean()))
    took = float(np.median(cycles_seconds))
    for how, seconds in kiln_seconds.items():
        whole, passes = np.median(seconds, axis=0)
        print('to 1 %%: Cycles %.1f s, kiln %s %.2f s (passes alone %.2f s): %.0f times faster (passes alone %.0f)' % (
            took, HOW[how], whole, passes, took / whole, took / passes))


if __name__ == '__main__':
    main()
