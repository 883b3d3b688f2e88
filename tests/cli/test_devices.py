"""What kiln says of devices, and what it does when there is none. Needs no GPU: a machine without a driver is
played."""
import json
import os
import unittest

from kiln_cli import InOwnFolder, kiln, run_json

NO_DRIVER = ["env", "VK_DRIVER_FILES=/nonexistent", "VK_ICD_FILENAMES=/nonexistent"]
FAST = ["--quality", "draft", "--texels-per-metre", "4", "--samples-probe", "0", "--quiet"]


class Devices(InOwnFolder):
    def setUp(self):
        super().setUp()
        self.scene = os.path.join(self.folder, "cornell.glb")
        self.assertEqual(kiln("generate", "cornell", "-o", self.scene).code, 0)

    def bake(self, *options, prefix=()):
        return kiln("bake", self.scene, "-o", os.path.join(self.folder, "out"), *FAST, *options, prefix=prefix)

    def test_list(self):
        answer = kiln("info", "--devices", "--json")
        self.assertEqual(answer.code, 0, answer.err)
        listed = json.loads(answer.out)
        self.assertEqual(listed["status"], "done")
        self.assertRegex(listed["embree"]["version"], r"^3\.\d+\.\d+$")
        self.assertGreaterEqual(listed["embree"]["threads"], 1)
        for number, device in enumerate(listed["vulkan"]):
            self.assertEqual(device["device"], number)
            self.assertEqual(device["fit"], device["lacks"] == "")
        words = kiln("info", "--devices")
        self.assertEqual(words.code, 0)
        self.assertIn(listed["embree"]["version"], words.out)
        for device in listed["vulkan"]:
            self.assertIn(device["name"], words.out)

    def test_no_driver(self):
        answer = kiln("info", "--devices", prefix=NO_DRIVER)
        self.assertEqual(answer.code, 0, answer.err)
        self.assertIn("no device", answer.out)
        refused = self.bake("--backend", "vulkan", prefix=NO_DRIVER)
        self.assertEqual(refused.code, 69)
        self.assertRegex(refused.sentence(), "no Vulkan device.*found: none")
        self.assertEqual(self.bake("--backend", "auto", prefix=NO_DRIVER).code, 0)

    def test_no_such_device(self):
        refused = self.bake("--backend", "vulkan", "--device", "1000")
        self.assertEqual(refused.code, 69)
        self.assertIn("1000", refused.sentence())

    def test_software_is_not_taken_unasked(self):
        listed = json.loads(kiln("info", "--devices", "--json").out)
        if any(device["fit"] and not device["software"] for device in listed["vulkan"]):
            self.skipTest("there is a GPU here")
        self.assertEqual(self.bake("--backend", "auto").code, 0)
        backend = run_json(os.path.join(self.folder, "out"))["backend"]
        self.assertEqual(backend["name"], "embree")
        self.assertEqual(sorted(backend["kernels"]), ["direct", "gather", "validity"])
        self.assertEqual(backend["because"]["let_through"], "none")
        self.assertEqual(backend["because"]["lights"]["emissive_triangles"], 2)
        self.assertEqual(backend["because"]["lights"]["environment"], "none")

    def test_arguments(self):
        for arguments in (["info", "--devices", self.scene], ["bake", self.scene, "--verify-fraction", "1.5"],
                          ["bake", self.scene, "--device", "-2"]):
            self.assertEqual(kiln(*arguments).code, 64, arguments)


if __name__ == "__main__":
    unittest.main()
