"""The common part of cell-size and per-object: bakes that differ only in the order of their work, so that every bit
must be the same, and what they take."""
import math

from . import child, counters, figure, options, sweep
from .child import Failure

RUNS_TO_TELL = 4
CSV = ('name,options,ranks,cell_size,cells,points,rays,nrmse,values_that_differ,runs,light_seconds,light_seconds_least,'
       'light_seconds_most,indirect_seconds,exchange_seconds,seconds,processor_seconds,peak_bytes,received_bytes,'
       'point_imbalance')


def factor_name(factor):
    """auto / 8, auto, auto x 2."""
    return 'auto' if factor == 1 else 'auto x %g' % factor if factor > 1 else 'auto / %g' % (1 / factor)


def counted(value):
    return '%.9g' % value if math.isfinite(value) else ''


class Order(sweep.Sweep):
    exact = True

    def add_parameters(self, parser):
        parser.add_argument('--ranks', metavar='N,N,...', help='numbers of ranks to bake with, by mpirun; without it '
                            'each bake is one process')

    def is_usual(self, s):
        """The bake that others are compared with: automatic cells, in order of cells."""
        return not s.objects and s.factor == 1

    def add_for_all(self, name, **values):
        """The setting for each number of ranks."""
        ranks = options.ascending(self.arguments.ranks) if self.arguments.ranks is not None else [0]
        for number in ranks:
            self.add(name=name if number == 0 else '%s, %d rank%s' % (name, number, 's' * (number > 1)), ranks=number,
                     **values)

    def key(self, s):
        return '%s (%.17g m)' % (s.name, s.size)

    def reference_words(self):
        child.tell(self.arguments.quiet, 'baking the reference, which all bakes must equal')
        return []

    # ---- files ----

    def csv(self):
        text = CSV + ''.join(',' + name for name in counters.CACHES) + '\n'
        for s, r in self.done():
            text += '"%s",%s,%d,%.9g,%.0f,%.0f,%.0f,%.6g,%.0f,%d,%.6g,%.6g,%.6g' % (
                s.name, self.option_words(s), s.ranks or 1, r.cell_size, r.cells, r.points, r.rays, r.error(),
                r.differing, len(r.runs), *r.spread(sweep.LIGHT))
            text += ',%s,%s,%.6g,%.6g,%.0f,%.0f,%.6g' % (
                counted(r.median(sweep.INDIRECT)), counted(r.median(sweep.EXCHANGE)), r.seconds, r.processor_seconds,
                r.peak_bytes, r.received, r.imbalance)
            text += ''.join(',' + counted(r.median(sweep.FIRST_COUNTER + c)) for c in range(4)) + '\n'
        return text

    def figures(self):
        plot = figure.Plot('Time of light by %s: %s' % (self.place_name, self.scene), self.across, 'passes of light, s',
                           ('', ' s'), logarithmic=False)
        if self.logarithmic:
            plot.axes.set_xscale('log')
        bakes, ticks = self.done(), {}
        for number, ranks in enumerate(sorted({s.ranks for s, _ in bakes})):
            line = sorted(((self.place(s, r), r) for s, r in bakes if s.ranks == ranks), key=lambda one: one[0])
            many = ', %d rank%s' % (ranks, 's' * (ranks > 1)) if ranks else ''
            plot.line([(x, r.light_seconds) for x, r in line], 'all light' + many, number)
            plot.line([(x, r.median(sweep.INDIRECT)) for x, r in line], 'indirect' + many, number, dashed=True)
            for x, r in line:
                plot.range(x, *r.spread(sweep.LIGHT)[1:], number)
        for s, r in bakes:
            ticks[self.place(s, r)] = self.tick(s, r)
        plot.axes.set_xticks(list(ticks), list(ticks.values()))
        plot.axes.minorticks_off()
        plot.axes.set_ylim(bottom=0)
        plot.note('medians of the runs; bars from the least to the most, of all light')
        return [('.svg', plot)]

    # ---- what is told ----

    def lines(self):
        for s in self.settings:
            yield '%-24s%s' % (s.name, self.option_words(s))
        yield '%d bakes, %d times each, and the reference before them' % (len(self.settings), self.repeats)

    def bits(self):
        bakes = self.done()
        differing = [(s, r) for s, r in bakes if r.differing > 0]
        if bakes and not differing:
            yield ("in all %d bakes every bit of the lightmaps is the reference's: the error against the unbiased bake "
                   "is 0" % len(bakes))
        for s, r in differing:
            yield "'%s' differs from the reference in %.0f values of its lightmaps: nrmse %.3g %%" % (
                s.name, r.differing, 100 * r.error())

    @staticmethod
    def certainty(a, b):
        """Whether the runs of two bakes tell their times apart: two sets of RUNS_TO_TELL runs each of the same bake lie
        wholly beside each other in 3 of 100 cases."""
        if min(len(a.runs), len(b.runs)) < RUNS_TO_TELL:
            return 'these are too few runs to tell them apart'
        (_, a_least, a_most), (_, b_least, b_most) = a.spread(sweep.LIGHT), b.spread(sweep.LIGHT)
        return ('their runs overlap, so these repeats cannot tell them apart' if a_least <= b_most and b_least <= a_most
                else 'their runs do not overlap')

    def times(self):
        """For each number of ranks, the bakes of least and of most time against the usual one."""
        for usual, u in self.done():
            if not self.is_usual(usual) or not u.light_seconds > 0:
                continue
            peers = [one for one in self.done() if one[0].ranks == usual.ranks]
            for which, choose in (('least', min), ('most', max)):
                s, r = choose(peers, key=lambda one: one[1].light_seconds)
                more = 100 * (r.light_seconds / u.light_seconds - 1)
                if s is not usual and more != 0:
                    yield "light takes %s time with '%s' (%s): %.3g s, %.1f %% %s than with '%s'; %s" % (
                        which, s.name, self.option_words(s), r.light_seconds, abs(more), 'less' if more < 0 else 'more',
                        usual.name, self.certainty(r, u))

    def missed(self):
        """Why there are no counts of cache misses."""
        if all(math.isfinite(r.median(sweep.FIRST_COUNTER + c)) for _, r in self.done() for c in range(4)):
            return
        found = counters.Counters()
        found.close()
        yield counters.remedy(found.why) if found.why else (
            'cache misses were not counted in all runs, some of which were made where they could not be; --no-resume '
            'begins anew')

    def sentences(self, left):
        said = [self.left_sentence(left, 'runs')] if left else []
        said += [*self.bits(), *self.times()]
        if any(s.ranks > 1 for s, _ in self.done()) and not any(r.received for _, r in self.done()):
            said.append('no radiosity was sent: these ranks are on one node, and share its memory')
        return [*said, *self.missed()]

    def row(self, s, r):
        light, least, most = r.spread(sweep.LIGHT)
        row = {'name': s.name, 'options': self.option_words(s), 'ranks': s.ranks or 1, 'cell_size': r.cell_size,
               'cells': r.cells, 'nrmse': r.error(), 'values_that_differ': r.differing, 'runs': len(r.runs),
               'light_seconds': light, 'light_seconds_least': least, 'light_seconds_most': most,
               'indirect_seconds': r.median(sweep.INDIRECT), 'exchange_seconds': r.median(sweep.EXCHANGE),
               'seconds': r.seconds, 'processor_seconds': r.processor_seconds, 'peak_bytes': r.peak_bytes,
               'received_bytes': r.received, 'point_imbalance': r.imbalance}
        return {**row, **{name: sweep.show_number(r.median(sweep.FIRST_COUNTER + c))
                          for c, name in enumerate(counters.CACHES)}}

    def show_table(self):
        print('%-22s%10s%9s%9s%19s%11s%11s%9s%9s%11s%9s%9s' % (
            'bake', 'side m', 'cells', 'light s', 'least to most', 'indirect s', 'processor', 'MiB', 'sent MiB',
            'imbalance%', 'miss %', 'L1 miss %'))
        for s, r in self.done():
            rates = []
            for c in (0, 2):
                used, missed = (r.median(sweep.FIRST_COUNTER + c + k) for k in (0, 1))
                rates.append('%9.2f' % (100 * missed / used) if used > 0 and math.isfinite(missed) else '%9s' % '-')
            print('%-22s%10.4g%9.0f%9.3f%10.3f%9.3f%11.3f%11.3f%9.1f%9.1f%11.1f%s' % (
                s.name, r.cell_size, r.cells, *r.spread(sweep.LIGHT), r.median(sweep.INDIRECT), r.processor_seconds,
                r.peak_bytes / 2 ** 20, r.received / 2 ** 20, 100 * r.imbalance, ''.join(rates)))

    def tell(self, left):
        said = self.sentences(left)
        if self.arguments.json:
            self.show_rows(left, self.row, sentences=said)
        else:
            self.show_table()
            print('\n'.join([*said, self.files_line()]), flush=True)
        differing = sum(r.differing > 0 for _, r in self.done())
        if differing:
            failure = Failure(child.BUG, '%d of %d bakes differ from the reference, which must have the same bits' % (
                differing, len(self.done())))
            failure.answered = True
            raise failure
