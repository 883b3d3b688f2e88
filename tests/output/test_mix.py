"""kiln mix: with 1 for all groups it writes the bake's lightmaps, bit for bit; with other factors the sum of the
groups' layers, which is as a bake of those lights alone; on any number of ranks the same bytes. Views show what
shines with its factor. What it refuses."""
import os
import shutil
import sys
import tempfile
import unittest

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, '../cli'))
sys.path.insert(0, os.path.join(HERE, '../common'))
import exr  # noqa: E402
import glb  # noqa: E402
import png  # noqa: E402
from kiln_cli import kiln, run_json  # noqa: E402

SCENE = os.path.join(HERE, '../data/punctual_zoo.glb')
SMALL = ('--lightmap-max', 32, '--quality', 'draft', '--samples-direct', 64, '--samples-probe', 0, '--backend',
         'embree', '--threads', 1, '--no-preview', '--quiet')
GROUPS = 'sun: {lights: [sun]}\npoints: {lights: ["pt*"]}\n'


class Mix(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp()
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.groups = cls.path('groups.yaml')
        with open(cls.groups, 'w', encoding='utf-8') as file:
            file.write(GROUPS)
        cls.bake('baked', '--light-groups', cls.groups, '--denoise', 'regression')

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder, name)

    @classmethod
    def bake(cls, name, *options, scene=SCENE):
        answer = kiln('bake', scene, *SMALL, *options, '-o', cls.path(name), timeout=120)
        if answer.code != 0:
            raise AssertionError(answer.err)

    def mix(self, bake, name, *options, **more):
        answer = kiln('mix', self.path(bake), *options, '-o', self.path(name), '--quiet', **more)
        self.assertEqual(answer.code, 0, answer.err)
        return self.maps(name)

    def maps(self, name):
        folder = self.path(name + '/lightmaps')
        files = sorted(file for file in os.listdir(folder) if file.endswith('.exr'))
        self.assertGreater(len(files), 3)
        return {file: exr.read(os.path.join(folder, file))[0] for file in files}

    def check_same(self, bake, name):
        mixed, baked = self.mix(bake, name), self.maps(bake)
        self.assertEqual(mixed.keys(), baked.keys())
        for file, layers in baked.items():
            self.assertEqual(set(mixed[file]), {layer for layer in layers if not layer.startswith('group.')})
            for layer, values in mixed[file].items():
                self.assertEqual(values.tobytes(), layers[layer].tobytes(), f'{file}: {layer}')
        self.assertEqual(kiln('verify', self.path(name)).code, 0)

    def test_all(self):
        self.check_same('baked', 'all')
        self.assertEqual(kiln('view', self.path('all'), '-o', self.path('view.png'), '--width', 32, '--height', 32,
                              timeout=60).code, 0)

    def test_half(self):
        self.bake('half', '--light-groups', self.groups, '--half')
        self.check_same('half', 'all_half')

    def test_sky(self):
        """Groups of so many patches have files of their own."""
        options = ('--environment', '1,1,1')
        self.bake('sky', '--sky-patches', 145, *options)
        self.bake('dark')
        self.check_same('sky', 'all_sky')
        baked, mixed = self.maps('dark'), self.mix('sky', 'night', '--set', 'sky.*=0')
        for file, layers in baked.items():
            for colour in 'RGB':
                # on the surface: which chart a texel beside it is a copy of hangs on all light
                on = layers['coverage.Y'] > 0
                one, other = mixed[file][colour][on].mean(), layers[colour][on].mean()
                self.assertLess(abs(one - other), 0.01 * other)
        for file, layers in self.maps('sky').items():
            parts = [exr.read(os.path.join(self.path(f'sky/lightmaps/groups-{n}'), file))[0] for n in range(3)]
            self.assertEqual(sum(map(len, parts)), 147 * 6)
            total = sum(part[name].astype(float) for part in parts for name in part
                        if name.endswith('.G') and not name.endswith('.direct.G'))
            off = np.abs(total - layers['G']) / layers['G'].mean()
            self.assertLess(np.quantile(off, 0.99), 5e-4)
            self.assertLess(off.max(), 5e-3)

    def test_factors(self):
        factors = {'sun': (0.5, 0.5, 0.5), 'points': (0, 0.2, 1), 'rest': (0, 0, 0)}
        mixed = self.mix('baked', 'some', '--set', '*=0', '--set', 'sun=0.5', '--set', 'points=0,0.2,1')
        for file, layers in self.maps('baked').items():
            for c, colour in enumerate('RGB'):
                for kind in ('', 'direct.'):
                    wanted = sum(of[c] * layers[f'group.{name}.{kind}{colour}'].astype(float)
                                 for name, of in factors.items())
                    np.testing.assert_allclose(mixed[file][kind + colour], np.maximum(wanted, 0), rtol=1e-6,
                                               atol=1e-6)
                off = mixed[file]['direct.' + colour] + mixed[file]['indirect.' + colour] - mixed[file][colour]
                self.assertLess(np.quantile(np.abs(off), 0.95), 1e-5)

    def test_shown(self):
        """What shines is shown with its factor, if its parts have one; parts that differ as the bake had them."""
        scene = glb.Scene()
        scene.quad('screen', [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)], scene.material('Screen', radiance=(2, 2, 2)))
        scene.document['images'] = [{'uri': png.data_uri(np.full((4, 4, 3), 255, np.uint8))}]
        scene.document['textures'] = [{'source': 0}]
        scene.document['materials'][0]['emissiveTexture'] = {'index': 0}
        scene.environment((1, 1, 1))
        groups = self.path('screen.yaml')
        with open(groups, 'w', encoding='utf-8') as file:
            file.write('screen: {materials: [Screen], blocks: [2, 1]}\nsky: {environment: true}\n')
        self.bake('shown', '--light-groups', groups, scene=scene.write(self.path('screen.glb')))
        for factors, wanted, told in ((('screen.*=0.5', 'sky=0,1,2'), (1, 1, 1), []),
                                      (('screen.0.0=0', ), (2, 2, 2), ['Screen'])):
            answer = kiln('mix', self.path('shown'), *(word for factor in factors for word in ('--set', factor)), '-o',
                          self.path('shown_mix'))
            self.assertEqual((answer.code, 'NOTE views show Screen' in answer.out), (0, bool(told)), answer.err)
            self.assertEqual(run_json(self.path('shown_mix'))['mix']['shown_as_baked'], told)
            view = self.path('shown.exr')
            self.assertEqual(kiln('view', self.path('shown_mix'), '--from', '1,1,4', '--to', '1,1,0', '--width', 64,
                                  '--height', 64, '-o', view, timeout=60).code, 0)
            np.testing.assert_allclose(exr.rgb(view)[32, 32], wanted, rtol=0.01)
            np.testing.assert_allclose(exr.rgb(view)[0, 0], (0, 1, 2) if not told else (1, 1, 1), rtol=0.01)

    def test_alone(self):
        with open(self.path('off.yaml'), 'w', encoding='utf-8') as file:
            file.write('lights: {"pt*": {on: false}, "sp*": {on: false}}')
        self.bake('alone', '--changes', self.path('off.yaml'))
        mixed = self.mix('baked', 'sun', '--set', '*=0', '--set', 'sun=1')
        means = [[maps[file]['G'].mean() for file in maps] for maps in (mixed, self.maps('alone'))]
        np.testing.assert_allclose(means[0], means[1], rtol=0.03)

    def test_ranks(self):
        wanted = self.mix('baked', 'one', '--set', 'sun=0.3')
        found = self.mix('baked', 'three', '--set', 'sun=0.3',
                         prefix=(os.environ.get('MPIRUN', 'mpirun'), '-n', '3', '--oversubscribe'))
        for file in wanted:
            with open(self.path('one/lightmaps/' + file), 'rb') as a, open(self.path('three/lightmaps/' + file),
                                                                          'rb') as b:
                self.assertEqual(a.read(), b.read(), file)
        self.assertEqual(found.keys(), wanted.keys())

    def refuse(self, code, words, *arguments):
        answer = kiln('mix', *arguments)
        self.assertEqual(answer.code, code, answer.err)
        self.assertIn(words, answer.err)
        self.assertFalse(os.path.exists(self.path('never')))

    def test_refused(self):
        baked, never = self.path('baked'), ('-o', self.path('never'))
        self.refuse(64, "the nearest of its 3 is 'points'", baked, '--set', 'pionts=1', *never)
        for wrong in ('sun=-1', 'sun=1,2', 'sun=nan', 'sun=0x1', 'sun=1,2,3,4', 'sun=', 'sun'):
            self.refuse(64, wrong, baked, '--set', wrong, *never)
        self.refuse(64, 'is the folder of the bake', baked, '-o', baked)
        os.mkdir(self.path('taken'))
        with open(self.path('taken/mine.txt'), 'w', encoding='utf-8') as file:
            file.write('mine')
        self.refuse(64, 'has other files in it', baked, '-o', self.path('taken'))
        self.bake('plain')
        self.refuse(65, 'bake with --light-groups', self.path('plain'), *never)
        self.refuse(66, 'No such file', self.path('nowhere'), *never)


if __name__ == '__main__':
    unittest.main()
