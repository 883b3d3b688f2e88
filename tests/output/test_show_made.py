"""kiln view --show voxels, voxel, links and seen: what is made of a bake for a picture.

Cells: which are filled is known of a scene of two quads, and so is what a camera sees of them. Links: the factors of
the nodes that a texel gathers from, times the light that these send, are the light that the texel got in the bake. What
a texel sees of a wall behind a board is known, too. What a bake has not kept, or no texel has, is said, with what to
do."""
import json
import os
import sys
import tempfile

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
import png  # noqa: E402
from relit import kiln  # noqa: E402

FEW = ["--texels-per-metre", "3", "--quality", "draft", "--samples-direct", "8", "--samples-indirect", "16",
       "--bounces", "1", "--samples-probe", "0", "--denoise", "none", "--no-export", "--no-preview", "--quiet",
       "--threads", "1", "--method", "radiosity"]
ORANGE, BLUE = np.array((0.80, 0.50, 0.16)), np.array((0.14, 0.36, 0.60))
Z_SIDE = 0.3
USAGE, NO_INPUT = 64, 66


def done(*arguments):
    run = kiln(*map(str, arguments))
    assert run.returncode == 0, f"kiln {arguments}: exit {run.returncode}\n{run.stderr}"
    return run


def refused(code, words, *arguments):
    run = kiln(*map(str, arguments))
    assert run.returncode == code and words in run.stderr, f"{arguments}: {run.returncode}, {run.stderr}"


def shown(bake, *arguments):
    """The image, and what --json says."""
    path = os.path.join(bake, "shown.exr")
    said = json.loads(done("view", bake, "-o", path, "--json", *arguments).stdout)
    return exr.rgb(path), said


def stage(folder):
    """A wall of 4 m x 4 m that faces +z, and half of one a metre before it."""
    scene = glb.Scene()
    paint = scene.material("paint", (0.6, 0.5, 0.4), double_sided=True)
    scene.quad("wall", [(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0)], paint)
    scene.quad("board", [(0, 0, 1.25), (1.9, 0, 1.25), (1.9, 4, 1.25), (0, 4, 1.25)], paint)
    scene.light("sun", {"type": "directional", "intensity": 3.0}, rotation=(-0.2, 0, 0, 0.98))
    return scene.write(os.path.join(folder, "stage.glb"))


def check_voxels(folder):
    """Cells of half a metre: 8 x 8 x 3, the wall in the first layer, the board in the third."""
    bake, size = os.path.join(folder, "voxels"), ("--width", "64", "--height", "64")
    done("bake", stage(folder), "-o", bake, "--visibility", "voxels:8", *FEW)
    before = ("--from", "2,2,400", "--to", "2,2,0", "--field-of-view", "0.573")
    image, said = shown(bake, "--show", "voxels", *before, *size)
    grid = said["voxels"]
    assert grid["cells"] == [8, 8, 3] and abs(grid["side"] - 0.5) < 1e-6 and grid["filled"] == 64 + 4 * 8, grid
    cells = image[4::8, 4::8] / Z_SIDE
    for y in range(8):
        for x in range(8):
            turn = (x + (7 - y) + (2 if x < 4 else 0)) % 2
            assert np.allclose(cells[y, x], BLUE if turn else ORANGE, atol=0.02), (x, y, cells[y, x])
    # by surfaces: the same cells, without the shade; and those of the atlas
    image, _ = shown(bake, "--show", "voxel", *before, *size)
    assert np.allclose(image[4::8, 4::8], cells, atol=0.02)
    for filtered in ("linear", "nearest"):
        image, _ = shown(bake, "--show", "voxels", "--atlas", "board", "--filter", filtered, *size[:2])
        tones = np.unique(np.round(image.reshape(-1, 3).astype(float), 3), axis=0)
        assert {tuple(t) for t in tones} <= {(0.8, 0.5, 0.16), (0.14, 0.36, 0.6), (0.0, 0.0, 0.0)}, tones
        assert len(tones) >= 2
    # another grid; a cell that its own light walls leave empty is seen through; the key stands below a PNG
    path = os.path.join(folder, "voxels.png")
    said = json.loads(done("view", bake, "--show", "voxels", "--voxels", "16", "-o", path, "--json", "--width", "200",
                           "--height", "150").stdout)
    assert said["voxels"]["cells"][:2] == [16, 16] and png.read(path).shape == (150 + 44, 200, 3)
    refused(USAGE, "--voxels", "view", bake, "--show", "area", "--voxels", "8")
    refused(USAGE, "--filter", "view", bake, "--show", "voxels", "--filter", "nearest")
    refused(NO_INPUT, "--keep-transport links", "view", bake, "--show", "links", "--texel", "wall,3,3")


def check_links(folder):
    bake = os.path.join(folder, "links")
    done("bake", "jobs/cornell.glb", "-o", bake, "--patches", "links:0.05", "--keep-transport",
         "links", *FEW)
    with h5py.File(os.path.join(bake, "kiln.h5"), "r") as file:
        names = [n.decode() for n in file["objects/name"][...]]
        p = {name: file[f"points/{name}"][...] for name in ("object", "texel", "albedo", "area", "valid")}
        direct, indirect = file["irradiance/direct"][...], file["irradiance/indirect"][...]
    name, texel = "floor", (3, 4)
    one = np.flatnonzero((p["object"] == names.index(name)) & (p["texel"] == texel).all(1) & (p["valid"] > 0))
    assert len(one) == 1, (name, texel)
    share = np.full(len(p["object"]), np.nan)
    for number, own in enumerate(names):
        image, said = shown(bake, "--show", "links", "--texel", f"{name},{texel[0]},{texel[1]}", "--atlas", own,
                            "--filter", "nearest", "--width", "1")
        points = p["object"] == number
        at = p["texel"][points]
        share[points] = image[at[:, 1], at[:, 0], 0]
    nodes, inverse = np.unique(share, return_inverse=True)
    seen = nodes > 0
    assert share[one[0]] == -1 and (nodes[~seen] == -1).sum() == (share == -1).sum() == 1
    weight = np.bincount(inverse, p["area"])
    light = np.zeros(3)
    for c in range(3):
        sent = np.bincount(inverse, p["area"] * p["albedo"][:, c] * direct[:, c]) / weight
        light[c] = (nodes * sent)[seen].sum() / 100
    assert np.allclose(light, indirect[one[0]], rtol=1e-2), (name, light, indirect[one[0]])
    assert abs(nodes[seen].sum() - said["links"]["view"]) < 0.02 * said["links"]["view"], said
    assert seen.sum() <= said["links"]["nodes"] + said["links"]["texels"]
    picture = os.path.join(folder, "links.png")
    said = done("view", bake, "--show", "links", "--texel", "floor,3,4", "-o", picture, "--width", "200", "--height",
                "150").stdout
    assert "the texel floor,3,4 gathers from" in said and png.read(picture).shape == (150 + 44, 200, 3), said
    for words, more in (("--texel OBJECT,X,Y", ()), ("give OBJECT,X,Y", ("--texel", "floor")),
                        ("no object of that name", ("--texel", "ground,1,1")), ("texels, counted from 0,0",
                                                                                  ("--texel", "floor,900,1"))):
        refused(USAGE, words, "view", bake, "--show", "links", *more)
    refused(USAGE, "--texel", "view", bake, "--show", "area", "--texel", "floor,3,4")
    refused(NO_INPUT, "--voxels N", "view", bake, "--show", "voxels")


def check_seen(folder):
    """Two walls of 4 m x 4 m, 4 m apart, and half way a board of 1 m x 1 m: its shadow is twice as wide."""
    scene, bake = glb.Scene(), os.path.join(folder, "seen")
    paint = scene.material("paint", (0.6, 0.5, 0.4))
    scene.quad("wall", [(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0)], paint)
    scene.quad("far", [(0, 0, 4), (0, 4, 4), (4, 4, 4), (4, 0, 4)], paint)
    scene.quad("board", [(1.6, 1.3, 2), (2.6, 1.3, 2), (2.6, 2.3, 2), (1.6, 2.3, 2)],
               scene.material("board", (0.6, 0.5, 0.4), double_sided=True))
    scene.light("sun", {"type": "directional", "intensity": 3.0}, rotation=(-0.2, 0, 0, 0.98))
    done("bake", scene.write(os.path.join(folder, "seen.glb")), "-o", bake, *FEW)
    with h5py.File(os.path.join(bake, "kiln.h5"), "r") as file:
        names = [n.decode() for n in file["objects/name"][...]]
        p = {name: file[f"points/{name}"][...] for name in ("object", "texel", "position")}
    on = {name: p["object"] == names.index(name) for name in names}
    one = p["position"][np.flatnonzero(on["wall"] & (p["texel"] == (3, 4)).all(1))[0]]
    middle = (p["position"][on["far"]] + one)[:, :2] / 2
    low, high = np.array((1.6, 1.3)), np.array((2.6, 2.3))
    hidden = ((middle > low) & (middle < high)).all(1)
    sure = (np.minimum(abs(middle - low), abs(middle - high)) > 1e-3).all(1)
    at = p["texel"][on["far"]]
    size = ("--texel", "wall,3,4", "--atlas", "far", "--filter", "nearest", "--width", "1")
    image, said = shown(bake, "--show", "seen", *size)
    assert 5 < hidden.sum() < 60 and sure.mean() > 0.9, (hidden.sum(), sure.mean())
    assert ((image[at[:, 1], at[:, 0], 0] > 0.5) != hidden)[sure].all(), image[..., 0]
    seen = said["seen"]
    assert seen["texel"] == "wall,3,4" and seen["voxels"] == seen["both"] == 0, seen
    assert abs(seen["rays"] + hidden.sum() - seen["facing"]) <= (~sure).sum() and seen["facing"] > hidden.size, seen
    # coarse cells hide more than the board
    image, said = shown(bake, "--show", "seen", "--voxels", "8", *size)
    coarse = said["seen"]
    assert coarse["rays"] == seen["rays"] and coarse["both"] <= min(coarse["rays"], coarse["voxels"]), coarse
    assert 0 < coarse["voxels"] != coarse["rays"], coarse
    # hidden, turned away and the texel itself are told apart
    tones = {tuple(np.round(t.astype(float), 2)) for t in image[at[:, 1], at[:, 0]]}
    image, _ = shown(bake, "--show", "seen", "--texel", "wall,3,4", "--atlas", "wall", "--filter", "nearest", "--width",
                     "1")
    assert tones == {(1.0, 1.0, 1.0), (0.02, 0.08, 0.3)} and np.allclose(image[4, 3], (1, 0.3, 0), atol=0.01), tones
    assert np.allclose(image[2, 2], 0.03, atol=0.01), image[2, 2]
    refused(USAGE, "give OBJECT,X,Y", "view", bake, "--show", "seen", "--texel", "wall")
    refused(USAGE, "no surface lies in that texel", "view", bake, "--show", "seen", "--texel", "wall,900,1")


def main():
    with tempfile.TemporaryDirectory() as folder:
        check_voxels(folder)
        check_links(folder)
        check_seen(folder)


if __name__ == "__main__":
    main()
