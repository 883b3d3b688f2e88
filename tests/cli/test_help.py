"""--help: quick, as wide as the terminal, the options that most need first; its examples are command lines that kiln
accepts."""
import fcntl
import os
import pty
import re
import shlex
import struct
import subprocess
import termios
import unittest

from kiln_cli import COMMANDS, KILN, kiln, quickest

OPTION = r"(?m)^  (?:-o, )?(--[a-z-]+)"
LONG_LISTS = ["bake", "plan", "view", "relight", "bench"]


def options(text):
    return re.findall(OPTION, text)


class Help(unittest.TestCase):
    def test_overview_fits_one_screen_and_lists_every_command(self):
        for arguments in (["--help"], ["-h"], ["help"]):
            answer = quickest(*arguments)
            self.assertEqual(answer.code, 0)
            self.assertEqual(answer.err, "")
            self.assertLess(answer.seconds, 0.2)
            self.assertLessEqual(len(answer.out.splitlines()), 24)
            self.assertLessEqual(max(map(len, answer.out.splitlines())), 80)
            for command in COMMANDS:
                self.assertRegex(answer.out, rf"(?m)^  {command} +\w")

    def test_every_command_has_its_screen_in_three_ways(self):
        for command in COMMANDS:
            for all in ([], ["all"]):
                screens = [kiln(command, "--help", *all), kiln("help", command, *all), kiln("--help", command, *all),
                           kiln(command, "--nonsense", "-h", *all)]
                for screen in screens:
                    self.assertEqual(screen.code, 0)
                    self.assertEqual(screen.out, screens[0].out)
        everything = kiln("--help", "all").out
        for command in COMMANDS:
            self.assertIn(kiln(command, "--help", "all").out, everything)

    def test_each_screen_says_what_the_command_does_and_where_the_rest_is(self):
        for command in COMMANDS:
            text = kiln(command, "--help").out
            paragraphs = text.split("\n\n")
            self.assertRegex(paragraphs[0], rf"^kiln {command}: [a-z][^.]+( \S+)*\.$")
            self.assertRegex(paragraphs[1], rf"^Usage: kiln {command} ")
            self.assertRegex(paragraphs[2], r"^Examples?\n")
            self.assertIn(len(re.findall(r"(?m)^  kiln |^  mpirun ", paragraphs[2])), (1, 2))
            last = " ".join(paragraphs[-1].split())
            if command in LONG_LISTS:
                every = options(kiln(command, "--help", "all").out)
                self.assertEqual(last, f"These are {len(options(text))} of {len(every)} options: kiln {command} --help "
                                       "all shows the rest.")
                self.assertLess(set(options(text)), set(every))
                self.assertLess(len(options(text)), 31)
            else:
                self.assertIn("kiln --help lists the other commands", last)
                self.assertEqual(options(text), options(kiln(command, "--help", "all").out))

    def test_the_first_screen_of_bake(self):
        found = options(kiln("bake", "--help").out)
        self.assertTrue(25 <= len(found) <= 30, f"{len(found)} options")
        self.assertEqual(found[:3], ["--quality", "--texels-per-metre", "--output"])

    def test_output_is_told_for_each_command(self):
        told = {}
        for command in COMMANDS:
            text = " ".join(kiln(command, "--help").out.split())
            found = re.search(r"-o, --output PATH (.*?(?:\(default[ :].*?\)|must be given))", text)
            if found:
                self.assertLess(len(found[1]), 100, command)
                told[command] = found[1]
            self.assertEqual(found is not None, "--output" in text, command)
        self.assertEqual((len(told), len(set(told.values()))), (12, 12))
        self.assertIn("DIR/view.png", " ".join(kiln("view", "--help").out.split()))

    def test_lines_are_as_long_as_the_terminal_is_wide(self):
        for command in [*COMMANDS, None]:
            words = {}
            for columns in (60, 80, 100, 200):
                text = kiln(*([command] if command else []), "--help", "all", columns=columns).out
                longest = max(map(len, text.splitlines()))
                self.assertLessEqual(longest, min(columns, 100), f"{command} at {columns}")
                words[columns] = text.replace("\\\n", " ").split()
            self.assertEqual(words[80], words[100], "lines end between words")
            self.assertEqual(words[200], words[100])
            self.assertEqual("".join(words[60]), "".join(words[100]))
            for word in set(words[60]) - set(words[100]):  # too long for a line
                self.assertTrue("|" in word or "]" in word, word)

    def test_a_terminal_is_asked_for_its_width(self):
        environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
        for columns in (66, 90):
            ours, theirs = pty.openpty()
            fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
            process = subprocess.Popen([KILN, "stop", "--help"], stdout=theirs, env=environment)
            os.close(theirs)
            text = b""
            try:
                while piece := os.read(ours, 65536):
                    text += piece
            except OSError:  # the other end is closed
                pass
            os.close(ours)
            self.assertEqual(process.wait(), 0)
            self.assertEqual(text.decode().replace("\r\n", "\n"), kiln("stop", "--help", columns=columns).out)
        self.assertNotEqual(kiln("stop", "--help", columns=66).out, kiln("stop", "--help", columns=90).out)

    def test_every_option_says_what_it_does(self):
        for command in COMMANDS:
            text = kiln(command, "--help", "all", columns=100).out
            found = re.findall(OPTION + r"(?: \S+)?(?: {2,}|\n {20,})(\S.*)$", text)
            self.assertEqual(len(found), len(options(text)), f"an option of {command} without help")
            for name, words in found:
                self.assertGreater(len(words), 5, name)

    def test_numbers_show_unit_and_default(self):
        text = " ".join(kiln("bake", "--help", "all").out.split())
        for pattern in (r"--cell-size METRES\|auto [^-]*default auto", r"--bounces N\|all .*?default all",
                        r"--lightmap-max TEXELS [^-]*default 4096", r"--environment-rotation DEGREES [^-]*default 0",
                        r"--stitch [^-]*default on; --no-stitch", r"production 2 % 256 16 512 256",
                        r"--undersample none\|stride\|random\|mipmap\[:W\] .*; W: texels a side of a window "
                        r"\(default none, W 4\)"):
            self.assertRegex(text, pattern)

    def test_examples_are_accepted(self):
        """Each example is understood: it may fail for want of a file (66), never for its wording (64)."""
        examples = 0
        for command in COMMANDS:
            text = kiln(command, "--help", "all").out.replace(" \\\n", "")
            for line in text[text.index("Example"):].split("\n\n")[0].splitlines()[1:]:
                words = shlex.split(line)
                words = words[words.index("kiln") + 1:words.index("<") if "<" in words else None]
                if words[0] != command:
                    continue  # what comes before it; its own screen has it
                if command == "generate" or "--devices" in words or "stability" in words:
                    continue  # would do it; test_generate.py and test_devices.py do
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
