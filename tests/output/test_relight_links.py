"""--keep-transport links and kiln relight: links that are found once serve any light, and say what they are off by.

A room with a crate and a window, and a sun that comes in. Kept links change no light; they are the same bytes from one
rank and from three, from a bake that goes on after interruptions, and about as many as kiln plan says. Nothing changed:
the bake bit for bit, and no link is found anew. Lights, colours and sky changed: the same bits on one rank and on
three, and 1.96 times the stated error of indirect light holds for as many texels as it should, against all pairs. Links
that were opened by other light do not know a patch of sun on the floor: their stated error says so, and --target-error
opens them there until they do, or says where they do not. What is damaged, or cannot be kept, is refused."""
import json
import os
import shutil
import sys
import tempfile

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
import harness  # noqa: E402
from reading import run_json  # noqa: E402
from relit import kiln, refused, refused_damaged  # noqa: E402

PLAIN = ["--texels-per-metre", "5", "--backend", "embree", "--samples-direct", "128", "--samples-indirect", "64",
         "--samples-probe", "0", "--no-export", "--denoise", "none", "--bounces", "2", "--method", "radiosity",
         "--error-map"]
LINKS = [*PLAIN, "--patches", "links:0.03"]
KEEP = ["--keep-transport", "links"]
USAGE, STOPPED = 64, 75
# The sun comes in at 45 and 35 degrees, or stands behind the room.
HIGH, LOW, BEHIND = (-0.3826834, 0, 0, 0.9238795), (-0.3007058, 0, 0, 0.9537170), (0, 0.9238795, 0.3826834, 0)


def wall(scene, name, material, corner, one, other):
    """A quad that faces one x other."""
    corner, one, other = np.array(corner, float), np.array(one, float), np.array(other, float)
    scene.quad(name, [tuple(corner + k) for k in (0 * one, one, one + other, other)], material)


def room(path, sun, strength=3.0, lamp=None, sky=(0.5, 0.6, 0.9), color=(0.7, 0.7, 0.6)):
    """3 m x 2.5 m x 4 m, with a crate, and an opening of 1 m x 1.2 m in the wall at z = 4."""
    scene = glb.Scene()
    paint = scene.material("wall", color, double_sided=True)
    for name, corner, one, other in (
        ("floor", (0, 0, 0), (0, 0, 4), (3, 0, 0)), ("ceiling", (0, 2.5, 0), (3, 0, 0), (0, 0, 4)),
        ("left", (0, 0, 0), (0, 2.5, 0), (0, 0, 4)), ("right", (3, 0, 0), (0, 0, 4), (0, 2.5, 0)),
        ("back", (0, 0, 0), (3, 0, 0), (0, 2.5, 0)), ("below", (0, 0, 4), (0, 1, 0), (3, 0, 0)),
        ("above", (0, 2.2, 4), (0, 0.3, 0), (3, 0, 0)), ("one", (0, 1, 4), (0, 1.2, 0), (1, 0, 0)),
        ("other", (2, 1, 4), (0, 1.2, 0), (1, 0, 0))):
        wall(scene, name, paint, corner, one, other)
    glb.box(scene, "crate", (0.3, 0.01, 0.6), (1.0, 0.8, 1.3), scene.material("red", (0.7, 0.15, 0.1)))
    glow = scene.material("glow", (0.2, 0.2, 0.2), *([lamp] if lamp is not None else []))
    glb.box(scene, "lamp", (1.3, 1.9, 1.8), (1.7, 2.0, 2.2), glow)
    scene.light("sun", {"type": "directional", "intensity": strength}, rotation=sun)
    scene.environment(sky)
    return scene.write(path)


def done(*arguments, ranks=1):
    run = kiln(*arguments, "--quiet", "--no-preview", "--threads", "1", ranks=ranks)
    assert run.returncode == 0, f"{' '.join(map(str, arguments))}: exit {run.returncode}\n{run.stderr}"
    return Bake(arguments[arguments.index("-o") + 1])


class Bake:
    """Light of the valid points by object and texel."""

    def __init__(self, folder):
        self.folder = folder
        self.run = run_json(folder)
        with h5py.File(os.path.join(folder, "kiln.h5"), "r") as file:
            get = lambda name: file[name][...].astype(np.float64)
            texel = file["points/texel"][...].reshape(-1, 2)
            sides = file["points/side"][...] if "points/side" in file else np.zeros(len(texel))
            order = np.lexsort((texel[:, 0], texel[:, 1], sides, file["points/object"][...]))
            order = order[file["points/valid"][...].astype(bool)[order]]
            self.area = get("points/area")[order]
            self.position = get("points/position")[order]
            self.light = get("irradiance/indirect")[order] @ harness.LUMINANCE
            self.error = get("irradiance/error_indirect")[order] if "error_indirect" in file["irradiance"] else None

    def file(self):
        with open(os.path.join(self.folder, "transport", "links"), "rb") as file:
            return file.read()


def bits(folder):
    found = {}
    with h5py.File(os.path.join(folder, "kiln.h5"), "r") as file:
        file.visititems(lambda key, item: found.update({key: item[()].tobytes()})
                        if isinstance(item, h5py.Dataset) and "provenance" not in key else None)
    for name in os.listdir(os.path.join(folder, "lightmaps")):
        with open(os.path.join(folder, "lightmaps", name), "rb") as file:
            found[name] = file.read()
    return found


def same(one, other, what):
    one, other = bits(one), bits(other)
    differ = sorted(name for name in one if one[name] != other.get(name))
    assert one.keys() == other.keys() and not differ, (what, differ)


def off(bake, truth):
    """Root of the mean square over the mean."""
    return np.sqrt(bake.area @ (bake.light - truth.light) ** 2 / bake.area.sum()) / (
        truth.area @ truth.light / truth.area.sum())


def counts(bake):
    return bake.run["relight"]["links_replayed"], bake.run["relight"]["links_traced"]


def stopped(at, scene):
    """A bake that is stopped as soon as there is something to go on from, again and again."""
    stops, slow = 0, ("bake", scene, *LINKS, *KEEP, "-o", at, "--quiet", "--no-preview", "--threads", "1")
    run = kiln(*slow, "--max-time", "0.2", slowness=10)
    while run.returncode == STOPPED and stops < 20:
        stops += 1
        run = kiln(*slow, "--max-time", str(0.2 * 1.5 ** stops), slowness=10)
    assert run.returncode == 0 and stops > 0, (stops, run.stderr)
    return Bake(at)


def reached(mended, sunny, at, coarse, target):
    """What a bake says of its target, and that opened links are the same bits from three ranks, and kept."""
    said = mended.run["error"]
    assert said["target"] == 0.03 and "rounds" not in said, said
    assert said["above_target_indirect"] < 0.15 < said["above_target_direct"] <= said["above_target"], said
    assert any("--target-error 0.03 is not reached" in note for note in mended.run["notes"]), mended.run["notes"]
    done("relight", at("shade"), sunny, *target, "-o", at("mended3"), ranks=3)
    same(at("mended"), at("mended3"), "opened links: one rank and three")
    kept = done("bake", sunny, *coarse, *target, *KEEP, "-o", at("opened"))
    again = done("relight", at("opened"), *target, "-o", at("again"))
    same(at("opened"), at("again"), "opened links that are kept")
    assert counts(again) == (kept.run["transport"]["links_kept"], 0), again.run["relight"]
    loose = done("bake", sunny, *coarse, "--target-error", "0.5", "-o", at("loose"))
    assert loose.run["error"]["above_target"] < 0.02, loose.run["error"]
    assert not any("--target-error" in note for note in loose.run["notes"]), loose.run["notes"]


def main(top):
    def at(name):
        return os.path.join(top, name)

    lamp = room(at("lamp.glb"), HIGH, lamp=(5, 4, 3))
    edited = room(at("edited.glb"), LOW, 2.0, (1, 2, 6), (0.9, 0.6, 0.3), (0.3, 0.6, 0.7))
    done("bake", lamp, *LINKS, "-o", at("plain"))
    kept = done("bake", lamp, *LINKS, *KEEP, "-o", at("kept"))
    same(at("plain"), at("kept"), "kept links change light")
    count = kept.run["transport"]["links_kept"]
    assert count == kept.run["links"]["count"] > 0, kept.run["transport"]
    assert done("bake", lamp, *LINKS, *KEEP, "-o", at("three"), ranks=3).file() == kept.file(), "three ranks"
    assert stopped(at("stopped"), lamp).file() == kept.file(), "after interruptions"
    planned = kiln("plan", lamp, *[o for o in LINKS if o != "--no-export"], *KEEP, "--ranks", "1", "--json")
    assert planned.returncode == 0, planned.stderr
    ratio = json.loads(planned.stdout)["disk_bytes"]["transport"] / len(kept.file())
    assert 0.4 < ratio < 2.5, ratio

    assert counts(done("relight", at("kept"), "-o", at("nothing"))) == (count, 0)
    same(at("plain"), at("nothing"), "nothing changed")
    relit = done("relight", at("kept"), edited, "-o", at("relit"))
    assert counts(relit) == (count, 0), relit.run["relight"]
    done("relight", at("three"), edited, "-o", at("relit3"), ranks=3)
    same(at("relit"), at("relit3"), "one rank and three")
    pairs = [o for o in PLAIN if o != "--error-map"]
    truth = done("bake", edited, *pairs, "--samples-indirect", "512", "-o", at("truth"))
    lit = relit.error > 0
    holds = np.mean(np.abs(relit.light - truth.light)[lit] < 1.96 * relit.error[lit])
    print("relit: off by %.2f %%, stated %.2f %% in the median; 1.96 standard errors hold for %.1f %% of %d texels" %
          (100 * off(relit, truth), 100 * np.median(relit.error[lit] / truth.light[lit]), 100 * holds, lit.sum()))
    assert 0.93 < holds < 0.975, holds

    # a patch of sun
    shade, sunny = room(at("shade.glb"), BEHIND), room(at("sunny.glb"), HIGH, 30.0)
    coarse = [*LINKS, "--patches", "links:0.1"]
    truth = done("bake", sunny, *pairs, "--samples-indirect", "512", "-o", at("sun_truth"))
    done("bake", shade, *coarse, *KEEP, "-o", at("shade"))
    as_kept = done("relight", at("shade"), sunny, "-o", at("as_kept"))
    target = ["--target-error", "0.03"]
    mended = done("relight", at("shade"), sunny, *target, "-o", at("mended"))
    before, after = off(as_kept, truth), off(mended, truth)
    stated = lambda bake: np.sqrt(bake.area @ bake.error ** 2 / bake.area.sum()) / (
        truth.area @ truth.light / truth.area.sum())
    print("patch of sun: off by %.2f %%, stated %.2f %%; mended %.2f %%, stated %.2f %%; %d links replayed" %
          (100 * before, 100 * stated(as_kept), 100 * after, 100 * stated(mended), counts(mended)[0]))
    assert counts(as_kept)[1] == 0 and counts(mended)[0] > 0 and counts(mended)[1] > 0
    assert stated(as_kept) > 0.5 * before and after < 0.025, (stated(as_kept), before, after)
    level = np.maximum(truth.light, 0.1 * truth.area @ truth.light / truth.area.sum())
    above = np.mean(np.abs(mended.light - truth.light) > 0.03 * level)
    print("%.1f %% of the texels are off by more than the target; %s" % (100 * above, mended.run["error"]))
    assert above < 0.05, above
    reached(mended, sunny, at, coarse, target)

    refused(USAGE, "this bake has none", "bake", lamp, *PLAIN[:-1], *KEEP, "-o", at("no"))
    refused(USAGE, "those are kept that --method cells gathers by", "bake", lamp, *LINKS, "--keep-transport", "rows",
            "-o", at("no"))
    with open(at("states.yaml"), "w") as file:
        file.write("dark: {lights: {sun: {on: false}}}\n")
    refused(USAGE, "serve one state at a time", "relight", at("kept"), "--states", at("states.yaml"), "-o", at("no"))
    assert kiln("verify", at("kept"), "--quiet").returncode == 0
    for place, words in ((20, "not as it was written, or of another bake"), (-3, "links of the surface points from")):
        shutil.rmtree(at("hurt"), ignore_errors=True)
        shutil.copytree(at("kept"), at("hurt"))
        data = bytearray(kept.file())
        data[place] ^= 1
        with open(os.path.join(at("hurt"), "transport", "links"), "wb") as file:
            file.write(data)
        refused_damaged(words, at("hurt"), edited, "-o", at("no"))
        refused(harness.BAD_INPUT, "transport/links", "verify", at("hurt"))
    os.remove(os.path.join(at("hurt"), "transport", "links"))
    refused(harness.BAD_INPUT, "transport/links' is missing", "relight", at("hurt"), edited, "-o", at("no"))
    print("%d links of %d points kept in %d bytes" % (count, len(kept.area), len(kept.file())))


with tempfile.TemporaryDirectory() as folder:
    main(folder)
