"""Levels of detail at one place: the finest is baked as if it were alone, the others are left out and named. Names,
names of nodes above, MSFT_lod, extras, OBJ; levels side by side, and those whose finer ones are excluded, are baked."""
import json
import os
import sys
import unittest

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
from program import InOwnFolder, kiln, run_json  # noqa: E402

REPOSITORY = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
CASE = os.path.normpath(os.path.join(REPOSITORY, "..", "shared", "scenes", "own", "cases", "c5_lods.glb"))


class Lods(InOwnFolder):
    def setUp(self):
        super().setUp()
        self.path = os.path.join(self.folder, "scene.glb")

    def info(self, scene, *options):
        """Names of the objects, and what is said of levels."""
        path = scene if isinstance(scene, str) else scene.write(self.path)
        report = json.loads(kiln("info", path, "--json", *options).stdout)
        said = [n for n in report["notes"] if "levels of detail" in n["text"]]
        self.assertTrue(all(n["severity"] == "warning" for n in said))
        return [o["name"] for o in report["objects"]], " ".join(n["text"] for n in said)

    def balls(self, *names, at=None, radii=None):
        scene = glb.Scene()
        grey = scene.material("grey", (0.5,) * 3)
        scene.quad("floor", [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], grey)
        for i, name in enumerate(names):
            glb.ball(scene, name, (at[i] if at else 0, 1, 0), radii[i] if radii else 0.5, grey, rings=8 - 2 * (i % 3))
        return scene

    def check(self, scene, kept, left_out, *options):
        names, said = self.info(scene, *options)
        self.assertEqual(sorted(names), sorted(["floor", *kept]))
        for name in left_out:
            self.assertIn('"%s"' % name, said)
        self.assertEqual(said == "", not left_out, said)

    def test_names(self):
        for fine, coarse in (("ball_LOD0", "ball_LOD1"), ("ball", "ball_LOD1"), ("Ball.lod1", "Ball.lod3"),
                             ("ballLOD0", "ballLOD2"), ("LOD0", "LOD1"), ("LOD0_ball", "LOD2_ball"),
                             ("ball_LOD0.001", "ball_LOD1.001"), ("ball_LOD_0", "ball_LOD_1"),
                             ("ball.004", "ball_lod1")):
            self.check(self.balls(coarse, fine), [fine], [coarse])
        for one, other in (("melod0", "melod1"), ("ball_LOD1", "cube_LOD0"), ("ball_LOD1", "ball_LOD1.001"),
                           ("ball_1", "ball_2"), ("ball_LOD", "ball_LOD.001")):
            self.check(self.balls(one, other), [one, other], [])

    def test_places(self):
        """Side by side, as on show, or of other sizes they are things of their own; and of many, each has its place."""
        self.check(self.balls("ball_LOD0", "ball_LOD1", at=(-1, 1)), ["ball_LOD0", "ball_LOD1"], [])
        self.check(self.balls("ball_LOD0", "ball_LOD1", radii=(0.5, 0.1)), ["ball_LOD0", "ball_LOD1"], [])
        scene = self.balls(*["b_LOD%d.%03d" % (k % 3, i) for i in range(6) for k in range(3)],
                           at=[i for i in range(6) for _ in range(3)])
        names, said = self.info(scene)
        self.assertEqual(sorted(names), ["b_LOD0.%03d" % i for i in range(6)] + ["floor"])
        self.assertIn(" and 4 more", said)

    def test_groups(self):
        """A finer level of several parts below a node of that name, a coarser one of one mesh."""
        scene = self.balls("left", "right", "far", at=(-0.4, 0.4, 0), radii=(0.4, 0.4, 0.8))
        nodes = scene.document["nodes"]
        nodes += [{"name": "car_LOD0", "children": [1, 2]}, {"name": "car_LOD1", "children": [3]}]
        scene.document["scenes"][0]["nodes"] = [0, 4, 5]
        self.check(scene, ["left", "right"], ["far"])

    def test_extension(self):
        """Levels in the scene, whatever their names; and outside of it."""
        for inside in (True, False):
            scene = self.balls("ball", "rough", "block")
            scene.used.add("MSFT_lod")
            scene.document["nodes"][1]["extensions"] = {"MSFT_lod": {"ids": [2, 3]}}
            if not inside:
                scene.document["scenes"][0]["nodes"] = [0, 1]
            self.check(scene, ["ball"], ["rough", "block"])
        scene = self.balls("ball", "rough")
        scene.used.add("MSFT_lod")
        scene.document["nodes"][1]["extensions"] = {"MSFT_lod": {"ids": [7]}}
        kiln("info", scene.write(self.path), code=65)

    def test_extras(self):
        for key in ("lod", "LOD", "lod_level", "lodLevel"):
            scene = self.balls("ball", "rough", "elsewhere", at=(0, 0, 3))
            for node, level in ((2, 1), (3, 1)):
                scene.document["nodes"][node]["extras"] = {key: level}
            self.check(scene, ["ball", "elsewhere"], ["rough"])

    def test_settings(self):
        """A level whose finer ones are excluded is the finest; one that is not to be excluded stays."""
        scene = self.balls("ball_LOD0", "ball_LOD1", "ball_LOD2")
        self.check(scene, ["ball_LOD1"], ["ball_LOD2"], "--objects", '{"*LOD0": {exclude: true}}')
        self.check(scene, ["ball_LOD0", "ball_LOD2"], ["ball_LOD1"], "--objects", '{"ball_LOD2": {exclude: false}}')

    def test_obj(self):
        path = os.path.join(self.folder, "scene.obj")
        with open(path, "w") as file:
            for k in range(3):
                corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
                file.write("o tower_LOD%d\n" % k)
                for c in corners:
                    file.write("v %g %g %g\n" % tuple(0.9 ** k * v for v in c))
                for f in ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)):
                    file.write("f %d %d %d %d\n" % tuple(8 * k + i for i in f))
        names, said = self.info(path)
        self.assertEqual(names, ["tower_LOD0"])
        self.assertIn('"tower_LOD1", "tower_LOD2"', said)

    def test_light(self):
        """The case of ../shared: each level as if alone, I cos / d^2 where the lamp is seen."""
        if not os.path.exists(CASE):
            self.skipTest("../shared/scenes/own/cases is not here")
        for level, rule in ((0, "{}"), (1, '{"*LOD0": {exclude: true}}'), (2, '{"*LOD[01]": {exclude: true}}')):
            folder = os.path.join(self.folder, "bake%d" % level)
            kiln("bake", CASE, "-o", folder, "--objects", rule, "--bounces", "0", "--samples-probe", "0",
                 "--no-preview", "--no-export", "--denoise", "none", "--quiet", "--lightmap-size", "32",
                 "--backend", "embree")
            names = [o["name"] for o in run_json(folder)["objects"]]
            self.assertEqual(names, ["floor", "ball_LOD%d" % level])
            with h5py.File(os.path.join(folder, "kiln.h5")) as file:
                ball = (file["points/object"][...] == 1) & (file["points/valid"][...] != 0)
                position, normal = file["points/position"][...][ball], file["points/normal"][...][ball]
                light = file["irradiance/direct"][...][ball][:, 1]
            self.assertGreater(ball.sum(), 200)
            way = np.array([2, 3, 1]) - position
            distance = np.linalg.norm(way, axis=1)
            cosine = np.sum(normal * way, axis=1) / distance
            seen = cosine > 0.3
            ratio = light[seen] / (10 * cosine[seen] / distance[seen] ** 2)
            print("level %d: %d points see the lamp, E / right %.4f to %.4f" % (level, seen.sum(), *np.percentile(
                ratio, (5, 95))))
            self.assertLess(np.abs(np.median(ratio) - 1), 0.01)
            self.assertGreater(np.percentile(ratio, 5), 0.9)
            self.assertEqual(light[cosine < -0.2].max(), 0)


if __name__ == "__main__":
    unittest.main()
