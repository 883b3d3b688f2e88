"""kiln view --method path: closed forms, the light of a bake, both backends, the same bits on any number of ranks."""
import json
import os
import sys
import unittest

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
import png  # noqa: E402
import price  # noqa: E402
from program import InOneFolder, kiln_on_host as kiln  # noqa: E402

DATA = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "data")
RHO = 0.5


def blocks(image, seen, side=8):
    """Sums over blocks of the pixels that are `seen`, as luminance."""
    light = (image @ (0.2126, 0.7152, 0.0722)) * seen
    height, width = light.shape
    return light.reshape(height // side, side, width // side, side).sum((1, 3))


class Paths(InOneFolder):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.furnace, cls.cornell = (os.path.join(cls.folder, name) for name in ("furnace.glb", "cornell.glb"))
        kiln("generate", "furnace", "--albedo", str(RHO), "-o", cls.furnace, "--quiet")
        kiln("generate", "cornell", "-o", cls.cornell, "--quiet")
        cls.bake = os.path.join(cls.folder, "bake")
        kiln("bake", cls.cornell, "-o", cls.bake, "--texels-per-metre", "12", "--quality", "preview", "--bounces", "2",
             "--samples-indirect", "512", "--samples-probe", "0", "--denoise", "none", "--no-preview", "--no-export",
             "--quiet")
        devices = json.loads(kiln("info", "--devices", "--json").stdout)["vulkan"]
        cls.backends = ["embree"] + ["vulkan"] * any(d["fit"] for d in devices)

    def view(self, scene, name, *options, **more):
        path = os.path.join(self.folder, name)
        kiln("view", scene, "--method", "path", "-o", path, "--quiet", *options, **more)
        return path

    def pixels(self, scene, *options):
        return exr.rgb(self.view(scene, "pixels.exr", *options))

    def test_furnace(self):
        """A closed box that emits 1 and reflects rho: 1 + rho + rho^2 + ... whichever way one looks, one term for what
        is seen, one for direct light and one a bounce; also through the back of a wall."""
        eyes = (("0.1,0.2,0.1", "0.9,0.3,0.2"), ("0.5,0.5,-1.5", "0.5,0.5,0.5"))
        for backend in self.backends:
            for bounces in ("0", "2", "all") if backend == "embree" or price.full else ("2",):
                for eye, target in eyes if bounces == "2" else eyes[:1]:
                    image = self.pixels(self.furnace, f"--from={eye}", f"--to={target}", "--bounces", bounces,
                                        "--width", "32", "--height", "24", "--field-of-view", "25", "--backend",
                                        backend, "--samples-pixel", "64" if backend == "embree" else "16")
                    terms = 60 if bounces == "all" else int(bounces) + 2
                    wanted = sum(RHO ** k for k in range(terms))
                    self.assertLess(abs(image.mean() / wanted - 1), 0.01, (backend, bounces, image.mean(), wanted))
                    self.assertLess(np.abs(image / wanted - 1).max(), 0.5)

    def test_length(self):
        """The same box: as many terms as rays of a path at most."""
        for backend in self.backends:
            for length in (1, 2, 3) if backend == "embree" else (2,):
                image = self.pixels(self.furnace, "--from=0.1,0.2,0.1", "--to=0.9,0.3,0.2", "--bounces", "all",
                                    "--width", "32", "--height", "24", "--field-of-view", "25", "--backend", backend,
                                    "--samples-pixel", "16", "--path-length", str(length))
                wanted = sum(RHO ** k for k in range(length))
                self.assertLess(abs(image.mean() / wanted - 1), 0.01 if length > 1 else 1e-5, (backend, length))

    def test_same_as_bake(self):
        """The light of a bake with as many bounces: 8 x 8 blocks of the picture, without the lamp. One bounce less is
        seen."""
        size = ("--width", "64", "--height", "64")
        baked = os.path.join(self.folder, "baked.exr")
        kiln("view", self.bake, "-o", baked, "--quiet", *size)
        baked, traced, short = exr.rgb(baked), *(self.pixels(self.bake, "--bounces", n, "--samples-pixel", "128", *size)
                                                 for n in ("2", "1"))
        seen = (baked.max(-1) < 0.6) & (traced.max(-1) < 0.6)
        self.assertGreater(seen.mean(), 0.97)
        one, other = blocks(baked, seen), blocks(traced, seen)
        self.assertLess(abs(other.sum() / one.sum() - 1), 0.01)
        self.assertLess(np.sqrt(((other - one) ** 2).mean()) / one.mean(), 0.03)
        self.assertLess(blocks(short, seen).sum() / one.sum(), 0.97)

    def test_backends(self):
        """The same paths, ray by ray, but for rounding."""
        if "vulkan" not in self.backends:
            self.skipTest("no Vulkan device")
        size = ("--width", "24", "--height", "18", "--bounces", "2", "--samples-pixel", "4")
        for scene in (self.cornell, os.path.join(DATA, "punctual_zoo.glb"), os.path.join(DATA, "many_lights.glb")):
            one, other = (self.pixels(scene, *size, "--backend", backend) for backend in ("embree", "vulkan"))
            self.assertLess(np.sqrt(((one - other) ** 2).mean()) / one.mean(), 1e-3, scene)
        # dispatches of any length
        paths = [self.view(self.cornell, f"{ms}.exr", *size, "--backend", "vulkan",
                           environment={"KILN_DISPATCH_TIME": ms})
                 for ms in ("1", "1000")]
        np.testing.assert_array_equal(*map(exr.rgb, paths))

    @price.long
    def test_backends_with_gloss(self):
        """The same by mirrors and glass, whose kernel takes a minute to be made on a software device."""
        if "vulkan" not in self.backends:
            self.skipTest("no Vulkan device")
        spheres = os.path.join(self.folder, "spheres.glb")
        kiln("generate", "cornell-spheres", "-o", spheres, "--quiet")
        one, other = (self.pixels(spheres, "--width", "24", "--height", "18", "--samples-pixel", "4", "--materials",
                                  "auto", "--path-length", "3", "--backend", backend)
                      for backend in ("embree", "vulkan"))
        self.assertLess(np.sqrt(((one - other) ** 2).mean()) / one.mean(), 1e-2)

    @price.long
    def test_lens(self):
        """A small lamp at distance d, with a lens of radius R focused at f, is a disc of radius R |1 / f - 1 / d| at
        distance 1: its second moment is half of that squared. It has the light of the pinhole's picture."""
        scene = glb.Scene()
        at, half = -2.0, 0.002
        scene.quad("lamp", [(-half, -half, at), (half, -half, at), (half, half, at), (-half, half, at)],
                   scene.material("light", radiance=(1, 1, 1)))
        path = scene.write(os.path.join(self.folder, "lamp.glb"))
        pixels, extent = 48, np.tan(np.radians(20) / 2)
        x = ((np.arange(pixels) + 0.5) / pixels * 2 - 1) * extent
        options = ("--from=0,0,0", "--to=0,0,-1", "--field-of-view", "20", "--width", str(pixels), "--height",
                   str(pixels), "--bounces", "0")
        for backend in self.backends:
            light = []
            for lens in ((), ("--lens-radius", "0.2", "--focus-distance", "4"), ("--lens-radius", "0.2")):
                image = self.pixels(path, *options, "--backend", backend, "--samples-pixel", "1024", *lens)[..., 0]
                light.append(image.sum())
                moment = (image * (x[:, None] ** 2 + x[None, :] ** 2)).sum() / light[-1]
                disc = 0.2 * abs(1 / 4 - 1 / 2) if len(lens) > 2 else 0
                # the picture of a pinhole lies in the four pixels in the middle
                wanted = disc ** 2 / 2 + (extent / pixels) ** 2 * (2 if disc == 0 else 2 / 3)
                self.assertLess(abs(np.sqrt(moment / wanted) - 1), 0.03, (backend, lens))
            # 4 pixels at the pinhole's, which its paths meet with chance 1/40 or so
            self.assertLess(abs(light[1] / light[0] - 1), 0.2, light)
        kiln("view", self.bake, "--lens-radius", "0.1", "-o", os.path.join(self.folder, "no.exr"), code=64)
        kiln("view", self.bake, "--path-length", "2", "-o", os.path.join(self.folder, "no.exr"), code=64)

    def test_surfaces(self):
        """--aov: colour, emission, normal, place and depth of a slanted quad, seen from the front and from the back;
        nothing where there is none. The light is as without."""
        scene = glb.Scene()
        corners = [(-1, -1, -3), (0, -1, -4), (0, 1, -4), (-1, 1, -3)]
        scene.quad("plate", corners, scene.material("both", albedo=(0.5, 0.25, 0.125), radiance=(0.5, 2, 1),
                                                    double_sided=True))
        path = scene.write(os.path.join(self.folder, "plate.glb"))
        size = ("--width", "40", "--height", "30", "--field-of-view", "50", "--samples-pixel", "4")
        for eye, target, side in (("0,0,0", "0,0,-1", 1), ("0,0,-7", "0,0,-1", -1)):
            view = self.view(path, "aov.exr", f"--from={eye}", f"--to={target}", "--aov", *size)
            found = exr.read(view).channels
            inside = found["albedo.R"] == 0.5
            outside = found["albedo.R"] == 0
            self.assertGreater(inside.sum(), 50)
            self.assertGreater(outside.sum(), 400)
            for name, wanted in (("albedo.G", 0.25), ("albedo.B", 0.125), ("emission.R", 0.5), ("emission.G", 2),
                                 ("normal.X", side * 0.5 ** 0.5), ("normal.Y", 0), ("normal.Z", side * 0.5 ** 0.5)):
                self.assertLess(np.abs(found[name][inside] - wanted).max(), 1e-5, (name, eye))
                self.assertEqual(np.abs(found[name][outside]).max(), 0, (name, eye))
            x, z = found["position.X"][inside], found["position.Z"][inside]
            self.assertLess(np.abs(x + z + 4).max(), 1e-5)
            depth = -z if side > 0 else z + 7
            self.assertLess(np.abs(found["Z"][inside] - depth).max(), 1e-5)
            self.assertTrue((found["Z"][outside] == 1e10).all())
            plain = exr.rgb(self.view(path, "plain.exr", f"--from={eye}", f"--to={target}", *size))
            np.testing.assert_array_equal(exr.rgb(view), plain)
            aim = (f"--from={eye}", f"--to={target}", "--environment", "1,2,3")
            sky = exr.rgb(self.view(path, "sky.exr", *aim, *size))
            self.assertGreater((sky[outside] == (1, 2, 3)).mean(), 0.95)  # not at the edges
        baked = os.path.join(self.folder, "baked.exr")
        kiln("view", self.bake, "--aov", "--width", "32", "--height", "24", "-o", baked, "--quiet")
        self.assertTrue({"albedo.R", "normal.Z", "Z"} <= set(exr.read(baked).channels))
        kiln("view", self.bake, "--aov", "-o", os.path.join(self.folder, "no.png"), code=64)

    def test_ranks(self):
        """The same bits over any number of ranks and threads, of one picture and of frames with one exposure."""
        size = ("--width", "37", "--height", "23", "--bounces", "1", "--samples-pixel", "70")  # more than one stretch
        images = [exr.rgb(self.view(self.bake, f"{n}.exr", *size, "--threads", str(threads), ranks=n))
                  for n, threads in ((1, 2), (3, 1), (4, 2))]
        for image in images[1:]:
            np.testing.assert_array_equal(image, images[0])
        self.assertTrue((self.pixels(self.bake, *size, "--seed", "1") != images[0]).any(), "the seed does nothing")
        keys = os.path.join(self.folder, "walk.csv")
        with open(keys, "w", encoding="utf-8") as file:
            file.write("from.x,from.y,from.z,to.x,to.y,to.z\n2.78,2.73,-8,2.78,2.73,0\n2,3,-7,2.78,2,2\n")
        frames = []
        for n in (1, 3):
            self.view(self.bake, f"walk{n}.png", "--path", keys, "--frames", "2", *size, ranks=n)
            frames.append([png.read(os.path.join(self.folder, f"walk{n}-000{k}.png")) for k in (1, 2)])
        for one, other in zip(*frames):
            self.assertGreater(one.std(), 10)  # there is something to see
            np.testing.assert_array_equal(one, other)

    @price.long
    def test_noise(self):
        """Sixteen times the paths have at most a third of the error, and what is printed names both."""
        size = ("--width", "32", "--height", "32", "--bounces", "1")
        best = self.pixels(self.bake, *size, "--samples-pixel", "1024", "--seed", "5")
        seen = best.max(-1) < 0.6
        errors = [np.sqrt(((self.pixels(self.bake, *size, "--samples-pixel", n) - best)[seen] ** 2).mean())
                  for n in ("4", "64")]
        self.assertLess(errors[1], errors[0] / 3, errors)
        said = json.loads(kiln("view", self.bake, "--method", "path", "--samples-pixel", "2", *size, "-o",
                               os.path.join(self.folder, "said.exr"), "--json").stdout)
        self.assertGreater(said["rays"], 2 * 32 * 32)
        self.assertGreater(said["seconds"], 0)

    def test_refused(self):
        out = ("-o", os.path.join(self.folder, "no.exr"))
        for arguments, code, words in (
                ((self.bake, "--bounces", "2"), 64, "--bounces: the light in lightmaps is as it was baked"),
                ((self.bake, "--samples-pixel", "2"), 64, "only --method path"),
                ((self.bake, "--denoise", "bmfr"), 64, "--denoise: the light in lightmaps is as it was baked"),
                ((self.bake, "--sequence"), 64, "--sequence: the light in lightmaps is as it was baked"),
                ((self.bake, "--method", "path", "--environment", "1,1,1"), 64, "--environment: a bake's surroundings"),
                ((self.bake, "--method", "path", "--show", "direct"), 64, "path tracing shows light"),
                ((self.bake, "--method", "rays"), 64, "lightmaps, path"),
                ((os.path.join(DATA, "analytic", "leak_box.glb"), "--method", "path"), 64, "--from X,Y,Z"),
                ((os.path.join(self.folder, "absent.glb"), "--method", "path"), 66, "cannot read scene"),
                ((self.cornell,), 66, "is a file")):
            for ranks in (0, 2) if "path" in arguments else (0,):
                said = kiln("view", *arguments, *out, code=code, ranks=ranks).stderr
                self.assertIn(words, said)
        self.assertFalse(os.path.exists(out[1]))


if __name__ == "__main__":
    unittest.main()
