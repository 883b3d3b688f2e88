"""kiln bench converge: how fast the error of a view falls with time, for all ways to compute its light

Which --method of kiln view is best for this view, and for how long must it run? The view is drawn by every method but
lightmaps, or by those that are the words behind the scene, each in a process of its own, with 1, 2, 4, ... paths a
pixel. Its time is that of computing the picture, by the clock, without import and BVH. Errors are those of kiln compare
against a reference: a given view, or one by path tracing with many paths. That one is the mean of two halves with seeds
of their own, which differ by twice the error of their mean, so that the reference's own error is known: a method cannot
be seen to come closer than that. Path tracing finds no light that lamps without extent send by way of mirrors and
glass. Methods that find it look wrong against such a reference; give one of theirs then.

The figure, converge.svg, shows error over time; converge.csv has all views, and the last view of each method stays.
Methods are held against each other by the PSNR of 8-bit pictures: at equal time, the longest that all have reached; by
what doubling the time gains at the end; by the time to 45 dB (Sun 2020 and Rodrigues 2021 plot these). Between two
views PSNR is linear in the logarithm of the time.

Price: at most 11 views of each method (--doublings), each of at most 10 s (--max-time), and a reference of 64 times the
paths of the last."""
import math
import os
import sys

import numpy as np

from study import child, exr, figure, folder, options, sweep
from study.child import Failure

LEVEL, LAST = 45.0, 4  # dB: pictures that differ less look alike; views that the gain is taken over
REFERENCE_FACTOR, MOST_REFERENCE = 64, 1 << 20  # its error adds 1/64 to the mean square of a path-traced view, 0.07 dB
OWN = ('seed', 'width', 'height')


class View:
    """A view of so many paths a pixel, and how far it is from the reference."""

    def __init__(self, samples, seconds, rays):
        self.samples, self.seconds, self.rays = samples, max(1e-9, seconds), int(rays)

    def measure(self, found):
        self.rmse, self.rel_rmse = found['rmse'], found['rel_rmse']
        self.nrmse = math.nan if found['nrmse'] is None else found['nrmse']
        self.psnr = math.inf if found['picture_psnr'] is None else found['picture_psnr']
        self.dissimilarity = found['picture_dissimilarity']

    def picture_error(self):
        """Root mean square of the 8-bit pictures' difference, relative to white."""
        return 10 ** (-self.psnr / 20)


class Method:
    """A method, and its views in the order of their samples."""

    def __init__(self, name):
        self.name, self.views, self.refusal, self.refusal_code = name, [], '', 0

    def psnr_at(self, seconds):
        """NaN if every view took longer."""
        count = len(self.views)
        while count > 0 and self.views[count - 1].seconds > seconds:
            count -= 1
        if count == 0:
            return math.nan
        a = self.views[count - 1]
        b = self.views[count] if count < len(self.views) else None
        if b is None or not math.isfinite(a.psnr) or not math.isfinite(b.psnr) or a.seconds == b.seconds:
            return a.psnr
        return a.psnr + (b.psnr - a.psnr) * math.log(seconds / a.seconds) / math.log(b.seconds / a.seconds)

    def gain(self):
        """Slope of PSNR over the binary logarithm of the time, by least squares, of the last views."""
        last = self.views[-LAST:]
        if not all(math.isfinite(view.psnr) for view in last):
            return math.nan
        x = np.log2([view.seconds for view in last])
        spread = float(((x - x.mean()) ** 2).sum())
        psnr = np.array([view.psnr for view in last])
        return float(((x - x.mean()) * (psnr - psnr.mean())).sum()) / spread if spread > 0 else math.nan

    def seconds_to_level(self):
        """(seconds, whether the first view has reached it already); NaN: none has."""
        index = next((i for i, view in enumerate(self.views) if view.psnr >= LEVEL), None)
        if index is None:
            return math.nan, False
        b, a = self.views[index], self.views[max(index - 1, 0)]
        if index == 0 or not math.isfinite(b.psnr):
            return b.seconds, index == 0
        part = (LEVEL - a.psnr) / (b.psnr - a.psnr) if b.psnr != a.psnr else 1.0
        return a.seconds * (b.seconds / a.seconds) ** part, False


class Converge:
    def __init__(self):
        made = options.parser('converge', __doc__, 'SCENE [METHOD ...]')
        options.lists(made)
        made.add_argument('--reference', metavar='FILE.exr', help='a view that errors are measured against')
        made.add_argument('--reference-samples', metavar='N', type=options.number(1, MOST_REFERENCE, whole=True),
                          help='paths a pixel of the reference (default 64 times the most)')
        made.add_argument('--max-time', metavar='SECONDS', type=options.number(1e-3, 1e9), default=10.0,
                          help='draw no view that would take longer (default 10)')
        made.add_argument('--doublings', metavar='N', type=options.number(1, 14, whole=True), default=10,
                          help='double the paths a pixel so often, from 1 on (default 10)')
        self.arguments, self.given = options.parse(made, sys.argv[1:], ['view'])
        if not self.arguments.words:
            raise Failure(child.USAGE, 'kiln bench converge takes a scene, and methods of kiln view; for example: kiln '
                                       'bench converge room.glb path')
        self.scene, asked = self.arguments.words[0], self.arguments.words[1:]
        self.size = [self.given.value(name, ['view']) if self.given.has(name) else None for name in OWN[1:]]
        self.seed = int(self.given.value('seed', ['view']))
        known = self.given.table.find('method', ['view'])['choices'][1:]  # lightmaps, the first, computes no light
        for name in asked:
            if name not in known:
                raise Failure(child.USAGE, "kiln view computes light by no method '%s'; there is: %s" % (
                    name, ', '.join(known)))
        self.methods = [Method(name) for name in known if not asked or name in asked]
        self.check()
        self.out = self.arguments.output or options.default_output(self.scene, '-converge')
        self.reference, self.reference_samples, self.reference_psnr = self.arguments.reference, None, math.nan

    def check(self):
        camera, samples = self.given.value('camera', ['view']), self.arguments.reference_samples
        if ',' in camera or camera == 'all':
            raise Failure(child.USAGE, '--camera %s: the bench draws one view; name one camera' % camera)
        if samples is not None and self.arguments.reference is not None:
            raise Failure(child.USAGE, '--reference-samples %d: the reference is given by --reference; leave one of '
                                       'the two out' % samples)
        if samples is not None and samples <= 1 << self.arguments.doublings:
            raise Failure(child.USAGE, '--reference-samples %d: the reference needs more than the %d paths a pixel of '
                          'the views that it judges (--doublings %d)' % (samples, 1 << self.arguments.doublings,
                                                                         self.arguments.doublings))

    # ---- views ----

    def path(self, name):
        return os.path.join(self.out, name)

    def view_path(self, method, view):
        return self.path('%s-%d.exr' % (method.name, view if isinstance(view, int) else view.samples))

    def draw(self, method, samples, seed, path):
        child.tell(self.arguments.quiet, '%s, %d paths a pixel' % (method, samples))
        size = [word for name, value in zip(OWN[1:], self.size) if value for word in ('--' + name, value)]
        return child.kiln('view', self.scene, '-o', path, '--json', '--method', method, '--samples-pixel', samples,
                          '--seed', seed, *size, *self.given.words('view', OWN))

    def draw_next(self, method):
        """The next view of a method, unless it refuses."""
        samples = 1 << len(method.views)
        path = self.view_path(method, samples)
        if self.reference and os.path.exists(path) and os.path.samefile(path, self.reference):
            raise Failure(child.USAGE, '--output %s: it would replace %s, which is read; give another --output' % (
                path, self.reference))
        done = self.draw(method.name, samples, self.seed, path)
        if not method.views and done.code in (child.USAGE, child.BAD_INPUT, 69):
            method.refusal, method.refusal_code = done.sentence().split('\n')[0][:399], done.code
            return
        found = done.must(method.name).json()
        method.views.append(View(samples, found['seconds'], found['rays']))

    def draw_all(self):
        """The next view takes about twice the last one's time."""
        for method in self.methods:
            while not method.refusal and len(method.views) <= self.arguments.doublings and (
                    not method.views or 2 * method.views[-1].seconds <= self.arguments.max_time):
                self.draw_next(method)
        if not any(method.views for method in self.methods):
            first = self.methods[0]
            raise Failure(first.refusal_code, 'no method draws this view; %s: %s' % (first.name, first.refusal))

    # ---- the reference ----

    def read_reference(self):
        """Views get the size of the reference that is given."""
        try:
            channels, _ = exr.read(self.reference)
            height, width = channels['R'].shape
        except (OSError, AssertionError, KeyError, ValueError) as error:
            raise Failure(child.BAD_INPUT if os.path.exists(self.reference) else child.NO_INPUT,
                          '--reference %s: it is no view with layers R, G and B: %s' % (self.reference, error))
        if any(own is not None and int(own) != there for own, there in zip(self.size, (width, height))):
            raise Failure(child.BAD_INPUT, '--reference %s: it has %d x %d pixels; leave --width and --height out' % (
                self.reference, width, height))
        self.size = [width, height]

    def make_reference(self):
        """The mean of two halves, which differ by twice its error."""
        most = max(view.samples for method in self.methods for view in method.views)
        self.reference_samples = self.arguments.reference_samples or min(REFERENCE_FACTOR * most, MOST_REFERENCE)
        self.reference = self.path('reference.exr')
        halves = [self.path('half-%d.exr' % k) for k in (1, 2)]
        try:
            for k, half in enumerate(halves):
                self.draw('path', (self.reference_samples + 1) // 2, self.seed + 1 + k, half).must('the reference')
            found = child.kiln_json('compare', halves[1], halves[0])['picture_psnr']
            self.reference_psnr = math.inf if found is None else found + 20 * math.log10(2)
            a, b = (exr.read(half).channels for half in halves)
            mean = {name: np.float32(0.5) * a[name] + np.float32(0.5) * b[name] for name in 'RGB'}
            exr.write(self.reference, mean, attributes={'kiln:quantity': 'radiance'})
        finally:
            for half in halves:
                child.remove(half)

    def measure_all(self):
        """Keeps the last view of each method."""
        for method in self.methods:
            for view in method.views:
                path = self.view_path(method, view)
                view.measure(child.kiln_json('compare', path, self.reference))
                if view is not method.views[-1]:
                    child.remove(path)

    # ---- files ----

    def csv(self):
        text = 'method,paths,seconds,rays,rmse,nrmse,rel_rmse,picture_psnr,picture_dissimilarity,refused\n'
        for method in self.methods:
            for v in method.views:
                text += '%s,%d,%.6g,%d,%.6g,%.6g,%.6g,%.6g,%.6g,\n' % (
                    method.name, v.samples, v.seconds, v.rays, v.rmse, v.nrmse, v.rel_rmse, v.psnr, v.dissimilarity)
            if not method.views:
                text += '%s,,,,,,,,,"%s"\n' % (method.name, method.refusal.replace('"', '""'))
        return text

    def plot(self):
        plot = figure.Plot('Error of a view over time: %s' % self.scene, 'time of computing',
                           'error of the 8-bit picture, of white', (' s', ' %'), (1.0, 100.0))
        for number, method in enumerate(self.methods):
            plot.line([(view.seconds, view.picture_error()) for view in method.views],
                      method.name + ('' if method.views else ' (refused)'), number)
        return plot

    # ---- what is told ----

    def row(self, method):
        views = [{'paths': v.samples, 'seconds': v.seconds, 'rays': v.rays, 'rmse': v.rmse,
                  'nrmse': sweep.show_number(v.nrmse), 'rel_rmse': v.rel_rmse,
                  'picture_psnr': sweep.show_number(v.psnr), 'picture_dissimilarity': v.dissimilarity}
                 for v in method.views]
        return {'method': method.name, 'refused': None if method.views else method.refusal, 'views': views,
                'psnr_at_equal_time': sweep.show_number(method.psnr_at(self.equal)),
                'psnr_gain_per_doubled_time': sweep.show_number(method.gain()),
                'seconds_to_45_db': sweep.show_number(method.seconds_to_level()[0])}

    def show_table(self):
        text = lambda value, none, before='': (none if math.isnan(value) else 'no error' if math.isinf(value) else
                                               '%s%.4g' % (before, value))
        print('%-12s%8s%12s%12s%16s%16s%14s' % ('method', 'paths', 'seconds', 'nrmse %', 'dB in %.3g s' % self.equal,
                                                'dB a doubling', 's to %.0f dB' % LEVEL))
        for method in self.methods:
            if not method.views:
                print('%-12s refused: %s' % (method.name, method.refusal))
                continue
            last, (seconds, at_most) = method.views[-1], method.seconds_to_level()
            print('%-12s%8d%12.4g%12.3f%16s%16s%14s' % (
                method.name, last.samples, last.seconds, 100 * last.nrmse, text(method.psnr_at(self.equal), 'too slow'),
                text(method.gain(), 'none'), text(seconds, 'not reached', '<= ' if at_most else '')))
        if self.reference_samples:
            print('against %d paths a pixel, whose own error is %s dB; views closer than that cannot be told apart' % (
                self.reference_samples, text(self.reference_psnr, 'not known')))
        print('%s, %s' % (self.path('converge.csv'), self.path('converge.svg')))

    def tell(self):
        self.equal = min(method.views[-1].seconds for method in self.methods if method.views)
        folder.publish(self.path('converge.csv'), self.csv())
        folder.publish(self.path('converge.svg'), self.plot().svg())
        if not self.arguments.json:
            self.show_table()
            return
        child.show_json({'status': 'done', 'equal_seconds': self.equal, 'methods': list(map(self.row, self.methods)),
                         'reference_samples': self.reference_samples,
                         'reference_psnr': sweep.show_number(self.reference_psnr), 'reference': self.reference,
                         'output': self.out})

    def run(self):
        options.check_scene(self.scene)
        if self.arguments.list:
            for method in self.methods:
                for k in range(self.arguments.doublings + 1):
                    print('--method %s --samples-pixel %d' % (method.name, 1 << k))
            return
        with folder.Folder(self.out, 'converge', ['converge.csv', 'converge.json']):
            if self.reference:
                self.read_reference()
            self.draw_all()
            if not self.reference:
                self.make_reference()
            self.measure_all()
            self.tell()


if __name__ == '__main__':
    child.main(lambda: Converge().run(), 'matplotlib')
