"""kiln bench tracing-range: error and time of rays that end at a range, with radiance probes behind it

What does --tracing-range save in this scene, and what does it cost? Rays of indirect light end at a range, and radiance
probes stand for what lies behind it (Vandersanden 2023). The scene is baked with rays that have no end, and with ranges
of 0 and 1/16 to 1/2 of its longest side, or with those in metres that are the words behind the scene; each with probes
1/8, 1/16 and 1/32 of that side apart, and at 1/16 with each --probe-basis.

The figure, tracing-range.svg, shows the error of indirect light over the range; tracing-range.csv has all bakes. Errors
are root mean squares against rays without an end, over the mean (as in kiln bench tradeoff).

Price: 26 bakes, and the reference, which is one of them in all but name."""
import math

from study import child, figure, sweep
from study.child import Failure

BASES, USUAL = ('sh', 'octahedral', 'cubemap'), 16
LINES = (('sh, 1/8 apart', 8, 'sh'), ('sh, 1/16', 16, 'sh'), ('sh, 1/32', 32, 'sh'),
         ('octahedral, 1/16', 16, 'octahedral'), ('cubemap, 1/16', 16, 'cubemap'))
CSV = ('name,options,range,spacing,basis,nrmse,nrmse_indirect,light_seconds,indirect_seconds,seconds,processor_seconds,'
       'peak_bytes,probes,probe_bytes,rays,probe_rays,points_without_probe\n')


def read_range(text):
    """Metres; None if it is something else."""
    try:
        found = float(text) if text[:1].isdigit() else math.nan
    except ValueError:
        return None
    return found if math.isfinite(found) else None


class TracingRange(sweep.Sweep):
    name, takes = 'tracing-range', '[METRES ...]'
    refused = ('tracing-range', 'radiance-probe-spacing', 'probe-basis', 'probe-side', 'samples-probe',
               'verify-fraction')
    side = 0.0  # of the scene, its longest, m; 0: not known yet

    def add_all(self, name, **values):
        for along in (USUAL // 2, USUAL, 2 * USUAL):
            for basis in BASES if along == USUAL else BASES[:1]:
                self.add(group='range', name='%s, 1/%d, %s' % (name[:12], along, basis), along=along, basis=basis,
                         **{'factor': 0.0, 'range': 0.0, **values})

    def choose(self):
        self.add(group='range', name='inf', range=math.inf, factor=0.0, along=USUAL, basis='')
        if not self.words:
            self.add_all('0')
            for part in (16, 8, 4, 2):
                self.add_all('1/%d' % part, factor=1.0 / part)
        for word in self.words:
            if read_range(word) is None:
                raise Failure(child.USAGE, "kiln bench tracing-range takes ranges in metres, such as 0 or 0.5, not '%s'"
                              % word)
            self.add_all(word, range=read_range(word))

    def range_of(self, s):
        """m; below 0: not known yet."""
        return s.range if not s.factor else s.factor * self.side if self.side else -1.0

    def option_words(self, s):
        if math.isinf(s.range):
            return '--tracing-range inf'
        if not self.side:
            return '%s of the longest side; --probe-basis %s' % (s.name, s.basis)
        return '--tracing-range %.9g --radiance-probe-spacing %.9g --probe-basis %s' % (
            self.range_of(s), self.side / s.along, s.basis)

    def key(self, s):
        return '%s (%.17g m)' % (s.name, s.range)

    def reference_words(self):
        child.tell(self.arguments.quiet, 'baking the reference, whose rays have no end')
        return []

    def _open_reference(self):
        super()._open_reference()
        bounds = child.kiln_json('info', self.scene, *self.given.words('info'))['bounds']
        self.side = max(high - low for low, high in zip(bounds['min'], bounds['max']))

    # ---- results ----

    def csv(self):
        text = CSV
        for s, r in self.done():
            ends = math.isfinite(s.range)
            text += '"%s",%s,%.9g,%.9g,%s,%s\n' % (
                s.name, self.option_words(s), self.range_of(s), self.side / s.along if ends else 0.0, s.basis,
                '%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.0f,%.0f,%.0f,%.0f,%.0f,%.0f' % (
                    r.error(0), r.error(2), r.light_seconds, r.median(sweep.INDIRECT), r.seconds, r.processor_seconds,
                    r.peak_bytes, r.probes, r.probe_bytes, r.rays, r.probe_rays, r.points_alone))
        return text

    def figures(self):
        plot = figure.Plot('Error of indirect light by tracing range: %s' % self.scene, 'tracing range', 'nrmse',
                           (' m', ' %'), (1.0, 100.0), logarithmic=False)
        for number, (name, along, basis) in enumerate(LINES):
            plot.line([(self.range_of(s), r.error(2)) for s, r in self.done() if (s.along, s.basis) == (along, basis)],
                      name, number)
        return [('.svg', plot)]

    def lines(self):
        for s in self.settings:
            yield '%-28s%s' % (s.name, self.option_words(s))
        yield '%d bakes, and the reference before them' % len(self.settings)

    def row(self, s, r):
        return {'name': s.name, 'options': self.option_words(s), 'range': sweep.show_number(self.range_of(s)),
                'nrmse': r.error(0), 'nrmse_indirect': r.error(2), 'light_seconds': r.light_seconds,
                'processor_seconds': r.processor_seconds, 'probes': r.probes, 'probe_bytes': r.probe_bytes,
                'rays': r.rays, 'probe_rays': r.probe_rays}

    def tell(self, left):
        if self.arguments.json:
            self.show_rows(left, self.row)
            return
        print('%-24s%9s%11s%9s%10s%10s%11s%11s%13s%13s' % (
            'range, spacing, basis', 'range m', 'indirect %', 'all %', 'light s', 'processor', 'probes', 'probe MiB',
            'rays', 'probe rays'))
        for s, r in self.done():
            print('%-24s%9.4g%11.2f%9.2f%10.3f%10.3f%11.0f%11.2f%13.0f%13.0f' % (
                s.name, self.range_of(s), 100 * r.error(2), 100 * r.error(0), r.light_seconds, r.processor_seconds,
                r.probes, r.probe_bytes / 2 ** 20, r.rays, r.probe_rays))
        if left:
            print(self.left_sentence(left))
        print('errors are root mean squares against rays without an end, relative to the mean')
        print(self.files_line())


if __name__ == '__main__':
    child.main(lambda: TracingRange(__doc__).run(), 'matplotlib')
