"""What the import tests share: running `kiln info`, measuring it, and writing small glTF files."""
import base64
import json
import os
import resource
import struct
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
from program import KILN, run_json  # noqa: E402, F401

REPOSITORY = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
SHARED = os.path.normpath(os.path.join(REPOSITORY, "..", "shared", "scenes"))
SANITIZED = "ASAN_OPTIONS" in os.environ  # AddressSanitizer takes memory and time of its own
MEMORY = (1024 if SANITIZED else 256) << 20
SECONDS = 20.0 if SANITIZED else 5.0  # of the processor: what other tests take meanwhile does not count
QUICK = 10.0 if SANITIZED else 2.0
SKIPPED = 77


class Answer:
    def __init__(self, code, out, err, seconds, memory):
        self.code, self.out, self.err, self.seconds, self.memory = code, out, err, seconds, memory

    def sentence(self):
        lines = [line for line in self.err.splitlines() if line.startswith("kiln: error: ")]
        return lines[0][len("kiln: error: "):] if len(lines) == 1 else None

    def json(self):
        return json.loads(self.out)


def kiln(*arguments, timeout=300, folder=None, space=None):
    """Runs kiln; `memory` is the most that it or its importer held, `seconds` what both took of the processor. `space`:
    a limit of its address space, in bytes."""
    begin = time.monotonic()
    confine = (lambda: resource.setrlimit(resource.RLIMIT_AS, (space, space))) if space and not SANITIZED else None
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = subprocess.Popen([KILN, *map(str, arguments)], stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                                 cwd=folder, preexec_fn=confine)
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid != 0:
                break
            if time.monotonic() - begin > timeout:
                child.kill()
            time.sleep(0.002)
        child.returncode = os.waitstatus_to_exitcode(status)
        seconds = usage.ru_utime + usage.ru_stime
        out.seek(0)
        err.seek(0)
        return Answer(child.returncode, out.read().decode("utf-8", "replace"), err.read().decode("utf-8", "replace"),
                      seconds,
                      usage.ru_maxrss * 1024)


def info(path, *options, **limits):
    return kiln("info", path, "--json", *options, **limits)


class Case(unittest.TestCase):
    def folder(self):
        holder = tempfile.TemporaryDirectory(prefix="kiln-import-")
        self.addCleanup(holder.cleanup)
        return holder.name

    def refused(self, path, words=(), seconds=SECONDS, memory=MEMORY):
        """Exit code 65 and one sentence that names the file and each of `words`; quick, small, no crash."""
        answer = kiln("info", path)
        context = f"{path}: {answer.err}"
        self.assertEqual(answer.code, 65, context)
        sentence = answer.sentence()
        self.assertIsNotNone(sentence, context)
        self.assertIn(os.path.basename(path)[:60], sentence, context)
        self.assertNotIn("importer died", sentence)
        self.assertGreater(len(sentence), len(path) + 20, "it says what is wrong")
        for word in words:
            self.assertIn(word, sentence, context)
        self.assertEqual(answer.out, "")
        self.assertLess(answer.seconds, seconds, context)
        self.assertLess(answer.memory, memory, context)
        return answer

    def accepted(self, path, *options):
        answer = info(path, *options)
        self.assertEqual(answer.code, 0, f"{path}: {answer.err}")
        return answer.json()


def write(folder, name, data):
    path = os.path.join(folder, name)
    with open(path, "wb") as file:
        file.write(data if isinstance(data, bytes) else json.dumps(data).encode())
    return path


QUAD = struct.pack("<12f6H", 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 0, 1, 2, 0, 2, 3)


def quad(**more):
    """A scene of one quad with its buffer as a data URI; `more` replaces or adds top-level members."""
    scene = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(QUAD), "uri": "data:application/octet-stream;base64," +
                     base64.b64encode(QUAD).decode()}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
                      {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    scene.update(more)
    return scene


def lacks(parts):
    return f"../shared/scenes/{'/'.join(parts)} is not here"


def need_shared(*parts):
    """A path below ../shared/scenes, or the end of the program: for what all of its tests need."""
    path = os.path.join(SHARED, *parts)
    if not os.path.exists(path):
        print("skipped: " + lacks(parts))
        sys.exit(SKIPPED)
    return path


def want_shared(*parts):
    """The same for one test of several: it is skipped."""
    path = os.path.join(SHARED, *parts)
    if not os.path.exists(path):
        raise unittest.SkipTest(lacks(parts))
    return path


def main():
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    unittest.main()
