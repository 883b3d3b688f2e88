"""kiln bench per-object: what work in order of objects costs against that in order of cells

Does it cost time to gather for each object in place of each cell? With --partition objects surface points stand by
object, then by tile of its lightmap: neighbours in a lightmap follow each other, also where they are far from each
other in space. This is the experiment of Vandersanden 2023, section 4.3.4. Both orders must have the bits of a bake by
one rank in order of cells; another bit is an error (exit code 70).

The figure, per-object.svg, shows the time of the passes of light of both orders, for each number of --ranks;
per-object.csv has all bakes, with cache references and misses where perf_event_open is permitted.

Price: 2 bakes 5 times (--repeats) for each number of ranks, and the reference."""
from study import child, order
from study.child import Failure


class PerObject(order.Order):
    name = 'per-object'
    refused = ('partition', 'samples-probe', 'verify-fraction')
    place_name, across, logarithmic = 'order of work', 'order of work: per cell, or per object', False

    def choose(self):
        if self.words:
            raise Failure(child.USAGE, "kiln bench per-object takes a scene and nothing else, not '%s'" % self.words[0])
        for name in ('cells', 'objects'):
            self.add_for_all(name, factor=1.0, size=0.0, objects=name == 'objects')

    def option_words(self, s):
        return '--partition ' + ('objects' if s.objects else 'cells')

    def place(self, s, r):
        return 1.0 if s.objects else 0.0

    def tick(self, s, r):
        return 'objects' if s.objects else 'cells'


if __name__ == '__main__':
    child.main(lambda: PerObject(__doc__).run(), 'matplotlib')
