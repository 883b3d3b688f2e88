"""kiln view --method path --materials: mirrors, gloss and glass against closed forms; both backends."""
import json
import math
import os
import sys
import unittest

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
import price  # noqa: E402
import png  # noqa: E402
from glb import GLASS, ball, gloss  # noqa: E402
from program import InOneFolder, kiln_on_host as kiln  # noqa: E402

FRESNEL = 0.04  # of an index of 1.5 at normal incidence


WHITE = (("mirror", {"metallic": 1.0}), ("rough metal", {"metallic": 1.0, "roughness": 0.5}),
         ("glass", GLASS), ("frosted glass", dict(GLASS, roughness=0.4)), ("plastic", {"roughness": 0.3}),
         ("lacquer", {"roughness": 0.6, "clearcoat": {"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.1}}))
# besides: what textures, transforms, anisotropy, dispersion, tints and thin walls do
MORE = (("brushed", {"color": (0.9, 0.6, 0.3), "metallic": 1.0, "roughness": 0.3,
                     "anisotropy": {"anisotropyStrength": 0.8, "anisotropyRotation": 0.5,
                                    "anisotropyTexture": {"index": 0}}}),
        ("prism", dict(GLASS, dispersion={"dispersion": 2.0}, ior={"ior": 1.7})),
        ("amber", {"transmission": {"transmissionFactor": 1.0}, "roughness": 0.2,
                   "volume": {"thicknessFactor": 1.0, "attenuationDistance": 0.5,
                              "attenuationColor": [0.9, 0.5, 0.1]}}),
        ("frosted pane", {"color": (0.5, 0.8, 0.9), "transmission": {"transmissionFactor": 0.8}, "roughness": 0.3}),
        ("patches", {"color": (0.3, 0.5, 0.7), "metallic": 1.0, "roughness": 0.7,
                     "specular": {"specularColorFactor": [1, 0.4, 0.2], "specularTexture": {"index": 0}},
                     "clearcoat": {"clearcoatFactor": 0.8, "clearcoatRoughnessFactor": 0.5,
                                   "clearcoatTexture": {"index": 0}}}),
        ("matt", {"color": (0.5, 0.5, 0.5), "roughness": 1.0}))


class Mirrors(InOneFolder):
    def view(self, scene, *options, name="pixels.exr", **more):
        path = os.path.join(self.folder, name)
        kiln("view", scene, "--method", "path", "-o", path, "--quiet", *options, **more)
        return path

    def scene(self, make):
        scene, path = glb.Scene(), os.path.join(self.folder, "scene.glb")
        make(scene)
        scene.write(path)
        return path

    def row(self, scene):
        """White balls side by side."""
        for i, (name, values) in enumerate(WHITE):
            ball(scene, name, (2.5 * i, 0.0, 0.0), 1.0, gloss(scene, name, **values))

    def furnace(self, make, what):
        """Where everything sends 1, white balls do too: nothing is lost or gained. Rays are few; the mean over a ball
        tells."""
        path = self.scene(make)
        for i, (name, _) in enumerate(WHITE):
            pixels = exr.rgb(self.view(path, f"--from={2.5 * i},0.5,3.5", f"--to={2.5 * i},0,0", "--materials", "auto",
                                       "--field-of-view", "24", "--width", "24", "--height", "24", "--samples-pixel",
                                       "512" if name == "rough metal" else "64"))  # its lobe meets lamps by chance
            # within frosted glass light meets facets many times, each of which loses a little
            self.assertLess(abs(pixels.mean() - 1), 0.03 if name.startswith("frosted") else 0.01,
                            (what, name, pixels.mean()))

    def test_furnace_of_sky(self):
        def make(scene):
            scene.environment((1.0, 1.0, 1.0))
            self.row(scene)
        self.furnace(make, "sky")

    def test_furnace_of_walls(self):
        """The walls are lamps, of which sharp lobes see what rays meet, and others what light samples bring."""
        def make(scene):
            glb.box(scene, "wall", (-4, -4, -4), (17, 4, 4), scene.material("lamp", radiance=(1, 1, 1)),
                    inward=range(6))
            self.row(scene)
        self.furnace(make, "walls")

    def test_pane(self):
        """A pane between the eye and a lamp. Of light that meets it straight, a solid one of index 1.5 lets through
        (1 - R)^2 (1 + R^2 + R^4 ...), and what its body absorbs comes in between."""
        for keeps in (1.0, 0.5):
            def make(scene):
                volume = {"thicknessFactor": 0.1, "attenuationDistance": 0.1, "attenuationColor": [keeps] * 3}
                pane = gloss(scene, "pane", transmission={"transmissionFactor": 1.0}, volume=volume)
                glb.box(scene, "pane", (-1, -1, 0), (1, 1, 0.1), pane)
                scene.quad("lamp", [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1)],
                           scene.material("lamp", radiance=(1, 1, 1)))
            pixels = exr.rgb(self.view(self.scene(make), "--from=0,0,40", "--to=0,0,0", "--field-of-view", "1",
                                       "--materials", "full", "--width", "16", "--height", "16", "--samples-pixel",
                                       "1024"))
            wanted = (1 - FRESNEL) ** 2 * keeps / (1 - (FRESNEL * keeps) ** 2)
            self.assertLess(abs(pixels.mean() / wanted - 1), 0.003, (keeps, pixels.mean(), wanted))

    def test_mirror_image(self):
        """A plane mirror shows what an eye behind it would see, times its colour (Schlick at 45 degrees)."""
        def make(scene):
            scene.quad("mirror", [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)],
                       gloss(scene, "mirror", (0.5, 0.6, 0.7), metallic=1.0))
            scene.quad("lamp", [(-2, 0.2, -3), (2, 0.2, -3), (2, 4, -3), (-2, 4, -3)],
                       scene.material("lamp", radiance=(1, 2, 3)))
        path = self.scene(make)
        narrow = ("--field-of-view", "2", "--width", "16", "--height", "16", "--samples-pixel", "16")
        image = exr.rgb(self.view(path, "--from=0,2,2", "--to=0,0,0", "--materials", "auto", *narrow))
        share = (1 - math.sqrt(0.5)) ** 5
        for c, color in enumerate((0.5, 0.6, 0.7)):
            wanted = (color + (1 - color) * share) * (c + 1)
            self.assertLess(abs(image[..., c].mean() / wanted - 1), 1e-3, (c, image[..., c].mean(), wanted))
        dark = exr.rgb(self.view(path, "--from=0,2,2", "--to=0,0,0", "--materials", "diffuse", "--bounces", "0",
                                 *narrow))
        self.assertGreater(abs(dark.mean() / image.mean() - 1), 0.1, "as diffuse it is no mirror")

    def room(self, scene):
        """Balls of all kinds in rows before walls, one of which mirrors a little; a lamp and two lights without
        extent."""
        scene.document["images"] = [{"uri": png.data_uri(np.random.default_rng(4).integers(0, 256, (8, 8, 3)))}]
        scene.document["textures"] = [{"source": 0}]
        for i, (name, values) in enumerate(WHITE + MORE):
            material = gloss(scene, name, **values)
            if name == "patches":
                shift = {"KHR_texture_transform": {"offset": [0.3, 0.1], "scale": [3, 2], "rotation": 0.4}}
                scene.used.add("KHR_texture_transform")
                scene.document["materials"][material]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {
                    "index": 0, "extensions": shift}
            ball(scene, name, (2.3 * (i % 4) - 3.4, 2.3 * (i // 4) - 2.3, 0.0), 1.0, material, rings=12)
        glb.box(scene, "walls", (-5, -4, -3), (5, 4, 8), gloss(scene, "walls", (0.7, 0.6, 0.5), roughness=0.4),
                inward=range(6))
        scene.quad("lamp", [(-4, 3.9, 1), (-4, 3.9, 4), (4, 3.9, 4), (4, 3.9, 1)],
                   scene.material("lamp", radiance=(5, 4, 3)))
        scene.light("bulb", {"type": "point", "intensity": 40.0}, translation=[-3, 0, 5])
        scene.light("sun", {"type": "directional", "intensity": 0.5})

    @price.long
    def test_on_gpus(self):
        """The same paths on both backends, but for rounding: pixels are the same to a thousandth but where a path is
        near to another way, and the mean is. A software device takes minutes to make the kernel."""
        if not any(d["fit"] for d in json.loads(kiln("info", "--devices", "--json").stdout)["vulkan"]):
            self.skipTest("no Vulkan device")
        small = ("--width", "40", "--height", "30", "--samples-pixel", "4", "--materials", "full", "--bounces", "2")
        room = (self.scene(self.room), "--from=0,0,7.5", "--to=0,0,0", "--field-of-view", "55")
        one, other = (exr.rgb(self.view(*room, *small, "--backend", backend)) for backend in ("embree", "vulkan"))
        far = np.abs(one - other).max(-1) > 1e-3 * one.max(-1) + 1e-5
        self.assertLess(far.mean(), 0.02)
        self.assertLess(abs(other.mean() / one.mean() - 1), 2e-3)

    def test_bounces_and_bits(self):
        """Mirrors are no bounce; a scene without gloss has the bits it had; ranks do not matter."""
        path, cornell = self.scene(self.mirror_room), os.path.join(self.folder, "cornell.glb")
        small = ("--width", "32", "--height", "24", "--samples-pixel", "16")
        by_mirror = exr.rgb(self.view(path, "--from=0,1,1", "--to=0,1,-1", "--materials", "full", "--bounces", "0",
                                      *small))
        self.assertGreater(by_mirror.mean(), 0.03, "light of a lamp on a wall, seen in a mirror, without a bounce")
        kiln("generate", "cornell", "-o", cornell, "--quiet")
        files = [self.view(cornell, "--materials", materials, *small, name=materials + ".exr")
                 for materials in ("auto", "diffuse")]
        with open(files[0], "rb") as a, open(files[1], "rb") as b:
            self.assertEqual(a.read(), b.read())
        files = [self.view(path, "--from=0,1,1", "--to=0,1,-1", "--materials", "full", *small, name=f"{ranks}.exr",
                           ranks=ranks) for ranks in (1, 3)]
        with open(files[0], "rb") as a, open(files[1], "rb") as b:
            self.assertEqual(a.read(), b.read())

    def mirror_room(self, scene):
        """A wall behind the eye, lit by a lamp, which the eye sees in a mirror before it."""
        scene.quad("mirror", [(-1, 0, -1), (1, 0, -1), (1, 2, -1), (-1, 2, -1)],
                   gloss(scene, "mirror", (0.9, 0.9, 0.9), metallic=1.0))
        scene.quad("wall", [(2, 0, 3), (-2, 0, 3), (-2, 2, 3), (2, 2, 3)], scene.material("wall", (0.8, 0.8, 0.8)))
        scene.light("lamp", {"type": "point", "intensity": 10.0}, translation=[0, 3, 2])

    def test_words(self):
        scene = os.path.join(self.folder, "room.glb")
        kiln("generate", "cornell", "-o", scene, "--quiet")
        told = kiln("view", scene, "--method", "path", "--materials", "shiny", code=64)
        self.assertIn("auto, diffuse, full", told.stderr.replace(" or ", ", "))


if __name__ == "__main__":
    unittest.main(verbosity=2)
