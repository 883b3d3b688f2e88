"""A re-bake removes what it makes stale: what kiln wrote, and nothing else."""
import os
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
from program import kiln  # noqa: E402


def room(path, names):
    """Quads side by side, facing up under a plain sky."""
    scene = glb.Scene()
    grey = scene.material("grey", (0.5, 0.5, 0.5))
    for i, name in enumerate(names):
        scene.quad(name, [[i, 0, 1], [i + 1, 0, 1], [i + 1, 0, 0], [i, 0, 0]], grey)
    scene.environment((1, 1, 1))
    return scene.write(path)


def bake(scene, out, *options):
    return kiln("bake", scene, "-o", out, "--texels-per-metre", "8", "--quality", "draft", "--backend", "embree",
                *options)


def write(path, text):
    with open(path, "w") as file:
        file.write(text)


def listing(out):
    return {os.path.relpath(os.path.join(d, f), out) for d, _, files in os.walk(out) for f in files}


with tempfile.TemporaryDirectory() as folder:
    out = os.path.join(folder, "out")
    three, one = room(os.path.join(folder, "three.glb"),
                      ["floor", "gone", "edited"]), room(os.path.join(folder, "one.glb"), ["floor"])
    bake(three, out, "--probe-spacing", "1")
    kiln("report", out)
    kiln("view", out, "--width", "32")
    mine = {"notes.txt": "mine", "lightmaps/mine.exr": "mine", "lightmaps/edited.exr": "painted over"}
    for name, text in mine.items():
        write(os.path.join(out, name), text)
    before = listing(out)
    assert before > {"report.html", "view.png", "volume.hdf", "preview.png", "lightmaps/gone.exr"}, before

    # the same again: only what was made later goes
    said = bake(one, out, "--probe-spacing", "1")
    after = listing(out)
    assert before - after == {"report.html", "view.png",
                              "lightmaps/gone.exr"} and not after - before, (before - after, after - before)
    assert "removed 3 files" in said.stderr and "lightmaps/edited.exr first" in said.stderr, said.stderr
    kiln("verify", out)

    # no volume and no preview any more; a report that is not kiln's stays
    write(os.path.join(out, "report.html"), "<html>mine</html>")
    said = bake(one, out, "--samples-probe", "0", "--no-preview")
    assert after - listing(out) == {"volume.hdf", "preview.png"}, listing(out)
    with open(os.path.join(out, "report.html")) as file:
        assert file.read() == "<html>mine</html>"
    for name, text in mine.items():
        with open(os.path.join(out, name)) as file:
            assert file.read() == text
    kiln("verify", out)
    with open(os.path.join(out, "manifest")) as file:
        assert "gone.exr" not in file.read()

    # nothing is left of transport that was kept
    bake(one, out, "--samples-probe", "0", "--no-preview", "--keep-transport", "rows")
    assert os.listdir(os.path.join(out, "transport"))
    bake(one, out, "--samples-probe", "0", "--no-preview")
    assert not os.path.exists(os.path.join(out, "transport")), listing(out)

    # a refused bake removes nothing; a manifest that names a file outside is not believed
    there = listing(out)
    write(os.path.join(folder, "broken.glb"), "no scene")
    kiln("bake", os.path.join(folder, "broken.glb"), "-o", out, code=65)
    assert listing(out) == there
print("a re-bake removes what is stale, and nothing that is the user's")
