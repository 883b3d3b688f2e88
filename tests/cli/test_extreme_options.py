"""Every option of every command that computes, with values that nobody means: each is refused with a sentence, or the
command ends well. The options are those of --help, so that a new one is tried without a word here.

The quick test gives each option one of the values, another for each option; the whole one (price.long) all of them."""
import os
import re
import resource
import subprocess
import sys
import tempfile
import unittest
import zlib

from kiln_cli import KILN, kiln

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
import price  # noqa: E402

ORDINARY = ["0", "-0", "-1", "1", "1e300", "1e-300", str(2 ** 31), str(2 ** 32), str(2 ** 63)]
NO_NUMBERS = ["nan", "inf", "", "text", "x" * 5000, "0x10", " 1", "1,1,1"]
VALUES = ORDINARY + NO_NUMBERS
ENDS = (0, 64, 65, 66, 69, 71, 73, 74, 75)  # 70 is a bug, 75 a limit of time that was reached
SECONDS = 60  # of the processor, and of the clock four times as many
TINY = ["--quality", "draft", "--bounces", "1", "--texels-per-metre", "4", "--backend", "embree", "--threads", "1",
        "--no-preview", "--samples-probe", "0", "--no-resume"]
PICTURE = ["--width", "16", "--threads", "1"]
MERGE, PATCHES = ["--caustics", "merge", "--photons", "500", "--iterations", "2"], ["--method", "radiosity"]
TRACED = ["--method", "path", "--samples-pixel", "2", "--backend", "embree", "--from", "1,1,2", "--to", "0,0,0"]
# what an option needs, so that it counts
NEEDS = {
    "bake": {"photons": MERGE, "merge-radius": MERGE, "iterations": MERGE, "radius-alpha": MERGE,
             "patches": PATCHES, "order": PATCHES, "gather": PATCHES, "undersample": PATCHES, "subdivide": PATCHES,
             "visibility": PATCHES, "albedo-scale": PATCHES, "visibility-cache": PATCHES,
             "probe-basis": ["--tracing-range", "1"],
             "leaf-size": ["--store", "octree"], "texels-per-metre": ["--lightmap-max", "16"]},
    "view": {**{name: TRACED for name in ("unit", "environment", "environment-scale", "environment-rotation", "bounces",
                                          "seed", "samples-pixel", "path-length", "max-time", "lens-radius")},
             "merge-radius": ["--method", "vcm", *TRACED[2:]], "focus-distance": [*TRACED, "--lens-radius", "0.1"],
             "checkpoint-every": [*TRACED, "--accumulate", "added"]},
    "export": {"range": ["--format", "rgbm", "--atlas", "64"]},
}
NEEDS["plan"] = NEEDS["bake"]
# what goes before the second value of an option
FIRST = {"patches": "links:", "order": "unshot:", "gather": "even:", "undersample": "mipmap:", "subdivide": "0.1:",
         "visibility": "voxels:", "probe-basis": "cubemap:"}
WITHOUT = {"lightmap-size": ["--texels-per-metre"], "lightmap-max": ["--texels-per-metre"],
           "samples-direct": ["--quality"], "method": ["--bounces"], "leaf-size": ["--texels-per-metre"]}


class Options(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.room = cls.enterClassContext(tempfile.TemporaryDirectory())
        scene = glb.Scene()
        grey = scene.material("grey", (0.5, 0.5, 0.5))
        scene.quad("ground", [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], grey)
        scene.light("lamp", {"type": "point", "intensity": 10.0}, translation=[0, 1, 0])
        cls.scene = scene.write(os.path.join(cls.room, "scene.glb"))
        groups = os.path.join(cls.room, "groups.yaml")
        with open(groups, "w") as file:
            file.write("lamps: {lights: [lamp]}\n")
        cls.plain, cls.kept, cls.apart = (os.path.join(cls.room, name) for name in ("plain", "kept", "apart"))
        for out, more in ((cls.plain, []), (cls.kept, ["--keep-transport", "rows"]),
                          (cls.apart, ["--light-groups", groups])):
            answer = kiln("bake", cls.scene, "-o", out, *TINY, *more)
            assert answer.code == 0, answer.err

    def setUp(self):
        self.folder = self.enterContext(tempfile.TemporaryDirectory())

    def command(self, name, option, value):
        """The command line, without those of its usual options that would exclude the one that is tried."""
        needs = [] if option not in NEEDS.get(name, {}) else NEEDS[name][option]
        traced = needs[:1] == ["--method"] and name == "view"
        seen = self.scene if traced else self.plain
        usual = {"bake": [self.scene, *TINY], "plan": [self.scene, *TINY], "view": [seen, *PICTURE],
                 "relight": [self.kept, "--threads", "1", "--no-preview"], "mix": [self.apart], "export": [self.plain]}
        out = ["--output", {"view": "picture.png", "export": "out.glb"}.get(name, "out")]
        words = [*usual[name], *(out if option != "output" else [])]
        for other in (option, *WITHOUT.get(option, ())):
            other = other if other.startswith("--") else "--" + other
            if other in words:
                at = words.index(other)
                del words[at:at + 2]
            if "--no-" + other[2:] in words:
                words.remove("--no-" + other[2:])
        if f"--{option}" in needs:
            at = needs.index(f"--{option}")
            needs = needs[:at] + needs[at + 2:]
        return [KILN, name, *words, *needs, f"--{option}", value]

    def limit(self):
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    def attempt(self, name, option, first, kind, value):
        words = self.command(name, option, first + value)
        shown = f"{name} --{option} {first}{value[:40]!r}"
        with tempfile.TemporaryDirectory(dir=self.folder) as here:
            try:
                done = subprocess.run(words, cwd=here, stdin=subprocess.DEVNULL, capture_output=True, text=True,
                                      errors="replace", timeout=4 * SECONDS, preexec_fn=self.limit)
            except subprocess.TimeoutExpired:
                return f"{shown}: no end after {4 * SECONDS} s"
        if done.returncode not in ENDS:
            return f"{shown}: exit {done.returncode}: {done.stderr[-300:]}"
        if done.returncode not in (0, 75) and "kiln: error: " not in done.stderr:
            return f"{shown}: exit {done.returncode} without a sentence: {done.stderr[-300:]}"
        if value in NO_NUMBERS and self.is_number(kind) and value not in kind.split("|") and done.returncode == 0:
            return f"{shown}: is accepted, and is no {kind}"
        if value == "" and done.returncode == 0:
            return f"{shown}: an empty value is accepted"
        return None

    @staticmethod
    def is_number(kind):
        """By the placeholder of --help: a unit or a letter in capitals, perhaps with words, but no file or text."""
        first = kind.split("|")[0]
        return re.fullmatch("[A-Z]+", first) is not None and first not in (
            "PATH", "FILE", "FOLDER", "SCENE", "NAME", "IMAGE", "GROUP", "DIR", "TEXT", "RULES", "LIST", "NAMES",
            "PATTERN", "PARTITION", "CAMERA", "COMMAND", "WHAT", "FORMAT")

    def options_of(self, name):
        """Each option that takes a value: its name, what goes before, and the placeholder of the value. One with two
        values comes twice."""
        text = kiln(name, "--help", "all", columns=100).out
        found = re.findall(r"(?m)^  (?:-o, )?--([a-z0-9-]+) ([^\s\[]+)(?:\[:(\w+)\])?(?:$| {2,})", text)
        self.assertEqual(len(found), len(re.findall(r"(?m)^  (?:-o, )?--[a-z0-9-]+ \S", text)), name)
        return [(option, "", kind) for option, kind, _ in found] + \
            [(option, FIRST[option], second) for option, _, second in found if second != ""]

    def walk(self, name, values_of):
        wrong = [self.attempt(name, option, first, kind, value) for option, first, kind in self.options_of(name)
                 for value in values_of(first + option)]
        wrong = [text for text in wrong if text is not None]
        self.assertEqual(wrong, [], "\n" + "\n".join(wrong))

    def test_a_target_that_no_number_of_samples_reaches(self):
        answer = kiln("bake", self.scene, "-o", os.path.join(self.folder, "out"), "--target-error", "1e-300")
        self.assertEqual(answer.code, 64, answer.err)
        self.assertIn("--target-error: 1e-300 is out of range; it must be a number from 1e-06 to 1", answer.sentence())


def some(name):
    return lambda self: self.walk(name, lambda option: [VALUES[zlib.crc32((name + option).encode()) % len(VALUES)]])


def whole(name):
    @price.long
    def test(self):
        self.walk(name, lambda option: VALUES)
    return test


for command in ("bake", "view", "relight", "mix", "export", "plan"):
    setattr(Options, f"test_some_{command}", some(command))
    setattr(Options, f"test_{command}", whole(command))

if __name__ == "__main__":
    unittest.main()
