"""Each study once, small, from `kiln bench NAME` to its files; what it refuses; that it goes on; and what is said where
Python, a module or the scripts are missing."""
import csv
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

import numpy as np

import studying
from studying import SCENE
from kiln_cli import KILN, kiln

sys.path.insert(0, os.path.join(studying.ROOT, 'tests/common'))
import harness  # noqa: E402
import price  # noqa: E402

SMALL = ('--lightmap-size', 8, '--backend', 'embree', '--threads', 1)
FEW = (*SMALL, '--samples-direct', 8, '--samples-bounce', 4, '--samples-indirect', 16)
NAMES = ('cell-size', 'converge', 'crossover', 'per-object', 'radiosity', 'stability', 'tracing-range', 'tradeoff')


def light(bake):
    """All light of a bake, with each texel's area, and 0 as the area of those that are buried."""
    values, areas = [], []
    points = bake.points
    for index in range(len(bake.names())):
        channels, _ = harness.read_exr(os.path.join(bake.directory, bake.run['objects'][index]['lightmap']))
        rgb = np.stack([channels[c] for c in 'RGB'], -1).astype(np.float64)
        area = np.zeros(rgb.shape[:2])
        here = points.object == index
        area[points.y[here], points.x[here]] = points.area[here]
        values.append(rgb.reshape(-1, 3))
        areas.append((area * (channels['validity.Y'] == 1)).ravel())
    return np.concatenate(values), np.concatenate(areas)


class Study(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp()
        self.out = os.path.join(self.folder, 'out')

    def tearDown(self):
        shutil.rmtree(self.folder)

    def bench(self, name, *words, code=0, out=None, timeout=200):
        answer = kiln('bench', name, *words, '-o', out or self.out, timeout=timeout)
        self.assertEqual(answer.code, code, answer.err)
        return answer

    def table(self, name, key='name'):
        with open(os.path.join(self.out, name + '.csv'), newline='') as file:
            return {row[key]: row for row in csv.DictReader(file)}

    def refuse(self, name, cases, scene=SCENE):
        for code, words, arguments in cases:
            answer = kiln('bench', name, scene, *arguments, '-o', self.out, folder=self.folder)
            self.assertEqual(answer.code, code, answer.err)
            self.assertIn(words, answer.sentence())
        self.assertFalse(os.path.exists(self.out))

    # ---- the start ----

    def test_help(self):
        text = kiln('bench', '--help').out
        for name in NAMES:
            self.assertRegex(text, r'(?m)^  %s +\w.{20,}$' % name)
            own = kiln('bench', name, '--help')
            self.assertEqual(own.code, 0, own.err)
            self.assertIn('usage: kiln bench ' + name, own.out)
            self.assertIn('Price: ', own.out)
        self.assertRegex(kiln('bench', 'tradeoff', '--help').out, r'--budget SECONDS +\w')
        self.assertIn('there are: rays, scaling, cell-size, ', kiln('bench', 'nothing').sentence())
        self.assertIn('give its name first', kiln('bench', '--json', 'tradeoff', SCENE).sentence())

    def start(self, **environment):
        done = subprocess.run([KILN, 'bench', 'tradeoff', SCENE, '--list', '--json'], capture_output=True, text=True,
                              env={**os.environ, **environment})
        return done.returncode, done.stderr, done.stdout

    def test_what_is_missing(self):
        code, said, printed = self.start(KILN_PYTHON='/none/python3')
        self.assertEqual((code, json.loads(printed)['code']), (78, 78))
        self.assertRegex(said, '(?s)/none/python3 cannot be started: install python3, .*KILN_PYTHON')
        code, said, _ = self.start(KILN_STUDIES='/none')
        self.assertEqual(code, 78)
        self.assertRegex(said, 'folder of the studies, /none, cannot be read: .*KILN_STUDIES')
        bare = os.path.join(self.folder, 'python3')  # sees none of Debian's modules
        with open(bare, 'w') as file:
            file.write('#!/bin/sh\nexec %s -S "$@"\n' % sys.executable)
        os.chmod(bare, 0o755)
        code, said, printed = self.start(KILN_PYTHON=bare)
        self.assertEqual((code, json.loads(printed)['code']), (78, 78), said)
        self.assertRegex(said, "kiln: error: the study needs Python's numpy, which .* lacks: install python3-numpy")

    def test_an_installed_program(self):
        """An installed program finds its studies beside itself, and not where somebody has built it."""
        for name in ('bin', 'share/kiln'):
            os.makedirs(os.path.join(self.folder, name))
        program = os.path.join(self.folder, 'bin/kiln')
        shutil.copy(KILN, program)
        run = lambda: subprocess.run([program, 'bench', 'per-object', SCENE, '--list'], capture_output=True, text=True)
        self.assertEqual(run().returncode, 78)
        shutil.copytree(studying.STUDIES, os.path.join(self.folder, 'share/kiln/studies'))
        self.assertIn('2 bakes, 5 times each', run().stdout)

    def test_what_all_refuse(self):
        self.refuse('tradeoff', (
            (64, 'has no option --texels-per-meter, but --texels-per-metre', ['--texels-per-meter', 3]),
            (64, '--budget: 0 is not from 0.001', ['--budget', 0]),
            (64, '--seed needs a value', ['--seed', '--json']),
            (64, "the bake 'reference' failed with 64: --lightmap-size", ['--lightmap-size', -1])))
        self.refuse('tradeoff', ((66, 'cannot read scene /none.glb', []),), '/none.glb')
        self.refuse('tradeoff', ((65, 'is a folder', []),), self.folder)
        for name in NAMES:
            if name != 'stability':
                self.assertIn('takes', kiln('bench', name).sentence())
        broken = os.path.join(self.folder, 'broken.glb')
        with open(broken, 'w') as file:
            file.write('glTF')
        answer = self.bench('tradeoff', broken, code=65)
        self.assertRegex(answer.sentence(), "the bake 'reference' failed with 65: .*broken.glb")

    # ---- sweeps ----

    def test_tradeoff(self):
        words = (SCENE, 'denoise', *SMALL, '--reference-samples', 2048)
        answer = self.bench('tradeoff', *words, '--budget', 0.001)
        self.assertIn('of 3 bakes are left', answer.out)
        answer = self.bench('tradeoff', *words)
        self.assertNotIn('reference', answer.err)
        self.assertEqual(sorted(os.listdir(self.out)), ['reference', 'tradeoff.csv', 'tradeoff.json', 'tradeoff.svg'])
        rows = self.table('tradeoff')
        errors = [float(rows[name + ', not denoised']['nrmse']) for name in ('draft', 'preview', 'production')]
        self.assertTrue(errors[0] > errors[1] > errors[2] > 0, errors)
        self.assertIn('for an nrmse below ', answer.out)
        self.check_error(rows['draft, not denoised'])
        answer = self.bench('tradeoff', *words, '--json')
        self.assertEqual((answer.err, len(json.loads(answer.out)['bakes'])), ('', 3))
        self.assertIn('with other options', self.bench('tradeoff', *words, '--seed', 5, code=65).sentence())
        self.check_reference_of_another_density()

    def check_error(self, row):
        """The error is what numpy finds."""
        directory = os.path.join(self.folder, 'same')
        answer = kiln('bake', SCENE, '-o', directory, *SMALL, '--samples-probe', 0, '--no-preview', '--no-export',
                      *row['options'].split())
        self.assertEqual(answer.code, 0, answer.err)
        (value, area), (best, area_of_best) = (light(harness.Bake(path))
                                               for path in (directory, os.path.join(self.out, 'reference')))
        weight = np.where(area > 0, area_of_best, 0)[:, None]
        error = np.sqrt((weight * (value - best) ** 2).sum() / (3 * weight.sum())) / \
            ((weight * best).sum() / (3 * weight.sum()))
        self.assertAlmostEqual(float(row['nrmse']) / error, 1, delta=0.02)

    def check_reference_of_another_density(self):
        """Coarser texels have an error of their own. A reference of another scene is refused."""
        fine, reference = self.table('tradeoff'), os.path.join(self.out, 'reference')
        self.out = os.path.join(self.folder, 'coarse')
        words = ('denoise', '--reference', reference, '--lightmap-size', 3, *SMALL[2:])
        self.bench('tradeoff', SCENE, *words)
        coarse = float(self.table('tradeoff')['production, not denoised']['nrmse'])
        self.assertTrue(2 * float(fine['production, not denoised']['nrmse']) < coarse < 1)
        furnace = os.path.join(self.folder, 'furnace.glb')
        self.assertEqual(kiln('generate', 'furnace', '-o', furnace).code, 0)
        self.assertIn('another scene', self.bench('tradeoff', furnace, *words, code=65,
                                                  out=os.path.join(self.folder, 'other')).sentence())

    def test_tradeoff_refuses(self):
        self.refuse('tradeoff', (
            (64, 'it sweeps: presets, denoise', ['guessed']), (64, "sweeps no '32,0,64'", ['32,0,64']),
            (64, 'takes no --samples-direct', ['--samples-direct', 8]),
            (64, 'density cannot be swept', ['density', '--lightmap-size', 8]),
            (66, "the reference '/none' cannot be read", ['--reference', '/none'])))
        lines = kiln('bench', 'tradeoff', SCENE, '--list').out.splitlines()
        self.assertEqual((lines[-1][:8], len(set(lines)), len(lines)), ('65 bakes', 66, 66))

    def test_cell_size(self):
        words = (SCENE, 2, '0.1', *FEW, '--repeats', 2)
        answer = self.bench('cell-size', *words)
        self.assertEqual(re.findall('kiln: bake ([0-9] of [0-9]: [^;]*)', answer.err),
                         [f'{i + 1} of 6: {name}' for i, name in enumerate(['auto', '2 m', '0.1 m'] * 2)])
        rows = self.table('cell-size')
        self.assertEqual([(float(rows[n]['cell_size']), rows[n]['runs']) for n in ('2 m', '0.1 m')],
                         [(2, '2'), (0.1, '2')])
        self.assertLess(float(rows['2 m']['cells']), 0.1 * float(rows['0.1 m']['cells']), 'the side does nothing')
        reference = os.path.join(self.out, 'reference')  # of another seed: other bits are found
        shutil.rmtree(reference)
        kiln('bake', SCENE, '-o', reference, *FEW, '--samples-probe', 0, '--no-preview', '--no-export', '--seed', 9)
        answer = self.bench('cell-size', SCENE, 2, *FEW, '--repeats', 3, code=70)
        self.assertIn('2 of 2 bakes differ from the reference', answer.sentence())
        self.assertGreater(float(self.table('cell-size')['2 m']['values_that_differ']), 100)

    def test_per_object(self):
        self.bench('per-object', SCENE, *FEW, '--ranks', '1,2', '--repeats', 1, '--cell-size', 0.1)
        rows = self.table('per-object')
        self.assertEqual(list(rows), ['cells, 1 rank', 'cells, 2 ranks', 'objects, 1 rank', 'objects, 2 ranks'])
        self.assertGreater(float(rows['objects, 2 ranks']['point_imbalance']),
                           float(rows['cells, 2 ranks']['point_imbalance']))

    def test_order_refuses(self):
        self.refuse('cell-size', ((64, 'takes sides of a cell in metres', ['small']), (64, "not '-1'", ['--', '-1']),
                                  (64, "not '0'", ['0']), (64, 'takes no --cell-size', ['--cell-size', 1])))
        self.refuse('per-object', ((64, 'takes no --reference', ['--reference', '/none']),
                                   (64, "nothing else, not '0.5'", ['0.5']),
                                   (64, '--ranks takes ascending numbers', ['--ranks', '2,1']),
                                   (64, 'at most 100 --repeats', ['--repeats', 101])))

    def test_tracing_range(self):
        words = (SCENE, '4', *FEW, '--bounces', 1, '--samples-radiance-probe', 1)
        self.bench('tracing-range', *words)
        rows = self.table('tracing-range')
        self.assertEqual((len(rows), rows['inf']['nrmse'], rows['inf']['probes']), (6, '0', '0'))
        probes = [float(rows['4, 1/%d, sh' % n]['probes']) for n in (8, 16, 32)]
        self.assertTrue(3 * probes[0] < probes[1] < probes[2] / 3, probes)
        self.refuse_ranges()

    def refuse_ranges(self):
        for words in (['far'], ['--tracing-range', 1]):
            self.assertEqual(kiln('bench', 'tracing-range', SCENE, *words).code, 64)

    def test_radiosity(self):
        words = (SCENE, '12', 'cache', '--backend', 'embree', '--threads', 1, '--reference-samples', 16)
        self.bench('radiosity', *words)
        rows = self.table('radiosity')
        self.assertEqual(float(rows['12 cache']['dfpr']), 0, 'kept visibility changes no light')
        self.assertEqual(rows['12 cache']['nrmse'], rows['12 pure']['nrmse'])
        self.assertTrue(0.7 * 12 ** 2 < float(rows['12 pure']['points']) < 1.5 * 12 ** 2)
        with open(os.path.join(self.out, 'radiosity.html')) as file:
            named = set(re.findall('src="([^"]*)"', file.read()))
        self.assertEqual([name for name in named if not os.path.exists(os.path.join(self.out, name))], [])
        self.assertEqual(len(os.listdir(os.path.join(self.out, 'pictures'))), 1 + 2 + 1 + 5)
        self.assertNotIn('kiln: bake ', self.bench('radiosity', *words).err)
        for wrong in ('0', '9000', 'nothing', '8.5', '-3'):
            self.assertEqual(kiln('bench', 'radiosity', SCENE, wrong, '--list').code, 64, wrong)
        self.assertIn('twice', kiln('bench', 'radiosity', SCENE, '8', '8', '--list').err)

    # ---- the others ----

    def test_converge(self):
        size = ('--width', 24, '--height', 18, '--backend', 'embree', '--doublings', 2)
        said = json.loads(self.bench('converge', SCENE, 'path', 'vcm', *size, '--json', '--quiet').out)
        self.assertEqual(sorted(os.listdir(self.out)),
                         ['converge.csv', 'converge.svg', 'path-4.exr', 'reference.exr', 'vcm-4.exr'])
        self.assertEqual((said['reference_samples'], [len(m['views']) for m in said['methods']]), (256, [3, 3]))
        views = said['methods'][0]['views']
        self.assertTrue(all(a['rmse'] > b['rmse'] for a, b in zip(views, views[1:])), views)
        self.assertGreater(said['reference_psnr'], views[-1]['picture_psnr'])
        given = os.path.join(self.out, 'path-2.exr')
        os.rename(os.path.join(self.out, 'path-4.exr'), given)
        again = json.loads(self.bench('converge', SCENE, 'path', '--reference', given, *size[4:], '--json',
                                      out=os.path.join(self.folder, 'again')).out)
        self.assertEqual((again['methods'][0]['views'][-1]['rmse'], again['reference_psnr']), (0, None))
        self.assertIn('which is read', self.bench('converge', SCENE, 'path', '--reference', given, *size[4:],
                                                  code=64).sentence())
        self.assertIn('24 x 18 pixels', self.bench('converge', SCENE, '--reference', given, '--width', 25,
                                                   code=65).sentence())
        self.assertIn("'none'", self.bench('converge', SCENE, 'path', '--camera', 'none', code=64).sentence())

    def test_converge_refuses(self):
        self.refuse('converge', (
            (64, "by no method 'lightmaps'; there is: path", ['lightmaps']),
            (64, 'name one camera', ['--camera', 'a,b']),
            (64, 'needs more than the 1024 paths', ['--reference-samples', 1024]),
            (64, 'leave one of', ['--reference-samples', 9999, '--reference', 'a.exr']),
            (64, 'has no option --texels-per-metre', ['--texels-per-metre', 3]),
            (64, 'is not from 1 to 14', ['--doublings', 15])))
        self.assertEqual(kiln('bench', 'converge', SCENE, 'path', '--doublings', 1, '--list').out,
                         '--method path --samples-pixel 1\n--method path --samples-pixel 2\n')

    def test_crossover(self):
        """Stopped, it goes on with what is done; and its figures follow from one another."""
        words = (SCENE, *SMALL[:4], '--bounces', 1, '--samples-direct', 16, '--samples-bounce', 16,
                 '--samples-indirect', 32, '--reference-samples', 65, '--json')
        first = subprocess.Popen([KILN, 'bench', 'crossover', *map(str, words), '-o', self.out], text=True,
                                 stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.assertTrue(any('with 65 paths' in line for line in iter(first.stderr.readline, '')))
        first.send_signal(signal.SIGINT)
        printed, _ = first.communicate(timeout=60)
        self.assertEqual((first.returncode, json.loads(printed)['status']), (75, 'stopped'))
        answer = self.bench('crossover', *words)
        self.assertNotIn('the bake', answer.err)
        said, rows = json.loads(answer.out), self.table('crossover', 'paths')
        self.assertAlmostEqual(math.log(float(rows['8']['error']) / float(rows['64']['error'])) / math.log(8),
                               said['exponent'], places=3)
        bake, view, path = (said[name][0] for name in ('bake_seconds', 'view_seconds', 'path_seconds'))
        self.assertEqual(said['users'], max(1, math.ceil(bake / (path - view))) if path > view else None)
        with open(os.path.join(self.out, 'views.csv'), newline='') as file:
            self.assertEqual(len({tuple(row.values()) for row in csv.DictReader(file)}), 4)
        self.assertIn('other options', self.bench('crossover', *words, '--seed', 8, code=65).sentence())
        self.assertIn('needs more than the 64 paths', kiln('bench', 'crossover', SCENE, '--reference-samples',
                                                           64).sentence())

    def test_places(self):
        """kiln view --places writes nothing but a path of cameras."""
        answer = kiln('bake', SCENE, '-o', self.out, *SMALL, '--samples-probe', 0, '--no-preview', '--quiet')
        self.assertEqual(answer.code, 0, answer.err)
        path = os.path.join(self.folder, 'places.csv')
        self.assertEqual(kiln('view', self.out, '--places', 2, '-o', path).code, 0)
        with open(path) as file:
            self.assertEqual(len(file.read().splitlines()), 3)
        self.assertIn('-o FILE.csv', kiln('view', self.out, '--places', 2, '-o', path[:-3] + 'png').sentence())

    def test_stability(self):
        run = lambda *words: kiln('bench', 'stability', *words, '--json', timeout=200)
        answer = run('half-floats', 'not-a-number', 'mirror', '--backend', 'embree', '--samples-direct', 512,
                     '--samples-indirect', 64, '--schedule', 'equal')
        self.assertEqual(answer.code, 0, answer.out)
        self.assertEqual([row['holds'] for row in json.loads(answer.out)['rows']], [True] * 6)
        answer = run('mirror', '--samples-direct', 1)
        self.assertEqual(answer.code, 70)
        self.assertEqual(json.loads(answer.out)['rows_that_do_not_hold'], 2)
        self.assertIn('slivers', kiln('bench', 'stability', 'silvers').sentence())

    @price.long
    def test_the_whole_table_holds(self):
        answer = kiln('bench', 'stability', '--backend', 'embree', '--json', timeout=900)
        self.assertEqual(answer.code, 0, answer.out)
        self.assertGreater(json.loads(answer.out)['rows_tried'], 50)


if __name__ == '__main__':
    unittest.main()
