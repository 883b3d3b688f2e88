"""What a bake says on its way and at its end: lines without control characters, a table that adds up, one sentence for
all ranks."""
import json
import os
import re
import subprocess
import tempfile
import unittest

from kiln_cli import KILN, kiln, run_json

RANKS = ["mpirun", "--bind-to", "none", "-n"]
SMALL = ["--backend", "embree", "--quality", "draft", "--lightmap-size", "24", "--bounces", "1", "--threads", "1"]


class End(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = cls.enterClassContext(tempfile.TemporaryDirectory())
        cls.scene = os.path.join(cls.folder, "cornell.glb")
        cls.out = os.path.join(cls.folder, "out")
        subprocess.run([KILN, "generate", "cornell", "-o", cls.scene], check=True, stdout=subprocess.DEVNULL)
        cls.answer = kiln("bake", cls.scene, "-o", cls.out, *SMALL, prefix=[*RANKS, "2"], timeout=120)

    def test_progress_is_plain_lines(self):
        self.assertEqual(self.answer.code, 0, self.answer.err)
        self.assertRegex(self.answer.err, r"(?m)^import")
        self.assertRegex(self.answer.err, r"\A[\n -~]*\Z")

    def test_progress_is_of_the_whole(self):
        """A bake as kiln status sees it: one share, which does not fall, and seconds left."""
        out = os.path.join(self.folder, "watched")
        bake = subprocess.Popen([KILN, "bake", self.scene, "-o", out, "--backend", "embree", "--quality", "8%",
                                 "--lightmap-size", "128", "--threads", "1"],
                                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        seen = []
        while bake.poll() is None:
            answer = kiln("status", out, "--json")
            if answer.code == 0:
                seen.append(json.loads(answer.out))
        lines = bake.communicate()[1]
        self.assertEqual(bake.returncode, 0, lines)
        shares = [said["share"] for said in seen if "share" in said]
        self.assertGreater(len(shares), 1, seen)
        self.assertEqual(shares, sorted(shares))
        self.assertTrue(0 <= shares[0] and shares[-1] <= 1, shares)
        self.assertTrue(all(said["seconds_left"] >= 0 for said in seen if "seconds_left" in said))
        said = [int(percent) for percent in re.findall(r"(?m)^.*: (\d+) %, .* left$", lines)]
        self.assertEqual(said, sorted(said), lines)

    def test_error_is_of_published_light(self):
        """The error reached, where it is worst and what would help most: the same on any number of ranks; and no figure
        of raw samples without that word."""
        found = []
        for ranks in (1, 2):
            out = os.path.join(self.folder, f"published{ranks}")
            answer = kiln("bake", self.scene, "-o", out, "--backend", "embree", "--quality", "8%", "--lightmap-size",
                          "48", "--threads", "1", prefix=[*RANKS, str(ranks)], timeout=120)
            self.assertEqual(answer.code, 0, answer.err)
            report = run_json(out)
            self.assertIn(report["error"]["worst"]["object"], [entry["name"] for entry in report["objects"]])
            found.append((report["error"]["published"], report["error"]["worst"], report["improve"]["option"]))
            self.assertRegex(answer.out, r"(?m)^error +[\d.]+ %: 95 % of the texels are less than that off \(asked: 8")
            self.assertRegex(answer.out, "(?m)^worst in +'%s', " % report["error"]["worst"]["object"])
            self.assertIn("improve it   " + report["improve"]["option"] + ": ", answer.out)
            self.assertEqual(kiln("report", out).code, 0)
            with open(os.path.join(out, "report.html"), encoding="utf-8") as file:
                page = file.read()
            for text in (answer.out, answer.err, page):
                self.assertEqual(len(re.findall("standard error", text)), text.count("standard error of raw samples"))
            self.assertIn(report["improve"]["option"], page)
        self.assertEqual(found[0], found[1])

    def test_phases_add_up_to_the_time(self):
        """On a busy machine a rank may be kept from running between two phases; so one of three bakes must do."""
        for attempt in range(3):
            path = os.path.join(self.folder, f"again{attempt}") if attempt > 0 else self.out
            if attempt > 0:
                kiln("bake", self.scene, "-o", path, *SMALL, prefix=[*RANKS, "2"], timeout=120)
            report = run_json(path)
            whole, missing = report["seconds"], []
            for rank in range(2):
                late = 0.1 if rank > 0 else 0  # s: ranks do not start at the same moment
                spent = sum(phase["per_rank"][rank] for phase in report["phases"])
                missing.append(abs(spent - whole) - late)
            if max(missing) <= 0.01 * whole:
                return
        self.fail(f"{missing} s of {whole}: {report['phases']}")

    def test_table(self):
        lines = self.answer.out.splitlines()
        head = lines.index("phase           least s  mean s  slowest s  imbalance  of all")
        shares = [float(line.split()[-2]) for line in lines[head + 1:lines.index("", head)]]
        self.assertGreater(len(shares), 10)
        self.assertAlmostEqual(sum(shares), 100, delta=2)
        self.assertRegex(self.answer.out, r"(?m)^peak memory of a rank [\d.]+ MiB")

    def test_status_of_what_is_done(self):
        answer = kiln("status", self.out)
        self.assertEqual(answer.code, 0)
        self.assertRegex(answer.out, r"(?m)^state +done$")
        self.assertRegex(answer.out, r"(?m)^next +kiln report")
        said = json.loads(kiln("status", self.out, "--json").out)
        self.assertEqual((said["status"], said["state"]), ("done", "done"))
        self.assertEqual(kiln("status", self.folder).code, 66)

    def test_damage_is_one_object(self):
        """The verdict, and no second object for the failure."""
        path = os.path.join(self.out, "preview.png")
        with open(path, "ab") as file:
            file.write(b"x")
        try:
            answer = kiln("verify", self.out, "--json")
        finally:
            os.truncate(path, os.path.getsize(path) - 1)
        self.assertEqual(answer.code, 65)
        verdict = json.loads(answer.out)
        self.assertEqual([verdict["status"], [problem["file"] for problem in verdict["problems"]]],
                         ["damaged", ["preview.png"]])

    def test_what_is_no_bake(self):
        for command in ("view", "probe", "report", "status", "stop", "verify"):
            for place, words in ((self.scene, "is a file; name the folder"),
                                 (os.path.join(self.folder, "none"), "No such file")):
                answer = kiln(command, place, *(["0", "0", "0"] if command == "probe" else []))
                self.assertEqual(answer.code, 66, command)
                self.assertIn(words, answer.sentence())

    def test_a_timeline_that_cannot_be_written_is_refused_before_the_bake(self):
        out = os.path.join(self.folder, "refused")
        answer = kiln("bake", self.scene, "-o", out, "--trace", os.path.join(self.folder, "none", "t.json"), *SMALL)
        self.assertEqual(answer.code, 73)
        self.assertIn("t.json", answer.sentence())
        self.assertFalse(os.path.exists(out))

    def test_names_that_are_not_unicode(self):
        """A folder's name is bytes; the report says what can be said of it."""
        out = os.path.join(self.folder, "light-\udcff")
        answer = kiln("bake", self.scene, "-o", out, *SMALL, "--no-preview", "--json", timeout=120)
        self.assertEqual(answer.code, 0, answer.err)
        self.assertTrue(json.loads(answer.out)["output"].endswith("light-?"))

    def test_an_error_is_said_once(self):
        for arguments, code in ((["bake", "/nowhere.glb"], 66), (["bake", self.scene, "--bounce", "3"], 64),
                                (["bake", self.scene, "-o", "/proc/none/out", *SMALL], 73)):
            answer = kiln(*arguments, prefix=[*RANKS, "8"], timeout=120)
            self.assertEqual(answer.code, code, answer.err)
            self.assertGreater(len(answer.sentence()), 20)


if __name__ == "__main__":
    unittest.main()
