"""Wrong command lines: exit code 64 (66 for what is missing, 65 for what is broken), one sentence, the nearest known
name, at once."""
import json
import os
import tempfile
import unittest

from kiln_cli import InOwnFolder, COMMANDS, kiln, quickest


class Usage(InOwnFolder):
    def setUp(self):
        super().setUp()
        self.scene = os.path.join(self.folder, "scene.glb")
        with open(self.scene, "wb") as file:
            file.write(b"not a scene")

    def refused(self, code, pattern, *arguments):
        answer = kiln(*arguments, folder=self.folder)
        self.assertEqual(answer.code, code, answer.err)
        self.assertRegex(answer.sentence(), pattern)
        self.assertEqual(answer.out, "")
        self.assertEqual(os.listdir(self.folder), ["scene.glb"], "nothing is written")
        return answer

    def test_unknown_names_bring_the_nearest(self):
        for pattern, arguments in {
            r"unknown command 'bakee'.*'bake'": ["bakee"],
            r"--quality: the command comes first": ["--quality", "draft", "bake", self.scene],
            r"unknown command 'generat'.*'generate'": ["generat", "--help"],
            r"--smaples-direct.*--samples-direct": ["bake", self.scene, "--smaples-direct", "4"],
            r"--sampels-bounce.*--samples-bounce": ["bake", self.scene, "--sampels-bounce=4"],
            r"--treads.*--threads": ["bake", self.scene, "--treads", "2"],
            r"--no-stich.*--stitch|--no-stich": ["bake", self.scene, "--no-stich"],
            r"-x.*-o and -h": ["bake", self.scene, "-x"],
            r"belongs to bake.*": ["view", "out", "--samples-bounce", "4"],
            r"has no option --camera; it belongs to view": ["bake", self.scene, "--camera", "all"],
            r"has no option --undersample; it belongs to bake, plan": ["info", self.scene, "--undersample", "random"],
            r"--subdivid.*--subdivide": ["bake", self.scene, "--subdivid", "0.1:16"],
        }.items():
            self.refused(64, pattern, *arguments)

    def test_what_is_not_near_is_not_named(self):
        for arguments in (["frobnicate"], ["foo"], ["bake", self.scene, "--lightprobes", "3"],
                          ["view", "out", "--xyzzy"], ["generate", "teapot"]):
            answer = self.refused(64, "unknown|no scene is called", *arguments)
            self.assertNotIn("nearest", answer.sentence())
            self.assertRegex(answer.sentence(), "lists all|lists them|there are: cornell")
        self.refused(64, "the nearest one is --no-stitch", "bake", self.scene, "--no-stich")
        self.refused(64, "the nearest one is 'generate'", "gen")  # how it begins

    def test_a_folder_that_is_no_bake(self):
        with tempfile.TemporaryDirectory() as folder:
            for arguments in (["view"], ["probe", "1", "2", "3"], ["report"], ["verify"], ["status"], ["stop"]):
                answer = kiln(arguments[0], folder, *arguments[1:])
                self.assertEqual(answer.code, 66)
                self.assertRegex(answer.sentence(),
                                 "is not the folder of a bake: .* name the folder that kiln bake -o wrote to")
            answer = kiln("compare", folder, folder)
            self.assertEqual(answer.code, 66)
            self.assertIn("is not the folder of a bake", answer.sentence())
            self.assertEqual(os.listdir(folder), [])

    def test_wrong_usage_is_answered_at_once(self):
        for arguments in (["bakee"], ["bake", self.scene, "--smaples-direct", "4"], ["bake", "missing.glb"], []):
            self.assertLess(quickest(*arguments).seconds, 0.2)

    def test_nothing_given(self):
        answer = kiln()
        self.assertEqual(answer.code, 64)
        self.assertIn("Commands", answer.err)
        for command in COMMANDS:
            if command != "generate":
                self.refused(64, rf"kiln {command} needs .*for example: kiln {command} ", command)

    def test_too_much_given(self):
        self.refused(64, "takes no argument 'second.glb'", "bake", self.scene, "second.glb")
        self.refused(64, "--quiet and --verbose", "bake", self.scene, "--quiet", "--verbose")

    def test_values(self):
        for pattern, arguments in {
            r"--threads: 0 is out of range.*1 to 4096, or auto": ["--threads", "0"],
            r"--threads: '2x' is not a whole number": ["--threads=2x"],
            r"--threads: '1.5' is not a whole number": ["--threads", "1.5"],
            r"--threads needs a value": ["--threads"],
            r"--threads needs a value: N": ["--threads", "--half"],
            r"--bounces: -1 is out of range.*0 to 10000, or all": ["--bounces", "-1"],
            r"--seed: 18446744073709551616 is out of range": ["--seed", "18446744073709551616"],
            r"--cell-size: 'nan' is not a number": ["--cell-size", "nan"],
            r"--cell-size: 'inf' is not a number": ["--cell-size", "inf"],
            r"--cell-size: '0x10' is not a number": ["--cell-size", "0x10"],
            r"--cell-size: '1e999' is not a number": ["--cell-size", "1e999"],
            r"--cell-size: -2 is out of range": ["--cell-size", "-2"],
            r"--partition: .*'cell'.*cells, objects": ["--partition", "cell"],
            r"--method: .*'paths'.*cells": ["--method", "paths"],
            r"--quality: .*'high'.*draft, preview, production, reference": ["--quality", "high"],
            r"--environment: '1,2' is neither": ["--environment", "1,2"],
            r"--environment: a radiance of -2 is out of range.*from 0 to 1e\+15": ["--environment", "1,-2,3"],
            r"--environment: 'sky.png' is neither": ["--environment", "sky.png"],
            r"--output: is empty": ["-o", ""],
            r"--stitch: 'maybe' is neither true nor false": ["--stitch=maybe"],
            r"--no-threads": ["--no-threads"],
        }.items():
            self.refused(64, pattern, "bake", self.scene, *arguments)
        self.refused(64, r"--from: '1,2' is not a point", "view", "out", "--from", "1,2")
        self.refused(69, r"--backend: this build has no backend 'optix'; it has: auto, embree, vulkan", "bake",
                     self.scene, "--backend", "optix")

    def test_scenes_that_are_not_there(self):
        for command in ("bake", "plan", "info", "check"):
            self.refused(66, "missing.glb: No such file", command, "missing.glb")
            self.refused(66, "Not a directory", command, "scene.glb/inside.glb")
            self.refused(65, "is a folder", command, ".")
            self.refused(65, "is not a regular file", command, "/dev/null")
            self.refused(66, "missing.yaml.*: No such file", command, "missing.yaml")

    def test_json_errors(self):
        for arguments in (["bake", "missing.glb", "--json"], ["bakee", "--json"],
                          ["bake", "--json", self.scene, "--theads", "2"]):
            answer = kiln(*arguments)
            object = json.loads(answer.out)
            self.assertEqual(object["status"], "error")
            self.assertEqual(object["code"], answer.code)
            self.assertEqual(object["message"], answer.sentence())
        answer = kiln("bake", b"\xff.glb".decode("utf-8", "surrogateescape"), "--json", folder=self.folder)
        self.assertEqual(json.loads(answer.out)["code"], 66)

    def test_under_mpirun_the_sentence_comes_once(self):
        for arguments in (["bake", "missing.glb"], ["info", "missing.glb"], ["bakee"]):
            answer = kiln(*arguments, prefix=["mpirun", "-n", "3"], folder=self.folder)
            self.assertEqual(answer.code, 64 if arguments == ["bakee"] else 66)
            answer.sentence()

    def test_options_that_do_not_count_are_told(self):
        """From the command line and from a job file alike; never of what was not given, and not with --quiet."""
        with tempfile.TemporaryDirectory() as folder:
            scene, job = os.path.join(folder, "room.glb"), os.path.join(folder, "job.yaml")
            kiln("generate", "furnace", "-o", scene)
            with open(job, "w") as file:
                file.write("scene: room.glb\nenvironment: none\nenvironment-scale: 2\nprobe-basis: cubemap\n")
            wanted = r"(?m)^kiln: note: --environment-scale does not count here: --environment none is no light"
            for words in (["info", scene, "--environment", "none", "--environment-scale", "2"], ["info", job]):
                self.assertRegex(kiln(*words).err, wanted)
                self.assertNotIn("does not count", kiln(*words, "--quiet").err)
            self.assertNotIn("does not count", kiln("info", scene).err)
            self.assertRegex(kiln("plan", job, "--ranks", "1", "--texels-per-metre", "1").err,
                             r"note: --probe-basis does not count here: .*give --tracing-range M")


if __name__ == "__main__":
    unittest.main()
