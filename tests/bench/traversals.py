"""Bidirectional views by both traversals of a GPU: the same picture, and times.

  /usr/bin/python3 tests/bench/traversals.py --kiln build/release/kiln [--size W H] [--samples N] [SCENE ...]

Of cornell-spheres, the mirrors, and of files that are given, each method (bdpt, vcm; path, whose kernels are others)
draws by KILN_TRAVERSAL=compute and =pipeline. Rows have milliseconds of a path for each pixel by both, from pictures of
N + 1 samples and of one; how far apart the two pictures are, rms and mean over the mean; and how far apart two seeds
are by compute, which noise makes of it. Both traversals follow the same paths by the same random numbers, so that
pictures differ where rounding decides whether an edge is met: much less than by seeds. It ends with 1 where their
means differ by more than 5 standard errors, estimated from the two seeds pixel by pixel, or by half of what seeds
make, rms. A device that has no ray-tracing pipeline says so.
"""
import os
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import exr  # noqa: E402
import harness  # noqa: E402

METHODS = ('bdpt', 'vcm', 'path')
GENERATED = ('cornell-spheres', 'mirrors')


def draw(kiln, scene, options, method, traversal, samples, seed):
    """(picture, seconds); ends with the program's sentence where it draws none."""
    path = os.path.join(kiln.scratch, 'view.exr')
    kiln.environment['KILN_TRAVERSAL'] = traversal
    run = kiln.command('view', scene, '--method', method, '--backend', 'vulkan', '--materials', 'auto', '--width',
                       options.size[0], '--height', options.size[1], '--samples-pixel', samples, '--seed', seed, '-o',
                       path, '--json', '--quiet', timeout=3600)
    if run.status != 0:
        sys.exit('%s, %s by %s: %s' % (os.path.basename(scene), method, traversal, run.sentence()))
    return exr.rgb(path), run.json()['seconds']


def compare(kiln, table, name, scene, method, options):
    """One row; whether both traversals have one picture."""
    pictures, per_path = {}, {}
    for traversal in ('compute', 'pipeline'):
        draw(kiln, scene, options, method, traversal, 1, 0)  # kernels are made
        first = draw(kiln, scene, options, method, traversal, 1, 0)[1]
        pictures[traversal], last = draw(kiln, scene, options, method, traversal, options.samples + 1, 0)
        per_path[traversal] = (last - first) / options.samples
    other = draw(kiln, scene, options, method, 'compute', options.samples + 1, 1)[0]
    one, mean = pictures['compute'], pictures['compute'].mean()
    apart, noise = pictures['pipeline'] - one, other - one
    rms, by_seeds = (float(np.sqrt((d**2).mean()) / mean) for d in (apart, noise))
    error = float(noise.mean(axis=2).std() / np.sqrt(2 * noise.shape[0] * noise.shape[1]) / mean)
    off = float(apart.mean() / mean)
    table.row(name, method, *('%.2f' % (1e3 * per_path[t]) for t in ('compute', 'pipeline')), '%.1e' % rms,
              '%+.1e' % off, '%.1e' % by_seeds, '%.1e' % error)
    return abs(off) <= 5 * error and rms <= by_seeds / 2


def main():
    options, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--size', type=int, nargs=2, default=(640, 360)),
        lambda p: p.add_argument('--samples', type=int, default=16),
        lambda p: p.add_argument('scenes', nargs='*', default=[]))
    table = harness.Table(('scene', 20), ('method', 6), ('ms compute', 10), ('pipeline', 9), ('apart', 8), ('mean', 9),
                          ('by seeds', 8), ('error', 8))
    same = True
    for name in (*GENERATED, *options.scenes):
        scene = measure.made(kiln, name) if name in GENERATED else name
        for method in METHODS:
            same = compare(kiln, table, os.path.basename(name), scene, method, options) and same
    sys.exit(0 if same else 1)


if __name__ == '__main__':
    main()
