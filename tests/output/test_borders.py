"""Borders of charts: what a sampler reads there is light of the same chart; where a layout has too little padding, kiln
says which density would do, and that density does; so does --repack.

Longer: test_borders.py --sponza bakes the Sponza of ../shared/scenes at the density that `kiln check` names, and packed
anew.
"""
import json
import os
import re
import sys
import tempfile

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import chart_borders  # noqa: E402
import exr  # noqa: E402
from program import kiln, run_json  # noqa: E402

REPOSITORY = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SHARED = os.path.normpath(os.path.join(REPOSITORY, "..", "shared", "scenes"))
FEW = ("--quality", "draft", "--samples-direct", "16", "--samples-bounce", "4", "--samples-indirect", "64",
       "--samples-probe", "0")


def bake(folder, scene, *options):
    run = kiln("bake", scene, "-o", folder, "--no-preview", *FEW, *options)
    return run.stdout + run.stderr, run_json(folder)


def measure(folder, most):
    """The share of the borders' length that is off by more than 10 %: at most `most`."""
    total = chart_borders.total_of(chart_borders.measure_bake(folder))
    off = chart_borders.share(total, "off")
    print("%s: %d charts, %.0f texels of border, off %.2f %%" %
          (os.path.basename(folder), total["charts"], total["length"], 100 * off))
    assert total["length"] > 100 and off <= most, total
    return total


def by_distance(folder, name):
    """The same measure when every margin texel is given to the nearest texel, whoever reads it: the measure has to see
    that."""
    scene = chart_borders.Scene(os.path.join(folder, "scene.kscene"))
    item = next(o for o in scene.objects if scene.name(o) == name)
    channels, _ = exr.read(os.path.join(folder, "lightmaps", name + ".exr"))
    values = np.stack([channels[c] for c in "RGB"], -1).astype(np.float32) @ chart_borders.LUMINANCE
    height, width = values.shape
    everyone = np.where(channels["coverage.Y"].ravel() > 0, 0, -1)
    index = np.arange(width * height)
    low, high = chart_borders.nearest_own(everyone, values.ravel(), index, np.zeros(len(index), np.int64), width,
                                          height)
    margin = (everyone < 0) & ~np.isnan(high)
    values.ravel()[margin] = high[margin]
    return chart_borders.share(chart_borders.measure(*scene.mesh(item["mesh"]), values), "off")


def cornell(folder):
    """Two blocks of five charts each: nothing is off, though charts lie close together."""
    result = os.path.join(folder, "cornell")
    bake(result, os.path.join(REPOSITORY, "jobs", "cornell.glb"), "--texels-per-metre", "24")
    measure(result, 0.0)
    off = by_distance(result, "short_block")
    assert off > 0.05, "the measure does not see margins that go to the nearest chart: %g" % off


def two_rooms(folder, scene):
    result = os.path.join(folder, "two_rooms")
    bake(result, scene, "--texels-per-metre", "24", "--no-stitch")
    measure(result, 0.0)
    bake(result, scene, "--texels-per-metre", "24")  # margin texels at seams take what lies beyond
    measure(result, 0.001)


def named_density(text):
    found = re.search(r"--texels-per-metre ([0-9.e+-]+) would leave less than 1 %", text)
    assert found and "less than two texels apart" in text and "--repack" in text, text
    return found[1]


def too_coarse(folder, scene, density, least, *options):
    """At a low density charts bleed and kiln says so; at the one it names they do not, nor when they are packed
    anew. Charts that even share texels are kept here."""
    options = ("--shared-texels", "keep", *options)
    wanted = named_density(kiln("check", scene, "--texels-per-metre", density, *options[:2]).stdout)
    assert named_density(kiln("info", scene, "--texels-per-metre", density, *options[:2]).stdout) == wanted
    assert float(wanted) > float(density)
    words, coarse = bake(os.path.join(folder, "coarse"), scene, "--texels-per-metre", density, *options)
    assert coarse["borders"]["disturbed_texels"] > least * coarse["borders"]["texels"]
    assert "--texels-per-metre %s would leave" % wanted in words and "light of another chart is read" in words, words
    _, named = bake(os.path.join(folder, "named"), scene, "--texels-per-metre", wanted, *options)
    assert named["borders"]["disturbed_texels"] < 0.01 * named["borders"]["texels"], named["borders"]
    measure(os.path.join(folder, "named"), 0.01)
    words, packed = bake(os.path.join(folder, "packed"), scene, "--texels-per-metre", density, "--repack", *options)
    assert packed["borders"]["disturbed_texels"] < 0.001 * packed["borders"][
        "texels"] and "another chart" not in words, packed["borders"]
    measure(os.path.join(folder, "packed"), 0.001)
    info = json.loads(kiln("info", scene, "--texels-per-metre", density, "--repack", "--json").stdout)
    assert "repacked" in {m["layout"] for m in info["meshes"]}


def main(arguments):
    with tempfile.TemporaryDirectory(prefix="kiln-borders-") as folder:
        if arguments == ["--sponza"]:
            too_coarse(folder, os.path.join(SHARED, "third_party", "crytek_sponza.glb"), "4", 0.05, "--environment",
                       "1,1,1",
                       "--bounces", "1", "--samples-direct", "4", "--samples-bounce", "1", "--samples-indirect", "8")
            return
        cornell(folder)
        two_rooms(folder, os.path.join(REPOSITORY, "tests", "data", "two_rooms.glb"))
        too_coarse(folder, os.path.join(REPOSITORY, "jobs", "cornell.glb"), "8", 0.02)


if __name__ == "__main__":
    main(sys.argv[1:])
