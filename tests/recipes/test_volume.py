"""jobs/recipes/volume.py against kiln probe: the same irradiance at any place and normal, inside, outside and
buried."""
import os
import subprocess
import sys
import tempfile
import unittest

import h5py
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', '..', 'jobs', 'recipes')]
import harness  # noqa: E402
import volume  # noqa: E402

RECIPE = os.path.join(harness.REPOSITORY, 'jobs', 'recipes', 'volume.py')
PLACES = 24


class VolumeRecipe(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix='kiln-test-')
        cls.kiln = harness.Kiln(os.environ['KILN'], cls.folder.name)
        cls.bake = cls.kiln.bake(harness.own_scene('cornell_original.glb'), '--quality', 'draft', '--texels-per-metre',
                                 2, '--probe-spacing', 0.5)
        assert cls.bake.process.status == 0, cls.bake.process.stderr
        cls.path = os.path.join(cls.bake.directory, 'volume.hdf')
        cls.volume = volume.Volume(cls.path)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def probe(self, position, normal):
        """What kiln says, or None where it finds no probe that can be trusted."""
        answer = self.kiln.command('probe', self.bake.directory, *position, *normal, '--json')
        return np.array(answer.json()['irradiance']) if answer.status == 0 else None

    def same(self, position, normal):
        ours, kilns = self.volume.irradiance(position, normal), self.probe(position, normal)
        where = 'at %s facing %s' % (position, normal)
        self.assertEqual(ours is None, kilns is None, where)
        if kilns is not None:
            self.assertLess(np.abs(ours - kilns).max(), 1e-6 * max(1.0, kilns.max()), where)
        return kilns

    def test_inside_and_outside(self):
        rng = np.random.default_rng(1)
        low, high = self.volume.origin, self.volume.origin + self.volume.spacing * (self.volume.size - 1)
        answers = [self.same(rng.uniform(low - 0.3, high + 0.3).round(6), rng.normal(size=3).round(6))
                   for _ in range(PLACES)]
        lit = [a for a in answers if a is not None and a.max() > 0]
        self.assertGreater(len(lit), PLACES // 2)  # else nothing was compared

    def test_probes_that_cannot_be_trusted(self):
        bad = self.volume.validity < 0.5
        corners = [bad[k:bad.shape[0] - 1 + k, j:bad.shape[1] - 1 + j, i:bad.shape[2] - 1 + i] for k, j,
                   i in np.ndindex(2, 2, 2)]
        buried = np.argwhere(np.all(corners, axis=0))  # grid cells whose eight probes are all inside a block
        self.assertGreater(len(buried), 0)
        z, y, x = buried[0]
        self.assertIsNone(self.same(self.volume.origin + self.volume.spacing * (x + 0.5, y + 0.5, z + 0.5), (0, 1, 0)))

    def test_a_grid_of_one_probe(self):
        """What has no second probe along an axis is constant along it."""
        path = os.path.join(self.folder.name, 'one.hdf')
        with h5py.File(path, 'w') as f:
            group = f.create_group('VTKHDF')
            group.attrs['Origin'], group.attrs['Spacing'] = np.zeros(3), np.ones(3)
            group['PointData/irradiance_sh'] = np.repeat(np.arange(9.0, 0.0, -1.0), 3).reshape(1, 1, 1, 27)
            group['PointData/validity'] = np.ones((1, 1, 1), np.float32)
            group['PointData/occluders'] = np.zeros((1, 1, 1, 81), np.float32)
            group['PointData/offset'] = np.zeros((1, 1, 1, 3), np.float32)
        one = volume.Volume(path)
        np.testing.assert_allclose(one.irradiance((5, -3, 0), (0, 2, 0)),
                                   volume.basis((0, 1, 0)) @ np.arange(9.0, 0.0, -1.0))

    def test_command(self):
        place = [str(v) for v in (*(self.volume.origin + 0.4 * self.volume.spacing).round(6), 0, 1, 0)]
        said = subprocess.run([sys.executable, RECIPE, self.path] + place, capture_output=True, text=True,
                              check=True).stdout
        expected = self.probe(place[:3], place[3:])
        np.testing.assert_allclose([float(v) for v in said.split('=')[1].split()], expected, rtol=1e-5, atol=1e-9)

    def test_short(self):
        with open(RECIPE) as f:
            self.assertLessEqual(len(f.readlines()), 70)


if __name__ == '__main__':
    unittest.main()
