"""cmake --install: the program, the jobs and the pages in one folder, from which a user bakes."""
import json
import os
import pathlib
import subprocess
import tempfile
import unittest

from hosts import bits

KILN = pathlib.Path(os.environ["KILN"])
PROJECT = pathlib.Path(__file__).resolve().parents[2]
THERE = ["bin/kiln", "share/doc/kiln/README.md", "share/doc/kiln/CHANGELOG.md", "share/doc/kiln/LICENSE",
         "share/doc/kiln/jobs/manual/quality.md", "share/doc/kiln/cluster/HOSTS.md", "share/kiln/jobs/cornell.yaml",
         "share/kiln/jobs/cornell.glb", "share/kiln/jobs/recipes/volume.py", "share/kiln/cluster/mpi-environment.sh",
         "share/kiln/cluster/examples/plain.sbatch"]
# What a build has only where its rules are: where it goes.
MADE = {"kiln.1": "share/man/man1/kiln.1", "kiln.bash": "share/bash-completion/completions/kiln",
        "kiln-float.kernels": "lib/kiln/kiln-float.kernels"}


class Install(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory(prefix="kiln-install-")))
        self.prefix = self.folder / "a place"
        subprocess.run(["cmake", "--install", KILN.parent, "--prefix", self.prefix], check=True, capture_output=True)

    def test_files(self):
        for name in THERE:
            self.assertTrue((self.prefix / name).is_file(), name)
        for name, place in MADE.items():
            self.assertEqual((KILN.parent / name).exists(), (self.prefix / place).exists(), place)
        self.assertEqual((PROJECT / "jobs/studies").is_dir(), (self.prefix / "share/kiln/studies").is_dir())
        self.assertEqual(list(self.prefix.rglob("__pycache__")), [])

    def test_bake(self):
        job = self.prefix / "share/kiln/jobs/cornell.yaml"
        options = ["--quality", "draft", "--texels-per-metre", "4", "--backend", "embree", "--quiet"]
        for program, name in ((self.prefix / "bin/kiln", "installed"), (KILN, "built")):
            subprocess.run([program, "bake", job, "-o", self.folder / name, *options], check=True)
        self.assertEqual(bits(self.folder / "installed"), bits(self.folder / "built"))
        self.assertEqual(json.loads((self.folder / "installed/run.json").read_text())["status"], "done")


if __name__ == "__main__":
    unittest.main()
