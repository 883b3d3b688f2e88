"""preview.png of a mirror has one ray a pixel where that suffices: what is seen there, leaning bars before
the sky, is what kiln view shows with sixteen times as many as it has else. The middle of the picture is enough, a
quarter of its pixels.
"""
import math
import os
import sys
import tempfile

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
import png  # noqa: E402
from program import kiln  # noqa: E402

FIELD = 0.6  # rad, vertical
PLAIN = ["--no-auto-exposure", "--tone-map", "none", "--quiet"]


def write_scene(path):
    """A mirror that fills the picture, and bars behind the camera, each turned a little."""
    scene = glb.Scene()
    scene.environment((0.7, 0.8, 1.0))
    mirror, bars = glb.gloss(scene, "mirror", (0.9, 0.9, 0.9), metallic=1.0), glb.gloss(
        scene, "bars", (0.1, 0.2, 0.4), roughness=1.0, specular={"specularFactor": 0})
    scene.quad("mirror", ((-9, -9, -2), (9, -9, -2), (9, 9, -2), (-9, 9, -2)), mirror)
    for i in range(8):
        x, lean = 0.6 * i - 2.4, 0.05 * i
        scene.quad("bar%d" % i, ((x + 0.3, -1.5, 3), (x, -1.5, 3), (x + lean, 1.5, 3), (x + lean + 0.3, 1.5, 3)), bars)
    scene.document["cameras"] = [{"type": "perspective", "perspective": {"yfov": FIELD, "aspectRatio": 4 / 3,
                                                                         "znear": 0.01}}]
    scene.node({"camera": 0, "name": "camera"})
    return scene.write(path)


with tempfile.TemporaryDirectory() as folder:
    bake, picture = os.path.join(folder, "bake"), os.path.join(folder, "view.png")
    kiln("bake", write_scene(os.path.join(folder, "scene.glb")), "-o", bake, "--texels-per-metre", "2",
         "--quality", "draft", "--bounces", "0", "--samples-probe", "0", "--materials", "full", *PLAIN)
    few = png.read(os.path.join(bake, "preview.png")).astype(float)
    height, width = few.shape[:2]
    few = few[height // 4:height // 4 + height // 2, width // 4:width // 4 + width // 2]
    kiln("view", bake, "-o", picture, "--width", str(width // 2), "--height", str(height // 2), "--from", "0,0,0",
         "--to", "0,0,-1", "--field-of-view", "%.9g" % math.degrees(2 * math.atan(math.tan(FIELD / 2) / 2)), *PLAIN)
    off = np.abs(few - png.read(picture).astype(float))[..., :3].max(-1)
    rms = np.sqrt((off ** 2).mean())
    print("%u x %u, off by %.3f of 255 rms, %.0f at most" % (width, height, rms, off.max()))
    assert few[..., :3].std() > 10, "nothing is seen in the mirror"
    assert rms < 6, (rms, off.max())  # with all rays 4.77; of the whole picture 3.79, with the first one alone 9.80
