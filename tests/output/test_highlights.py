"""kiln view over lightmaps: highlights of lamps, points and suns on rough metal, against those of path tracing."""
import os
import sys
import unittest

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
import price  # noqa: E402
from glb import gloss  # noqa: E402
from program import InOneFolder, kiln  # noqa: E402

LOOK = ("--from=0,1.2,2.2", "--to=0,0,-0.2", "--field-of-view", "60", "--width", "64", "--height", "48", "--quiet",
        "--backend", "embree")


def point(scene):
    scene.light("bulb", {"type": "point", "intensity": 3.0, "color": [1, 0.5, 0.25]}, translation=[0.5, 1.0, -0.5])


def sun(scene):
    scene.light("sun", {"type": "directional", "intensity": 2.0}, rotation=[-0.5, 0.0, 0.0, 0.8660254])


def lamp(scene):
    """Small, so that few rays from rough surfaces meet it, and near, so that the light of these counts."""
    scene.quad("lamp", [(-0.1, 0.4, -0.1), (0.1, 0.4, -0.1), (0.1, 0.4, 0.1), (-0.1, 0.4, 0.1)],
               scene.material("lamp", radiance=(60, 40, 20)))


def pane(scene):
    """A bulb on the other side of tinted glass, and tinted glass behind it, which takes none of its light."""
    point(scene)
    tinted = gloss(scene, "tinted", (0.5, 0.6, 0.7), transmission={"transmissionFactor": 1.0})
    scene.document["materials"][tinted]["doubleSided"] = True
    for height in (0.5, 1.5):
        scene.quad(f"pane{height}", [(-2, height, 0), (2, height, 0), (2, height, -2), (-2, height, -2)], tinted)


class Highlights(InOneFolder):
    def views(self, name, make, *surroundings):
        """What lightmaps and paths show of boards of metal, one of them brushed, one behind a clear coat."""
        scene = glb.Scene()
        for i, more in enumerate(({"roughness": 0.3}, {"roughness": 0.6},
                                  {"roughness": 0.4, "anisotropy": {"anisotropyStrength": 0.8}},
                                  {"roughness": 0.5, "clearcoat": {"clearcoatFactor": 1.0,
                                                                   "clearcoatRoughnessFactor": 0.2}})):
            x = i - 2
            scene.quad(f"board{i}", [(x, 0, 1), (x + 1, 0, 1), (x + 1, 0, -1), (x, 0, -1)],
                       gloss(scene, f"metal{i}", (0.9, 0.8, 0.7), metallic=1.0, **more))
        make(scene)
        path, bake = (os.path.join(self.folder, name + end) for end in (".glb", ""))
        scene.write(path)
        kiln("bake", path, "-o", bake, "--quality", "draft", "--texels-per-metre", "2", "--materials", "full",
             "--quiet", "--no-export", "--no-preview", "--samples-probe", "0", "--bounces", "0", "--caustics", "none",
             *surroundings)
        files = [os.path.join(self.folder, name + end) for end in ("_bake.exr", "_path.exr")]
        kiln("view", bake, "-o", files[0], "--materials", "full", *LOOK)
        kiln("view", path, "--method", "path", "-o", files[1], "--materials", "full", "--samples-pixel", "1024", *LOOK,
             *surroundings)
        return [exr.rgb(file) for file in files]

    def compare(self, name, make, noise, *surroundings):
        """Blocks of pixels have the same light, and pixels are off by less than chance hits of a lamp would leave."""
        shown, traced = self.views(name, make, *surroundings)
        blocks = [picture.reshape(6, 8, 8, 8, 3).mean((1, 3)) for picture in (shown, traced)]
        apart = np.abs(blocks[0] - blocks[1]).max(-1) / (blocks[1].max(-1) + blocks[1].mean())
        pixels = np.sqrt(((shown - traced) ** 2).mean()) / traced.mean()
        print("%s: light %.4f, blocks apart by %.4f at most, pixels %.3f rms" % (
            name, traced.mean(), apart.max(), pixels))
        self.assertGreater(traced.mean(), 0.01)
        self.assertLess(abs(shown.mean() / traced.mean() - 1), 0.01)
        self.assertLess(apart.max(), 0.05)
        self.assertLess(pixels, noise)

    def shown(self, scene, name, baked, seen):
        """Light of the pixels of a view of a bake without caustics."""
        path, bake, view = (os.path.join(self.folder, name + end) for end in (".glb", "", ".exr"))
        scene.write(path)
        kiln("bake", path, "-o", bake, "--quality", "draft", "--quiet", "--no-export", "--no-preview",
             "--samples-probe", "0", "--caustics", "none", *baked)
        kiln("view", bake, "-o", view, *seen, "--quiet", "--backend", "embree")
        return exr.rgb(view).mean(-1)

    def test_point(self):
        self.compare("point", point, 0.1)

    @price.long
    def test_sun(self):
        self.compare("sun", sun, 0.1)

    def test_lamp(self):
        self.compare("lamp", lamp, 0.1)

    def test_behind_glass(self):
        self.compare("pane", pane, 0.1)

    @price.long
    def test_sky(self):
        """An image with one bright texel: neither rays nor samples alone find all of it well."""
        image = os.path.join(self.folder, "sky.hdr")
        texels = np.full((8, 16, 4), (100, 120, 160, 128), np.uint8)
        texels[1, 3] = (255, 240, 200, 133)
        with open(image, "wb") as file:
            file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n" + texels.tobytes())
        self.compare("sky", lambda scene: None, 0.1, "--environment", image)

    def test_specks(self):
        """A small panel in the light of a spot beside a floor of rough metal, which few rays meet by their lobe."""
        scene = glb.Scene()
        scene.quad("floor", [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)],
                   gloss(scene, "metal", (0.9, 0.8, 0.7), metallic=1.0, roughness=0.3))
        scene.quad("panel", [(-0.6, 1.0, -2), (-0.2, 1.0, -2), (-0.2, 2.0, -2), (-0.6, 2.0, -2)],
                   scene.material("panel", (0.8, 0.8, 0.8)))
        scene.light("spot", {"type": "spot", "intensity": 100.0,
                             "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.25}}, translation=[-0.4, 1.5, 1.0])
        light = self.shown(scene, "specks", ("--texels-per-metre", "8", "--environment", "0.02,0.02,0.02"),
                           ("--from=2,0.8,0.5", "--to=-1,0,0.5", "--field-of-view", "50", "--width", "160", "--height",
                            "120"))
        near = np.lib.stride_tricks.sliding_window_view(np.pad(light, 2, mode="edge"), (5, 5))
        specks = int((light > 2 * np.median(near, axis=(2, 3))).sum())
        print("specks: %d of %d pixels" % (specks, light.size))
        self.assertLess(specks, 60)

    def test_grain(self):
        """Pixels of rough metal between walls of other light are as those around."""
        scene = glb.Scene()
        scene.quad("floor", [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)],
                   gloss(scene, "metal", (0.9, 0.8, 0.7), metallic=1.0, roughness=0.45))
        for name, radiance, wall in (("dark", 0.0, [(-2, 0, -2), (2, 0, -2), (2, 2, -2), (-2, 2, -2)]),
                                     ("left", 3.0, [(-2, 0, 2), (-2, 0, -2), (-2, 2, -2), (-2, 2, 2)]),
                                     ("behind", 2.0, [(2, 0, 2), (-2, 0, 2), (-2, 2, 2), (2, 2, 2)])):
            scene.quad(name, wall, scene.material(name, (0.8, 0.1, 0.1), radiance=(radiance, radiance, radiance)))
        light = self.shown(scene, "grain", ("--texels-per-metre", "4", "--environment", "0.3,0.3,0.3"),
                           ("--from=0,1.0,1.8", "--to=0,0.4,-1", "--field-of-view", "60", "--width", "128", "--height",
                            "96"))
        near = np.lib.stride_tricks.sliding_window_view(np.pad(light, 1, mode="edge"), (3, 3))
        off = np.abs(light - np.median(near, axis=(2, 3))) / light
        grain = off[75:, 20:108].mean()
        print("grain: %.4f of the light" % grain)
        self.assertGreater(light[75:, 20:108].min(), 0.1)
        self.assertLess(grain, 0.015)


if __name__ == "__main__":
    unittest.main(verbosity=2)
