"""--caustics land: light paths bring what gather rays find; the same bits on any ranks; errors as large as they say."""
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


class Land(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = temporary.name
        cls.scene = os.path.join(cls.folder, "spheres.glb")
        subprocess.run([KILN, "generate", "cornell-spheres", "-o", cls.scene, "--quiet"], check=True)

    def bake(self, name, *options, ranks=0, code=0):
        """The folder of the bake; or what it says where it ends with another code."""
        folder = os.path.join(self.folder, name)
        start = ["mpirun", "-n", str(ranks)] if ranks else []
        done = subprocess.run([*start, KILN, "bake", self.scene, "-o", folder, *SMALL, *options], capture_output=True,
                              text=True)
        self.assertEqual(done.returncode, code, done.stderr)
        return folder if code == 0 else done.stderr

    @staticmethod
    def light(folder):
        with h5py.File(os.path.join(folder, "kiln.h5")) as file:
            values = {name: file["irradiance"][name][...] for name in file["irradiance"]}
            values.update(area=file["points/area"][...], object=file["points/object"][...],
                          names=[name.decode() for name in file["objects/name"][...]])
            return values

    def test_as_gathered(self):
        """Power of caustics on each wall and on all, by paths and by gather rays, within 5 standard errors, which the
        spread of some seeds tells."""
        def powers(folder):
            light = self.light(folder)
            power = (light["caustic"] @ LUMINANCE) * light["area"]
            walls = [power[light["object"] == light["names"].index(name)].sum() for name in names]
            return np.array([*walls, sum(walls)])

        names = ["floor", "back", "left_red", "right_green", "ceiling"]
        landed = np.array([powers(self.bake("land%d" % seed, *LAND, "--bounces", "0", "--seed", str(seed)))
                           for seed in range(3)])
        gathered = np.array([powers(self.bake("gather%d" % seed, "--bounces", "0", "--seed", str(seed), "--caustics",
                                              "gather", "--samples-indirect", "1024")) for seed in range(6)])
        for values, name in ((landed, "land"), (gathered, "gather")):
            print(name, *("%.4f +- %.4f" % pair for pair in zip(values.mean(0), self.error(values))))
        difference = np.abs(landed.mean(0) - gathered.mean(0))
        limit = 5.0 * np.hypot(self.error(landed), self.error(gathered))
        self.assertTrue(np.all(difference < limit), (difference, limit))
        self.assertLess(limit[-1], 0.15 * gathered.mean(0)[-1])

    @staticmethod
    def error(values):
        return values.std(0, ddof=1) / np.sqrt(len(values))

    def test_same_bits(self):
        lights = [self.light(self.bake("ranks%d" % ranks, *LAND, "--bounces", "1", "--threads", "1", ranks=ranks))
                  for ranks in (1, 2, 3)]
        for other in lights[1:]:
            for name in lights[0]:
                self.assertTrue(np.array_equal(lights[0][name], other[name]), name)
        self.assertGreater(lights[0]["caustic"].max(), 0.1)

    def test_errors(self):
        """Two bakes differ by what their errors say; the error falls with the root of the paths."""
        few = self.light(self.bake("few", *LAND, "--bounces", "0", "--samples-direct", "512", "--seed", "3"))
        more = self.light(self.bake("more", *LAND, "--bounces", "0", "--samples-direct", "512", "--seed", "4",
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

    def test_wrong_values(self):
        for options in (("--photons", "0"), ("--photons", "-1"), ("--photons", "4294967296"), ("--iterations", "0"),
                        ("--iterations", "x"), ("--caustics", "fall")):
            self.assertIn(options[0], self.bake("wrong", *LAND, *options, code=64))
        self.assertIn("--photons 2 or more", self.bake("wrong", *LAND, "--photons", "1", code=64))

    def test_without_gloss(self):
        """Where nothing bends light there are no paths, and no layer."""
        light = self.light(self.bake("diffuse", *LAND, "--bounces", "0", "--materials", "diffuse"))
        self.assertNotIn("caustic", light)


if __name__ == "__main__":
    unittest.main(verbosity=2)
