"""A Slurm cluster of its own on the hosts of a Cluster: munged, slurmctld, one slurmd a host; no accounting, no
cgroups."""
import json
import os
import pathlib
import subprocess
import time
import unittest

from hosts import KILN, NET, Cluster, bake_can, bits, die_with_parent, wait_for


ENDED = ("COMPLETED", "FAILED", "TIMEOUT", "CANCELLED", "NODE_FAIL")
AGAIN = 5  # seconds that a job waits that was put back into the queue; by default they are 120


class Slurm:
    """`with Slurm(cluster) as slurm:` — the first host is the controller, the others are the nodes. Ends with the
    cluster."""

    def __init__(self, cluster):
        self.cluster, self.head, self.nodes = cluster, cluster.hosts[0], cluster.hosts[1:]
        self.folder = os.path.join(cluster.folder, "slurm")
        self.conf = os.path.join(self.folder, "slurm.conf")
        self.environment = {"SLURM_CONF": self.conf}

    def __enter__(self):
        for name in ("state", "munge"):
            os.makedirs(os.path.join(self.folder, name))
        os.chmod(self.cluster.folder, 0o755)
        munge = os.path.join(self.folder, "munge")
        os.chmod(munge, 0o700)
        with open(os.path.join(munge, "key"), "wb") as file:
            os.fchmod(file.fileno(), 0o400)
            file.write(os.urandom(128))
        self.head.run("munged", "--force", f"--socket={self.folder}/munge.sock", f"--key-file={munge}/key",
                      f"--pid-file={munge}/pid",
                      f"--log-file={munge}/log", f"--seed-file={munge}/seed", check=True)
        with open(self.conf, "w") as file:
            file.write(self.configuration())
        self.head.run("slurmctld", environment=self.environment, check=True)
        for node in self.nodes:
            self.start(node)
        wait_for(lambda: len(self.states("idle")) == len(self.nodes), 30, "nodes that are ready")
        return self

    def __exit__(self, *_):
        pass

    def configuration(self):
        f = self.folder
        nodes = "".join(f"NodeName={node.name} NodeAddr={node.address} CPUs=2 RealMemory=1000 State=UNKNOWN\n"
                        for node in self.nodes)
        return (f"ClusterName=kiln\nSlurmctldHost={self.head.name}({self.head.address})\nSlurmUser=root\n"
                f"SlurmdUser=root\n"
                f"AuthType=auth/munge\nAuthInfo=socket={f}/munge.sock,cred_expire={AGAIN}\nCredType=cred/munge\n"
                f"StateSaveLocation={f}/state\n"
                f"SlurmdSpoolDir={f}/spool-%n\nTmpFS={f}/tmp-%n\nSlurmctldPidFile={f}/slurmctld.pid\n"
                f"SlurmdPidFile={f}/slurmd-%n.pid\n"
                f"SlurmctldLogFile={f}/slurmctld.log\nSlurmdLogFile={f}/slurmd-%n.log\n"
                f"ProctrackType=proctrack/linuxproc\n"
                "TaskPlugin=task/none\nJobAcctGatherType=jobacct_gather/none\n"
                "AccountingStorageType=accounting_storage/none\n"
                "SwitchType=switch/none\nMpiDefault=none\nReturnToService=2\nSchedulerType=sched/backfill\n"
                "SchedulerParameters=sched_interval=2,batch_sched_delay=1,bf_interval=2\nSelectType=select/cons_tres\n"
                "SelectTypeParameters=CR_Core\nSlurmdParameters=config_overrides\nJobRequeue=1\nSlurmctldTimeout=10\n"
                "SlurmdTimeout=10\n"
                "InactiveLimit=0\nMinJobAge=300\nKillWait=30\nMessageTimeout=10\n"
                "PropagateResourceLimitsExcept=MEMLOCK\n"
                f"{nodes}PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP\n")

    def start(self, node):
        for name in (f"spool-{node.name}", f"tmp-{node.name}"):
            os.makedirs(os.path.join(self.folder, name), exist_ok=True)
        node.run("slurmd", "-N", node.name, environment=self.environment, check=True)

    def run(self, *words, **more):
        """A command on the controller, with the environment that jobs inherit."""
        return self.head.run(*words, environment=self.environment, **more)

    def states(self, state):
        return self.run("sinfo", "-h", "-N", "-t", state, "-o", "%N").stdout.split()

    def job(self, number):
        """What Slurm knows of a job, by its own names."""
        words = self.run("scontrol", "--oneliner", "show", "job", number).stdout.split()
        return dict(word.split("=", 1) for word in words if "=" in word)

    def wait_state(self, number, states, seconds):
        def reached():
            state = self.job(number).get("JobState")
            return state if state in states else None
        return wait_for(reached, seconds, f"job {number} in state {'/'.join(states)}")


@unittest.skipUnless(KILN and bake_can("resume"), "this kiln keeps no checkpoints")
class Bakes(unittest.TestCase):
    """Bakes of a Cornell box on a Slurm of three nodes. cls.write("NAME", "quality: draft", ...) makes NAME.yaml, which
    bakes into NAME."""

    @classmethod
    def setUpClass(cls):
        cls.cluster = cls.enterClassContext(Cluster("desk", "node1", "node2", "node3"))
        cls.slurm = cls.enterClassContext(Slurm(cls.cluster))
        cls.folder = os.path.join(cls.cluster.folder, "work")
        os.makedirs(cls.folder)
        subprocess.run([KILN, "generate", "cornell", "-o", os.path.join(cls.folder, "cornell.glb")], check=True,
                       stdout=subprocess.DEVNULL)

    @classmethod
    def write(cls, name, *lines):
        pathlib.Path(cls.folder,
                     f"{name}.yaml").write_text("\n".join(["scene: cornell.glb", f"output: {name}", *lines, ""]))

    @classmethod
    def begin_alone(cls, name):
        """Starts the same bake by one process that nothing happens to."""
        return subprocess.Popen([KILN, "bake", os.path.join(cls.folder, f"{name}.yaml"), "-o",
                                 os.path.join(cls.folder, f"{name}-alone"), "--quiet"],
                                stderr=subprocess.PIPE, text=True, preexec_fn=die_with_parent)

    def assertSame(self, name, alone):
        """The lightmaps have the bits of those of begin_alone(name)."""
        words = alone.communicate()[1]
        self.assertEqual(alone.returncode, 0, words)
        self.assertEqual(bits(os.path.join(self.folder, name)), bits(os.path.join(self.folder, f"{name}-alone")))

    def submit(self, *words):
        done = self.slurm.run(KILN, "submit", "--json", *words, cwd=self.folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout)["job"]

    def log(self, job):
        path = pathlib.Path(self.folder, f"kiln-{job}.log")
        return path.read_text(errors="replace") if path.exists() else ""

    def says_something(self, job, seconds):
        """Waits until there is something in the job's log: true; or until it has ended without: false."""
        return wait_for(lambda: (self.log(job) and "log") or (self.slurm.job(job)["JobState"] in ENDED and "end"),
                        seconds, f"a word of job {job}") == "log" or self.log(job) != ""

    def wait_log(self, job, words, seconds, times=1):
        """Seconds until the job's log has the words so many times."""
        begin = time.monotonic()
        try:
            wait_for(lambda: self.log(job).count(words) >= times or self.slurm.job(job)["JobState"] in ENDED, seconds,
                     f"'{words}'")
        except AssertionError as failure:
            raise AssertionError(f"{failure}: {self.slurm.job(job)}\n{self.log(job)}") from None
        self.assertGreaterEqual(self.log(job).count(words), times, self.log(job))
        return time.monotonic() - begin

    def finish(self, job, seconds=120):
        self.assertEqual(self.slurm.wait_state(job, ENDED, seconds), "COMPLETED", self.log(job))

    def nodes_of(self, job):
        return self.slurm.run("scontrol", "show", "hostnames", self.slurm.job(job)["NodeList"]).stdout.split()

    def host(self, name):
        return next(node for node in self.slurm.nodes if node.name == name)
