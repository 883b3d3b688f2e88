"""Running kiln in tests that find it in the variable KILN, and folders that go when these end. Tests with --kiln PATH
have harness.py."""
import os
import subprocess
import tempfile
import unittest

from ranks import MPI_ENVIRONMENT, under_mpi
from reading import content, run_json  # noqa: F401

KILN = os.environ["KILN"]


def kiln(*arguments, code=0, ranks=0, prefix=(), lines=None, folder=None, environment=None, timeout=None):
    """Runs kiln to its end, under mpirun where there are `ranks`, after the words of `prefix`, with `lines` as its
    input, in `folder`; it has to end with `code`, unless that is None."""
    given = {"stdin": subprocess.DEVNULL} if lines is None else {"input": lines}
    done = subprocess.run([*prefix, *under_mpi(ranks), KILN, *map(str, arguments)], capture_output=True, text=True,
                          errors="replace", cwd=folder, timeout=timeout, **given,
                          env={**os.environ, **MPI_ENVIRONMENT, **(environment or {})})
    said = f"kiln {' '.join(map(str, arguments))}: exit {done.returncode}, wanted {code}\n{done.stderr}"
    assert code is None or done.returncode == code, said
    return done


def kiln_on_host(*arguments, **more):
    """The same; views are by Embree where nothing else is said, and load no drivers of Vulkan to find no GPU."""
    if arguments[0] == "view" and "--backend" not in arguments:
        arguments += ("--backend", "embree")
    return kiln(*arguments, **more)


def flat(scene, folder):
    """A scene file as kiln's own scene file, which a bake leaves: views read it in a fifth of the time."""
    kiln("bake", scene, "-o", folder, "--backend", "embree", "--texels-per-metre", "0.5", "--bounces", "0",
         "--samples-direct", "1", "--samples-indirect", "1", "--samples-probe", "0", "--caustics", "none", "--denoise",
         "none", "--no-export", "--no-preview", "--quiet")
    return os.path.join(folder, "scene.kscene")


class InOneFolder(unittest.TestCase):
    """Tests that share `folder`."""

    @classmethod
    def setUpClass(cls):
        cls.folder = cls.enterClassContext(tempfile.TemporaryDirectory(prefix="kiln-test-"))


class InOwnFolder(unittest.TestCase):
    """Each test has a `folder` of its own."""

    def setUp(self):
        self.folder = self.enterContext(tempfile.TemporaryDirectory(prefix="kiln-test-"))
