"""kiln bench radiosity on the Cornell box: rows hold what the bakes say, DFPR is that of kiln compare, kept visibility
changes nothing, windows cost accuracy, the same command goes on, and wrong input is refused."""
import csv
import json
import os
import shutil
import sys
import tempfile
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
from kiln_cli import kiln  # noqa: E402

SCENE = os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../jobs/cornell.glb')
FEW = ('--backend', 'embree', '--threads', 1, '--reference-samples', 64)
GROUPS = ('mipmap', 'cache')


class RadiosityBench(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp()
        self.out = os.path.join(self.folder, 'out')

    def tearDown(self):
        shutil.rmtree(self.folder)

    def table(self, name):
        with open(os.path.join(self.out, name), newline='') as file:
            return list(csv.DictReader(file))

    def test_rows(self):
        command = ('bench', 'radiosity', SCENE, '12', '24', *GROUPS, *FEW, '-o', self.out)
        answer = kiln(*command, timeout=200)
        self.assertEqual(answer.code, 0, answer.err)
        rows = {row['name']: row for row in self.table('radiosity.csv')}
        self.assertEqual(len(rows), 10)
        points = {side: float(rows['%d pure' % side]['points']) for side in (12, 24)}
        self.assertTrue(0.7 * 24 ** 2 < points[24] < 1.5 * 24 ** 2, points)
        for side in (12, 24):
            pure, cache = rows['%d pure' % side], rows['%d cache' % side]
            self.assertEqual(float(pure['dfpr_8bit']), 0)
            self.assertEqual(float(cache['dfpr']), 0, 'kept visibility changes no light')
            self.assertEqual(cache['nrmse'], pure['nrmse'])
            self.assertGreater(float(pure['rays']), 1.2 * float(cache['rays']))
        wide = [float(rows['24 mipmap %d' % w]['dfpr_8bit']) for w in (2, 4, 8)]
        self.assertTrue(0 < wide[0] < wide[2], wide)
        asked = [float(rows['24 mipmap %d' % w]['rays']) for w in (2, 4, 8)]
        self.assertTrue(asked[0] > asked[1] > asked[2], asked)
        self.assertGreater(float(rows['12 pure']['nrmse']), float(rows['24 pure']['nrmse']), 'texels are larger')
        self.check_dfpr(rows)
        self.check_files()
        answer = kiln(*command, '--json', timeout=60)
        self.assertEqual(len(json.loads(answer.out)['bakes']), 10)
        self.assertNotIn('kiln: bake ', answer.err)

    def check_dfpr(self, rows):
        """That of a bake by the options that the row states."""
        row, bake = rows['24 mipmap 8'], os.path.join(self.folder, 'bake')
        answer = kiln('bake', SCENE, '-o', bake, *row['options'].split(), '--samples-probe', 0, '--no-preview',
                      '--no-export', '--backend', 'embree', '--threads', 1, timeout=60)
        self.assertEqual(answer.code, 0, answer.err)
        answer = kiln('compare', bake, os.path.join(self.out, 'pure-24'), '--json')
        found = json.loads(answer.out)
        self.assertAlmostEqual(found['dfpr_8bit'], float(row['dfpr_8bit']), 6)
        self.assertAlmostEqual(found['dfpr_unit'], float(row['dfpr']), 6)

    def check_files(self):
        with open(os.path.join(self.out, 'radiosity-figure-6.5.svg')) as file:
            self.assertEqual(file.read().count('<circle'), 2)
        with open(os.path.join(self.out, 'radiosity.svg')) as file:
            self.assertEqual(file.read().count('<circle'), 10 + len(GROUPS) + 1, 'a point each, and the legend')
        self.assertEqual([row['window'] for row in self.table('radiosity-table-6.1.csv')], ['1'])
        with open(os.path.join(self.out, 'radiosity.html')) as file:
            page = file.read()
        pictures = set(os.listdir(os.path.join(self.out, 'pictures')))
        self.assertEqual(len(pictures), 11 + 8 + 5, 'all, the reference, what differs from pure ones, and what is seen')
        self.check_seen()
        self.assertTrue(pictures.issuperset(part.split('"')[0] for part in page.split('src="pictures/')[1:]))

    def check_seen(self):
        rows = self.table('radiosity-figure-6.14.csv')
        self.assertEqual([row['voxels_along'] for row in rows], ['rays', '128', '64', '32', '16'])
        self.assertEqual(len({(row['facing'], row['seen_by_rays']) for row in rows}), 1)
        facing, seen = float(rows[0]['facing']), float(rows[0]['seen'])
        self.assertTrue(0.3 * facing < seen < facing, rows[0])
        wrong = [float(row['wrong_share']) for row in rows]
        self.assertTrue(wrong[0] == 0 and 0 < wrong[4] < 0.5 and max(wrong[1:3]) < wrong[4], wrong)

    def test_scenes(self):
        """Pure passes of other scenes, which are not compared with the reference."""
        command = ('bench', 'radiosity', SCENE, '8', 'scenes', *FEW, '-o', self.out)
        answer = kiln(*command, timeout=200)
        self.assertEqual(answer.code, 0, answer.err)
        rows = self.table('radiosity-figure-6.12.csv')
        self.assertEqual(len(rows), 7)
        self.assertEqual(rows[0]['scene'], 'cornell.glb')
        triangles = {row['scene']: float(row['triangles']) for row in rows}
        self.assertEqual(triangles['cornell'], triangles['cornell.glb'])
        self.assertTrue(140e3 < triangles['cornell-statue --triangles 150000'] < 160e3, triangles)
        for row in rows:
            pairs = float(row['texels']) ** 2
            self.assertAlmostEqual(float(row['pair_nanoseconds']), 1e9 * float(row['pass_seconds']) / pairs, 1)
        same = [[row[k] for k in ('triangles', 'texels', 'rays')] for row in rows[:2]]
        self.assertEqual(*same, 'the Cornell box given, and generated')
        with open(os.path.join(self.out, 'radiosity-figure-6.12.svg')) as file:
            self.assertEqual(file.read().count('<circle'), 2 * 7, 'a point each, and its name')
        self.assertEqual({row['nrmse'] for row in self.table('radiosity.csv') if row['method'] == 'scenes'}, {''})
        self.assertNotIn('kiln: bake ', kiln(*command, '--json', timeout=60).err)

    def test_refusals(self):
        for wrong in ('0', '9000', 'nothing', '8.5', '-3'):
            answer = kiln('bench', 'radiosity', SCENE, wrong, '--list')
            self.assertEqual(answer.code, 64, wrong)
        self.assertIn('twice', kiln('bench', 'radiosity', SCENE, '8', '8', '--list').err)
        self.assertIn('--method', kiln('bench', 'radiosity', SCENE, '--method', 'cells', '--list').err)
        answer = kiln('bench', 'radiosity', SCENE, '8', 'even', '--list')
        self.assertEqual(answer.out.count('--gather even'), 3)
        self.assertIn('4 bakes', answer.out)


if __name__ == '__main__':
    unittest.main()
