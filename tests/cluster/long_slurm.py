"""Longer than a test may take, and not run by ctest: a bake that needs many runs, and every way to lose a node. As
root:

    KILN=build/release/kiln tests/cluster/long_slurm.py                 all, about twelve minutes on two quiet cores
    KILN=build/release/kiln tests/cluster/long_slurm.py Long.test_ping_pong

KILN_RUNS=N: at least N requeues of one bake (5). KILN_SAMPLES=N: of that bake; half as many make it half as long, where
the machine is busy."""
import os
import time
import unittest

from hosts import require, wait_for
from slurm import Bakes

RUNS = int(os.environ.get("KILN_RUNS", "5"))
SAMPLES = int(os.environ.get("KILN_SAMPLES", str(512 * RUNS)))
BAKE = ["quality: production", "texels-per-metre: 32", "schedule: equal", "bounces: 6", "preview: false"]


class Long(Bakes):
    def setUp(self):
        for node in self.slurm.nodes:
            if node.holder.poll() is not None:
                node.start()
                self.slurm.start(node)
        wait_for(lambda: len(self.slurm.states("idle")) == len(self.slurm.nodes), 90, "nodes that are ready")

    def test_ping_pong(self):
        """Every run is warned in the first half minute of its one; nobody but the script and Slurm does anything."""
        self.write("endless", *BAKE, f"samples-indirect: {SAMPLES}")
        begin = time.monotonic()
        job = self.submit("endless.yaml", "--nodes", "2", "--threads", "2", "--time", "1", "--warning", "30")
        self.finish(job, 3600)
        seconds, requeues = time.monotonic() - begin, int(self.slurm.job(job)["Restarts"])
        self.assertGreaterEqual(self.log(job).count("requeued (exit 75)"), RUNS, self.log(job))
        self.assertEqual(self.log(job).count("going on from checkpoint"), requeues, self.log(job))
        self.assertSame("endless", self.begin_alone("endless"))
        print(f"\n{requeues} requeues in {seconds:.0f} s: the same bits as one run")

    def begin(self, name, nodes, *words):
        job = self.submit(f"{name}.yaml", "--nodes", nodes, "--threads", "1", *words)
        self.wait_log(job, "bounce", 90)
        return job

    def end(self, name, job, alone, restarts):
        self.finish(job, 400)
        self.assertEqual(self.slurm.job(job)["Restarts"], str(restarts), self.log(job))
        self.assertSame(name, alone)

    def test_two_losses(self):
        """A cut link, then another node: those that are left go on each time, in the same job."""
        self.write("three", *BAKE, "samples-indirect: 256")
        alone = self.begin_alone("three")
        job = self.begin("three", "3", "--tries", "4")
        first, cut, other = map(self.host, self.nodes_of(job))
        cut.cut()
        print(f"\ncut link: the others go on after "
              f"{self.wait_log(job, f'continuing on {first.name} {other.name}', 40):.0f} s")
        self.assertNotIn("kiln bake", cut.run("ps", "-e", "-o", "args=").stdout,
                         "ranks beyond the cut are at work still")
        cut.mend()
        self.wait_log(job, "import", 60, times=2)
        other.kill()
        print(f"lost node: {self.wait_log(job, f'no answer from {other.name}', 40):.0f} s")
        self.end("three", job, alone, 0)

    def test_back_into_the_queue(self):
        """Without --tries the job gets as many nodes as it asked for again, whichever node is lost: the one that runs
        the script, another."""
        for lost in (0, 1):
            self.setUp()
            name = f"back{lost}"
            self.write(name, *BAKE, "samples-indirect: 256")
            alone, job = self.begin_alone(name), self.begin(name, "2")
            self.host(self.nodes_of(job)[lost]).kill()
            self.wait_log(job, "attempt 2", 120)
            self.assertEqual(len(self.nodes_of(job)), 2)
            self.end(name, job, alone, 1)


if __name__ == "__main__":
    require("slurmctld", "slurmd", "sbatch", "munged")
    unittest.main()
