"""Bounces at a part of the resolution (--indirect-scale): what they cost, and what they lose.

  /usr/bin/python3 tests/bench/scale.py --kiln build/release/kiln [SCENE] [--density D]

Times are processor times of one thread, the least of three bakes, at production's samples: a bake of six bounces less
one of one, in which only the final gather is left. The time of finding the blocks is not in them, and the table has it
apart: it is the rise of the bake of one bounce. The error is that of
indirect light against the bake at full resolution with the same rays in the final gather and many in the bounces, so
that it is that of the resolution alone: rms over the mean, by area.
"""
import math
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402
import numpy as np  # noqa: E402

COMMON = ('--samples-probe', 0, '--no-export', '--denoise', 'none')


def bake(kiln, scene, density, scale, direct, bounce, indirect, bounces=6):
    return measure.must(kiln.bake(scene, *COMMON, *density, '--bounces', bounces, '--samples-direct', direct,
                                  '--samples-bounce', bounce, '--samples-indirect', indirect, '--indirect-scale', scale,
                                  '--threads', 1, timeout=3600))


def processor_time(kiln, scene, density, scale, bounces):
    """(s, rays of the bounces)"""
    seconds = []
    for _ in range(3):
        b = bake(kiln, scene, density, scale, 16, 16, 4, bounces)
        seconds.append(b.process.processor)
        rays = b.run['rays']['bounces']
        b.remove()
    return min(seconds), rays


def cost(kiln, scene, density, scale):
    """(s of the bounces, s of all else, their rays)"""
    (few, _), (many, rays) = [processor_time(kiln, scene, density, scale, bounces) for bounces in (1, 6)]
    return many - few, few, rays


def light(b):
    p = b.points
    order = np.lexsort((p.x, p.y, p.side, p.object))
    return p.indirect[order] @ harness.LUMINANCE, p.area[order]


def main():
    arguments, kiln = harness.start(__doc__, lambda p: p.add_argument('scene', nargs='?'),
                                    lambda p: p.add_argument('--density', help='texels a metre'))
    scene = arguments.scene or os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
    density = ('--texels-per-metre', arguments.density) if arguments.density else ()
    table = harness.Table(('scale', 6), ('bounces, s', 12), ('times less', 11), ('rays, times less', 17),
                          ('blocks, s', 10), ('rms error', 10), ('of all light', 13))
    for scale in (1, 2, 4, 8):
        seconds, other, rays = cost(kiln, scene, density, scale)
        b = bake(kiln, scene, density, scale, 16, 128, 64)
        value, area = light(b)
        b.remove()
        if scale == 1:
            whole = (seconds, other, rays, value)
        mean = whole[3] @ area / area.sum()
        table.row(scale, '%.3f' % seconds, '%.1f' % (whole[0] / seconds), '%.1f' % (whole[2] / rays),
                  '%.2f' % (other - whole[1]), '%.2f %%' %
                  (100 * math.sqrt((value - whole[3])**2 @ area / area.sum()) / mean), '%+.2f %%' %
                  (100 * ((value @ area) / (whole[3] @ area) - 1)))


if __name__ == '__main__':
    main()
