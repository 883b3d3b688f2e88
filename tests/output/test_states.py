"""kiln relight --states and --listen: many states of lights, colours and sky from one load.

Two closed rooms and a yard: lamps, a screen that emits, a smooth ball, a sun and a constant sky. Where no light is
changed, also with other colours, a state has the bits of the bake of that scene, by rows and where these are traced.
States that are solved together have the bits that each has with fewer or alone, on one, three and four ranks, and
by --listen.
What scales lights agrees with fresh bakes of the edited scene, by another seed, within the errors that both state.
--listen answers each line, writes what has changed alone, and goes on after a line that is wrong. What cannot be is
refused."""
import json
import os
import sys
import tempfile

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
import harness  # noqa: E402
from program import content, run_json  # noqa: E402
from relit import kiln  # noqa: E402

OPTIONS = ["--texels-per-metre", "4", "--backend", "embree", "--samples-direct", "64", "--samples-bounce", "16",
           "--samples-indirect", "64", "--samples-probe", "8", "--probe-spacing", "2", "--materials", "diffuse"]
KEEP = ["--keep-transport", "rows"]
USAGE = 64
STATES = {
    "same": {},
    "dim": {"lights": {"lamp": {"scale": [0.5, 0.25, 1]}}},
    "dark": {"lights": {"*": {"on": False}}, "materials": {"screen": {"on": False}}, "environment": {"on": False}},
    "wall": {"materials": {"wall": {"albedo": [0.3, 0.6, 0.7]}}},
    "sky": {"environment": {"radiance": [2, 1, 0.2]}, "lights": {"sun": {"intensity": [1, 1, 2]}},
            "materials": {"screen": {"emission": [0, 1, 6]}}},
    "all": {"lights": {"lamp": {"scale": 3}}, "materials": {"wall": {"albedo": [0.8, 0.5, 0.5]},
                                                            "screen": {"emission-scale": 0.2}}},
}
WRONG = {"a: {lights: {moon: {scale: 2}}}": "state a: changes: no light of the scene has a name that matches 'moon'",
         "a/b: {}": "'a/b' is no name of a state", "transport: {}": "is no name of a state",
         "a: 1": "a needs its changes",
         "a: {}\na: {}": "the key stands twice", "{}": "has no state", "[a]": "is one mapping",
         "a: {sky: {scale: 2}}": "there is no key 'sky'"}


def rooms(path, moved=False):
    scene = glb.Scene()
    wall = scene.material("wall", (0.7, 0.7, 0.6))
    screen = scene.material("screen", (0.2, 0.2, 0.2), (1, 2, 4))
    ball = scene.material("ball", (0.8, 0.2, 0.2))
    glb.box(scene, "room", (0, 0, 0), (2, 2, 2), wall, inward=range(6))
    glb.box(scene, "other", (5, 0, 0), (6, 1, 1), wall, inward=range(6))
    glb.box(scene, "panel", (0.5, 0.7, 0.02), (1.5, 1.3, 0.06), screen)
    glb.ball(scene, "ball", (1.2, 0.5, 1.1), 0.35, ball, rings=8)
    glb.box(scene, "yard", (-3, -0.2, 0), (-1, 0, 2), wall)
    glb.box(scene, "post", (-2.2, 0, 0.8), (-1.8, 0.8, 1.2), wall)
    if moved:
        next(n for n in scene.document["nodes"] if n["name"] == "ball")["translation"] = [0.1, 0, 0]
    scene.light("lamp", {"type": "point", "intensity": 3.0}, translation=[0.6, 1.7, 1.5])
    scene.light("bulb", {"type": "point", "intensity": 1.0}, translation=[5.5, 0.8, 0.5])
    scene.light("sun", {"type": "directional", "intensity": 3.0}, rotation=[-0.5, 0, 0, 0.866])
    scene.environment((0.5, 0.6, 0.9))
    return scene.write(path)


def done(*arguments, ranks=1, lines=None, threads=1):
    run = kiln(*arguments, "--quiet", "--no-preview", "--no-export", "--threads", threads, ranks=ranks, lines=lines)
    assert run.returncode == 0, f"{' '.join(map(str, arguments))}: exit {run.returncode}\n{run.stderr}"
    return run.stdout


def light(folder):
    """All that a bake says of light, as bytes by name."""
    found = {}
    for name in {"kiln.h5", "volume.hdf"} & set(os.listdir(folder)):
        with h5py.File(os.path.join(folder, name), "r") as file:
            file.visititems(lambda key, item: found.update({name + "/" + key: item[()].tobytes()})
                            if isinstance(item, h5py.Dataset) and "provenance" not in key else None)
    for name in os.listdir(os.path.join(folder, "lightmaps")):
        found[name] = content(os.path.join(folder, "lightmaps", name))
    return found


def same(one, other, what):
    one, other = light(one), light(other)
    differ = sorted(name for name in one if one[name] != other.get(name))
    assert one.keys() == other.keys() and not differ, (what, differ)


def values(folder):
    """Luminance of all light of each point that has some place to gather, and its standard error."""
    with h5py.File(os.path.join(folder, "kiln.h5"), "r") as file:
        total = file["irradiance/total"][()].astype(float) @ [0.2126, 0.7152, 0.0722]
        return total, file["irradiance/error"][()].astype(float)


def within(state, bake, what):
    """A state and a bake of another seed differ by what both say of their errors."""
    (a, da), (b, db) = values(state), values(bake)
    lit = (a > 0) | (b > 0)
    error = np.hypot(da, db)[lit]
    off = np.abs(a - b)[lit]
    share = [float(np.mean(off <= n * error + 1e-4 * b[lit])) for n in (1, 2, 3)]
    mean = abs(a.sum() / b.sum() - 1)
    assert share[0] > 0.68 and share[1] > 0.93 and share[2] > 0.97 and mean < 0.01, (what, share, mean)
    return "%s %.3f %.3f mean off %.1e" % (what, share[0], share[1], mean)


with tempfile.TemporaryDirectory() as top:
    def at(*names):
        return os.path.join(top, *names)

    def file(name, text):
        with open(at(name), "w") as out:
            out.write(text if isinstance(text, str) else json.dumps(text))
        return at(name)

    scene = rooms(at("rooms.glb"))
    done("bake", scene, *OPTIONS, *KEEP, "-o", at("kept"), threads=2)
    states = file("states.yaml", STATES)
    done("relight", at("kept"), "--states", states, "-o", at("many"))
    same(at("kept"), at("many", "same"), "nothing changed")
    done("bake", scene, *OPTIONS, "--changes", file("wall.yaml", STATES["wall"]), "-o", at("wall"))
    same(at("wall"), at("many", "wall"), "other colours")
    assert values(at("many", "dark"))[0].max() == 0
    with open(at("many", "states.json")) as report:
        told = json.load(report)
    assert [s["state"] for s in told["states"]] == list(STATES) and told["rays_traced"] * 5 < told["rays_read"], told
    relight = run_json(at("many", "dim"))["relight"]
    assert relight["state"] == "dim" and relight["direct_light"] == "parts, scaled" and relight["volume"] == "traced"

    few = file("few.yaml", {"all": STATES["all"]})
    done("relight", at("kept"), "--states", few, "-o", at("few"), ranks=3)
    same(at("many", "all"), at("few", "all"), "alone, on 3 ranks")
    assert kiln("verify", at("many", "all"), "--quiet").returncode == 0

    # groups of lights that a bake has told apart are not told apart by its states
    coarse = ["1" if o == "4" else o for o in OPTIONS]
    done("bake", scene, *coarse, *KEEP, "--light-groups", file("groups.yaml", "lamps: {lights: [lamp]}"), "-o",
         at("groups"))
    done("bake", scene, *coarse, *KEEP, "-o", at("coarse"))
    done("relight", at("groups"), "--states", few, "-o", at("of_groups"))
    done("relight", at("coarse"), "--states", few, "-o", at("of_coarse"))
    same(at("of_coarse", "all"), at("of_groups", "all"), "groups left out")

    # in parts, whose spread is the error
    parts = (*OPTIONS, "--error-map", "--samples-probe", "0", "--bounces", "4")
    done("bake", scene, *parts, *KEEP, "-o", at("parts"))
    done("relight", at("parts"), "--states", states, "-o", at("in_parts"))
    figures = []
    for name in ("sky", "all"):
        changes = file("changes.yaml", STATES[name])
        done("bake", scene, *parts, "--changes", changes, "--seed", "7", "-o", at("fresh"))
        figures.append(within(at("in_parts", name), at("fresh"), name))

    # where the number of bounces is given, light of one room has no part in another
    lines = [json.dumps(STATES["dim"]), "", "{lights: {moon: {on: false}}}", "{", json.dumps(STATES["dim"]),
             json.dumps({"lights": {"lamp": {"scale": [0.5, 0.25, 1]}, "bulb": {"scale": 2}}}), "{}"]
    answers = [json.loads(line) for line in done("relight", at("parts"), "--listen", "-o", at("live"),
                                                 lines="\n".join(lines)).splitlines()]
    assert [a["line"] for a in answers] == [1, 3, 4, 5, 6, 7], answers
    assert [a["status"] for a in answers] == [0, USAGE, harness.BAD_INPUT, 0, 0, 0], answers
    assert "'moon'" in answers[1]["error"] and "line 4:1: is not YAML" in answers[2]["error"].replace("4:2", "4:1")
    assert answers[0]["lightmaps"] == 6 and answers[3]["lightmaps"] == 0, answers
    assert answers[4]["lightmaps"] == 1, ("the other room alone has other light", answers)
    same(at("parts"), at("live"), "the last line changes nothing")
    done("relight", at("parts"), "--listen", "-o", at("live4"), lines=lines[0], ranks=4)
    same(at("in_parts", "dim"), at("live4"), "dim on 4 ranks, by a line that has no end")

    def refused(status, words, *arguments, lines=None):
        run = kiln("relight", *arguments, "--quiet", "--no-preview", "--threads", "1", lines=lines)
        assert run.returncode == status and words in run.stderr, (arguments, run.returncode, run.stderr)

    for text, words in WRONG.items():
        run = kiln("relight", at("kept"), "--states", file("wrong.yaml", text), "-o", at("no"), "--quiet", "--threads",
                   "1")
        assert run.returncode in (USAGE, harness.BAD_INPUT) and words in run.stderr, (text, run.stderr)
    refused(harness.BAD_INPUT, "ball                             moved", at("kept"), rooms(at("moved.glb"), moved=True),
            "--states", states, "-o", at("no"))
    refused(USAGE, "exclude each other", at("kept"), "--states", states, "--listen", "-o", at("no"))
    refused(USAGE, "folder of the bake that is relit", at("kept"), "--states", file("kept.yaml", {"kept": {}}), "-o",
            top)
    refused(66, "cannot be opened", at("kept"), "--states", at("none.yaml"), "-o", at("no"))
    refused(harness.BAD_INPUT, "a line is longer", at("kept"), "--listen", "-o", at("no"), lines="#" * 70000)
    rows = at("kept", "transport", "rows-65535-0")
    with open(rows, "rb") as old:
        data = bytearray(old.read())
    data[next(i for i in range(len(data) // 2, len(data)) if data[i])] ^= 1
    with open(rows, "wb") as new:
        new.write(data)
    refused(harness.BAD_INPUT, "is not as it was written: its hash", at("kept"), "--states", few, "-o", at("no"))
    os.remove(at("kept", "manifest"))
    refused(harness.BAD_INPUT, "the row of surface point", at("kept"), "--states", few, "-o", at("no"))
    print("; ".join(figures))
