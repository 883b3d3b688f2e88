"""kiln view --sequence and --denoise bmfr: what frames take over, light that must stay, less noise, the same bits."""
import os
import sys
import unittest

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
from program import InOneFolder, kiln  # noqa: E402

AIM = ("2.8,2.7,-7", "2.8,2.5,0")
BMFR = ("--denoise", "bmfr")


class Sequences(InOneFolder):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.cornell = os.path.join(cls.folder, "cornell.glb")
        kiln("generate", "cornell", "-o", cls.cornell, "--quiet")

    def table(self, name, *keys):
        path = os.path.join(self.folder, name)
        with open(path, "w", encoding="utf-8") as file:
            file.write("from.x,from.y,from.z,to.x,to.y,to.z\n" + "".join(f"{a},{b}\n" for a, b in keys))
        return path

    def view(self, name, *options, scene=None, method="path", **more):
        path = os.path.join(self.folder, name)
        kiln("view", scene or self.cornell, "--method", method, "--backend", "embree", "-o", path, "--quiet", *options,
             **more)
        return path

    def frames(self, name, keys, count, *options, **more):
        path = self.view(name, "--path", keys, "--frames", str(count), *options, **more)
        return [exr.rgb(f"{path[:-4]}-{k + 1:04d}.exr") for k in range(count)]

    def test_still(self):
        """Frames of a camera that stands still: the mean over the paths of all, each of which has others."""
        size = ("--width", "48", "--height", "36", "--bounces", "1")
        keys = self.table("still.csv", AIM, AIM)
        frames = self.frames("still.exr", keys, 4, "--sequence", "--samples-pixel", "3", *size)
        for k, frame in enumerate(frames):
            alone = exr.rgb(self.view("alone.exr", f"--from={AIM[0]}", f"--to={AIM[1]}", *size, "--samples-pixel",
                                      str(3 * k + 3)))
            np.testing.assert_allclose(frame, alone, rtol=1e-3, atol=1e-4 * alone.mean())
        self.assertGreater(np.abs(frames[3] - frames[0]).mean(), 0.01 * frames[0].mean())

    def test_constant(self):
        """Stripes on the ground below a sky of 1, while the camera moves: what is seen is the albedo, whatever frames
        take over and the filter does. Without either, too."""
        scene = glb.Scene()
        for i in range(4):
            left, material = i - 2.0, scene.material(f"stripe {i}", albedo=((0.2, 0.8)[i % 2], 0.5, 0.3 + 0.1 * i))
            scene.quad(f"stripe {i}", [(left + 1, 0, 0), (left + 1, 0, -4), (left, 0, -4), (left, 0, 0)], material)
        path = scene.write(os.path.join(self.folder, "ground.glb"))
        keys = self.table("over.csv", ("0,1.5,1", "0,0,-2"), ("0.6,1.7,0.6", "0.2,0,-2"))
        options = ("--environment", "1,1,1", "--width", "64", "--height", "48", "--samples-pixel", "2", "--aov",
                   "--bounces", "0", "--path", keys, "--frames", "3")
        for more in ((), ("--sequence",), BMFR, ("--sequence", *BMFR)):
            name = self.view("over.exr", *options, *more, scene=path)
            for k in range(3):
                frame = f"{name[:-4]}-{k + 1:04d}.exr"
                channels, light = exr.read(frame).channels, exr.rgb(frame)
                albedo = np.stack([channels["albedo." + c] for c in "RGB"], -1)
                inside = np.abs(channels["normal.Y"] - 1) < 1e-5
                for dy, dx in np.ndindex(5, 5):  # edges between stripes pass by the rays that see surfaces
                    inside[2:-2, 2:-2] &= np.abs(albedo[dy:44 + dy, dx:60 + dx] - albedo[2:-2, 2:-2]).max(-1) < 1e-5
                inside[[0, 1, -2, -1]] = inside[:, [0, 1, -2, -1]] = False
                self.assertGreater(inside.mean(), 0.3)
                self.assertLess(np.abs(light - albedo)[inside].max(), 0.02 if BMFR[0] in more else 1e-3, (more, k))

    def test_noise(self):
        """The filter leaves less than 0.6 of the error, and the mean; a sequence of a moving camera less than frames
        alone."""
        aim = (f"--from={AIM[0]}", f"--to={AIM[1]}", "--width", "96", "--height", "72", "--bounces", "1")
        best = exr.rgb(self.view("best.exr", *aim, "--samples-pixel", "512", "--seed", "5"))
        seen = best.max(-1) < 0.6  # not the lamp, nor beside it
        for axis in (0, 1):
            seen &= np.roll(seen, 1, axis) & np.roll(seen, -1, axis)

        def error(image):
            return np.sqrt(((image - best)[seen] ** 2).mean())

        for samples in ("1", "4"):
            plain, filtered = (exr.rgb(self.view("noise.exr", *aim, "--samples-pixel", samples, *more))
                               for more in ((), BMFR))
            self.assertLess(error(filtered), 0.6 * error(plain), samples)
            self.assertLess(abs(filtered[seen].mean() / best[seen].mean() - 1), 0.02)
        fixed = self.frames("fixed.exr", self.table("fixed.csv", AIM, AIM), 2, "--samples-pixel", "4", *aim[2:], *BMFR)
        np.testing.assert_array_equal(filtered, fixed[1])  # frames that are no sequence are single views
        keys = self.table("noise.csv", ("2.2,3.1,-6.6", "2.9,2.4,0"), AIM)
        last = [self.frames("moving.exr", keys, 6, "--samples-pixel", "4", *aim[2:], *more)[-1]
                for more in ((), ("--sequence",), ("--sequence", *BMFR))]
        off = [np.abs(image - best)[seen].mean() for image in last]
        self.assertLess(off[1], 0.5 * off[0], off)
        self.assertLess(off[2], off[1], off)
        self.assertLess(error(last[2]), 0.5 * error(last[0]))

    def test_mirror(self):
        """In a mirror the filter goes by what is seen there: of a path a pixel less than 0.45 of the error is left; by
        the mirror's own surface 0.7."""
        scene = os.path.join(self.folder, "spheres.glb")
        kiln("generate", "cornell-spheres", "-o", scene, "--quiet")
        aim = ("--from=2.4,1.6,0.6", "--to=1.9,1,2.6", "--width", "72", "--height", "72")
        best = exr.rgb(self.view("mirrored.exr", *aim, "--samples-pixel", "192", "--seed", "5", scene=scene))
        clean = exr.rgb(self.view("clean.exr", *aim, "--samples-pixel", "1", *BMFR, scene=scene))
        plain = self.view("plain.exr", *aim, "--samples-pixel", "1", "--aov", scene=scene)
        channels, plain = exr.read(plain).channels, exr.rgb(plain)
        place = np.stack([channels["position." + c] for c in "XYZ"], -1)
        seen = np.abs(np.sqrt(((place - (1.6, 1.01, 3.6)) ** 2).sum(-1)) - 1) < 0.01
        dark = best.max(-1) < 0.8  # not the lamp, nor beside it
        for axis in (0, 1):
            dark &= np.roll(dark, 1, axis) & np.roll(dark, -1, axis)
        seen &= dark
        self.assertGreater(seen.mean(), 0.3)
        left = np.sqrt(((clean - best)[seen] ** 2).mean() / ((plain - best)[seen] ** 2).mean())
        print(f"of the noise in a mirror {left:.3f} is left")
        self.assertLess(left, 0.45)

    def test_edges(self):
        """Nothing of a bright wall stays behind in the dark beside it, nor the other way round, as the camera moves."""
        scene = glb.Scene()
        scene.quad("wall", [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)],
                   scene.material("white", albedo=(0.9, 0.9, 0.9)))
        scene.quad("lamp", [(-9, -9, 9), (-9, 9, 9), (9, 9, 9), (9, -9, 9)], scene.material("l", radiance=(1, 1, 1)))
        path = scene.write(os.path.join(self.folder, "wall.glb"))
        keys = self.table("aside.csv", ("-0.3,0,3", "-0.3,0,0"), ("0.4,0.1,3", "0.4,0.1,0"))
        for more in (("--sequence",), ("--sequence", *BMFR)):
            options = ("--width", "64", "--height", "48", "--samples-pixel", "4", "--bounces", "0", "--aov", *more)
            self.frames("aside.exr", keys, 6, *options, scene=path)
            channels = exr.read(os.path.join(self.folder, "aside-0006.exr")).channels
            dark = channels["Z"] > 1e9
            for axis in (0, 1):  # not at the edge itself
                dark &= np.roll(dark, 1, axis) & np.roll(dark, -1, axis)
            bright = channels["albedo.R"] > 0.899
            self.assertGreater(dark.sum(), 200)
            self.assertEqual(channels["R"][dark].max(), 0, more)
            self.assertGreater(channels["R"][bright].min(), 0.2, more)

    def test_ranks(self):
        """The same bits over any number of ranks and threads, by paths from the camera and by both ways."""
        keys = self.table("walk.csv", ("2.2,3.1,-6.6", "2.9,2.4,0"), AIM)
        for method in ("path", "bdpt"):
            options = ("--width", "45", "--height", "33", "--samples-pixel", "3", "--bounces", "1", "--sequence",
                       *BMFR)
            one, *others = (self.frames(f"{method}{n}.exr", keys, 3, *options, "--threads", str(threads), method=method,
                                        ranks=n) for n, threads in ((1, 2), (3, 1)))
            for other in others:
                np.testing.assert_array_equal(one, other)

    def test_refused(self):
        out = ("-o", os.path.join(self.folder, "no.exr"), "--method", "path")
        keys = self.table("no.csv", AIM, AIM)
        aim = (f"--from={AIM[0]}", f"--to={AIM[1]}")
        for arguments, words in (((*aim, *out, "--sequence"), "--path FILE.csv names one"),
                                 ((*aim, *out, *BMFR, "--max-time", "1"), "two halves of the paths"),
                                 ((*aim, *out, *BMFR, "--lens-radius", "0.1"), "what a pinhole sees"),
                                 (("--path", keys, *out, "--sequence", "--lens-radius", "0.1"), "what a pinhole sees")):
            self.assertIn(words, kiln("view", self.cornell, *arguments, code=64).stderr)
        self.assertFalse(os.path.exists(out[1]))


if __name__ == "__main__":
    unittest.main()
