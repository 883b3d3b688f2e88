"""kiln submit on a real Slurm of three nodes: over two nodes and as an array; over the time limit; through the loss of a node.
Whatever happens on the way, the lightmaps have the same bits as those of one process alone."""
import json
import os
import pathlib
import subprocess
import time
import unittest

from hosts import KILN, Cluster, bake_can, bits, require, wait_for
from slurm import Slurm

LONG = ["quality: production", "texels-per-metre: 32", "schedule: equal", "bounces: 6", "samples-indirect: 256", "preview: false"]


@unittest.skipUnless(KILN and bake_can("resume"), "this kiln keeps no checkpoints")
class Queue(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.cluster = cls.enterClassContext(Cluster("desk", "node1", "node2", "node3"))
        cls.slurm = cls.enterClassContext(Slurm(cls.cluster))
        cls.folder = os.path.join(cls.cluster.folder, "work")
        os.makedirs(cls.folder)
        subprocess.run([KILN, "generate", "cornell", "-o", os.path.join(cls.folder, "cornell.glb")], check=True, stdout=subprocess.DEVNULL)
        cls.write("small", "quality: draft")
        cls.write("other", "quality: draft", "seed: 1")
        cls.write("long", *LONG)

    @classmethod
    def write(cls, name, *lines):
        pathlib.Path(cls.folder, f"{name}.yaml").write_text("\n".join(["scene: cornell.glb", f"output: {name}", *lines, ""]))

    @classmethod
    def alone(cls, name):
        """The bits of the same bake by one process that nothing happens to."""
        output = os.path.join(cls.folder, f"{name}-alone")
        if not os.path.exists(output):
            done = subprocess.run([KILN, "bake", os.path.join(cls.folder, f"{name}.yaml"), "-o", output, "--quiet"], capture_output=True, text=True)
            assert done.returncode == 0, done.stderr
        return bits(output)

    def submit(self, *words):
        done = self.slurm.run(KILN, "submit", "--json", *words, cwd=self.folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)["job"]

    def log(self, job):
        path = pathlib.Path(self.folder, f"kiln-{job}.log")
        return path.read_text(errors="replace") if path.exists() else ""

    def finish(self, job, seconds=120):
        state = self.slurm.wait_state(job, ("COMPLETED", "FAILED", "TIMEOUT", "CANCELLED", "NODE_FAIL"), seconds)
        self.assertEqual(state, "COMPLETED", self.log(job))

    def test_1_an_array_over_two_nodes_each(self):
        job = self.submit("--nodes", "2", "--ranks-per-node", "1", "--threads", "1", "--array", "[so]*.yaml")
        for task, name in enumerate(("other", "small")):
            self.finish(f"{job}_{task}")
            self.assertEqual(json.loads(pathlib.Path(self.folder, name, "run.json").read_text())["ranks"], 2)
            self.assertEqual(bits(os.path.join(self.folder, name)), self.alone(name))

    def test_2_a_broken_scene_is_not_tried_again(self):
        pathlib.Path(self.folder, "broken.glb").write_bytes(b"glTF nonsense")
        job = self.submit("broken.glb", "--threads", "1")
        self.slurm.wait_state(job, ("FAILED",), 60)
        self.assertIn("would fail again (exit 65)", self.log(job))

    def test_3_over_the_time_limit_and_through_the_loss_of_a_node(self):
        # The warning comes at some moment of the first half minute.
        job = self.submit("long.yaml", "--nodes", "2", "--threads", "2", "--time", "1", "--warning", "59")
        self.slurm.wait_state(job, ("RUNNING",), 60)
        self.slurm.wait_state(job, ("PENDING",), 60)
        self.assertIn("back into the queue (exit 75)", self.log(job))
        self.slurm.start_now(job)
        lost = self.lose_a_node_of(job)
        begin = time.monotonic()
        self.slurm.start_now(job)
        print(f"\nlost node: running again after {time.monotonic() - begin:.0f} s")
        self.slurm.run("scontrol", "update", f"JobId={job}", "TimeLimit=30")
        self.finish(job, 150)
        self.assertNotIn(lost.name, self.nodes_of(job))
        self.assertGreaterEqual(int(self.slurm.job(job)["Restarts"]), 2)
        self.assertEqual(bits(os.path.join(self.folder, "long")), self.alone("long"))

    def nodes_of(self, job):
        return self.slurm.run("scontrol", "show", "hostnames", self.slurm.job(job)["NodeList"]).stdout.split()

    def lose_a_node_of(self, job):
        name = self.nodes_of(job)[1]
        wait_for(lambda: self.log(job).count("import") > 1, 20, "the second attempt at work")
        self.assertEqual(self.slurm.job(job)["JobState"], "RUNNING", self.log(job))
        lost = next(node for node in self.slurm.nodes if node.name == name)
        lost.kill()
        return lost


if __name__ == "__main__":
    require("slurmctld", "slurmd", "sbatch", "munged")
    unittest.main()
