"""Numbers of scene files have ranges (coordinator/import/numbers.h): what is outside is refused with place, value and
range, at import; what is inside and extreme is baked, and all light is finite. And settings of a file that ask for more
texels than any machine should make of a few kilobytes are refused before any is made."""
import os
import sys

import importing

sys.path.insert(0, os.path.join(importing.REPOSITORY, "tests", "common"))
import glb  # noqa: E402

MOST = 1e15  # KILN_LIGHT_MOST
TINY = ["--texels-per-metre", "1", "--quality", "draft", "--bounces", "2", "--samples-probe", "0", "--backend",
        "embree", "--threads", "1", "--error-map", "--no-resume", "--no-preview", "--no-export", "--quiet"]


def extension(name, **members):
    return {"extensions": {name: members}}


def glass(**members):
    return {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 1.0},
                           "KHR_materials_volume": {"thicknessFactor": 0.1, **members}}}


def smooth(material):
    material["pbrMetallicRoughness"] = {"metallicFactor": 0.0, "roughnessFactor": 0.0}
    return material


# of a material: its name here, what it becomes with a value, the word in the sentence, values outside, values inside
MATERIALS = [
    ("ior", lambda x: extension("KHR_materials_ior", ior=x), "ior", (1e30, 1001, -1), (1e3,)),
    ("smooth ior", lambda x: smooth(extension("KHR_materials_ior", ior=x)), "ior", (1e30,), (1e3,)),
    ("strength", lambda x: {"emissiveFactor": [1, 1, 1], **extension("KHR_materials_emissive_strength",
                                                                     emissiveStrength=x)},
     "emissiveStrength", (1e30, 1e19, -1), (MOST,)),
    ("emission", lambda x: {"emissiveFactor": [x, x, x]}, "emissiveFactor", (1e30, -1), ()),
    ("product", lambda x: {"emissiveFactor": [100, 1, 1], **extension("KHR_materials_emissive_strength",
                                                                      emissiveStrength=x)},
     "times its strength is", (MOST,), ()),
    ("dispersion", lambda x: {"extensions": {**glass()["extensions"], "KHR_materials_dispersion": {"dispersion": x}}},
     "dispersion", (1e30, -1), (1e3,)),
    ("thickness", lambda x: glass(thicknessFactor=x), "thicknessFactor", (1e30, -1), (1e12,)),
    ("attenuation", lambda x: glass(attenuationDistance=x, attenuationColor=[0.5, 0.5, 0.5]), "attenuationDistance",
     (-1, 0), (3.4e38, 1e-30)),
    ("specular", lambda x: extension("KHR_materials_specular", specularColorFactor=[x, x, x]), "specularColorFactor",
     (1e30, -1), (1e6,)),
    ("cutoff", lambda x: {"alphaMode": "MASK", "alphaCutoff": x}, "alphaCutoff", (1e31, -1), (1e6,)),
    ("roughness", lambda x: {"pbrMetallicRoughness": {"roughnessFactor": x}}, "roughnessFactor", (1.5, -1), ()),
]
LIGHTS = [
    ("intensity", lambda x: {"intensity": x}, "intensity", (1e30, 1e19, -1), (MOST,)),
    ("colour", lambda x: {"color": [x, x, x]}, "color", (1e30, -1), (MOST,)),
    ("colour and intensity", lambda x: {"color": [x, x, x], "intensity": x}, "times the colour is", (1e10,), ()),
    ("range", lambda x: {"range": x}, "range", (1e30, 1e-30, -1), (1e15, 1e-15)),
]


class Numbers(importing.Case):
    def setUp(self):
        self.room = self.folder()

    def scene(self, name, materials=(), lights=(), nodes=None):
        """A room with a lamp; a thing of each of the materials, and a lamp of each of the lights."""
        scene = glb.Scene()
        grey = scene.material("grey", (0.7, 0.7, 0.7))
        glb.box(scene, "room", (0, 0, 0), (2, 2, 2), grey, inward=range(6))
        for i, material in enumerate(materials or [{}]):
            own = scene.material(f"own {i}", (0.7, 0.7, 0.7))
            glb.box(scene, f"thing {i}", (0.15 * i, 0.5, 0.5), (0.15 * i + 0.1, 1, 1), own)
            scene.document["materials"][own].update(material)
            scene.used.update(material.get("extensions", {}))
        for i, light in enumerate(lights or [{}]):
            scene.light(f"lamp {i}", {"type": "point", "intensity": 1.0, **light},
                        translation=[1.5, 1.5, 0.2 + 0.1 * i])
        for node in scene.document["nodes"]:
            node.update(nodes or {})
        return scene.write(os.path.join(self.room, name))

    def refused_with(self, path, *words):
        answer = importing.info(path)
        self.assertEqual(answer.code, 65, answer.err)
        for word in words:
            self.assertIn(word, answer.sentence())
        return answer

    def test_what_is_outside_is_refused(self):
        for rows, key, place in ((MATERIALS, "materials", "materials[1]"),
                                 (LIGHTS, "lights", "extensions.KHR_lights_punctual.lights[0]")):
            for name, make, word, outside, _ in rows:
                for value in outside:
                    with self.subTest(name, value=value):
                        self.refused_with(self.scene("out.glb", **{key: [make(value)]}), place, word,
                                          "repair the file")

    def test_what_is_inside_is_baked(self):
        """In one bake; the brightest in another, beside which the light of others would be none."""
        for bright in (False, True):
            materials, lights = ([make(value) for _, make, _, _, inside in rows for value in inside
                                  if (value == MOST) == bright] for rows in (MATERIALS, LIGHTS))
            self.assertGreater(len(materials) + len(lights), 2)
            for more in ([], ["--materials", "full", "--method", "path"]):
                answer = importing.kiln("bake", self.scene("in.glb", materials, lights), "-o",
                                        os.path.join(self.room, "baked"), *TINY, *more)
                self.assertEqual(answer.code, 0, answer.err)

    def test_mtl(self):
        path = os.path.join(self.room, "room.obj")
        with open(path, "w") as file:
            file.write("mtllib room.mtl\nusemtl own\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        for text, words in (("Ke 1e30 1 1", "Ke is 1e+30, outside 0 to 1e+15"), ("Kd 2 0 0", "Kd is 2, outside 0 to 1"),
                            ("map_Kd -s 1e30 1 a.png", "-s is 1e+30"), ("map_Ke -o 1 -1e9 a.png", "-o is -1e+09")):
            with open(os.path.join(self.room, "room.mtl"), "w") as file:
                file.write(f"newmtl own\n{text}\n")
            self.refused_with(path, "line 2", words)
        with open(os.path.join(self.room, "room.mtl"), "w") as file:
            file.write("newmtl own\nillum 7\nKs 1 1 1\nNi 1e30\n")  # gloss is mended, and a note says so
        report = importing.info(path).json()
        self.assertTrue(any("outside their range" in note["text"] for note in report["notes"]), report["notes"])

    def test_hostile_file(self):
        path = os.path.join(importing.want_shared("own", "hostile"), "nonfinite_73.glb")
        self.refused_with(path, "materials[2]", "ior is 1e+30, outside 0 to 1000")

    def test_settings_of_a_file_ask_for_few_texels(self):
        for extras, options in (({"kiln-density-scale": 1000}, []), ({"kiln-lightmap-size": 32768}, []),
                                ({"kiln-density-scale": 1000}, ["--lightmap-size", "64"]),
                                ({"kiln-density-scale": 1000}, ["--texels-per-metre", "4"]),
                                ({"kiln-density-scale": 1000}, ["--objects", "{none: {exclude: false}}"])):
            with self.subTest(extras, options=options):
                path = self.scene("large.glb", 3 * [{}], nodes={"extras": extras})
                answer = importing.info(path, *options)
                self.assertEqual(answer.code, 65, answer.err)
                for word in ("million texels", 'object "', "texels a metre" if "kiln-lightmap-size" not in extras and
                             "--lightmap-size" not in options else "a side of", "--objects"):
                    self.assertIn(word, answer.sentence())
                self.assertLess(answer.seconds, importing.QUICK)
                self.assertLess(answer.memory, importing.MEMORY)
        sized = importing.info(path, "--objects", "{'*': {lightmap-size: 8}}")
        self.assertEqual(sized.code, 0, sized.err)
        modest = importing.info(self.scene("modest.glb", nodes={"extras": {"kiln-density-scale": 3}}),
                                "--texels-per-metre", "8")
        self.assertEqual(modest.code, 0, modest.err)

    def test_options_of_the_user_fit_the_host(self):
        path = self.scene("plain.glb", 63 * [{}])
        if os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") > 64 * 2 ** 33:
            self.skipTest("this host has the memory")
        answer = importing.info(path, "--texels-per-metre", "1e9", "--lightmap-max", "32768")
        self.assertEqual(answer.code, 64, answer.err)
        for word in ("million texels", "memory of this host", "--lightmap-max"):
            self.assertIn(word, answer.sentence())
        self.assertLess(answer.seconds, importing.QUICK)
        path = self.scene("plain.glb")
        answer = importing.kiln("bake", path, "-o", os.path.join(self.room, "never"), "--texels-per-metre", "200",
                                "--memory-budget", "0.01", "--backend", "embree", "--threads", "1")
        self.assertEqual(answer.code, 64, answer.err)
        self.assertIn("million surface points", answer.sentence())
        self.assertLess(answer.seconds, importing.SECONDS)
        sides = self.accepted(path, "--lightmap-size", "16", "--lightmap-max", "32", "--objects",
                              "{'*': {density-scale: 100}}")["objects"]
        self.assertEqual({side for o in sides for side in o["lightmap"]}, {32})


if __name__ == "__main__":
    importing.main()
