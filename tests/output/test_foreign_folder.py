"""kiln relight and the folder of a stranger, made to fit its own hashes: it says what the light is, and nothing else.

Options of transport/index that say where a run writes, what it reads besides or how it runs are passed over, whatever
they name; those of light are checked as on the command line, and their types too: 65, no signal. Changes and groups of
lights stand in the index, and their files may be gone. What is not as the manifest has it is not read. FIFOs and links
in the place of files of transport, and FIFOs as --light-groups, --states and changes, are refused at once. Links with
numbers that are not finite are refused by verify and by relight. A state whose folder is a link is not written."""
import json
import os
import shutil
import struct
import sys
import tempfile

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import harness  # noqa: E402
import sealing  # noqa: E402
from program import kiln  # noqa: E402
from relit import light, same  # noqa: E402

SMALL = ["--lightmap-size", "8", "--samples-direct", "4", "--samples-indirect", "4", "--bounces",
         "2", "--samples-probe", "2", "--probe-spacing", "3", "--no-check-density", "--no-preview", "--no-export",
         "--backend", "embree"]
LINKS = ["--method", "radiosity", "--patches", "links", "--keep-transport", "links"]
SOON = 60 if "ASAN_OPTIONS" in os.environ else 20  # s; what hangs does so for ever
CANNOT_CREATE = 73
INDEX = "transport/index"
GROUPS = "lamps: {materials: [light]}\n"
CHANGES = "materials: {light: {emission-scale: 3}}\n"


def done(*arguments, code=0):
    return kiln(*arguments, "--quiet", code=code, timeout=SOON)


def refused(words, *arguments, status=harness.BAD_INPUT):
    run = done(*arguments, code=status)
    assert words in run.stderr, (arguments, run.stderr)


class Folder:
    """A copy of a bake, and what a stranger makes of it."""

    def __init__(self, top, good):
        self.path = os.path.join(top, "foreign")
        shutil.rmtree(self.path, ignore_errors=True)
        shutil.copytree(good, self.path, symlinks=True)

    def at(self, name):
        return os.path.join(self.path, name)

    def index(self, **values):
        content = sealing.read(self.at(INDEX))
        job = values.pop("job", {})
        content.update(values)
        if isinstance(content["job"], dict) and isinstance(job, dict):
            content["job"].update(job)
        else:
            content["job"] = job
        sealing.write(self.at(INDEX), content)
        sealing.fit(self.path, INDEX)
        return self.path

    def without_manifest(self):
        os.remove(self.at("manifest"))
        return self.path


def try_options(top, good, plain):
    """Options that write, read or run: nothing of them happens, and the light is the bake's."""
    victim, elsewhere = os.path.join(top, "victim"), os.path.join(top, "elsewhere")
    with open(victim, "w") as file:
        file.write("precious")
    os.mkdir(elsewhere)
    foreign = Folder(top, good).index(job={
        "trace": victim, "output": elsewhere, "kernel-cache": elsewhere, "checkpoint-local": elsewhere,
        "resume": "false", "keep-transport": "rows", "max-time": "0.000001", "watchdog": "1e-9", "threads": "1000000",
        "memory-budget": "1e-9", "exchange-limit": "1", "json": "true", "verbose": "true", "device": "99",
        "of another kiln": "1"})
    before = sorted(os.listdir(top))
    done("relight", foreign, "-o", os.path.join(top, "out"))
    assert open(victim).read() == "precious" and not os.listdir(elsewhere), "the folder's options are followed"
    assert sorted(os.listdir(top)) == sorted([*before, "out"]), os.listdir(top)
    assert not os.path.exists(os.path.join(top, "out", "transport"))
    same(plain, os.path.join(top, "out"), "options that are not of light")
    for name in ("changes", "light-groups"):
        refused("which is not followed", "relight", Folder(top, good).index(job={name: victim}), "-o",
                os.path.join(top, "no"))


def try_values(top, good):
    no = os.path.join(top, "no")
    for job in ({"bounces": "-7"}, {"samples-direct": "0x10"}, {"method": "magic"}, {"cell-size": "nan"},
                {"objects": "{"}, {"volume-bounds": "1,2"}, {"environment": "-1,0,0"}):
        refused("of the bake in", "relight", Folder(top, good).index(job=job), "-o", no)
    # what cannot be together, or what no such bake can have kept
    for job, words, status in (({"final-scale": "2", "error-map": "true"}, "exclude each other", 64),
                               ({"method": "path"}, "cannot be of the bake", 65),
                               ({"guide": "auto"}, "cannot be of the bake", 65)):
        refused(words, "relight", Folder(top, good).index(job=job), "-o", no, status=status)
    for name, value in (("bounces", None), ("backend", 1), ("environment", True), ("seed", []), ("quality", {"a": 1})):
        refused("of another type", "relight", Folder(top, good).index(job={name: value}), "-o", no)
        refused("transport/index", "verify", Folder(top, good).index(job={name: value}))
    for name, value in (("kiln", 1), ("identity", "x"), ("scene", None), ("backend", []), ("instruction set", {}),
                        ("job", [])):
        refused("of another type", "relight", Folder(top, good).index(**{name: value}), "-o", no)
    refused("no backend 'magic'", "relight", Folder(top, good).index(backend="magic"), "-o", no, status=69)
    refused("no instruction-set", "relight", Folder(top, good).index(**{"instruction set": "x" * 9999}), "-o", no,
            status=69)
    for text in (b"null\n", b"[" * 100000 + b"\n", b"{\"a\": " * 1000 + b"\n", b"\xff\n", b"\n"):
        foreign = Folder(top, good)
        with open(foreign.at(INDEX), "wb") as file:
            file.write(text + b"xxh3_128 " + sealing.hash_of(text).encode() + b"\n")
        sealing.fit(foreign.path, INDEX)
        refused("index", "relight", foreign.path, "-o", no)


def try_rules(top, scene):
    """Changes and groups are those of the bake when their files are gone."""
    files = [os.path.join(top, name) for name in ("changes.yaml", "groups.yaml")]
    for path, text in zip(files, (CHANGES, GROUPS)):
        with open(path, "w") as file:
            file.write(text)
    told = os.path.join(top, "told")
    done("bake", scene, *SMALL, "--keep-transport", "rows", "--changes", files[0], "--light-groups", files[1], "-o",
         told)
    for path in files:
        os.remove(path)
    out = os.path.join(top, "relit_told")
    done("relight", told, "-o", out)
    same(told, out, "changes and groups")
    assert any("lamps" in name for name in light(out)), sorted(light(out))
    no = os.path.join(top, "no")
    for rules in ({"lamps": {"materials": [["deep"]]}}, {"..": {"lights": ["x"]}}, {"lamps": 1}):
        refused("groups of lights", "relight", Folder(top, told).index(**{"light groups": rules}), "-o", no)
    refused("power", "relight", Folder(top, told).index(changes={"materials": {"light": {"power": 1}}}), "-o", no,
            status=64)


def try_manifest(top, good):
    """What is not as the manifest has it is not read."""
    rows = next(name for name in sorted(os.listdir(os.path.join(good, "transport"))) if name != "index")
    for name in (INDEX, "transport/" + rows):
        foreign = Folder(top, good)
        with open(foreign.at(name), "r+b") as file:
            file.seek(100)
            byte = file.read(1)
            file.seek(100)
            file.write(bytes([byte[0] ^ 1]))
        refused("%s' is not as it was written: its hash" % name, "relight", foreign.path, "-o", os.path.join(top, "no"))


def try_places(top, good, linked):
    """FIFOs and links in the place of files; with a manifest, and where the files themselves are opened."""
    no, names = os.path.join(top, "no"), []
    for bake in (good, linked):
        names += [(bake, "transport/" + name) for name in sorted(os.listdir(os.path.join(bake, "transport")))]
    assert sum("rows-" in name for _, name in names) > 1 and (linked, "transport/links") in names, names
    for bake, name in names:
        for make, words in ((os.mkfifo, "is not a plain file"), (lambda p: os.symlink("/etc/passwd", p), "link")):
            for manifest in (True, False):
                foreign = Folder(top, bake)
                os.remove(foreign.at(name))
                make(foreign.at(name))
                if not manifest:
                    foreign.without_manifest()
                refused(words, "relight", foreign.path, "-o", no)
    fifo = os.path.join(top, "fifo.yaml")
    os.mkfifo(fifo)
    for arguments in (["--light-groups", fifo], ["--states", fifo]):
        refused("is not a plain file", "relight", good, "-o", no, *arguments)
    refused("is not a plain file", "relight", good, fifo, "-o", no)
    refused("is not a plain file", "bake", fifo, "-o", no)


def points_of(data):
    """Places of the floats of the first point with light, in the first code that has one; the code's entry."""
    runs = struct.unpack_from("<Q", data, 32)[0]
    for run in range(runs):
        place = 4096 + 32 * run
        first, offset, size, _, _ = struct.unpack_from("<QQIIQ", data, place)
        at = offset + 1
        for _ in range(2):  # numbers of links
            while data[at] >= 128:
                at += 1
            at += 1
        if size > 0 and 0 < data[at] < 128:
            return place, first, offset, size, at + 1
    raise AssertionError("no links")


def try_links(top, linked):
    """Hashes are made to fit, as whoever has the folder can."""
    with open(os.path.join(linked, "transport", "links"), "rb") as file:
        good = file.read()
    place, first, offset, size, at = points_of(good)
    key = struct.unpack_from("<Q", good, 48)[0]
    seed = key ^ (first * 0x9e3779b97f4a7c15 & (1 << 64) - 1)
    assert sealing.hash64(good[offset:offset + size], seed) == struct.unpack_from("<Q", good, place + 24)[0]
    # of the first point with light: its row's scale, escaped, blocked
    for number, value in ((0, float("nan")), (0, 3e38), (1, float("inf")), (1, -1.0), (2, float("nan"))):
        data = bytearray(good)
        struct.pack_into("<f", data, at + 4 * number, value)
        struct.pack_into("<Q", data, place + 24, sealing.hash64(data[offset:offset + size], seed))
        foreign = Folder(top, linked)
        with open(foreign.at("transport/links"), "wb") as file:
            file.write(data)
        sealing.fit(foreign.path, "transport/links")
        refused("are damaged", "relight", foreign.path, "-o", os.path.join(top, "no"))
        refused("transport/links", "verify", foreign.path)
    for change in (lambda d: struct.pack_into("<Q", d, 32, 1 << 60),
                   lambda d: struct.pack_into("<Q", d, 4096 + 8, 1 << 63),
                   lambda d: d.__delitem__(slice(len(d) - 9, None))):
        data = bytearray(good)
        change(data)
        foreign = Folder(top, linked)
        with open(foreign.at("transport/links"), "wb") as file:
            file.write(data)
        sealing.fit(foreign.path, "transport/links")
        refused("transport/links", "verify", foreign.path)


def try_view(top, linked):
    """kiln view --texel has the scene of the index, which is no option and no job file."""
    shown = ["--show", "links", "--texel", "floor,3,3", "--width", "64", "-o", os.path.join(top, "a.png")]
    job = os.path.join(top, "job.yaml")
    with open(job, "w") as file:
        json.dump({"scene": os.path.join(top, "cornell.glb"), "lightmap-size": 8}, file)
    done("view", linked, *shown)
    for scene, status in (("--help", 66), (job, 65), ("", 66)):
        refused("", "view", Folder(top, linked).index(scene=scene), *shown, status=status)
        refused("", "relight", Folder(top, linked).index(scene=scene), "-o", os.path.join(top, "no"), status=status)


def try_states(top, good):
    states, elsewhere, out = (os.path.join(top, name) for name in ("states.yaml", "far", "many"))
    with open(states, "w") as file:
        json.dump({"noon": {}, "night": {}}, file)
    os.mkdir(elsewhere)
    os.mkdir(out)
    os.symlink(elsewhere, os.path.join(out, "night"))
    refused("night", "relight", good, "--states", states, "-o", out, status=CANNOT_CREATE)
    assert not os.listdir(elsewhere), "written through a link"


def main():
    if not sealing.available():
        print("skipped: libxxhash.so.0 is not here, which makes manifests fit")
        return harness.SKIPPED
    with tempfile.TemporaryDirectory() as top:
        scene, good, linked = (os.path.join(top, name) for name in ("cornell.glb", "good", "linked"))
        done("generate", "cornell", "-o", scene)
        done("bake", scene, *SMALL, "--keep-transport", "rows", "-o", good)
        done("bake", scene, *SMALL, *LINKS, "-o", linked)
        done("verify", linked)
        done("relight", linked, "-o", os.path.join(top, "relinked"))
        only = os.environ.get("KILN_ONLY", "")
        for check, arguments in ((try_options, (good, good)), (try_values, (good,)), (try_rules, (scene,)),
                                 (try_manifest, (good,)), (try_places, (good, linked)), (try_links, (linked,)),
                                 (try_view, (linked,)), (try_states, (good,))):
            if only in check.__name__:
                check(top, *arguments)
    return 0


sys.exit(main())
