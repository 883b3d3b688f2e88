"""A scene without light traces nothing and says so last; pictures of other light keep the exposure of the bake, and
what is dark for the lights that there are stays dark; mixtures have a preview; a view that kiln chooses shows what is
lit."""
import json
import os
import sys
import unittest

import numpy as np

sys.path[:0] = [os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", name) for name in ("common", "cli")]
import glb  # noqa: E402
import png  # noqa: E402
from kiln_cli import InOwnFolder, kiln, run_json  # noqa: E402

FEW = ["--backend", "embree", "--quality", "draft", "--bounces", "1", "--threads", "1", "--samples-probe", "0",
       "--no-export", "--texels-per-metre", "4"]


class Dark(InOwnFolder):
    def at(self, name):
        return os.path.join(self.folder, name)

    def run_json(self, name):
        return run_json(self.at(name))

    def brightness(self, name):
        return float(np.mean(png.read(self.at(name + "/preview.png"))))

    def room(self, light=True, **options):
        scene = glb.Scene()
        grey = scene.material("grey", (0.5, 0.5, 0.5))
        glb.box(scene, "room", (-2, 0, -2), (2, 3, 2), grey, range(6))
        if light:
            for name, intensity, x in (("one", 10.0, -1), ("two", 2.0, 1)):
                scene.light(name, {"name": name, "type": "point", "intensity": intensity}, translation=[x, 2, 0])
        return scene.write(self.at("room.glb"))

    def bake(self, path, name, *options, code=0):
        answer = kiln("bake", path, "-o", self.at(name), *FEW, *options, timeout=120)
        self.assertEqual(answer.code, code, answer.err)
        return answer

    def test_without_light_nothing_is_traced(self):
        path = self.room(light=False)
        for more in ([], ["--environment", "0,0,0"], ["--method", "path"], ["--method", "radiosity"],
                     ["--samples-probe", "64", "--tracing-range", "1", "--bounces", "all", "--error-map"]):
            answer = self.bake(path, "out", *more)
            self.assertRegex(answer.out.splitlines()[-1], r"^WARNING there is no light.*--environment R,G,B gives one")
            run = self.run_json("out")
            self.assertEqual(sum(run["rays"].values()), 0, run["rays"])
        answer = self.bake(path, "out", "--json")
        self.assertRegex(answer.err.splitlines()[-1], r"^WARNING there is no light")
        self.assertIs(json.loads(answer.out)["scene"]["lit"], False)
        # what light to come needs is computed
        self.bake(path, "out", "--keep-transport", "rows")
        self.assertGreater(sum(self.run_json("out")["rays"].values()), 0)
        answer = self.bake(path, "out", "--environment", "1,1,1", "--samples-probe", "16")
        self.assertNotIn("WARNING", answer.out)
        self.assertTrue(os.path.exists(self.at("out/volume.hdf")))

    def test_what_is_dark_for_the_lights_stays_dark(self):
        """A room with a millionth of what its neighbour, from which nothing comes, has; and that room alone, which is
        shown bright."""
        eye = ["--from", "-1,1.5,-1", "--to", "1,1,1", "--width", "64", "--height", "48"]
        brightness = []
        for strong in (True, False):
            scene = glb.Scene()
            grey = scene.material("grey", (0.2, 0.2, 0.2))
            glb.box(scene, "room", (-2, 0, -2), (2, 3, 2), grey, range(6))
            glb.box(scene, "other", (3, 0, -2), (7, 3, 2), grey, range(6))
            scene.light("weak", {"type": "point", "intensity": 1e-5}, translation=[0, 2, 0])
            if strong:
                scene.light("strong", {"type": "point", "intensity": 10.0}, translation=[5, 2, 0])
            self.bake(scene.write(self.at("two.glb")), "two", "--no-preview")
            kiln("view", self.at("two"), *eye, "-o", self.at("two.png"))
            brightness.append(float(np.mean(png.read(self.at("two.png")))))
        self.assertLess(brightness[0], 20)
        self.assertGreater(brightness[1], 80)

    def test_relit_pictures_keep_exposure_and_place(self):
        path = self.room()
        self.bake(path, "out", "--keep-transport", "rows")
        with open(self.at("dim.yaml"), "w") as file:
            file.write("lights: {one: {scale: 0.01}, two: {scale: 0.01}}\n")
        answer = kiln("relight", self.at("out"), self.at("dim.yaml"), "-o", self.at("dim"), "--no-export")
        self.assertEqual(answer.code, 0, answer.err)
        bake, dim = self.run_json("out")["preview"], self.run_json("dim")["preview"]
        for key in ("automatic", "white", "added"):
            self.assertEqual(bake["exposure"][key], dim["exposure"][key])
        self.assertEqual(bake["viewpoint"]["chosen"], dim["viewpoint"]["chosen"])
        for key in ("from", "to"):
            np.testing.assert_allclose(bake["viewpoint"][key], dim["viewpoint"][key], atol=1e-9)
        self.assertLess(self.brightness("dim"), 0.5 * self.brightness("out"))

    def test_a_mixture_has_a_preview(self):
        path = self.room()
        with open(self.at("groups.yaml"), "w") as file:
            file.write("one: {lights: [one]}\ntwo: {lights: [two]}\n")
        self.bake(path, "out", "--light-groups", self.at("groups.yaml"))
        for factor, name in (("1", "same"), ("0.1", "dim")):
            answer = kiln("mix", self.at("out"), "--set", f"one={factor}", "--set", f"two={factor}", "-o",
                          self.at(name))
            self.assertEqual(answer.code, 0, answer.err)
            self.assertEqual(kiln("verify", self.at(name)).code, 0)
            mixed, bake = self.run_json(name)["preview"], self.run_json("out")["preview"]
            self.assertEqual(mixed["exposure"], bake["exposure"])
        self.assertAlmostEqual(self.brightness("same"), self.brightness("out"), delta=1.5)
        self.assertLess(self.brightness("dim"), 0.6 * self.brightness("out"))

    def test_a_view_shows_what_is_lit(self):
        """Of a long room whose one half is lit by a spot, from wherever it is taken, the lit end is in the picture."""
        scene = glb.Scene()
        grey = scene.material("grey", (0.3, 0.3, 0.3))
        glb.box(scene, "room", (-6, 0, -2), (6, 3, 2), grey, range(6))
        glb.box(scene, "post", (-1, 0, -0.3), (-0.4, 3, 0.3), grey)
        scene.light("lamp", {"type": "point", "intensity": 30.0}, translation=[4.5, 2.5, 0])
        self.bake(scene.write(self.at("room.glb")), "out")
        place = self.run_json("out")["preview"]["viewpoint"]
        self.assertEqual(place["chosen"], "inside")
        self.assertGreater(place["to"][0], place["from"][0] - 0.5, place)


if __name__ == "__main__":
    unittest.main()
