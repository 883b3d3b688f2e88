"""kiln submit on a real Slurm of three nodes: over two nodes and as an array; over the time limit; through the loss of
a node. Whatever happens on the way, the lightmaps have the same bits as those of one process alone."""
import json
import os
import pathlib
import unittest

from hosts import require
from slurm import Bakes

# It lasts until what is to happen to it has happened (KILN_HOLD), whatever the machine: the watchdog is to wait for it.
HELD = ["quality: draft", "texels-per-metre: 8", "bounces: 3", "denoise: none", "preview: false", "watchdog: 900"]


class Queue(Bakes):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.write("small", "quality: draft", "texels-per-metre: 8")
        cls.write("other", "quality: draft", "texels-per-metre: 8", "seed: 1")
        cls.write("held", *HELD)

    def test_1_an_array_over_two_nodes_each(self):
        job = self.submit("--nodes", "2", "--ranks-per-node", "1", "--threads", "1", "--array", "[so]*.yaml")
        for task, name in enumerate(("other", "small")):
            self.finish(f"{job}_{task}")
            self.assertEqual(json.loads(pathlib.Path(self.folder, name, "run.json").read_text())["ranks"], 2)
            self.assertSame(name, self.begin_alone(name))

    def test_2_a_broken_scene_is_not_tried_again(self):
        pathlib.Path(self.folder, "broken.glb").write_bytes(b"glTF nonsense")
        job = self.submit("broken.glb", "--threads", "1")
        self.slurm.wait_state(job, ("FAILED",), 60)
        self.assertIn("would fail again (exit 65)", self.log(job))

    def test_3_over_the_time_limit_and_through_the_loss_of_a_node(self):
        # The warning comes at some moment of the first half minute.
        hold = pathlib.Path(self.folder, "hold")
        hold.touch()
        alone = self.begin_alone("held")
        self.slurm.environment["KILN_HOLD"] = str(hold)
        for _ in range(3):
            job = self.submit("held.yaml", "--nodes", "2", "--threads", "2", "--time", "1", "--warning", "59",
                              "--tries", "2")
            if self.says_something(job, 60):
                break
            # with a limit as short as this one the warning may come before the script's first line is run
            print(f"\n{self.slurm.job(job)} ended before its script said anything: once more")
        self.wait_log(job, "requeued (exit 75)", 60)
        self.wait_log(job, "import", 60, times=2)
        self.slurm.run("scontrol", "update", f"JobId={job}", "TimeLimit=30")
        lost = self.host(self.nodes_of(job)[1])
        lost.kill()
        seconds = self.wait_log(job, f"no answer from {lost.name}", 30)
        hold.unlink()
        print(f"\nlost node: the other goes on after {seconds:.0f} s")
        self.finish(job, 200)
        self.assertEqual(self.slurm.job(job)["Restarts"], "1")
        self.assertSame("held", alone)


if __name__ == "__main__":
    require("slurmctld", "slurmd", "sbatch", "munged")
    unittest.main()
