"""kiln submit on a real Slurm of three nodes: over two nodes and as an array; over the time limit; through the loss of a node.
Whatever happens on the way, the lightmaps have the same bits as those of one process alone."""
import json
import os
import pathlib
import re
import subprocess
import time
import unittest

from hosts import KILN, NET, Cluster, bake_can, bits, require, wait_for
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

    def begin_long(self, *words):
        """The long bake on two nodes, when it has begun to trace."""
        subprocess.run(["rm", "-rf", os.path.join(self.folder, "long")], check=True)
        job = self.submit("long.yaml", "--nodes", "2", "--threads", "2", *words)
        self.slurm.wait_state(job, ("RUNNING",), 60)
        return job

    def test_3_over_the_time_limit(self):
        job = self.begin_long("--time", "1", "--warning", "48")
        restarts = 0
        while self.slurm.wait_state(job, ("PENDING", "COMPLETED", "FAILED", "TIMEOUT", "CANCELLED"), 120) == "PENDING":
            self.slurm.start_now(job)
            restarts += 1
            self.assertLess(restarts, 8, self.log(job))
        self.assertEqual(self.slurm.job(job)["JobState"], "COMPLETED", self.log(job))
        self.assertGreater(restarts, 0, "the bake was over before the warning; this test shows nothing")
        print(f"\ntime limit: finished after {restarts} restart(s)")
        self.assertIn("attempt 2", self.log(job))
        self.assertEqual(bits(os.path.join(self.folder, "long")), self.alone("long"))

    def test_4_through_the_loss_of_a_node(self):
        job = self.begin_long()
        names = self.slurm.run("scontrol", "show", "hostnames", self.slurm.job(job)["NodeList"]).stdout.split()
        time.sleep(8)
        self.assertEqual(self.slurm.job(job)["JobState"], "RUNNING", "the bake ended before anything happened to it")
        lost = next(node for node in self.slurm.nodes if node.name == names[1])
        lost.kill()
        begin = time.monotonic()
        self.slurm.start_now(job)
        print(f"\nlost node: running again after {time.monotonic() - begin:.0f} s")
        self.finish(job, 150)
        self.assertNotIn(lost.name, self.slurm.run("scontrol", "show", "hostnames", self.slurm.job(job)["NodeList"]).stdout.split())
        self.assertEqual(bits(os.path.join(self.folder, "long")), self.alone("long"))


if __name__ == "__main__":
    require("slurmctld", "slurmd", "sbatch", "munged")
    unittest.main()
