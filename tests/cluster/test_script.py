"""Batch scripts of kiln submit: bash and ShellCheck accept them, hostile names arrive as they were, and the judge in
the script puts back into the queue what has to go there and nothing else. mpirun, sbatch and scontrol are small
programs of this test."""
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

KILN = os.environ["KILN"]
HOSTILE = ["plain", "two words", "don't", '"quoted"', "$(touch broken)", "`touch broken`", "${HOME}", "a;touch broken",
           "a|b&c", "-rf", "--help",
           "*", "?[a-z]", "~", "#comment", "!history!", "back\\slash", "trailing\\", "\\n", "line\nbreak",
           "line\n#SBATCH --nodes=9\n", "tab\there",
           "bell\a", "\x1b[31m", "\r", "{a,b}", "=", ":", "%j%x", "<in>out", "(sub)", "é\u00fc\u4f60", "$'x'", "'",
           "''", "' '", "a'\nb", "\x7f",
           "x" * 200, "EOF", "[[ 1 ]]", "&&", "0", " lead", "trail ", "\\'", "'\\", "$((1+1))", "\u202e"]


class Place(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory(prefix="kiln-script-")))
        self.programs = self.folder / "programs"
        self.programs.mkdir()
        subprocess.run([KILN, "generate", "cornell", "-o", self.folder / "cornell.glb"], check=True,
                       stdout=subprocess.DEVNULL)

    def program(self, name, text):
        path = self.programs / name
        path.write_text(text)
        path.chmod(0o755)

    def submit(self, *words, folder=None, code=0):
        done = subprocess.run([KILN, "submit", *words], cwd=folder or self.folder, capture_output=True, text=True,
                              stdin=subprocess.DEVNULL,
                              env=dict(os.environ, PATH=f"{self.programs}:{os.environ['PATH']}"), timeout=60)
        self.assertEqual(done.returncode, code, done.stderr)
        return done

    def run_script(self, script, **more):
        environment = dict(os.environ, PATH=f"{self.programs}:{os.environ['PATH']}", SLURM_JOB_ID="7",
                           SLURM_JOB_NODELIST="n[1-2]", **more)
        return subprocess.Popen(["bash", "-c", script], env=environment, stdin=subprocess.DEVNULL,
                                stdout=subprocess.PIPE,
                                stderr=subprocess.STDOUT, text=True)


class Names(Place):
    def test_every_name_arrives_as_it_was(self):
        self.program("mpirun", f"#!{sys.executable}\nimport os, sys\n"
                     f"open({str(self.folder / 'seen')!r}, 'ab').write(b'\\0'.join(map(os.fsencode, sys.argv[1:])) + "
                     f"b'\\0\\0')\n")
        for name in HOSTILE:
            place = self.folder / "jobs" / name
            place.mkdir(parents=True)
            job = place / f"{name[:100]}.yaml"
            job.write_text(f"scene: {os.path.relpath(self.folder / 'cornell.glb', place)}\n")
            setup = place / "setup"
            setup.write_text("ready=yes\n")
            script = self.submit("--dry-run", "--setup", str(setup), "-o", str(place / "out"), "--", str(job),
                                 folder=place).stdout
            self.assertEqual(subprocess.run(["bash", "-n"], input=script, text=True, capture_output=True).stderr, "",
                             name)
            self.assertEqual(len(re.findall("(?m)^#SBATCH --nodes", script)), 1, name)
            with self.run_script(script) as run:
                words = run.communicate(timeout=20)[0]
            self.assertEqual(run.returncode, 0, words)
            seen = (self.folder / "seen").read_bytes()
            (self.folder / "seen").unlink()
            arguments = seen.removesuffix(b"\0\0").split(b"\0")
            self.assertEqual(os.fsdecode(arguments[-1]), str(job))
            self.assertEqual(os.fsdecode(arguments[arguments.index(b"--output") + 1]), str(place / "out"))
        self.assertEqual([str(path) for path in self.folder.rglob("broken*")], [])

    def test_an_array_takes_every_file_once(self):
        jobs = self.folder / "jobs"
        jobs.mkdir()
        names = [f"{i} {name[:50].replace('/', '')}.yaml" for i, name in enumerate(HOSTILE)]
        for name in names:
            (jobs / name).write_text("scene: ../cornell.glb\n")
        self.program("mpirun", f"#!/bin/bash\nprintf '%s' \"${{@: -1}}\" > {self.folder}/job\n")
        script = self.submit("--dry-run", "--array", "jobs/*.yaml").stdout
        self.assertIn(f"#SBATCH --array=0-{len(names) - 1}\n", script)
        if shutil.which("shellcheck") is not None:
            self.assertEqual(subprocess.run(["shellcheck", "-"], input=script, text=True, capture_output=True).stdout,
                             "", "with all names in it")
        found = set()
        for task in range(len(names)):
            with self.run_script(script, SLURM_ARRAY_TASK_ID=str(task)) as run:
                run.communicate(timeout=20)
            found.add(os.fsdecode((self.folder / "job").read_bytes()))
        self.assertEqual(found, {str(jobs / name) for name in names})

    def test_two_bakes_in_one_folder_are_refused(self):
        (self.folder / "a").mkdir()
        for name in ("x.yaml", "a/x.yaml"):
            (self.folder / name).write_text(f"scene: {self.folder}/cornell.glb\n")
        self.assertIn("give each its own `output`", self.submit("--dry-run", "x.yaml", "a/x.yaml", code=64).stderr)

    def test_slurm_words_are_checked(self):
        for words in (["--partition", "a b"], ["--partition", "x\n#SBATCH y"], ["--account", "$(x)"],
                      ["--time", "soon"], ["--time", "-1"]):
            self.assertIn("is not", self.submit("--dry-run", "cornell.glb", *words, code=64).stderr)

    def test_broken_jobs_are_refused_before_they_queue(self):
        (self.folder / "bad.yaml").write_text("scene: cornell.glb\nbounzes: 3\n")
        self.assertIn("bad.yaml:2", self.submit("bad.yaml", code=65).stderr)
        (self.folder / "gone.yaml").write_text("scene: gone.glb\n")
        self.assertIn("gone.glb", self.submit("gone.yaml", code=66).stderr)
        self.submit("--array", "none*.yaml", code=66)

    def test_shellcheck(self):
        if shutil.which("shellcheck") is None:
            self.skipTest("shellcheck is not installed")
        for words in ([], ["--gpus", "4", "--nodes", "3", "--memory", "0.5", "--time", "1-0", "--partition", "p",
                           "--account", "a"],
                      ["--threads", "3", "--ranks-per-node", "2", "--setup", "x y"], ["--nodes", "2", "--tries", "3"],
                      ["--warning", "5"],
                      ["--gpus", "2", "--nodes", "2", "--tries", "2", "--threads", "7", "--setup", "$x"]):
            script = self.submit("--dry-run", "cornell.glb", *words).stdout
            done = subprocess.run(["shellcheck", "-"], input=script, text=True, capture_output=True)
            self.assertEqual(done.stdout, "")

    def test_submitting(self):
        self.program("sbatch",
                     f"#!/bin/sh\ncat > {self.folder}/script\nprintf '%s ' \"$@\" \"$LD_LIBRARY_PATH\" > "
                     f"{self.folder}/words\necho '42;cluster'\n")
        answer = json.loads(self.submit("cornell.glb", "--json", "--gpus", "2").stdout)
        self.assertEqual((answer["status"], answer["job"]), ("done", "42"))
        script = (self.folder / "script").read_text()
        self.assertEqual(script, self.submit("cornell.glb", "--dry-run", "--gpus", "2").stdout)
        self.assertIn("#SBATCH --ntasks-per-node=2\n", script)
        self.assertIn("--backend vulkan", script)
        self.assertIn("kiln status", self.submit("cornell.glb").stdout)
        self.program("sbatch", "#!/bin/sh\nexec >&2\necho no such partition\nexit 1\n")
        refused = self.submit("cornell.glb", code=78).stderr
        self.assertIn("no such partition", refused)


class Judge(Place):
    """What the script makes of the end of mpirun."""

    def setUp(self):
        super().setUp()
        self.program("scontrol", "#!/bin/sh\necho \"scontrol $*\"\n")
        self.script = self.submit("--dry-run", "-o", "out dir", "cornell.glb").stdout

    def outcome(self, code, attempt=0, checkpoint=False):
        make = ("mkdir -p 'out dir/checkpoint/gen-000002'; "
                "touch 'out dir/checkpoint/gen-000002/manifest'; ") if checkpoint else ""
        self.program("mpirun", f"#!/bin/bash\n{make}exit {code}\n")
        with self.run_script(self.script, SLURM_RESTART_COUNT=str(attempt)) as run:
            words = run.communicate(timeout=20)[0]
        self.assertEqual(run.returncode, code)
        return "scontrol requeue 7" in words.splitlines()

    def test_what_fails_again_is_not_tried_again(self):
        for code in (0, 64, 65, 66, 69, 70, 71, 73, 74, 77, 78):
            self.assertFalse(self.outcome(code), code)

    def test_a_lost_rank_or_node_is(self):
        for code in (1, 76, 137, 205, 255):
            self.assertTrue(self.outcome(code), code)

    def test_not_for_ever(self):
        self.assertFalse(self.outcome(137, attempt=3))
        self.assertTrue(self.outcome(137, attempt=3, checkpoint=True), "there is progress")

    def test_a_stop_on_request_rests(self):
        self.assertFalse(self.outcome(75))

    def test_the_warning_reaches_the_bake_and_it_goes_back(self):
        for number in (signal.SIGUSR1, signal.SIGTERM):
            self.program("mpirun",
                         f"#!/bin/bash\ntrap 'echo saved; exit 75' USR1\ntouch {self.folder}/up\nwhile :; do sleep "
                         f"0.1; done\n")
            with self.run_script(self.script) as run:
                while not (self.folder / "up").exists():
                    time.sleep(0.05)
                run.send_signal(number)
                words = run.communicate(timeout=20)[0]
            (self.folder / "up").unlink()
            self.assertIn("saved", words)
            self.assertIn("scontrol requeue 7", words)
            self.assertEqual(run.returncode, 75)


class Lost(Place):
    """What the script does when nodes are lost. Slurm here has the nodes n1, n2 and n3; those of them that are files in
    the folder `dead` do not answer. Each try of mpirun runs its line of `tries` and leaves its words in `seen`."""

    def setUp(self):
        super().setUp()
        (self.folder / "dead").mkdir()
        self.program("scontrol", "#!/bin/sh\n[ \"$1\" = requeue ] && echo \"scontrol $*\" || printf 'n%s\\n' 1 2 3\n")
        self.program("srun",
                     f"#!/bin/sh\nfor word; do case $word in --nodelist=*) node=${{word#*=}};; esac; done\n[ ! -e "
                     f"{self.folder}/dead/$node ] && echo $node\n")
        self.program("mpirun",
                     f"#!/bin/bash\necho \"$*\" >> {self.folder}/seen\neval \"$(sed -n \"$(wc -l < "
                     f"{self.folder}/seen)p\" {self.folder}/tries)\"\n")

    def outcome(self, code, *tries, options=()):
        """The hosts of each try, and whether the job goes back into the queue."""
        script = self.submit("--dry-run", "-o", "out", "--nodes", "3", "--tries", "3", *options, "cornell.glb").stdout
        (self.folder / "tries").write_text("".join(f"cd {self.folder}/dead; {line}\n" for line in tries))
        with self.run_script(script) as run:
            words = run.communicate(timeout=20)[0]
        self.assertEqual(run.returncode, code, words)
        lines = (self.folder / "seen").read_text().splitlines()
        return [re.sub("--map-by.*", "", line.removeprefix("--host ")).strip()
                for line in lines], "scontrol requeue 7" in words.splitlines()

    def test_the_others_go_on(self):
        self.assertEqual(self.outcome(0, "touch n2; exit 205", "exit 0"), (["", "n1:1,n3:1"], False))

    def test_ranks_of_each(self):
        self.assertEqual(self.outcome(0, "touch n1; exit 137", "exit 0", options=["--gpus", "4"]),
                         (["", "n2:4,n3:4"], False))

    def test_three_tries(self):
        self.assertEqual(self.outcome(205, "touch n2; exit 205", "touch n3; exit 205", "touch n1; rm n2; exit 205"),
                         (["", "n1:1,n3:1", "n1:1"], True))

    def test_a_node_that_comes_back_is_taken_again_once(self):
        tries = ["touch n2; exit 205", "touch n3; rm n2; exit 205", "touch n2; rm n3; exit 205",
                 "touch n1; rm n2; exit 205", "exit 0"]
        self.assertEqual(self.outcome(0, *tries, options=["--tries", "9"])[0],
                         ["", "n1:1,n3:1", "n1:1,n2:1", "n1:1,n3:1", "n3:1"])

    def test_only_on_request(self):
        self.assertIn("\n#SBATCH --no-kill\n",
                      self.submit("--dry-run", "--nodes", "3", "--tries", "3", "cornell.glb").stdout)
        self.assertNotIn("--no-kill", self.submit("--dry-run", "--nodes", "3", "cornell.glb").stdout)

    def test_a_rank_that_died_is_for_the_queue(self):
        self.assertEqual(self.outcome(137, "exit 137"), ([""], True))
        (self.folder / "seen").unlink()
        self.assertEqual(self.outcome(205, "touch n2; exit 205", "exit 205", options=["--tries", "1"]), ([""], True))

    def test_an_end_is_an_end(self):
        for code, again in ((0, False), (65, False), (71, False), (75, False)):
            self.assertEqual(self.outcome(code, f"touch n2; exit {code}"), ([""], again))
            (self.folder / "seen").unlink()

    def test_too_little_memory_on_fewer_nodes_is_for_the_queue(self):
        self.assertEqual(self.outcome(76, "touch n2; exit 205", "exit 71"), (["", "n1:1,n3:1"], True))

    def test_nobody_answers(self):
        self.assertEqual(self.outcome(205, "touch n1 n2 n3; exit 205"), ([""], True))

    def test_a_warning_meanwhile(self):
        self.assertEqual(self.outcome(205, "trap : USR1; touch n2; kill -USR1 $PPID; sleep 1; exit 205"), ([""], True))


if __name__ == "__main__":
    unittest.main()
