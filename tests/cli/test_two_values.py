"""Options with two values, --undersample mipmap:4. Their second values were options of their own in the version before:
these are still accepted, with a note, and give the same bits."""
import json
import os
import signal
import subprocess
import tempfile
import time
import unittest

from kiln_cli import KILN, kiln

PATCHES = ["--method", "radiosity"]
QUICK = ["--texels-per-metre", "1", "--bounces", "2", "--quality", "draft", "--backend", "embree", "--threads", "1",
         "--no-preview", "--no-export", "--samples-probe", "0", "--materials", "diffuse"]
# option, its two values, former name of the second, what else makes it count
PAIRS = [("patches", "links", "0.1", "link-error", PATCHES), ("order", "unshot", "0.01", "unshot-left", PATCHES),
         ("gather", "even", "64", "directions", PATCHES), ("undersample", "mipmap", "2", "sampling-window", PATCHES),
         ("subdivide", "0.1", "4", "node-max", PATCHES), ("visibility", "voxels", "16", "voxels", PATCHES),
         ("probe-basis", "cubemap", "2", "probe-side", ["--tracing-range", "1", "--samples-radiance-probe", "16"])]


class TwoValues(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.room = cls.enterClassContext(tempfile.TemporaryDirectory())

    def setUp(self):
        self.folder = self.enterContext(tempfile.TemporaryDirectory())

    def bake(self, *words, code=0):
        out = os.path.join(self.folder, "out%d" % len(os.listdir(self.folder)))
        answer = kiln("bake", *words, "-o", out, *QUICK)
        self.assertEqual(answer.code, code, answer.err)
        light = {}
        for name in sorted(os.listdir(os.path.join(out, "lightmaps"))) if code == 0 else ():
            with open(os.path.join(out, "lightmaps", name), "rb") as file:
                light[name] = file.read()
        return light, answer.err

    def job(self, text):
        path = os.path.join(self.folder, "job.yaml")
        with open(path, "w") as file:
            file.write(f"scene: {os.path.abspath('jobs/cornell.glb')}\n{text}")
        return path

    def test_both_forms_give_the_same_bits(self):
        scene = "jobs/cornell.glb"
        for option, first, second, former, more in PAIRS:
            new, said = self.bake(scene, *more, f"--{option}", f"{first}:{second}")
            self.assertNotIn("kiln: note: the option", said)
            old, said = self.bake(scene, *more, f"--{option}", first, f"--{former}", second)
            self.assertRegex(said, rf"the option {former} is now part of {option}: write {option} \S+:\S+; the next")
            plain, _ = self.bake(scene, *more, f"--{option}", first)
            self.assertEqual(new, old, option)
            if former != "unshot-left":  # two bounces end before it
                self.assertNotEqual(new, plain, f"--{option} {first}:{second} does as {first} alone")

    def test_job_files(self):
        """Either form, which the command line wins over as a whole."""
        wanted, _ = self.bake("jobs/cornell.glb", *PATCHES, "--undersample", "mipmap:2")
        for text, note in (("undersample: mipmap:2", False), ("undersample: 'mipmap:2'", False),
                           ("undersample: mipmap\nsampling-window: 2", True)):
            light, said = self.bake(self.job(f"method: radiosity\n{text}\n"))
            self.assertEqual(light, wanted, text)
            self.assertEqual("sampling-window is now part of undersample: write undersample mipmap:2" in said, note)
        usual, _ = self.bake("jobs/cornell.glb", *PATCHES, "--undersample", "mipmap")
        job = self.job("method: radiosity\nundersample: stride:2\n")
        self.assertEqual(self.bake(job, "--undersample", "mipmap")[0], usual)
        self.assertEqual(self.bake(job, "--undersample", "mipmap:2")[0], wanted)

    def test_a_checkpoint_of_one_form_is_gone_on_from_with_the_other(self):
        out, held = os.path.join(self.folder, "out"), os.path.join(self.folder, "held")
        words = ["bake", "jobs/cornell.glb", "-o", out, *QUICK, "--tracing-range", "1"]
        with open(held, "w"):
            pass
        bake = subprocess.Popen([KILN, *words, "--probe-basis", "cubemap", "--probe-side", "2"],
                                env={**os.environ, "KILN_HOLD": held}, stderr=subprocess.PIPE, text=True)
        end = time.monotonic() + 60
        while not json.loads(kiln("status", out, "--json").out or "{}").get("phase", "").startswith("bounce"):
            self.assertIsNone(bake.poll(), "the bake is not held")
            self.assertLess(time.monotonic(), end)
            time.sleep(0.1)
        bake.send_signal(signal.SIGUSR1)
        self.assertIn("the same command goes on from it", bake.communicate(timeout=60)[1])
        other = kiln(*words, "--probe-basis", "cubemap:4")
        self.assertEqual(other.code, 65, "another side is another bake")
        self.assertRegex(other.err, "probe-side +2 +4|probe-side +2 .*4")
        self.assertIn("going on from checkpoint", kiln(*words, "--probe-basis", "cubemap:2").err)

    def test_wrong_values(self):
        scene = "jobs/cornell.glb"
        for words, sentence in {
            ("--undersample", "mipmap:5"): "--undersample: there is no sampling-window '5'; there is: 1, 2, 4",
            ("--undersample", "mipmap:"): "--undersample: there is no sampling-window ''",
            ("--undersample", "mipmip:4"): "--undersample: there is no undersample 'mipmip'",
            ("--gather", "even:x"): "--gather: 'x' is not a whole number",
            ("--gather", "even:2e6"): "--gather: 2e6 is out of range",
            ("--gather", "even:4:5"): "--gather: '4:5' is not a whole number",
            ("--subdivide", "0.1:16m"): "--subdivide: there is no node-max '16m'",
            ("--order", "lockstep:0.1"): "--order ...:0.1",
            ("--patches", "all:0.5"): "--patches ...:0.5: there are no links",
            ("--sampling-window", "2"): "--sampling-window: all texels send",
        }.items():
            answer = kiln("bake", scene, *PATCHES, *words, folder=os.getcwd())
            self.assertEqual(answer.code, 64, answer.err)
            self.assertIn(sentence, answer.sentence())
        answer = kiln("bake", self.job("method: radiosity\nvisibility: voxels:0\n"))
        self.assertEqual(answer.code, 65)
        self.assertIn("job.yaml:3: visibility: 0 is out of range", answer.sentence())

    def test_one_note_where_neither_counts(self):
        said = kiln("plan", "jobs/cornell.glb", "--probe-basis", "cubemap:16", "--texels-per-metre", "1").err
        self.assertEqual(said.count("does not count here"), 1, said)
        said = kiln("plan", "jobs/cornell.glb", "--probe-basis", "sh:16", "--tracing-range", "1", "--texels-per-metre",
                    "1").err
        self.assertIn("of --probe-basis what stands behind the colon does not count here", said)

    def test_help_has_the_present_form_alone(self):
        text = kiln("bake", "--help", "all").out
        for option, _, _, former, _ in PAIRS:
            self.assertIn(f"--{option} ", text)
            self.assertNotIn(f"--{former} ", text)


if __name__ == "__main__":
    unittest.main()
