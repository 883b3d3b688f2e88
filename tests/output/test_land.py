"""--caustics land and vcm: light paths bring what gather rays find, alone and shared with these; the same bits on any
ranks; errors as large as they say."""
import itertools
import os
import sys
import tempfile
import unittest

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
import price  # noqa: E402
from program import InOneFolder, kiln, run_json  # noqa: E402

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
SMALL = ("--backend", "embree", "--texels-per-metre", "2", "--materials", "auto", "--samples-probe", "0", "--denoise",
         "none", "--samples-direct", "4", "--samples-bounce", "2", "--samples-indirect", "4", "--no-preview", "--quiet")
LAND = ("--caustics", "land", "--photons", "40000", "--iterations", "3")
VCM = ("--caustics", "vcm", "--photons", "20000", "--iterations", "3", "--samples-indirect", "64")
WAYS = {"land": LAND, "vcm": VCM}


class Land(InOneFolder):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.scene = os.path.join(cls.folder, "spheres.glb")
        kiln("generate", "cornell-spheres", "-o", cls.scene, "--quiet")

    def bake(self, name, *options, ranks=0, code=0, scene=None):
        """The folder of the bake; or what it says where it ends with another code."""
        folder = os.path.join(tempfile.mkdtemp(dir=self.folder), name)
        done = kiln("bake", scene or self.scene, "-o", folder, *SMALL, *options, ranks=ranks, code=code)
        return folder if code == 0 else done.stderr

    @staticmethod
    def light(folder):
        with h5py.File(os.path.join(folder, "kiln.h5")) as file:
            values = {name: file["irradiance"][name][...] for name in file["irradiance"]}
            values.update(area=file["points/area"][...], object=file["points/object"][...],
                          names=[name.decode() for name in file["objects/name"][...]])
            return values

    def powers(self, names, *options, seeds, scene=None):
        """Power of caustics on each object and on all, for some seeds."""
        found = []
        for seed in range(seeds):
            folder = self.bake("powers", *options, "--bounces", "0", "--seed", str(seed), scene=scene)
            light = self.light(folder)
            power = (light["caustic"] @ LUMINANCE) * light["area"]
            walls = [power[light["object"] == light["names"].index(name)].sum() for name in names]
            found.append([*walls, power.sum()])
        return np.array(found)

    def check_as_gathered(self, scene, names, more, least, ways):
        """Each way brings what the others do, within 5 standard errors, which the spread of some seeds tells."""
        values = {"gather": self.powers(names, "--caustics", "gather", "--samples-indirect", "1024", *more, seeds=6,
                                        scene=scene)}
        for way, options in ways.items():
            values[way] = self.powers(names, *options, *more, seeds=4, scene=scene)
        for way, found in values.items():
            print(way, *("%.4f +- %.4f" % pair for pair in zip(found.mean(0), self.error(found))))
        for one, other in itertools.combinations(reversed(values), 2):
            difference = np.abs(values[one].mean(0) - values[other].mean(0))
            limit = 5.0 * np.hypot(self.error(values[one]), self.error(values[other]))
            self.assertTrue(np.all(difference < limit), (one, other, difference, limit))
            self.assertLess(limit[-1], least * values[other].mean(0)[-1], (one, other))

    def test_as_gathered(self):
        self.check_as_gathered(None, ["floor", "back", "left_red", "right_green", "ceiling"], (), 0.15, WAYS)

    @price.long
    def test_faint_gloss_as_gathered(self):
        """All surfaces are glossy, and the lamp stands within the spheres of some of them."""
        scene = os.path.join(self.folder, "cornell.glb")
        kiln("generate", "cornell", "-o", scene, "--quiet")
        self.check_as_gathered(scene, ["floor", "left_red", "ceiling", "tall_block"], ("--materials", "full"), 0.2,
                               WAYS)

    @staticmethod
    def error(values):
        return values.std(0, ddof=1) / np.sqrt(len(values))

    def test_same_bits(self):
        for way, options in WAYS.items():
            runs = ((0, 1), (0, 2), (2, 1), (3, 1)) if way == "vcm" and price.full else ((0, 2), (3, 1))
            # records of landings that ranks of two nodes send, and that threads of two ranks read where they lie
            runs += ((3, 1, "--shared-memory-ranks", "2"), (2, 2)) if way == "land" else ()
            lights = [self.light(self.bake("%s-%d-%d" % (way, *run[:2]), *options, "--bounces", "1", "--threads",
                                           str(run[1]), *run[2:], ranks=run[0])) for run in runs]
            for run, other in zip(runs[1:], lights[1:]):
                for name in lights[0]:
                    self.assertTrue(np.array_equal(lights[0][name], other[name]), (way, run, name))
            self.assertGreater(lights[0]["caustic"].max(), 0.1)

    def test_errors(self):
        """Two bakes differ by what their errors say; the error falls with the root of the paths."""
        for way in WAYS:
            self.check_errors(*WAYS[way])

    def check_errors(self, *options):
        few = self.light(self.bake("few", *options, "--bounces", "0", "--samples-direct", "512", "--seed", "3"))
        more = self.light(self.bake("more", *options, "--bounces", "0", "--samples-direct", "512", "--seed", "4",
                                    "--iterations", "12"))
        lit = (few["caustic"] @ LUMINANCE > 0.05) & (few["error"] > 0) & (more["error"] > 0)
        apart = ((few["total"] - more["total"]) @ LUMINANCE)[lit] / np.hypot(few["error"], more["error"])[lit]
        print("%d texels apart by %.2f standard errors rms" % (lit.sum(), np.sqrt((apart**2).mean())))
        self.assertTrue(lit.sum() > 20 and 0.5 < np.sqrt((apart**2).mean()) < 1.3)
        ratio = np.median(few["error"][lit] / more["error"][lit])
        self.assertTrue(1.6 < ratio < 2.4, ratio)

    def test_report(self):
        materials = run_json(self.bake("report", *LAND, "--bounces", "0"))["materials"]
        self.assertEqual([materials[name] for name in ("caustics", "photons", "iterations")], ["land", 40000, 3])
        self.assertNotIn("mis", materials)
        report = run_json(self.bake("shared", *VCM, "--bounces", "0", "--mis", "power"))
        self.assertEqual([report["materials"][name] for name in ("caustics", "mis", "photons")],
                         ["vcm", "power", 20000])
        self.assertEqual(report["energy"]["unfound"], [0.0, 0.0, 0.0])
        self.assertLess(abs(report["energy"]["residual"]), 5.0 * report["energy"]["error"])

    def first_light(self, name, caustics, scene=None):
        folder = self.bake(name, *caustics, "--bounces", "0", "--samples-direct", "64", scene=scene)
        return run_json(folder)["energy"]["first_light"]

    def check_first_light(self, light, least):
        error, traced = light["error"], LUMINANCE @ light["traced"]
        self.assertAlmostEqual(LUMINANCE @ light["found"] - traced, light["difference"], places=6)
        self.assertLess(abs(light["difference"]), 5.0 * error, light)
        self.assertLess(5.0 * error, least * traced, light)

    def test_first_light(self):
        """Light that has met no diffuse surface is as much in texels as the lamps send there, by tracing that shares no
        code with the passes; a beam far narrower than a texel too, which glass splits and mirrors."""
        prism = os.path.join(self.folder, "prism.glb")
        kiln("generate", "prism", "-o", prism, "--quiet")
        for name, caustics in WAYS.items():
            of = {scene: self.first_light(name, caustics, scene) for scene in (None, prism)}
            self.check_first_light(of[None]["direct"], 0.02)
            self.check_first_light(of[None]["caustic"], 0.06)
            self.check_first_light(of[prism]["caustic"], 0.08)
            print(name, {scene and "prism": light["caustic"] for scene, light in of.items()})
        self.assertEqual(self.first_light("gather", ("--caustics", "gather"), prism)["caustic"]["found"], [0, 0, 0])
        self.assertEqual(list(self.first_light("none", ("--caustics", "none"))), ["direct"])

    @price.long
    def test_iterations_all(self):
        """With --iterations all a round has light paths by its rays, the same on any ranks. So caustics reach an error
        that as many paths in each round, of which late ones count most, do not."""
        more = ("--caustics", "land", "--photons", "500", "--bounces", "0", "--samples-direct", "32",
                "--samples-indirect", "64", "--target-error", "0.1", "--iterations")
        folders = [self.bake("all", *more, "all", ranks=ranks) for ranks in (0, 3)] + [self.bake("some", *more, "16")]
        reports = []
        for folder in folders:
            reports.append(run_json(folder))
        self.assertEqual([report["materials"]["iterations"] for report in reports], ["all", "all", 16])
        grown, _, same = [[step for step in report["bounces"] if "iterations" in step] for report in reports]
        for step in grown:
            self.assertEqual(step["iterations"], 16 * step["samples"] // grown[0]["samples"])
        self.assertGreater(grown[-1]["iterations"], 16)
        self.assertEqual({step["iterations"] for step in same}, {16})
        above = [report["error"]["above_target"] for report in reports]
        print("%d and %d rounds; above the target %.4f and %.4f" % (
            reports[0]["error"]["rounds"], reports[2]["error"]["rounds"], above[0], above[2]))
        self.assertTrue(above[0] <= 0.025 < above[2], above)
        lights = [self.light(folder) for folder in folders]
        for name in lights[0]:
            self.assertTrue(np.array_equal(lights[0][name], lights[1][name]), name)
        power = [((light["caustic"] @ LUMINANCE) * light["area"]).sum() for light in lights]
        self.assertLess(abs(power[0] / power[2] - 1.0), 0.05, power)
        self.assertIn("--target-error", self.bake("wrong", *LAND, "--iterations", "all", code=64))

    def mirror_scene(self, turned=()):
        """A floor beside a mirror of height 0.75, a lamp at (1, 1, 0), and a sun above it; `turned` are corners of the
        mirror's quad in another order, so that it shows its back."""
        scene, path = glb.Scene(), os.path.join(self.folder, "mirror.glb")
        mirror = scene.material("mirror", (1, 1, 1))
        scene.document["materials"][mirror]["pbrMetallicRoughness"].update(metallicFactor=1.0, roughnessFactor=0.0)
        corners = [(0, 0, -4), (0, 0.75, -4), (0, 0.75, 4), (0, 0, 4)]
        scene.quad("mirror", [corners[i] for i in turned or range(4)], mirror)
        scene.quad("floor", [(0, 0, -1), (0, 0, 1), (2, 0, 1), (2, 0, -1)], scene.material("floor", (0.5, 0.5, 0.5)))
        scene.light("lamp", {"type": "point", "intensity": 10.0}, translation=[1, 1, 0])
        # shines along -z of its node: turned to (-1, -1, 0) / sqrt(2)
        scene.light("sun", {"type": "directional", "intensity": 2.0},
                    rotation=[-0.27059805, 0.65328148, 0.27059805, 0.65328148])
        scene.write(path)
        return path

    def test_mirror_images(self):
        """What a flat mirror brings of lamps without extent is what their images do, without noise; a texel at the edge
        has its share; backs bring nothing; the same bits on any ranks."""
        few = ("--caustics", "vcm", "--photons", "64", "--iterations", "1", "--samples-indirect", "64", "--bounces",
               "0")
        folder = self.bake("one", *few, scene=self.mirror_scene())
        energy = run_json(folder)["energy"]
        self.assertLess(abs(energy["residual"]), max(1e-6, 5.0 * energy["error"]))
        with h5py.File(os.path.join(folder, "kiln.h5")) as file:
            floor = file["points/object"][...] == list(file["objects/name"][...]).index(b"floor")
            place, found = file["points/position"][...][floor], file["irradiance/caustic"][...][floor, 0]
        x, z = np.meshgrid((np.arange(32) + 0.5) / 64, (np.arange(32) + 0.5) / 64)  # of a texel
        at = place[:, None, None] + np.stack([x - 0.25, 0 * x, z - 0.25], -1)
        way = np.array([-1, 1, 0]) - at
        height = at[..., 0] / (at[..., 0] + 1)  # where light of the lamp meets the mirror
        lamp = (height < 0.75) * 10.0 / (way**2).sum(-1)**1.5
        sun = (at[..., 0] < 0.75) * 2.0 * np.sqrt(0.5)
        wanted = (lamp + sun).mean((1, 2))
        print("farthest from its mean: %.4f" % np.abs(found / wanted - 1).max())
        self.assertEqual(len(found), 16)
        self.assertLess(np.abs(found / wanted - 1).max(), 0.02)
        lights = [self.light(folder), self.light(self.bake("ranks", *few, ranks=3, scene=self.mirror_scene()))]
        for name in lights[0]:
            self.assertTrue(np.array_equal(lights[0][name], lights[1][name]), name)
        back = self.light(self.bake("back", *few, scene=self.mirror_scene((0, 3, 2, 1))))
        self.assertEqual(back["caustic"].max(), 0.0)

    def test_wrong_values(self):
        for options in (("--photons", "0"), ("--photons", "-1"), ("--photons", "4294967296"), ("--iterations", "0"),
                        ("--iterations", "x"), ("--caustics", "fall"), ("--mis", "none"),
                        ("--mis", "optimal"), ("--connections", "0.5")):
            self.assertIn(options[0], self.bake("wrong", *LAND, *options, code=64))
        self.assertIn("--photons 2 or more", self.bake("wrong", *LAND, "--photons", "1", code=64))

    def test_without_gloss(self):
        """Where nothing bends light there are no paths, and no layer."""
        light = self.light(self.bake("diffuse", *LAND, "--bounces", "0", "--materials", "diffuse"))
        self.assertNotIn("caustic", light)


if __name__ == "__main__":
    unittest.main(verbosity=2)
