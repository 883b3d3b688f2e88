"""--method path, bdpt, vcm: texels by paths, held against a bake that gathers radiosity and against each other; the
same bits on any ranks; a ledger that closes; what they refuse."""
import json
import os
import sys
import unittest

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
import price  # noqa: E402
from program import InOneFolder, kiln, run_json  # noqa: E402

DATA = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "data")
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
SMALL = ("--samples-probe", "0", "--denoise", "none", "--no-preview", "--no-export", "--quiet", "--backend", "embree")
COARSE = ("--texels-per-metre", "2", "--samples-direct", "16")


class Reference(InOneFolder):
    def scene(self, name):
        path = os.path.join(self.folder, name + ".glb")
        if not os.path.exists(path):
            kiln("generate", name, "-o", path, "--quiet")
        return path

    def bake(self, scene, method, *options, ranks=0, code=0):
        """The folder of the bake; or what it says where it ends with another code."""
        folder = os.path.join(self.folder, "bake")
        done = kiln("bake", scene, "-o", folder, "--no-resume", *SMALL, *options, "--method", method, ranks=ranks,
                    code=code)
        return folder if code == 0 else done.stderr

    @staticmethod
    def light(folder):
        with h5py.File(os.path.join(folder, "kiln.h5")) as file:
            values = {name: file["irradiance"][name][...] for name in file["irradiance"]}
            values.update(area=file["points/area"][...], object=file["points/object"][...],
                          names=[name.decode() for name in file["objects/name"][...]])
            return values

    def powers(self, scene, method, samples, seeds, *options):
        """Power of what is not direct light on each object and on all, the mean of some seeds, and its standard error:
        what points state, or the spread of the seeds where that is more."""
        found, stated = [], []
        for seed in range(seeds):
            light = self.light(self.bake(scene, method, *COARSE, "--samples-indirect", str(samples), "--seed",
                                         str(seed), *options))
            power = (light["total"] - light["direct"]) @ LUMINANCE * light["area"]
            square = (light["error"] * light["area"]) ** 2
            sets = [light["object"] == i for i in range(len(light["names"]))] + [power == power]
            found.append([power[s].sum() for s in sets])
            stated.append([square[s].sum() for s in sets])
        found = np.array(found)
        spread = found.std(0, ddof=1) / seeds**0.5 if seeds > 1 else 0.0
        return found.mean(0), np.maximum(spread, np.sqrt(np.mean(stated, 0) / seeds))

    def agree(self, scene, one, other, bias=0.0):
        difference, error = np.abs(one[0] - other[0]), np.hypot(one[1], other[1])
        text = "%s: %s +- %s and %s +- %s" % (scene, one[0], one[1], other[0], other[1])
        print(text)
        self.assertTrue(np.all(difference <= 5.0 * error + bias * other[0]), text)
        self.assertLess(error[-1], 0.04 * other[0][-1], text)

    def methods(self, scene, *options, gathered=(), bias=0.0, samples=(128, 64, 32), seeds=2):
        """All three, and a bake that gathers: its radiosity is of whole texels, which is the bias that is allowed."""
        path = self.powers(scene, "path", samples[0], seeds, *options)
        for method, number in (("bdpt", samples[1]), ("vcm", samples[2])):
            self.agree(scene, self.powers(scene, method, number, seeds, *options), path)
        cells = self.powers(scene, "cells", 128, 1, *options, "--samples-bounce", "64", *gathered)
        self.agree(scene, cells, path, bias)

    def test_diffuse(self):
        self.methods(self.scene("cornell"), "--bounces", "3", bias=0.06)

    @price.long
    def test_finer(self):
        """With finer texels the bake that gathers comes to what paths find."""
        scene, options = self.scene("cornell"), ("--bounces", "2", "--texels-per-metre", "10")
        path = self.powers(scene, "path", 48, 1, *options)
        self.agree(scene, self.powers(scene, "cells", 64, 1, *options, "--samples-bounce", "64"), path, 0.004)

    @price.long
    def test_all_bounces(self):
        """Without a last bounce: with the tail of the bake."""
        path = self.powers(self.scene("cornell"), "path", 128, 1)
        self.agree("cornell", self.powers(self.scene("cornell"), "cells", 128, 1, "--samples-bounce", "64"), path, 0.06)

    def test_glass(self):
        """A mirror, and glass that bounds a body: caustics of an area light, and their bounces."""
        self.methods(self.scene("cornell-spheres"), "--materials", "auto", "--bounces", "1", bias=0.06,
                     gathered=("--photons", "50000", "--iterations", "4"),
                     samples=(512, 96, 64) if price.full else (256, 64, 48),
                     seeds=3 if price.full else 2)

    @price.long
    def test_caustics_alone(self):
        """No bounce: what light brings that has met no diffuse surface."""
        options = ("--materials", "auto", "--bounces", "0")
        scene = self.scene("cornell-spheres")
        land = self.powers(scene, "cells", 16, 1, *options, "--photons", "50000")
        self.agree(scene, self.powers(scene, "vcm", 64, 4, *options), land, 0.02)

    @price.long
    def test_let_through(self):
        """Half of the light goes through a block, which has two sides."""
        path = os.path.join(self.folder, "half.glb")
        scene = glb.Scene()
        scene.load(self.scene("cornell"))
        for node in scene.document["nodes"]:
            if node.get("name") == "tall_block":
                number = scene.document["meshes"][node["mesh"]]["primitives"][0]["material"]
                material = json.loads(json.dumps(scene.document["materials"][number]))
                scene.document["materials"].append(material)
                scene.document["meshes"][node["mesh"]]["primitives"][0]["material"] = len(
                    scene.document["materials"]) - 1
                material.update(alphaMode="BLEND", doubleSided=True)
                material["pbrMetallicRoughness"]["baseColorFactor"][3] = 0.5
                break
        else:
            self.fail("no tall block")
        scene.write(path)
        self.methods(path, "--bounces", "2", bias=0.06)

    def test_sky_and_points(self):
        """A constant sky, which rays meet; lamps without size and suns, which they do not."""
        self.methods(os.path.join(DATA, "punctual_zoo.glb"), "--bounces", "1", "--environment", "0.3,0.4,0.5",
                     bias=0.06)

    def test_mirrors_of_a_point(self):
        """Merging at the point itself finds what no ray meets: the lamp behind mirrors."""
        scene, options = self.scene("mirrors"), ("--materials", "auto", "--bounces", "1")
        land = self.powers(scene, "cells", 64, 1, *options, "--photons", "50000", "--iterations", "4")
        vcm = self.powers(scene, "vcm", 64, 2, *options)
        rough = slice(0, 2)  # floor and ceiling
        self.agree(scene, (vcm[0][rough], vcm[1][rough]), (land[0][rough], land[1][rough]), 0.03)

    def test_same_bits(self):
        """Over ranks; and direct light is the gathering bake's."""
        for method in ("path", "bdpt", "vcm"):
            options = (*COARSE, "--materials", "auto", "--samples-indirect", "4", "--bounces", "2", "--threads", "1")
            lights = [self.light(self.bake(self.scene("cornell-spheres"), method, *options, ranks=ranks))
                      for ranks in (1, 3)]
            for name in lights[0]:
                self.assertTrue(np.array_equal(lights[0][name], lights[1][name]), (method, name))
            self.assertGreater(lights[0]["indirect"].max(), 0.1)
        cells = self.light(self.bake(self.scene("cornell-spheres"), "cells", *options, "--photons", "1000"))
        self.assertTrue(np.array_equal(cells["direct"], lights[0]["direct"]))

    def test_radius(self):
        """Where none is given light is merged by the width of the median texel, whatever a few large ones are like."""
        options = (*COARSE, "--samples-indirect", "4", "--bounces", "1")
        floor = ("--objects", "{floor: {density-scale: 0.25}}")

        def merged(*more):
            folder = self.bake(self.scene("cornell"), "vcm", *options, *more)
            return self.light(folder), run_json(folder)["merge_radius"]

        by_kiln, radius = merged()
        for light, found in ((by_kiln, radius), merged(*floor)):
            texel, count = np.sort(light["area"])[(len(light["area"]) - 1) // 2] ** 0.5, len(light["area"])
            self.assertLess(abs(np.log2(found / (texel * np.sqrt(count / (np.pi * (1 << 14)))))), 1 / 15)
            print("median texel %.4f m, %d points, merged within %.5f m" % (texel, count, found))
        for factor, same in ((1.0, True), (1.3, False)):
            given = self.light(self.bake(self.scene("cornell"), "vcm", *options, "--merge-radius",
                                         repr(float(radius * factor))))
            self.assertEqual(np.allclose(given["indirect"], by_kiln["indirect"], rtol=1e-5), same, factor)

    def test_ledger(self):
        """Closes though nothing bounces: by what becomes of rays from what sends the light that paths have found."""
        for options, methods in ((("--bounces", "2"), ("path",)), (("--bounces", "all"), ("bdpt",)),
                                 (("--bounces", "0"), ("path",))):
            for method in ("path", "bdpt") if price.full else methods:
                folder = self.bake(self.scene("cornell-spheres"), method, *COARSE, "--samples-indirect", "256",
                                   "--materials", "auto", *options)
                energy = run_json(folder)["energy"]
                self.assertLess(abs(energy["residual"]), 5 * energy["error"], (method, options))
                self.assertLess(energy["relative_residual"], 0.01, (method, options))
                if options[1] == "all":
                    self.assertLess(abs(energy["left_over"][1]), 1e-9 * energy["emitted"][1])

    @price.long
    def test_errors(self):
        """Two seeds differ by what their errors say."""
        for method in ("path", "bdpt"):
            one, other = (self.light(self.bake(self.scene("cornell"), method, *COARSE, "--samples-direct", "64",
                                               "--samples-indirect", "64", "--bounces", "2", "--seed", str(seed)))
                          for seed in (3, 4))
            good = (one["error"] > 0) & (other["error"] > 0)
            apart = ((one["total"] - other["total"]) @ LUMINANCE)[good] / np.hypot(one["error"], other["error"])[good]
            self.assertTrue(0.6 < np.sqrt((apart**2).mean()) < 1.4, np.sqrt((apart**2).mean()))

    def test_refused(self):
        scene = self.scene("cornell")
        for options, words in ((("--schedule", "equal"), "--schedule"),
                               (("--guide", "auto"), "--guide"), (("--final-scale", "2"), "--final-scale"),
                               (("--indirect-scale", "2"), "--indirect-scale"), (("--tail",), "--tail"),
                               (("--caustics", "land"), "--caustics"), (("--tracing-range", "1"), "--tracing-range")):
            said = self.bake(scene, "path", *options, code=64)
            self.assertIn(words, said)
            self.assertIn("--method", said)


if __name__ == "__main__":
    unittest.main(verbosity=2)
