"""How files are read: --up, --unit and --strict, on the command line, in job files and in --help."""
import json
import os
import unittest

from kiln_cli import InOwnFolder, kiln

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 2 3\nf 1 2 3\n"


class Files(InOwnFolder):
    def setUp(self):
        super().setUp()
        self.write("a.obj", TRIANGLE)

    def write(self, name, text):
        with open(os.path.join(self.folder, name), "w") as file:
            file.write(text)

    def bounds(self, *arguments):
        answer = kiln("info", *arguments, "--json", "--lightmap-size", 2, folder=self.folder)
        self.assertEqual(answer.code, 0, answer.err)
        return [round(v, 6) for v in json.loads(answer.out)["bounds"]["max"]]

    def test_help(self):
        text = kiln("info", "--help", "all").out
        for words in ("--up", "--unit METRES", "--strict", "us-ft"):
            self.assertIn(words, text)

    def test_command_line_and_job_file(self):
        self.assertEqual(self.bounds("a.obj"), [1, 2, 3])
        self.assertEqual(self.bounds("a.obj", "--up", "z", "--unit", "in"), [0.0254, 0.0762, 0])
        self.write("job.yaml", "scene: a.obj\nup: z\nunit: mm\n")
        self.assertEqual(self.bounds("job.yaml"), [0.001, 0.003, 0])
        self.assertEqual(self.bounds("job.yaml", "--unit", "10", "--up", "y"), [10, 20, 30])
        self.write("job.yaml", "scene: a.obj\nunit: 0.5\nstrict: true\n")
        self.assertEqual(self.bounds("job.yaml"), [0.5, 1, 1.5])

    def test_refused(self):
        for arguments, code, words in ((("--unit", "furlong"), 64, "us-ft"), (("--unit", "0"), 64, "out of range"),
                                       (("--up", "x"), 64, "y, z")):
            answer = kiln("info", "a.obj", *arguments, folder=self.folder)
            self.assertEqual(answer.code, code, answer.err)
            self.assertIn(words, answer.err)
        self.write("job.yaml", "scene: a.obj\nunit: elle\n")
        answer = kiln("info", "job.yaml", folder=self.folder)
        self.assertEqual(answer.code, 65)
        self.assertIn("job.yaml:2: unit: 'elle'", answer.err)

    def test_of_no_use(self):
        """glTF says its axes and unit itself: what would not count is refused."""
        self.write("a.gltf", '{"asset": {"version": "2.0"}}')
        for arguments in (("--up", "z"), ("--unit", "cm")):
            answer = kiln("info", "a.gltf", *arguments, folder=self.folder)
            self.assertEqual(answer.code, 64, answer.err)
            self.assertIn("--up and --unit are for OBJ files", answer.err)


if __name__ == "__main__":
    unittest.main()
