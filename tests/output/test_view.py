"""kiln view and report on small bakes: known radiance, the right way round, a page that stands alone."""
import base64
import html.parser
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import zlib

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
from program import KILN, kiln, run_json  # noqa: E402

DRAFT = ("--quality", "draft", "--samples-probe", "0", "--quiet")


def radiance(bake, *arguments):
    path = os.path.join(bake, "view.exr")
    kiln("view", bake, "-o", path, *arguments)
    return exr.rgb(path)


def furnace(folder):
    """A closed box that emits 1 and reflects 0.5 everywhere: radiance is 1 / (1 - 0.5) whichever way one looks."""
    scene, bake = os.path.join(folder, "furnace.glb"), os.path.join(folder, "furnace")
    kiln("generate", "furnace", "--albedo", "0.5", "-o", scene, "--quiet")
    kiln("bake", scene, "-o", bake, "--lightmap-size", "16", "--bounces", "all", "--samples-direct", "512",
         "--no-preview", *DRAFT)
    assert not os.path.exists(os.path.join(bake, "preview.png"))
    # the last through the back of a wall
    for eye, target in (("0.1,0.2,0.1", "0.9,0.3,0.2"), ("0.1,0.2,0.1", "0.1,0.9,0.1"),
                        ("0.5,0.5,-1.5", "0.5,0.5,0.5")):
        image = radiance(bake, "--from=" + eye, "--to=" + target, "--width", "40", "--height", "30", "--field-of-view",
                         "25")
        assert image.shape == (30, 40, 3)
        assert abs(image.mean() - 2) < 0.01 and np.abs(image - 2).max() < 0.1, (eye, target, image.min(), image.max())
    same = "--from=0.1,0.2,0.1", "--to=0.1,0.2,0.1"
    assert "eye" in kiln("view", bake, "-o", os.path.join(folder, "no.png"), *same, code=64).stderr
    assert "camera" in kiln("view", bake, "--camera", "nobody", code=64).stderr
    assert "png" in kiln("view", bake, "-o", os.path.join(folder, "no.jpg"), code=64).stderr
    return bake


def single_fields(bake):
    """--show of a field: its own values, which add up; what a bake does not have, and what nobody has, is told."""
    size = ("--width", "40", "--height", "40")
    direct, indirect, total = (radiance(bake, "--show", name, *size) for name in ("direct", "indirect", "total"))
    assert indirect.min() >= 0 and indirect.mean() > 0.1 * total.mean() and np.allclose(
        direct + indirect, total, rtol=1e-5, atol=1e-6)
    attributes = exr.read(os.path.join(bake, "view.exr")).attributes
    assert attributes["kiln:units"] == "W m-2" and "direct + indirect" in attributes["kiln:quantity"], attributes
    assert "have light, direct, indirect, total, error\n" in kiln("view", bake, "--show", "bent_normal", code=66).stderr
    assert "light, texels, direct" in kiln("view", bake, "--show", "nothing", code=64).stderr


def cornell(folder):
    scene, bake = os.path.join(folder, "cornell.glb"), os.path.join(folder, "cornell")
    kiln("generate", "cornell", "-o", scene, "--quiet")
    kiln("bake", scene, "-o", bake, "--texels-per-metre", "8", "--preview", *DRAFT)
    with open(os.path.join(bake, "preview.png"), "rb") as file:
        head = file.read(24)
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">2I", head[16:24])
    assert width == height and 400 < width < 480, "a bake of few points has a small preview: %d x %d" % (width, height)
    image = radiance(bake, "--width", "60", "--height", "60")
    red, green = image[20:40, 1:8].mean((0, 1)), image[20:40, -8:-1].mean((0, 1))
    assert red[0] > 3 * red[1] and green[1] > 2 * green[0], "red stands left and green right"
    brightest = np.unravel_index(image.sum(-1).argmax(), (60, 60))
    assert brightest[0] < 20, "the light is at the top"
    small = radiance(bake, "--width", "20", "--height", "20")
    # without the light, whose edge falls otherwise
    lower, small_lower = image[30:].mean((0, 1)), small[10:].mean((0, 1))
    assert np.abs(lower / small_lower - 1).max() < 0.02, (lower, small_lower)
    single_fields(bake)
    kiln("view", bake)
    assert os.path.getsize(os.path.join(bake, "view.png")) > 1000
    os.remove(os.path.join(bake, "lightmaps", sorted(os.listdir(os.path.join(bake, "lightmaps")))[0]))
    run = subprocess.run([KILN, "view", bake], capture_output=True, text=True)
    assert run.returncode == 66 and "lightmaps" in run.stderr, "a missing lightmap is told, not drawn black"
    return bake


class Page(html.parser.HTMLParser):
    EMPTY = {"meta", "img", "br", "rect", "line"}

    def __init__(self, path):
        super().__init__()
        self.open, self.images, self.rects, self.text = [], [], 0, ""
        with open(path, encoding="utf-8") as file:
            content = file.read()
        self.feed(content)
        assert not self.open, f"left open: {self.open}"
        outside = re.findall(r'(?:src|href)="(?!data:)[^"]*"|https?://|<script', content)
        assert not outside, outside

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            self.images.append(base64.b64decode(dict(attributes)["src"].split("base64,")[1], validate=True))
        self.rects += tag == "rect"
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in self.EMPTY:
            assert self.open.pop() == tag, tag

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)

    def handle_data(self, data):
        self.text += data


def report(bake, folder):
    kiln("report", bake)
    page = Page(os.path.join(bake, "report.html"))
    run = run_json(bake)
    assert len(page.images) == len(run["objects"]) and all(i.startswith(b"\x89PNG") for i in page.images)
    assert page.rects >= len(run["phases"]) + len(run["bounces"])
    for word in ("final gather", "absorbed", "texels, ", " a metre", "standard error", run["objects"][0]["name"]):
        assert word in page.text, word
    assert all(o["texels_per_metre"] > 0 and o["relative_error"] > 0 and o["mean"] > 0 for o in run["objects"])
    for word in ("Balance of the ranks", "restarts", "behind", "nan", "asked node"):  # what says nothing is not there
        assert not re.search(rf"\b{word}\b", page.text), word
    # fields may be missing or strange; names are text, not markup; paths stay below the folder
    for content in ({}, {"phases": 3, "objects": [{}], "bounces": [1, None]},
                    {"scene": "<script>alert(1)</script> & co"},
                    {"objects": [{"name": "<b>", "lightmap": "../../../etc/passwd"},
                                 {"name": "\"", "lightmap": "lightmaps/none.exr"}]}):
        strange = os.path.join(folder, "strange")
        os.makedirs(strange, exist_ok=True)
        with open(os.path.join(strange, "run.json"), "w") as file:
            json.dump(content, file)
        kiln("report", strange)
        page = Page(os.path.join(strange, "report.html"))
        assert "passwd" not in page.text
        assert "scene" not in content or content["scene"] in page.text
    with open(os.path.join(strange, "run.json"), "w") as file:
        file.write("{\n\"half\": ")
    assert "line 2" in kiln("report", strange, code=65).stderr
    os.remove(os.path.join(strange, "run.json"))
    assert "run.json" in kiln("report", strange, code=66).stderr


def png_texts(path):
    """{keyword: text} of a PNG's tEXt chunks, whose checksums must hold."""
    with open(path, "rb") as file:
        data = file.read()
    texts, at = {}, 8
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8:at + 8 + length]
        assert struct.unpack_from(">I", data, at + 8 + length)[0] == zlib.crc32(kind + body), kind
        if kind == b"tEXt":
            keyword, text = body.split(b"\0")
            texts[keyword.decode()] = text.decode()
        at += 12 + length
    return texts


def without_camera(path, copy, change=lambda document: None):
    scene = glb.Scene()
    scene.load(path)
    scene.document.pop("cameras", None)
    for node in scene.document["nodes"]:
        node.pop("camera", None)
    change(scene.document)
    return scene.write(copy)


def brighter(document):
    for material in document["materials"]:
        strength = material.get("extensions", {}).get("KHR_materials_emissive_strength")
        if strength:
            strength["emissiveStrength"] *= 4096


def preview_of(bake):
    run = run_json(bake)
    with open(os.path.join(bake, "preview.png"), "rb") as file:
        return run["preview"], file.read()


def no_camera(folder):
    """A closed scene is looked at from inside, at what is lit; an open one from where it is open; the same on any
    number of ranks and under any light."""
    rooms, bright = os.path.join(folder, "rooms.glb"), os.path.join(folder, "bright.glb")
    kiln("generate", "rooms", "--columns", "2", "--rows", "1", "-o", rooms, "--quiet")
    scene = without_camera(rooms, os.path.join(folder, "blind.glb"))
    without_camera(rooms, bright, brighter)
    options = ("--texels-per-metre", "4", "--bounces", "1", "--preview", "--backend", "embree", *DRAFT)
    pictures = []
    for name, path, prefix in (("one", scene, ()),
                               ("three", scene, ("mpirun", "-n", "3", "--bind-to", "none", "--oversubscribe")),
                               ("lit", bright, ())):
        bake = os.path.join(folder, name)
        environment = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")
        run = subprocess.run([*prefix, KILN, "bake", path, "-o", bake, *options], capture_output=True, text=True,
                             env=environment)
        assert run.returncode == 0, run.stderr
        pictures.append(preview_of(bake))
    (said, picture), (_, of_three), (lit, of_bright) = pictures
    assert picture == of_three, "the same picture on three ranks"
    assert said["viewpoint"]["chosen"] == "inside" and "camera" not in said["viewpoint"], said
    assert abs(said["exposure"]["automatic"] - lit["exposure"]["automatic"] - 12) < 1e-4, (said, lit)
    texts = png_texts(os.path.join(folder, "one", "preview.png"))
    assert "from inside" in texts["Description"] and "--from" in texts["Description"] and texts["Software"].startswith(
        "made by kiln"), texts
    # what is in the picture: lit, not the outside, not a wall at the nose, more than one thing
    image = radiance(os.path.join(folder, "one"), "--width", "64", "--height", "48", "--backend", "embree").sum(-1)
    assert (image > 0.05 * np.median(image)).mean() > 0.9 and image.std() > 0.05 * np.median(image), (
        image.min(), np.median(image), image.std())
    answer = json.loads(kiln("view", os.path.join(folder, "one"), "--json", "--width", "32", "--backend",
                             "embree").stdout)
    low, high = (np.array(json.loads(kiln("info", scene, "--json").stdout)["bounds"][k]) for k in ("min", "max"))
    eye = np.array(answer["viewpoint"]["from"])
    assert answer["viewpoint"]["chosen"] == "inside" and (eye > low + 0.1).all() and (eye < high - 0.1).all(), (
        eye, low, high)
    answer = kiln("view", os.path.join(folder, "one"), "--from=0.5,1.5,0.5", "--width", "32", "--backend",
                  "embree").stdout
    assert "as asked" in answer and "exposure" in answer and "automatic" in answer, answer
    darker, brighter_png = (os.path.join(folder, n) for n in ("darker.png", "brighter.png"))
    answer = [json.loads(kiln("view", os.path.join(folder, "one"), "-o", path, "--exposure", stops, "--json", "--width",
                              "32", "--backend", "embree").stdout)
              for path, stops in ((darker, "-2"), (brighter_png, "1.5"))]
    assert answer[0]["exposure"]["automatic"] == answer[1]["exposure"]["automatic"] and answer[1]["exposure"][
        "added"] == 1.5, answer
    box = without_camera(os.path.join(folder, "cornell.glb"), os.path.join(folder, "blind_box.glb"))
    bake = os.path.join(folder, "box")
    kiln("bake", box, "-o", bake, "--texels-per-metre", "4", "--bounces", "1", "--preview", "--backend", "embree",
         *DRAFT)
    assert preview_of(bake)[0]["viewpoint"]["chosen"] == "outside"
    image = radiance(bake, "--width", "64", "--height", "48")
    coloured = (image[..., 0] > 3 * image[..., 1]) | (image[..., 1] > 2 * image[..., 0])
    assert coloured.sum() > 200 and (
        image.sum(-1) > 0).mean() > 0.3, "a coloured wall and the blocks before it, so from the open side"


def metals(folder):
    """A metal reflects nothing diffusely; by --materials diffuse it is shown by its base colour, and said to be
    approximate."""
    def gild(document):
        for material in document["materials"]:
            material["pbrMetallicRoughness"].update(metallicFactor=1.0, baseColorFactor=[0.5, 0.25, 0.125, 1.0])
            material.pop("pbrMetallicRoughness_", None)
    scene, bake = os.path.join(folder, "gold.glb"), os.path.join(folder, "gold")
    without_camera(os.path.join(folder, "furnace.glb"), scene, gild)
    kiln("bake", scene, "-o", bake, "--lightmap-size", "16", "--samples-direct", "512", "--no-preview", "--materials",
         "diffuse", *DRAFT)
    said = kiln("view", bake, "--from=0.1,0.2,0.1", "--to=0.9,0.3,0.2", "--field-of-view", "25", "--width", "40").stdout
    assert "metals, 100.0 %" in said and "approximate" in said, said
    view = os.path.join(bake, "view.exr")
    image = radiance(bake, "--from=0.1,0.2,0.1", "--to=0.9,0.3,0.2", "--width", "40", "--height", "30",
                     "--field-of-view", "25")
    # emits 1, and base colour x E / pi with E = pi: no bounces, metals give none on
    wanted = 1 + np.array([0.5, 0.25, 0.125])
    assert np.abs(image.mean((0, 1)) / wanted - 1).max() < 0.01, image.mean((0, 1))
    attributes = exr.read(view).attributes
    assert "metals" in attributes["kiln:approximate"] and "as asked" in attributes["kiln:viewpoint"], attributes


def unfinished(folder, bake):
    """Folders that are no bakes, and bakes that are not finished, are told apart."""
    empty = os.path.join(folder, "empty")
    os.makedirs(empty)
    for arguments in (("view", empty), ("probe", empty, "0", "0", "0"), ("report", empty), ("verify", empty),
                      ("status", empty), ("stop", empty)):
        assert "not the folder of a bake" in kiln(*arguments, code=66).stderr, arguments
    os.makedirs(os.path.join(empty, "lightmaps"))
    shutil.copy(os.path.join(bake, "scene.kscene"), empty)
    assert "not finished" in kiln("view", empty, code=66).stderr


with tempfile.TemporaryDirectory() as temporary:
    report(furnace(temporary), temporary)
    unfinished(temporary, cornell(temporary))
    no_camera(temporary)
    metals(temporary)
print("views have the radiance they should, and the report stands alone")
