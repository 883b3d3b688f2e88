"""--keep-transport rows and kiln relight: a bake whose rays are looked up has the bits of one that traces them.

The room has a flat and a smooth object, a pane with holes and a hole to the sky. Kept transport changes no light; it is
the same bytes from one rank, from three and from a bake that was stopped and gone on with. Nothing changed, and lights,
colours, emission and sky changed: relit on one rank and on three, the room has the bits of its bake, and no ray was
traced that was kept. So does one with textures, a lamp that has moved and a new one, relit on four ranks after it was
stopped. Where other light takes other steps, these are traced. What is damaged, moved or cannot be kept is refused."""
import json
import os
import shutil
import sys
import tempfile

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
import harness  # noqa: E402
import png  # noqa: E402
from reading import run_json  # noqa: E402
from relit import done, kept_files, kiln, light, rays, refused, refused_damaged, same  # noqa: E402

OPTIONS = ["--texels-per-metre", "6", "--backend", "embree", "--samples-direct", "32", "--samples-bounce", "16",
           "--samples-indirect", "64", "--samples-probe", "16", "--probe-spacing", "1", "--materials", "diffuse"]
KEEP = ["--keep-transport", "rows"]
USAGE, STOPPED, SLOWNESS = 64, 75, 20


def room(path, edited=False, moved=False, extra=False, white=None, textured=False):
    """`edited`: other lights, colours and sky; `moved`, `extra`: other geometry; `white`: albedo of the walls;
    `textured`: textures of colour and emission, the sun from elsewhere, and one more lamp."""
    scene = glb.Scene()
    wall = scene.material("wall", (white,) * 3 if white else (0.3, 0.6, 0.7) if edited else (0.7, 0.7, 0.6))
    glow = scene.material("glow", (0.2, 0.2, 0.2), (1, 4, 2) if edited else (5, 4, 3))
    ball = scene.material("ball", (0.8, 0.2, 0.2), (0.5, 0, 0) if edited else (0.1, 0.1, 0), double_sided=True)
    pane = scene.material("pane", (0.4, 0.5, 0.4))
    scene.document["materials"][pane].update(alphaMode="BLEND")
    scene.document["materials"][pane]["pbrMetallicRoughness"]["baseColorFactor"][3] = 0.5
    glb.box(scene, "room", (0, 0, 0), (2, 2, 3), wall, inward=range(5))
    glb.box(scene, "lamp", (0.8, 1.7, 0.8), (1.2, 1.8, 1.2), glow)
    glb.ball(scene, "ball", (0.6, 0.4, 0.7), 0.35, ball, rings=8)
    scene.quad("pane", ((1.2, 0.2, 1.9), (1.8, 0.2, 1.9), (1.8, 1.2, 1.7), (1.2, 1.2, 1.7)), pane)
    if moved:
        next(n for n in scene.document["nodes"] if n["name"] == "ball")["translation"] = [0.1, 0, 0]
    if extra:
        glb.box(scene, "box", (1.4, 0, 0.4), (1.6, 0.3, 0.6), wall)
    scene.light("sun", {"type": "directional", "intensity": 1.0 if edited else 3.0},
                rotation=[-0.6, 0.1, 0, 0.794] if textured else [-0.5, 0, 0, 0.866])
    if textured:
        pictures = np.random.default_rng(1).integers(40, 255, (2, 8, 8, 3), np.uint8)
        scene.document["images"] = [{"uri": png.data_uri(picture)} for picture in pictures]
        scene.document["textures"] = [{"source": 0}, {"source": 1}]
        scene.document["materials"][wall]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
        scene.document["materials"][glow]["emissiveTexture"] = {"index": 1}
        scene.light("spot", {"type": "spot", "intensity": 5.0, "spot": {"outerConeAngle": 0.6}},
                    translation=[1.5, 1.6, 1.2], rotation=[-0.5, 0, 0, 0.866])
    scene.environment((2, 0.5, 0.2) if edited else (0.5, 0.6, 0.9))
    return scene.write(path)


# The same as `edited`, in another language.
CHANGES = """lights:
  s*: {intensity: [4, 4, 4], scale: 0.25}
materials:
  wall: {albedo: [0.3, 0.6, 0.7]}
  glow: {emission: [2, 8, 4], emission-scale: 0.5}
  ball: {emission: [0.5, 0, 0]}
environment: {radiance: [2, 0.5, 0.2]}
"""
DARK = "lights: {sun: {on: false}}\nmaterials: {glow: {on: false}}\n"
WRONG = {"lights: {moon: {scale: 2}}": "no light of the scene has a name that matches 'moon'",
         "lights: {sun: {power: 2}}": "light 'sun' has no setting 'power'; it has on, scale, intensity",
         "materials: {wall: {albedo: [2, 0, 0]}}": "'albedo' is three numbers, [R, G, B], from 0 to 1",
         "materials: {wall: {albedo: 0.5}}": "'albedo' is three numbers", "sky: {scale: 2}": "there is no key 'sky'",
         "environment: {scale: -1}": "'scale' is a number, or three, [R, G, B], from 0", "": "is empty",
         "environment: {scale: 2, scale: 3}": ":1: the key stands twice", "lights: [1": ": is not YAML",
         "lights: {sun: {on: [[[[[1]]]]]}}": ":1: this is no value that changes have"}


with tempfile.TemporaryDirectory() as top:
    def at(name):
        return os.path.join(top, name)

    scene, edited = room(at("room.glb")), room(at("edited.glb"), edited=True)
    done("bake", scene, *OPTIONS, "-o", at("plain"))
    done("bake", scene, *OPTIONS, *KEEP, "-o", at("kept"))
    same(at("plain"), at("kept"), "kept transport changes light")
    done("bake", scene, *OPTIONS, *KEEP, "-o", at("three"), ranks=3)
    kept = kept_files(at("kept"))
    assert len(kept) > 3 and kept == kept_files(at("three")), "rows of three ranks differ"
    report = run_json(at("kept"))
    counted = sum(report["rays"][kind] for kind in ("bounces", "final"))
    assert report["transport"]["rays_kept"] == counted, (report["transport"], counted)

    planned = kiln("plan", scene, *OPTIONS, *KEEP, "--bounces", "2", "--ranks", "1", "--json")
    assert planned.returncode == 0, planned.stderr
    done("bake", scene, *OPTIONS, *KEEP, "--bounces", "2", "-o", at("two"))
    two = sum(map(len, kept_files(at("two")).values()))
    assert json.loads(planned.stdout)["disk_bytes"]["transport"] == two, (planned.stdout, two)

    # stopped as soon as there is something to go on from, again and again; slow, or quick machines are done before
    stops, slow = 0, ("bake", scene, *OPTIONS, *KEEP, "-o", at("stopped"), "--quiet", "--no-preview")
    run = kiln(*slow, "--max-time", "0.2", slowness=SLOWNESS)
    while run.returncode == STOPPED and stops < 20:
        stops += 1
        run = kiln(*slow, "--max-time", str(0.2 + 0.2 * stops), slowness=SLOWNESS)
    assert run.returncode == 0, run.stderr
    assert stops > 0, "nothing was stopped"
    assert kept_files(at("stopped")) == kept, "rows of a bake that was stopped differ"
    same(at("plain"), at("stopped"), "stopped")

    done("relight", at("kept"), "-o", at("nothing"))
    same(at("plain"), at("nothing"), "nothing changed")
    assert rays(at("nothing")) == (counted, 0), rays(at("nothing"))
    done("bake", edited, *OPTIONS, "-o", at("edited"))
    assert light(at("edited")) != light(at("plain"))
    for ranks in (1, 3):
        out = at(f"relit{ranks}")
        done("relight", at("three"), edited, "-o", out, ranks=ranks)
        same(at("edited"), out, f"edited scene on {ranks} ranks")
        assert rays(out)[0] > 0.9 * counted, rays(out)
    textured = room(at("textured.glb"), textured=True)
    done("bake", textured, *OPTIONS, "-o", at("textured"))
    again = ("relight", at("kept"), textured, "-o", at("relit_textured"))
    assert kiln(*again, "--quiet", "--max-time", "0.3", slowness=SLOWNESS).returncode == STOPPED, "not stopped"
    done(*again, ranks=4)
    same(at("textured"), at("relit_textured"), "textures, a moved and a new lamp")
    assert rays(at("relit_textured"))[0] > 0.85 * counted, rays(at("relit_textured"))
    sky = ("--environment", "0.1,0.2,3")
    done("bake", scene, *OPTIONS, *sky, "-o", at("sky"))
    done("relight", at("kept"), *sky, "-o", at("relit_sky"))
    same(at("sky"), at("relit_sky"), "sky")

    for name, text in (("changes", CHANGES), ("dark", DARK)):
        with open(at(name + ".yaml"), "w") as file:
            file.write(text)
    done("relight", at("kept"), at("changes.yaml"), "-o", at("changed"))
    same(at("edited"), at("changed"), "changes by name")
    done("bake", scene, *OPTIONS, "--changes", at("dark.yaml"), "-o", at("dark"))
    done("relight", at("kept"), at("dark.yaml"), "-o", at("relit_dark"))
    same(at("dark"), at("relit_dark"), "lights that are off")
    assert light(at("dark")) != light(at("plain"))
    for text, words in WRONG.items():
        with open(at("wrong.yaml"), "w") as file:
            file.write(text)
        run = kiln("relight", at("kept"), at("wrong.yaml"), "-o", at("no"), "--quiet")
        assert run.returncode in (USAGE, harness.BAD_INPUT) and words in run.stderr, (text, run.stderr)

    # white walls take more bounces than were kept; and those of which half is measured are in four parts
    white = room(at("white.glb"), white=0.97)
    done("bake", white, *OPTIONS, "-o", at("white"))
    done("relight", at("kept"), white, "-o", at("relit_white"))
    same(at("white"), at("relit_white"), "white walls")
    parts = (*OPTIONS, "--error-map", "--indirect-scale", "2", "--bounces", "2")
    done("bake", scene, *parts, *KEEP, "-o", at("kept_parts"))
    done("bake", edited, *parts, "-o", at("parts"))
    done("relight", at("kept_parts"), edited, "-o", at("relit_parts"))
    same(at("parts"), at("relit_parts"), "in parts")
    assert rays(at("relit_parts"))[0] > 0 and rays(at("relit_parts"))[1] == 0, rays(at("relit_parts"))

    refused(harness.BAD_INPUT, "ball                             moved", "relight", at("kept"),
            room(at("moved.glb"), moved=True), "-o", at("no"))
    refused(harness.BAD_INPUT, "box                              new", "relight", at("kept"),
            room(at("extra.glb"), extra=True), "-o", at("no"))
    refused(USAGE, "folder of the bake that is relit", "relight", at("kept"), "-o", at("kept"))
    refused(66, "has kept no transport", "relight", at("plain"), "-o", at("no"))
    for option in (["--guide", "auto"], ["--tracing-range", "1"], ["--method", "path"]):
        refused(USAGE, "--keep-transport rows: ", "bake", scene, *OPTIONS, *KEEP, *option, "-o", at("no"))

    assert kiln("verify", at("kept"), "--quiet").returncode == 0
    for place, words in ((20, "not as it was written, or of another bake"), (None, "the row of surface point")):
        shutil.rmtree(at("hurt"), ignore_errors=True)
        shutil.copytree(at("kept"), at("hurt"))
        name = os.path.join(at("hurt"), "transport", "rows-65535-0")
        data = bytearray(kept["rows-65535-0"])
        if place is None:
            place = next(i for i in range(len(data) // 2, len(data)) if data[i])
        data[place] ^= 1
        with open(name, "wb") as file:
            file.write(data)
        refused_damaged(words, at("hurt"), edited, "-o", at("no"))
        refused(harness.BAD_INPUT, "transport/rows-65535-0", "verify", at("hurt"))
    print("%d rays kept, %d files, %d bytes; stopped %d times" %
          (counted, len(kept), sum(map(len, kept.values())), stops))
