"""kiln view --show: what it shows of a bake, as the atlas and from the camera, against kiln.h5 and the lightmaps."""
import json
import os
import re
import subprocess
import sys
import tempfile

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import png  # noqa: E402
from program import KILN, kiln  # noqa: E402

SCENE = os.path.join("jobs", "cornell.glb")
FEW = ("--quality", "draft", "--samples-direct", "8", "--samples-indirect", "8", "--bounces", "1", "--samples-probe",
       "0", "--no-export", "--no-preview", "--quiet", "--threads", "1")
NAMES = ("position", "normal", "albedo", "area", "error")
STOPS = np.array([(68, 1, 84), (71, 45, 123), (59, 82, 139), (44, 114, 142), (33, 145, 140), (40, 174, 128),
                  (94, 201, 98), (173, 220, 48), (253, 231, 37)], float)


def shown(bake, *arguments):
    """The image (height, width, 3), and what --json says."""
    path = os.path.join(bake, "shown.exr")
    said = json.loads(kiln("view", bake, "-o", path, "--json", *arguments).stdout)
    return exr.rgb(path), said


def bake_cornell(folder):
    bake, groups = os.path.join(folder, "cornell"), os.path.join(folder, "groups.yaml")
    with open(groups, "w", encoding="utf-8") as file:
        file.write("lamps: {materials: ['*ight*']}\n")
    kiln("bake", SCENE, "-o", bake, "--texels-per-metre", "3", "--light-groups", groups, *FEW)
    return bake


def points(bake, name):
    with h5py.File(os.path.join(bake, "kiln.h5"), "r") as file:
        names = [n.decode() for n in file["objects/name"][...]]
        own = file["points/object"][...] == names.index("floor")
        if "points/part" in file:  # what the lightmap shows of texels that walls divide
            own &= file["points/part"][...] == 0
        value = file[name][...].astype(np.float64)[own]
        return file["points/texel"][...][own], value.reshape(len(value), -1), file["points/valid"][...][own] > 0


def check_atlas(bake):
    """Texels as squares: each has the value that kiln.h5 has, and nothing else has one."""
    for name in NAMES:
        group = "irradiance" if name == "error" else "points"
        texel, value, valid = points(bake, f"{group}/{name}")
        image, said = shown(bake, "--show", name, "--atlas", "floor", "--filter", "nearest")
        zoom = said["width"] // (texel[:, 0].max() + 1)
        assert zoom > 8 and said["viewpoint"]["chosen"] == "atlas", said
        small = image[zoom // 2::zoom, zoom // 2::zoom]
        assert np.array_equal(np.repeat(np.repeat(small, zoom, 0), zoom, 1), image), f"{name}: texels are no squares"
        used = valid if name == "error" else np.ones(len(valid), bool)
        got = small[texel[:, 1], texel[:, 0]]
        wanted = np.broadcast_to(value[:, -1:] if value.shape[1] == 1 else value, got.shape)
        same = np.isclose(got, wanted, rtol=1e-6, atol=1e-7).all(-1) | ~used
        if name in ("position", "area", "error"):  # of texels that walls divide kiln.h5 has what is of a part
            assert same.mean() > 0.98 and np.abs(got - wanted)[~same].max(initial=0) < 0.35, f"{name}: far off"
        else:
            assert same.all(), f"{name}: other values than kiln.h5"
        empty = np.ones(small.shape[:2], bool)
        empty[texel[:, 1], texel[:, 0]] = False
        assert np.all(small[empty] == 0), f"{name}: a value where there is no point"
    linear, _ = shown(bake, "--show", "area", "--atlas", "floor", "--filter", "linear")
    nearest, _ = shown(bake, "--show", "area", "--atlas", "floor", "--filter", "nearest")
    assert not np.array_equal(linear, nearest) and linear.max() <= nearest.max() * (1 + 1e-6)


def check_layers(bake):
    """What lightmaps have comes from there."""
    layers = exr.read(os.path.join(bake, "lightmaps", "floor.exr")).channels
    for name, prefix in (("light", ""), ("direct", "direct."), ("indirect", "indirect."),
                         ("group:lamps", "group.lamps.")):
        image, said = shown(bake, "--show", name, "--atlas", "floor", "--filter", "nearest", "--width", "1")
        wanted = np.stack([layers[prefix + c] for c in "RGB"], -1)
        assert image.shape == wanted.shape and np.array_equal(image, wanted), name
    squares, _ = shown(bake, "--show", "texels", "--atlas", "floor", "--width", "1")
    assert np.array_equal(squares[:-2], squares[2:]) and not np.array_equal(squares[:-1], squares[1:])


def check_surfaces(bake):
    """From the camera: positions and normals are those of the surfaces that are seen, within a texel."""
    size = ("--width", "64", "--height", "64")
    path = os.path.join(bake, "light.exr")
    kiln("view", bake, "-o", path, "--aov", *size)
    seen = exr.read(path).channels
    flat = np.ones((64, 64), bool)
    flat[1:] &= seen["normal.X"][1:] == seen["normal.X"][:-1]
    flat[:, 1:] &= seen["normal.X"][:, 1:] == seen["normal.X"][:, :-1]
    for filtered in ("linear", "nearest"):
        places, said = shown(bake, "--show", "position", "--filter", filtered, *size)
        far = np.linalg.norm(places - np.stack([seen["position." + c] for c in "XYZ"], -1), axis=-1)
        covered = np.abs(np.linalg.norm([seen["normal." + c] for c in "XYZ"], axis=0) - 1) < 1e-3
        assert np.percentile(far[covered], 95) < 0.5, np.percentile(far[covered], 95)
        assert said["scale"]["unit"] == "m" and said["scale"]["high"][1] > 5
        normals, _ = shown(bake, "--show", "normal", "--filter", filtered, *size)
        off = np.linalg.norm(normals - np.stack([seen["normal." + c] for c in "XYZ"], -1), axis=-1)
        assert np.percentile(off[covered & flat], 90) < 0.05, np.percentile(off[covered & flat], 90)
    albedo, _ = shown(bake, "--show", "albedo", *size)
    assert np.percentile(np.abs(albedo - np.stack([seen["albedo." + c] for c in "RGB"], -1))[covered], 90) < 0.02


def check_colors(bake):
    """A number without a colour: false colours by the scale that is stated, and a strip with it below."""
    path, size = os.path.join(bake, "error.png"), ("--width", "200", "--height", "150")
    values, _ = shown(bake, "--show", "error", *size)
    said = json.loads(kiln("view", bake, "--show", "error", "-o", path, "--json", *size).stdout)
    low, high = said["scale"]["low"][0], said["scale"]["high"][0]
    assert said["scale"]["unit"] == "W m-2" and 0 <= low < high, said
    picture = png.read(path)
    assert picture.shape == (150 + 44, 200, 3), picture.shape
    at = np.clip((values[..., 0] - low) / (high - low), 0, 1) * (len(STOPS) - 1)
    below = np.minimum(at.astype(int), len(STOPS) - 2)
    wanted = STOPS[below] + (at - below)[..., None] * (STOPS[below + 1] - STOPS[below])
    there = values[..., 0] > 0
    assert there.mean() > 0.5 and np.abs(picture[:150][there] - wanted[there]).max() < 1.5
    bar = picture[150 + 14, 8:192]
    assert np.array_equal(bar[0], STOPS[0]) and np.array_equal(bar[-1], STOPS[-1]), (bar[0], bar[-1])
    text = picture[150 + 24:]
    assert (text[..., 0] > 200).sum() > 50, "the strip has no numbers"
    walk = os.path.join(bake, "walk.csv")
    with open(walk, "w", encoding="utf-8") as file:
        file.write("from.x,from.y,from.z,to.x,to.y,to.z\n2.7,2.7,-4,2.7,2.7,0\n2.7,2.7,2,2.7,5,3\n")
    frames = json.loads(kiln("view", bake, "--show", "error", "--path", walk, "--frames", 2, "-o",
                             os.path.join(bake, "walk.png"), "--json", *size).stdout)["pictures"]
    assert frames[0]["scale"] == frames[1]["scale"], "the scale flickers"
    light = os.path.join(bake, "light.png")
    kiln("view", bake, "--show", "normal", "-o", light, *size)
    assert png.read(light).shape == (150, 200, 3)


def squares_of(bake):
    """{(object, x, y): side} as kiln.h5 has it; each square of that side is one node."""
    with h5py.File(os.path.join(bake, "kiln.h5"), "r") as file:
        where = np.column_stack([file["points/object"][...], file["points/texel"][...]])
        shown = file["points/part"][...] == 0 if "points/part" in file else slice(None)
        sides = dict(zip(map(tuple, where[shown].tolist()), file["radiosity/node"][...][shown].astype(int).tolist()))
    for (o, x, y), side in sides.items():
        if side > 0:
            u, v = x // side * side, y // side * side
            others = [sides.get((o, u + i % side, v + i // side)) for i in range(side ** 2)]
            assert set(others) <= {side, 0, None}, ((o, x, y), side, others)
    return sides


def check_nodes(folder):
    """The nodes of windows and of the quad-tree: whole squares, as large as is asked for, the same on three ranks."""
    few = (*FEW, "--texels-per-metre", "2", "--method", "radiosity", "--keep-nodes")
    for name, most, more in (("windows", 4, ("--undersample", "mipmap:4")),
                             ("tree", 8, ("--subdivide", "0.05:8"))):
        bake = os.path.join(folder, name)
        kiln("bake", SCENE, "-o", bake, *few, *more)
        sides = squares_of(bake)
        assert set(sides.values()) <= {0, 1, 2, 4, most} and max(sides.values()) == most, set(sides.values())
        assert len(set(sides.values())) > 2, "all nodes are of one size"
        image, said = shown(bake, "--show", "node", "--atlas", "floor", "--filter", "nearest", "--width", "1")
        texel, value, _ = points(bake, "radiosity/node")
        assert np.array_equal(image[texel[:, 1], texel[:, 0], 0], value[:, 0])
        assert said["scale"]["unit"] == "texel", said
    again = os.path.join(folder, "ranks")
    subprocess.run(["mpirun", "-n", "3", KILN, "bake", SCENE, "-o", again, *few, *more], check=True)
    assert squares_of(again) == sides, "other nodes on three ranks"
    assert "--undersample" in kiln("bake", SCENE, "-o", again, "--method", "radiosity", "--keep-nodes", code=64).stderr
    assert "--method radiosity" in kiln("bake", SCENE, "-o", again, "--keep-nodes", code=64).stderr


def check_refusals(bake):
    assert "light, texels, direct" in kiln("view", bake, "--show", "nothing", code=64).stderr
    assert "group:NAME" in kiln("view", bake, "--show", "group:", code=64).stderr
    assert "nobody" in kiln("view", bake, "--show", "group:nobody", code=66).stderr
    assert "node" in kiln("view", bake, "--show", "node", code=66).stderr
    assert "floor" in kiln("view", bake, "--atlas", "nobody", code=64).stderr
    assert "--from" in kiln("view", bake, "--atlas", "floor", "--from", "0,1,0", code=64).stderr
    assert "--filter" in kiln("view", bake, "--method", "path", "--filter", "nearest", code=64).stderr
    assert "--atlas" in kiln("view", bake, "--method", "path", "--atlas", "floor", code=64).stderr
    assert "scale" in kiln("view", bake, "--show", "area", "--exposure", "1", code=64).stderr
    help_text = kiln("view", "--help", "all").stdout
    for name in ("light", "texels", "direct", "indirect", "group:NAME", *NAMES):
        assert re.search(rf"^  {re.escape(name)}  +\S+  +\w+", help_text, re.M), name


def main():
    with tempfile.TemporaryDirectory() as folder:
        bake = bake_cornell(folder)
        check_atlas(bake)
        check_layers(bake)
        check_surfaces(bake)
        check_colors(bake)
        check_nodes(folder)
        check_refusals(bake)


if __name__ == "__main__":
    main()
