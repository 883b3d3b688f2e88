"""--patches links against windows of texels: error and processor time, and what either takes as texels grow.

  /usr/bin/python3 tests/bench/links.py --kiln build/release/kiln --side 128,256 --link-error 0.015,0.05,0.1

The Cornell box with as many points as `side` squared. The error is that of indirect light, root of the mean square over
the mean, against two bakes by many rays, which differ by their seed: the mean of (x - a) (x - b) has no noise of
theirs. Seconds are of the processor, of one thread, of all that follows direct light: the whole bake, less one with no
bounce; rays are those of bounces, a point. --window 0 leaves the windows out, which take long.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

CORNELL = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
AT_ONE = 211.0  # points at one texel a metre
PLAIN = ('--samples-probe', 0, '--no-export', '--denoise', 'none', '--bounces', 2, '--threads', 1,
         '--samples-direct', 64)


def values(bake):
    p = bake.points
    order = np.lexsort((p.x, p.y, p.object))
    return p.indirect[order] @ harness.LUMINANCE, p.area[order] * p.valid[order]


class Side:
    def __init__(self, kiln, scene, side, rays):
        self.kiln, self.scene = kiln, scene
        self.density = side / math.sqrt(AT_ONE)
        self.dark = self.bake('--method', 'radiosity', '--bounces', 0)
        self.truth = [] if rays == 0 else [
            values(self.bake('--samples-bounce', rays // 4, '--samples-indirect', rays, '--seed', seed))[0]
            for seed in (1, 2)]

    def bake(self, *more):
        return measure.must(self.kiln.bake(self.scene, *PLAIN, '--texels-per-metre', self.density, *more, timeout=7200))

    def row(self, table, name, *more):
        bake = self.bake('--method', 'radiosity', *more)
        got, area = values(bake)
        error = mean = math.nan
        if self.truth:
            a, b = self.truth
            level = area @ (a + b) / 2 / area.sum()
            error = math.sqrt(max(0.0, area @ ((got - a) * (got - b)) / area.sum())) / level
            mean = area @ (got - (a + b) / 2) / area.sum() / level
        seconds = bake.process.processor - self.dark.process.processor
        links = bake.run.get('links', {'count': 0, 'bytes': 0})
        n = len(got)
        table.row(name, n, '%.2f %%' % (100 * error), '%+.2f %%' % (100 * mean), '%.1f' % seconds,
                  '%.1f' % (1e6 * seconds / n), '%.1f' % (bake.run['rays']['bounces'] / n),
                  '%.0f' % (links['count'] / n), '%.0f' % (links['bytes'] / n))
        bake.remove()


def main():
    numbers = lambda kind: lambda text: [kind(word) for word in text.split(',')]
    add = lambda p: (p.add_argument('--side', type=numbers(int), default=[128, 256]),
                     p.add_argument('--link-error', type=numbers(float), default=[0.015, 0.05, 0.2, 0.7]),
                     p.add_argument('--window', type=int, default=16), p.add_argument('--rays', type=int, default=256),
                     p.add_argument('--scene', default=CORNELL), p.add_argument('--samples', type=int, default=64))
    arguments, kiln = harness.start(__doc__, add)
    table = harness.Table(('way', 14), ('points', 8), ('error', 8), ('mean', 8), ('s', 8), ('us a point', 10),
                          ('rays', 6), ('links', 6), ('bytes', 6))
    for side in arguments.side:
        of = Side(kiln, arguments.scene, side, arguments.rays)
        rays = ('--samples-indirect', arguments.samples)
        if arguments.window > 0:
            of.row(table, 'window %d' % arguments.window, '--undersample', 'mipmap:%d' % arguments.window, *rays)
        for error in arguments.link_error:
            of.row(table, 'links %g' % error, '--patches', 'links:%g' % error, *rays)


if __name__ == '__main__':
    main()
