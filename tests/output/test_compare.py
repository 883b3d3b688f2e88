"""kiln compare against its definitions (coordinator/view/compare.h) computed again with numpy, on generated files."""
import json
import os
import sys
import tempfile

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
from program import kiln  # noqa: E402


def compare(a, b, *more):
    return json.loads(kiln("compare", a, b, "--json", *more).stdout)


def windows(x, y, used):
    """Mean structural similarity over used texels, windows made by explicit shifts of the whole image."""
    height, width = used.shape
    x, y, m = (np.pad(np.where(used, v, 0), 5) for v in (x, y, used.astype(float)))
    sums = np.zeros((6, height, width))
    for dy in range(11):
        for dx in range(11):
            weight = np.exp(-((dx - 5) ** 2 + (dy - 5) ** 2) / (2 * 1.5 ** 2))
            window = np.s_[dy:dy + height, dx:dx + width]
            for k, value in enumerate((m, x, y, x * x, y * y, x * y)):
                sums[k] += weight * (m * value)[window]
    n, x, y, xx, yy, xy = sums[:, used]
    x, y = x / n, y / n
    vx, vy, c = np.maximum(xx / n - x * x, 0), np.maximum(yy / n - y * y, 0), xy / n - x * y
    return np.mean((2 * x * y + 1e-4) * (2 * c + 9e-4) / ((x * x + y * y + 1e-4) * (vx + vy + 9e-4)))


WEIGHTS = [0.2126, 0.7152, 0.0722]


def ssim(a, b, used, exposure):
    return windows(*((lambda t: t / (1 + t))(exposure * np.maximum(rgb @ WEIGHTS, 0)) for rgb in (a, b)), used)


def picture(rgb, exposure):
    linear = np.clip(exposure * rgb / (1 + exposure * np.maximum(rgb @ WEIGHTS, 0)[..., None]), 0, 1)
    return np.round(255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)) / 255


def picture_metrics(a, b, used, exposure):
    shown = [picture(v, exposure) for v in (a, b)]
    return (10 * np.log10(1 / np.mean((shown[0] - shown[1])[used] ** 2)),
            1 / windows(*(v @ WEIGHTS for v in shown), used) - 1)


def code_lengths(a, b, used, white=None):
    """Of all pixels, as 8-bit codes over 255; `white` has code 255, or else the brightest value."""
    white = b[used].max() if white is None else white
    a, b = (np.floor(255 * np.clip(np.nan_to_num(v) / white, 0, 1) + 0.5) / 255 for v in (a, b))
    return np.linalg.norm(a - b, axis=-1)


def expected(a, b, used, inside):
    a, b = a.astype(float), b.astype(float)
    d, r = (a - b)[used], b[used]
    length = np.linalg.norm(d, axis=1)
    luminance = r @ [0.2126, 0.7152, 0.0722]
    rmse = np.sqrt(np.mean(d ** 2))
    exposure = 0.18 / np.exp(np.mean(np.log(luminance[luminance > 0])))
    y, x = np.argwhere(used)[np.argmax(length)]
    decibels, dissimilarity = picture_metrics(a, b, used, exposure)
    return {
        "texels": used.sum(), "interior_texels": inside.sum(), "mean": r.mean(), "rmse": rmse,
        "nrmse": np.sqrt(np.mean((a - b)[inside] ** 2)) / b[inside].mean(),
        "rel_rmse": np.sqrt(np.mean((d / (np.abs(r) + 0.01 * np.abs(r).mean())) ** 2)),
        "psnr": 20 * np.log10(np.abs(r).max() / rmse), "dssim": (1 - ssim(a, b, used, exposure)) / 2,
        "picture_psnr": decibels, "picture_dissimilarity": dissimilarity,
        "dfpr": length.mean(), "dfpr_unit": length.mean() / r.max(), "dfpr_8bit": code_lengths(a, b, used).mean(),
        "worst": {"difference": length.max(), "x": x, "y": y},
    }


def check(found, wanted, what):
    for name, value in wanted.items():
        if isinstance(value, dict):
            check(found[name], value, what + "." + name)
            continue
        tolerance = 2e-6 * abs(value) + (2e-7 if name in ("dssim", "picture_dissimilarity") else 1e-12)
        assert abs(found[name] - value) <= tolerance, f"{what}: {name} is {found[name]}, should be {value}"


def planes(rgb):
    return {c: rgb[..., i].astype(np.float32) for i, c in enumerate("RGB")}


def as_stored(rgb, half):
    return rgb.astype(np.float16).astype(np.float32) if half else rgb.astype(np.float32)


def images(rng, height, width, noise):
    y, x = np.mgrid[0:height, 0:width]
    base = 1 + np.sin(x / 5)[..., None] * np.cos(y / 7)[..., None] * [0.8, 0.5, 0.2] + [0.1, 0.2, 0.3]
    return base * (1 + noise * rng.standard_normal(base.shape)), base


def plain_files(rng, folder):
    for case, (height, width, noise, compression, half) in enumerate(
            [(33, 47, 0.1, "ZIP", False), (16, 16, 0.5, "NONE", False), (70, 31, 0.02, "ZIP", True),
             (5, 3, 0.3, "ZIPS", False)]):
        a, b = (as_stored(i, half) for i in images(rng, height, width, noise))
        paths = [os.path.join(folder, n) for n in ("a.exr", "b.exr")]
        for path, image in zip(paths, (a, b)):
            exr.write(path, planes(image), half="RGB" if half else "", compression=compression)
        everything = np.ones((height, width), bool)
        found = compare(*paths)
        check(found, expected(a, b, everything, everything), f"case {case}")
        assert found["identical"] is False
        same = compare(paths[1], paths[1])
        assert same["identical"] is True and same["rmse"] == 0 and same["psnr"] is None and abs(same["dssim"]) < 1e-7
        assert same["picture_psnr"] is None and abs(same["picture_dissimilarity"]) < 1e-7


def masked_folders(rng, folder):
    """Two bakes of two objects, with margins, filled texels and a NaN."""
    sums = []
    for name, (height, width) in (("floor", (40, 24)), ("wall", (25, 61))):
        a, b = (as_stored(i, False) for i in images(rng, height, width, 0.2))
        validity = [rng.choice([0, 0.5, 1], (height, width), p=[0.2, 0.1, 0.7]) for _ in range(2)]
        coverage = [rng.choice([0.3, 1], (height, width)) for _ in range(2)]
        a[3, 4, 1] = np.nan
        for bake, image, v, c in zip("AB", (a, b), validity, coverage):
            os.makedirs(os.path.join(folder, bake, "lightmaps"), exist_ok=True)
            exr.write(os.path.join(folder, bake, "lightmaps", name + ".exr"),
                      {**planes(image), "validity.Y": v, "coverage.Y": c}, half=("validity.Y", "coverage.Y"))
        used = (validity[0] == 1) & (validity[1] == 1) & np.isfinite(a).all(-1)
        sums.append((name, a, b, used, used & (coverage[0] == 1) & (coverage[1] == 1)))
    found = compare(os.path.join(folder, "A"), os.path.join(folder, "B"))
    for name, a, b, used, inside in sums:
        wanted = expected(np.nan_to_num(a), b, used, inside)
        del wanted["dfpr_8bit"]  # whose white is that of both
        check(found["lightmaps"][name + ".exr"], wanted, name)
    d = np.concatenate([(a.astype(float) - b)[used] for _, a, b, used, _ in sums])
    inner = [np.concatenate([v[inside].astype(float) for v, inside in sets]) for sets in
             ([(a - b.astype(float), i) for _, a, b, _, i in sums], [(b, i) for _, _, b, _, i in sums])]
    white = max(b[used].max() for _, _, b, used, _ in sums)
    codes = [code_lengths(a.astype(float), b.astype(float), used, white).ravel() for _, a, b, used, _ in sums]
    for (name, *_), one in zip(sums, codes):
        check(found["lightmaps"][name + ".exr"], {"dfpr_8bit": one.mean()}, name)
    assert len({float(b[used].max()) for _, _, b, used, _ in sums}) > 1, "lightmaps are equally bright"
    check(found, {"texels": len(d), "rmse": np.sqrt(np.mean(d ** 2)), "dfpr": np.linalg.norm(d, axis=1).mean(),
                  "dfpr_8bit": np.concatenate(codes).mean(),
                  "nrmse": np.sqrt(np.mean(inner[0] ** 2)) / inner[1].mean()}, "both objects")
    worst = max(sums, key=lambda s: np.nanmax(np.linalg.norm(np.where(s[3][..., None], s[1] - s[2], 0), axis=-1)))
    assert found["worst"]["lightmap"] == worst[0] + ".exr"
    # a picture, and a lightmap that only one side has
    picture = os.path.join(folder, "difference.png")
    compare(os.path.join(folder, "A"), os.path.join(folder, "B"), "-o", picture)
    with open(picture, "rb") as file:
        assert file.read(8) == b"\x89PNG\r\n\x1a\n"
    os.remove(os.path.join(folder, "B", "lightmaps", "wall.exr"))
    assert "wall.exr" in kiln("compare", os.path.join(folder, "A"), os.path.join(folder, "B"), code=65).stderr


def refusals(rng, folder):
    small, large = os.path.join(folder, "small.exr"), os.path.join(folder, "large.exr")
    exr.write(small, planes(images(rng, 8, 8, 0)[1]))
    exr.write(large, planes(images(rng, 8, 9, 0)[1]))
    for arguments, code, words in ((("compare", small, large), 65, "8 x 8"), (("compare", small, folder), 64, "folder"),
                                   (("compare", small, os.path.join(folder, "none.exr")), 66, "none.exr"),
                                   (("compare", small, __file__), 65, "test_compare.py")):
        run = kiln(*arguments, code=code)
        assert words in run.stderr, run


def bake(scene, folder, *options):
    kiln("bake", scene, "-o", folder, "--samples-probe", "0", "--no-preview", "--quiet", "--backend", "embree",
         *options)
    return folder


def densities(rng, folder):
    """Two densities of one scene: at surface positions, by area. Computed again from the surface points of A (kiln.h5)
    and B's lightmap at the same object and coordinate."""
    scene = os.path.join(folder, "cornell.glb")
    kiln("generate", "cornell", "-o", scene, "--quiet")
    coarse = bake(scene, os.path.join(folder, "coarse"), "--texels-per-metre", "6", "--quality", "draft",
                  "--shared-texels", "keep")
    fine = bake(scene, os.path.join(folder, "fine"), "--texels-per-metre", "14", "--quality", "draft",
                "--samples-direct", "64", "--samples-indirect", "128", "--shared-texels", "keep")
    found = compare(coarse, fine)
    assert found["sampled"] is True and found["dssim"] is found["dfpr_8bit"] is None and not found["identical"] and len(
        found["worst"]["position"]) == 3 and found["picture_psnr"] is None
    with h5py.File(os.path.join(coarse, "kiln.h5")) as file:
        names = [n.decode() for n in file["objects/name"][...]]
        sizes, of, texel = file["objects/lightmap"][...], file["points/object"][...], file["points/texel"][...]
        area, valid = file["points/area"][...].astype(float), file["points/valid"][...].astype(bool)
    sums = np.zeros(4)
    for index, name in enumerate(names):
        a, b = (exr.read(os.path.join(d, "lightmaps", name + ".exr")) for d in (coarse, fine))
        own = np.flatnonzero((of == index) & valid)
        x, y = texel[own, 0], texel[own, 1]
        whole = a.channels["coverage.Y"][y, x] > 0.9995
        own, x, y = own[whole], x[whole], y[whole]
        height, width = b.channels["R"].shape
        fx = np.clip((x + 0.5) / sizes[index, 0] * width - 0.5, 0, width - 1)
        fy = np.clip((y + 0.5) / sizes[index, 1] * height - 0.5, 0, height - 1)
        x0, y0 = np.minimum(fx.astype(int), max(width - 2, 0)), np.minimum(fy.astype(int), max(height - 2, 0))
        x1, y1 = np.minimum(x0 + 1, width - 1), np.minimum(y0 + 1, height - 1)
        wx, wy = fx - x0, fy - y0
        for c in "RGB":
            e = b.channels[c].astype(float)
            at = (1 - wy) * ((1 - wx) * e[y0, x0] + wx * e[y0, x1]) + wy * ((1 - wx) * e[y1, x0] + wx * e[y1, x1])
            difference = a.channels[c][y, x].astype(float) - at
            sums += [(area[own] * difference ** 2).sum(), (area[own] * difference).sum(), (area[own] * at).sum(),
                     area[own].sum()]
    rms, bias, mean = np.sqrt(sums[0] / sums[3]), sums[1] / sums[3], sums[2] / sums[3]
    assert abs(found["mean"] / mean - 1) < 0.03, (found["mean"], mean)  # edges are in kiln's
    # between texel centres noise is averaged
    assert 0.5 * rms / mean < found["nrmse"] < 1.1 * rms / mean, (found["nrmse"], rms / mean)
    assert abs(np.mean([c["mean_difference"] for c in found["channels"].values()]) / mean -
               bias / mean) < 0.01, (found["channels"], bias)
    # of itself there is no difference to speak of; the other way round the same distance
    back = compare(fine, coarse)
    assert abs(back["rmse"] / found["rmse"] - 1) < 0.02
    same = compare(fine, fine)
    assert same["sampled"] is False and same["identical"]
    text = kiln("compare", coarse, fine)
    assert "spread over the surfaces" in text.stdout and "dssim" not in text.stdout, text.stdout
    kiln("compare", coarse, fine, "-o", os.path.join(folder, "no.png"), code=64)
    # kiln's own layouts differ with the density: still the same places
    plain = glb.Scene()
    plain.load(scene)
    for mesh in plain.document["meshes"]:
        for primitive in mesh["primitives"]:
            primitive["attributes"].pop("TEXCOORD_1", None)
            primitive["attributes"].pop("TEXCOORD_0", None)
    bare = plain.write(os.path.join(folder, "bare.glb"))
    unwrapped = bake(bare, os.path.join(folder, "unwrapped"), "--texels-per-metre", "10", "--quality", "draft",
                     "--samples-indirect", "128")
    other = compare(unwrapped, fine)
    assert abs(other["mean"] / found["mean"] - 1) < 0.01 and other["nrmse"] < 1.5 * found["nrmse"], (
        other["nrmse"], found["nrmse"])
    # another geometry under the same names is refused
    plain.document["nodes"][0]["translation"] = [0.25, 0, 0]
    moved = bake(plain.write(os.path.join(folder, "moved.glb")), os.path.join(folder, "moved"), "--texels-per-metre",
                 "5", "--quality", "draft")
    assert "not in the same place" in kiln("compare", moved, fine, code=65).stderr


with tempfile.TemporaryDirectory() as temporary:
    generator = np.random.default_rng(7)
    for test in (plain_files, masked_folders, refusals, densities):
        test(generator, temporary)
print("kiln compare agrees with its definitions")
