"""kiln view --method light, bdpt, vcm, ...: the light of --method path, light that only they find, the same bits on any
number of ranks and threads, both backends."""
import json
import os
import sys
import unittest

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
import price  # noqa: E402
from program import InOneFolder, flat, kiln_on_host as kiln  # noqa: E402

DATA = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "data")
SIZE = ("--width", "32", "--height", "32")
SEEDS = 6
MERGE, RADIUS = ("vcm", "vcm-single", "ppm", "sppm"), "0.02"


class Bidirectional(InOneFolder):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.known = {}

    def scene(self, name):
        path = os.path.join(self.folder, name + ".glb")
        if not os.path.exists(path):
            kiln("generate", name, "-o", path, "--quiet")
        return path

    def flat(self, name):
        """The same as kiln's own scene file."""
        folder = os.path.join(self.folder, name)
        return os.path.join(folder, "scene.kscene") if os.path.exists(folder) else flat(self.scene(name), folder)

    def view(self, scene, method, *options, **more):
        path = os.path.join(self.folder, "view.exr")
        if method in MERGE and "--merge-radius" not in options:
            options = (*options, "--merge-radius", RADIUS)
        kiln("view", scene, "--method", method, "-o", path, "--quiet", *options, **more)
        return exr.rgb(path)

    def by_path(self, scene, *options):
        """Means by --method path, found once for each scene and its options."""
        known = Bidirectional.known
        if (scene, options) not in known:
            known[scene, options] = self.means(scene, "path", 64, *options)
        return known[scene, options]

    def means(self, scene, method, samples, *options):
        """Means of the whole and of 4 x 4 blocks, with their standard errors by the spread of pictures of several
        seeds. Those of blocks come from few pictures each: their own mean square holds them up."""
        light = np.array([self.view(scene, method, "--samples-pixel", str(samples), "--seed", str(seed), *SIZE,
                                    *options) @ (0.2126, 0.7152, 0.0722) for seed in range(SEEDS)])
        blocks = light.reshape(SEEDS, 4, 8, 4, 8).mean((2, 4)).reshape(SEEDS, 16)
        variance = blocks.var(0, ddof=1) / SEEDS
        return (light.mean(), light.mean((1, 2)).std(ddof=1) / SEEDS ** 0.5, blocks.mean(0),
                np.sqrt((variance + variance.mean()) / 2))

    def agree(self, scene, methods, samples, *options):
        """Within 5 standard errors, which must be small."""
        want = self.by_path(scene, *options)
        for method in methods:
            got = self.means(scene, method, samples, *options)
            off = abs(got[0] - want[0]) / np.hypot(got[1], want[1])
            blocks = np.abs(got[2] - want[2]) / np.hypot(got[3], want[3])
            self.assertLess(got[1] / got[0], 0.04, (scene, method))
            self.assertLess(off, 5, (scene, method, got[0], want[0]))
            self.assertLess(blocks.max(), 5, (scene, method))

    def test_diffuse(self):
        self.agree(self.flat("cornell"), ("light",), 64, "--bounces", "2")
        self.agree(self.flat("cornell"), ("bdpt", "vcm", "vcm-single", "sppm"), 8, "--bounces", "2")

    def test_ppm(self):
        """The camera's paths are the same in all samples: a pixel's place differs, its light does not."""
        self.agree(self.flat("cornell"), ("ppm",), 16, "--bounces", "2")

    def test_glass(self):
        """A mirror and a ball of glass under an area light: caustics that all of them find."""
        self.agree(self.flat("cornell-spheres"), ("bdpt", "vcm", "sppm"), 8, "--bounces", "1", "--materials", "auto")

    def test_lights(self):
        """Suns, points and spots, one of them with a range; two hundred lamps."""
        self.agree(os.path.join(DATA, "punctual_zoo.glb"), ("bdpt", "vcm"), 8, "--bounces", "1")
        self.agree(os.path.join(DATA, "many_lights.glb"), ("bdpt",), 8, "--bounces", "1")

    @price.long
    def test_sky(self):
        """Image and constant sky, through the open side of the box."""
        image = os.path.join(self.folder, "sky.hdr")
        rows, columns = 8, 16
        texels = np.full((rows, columns, 4), (100, 120, 160, 128), np.uint8)
        texels[2, 3] = (255, 240, 200, 133)
        with open(image, "wb") as file:
            file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (rows, columns) + texels.tobytes())
        for sky in (image, "0.5,0.7,1"):
            bake = os.path.join(self.folder, "bake" + str(sky == image))
            kiln("bake", self.scene("cornell"), "-o", bake, "--texels-per-metre", "2", "--quality", "draft",
                 "--bounces", "0", "--samples-probe", "0", "--denoise", "none", "--no-preview", "--no-export",
                 "--quiet", "--environment", sky)
            self.agree(bake, ("bdpt", "vcm") if sky == image else ("bdpt",), 8, "--bounces", "1")

    def through_pane(self, ways):
        """A floor under a smooth pane, seen straight, and a sun at 60 degrees: light comes twice through the pane, less
        what it reflects each time. `ways`: method, backend, how near the light must come."""
        scene, path = glb.Scene(), os.path.join(self.folder, "pane.glb")
        for name, height, material in (("floor", 0, scene.material("grey", (0.5, 0.5, 0.5))), ("pane", 1, glb.gloss(
                scene, "pane", transmission={"transmissionFactor": 1.0}))):
            scene.quad(name, [(-9, height, 9), (9, height, 9), (9, height, -9), (-9, height, -9)], material)
        scene.light("sun", {"type": "directional", "intensity": 2.0}, rotation=[-np.sin(np.pi / 12), 0, 0,
                                                                                 np.cos(np.pi / 12)])
        other = np.sqrt(1 - 0.75 / 1.5 ** 2)
        across, along = (0.5 - 1.5 * other) / (0.5 + 1.5 * other), (other - 0.75) / (other + 0.75)
        wanted = 0.5 / np.pi * (1 - (across ** 2 + along ** 2) / 2) * (1 - 0.04)
        scene.write(path)
        for method, backend, within in ways:
            options = ("--bounces", "0", "--from=0,20,0", "--to=0,0,0", "--field-of-view", "0.5", "--width", "16",
                       "--height", "16", "--samples-pixel", "16", "--backend", backend)
            image = self.view(path, method, *options, "--materials", "auto")
            self.assertLess(abs(image.mean() / wanted - 1), within, (method, backend, image.mean(), wanted))
            image = self.view(path, method, *options, "--materials", "diffuse")
            self.assertLess(abs(image.mean() * np.pi * 2 - 1), within, (method, backend, image.mean()))

    def test_pane(self):
        self.through_pane([("path", "embree", 1e-5), ("bdpt", "embree", 0.01), ("vcm", "embree", 0.02)])

    @price.long
    def test_pane_on_a_device(self):
        """A software device takes a minute to make the kernel."""
        self.needs_device()
        self.through_pane([("path", "vulkan", 1e-5)])

    def test_mirror_of_a_point(self):
        """Light of a point by way of mirrors, which --method path does not find: vcm and sppm see the same."""
        options = ("--bounces", "1", "--materials", "auto")
        scene = self.flat("mirrors")
        vcm, sppm, path = (self.means(scene, method, 16, *options) for method in ("vcm", "sppm", "path"))
        self.assertLess(abs(vcm[0] - sppm[0]), 5 * np.hypot(vcm[1], sppm[1]) + 0.02 * vcm[0])
        self.assertGreater(vcm[0], 1.5 * path[0])
        for method, materials, said in (("path", "auto", True), ("path", "diffuse", False), ("vcm", "auto", False)):
            told = kiln("view", scene, "--method", method, "--materials", materials, "--samples-pixel", "1", *SIZE,
                        "-o", os.path.join(self.folder, "view.exr")).stderr
            self.assertEqual("--method vcm or bdpt finds it" in told, said, (method, materials, told))
        lamp = kiln("view", self.flat("cornell-spheres"), "--method", "path", "--materials", "auto", *SIZE,
                    "--samples-pixel", "1", "-o", os.path.join(self.folder, "view.exr")).stderr
        self.assertNotIn("finds it", lamp)

    def test_length(self):
        """A closed box that emits 1 and reflects half of it: 1 + 1/2 + 1/4 for paths of three rays."""
        furnace = os.path.join(self.folder, "furnace.glb")
        kiln("generate", "furnace", "--albedo", "0.5", "-o", furnace, "--quiet")
        for method in ("light", "bdpt", "vcm", "vcm-single", "ppm", "sppm"):
            for length in (1, 2, 3):
                image = self.view(furnace, method, "--from=0.1,0.2,0.1", "--to=0.9,0.3,0.2", "--bounces", "all",
                                  "--width", "24", "--height", "16", "--samples-pixel", "16", "--path-length",
                                  str(length))
                wanted, within = 2 - 0.5 ** (length - 1), 0.03 if method in ("ppm", "sppm") else 0.01
                self.assertLess(abs(image.mean() / wanted - 1), within if length > 1 else 1e-5, (method, length))

    @price.long
    def test_length_of_chains(self):
        """Mirrors and glass count as walls do."""
        self.agree(self.flat("cornell-spheres"), ("bdpt", "vcm"), 8, "--materials", "auto", "--path-length", "4")

    def test_lens(self):
        """A wide lens that is focused before the back wall: the light of --method path, place by place."""
        lens = ("--lens-radius", "0.1", "--focus-distance", "1.5")
        self.agree(self.flat("cornell"), ("light",), 64, "--bounces", "1", *lens)
        self.agree(self.flat("cornell"), ("bdpt", "vcm"), 8, "--bounces", "1", *lens)

    @price.long
    def test_blur(self):
        """A lens of radius R, focused at f, adds half of (R |1 / f - 1 / d|)^2 to the second moment of what lies at
        distance d. Paths of light alone see the patch."""
        at, half, pixels = 2.0, 0.1, 48
        scene = glb.Scene()
        scene.quad("patch", [(-half, -half, -at), (half, -half, -at), (half, half, -at), (-half, half, -at)],
                   scene.material("grey", (0.5, 0.5, 0.5)))
        scene.light("spot", {"type": "spot", "intensity": 100.0,
                             "spot": {"innerConeAngle": 0.074, "outerConeAngle": 0.075}})
        path = scene.write(os.path.join(self.folder, "patch.glb"))
        x = ((np.arange(pixels) + 0.5) / pixels * 2 - 1) * np.tan(np.radians(20) / 2)
        for radius, focus in (("0.2", "4"), ("0.2", "2"), ("0.1", "1")):
            image = self.view(path, "light", "--from=0,0,0", "--to=0,0,-1", "--field-of-view", "20", "--width",
                              str(pixels), "--height", str(pixels), "--samples-pixel", "4", "--lens-radius", radius,
                              "--focus-distance", focus)[..., 0]
            moment = (image * (x[:, None] ** 2 + x[None, :] ** 2)).sum() / image.sum()
            disc = float(radius) * abs(1 / float(focus) - 1 / at)
            wanted = disc ** 2 / 2 + 2 / 3 * (half / at) ** 2 + (x[1] - x[0]) ** 2 / 6
            self.assertLess(abs(np.sqrt(moment / wanted) - 1), 0.01, (radius, focus))

    def test_radius(self):
        """Small pictures have few paths of light: the automatic radius has some of them around each place."""
        path, light = os.path.join(self.folder, "radius.exr"), []
        for method, samples, *radius in (("vcm", "64"), ("sppm", "16"), ("sppm", "16", "--merge-radius", "0.0143")):
            kiln("view", self.flat("cornell-spheres"), "--method", method, "--samples-pixel", samples, *SIZE,
                 "--materials", "auto", "-o", path, "--quiet", *radius)
            light.append(exr.rgb(path))
        auto, narrow = (((image - light[0]) ** 2).mean() for image in light[1:])
        self.assertLess(auto, narrow / 4)

    def test_radius_of_a_pixel(self):
        """The automatic radius: half a pixel where the picture's median depth is, for photon mapping a whole one; to
        4.5 %, by which depths are rounded. Small pictures count as having 32 x 32 pixels."""
        scene = glb.Scene()
        grey = scene.material("grey", (0.5, 0.5, 0.5))
        scene.quad("wall", [(-9, -9, -3), (9, -9, -3), (9, 9, -3), (-9, 9, -3)], grey)
        scene.light("spot", {"type": "spot", "intensity": 100.0})
        path = scene.write(os.path.join(self.folder, "wall.glb"))
        wide = 2 * np.tan(np.radians(40) / 2)
        for method, size, view, wanted in (("vcm", 64, ("--from=0,0,0",), 0.5 * 3 * wide / 64),
                                           ("sppm", 64, ("--from=0,0,0",), 3 * wide / 64),
                                           ("sppm", 64, ("--from=0,0,-1",), 2 * wide / 64),
                                           ("sppm", 16, ("--from=0,0,0",), 3 * wide / 32)):
            said = kiln("view", path, "--method", method, *view, "--to=0,0,-3", "--field-of-view", "40", "--width",
                        str(size), "--height", str(size), "--samples-pixel", "1", "--json", "-o",
                        os.path.join(self.folder, "view.exr")).stdout
            self.assertLess(abs(json.loads(said)["merge_radius"] / wanted - 1), 0.045, (method, size, view))

    @price.long
    def test_radius_beside_a_plain(self):
        """A room on a plain 100 times as wide: the automatic radius goes by what the camera sees, and light stays
        within the room's walls."""
        scene = glb.Scene()
        scene.load(self.scene("cornell"))
        scene.quad("plain", [(-300, -0.1, 300), (300, -0.1, 300), (300, -0.1, -300), (-300, -0.1, -300)],
                   scene.material("earth", (0.5, 0.5, 0.5)))
        path = scene.write(os.path.join(self.folder, "plain.glb"))
        self.agree(path, ("vcm",), 8, "--bounces", "2", "--merge-radius", "auto")

    def test_ranks(self):
        """The same bits over any number of ranks and threads."""
        size = ("--width", "21", "--height", "13", "--bounces", "2", "--samples-pixel", "9", "--materials", "auto",
                "--merge-radius", "auto")
        for method in ("light", "bdpt", "vcm", "sppm"):
            images = [self.view(self.flat("cornell-spheres"), method, *size, "--threads", str(threads), ranks=ranks)
                      for ranks, threads in ((1, 2), (3, 1))]
            self.assertGreater(images[0].mean(), 0)
            np.testing.assert_array_equal(images[0], images[1], method)

    def same_on_both(self, scene, method, *options):
        """The same paths on both backends, but for rounding: pixels are the same to 0.01 % but where a path is near to
        another way."""
        small = ("--width", "24", "--height", "24", "--samples-pixel", "3", *options)
        one, other = (self.view(scene, method, *small, "--backend", backend) for backend in ("embree", "vulkan"))
        far = np.abs(one - other).max(-1) > 1e-4 * one.max(-1) + 1e-6
        self.assertGreater(one.mean(), 0)
        self.assertLess(far.mean(), 0.01, (scene, method))
        self.assertLess(abs(other.mean() / one.mean() - 1), 2e-3, (scene, method))

    def needs_device(self):
        if not any(d["fit"] for d in json.loads(kiln("info", "--devices", "--json").stdout)["vulkan"]):
            self.skipTest("no Vulkan device")

    def test_vulkan(self):
        """Connections, merging within the same radius, what the camera sees of paths of light; diffuse surfaces,
        through a lens."""
        self.needs_device()
        self.same_on_both(self.scene("cornell"), "vcm", "--bounces", "2", "--lens-radius", "0.05", "--focus-distance",
                          "2", "--path-length", "4", "--merge-radius", "auto")

    @price.long
    def test_on_gpus(self):
        """All methods and lights; mirrors and glass; more vertices of light than there is room for at first; ranks. A
        software device takes minutes to make the kernels."""
        self.needs_device()
        for method in ("light", "bdpt", "vcm-single", "ppm", "sppm"):
            self.same_on_both(self.scene("cornell"), method, "--bounces", "all")
        self.same_on_both(os.path.join(DATA, "punctual_zoo.glb"), "vcm", "--bounces", "1")
        self.same_on_both(os.path.join(DATA, "many_lights.glb"), "bdpt", "--bounces", "1")
        for scene, method in (("cornell-spheres", "vcm"), ("cornell-spheres", "sppm"), ("mirrors", "bdpt")):
            self.same_on_both(self.scene(scene), method, "--bounces", "2", "--materials", "auto")
        self.same_on_both(self.scene("furnace"), "light", "--bounces", "8", "--from=0.1,0.2,0.1", "--to=0.9,0.3,0.2")
        size = ("--width", "21", "--height", "13", "--bounces", "2", "--samples-pixel", "3", "--backend", "vulkan")
        for method in ("light", "bdpt", "vcm", "sppm"):
            images = [self.view(self.scene("cornell"), method, *size, ranks=ranks) for ranks in (1, 3)]
            np.testing.assert_array_equal(images[0], images[1], method)

    def test_refused(self):
        out = ("-o", os.path.join(self.folder, "no.exr"))
        for options, words in ((("--method", "bdpt", "--merge-radius", "1"), "nothing is merged"),
                               (("--method", "path", "--merge-radius", "1"), "nothing is merged"),
                               (("--method", "vcm", "--merge-radius", "0"), "merge-radius"),
                               (("--method", "vcm", "--show", "texels"), "--method vcm --show texels")):
            said = kiln("view", self.scene("cornell"), *options, *out, code=64).stderr
            self.assertIn(words, said)


if __name__ == "__main__":
    unittest.main()
