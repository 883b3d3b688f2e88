"""Groups of lights in the volume: /groups of volume.hdf adds up to its light and changes no bit of it; each group is as
a bake with its lights alone is; patches of a constant sky add up to a bake under it; any number of ranks gives the same
bits. kiln verify reads the file."""
import os
import shutil
import sys
import tempfile
import unittest

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '../cli'))
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import test_light_groups as groups_of  # noqa: E402
from kiln_cli import kiln  # noqa: E402
from test_light_groups import GROUPS, SCENE  # noqa: E402

SMALL = ('--lightmap-max', 16, '--quality', 'draft', '--samples-direct', 64, '--samples-probe', 64, '--probe-spacing',
         1.5, '--backend', 'embree', '--threads', 1, '--denoise', 'none', '--no-preview', '--no-export', '--quiet')
AXES = [f'irradiance_{sign}{axis}' for axis in 'xyz' for sign in ('pos', 'neg')]


class GroupVolume(unittest.TestCase):
    setUp, write, same, mpi = (getattr(groups_of.LightGroups, name) for name in ('setUp', 'write', 'same', 'mpi'))

    def bake(self, name, *options, **more):
        out = os.path.join(self.folder, name)
        answer = kiln('bake', SCENE, *SMALL, *options, '-o', out, timeout=120, **more)
        self.assertEqual(answer.code, 0, answer.err)
        return self.read(name)

    def read(self, name):
        with h5py.File(os.path.join(self.folder, name, 'volume.hdf')) as file:
            found = {}
            file.visititems(lambda key, item: found.update({key: item[()]}) if isinstance(item, h5py.Dataset) else None)
        return found

    def light(self, found):
        """All light of a probe, as groups have it."""
        return np.concatenate([found['VTKHDF/PointData/irradiance_sh']] +
                              [found[f'VTKHDF/PointData/{axis}'] for axis in AXES], axis=3).astype(float)

    def test_groups_add_up(self):
        plain = self.bake('plain')
        groups = ('--light-groups', self.write('groups.yaml', GROUPS))
        both = self.bake('both', *groups)
        for key, values in plain.items():
            self.assertEqual(values.tobytes(), both[key].tobytes(), key)
        self.assertEqual(sorted(set(both) - set(plain)), ['groups/points', 'groups/rest', 'groups/sun'])
        total = self.light(plain)
        found = [both[f'groups/{name}'].astype(float) for name in ('sun', 'points', 'rest')]
        for group in found:
            self.assertEqual(group.shape, total.shape)
            self.assertGreater(group[..., 27:].mean(), 0)
        self.assertLess(np.abs(sum(found) - total).max(), 1e-3 * np.abs(total).mean())
        off = 'lights: {"pt*": {on: false}, "sp*": {on: false}}'
        alone = self.light(self.bake('alone', '--changes', self.write('off.yaml', off)))
        self.assertLess(abs(found[0][..., 27:].mean() - alone[..., 27:].mean()), 0.05 * alone[..., 27:].mean())
        self.same(self.bake('three', *groups, prefix=self.mpi(3)), both, 'three ranks')
        self.assertEqual(kiln('verify', os.path.join(self.folder, 'both'), '--quiet').code, 0)
        self.mixtures(both, plain)

    def mixtures(self, both, plain):
        """With 1 for all the bake's volume bit for bit, of one rank and three; with other factors their sum."""
        for name, options, prefix in (('ones', (), ()), ('mixed', ('--set', 'sun=0.5', '--set', 'points=0,2,1'), ()),
                                      ('mixed3', ('--set', 'sun=0.5', '--set', 'points=0,2,1'), self.mpi(3))):
            out = os.path.join(self.folder, name)
            answer = kiln('mix', os.path.join(self.folder, 'both'), *options, '-o', out, '--quiet', prefix=prefix)
            self.assertEqual(answer.code, 0, answer.err)
            self.assertEqual(kiln('verify', out, '--quiet').code, 0)
        self.same(self.read('ones'), plain, 'all groups as they are')
        mixed = self.read('mixed')
        self.same(self.read('mixed3'), mixed, 'mixed by three ranks')
        wanted = both['groups/sun'] * 0.5 + both['groups/rest']
        for c, factor in enumerate((0, 2, 1)):
            wanted[..., c::3] += factor * both['groups/points'][..., c::3]
        self.assertLess(np.abs(self.light(mixed) - wanted).max(), 1e-3 * np.abs(wanted).mean())
        for key, values in plain.items():
            if 'irradiance' not in key:
                self.assertEqual(values.tobytes(), mixed[key].tobytes(), key)

    def test_sky(self):
        options = ('--environment', '1,2,3', '--sky-patches', 145, '--bounces', 1)
        found = self.bake('sky', *options)
        total = self.light(found)
        parts = [values.astype(float) for key, values in found.items() if key.startswith('groups/')]
        self.assertEqual(len(parts), 147)
        self.assertLess(np.abs(sum(parts) - total).max(), 1e-3 * np.abs(total).mean())
        down = found['groups/sky.144'][..., 27 + 9:27 + 12]  # what comes from straight above, on faces that look down
        self.assertLess(down.mean(), found['groups/sky.144'][..., 27 + 6:27 + 9].mean())


if __name__ == '__main__':
    unittest.main()
