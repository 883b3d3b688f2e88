"""--keep-transport rows and kiln relight where rays go on: from a polished floor, a mirror, brushed metal and a ball of
glass, on from the far side of tinted panes and of a smooth mesh.

Kept chains change no light; their files have the same bytes from one rank, from three and from a bake that was stopped
and gone on with, and nothing else is left beside them. Nothing changed, and lights, colours of dull surfaces, emission
and sky changed, relit on one rank and on three, it has the bits of its bake, and no ray was traced that was kept.
So does each of several states from one load. Another colour of a surface that rays go on from is refused with its
name, and so is damage."""
import json
import os
import shutil
import struct
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
import harness  # noqa: E402
import sealing  # noqa: E402
from reading import run_json  # noqa: E402
from relit import done, kept_files, kiln, light, rays, refused, refused_damaged, same  # noqa: E402

OPTIONS = ["--texels-per-metre", "2", "--backend", "embree", "--samples-direct", "8", "--samples-bounce", "8",
           "--samples-indirect", "32", "--samples-probe", "8", "--probe-spacing", "1.5", "--bounces", "2",
           "--photons", "1000", "--iterations", "1"]
KEEP = ["--keep-transport", "rows"]
STOPPED = 75


def room(path, edited=False, gold=(0.9, 0.6, 0.3)):
    """`edited`: other lights, colours of dull surfaces and sky; `gold`: of the brushed metal."""
    scene = glb.Scene()
    wall = scene.material("wall", (0.3, 0.6, 0.7) if edited else (0.7, 0.7, 0.6))
    glow = scene.material("glow", (0.2, 0.2, 0.2), (1, 4, 2) if edited else (5, 4, 3))
    floor = glb.gloss(scene, "floor", (0.5, 0.4, 0.3), roughness=0.2)
    mirror = glb.gloss(scene, "mirror", (0.9, 0.9, 0.9), metallic=1.0)
    brushed = glb.gloss(scene, "gold", gold, metallic=1.0, roughness=0.4)
    glass = glb.gloss(scene, "glass", (0.9, 1, 0.9), transmission={"transmissionFactor": 1.0},
                      volume={"thicknessFactor": 0.1, "attenuationDistance": 0.5,
                              "attenuationColor": [0.5, 0.9, 0.6]})
    pane = glb.gloss(scene, "pane", (0.9, 0.4, 0.4), transmission={"transmissionFactor": 0.8})
    glb.box(scene, "room", (0, 0, 0), (2, 2, 3), wall, inward=range(5))
    scene.quad("floor", ((0, 0.01, 3), (2, 0.01, 3), (2, 0.01, 0), (0, 0.01, 0)), floor)
    scene.quad("mirror", ((0.05, 0.3, 2), (0.05, 0.3, 1), (0.05, 1.5, 1), (0.05, 1.5, 2)), mirror)
    glb.box(scene, "lamp", (0.8, 1.7, 0.8), (1.2, 1.8, 1.2), glow)
    glb.box(scene, "block", (1.3, 0.02, 0.4), (1.7, 0.6, 0.8), brushed)
    glb.ball(scene, "ball", (0.6, 0.4, 0.7), 0.35, glass, rings=6)
    glb.ball(scene, "dull", (1.4, 0.9, 0.6), 0.25, wall, rings=6)
    scene.quad("pane", ((0.2, 0.2, 1.9), (1.8, 0.2, 1.9), (1.8, 1.2, 1.7), (0.2, 1.2, 1.7)), pane)
    scene.light("sun", {"type": "directional", "intensity": 1.0 if edited else 3.0}, rotation=[-0.5, 0, 0, 0.866])
    scene.environment((2, 0.5, 0.2) if edited else (0.5, 0.6, 0.9))
    return scene.write(path)


def make_infinite(folder, name):
    """What escapes at a point that has chains, with hashes that fit (worker/pass/row_chains.h)."""
    with open(os.path.join(folder, name), "rb") as file:
        data = bytearray(file.read())
    points, key = struct.unpack_from("<QQ", data, 24)
    for point in range(points):
        record = 4096 + 56 * point
        check, _, at, words = struct.unpack_from("<IIQQ", data, record)
        if check != 0 and words > 0:
            break
    stream = 4096 + 56 * points + 4 * at

    def fit():
        seed = sealing.hash64(data[record + 24:record + 56], key ^ (point * 0x9e3779b97f4a7c15 & (1 << 64) - 1))
        return sealing.hash64(data[stream:stream + 4 * words], seed) & 0xffffffff

    assert fit() == check, "the format has changed"
    struct.pack_into("<f", data, record + 24, float("inf"))
    struct.pack_into("<I", data, record, fit())
    with open(os.path.join(folder, name), "wb") as file:
        file.write(data)
    sealing.fit(folder, name)


with tempfile.TemporaryDirectory() as top:
    def at(name):
        return os.path.join(top, name)

    scene, edited = room(at("room.glb")), room(at("edited.glb"), edited=True)
    done("bake", scene, *OPTIONS, "-o", at("plain"))
    done("bake", scene, *OPTIONS, *KEEP, "-o", at("kept"))
    same(at("plain"), at("kept"), "kept chains change light")
    done("bake", scene, *OPTIONS, *KEEP, "-o", at("three"), ranks=3)
    kept = kept_files(at("kept"))
    chains = sorted(name for name in kept if name.startswith("chains"))
    assert len(chains) == len(kept) / 2 and all(name.count("-") == 2 for name in chains), sorted(kept)
    assert kept == kept_files(at("three")), "chains of three ranks differ"
    assert kiln("verify", at("kept"), "--quiet").returncode == 0

    again = ("bake", scene, *OPTIONS, *KEEP, "-o", at("stopped"), "--quiet", "--no-preview", "--no-export")
    assert kiln(*again, "--max-time", "0.2", slowness=20).returncode == STOPPED, "nothing was stopped"
    run = kiln(*again)
    assert run.returncode == 0, run.stderr
    assert kept_files(at("stopped")) == kept, "chains of a bake that was stopped differ"

    counted = run_json(at("kept"))["transport"]["rays_kept"]
    done("relight", at("kept"), "-o", at("nothing"))
    same(at("plain"), at("nothing"), "nothing changed")
    assert rays(at("nothing")) == (counted, 0), (rays(at("nothing")), counted)
    done("bake", edited, *OPTIONS, "-o", at("edited"))
    before, after = light(at("plain")), light(at("edited"))
    assert before["kiln.h5/irradiance/caustic"] != after["kiln.h5/irradiance/caustic"], sorted(before)
    done("relight", at("kept"), edited, "-o", at("relit"), ranks=3)
    same(at("edited"), at("relit"), "edited scene on 3 ranks")
    assert rays(at("relit")) == (counted, 0), rays(at("relit"))

    refused(harness.BAD_INPUT, "block                            other gloss or colour of a surface that rays go on",
            "relight", at("kept"), room(at("silver.glb"), gold=(0.9, 0.9, 0.9)), "-o", at("no"))

    states = {"same": {}, "noon": {"lights": {"sun": {"scale": 0.3}}, "environment": {"radiance": [2, 0.5, 0.2]},
                                   "materials": {"wall": {"albedo": [0.3, 0.6, 0.7]}, "glow": {"emission": [1, 4, 2]}}}}
    for name, text in (("states.yaml", states), ("noon.yaml", states["noon"]),
                       ("wrong.yaml", {"a": {"materials": {"gold": {"albedo": [0.9, 0.9, 0.9]}}}})):
        with open(at(name), "w") as file:
            json.dump(text, file)
    done("relight", at("kept"), "--states", at("states.yaml"), "-o", at("states"))
    done("relight", at("kept"), at("noon.yaml"), "-o", at("noon"))
    same(at("plain"), os.path.join(at("states"), "same"), "the state of nothing changed")
    same(at("noon"), os.path.join(at("states"), "noon"), "a state against a relit bake")
    done("relight", at("kept"), "--listen", "-o", at("live"), ranks=3, lines="{}\n" + json.dumps(states["noon"]))
    same(at("noon"), at("live"), "a line on 3 ranks, after another")
    with open(os.path.join(at("states"), "states.json")) as file:
        told = json.load(file)
    assert (told["rays_read"], told["rays_traced"]) == (2 * counted, 0), told
    refused(harness.BAD_INPUT, "material 'gold'", "relight", at("kept"), "--states", at("wrong.yaml"), "-o", at("no"))
    shutil.copytree(at("kept"), at("hurt"))
    hurt = os.path.join(at("hurt"), "transport", "chains-65535-0")
    with open(hurt, "r+b") as file:
        file.seek(-2, os.SEEK_END)
        byte = file.read(1)
        file.seek(-2, os.SEEK_END)
        file.write(bytes([byte[0] ^ 1]))
    refused_damaged("the row of surface point", at("hurt"), edited, "-o", at("no"))
    if sealing.available():
        shutil.rmtree(at("hurt"))
        shutil.copytree(at("kept"), at("hurt"))
        make_infinite(at("hurt"), "transport/chains-65535-0")
        refused(harness.BAD_INPUT, "the row of surface point", "relight", at("hurt"), "-o", at("no"))
    print("%d rays kept; rows of %d bytes, chains of %d" %
          (counted, sum(len(kept[name]) for name in kept if name not in chains),
           sum(len(kept[name]) for name in chains)))
