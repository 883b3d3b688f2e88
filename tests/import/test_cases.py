"""Conditions of public bug reports (../shared/scenes/own/cases): each gives its right value, on both backends."""
import math
import os

import importing

CASES = importing.need_shared("own", "cases")


def case(name):
    return importing.want_shared("own", "cases", name)


class Cases(importing.Case):
    def notes(self, path, *options):
        return "\n".join(note["text"] for note in self.accepted(path, *options)["notes"])

    def bakes(self, path, *options):
        """run.json of a small bake, its folder and what it says, on each of the backends that the machine has."""
        for backend in ("embree", "vulkan"):
            out = os.path.join(self.folder(), "out")
            answer = importing.kiln("bake", path, "-o", out, "--lightmap-size", 16, "--samples-probe", 0,
                                    "--no-preview", "--backend", backend, *options)
            if backend == "vulkan" and answer.code == 69:
                continue  # no device
            self.assertEqual(answer.code, 0, answer.err)
            yield importing.run_json(out), out, answer.err

    def object(self, run, name):
        (found,) = [o for o in run["objects"] if o["name"] == name]
        return found

    def close(self, found, right):
        """Within 4 standard errors and 1 %."""
        self.assertLess(abs(found["mean"] - right), 0.01 * right + 4 * found["relative_error"] * found["mean"] + 1e-6)

    def test_an_invisible_sheet_shades_nothing(self):
        for run, _, said in self.bakes(case("g20.glb")):
            self.close(self.object(run, "floor"), 2.0)
            self.assertEqual(len(run["objects"]), 1)
            self.assertIn("1 invisible nodes (KHR_node_visibility)", said)

    def test_unlit_materials_do_not_emit(self):
        report = self.accepted(case("b1_unlit_emit.glb"), "--lightmap-size", 4)
        self.assertEqual(report["counts"]["triangles_emissive"], 0)
        for run, _, said in self.bakes(case("b1_unlit_emit.glb")):
            self.assertEqual(self.object(run, "floor")["mean"], 0.0)
            self.assertIn("there is no light", said)

    def test_specular_glossiness(self):
        """Two lit by the same sun would say nothing of albedo: what `info` reads, and the light is the sun's."""
        report = self.accepted(case("b2_specgloss.glb"), "--lightmap-size", 4)
        for found, right in zip(report["materials"][0]["base_color"], (0.5, 0.1, 0.1, 1.0)):
            self.assertAlmostEqual(found, right, places=6)
        self.assertEqual((report["materials"][0]["metallic"], report["materials"][0]["kind"]), (0.0, "diffuse"))
        for run, out, _ in self.bakes(case("b2_specgloss.glb")):
            self.close(self.object(run, "floor"), 2.0)

    def test_a_skin(self):
        """The box stands where its joint is; under the lamp at (0, 3, 0), its top's mean says so, too."""
        report = self.accepted(case("e6_skin.glb"), "--objects", "{floor: {exclude: true}}", "--lightmap-size", 4)
        for found, right in ((report["bounds"]["min"], (0.5, 0, -0.5)), (report["bounds"]["max"], (1.5, 1, 0.5))):
            for a, b in zip(found, right):
                self.assertAlmostEqual(a, b, places=6)

    def test_map_coordinates(self):
        """An OBJ of 4 decimals at 5,400,000 m: areas to 1e-4, light as at the origin."""
        path = case("j.obj")
        report = self.accepted(path, "--texels-per-metre", 4)
        areas = {o["name"]: o["area"] for o in report["objects"]}
        self.assertAlmostEqual(areas["floor"], 10.89, delta=1e-5)
        self.assertAlmostEqual(areas["box"], 3.84, delta=1e-5)
        self.assertFalse([n for n in report["notes"] if "coarser" in n["text"]])
        for run, _, _ in self.bakes(path, "--bounces", 8, "--samples-direct", 256):
            self.close(self.object(run, "floor"), 0.523)

    def test_pictures_of_another_computer(self):
        notes = self.notes(case("d1h.obj"), "--lightmap-size", 4)
        self.assertIn("'four.png', which is, is used", notes)
        self.assertIn("C:\\Users\\x\\Desktop\\four.png", notes)

    def test_a_black_factor_of_a_picture(self):
        path = case("d1k.obj")
        self.assertIn("its Kd is black", self.notes(path, "--lightmap-size", 4))
        (floor,) = [m for m in self.accepted(path, "--lightmap-size", 4)["materials"] if m["name"] == "floor"]
        self.assertTrue(floor["base_color_texture"] or max(floor["base_color"][:3]) > 0)

    def test_missing_pictures(self):
        for name, missing in (("miss3.obj", ("a.png", "b.png", "c.png")),
                              ("miss.gltf", ("base.png", "mr.png", "normal.png", "ao.png"))):
            checked = importing.kiln("check", case(name), "--lightmap-size", 4)
            strict = importing.kiln("check", case(name), "--lightmap-size", 4, "--strict")
            self.assertEqual((checked.code, strict.code), (0, 65), checked.err)
            for picture in missing:
                self.assertIn(f"the picture '{picture}' is missing", checked.out)
                self.assertIn(f"'{picture}'", strict.sentence())

    def test_light_that_glass_keeps_in(self):
        """A point lamp 0.3 m from the middle of a ball of 0.35 m and of index 1.5: total reflection keeps in what
        leaves it at an angle to the radius with a sine above 0.35 / (1.5 x 0.3). Embree alone: software devices take
        minutes for light paths."""
        out = os.path.join(self.folder(), "out")
        answer = importing.kiln("bake", case("inglass_tir.glb"), "-o", out, "--lightmap-size", 8, "--samples-probe", 0,
                                "--no-preview", "--bounces", 0, "--samples-direct", 64, "--photons", 20000,
                                "--iterations", 4, "--backend", "embree")
        self.assertEqual(answer.code, 0, answer.err)
        energy = importing.run_json(out)["energy"]
        kept = math.sqrt(1 - (0.35 / (1.5 * 0.3)) ** 2)
        for found, share in (("absorbed", 1 - kept), ("gloss", kept)):
            self.assertAlmostEqual(energy[found][0], 4 * math.pi * share,
                                   delta=0.01 * 4 * math.pi * share + 4 * energy["error"])
        self.assertIn("% of what the lamps emit ends in mirrors, gloss and glass", answer.out)

    def test_exposure_of_a_radiance_picture(self):
        for run, _, said in self.bakes(case("g15.glb"), "--environment", case("x.hdr"), "--samples-direct", 256):
            self.close(self.object(run, "floor"), 3.14159265 / 2)
            self.assertIn("multiplied by 2, 2 and 2", said)


if __name__ == "__main__":
    importing.main()
