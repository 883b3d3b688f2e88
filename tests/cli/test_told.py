"""What is told of a scene and of a bake is true: lights that are enclosed, light on backs, points that count, the phase
that denoises, materials of MTL files."""
import json
import os
import sys
import unittest

from kiln_cli import InOwnFolder, kiln, run_json

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402

CASES = os.path.join("..", "shared", "scenes", "own", "cases")
QUICK = ["--backend", "embree", "--quality", "draft", "--bounces", "1", "--threads", "1", "--samples-probe", "0",
         "--no-preview", "--no-export", "--no-resume"]


def lamp(scene, place, kind="point"):
    light = {"name": "lamp", "type": kind, "intensity": 10.0, **({"spot": {}} if kind == "spot" else {})}
    scene.light("lamp", light, translation=list(place))


def box(scene, name, low, high, material, inward=False, without=()):
    """Six quads, of names NAME0 and on, single-sided, or fewer."""
    (a, b, c), (d, e, f) = low, high
    sides = [[(a, b, f), (d, b, f), (d, b, c), (a, b, c)], [(a, e, c), (d, e, c), (d, e, f), (a, e, f)],
             [(a, b, f), (a, b, c), (a, e, c), (a, e, f)], [(d, b, c), (d, b, f), (d, e, f), (d, e, c)],
             [(a, b, c), (d, b, c), (d, e, c), (a, e, c)], [(d, b, f), (a, b, f), (a, e, f), (d, e, f)]]
    for i, side in enumerate(sides):
        if i not in without:
            scene.quad(f"{name}{i}", side if inward else side[::-1], material)


class Told(InOwnFolder):
    def at(self, name):
        return os.path.join(self.folder, name)

    def scene(self, name, **more):
        scene = glb.Scene()
        scene.grey = scene.material("grey", (0.5, 0.5, 0.5), **more)
        return scene, self.at(name + ".glb")

    def bake(self, path, *options):
        answer = kiln("bake", path, "-o", self.at("out"), *QUICK, *options, timeout=120)
        self.assertEqual(answer.code, 0, answer.err)
        return answer, run_json(self.at("out"))

    def problems(self, path):
        found = json.loads(kiln("check", path, "--json").out)["problems"]
        return [(p["severity"], p["place"], p["text"]) for p in found]

    def enclosed(self, path):
        return [(place, text) for _, place, text in self.problems(path) if "enclosed" in text]

    def ground(self, scene, size=2.0):
        scene.quad("ground", [(-size, 0, size), (size, 0, size), (size, 0, -size), (-size, 0, -size)], scene.grey)

    def bulb(self, name, half=0.05, kind="point", without=(), inward=False, material=None, **more):
        """A lamp at height 1 in a box over a ground of 4 m; returns the scene's path."""
        scene, path = self.scene(name, **more)
        self.ground(scene)
        box(scene, "bulb", (-half, 1 - half, -half), (half, 1 + half, half),
            scene.grey if material is None else material(scene), inward, without)
        lamp(scene, (0, 1, 0), kind)
        scene.write(path)
        return path

    def test_enclosed_lights_are_named_with_their_meshes(self):
        for name, options in (("single", {}), ("double", {"double_sided": True}), ("inward", {"inward": True}),
                              ("spot", {"kind": "spot"})):
            (found,) = self.enclosed(self.bulb(name, **options))
            self.assertIn("'lamp'", found[0], name)
            self.assertRegex(found[1], "enclosed in mesh 'bulb[0-5]', which is opaque", name)

    def test_lights_that_get_out_are_not(self):
        def glass(scene):
            number = scene.material("glass", (1, 1, 1))
            scene.document["materials"][number]["extensions"] = {"KHR_materials_transmission": {
                "transmissionFactor": 1.0}}
            scene.used.add("KHR_materials_transmission")
            return number

        for name, options in (("shade", {"without": (0,), "double_sided": True}), ("glass", {"material": glass})):
            self.assertEqual(self.enclosed(self.bulb(name, **options)), [], name)
        scene, path = self.scene("room", double_sided=True)
        box(scene, "room", (-2, 0, -2), (2, 3, 2), scene.grey)
        lamp(scene, (0, 2, 0))
        scene.write(path)
        self.assertEqual(self.enclosed(path), [])

    def test_enclosed_emitters_are_named(self):
        scene, path = self.scene("filament")
        self.ground(scene)
        hot = scene.material("white-hot", radiance=(100, 100, 100))
        scene.quad("filament", [(-0.01, 1, 0.01), (-0.01, 1, -0.01), (0.01, 1, -0.01), (0.01, 1, 0.01)], hot)
        box(scene, "bulb", (-0.05, 0.95, -0.05), (0.05, 1.05, 0.05), scene.grey)
        scene.write(path)
        (found,) = self.enclosed(path)
        self.assertIn("'filament'", found[0])

    def test_a_bake_names_both(self):
        path = os.path.join(CASES, "g6.glb")
        if not os.path.exists(path):
            self.skipTest("../shared/scenes is not there")
        (found,) = self.enclosed(path)
        self.assertTrue("'lamp'" in found[0] and "'bulb'" in found[1], found)
        answer, run = self.bake(path, "--texels-per-metre", "4")
        self.assertRegex(answer.err, r"note: light 'lamp': it is enclosed in mesh 'bulb'")
        (note,) = [note for note in run["notes"] if "hit backs" in note]
        self.assertNotIn("flip", note, "that would not let the light out")

    def backs(self, path, *options):
        _, run = self.bake(path, "--texels-per-metre", "4", *options)
        return [note for note in run["notes"] if "hit backs" in note]

    def test_sky_on_a_room_is_no_fault(self):
        for height in (3.0, 3.3):  # sheets that meet, and walls that reach above the ceiling
            scene, path = self.scene(f"room{height}")
            box(scene, "room", (-2, 0.01, -2), (2, 3, 2), scene.grey, inward=True, without=(2,))
            scene.quad("wall", [(-2, 0, 2), (-2, 0, -2), (-2, height, -2), (-2, height, 2)], scene.grey)
            self.ground(scene, 6.0)
            scene.write(path)
            self.assertEqual(self.backs(path, "--environment", "1,1,1"), [])

    def test_light_on_backs_is_told(self):
        scene, path = self.scene("lamp")
        self.ground(scene)
        scene.quad("flipped", [(-1, 0.5, 1), (-1, 0.5, -1), (1, 0.5, -1), (1, 0.5, 1)], scene.grey)
        lamp(scene, (0, 2, 0))
        scene.write(path)
        (note,) = self.backs(path)
        self.assertIn("flip those faces", note)
        scene, path = self.scene("ground")  # a ground that faces down, under the sun; a room stands on it
        scene.quad("ground", [(-9, 0, 9), (-9, 0, -9), (9, 0, -9), (9, 0, 9)], scene.grey)
        box(scene, "room", (-1, 0.1, -1), (1, 2, 1), scene.grey, inward=True)
        scene.light("sun", {"type": "directional", "intensity": 3.0}, rotation=[-2 ** -0.5, 0, 0, 2 ** -0.5])
        scene.write(path)
        (note,) = self.backs(path)
        self.assertIn("flip those faces", note)
        scene, path = self.scene("shelf")  # inside a room, of whose outside the sky sees more
        box(scene, "room", (-2, 0, -2), (2, 3, 2), scene.grey, inward=True)
        scene.quad("shelf", [(-1, 0.5, 1), (-1, 0.5, -1), (1, 0.5, -1), (1, 0.5, 1)], scene.grey)
        lamp(scene, (0, 2, 0))
        scene.write(path)
        (note,) = self.backs(path, "--environment", "1,1,1")
        self.assertIn("flip those faces", note)

    def test_denoising_is_a_phase(self):
        path = self.at("cornell.glb")
        kiln("generate", "cornell", "-o", path)
        for options, wanted in ((["--denoise", "regression"], True), (["--denoise", "none"], False)):
            answer, run = self.bake(path, "--lightmap-size", "48", *options)
            phases = {phase["name"]: phase["seconds"]["avg"] for phase in run["phases"]}
            self.assertEqual("denoising" in phases, wanted)
            self.assertEqual("\ndenoising " in answer.out, wanted)
            if wanted:
                self.assertGreater(phases["denoising"], 0.2 * run["denoise"]["seconds"])
                self.assertGreater(phases["lightmaps"], 0.0)

    def test_figures_of_a_bake_for_some_views_are_of_what_counts(self):
        path = self.at("rooms.glb")
        kiln("generate", "rooms", "-o", path)
        answer, run = self.bake(path, "--lightmap-size", "16", "--only-visible-from", "all")
        _, whole = self.bake(path, "--lightmap-size", "16")
        self.assertEqual(run["points"]["invalid"], whole["points"]["invalid"])
        self.assertIsNone(run["energy"]["relative_residual"])
        self.assertNotIn("energy balanced", answer.out)
        self.assertRegex(answer.out, "surface points, %.2f %% of them buried" % (
            100 * whole["points"]["invalid"] / whole["points"]["count"]))

    def test_pr_and_pm_count(self):
        with open(self.at("a.mtl"), "w") as file:
            file.write("newmtl a\nKd 0.5 0.5 0.5\nPr 0.1\nPm 1\n")
        with open(self.at("a.obj"), "w") as file:
            file.write("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n")
        (note,) = [text for _, _, text in self.problems(self.at("a.obj")) if "Pr, Pm" in text]
        self.assertIn("--materials auto and full take them", note)


if __name__ == "__main__":
    unittest.main()
