"""Completion for bash and the manual page, which are made of the table of options."""
import os
import re
import shutil
import subprocess
import tempfile
import unittest

from kiln_cli import COMMANDS, KILN, kiln

# Prints the replies for a command line, whose last word is being written.
COMPLETE = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
_kiln
printf '%s\\n' "${COMPREPLY[@]}"
"""


class Completion(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = cls.enterClassContext(tempfile.TemporaryDirectory())
        cls.script = os.path.join(cls.folder, ".kiln.bash")
        answer = kiln("--completion", "bash")
        assert answer.code == 0, answer.err
        with open(cls.script, "w") as file:
            file.write(answer.out)
        for name in ("room.glb", "room.txt", "two words.glb", "job.yaml"):
            with open(os.path.join(cls.folder, name), "w"):
                pass
        os.mkdir(os.path.join(cls.folder, "out"))

    def replies(self, *words):
        done = subprocess.run(["bash", "-c", COMPLETE, "bash", self.script, "kiln", *words], cwd=self.folder,
                              capture_output=True, text=True, check=True)
        self.assertEqual(done.stderr, "")
        return [line for line in done.stdout.splitlines() if line != ""]

    def test_commands(self):
        self.assertEqual(self.replies("bak"), ["bake"])
        self.assertEqual(sorted(COMMANDS), [word for word in self.replies("") if word[0] != "-" and word != "help"])
        self.assertEqual(self.replies("help", "ver"), ["verify"])

    def test_every_option_of_every_command(self):
        for command in COMMANDS:
            text = kiln(command, "--help", "all").out
            wanted = set(re.findall(r"(?m)^  (?:-o, )?--([a-z-]+)", text)) | {"help"}
            found = {word[2:] for word in self.replies(command, "--")}
            self.assertEqual({name.removeprefix("no-") for name in found}, wanted, command)
        self.assertEqual(self.replies("bake", "--no-st"), ["--no-stitch"])

    def test_values(self):
        self.assertEqual(self.replies("bake", "--quality", ""), ["draft", "preview", "production", "reference"])
        self.assertEqual(self.replies("bake", "--quality", "pro"), ["production"])
        self.assertEqual(self.replies("bake", "--quality", "=", "pro"), ["production"])
        self.assertEqual(self.replies("bake", "--quality=pro"), ["--quality=production"])
        self.assertEqual(self.replies("view", "--method", "light"), ["light", "lightmaps"])
        self.assertEqual(self.replies("bake", "--method", "li"), [])
        self.assertEqual(self.replies("view", "--show", "tex"), ["texels"])
        self.assertEqual(self.replies("bake", "--undersample", "mip"), ["mipmap"])
        self.assertEqual(self.replies("bake", "--seed", ""), [])
        self.assertEqual(self.replies("bake", "--help", ""), ["all"])

    def test_names_of_files(self):
        self.assertEqual(self.replies("bake", ""), ["job.yaml", "out", "room.glb", "two words.glb"])
        self.assertEqual(self.replies("bake", "room.glb", "-o", "r"), ["room.glb", "room.txt"])
        self.assertEqual(self.replies("report", ""), ["out"])
        self.assertEqual(self.replies("bake", "--strict", "ro"), ["room.glb"])

    def test_words_that_are_arguments(self):
        self.assertEqual(self.replies("generate", "furn"), ["furnace"])
        sentence = kiln("bench", "nothing", "jobs/cornell.glb").sentence()
        named = sorted(re.search("there are: (.*)$", sentence)[1].split(", "))
        found = self.replies("bench", "")
        self.assertEqual([word for word in found if word in named], named)
        self.assertEqual([word for word in found if word not in named],
                         ["job.yaml", "out", "room.glb", "two words.glb"])

    def test_bash_alone(self):
        for words in (["--completion"], ["--completion", "fish"]):
            answer = kiln(*words)
            self.assertEqual(answer.code, 64)
            self.assertIn("kiln --completion bash", answer.sentence())

    def test_the_build_has_made_it(self):
        path = os.path.join(os.path.dirname(KILN), "kiln.bash")
        if not os.path.exists(path):
            self.skipTest("kiln alone was built")
        with open(path) as made, open(self.script) as wanted:
            self.assertEqual(made.read(), wanted.read())


class Man(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = cls.enterClassContext(tempfile.TemporaryDirectory())
        cls.page = os.path.join(folder, "kiln.1")
        answer = kiln("--man")
        assert answer.code == 0, answer.err
        with open(cls.page, "w") as file:
            file.write(answer.out)

    def rendered(self):
        """The page as text, without a warning."""
        if shutil.which("man"):
            words = ["man", "--warnings", "--local-file", self.page]
        elif shutil.which("groff"):
            words = ["groff", "-man", "-ww", "-Tutf8", "-P-cbou", self.page]
        else:
            self.skipTest("there is neither man nor groff")
        environment = dict(os.environ, MANWIDTH="100", LC_ALL="C.UTF-8", MANPAGER="cat")
        done = subprocess.run(words, capture_output=True, text=True, env=environment)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return re.sub(".\b", "", done.stdout)

    def test_it_has_all_commands_and_options(self):
        text = self.rendered()
        for command in COMMANDS:
            self.assertRegex(text, rf"(?m)^ +kiln {command} \S")
            for name in re.findall(r"(?m)^  (?:-o, )?(--[a-z-]+)", kiln(command, "--help", "all").out):
                self.assertRegex(text, rf"(?m)^ +(-o, )?{name}( |$)")
        for words in ("kiln mix out --set '*=0' --set screen=0,0.2,1 -o screen", "DIR/view.png", "EXIT STATUS",
                      "finer where charts lie", "~/.cache/kiln"):
            self.assertIn(words, text)

    def test_the_build_has_made_it(self):
        path = os.path.join(os.path.dirname(KILN), "kiln.1")
        if not os.path.exists(path):
            self.skipTest("kiln alone was built")
        with open(path) as made, open(self.page) as wanted:
            self.assertEqual(made.read(), wanted.read())


if __name__ == "__main__":
    unittest.main()
