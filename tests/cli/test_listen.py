"""kiln relight --listen beside what is not well-behaved: lines that are no text, a folder as standard input, and a
reader of the answers that does not read."""
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import unittest

from kiln_cli import KILN, kiln

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402

PIPE = 65536  # bytes that a pipe holds


class Listen(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = cls.enterClassContext(tempfile.TemporaryDirectory())
        scene = glb.Scene()
        grey = scene.material("grey", (0.5, 0.5, 0.5))
        scene.quad("ground", [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], grey)
        scene.light("lamp", {"type": "point", "intensity": 10.0}, translation=[0, 1, 0])
        cls.kept = os.path.join(cls.folder, "kept")
        answer = kiln("bake", scene.write(os.path.join(cls.folder, "scene.glb")), "-o", cls.kept, "--keep-transport",
                      "rows", "--quality", "draft", "--texels-per-metre", "2", "--backend", "embree", "--samples-probe",
                      "0", "--threads", "1", "--no-preview", "--no-export", "--quiet")
        assert answer.code == 0, answer.err
        cls.words = [KILN, "relight", cls.kept, "--listen", "-o", os.path.join(cls.folder, "live"), "--threads", "1",
                     "--no-preview", "--no-export", "--quiet"]

    def answers(self, lines):
        done = subprocess.run(self.words, input=lines, capture_output=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        return {answer["line"]: answer for answer in map(json.loads, done.stdout.splitlines())}

    def test_what_is_no_single_document_is_answered(self):
        lines = [b"\0", b"\0{}", b"{}\0", b"{lights: {lamp: {scale: 2}}}\0 more", b"--- {} ... --- {}", b"{} {}", b"{}"]
        answers = self.answers(b"\n".join(lines))
        self.assertEqual(sorted(answers), list(range(1, 8)))
        for line in range(1, 5):
            self.assertEqual(answers[line]["status"], 65, answers[line])
            self.assertIn("a byte of value 0", answers[line]["error"])
        self.assertEqual([answers[line]["status"] for line in (5, 6, 7)], [65, 65, 0], answers)

    def test_a_second_document_in_a_file(self):
        for text, words in ((b"{}\n---\n{}\n", "a second document"), (b"{}\n\0more", "a byte of value 0")):
            path = os.path.join(self.folder, "changes.yaml")
            with open(path, "wb") as file:
                file.write(text)
            answer = kiln("relight", self.kept, path, "-o", os.path.join(self.folder, "never"), "--no-preview")
            self.assertEqual(answer.code, 65, answer.err)
            self.assertIn(words, answer.sentence())
            job = os.path.join(self.folder, "job.yaml")
            with open(job, "wb") as file:
                file.write(b"scene: scene.glb\n" + text[2:])
            answer = kiln("plan", job)
            self.assertEqual(answer.code, 65, answer.err)
            self.assertIn(words, answer.sentence())
        answer = kiln("plan", os.path.join(self.folder, "scene.glb"), "--objects", "{'*': {exclude: true}} --- {}")
        self.assertEqual(answer.code, 64, answer.err)

    def test_a_folder_is_no_input(self):
        folder = os.open(self.folder, os.O_RDONLY)
        self.addCleanup(os.close, folder)
        done = subprocess.run(self.words, stdin=folder, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 74, done.stderr)
        self.assertIn("standard input cannot be read: Is a directory", done.stderr)

    def test_it_ends_though_nobody_reads_its_answers(self):
        for number in (signal.SIGTERM, signal.SIGINT):
            with subprocess.Popen(self.words, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE) as run:
                self.addCleanup(run.kill)
                run.stdin.write(b"{\n" * (PIPE // 40))
                run.stdin.flush()
                filled = self.wait_until_full(run)
                run.send_signal(number)
                try:
                    run.wait(20)
                except subprocess.TimeoutExpired:
                    run.kill()
                    self.fail(f"signal {number} did not end it")
                self.assertTrue(filled)
                self.assertEqual(run.returncode, 75, run.stderr.read())

    @staticmethod
    def wait_until_full(run):
        """Whether the pipe of the answers gets full: poll(2) on a writing end of it says so."""
        end = os.open(f"/proc/{run.pid}/fd/1", os.O_WRONLY | os.O_NONBLOCK)
        try:
            for _ in range(600):
                if not select.select([], [end], [], 0)[1]:
                    return True
                select.select([], [], [], 0.05)
            return False
        finally:
            os.close(end)


if __name__ == "__main__":
    unittest.main()
