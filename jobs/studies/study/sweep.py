"""Sweeps: a scene is baked with many settings, and each bake is held against a reference. A study that sweeps is a
class that derives from Sweep. Repeats, breaks and budgets, what is kept, and what all have on their command line are
here."""
import math
import os
import statistics
import sys
import time
import types

from . import child, folder, options
from .child import Failure
from .counters import Counters

WHOLE, LIGHT, INDIRECT, EXCHANGE, PROCESSOR, FIRST_COUNTER = range(6)  # what is kept of each run; counters behind
SETTINGS_MOST, REPEATS_MOST = 128, 100
FIGURES_EVERY = 60.0  # s
OF_LIGHT = ('direct light', 'bounces', 'final gather', 'radiance probes', 'exchange')


class Result:
    """Measurements of a setting: the runs, and values by name that all runs have in common."""

    def __init__(self, kept=None):
        self.runs = [[math.nan if t is None else t for t in run] for run in (kept or {}).get('runs', [])]
        self.values = {name: value for name, value in (kept or {}).items() if name != 'runs'}
        self.front = False

    def __getattr__(self, name):
        return self.values.get(name, 0.0)

    @property
    def done(self):
        return bool(self.runs)

    def error(self, layer=0):
        """nrmse of all light, of direct light, of indirect light."""
        return self.values.get('nrmse', (0.0, 0.0, 0.0))[layer]

    def spread(self, time):
        """(median, least, most) of a time; NaN if a run does not know it."""
        known = sorted(run[time] for run in self.runs)
        if not known or not all(map(math.isfinite, known)):
            return math.nan, math.nan, math.nan
        return statistics.median(known), known[0], known[-1]

    def median(self, time):
        return self.spread(time)[0]

    @property
    def seconds(self):
        return self.median(WHOLE)

    @property
    def light_seconds(self):
        return self.median(LIGHT)

    @property
    def processor_seconds(self):
        return self.median(PROCESSOR)

    def kept(self):
        return {'runs': [[t if math.isfinite(t) else None for t in run] for run in self.runs], **self.values}


class Setting(types.SimpleNamespace):
    """One bake: its group and its name, and what the study says of it."""
    group = name = ''
    ranks = 0  # started by mpirun; 0: by itself
    generate = None  # another scene than the study's, as words of kiln generate: it is not compared


def phase_seconds(report, names):
    """Seconds of the slowest rank in these phases."""
    return sum(phase['seconds']['max'] for phase in report['phases'] if phase['name'] in names)


def read_report(report, values):
    """Takes the values of run.json that all runs have in common."""
    part = lambda group, name: float((report.get(group) or {}).get(name) or 0.0)
    values.update(peak_bytes=max(values.get('peak_bytes', 0.0), part('memory', 'peak_rank')),
                  points=part('points', 'count'), rays=float(sum(report['rays'].values())),
                  texels_per_metre=part('scene', 'texels_per_metre'), triangles=part('scene', 'triangles'),
                  cells=part('balance', 'cells_occupied'), cell_size=part('balance', 'cell_size'),
                  imbalance=part('balance', 'point_imbalance'), received=part('mpi', 'received_between_nodes'))
    for name, key in (('probes', 'probes'), ('probe_bytes', 'bytes'), ('probe_rays', 'rays'),
                      ('points_alone', 'points_without')):
        values[name] = part('radiance_probes', key)


def show_number(value):
    return value if math.isfinite(value) else None


class Sweep:
    """name: of the study, and of its files; refused: options that it sets itself; exact: every bake must have the
    reference's bits, and runs are repeated; takes: what the words behind the scene are, for the usage line;
    takes_reference: --reference may name one; reference_samples: of each texel of one that is made, 0 where nobody says
    how many."""
    name, refused, exact, takes = '', (), False, ''
    takes_reference, reference_samples = False, 0

    # ---- of the study: choose, option_words, key, reference_words, csv, figures, tell; and, where it wants, these ----

    def rays(self, setting):
        """A measure of how long the bake takes."""
        return 1.0

    def prepare(self, setting):
        """Before a bake's options are asked for."""

    def more(self, setting, result, report):
        """Measures more of the bake in self.trial."""

    def judge(self):
        """Before results are written."""

    def texts(self):
        """More files: (ending, text)."""
        return []

    def add_parameters(self, parser):
        """Parameters of the study's own."""

    # ---- the command line ----

    def __init__(self, text):
        made = options.parser(self.name, text, 'SCENE ' + self.takes)
        options.goes_on(made)
        options.lists(made)
        made.add_argument('--budget', metavar='SECONDS', type=options.number(1e-3, 1e9, word='none'),
                          help='begin no bake that would end later; run again to go on (default none)')
        if self.takes_reference:
            made.add_argument('--reference', metavar='DIR', help='a bake that errors are measured against, in place of '
                                                                 'one that is made')
        if self.reference_samples:
            made.add_argument('--reference-samples', metavar='N', type=options.number(1, 1 << 20, whole=True),
                              default=self.reference_samples,
                              help='samples of each texel of the reference (default %(default)s)')
        if self.exact:
            made.add_argument('--repeats', metavar='N', type=options.number(1, 1000, whole=True), default=5,
                              help='runs of each bake; the median is reported (default 5)')
        self.add_parameters(made)
        words = sys.argv[1:]
        for name in ('--reference', '--reference-samples'):
            if name not in made._option_string_actions and options.was_given(words, name):
                self._refuse(name)
        self.arguments, self.given = options.parse(made, words, ['bake'])
        if not self.arguments.words:
            raise Failure(child.USAGE, 'kiln bench %s takes a scene; for example: kiln bench %s room.glb' % (
                self.name, self.name))
        self.scene, self.words = self.arguments.words[0], self.arguments.words[1:]
        for name in self.refused:
            if self.given.has(name):
                self._refuse('--' + name)
        self.repeats = getattr(self.arguments, 'repeats', 1)
        if self.repeats > REPEATS_MOST:
            raise Failure(child.USAGE, 'kiln bench %s takes at most %d --repeats, not %d' % (
                self.name, REPEATS_MOST, self.repeats))
        self.given_reference = getattr(self.arguments, 'reference', None)
        if self.given_reference is not None and not os.access(self.given_reference, os.R_OK):
            raise Failure(child.NO_INPUT, "the reference '%s' cannot be read: No such file or directory" %
                          self.given_reference)
        self.out = self.arguments.output or options.default_output(self.scene, '-' + self.name)
        self.settings, self.results, self.report = [], [], None
        self.density = float(self.given.value('texels-per-metre') or 0) if self.given.has('texels-per-metre') else 1.0

    def _refuse(self, option):
        raise Failure(child.USAGE, 'kiln bench %s takes no %s: its bakes have their own; --list shows them' % (
            self.name, option))

    def add(self, **values):
        if len(self.settings) == SETTINGS_MOST - 1:
            raise Failure(child.USAGE, 'there are too many bakes in one sweep: give fewer')
        self.settings.append(Setting(**values))
        self.results.append(Result())

    def done(self):
        """(setting, result) of those that have a result."""
        return [(s, r) for s, r in zip(self.settings, self.results) if r.done]

    def path(self, *names):
        return os.path.join(self.out, *names)

    # ---- a bake ----

    def _command(self, scene, where):
        return ['bake', scene, '-o', where, '--samples-probe', 0, '--no-preview', '--no-export',
                *self.given.words('bake')]

    def scene_of(self, setting):
        if setting.generate is None:
            return self.scene
        return self.path('scenes', setting.generate.replace(' ', '-') + '.glb')

    def _open_reference(self):
        if not self.given_reference and not self.kept.values['reference_done']:
            words = self.reference_words()
            child.kiln(*self._command(self.scene, self.reference), *words,
                       *([] if self.arguments.resume else ['--no-resume'])).must("the bake 'reference'")
        self.report = child.report(self.reference)
        self.density = self.report['scene']['texels_per_metre']
        self.kept.values['reference_done'] = True

    def _compare(self, report, values):
        """Errors of the bake in self.trial, and with `exact` its bits."""
        hashes = [[source['xxh3_128'] for source in one['scene']['sources']] for one in (report, self.report)]
        if hashes[0] != hashes[1]:
            raise Failure(child.BAD_INPUT, "'%s' is a bake of another scene than '%s', or the scene has changed since: "
                          "give another --reference, or another --output" % (self.reference, self.scene))
        found = child.kiln_json('compare', self.trial, self.reference).get('by_area', {'why': 'it has no scene file'})
        if 'why' in found:
            raise Failure(child.BAD_INPUT, "'%s': %s" % (self.reference, found['why']))
        values['nrmse'] = [found['nrmse'], found['nrmse_direct'], found['nrmse_indirect']]
        values['differing'] = max(values.get('differing', 0.0), found['values_that_differ'])

    def _measure(self, setting, result):
        child.remove(self.trial)
        self.prepare(setting)
        counters = Counters()
        try:
            done = child.kiln(*self._command(self.scene_of(setting), self.trial), *self.option_words(setting).split(),
                              '--no-resume', ranks=setting.ranks).must("the bake '%s'" % setting.name)
            counts = counters.read()
        finally:
            counters.close()
        report, values = child.report(self.trial), dict(result.values)
        if setting.generate is None:
            self._compare(report, values)
        result.values = values
        self.more(setting, result, report)
        read_report(report, values)
        result.runs.append([done.seconds, phase_seconds(report, OF_LIGHT),
                            phase_seconds(report, ('bounces', 'final gather')), phase_seconds(report, ('exchange',)),
                            done.processor, *counts])
        child.remove(self.trial)
        self._keep()

    # ---- what is kept ----

    def _keep(self, figures=False):
        """Writes the results, and at times the figures, which take longer than a small bake."""
        self.judge()
        self.kept.values['results'].update((self.key(s), r.kept()) for s, r in self.done())
        self.kept.write()
        for ending, text in [('.csv', self.csv()), *self.texts()]:
            folder.publish(self.path(self.name + ending), text)
        if figures or time.monotonic() > self.drawn + FIGURES_EVERY:
            for ending, plot in self.figures():
                folder.publish(self.path(self.name + ending), plot.svg())
            self.drawn = time.monotonic()

    # ---- the sweep ----

    def _predict(self, setting):
        """How long a bake is likely to take: seconds = a + b rays, fitted to those that were run."""
        known = [(self.rays(s), r.seconds) for s, r in self.done()]
        if not known:
            return 0.0
        n, x, y = len(known), sum(a for a, _ in known), sum(b for _, b in known)
        spread = n * sum(a * a for a, _ in known) - x * x
        slope = max(0.0, (n * sum(a * b for a, b in known) - x * y) / spread) if spread > 0 else 0.0
        return max(0.0, (y - slope * x) / n + slope * self.rays(setting))

    def _tell_progress(self, number, setting, budget):
        left = min(budget, sum(max(0, self.repeats - len(r.runs)) * self._predict(s)
                               for s, r in zip(self.settings, self.results)))
        child.tell(self.arguments.quiet, 'bake %d of %d: %s; about %.0f:%02.0f left' % (
            number + 1, self.repeats * len(self.settings), setting.name, left // 60, math.floor(left % 60)))

    def _run_all(self, begin):
        """Repeats in turn, so that a machine that slows down does so for all settings. Returns how many runs the budget
        has no room for."""
        left = 0
        for number in range(self.repeats * len(self.settings)):
            index = number % len(self.settings)
            setting, result = self.settings[index], self.results[index]
            budget = begin + self.arguments.budget - time.monotonic() if self.arguments.budget else math.inf
            if len(result.runs) > number // len(self.settings):
                continue
            if left > 0 or budget <= 0 or self._predict(setting) > budget:
                left += 1
                continue
            self._tell_progress(number, setting, budget)
            self._measure(setting, result)
        return left

    def run(self):
        options.check_scene(self.scene)
        self.choose()
        if self.arguments.list:
            for line in self.lines():
                print(line)
            return
        begin = self.drawn = time.monotonic()
        with folder.Folder(self.out, self.name, [self.name + '.csv', self.name + '.json']):
            self.reference = self.given_reference or self.path('reference')
            self.trial = self.path('trial')
            identity = folder.identity(self.given, self.scene, self.given_reference,
                                       getattr(self.arguments, 'reference_samples', 0))
            self.kept = folder.Kept(self.out, self.name, identity, self.arguments.resume,
                                    {'reference_done': False, 'results': {}})
            for index, setting in enumerate(self.settings):
                self.results[index] = Result(self.kept.values['results'].get(self.key(setting)))
            self._open_reference()
            try:
                left = self._run_all(begin)
            finally:
                self._keep(figures=True)
            self.tell(left)

    # ---- what is told ----

    def left_sentence(self, left, what='bakes'):
        return '%d of %d %s are left, for the budget of %.4g s is used up; the same command goes on with them' % (
            left, self.repeats * len(self.settings), what, self.arguments.budget)

    def files_line(self):
        return '%s, %s' % (self.path(self.name + '.csv'), self.path(self.name + '.svg'))

    def show_rows(self, left, row, **more):
        """For --json: a row for each bake that was done."""
        child.show_json({'status': 'done', 'output': self.out, 'left': left,
                         'bakes': [row(s, r) for s, r in self.done()], **more})

