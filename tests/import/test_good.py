"""Every good scene is taken, with the numbers that the README of ../shared/scenes gives; what kiln cannot read is
refused by name."""
import glob
import os
import re

import importing

SCENES = importing.need_shared("own")
REFUSED = {"unknown_required_extension_must_refuse.glb": "VENDOR_unknown_required", "webp_required.glb": "WebP"}
# Triangles of no area are in the README's counts and not in kiln's.
SLOW = {"city_instanced.glb"}  # 1601 objects in few texels; with KILN_TEST_FULL only
WITHOUT_AREA = re.compile(r"^(\d+) triangles without area were left out$")


def dropped(report):
    return sum(int(m.group(1)) for m in (WITHOUT_AREA.match(n["text"]) for n in report["notes"]) if m)


def table():
    """The README's rows: name -> (triangles stored, meshes, materials, textures)."""
    rows = {}
    with open(os.path.join(importing.SHARED, "README.md")) as file:
        for line in file:
            cells = [c.strip() for c in line.strip().strip("|").split("|")]
            if len(cells) == 8 and cells[0].startswith("`"):
                rows[cells[0].strip("`")] = (int(cells[2].split()[0]), re.search(r"\((\d+) flat\)", cells[2]),
                                             int(cells[3].split("/")[0]),
                                             int(cells[4]), int(cells[7]))
    return rows


class Good(importing.Case):
    def check_row(self, path, name):
        stored, flat, meshes, materials, textures = table()[name]
        # small maps: this is not about surfaces
        counts = (report := self.accepted(path, "--lightmap-max", 16))["counts"]
        self.assertEqual(counts["triangles"] + dropped(report), stored)
        if name != "nasty_valid.glb":
            self.assertEqual(counts["meshes"], meshes)
            self.assertEqual(counts["triangles_expanded"] + dropped(report), int(flat.group(1)) if flat else stored)
            # kiln adds a grey one where primitives have none
            self.assertIn(counts["materials"], (materials, materials + 1))
        self.assertLessEqual(counts["textures"], textures)
        self.assertGreater(report["surface"]["points"], 0)
        return report

    def test_own(self):
        for path in sorted(glob.glob(os.path.join(SCENES, "*.glb"))):
            if os.path.basename(path) in SLOW and "KILN_TEST_FULL" not in os.environ:
                continue
            with self.subTest(os.path.basename(path)):
                self.check_row(path, os.path.basename(path))

    def test_third_party(self):
        rows = [n for n in table() if os.path.exists(os.path.join(importing.SHARED, "third_party", n))]
        if not rows:
            self.skipTest("../shared/scenes/third_party is not here")
        for name in rows:
            with self.subTest(name):
                self.check_row(os.path.join(importing.SHARED, "third_party", name), name)

    def test_analytic(self):
        for path in sorted(glob.glob(os.path.join(SCENES, "analytic", "*.glb"))):
            with self.subTest(os.path.basename(path)):
                self.assertGreater(self.accepted(path, "--lightmap-max", 16)["counts"]["triangles"], 0)

    def test_features(self):
        paths = [p for kind in ("glb", "gltf", "obj") for p in glob.glob(os.path.join(SCENES, "features", "*." + kind))]
        self.assertGreater(len(paths), 25)
        for path in sorted(paths):
            name = os.path.basename(path)
            with self.subTest(name):
                if name in REFUSED:
                    self.refused(path, [REFUSED[name], "export again"])
                else:
                    self.accepted(path, "--lightmap-max", 32)

    def test_twins_are_equal(self):
        """Quantized and compressed scenes and their plain twin: the same triangles, areas within the quantization."""
        plain = self.accepted(os.path.join(SCENES, "features", "uncompressed_twin_of_compressed.glb"), "--lightmap-max",
                              32)
        for name in ("quantized", "draco", "meshopt"):
            twin = self.accepted(os.path.join(SCENES, "features", name + "_required.glb"), "--lightmap-max", 32)
            self.assertEqual(plain["counts"], twin["counts"])
            self.assertAlmostEqual(plain["surface"]["area"], twin["surface"]["area"],
                                   delta=2e-3 * plain["surface"]["area"])

    def test_index_types_agree(self):
        reports = [self.accepted(os.path.join(SCENES, "features", f"indices_u{b}.glb"), "--lightmap-max", 32)
                   for b in (8, 16, 32)]
        self.assertEqual(reports[0]["surface"], reports[1]["surface"])
        self.assertEqual(reports[0]["surface"], reports[2]["surface"])

    def test_nasty_is_explained(self):
        report = self.accepted(os.path.join(SCENES, "nasty_valid.glb"))
        text = "\n".join(n["text"] for n in report["notes"])
        for word in ("without area", "to the back of their winding", "points or lines", "no material",
                     "scaled to nothing", "zero_area_and_duplicate",
                     "overlap_uv1", "uv1_outside", "uv1_point"):
            self.assertIn(word, text)
        names = [o["original_name"] for o in report["objects"]]
        self.assertNotIn("zero_scale", names)
        self.assertIn("flat_scale", names)  # flattened along the normal of a flat mesh: it has an area
        check = importing.kiln("check", os.path.join(SCENES, "nasty_valid.glb"), "--json").json()
        self.assertIn("mesh 'inverted_winding'", [p["place"] for p in check["problems"] if "inward" in p["text"]])

    def test_emission_is_factor_times_strength(self):
        lamps = [m for m in self.accepted(os.path.join(SCENES, "features", "base.glb"), "--lightmap-max",
                                          8)["materials"] if max(m["emission"]) > 0]
        self.assertEqual(len(lamps), 1)
        for value, expected in zip(lamps[0]["emission"], (10.0, 9.0, 8.0)):
            self.assertAlmostEqual(value, expected, places=5)

    def test_obj_equals_its_glb(self):
        obj, glb = (self.accepted(os.path.join(SCENES, "cornell_original." + kind), "--lightmap-max", 64,
                                  "--shared-texels", "keep")
                    for kind in ("obj", "glb"))
        self.assertEqual(obj["counts"]["triangles"], glb["counts"]["triangles"])
        self.assertAlmostEqual(obj["surface"]["area"], glb["surface"]["area"], places=4)
        lamp = lambda report: max(max(m["emission"]) for m in report["materials"])
        self.assertAlmostEqual(lamp(obj), 18.387, places=4)  # Ke
        self.assertAlmostEqual(lamp(glb), lamp(obj), places=3)
        # its vt, turned the right way up, is the layout of the .glb
        size = {o["original_name"]: o["lightmap"] for o in glb["objects"]}
        self.assertEqual({m["layout"] for m in obj["meshes"]}, {"own"})
        self.assertEqual({o["original_name"]: o["lightmap"] for o in obj["objects"]}, size)

    def test_environment(self):
        scene = os.path.join(SCENES, "analytic", "sky_open_plane.glb")
        environment = lambda *options: self.accepted(scene, "--lightmap-max", 16, *options)["environment"]
        self.assertEqual(environment()["radiance"], [2.0, 2.0, 2.0])
        self.assertEqual(environment("--environment", "none")["kind"], "none")
        changed = environment("--environment", "1,0.5,0.25", "--environment-scale", "2")
        self.assertEqual(changed["radiance"], [2.0, 1.0, 0.5])


if __name__ == "__main__":
    importing.main()
