"""What the command line tests share: running kiln and taking its answer apart."""
import os
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
from program import KILN, InOwnFolder, run_json  # noqa: E402, F401


class Answer:
    def __init__(self, completed, seconds):
        self.code = completed.returncode
        self.out = completed.stdout
        self.err = completed.stderr
        self.seconds = seconds

    def sentence(self):
        """The one line "kiln: error: ..." of stderr."""
        lines = [line for line in self.err.splitlines() if line.startswith("kiln: error: ")]
        assert len(lines) == 1, f"not exactly one error sentence in {self.err!r}"
        return lines[0][len("kiln: error: "):]


def kiln(*arguments, folder=None, stdout=subprocess.PIPE, prefix=(), timeout=60, columns=None):
    """Runs kiln in `folder` and waits. `prefix` goes before it on the command line, as for mpirun. `columns`: width of
    the terminal, as a shell states it."""
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    if columns is not None:
        environment["COLUMNS"] = str(columns)
    begin = time.monotonic()
    completed = subprocess.run([*prefix, KILN, *map(str, arguments)], cwd=folder, stdin=subprocess.DEVNULL,
                               stdout=stdout, env=environment,
                               stderr=subprocess.PIPE, text=True, errors="surrogateescape", timeout=timeout)
    return Answer(completed, time.monotonic() - begin)


def quickest(*arguments, tries=5):
    """The answer that took least time: the machine may be busy with other tests."""
    return min((kiln(*arguments) for _ in range(tries)), key=lambda answer: answer.seconds)


COMMANDS = ["bake", "plan", "info", "check", "view", "compare", "probe", "generate", "report", "bench", "submit",
            "status", "stop", "verify", "export", "mix", "relight", "import"]
