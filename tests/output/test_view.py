"""kiln view and report on small bakes: known radiance, the right way round, a page that stands alone."""
import base64
import html.parser
import json
import os
import re
import subprocess
import sys
import tempfile

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402

KILN = os.environ["KILN"]
DRAFT = ("--quality", "draft", "--samples-probe", "0", "--quiet")


def kiln(*arguments, code=0):
    run = subprocess.run([KILN, *arguments], capture_output=True, text=True)
    assert run.returncode == code, f"kiln {' '.join(arguments)}: exit {run.returncode}, wanted {code}\n{run.stderr}"
    return run


def radiance(bake, *arguments):
    path = os.path.join(bake, "view.exr")
    kiln("view", bake, "-o", path, *arguments)
    return exr.rgb(path)


def furnace(folder):
    """A closed box that emits 1 and reflects 0.5 everywhere: radiance is 1 / (1 - 0.5) whichever way one looks."""
    scene, bake = os.path.join(folder, "furnace.glb"), os.path.join(folder, "furnace")
    kiln("generate", "furnace", "--albedo", "0.5", "-o", scene, "--quiet")
    kiln("bake", scene, "-o", bake, "--lightmap-size", "16", "--bounces", "all", "--samples-direct", "512", "--no-preview", *DRAFT)
    assert not os.path.exists(os.path.join(bake, "preview.png"))
    for eye, target in (("0.1,0.2,0.1", "0.9,0.3,0.2"), ("0.1,0.2,0.1", "0.1,0.9,0.1"), ("0.5,0.5,-1.5", "0.5,0.5,0.5")):  # the last through the back of a wall
        image = radiance(bake, "--from=" + eye, "--to=" + target, "--width", "40", "--height", "30", "--field-of-view", "25")
        assert image.shape == (30, 40, 3)
        assert abs(image.mean() - 2) < 0.01 and np.abs(image - 2).max() < 0.1, (eye, target, image.min(), image.max())
    same = "--from=0.1,0.2,0.1", "--to=0.1,0.2,0.1"
    assert "eye" in kiln("view", bake, "-o", os.path.join(folder, "no.png"), *same, code=64).stderr
    assert "camera" in kiln("view", bake, "--camera", "nobody", code=64).stderr
    assert "png" in kiln("view", bake, "-o", os.path.join(folder, "no.jpg"), code=64).stderr
    return bake


def cornell(folder):
    scene, bake = os.path.join(folder, "cornell.glb"), os.path.join(folder, "cornell")
    kiln("generate", "cornell", "-o", scene, "--quiet")
    kiln("bake", scene, "-o", bake, "--texels-per-metre", "8", "--preview", *DRAFT)
    with open(os.path.join(bake, "preview.png"), "rb") as file:
        assert file.read(8) == b"\x89PNG\r\n\x1a\n"
    image = radiance(bake, "--width", "60", "--height", "60")
    red, green = image[20:40, 1:8].mean((0, 1)), image[20:40, -8:-1].mean((0, 1))
    assert red[0] > 3 * red[1] and green[1] > 2 * green[0], "red stands left and green right"
    brightest = np.unravel_index(image.sum(-1).argmax(), (60, 60))
    assert brightest[0] < 20, "the light is at the top"
    small = radiance(bake, "--width", "20", "--height", "20")
    lower, small_lower = image[30:].mean((0, 1)), small[10:].mean((0, 1))  # without the light, whose edge falls otherwise
    assert np.abs(lower / small_lower - 1).max() < 0.02, (lower, small_lower)
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
    with open(os.path.join(bake, "run.json")) as file:
        run = json.load(file)
    assert len(page.images) == len(run["objects"]) and all(i.startswith(b"\x89PNG") for i in page.images)
    assert page.rects >= len(run["phases"]) + len(run["bounces"])
    for word in ("final gather", "absorbed", "seams before", run["objects"][0]["name"]):
        assert word in page.text, word
    # fields may be missing or strange; names are text, not markup; paths stay below the folder
    for content in ({}, {"phases": 3, "objects": [{}], "bounces": [1, None]}, {"scene": "<script>alert(1)</script> & co"},
                    {"objects": [{"name": "<b>", "lightmap": "../../../etc/passwd"}, {"name": "\"", "lightmap": "lightmaps/none.exr"}]}):
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


with tempfile.TemporaryDirectory() as temporary:
    report(furnace(temporary), temporary)
    cornell(temporary)
print("views have the radiance they should, and the report stands alone")
