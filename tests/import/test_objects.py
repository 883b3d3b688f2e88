"""Settings of single objects, in a node's extras and in jobs: what they do to lightmaps and to light."""
import os
import sys

import importing
from importing import kiln, run_json

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402


def scene(path, extras=(), names=("Floor", "Awning", "Lamp", "Post.001", "Post.002"), lit_awning=False):
    """A floor of 4 m x 4 m, half of it under an awning at 1 m, a sun from above, a lamp, two posts beside. `extras`: by
    name."""
    s = glb.Scene()
    grey = s.material("grey", (0.5, 0.5, 0.5))
    bright = s.material("bright", (0.5, 0.5, 0.5), (10, 10, 10))
    s.quad(names[0], [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], grey)
    # its front looks down
    s.quad(names[1], [(0, 1, -2), (2, 1, -2), (2, 1, 2), (0, 1, 2)], bright if lit_awning else grey)
    s.quad(names[2], [(-1.6, 2, -0.1), (-1.4, 2, -0.1), (-1.4, 2, 0.1), (-1.6, 2, 0.1)], bright)
    for name, x in zip(names[3:], (-1.9, -1.8)):
        s.quad(name, [(x, 0, -1.9), (x + 0.05, 0, -1.9), (x + 0.05, 0.3, -1.9), (x, 0.3, -1.9)], grey)
    s.light("Sun", {"type": "directional", "intensity": 2.0, "color": [1, 1, 1]},
            rotation=[-0.7071067811865476, 0, 0, 0.7071067811865476])
    for node in s.document["nodes"]:
        if node["name"] in dict(extras):
            node["extras"] = dict(extras)[node["name"]]
    return s.write(path)


class Objects(importing.Case):
    def setUp(self):
        self.at = self.folder()
        self.scene = scene(os.path.join(self.at, "scene.glb"))

    def objects(self, *options, path=None):
        data = self.accepted(path or self.scene, *options)
        return {o["original_name"]: o for o in data["objects"]}, [n["text"] for n in data["notes"]]

    def job(self, text, *options):
        path = importing.write(self.at, "job.yaml", ("scene: scene.glb\n" + text).encode())
        return self.objects(*options, path=path)

    def test_a_file_asks_for_so_many_texels_only(self):
        path = scene(os.path.join(self.at, "large.glb"), {"Floor": {"kiln": {"lightmap-size": 32768}}})
        self.refused(path, ("settings in the file", "ask for lightmaps of 1074 million texels"))
        objects, _ = self.objects("--objects", "{Floor: {lightmap-size: 64}}", path=path)
        self.assertEqual(objects["Floor"]["lightmap"], [64, 64])

    def test_settings_reach_the_lightmaps(self):
        plain, _ = self.objects("--texels-per-metre", 20)
        self.assertEqual({o["density_reason"] for o in plain.values()}, {"common"})
        objects, notes = self.job(
            'texels-per-metre: 20\nobjects:\n  "Post.*":\n    density-scale: 3\n  Post.002: {density-scale: 10}\n'
                                  "  Lamp: {exclude: true}\n  Fl?or:\n    lightmap-size: 64\n  Awning: {role: "
                                  "caster-only}\n  \"Sofa*\": {exclude: true}\n")
        self.assertEqual(sorted(objects), ["Awning", "Floor", "Post.001", "Post.002"])
        self.assertEqual(objects["Floor"]["lightmap"], [64, 64])
        self.assertEqual([v // 4 for v in plain["Awning"]["lightmap"]], objects["Awning"]["lightmap"])
        self.assertEqual([3 * v for v in plain["Post.001"]["lightmap"]], objects["Post.001"]["lightmap"])
        self.assertEqual([10 * v for v in plain["Post.002"]["lightmap"]], objects["Post.002"]["lightmap"],
                         "the later rule wins")
        self.assertEqual({n: o["density_reason"] for n, o in objects.items()},
                         {"Floor": "lightmap-size", "Awning": "caster-only", "Post.001": "density-scale",
                          "Post.002": "density-scale"})
        self.assertEqual(objects["Awning"]["role"], "caster-only")
        self.assertTrue(any("'Sofa*'" in n and "no object" in n for n in notes), notes)
        self.assertTrue(any(n.startswith("1 objects are left out") for n in notes), notes)
        line, _ = self.objects("--texels-per-metre", 20, "--objects",
                               "{Lamp: {exclude: true}, 'P*': {density-scale: 3}}")
        self.assertNotIn("Lamp", line)
        self.assertEqual(line["Post.002"]["lightmap"], objects["Post.001"]["lightmap"])

    def test_document(self):
        path = scene(os.path.join(self.at, "extras.glb"), {
            "Floor": {"kiln": {"lightmap-size": 32, "colour": 3}}, "Lamp": {"kiln_exclude": 1, "other": {}},
            "Post.001": {"kiln-density-scale": 2.0},
            "Awning": {"kiln": {"role": "receiver-only", "sides": "two"}, "kiln_lightmap": {"file": "x.exr"}}})
        plain, _ = self.objects("--texels-per-metre", 20)
        objects, notes = self.objects("--texels-per-metre", 20, path=path)
        self.assertEqual(sorted(objects), ["Awning", "Floor", "Post.001", "Post.002"])
        self.assertEqual(objects["Floor"]["lightmap"], [32, 32])
        self.assertEqual([2 * v for v in plain["Post.001"]["lightmap"]], objects["Post.001"]["lightmap"])
        self.assertEqual(objects["Awning"]["role"], "receiver-only")
        self.assertEqual(len([n for n in notes if "no setting" in n]), 1, notes)
        self.assertTrue(any("nodes[0].extras" in n and "'colour'" in n for n in notes), notes)
        objects, _ = self.objects("--objects", "{Floor: {lightmap-size: 48}, Awning: {role: both}}", path=path)
        self.assertEqual(objects["Floor"]["lightmap"], [48, 48], "the job's rules come after the document's")
        self.assertEqual(objects["Awning"]["role"], "both")
        for key, value, words in (("density-scale", 0, "0.001 to 1000"), ("lightmap-size", 1.5, "whole number"),
                                  ("exclude", "yes", "true or false"),
                                  ("role", "caster", "caster-only"), ("sides", 2, "one or two")):
            bad = scene(os.path.join(self.at, "bad.glb"), {"Lamp": {"kiln": {key: value}}})
            self.refused(bad, ["nodes[2].extras", key, words])

    def test_refusals_name_the_place(self):
        for text, words in (("objects: 3\n", ["job.yaml:2", "objects"]),
                            ("objects:\n  A: 3\n", ["job.yaml:3", "'A'", "settings"]),
                            ("objects:\n  A:\n    size: 3\n", ["job.yaml:4", "'A'", "'size'", "'sides'"]),
                            ("objects:\n  A: {density-scale: fine}\n",
                             ["job.yaml:3", "density-scale", '"fine"', "0.001 to 1000"]),
                            ("objects:\n  A: {exclude: true}\n  A: {exclude: false}\n", ["job.yaml:4", "'A'", "twice"]),
                            ("objects:\n  A: {exclude: true, exclude: false}\n", ["job.yaml:3", "'exclude'", "twice"]),
                            ("objects:\n  A: {role: [both]}\n", ["job.yaml:3", "role", "list"]),
                            ("objects:\n  A: {role: both}\nobjects:\n  B: {role: both}\n",
                             ["job.yaml:4", "'objects'", "twice"]),
                            ("objects:\n" + "".join(f"  {'a' * 90}{i}: {{role: both}}\n" for i in range(900)),
                             ["too many"])):
            path = importing.write(self.at, "job.yaml", ("scene: scene.glb\n" + text).encode())
            answer = kiln("info", path)
            self.assertEqual(answer.code, 65, text[:80] + answer.err)
            for word in words:
                self.assertIn(word, answer.sentence())
        for text, word in (("Lamp", "{PATTERN"), ("{Lamp: {glow: 1}}", "'glow'"),
                           ("{Lamp: {role: lamp}}", "receiver-only"), ("{Lamp: ", "--objects:")):
            answer = kiln("info", self.scene, "--objects", text)
            self.assertEqual(answer.code, 64, text + answer.err)
            self.assertIn(word, answer.sentence())

    # ---- light ----

    BAKE = ("--texels-per-metre", 8, "--samples-direct", 64, "--samples-indirect", 256, "--samples-probe", 0,
            "--bounces", 2, "--json", "--no-preview")

    def bake(self, name, path, *options, backend="embree"):
        """What run.json says, and the lightmaps' means over the half of the floor under the awning and the other, and
        of the awning."""
        out = os.path.join(self.at, name)
        answer = kiln("bake", path, "-o", out, *self.BAKE, "--backend", backend, *options)
        if backend == "vulkan" and answer.code == 69:
            self.skipTest("no device for Vulkan: " + (answer.sentence() or ""))
        self.assertEqual(answer.code, 0, answer.err)
        run = run_json(out)
        means = {}
        for entry in run["objects"]:
            if entry["lightmap"] is not None:
                channels, _ = exr.read(os.path.join(out, entry["lightmap"]))
                means[entry["name"]] = channels["G"]
        floor = means.get("Floor")
        return run, float(floor[:, floor.shape[1] * 5 // 8:floor.shape[1] * 7 // 8].mean()), means

    def view(self, name, *options):
        out = os.path.join(self.at, name)
        self.assertEqual(kiln("verify", out).code, 0)
        answer = kiln("view", out, "-o", os.path.join(out, "v.exr"), "--from", "1,0.3,5", "--to", "1,0.9,0", "--width",
                      64, "--backend", "embree", *options)
        self.assertEqual(answer.code, 0, answer.err)
        return exr.read(os.path.join(out, "v.exr"))[0]["G"]

    def receiver(self, backend):
        # both backends have the same samples: without the awning one of them is enough
        _, without, _ = self.bake("without", self.scene, "--objects", "{Awning: {exclude: true}}")
        receiver, met, means = self.bake("receiver", self.scene, "--objects", "{Awning: {role: receiver-only}}",
                                         "--preview", backend=backend)
        self.assertAlmostEqual(met / without, 1.0, delta=0.01, msg="no ray meets it")
        self.assertGreater(means["Awning"].mean(), 0.3, "it sees the lit floor")
        self.assertLess(receiver["energy"]["relative_residual"], 0.02)
        return without

    def test_receiver_on_vulkan(self):
        self.receiver("vulkan")

    def test_roles(self):
        without = self.receiver("embree")
        more = ("--samples-bounce", 128)  # the light in the shade is that of bounces
        _, shaded, _ = self.bake("plain", self.scene, "--preview", *more)
        self.assertGreater(without, 4 * shaded, "the awning shades the floor")
        unseen, seen = self.view("without"), self.view("receiver")
        self.assertGreater(abs(seen - unseen).max(), 0.02, "a receiver is in pictures")
        caster, stopped, means = self.bake("caster", self.scene, "--objects", "{Awning: {role: caster-only}}",
                                           *more)
        self.assertAlmostEqual(stopped / shaded, 1.0, delta=0.03, msg="it stops and reflects light all the same")
        self.assertNotIn("Awning", means)
        self.assertFalse(os.path.exists(os.path.join(self.at, "caster", "lightmaps", "Awning.exr")))
        self.assertTrue([o for o in caster["objects"] if o["name"] == "Awning" and o["lightmap"] is None])
        plain, hidden = self.view("plain"), self.view("caster")
        self.assertGreater(abs(plain - hidden).max(), 0.02, "there is no lightmap to show it with")
        lit = scene(os.path.join(self.at, "lit.glb"), lit_awning=True)
        _, glowing, _ = self.bake("lit", lit)
        self.assertGreater(glowing, 5 * shaded)
        _, dark, _ = self.bake("unlit", lit, "--objects", "{Awning: {role: receiver-only}}")
        self.assertAlmostEqual(dark / without, 1.0, delta=0.01, msg="a lamp that no ray meets lights nothing")

    def test_texels_are_shown(self):
        """Squares alternate: along the middle row of the floor seen from above, as often as it has texels."""
        self.bake("plain", self.scene)
        out = os.path.join(self.at, "plain")
        answer = kiln("view", out, "--show", "texels", "-o", os.path.join(out, "t.exr"), "--from", "-1,3,0.001", "--to",
                      "-1,0,0", "--width", 400, "--height",
                      400, "--field-of-view", 30, "--backend", "embree")
        self.assertEqual(answer.code, 0, answer.err)
        row = exr.read(os.path.join(out, "t.exr"))[0]["G"][100]
        # 400 pixels see 2 x 3 m x tan 15 degrees of a floor of 8 texels a metre
        changes = int(((row[1:] > 0.5 * row.max()) != (row[:-1] > 0.5 * row.max())).sum())
        self.assertAlmostEqual(changes, 8 * 6 * 0.26795, delta=1)

    def test_large_caster_on_ranks(self):
        """A caster-only lightmap so large that ranks would share its packing is not written either, and the others
        are."""
        out = os.path.join(self.at, "ranks")
        side = 728  # its square is above KILN_STRIPS_LEAST
        command = ("--objects", f"{{Floor: {{role: caster-only, lightmap-size: {side}}}, "
                   f"Awning: {{lightmap-size: {side}}}}}", "--lightmap-max", 1024, "--texels-per-metre", 8,
                   "--denoise", "none", "--no-stitch", "--no-export")
        import subprocess
        done = subprocess.run(["mpirun", "-n", "2", importing.KILN, "bake", self.scene, "-o", out, "--samples-direct",
                               "1", "--samples-indirect", "1",
                               "--samples-bounce", "1", "--samples-probe", "0", "--bounces", "0", "--no-preview",
                               *map(str, command)], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(sorted(os.listdir(os.path.join(out, "lightmaps"))),
                         ["Awning.exr", "Lamp.exr", "Post.001.exr", "Post.002.exr"])
        self.assertEqual(kiln("verify", out).code, 0)


if __name__ == "__main__":
    importing.main()
