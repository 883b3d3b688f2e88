"""kiln bake --light-groups: groups add up to the bake and do not change it; each is as a bake with its lights alone
is; any number of ranks gives the same bits; names that the scene does not have are refused."""
import os
import sys
import unittest

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '../cli'))
from kiln_cli import InOwnFolder, kiln  # noqa: E402

SCENE = os.path.join(os.path.dirname(os.path.abspath(__file__)), '../data/punctual_zoo.glb')
SMALL = ('--lightmap-max', 32, '--quality', 'draft', '--samples-direct', 64, '--samples-probe', 0, '--backend',
         'embree', '--threads', 1, '--denoise', 'none', '--no-preview', '--quiet')
GROUPS = 'sun: {lights: [sun]}\npoints: {lights: ["pt*"]}\n'


class LightGroups(InOwnFolder):
    def write(self, name, text):
        path = os.path.join(self.folder, name)
        with open(path, 'w', encoding='utf-8') as file:
            file.write(text)
        return path

    def bake(self, name, *options, scene=SCENE, **more):
        out = os.path.join(self.folder, name)
        answer = kiln('bake', scene, *SMALL, *options, '-o', out, timeout=120, **more)
        self.assertEqual(answer.code, 0, answer.err)
        return self.read(out)

    def read(self, out):
        with h5py.File(os.path.join(out, 'kiln.h5')) as file:
            found = {}
            file.visititems(lambda key, item: found.update({key: item[()]}) if isinstance(item, h5py.Dataset) else None)
        return found

    def test_groups_add_up(self):
        groups = ('--light-groups', self.write('groups.yaml', GROUPS))
        self.add_up(self.bake('blocks', '--schedule', 'lean', '--indirect-scale', 2, '--final-scale', 2, *groups))
        plain = self.bake('plain')
        both = self.bake('both', *groups)
        for key, values in plain.items():
            self.assertEqual(values.tobytes(), both[key].tobytes(), key)
        self.assertGreater(both['groups/sun'].mean(), 0)
        self.add_up(both)
        off = 'lights: {"pt*": {on: false}, "sp*": {on: false}}'
        alone = self.bake('alone', '--changes', self.write('off.yaml', off))['irradiance/total'].astype(float)
        self.assertLess(abs(both['groups/sun'].mean() - alone.mean()), 0.02 * alone.mean())

    def test_verified(self):
        """A fresh bake is sound whatever its groups are called, and its denoised layers are a little below 0 in
        places."""
        groups = 'R: {lights: [sun]}\nalbedo: {lights: ["pt*"]}\nvalidity: {lights: ["sp*"]}\n'
        self.bake('named', '--light-groups', self.write('named.yaml', groups), '--denoise', 'regression',
                  '--samples-indirect', 16)
        answer = kiln('verify', os.path.join(self.folder, 'named'), timeout=60)
        self.assertEqual(answer.code, 0, answer.err)

    def add_up(self, found):
        total = found['irradiance/total'].astype(float)
        parts = sum(found[f'groups/{name}'].astype(float) for name in ('sun', 'points', 'rest'))
        self.assertLess(np.abs(parts - total).max(), 1e-3 * total.mean())

    def same(self, found, wanted, what):
        self.assertEqual(found.keys(), wanted.keys())
        for key, values in wanted.items():
            self.assertEqual(values.tobytes(), found[key].tobytes(), f'{what}: {key}')

    def test_same_bits(self):
        """On any number of ranks, and after a bake that is slow was stopped at least twice."""
        options = ('--light-groups', self.write('groups.yaml', GROUPS), '--bounces', 2, '--schedule', 'equal',
                   '--environment', '0.5,0.5,0.5', '--sky-patches', 145, '--lightmap-max', 16)
        wanted = self.bake('one', *options)
        three = self.bake('three', *options, prefix=self.mpi(3))
        self.same(three, wanted, 'three ranks')
        out, stops = os.path.join(self.folder, 'stopped'), 0
        slow = ('env', 'KILN_SLOW_RANK=0:24')
        code = 75
        while code == 75 and stops < 20:
            answer = kiln('bake', SCENE, *SMALL, *options, '--max-time', 0.2 * 1.3 ** stops, '-o', out, prefix=slow,
                          timeout=120)
            code = answer.code
            stops += code == 75
        self.assertEqual(code, 0, answer.err)
        self.assertGreaterEqual(stops, 2)
        self.same(self.read(out), wanted, f'after {stops} stops')

    def mpi(self, ranks):
        return os.environ.get('MPIRUN', 'mpirun'), '-n', str(ranks), '--oversubscribe'

    def test_refused_names(self):
        for text, parts in (('a: {objects: [nowhere]}\n', ("'nowhere'",)),
                            ('lamps: {materials: [white]}\n', ('groups.yaml', 'lamps', "'white' emits no light"))):
            groups = self.write('groups.yaml', text)
            answer = kiln('bake', SCENE, *SMALL, '--light-groups', groups, '-o', os.path.join(self.folder, 'out'))
            self.assertEqual(answer.code, 64, answer.err)
            for part in parts:
                self.assertIn(part, answer.err)


if __name__ == '__main__':
    unittest.main()
