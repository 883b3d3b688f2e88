"""Gloss of materials, as users see it: what kiln info and kiln check say of glTF's and MTL's materials. unit.test_gltf
looks at the records, unit.test_gloss at the kinds."""
import importing
import png
from test_normal_maps import FLAT, GREY, LEANING
from test_obj import SQUARE, picture

CUBE = ("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
        "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 4 1 5 8\n")


def extension(**named):
    return {"KHR_materials_" + name: body for name, body in named.items()}


class Gltf(importing.Case):
    def scene(self, *materials, image=None, name="scene"):
        tree = importing.quad()
        tree["meshes"][0]["primitives"][0]["material"] = 0
        tree["materials"] = [{"name": f"m{i}", **material} for i, material in enumerate(materials)]
        if image is not None:
            tree["images"], tree["textures"] = [{"uri": image}], [{"source": 0}]
        return importing.write(self.folder(), name + ".gltf", tree)

    def test_kinds(self):
        dull = {"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.9}}
        clear = extension(transmission={"transmissionFactor": 1}, ior={"ior": 1.4})
        path = self.scene(dull, {}, {**dull, "extensions": clear},
                          {**dull, "extensions": {**clear, **extension(
                              volume={"thicknessFactor": 0.1, "attenuationDistance": 0.5,
                                      "attenuationColor": [0.9, 0.5, 0.1]}, dispersion={"dispersion": 0.5})}},
                          {**dull, "extensions": extension(clearcoat={"clearcoatFactor": 0.5,
                                                                      "clearcoatRoughnessFactor": 0.25})},
                          {"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.2}})
        materials = self.accepted(path)["materials"]
        self.assertEqual([m["kind"] for m in materials],
                         ["diffuse", "metal", "thin glass", "volume glass", "clear coat", "gloss"])
        self.assertIsNone(materials[0]["gloss"])
        body = materials[3]["gloss"]
        self.assertEqual((body["volume"], round(body["ior"], 6), round(body["thickness"], 6), body["dispersion"]),
                         (True, 1.4, 0.1, 0.5))
        text = importing.kiln("info", path).out
        for words in ("material 'm1': metal, metallic 1, roughness 1\n",
                      "material 'm2': thin glass, roughness 0.9, transmission 1, index 1.4\n",
                      "material 'm3': volume glass, roughness 0.9, transmission 1, index 1.4, white becomes 0.9 0.5 "
                      "0.1 in 0.5 m, Abbe number 40\n",
                      "material 'm4': clear coat, roughness 0.9, clear coat 0.5 of roughness 0.25\n",
                      "material 'm5': gloss, roughness 0.2\n",
                      "a bake has the light that each of these materials sends on"):
            self.assertIn(words, text)
        self.assertNotIn("material 'm0'", text)

    def test_thin_walls(self):
        """Smooth ones no --materials takes with all their gloss; what would not come is not announced."""
        for roughness, words, bent in ((0.04, "it is thin and smooth: what it reflects is taken off", False),
                                        (0.06, "without --materials diffuse it is refracted", True)):
            path = self.scene({"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": roughness},
                               "extensions": extension(transmission={"transmissionFactor": 0.5})})
            text = importing.kiln("info", path).out
            self.assertIn("thin glass", text)
            self.assertIn(words, text)
            self.assertEqual("without --materials diffuse" in text, bent)
            self.assertEqual("a bake has the light" in text, bent)

    def test_nothing_but_diffuse(self):
        """Nothing is said of gloss where there is none."""
        path = self.scene({"pbrMetallicRoughness": {"metallicFactor": 0}})
        self.assertNotIn("material '", importing.kiln("info", path).out)
        self.assertNotIn("a bake takes", importing.kiln("info", path).out)

    def test_a_texture_counts_by_its_mean(self):
        """Roughness 0.502 (green 128) and 0 (green 20) in halves: 0.29; metal by blue."""
        mixed = {"pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}}}
        material = self.accepted(self.scene(mixed, image=png.data_uri([[(0, 128, 0), (0, 20, 0)]])))["materials"][0]
        self.assertEqual((material["kind"], material["metallic"]), ("gloss", 0))
        self.assertAlmostEqual(material["gloss"]["mean_roughness"], 74 / 255, places=5)
        material = self.accepted(self.scene(mixed, image=png.data_uri([[(0, 255, 51), (0, 255, 0)]])))["materials"][0]
        self.assertEqual(material["kind"], "metal")
        self.assertAlmostEqual(material["gloss"]["mean_metallic"], 0.1, places=5)

    def test_a_clear_coat_without_normals(self):
        coat = {"extensions": extension(clearcoat={"clearcoatFactor": 1, "clearcoatNormalTexture": {"index": 0}})}
        report = self.accepted(self.scene(coat, image=png.data_uri([[GREY, GREY]])))
        self.assertEqual(report["materials"][0]["gloss"]["textures"], [])
        self.assertIn("clearcoatNormalTexture: its image is no normal map", report["notes"][-1]["text"] +
                      report["notes"][0]["text"])
        report = self.accepted(self.scene(coat, image=png.data_uri([[FLAT, LEANING]])))
        self.assertEqual(report["materials"][0]["gloss"]["textures"], ["clearcoat_normal"])

    def test_check_names_what_is_doubtful(self):
        thin = {"extensions": extension(transmission={"transmissionFactor": 1}), "pbrMetallicRoughness": {
            "metallicFactor": 0.25}}
        body = {"extensions": {**thin["extensions"], **extension(volume={"thicknessFactor": 1})}}
        body["pbrMetallicRoughness"] = {"metallicFactor": 0}
        answer = importing.kiln("check", self.scene(thin))
        self.assertIn("note: material 'm0': it transmits light but bounds no body", answer.out)
        self.assertIn("note: material 'm0': 25 % of it is metal", answer.out)
        self.assertNotIn("is not closed", answer.out)
        answer = importing.kiln("check", self.scene(body))
        self.assertIn("its material 'm0' is glass with a volume", answer.out)
        self.assertNotIn("bounds no body", answer.out)


class Mtl(importing.Case):
    def setUp(self):
        self.place = self.folder()

    def read(self, mtl, shape=SQUARE + "f 1 2 3 4\n", command=importing.info):
        importing.write(self.place, "m.mtl", mtl.encode())
        path = importing.write(self.place, "scene.obj", ("mtllib m.mtl\nusemtl a\n" + shape).encode())
        return command(path, "--lightmap-size", "16")

    def gloss(self, mtl, shape=SQUARE + "f 1 2 3 4\n"):
        report = self.read("newmtl a\n" + mtl, shape).json()
        return report["materials"][1], " / ".join(note["text"] for note in report["notes"])

    def test_phong(self):
        """illum 0 and 1 have no lobe, 2 has one, 3 is a mirror. A wide lobe is diffuse, but kept."""
        for illum, kind, mirror in ((0, "diffuse", None), (1, "diffuse", None), (2, "gloss", False),
                                    (3, "gloss", True)):
            material, _ = self.gloss(f"Kd 0.5 0.5 0.5\nKs 0.25 0.5 0.75\nNs 200\nillum {illum}\n")
            self.assertEqual(material["kind"], kind, illum)
            if mirror is None:
                self.assertIsNone(material["gloss"])
                continue
            self.assertEqual(material["gloss"]["model"], "phong")
            self.assertEqual(material["gloss"]["specular_color"], [0.25, 0.5, 0.75])
            self.assertEqual((material["gloss"]["exponent"], material["gloss"]["mirror"]), (200, mirror))
        material, _ = self.gloss("Ks 0.25 0.5 0.75\nNs 10\n")
        self.assertEqual((material["kind"], material["gloss"]["exponent"]), ("diffuse", 10))
        self.assertIsNone(self.gloss("Ks 0 0 0\nNs 200\nillum 2\n")[0]["gloss"])

    def test_glass(self):
        """illum 6 and 7 bend light, 4 and 9 do not; what passes is 1 - d or, with d 1, Tf."""
        for illum, lines, kind, passes, colour in ((7, "d 0.25\n", "volume glass", 0.75, [1, 1, 1]),
                                                   (6, "Tf 1 0.5 0\n", "volume glass", 1, [1, 0.5, 0]),
                                                   (4, "Tr 0.5\n", "thin glass", 0.5, [1, 1, 1]),
                                                   (9, "d 0.5\n", "thin glass", 0.5, [1, 1, 1]),
                                                   (7, "", "diffuse", None, None),
                                                   (2, "d 0.5\n", "diffuse", None, None)):
            material, _ = self.gloss(f"Kd 0.1 0.1 0.1\nNi 1.33\nillum {illum}\n" + lines)
            self.assertEqual(material["kind"], kind, (illum, lines))
            if passes is not None:
                gloss = material["gloss"]
                self.assertEqual((gloss["transmission"], gloss["filter"]), (passes, colour))
                self.assertAlmostEqual(gloss["ior"], 1.33, places=6)

    def test_physical(self):
        material, notes = self.gloss("Pr 0.3\nPm 0.75\nPc 0.5\nPcr 0.25\naniso 0.5\nanisor 0.25\nNi 1.6\nPs 1\n")
        gloss = material["gloss"]
        self.assertEqual((material["kind"], gloss["model"], material["metallic"]),
                         ("clear coat", "metallic-roughness", 0))
        for name, value in (("roughness", 0.3), ("metallic", 0.75), ("clearcoat", 0.5), ("clearcoat_roughness", 0.25),
                            ("anisotropy", 0.5), ("anisotropy_rotation", 1.5707963), ("ior", 1.6)):
            self.assertAlmostEqual(gloss[name], value, places=6)
        self.assertIn("1 statements of sheen", notes)
        self.assertAlmostEqual(self.gloss("Pm 1\nNs 198\n")[0]["gloss"]["roughness"], 0.01**0.25, places=6)

    def test_maps(self):
        importing.write(self.place, "r.png", picture(3, 1, (102, 0, 0)))
        shape = SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"
        material, _ = self.gloss("map_Pr -s 2 3 1 -o 0.5 0.25 0 r.png\nmap_Pm r.png\nmap_Kd r.png\n", shape)
        self.assertEqual(sorted(material["gloss"]["textures"]), ["metallic", "roughness"])
        for mean in ("mean_roughness", "mean_metallic"):  # 102, 102, 0
            self.assertAlmostEqual(material["gloss"][mean], 0.8 / 3, places=5)
        report = self.read("newmtl a\nmap_Pr r.png\nmap_Pm r.png\nmap_Kd r.png\n", shape).json()
        self.assertEqual(len(report["textures"]), 2)  # linear and sRGB
        material, notes = self.gloss("Ks 1 1 1\nNs 300\nmap_Ks absent.png\nmap_Ns r.png\n", shape)
        self.assertEqual(material["gloss"]["textures"], ["roughness"])
        self.assertIn("map_Ks: the picture 'absent.png' is missing in the scene's folder; its factor stands alone",
                      notes)

    def test_numbers_out_of_range(self):
        material, notes = self.gloss("Ks 2 -1 0.5\nNs -3\nNi 0.5\nPc spectral x.rfl\nPr nan\n")
        self.assertEqual((material["gloss"]["exponent"], material["gloss"]["ior"]), (0, 1))
        self.assertIn("6 numbers of gloss", notes)
        material, notes = self.gloss("Ks 0\nNs -3\n")
        self.assertNotIn("numbers of gloss", notes)  # they mean nothing where nothing is reflected

    def test_what_a_diffuse_bake_does_without_stops_none(self):
        """What concerns gloss alone is no reason to refuse a file: a map without a name, a number before any
        material."""
        material, notes = self.gloss("Ks 1 1 1\nmap_Ks -clamp on\nmap_Pr\n")
        self.assertEqual(material["gloss"]["textures"], [])
        self.assertIn("2 numbers of gloss", notes)
        self.assertEqual(self.read("Ks 1 1 1\nmap_Ks\nillum 2\nnewmtl a\nKd 0.5\n").json()["materials"][1]["kind"],
                         "diffuse")

    def test_check(self):
        glass = "newmtl a\nillum 7\nNi 1.5\nd 0\nKd 1 1 1\n"
        self.assertIn("is glass with a volume", self.read(glass, command=lambda *a: importing.kiln("check", *a)).out)
        self.assertNotIn("is glass with a volume",
                         self.read(glass, CUBE, lambda *a: importing.kiln("check", *a)).out)


if __name__ == "__main__":
    importing.main()
