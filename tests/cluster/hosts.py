"""Several hosts on one machine: each has its own name, network, processes, /dev/shm and sshd; files are shared, as on a
cluster.

A host is the set of namespaces of one process. Killing that process kills all that runs on the host; when this program
ends, however it does, the hosts end too, and nothing is left of their network, because the switch between them is a
namespace as well.
"""
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

KILN = os.environ.get("KILN", "")
NET = "10.99.0"
BUSY = 4  # times as long may it take on a busy machine until something has happened


def skip(sentence):
    """The whole file has to be skipped."""
    print(f"skipped: {sentence}")
    sys.exit(77)


def require(*programs):
    """Skips the file unless hosts can be made here and the programs are installed."""
    if os.geteuid() != 0:
        skip("hosts in network namespaces can only be made by root")
    os.environ["PATH"] += ":/usr/sbin:/sbin"
    for program in ("ip", "nsenter", "unshare", "sshd", "ssh-keygen", "mpirun", *programs):
        if shutil.which(program) is None:
            skip(f"{program} is not installed; cluster/install-packages installs it")
    made = subprocess.run(["unshare", "--net", "--uts", "--ipc", "--mount", "--pid", "--fork", "ip", "link", "add",
                           "name", "switch", "type", "bridge"],
                          capture_output=True, text=True)
    if made.returncode != 0:
        skip(f"this machine does not let namespaces be made: {made.stderr.strip()}")


def wait_for(condition, seconds, what):
    """Looks every tenth of a second; gives back what the condition gave. `seconds`: what it may take on a machine that
    does nothing else; on one that other tests use it gets more."""
    seconds *= BUSY
    end = time.monotonic() + seconds
    while True:
        answer = condition()
        if answer:
            return answer
        if time.monotonic() > end:
            raise AssertionError(f"{what}: not within {seconds} s")
        time.sleep(0.1)


def bake_can(option):
    return f"--{option}" in subprocess.run([KILN, "bake", "--help", "all"], capture_output=True, text=True).stdout


def bits(folder):
    """The lightmaps, byte for byte: what has to be the same."""
    maps = pathlib.Path(folder, "lightmaps")
    found = {path.name: path.read_bytes() for path in maps.iterdir()}
    assert found, f"no lightmap in {folder}"
    return found


class Host:
    def __init__(self, cluster, name, number):
        self.cluster, self.name, self.address = cluster, name, f"{NET}.{number}"
        self.number, self.link = number, f"v{number}"
        self.folder = os.path.join(cluster.folder, name)
        os.makedirs(os.path.join(self.folder, "tmp"))
        self.start()

    def start(self):
        """Also after kill(): the host comes back, with nothing running on it but sshd."""
        ready = os.path.join(self.folder, "ready")
        setup = (f"hostname {self.name} && mount --bind {self.cluster.folder}/hosts /etc/hosts && mount -t tmpfs "
                 f"tmpfs /dev/shm && "
                 f"mount -t tmpfs tmpfs /run && mkdir /run/sshd && touch {ready} && exec sleep infinity")
        if os.path.exists(ready):
            os.remove(ready)
        self.holder = subprocess.Popen(["unshare", "--net", "--uts", "--ipc", "--mount", "--pid", "--fork",
                                        "--kill-child", "--mount-proc",
                                        "--propagation", "private", "sh", "-c", setup], preexec_fn=die_with_parent)
        wait_for(lambda: os.path.exists(ready), 10, f"start of host {self.name}")
        self.process = only_child(self.holder.pid)
        self.cluster.switch_run("ip", "link", "add", self.link, "type", "veth", "peer", "name", "eth0", "address",
                                # the others remember it when it comes back
                                f"02:00:00:00:00:{self.number:02x}", "netns", str(self.process))
        self.cluster.switch_run("ip", "link", "set", self.link, "master", "switch", "up")
        self.run("ip", "addr", "add", f"{self.address}/24", "dev", "eth0", check=True)
        self.run("ip", "link", "set", "lo", "up", check=True)
        self.run("ip", "link", "set", "eth0", "up", check=True)
        config = os.path.join(self.folder, "sshd_config")
        with open(config, "w") as file:
            file.write(f"ListenAddress {self.address}\nHostKey {self.cluster.folder}/host_key\nPidFile none\n"
                       f"StrictModes no\nUsePAM no\n"
                       f"UseDNS no\nAuthorizedKeysFile {self.cluster.folder}/key.pub\nPermitRootLogin "
                       f"prohibit-password\n"
                       f"PasswordAuthentication no\nSetEnv TMPDIR={self.folder}/tmp OMPI_ALLOW_RUN_AS_ROOT=1 "
                       "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1\n")
        self.run(shutil.which("sshd"), "-f", config, "-E", os.path.join(self.folder, "sshd.log"), check=True)

    def command(self, *words, cwd=None):
        return ["nsenter", f"--target={self.process}", "--net", "--uts", "--ipc", "--mount", "--pid",
                f"--wd={cwd or os.getcwd()}",
                *map(str, words)]

    def environment(self, more=None):
        return dict(os.environ, TMPDIR=os.path.join(self.folder, "tmp"), **self.cluster.settings, **(more or {}))

    def run(self, *words, check=False, timeout=120 * BUSY, environment=None, cwd=None):
        """A command on this host, to its end."""
        done = subprocess.run(self.command(*words, cwd=cwd), env=self.environment(environment),
                              stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True, errors="replace", timeout=timeout)
        said = f"{words} on {self.name}: {done.returncode}\n{done.stdout}{done.stderr}"
        assert not check or done.returncode == 0, said
        return done

    def begin(self, *words, environment=None, **more):
        """A command on this host, running on."""
        return subprocess.Popen(self.command(*words), env=self.environment(environment), stdin=subprocess.DEVNULL,
                                text=True,
                                preexec_fn=die_with_parent, **more)

    def cut(self):
        """The cable is pulled; what runs on the host goes on."""
        self.cluster.switch_run("ip", "link", "set", self.link, "down")

    def mend(self):
        self.cluster.switch_run("ip", "link", "set", self.link, "up")

    def kill(self):
        """The power is pulled."""
        os.kill(self.process, signal.SIGKILL)
        self.holder.wait()


def die_with_parent():
    import ctypes
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def only_child(process):
    return int(pathlib.Path(f"/proc/{process}/task/{process}/children").read_text().split()[0])


class Cluster:
    """`with Cluster("a", "b") as cluster:` — cluster.hosts[0] is a. mpirun may be started on any of them."""

    def __init__(self, *names):
        self.names = names

    def __enter__(self):
        self.folder = tempfile.mkdtemp(prefix="kiln-cluster-")
        try:
            self.build()
        except BaseException:
            self.__exit__()
            raise
        return self

    def build(self):
        self.hosts = []
        self.switch = subprocess.Popen(["unshare", "--net", "--fork", "--kill-child", "sh", "-c",
                                        f"ip link add name switch type bridge && ip link set switch up && touch "
                                        f"{self.folder}/switch && exec sleep infinity"],
                                       preexec_fn=die_with_parent)
        for key in ("key", "host_key"):
            subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", os.path.join(self.folder, key)],
                           check=True)
        with open(os.path.join(self.folder, "hosts"), "w") as file:
            file.write("127.0.0.1 localhost\n" +
                       "".join(f"{NET}.{i + 1} {name}\n" for i, name in enumerate(self.names)))
        self.agent = os.path.join(self.folder, "ssh")
        with open(self.agent, "w") as file:
            file.write(f"#!/bin/sh\nexec ssh -i {self.folder}/key -o StrictHostKeyChecking=no -o "
                       f"UserKnownHostsFile=/dev/null "
                       "-o LogLevel=ERROR -o BatchMode=yes \"$@\"\n")
        os.chmod(self.agent, 0o755)
        # Each host believes that all cores are its own; their ranks have to yield.
        self.settings = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMPI_MCA_pml": "ob1",
                         "OMPI_MCA_btl": "self,vader,tcp", "OMPI_MCA_mpi_yield_when_idle": "1",
                         "OMPI_MCA_hwloc_base_binding_policy": "none", "OMPI_MCA_rmaps_base_oversubscribe": "1",
                         "OMPI_MCA_btl_tcp_if_include": f"{NET}.0/24", "OMPI_MCA_oob_tcp_if_include": f"{NET}.0/24"}
        wait_for(lambda: os.path.exists(os.path.join(self.folder, "switch")), 10, "start of the switch")
        self.switch_process = only_child(self.switch.pid)
        for i, name in enumerate(self.names):
            self.hosts.append(Host(self, name, i + 1))
        self.hostfile = os.path.join(self.folder, "hostfile")
        with open(self.hostfile, "w") as file:
            file.write("".join(f"{name} slots=2\n" for name in self.names))

    def switch_run(self, *words):
        subprocess.run(["nsenter", f"--target={self.switch_process}", "--net", *words], check=True)

    def __exit__(self, *_):
        for holder in [host.holder for host in getattr(self, "hosts", [])] + ([self.switch] if hasattr(self, "switch")
                                                                              else []):
            holder.kill()
            holder.wait()
        for _ in range(20): # what is being written there just now
            shutil.rmtree(self.folder, ignore_errors=True)
            if not os.path.exists(self.folder):
                break
            time.sleep(0.1)
