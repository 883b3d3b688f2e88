"""kiln bench cell-size and kiln bench per-object: small sweeps of the Cornell box. Every bake has the reference's bits,
figures are those of the bakes, an interrupted sweep goes on, other bits are found, and wrong input is refused."""
import csv
import json
import os
import re
import shutil
import tempfile
import unittest

from kiln_cli import kiln

SCENE = os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../jobs/cornell.glb')
SMALL = ('--lightmap-size', 8, '--backend', 'embree', '--threads', 1, '--samples-direct', 8, '--samples-bounce', 4,
         '--samples-indirect', 16)
COUNTERS = ('cache_references', 'cache_misses', 'l1d_reads', 'l1d_read_misses')


def sweep(out, name, *arguments, scene=SCENE):
    return kiln('bench', name, scene, *arguments, *SMALL, '-o', out, timeout=120)


def rows_of(out, name):
    with open(os.path.join(out, f'{name}.csv'), newline='') as file:
        rows = list(csv.DictReader(file))
    return {row['name']: {key: value if key in ('name', 'options') + COUNTERS else float(value)
                          for key, value in row.items()} for row in rows}


class Order(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp()
        self.out = os.path.join(self.folder, 'out')

    def tearDown(self):
        shutil.rmtree(self.folder)

    def check_rows(self, rows, answer, runs):
        self.assertIn(f'in all {len(rows)} bakes every bit of the lightmaps is the reference\'s', answer.out)
        for row in rows.values():
            self.assertEqual((row['nrmse'], row['values_that_differ'], row['runs']), (0, 0, runs))
            self.assertLess(0, row['light_seconds_least'])
            self.assertLessEqual(row['light_seconds_least'], row['light_seconds'])
            self.assertLessEqual(row['light_seconds'], row['light_seconds_most'])
            self.assertLess(row['indirect_seconds'], row['light_seconds_most'])
            self.assertLess(row['light_seconds'], row['seconds'])
            self.assertGreater(row['processor_seconds'], 0)
            self.assertGreater(row['peak_bytes'], 1e6)
            counted = [float(row[name]) > 0 if row[name] else False for name in COUNTERS]
            self.assertTrue(all(counted) or 'cache misses were' in answer.out, answer.out)

    def test_sides(self):
        answer = sweep(self.out, 'cell-size', 2, '0.1', '--repeats', 2)
        self.assertEqual(answer.code, 0, answer.err)
        self.assertEqual(sorted(os.listdir(self.out)),
                         ['cell-size.csv', 'cell-size.json', 'cell-size.svg', 'reference'])
        self.assertEqual(re.findall('kiln: bake ([0-9] of [0-9]: [^;]*)', answer.err),
                         [f'{i + 1} of 6: {name}' for i, name in enumerate(['auto', '2 m', '0.1 m'] * 2)])
        rows = rows_of(self.out, 'cell-size')
        self.check_rows(rows, answer, 2)
        self.assertEqual([rows[name]['cell_size'] for name in ('2 m', '0.1 m')], [2, 0.1])
        self.assertLess(rows['2 m']['cells'], 0.1 * rows['0.1 m']['cells'], 'the side does nothing')
        self.assertEqual(len({row['rays'] for row in rows.values()}), 1)
        with open(os.path.join(self.out, 'cell-size.svg')) as file:
            plot = file.read()
        self.assertEqual(plot.count('<circle'), 6)
        for label in ('>2 m<', '>0.1 m<', '>auto<'):
            self.assertIn(label, plot)

        self.goes_on(rows)
        self.other_bits_are_found()

    def goes_on(self, before):
        """The same command does nothing more; more sides and repeats are added to what is there."""
        answer = sweep(self.out, 'cell-size', 2, '0.1', '--repeats', 2)
        self.assertEqual((answer.code, answer.err), (0, ''))
        self.assertEqual(rows_of(self.out, 'cell-size'), before)
        answer = sweep(self.out, 'cell-size', 2, '0.1', '0.5', '--repeats', 2, '--budget', 0.001, '--json')
        self.assertEqual(json.loads(answer.out)['left'], 2)
        answer = sweep(self.out, 'cell-size', 2, '0.5', '--repeats', 2, '--json')
        table = json.loads(answer.out)
        self.assertEqual((table['left'], [bake['name'] for bake in table['bakes']]), (0, ['auto', '2 m', '0.5 m']))
        self.assertEqual(answer.err.count('kiln: bake '), 2, answer.err)
        self.assertEqual(rows_of(self.out, 'cell-size')['2 m'], before['2 m'])
        answer = sweep(self.out, 'cell-size', 2, '--seed', 7)
        self.assertEqual(answer.code, 65)
        self.assertIn('with other options', answer.sentence())

    def other_bits_are_found(self):
        """With a reference of another seed."""
        reference = os.path.join(self.out, 'reference')
        shutil.rmtree(reference)
        answer = kiln('bake', SCENE, '-o', reference, *SMALL, '--samples-probe', 0, '--no-preview', '--no-export',
                      '--seed', 9)
        self.assertEqual(answer.code, 0, answer.err)
        answer = sweep(self.out, 'cell-size', 2, '--repeats', 3)
        self.assertEqual(answer.code, 70)
        self.assertIn('2 of 2 bakes differ from the reference', answer.sentence())
        self.assertRegex(answer.out, "'2 m' differs from the reference in [0-9]+ values")
        row = rows_of(self.out, 'cell-size')['2 m']
        self.assertGreater(row['nrmse'], 1e-4)
        self.assertGreater(row['values_that_differ'], 100)

    def test_orders(self):
        answer = sweep(self.out, 'per-object', '--ranks', '1,2', '--repeats', 1, '--cell-size', 0.1)
        self.assertEqual(answer.code, 0, answer.err)
        rows = rows_of(self.out, 'per-object')
        self.assertEqual(list(rows), ['cells, 1 rank', 'cells, 2 ranks', 'objects, 1 rank', 'objects, 2 ranks'])
        self.check_rows(rows, answer, 1)
        self.assertEqual([row['ranks'] for row in rows.values()], [1, 2, 1, 2])
        self.assertEqual(rows['cells, 1 rank']['point_imbalance'], 0)
        self.assertGreater(rows['objects, 2 ranks']['point_imbalance'], rows['cells, 2 ranks']['point_imbalance'])
        self.assertIn('share its memory', answer.out)
        self.assertIn('too few runs to tell them apart', answer.out)
        with open(os.path.join(self.out, 'per-object.svg')) as file:
            plot = file.read()
        self.assertEqual(plot.count('<circle'), 8)
        self.assertIn('>indirect, 2 ranks<', plot)

    def test_the_list(self):
        answer = kiln('bench', 'cell-size', SCENE, '0.25', '--list', '-o', self.out)
        self.assertEqual([line.split() for line in answer.out.splitlines()[:2]],
                         [['auto', '--cell-size', 'auto'], ['0.25', 'm', '--cell-size', '0.25']])
        answer = kiln('bench', 'cell-size', SCENE, '--list', '-o', self.out)
        self.assertEqual([line[:8].strip() for line in answer.out.splitlines()[:-1]],
                         ['auto / 8', 'auto / 4', 'auto / 2', 'auto', 'auto x 2', 'auto x 4', 'auto x 8'])
        self.assertIn('7 bakes, 5 times each', answer.out)
        answer = kiln('bench', 'per-object', SCENE, '--list', '--repeats', 3, '-o', self.out)
        self.assertIn('2 bakes, 3 times each', answer.out)
        self.assertFalse(os.path.exists(self.out))

    def test_wrong_input_is_refused(self):
        for code, words, name, arguments in (
                (64, "takes sides of a cell in metres", 'cell-size', ['small']),
                (64, "not '-1'", 'cell-size', ['--', '-1']),
                (64, "not '0'", 'cell-size', ['0']),
                (64, 'takes no --cell-size', 'cell-size', ['--cell-size', 1]),
                (64, 'takes no --partition', 'per-object', ['--partition', 'objects']),
                (64, 'takes no --reference', 'per-object', ['--reference', '/none']),
                (64, "nothing else, not '0.5'", 'per-object', ['0.5']),
                (64, "--ranks takes ascending numbers", 'per-object', ['--ranks', '2,1']),
                (64, 'at most 100 --repeats', 'per-object', ['--repeats', 101])):
            answer = kiln('bench', name, SCENE, '-o', self.out, *arguments)
            self.assertEqual(answer.code, code, answer.err)
            self.assertIn(words, answer.sentence())
            self.assertFalse(os.path.exists(self.out))
        answer = sweep(self.out, 'per-object', scene='/none.glb')
        self.assertEqual(answer.code, 66)
        self.assertIn('takes a scene', kiln('bench', 'per-object').sentence())


if __name__ == '__main__':
    unittest.main()
