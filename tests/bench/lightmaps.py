"""Writing one large lightmap on one rank and on several: seconds of the phases that write, one thread a rank.

  /usr/bin/python3 tests/bench/lightmaps.py --kiln build/release/kiln [--side 2048] [RANKS ...]

A box from inside, one object of six charts with noisy light; the least of three turns. More ranks than cores show
nothing.
"""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

CHEAP = ('--samples-direct', 2, '--samples-bounce', 1, '--samples-indirect', 1, '--bounces', 1, '--samples-probe', 0,
         '--no-preview')
PHASES = ('lightmaps', 'kiln.h5')
TURNS = 3


def main():
    def more(parser):
        parser.add_argument('--side', type=int, default=2048)
        parser.add_argument('ranks', nargs='*', type=int, default=[1, 2, 4])
    arguments, kiln = harness.start(__doc__, more)
    scene = measure.made(kiln, 'furnace')
    columns = [column for name in PHASES for column in ((name + ', s', 12), ('ns a texel', 10), ('faster', 7))]
    table = harness.Table(('ranks', 6), *columns)
    counts, least = sorted({1, *arguments.ranks}), {}
    for _ in range(TURNS):
        for ranks in counts:
            bake = measure.must(kiln.bake(scene, *CHEAP, '--lightmap-size', arguments.side, '--threads', 1, ranks=ranks,
                                          timeout=3600))
            for phase in bake.run['phases']:
                if phase['name'] in PHASES:
                    key = ranks, phase['name']
                    least[key] = min(phase['seconds']['max'], least.get(key, float('inf')))
            bake.remove()
    for ranks in counts:
        row = []
        for name in PHASES:
            seconds = least[ranks, name]
            row += ['%.2f' % seconds, '%.0f' % (1e9 * seconds / arguments.side ** 2),
                    '%.2f' % (least[1, name] / seconds)]
        table.row(ranks, *row)


if __name__ == '__main__':
    main()
