"""kiln compare against its definitions (coordinator/output/compare.h) computed again with numpy, on generated files."""
import json
import os
import subprocess
import sys
import tempfile

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402

KILN = os.environ["KILN"]


def kiln(*arguments):
    return subprocess.run([KILN, *arguments], capture_output=True, text=True)


def compare(a, b, *more):
    run = kiln("compare", a, b, "--json", *more)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def ssim(a, b, used, exposure):
    """Mean over used texels, windows made by explicit shifts of the whole image."""
    tone = lambda rgb: np.where(used, (lambda t: t / (1 + t))(exposure * np.maximum(rgb @ [0.2126, 0.7152, 0.0722], 0)), 0)
    height, width = used.shape
    x, y, m = (np.pad(v, 5) for v in (tone(a), tone(b), used.astype(float)))
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


def expected(a, b, used, inside):
    a, b = a.astype(float), b.astype(float)
    d, r = (a - b)[used], b[used]
    length = np.linalg.norm(d, axis=1)
    luminance = r @ [0.2126, 0.7152, 0.0722]
    rmse = np.sqrt(np.mean(d ** 2))
    exposure = 0.18 / np.exp(np.mean(np.log(luminance[luminance > 0])))
    y, x = np.argwhere(used)[np.argmax(length)]
    return {
        "texels": used.sum(), "interior_texels": inside.sum(), "mean": r.mean(), "rmse": rmse,
        "nrmse": np.sqrt(np.mean((a - b)[inside] ** 2)) / b[inside].mean(),
        "rel_rmse": np.sqrt(np.mean((d / (np.abs(r) + 0.01 * np.abs(r).mean())) ** 2)),
        "psnr": 20 * np.log10(np.abs(r).max() / rmse), "dssim": (1 - ssim(a, b, used, exposure)) / 2,
        "dfpr": length.mean(), "dfpr_unit": length.mean() / r.max(),
        "worst": {"difference": length.max(), "x": x, "y": y},
    }


def check(found, wanted, what):
    for name, value in wanted.items():
        if isinstance(value, dict):
            check(found[name], value, what + "." + name)
            continue
        tolerance = 2e-6 * abs(value) + (2e-7 if name == "dssim" else 1e-12)
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
            [(33, 47, 0.1, "ZIP", False), (16, 16, 0.5, "NONE", False), (70, 31, 0.02, "ZIP", True), (5, 3, 0.3, "ZIPS", False)]):
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
        check(found["lightmaps"][name + ".exr"], expected(np.nan_to_num(a), b, used, inside), name)
    d = np.concatenate([(a.astype(float) - b)[used] for _, a, b, used, _ in sums])
    inner = [np.concatenate([v[inside].astype(float) for v, inside in sets]) for sets in
             ([(a - b.astype(float), i) for _, a, b, _, i in sums], [(b, i) for _, _, b, _, i in sums])]
    check(found, {"texels": len(d), "rmse": np.sqrt(np.mean(d ** 2)), "dfpr": np.linalg.norm(d, axis=1).mean(),
                  "nrmse": np.sqrt(np.mean(inner[0] ** 2)) / inner[1].mean()}, "both objects")
    worst = max(sums, key=lambda s: np.nanmax(np.linalg.norm(np.where(s[3][..., None], s[1] - s[2], 0), axis=-1)))
    assert found["worst"]["lightmap"] == worst[0] + ".exr"
    # a picture, and a lightmap that only one side has
    picture = os.path.join(folder, "difference.png")
    compare(os.path.join(folder, "A"), os.path.join(folder, "B"), "-o", picture)
    with open(picture, "rb") as file:
        assert file.read(8) == b"\x89PNG\r\n\x1a\n"
    os.remove(os.path.join(folder, "B", "lightmaps", "wall.exr"))
    run = kiln("compare", os.path.join(folder, "A"), os.path.join(folder, "B"))
    assert run.returncode == 65 and "wall.exr" in run.stderr, run


def refusals(rng, folder):
    small, large = os.path.join(folder, "small.exr"), os.path.join(folder, "large.exr")
    exr.write(small, planes(images(rng, 8, 8, 0)[1]))
    exr.write(large, planes(images(rng, 8, 9, 0)[1]))
    for arguments, code, words in ((("compare", small, large), 65, "8 x 8"), (("compare", small, folder), 64, "folder"),
                                   (("compare", small, os.path.join(folder, "none.exr")), 66, "none.exr"),
                                   (("compare", small, __file__), 65, "test_compare.py")):
        run = kiln(*arguments)
        assert run.returncode == code and words in run.stderr, f"kiln {' '.join(arguments)}: {run}"


with tempfile.TemporaryDirectory() as temporary:
    generator = np.random.default_rng(7)
    for test in (plain_files, masked_folders, refusals):
        test(generator, temporary)
print("kiln compare agrees with its definitions")
