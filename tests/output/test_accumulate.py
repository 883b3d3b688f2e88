"""kiln view --accumulate: paths that are traced in several calls, on any ranks, give the same bits as at once;
also after signals, kills and damage. --max-time: the picture after a time."""
import glob
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import unittest

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import price  # noqa: E402
from program import KILN, InOneFolder, flat, kiln  # noqa: E402

SMALL = ("--width", "24", "--height", "20", "--materials", "auto", "--backend", "embree")
LONG = ("--width", "120", "--height", "90", "--backend", "embree", "--method", "path")
STOPPED, BAD_INPUT, USAGE = 75, 65, 64


class Accumulate(InOneFolder):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.generated = os.path.join(cls.folder, "spheres.glb")
        kiln("generate", "cornell-spheres", "-o", cls.generated, "--quiet")
        cls.scene = flat(cls.generated, os.path.join(cls.folder, "flat"))

    def setUp(self):
        self.sums, self.out = (os.path.join(self.folder, name) for name in ("sums", "view.exr"))
        shutil.rmtree(self.sums, ignore_errors=True)

    def view(self, samples, *options, sums=None, **more):
        kiln("view", self.scene, "--samples-pixel", str(samples), "--accumulate", sums or self.sums, "-o", self.out,
             "--quiet", *options, **more)
        return exr.rgb(self.out)

    def at_once(self, samples, *options):
        sums = os.path.join(self.folder, "other")
        shutil.rmtree(sums, ignore_errors=True)
        return self.view(samples, *options, sums=sums)

    def test_same_bits(self):
        """29 paths a pixel at once; or 1, then 5, 22 on three ranks, which save twice, and 29."""
        for method in ("path", "vcm"):
            shutil.rmtree(self.sums, ignore_errors=True)
            options = (*SMALL, "--method", method)
            self.view(1, *options)
            self.view(5, *options)
            self.view(22, *options, "--threads", "1", "--checkpoint-every", "0.001", ranks=3)
            whole = self.at_once(29, *options)
            np.testing.assert_array_equal(self.view(29, *options), whole, method)
            # there are more already: those of whole rounds
            np.testing.assert_array_equal(self.view(3, *options), self.at_once(24, *options), method)
            plain = os.path.join(self.folder, "plain.exr")
            kiln("view", self.scene, "--samples-pixel", "29", "-o", plain, "--quiet", *options)
            self.assertLess(np.abs(exr.rgb(plain) - whole).max(), 1e-5 * whole.max(), method)

    def test_signals(self):
        """The picture and the sums that there are; the same command goes on."""
        self.stopped_by(signal.SIGINT)

    @price.long
    def test_another_signal(self):
        self.stopped_by(signal.SIGUSR1)

    def stopped_by(self, number):
        shutil.rmtree(self.sums, ignore_errors=True)
        command = [KILN, "view", self.scene, *LONG, "--samples-pixel", "100000", "--accumulate", self.sums, "-o",
                   self.out, "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            while not os.path.exists(os.path.join(self.sums, ".kiln.lock")) and process.poll() is None:
                time.sleep(0.05)
            time.sleep(0.7)
            process.send_signal(number)
            said = json.loads(process.communicate()[0])
        self.assertEqual((process.returncode, said["status"]), (STOPPED, "stopped"))
        words = said["message"].split()
        samples = int(words[words.index("has") + 1])
        self.assertTrue(0 < samples < 100000 and signal.Signals(number).name + ":" in words, said)
        stopped = exr.rgb(self.out)
        np.testing.assert_array_equal(self.at_once(samples, *LONG), stopped)
        np.testing.assert_array_equal(self.view(samples + 8, *LONG), self.at_once(samples + 8, *LONG))

    def test_kills(self):
        """Killed twice, some moment after a checkpoint."""
        command = [KILN, "view", self.scene, *LONG, "--samples-pixel", "100", "--accumulate", self.sums, "-o", self.out,
                   "--quiet", "--checkpoint-every", "0.01"]
        for seconds in (0.0, 0.1):
            before = set(glob.glob(os.path.join(self.sums, "checkpoint", "gen-*")))
            with subprocess.Popen(command) as process:
                while not set(glob.glob(os.path.join(self.sums, "checkpoint", "gen-*"))) - before:
                    self.assertIsNone(process.poll())
                    time.sleep(0.005)
                time.sleep(seconds)
                process.kill()
            self.assertEqual(process.returncode, -signal.SIGKILL)
        self.assertTrue(glob.glob(os.path.join(self.sums, "checkpoint", "gen-*")))
        np.testing.assert_array_equal(self.view(100, *LONG), self.at_once(100, *LONG))

    def test_damage(self):
        """A damaged checkpoint is noticed; the one before is used, if there is one."""
        options = (*SMALL, "--method", "bdpt")
        for samples in (8, 16):
            self.view(samples, *options)
        parts = sorted(glob.glob(os.path.join(self.sums, "checkpoint", "gen-*", "part-00000")))
        self.assertEqual(len(parts), 2)
        for part, code in ((parts[1], 0), (parts[0], BAD_INPUT)):
            with open(part, "r+b") as file:
                file.seek(200)
                byte = file.read(1)
                file.seek(200)
                file.write(bytes([byte[0] ^ 4]))
            if code == 0:
                kept = os.path.join(self.folder, "kept")
                shutil.rmtree(kept, ignore_errors=True)
                shutil.copytree(self.sums, kept)
                np.testing.assert_array_equal(self.view(24, *options, sums=kept), self.at_once(24, *options))
        said = kiln("view", self.scene, "--samples-pixel", "24", "--accumulate", self.sums, "-o", self.out, *options,
                    code=BAD_INPUT).stderr
        self.assertIn("damaged", said)
        np.testing.assert_array_equal(self.view(24, *options, "--no-resume"), self.at_once(24, *options))

    def test_refused(self):
        """What is kept is of another view: the table says which."""
        self.scene = self.generated  # which other surroundings can be given
        options = (*SMALL, "--method", "path")
        self.view(2, *options)
        for other, words in ((("--from=0,0,-5",), "camera's position"), (("--seed", "2"), "seed"),
                             (("--bounces", "1"), "bounces"), (("--path-length", "3"), "path-length"),
                             (("--lens-radius", "0.1"), "lens-radius"), (("--materials", "diffuse"), "materials"),
                             (("--environment", "1,1,1"), "scene content"), (("--width", "25"), "width"),
                             (("--method", "bdpt"), "method")):
            said = kiln("view", self.scene, "--accumulate", self.sums, "-o", self.out, *options, *other,
                        code=BAD_INPUT).stderr
            self.assertIn("\n  " + words, said)
        out = ("-o", self.out)
        bake = os.path.join(self.folder, "bake")
        kiln("bake", self.scene, "-o", bake, "--lightmap-size", "4", "--quality", "draft", "--samples-probe", "0",
             "--bounces", "0", "--no-preview", "--no-export", "--backend", "embree", "--quiet")
        several = ("--method", "path", "--camera", "camera,camera")
        for arguments, words in (((*several, "--accumulate", self.sums), "one picture"),
                                 ((*several, "--max-time", "1"), "one picture"),
                                 (("--method", "path", "--no-resume"), "--accumulate DIR"),
                                 (("--method", "path", "--accumulate", bake), "the folder of a bake")):
            self.assertIn(words, kiln("view", self.scene, *arguments, *out, code=USAGE).stderr)

    def test_time(self):
        """The time is kept, and the picture is that of as many paths."""
        said = json.loads(kiln("view", self.scene, *LONG, "--samples-pixel", "100000", "--max-time", "1.5", "-o",
                               self.out, "--json").stdout)
        self.assertEqual(said["status"], "done")
        self.assertTrue(0 < said["samples"] < 100000 and said["seconds"] < 3.0, said)
        timed = exr.rgb(self.out)
        np.testing.assert_array_equal(timed, self.at_once(said["samples"], *LONG))


if __name__ == "__main__":
    unittest.main()
