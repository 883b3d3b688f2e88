"""kiln bench converge: small views of a furnace and of glass, whose figures follow from one another; wrong input is
refused.
"""
import csv
import json
import math
import os
import tempfile
import unittest

from kiln_cli import kiln

SMALL = ('--width', 24, '--height', 18, '--backend', 'embree')
LAST = 4  # views that the gain is taken over


def bench(scene, out, *options):
    answer = kiln('bench', 'converge', scene, *options, '-o', out, '--json', '--quiet', timeout=200)
    assert answer.code == 0, answer.err
    with open(os.path.join(out, 'converge.csv'), newline='') as file:
        return json.loads(answer.out), list(csv.DictReader(file))


def slope(points):
    """Least squares of (x, y)."""
    x = sum(point[0] for point in points) / len(points)
    return sum((a - x) * b for a, b in points) / sum((a - x) ** 2 for a, b in points)


class Converge(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.furnace, cls.spheres = (os.path.join(cls.folder.name, name + '.glb') for name in
                                    ('furnace', 'cornell-spheres'))
        for scene in (cls.furnace, cls.spheres):
            kiln('generate', os.path.basename(scene)[:-4], '-o', scene)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def check_rows(self, said, rows, doublings):
        """The table and the JSON object say the same, and figures follow from the views."""
        last = [method['views'][-1]['seconds'] for method in said['methods'] if method['views']]
        self.assertEqual(said['equal_seconds'], min(last))
        for method in said['methods']:
            own = [row for row in rows if row['method'] == method['method']]
            if not method['views']:
                self.assertTrue(method['refused'] and own[0]['refused'] == method['refused'], method)
                continue
            self.assertIsNone(method['refused'])
            self.assertEqual([view['paths'] for view in method['views']], [2 ** k for k in range(doublings + 1)])
            for row, view in zip(own, method['views'], strict=True):
                self.assertEqual(int(row['paths']), view['paths'])
                for key in ('seconds', 'rays', 'rmse', 'nrmse', 'rel_rmse', 'picture_dissimilarity'):
                    self.assertAlmostEqual(float(row[key]), view[key], delta=1e-5 * view[key])
                self.assertTrue(view['rays'] > 0 and view['seconds'] > 0)
            points = [(math.log2(view['seconds']), view['picture_psnr']) for view in method['views'][-LAST:]]
            self.assertAlmostEqual(method['psnr_gain_per_doubled_time'], slope(points), places=6)
            reached = [view['picture_psnr'] >= 45 for view in method['views']]
            self.assertEqual(method['seconds_to_45_db'] is not None, any(reached))
            if min(last) == method['views'][-1]['seconds']:
                self.assertEqual(method['psnr_at_equal_time'], method['views'][-1]['picture_psnr'])

    def test_furnace(self):
        # seen from its middle; four times the paths halve the noise, and so does the sum of two halves of the reference
        out = os.path.join(self.folder.name, 'furnace')
        said, rows = bench(self.furnace, out, 'path', '--from=0,0,0.5', '--to=0,0,-1', '--doublings', 6,
                           '--reference-samples', 1024, *SMALL)
        self.check_rows(said, rows, 6)
        self.assertEqual([method['method'] for method in said['methods']], ['path'])
        views = said['methods'][0]['views']
        for few, many in zip(views[1:], views[3:]):
            self.assertTrue(1.4 < few['rmse'] / many['rmse'] < 2.8, views)
        self.assertEqual(said['reference_samples'], 1024)
        # 1024 paths have a 4th of the error of 64 paths; the view's error has both
        beside = said['reference_psnr'] - views[-1]['picture_psnr']
        self.assertTrue(9 < beside < 16, said)
        self.assertTrue(os.path.getsize(os.path.join(out, 'converge.svg')) > 1000)
        self.assertEqual(sorted(os.listdir(out)),
                         ['converge.csv', 'converge.svg', 'path-64.exr', 'reference.exr'])

    def test_path_length(self):
        # views have it: paths of one ray see emission alone, without noise
        said, _ = bench(self.furnace, os.path.join(self.folder.name, 'emission'), 'path', '--path-length', 1,
                        '--from=0.1,0.2,0.1', '--to=0.9,0.3,0.2', '--doublings', 1, '--reference-samples', 4, *SMALL)
        self.assertLess(said['methods'][0]['views'][0]['rmse'], 1e-6)

    def test_given_reference(self):
        # a view against itself differs by nothing
        first, again = (os.path.join(self.folder.name, name) for name in ('first', 'again'))
        options = ('--materials', 'auto', '--doublings', 1, *SMALL)
        said, rows = bench(self.spheres, first, *options)
        self.check_rows(said, rows, 1)
        reference = os.path.join(first, 'path-2.exr')
        said, _ = bench(self.spheres, again, 'path', '--reference', reference, *options[:4], '--backend', 'embree')
        views = said['methods'][0]['views']
        self.assertTrue(views[0]['rmse'] > 0 and views[0]['picture_psnr'] > 0)
        self.assertEqual((views[1]['rmse'], views[1]['picture_psnr'], views[1]['picture_dissimilarity']), (0, None, 0))
        self.assertEqual((said['reference'], said['reference_samples'], said['reference_psnr']),
                         (reference, None, None))
        # which the bench does not write over
        answer = kiln('bench', 'converge', self.spheres, '--reference', reference, '-o', first, *options)
        self.assertEqual(answer.code, 64)
        self.assertIn('which is read', answer.sentence())
        # nor does it take one of another size
        answer = kiln('bench', 'converge', self.spheres, '--reference', reference, '-o', again, '--width', 25)
        self.assertEqual(answer.code, 65)
        self.assertIn('it has 24 x 18 pixels', answer.sentence())

    def test_device(self):
        if not json.loads(kiln('info', '--devices', '--json').out)['vulkan']:
            self.skipTest('there is no Vulkan device')
        reference = os.path.join(self.folder.name, 'small.exr')
        kiln('view', self.spheres, '--method', 'path', '--backend', 'embree', '--width', 8, '--height', 6, '-o',
             reference)
        said, rows = bench(self.spheres, os.path.join(self.folder.name, 'device'), 'path', '--doublings', 1,
                           '--reference', reference, '--backend', 'vulkan')
        self.check_rows(said, rows, 1)
        self.assertEqual(said['methods'][0]['method'], 'path')

    def test_max_time(self):
        out = os.path.join(self.folder.name, 'short')
        said, _ = bench(self.spheres, out, 'path', '--max-time', 0.001, '--reference-samples', 2048, *SMALL)
        self.assertEqual(len(said['methods'][0]['views']), 1)

    def test_refused(self):
        spheres = self.spheres
        for arguments, words in (((), 'takes a scene'),
                                 ((spheres, 'lightmaps'), "by no method 'lightmaps'; there is: path"),
                                 ((spheres, '--reference-samples', 1024), 'needs more than the 1024 paths'),
                                 ((spheres, '--reference-samples', 9999, '--reference', 'a.exr'), 'leave one of'),
                                 ((spheres, '--camera', 'a,b'), 'name one camera'),
                                 ((spheres, '--texels-per-metre', 3), 'which have no such option'),
                                 ((spheres, '--doublings', 15), 'from 1 to 14')):
            answer = kiln('bench', 'converge', *arguments, folder=self.folder.name)
            self.assertEqual(answer.code, 64, answer.err)
            self.assertIn(words, answer.sentence())
        for option, value in (('--width', 24), ('--materials', 'full'), ('--path-length', 3)):
            answer = kiln('bench', 'rays', spheres, option, value)
            self.assertEqual(answer.code, 64)
            self.assertIn(option + ': of all benches only converge', answer.sentence())

    def test_no_method_draws_it(self):
        # the sentence of the view is the reason
        answer = kiln('bench', 'converge', self.spheres, 'path', '--camera', 'none', '--quiet', '-o',
                      os.path.join(self.folder.name, 'none'))
        self.assertEqual(answer.code, 64)
        self.assertIn("'none'", answer.sentence())


if __name__ == '__main__':
    unittest.main()
