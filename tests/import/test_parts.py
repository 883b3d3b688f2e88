"""Scenes in parts: many files, read one by one, give the bits of one file; only what has changed is read again."""
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import unittest

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
import png  # noqa: E402
from gltf_file import File, strip, write_glb  # noqa: E402
from merged import write_merged  # noqa: E402
from program import KILN, InOneFolder, kiln, run_json  # noqa: E402
from ranks import MPI_ENVIRONMENT  # noqa: E402

REPOSITORY = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
QUICK = ["--quality", "draft", "--texels-per-metre", "2", "--samples-direct", "4", "--samples-bounce", "4",
         "--samples-indirect", "8", "--bounces", "1", "--backend", "embree", "--no-preview"]
IDENTITY = np.eye(4).tolist()


def moved(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix.tolist()


def turned(x, y, z, scale=1.0):
    """A quarter turn about y, and a translation."""
    return [[0.0, 0.0, scale, x], [0.0, scale, 0.0, y], [-scale, 0.0, 0.0, z], [0.0, 0.0, 0.0, 1.0]]


def write_textured(source, target):
    """Gives a scene a picture, a normal map and a material that shines."""
    file = File(source)
    picture = np.arange(8 * 8 * 3, dtype=np.uint8).reshape(8, 8, 3) + 40
    file.json["images"] = [{"uri": png.data_uri(picture)}]
    file.json["textures"] = [{"source": 0}]
    material = file.json["materials"][0]
    material["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    material["pbrMetallicRoughness"]["roughnessFactor"] = 0.3
    material["normalTexture"] = {"index": 0}
    write_glb(target, file.json, file.binary)


def yaml(parts):
    lines = ["parts:"]
    for name, file, places in parts:
        lines.append(f"  - name: {name}\n    file: {file}\n    at: {json.dumps(places)}")
    return "\n".join(lines) + "\n"


def lightmaps(folder):
    """The channels of all lightmaps, in the order of the objects."""
    return [exr.read(os.path.join(folder, o["lightmap"])).channels for o in run_json(folder)["objects"]]


class Parts(InOneFolder):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        for name in ("cornell", "rooms"):
            shutil.copy(os.path.join(REPOSITORY, "jobs", name + ".glb"), cls.folder)
        strip(os.path.join(cls.folder, "rooms.glb"), os.path.join(cls.folder, "plain.glb"))
        write_textured(os.path.join(cls.folder, "cornell.glb"), os.path.join(cls.folder, "textured.glb"))
        cls.write_lamps(os.path.join(cls.folder, "lamps.glb"))

    @classmethod
    def write_lamps(cls, path):
        scene = glb.Scene()
        grey = scene.material("grey", (0.5, 0.5, 0.5))
        scene.quad("floor", [[0, 0, 4], [4, 0, 4], [4, 0, 0], [0, 0, 0]], grey)
        down = [-0.7071067811865476, 0.0, 0.0, 0.7071067811865476]
        for name, light in (("spot", {"type": "spot", "intensity": 40.0,
                                      "spot": {"innerConeAngle": 0.3, "outerConeAngle": 0.6}}),
                            ("sun", {"type": "directional", "intensity": 0.5})):
            scene.light(name, light, translation=[2, 3, 2], rotation=down)
        scene.write(path)

    def path(self, name):
        return os.path.join(self.folder, name)

    def write(self, name, text):
        with open(self.path(name), "w") as file:
            file.write(text)
        return self.path(name)

    def job(self, name, parts):
        return self.write(name, yaml(parts))

    def bake(self, scene, out, *options, ranks=0, code=0, environment=None):
        return kiln("bake", scene, "-o", self.path(out), *QUICK, *options, ranks=ranks, code=code,
                    environment=environment)

    def assert_same_light(self, one, other):
        a, b = lightmaps(self.path(one)), lightmaps(self.path(other))
        self.assertEqual(len(a), len(b))
        for own, others in zip(a, b):
            self.assertEqual(own.keys(), others.keys())
            for channel in own:
                np.testing.assert_array_equal(own[channel], others[channel])


class SameBits(Parts):
    PARTS = [("box", "textured.glb", [IDENTITY]),
             ("rooms", "plain.glb", [moved(8, 0, 0), turned(40, 0, 8, 2.0)]),
             ("lamps", "lamps.glb", [moved(8, 0, 16), turned(24, 0, 16)]),
             ("other", "rooms.glb", [moved(0, 0, -32)])]

    def test_parts_give_the_bits_of_one_file_on_any_number_of_ranks(self):
        write_merged(self.path("merged.glb"), [(self.path(file), places) for _, file, places in self.PARTS])
        self.bake(self.path("merged.glb"), "one")
        job = self.job("job.yaml", self.PARTS)
        for ranks in (0, 2, 3):
            with self.subTest(ranks=ranks):
                out = f"parts{ranks}"
                self.bake(job, out, ranks=ranks)
                self.assert_same_light("one", out)
                self.assertEqual([o["name"] for o in run_json(self.path(out))["objects"]][-1][:6], "other/")

    def test_automatic_density_and_rules_are_those_of_one_file(self):
        """The density is one of the whole scene, and rules reach into parts by their names."""
        write_merged(self.path("merged2.glb"), [(self.path(file), places) for _, file, places in self.PARTS])
        job = self.job("job2.yaml", self.PARTS)
        options = ["--quality", "draft", "--texels-per-metre", "auto"]
        with_rules = {name: ["--objects", json.dumps({pattern: {"density-scale": 3}, other: {"exclude": True}})]
                      for name, pattern, other in (("one2", "floor", "short_block"),
                                                   ("parts2", "*/floor", "box/short_block"))}
        self.bake(self.path("merged2.glb"), "one2", *options, *with_rules["one2"])
        self.bake(job, "parts2", *options, *with_rules["parts2"], ranks=2)
        self.assert_same_light("one2", "parts2")


class Files(Parts):
    PARTS = [("box", "textured.glb", [IDENTITY]), ("rooms", "plain.glb", [moved(8, 0, 0), moved(40, 0, 0)]),
             ("lamps", "lamps.glb", [moved(8, 0, 16)])]

    def test_each_part_has_a_scene_with_links(self):
        job = self.job("files.yaml", self.PARTS)
        self.bake(job, "files")
        self.bake(job, "files3", ranks=3)
        names = ["box.glb", "lamps.glb", "rooms.2.glb", "rooms.glb"]
        self.assertEqual(sorted(os.listdir(self.path("files/scenes"))), names)
        self.assertFalse(os.path.exists(self.path("files/scene.glb")))
        objects = run_json(self.path("files"))["objects"]
        for name in names:
            with open(self.path("files/scenes/" + name), "rb") as one, open(self.path("files3/scenes/" + name),
                                                                           "rb") as other:
                self.assertEqual(one.read(), other.read())
            file = File(self.path("files/scenes/" + name))
            place = name[:-len(".glb")] + "/"
            links = {node["name"]: node["extras"]["kiln_lightmap"] for node in file.json["nodes"] if "mesh" in node}
            self.assertEqual({"../" + o["lightmap"] for o in objects if o["lightmap"].startswith("lightmaps/" + place)},
                             {link["file"] for link in links.values()})
            self.assertTrue(all(node["name"].startswith(place) for node in file.json["nodes"]))
            pages = file.json["extensions"]["KILN_lightmap"]["pages"]
            self.assertEqual([pages[link["page"]]["file"] for link in links.values()],
                             [link["file"] for link in links.values()])
            used = {p["material"] for mesh in file.json["meshes"] for p in mesh["primitives"]}
            self.assertEqual(used, set(range(len(file.json["materials"]))))
            self.assertEqual(len(file.json.get("textures", [])), 1 if name == "box.glb" else 0)
        lamps = File(self.path("files/scenes/lamps.glb")).json["extensions"]["KHR_lights_punctual"]["lights"]
        self.assertEqual([light["name"] for light in lamps], ["lamps/spot", "lamps/sun"])
        self.assertIn("values in range", kiln("verify", self.path("files")).stdout)
        # without the files of scenes there are none, and those of the bake before go
        self.bake(job, "files", "--no-export")
        self.assertFalse(os.path.exists(self.path("files/scenes")))


class OtherCommands(Parts):
    def test_commands_that_take_a_scene_take_parts(self):
        job = self.job("all.yaml", [("box", "cornell.glb", [IDENTITY]), ("lamps", "lamps.glb", [moved(8, 0, 0)])])
        with tempfile.TemporaryDirectory() as scratch:
            counts = {command: json.loads(kiln(command, job, "--json", environment={"TMPDIR": scratch}).stdout)
                      for command in ("info", "check", "plan")}
            self.assertEqual(os.listdir(scratch), [])
        self.assertEqual(counts["info"]["counts"]["objects"], 9)
        self.assertEqual(counts["check"]["scene"], job)
        self.assertEqual(counts["plan"]["triangles"], counts["info"]["counts"]["triangles_expanded"])

    def test_a_bake_in_parts_is_relit_mixed_compared_and_exported(self):
        job = self.job("uses.yaml", [("box", "cornell.glb", [IDENTITY]), ("lamps", "lamps.glb", [moved(8, 0, 0)])])
        groups = self.write("groups.yaml", "spots: {lights: [lamps/spot]}\n")
        self.bake(job, "kept", "--keep-transport", "rows")
        kiln("relight", self.path("kept"), "-o", self.path("relit"), "--no-preview", ranks=2)
        self.assert_same_light("kept", "relit")
        compared = kiln("compare", self.path("kept"), self.path("relit"), "--json").stdout
        self.assertTrue(json.loads(compared)["identical"])
        self.bake(job, "grouped", "--light-groups", groups)
        kiln("mix", self.path("grouped"), "--set", "spots=0.5", "-o", self.path("mixed"), ranks=2)
        self.assertTrue(os.path.exists(self.path("mixed/lightmaps/lamps/floor.exr")))
        self.assertEqual(sorted(os.listdir(self.path("mixed/scenes"))), ["box.glb", "lamps.glb"])
        self.assertIn("values in range", kiln("verify", self.path("mixed")).stdout)
        kiln("export", self.path("kept"), "-o", self.path("exported/scene.glb"))
        document = File(self.path("exported/scene.glb")).json
        for page in document["extensions"]["KILN_lightmap"]["pages"]:
            self.assertTrue(os.path.exists(os.path.join(self.path("exported"), page["file"])), page)

    def test_a_rank_that_reads_a_broken_part_ends_all(self):
        self.write("broken-on-rank-1.glb", "nothing")
        job = self.job("rank.yaml", [("a", "cornell.glb", [IDENTITY]), ("b", "broken-on-rank-1.glb", [IDENTITY]),
                                     ("c", "lamps.glb", [IDENTITY])])
        said = kiln("import", job, "-o", self.path("rank"), ranks=3, code=65)
        self.assertRegex(said.stderr, "error: part 'b': .*broken-on-rank-1.glb: ")
        self.assertEqual(sorted(os.listdir(self.path("rank/parts"))), ["a.kscene", "c.kscene"])
        # what was read counts when the part is repaired
        shutil.copy(self.path("rooms.glb"), self.path("broken-on-rank-1.glb"))
        self.assertIn("3 parts, 1 of them read: b\n", kiln("import", job, "-o", self.path("rank"), ranks=2).stdout)


class OnlyWhatChanged(Parts):
    def read(self, out):
        """The parts that a bake has read."""
        return [part["name"] for part in run_json(self.path(out))["scene"]["parts"] if part["read"]]

    def test_one_changed_file_is_read_again(self):
        for name in ("cornell", "rooms"):
            shutil.copy(self.path(name + ".glb"), self.path(name + "-own.glb"))
        parts = [("a", "cornell-own.glb", [IDENTITY]), ("b", "rooms-own.glb", [moved(8, 0, 0)]),
                 ("c", "lamps.glb", [moved(0, 0, 16)])]
        job = self.job("change.yaml", parts)
        said = self.bake(job, "change", ranks=2)
        self.assertIn("kiln: 3 parts, 3 of them read\n", said.stderr)
        self.assertEqual(self.read("change"), ["a", "b", "c"])
        self.assertEqual([part["rank"] for part in run_json(self.path("change"))["scene"]["parts"]], [0, 1, 0])
        said = self.bake(job, "change")
        self.assertIn("kiln: 3 parts, 0 of them read\n", said.stderr)
        file = File(self.path("rooms-own.glb"))
        file.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.1, 0.2, 0.3, 1.0]
        write_glb(self.path("rooms-own.glb"), file.json, file.binary)
        said = self.bake(job, "change", ranks=3)
        self.assertIn("kiln: 3 parts, 1 of them read: b\n", said.stderr)
        self.assertEqual(self.read("change"), ["b"])
        self.bake(job, "fresh")
        self.assert_same_light("fresh", "change")
        # what concerns the whole scene reads no part again: a density, a sky, a place
        parts[2] = ("c", "lamps.glb", [moved(0, 0, 20)])
        said = self.bake(self.job("change.yaml", parts), "change", "--environment", "1,1,1")
        self.assertIn("kiln: 3 parts, 0 of them read\n", said.stderr)
        # a part that has left the job leaves nothing behind
        self.bake(self.job("change.yaml", parts[:2]), "change")
        self.assertEqual(sorted(os.listdir(self.path("change/parts"))), ["a.kscene", "b.kscene", "scene.parts"])
        self.assertEqual(sorted(os.listdir(self.path("change/lightmaps"))), ["a", "b"])
        self.assertEqual(sorted(os.listdir(self.path("change/scenes"))), ["a.glb", "b.glb"])

    def test_import_reads_what_a_bake_takes(self):
        job = self.job("ahead.yaml", [("a", "cornell.glb", [IDENTITY]), ("b", "lamps.glb", [moved(8, 0, 0)])])
        said = kiln("import", job, "-o", self.path("ahead"), "--texels-per-metre", "2", "--json", ranks=2)
        answer = json.loads(said.stdout)
        self.assertEqual([(part["name"], part["read"], part["rank"]) for part in answer["parts"]],
                         [("a", True, 0), ("b", True, 1)])
        self.assertFalse(answer["up_to_date"])
        before = os.stat(self.path("ahead/scene.kscene"))
        said = self.bake(job, "ahead")
        self.assertIn("kiln: 2 parts, 0 of them read\n", said.stderr)
        self.assertEqual(os.stat(self.path("ahead/scene.kscene")).st_ino, before.st_ino)
        self.assertTrue(json.loads(kiln("import", job, "-o", self.path("ahead"), "--texels-per-metre", "2",
                                        "--json").stdout)["up_to_date"])

    def write_long(self, name, count=150000):
        """An OBJ file that takes a while to read: a strip of quads."""
        with open(self.path(name), "w") as file:
            for i in range(count):
                file.write(f"v {i * 0.001:.3f} 0 0\nv {i * 0.001:.3f} 0 1\n")
            for i in range(count - 1):
                a = 2 * i + 1
                file.write(f"f {a} {a + 1} {a + 3} {a + 2}\n")

    def start(self, job, out):
        return subprocess.Popen([KILN, "bake", job, "-o", self.path(out), *QUICK], stdin=subprocess.DEVNULL,
                                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                                env={**os.environ, **MPI_ENVIRONMENT})

    def wait_for(self, path, process):
        while not os.path.exists(self.path(path)):
            self.assertIsNone(process.poll(), "the bake ended too early")
            time.sleep(0.002)

    def wait_until_read(self, name, process):
        """Waits until an import child has the file mapped."""
        while True:
            self.assertIsNone(process.poll(), "the bake ended too early")
            children = subprocess.run(["pgrep", "-P", str(process.pid)], capture_output=True, text=True).stdout.split()
            for child in children:
                try:
                    with open(f"/proc/{child}/maps") as maps:
                        if name in maps.read():
                            return
                except OSError:
                    pass

    def long_job(self, name):
        self.write_long(name + ".obj")
        return self.job(name + ".yaml", [("first", "cornell.glb", [IDENTITY]), ("long", name + ".obj", [IDENTITY])])

    def test_a_killed_import_goes_on_with_what_is_left(self):
        job = self.long_job("killed")
        process = self.start(job, "killed")
        self.wait_for("killed/parts/.long.kscene.part", process)
        process.kill()
        process.communicate()
        self.assertEqual([name for name in os.listdir(self.path("killed/parts")) if name[0] != "."], ["first.kscene"])
        before = os.stat(self.path("killed/parts/first.kscene")).st_mtime_ns
        process = self.start(job, "killed")
        self.wait_for("killed/scene.kscene", process)
        process.kill()
        process.communicate()
        self.assertEqual(os.stat(self.path("killed/parts/first.kscene")).st_mtime_ns, before)
        said = self.bake(job, "killed")
        self.assertIn("kiln: 2 parts, 0 of them read\n", said.stderr)
        self.bake(job, "unkilled")
        self.assert_same_light("unkilled", "killed")

    def test_a_file_that_changes_while_it_is_read_is_refused(self):
        job = self.long_job("moving")
        process = self.start(job, "moving")
        self.wait_until_read("moving.obj", process)
        with open(self.path("moving.obj"), "a") as file:
            file.write("# written while it is read\n")
        _, said = process.communicate()
        self.assertEqual(process.returncode, 74, said)
        self.assertRegex(said, r"error: (rank 0 on \S+: )?part 'long': \S+moving.obj, or a file that it refers to, "
                               r"changed while it was read: run the same command again")
        self.assertFalse(os.path.exists(self.path("moving/scene.kscene")))
        self.bake(job, "moving")

    def test_a_file_that_changes_during_the_bake_is_named(self):
        shutil.copy(self.path("rooms.glb"), self.path("later.glb"))
        job = self.job("later.yaml", [("box", "cornell.glb", [IDENTITY]), ("later", "later.glb", [moved(8, 0, 0)])])
        process = self.start(job, "later")
        self.wait_for("later/scene.kscene", process)
        file = File(self.path("later.glb"))
        file.json["asset"]["generator"] = "another one"
        write_glb(self.path("later.glb"), file.json, file.binary)
        _, said = process.communicate()
        self.assertEqual(process.returncode, 0, said)
        self.assertRegex(said, r"warning: part 'later': \S+later.glb has changed since it was read.*the same command")
        self.assertIn("1 of them read: later", self.bake(job, "later").stderr)


class WhoWins(Parts):
    def write_sky(self, name, radiance=None, units=None):
        scene = glb.Scene()
        scene.quad("floor", [[0, 0, 4], [4, 0, 4], [4, 0, 0], [0, 0, 0]], scene.material("grey", (0.5, 0.5, 0.5)))
        scene.node({"name": "eye", "camera": 0, "translation": [2, 1, 8]})
        scene.document["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}]
        if radiance is not None:
            scene.environment(radiance)
        if units is not None:
            scene.document["asset"]["extras"] = {"units": units}
        scene.write(self.path(name))

    def info(self, job, *options):
        return json.loads(kiln("info", job, "--json", *options).stdout)

    @staticmethod
    def notes(info):
        return " ".join(note["text"] for note in info["notes"])

    def test_names_environment_and_cameras(self):
        self.write_sky("plain-sky.glb")
        self.write_sky("blue.glb", (0.1, 0.2, 0.9))
        self.write_sky("red.glb", (0.9, 0.2, 0.1))
        job = self.job("sky.yaml", [("none", "plain-sky.glb", [IDENTITY, moved(10, 0, 0)]),
                                    ("blue", "blue.glb", [moved(20, 0, 0)]), ("red", "red.glb", [moved(30, 0, 0)])])
        info = self.info(job)
        self.assertEqual(info["cameras"], ["none/eye", "none.2/eye", "blue/eye", "red/eye"])
        np.testing.assert_allclose(info["environment"]["radiance"], (0.1, 0.2, 0.9), rtol=1e-6)
        notes = self.notes(info)
        self.assertRegex(notes, "environment of part 'blue' lights the scene; that of part 'red' is left out")
        asked = self.info(job, "--environment", "3,3,3")
        np.testing.assert_allclose(asked["environment"]["radiance"], (3, 3, 3), rtol=1e-6)
        self.assertNotRegex(self.notes(asked), "is left out")
        self.bake(job, "sky")
        bake = run_json(self.path("sky"))
        self.assertEqual([(o["name"], o["lightmap"]) for o in bake["objects"]],
                         [(f"{part}/floor", f"lightmaps/{part}/floor.exr")
                          for part in ("none", "none.2", "blue", "red")])
        self.assertRegex(" ".join(bake["scene"]["warnings"]), "part 'red'")

    def test_a_part_of_another_unit_is_noted(self):
        self.write_sky("metres.glb")
        job = self.job("unit.yaml", [("a", "metres.glb", [IDENTITY]), ("b", "metres.glb", [moved(8, 0, 0)]),
                                     ("c", "metres.glb", [[[1000, 0, 0, 0], [0, 1000, 0, 0], [0, 0, 1000, 0],
                                                           [0, 0, 0, 1]]])])
        notes = self.notes(self.info(job))
        self.assertRegex(notes, r"part 'c' is 4e\+03 m long where it stands, and half of the parts are at most 4 m")
        self.assertNotRegex(notes, "part '[ab]' is")

    def test_a_place_in_words_is_the_matrix(self):
        rows = turned(3, 0, 1, 2.0)
        job = self.job("rows.yaml", [("a", "cornell.glb", [rows])])
        words = self.write("words.yaml", "parts:\n- {name: a, file: cornell.glb, at: {translation: [3, 0, 1], "
                                         "rotation: 90, scale: 2}}\n")
        for text, out in ((job, "rows"), (words, "words")):
            kiln("import", text, "-o", self.path(out))
        a, b = (open(self.path(out + "/parts/scene.parts")).read() for out in ("rows", "words"))
        self.assertEqual(json.loads(a)["parts"][0]["places"], json.loads(b)["parts"][0]["places"])

    def test_levels_of_detail_and_rules_are_found_in_parts(self):
        scene = glb.Scene()
        grey = scene.material("grey", (0.5, 0.5, 0.5))
        for level in range(2):
            scene.quad(f"thing_LOD{level}", [[0, 0, 4], [4, 0, 4], [4, 0, 0], [0, 0, 0]], grey)
        scene.write(self.path("lod.glb"))
        job = self.job("lod.yaml", [("a", "lod.glb", [IDENTITY, moved(10, 0, 0)])])
        self.assertEqual(self.info(job)["counts"]["objects"], 2)


class Refused(Parts):
    def refused(self, pattern, text, code=65):
        job = self.write("bad.yaml", text)
        out = self.path(f"bad-{self._testMethodName}")
        said = kiln("bake", job, "-o", out, code=code)
        self.assertRegex(said.stderr, pattern)
        return out

    def test_bad_lists(self):
        good = "{name: a, file: cornell.glb"
        for pattern, text in {
            "parts is empty": "parts: []",
            "parts is a list": "parts: {a: b}",
            "part 'a' has no file": "parts: [{name: a}]",
            "a part has no name": "parts: [{file: cornell.glb}]",
            "a part has no key 'fiel'": "parts: [{name: a, fiel: cornell.glb}]",
            "'back' is no name of a part": "parts: [{name: back, file: cornell.glb}]",
            r"'\.\./up' is no name of a part": "parts: [{name: ../up, file: cornell.glb}]",
            "two parts are called 'A'": "parts: [%s}, {name: A, file: rooms.glb}]" % good,
            "part 'a': .*bad.yaml is a job": "parts: [{name: a, file: bad.yaml}]",
            "part 'a': .*x.kscene has its layouts": "parts: [{name: a, file: x.kscene}]",
            "part 'a': at: is singular": "parts: [%s, at: {scale: [1, 0, 1]}}]" % good,
            "part 'a': at: is singular:": "parts: [%s, at: [[1,0,0,0],[1,0,0,0],[0,0,1,0],[0,0,0,1]]}]" % good,
            "part 'a': at: the last row": "parts: [%s, at: [[1,0,0,0],[0,1,0,0],[0,0,1,0],[1,0,0,1]]}]" % good,
            "part 'a': at: translation is three finite": "parts: [%s, at: {translation: [.inf, 0, 0]}}]" % good,
            "part 'a': at: a number is infinite": "parts: [%s, at: {translation: [1e13, 0, 0]}}]" % good,
            "part 'a': at: rotation is no unit": "parts: [%s, at: {rotation: [1, 1, 0, 0]}}]" % good,
            "part 'a': at: there is no key 'rotate'": "parts: [%s, at: {rotate: 3}}]" % good,
            "part 'a': at: names no place": "parts: [%s, at: []}]" % good,
            "parts: nothing of a part lies so deep": "parts: [%s, at: [[[[[[1]]]]]]}]" % good,
            "has scene and parts": "scene: cornell.glb\nparts: [%s}]" % good,
            "unknown key 'part'.*'parts'": "part: [%s}]" % good,
            "'file' stands twice": "parts: [%s, file: rooms.glb}]" % good,
        }.items():
            with self.subTest(text=text):
                self.assertFalse(os.path.exists(self.refused(pattern, text)))

    def test_a_missing_or_broken_file_names_its_part(self):
        good = "{name: good, file: cornell.glb}"
        self.refused("part 'gone': cannot read its file .*gone.glb", "parts: [%s, {name: gone, file: gone.glb}]" % good,
                     66)
        self.write("broken.glb", "this is no scene")
        out = self.refused("part 'broken': .*broken.glb: the file does not begin with 'glTF'",
                           "parts: [%s, {name: broken, file: broken.glb}]" % good)
        self.assertFalse(os.path.exists(os.path.join(out, "scene.kscene")))
        os.mkdir(self.path("folder.glb"))
        self.refused("part 'folder': .* is not a regular file", "parts: [{name: folder, file: folder.glb}]")

    def test_a_part_is_no_scene(self):
        kiln("import", self.job("one.yaml", [("a", "cornell.glb", [IDENTITY])]), "-o", self.path("one"))
        said = kiln("info", self.path("one/parts/a.kscene"), code=65)
        self.assertIn("is the scene file of a part", said.stderr)


if __name__ == "__main__":
    unittest.main()
