"""cluster/package: the Debian package on a bare Debian 12. apt installs it with what it depends on; a new user bakes
the sample job, alone and on two ranks, and looks at help and manual page; apt removes it without a trace.

It takes some minutes: debootstrap makes the system. KILN_DEBIAN_ROOT names a folder that debootstrap --variant=minbase
has filled before; it is copied."""
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

from hosts import bits, skip

KILN = pathlib.Path(os.environ["KILN"])
PROJECT = pathlib.Path(__file__).resolve().parents[2]
SUITE = "bookworm"
MIRROR = os.environ.get("KILN_DEBIAN_MIRROR", "http://deb.debian.org/debian")
SETTINGS = ["etc/apt/sources.list", "etc/apt/sources.list.d", "etc/apt/apt.conf", "etc/apt/apt.conf.d",
            "etc/apt/trusted.gpg.d", "etc/resolv.conf", "etc/hosts"]  # of the network, as this machine has them
JOB = "/usr/share/kiln/jobs/cornell.yaml"
OPTIONS = "--backend embree --instruction-set avx2 --quality draft --quiet"


def require():
    if os.geteuid() != 0:
        skip("only root can make a Debian in a folder")
    os.environ["PATH"] += ":/usr/sbin:/sbin"
    for program in ("debootstrap", "chroot", "unshare", "cpack", "dpkg-shlibdeps"):
        if shutil.which(program) is None:
            skip(f"{program} is not installed: apt-get install debootstrap cmake dpkg-dev")


class Package(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory(prefix="kiln-package-")))
        made = subprocess.run([PROJECT / "cluster/package", KILN.parent, cls.folder], capture_output=True, text=True)
        assert made.returncode == 0, made.stderr
        cls.package = pathlib.Path(made.stdout.strip())
        cls.root = cls.folder / "root"
        given = os.environ.get("KILN_DEBIAN_ROOT")
        subprocess.run(["cp", "-a", given, cls.root] if given else
                       ["debootstrap", "--variant=minbase", SUITE, cls.root, MIRROR], check=True,
                       stdout=subprocess.DEVNULL)
        for name in SETTINGS:
            place = cls.root / name
            if (pathlib.Path("/") / name).is_dir():
                shutil.copytree(pathlib.Path("/") / name, place, dirs_exist_ok=True)
            elif (pathlib.Path("/") / name).exists():
                shutil.copy(pathlib.Path("/") / name, place)
        shutil.copy(cls.package, cls.root / "tmp" / cls.package.name)

    def inside(self, line, user="root", good=True):
        """Runs a line of sh in that system."""
        words = ["sh", "-c", line] if user == "root" else ["su", "-", user, "-c", line]
        mounts = ("mount --rbind /dev \"$0/dev\" && mount -t proc proc \"$0/proc\" && "
                  f"exec {shutil.which('chroot')} \"$0\" \"$@\"")
        run = subprocess.run(["unshare", "--mount", "--propagation", "private", "sh", "-c", mounts, str(self.root),
                              *words], capture_output=True, text=True, timeout=1200, stdin=subprocess.DEVNULL,
                             env={**os.environ, "DEBIAN_FRONTEND": "noninteractive", "LC_ALL": "C.UTF-8",
                                  "PATH": "/usr/sbin:/usr/bin:/sbin:/bin"})
        if good:
            self.assertEqual(run.returncode, 0, f"{line}\n{run.stdout[-2000:]}\n{run.stderr[-2000:]}")
        return run

    def test_a_bare_debian(self):
        self.assertNotEqual(self.inside("command -v kiln mpirun", good=False).returncode, 0)
        self.inside("apt-get -q update")
        self.inside(f"apt-get -q install --yes --no-install-recommends /tmp/{self.package.name}")
        self.inside("useradd --create-home --shell /bin/sh anna")

        self.assertIn("kiln bake", self.inside("kiln --help", "anna").stdout)
        self.inside(f"kiln bake {JOB} -o out {OPTIONS}", "anna")
        self.inside(f"mpirun --bind-to none --oversubscribe -n 2 kiln bake {JOB} -o two {OPTIONS} --threads 1", "anna")
        self.inside("kiln verify out && kiln view out -o view.png && kiln report out", "anna")
        home = self.root / "home/anna"
        self.assertEqual(json.loads((home / "two/run.json").read_text())["ranks"], 2)
        self.assertEqual(bits(home / "out"), bits(home / "two"))
        self.assertGreater((home / "out/preview.png").stat().st_size, 10000)
        own = self.folder / "own"
        subprocess.run([KILN, "bake", PROJECT / "jobs/cornell.yaml", "-o", own, *OPTIONS.split()], check=True)
        self.assertEqual(bits(home / "out"), bits(own))
        kept = os.environ.get("KILN_KEEP")  # a folder, for who wants to look at the pictures
        if kept:
            shutil.copytree(home / "out", kept, dirs_exist_ok=True)

        if (KILN.parent / "kiln.1").exists():
            self.inside("apt-get -q install --yes --no-install-recommends man-db")
            self.assertIn("kiln", self.inside("man kiln", "anna").stdout)

        self.inside("apt-get -q purge --yes kiln")
        left = self.inside("find / -xdev -path '*kiln*' -not -path '/home/*' -not -path '/tmp/*' -not -path '/proc/*' "
                           "-not -path '/dev/*' -not -path '/var/cache/*' -not -path '/var/log/*'").stdout
        self.assertEqual(left, "")


if __name__ == "__main__":
    require()
    unittest.main()
