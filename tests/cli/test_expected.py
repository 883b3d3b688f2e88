"""Time that a bake and a plan expect: every phase on both backends, what is over as measured, more for a finer error;
said before the light, and not by a quiet bake."""
import json
import os
import re
import unittest

from kiln_cli import InOwnFolder, kiln, run_json

FEW = ["--quality", "draft", "--bounces", "1", "--threads", "1", "--samples-probe", "16", "--texels-per-metre", "2",
       "--no-resume"]


def whole(reckoned):
    return sum(seconds for phase, seconds in reckoned.items() if phase != "total")


class Expected(InOwnFolder):
    def setUp(self):
        super().setUp()
        self.scene = os.path.join(self.folder, "cornell.glb")
        self.out = os.path.join(self.folder, "out")
        self.assertEqual(kiln("generate", "cornell", "-o", self.scene).code, 0)

    def bake(self, *options):
        answer = kiln("bake", self.scene, "-o", self.out, *FEW, *options, timeout=240)
        self.assertEqual(answer.code, 0, answer.err)
        return answer, run_json(self.out)

    def plan(self, *options):
        answer = kiln("plan", self.scene, "--threads", "1", "--texels-per-metre", "2", "--json", *options, timeout=240)
        self.assertEqual(answer.code, 0, answer.err)
        return json.loads(answer.out)["seconds"]

    def test_bake(self):
        answer, run = self.bake("--backend", "embree")
        expected, choice = run["expected"], run["backend"]["choice"]
        said = re.findall(r"kiln: about (\S+ \S+) expected on the processors, (\S+ \S+) of it light; "
                          r"by a trial an error of 20 % after 1 round\n", answer.err)
        self.assertEqual(len(said), 1, answer.err)
        foretold = run["foretold"]
        self.assertEqual((1, 1, False), tuple(foretold[key] for key in (
            "rounds", "samples_over_first_round", "limited")))
        self.assertTrue(foretold["tried_tiles"] > 0 and 0.0 < foretold["error"] < 0.2)
        self.assertAlmostEqual(expected["total"], whole(expected), places=6)
        taken = {phase["name"]: phase["seconds"]["max"] for phase in run["phases"]}
        for phase in ("import", "scene and BVH", "surface points", "validity"):
            self.assertAlmostEqual(expected.get(phase, 0.0), taken[phase], places=6)
        for phase in ("direct light", "final gather", "probes", "denoising", "lightmaps", "kiln.h5", "preview"):
            self.assertGreater(expected[phase], 0.0)
            self.assertGreater(choice["vulkan"][phase], 0.0)
        for backend in ("embree", "vulkan"):
            self.assertAlmostEqual(choice[backend]["total"], whole(choice[backend]), places=6)
            self.assertEqual(choice[backend]["total"], choice[backend + "_seconds"])
        self.assertNotIn("kernels", choice["embree"])

    def test_quiet(self):
        answer, run = self.bake("--backend", "embree", "--quiet")
        self.assertEqual(answer.err, "")
        self.assertGreater(run["expected"]["total"], 0.0)

    def test_auto(self):
        answer, run = self.bake("--backend", "auto")
        if run["backend"]["choice"]["why"].startswith("processors"):
            self.assertRegex(answer.err, r"expected on the processors, .* of it light; .*; --backend vulkan with a GPU")

    def test_trial(self):
        """Less noise takes more rounds; a time has an error of its own; counts of samples have nothing to try."""
        rounds = []
        for quality in ("20%", "3%"):
            answer, run = self.bake("--backend", "embree", "--quality", quality)
            rounds.append(run["foretold"]["rounds"])
            self.assertIn("by a trial an error of", answer.err)
            self.assertLessEqual(abs(rounds[-1] - run["error"]["rounds"]), 2)  # each doubles the samples at most
            self.assertGreater(run["foretold"]["total_after_first_round"], 0.0)
        self.assertGreater(rounds[1], rounds[0])
        answer, run = self.bake("--backend", "embree", "--time", "2")
        said = re.search(r"by a trial an error of (\S+) % after", answer.err)
        self.assertAlmostEqual(float(said[1]), 100 * run["foretold"]["error"], delta=0.06 * float(said[1]))
        answer, run = self.bake("--backend", "embree", "--samples-direct", "16", "--samples-indirect", "32")
        self.assertNotIn("foretold", run)
        self.assertNotIn("by a trial", answer.err)

    def test_plan(self):
        seconds = self.plan("--backend", "embree", "--quality", "20%")
        reckoned = seconds["backends"]
        self.assertEqual(reckoned["assumed"], "embree")
        for backend in ("embree", "vulkan"):
            self.assertAlmostEqual(reckoned[backend]["total"], whole(reckoned[backend]), places=6)
        here = reckoned["embree"]
        for phase, name in (("import", "import"), ("validity", "validity"), ("direct light", "direct"),
                            ("final gather", "final"), ("probes", "probes")):
            self.assertAlmostEqual(here.get(phase, 0.0), seconds[name], places=6)
        self.assertLess(abs(seconds["total"] - here["total"] - seconds["exchange"] - seconds["checkpoints"]), 0.01)
        self.assertEqual(reckoned["rounds"]["rounds"], 1)
        fine = self.plan("--backend", "embree", "--quality", "1%")["backends"]
        self.assertGreater(fine["rounds"]["samples_over_first_round"], 1.0)
        for backend in ("embree", "vulkan"):
            for phase in ("direct light", "final gather"):
                self.assertGreater(fine[backend][phase], reckoned[backend][phase])


if __name__ == "__main__":
    unittest.main()
