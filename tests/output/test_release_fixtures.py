"""What kiln 0.1.0 left behind is read, with the light that it had: a finished bake, kept transport (rows and links), a
bake and a view that were interrupted, and job files with the options' names of that time. Where a version's results
have other bits, a checkpoint and transport are refused with a sentence that names the version and what to do.
tests/data/release_0.1.0/README.md says how the files were made."""
import glob
import json
import os
import shutil
import sys
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import harness  # noqa: E402
import sealing  # noqa: E402
from program import InOwnFolder, kiln, run_json  # noqa: E402

OF_010 = os.path.join(harness.DATA, "release_0.1.0")
SCENE = os.path.join(OF_010, "room.glb")
BAKED = ["--texels-per-metre", "1.5", "--probe-spacing", "2", "--seed", "5", "--backend", "embree",
         "--instruction-set", "sse2", "--no-preview", "--quiet"]
STOPPED = [*BAKED, "--samples-direct", "16", "--samples-bounce", "4", "--bounces", "4", "--samples-indirect", "16384"]
VIEWED = ["--method", "path", "--width", "24", "--height", "16", "--instruction-set", "sse2", "--backend", "embree"]
# The C library of another processor may round otherwise; a bit of a random number is worth a hundred times as much.
NRMSE = 1e-4
# Names of options that later versions may have dropped, with values of 0.1.0.
DROPPED = ["exchange-limit: 1000", "dispatch-time: 20", "traversal: binary", "connections: 0.1", "mis: variance"]


class OfRelease(InOwnFolder):
    """The present program, on files of 0.1.0."""

    def place(self, name):
        return os.path.join(self.folder, name)

    def copy(self, name):
        """A copy of a folder of 0.1.0, which commands may write into."""
        return shutil.copytree(os.path.join(OF_010, name), self.place(name))

    def done(self, *arguments):
        return kiln(*arguments)

    def refused(self, words, *arguments):
        run = kiln(*arguments, code=harness.BAD_INPUT)
        for word in words:
            self.assertIn(word, run.stderr)

    def same_light(self, one, other):
        found = self.done("compare", one, other, "--json").stdout
        nrmse = json.loads(found)["nrmse"]
        self.assertLess(nrmse, NRMSE, found)

    def test_bake(self):
        bake = self.copy("kept")
        self.assertIn("as they were written", self.done("verify", bake).stdout)
        said = json.loads(self.done("probe", bake, 3, 3, 3, "--json").stdout)
        self.assertAlmostEqual(said["axes"]["+y"][1] / 19.06, 1, delta=0.02)
        self.done("view", bake, "-o", self.place("view.png"), "--width", 24, "--height", 16)
        self.done("report", bake)
        self.done("export", bake, "--scene", SCENE, "-o", self.place("engine.glb"))
        self.assertGreater(os.path.getsize(self.place("engine.glb")), os.path.getsize(SCENE))
        self.assertIs(json.loads(self.done("compare", bake, os.path.join(OF_010, "kept"), "--json").stdout)
                      ["identical"], True)

    def test_bake_again(self):
        """Its place is taken by the same bake of today, and what it left is removed."""
        bake = self.copy("kept")
        self.done("bake", SCENE, "-o", bake, *BAKED, "--bounces", 2, "--samples-direct", 16, "--samples-bounce", 4,
                  "--samples-indirect", 16, "--samples-probe", 16)
        self.assertFalse(os.path.exists(os.path.join(bake, "transport")))
        self.same_light(os.path.join(OF_010, "kept"), bake)

    def test_transport(self):
        for name, what in (("kept", "rays_replayed"), ("links", "links_replayed")):
            lit = self.place("lit-" + name)
            self.done("relight", os.path.join(OF_010, name), SCENE, "-o", lit, "--no-preview", "--quiet")
            said = run_json(lit)["relight"]
            self.assertGreater(said[what], 1000, name)
            self.same_light(os.path.join(OF_010, name), lit)

    def test_checkpoint(self):
        went_on, alone = self.copy("stopped"), self.place("alone")
        self.assertIn("stopped", self.done("status", went_on).stdout)
        run = self.done("bake", SCENE, "-o", went_on, *[word for word in STOPPED if word != "--quiet"])
        self.assertIn("going on from checkpoint 1", run.stderr)
        self.done("bake", SCENE, "-o", alone, *STOPPED)
        self.same_light(alone, went_on)

    def test_checkpoint_of_another_job(self):
        words = ["seed", "kiln 0.1.0", "--no-resume"]
        self.refused(words, "bake", SCENE, "-o", self.copy("stopped"), *STOPPED, "--seed", 6)

    def test_view(self):
        sums = self.copy("view")
        run = self.done("view", SCENE, *VIEWED, "--samples-pixel", 8, "--accumulate", sums, "-o", self.place("8.exr"))
        self.assertIn("8 paths a pixel", run.stderr + run.stdout)
        self.done("view", SCENE, *VIEWED, "--samples-pixel", 8, "-o", self.place("alone.exr"))
        self.same_light(self.place("alone.exr"), self.place("8.exr"))

    def test_jobs(self):
        with open(os.path.join(OF_010, "means.json")) as file:
            means = json.load(file)
        for job, objects in means.items():
            bake = self.place(job)
            self.done("bake", os.path.join(OF_010, job + ".yaml"), "-o", bake, "--quiet")
            found = {entry["name"]: entry["mean"] for entry in run_json(bake)["objects"]}
            self.assertEqual(found.keys(), objects.keys())
            for name, mean in objects.items():
                self.assertAlmostEqual(found[name] / mean, 1, delta=NRMSE, msg=f"{job}: {name}")

    def test_dropped_options(self):
        """An option of a job file that is no more is refused in its line, or read and said not to count."""
        with open(os.path.join(OF_010, "job.yaml")) as file:
            text = file.read().replace("room.glb", SCENE).replace("caustics: none", "caustics: vcm")
        for line in DROPPED:
            job = self.place("job.yaml")
            with open(job, "w") as file:
                file.write(text + line + "\n")
            run = kiln("bake", job, "-o", self.place("dropped"), "--no-resume", code=None)
            if run.returncode != 0:
                gone = line.split(":")[0] + " is no more since kiln .*: leave it out"
                self.assertEqual(run.returncode, 65, run.stderr)
                self.assertRegex(run.stderr, rf"job.yaml:\d+: ({gone}|mis: .* balance)")

    def test_other_bits(self):
        """Of a version whose results have other bits nothing is gone on from."""
        kept, stopped = self.copy("kept"), self.copy("stopped")
        os.remove(os.path.join(kept, "manifest"))
        for path in (os.path.join(kept, "transport", "index"),
                     *glob.glob(os.path.join(stopped, "checkpoint", "gen-*", "manifest"))):
            be_of("0.0.9", path)
        self.refused(["kept by kiln 0.0.9", "bake again"], "relight", kept, SCENE, "-o", self.place("lit"))
        self.refused(["of kiln 0.0.9", "finish it with kiln 0.0.9", "--no-resume"], "bake", SCENE, "-o", stopped,
                     *STOPPED)


def be_of(version, path):
    """Lets an index of transport, or a checkpoint's manifest, say that another version wrote it."""
    content = sealing.read(path)
    content["kiln"] = version
    content["identity"].get("fields", {})["kiln"] = version
    sealing.write(path, content)


if __name__ == "__main__":
    unittest.main()
