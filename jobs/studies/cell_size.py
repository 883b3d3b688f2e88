"""kiln bench cell-size: what the side of a radiance cell costs, and that it changes no bit

Does another --cell-size make this scene's bake quicker? Surface points stand in one order: by cell along a
space-filling curve, then by object, then by tile run of a lightmap. A rank computes its range of them in that order, so
that rays that are traced one after the other begin near each other; also a single rank does so. Smaller cells keep
those rays closer together, and cut tile runs, which then have fewer points each. This is the experiment of Vandersanden
2023, section 4.3.1. The words behind the scene are sides in metres; `auto`, or no word, adds 1/8, 1/4 ... 4, 8 times
the automatic side. kiln's light hangs on none of it: every lightmap is held against that of a bake by one rank with
automatic cells, bit by bit, and another bit is an error (exit code 70).

The figure, cell-size.svg, shows the time of the passes of light over the side, for each number of --ranks;
cell-size.csv has all bakes, with cache references and misses where perf_event_open is permitted.

Price: 7 bakes 5 times (--repeats), and the reference."""
import math

from study import child, order
from study.child import Failure


def read_side(text):
    """A side in metres; None if it is something else."""
    try:
        side = float(text) if text[:1].isdigit() else math.nan
    except ValueError:
        return None
    return side if math.isfinite(side) and side > 0 else None


class CellSize(order.Order):
    name, takes = 'cell-size', '[auto|METRES ...]'
    refused = ('cell-size', 'samples-probe', 'verify-fraction')
    place_name, across, logarithmic = 'side of a cell', 'side of a radiance cell (logarithmic)', True

    def choose(self):
        for word in self.words:
            if word != 'auto' and read_side(word) is None:
                raise Failure(child.USAGE, "kiln bench cell-size takes sides of a cell in metres, such as 0.5, and "
                                           "'auto', which is 1/8 to 8 times the automatic one; not '%s'" % word)
        for power in range(-3, 4):
            if power == 0 or not self.words or 'auto' in self.words:
                self.add_for_all(order.factor_name(2.0 ** power), factor=2.0 ** power, size=0.0, objects=False)
        for word in self.words:
            if word != 'auto':
                self.add_for_all('%g m' % read_side(word), factor=0.0, size=read_side(word), objects=False)

    def option_words(self, s):
        side = s.factor * self.report['balance']['cell_size'] if s.factor and self.report else s.size
        if self.is_usual(s):
            return '--cell-size auto'
        return '--cell-size %.9g' % side if side > 0 else '--cell-size (%g times the automatic side)' % s.factor

    def place(self, s, r):
        return r.cell_size

    def tick(self, s, r):
        side = '%.3g m' % r.cell_size
        return '%s\n%s' % (order.factor_name(s.factor), side) if s.factor else '\n\n' + side


if __name__ == '__main__':
    child.main(lambda: CellSize(__doc__).run(), 'matplotlib')
