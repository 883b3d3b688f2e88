"""Three hosts, mpirun over ssh: the same bits as one host; a cut link and a lost host end the job with a sentence, and one host alone
brings the bake to its end, with the same bits again."""
import json
import os
import pathlib
import re
import subprocess
import time
import unittest

from hosts import KILN, Cluster, bake_can, bits, require, wait_for

LONG = ["--quality", "draft", "--schedule", "equal", "--bounces", "6", "--samples-indirect", "128", "--no-preview", "--checkpoint-every", "2"]
KEEPALIVE = ["--mca", "oob_tcp_keepalive_time", "3", "--mca", "oob_tcp_keepalive_intvl", "2", "--mca", "oob_tcp_keepalive_probes", "3"]


class Hosts(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.cluster = cls.enterClassContext(Cluster("alder", "birch", "cedar"))
        cls.folder = os.path.join(cls.cluster.folder, "work")
        os.makedirs(cls.folder)
        cls.scene = os.path.join(cls.folder, "cornell.glb")
        subprocess.run([KILN, "generate", "cornell", "-o", cls.scene], check=True, stdout=subprocess.DEVNULL)

    def bake_words(self, output, *options):
        return ["mpirun", "--hostfile", self.cluster.hostfile, "--mca", "plm_rsh_agent", self.cluster.agent, *KEEPALIVE, "--map-by",
                "ppr:1:node", "--display-map", KILN, "bake", self.scene, "-o", os.path.join(self.folder, output), "--threads", "1", *options]

    def test_same_bits_as_one_host(self):
        alone = subprocess.run([KILN, "bake", self.scene, "-o", os.path.join(self.folder, "alone"), "--quality", "draft", "--threads", "2"],
                               capture_output=True, text=True)
        self.assertEqual(alone.returncode, 0, alone.stderr)
        three = self.cluster.hosts[0].run(*self.bake_words("three", "--quality", "draft"))
        self.assertEqual(three.returncode, 0, three.stderr)
        self.assertEqual(bits(os.path.join(self.folder, "three")), bits(os.path.join(self.folder, "alone")))
        for host in self.cluster.hosts:
            self.assertRegex(three.stdout, f"Data for node: {host.name}\\b", "every host had a rank")

    def test_unequal_hosts(self):
        """Two ranks, two and one, one host after the other and in turn: what a host's ranks share and what travels is not the same."""
        options = ["--quality", "draft", "--no-preview", "--threads", "1"]
        alone = subprocess.run([KILN, "bake", self.scene, "-o", os.path.join(self.folder, "one"), *options], capture_output=True, text=True)
        self.assertEqual(alone.returncode, 0, alone.stderr)
        for order in ("slot", "node"):
            output = os.path.join(self.folder, "five by " + order)
            hosts = ",".join(f"{host.name}:{slots}" for host, slots in zip(self.cluster.hosts, (2, 2, 1)))
            five = self.cluster.hosts[0].run("mpirun", "--mca", "plm_rsh_agent", self.cluster.agent, *KEEPALIVE, "-n", "5", "--oversubscribe", "--host",
                                             hosts, "--map-by", order, KILN, "bake", self.scene, "-o", output, *options)
            self.assertEqual(five.returncode, 0, five.stderr)
            self.assertEqual(bits(output), bits(os.path.join(self.folder, "one")))
            with open(os.path.join(output, "run.json"), encoding="utf-8") as report:
                self.assertGreater(json.load(report)["mpi"]["received_between_nodes"], 0)

    def begin_long(self, output):
        """A bake that has come to its bounces."""
        bake = self.cluster.hosts[0].begin(*self.bake_words(output, *LONG), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        checkpoints = pathlib.Path(self.folder, output, "checkpoint")
        wait_for(lambda: bake.poll() is not None or list(checkpoints.glob("gen-*")), 60, "the first checkpoint")
        time.sleep(1)
        self.assertIsNone(bake.poll(), "the bake ended before anything happened to it")
        return bake

    def here(self, output):
        """The long bake by one process, from the beginning or from what is there."""
        done = subprocess.run([KILN, "bake", self.scene, "-o", os.path.join(self.folder, output), *LONG, "--threads", "2"], capture_output=True,
                              text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stderr

    def end_within(self, bake, seconds):
        begin = time.monotonic()
        try:
            words = bake.communicate(timeout=seconds)[1]
        except subprocess.TimeoutExpired:
            bake.kill()
            self.fail(f"the job hangs {seconds} s after the loss")
        return words, time.monotonic() - begin

    @unittest.skipUnless(KILN and bake_can("resume"), "this kiln keeps no checkpoints")
    def test_cut_link_ends_the_job_with_a_sentence(self):
        bake = self.begin_long("cut")
        cut = self.cluster.hosts[2]
        cut.cut()
        try:
            words, seconds = self.end_within(bake, 30)
        finally:
            cut.mend()
        print(f"\ncut link: the job ended after {seconds:.1f} s")
        self.assertNotEqual(bake.returncode, 0)
        self.assertRegex(re.sub(r"\s+", " ", words), r"(?i)lost (communication|connection)|cedar")
        self.assertIn("going on from checkpoint", self.here("cut"))
        self.here("whole")
        self.assertEqual(bits(os.path.join(self.folder, "cut")), bits(os.path.join(self.folder, "whole")))

    @unittest.skipUnless(KILN and bake_can("resume"), "this kiln keeps no checkpoints")
    def test_lost_host_ends_the_job_with_a_sentence(self):
        bake = self.begin_long("lost")
        lost = self.cluster.hosts[1]
        lost.kill()
        try:
            words, seconds = self.end_within(bake, 30)
        finally:
            lost.start()
        print(f"\nlost host: the job ended after {seconds:.1f} s")
        self.assertNotEqual(bake.returncode, 0)
        self.assertRegex(re.sub(r"\s+", " ", words), r"(?i)lost (communication|connection)|birch")
        left = self.cluster.hosts[2].run("ps", "-e", "-o", "args=").stdout
        self.assertNotIn("kiln bake", left, "a rank stayed behind")


if __name__ == "__main__":
    require()
    unittest.main()
