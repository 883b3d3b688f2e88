"""--caustics land and vcm: light paths bring what gather rays find, alone and shared with these; the same bits on any
ranks; errors as large as they say."""
import itertools
import json
import os
import subprocess
import tempfile
import unittest

import h5py
import numpy as np

KILN = os.environ["KILN"]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
SMALL = ("--backend", "embree", "--texels-per-metre", "2", "--materials", "auto", "--samples-probe", "0", "--denoise",
         "none", "--samples-direct", "4", "--samples-bounce", "2", "--samples-indirect", "4", "--no-preview", "--quiet")
LAND = ("--caustics", "land", "--photons", "40000", "--iterations", "3")
VCM = ("--caustics", "vcm", "--photons", "20000", "--iterations", "3", "--samples-indirect", "64")
WAYS = {"land": LAND, "vcm": VCM}
CONNECTED = {"connected": (*VCM, "--connections", "0.5")}


class Land(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = temporary.name
        cls.scene = os.path.join(cls.folder, "spheres.glb")
        subprocess.run([KILN, "generate", "cornell-spheres", "-o", cls.scene, "--quiet"], check=True)

    def bake(self, name, *options, ranks=0, code=0, scene=None):
        """The folder of the bake; or what it says where it ends with another code."""
        folder = os.path.join(tempfile.mkdtemp(dir=self.folder), name)
        start = ["mpirun", "-n", str(ranks)] if ranks else []
        command = [*start, KILN, "bake", scene or self.scene, "-o", folder, *SMALL, *options]
        done = subprocess.run(command, capture_output=True, text=True)
        self.assertEqual(done.returncode, code, done.stderr)
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

    def test_faint_gloss_as_gathered(self):
        """All surfaces are glossy, and the lamp stands within the spheres of some of them."""
        scene = os.path.join(self.folder, "cornell.glb")
        subprocess.run([KILN, "generate", "cornell", "-o", scene, "--quiet"], check=True)
        self.check_as_gathered(scene, ["floor", "left_red", "ceiling", "tall_block"], ("--materials", "full"), 0.2,
                               {**WAYS, **CONNECTED})

    @staticmethod
    def error(values):
        return values.std(0, ddof=1) / np.sqrt(len(values))

    def test_same_bits(self):
        for way, options in {**WAYS, **CONNECTED}.items():
            runs = ((0, 1), (0, 2), (2, 1), (3, 1))
            lights = [self.light(self.bake("%s-%d-%d" % (way, *run), *options, "--bounces", "1", "--threads",
                                           str(run[1]), ranks=run[0])) for run in runs]
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
        with open(os.path.join(self.bake("report", *LAND, "--bounces", "0"), "run.json"), encoding="utf-8") as file:
            materials = json.load(file)["materials"]
        self.assertEqual([materials[name] for name in ("caustics", "photons", "iterations")], ["land", 40000, 3])
        self.assertNotIn("mis", materials)
        with open(os.path.join(self.bake("shared", *VCM, "--bounces", "0", "--mis", "power"), "run.json"),
                  encoding="utf-8") as file:
            report = json.load(file)
        self.assertEqual([report["materials"][name] for name in ("caustics", "mis", "photons")],
                         ["vcm", "power", 20000])
        self.assertEqual(report["energy"]["unfound"], [0.0, 0.0, 0.0])
        self.assertLess(abs(report["energy"]["residual"]), 5.0 * report["energy"]["error"])

    def test_wrong_values(self):
        for options in (("--photons", "0"), ("--photons", "-1"), ("--photons", "4294967296"), ("--iterations", "0"),
                        ("--iterations", "x"), ("--caustics", "fall"), ("--mis", "none"),
                        ("--connections", "0.5"), ("--connections", "1.1")):
            self.assertIn(options[0], self.bake("wrong", *LAND, *options, code=64))
        self.assertIn("--photons 2 or more", self.bake("wrong", *LAND, "--photons", "1", code=64))

    def test_without_gloss(self):
        """Where nothing bends light there are no paths, and no layer."""
        light = self.light(self.bake("diffuse", *LAND, "--bounces", "0", "--materials", "diffuse"))
        self.assertNotIn("caustic", light)


if __name__ == "__main__":
    unittest.main(verbosity=2)
