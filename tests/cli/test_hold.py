"""KILN_HOLD=FILE: a bake lasts until what is to happen to it has happened, on any machine; it can be stopped and goes
on, with the same bits."""
import json
import os
import pathlib
import signal
import subprocess
import tempfile
import time
import unittest

from kiln_cli import KILN, kiln

SMALL = ["--backend", "embree", "--quality", "draft", "--lightmap-size", "8", "--threads", "1", "--samples-probe", "0",
         "--no-preview", "--no-export", "--quiet"]


class Hold(unittest.TestCase):
    def test_a_held_bake_stops_and_goes_on(self):
        with tempfile.TemporaryDirectory() as folder:
            scene, out, alone, held = (os.path.join(folder, name) for name in ("cornell.glb", "out", "alone", "held"))
            kiln("generate", "cornell", "-o", scene)
            self.assertEqual(kiln("bake", scene, "-o", alone, *SMALL).code, 0)
            open(held, "w").close()
            words = [KILN, "bake", scene, "-o", out, *SMALL]
            bake = subprocess.Popen(words, env={**os.environ, "KILN_HOLD": held}, stderr=subprocess.PIPE, text=True)
            end = time.monotonic() + 60
            while not json.loads(kiln("status", out, "--json").out or "{}").get("phase", "").startswith(
                    ("bounce", "final gather")):
                self.assertIsNone(bake.poll(), "the bake is not held")
                self.assertLess(time.monotonic(), end, kiln("status", out).out)
                time.sleep(0.1)
            self.assertRaises(subprocess.TimeoutExpired, bake.wait, 0.5)
            bake.send_signal(signal.SIGUSR1)
            self.assertIn("the same command goes on from it", bake.communicate(timeout=60)[1])
            self.assertEqual(bake.returncode, 75)
            bake = subprocess.Popen(words, env={**os.environ, "KILN_HOLD": held})
            self.assertRaises(subprocess.TimeoutExpired, bake.wait, 1.0)
            os.remove(held)
            self.assertEqual(bake.wait(timeout=60), 0)
            for name in sorted(os.listdir(os.path.join(alone, "lightmaps"))):
                one, other = (pathlib.Path(f, "lightmaps", name).read_bytes() for f in (alone, out))
                self.assertEqual(one, other, name)


if __name__ == "__main__":
    unittest.main()
