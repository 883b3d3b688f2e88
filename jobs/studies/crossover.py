"""kiln bench crossover: from how many views on one bake costs less than path tracing each of them, at equal error

Is a bake worth its time for this scene? (Vandersanden 2023, section 4.4: users of one bake.) Views are drawn from lit
places in the scene (kiln view --places), small, 128 x 72 pixels: from the bake's lightmaps, and by path tracing with
few and with many paths a pixel. Each is held against the same view of very many paths of another seed. The error is
what a user sees of it: the root mean square, over all views, of the difference of t = e L / (1 + e L), with luminance L
and e = 0.18 / the view's geometric mean of L: white is 1. Where texels are smaller than these pixels, their noise is
less here than in a view of full size.

The error of n paths is C n^-p, by what two numbers of paths have. The error of the reference itself, by the same
formula, is taken out of both errors by squares. At n paths, n = (C / error of the bake)^(1/p), both ways have the same
error. The time of a path-traced view at 1920 x 1080 is n times that number of pixels times the time of a path, from the
difference of the two runs; that of a view from lightmaps is measured at two sizes. So what scales is paths and pixels,
and neither import nor BVH is counted. The bake is the whole process. Then N views cost less from one bake where bake +
N view <= N path. Times are of the processor, over all threads, which other programs disturb least; with a GPU, and
beside them, by the clock.

The figure, crossover.svg, shows time over the number of views; crossover.csv has the ways, views.csv the cameras.

Price: the bake, and 4 views of 1024 paths a pixel (--reference-samples)."""
import math
import os
import sys

import numpy as np

from study import child, exr, figure, folder, options, sweep
from study.child import Failure

VIEWS, SMALL, LARGE, FULL = 4, (128, 72), (960, 540), (1920, 1080)
FEW, MANY, ROUNDS = 8, 64, 50
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
OWN = ('samples-probe', 'preview', 'export')


class Way:
    """A way of drawing the views: how far from the reference they are, in t, and over the mean radiance; what the
    process that drew them took, (processor, clock) in s."""

    def __init__(self, samples):
        self.samples = samples  # paths a pixel; 0: from lightmaps
        self.cost, self.distance, self.nrmse, self.error = (0.0, 0.0), 0.0, 0.0, 0.0


def without(distance, own):
    return math.sqrt(max(0.0, distance * distance - own * own))


def fit(few, many, lightmaps, reference_samples):
    """Fits the error of n paths, factor n^-exponent, and takes the reference's own out of all. Returns (exponent,
    factor, the reference's error, the paths that have the lightmaps' error)."""
    exponent = factor = own = 0.0
    for _ in range(ROUNDS):
        few.error, many.error = without(few.distance, own), without(many.distance, own)
        if not few.error > 0 or not many.error > 0:
            break
        exponent = math.log(few.error / many.error) / math.log(many.samples / few.samples)
        factor = few.error * few.samples ** exponent
        own = factor * reference_samples ** -exponent
    if not many.error > 0 or not exponent > 0:
        raise Failure(child.BAD_INPUT, 'the error of path tracing does not fall from %d to %d paths a pixel, as if '
                      'there were no noise in the views; more --reference-samples may help' % (
                          few.samples, many.samples))
    # below the reference's own error it is not known how good the bake is
    lightmaps.error = max(without(lightmaps.distance, own), own)
    return exponent, factor, own, max(1.0, (factor / lightmaps.error) ** (1 / exponent))


def users_of(bake, view, path):
    return max(1.0, math.ceil(bake / (path - view))) if path > view else math.inf


def difference(a, b):
    """Sums over a view a and its reference b: squares of t, pixels, squares of radiance, radiance of b, values."""
    seen = b.astype(np.float64) @ LUMINANCE
    lit = seen[seen > 0]
    exposure = 0.18 / math.exp(np.log(lit).mean()) if len(lit) else 1.0
    x, y = exposure * (a.astype(np.float64) @ LUMINANCE), exposure * seen
    off = a.astype(np.float64) - b
    return np.array([((x / (1 + x) - y / (1 + y)) ** 2).sum(), x.size, (off * off).sum(), b.sum(dtype=np.float64),
                     b.size])


class Crossover:
    def __init__(self):
        made = options.parser('crossover', __doc__, 'SCENE')
        options.goes_on(made)
        options.lists(made)
        made.add_argument('--reference-samples', metavar='N', type=options.number(1, 1 << 20, whole=True), default=1024,
                          help='paths a pixel of the reference (default 1024)')
        self.arguments, self.given = options.parse(made, sys.argv[1:], ['bake'])
        self.reference = Way(self.arguments.reference_samples)
        self.few, self.many, self.lightmaps, self.large = Way(FEW), Way(MANY), Way(0), Way(0)
        if len(self.arguments.words) != 1:
            raise Failure(child.USAGE, 'kiln bench crossover takes one scene; for example: kiln bench crossover '
                                       'room.glb')
        if self.reference.samples <= MANY:
            raise Failure(child.USAGE, '--reference-samples %d: the reference needs more than the %d paths a pixel of '
                                       'the views that it judges' % (self.reference.samples, MANY))
        self.scene = self.arguments.words[0]
        self.out = self.arguments.output or options.default_output(self.scene, '-crossover')

    def path(self, name):
        return os.path.join(self.out, name)

    # ---- children ----

    def run_kept(self, what, *words):
        """(processor, clock) of a command; what it took in an earlier run, whose files are there."""
        costs = self.kept.values['costs']
        if what not in costs:
            child.tell(self.arguments.quiet, what)
            done = child.kiln(*words).must(what)
            costs[what] = [done.processor, done.seconds]
            self.kept.write()
        return tuple(costs[what])

    def views_path(self, way):
        return self.path('large.exr' if way is self.large else 'paths%d.exr' % way.samples if way.samples else
                         'lightmaps.exr')

    def draw(self, way, seed=0):
        width, height = LARGE if way is self.large else SMALL
        what = ('the views, with %d paths a pixel' % way.samples if way.samples else
                'the large views from lightmaps' if way is self.large else 'the views from lightmaps')
        words = ['view', self.path('bake'), '-o', self.views_path(way), '--quiet', '--path', self.path('views.csv'),
                 '--frames', VIEWS, '--width', width, '--height', height, '--backend', self.given.value('backend')]
        if self.given.has('threads'):
            words += ['--threads', self.given.value('threads')]
        if way.samples:
            words += ['--method', 'path', '--samples-pixel', way.samples, '--seed', seed]
            if self.given.value('bounces') != 'all':
                words += ['--bounces', self.given.value('bounces')]
        way.cost = self.run_kept(what, *words)

    def read(self, way, view):
        path = '%s-%04d.exr' % (self.views_path(way)[:-4], view + 1)
        image = exr.rgb(path)
        if image.shape != (SMALL[1], SMALL[0], 3):
            raise Failure(child.BAD_INPUT, "'%s' is not the view that was just written there" % path)
        return image

    def measure(self, way):
        """How far a way's views are from those of the reference."""
        shown, pixels, squares, mean, values = sum(difference(self.read(way, view), self.read(self.reference, view))
                                                   for view in range(VIEWS))
        way.distance = math.sqrt(shown / pixels)
        way.nrmse = math.sqrt(squares / values) / (mean / values) if mean > 0 else 0.0

    # ---- the study ----

    def reckon(self):
        """Times of a view at full size, and from how many on the bake costs less."""
        small, large, full = (VIEWS * w * h for w, h in (SMALL, LARGE, FULL))
        apart = lambda a, b, by: [max(0.0, x - y) / by for x, y in zip(a.cost, b.cost)]
        self.path_cost = [seconds * full / VIEWS * self.paths
                          for seconds in apart(self.many, self.few, small * (MANY - FEW))]
        self.view_cost = [seconds * full / VIEWS for seconds in apart(self.large, self.lightmaps, large - small)]
        self.users = [users_of(*costs) for costs in zip(self.bake_cost, self.view_cost, self.path_cost)]

    def measure_all(self):
        identity = folder.identity(self.given, self.scene, None, self.reference.samples)
        self.kept = folder.Kept(self.out, 'crossover', identity, self.arguments.resume, {'costs': {}})
        self.bake_cost = self.run_kept('the bake', 'bake', self.scene, '-o', self.path('bake'), '--samples-probe', 0,
                                       '--no-preview', '--no-export', '--no-resume', '--quiet',
                                       *self.given.words('bake', OWN))
        self.judge = int(child.report(self.path('bake'))['backend']['name'] != 'embree')  # which of the two times
        child.kiln('view', self.path('bake'), '--places', VIEWS, '-o', self.path('views.csv')).must('kiln view')
        seed = int(self.given.value('seed'))
        self.draw(self.reference, seed + 1)
        for way in (self.few, self.many, self.lightmaps):
            self.draw(way, seed)
            self.measure(way)
        self.draw(self.large)
        self.exponent, self.factor, self.own, self.paths = fit(self.few, self.many, self.lightmaps,
                                                               self.reference.samples)
        self.reckon()

    # ---- files ----

    def csv(self):
        text = 'way,paths,error,distance,nrmse,processor_seconds_a_view,seconds_a_view\n'
        for way in (self.lightmaps, self.few, self.many):
            cost = [c * way.samples / self.paths for c in self.path_cost] if way.samples else self.view_cost
            text += '%s,%d,%.6g,%.6g,%.6g,%.6g,%.6g\n' % (
                'path' if way.samples else 'lightmaps', way.samples, way.error, way.distance, way.nrmse, *cost)
        text += "path at the bake's error,%.6g,%.6g,,,%.6g,%.6g\n" % (self.paths, self.lightmaps.error, *self.path_cost)
        return text + 'bake,,,,,%.6g,%.6g\n' % self.bake_cost

    def plot(self):
        """Both ways, up to twice the crossover."""
        users, bake, view, trace = (pair[self.judge] for pair in (self.users, self.bake_cost, self.view_cost,
                                                                  self.path_cost))
        most = 2 * users if math.isfinite(users) else 10.0
        across = "views of %d x %d, at the bake's error (%.2f %% of white)" % (*FULL, 100 * self.lightmaps.error)
        plot = figure.Plot('One bake or path tracing: %s' % self.scene, across, 'time', ('', ' s'), logarithmic=False)
        plot.line([(0, bake), (most, bake + view * most)], 'bake, and its views', dots=False)
        plot.line([(0, 0), (most, trace * most)], 'path-traced views', 1, dots=False)
        return plot

    # ---- what is told ----

    def sentence(self):
        users, by = self.users[self.judge], 'by the clock' if self.judge else 'of the processor'
        if math.isfinite(users):
            return 'from %.0f view%s on one bake costs less than path tracing each at its error, by time %s' % (
                users, 's' * (users > 1), by)
        return ("path tracing a view at the bake's error costs less than drawing it from lightmaps, by time %s" % by)

    def show_table(self):
        def row(name, paths, error, nrmse, cost):
            print('%-26s%8s%12s%10s%14.3f%12.3f' % (name, paths, error, nrmse, *cost))
        print('%-26s%8s%12s%10s%14s%12s' % ('a view of 1920 x 1080', 'paths', 'error %', 'nrmse %', 'processor s',
                                            'seconds'))
        for way in (self.lightmaps, self.few, self.many):
            cost = [c * way.samples / self.paths for c in self.path_cost] if way.samples else self.view_cost
            row('path-traced' if way.samples else 'from lightmaps', way.samples or '', '%.3f' % (100 * way.error),
                '%.2f' % (100 * way.nrmse), cost)
        row('path-traced, as the bake', '%.4g' % self.paths, '%.3f' % (100 * self.lightmaps.error), '', self.path_cost)
        row('the bake', '', '', '', self.bake_cost)
        print('the error falls with the power %.2f of the paths; of %d views of %d x %d pixels, against %d paths '
              '(error %.3f %%)' % (self.exponent, VIEWS, *SMALL, self.reference.samples, 100 * self.own))
        print(self.sentence())
        print('%s, %s' % (self.path('crossover.csv'), self.path('crossover.svg')))

    def tell(self):
        folder.publish(self.path('crossover.csv'), self.csv())
        folder.publish(self.path('crossover.svg'), self.plot().svg())
        if not self.arguments.json:
            self.show_table()
            return
        child.show_json({'status': 'done', 'users': sweep.show_number(self.users[0]),
                         'users_by_the_clock': sweep.show_number(self.users[1]), 'error': self.lightmaps.error,
                         'paths': self.paths, 'exponent': self.exponent, 'reference_error': self.own,
                         'bake_seconds': self.bake_cost, 'view_seconds': self.view_cost, 'path_seconds': self.path_cost,
                         'output': self.out, 'sentence': self.sentence()})

    def run(self):
        options.check_scene(self.scene)
        if self.arguments.list:
            print('the bake')
            for n in (self.reference.samples, FEW, MANY):
                what = ': the reference' if n == self.reference.samples else ''
                print('%d views, with %d paths a pixel%s' % (VIEWS, n, what))
            print('%d views from lightmaps, %d x %d and %d x %d' % (VIEWS, *SMALL, *LARGE))
            return
        with folder.Folder(self.out, 'crossover', ['crossover.csv', 'crossover.json']):
            self.measure_all()
            self.tell()


if __name__ == '__main__':
    child.main(lambda: Crossover().run(), 'matplotlib')
