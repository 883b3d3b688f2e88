"""kiln bench radiosity: light between patches by the tables and figures of Kahl's thesis, and its true error

What do the ways to send light between patches cost in this scene, and how far are they from the truth? The scene is
baked at sizes of lightmaps that are words behind it (default 16 32 64), each by pure pairs, undersampling, subdivision,
cached visibility, voxels, links and directions; names of these rows among the words choose some. `scenes` adds pure
passes of generated scenes. These are the measures of Kahl, "RTX Radiosity", 2023, chapter 6: time of a pass and DFPR
(kiln compare), and beside them what he does not have: the true error.

A size N is a scene of about N x N texels, as his one lightmap of N x N pixels. All bakes are diffuse, have lamps as
patches, as his tool has, two bounces (--bounces), and are not denoised. Nothing is clamped, unless a row says so. DFPR
is against the pure bake of the same size, of 8 bits and all pixels, as his tool computes it. The true error (nrmse, as
in kiln bench tradeoff) is against a bake by paths at the largest size, with sampled lamps: what texels blur is in it. A
pass's time is that of one bounce, by the clock; processor time is that of the whole bake.

The figures are his: radiosity-figure-6.5.svg, -6.7, -6.10 to -6.16 and -6.18, and radiosity.svg, error over time of
all; his tables are radiosity-table-6.1.csv and -6.2.csv; radiosity.csv has all bakes, radiosity.html everything on a
page, with a view of each bake.

Price: 32 bakes a size, each 16 times as long at twice the size where it goes by pairs, and the reference."""
import html
import math
import os

from study import child, figure, sweep
from study.child import Failure

LEAST, MOST, BOUNCES, WIDTH = 4, 8192, 2, 240
# Bakes of each size, the pure one first: group, name, words, the parameter by which its group's figure is
# drawn, and the share of all pairs, or above 1 the rays of a texel. Rows without a method are of radiosity.
ROWS = [
    ('pure', 'pure', '', 1, 1.0),
    ('lamps', 'lamps sampled', '--lights sampled', 1, 0.7),
    ('clamped', 'clamped', '--clamp --albedo-scale 0.9', 1, 1.0),
    *[('stride', 'stride %d' % n, '--undersample stride --sampling-window %d' % n, n, s)
      for n, s in ((2, 0.3), (4, 0.1))],
    *[('random', 'random %d' % n, '--undersample random --sampling-window %d' % n, n, s)
      for n, s in ((2, 0.3), (4, 0.1), (8, 0.05), (16, 0.03))],
    *[('mipmap', 'mipmap %d' % n, '--undersample mipmap --sampling-window %d' % n, n, s)
      for n, s in ((2, 0.3), (4, 0.1), (8, 0.05))],
    *[('subdivide', 'subdivide %g' % t, '--subdivide %g --node-max 8' % t, t, s)
      for t, s in ((0.02, 0.8), (0.05, 0.5), (0.1, 0.3), (0.2, 0.2), (0.5, 0.1))],
    ('unshot', 'unshot', '--order unshot', 1, 1.0),
    *[('voxels', 'voxels %d' % n, '--visibility voxels --voxels %d' % n, n, s)
      for n, s in ((32, 0.7), (64, 0.8), (128, 0.9))],
    ('cache', 'cache', '--visibility-cache 4', 1, 0.7),
    *[('links', 'links %g' % e, '--patches links --link-error %g' % e, e, s) for e, s in ((0.06, 200), (0.015, 1000))],
    *[(way, '%s %d' % (way, n), '--gather %s --directions %d' % (way, n), n, n)
      for way, n in (('even', 64), ('even', 256), ('even', 1024), ('circles', 256), ('cosine', 256), ('mixed', 256))],
    ('cells', 'cells', '--method cells', 1, 200),
]
GROUPS = list(dict.fromkeys(row[0] for row in ROWS)) + ['scenes']
# Other scenes, of which pure radiosity is timed at the largest size: as words of kiln generate, from few triangles to
# many. His are much like the first five.
SCENES = ('cornell', 'cornell-layers', 'cornell-shapes', 'cornell-statue --triangles 5000',
          'cornell-statue --triangles 150000', 'rooms')
VOXELS = (0, 128, 64, 32, 16)  # grids by which a texel sees; 0: rays
CSV = ('side,method,name,options,triangles,points,rays,first_pass_seconds,later_pass_seconds,light_seconds,seconds,'
       'processor_seconds,peak_bytes,dfpr,dfpr_8bit,nrmse,nrmse_direct,nrmse_indirect\n')
STYLE = ('body{font-family:sans-serif;margin:2em;max-width:1400px}'
         'figure{display:inline-block;margin:4px;font-size:12px}td{padding:2px 12px 2px 0;text-align:right}'
         '.plot{width:860px;display:block}figure img{width:240px;'
         'image-rendering:pixelated}')


def pass_of(result):
    """The time of a pass: one that is not the first, where there is one."""
    return result.later_pass if result.later_pass > 0 else result.first_pass


def picture(name, ending=''):
    return 'pictures/%s%s.png' % (name.replace(' ', '-'), ending)


def seen_picture(along):
    return 'pictures/seen-voxels-%d.png' % along if along else 'pictures/seen-rays.png'


def is_size(word):
    return word[:1].isdigit()


class Radiosity(sweep.Sweep):
    name, takes, reference_samples = 'radiosity', '[SIZE|NAME ...]', 1024
    refused = ('method', 'materials', 'texels-per-metre', 'lightmap-size', 'samples-probe', 'verify-fraction')

    # ---- settings ----

    def choose(self):
        sides = []
        for word in self.words:
            if word in GROUPS:
                continue
            if not word.isdecimal() or not LEAST <= int(word) <= MOST:
                raise Failure(child.USAGE, "kiln bench radiosity takes sizes of a lightmap in texels a side, %d to %d, "
                                           "such as 64, and names of what is baked, not '%s'; there is: %s" % (
                                               LEAST, MOST, word, ', '.join(GROUPS)))
            if int(word) in sides:
                raise Failure(child.USAGE, 'kiln bench radiosity: the size %s is given twice' % word)
            sides.append(int(word))
        named = [word for word in self.words if not is_size(word)]
        wanted = lambda group: not named or group in named or group == 'pure'
        self.sides = sides or [16, 32, 64]
        for side in self.sides:
            for group, name, words, parameter, share in ROWS:
                if wanted(group):
                    self.add(group=group, name='%d %s' % (side, name), words=words, side=side, parameter=parameter,
                             share=share, density=0.0)
        self.largest = max(self.sides)
        for scene in SCENES if wanted('scenes') else ():
            self.add(group='scenes', name='%d %s' % (self.largest, scene), words='', side=self.largest, generate=scene,
                     parameter=1, share=1.0, density=0.0)
        self.sides = sorted(self.sides)

    def bounces(self):
        given = self.given.value('bounces')
        return int(given) if given.isdecimal() else BOUNCES

    def density_of(self, s):
        """Texels per metre; 0: not known yet. The reference is of the largest size."""
        if s.generate is not None:
            return s.density or self.results[self.settings.index(s)].texels_per_metre
        return self.density * s.side / self.largest if self.report else 0.0

    def option_words(self, s):
        words = [] if '--method' in s.words else ['--method radiosity']
        if '--method' not in s.words and '--lights' not in s.words:
            words.append('--lights patches')
        words += [s.words] if s.words else []
        words.append('--bounces %d --denoise none --materials diffuse' % self.bounces())
        if self.density_of(s) > 0:
            words.append('--texels-per-metre %.9g' % self.density_of(s))
        return ' '.join(words)

    def key(self, s):
        return '%s: %s' % (s.name, s.words)

    def rays(self, s):
        points = float(s.side * s.side)
        return points * (s.share if s.share > 1 else s.share * points)

    # ---- children ----

    def area(self, scene):
        """Surface of a scene, m2."""
        found = child.kiln_json('info', scene, *self.given.words('info'))['surface']['area']
        if not found > 0:
            raise Failure(child.BAD_INPUT, "'%s' has no surface to put texels on" % scene)
        return found

    def prepare(self, s):
        """Makes a scene, and finds how wide texels are that it has as many as the size says."""
        if s.generate is not None:
            os.makedirs(self.path('scenes'), exist_ok=True)
            child.kiln_json('generate', *s.generate.split(), '-o', self.scene_of(s))
            s.density = s.side / math.sqrt(self.area(self.scene_of(s)))

    def reference_words(self):
        area, samples = self.area(self.scene), self.arguments.reference_samples
        child.tell(self.arguments.quiet, 'baking the reference, with %d paths a texel' % samples)
        return ['--method', 'path', '--materials', 'diffuse', '--denoise', 'none', '--samples-direct', samples,
                '--samples-indirect', samples, '--bounces', self.bounces(), '--seed',
                int(self.given.value('seed')) + 1, '--texels-per-metre', '%.9g' % (self.largest / math.sqrt(area))]

    # ---- measuring ----

    def read_passes(self, result, report):
        seconds = [b['seconds'] for b in report['bounces'] if b['kind'] not in ('direct', 'pilot')]
        while seconds and not seconds[0] > 0:
            seconds.pop(0)
        result.values['first_pass'] = seconds[0] if seconds else 0.0
        result.values['later_pass'] = sum(seconds[1:]) / (len(seconds) - 1) if len(seconds) > 1 else 0.0

    def pure(self, side):
        return self.path('pure-%d' % side)

    def find_dfpr(self, s, result):
        """Against the pure bake of its size; and the picture of the difference."""
        if s.group != 'pure':
            found = child.kiln_json('compare', self.trial, self.pure(s.side), '-o',
                                    self.path(picture(s.name, '-difference')))
            result.values.update(dfpr=found['dfpr_unit'], dfpr_8bit=found['dfpr_8bit'] or 0.0)

    def draw(self, s):
        """All pictures have the exposure of the reference's."""
        os.makedirs(self.path('pictures'), exist_ok=True)
        if 'exposure' not in self.kept.values:
            self.kept.values['exposure'] = child.kiln_json(
                'view', self.reference, '-o', self.path('pictures/reference.png'), '--width',
                WIDTH)['exposure']['automatic']
        child.kiln_json('view', self.trial, '-o', self.path(picture(s.name)), '--no-auto-exposure', '--width', WIDTH,
                        '--exposure', '%.9g' % self.kept.values['exposure'])

    def find_seen(self):
        """Counts the texels that one texel sees, by rays and by grids of voxels, and draws them."""
        rows = []
        for along in VOXELS:
            found = child.kiln_json('view', self.trial, '--show', 'seen', '--filter', 'nearest', '-o',
                                    self.path(seen_picture(along)), '--width', WIDTH,
                                    *(['--voxels', along] if along else []))
            rows.append({'along': along, **found['seen']})
        self.kept.values['seen'] = rows

    def more(self, s, result, report):
        self.read_passes(result, report)
        if s.generate is not None:
            return
        os.makedirs(self.path('pictures'), exist_ok=True)
        self.find_dfpr(s, result)
        self.draw(s)
        if s.group == 'pure':
            if s.side == self.largest:
                self.find_seen()
            child.remove(self.pure(s.side))
            os.rename(self.trial, self.pure(s.side))

    # ---- tables ----

    def csv(self):
        text = CSV
        for s, r in self.done():
            text += '%d,%s,%s,%s,%.0f,%.0f,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.0f,' % (
                s.side, s.group, s.name, self.option_words(s), r.triangles, r.points, r.rays, r.first_pass,
                r.later_pass, r.light_seconds, r.seconds, r.processor_seconds, r.peak_bytes)
            if s.generate is None:
                text += '%.6g,%.6g,%.6g,%.6g,%.6g\n' % (r.dfpr, r.dfpr_8bit, r.error(0), r.error(1), r.error(2))
            else:  # of another scene than the reference
                text += ',,,,\n'
        return text

    def find(self, side, row):
        """The result of a row at a size; None: there is none yet."""
        return next((r for s, r in self.done() if s.name == '%d %s' % (side, row)), None)

    def constant_ratio(self, side):
        """The row of undersampling by chance whose window has the same ratio to the size at all sizes."""
        window = (side + self.sides[0] // 2) // self.sides[0]
        return 'pure' if window <= 1 else 'random %d' % window

    def table_6_1(self):
        text = 'side,texels,window,dfpr_8bit,dfpr,nrmse,pass_seconds\n'
        for side in self.sides:
            row = self.constant_ratio(side)
            r = self.find(side, row)
            if r is not None:
                text += '%d,%.0f,%s,%.6g,%.6g,%.6g,%.6g\n' % (
                    side, r.points, row.partition(' ')[2] or '1', r.dfpr_8bit, r.dfpr, r.error(), pass_of(r))
        return text

    def table_6_2(self):
        text = 'side,texels,method,bake_seconds,processor_seconds,dfpr_8bit,nrmse\n'
        for side in self.sides:
            for row in ('cells', self.constant_ratio(side), 'even 1024', 'links 0.015'):
                r = self.find(side, row)
                if r is not None:
                    text += '%d,%.0f,%s,%.6g,%.6g,%.6g,%.6g\n' % (
                        side, r.points, row, r.seconds, r.processor_seconds, r.dfpr_8bit, r.error())
        return text

    def pure_scenes(self):
        """(scene, result) of the pure passes at the largest size."""
        return [(s.generate or os.path.basename(self.scene), r) for s, r in self.done()
                if s.side == self.largest and (s.generate or s.group == 'pure')]

    def table_6_12(self):
        return 'scene,triangles,texels,rays,pass_seconds,pair_nanoseconds\n' + ''.join(
            '%s,%.0f,%.0f,%.6g,%.6g,%.6g\n' % (scene, r.triangles, r.points, r.rays, pass_of(r),
                                               1e9 * pass_of(r) / r.points ** 2) for scene, r in self.pure_scenes())

    def seen(self):
        """(texel, along, facing, by rays, seen, by both, share that is wrong of those that it faces)."""
        for row in self.kept.values.get('seen', []):
            rays = row['rays']
            seen, both = (row['voxels'], row['both']) if row['along'] else (rays, rays)
            wrong = (rays + seen - 2 * both) / row['facing'] if row['facing'] > 0 else 0.0
            yield row['texel'], row['along'], row['facing'], rays, seen, both, wrong

    def table_6_14(self):
        return 'voxels_along,facing,seen,seen_by_rays,seen_by_both,wrong_share\n' + ''.join(
            '%s,%.0f,%.0f,%.0f,%.0f,%.6g\n' % (along or 'rays', facing, seen, rays, both, wrong)
            for _, along, facing, rays, seen, both, wrong in self.seen())

    def texts(self):
        return [('-table-6.1.csv', self.table_6_1()), ('-table-6.2.csv', self.table_6_2()),
                ('-figure-6.12.csv', self.table_6_12()), ('-figure-6.14.csv', self.table_6_14()),
                ('.html', self.page())]

    # ---- figures ----

    def plot(self, title, *rest, **more):
        return figure.Plot('%s: %s' % (title, self.scene), *rest, **more)

    def over_sizes(self, plot, *rows):
        """A line of each row: the time of a pass over the sizes."""
        for number, row in enumerate(rows):
            found = [(side, self.find(side, row)) for side in self.sides]
            plot.line([(side, pass_of(r)) for side, r in found if r is not None], row, number)
        return plot

    def over_parameter(self, plot, group, over_time=False):
        """For each size a line of a group's DFPR and a dashed one of its error, over the parameter or the time of a
        pass."""
        for number, side in enumerate(self.sides):
            some = [(s, r) for s, r in self.done() if (s.side, s.group) == (side, group)]
            x = [pass_of(r) if over_time else s.parameter for s, r in some]
            plot.line(list(zip(x, [r.dfpr_8bit for _, r in some])), '%d: DFPR' % side, number)
            plot.line(list(zip(x, [r.error() for _, r in some])), '%d: true error' % side, number, dashed=True)
        return plot

    def scatter(self, plot, side=None):
        """All rows of a size, error over time of a pass; or of all sizes over the processor time of the bake."""
        for number, group in enumerate(GROUPS[:-1]):
            some = [(s, r) for s, r in self.done() if s.group == group and side in (None, s.side)]
            if any(s.group == group for s in self.settings):
                plot.dots([(pass_of(r) if side else r.processor_seconds, r.error()) for _, r in some], group, number,
                          number >= len(figure.COLORS), [s.name.partition(' ')[2] for s, _ in some] if side else ())
        return plot

    def kept_over_pure(self):
        plot = self.plot('Passes that keep visibility, over pure ones (figure 6.13)', 'texels a side', 'time of a pass',
                         ('', ' %'), (1.0, 100.0))
        both = [(side, self.find(side, 'cache'), self.find(side, 'pure')) for side in self.sides]
        for number, (name, time) in enumerate((('first pass', 'first_pass'), ('later passes', 'later_pass'))):
            plot.line([(side, getattr(kept, time) / getattr(pure, time)) for side, kept, pure in both
                       if kept is not None and pure is not None and getattr(pure, time) > 0], name, number)
        return plot

    def scenes_figure(self):
        plot = self.plot('Time of a pass of pure radiosity, by scene (figure 6.12)', 'triangles',
                         'nanoseconds a pair of texels', ('', ' ns'))
        for number, (scene, r) in enumerate(self.pure_scenes()):
            plot.dots([(r.triangles, 1e9 * pass_of(r) / r.points ** 2)],
                      '%s, %.0f' % (scene.partition(' ')[0][:20], r.triangles), number)
        return plot

    def voxels_figure(self):
        plot = self.plot('What a texel sees by voxels (figure 6.14)', 'voxels along the longest side',
                         'texels seen by voxels or rays alone, of those it faces', ('', ' %'), (1.0, 100.0))
        plot.line([(along, wrong) for _, along, *_, wrong in self.seen()], 'wrong')
        return plot

    def figures(self):
        dfpr, side, seconds = 'DFPR; dashed: true error', 'texels a side', 'seconds of a pass'
        percent = (' s', ' %'), (1.0, 100.0)
        plots = {
            '6.5': self.over_sizes(self.plot('Time of a pass of pure radiosity (figure 6.5)', side, seconds,
                                             ('', ' s')), 'pure'),
            '6.7': self.over_parameter(self.plot('Undersampling by chance (figure 6.7)', 'texels a side of a window',
                                                 dfpr), 'random'),
            '6.10': self.over_parameter(self.plot('Subdivision, thresholds 0.02 to 0.5 (figure 6.10)', seconds, dfpr,
                                                  (' s', '')), 'subdivide', True),
            '6.11': self.scatter(self.plot('All methods at the largest size (figures 6.11, 6.18)', seconds,
                                           'true error', *percent), self.largest),
            '6.12': self.scenes_figure(), '6.13': self.kept_over_pure(), '6.14': self.voxels_figure(),
            '6.15': self.over_parameter(self.plot('Voxels for rays (figure 6.15)', 'voxels along the longest side',
                                                  dfpr), 'voxels'),
            '6.16': self.over_parameter(self.plot('Even directions (figures 6.16, 6.17)', 'directions of a texel',
                                                  dfpr), 'even'),
            '6.18': self.over_sizes(self.plot('Time of a pass (figure 6.18)', side,
                                              'seconds of a pass that is not the first', ('', ' s')),
                                    'pure', 'random 4', 'mipmap 4', 'subdivide 0.1', 'cache', 'links 0.015', 'even 256',
                                    'mixed 256', 'cells')}
        return [('-figure-%s.svg' % number, plot) for number, plot in plots.items()] + [
            ('.svg', self.scatter(self.plot('True error over processor time', 'processor seconds of the bake',
                                            'true error', *percent)))]

    # ---- the page ----

    @staticmethod
    def figure_of(file, caption):
        return '<figure><img src="%s" alt="%s"><figcaption>%s</figcaption></figure>\n' % (
            html.escape(file), html.escape(file), caption)

    def shown(self, side, rows, ending=''):
        """Pictures of the rows of a size that are done."""
        found = [('%d %s' % (side, row), self.find(side, row)) for row in rows]
        return '<div>\n%s</div>\n' % ''.join(
            self.figure_of(picture(name, ending), '%s<br>%.3g s, DFPR %.4f, error %.1f %%' % (
                name, pass_of(r), r.dfpr_8bit, 100 * r.error())) for name, r in found if r is not None)

    @staticmethod
    def as_table(title, text):
        rows = [''.join('<td>%s</td>' % html.escape(cell) for cell in line.split(',')) for line in text.splitlines()]
        return '<h2>%s</h2>\n<table>%s</table>\n' % (title, '\n'.join('<tr>%s</tr>' % row for row in rows))

    def seen_pictures(self):
        for texel, along, facing, _, seen, _, wrong in self.seen():
            caption = '%d voxels<br>%.1f %% wrong' % (along, 100 * wrong) if along else \
                'rays<br>%.0f of %.0f texels' % (seen, facing)
            yield self.figure_of(seen_picture(along), '%s, %s' % (html.escape(str(texel)), caption))

    def page(self):
        windows = ['pure', 'random 2', 'random 4', 'random 8', 'random 16']
        plots = ['-figure-6.%d' % n for n in (5, 7, 10, 11, 12, 13, 14, 15, 16, 18)]
        all_rows = [row[1] for row in ROWS]
        parts = [
            '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>kiln bench radiosity</title>'
            '<style>%s</style></head><body>\n<h1>Radiosity by patches: %s</h1>\n' % (STYLE, html.escape(self.scene)),
            '<p>Tables and figures are numbered as in Kahl, &#8220;RTX Radiosity&#8221;, 2023, chapter 6. DFPR is '
            'against pure radiosity of the same size, of 8 bits and all pixels; the true error is the root mean square '
            'against paths at the largest size, over the mean. Seconds are of one pass, by the clock.</p>\n',
            self.as_table('Windows of one ratio to the size (table 6.1)', self.table_6_1()),
            self.as_table('Whole bakes (table 6.2)', self.table_6_2()),
            self.as_table('Scenes (figure 6.12)', self.table_6_12()),
            self.as_table('What a texel sees (figure 6.14)', self.table_6_14()),
            *['<img class="plot" src="radiosity%s.svg" alt="%s">\n' % (name, name) for name in [*plots, '']],
            '<h2>Undersampling by chance, sizes and windows (figure 6.6)</h2>\n',
            *[self.shown(side, windows) for side in self.sides],
            '<h2>Difference of the lightmap that is off most from pure radiosity; white: 10 % of the mean (figure '
            '6.9)</h2>\n', self.shown(self.largest, windows[1:], '-difference'),
            '<h2>All methods at the largest size (figures 6.8, 6.11, 6.17)</h2>\n',
            self.figure_of('pictures/reference.png', 'reference, by paths'), self.shown(self.largest, all_rows),
            '<h2>What a texel sees, by rays and by voxels; white: seen, blue: hidden (figure 6.14)</h2>\n',
            *self.seen_pictures(), '</body></html>\n']
        return ''.join(parts)

    # ---- what is told ----

    def lines(self):
        for s in self.settings:
            yield '%-36s %s' % (s.name, self.option_words(s))
        yield '%d bakes, and the reference before them' % len(self.settings)

    def row(self, s, r):
        row = {'name': s.name, 'side': s.side, 'options': self.option_words(s), 'triangles': r.triangles,
               'points': r.points, 'rays': r.rays, 'first_pass_seconds': r.first_pass,
               'later_pass_seconds': r.later_pass, 'processor_seconds': r.processor_seconds}
        if s.generate is None:
            row.update(dfpr=r.dfpr, dfpr_8bit=r.dfpr_8bit, nrmse=r.error(0), nrmse_indirect=r.error(2))
        return row

    def tell(self, left):
        if self.arguments.json:
            self.show_rows(left, self.row)
            return
        print('%-36s%9s%12s%11s%11s%12s%11s%9s%12s' % ('size, method', 'texels', 'rays', 'first s', 'later s',
                                                       'processor s', 'DFPR', 'error', 'indirect'))
        for s, r in self.done():
            print('%-36s%9.0f%12.3g%11.3g%11.3g%12.3g%s' % (
                s.name, r.points, r.rays, r.first_pass, r.later_pass, r.processor_seconds,
                '' if s.generate else '%11.4f%8.2f%%%11.2f%%' % (r.dfpr_8bit, 100 * r.error(0), 100 * r.error(2))))
        if left:
            print(self.left_sentence(left))
        print('DFPR: against pure radiosity of the same size; error: root mean square against paths at size %d, over '
              'the mean' % self.largest)
        print('%s has tables, figures and pictures' % self.path('radiosity.html'))


if __name__ == '__main__':
    child.main(lambda: Radiosity(__doc__).run(), 'matplotlib')
