"""Normal maps: what is read, what is left out with a warning, and what is refused. `kiln view` shows them
(tests/output/test_normal_maps.py); unit.test_gltf looks at the coordinates."""
import base64
import struct
import zlib

import importing
import png

FLAT, LEANING, INWARD, GREY = (128, 128, 255), (163, 128, 250), (128, 128, 20), (180, 180, 180)
TEXCOORDS = struct.pack("<8f", 0, 0, 1, 0, 1, 1, 0, 1)
BUFFER = importing.QUAD + TEXCOORDS


def scene(normal, image=None, coordinates=True, **more):
    """The quad with texture coordinates and one material with that normalTexture."""
    tree = importing.quad()
    tree["buffers"] = [{"byteLength": len(BUFFER), "uri": "data:application/octet-stream;base64," +
                        base64.b64encode(BUFFER).decode()}]
    tree["bufferViews"].append({"buffer": 0, "byteOffset": 60, "byteLength": 32})
    tree["accessors"].append({"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2"})
    primitive = tree["meshes"][0]["primitives"][0]
    primitive["material"] = 0
    if coordinates:
        primitive["attributes"]["TEXCOORD_0"] = 2
    tree["materials"] = [{"normalTexture": normal}]
    tree["images"] = [{"uri": image or png.data_uri([[FLAT, LEANING]])}]
    tree["textures"] = [{"source": 0}]
    tree.update(more)
    return tree


class NormalMaps(importing.Case):
    def check(self, name, *arguments, **options):
        return importing.write(self.folder(), name + ".gltf", scene(*arguments, **options))

    def warnings(self, answer):
        return [note["text"] for note in answer["notes"] if note["severity"] == "warning"]

    def test_read(self):
        answer = self.accepted(self.check("good", {"index": 0, "scale": 2}))
        self.assertTrue(answer["materials"][0]["normal_map"])
        self.assertEqual((len(answer["textures"]), self.warnings(answer)), (1, []))
        self.assertEqual((answer["textures"][0]["width"], answer["textures"][0]["height"]), (2, 1))

    def test_left_out(self):
        """No normal map by its texels, or no coordinates for it: a warning, and the bake goes on without."""
        for name, image, words in (("inward", png.data_uri([[INWARD, INWARD, FLAT]]), "into the surface"),
                                   ("grey", png.data_uri([[GREY, (200, 200, 200)]]), "grey")):
            answer = self.accepted(self.check(name, {"index": 0}, image))
            self.assertFalse(answer["materials"][0]["normal_map"])
            self.assertEqual(len(self.warnings(answer)), 1)
            self.assertIn("materials[0].normalTexture", self.warnings(answer)[0])
            self.assertIn(words, self.warnings(answer)[0])
        answer = self.accepted(self.check("bare", {"index": 0}, coordinates=False))
        self.assertEqual(len(self.warnings(answer)), 1)
        self.assertIn("texture coordinates", self.warnings(answer)[0])
        answer = self.accepted(self.check("flat", {"index": 0, "scale": 0}))  # no strength: no map
        self.assertEqual((answer["materials"][0]["normal_map"], len(answer["textures"])), (False, 0))

    def test_refused(self):
        self.refused(self.check("index", {"index": 5}), ["materials[0]", "index", "5"])
        self.refused(self.check("none", {"scale": 1}), ["materials[0].normalTexture", "no texture index"])
        self.refused(self.check("scale", {"index": 0, "scale": "big"}), ["materials[0]", "scale"])
        self.refused(self.check("huge", {"index": 0, "scale": 1e30}), ["materials[0]", "scale"])
        self.refused(self.check("set", {"index": 0, "texCoord": -1}), ["materials[0]", "texCoord"])
        self.refused(self.check("kind", [0]), ["materials[0].normalTexture"])
        self.refused(self.check("outside", {"index": 0}, "../../etc/passwd"), ["images[0]"])

    def test_without_its_picture(self):
        """A bake needs none: a normal map whose picture is missing, broken or too large stops nothing, and is said."""
        row = zlib.compress(b"\0" + bytes(3 * 16384))  # the header promises more rows than there are bytes for
        big = png.of(16384, 16384, 3, row)
        for name, image, more, words in (
                ("missing", "nothing.png", {}, ["images[0].uri", "nothing.png", "missing"]),
                ("text", "data:image/png;base64,aGVsbG8gd29ybGQh", {},
                 ["materials[0].normalTexture", "images[0]", "PNG"]),
                ("cut", png.data_uri([[FLAT]])[:-40], {}, ["materials[0].normalTexture", "images[0]"]),
                ("source", png.data_uri([[FLAT]]), {"textures": [{}]},
                 ["materials[0].normalTexture", "textures[0].source"]),
                ("big", "data:image/png;base64," + base64.b64encode(big).decode(), {}, ["images[0]", "16384"])):
            with self.subTest(name):
                path = self.check(name, {"index": 0}, image, **more)
                answer = self.accepted(path)
                self.assertFalse(answer["materials"][0]["normal_map"])
                (warning,) = self.warnings(answer)
                for word in words:
                    self.assertIn(word, warning)
                self.assertEqual(importing.kiln("info", path, "--strict").code, 65)

    def test_often(self):
        """An image's texels are looked at once, however many materials and textures have it."""
        row = b"\0" + bytes((128, 128, 255)) * 4000
        data = png.of(4000, 4000, 3, zlib.compress(row * 4000))
        tree = scene({"index": 0}, "data:image/png;base64," + base64.b64encode(data).decode())
        tree["textures"] = [{"source": 0}] * 1000
        tree["materials"] = [{"normalTexture": {"index": i % 1000}} for i in range(10000)]
        path = importing.write(self.folder(), "often.gltf", tree)
        answer = importing.info(path)
        self.assertEqual(answer.code, 0, answer.err)
        self.assertLess(answer.seconds, 10 * importing.QUICK)  # 10,000 looks at 16 million texels take minutes


if __name__ == "__main__":
    importing.main()
