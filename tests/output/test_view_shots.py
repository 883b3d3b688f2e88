"""kiln view: tone curves, exposure, several cameras, and paths of cameras, on a small bake; on both backends."""
import json
import math
import os
import sys
import unittest

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
import png  # noqa: E402
from program import InOneFolder, content, kiln_on_host as kiln  # noqa: E402

SMALL = ("--width", "48", "--height", "36", "--quiet")
KEYS = ((0.1, 0.25, 0.5, 0.3, 0.3, 0.0, 70), (0.3, 0.3, 0.4, 0.3, 0.2, 0.0, 60), (0.4, 0.2, 0.5, 0.1, 0.3, 0.1, 45))


def srgb(linear):
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def aims(key):
    return ("--from=%r,%r,%r" % key[:3], "--to=%r,%r,%r" % key[3:6], "--field-of-view", "%r" % key[6])


class Shots(InOneFolder):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        plain, scene = (os.path.join(cls.folder, name) for name in ("plain.glb", "scene.glb"))
        kiln("generate", "cornell", "-o", plain, "--quiet")
        cameras = glb.Scene()
        cameras.load(plain)
        nodes = cameras.document["nodes"]
        first = next(i for i, node in enumerate(nodes) if "camera" in node)
        nodes[first]["name"] = "front"
        for name, shift in (("a side/../x", 0.1), ("A side_.._x", -0.1)):  # one file on some file systems
            cameras.node({"name": name, "camera": nodes[first]["camera"],
                          "translation": (np.array(nodes[first]["translation"]) + (shift, 0, 0)).tolist()})
        cameras.write(scene)
        cls.bake = os.path.join(cls.folder, "bake")
        kiln("bake", scene, "-o", cls.bake, "--texels-per-metre", "12", "--quality", "draft", "--bounces", "1",
             "--samples-probe", "0", "--backend", "embree", "--preview", "--quiet")
        cls.path = cls.table("path.csv", KEYS)
        cls.backends = ["embree"]
        if any(d["fit"] for d in json.loads(kiln("info", "--devices", "--json").stdout)["vulkan"]):
            cls.backends.append("vulkan")

    @classmethod
    def table(cls, name, keys, heading="from.x,from.y,from.z,to.x,to.y,to.z,field-of-view"):
        path = os.path.join(cls.folder, name)
        with open(path, "w") as file:
            file.write("\n".join([heading, *(",".join(map(repr, key)) for key in keys)]) + "\n")
        return path

    def view(self, name, *arguments, backend="embree"):
        path = os.path.join(self.folder, name)
        run = kiln("view", self.bake, "-o", path, "--backend", backend, *SMALL, *arguments)
        return path, run

    def refused(self, pattern, *arguments):
        before = sorted(os.listdir(self.folder))
        run = kiln("view", self.bake, "-o", os.path.join(self.folder, "no.png"), *arguments, code=64)
        self.assertRegex(run.stderr, pattern)
        self.assertEqual(sorted(os.listdir(self.folder)), before, "nothing is written")

    def test_curves(self):
        """A PNG is the EXR through the curve; the default is filmic, for the preview of a bake too."""
        linear = exr.rgb(self.view("linear.exr")[0]).astype(float)
        pictures = {}
        for curve in ("filmic", "reinhard", "aces", "none"):
            plain = self.view("plain.png", "--tone-map", curve, "--no-auto-exposure", "--exposure", "-1.5")[0]
            pictures[curve] = png.read(plain).astype(float)
            self.assertIn(f"exposure -1.5 stops, not automatic; tone map {curve}".encode(), content(plain))
        exposed = linear * 2 ** -1.5
        self.assertLessEqual(np.abs(pictures["none"] - 255 * srgb(exposed)).max(), 0.51)
        luminance = exposed @ (0.2126, 0.7152, 0.0722)
        wanted = exposed * ((1 + luminance / 16) / (1 + luminance))[..., None]
        self.assertLessEqual(np.abs(pictures["reinhard"] - 255 * srgb(wanted)).max(), 0.51)
        for one, other in (("filmic", "aces"), ("filmic", "reinhard"), ("aces", "none")):
            self.assertGreater(np.abs(pictures[one] - pictures[other]).max(), 8, (one, other))
        size = ("--width", "96")
        default, named = (self.view(name, *size, *more)[0]
                          for name, more in (("default.png", ()), ("named.png", ("--tone-map", "filmic"))))
        self.assertEqual(content(default), content(named))
        self.assertIn(b"tone map filmic", content(os.path.join(self.bake, "preview.png")))
        scene, bake = (os.path.join(self.folder, name) for name in ("furnace.glb", "furnace"))
        kiln("generate", "furnace", "-o", scene, "--quiet")
        kiln("bake", scene, "-o", bake, "--lightmap-size", "8", "--quality", "draft", "--samples-probe", "0", "--quiet",
             "--backend", "embree", "--tone-map", "aces", "--no-auto-exposure", "--exposure", "-1")
        self.assertIn(b"exposure -1 stops, not automatic; tone map aces", content(os.path.join(bake, "preview.png")))

    def test_cameras(self):
        """Each camera has its file, the same as alone; names that would be one file are numbered."""
        everything = os.path.join(self.folder, "all.png")
        answer = json.loads(kiln("view", self.bake, "-o", everything, "--camera", "all", "--json", *SMALL).stdout)
        names = [os.path.basename(p["output"]) for p in answer["pictures"]]
        self.assertEqual(names, ["all-front-1.png", "all-a_side_.._x-2.png", "all-A_side_.._x-3.png"])
        self.assertEqual([p["viewpoint"]["camera"] for p in answer["pictures"]],
                         ["front", "a side/../x", "A side_.._x"])
        alone = self.view("alone.png", "--camera", "a side/../x")[0]
        self.assertEqual(content(os.path.join(self.folder, names[1])), content(alone))
        self.assertNotEqual(content(os.path.join(self.folder, names[2])), content(alone))
        self.view("some.png", "--camera", "A side_.._x,front")
        self.assertEqual(content(os.path.join(self.folder, "some-A_side_.._x.png")),
                         content(os.path.join(self.folder, names[2])))
        self.assertEqual(content(os.path.join(self.folder, "some-front.png")), content(self.view("front.png")[0]))
        self.refused("no camera 'nobody'; it has 'front', 'a side/../x', 'A side_.._x'", "--camera", "front,nobody")
        self.refused("leave one of the two out", "--camera", "all", "--from=0,0,9")

    def test_frames(self):
        """Frames at key frames are single views, to the bit; the count is as asked for; one exposure for all."""
        for backend in self.backends:
            self.view("walk.exr", "--path", self.path, "--frames", "5", backend=backend)
            frames = sorted(n for n in os.listdir(self.folder) if n.startswith("walk-"))
            self.assertEqual(frames, [f"walk-{i:04d}.exr" for i in range(1, 6)])
            for frame, key in ((1, 0), (3, 1), (5, 2)):
                single = self.view("single.exr", *aims(KEYS[key]), backend=backend)[0]
                walked = os.path.join(self.folder, f"walk-{frame:04d}.exr")
                self.assertEqual(content(single), content(walked), (backend, key))
        self.view("auto.exr", "--path", self.path, "--width", "4", "--height", "3")
        self.assertEqual(sum(n.startswith("auto-") for n in os.listdir(self.folder)), 49)

    def test_backends_agree(self):
        if len(self.backends) < 2:
            self.skipTest("no Vulkan device")
        one, other = (exr.rgb(self.view("agree.exr", backend=b)[0]) for b in self.backends)
        self.assertLess((np.abs(one - other) > 1e-3 * one.max()).any(-1).mean(), 0.01)

    def test_exposure_of_a_path(self):
        """The frames of a path share an exposure, between those of its key frames alone."""
        one = json.loads(kiln("view", self.bake, "-o", os.path.join(self.folder, "e.png"), "--path", self.path,
                              "--frames", "3", "--json", *SMALL[:4]).stdout)["pictures"]
        stops = {p["exposure"]["automatic"] for p in one}
        self.assertEqual(len(stops), 1)
        alone = [json.loads(kiln("view", self.bake, "-o", os.path.join(self.folder, "e.png"), *aims(key), "--json",
                                 *SMALL[:4]).stdout)["exposure"]["automatic"] for key in KEYS]
        self.assertTrue(min(alone) - 0.1 < stops.pop() < max(alone) + 0.1, (one, alone))
        self.assertGreater(max(alone) - min(alone), 0.01)
        radiance = exr.rgb(self.view("grey.exr")[0]).astype(float) @ (0.2126, 0.7152, 0.0722)
        chosen = json.loads(kiln("view", self.bake, "-o", os.path.join(self.folder, "e.png"), "--json",
                                 *SMALL[:4]).stdout)["exposure"]["automatic"]
        lit = np.sort(radiance[radiance > 0])
        middle = lit[len(lit) // 20:-len(lit) // 20]
        self.assertLess(abs(chosen - math.log2(0.18 / math.exp(np.log(middle).mean()))), 0.05)

    def test_contradictions(self):
        self.refused("--frames 3: there is no path", "--frames", "3")
        self.refused("--path and --to: .* leave --to out", "--path", self.path, "--to", "0,0,0")
        self.refused("--path and --camera", "--path", self.path, "--camera", "front")
        self.refused("there is no tone-map 'sepia'; there is: filmic, reinhard, aces, none", "--tone-map", "sepia")
        broken = self.table("broken.csv", [KEYS[0]])
        run = kiln("view", self.bake, "-o", os.path.join(self.folder, "no.png"), "--path", broken, code=65)
        self.assertIn("broken.csv: it has 1 key frames", run.stderr)
        kiln("view", self.bake, "-o", os.path.join(self.folder, "no.png"), "--path", "/nowhere.csv", code=66)
        long = self.table("long.csv", KEYS[:2] * 2100)
        run = kiln("view", self.bake, "-o", os.path.join(self.folder, "no.png"), "--path", long, code=65)
        self.assertIn("4200 key frames would be 100777 frames", run.stderr)
        self.assertFalse(os.path.exists(os.path.join(self.folder, "no.png")))


unittest.main()
