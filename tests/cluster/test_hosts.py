"""Three hosts, mpirun over ssh: the same bits as one host; a cut link and a lost host end the job with a sentence, and
one host alone brings the bake to its end, with the same bits again."""
import json
import os
import pathlib
import re
import subprocess
import time
import unittest

from hosts import BUSY, KILN, Cluster, bake_can, bits, require, wait_for

SHORT = ["--quality", "draft", "--texels-per-metre", "8"]
# A checkpoint after direct light; then it lasts until what is to happen to it has happened (KILN_HOLD), on any machine.
HELD = ["--quality", "draft", "--texels-per-metre", "8", "--bounces", "6", "--samples-probe", "0", "--denoise", "none",
        "--no-preview", "--checkpoint-every", "0.001"]
KEEPALIVE = ["--mca", "oob_tcp_keepalive_time", "2", "--mca", "oob_tcp_keepalive_intvl", "1", "--mca",
             "oob_tcp_keepalive_probes", "3"]


class Hosts(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.cluster = cls.enterClassContext(Cluster("alder", "birch", "cedar"))
        cls.folder = os.path.join(cls.cluster.folder, "work")
        os.makedirs(cls.folder)
        cls.scene = os.path.join(cls.folder, "cornell.glb")
        subprocess.run([KILN, "generate", "cornell", "-o", cls.scene], check=True, stdout=subprocess.DEVNULL)
        subprocess.run([KILN, "bake", cls.scene, "-o", os.path.join(cls.folder, "alone"), "--quiet", *SHORT],
                       check=True)

    def folder_of(self, output):
        return os.path.join(self.folder, output)

    def bake_words(self, output, *options, hold=None):
        held = ["-x", f"KILN_HOLD={hold}"] if hold else []
        return ["mpirun", *held, "--hostfile", self.cluster.hostfile, "--mca", "plm_rsh_agent", self.cluster.agent,
                *KEEPALIVE, "--map-by", "ppr:1:node", "--display-map", KILN, "bake", self.scene, "-o",
                self.folder_of(output), "--threads", "1", *options]

    def bake_here(self, output, *options):
        """By one process on this machine, to its end; gives back what it said."""
        done = subprocess.run([KILN, "bake", self.scene, "-o", self.folder_of(output), "--threads", "2", *options],
                              capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stderr

    def assert_same(self, one, other):
        self.assertEqual(bits(self.folder_of(one)), bits(self.folder_of(other)))

    def test_same_bits_as_one_host(self):
        three = self.cluster.hosts[0].run(*self.bake_words("three", *SHORT))
        self.assertEqual(three.returncode, 0, three.stderr)
        self.assert_same("three", "alone")
        for host in self.cluster.hosts:
            self.assertRegex(three.stdout, f"Data for node: {host.name}\\b", "every host had a rank")

    def test_unequal_hosts(self):
        """Two ranks, two and one, one host after the other and in turn: what a host's ranks share and what travels is
        not the same."""
        options = [*SHORT, "--no-preview"]
        hosts = ",".join(f"{host.name}:{slots}" for host, slots in zip(self.cluster.hosts, (2, 2, 1)))
        for order in ("slot", "node"):
            output = "five by " + order
            five = self.cluster.hosts[0].run("mpirun", "--mca", "plm_rsh_agent", self.cluster.agent, *KEEPALIVE, "-n",
                                             "5", "--oversubscribe", "--host",
                                             hosts, "--map-by", order, KILN, "bake", self.scene, "-o",
                                             self.folder_of(output), "--threads", "1", *options)
            self.assertEqual(five.returncode, 0, five.stderr)
            self.assert_same(output, "alone")
            with open(os.path.join(self.folder_of(output), "run.json"), encoding="utf-8") as report:
                self.assertGreater(json.load(report)["mpi"]["received_between_nodes"], 0)

    def test_rank_that_stands_still_is_named_with_its_host(self):
        """On one host after the other, while results are written: rank 0 hears the others, and the last one rank 0."""
        for rank, host, place in ((1, "birch", "lightmaps"), (0, "alder", "volume.hdf")):
            words = self.bake_words("still", *SHORT, "--no-preview", "--watchdog", "4")
            begin = time.monotonic()
            bake = self.cluster.hosts[0].run(words[0], "-x", f"KILN_HALT_RANK={rank}:{place}", *words[1:])
            print(f"\nstill: the job ended after {time.monotonic() - begin:.1f} s")
            self.assertEqual(bake.returncode, 76, bake.stderr)
            self.assertRegex(bake.stderr, f"rank {rank} on {host} has given no sign of life for [0-9.]+ s")
            self.bake_here("still", *SHORT, "--no-preview")

    def lose(self, output, loss, repair):
        """A bake that has come to its bounces loses something; what mpirun says in the end, on one line."""
        hold = pathlib.Path(self.folder, "hold")
        hold.touch()
        bake = self.cluster.hosts[0].begin(*self.bake_words(output, *HELD, hold=hold), stdout=subprocess.DEVNULL,
                                           stderr=subprocess.PIPE)
        checkpoints = pathlib.Path(self.folder_of(output), "checkpoint")
        wait_for(lambda: bake.poll() is not None or list(checkpoints.glob("gen-*")), 60, "the first checkpoint")
        self.assertIsNone(bake.poll(), "the bake ended before anything happened to it")
        loss()
        begin = time.monotonic()
        try:
            words = bake.communicate(timeout=30 * BUSY)[1]
        except subprocess.TimeoutExpired:
            bake.kill()
            self.fail(f"the job hangs {30 * BUSY} s after the loss")
        finally:
            repair()
        print(f"\n{output}: the job ended after {time.monotonic() - begin:.1f} s")
        self.assertNotEqual(bake.returncode, 0)
        return re.sub(r"\s+", " ", words)

    @unittest.skipUnless(KILN and bake_can("resume"), "this kiln keeps no checkpoints")
    def test_cut_link_ends_the_job_with_a_sentence(self):
        host = self.cluster.hosts[2]
        words = self.lose("cut", host.cut, host.mend)
        self.assertRegex(words, r"(?i)lost (communication|connection)|cedar")
        self.assertIn("going on from checkpoint", self.bake_here("cut", *HELD))
        self.bake_here("whole", *HELD)
        self.assert_same("cut", "whole")

    @unittest.skipUnless(KILN and bake_can("resume"), "this kiln keeps no checkpoints")
    def test_lost_host_ends_the_job_with_a_sentence(self):
        host = self.cluster.hosts[1]
        words = self.lose("lost", host.kill, host.start)
        self.assertRegex(words, r"(?i)lost (communication|connection)|birch")
        left = self.cluster.hosts[2].run("ps", "-e", "-o", "args=").stdout
        self.assertNotIn("kiln bake", left, "a rank stayed behind")


if __name__ == "__main__":
    require()
    unittest.main()
