"""--help: quick, complete, and its examples are command lines that kiln accepts."""
import os
import re
import shlex
import subprocess
import unittest

from kiln_cli import COMMANDS, KILN, kiln, quickest


class Help(unittest.TestCase):
    def test_overview_fits_one_screen_and_lists_every_command(self):
        for arguments in (["--help"], ["-h"], ["help"]):
            answer = quickest(*arguments)
            self.assertEqual(answer.code, 0)
            self.assertEqual(answer.err, "")
            self.assertLess(answer.seconds, 0.2)
            self.assertLessEqual(len(answer.out.splitlines()), 24)
            self.assertLessEqual(max(map(len, answer.out.splitlines())), 100)
            for command in COMMANDS:
                self.assertRegex(answer.out, rf"(?m)^  {command} +\w")

    def test_every_command_has_its_screen_in_three_ways(self):
        for command in COMMANDS:
            screens = [kiln(command, "--help"), kiln("help", command), kiln("--help", command),
                       kiln(command, "--nonsense", "-h")]
            for screen in screens:
                self.assertEqual(screen.code, 0)
                self.assertEqual(screen.out, screens[0].out)
            self.assertIn(f"Usage: kiln {command} ", screens[0].out)
            self.assertLess(screens[0].out.index("Examples"), screens[0].out.index("--json"), "examples come first")

    def test_every_option_says_what_it_does(self):
        for command in COMMANDS:
            text = kiln(command, "--help").out
            options = re.findall(r"(?m)^  (--[a-z-]+)(?: \S+)?(?: {2,}|\n {20,})(\S.*)$", text)
            self.assertEqual(len(options), len(re.findall(r"(?m)^  --", text)), f"an option of {command} without help")
            for name, words in options:
                self.assertGreater(len(words), 5, name)

    def test_numbers_show_unit_and_default(self):
        text = kiln("bake", "--help").out
        for pattern in (r"--cell-size METRES\|auto .*default auto", r"--bounces N\|all .*default all",
                        r"--lightmap-max TEXELS .*default 4096", r"--environment-rotation DEGREES\n? .*default 0",
                        r"--stitch .*default on; --no-stitch", r"production +256 +16 +512 +256"):
            self.assertRegex(text, pattern)

    def test_examples_are_accepted(self):
        """Each example is understood: it may fail for want of a file (66), never for its wording (64)."""
        examples = 0
        for command in COMMANDS:
            text = kiln(command, "--help").out
            for line in text[text.index("Examples"):].split("\n\n")[0].splitlines()[1:]:
                words = shlex.split(line)
                words = words[words.index("kiln") + 1:]
                self.assertEqual(words[0], command)
                if command == "generate" or "--devices" in words or "stability" in words:
                    continue  # would do it; test_generate.py, test_devices.py and test_stability.py do
                answer = kiln(*words, folder="/proc/self")
                self.assertNotIn(answer.code, (0, 64, 70), f"{line}: {answer.err}")
                examples += 1
        self.assertGreater(examples, 12)

    def test_version(self):
        answer = kiln("--version")
        self.assertEqual(answer.code, 0)
        self.assertRegex(answer.out, r"^kiln \d+\.\d+\.\d+\n$")

    def test_a_full_disk_is_noticed(self):
        with open("/dev/full", "w") as full:
            answer = kiln("--help", stdout=full)
        self.assertEqual(answer.code, 74)
        self.assertIn("stdout", answer.sentence())

    def test_it_starts_no_mpi(self):
        """With a launcher's variables that lead nowhere MPI would fail or hang."""
        environment = dict(os.environ, OMPI_COMM_WORLD_RANK="1", OMPI_COMM_WORLD_SIZE="4", PMIX_RANK="1")
        done = subprocess.run([KILN, "bake", "--help"], env=environment, capture_output=True, timeout=10)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, b"", b""), "only rank 0 speaks")


if __name__ == "__main__":
    unittest.main()
