"""Tables, advice and figures that studies make of results, held against records of real runs and known values."""
import contextlib
import errno
import io
import math
import os
import re
import subprocess
import sys
import tempfile
import unittest

import numpy as np

import studying
import converge
import crossover
import tradeoff
from study import child, counters, exr, folder, order, sweep


def printed(study, left=0):
    """The lines that a study prints, without those that hang on this machine's counters."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        study.tell(left)
    return without_counters(text.getvalue())


def without_counters(text):
    return [line for line in text.splitlines() if 'cache misses were' not in line and 'were not counted' not in line]


class Recorded(unittest.TestCase):
    """Tables, advice and what is printed are as they were."""

    def check(self, name):
        study, record = studying.recorded(name)
        if name == 'tracing_range':
            study.side = 5.5920000076293945
        tables = {study.name + ending: text for ending, text in [('.csv', study.csv()), *study.texts()]
                  if ending.endswith('.csv')}
        self.assertEqual(tables.keys(), record['files'].keys())
        for file, text in tables.items():
            self.assertEqual(text, record['files'][file], file)
        self.assertEqual(printed(study), without_counters(record['text']))
        return study

    def test_tradeoff(self):
        study = self.check('tradeoff')
        front = [s.name for s, _ in tradeoff.front_of(study.done())]
        self.assertEqual(front, [s.name for s, r in sorted(study.done(), key=lambda one: one[1].seconds) if r.front])
        study.arguments.budget = 60
        self.assertRegex(printed(study, 2)[len(front) + 1], '^2 of 11 bakes are left, for the budget of 60 s is used')

    def test_a_preset_off_the_front(self):
        study, _ = studying.recorded('tradeoff')
        slow = next(r for s, r in study.done() if s.name == 'draft')
        slow.runs[0][sweep.WHOLE] = 100.0
        study.judge()
        said = [line for line in study.sentences(0) if 'the preset draft' in line]
        self.assertRegex(said[0], 'takes [0-9]+ % more time than the front|is off the front: ')
        name = re.search("front: '(.*)' takes", said[0])
        if name:
            better = next(r for s, r in study.done() if s.name == name.group(1))
            self.assertTrue(better.seconds <= slow.seconds and better.error() <= slow.error())

    def test_cell_size(self):
        study = self.check('cell_size')
        result = study.results[0]
        result.values['differing'] = 17.0
        with self.assertRaises(child.Failure) as caught:
            printed(study)
        self.assertEqual((caught.exception.code, caught.exception.sentence), (
            child.BUG, '1 of 8 bakes differ from the reference, which must have the same bits'))

    def test_certainty(self):
        runs = lambda *seconds: sweep.Result({'runs': [[0, t, 0, 0, 0] for t in seconds]})
        self.assertIn('do not overlap', order.Order.certainty(runs(1, 2, 3, 4), runs(5, 6, 7, 8)))
        self.assertIn('runs overlap', order.Order.certainty(runs(1, 2, 3, 5), runs(4, 6, 7, 8)))
        self.assertIn('too few', order.Order.certainty(runs(1, 2, 3), runs(5, 6, 7, 8)))

    def test_per_object(self):
        self.check('per_object')

    def test_tracing_range(self):
        self.check('tracing_range')

    def test_radiosity(self):
        study = self.check('radiosity')
        page = study.page()
        for name, _ in study.figures():
            self.assertIn('src="radiosity%s"' % name, page)
        self.assertEqual(page.count('src="pictures/'), len(set(re.findall('src="(pictures/[^"]*)"', page))) + 5,
                         'pure and random ones of the largest size stand twice')

    def test_figures(self):
        """Each result is a mark on its figure; text stays text."""
        for name, marks, text in (('tradeoff', 11, 'nrmse against the reference'), ('tracing_range', 10, 'sh, 1/32'),
                                  ('cell_size', 8, 'auto / 8'), ('per_object', 4, 'indirect, 2 ranks')):
            study, _ = studying.recorded(name)
            study.side = 5.592
            picture = dict(study.figures())['.svg'].svg()
            self.assertGreaterEqual(picture.count('<use '), marks, name)
            self.assertIn(text, picture)

    def test_prediction(self):
        """Seconds as a line over rays."""
        study, _ = studying.recorded('tradeoff')
        for s, r in study.done():
            r.runs[0][sweep.WHOLE] = 3 + 0.001 * study.rays(s)
        asked = sweep.Setting(density=1.0, direct=100, bounce=10, indirect=1000, bounces=-1, equal=False)
        self.assertAlmostEqual(study._predict(asked), 3 + 0.001 * study.rays(asked), places=6)


class Converge(unittest.TestCase):
    @staticmethod
    def method(*views):
        made = converge.Method('path')
        for n, (seconds, psnr) in enumerate(views):
            made.views.append(converge.View(1 << n, seconds, 100))
            made.views[-1].psnr = psnr
        return made

    def test_what_views_say(self):
        made = self.method((1, 30), (2, 36), (4, 42), (8, 48))
        self.assertAlmostEqual(made.gain(), 6)
        self.assertAlmostEqual(made.psnr_at(2 * math.sqrt(2)), 39)
        self.assertTrue(math.isnan(made.psnr_at(0.5)))
        self.assertEqual(made.psnr_at(100), 48)
        seconds, at_most = made.seconds_to_level()
        self.assertAlmostEqual(seconds, 4 * math.sqrt(2))
        self.assertFalse(at_most)
        self.assertEqual(self.method((1, 50), (2, 51)).seconds_to_level(), (1, True))
        self.assertTrue(math.isnan(self.method((1, 30)).seconds_to_level()[0]))
        self.assertTrue(math.isnan(self.method((1, 30), (2, math.inf)).gain()))


class Crossover(unittest.TestCase):
    def test_fit(self):
        """Errors C n^-p give C and p back, whatever the reference's own error."""
        few, many, maps = crossover.Way(8), crossover.Way(64), crossover.Way(0)
        factor, power = 0.3, 0.5
        own = factor * 1024 ** -power
        for way in (few, many):
            way.distance = math.hypot(factor * way.samples ** -power, own)
        maps.distance = math.hypot(0.02, own)
        exponent, found, reference, paths = crossover.fit(few, many, maps, 1024)
        for got, want in ((exponent, power), (found, factor), (reference, own), (paths, (factor / 0.02) ** 2)):
            self.assertAlmostEqual(got / want, 1, places=6)
        many.distance = few.distance
        with self.assertRaises(child.Failure):
            crossover.fit(few, many, maps, 1024)

    def test_users(self):
        self.assertEqual(crossover.users_of(10, 1, 3.5), 4)
        self.assertEqual(crossover.users_of(10, 3, 2), math.inf)

    def test_difference(self):
        """A view against itself; and one twice as bright, whose t are 0.18 and 0.36 over one more."""
        grey = np.full((4, 5, 3), 2.0, np.float32)
        self.assertEqual(crossover.difference(grey, grey)[0], 0)
        shown, pixels = crossover.difference(2 * grey, grey)[:2]
        self.assertAlmostEqual(math.sqrt(shown / pixels), 0.36 / 1.36 - 0.18 / 1.18, places=6)


class Files(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.path = os.path.join(self.folder.name, 'out')

    def tearDown(self):
        self.folder.cleanup()

    def open(self):
        return folder.Folder(self.path, 'tradeoff', ['tradeoff.csv'])

    def test_it_is_marked_while_it_is_not_finished(self):
        with self.assertRaises(ZeroDivisionError), self.open():
            folder.publish(os.path.join(self.path, 'tradeoff.csv'), 'x')
            1 / 0
        self.assertEqual(sorted(os.listdir(self.path)), ['.kiln.unfinished', 'tradeoff.csv'])
        with open(os.path.join(self.path, '.half.part'), 'w'):
            pass
        with self.open():
            self.assertIn(folder.LOCK, os.listdir(self.path))
        self.assertEqual(os.listdir(self.path), ['tradeoff.csv'])

    def test_what_others_have_is_left_alone(self):
        os.mkdir(self.path)
        with open(os.path.join(self.path, 'mine'), 'w'):
            pass
        with self.assertRaisesRegex(child.Failure, 'has other files in it'), self.open():
            pass
        self.assertEqual(os.listdir(self.path), ['mine'])

    def test_two_at_a_time(self):
        """Also one of another process, and one of kiln."""
        with self.open():
            again = subprocess.run([sys.executable, '-c', 'import sys; sys.path.insert(0, %r)\n'
                                    'from study import folder\n'
                                    'with folder.Folder(%r, "tradeoff", []): pass' % (studying.STUDIES, self.path)],
                                   capture_output=True, text=True)
            self.assertRegex(again.stderr, 'at work in .*process %d on ' % os.getpid())
            mixed = child.run([os.environ['KILN'], 'bench', 'scaling', studying.SCENE, '-o', self.path])
            self.assertEqual(mixed.code, child.CANNOT_CREATE, mixed.said)
            self.assertIn('process %d' % os.getpid(), mixed.said)

    def test_what_is_kept(self):
        os.mkdir(self.path)
        make = lambda identity, resume=True: folder.Kept(self.path, 'tradeoff', identity, resume, {'results': {}})
        kept = make({'a': 1})
        kept.values['results']['x'] = [1.5, None]
        kept.write()
        self.assertEqual(make({'a': 1}).values['results'], {'x': [1.5, None]})
        self.assertEqual(make({'a': 2}, False).values['results'], {})
        with self.assertRaisesRegex(child.Failure, 'with other options'):
            make({'a': 2})
        with open(os.path.join(self.path, 'tradeoff.json'), 'r+') as file:
            file.seek(20)
            file.write('7')
        with self.assertRaisesRegex(child.Failure, 'is damaged'):
            make({'a': 1})

    def test_exr(self):
        """Files that are written are read again, packed or not."""
        random = np.random.default_rng(1)
        for name in exr.COMPRESSIONS:
            path = os.path.join(self.folder.name, 'a.exr')
            image = {c: random.random((37, 20), np.float32) for c in 'RGB'}
            exr.write(path, image, compression=name, attributes={'kiln:quantity': 'radiance'})
            found, attributes = exr.read(path)
            self.assertTrue(all((found[c] == image[c]).all() for c in 'RGB'))
            self.assertEqual(attributes['kiln:quantity'], 'radiance')


class Counters(unittest.TestCase):
    BUSY = 'import time\nwhile time.process_time() < %g: pass'

    def test_children_are_counted(self):
        """Also a child of a child, as the ranks that mpirun starts."""
        counted = counters.Counters([counters.TASK_CLOCK])
        try:
            if counted.why in (errno.EACCES, errno.EPERM, errno.ENOSYS):
                self.skipTest('this system does not permit it')
            self.assertEqual(counted.why, 0)
            subprocess.run([sys.executable, '-S', '-c', self.BUSY % 0.1], check=True)
            first = counted.read()[0]
            inner = 'import subprocess, sys\nsubprocess.run([sys.executable, "-S", "-c", %r])' % (self.BUSY % 0.2)
            subprocess.run([sys.executable, '-S', '-c', inner], check=True)
            second = counted.read()[0]
        finally:
            counted.close()
        self.assertTrue(0.09e9 < first < 0.2e9, first)  # ns
        self.assertTrue(0.18e9 < second - first < 0.4e9, second - first)

    def test_what_cannot_be_counted(self):
        counted = counters.Counters([(1, 0xffff)])
        self.assertNotEqual(counted.why, 0)
        self.assertTrue(math.isnan(counted.read()[0]))
        counted.close()
        for why, words in ((errno.EACCES, 'kernel.perf_event_paranoid'), (errno.ENOENT, 'virtual machine'),
                           (errno.ENOSYS, 'container'), (errno.EMFILE, 'too many open files')):
            self.assertIn(words, counters.remedy(why))


if __name__ == '__main__':
    unittest.main()
