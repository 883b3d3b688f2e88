"""kiln bench crossover: a small run of the Cornell box, whose figures follow from one another; wrong input is refused.
"""
import csv
import json
import math
import os
import tempfile
import unittest

from kiln_cli import kiln

SCENE = os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../jobs/cornell.glb')
SMALL = ('--lightmap-size', 8, '--backend', 'embree', '--bounces', 1, '--samples-direct', 16, '--samples-bounce', 16,
         '--samples-indirect', 32, '--reference-samples', 128)


class Crossover(unittest.TestCase):
    def test_figures(self):
        with tempfile.TemporaryDirectory() as folder:
            out = os.path.join(folder, 'out')
            said = json.loads(kiln('bench', 'crossover', SCENE, *SMALL, '-o', out, '--json', timeout=200).out)
            with open(os.path.join(out, 'crossover.csv'), newline='') as file:
                rows = {(row['way'], row['paths']): row for row in csv.DictReader(file)}
            with open(os.path.join(out, 'views.csv'), newline='') as file:
                eyes = [[float(row['from.' + axis]) for axis in 'xyz'] for row in csv.DictReader(file)]
            self.assertTrue(os.path.getsize(os.path.join(out, 'crossover.svg')) > 1000)
        few, many, lightmaps = (rows[key] for key in (('path', '8'), ('path', '64'), ('lightmaps', '0')))
        # noise falls between by the root of the number and by the number itself
        self.assertTrue(0.35 < said['exponent'] < 1.0, said)
        self.assertAlmostEqual(math.log(float(few['error']) / float(many['error'])) / math.log(8), said['exponent'],
                               places=3)
        # the paths that have the bake's error have it by the formula
        wanted = float(few['error']) * (8 / said['paths']) ** said['exponent']
        self.assertTrue(said['paths'] == 1 or abs(wanted / float(lightmaps['error']) - 1) < 1e-3, (said, wanted))
        for k in (0, 1):
            bake, view, path = (said[name][k] for name in ('bake_seconds', 'view_seconds', 'path_seconds'))
            users = said['users' if k == 0 else 'users_by_the_clock']
            self.assertTrue(bake > 0 and view >= 0 and path > 0)
            if path > view:
                self.assertEqual(users, max(1, math.ceil(bake / (path - view))))
            else:
                self.assertIsNone(users)
        # eyes are apart, and inside the box
        self.assertEqual(len({tuple(eye) for eye in eyes}), 4)
        self.assertTrue(all(abs(x) < 10 for eye in eyes for x in eye), eyes)

    def test_refused(self):
        for arguments, words in (((), 'takes one scene'), ((SCENE, 'more'), 'takes one scene'),
                                 ((SCENE, '--reference-samples', 64), 'needs more than the 64 paths')):
            answer = kiln('bench', 'crossover', *arguments)
            self.assertEqual(answer.code, 64)
            self.assertIn(words, answer.sentence())


if __name__ == '__main__':
    unittest.main()
