"""Finding the surface points on one rank and on several: how many times faster, of as many times as there are ranks.

  /usr/bin/python3 tests/bench/surface.py --kiln build/release/kiln [RANKS ...]

The phase "surface points" of bakes of a city with 200,000 triangles and 1.8 million points, one thread a rank, the
slowest rank's; the least of three turns. More ranks than cores show nothing.
"""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

CHEAP = ('--samples-direct', 1, '--samples-bounce', 1, '--samples-indirect', 1, '--bounces', 1, '--samples-probe', 0,
         '--no-preview')
TURNS = 3


def main():
    arguments, kiln = harness.start(__doc__,
                                    lambda parser: parser.add_argument('ranks', nargs='*', type=int, default=[1, 2]))
    scene = measure.made(kiln, 'city', '--triangles', 200000)
    table = harness.Table(('ranks', 6), ('points', 10), ('seconds', 8), ('faster', 7), ('of ideal', 8))
    counts = sorted({1, *arguments.ranks})
    least = {}
    for _ in range(TURNS):
        for ranks in counts:
            bake = measure.must(kiln.bake(scene, *CHEAP, '--texels-per-metre', 4, '--threads', 1, ranks=ranks,
                                          timeout=3600))
            points = bake.run['points']['count']
            seconds = next(p['seconds']['max'] for p in bake.run['phases'] if p['name'] == 'surface points')
            least[ranks] = min(seconds, least.get(ranks, seconds))
            bake.remove()
    for ranks in counts:
        ratio = least[1] / least[ranks]
        table.row(ranks, points, '%.2f' % least[ranks], '%.2f' % ratio, '%.2f' % (ratio / ranks))


if __name__ == '__main__':
    main()
