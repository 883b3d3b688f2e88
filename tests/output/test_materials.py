"""kiln bake --materials: light that mirrors, gloss and glass send on, in lightmaps. Embree."""
import json
import math
import os
import sys
import unittest

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
import harness  # noqa: E402
import price  # noqa: E402
from program import InOneFolder, kiln, run_json  # noqa: E402
from test_mirrors import WHITE, ball, gloss  # noqa: E402

FEW = ("--backend", "embree", "--quiet", "--no-export", "--no-preview", "--samples-probe", "0")


def light(folder, name="total"):
    with h5py.File(os.path.join(folder, "kiln.h5"), "r") as file:
        return file["irradiance/" + name][:]


def fields(folder):
    with h5py.File(os.path.join(folder, "kiln.h5"), "r") as file:
        return {name: values[:].tobytes() for name, values in file["irradiance"].items()}


def channels(folder, entry):
    return exr.read(os.path.join(folder, entry["lightmap"]))[0]


class Materials(InOneFolder):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        for name in ("cornell-spheres", "cornell-water", "cornell", "mirrors"):
            kiln("generate", name, "-o", os.path.join(cls.folder, name + ".glb"), "--quiet")

    def bake(self, scene, name, *options, **more):
        folder = os.path.join(self.folder, name)
        kiln("bake", os.path.join(self.folder, scene + ".glb"), "-o", folder, *FEW, *options, **more)
        return folder

    def test_furnace(self):
        """Walls that send 1 and reflect half of what comes: wherever one looks the radiance is 2, whatever white
        things mirror, bend and scatter it. What falls on these is of that radiance too. Not frosted glass, which is a
        little darker than white."""
        scene = glb.Scene()
        glb.box(scene, "wall", (-2, -2, -2), (12.5, 2, 2), scene.material("lamp", (0.5, 0.5, 0.5), radiance=(1, 1, 1)),
                inward=range(6))
        for i, (name, values) in enumerate(each for each in WHITE if not each[0].startswith("frosted")):
            ball(scene, name, (2.5 * i, 0.0, 0.0), 1.0, gloss(scene, name, **values), 12)
        scene.write(os.path.join(self.folder, "furnace.glb"))
        folder = self.bake("furnace", "furnace", "--materials", "auto", "--texels-per-metre", "2", "--samples-direct",
                           "512", "--samples-bounce", "64", "--samples-indirect", "256", "--denoise", "none",
                           "--samples-probe", "128", "--probe-spacing", "1.1", "--directional", "sh1")
        text, closed = harness.energy(run_json(folder))
        self.assertTrue(closed, text)
        for entry in run_json(folder)["objects"]:
            layers = channels(folder, entry)
            there = layers["validity.Y"] == 1
            mean = layers["G"][there].mean() / (2 * math.pi) - 1
            self.assertLess(abs(mean), 0.005 if entry["name"] == "wall" else 0.015, (entry["name"], mean))
        with h5py.File(os.path.join(folder, "volume.hdf"), "r") as file:
            probes = file["VTKHDF/PointData"]
            valid = probes["validity"][:] > 0.99
            for name in (sign + axis for sign in ("pos", "neg") for axis in "xyz"):
                mean = probes["irradiance_" + name][:][valid][:, 1].mean() / (2 * math.pi) - 1
                self.assertLess(abs(mean), 0.02, (name, mean))
        with h5py.File(os.path.join(folder, "kiln.h5"), "r") as file:
            zero = file["directional/sh"][:][:, 1]  # half of the sphere, each of radiance 2
            self.assertLess(abs(zero.mean() / (2 * math.sqrt(math.pi)) - 1), 0.01)

    def test_layers(self):
        """The layer of caustics is a part of the sum, and of what the bounces gather; the ledger closes with it, and
        tells what is left out without. It is there without an option."""
        options = ("--texels-per-metre", "4", "--quality", "draft", "--denoise", "none")
        few = ("--photons", "20000", "--iterations", "4")
        folder = self.bake("cornell-spheres", "layers", *options, *few)
        self.assertTrue(np.array_equal(light(folder), light(folder, "direct") + light(folder, "indirect") +
                                       light(folder, "caustic")))
        said = run_json(folder)["materials"]
        self.assertEqual((said["mode"], said["taken"], said["caustics"]), ("auto", 2, "vcm"))
        self.assertEqual(said["kinds"], {"metal": 1, "volume glass": 1})
        self.assertTrue(any("caustic.R" in channels(folder, entry)
                            for entry in run_json(folder)["objects"]))
        without = self.bake("cornell-spheres", "without", *options, "--caustics", "none")
        self.assertNotIn("caustic", fields(without))
        self.assertLess(light(without, "indirect").mean(), 0.97 * light(folder, "indirect").mean())
        for each in (folder, without):
            text, closed = harness.energy(run_json(each))
            self.assertTrue(closed, text)
        self.assertEqual(run_json(folder)["energy"]["unfound"], [0.0] * 3)
        self.assertGreater(run_json(without)["energy"]["unfound"][0], 1.0)
        clean = self.bake("cornell-spheres", "denoised", *options, *few, "--denoise", "regression",
                          "--no-stitch")
        for entry in run_json(folder)["objects"]:
            before, after = channels(folder, entry), channels(clean, entry)
            there = before["validity.Y"] == 1
            self.assertTrue(np.array_equal(before["caustic.G"][there], after["caustic.G"][there]), entry["name"])
        self.assertTrue(np.array_equal(light(clean, "error_caustic") > 0, light(clean, "caustic").max(1) > 0))
        kiln("verify", folder, "--quiet")
        kiln("view", folder, "--show", "caustic", "-o", os.path.join(self.folder, "caustic.png"), "--from=0,1,3",
             "--to=0,1,0", "--width", "32", "--height", "32", "--quiet")

    def test_view(self):
        """A view shows what mirrors and glass show of the lightmaps: the light of bidirectional paths, in blocks of
        pixels; --materials diffuse shows the balls as if they were plaster."""
        folder = self.bake("cornell-spheres", "viewed", "--texels-per-metre", "12", "--quality", "draft",
                           "--samples-indirect", "128", "--bounces", "3", "--photons", "20000", "--iterations", "8")
        size = ("--width", "64", "--height", "64", "--quiet")
        pictures = []
        for more in ((), ("--method", "bdpt", "--bounces", "3", "--samples-pixel", "64",
                          "--backend", "embree"), ("--materials", "diffuse")):
            path = os.path.join(self.folder, f"view{len(pictures)}.exr")
            kiln("view", folder, "-o", path, *size, *more)
            pictures.append(exr.rgb(path))
        # medians, for the noise of paths that find the lamp by a mirror is rare and bright
        blocks = [np.median(p.reshape(8, 8, 8, 8, 3), (1, 3)).mean(-1) for p in pictures]
        apart = [np.abs(b - blocks[1]) / blocks[1].mean() for b in (blocks[0], blocks[2])]
        print("blocks apart by %.3f at most, %.3f rms; diffuse %.3f at most" % (
            apart[0].max(), np.sqrt((apart[0] ** 2).mean()), apart[1].max()))
        self.assertLess(np.sqrt((apart[0] ** 2).mean()), 0.04)
        self.assertLess(apart[0].max(), 0.16)
        self.assertGreater(apart[1].max(), 0.4)

    @price.long
    def test_under_water(self):
        """What stands in glass is lit, though rays from it meet its back all round; the ledger closes."""
        folder = self.bake("cornell-water", "water", "--materials", "auto", "--texels-per-metre", "2", "--bounces", "0",
                           "--caustics", "land", "--photons", "20000", "--samples-direct", "64", "--samples-indirect",
                           "4", "--denoise", "none")
        with h5py.File(os.path.join(folder, "kiln.h5"), "r") as file:
            self.assertTrue(file["points/valid"][:].all())
        text, closed = harness.energy(run_json(folder))
        self.assertTrue(closed, text)

    @price.long
    def test_in_a_block(self):
        """A block of glass on a floor: probes in it keep their places, and a face of it parts the texels that it stands
        on, of which both sides are lit."""
        scene = glb.Scene()
        scene.quad("floor", [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], scene.material("grey", (0.5, 0.5, 0.5)))
        glb.box(scene, "block", (-1.3, 0, -1.3), (1.3, 1, 1.3), gloss(scene, "glass", **glb.GLASS))
        scene.light("lamp", {"type": "point", "intensity": 30.0}, translation=[0.2, 2.0, 0.1])
        scene.write(os.path.join(self.folder, "block.glb"))
        told = run_json(self.bake("block", "block", "--materials", "auto", "--texels-per-metre", "2", "--bounces", "0",
                                "--caustics", "none", "--samples-direct", "4", "--samples-probe", "4",
                                "--probe-spacing", "0.4"))
        probes = told["volume"]["probes"]
        self.assertEqual([probes[state] for state in ("moved", "filled", "buried")], [0, 0, 0])
        self.assertGreater(probes["in_place"], 100)
        self.assertGreater(told["points"]["divided"], 15)

    def test_lamps_without_size(self):
        """No gather ray meets a point by a mirror: its light that way is told as unfound, and the ledger closes."""
        folder = self.bake("mirrors", "mirrors", "--materials", "auto", "--caustics", "gather",
                           "--texels-per-metre", "4", "--quality", "draft")
        text, closed = harness.energy(run_json(folder))
        self.assertTrue(closed, text)
        self.assertGreater(run_json(folder)["energy"]["unfound"][1], 0.2 * run_json(folder)["energy"]["emitted"][1])
        self.assertTrue(any("left out" in note for note in run_json(folder)["notes"]))

    def test_same_bits(self):
        """On any number of ranks, in rounds; by hand also by the other schedule and in parts."""
        few = ("--photons", "2000", "--iterations", "4")
        others = (("--schedule", "equal", "--bounces", "2", "--exchange", "full", *few),
                  ("--bounces", "2", "--error-map", "--samples-direct", "32", *few))
        for i, more in enumerate((("--bounces", "all", "--caustics", "gather"),
                                  ("--bounces", "1", "--target-error", "0.4", "--rebalance", "always", *few),
                                  *(others if price.full else ()))):
            options = ("--materials", "auto", "--texels-per-metre", "2", "--quality", "draft", "--samples-indirect",
                       "16", *more)
            one = fields(self.bake("cornell-spheres", f"one{i}", *options))
            self.assertIn("caustic", one)
            self.assertEqual(one, fields(self.bake("cornell-spheres", f"three{i}", *options, ranks=3)), more)

    def test_nothing_to_take(self):
        """A scene without gloss is the same bake, bit for bit and step by step, and says why."""
        options = ("--texels-per-metre", "2", "--quality", "draft")
        bakes = [self.bake("cornell", mode, *materials, *options)
                 for mode, materials in (("auto", ()), ("diffuse", ("--materials", "diffuse")))]
        self.assertEqual(*(fields(folder) for folder in bakes))
        self.assertEqual(*(len(run_json(folder)["bounces"]) for folder in bakes))
        said = run_json(bakes[0])["materials"]
        self.assertEqual(said["taken"], 0)
        self.assertIn("no metal", said["why"])
        plans = [json.loads(kiln("plan", os.path.join(self.folder, "cornell.glb"), "--materials", mode, "--json",
                                 *options).stdout) for mode in ("auto", "diffuse")]
        self.assertEqual(*(plan["disk_bytes"]["kiln_h5"] for plan in plans))

    def test_refusals(self):
        scene = os.path.join(self.folder, "cornell-spheres.glb")
        for words in (("--materials", "shiny"), ("--caustics", "all"), ("--chain-length", "0")):
            self.assertIn(words[0], kiln("bake", scene, *words, code=64).stderr)


if __name__ == "__main__":
    unittest.main()
