"""What kiln makes of its surroundings: text from scenes on a terminal, closed descriptors, limits on files, signals,
numbers without bounds."""
import json
import os
import re
import resource
import signal
import struct
import subprocess
import tempfile
import time
import unittest

from kiln_cli import KILN, kiln

SMALL = ["--backend", "embree", "--quality", "draft", "--lightmap-size", "16", "--bounces", "1", "--threads", "1",
         "--samples-probe", "1"]
FORGED = "kiln: 12 files: all as they were written"
EVIL = f"\x1b[31mX\n{FORGED}\u202e\u009b2J\x7f"
ACTS = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")


def renamed(data):
    """A .glb whose names would all like to write on the terminal."""
    length, = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20:20 + length])
    for kind in ("nodes", "meshes", "materials", "cameras"):
        for thing in document.get(kind, []):
            thing["name"] = EVIL + kind
    document["extensionsUsed"] = [EVIL]
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length:]
    return data[:8] + struct.pack("<II", 20 + len(text) + len(rest), len(text)) + data[16:20] + text + rest


class Manners(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = cls.enterClassContext(tempfile.TemporaryDirectory())
        cls.scene, cls.evil, cls.out = (os.path.join(cls.folder, name) for name in ("cornell.glb", "evil.glb", "evil"))
        subprocess.run([KILN, "generate", "cornell", "-o", cls.scene], check=True, stdout=subprocess.DEVNULL)
        with open(cls.scene, "rb") as source, open(cls.evil, "wb") as target:
            target.write(renamed(source.read()))
        cls.baked = kiln("bake", cls.evil, "-o", cls.out, *SMALL)

    def test_names_write_nothing_on_the_terminal(self):
        self.assertEqual(self.baked.code, 0, self.baked.err)
        picture = os.path.join(self.folder, "view.png")
        answers = [self.baked, *(kiln(*words) for words in (
            ["info", self.evil, "--verbose"], ["check", self.evil], ["view", self.out, "-o", picture, "--width", "16"],
            ["view", self.out, "--camera", EVIL],
            ["compare", self.out, self.out], ["verify", self.out],
            ["export", self.out, "-o", os.path.join(self.folder, "exported", "scene.glb")],
            ["info", EVIL], ["bake", self.scene, f"--{EVIL}"], ["bake", self.scene, "--quality", EVIL], [EVIL],
            ["bake", self.scene, "-o", f"{self.out}/{EVIL}/\0"[:-1] + "/x" * 2100]))]
        for answer in answers:
            for text in (answer.out, answer.err):
                self.assertIsNone(ACTS.search(text), repr(text))
                self.assertNotIn(FORGED, text.splitlines())
        self.assertTrue(any("\\x1b[31mX\\x0a" in answer.out + answer.err for answer in answers))

    def test_names_write_nothing_in_pages(self):
        """Whoever prints one on a terminal is as safe."""
        page = os.path.join(self.folder, "report.html")
        self.assertEqual(kiln("report", self.out, "-o", page).code, 0)
        with open(page, encoding="utf-8") as file:
            text = file.read()
        self.assertTrue("\\x1b[31mX" in text)
        self.assertTrue(ACTS.search(text) is None)

    def test_threads_sleep_while_they_wait(self):
        """Unless the environment says otherwise. OpenMP's library says what it has read."""
        for wish, policy in (({}, "PASSIVE"), ({"OMP_WAIT_POLICY": "active"}, "ACTIVE")):
            others = {name: value for name, value in os.environ.items() if name != "OMP_WAIT_POLICY"}
            said = subprocess.run([KILN, "--version"], env={**others, **wish, "OMP_DISPLAY_ENV": "verbose"},
                                  capture_output=True, text=True, timeout=60).stderr
            self.assertRegex(said, f"OMP_WAIT_POLICY *= *'{policy}'")
            turns = re.search("GOMP_SPINCOUNT = '([0-9]+)'", said)  # of GCC's library, which calls its default passive
            if turns is not None:
                self.assertEqual(turns[1] == "0", policy == "PASSIVE", said)

    def test_status_of_text_that_was_cut(self):
        place = os.path.join(self.folder, "cut")
        os.makedirs(os.path.join(place, "checkpoint"))
        with open(os.path.join(place, "checkpoint", "status.json"), "w") as file:
            json.dump({"state": "ééééééééé", "phase": "\x1b[2J" + "é" * 40, "host": "é" * 40,
                       "message": "x" + "é" * 400, "code": 75}, file)
        answer = kiln("status", place, "--json")
        self.assertEqual(answer.code, 0, answer.err)
        self.assertTrue(json.loads(answer.out)["message"].endswith("é"))
        self.assertEqual(json.loads(answer.out)["status"], "ééééééé")  # and not done
        self.assertIsNone(ACTS.search(kiln("status", place).out))

    def test_closed_descriptors_are_nobody_elses(self):
        """Their numbers would go to the next file or pipe, and what is meant for a person into it."""
        out = os.path.join(self.folder, "closed")
        done = subprocess.run(["mpirun", "-n", "2", "sh", "-c",
                               f"exec {KILN} bake {self.scene} -o {out} --no-export {' '.join(SMALL)} <&- >&- 2>&-"],
                              stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 74, done.stderr)  # the table could not be printed
        self.assertNotIn("surface points", done.stdout + done.stderr)
        self.assertEqual(kiln("verify", out).code, 0)
        for closed in ("2>&-", "<&- >&- 2>&-"):
            done = subprocess.run(["sh", "-c", f"{KILN} info {self.scene} {closed}"], stdin=subprocess.DEVNULL,
                                  capture_output=True, timeout=60)
            self.assertEqual(done.returncode, 74 if ">&-" in closed.replace("2>&-", "") else 0, closed)

    def test_a_limit_on_files_is_said(self):
        def limited():
            resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
        for words in (["generate", "cornell", "-o", os.path.join(self.folder, "large.glb")],
                      ["bake", self.scene, "-o", os.path.join(self.folder, "limited"), *SMALL],
                      ["info", self.scene], ["view", self.out, "-o", os.path.join(self.folder, "large.png")]):
            done = subprocess.run([KILN, *words], stdin=subprocess.DEVNULL, capture_output=True, text=True,
                                  preexec_fn=limited, timeout=60)
            self.assertEqual(done.returncode, 74, done.stderr)
            self.assertIn("at most 4096 bytes (ulimit -f)", done.stderr)

    def test_what_cannot_be_printed_is_said(self):
        def broken():
            signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        for words in (["help"], ["info", self.scene], ["info", self.scene, "--json"], ["verify", self.out, "--json"],
                      ["bake", "--help"]):
            with open("/dev/full", "w") as full:
                done = subprocess.run([KILN, *words], stdin=subprocess.DEVNULL, stdout=full, stderr=subprocess.PIPE,
                                      text=True, timeout=60)
            self.assertEqual(done.returncode, 74, done.stderr)
            self.assertIn("cannot write to stdout: No space left on device", done.stderr)
            reads, writes = os.pipe()
            os.close(reads)
            done = subprocess.run([KILN, *words], stdin=subprocess.DEVNULL, stdout=writes, stderr=subprocess.PIPE,
                                  text=True, timeout=60, preexec_fn=broken, restore_signals=False)
            os.close(writes)
            self.assertEqual(done.returncode, 74, done.stderr)
            self.assertIn("cannot write to stdout: Broken pipe", done.stderr)

    def test_a_limit_on_the_stack_is_said(self):
        """The soft limit is raised; a hard one that is too low is told."""
        for hard in (512 << 10, 1 << 20, 64 << 20):
            out = os.path.join(self.folder, f"stack{hard}")

            def limited():
                resource.setrlimit(resource.RLIMIT_STACK, (512 << 10, hard))
            for words in (["plan", self.scene], ["bake", self.scene, "-o", out, *SMALL]):
                done = subprocess.run([KILN, *words], stdin=subprocess.DEVNULL, capture_output=True, text=True,
                                      preexec_fn=limited, timeout=60)
                self.assertEqual(done.returncode, 0 if hard > 4 << 20 else 71, done.stderr)
                if hard < 4 << 20:
                    self.assertIn(f"the stack may have {hard >> 10} KiB, and kiln needs 4096: raise the limit first "
                                  "(ulimit -s 4096)", done.stderr)

    def test_zero_is_zero(self):
        answer = kiln("info", self.scene, "--environment", "1,1,1", "--environment-scale", "0")
        self.assertRegex(answer.out, r"(?m)^  environment  none")
        answer = kiln("bake", self.scene, "-o", os.path.join(self.folder, "never"), "--max-time", "0")
        self.assertEqual(answer.code, 64)
        self.assertRegex(answer.sentence(), "--max-time: 0 is out of range; .* or none")

    def test_numbers_have_bounds(self):
        for words, code, pattern in ((["view", self.out, "--from", "1e19,0,0"], 64, "1e\\+19 is out of range"),
                                     (["view", self.out, "--to", "0,-1e300,0"], 64, "out of range"),
                                     (["bake", self.scene, "--environment", "1e19,1,1"], 64,
                                      "radiance of 1e\\+19 is out of range; .* from 0 to 1e\\+15"),
                                     (["info", self.scene, "--environment", "1e15,1e15,1e15", "--environment-scale",
                                       "1e3"], 64, "radiance into 1e\\+18")):
            answer = kiln(*words)
            self.assertEqual(answer.code, code, answer.err)
            self.assertRegex(answer.sentence(), pattern)
        answer = kiln("view", self.out, "--from", "1e15,0,0", "-o", os.path.join(self.folder, "far.png"), "--width",
                      "16")
        self.assertEqual(answer.code, 0, answer.err)

    def test_advice_can_be_followed(self):
        answer = kiln("bake", self.scene, "-o", os.path.join(self.folder, "cells"), "--cell-size", "1e-9", *SMALL)
        self.assertEqual(answer.code, 65)
        advised = re.search("--cell-size ([-0-9.e]+) would do, or auto", answer.sentence()).group(1)
        self.assertEqual(kiln("bake", self.scene, "-o", os.path.join(self.folder, "cells"), "--cell-size", advised,
                              "--no-preview", "--no-export", *SMALL).code, 0)

    def test_what_can_be_refused_is_refused_before_the_first_ray(self):
        out = os.path.join(self.folder, "refused")
        os.makedirs(os.path.join(out, "preview.png"))
        answers = [kiln("bake", self.scene, "-o", out, *SMALL)]
        os.rename(os.path.join(out, "preview.png"), os.path.join(out, "mine"))
        answers.append(kiln("bake", self.scene, "-o", out, *SMALL, "--probe-spacing", "1e-4"))
        for answer, code, word in zip(answers, (73, 64), ("preview.png' is in the way: it is no plain file",
                                                          "use a larger --probe-spacing")):
            self.assertEqual(answer.code, code, answer.err)
            self.assertIn(word, answer.sentence())
            self.assertNotRegex(answer.err, "(?m)^(validity|emission|direct light)")

    def test_signals_at_any_time(self):
        """From the begin of main on a bake notes them; what nohup ignores stays ignored; other commands that
        write files end at once."""
        def started(process):
            return subprocess.run(["grep", "-q", "^SigCgt:.*[1-9a-f]", f"/proc/{process.pid}/status"]).returncode == 0
        for number in (signal.SIGHUP, signal.SIGUSR1, signal.SIGTERM):
            out = os.path.join(self.folder, f"signal{number}")
            process = subprocess.Popen([KILN, "bake", self.scene, "-o", out, *SMALL], stdout=subprocess.DEVNULL,
                                       stderr=subprocess.PIPE, text=True)
            while not started(process) and process.poll() is None:
                time.sleep(0.001)
            process.send_signal(number)
            error = process.communicate(timeout=60)[1]
            self.assertEqual(process.returncode, 75, error)
            self.assertRegex(error, f"stopped by {number.name} before any light was computed: there is nothing to keep")
        process = subprocess.Popen(["nohup", KILN, "bake", self.scene, "-o", os.path.join(self.folder, "nohup"),
                                    "--no-preview", "--no-export", *SMALL], stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        while not started(process) and process.poll() is None:
            time.sleep(0.001)
        process.send_signal(signal.SIGHUP)
        process.communicate(timeout=60)
        self.assertEqual(process.returncode, 0)
        process = subprocess.Popen([KILN, "generate", "city", "--triangles", "300000", "--json", "-o",
                                    os.path.join(self.folder, "city.glb")],
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        while not started(process) and process.poll() is None:
            time.sleep(0.001)
        process.send_signal(signal.SIGTERM)
        said, error = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 75, error)
        self.assertEqual(error, "kiln: stopped by SIGTERM; the same command starts again\n")
        self.assertEqual(json.loads(said), {"status": "stopped", "code": 75, "message": error[len("kiln: "):-1]})
        self.assertEqual([name for name in os.listdir(self.folder) if "city" in name], [])


if __name__ == "__main__":
    unittest.main()
