"""Where results may go: what stands at an output's name, links that somebody planted in a bake's folder, two bakes in
one folder, and what is left of a command that is killed. KILN_PAIRS pairs of bakes and KILN_KILLS kills instead of a
few, drawn from KILN_SEED."""
import hashlib
import json
import os
import random
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
import unittest

KILN = os.path.abspath(os.environ["KILN"])
SEED = int(os.environ.get("KILN_SEED", "1"))
PAIRS = int(os.environ.get("KILN_PAIRS", "1"))
KILLS = int(os.environ.get("KILN_KILLS", "3"))
BAKE = ["--lightmap-size", "4", "--quality", "draft", "--backend", "embree", "--no-preview", "--quiet",
        "--samples-probe", "0", "--threads", "1"]
SMALL = ["--width", "16", "--height", "16", "--backend", "embree"]
LONG = ["--samples-indirect", "1000000", "--checkpoint-every", "0"]


def run(*arguments, environment=None, folder=None, timeout=120):
    return subprocess.run([KILN, *arguments], capture_output=True, text=True, timeout=timeout, cwd=folder,
                          env=dict(os.environ, **(environment or {})))


def start(*arguments, environment=None):
    return subprocess.Popen([KILN, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                            env=dict(os.environ, **(environment or {})))


def content(folder):
    """Every file below: its hash, or where it leads."""
    found = {}
    for place, folders, files in os.walk(folder):
        for name in files + folders:
            path = os.path.join(place, name)
            if os.path.islink(path):
                found[os.path.relpath(path, folder)] = "-> " + os.readlink(path)
            elif os.path.isfile(path):
                with open(path, "rb") as file:
                    found[os.path.relpath(path, folder)] = hashlib.sha256(file.read()).hexdigest()
    return found


class Places(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.mkdtemp(prefix="kiln-places-")
        cls.scene = os.path.join(cls.scratch, "scene.glb")
        cls.baked = os.path.join(cls.scratch, "baked")
        assert run("generate", "furnace", "-o", cls.scene).returncode == 0
        done = run("bake", cls.scene, "-o", cls.baked, *BAKE)
        assert done.returncode == 0, done.stderr

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.scratch, ignore_errors=True)

    def setUp(self):
        self.folder = tempfile.mkdtemp(dir=self.scratch)

    def at(self, *names):
        return os.path.join(self.folder, *names)

    def refused(self, code, words, *arguments, **more):
        done = run(*arguments, **more)
        self.assertEqual(done.returncode, code, f"{arguments}: {done.stderr}")
        for word in [words] if isinstance(words, str) else words:
            self.assertIn(word, done.stderr)
        self.assertEqual(len(done.stderr.splitlines()), 1, done.stderr)
        return done

    def bake(self, *more, **other):
        return run("bake", self.scene, "-o", self.at("out"), *BAKE, *more, **other)

    # ---- what stands at the name ----

    def test_pipe(self):
        pipe = self.at("view.png")
        os.mkfifo(pipe)
        self.refused(73, "nobody reads", "view", self.baked, "-o", pipe, *SMALL, "--quiet")
        reader = subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE)
        done = run("view", self.baked, "-o", pipe, *SMALL)
        picture = reader.communicate(timeout=60)[0]
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(run("view", self.baked, "-o", self.at("file.png"), *SMALL).returncode, 0)
        with open(self.at("file.png"), "rb") as file:
            self.assertEqual(picture, file.read())
        self.assertTrue(stat.S_ISFIFO(os.lstat(pipe).st_mode))

    def test_device(self):
        device = self.at("null.json")
        try:
            os.mknod(device, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
            with open(device, "w"):
                pass
        except OSError:
            self.skipTest("only root makes device nodes")
        os.symlink(device, self.at("link.json"))
        for name in (device, self.at("link.json")):
            done = self.bake("--trace", name)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(run("report", self.baked, "-o", name).returncode, 0)
        self.assertTrue(stat.S_ISCHR(os.lstat(device).st_mode))
        self.assertTrue(os.path.islink(self.at("link.json")))

    def test_stdout(self):
        done = run("report", self.baked, "-o", "/proc/self/fd/1", "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue(done.stdout.rstrip().endswith("</html>"))

    def test_folder_and_socket(self):
        os.mkdir(self.at("x.png"))
        self.refused(73, "is a folder", "view", self.baked, "-o", self.at("x.png"), *SMALL)
        import socket
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(self.at("y.png"))
            self.refused(73, "is a socket", "view", self.baked, "-o", self.at("y.png"), *SMALL)
        self.refused(73, "x.png", "generate", "furnace", "-o", self.at("x.png", "no", "scene.glb"))

    def test_link_is_replaced(self):
        """As since ever: what a user's link leads to is not written through."""
        with open(self.at("precious"), "w") as file:
            file.write("mine")
        os.symlink("precious", self.at("view.png"))
        self.assertEqual(run("view", self.baked, "-o", self.at("view.png"), *SMALL).returncode, 0)
        with open(self.at("precious")) as file:
            self.assertEqual(file.read(), "mine")

    def test_own_files_and_inputs(self):
        out, scene = self.at("out"), self.at("scene.glb")
        shutil.copy(self.scene, scene)
        shutil.copytree(self.baked, out)
        os.link(os.path.join(out, "kiln.h5"), self.at("other.json"))
        os.symlink("out/lightmaps", self.at("maps"))
        before = content(self.folder)
        lightmap = next(name for name in before if name.startswith("out/lightmaps/"))
        for trace in ("out/kiln.h5", "out/run.json", "out/manifest", "out/.kiln.h5.part", "out/checkpoint/x", "maps/x",
                      "other.json", "scene.glb", lightmap):
            self.refused(64, "--trace", "bake", scene, "-o", out, *BAKE, "--trace", self.at(trace))
        self.refused(64, "--output", "report", out, "-o", self.at("out/run.json"))
        self.refused(64, "--output", "view", out, "-o", self.at(lightmap), *SMALL)
        self.refused(64, "--output", "compare", self.at(lightmap), self.at(lightmap), "-o", self.at(lightmap))
        self.refused(64, "--output", "export", out, "--scene", scene, "-o", scene)
        self.assertEqual(content(self.folder), before)

    def test_names(self):
        self.refused(64, "./-x.glb", "generate", "furnace", "-o", "-x.glb", folder=self.folder)
        self.refused(64, "./-x", "bake", self.scene, "--trace=-x", folder=self.folder)
        shutil.copy(self.scene, self.at("-s.glb"))
        done = run("bake", "./-s.glb", *BAKE, folder=self.folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue(os.path.exists(self.at("-s-bake", "run.json")))
        for name in ("a" * 300, "a" * 5000, "a/" * 2500, os.path.join(self.scene, "x")):
            self.refused(66, "", "info", name)
            self.refused(66, "", "verify", name)
        self.refused(73, "", "bake", self.scene, "-o", "a" * 300, folder=self.folder)

    # ---- planted links ----

    def test_links_below(self):
        def victim():
            os.makedirs(self.at("victim"))
            for name in ("part-00000", "manifest", "status.json", "stop", "notes", "kiln.h5"):
                with open(self.at("victim", name), "w") as file:
                    file.write(name)

        lightmap = next(name for name in os.listdir(os.path.join(self.baked, "lightmaps")))
        for name, target in (("lightmaps", "../victim"), ("checkpoint", "../victim"),
                             ("lightmaps/back", "../../victim"), ("kiln.h5", "../victim/kiln.h5"),
                             ("run.json", "../victim/new"), ("manifest", "../victim/manifest"),
                             ("scene.kscene", "../victim/notes"),
                             ("lightmaps/" + lightmap, "../../victim/notes"), (".kiln.lock", "../victim/notes")):
            with self.subTest(link=name):
                shutil.rmtree(self.at("victim"), ignore_errors=True)
                shutil.rmtree(self.at("out"), ignore_errors=True)
                victim()
                os.makedirs(os.path.dirname(self.at("out", name)), exist_ok=True)
                os.symlink(target, self.at("out", name))
                before = content(self.at("victim"))
                done = self.bake("--sides", "two")
                self.assertEqual(done.returncode, 73, done.stderr)
                self.assertIn(os.path.join("out", name), done.stderr)
                self.assertEqual(content(self.at("victim")), before)
                self.assertTrue(os.path.islink(self.at("out", name)))

    def test_linked_generation(self):
        """Of a generation that is a link, the link alone goes; of one among the others, too."""
        os.makedirs(self.at("victim"))
        for name in ("part-00000", "manifest", "notes"):
            with open(self.at("victim", name), "w") as file:
                file.write(name)
        os.makedirs(self.at("out", "checkpoint"))
        for name in ("gen-000009", ".writing-000003"):
            os.symlink("../../victim", self.at("out", "checkpoint", name))
        before = content(self.at("victim"))
        done = self.bake("--checkpoint-every", "0.01")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("gen-000009", done.stderr)
        self.assertEqual(content(self.at("victim")), before)
        self.assertFalse(os.path.lexists(self.at("out", "checkpoint")))
        self.assertEqual(run("verify", self.at("out")).returncode, 0)

    def test_linked_stop(self):
        os.makedirs(self.at("victim"))
        os.makedirs(self.at("out", "checkpoint"))
        os.symlink("../../victim/stop", self.at("out", "checkpoint", "stop"))
        os.symlink("../victim", self.at("out", "lightmaps"))
        run("stop", self.at("out"))
        self.assertEqual(os.listdir(self.at("victim")), [])

    def test_folder_itself_may_be_a_link(self):
        os.makedirs(self.at("real"))
        os.symlink("real", self.at("out"))
        done = self.bake()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(run("verify", self.at("real")).returncode, 0)

    # ---- one bake at a time ----

    def test_pairs(self):
        print(f"KILN_SEED={SEED} KILN_PAIRS={PAIRS}")
        chance = random.Random(SEED)
        for pair in range(PAIRS):
            for environment in ({}, {"KILN_LOCKS": "none"}):
                shutil.rmtree(self.at("out"), ignore_errors=True)
                line = ["bake", self.scene, "-o", self.at("out"), *BAKE, *LONG]
                both = [start(*line, environment=environment)]
                time.sleep(chance.random() * 0.01)
                both.append(start(*line, environment=environment))
                end = time.monotonic() + 120
                while all(process.poll() is None for process in both) and time.monotonic() < end:
                    time.sleep(0.02)
                refused, holder = both if both[0].poll() is not None else reversed(both)
                said = refused.communicate(timeout=120)[1]
                self.assertEqual(refused.returncode, 73, said)
                self.assertIn(f"another bake is at work in {self.at('out')} (process {holder.pid} on ", said)
                self.assertIsNone(holder.poll())
                holder.terminate()
                said = holder.communicate(timeout=120)[1]
                self.assertEqual(holder.returncode, 75, said)
                self.assertFalse([name for name in os.listdir(self.at("out")) if name.startswith(".")])
        done = self.bake("--no-resume")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(run("verify", self.at("out")).returncode, 0)

    def wait_for_lock(self, process):
        for _ in range(500):
            try:
                with open(self.at("out", ".kiln.lock")) as file:
                    if json.load(file)["process"] == process.pid:
                        return
            except (OSError, ValueError):
                pass
            time.sleep(0.02)
        self.fail("no lock: " + str(process.poll()))

    def test_killed_holder(self):
        """What a killed bake left does not block the next, with locks and without; a bake at work keeps others from
        writing beside its results."""
        for environment in ({}, {"KILN_LOCKS": "none"}):
            bake = start("bake", self.scene, "-o", self.at("out"), *BAKE, *LONG, environment=environment)
            self.wait_for_lock(bake)
            self.refused(73, f"process {bake.pid} on", "bake", self.scene, "-o", self.at("out"), *BAKE,
                         environment=environment)
            while not os.path.exists(self.at("out", "scene.kscene")):
                time.sleep(0.02)
            self.refused(73, f"process {bake.pid} on", "view", self.at("out"), environment=environment)
            bake.kill()
            bake.communicate()
            done = self.bake("--no-resume", environment=environment)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertFalse(os.path.exists(self.at("out", ".kiln.lock")))

    def test_another_host(self):
        """Another host's file: kept fresh it holds the folder, also where its lock cannot be seen; standing still it
        does not."""
        os.makedirs(self.at("out"))
        text = json.dumps({"host": "elsewhere", "boot": "x", "process": 1, "started": 1, "since": 1,
                           "command": "kiln bake \x1b[31m", "locks": True})
        with open(self.at("out", ".kiln.lock"), "w") as file:
            file.write(text)
        bake = start("bake", self.scene, "-o", self.at("out"), *BAKE)
        while bake.poll() is None:
            os.utime(self.at("out", ".kiln.lock"))
            time.sleep(0.3)
        said = bake.communicate()[1]
        self.assertEqual(bake.returncode, 73, said)
        self.assertIn("process 1 on elsewhere", said)
        self.assertNotIn("\x1b", said)
        with open(self.at("out", ".kiln.lock")) as file:
            self.assertEqual(file.read(), text)
        done = self.bake()
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_taken_over(self):
        """A bake that lost its folder while it stood still replaces no results."""
        bake = start("bake", self.scene, "-o", self.at("out"), *BAKE, "--samples-indirect", "200000")
        self.wait_for_lock(bake)
        os.unlink(self.at("out", ".kiln.lock"))
        said = bake.communicate(timeout=120)[1]
        self.assertEqual(bake.returncode, 74, said)
        self.assertIn("taken over", said)
        self.assertFalse(os.path.exists(self.at("out", "kiln.h5")))

    # ---- what is left ----

    def test_temporary_files(self):
        print(f"KILN_SEED={SEED} KILN_KILLS={KILLS}")
        chance = random.Random(SEED)
        scene = self.at("city.glb")
        self.assertEqual(run("generate", "city", "-o", scene, "--triangles", "2000").returncode, 0)
        os.mkdir(self.at("tmp"))
        for kill in range(KILLS):
            number = chance.choice([signal.SIGTERM, signal.SIGINT, signal.SIGKILL])
            command = ["info", "check", "plan"][kill % 3]
            process = start(command, scene, environment={"TMPDIR": self.at("tmp")})
            time.sleep(0.02 + 0.5 * chance.random())
            process.send_signal(number)
            process.communicate(timeout=60)
            self.assertEqual(os.listdir(self.at("tmp")), [], f"{command} and signal {number}")

    def test_scene_cut_short(self):
        scene = self.at("city.glb")
        self.assertEqual(run("generate", "city", "-o", scene, "--triangles", "2000").returncode, 0)
        bake = start("bake", scene, "-o", self.at("out"), *BAKE, *LONG)
        while not os.path.exists(self.at("out", "scene.kscene")):
            self.assertIsNone(bake.poll())
            time.sleep(0.02)
        for _ in range(1000): # what is read before is checked as it is opened
            try:
                with open(self.at("out", "checkpoint", "status.json")) as file:
                    if json.load(file)["phase"] not in ("start", "import", "scene and BVH", "surface points"):
                        break
            except (OSError, ValueError):
                pass
            time.sleep(0.02)
        os.truncate(self.at("out", "scene.kscene"), 100)
        said = bake.communicate(timeout=120)[1]
        self.assertEqual(bake.returncode, 74, said)
        self.assertRegex(said, "scene.kscene' was (made shorter|changed) while kiln was using it")
        self.assertFalse(os.path.exists(self.at("out", "kiln.h5")))


if __name__ == "__main__":
    unittest.main(verbosity=1)
