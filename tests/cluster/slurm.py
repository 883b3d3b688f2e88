"""A Slurm cluster of its own on the hosts of a Cluster: munged, slurmctld, one slurmd a host; no accounting, no cgroups."""
import os
import time

from hosts import NET, wait_for


class Slurm:
    """`with Slurm(cluster) as slurm:` — the first host is the controller, the others are the nodes. Ends with the cluster."""

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
        self.head.run("munged", "--force", f"--socket={self.folder}/munge.sock", f"--key-file={munge}/key", f"--pid-file={munge}/pid",
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
        nodes = "".join(f"NodeName={node.name} NodeAddr={node.address} CPUs=2 RealMemory=1000 State=UNKNOWN\n" for node in self.nodes)
        return (f"ClusterName=kiln\nSlurmctldHost={self.head.name}({self.head.address})\nSlurmUser=root\nSlurmdUser=root\n"
                f"AuthType=auth/munge\nAuthInfo=socket={f}/munge.sock\nCredType=cred/munge\nStateSaveLocation={f}/state\n"
                f"SlurmdSpoolDir={f}/spool-%n\nTmpFS={f}/tmp-%n\nSlurmctldPidFile={f}/slurmctld.pid\nSlurmdPidFile={f}/slurmd-%n.pid\n"
                f"SlurmctldLogFile={f}/slurmctld.log\nSlurmdLogFile={f}/slurmd-%n.log\nProctrackType=proctrack/linuxproc\n"
                "TaskPlugin=task/none\nJobAcctGatherType=jobacct_gather/none\nAccountingStorageType=accounting_storage/none\n"
                "SwitchType=switch/none\nMpiDefault=none\nReturnToService=2\nSchedulerType=sched/backfill\n"
                "SchedulerParameters=sched_interval=2,batch_sched_delay=1,bf_interval=2\nSelectType=select/cons_tres\n"
                "SelectTypeParameters=CR_Core\nSlurmdParameters=config_overrides\nJobRequeue=1\nSlurmctldTimeout=10\nSlurmdTimeout=10\n"
                "InactiveLimit=0\nMinJobAge=300\nKillWait=30\nMessageTimeout=10\nPropagateResourceLimitsExcept=MEMLOCK\n"
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

    def start_now(self, number):
        """Slurm lets a job that was put back wait for two minutes. It may say so again while the job's last run is cleared away."""
        def running():
            if self.job(number).get("JobState") == "PENDING":
                self.run("scontrol", "update", f"JobId={number}", "StartTime=now")
                time.sleep(1)
                return None
            return self.job(number).get("Restarts") != before and self.job(number).get("JobState") in ("RUNNING", "COMPLETED")
        before = str(int(self.job(number).get("Restarts", "0")) - (self.job(number).get("JobState") == "PENDING"))
        try:
            wait_for(running, 90, f"job {number} running again")
        except AssertionError as failure:
            raise AssertionError(f"{failure}: {self.job(number)}, nodes {self.run('sinfo', '-N', '-o', '%N:%T').stdout.split()}") from None
