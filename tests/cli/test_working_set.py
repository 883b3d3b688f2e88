"""kiln plan --tracing-range: what of the scene a rank needs whose rays end at a range. The working set grows with the
range, each rank's own is told, and wrong input is refused."""
import json
import os
import shutil
import sys
import tempfile
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
from kiln_cli import kiln  # noqa: E402

SCENE = os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../jobs/cornell.glb')


class WorkingSet(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp()

    def tearDown(self):
        shutil.rmtree(self.folder)

    def test_plan(self):
        sets = []
        few = ('--ranks', 4, '--texels-per-metre', 4, '--cell-size', 0.5, '--backend', 'embree', '--json')
        for reach in (0, 1, 100):
            answer = kiln('plan', SCENE, *few, '--tracing-range', reach, timeout=100)
            self.assertEqual(answer.code, 0, answer.err)
            plan = json.loads(answer.out)
            sets.append(plan['working_set'])
            self.check_ranks(plan['working_set'])
            own = [r['own_points'] for r in plan['working_set']['ranks']]
            self.assertEqual((min(own), max(own), sum(own)), (plan['points_min'], plan['points_max'], plan['points']))
        self.assertLessEqual(sets[0]['points_mean'], sets[1]['points_mean'])
        self.assertLess(sets[0]['points_mean'], 0.7 * sets[2]['points_mean'])
        self.assertEqual((sets[2]['points_most'], sets[2]['triangles_most']), (plan['points'], plan['triangles']))
        answer = kiln('plan', SCENE, *few, timeout=100)
        self.assertNotIn('working_set', json.loads(answer.out))

    def check_ranks(self, found):
        """Each rank's own working set: what is told of all follows from these."""
        ranks = found['ranks']
        self.assertEqual([r['rank'] for r in ranks], [0, 1, 2, 3])
        for name in ('triangles', 'points', 'radiance_probes', 'bytes'):
            values = [r[name] for r in ranks]
            self.assertEqual(max(values), found[name + '_most'])
            self.assertAlmostEqual(sum(values) / 4, found[name + '_mean'], delta=1e-9 * max(values))
            self.assertGreater(min(values), 0)
        self.assertLessEqual(found['radiance_probes_most'], found['radiance_probes'])

    def test_plan_of_each_rank(self):
        """In a row of closed rooms, far apart, a rank reaches its own rooms alone, and they differ; told as text for 16
        ranks, not for 17."""
        row = os.path.join(self.folder, 'row.glb')
        scene = glb.Scene()
        grey = scene.material('grey', (0.5, 0.5, 0.5))
        for i in range(4):
            x = 10 * i
            glb.box(scene, 'room %d' % i, (x, 0, 0), (x + 2, 2, 2), grey, range(6))
            for k in range(3 * i):
                glb.box(scene, 'box %d %d' % (i, k), (x + 0.1 + 0.2 * k, 0.1, 0.1), (x + 0.2 + 0.2 * k, 0.2, 0.2), grey)
        scene.write(row)
        few = ('--texels-per-metre', 2, '--cell-size', 2.5, '--backend', 'embree', '--tracing-range', 2,
               '--radiance-probe-spacing', 1)
        answer = kiln('plan', row, *few, '--ranks', 4, '--json', timeout=100)
        self.assertEqual(answer.code, 0, answer.err)
        found = json.loads(answer.out)['working_set']
        self.check_ranks(found)
        own = [r['own_points'] for r in found['ranks']]
        triangles = sorted(r['triangles'] for r in found['ranks'])
        self.assertGreater(triangles[-1], 2 * triangles[0])
        self.assertLess(found['radiance_probes_most'], 0.7 * found['radiance_probes'])
        self.assertLess(found['points_most'], 0.6 * sum(own))
        few = (*few, '--samples-direct', 4, '--samples-bounce', 4, '--samples-indirect', 4, '--samples-probe', 0)
        for ranks, rows in ((16, 16), (17, 0)):
            answer = kiln('plan', row, *few, '--ranks', ranks, timeout=100)
            self.assertEqual(answer.code, 0, answer.err)
            lines = answer.out.split('radiance probes that they may ask\n')[1].split('a rank keeps all')[0].splitlines()
            self.assertEqual(len(lines), 1 + rows + 3, answer.out)
            self.assertEqual([len(line.split()) for line in lines[1:-1]], [6] * (rows + 2), answer.out)
            self.assertEqual(lines[0].split(), ['rank', 'own', 'points', 'triangles', 'points', 'probes', 'MiB'])

    def test_wrong_input_is_refused(self):
        for code, words, arguments in ((64, '--tracing-range', ('bake', SCENE, '--tracing-range', -1)),
                                       (64, '--radiance-probe-spacing',
                                        ('bake', SCENE, '--tracing-range', 1, '--radiance-probe-spacing', 1e-4,
                                         '--lightmap-size', 8, '--backend', 'embree'))):
            answer = kiln(*arguments, '-o', os.path.join(self.folder, 'out'), timeout=60)
            self.assertEqual(answer.code, code, answer.err)
            self.assertIn(words, answer.sentence())


if __name__ == '__main__':
    unittest.main()
