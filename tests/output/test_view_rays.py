"""kiln view gives a pixel few rays where they suffice: a picture of a textured floor with boxes and red glass is what
the mean over pixels of a larger picture is, at edges and in the texture, near by and far away."""
import os
import sys
import tempfile

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
import png  # noqa: E402
from program import kiln  # noqa: E402

WIDTH, HEIGHT, TIMES = 160, 120, 6


def write_scene(path):
    scene = glb.Scene()
    scene.environment((1, 1, 1))
    pixels = np.random.default_rng(1).integers(40, 255, (64, 64, 3)).astype(np.uint8)
    scene.document["images"] = [{"uri": png.data_uri(pixels)}]
    scene.document["textures"] = [{"source": 0}]
    floor, grey = scene.material("floor", (0.8, 0.8, 0.8)), scene.material("grey", (0.2, 0.3, 0.6))
    scene.document["materials"][floor]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    scene.quad("floor", ((-5, 0, 5), (5, 0, 5), (5, 0, -5), (-5, 0, -5)), floor)
    for i in range(4):
        glb.box(scene, "box%d" % i, (i - 2, 0, -i), (i - 1.5, 0.7, 0.4 - i), grey)
    for i in range(6):
        glb.box(scene, "bar%d" % i, (-2, 0.2 * i, 0.7), (2, 0.2 * i + 0.01, 0.71), grey)
    red = scene.material("red glass", (1, 0.3, 0.2))
    scene.document["materials"][red]["extensions"] = {"KHR_materials_transmission": {"transmissionFactor": 1}}
    scene.used.add("KHR_materials_transmission")
    scene.quad("pane", ((-1, 0.2, 2), (1, 0.2, 2), (1, 1.2, 2), (-1, 1.2, 2)), red)
    return scene.write(path)


def view(bake, times):
    path = os.path.join(bake, "view.exr")
    kiln("view", bake, "-o", path, "--from=0.3,1.5,4.4", "--to=0,0.3,0", "--width",
         str(times * WIDTH), "--height", str(times * HEIGHT), "--quiet")
    return exr.rgb(path).astype(float)


with tempfile.TemporaryDirectory() as folder:
    kiln("bake", write_scene(os.path.join(folder, "scene.glb")), "-o", os.path.join(folder, "bake"),
         "--texels-per-metre", "2", "--quality", "draft", "--bounces", "0", "--samples-probe", "0",
         "--no-preview", "--quiet", "--materials", "diffuse")
    bake = os.path.join(folder, "bake")
    image, wide = view(bake, 1), view(bake, TIMES)
    mean = wide.reshape(HEIGHT, TIMES, WIDTH, TIMES, 3).mean((1, 3))
    off = np.sqrt(((image - mean) ** 2).sum(-1)) / mean.mean()
    rms = np.sqrt((off ** 2).mean())
    print("off by %.4f rms, %.3f at most" % (rms, off.max()))
    assert rms < 0.030 and off.max() < 0.6, (rms, off.max())  # with all 16 rays 0.0278 and 0.550
