"""kiln bench tradeoff: what settings are worth for a scene, by error, time and memory

Which settings are worth choosing for this scene? It is baked with many, and each bake is held against one of many
samples. What no other bake beats in both error and time is the front: the settings to choose from. The words behind the
scene name what is swept (presets, denoise, schedule, density, bounces, samples; none: all), or are samples of direct
light, bounces and final gather, such as 32,4,64.

The figure, tradeoff.svg, shows error over time; tradeoff.csv has all bakes. The error is the nrmse: the root mean
square of the difference of all light from the reference, over R, G, B and the area of the surfaces, over the mean of
the reference. It is taken from the lightmaps, as they are published (denoised, seams smoothed), at the centres of the
reference's texels; a bake of another density is read there bilinearly, as an engine reads it. The parts of direct and
indirect light are divided by the same mean. Time is that of the whole process, by the clock, without volume, preview
and export, and of its passes of light; processor time is that of all its threads, memory the peak of the process.

Price: 65 bakes, and the reference, which takes longer than most of them together; --budget ends it early."""
import math
import re

from study import child, figure, sweep
from study.child import Failure

# In this order, so that a sweep that ends early has the presets and what is quick.
GROUPS = ('presets', 'denoise', 'schedule', 'density', 'bounces', 'samples')
CSV = ('group,name,options,samples_direct,samples_bounce,samples_indirect,bounces,schedule,denoised,texels_per_metre,'
       'points,rays,nrmse,nrmse_direct,nrmse_indirect,seconds,light_seconds,processor_seconds,peak_bytes,front\n')


def read_samples(text):
    """DIRECT,BOUNCE,INDIRECT, such as 32,4,64; None if it is something else."""
    if not re.fullmatch('[0-9]+,[0-9]+,[0-9]+', text):
        return None
    values = [int(part) for part in text.split(',')]
    return values if all(1 <= value <= 1 << 20 for value in values) else None


def beats(a, b):
    return a.seconds <= b.seconds and a.error() <= b.error() and (a.seconds < b.seconds or a.error() < b.error())


def front_of(bakes):
    """The bakes that no other beats, by time."""
    found = [one for one in bakes if not any(beats(other[1], one[1]) for other in bakes)]
    return sorted(found, key=lambda one: one[1].seconds)


def seconds_of_front(bakes, error):
    """The time in which the front of these bakes has an error: between two of it the logarithms are interpolated. NaN
    beyond its ends."""
    front = front_of(bakes)
    for (_, a), (_, b) in zip(front, front[1:]):
        if a.error() >= error >= b.error() > 0:
            over = math.log(a.error() / b.error())
            return a.seconds * (b.seconds / a.seconds) ** (math.log(a.error() / error) / over if over > 0 else 0.0)
    return math.nan


class Tradeoff(sweep.Sweep):
    name, takes = 'tradeoff', '[GROUP|DIRECT,BOUNCE,INDIRECT ...]'
    takes_reference, reference_samples = True, 16384
    refused = ('quality', 'samples-direct', 'samples-bounce', 'samples-indirect', 'samples-probe', 'bounces', 'tail',
               'schedule', 'verify-fraction')

    # ---- settings ----

    def add_setting(self, group, samples, name=None, **more):
        direct, bounce, indirect = samples
        values = dict(quality=None, bounces=-1, density=1.0, preset=False, equal=False, raw=False)
        self.add(group=group, name=name or '%d %d %d' % (direct, bounce, indirect), direct=direct, bounce=bounce,
                 indirect=indirect, **{**values, **more})

    def add_presets(self, group):
        """The presets themselves, or with one thing changed; `reference` takes too long to be tried in many ways."""
        presets = self.given.table.qualities
        for index, q in enumerate(presets):
            name, samples = q['name'], [q['samples-' + kind] for kind in ('direct', 'bounce', 'indirect')]
            base = dict(quality=name, raw=name == 'reference')
            if group == 'presets':
                self.add_setting(group, samples, name, **base, preset=True)
            elif index + 1 == len(presets):
                break
            elif group == 'denoise':
                self.add_setting(group, samples, name + ', not denoised', quality=name, raw=True)
            elif group == 'schedule':
                self.add_setting(group, samples, name + ', equal', **base, equal=True)
            elif group == 'density':
                for density in (0.7071, 0.5):
                    self.add_setting(group, samples, '%s, density %.2g' % (name, density), **base, density=density)
            elif index + 2 == len(presets):  # where noise hides least what bounces leave out
                for bounces in (1, 2, 4):
                    self.add_setting(group, samples, '%s, %d bounce%s' % (name, bounces, 's' * (bounces > 1)), **base,
                                     bounces=bounces)

    def add_samples(self):
        """All products of samples, the quickest first."""
        presets = [[q['samples-' + kind] for kind in ('direct', 'bounce', 'indirect')]
                   for q in self.given.table.qualities]
        products = [[d, b, i] for d in (16, 64, 256, 1024) for b in (4, 16, 64) for i in (32, 128, 512, 2048)]
        lean = lambda p: 0.5 * p[0] + 7.0 * p[1] + p[2]
        for samples in sorted(products, key=lean):
            if samples not in presets:
                self.add_setting('samples', samples)

    def choose(self):
        for word in self.words:
            if word not in GROUPS and read_samples(word) is None:
                raise Failure(child.USAGE, "kiln bench tradeoff sweeps no '%s'; it sweeps: %s, and samples given as "
                                           "DIRECT,BOUNCE,INDIRECT, such as 32,4,64" % (word, ', '.join(GROUPS)))
            if word not in GROUPS:
                self.add_setting('given', read_samples(word))
        for group in GROUPS:
            if self.words and group not in self.words or group == 'density' and self.given.has('lightmap-size'):
                continue
            self.add_samples() if group == 'samples' else self.add_presets(group)
        if not self.settings:
            raise Failure(child.USAGE, 'density cannot be swept with --lightmap-size, which sets the size of every '
                                       'lightmap')

    def rays(self, s):
        # Bounces of the lean schedule have 3, 1.5, 1, 1/2, 1/2, 1/4 ... times the samples; a shadow ray is the cheaper
        # one.
        many = s.bounces if 0 <= s.bounces < 8 else 8.0
        lean = min(3.0 + 0.6 * many, 7.0)
        gathers = many * s.indirect if s.equal else lean * s.bounce + s.indirect
        return s.density * s.density * (0.5 * s.direct + gathers)

    def words_of(self, s, density):
        words = '--quality %s' % s.quality if s.preset else (
            '--samples-direct %d --samples-bounce %d --samples-indirect %d --schedule %s --denoise %s' % (
                s.direct, s.bounce, s.indirect, 'equal' if s.equal else 'lean', 'none' if s.raw else 'regression'))
        if s.bounces >= 0:
            words += ' --bounces %d' % s.bounces
        if s.density < 1:
            words += ' --texels-per-metre %.9g' % (s.density * density)
        return words

    def option_words(self, s):
        return self.words_of(s, self.density)

    def key(self, s):
        return '%s (%d %d %d, density %.6g)' % (self.words_of(s, 1.0), s.direct, s.bounce, s.indirect, s.density)

    def reference_words(self):
        """Many samples, and another seed."""
        samples = self.arguments.reference_samples
        child.tell(self.arguments.quiet, 'baking the reference, with %d rays in the final gather' % samples)
        return ['--samples-direct', '%.0f' % max(1, samples / 4), '--samples-bounce', '%.0f' % max(1, samples / 64),
                '--samples-indirect', samples, '--seed', int(self.given.value('seed')) + 1, '--denoise', 'none',
                '--error-map']

    # ---- results ----

    def judge(self):
        bakes = self.done()
        for _, result in bakes:
            result.front = not any(beats(other, result) for _, other in bakes)

    def csv(self):
        row = '%s,"%s",%s,%d,%d,%d,%s,%s,%s,%.9g,%.0f,%.0f,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.0f,%s\n'
        return CSV + ''.join(row % (
            s.group, s.name, self.option_words(s), s.direct, s.bounce, s.indirect,
            s.bounces if s.bounces >= 0 else 'all', 'equal' if s.equal else 'lean', 'no' if s.raw else 'yes',
            r.texels_per_metre, r.points, r.rays, r.error(0), r.error(1), r.error(2), r.seconds, r.light_seconds,
            r.processor_seconds, r.peak_bytes, 'yes' if r.front else 'no') for s, r in self.done())

    def figures(self):
        plot = figure.Plot('Error over time: %s' % self.scene, 'time of the whole process',
                           'nrmse against the reference', (' s', ' %'), (1.0, 100.0), legend=False)
        place = lambda one: (one[1].seconds, one[1].error())
        bakes = self.done()
        plot.line([place(one) for one in front_of(bakes)], 'front', dots=False)
        for color, named, chosen in (('#999999', False, lambda s, r: not r.front and not s.preset),
                                     ('#1f5fa8', True, lambda s, r: r.front and not s.preset),
                                     ('#c4451c', True, lambda s, r: s.preset)):
            some = [one for one in bakes if chosen(*one)]
            plot.dots([place(one) for one in some], color=color, labels=[s.name for s, _ in some] if named else ())
        plot.note('samples: direct, bounce, final gather; red: presets')
        return [('.svg', plot)]

    # ---- what is told ----

    def lines(self):
        for s in self.settings:
            yield '%-10s%-28s%s' % (s.group, s.name, self.option_words(s))
        yield '%d bakes, and the reference before them%s' % (
            len(self.settings), '' if self.given.has('texels-per-metre') else
            '; densities are relative to that of the reference')

    def choices(self, front):
        """For each round error that the front reaches, the quickest bake that has it."""
        last = None
        for most in (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1):
            best = next((one for one in front if one[1].error() <= most), None)
            if best is not None and best is not last:
                last = best
                yield "for an nrmse below %g %% choose '%s' (%s), which takes %.3g s" % (
                    100 * most, best[0].name, self.option_words(best[0]), best[1].seconds)

    def presets(self, front):
        others = [one for one in self.done() if not one[0].preset]
        for s, r in self.done():
            if not s.preset:
                continue
            needed = seconds_of_front(others, r.error())
            better = [other.name for other, o in front if o.seconds <= r.seconds and o.error() <= r.error()]
            if r.front:
                yield 'the preset %s is on the front' % s.name
            elif math.isfinite(needed):
                yield 'the preset %s takes %.0f %% more time than the front at its error (%.3g s, %.3g s)' % (
                    s.name, 100 * (r.seconds / needed - 1), r.seconds, needed)
            else:
                yield "the preset %s is off the front: '%s' takes no more time and has no more error" % (
                    s.name, better[0] if better else '')

    def reference_error(self):
        return float((self.report.get('error') or {}).get('mean_relative') or 0.0)

    def sentences(self, left):
        front = front_of(self.done())
        said = [self.left_sentence(left)] if left else []
        said += [*self.choices(front), *self.presets(front)]
        own = self.reference_error()
        if min((r.error() for _, r in self.done()), default=math.inf) < 3 * own:
            said.append('the reference states an error of %.3g %% of its own: what is measured below %.3g %% is partly '
                        'that; more --reference-samples make it less' % (100 * own, 300 * own))
        return said

    def row(self, s, r):
        return {'group': s.group, 'name': s.name, 'options': self.option_words(s), 'nrmse': r.error(0),
                'nrmse_direct': r.error(1), 'nrmse_indirect': r.error(2), 'seconds': r.seconds,
                'light_seconds': r.light_seconds, 'processor_seconds': r.processor_seconds, 'peak_bytes': r.peak_bytes,
                'front': r.front}

    def tell(self, left):
        said = self.sentences(left)
        if self.arguments.json:
            self.show_rows(left, self.row, reference_error=self.reference_error(), sentences=said)
            return
        print('%-28s%9s%9s%10s%11s%11s%10s' % ('front, by time', 'nrmse %', 'direct %', 'indirect %', 'seconds',
                                               'light s', 'MiB'))
        for s, r in front_of(self.done()):
            print('%-28s%9.3f%9.3f%10.3f%11.3f%11.3f%10.1f' % (
                s.name, 100 * r.error(0), 100 * r.error(1), 100 * r.error(2), r.seconds, r.light_seconds,
                r.peak_bytes / 2 ** 20))
        print('\n'.join([*said, self.files_line()]))


if __name__ == '__main__':
    child.main(lambda: Tradeoff(__doc__).run(), 'matplotlib')
