"""cluster/bundle: the folder runs wherever it is put, in a root that has nothing but the C library and a shell, with
its own Open MPI; where the host has an Open MPI, that one is taken."""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

from hosts import bits, require

KILN = os.environ["KILN"]
PROJECT = pathlib.Path(__file__).resolve().parents[2]
DRAFT = ["--quality", "draft", "--texels-per-metre", "8"]
TOOLS = ["sh", "readlink", "dirname", "grep", "cat", "ls"]


def libraries(program):
    lines = subprocess.run(["ldd", program], capture_output=True, text=True, check=True).stdout.splitlines()
    return [words[2] for words in map(str.split, lines) if len(words) > 2 and words[2].startswith("/")]


class Bundle(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory(prefix="kiln-bundle-")))
        cls.made = cls.folder / "made"
        done = subprocess.run([PROJECT / "cluster/bundle", "--program", KILN, "--output", cls.made],
                              capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        print("\n" + done.stdout.strip())
        # Elsewhere, under a name that has to be quoted, and gone from where it was made.
        cls.root = cls.folder / "root"
        cls.bundle = cls.root / "opt" / "a b'c"
        cls.bundle.parent.mkdir(parents=True)
        shutil.move(cls.made, cls.bundle)
        cls.fill_root()
        cls.alone = cls.folder / "alone"
        subprocess.run([KILN, "generate", "cornell", "-o", cls.root / "tmp/cornell.glb"], check=True,
                       stdout=subprocess.DEVNULL)
        subprocess.run([KILN, "bake", cls.root / "tmp/cornell.glb", "-o", cls.alone, *DRAFT, "--quiet"],
                       check=True)

    @classmethod
    def fill_root(cls):
        """A system with the C library, a shell and its usual tools, and nothing else."""
        for name in ("bin", "lib64", "lib/x86_64-linux-gnu", "tmp", "proc", "dev", "sys", "etc"):
            (cls.root / name).mkdir(parents=True)
        files = {shutil.which(tool) for tool in TOOLS}
        for tool in list(files):
            shutil.copy(tool, cls.root / "bin")
        wanted = {path for tool in files
                  for path in libraries(tool)} | {path for path in libraries(cls.bundle / "bin/kiln")
                                                                         if pathlib.Path(path).name.split(".so")[0] in
                                                                         ("libc", "libm", "libdl", "librt",
                                                                          "libpthread", "libresolv")}
        for path in wanted:
            shutil.copy(path, cls.root / "lib/x86_64-linux-gnu")
        shutil.copy("/lib64/ld-linux-x86-64.so.2", cls.root / "lib64")
        (cls.root / "etc/passwd").write_text("root:x:0:0:root:/:/bin/sh\n")

    def bare(self, *words):
        """Runs in that root, with an empty environment."""
        root = str(self.root)
        mounts = (f"mount --bind /dev '{root}/dev' && mount -t proc proc '{root}/proc' && "
                  f"mount --bind /sys '{root}/sys' && "
                  "exec env -i OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 "
                  f"{shutil.which('chroot')} \"$@\"")
        return subprocess.run(["unshare", "--mount", "--propagation", "private", "sh", "-c", mounts, "sh", root,
                               *words], capture_output=True,
                              text=True, timeout=120, stdin=subprocess.DEVNULL)

    def test_in_a_bare_root(self):
        done = self.bare("/opt/a b'c/kiln", "bake", "/tmp/cornell.glb", "-o", "/tmp/one", *DRAFT, "--backend", "embree")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(bits(self.root / "tmp/one"), bits(self.alone))

    def test_in_a_bare_root_with_its_own_mpirun(self):
        done = self.bare("/opt/a b'c/mpirun", "--oversubscribe", "-n", "2", "/opt/a b'c/kiln", "bake",
                         "/tmp/cornell.glb", "-o", "/tmp/two", *DRAFT, "--threads", "1", "--backend",
                         "embree")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn('"ranks": 2', (self.root / "tmp/two/run.json").read_text())
        self.assertEqual(bits(self.root / "tmp/two"), bits(self.alone))

    def test_the_hosts_open_mpi_wins(self):
        """Here all that could be lent is on the host: nothing is, and the rest comes from the folder."""
        environment = {"PATH": "/usr/bin:/bin", "LD_DEBUG": "files", "LD_DEBUG_OUTPUT": str(self.folder / "debug")}
        subprocess.run([self.bundle / "kiln", "check", self.root / "tmp/cornell.glb"], env=environment,
                       capture_output=True, check=True)
        loaded = "".join(path.read_text(errors="replace") for path in self.folder.glob("debug.*"))
        self.assertIn(f"calling init: {self.bundle}/bin/../lib/libembree3.so.3", loaded)
        self.assertNotIn("calling init: /lib/x86_64-linux-gnu/libembree3", loaded)
        self.assertRegex(loaded, r"calling init: /(usr/)?lib/\S*/libmpi\.so\.40")
        for lent in ("openmpi", "lib-missing", "lib-driver"):
            self.assertNotIn(f"{self.bundle}/{lent}/", loaded)

    def test_batch_scripts_start_the_folders_programs(self):
        done = subprocess.run([self.bundle / "kiln", "submit", "--dry-run", self.root / "tmp/cornell.glb"],
                              env={"PATH": "/usr/bin:/bin"},
                              capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        for name in ("kiln", "mpirun"):
            line = next(line for line in done.stdout.splitlines() if line.startswith(f"{name}="))
            said = subprocess.run(["bash", "-c", f"{line}; printf %s \"${name}\""], capture_output=True,
                                  text=True).stdout
            self.assertEqual(said, str(self.bundle / name))

    def test_no_library_is_left_to_chance(self):
        """All that the folder's own libraries need is in the folder, of the C library, or lent."""
        inside = {path.name for path in self.bundle.rglob("*.so*")}
        for library in (self.bundle / "lib").glob("*.so*"):
            needed = subprocess.run(["patchelf", "--print-needed", library], capture_output=True, text=True,
                                    check=True).stdout.split()
            for name in needed:
                self.assertTrue(name in inside
                                or name.startswith(("libc.so", "libm.so", "ld-linux", "libdl.", "libpthread.",
                                                    "librt.")),
                                f"{library.name} needs {name}")

    def test_kernels_without_doubles(self):
        """Where the program looks for them: in ../lib/kiln of its folder."""
        name = "kiln-float.kernels"
        self.assertEqual((self.bundle / "lib/kiln" / name).read_bytes(),
                         (pathlib.Path(KILN).resolve().parent / name).read_bytes())


if __name__ == "__main__":
    if shutil.which("patchelf") is None:
        print("skipped: patchelf is not installed; cluster/install-packages installs it")
        sys.exit(77)
    require()
    unittest.main()
