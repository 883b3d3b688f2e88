"""Groups that are parts of a light: patches of the sky (--sky-patches) bring what closed forms say, blocks of a screen
what such screens alone do; they add up to the bake, and any number of ranks gives the same bits. What is refused."""
import math
import os
import sys
import unittest

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, '../cli'))
sys.path.insert(0, os.path.join(HERE, '../common'))
sys.path.insert(0, HERE)
import glb  # noqa: E402
import png  # noqa: E402
import test_light_groups as groups_of  # noqa: E402
from kiln_cli import kiln, run_json  # noqa: E402
from test_light_groups import SCENE, SMALL  # noqa: E402


class GroupParts(unittest.TestCase):
    setUp, write, bake, read, same, mpi = (getattr(groups_of.LightGroups, name) for name in
                                           ('setUp', 'write', 'bake', 'read', 'same', 'mpi'))

    def meadow(self):
        """A floor, and a wall that looks to +x and is far away; both are black."""
        scene = glb.Scene()
        black = scene.material('black')
        scene.quad('floor', [(0, 0, 1), (1, 0, 1), (1, 0, 0), (0, 0, 0)], black)
        scene.quad('wall', [(0, 0, 51), (0, 0, 50), (0, 1, 50), (0, 1, 51)], black)
        return scene.write(os.path.join(self.folder, 'meadow.glb'))

    def test_sky_patches(self):
        scene, options = self.meadow(), ('--environment', '1,2,3', '--sky-patches', '145', '--samples-direct', 256)
        found = self.bake('sky', *options, scene=scene)
        groups = run_json(os.path.join(self.folder, 'sky'))['light_groups']
        self.assertEqual([group['name'] for group in groups[:2] + groups[-3:]],
                         ['sky.000', 'sky.001', 'sky.144', 'sky.ground', 'rest'])
        total = found['irradiance/total'].astype(float)
        parts = sum(found[f'groups/{group["name"]}'].astype(float) for group in groups)
        self.assertLess(np.abs(parts - total).max(), 1e-5 * total.max())
        wall = found['points/object'] == 1
        height, bands, ratios = math.pi / 15, [30, 30, 24, 24, 18, 12, 6, 1], [[] for _ in range(8)]
        for group in groups[:145]:
            x, y, _ = group['direction']
            light = found[f'groups/{group["name"]}']
            band = 7 if y == 1 else round(math.asin(y) / height - 0.5)
            share = math.sin(min((band + 1) * height, math.pi / 2)) ** 2 - math.sin(band * height) ** 2
            ratios[band].append(light[~wall, 0].mean() / (math.pi / bands[band] * share))
            if x < -0.25:
                self.assertEqual(light[wall].max(), 0, group['name'])
            if x > 0.25:
                self.assertGreater(light[wall].mean(), 0, group['name'])
        self.assertEqual([len(ratio) for ratio in ratios], bands)
        for ratio in ratios:  # samples of neighbours are not independent, and few are in a patch
            self.assertLess(abs(np.mean(ratio) - 1), 0.03)
            self.assertLess(np.abs(np.array(ratio) - 1).max(), 0.5)
        np.testing.assert_allclose(found['groups/sky.100'][~wall], found['groups/sky.100'][~wall, :1] * [1, 2, 3],
                                   rtol=1e-5)
        for ranks in (3, 4):
            self.same(self.bake(f'on{ranks}', *options, scene=scene, prefix=self.mpi(ranks)), found, f'{ranks} ranks')

    def screens(self, name, lit):
        """A screen of 4 x 2 quads over a wall; those that `lit` says shine."""
        scene = glb.Scene()
        black, white = scene.material('black'), scene.material('Screen', radiance=(3, 2, 1))
        scene.quad('wall', [(0, 0, 0), (4, 0, 0), (4, 2, 0), (0, 2, 0)], black)
        for y in range(2):
            for x in range(4):
                corners = [(x + 1, 1 - y, 1), (x, 1 - y, 1), (x, 2 - y, 1), (x + 1, 2 - y, 1)]
                uv = [((x + 1) / 4, (y + 1) / 2), (x / 4, (y + 1) / 2), (x / 4, y / 2), ((x + 1) / 4, y / 2)]
                scene.quad(f's{x}{y}', corners, white if lit(x, y) else black, layout=uv)
        return scene.write(os.path.join(self.folder, name + '.glb'))

    def test_blocks(self):
        groups = self.write('groups.yaml', 'screen: {materials: [Screen], blocks: [4, 2]}\n')
        scene = glb.Scene()
        white = scene.material('Screen', radiance=(3, 2, 1))
        scene.document['images'] = [{'uri': png.data_uri(np.full((4, 4, 3), 255, np.uint8))}]
        scene.document['textures'] = [{'source': 0}]
        scene.document['materials'][white]['emissiveTexture'] = {'index': 0}
        scene.quad('wall', [(0, 0, 0), (4, 0, 0), (4, 2, 0), (0, 2, 0)], scene.material('black'))
        scene.quad('screen', [(4, 0, 1), (0, 0, 1), (0, 2, 1), (4, 2, 1)], white,
                   layout=((1, 1), (0, 1), (0, 0), (1, 0)))
        whole = scene.write(os.path.join(self.folder, 'whole.glb'))
        found = self.bake('whole', '--light-groups', groups, '--samples-direct', 256, scene=whole)
        wall = found['points/object'] == 0
        self.assertEqual(sum('groups/' in key for key in found), 9)
        for x, y in ((0, 0), (3, 0), (1, 1)):
            alone = self.bake(f'alone{x}{y}', scene=self.screens(f'alone{x}{y}', lambda a, b: (a, b) == (x, y)))
            wanted = alone['irradiance/total'][alone['points/object'] == 0]
            light = found[f'groups/screen.{x}.{y}'][wall]
            self.assertLess(abs(light.mean() - wanted.mean()), 0.01 * wanted.mean())
            self.assertLess(np.abs(light - wanted).mean(), 0.1 * wanted.mean())

    def test_no_sky(self):
        answer = kiln('bake', self.screens('dark', lambda x, y: True), *SMALL, '--sky-patches', 145, '-o',
                      os.path.join(self.folder, 'out'))
        self.assertEqual(answer.code, 64)
        self.assertIn('the scene has no sky', answer.err)

    def test_blocks_need_coordinates(self):
        groups = self.write('groups.yaml', 'a: {lights: [sun], blocks: [2, 2]}\n')
        out = os.path.join(self.folder, 'out')
        answer = kiln('bake', SCENE, *SMALL, '--light-groups', groups, '-o', out)
        self.assertEqual(answer.code, 65)
        self.assertIn('blocks are of surfaces that emit', answer.err)
        groups = self.write('groups.yaml', 'a: {materials: [Screen], blocks: [2, 2]}\n')
        answer = kiln('bake', self.screens('plain', lambda x, y: True), *SMALL, '--light-groups', groups, '-o', out)
        self.assertEqual(answer.code, 64)
        self.assertIn("has no texture for its emission", answer.err)

    def test_relight(self):
        """Groups of a bake that has kept its rays: the bits of a bake that tells them apart, without a gather ray."""
        options = ('--environment', '1,1,1', '--lightmap-max', 16)
        wanted = self.bake('told', *options, '--sky-patches', 145)
        self.bake('rows', *options, '--keep-transport', 'rows')
        out = os.path.join(self.folder, 'relit')
        answer = kiln('relight', os.path.join(self.folder, 'rows'), '--sky-patches', 145, '--quiet', '-o', out)
        self.assertEqual(answer.code, 0, answer.err)
        self.same(self.read(out), wanted, 'relit')
        self.assertEqual(run_json(out)['relight']['rays_traced'], 0)

    def test_too_many(self):
        """2,307 groups on some million points take more memory than a host has."""
        answer = kiln('bake', self.meadow(), '--lightmap-size', 4096, '--samples-probe', 0, '--backend', 'embree',
                      '--sky-patches', 2305, '--environment', '1,1,1', '--quiet', '-o',
                      os.path.join(self.folder, 'out'), timeout=120)
        self.assertEqual(answer.code, 64)
        self.assertIn('2307 groups of lights', answer.err)
        self.assertRegex(answer.err, r'take about \d+\.\d+ GiB on a host \(.*\), and --memory-budget is \d+\.\d+')
        self.assertRegex(answer.err, r'with 0\.\d+ % of its texels it would fit')


if __name__ == '__main__':
    unittest.main()
