"""The irradiance volume spans what receives light: a sky dome, a far sun of emissive triangles and what only casts
count only as far as they are near; --volume-bounds names the box."""
import os
import sys
import unittest

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
from program import InOwnFolder, kiln, run_json  # noqa: E402

REPOSITORY = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
DOME = os.path.normpath(os.path.join(REPOSITORY, "..", "shared", "scenes", "own", "cases", "g30_dome.glb"))
FEW = ("--quality", "draft", "--samples-direct", "4", "--samples-bounce", "4", "--samples-indirect", "4",
       "--samples-probe", "8", "--bounces", "1", "--lightmap-size", "4", "--no-preview", "--no-export", "--denoise",
       "none", "--quiet", "--backend", "embree")
ROOM = ((-2, 0, -2), (2, 3, 2))


def room():
    """An open room of 4 x 3 x 4 m: a floor and two walls; and a black lamp in it."""
    scene = glb.Scene()
    white, lamp = scene.material("white", (0.5,) * 3), scene.material("lamp", radiance=(1,) * 3)
    scene.quad("floor", [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], white)
    scene.quad("back", [(-2, 0, -2), (2, 0, -2), (2, 3, -2), (-2, 3, -2)], white)
    scene.quad("left", [(-2, 0, 2), (-2, 0, -2), (-2, 3, -2), (-2, 3, 2)], white)
    scene.quad("lamp", [(-1, 2.9, -1), (1, 2.9, -1), (1, 2.9, 1), (-1, 2.9, 1)], lamp)
    return scene


class VolumeBounds(InOwnFolder):
    def setUp(self):
        super().setUp()
        self.path = os.path.join(self.folder, "scene.glb")

    def bake(self, scene, *options, status=0):
        path = scene if isinstance(scene, str) else scene.write(self.path)
        run = kiln("bake", path, "-o", os.path.join(self.folder, "bake"), "--no-resume", *FEW, *options, code=status)
        if status != 0:
            return run.stderr
        report = run_json(os.path.join(self.folder, "bake"))
        v = report["volume"]
        half = np.array(v["spacing"]) / 2
        low = np.array(v["origin"]) - half
        return low, low + np.array(v["size"]) * 2 * half, v.get("left_out"), " ".join(report.get("notes", []))

    def spans(self, found, low, high, left_out=None):
        np.testing.assert_allclose(found[0], low, atol=1e-5)
        np.testing.assert_allclose(found[1], high, atol=1e-5)
        self.assertEqual(None if found[2] is None else (found[2]["objects"], found[2]["largest"]), left_out)
        if left_out is not None:
            self.assertIn("--volume-bounds", found[3])
            self.assertIn("'%s'" % left_out[1], found[3])

    def test_dome(self):
        if not os.path.exists(DOME):
            self.skipTest("../shared/scenes/own/cases is not here")
        low, high, left_out, _ = self.bake(DOME)
        self.assertTrue(np.all(high - low <= 4.001) and left_out["largest"] == "sky", (low, high, left_out))

    def test_lamp_in_the_room(self):
        self.spans(self.bake(room()), *ROOM)

    def test_sky_by_name(self):
        """It reflects, and would receive light as anything else."""
        for name, left_out in (("SkySphere", True), ("my_sky", True), ("Sky.001", True), ("whisky", False),
                               ("skyscraper", False)):
            scene = room()
            glb.ball(scene, name, (0, 0, 0), 300, scene.material("grey", (0.5,) * 3), rings=6)
            if left_out:
                self.spans(self.bake(scene), *ROOM, (1, name))
            else:
                self.assertGreater(self.bake(scene)[1][0], 250)

    def test_sun_of_triangles(self):
        """Emissive, and reflecting; beside it a black one."""
        scene = room()
        for name, x, albedo in (("sun", 0, 0.5), ("second", 300, 0.0)):
            scene.quad(name, [(x - 9, 1000, -9), (x + 9, 1000, -9), (x + 9, 1000, 9), (x - 9, 1000, 9)],
                       scene.material(name, (albedo,) * 3, (5,) * 3))
        self.spans(self.bake(scene), *ROOM, (2, "sun"))

    def test_far_receiver(self):
        """What receives light is spanned, however far; unless it only casts."""
        for role, far in ((None, 500), ("caster-only", 2)):
            scene = room()
            scene.quad("far", [(400, 0, -2), (400, 0, 2), (500, 0, 2), (500, 0, -2)],
                       scene.material("grey", (0.5,) * 3))
            if role:
                scene.document["nodes"][-1]["extras"] = {"kiln-role": role}
            self.assertAlmostEqual(self.bake(scene)[1][0], far, 5)

    def test_given(self):
        self.spans(self.bake(room(), "--volume-bounds=-1,0.5,-1.5,1,2.5,1", "--probe-spacing", "0.5"), (-1, 0.5, -1.5),
                   (1, 2.5, 1))
        for wrong in ("1,2,3", "0,0,0,1,1,x", "1,0,0,0,1,1", "0,0,0,1,1,0", "0,0,0,1,1,1e30"):
            text = self.bake(room(), "--volume-bounds", wrong, status=64)
            self.assertIn("--volume-bounds", text)


if __name__ == "__main__":
    unittest.main()
