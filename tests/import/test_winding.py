"""Triangles wound against their normals: how many is said, of each object; --trust decides which of the two is their
front."""
import os
import sys

import importing
from importing import kiln

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
import numpy as np  # noqa: E402


def scene(path):
    """Three floors under a sun of 2 W/m2, with normals upward: one wound so, one with half of its 32 triangles wound
    otherwise, one with all."""
    s = glb.Scene()
    grey = s.material("grey", (0.5, 0.5, 0.5))
    for name, x, wrong in (("right", 0, lambda k: False), ("half", 2, lambda k: k >= 16), ("wrong", 4, lambda k: True)):
        s.quad(name, [(x, 0, 0), (x + 1, 0, 0), (x + 1, 0, -1), (x, 0, -1)], grey, cuts=4)
        accessor = s.document["accessors"][s.document["meshes"][-1]["primitives"][0]["indices"]]
        at = s.document["bufferViews"][accessor["bufferView"]]["byteOffset"]
        corners = np.frombuffer(bytes(s.blob[at:at + 4 * accessor["count"]]), np.uint32).reshape(-1, 3).copy()
        for k in range(len(corners)):
            if wrong(k):
                corners[k] = corners[k][[0, 2, 1]]
        s.blob[at:at + corners.nbytes] = corners.tobytes()
    s.document["nodes"].append({"name": "mirrored", "mesh": 2, "scale": [-1, 1, 1], "translation": [0, 0, 3]})
    s.document["scenes"][0]["nodes"].append(3)
    s.light("Sun", {"type": "directional", "intensity": 2.0, "color": [1, 1, 1]},
            rotation=[-0.7071067811865476, 0, 0, 0.7071067811865476])
    return s.write(path)


class Winding(importing.Case):
    def setUp(self):
        self.scene = scene(os.path.join(self.folder(), "scene.glb"))

    def notes(self, path, *options):
        return [n["text"] for n in self.accepted(path, *options)["notes"] if "winding" in n["text"]]

    def test_is_said_of_each_object(self):
        notes = self.notes(self.scene, "--texels-per-metre", 8)
        self.assertEqual(len(notes), 3, notes)
        for note, words in zip(notes, (('"half"', "16 of 32"), ('"wrong"', "32 of 32"), ('"mirrored"', "32 of 32"))):
            for word in (*words, "--trust normals", "the winding decides"):
                self.assertIn(word, note)
        self.assertEqual([n for n in self.notes(self.scene, "--texels-per-metre", 8, "--trust", "normals")
                          if "the normals decide" not in n], [])
        check = kiln("check", self.scene)
        self.assertEqual(check.out.count("--trust normals"), 3, check.out)

    def test_light(self):
        for trust, expected in (("winding", {"right": 2, "half": 1, "wrong": 0, "mirrored": 0}),
                                ("normals", {"right": 2, "half": 2, "wrong": 2, "mirrored": 2})):
            out = os.path.join(self.folder(), trust)
            answer = kiln("bake", self.scene, "-o", out, "--texels-per-metre", 8, "--trust", trust, "--samples-direct",
                          4, "--samples-probe", 0,
                          "--bounces", 0, "--no-preview", "--backend", "embree")
            self.assertEqual(answer.code, 0, answer.err)
            self.assertEqual(answer.err.count("to the back of their winding"), 3 if trust == "winding" else 0,
                             answer.err)
            for name, mean in expected.items():
                channels, _ = exr.read(os.path.join(out, "lightmaps", name + ".exr"))
                self.assertAlmostEqual(float(channels["direct.G"].mean()), mean, delta=1e-5 if mean != 1 else 0.01,
                                       msg=f"{trust}: {name}")

    def test_a_solid_turned_inside_out(self):
        path = os.path.join(importing.want_shared("own"), "nasty_valid.glb")
        inward = lambda *options: [p["place"] for p in kiln("check", path, "--json", *options).json()["problems"]
                                   if "inward" in p["text"]]
        self.assertIn("mesh 'inverted_winding'", inward())
        self.assertNotIn("mesh 'inverted_winding'", inward("--trust", "normals"))
        self.assertTrue(any("inverted_winding" in n for n in self.notes(path)))

    def test_refused(self):
        answer = kiln("info", self.scene, "--trust", "me")
        self.assertEqual(answer.code, 64)
        self.assertIn("winding, normals", answer.sentence())


if __name__ == "__main__":
    importing.main()
