"""Files made to kill an importer: small ones that ask for much, deep ones, long ones. Each is answered quickly, in
little memory."""
import base64
import json
import os
import struct
import zlib

import importing

NOTHING = {"asset": {"version": "2.0"}}


def bomb_png(side, depth=8):
    """A PNG of one colour: about a thousandth of its pixels' bytes."""
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    row = b"\0" + b"\0" * side
    packer = zlib.compressobj(9)
    data = b"".join(packer.compress(row) for _ in range(side)) + packer.flush()
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, depth, 0, 0, 0, 0)) + chunk(
        b"IDAT", data) + chunk(b"IEND", b"")


def flat_jpeg(width, height, sof=0xC0, scans=1, data=None):
    """A grey JPEG whose codes take one bit: two bits for each block of 64 pixels."""
    segment = lambda marker, body: struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body
    head = b"\xff\xd8" + segment(0xDB, b"\0" + b"\1" * 64) + segment(sof, struct.pack(">BHHB", 8, height, width, 1) +
                                                                     b"\1\x11\0")
    head += segment(0xC4, b"\0" + b"\1" + b"\0" * 15 + b"\0") + segment(0xC4, b"\x10" + b"\1" + b"\0" * 15 + b"\0")
    blocks = ((width + 7) // 8) * ((height + 7) // 8)
    body = b"\0" * ((2 * blocks + 7) // 8) if data is None else data
    return head + (segment(0xDA, b"\1\1\0" + (b"\0\0\0" if sof == 0xC2 else b"\0\x3f\0")) + body) * scans + b"\xff\xd9"


def textured(images, key="baseColorTexture", materials=None):
    """A scene whose materials use one image each, in turn."""
    count = materials or len(images)
    return importing.quad(images=images, textures=[{"source": i} for i in range(len(images))],
                          materials=[{"pbrMetallicRoughness": {key: {"index": i % len(images)}}} for i in range(count)])


def data_uri(data):
    return "data:image/png;base64," + base64.b64encode(data).decode()


class Killers(importing.Case):
    def setUp(self):
        self.place = self.folder()

    def write(self, data, name="killer.gltf"):
        return importing.write(self.place, name, data)

    def killed(self, data, *words):
        return self.refused(self.write(data), words, seconds=importing.QUICK)

    def survived(self, data):
        """A legal file: taken, quickly and in little memory."""
        answer = importing.info(self.write(data))
        self.assertEqual(answer.code, 0, answer.err)
        self.assertLess(answer.seconds, 10 * importing.QUICK)
        self.assertLess(answer.memory, 2 * importing.MEMORY)
        return answer.json()

    def test_nested_arrays(self):
        self.killed(b"[" * 2000000, "depth")
        self.killed(b'{"asset":{"version":"2.0"},"extras":' + b"[" * 1000000 + b"]" * 1000000 + b"}", "depth")
        self.killed(b'{"asset":' * 300000, "depth")

    def test_many_empty_objects(self):
        self.killed(b'{"asset":{"version":"2.0"},"nodes":[' + b"{}," * 3000000 + b"{}]}", "objects and arrays")

    def test_long_chain_of_nodes(self):
        nodes = [{"children": [i + 1]} for i in range(199999)] + [{"mesh": 0}]
        report = self.survived(importing.quad(nodes=nodes))
        self.assertEqual(report["counts"]["objects"], 1)

    def test_long_cycle_of_nodes(self):
        nodes = [{"children": [(i + 1) % 100000]} for i in range(100000)]
        self.killed(dict(NOTHING, nodes=nodes), "cycle")

    def test_many_nodes(self):
        report = self.survived(dict(NOTHING, nodes=[{"name": "n"}] * 300000, scenes=[{"nodes": list(range(300000))}]))
        self.assertEqual(report["counts"]["objects"], 0)

    def test_sparse_accessor_of_any_count(self):
        """1,195 bytes that made Assimp take 7 GB."""
        sparse = {"count": 1, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 0}}
        for count in (500000000, 4294967294):
            accessors = [{"componentType": 5126, "count": count, "type": "VEC3", "sparse": sparse}]
            for mode in (4, 5, 6):
                mesh = [{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode}]}]
                self.killed(importing.quad(accessors=accessors, meshes=mesh))

    def test_empty_accessor_of_any_count(self):
        accessors = [{"componentType": 5126, "count": 4000000000, "type": "VEC3"}]
        self.killed(importing.quad(accessors=accessors,
                                   meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}]}]), "triangles")
        instancing = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}}
        scene = importing.quad(nodes=[{"mesh": 0, "extensions": instancing}])
        scene["accessors"] = scene["accessors"] + accessors
        self.killed(scene, "objects")

    def test_one_index_buffer_drawn_very_often(self):
        scene = importing.quad(meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}] * 100000}])
        answer = importing.info(self.write(scene))
        self.assertIn(answer.code, (0, 65))
        self.assertLess(answer.seconds, 20 * importing.QUICK)
        indices = struct.pack("<12f", *([0.0] * 12)) + b"\0\1\2" * 100000
        buffers = [{"byteLength": len(indices), "uri": "data:application/octet-stream;base64," +
                    base64.b64encode(indices).decode()}]
        views = [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 300000}]
        accessors = [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
                     {"bufferView": 1, "componentType": 5121, "count": 300000, "type": "SCALAR"}]
        self.killed(importing.quad(buffers=buffers, bufferViews=views, accessors=accessors,
                                   meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}] * 20000}]),
                    "triangles")

    def test_sparse_indices_shared_by_many_accessors(self):
        indices = struct.pack("<12f", *([0.0] * 12)) + b"".join(struct.pack("<H", i)
                                                                for i in range(60000)) + b"\0" * 720000
        buffers = [{"byteLength": len(indices), "uri": "data:application/octet-stream;base64," +
                    base64.b64encode(indices).decode()}]
        views = [{"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 120000},
                 {"buffer": 0, "byteOffset": 120048, "byteLength": 720000}]
        sparse = {"count": 60000, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 2}}
        accessors = [{"componentType": 5126, "count": 60000, "type": "VEC3", "sparse": sparse}] * 10000
        self.killed(importing.quad(buffers=buffers, bufferViews=views, accessors=accessors), "sparse")

    def test_picture_bombs(self):
        for side in (16384, 12000):
            data = bomb_png(side)
            importing.write(self.place, "bomb.png", data)
            scene = importing.quad(images=[{"uri": "bomb.png"}], textures=[{"source": 0}],
                                   materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}])
            answer = importing.info(self.write(scene))
            self.assertEqual(answer.code, 65, f"{side}: {answer.err}")
            self.assertIn("images[0]", answer.err)
            self.assertLess(answer.memory, importing.MEMORY)
            self.assertLess(answer.seconds, importing.QUICK)

    def test_pictures_that_claim_more_than_they_hold(self):
        """A header of any size costs nothing before its bytes have been looked at."""
        self.accepted(self.write(textured([{"uri": data_uri(flat_jpeg(512, 256))}])), "--lightmap-size", "16")
        png = bomb_png(64)
        claimed = png[:16] + struct.pack(">II", 5700, 5700) + png[24:]
        for data in (claimed, flat_jpeg(4000, 4000, data=b"\0" * 9), flat_jpeg(64, 64, scans=900),
                     flat_jpeg(2048, 2048, 0xC2, scans=900, data=b"\0"),
                     flat_jpeg(10000, 10000), bomb_png(5000)[:-40] + b"\0" * 40):
            answer = self.killed(textured([{"uri": data_uri(data)}]), "images[0]")
            self.assertLess(answer.memory, importing.MEMORY // 2)

    def test_a_flipped_bit_in_a_picture(self):
        png = bytearray(bomb_png(64))
        png[60] ^= 4
        self.killed(textured([{"uri": data_uri(bytes(png))}]), "images[0]")

    def test_one_picture_by_many_names(self):
        """Equal bytes are decoded once; what a few bytes are made to stand for is bounded."""
        importing.write(self.place, "a.png", bomb_png(2000))
        names = [{"uri": "./" * (i % 500) + "a.png"} for i in range(1000)]
        for key in ("baseColorTexture", "metallicRoughnessTexture"):
            self.survived(textured(names, key))
        self.survived(textured(names[:1], "metallicRoughnessTexture", 1000))
        data = bomb_png(5000)
        overlapping = textured([{"bufferView": i, "mimeType": "image/png"} for i in range(1000)])
        tail = b"\0" * 1000  # each view is another picture, of nearly the same bytes
        buffers = [{"byteLength": len(data) + 1000, "uri": data_uri(data + tail)}]
        overlapping["buffers"] += buffers
        overlapping["bufferViews"] += [{"buffer": 1, "byteLength": len(data) + i} for i in range(1000)]
        for image in overlapping["images"]:
            image["bufferView"] += 2
        self.killed(overlapping, "images[")

    def test_pictures_of_wrong_dimensions(self):
        for width, height in ((0, 1), (1, 0), (65535, 65535), (2147483647, 1), (20000, 1)):
            head = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + struct.pack(
                ">IIBBBBB", width, height, 8, 6, 0, 0, 0)
            uri = "data:image/png;base64," + base64.b64encode(head + b"\0" * 40).decode()
            self.killed(importing.quad(images=[{"uri": uri}], textures=[{"source": 0}],
                                       materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]),
                        "images[0]")

    def test_pictures_cut_off(self):
        folder = os.path.join(importing.SHARED, "own", "features")
        if not os.path.isdir(folder):
            self.skipTest("../shared/scenes/own is not here")
        with open(os.path.join(folder, "image_formats.glb"), "rb") as file:
            glb = file.read()
        length = struct.unpack_from("<I", glb, 12)[0]
        scene, binary = json.loads(glb[20:20 + length]), glb[20 + length + 8:]
        self.assertGreater(len(scene["images"]), 5)
        for image in scene["images"]:
            view = scene["bufferViews"][image["bufferView"]]
            data = binary[view.get("byteOffset", 0):][:view["byteLength"]]
            for size in (len(data), len(data) * 9 // 10, len(data) // 2, 20, 8):
                uri = "data:image/png;base64," + base64.b64encode(data[:size]).decode()
                path = self.write(importing.quad(images=[{"uri": uri}], textures=[{"source": 0}], materials=[
                    {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]))
                with self.subTest(image=image.get("name"), size=size):
                    if size == len(data):
                        self.accepted(path)
                    else:
                        self.refused(path, ["images[0]"])

    def test_long_strings_and_names(self):
        report = self.survived(importing.quad(nodes=[{"mesh": 0, "name": "x/" * 500000}]))
        self.assertLessEqual(len(report["objects"][0]["name"]), 120)
        names = [{"mesh": 0, "name": "same"} for _ in range(2000)]
        report = self.survived(importing.quad(nodes=names, scenes=[{"nodes": list(range(2000))}]))
        self.assertEqual(len({o["name"].lower() for o in report["objects"]}), 2000)

    def test_numbers(self):
        for text in (b"1e999", b"-1e999", b"99999999999999999999999", b"NaN", b"Infinity", b"0x10", b"1.5", b"-1",
                     b"true", b"null", b'"1"', b"[]", b"{}"):
            data = json.dumps(importing.quad()).encode().replace(b'"count": 4', b'"count": ' + text)
            self.killed(data)

    def test_hierarchy_that_overflows(self):
        nodes = [{"scale": [1e20, 1e20, 1e20], "children": [i + 1]} for i in range(30)] + [{"mesh": 0}]
        self.killed(importing.quad(nodes=nodes))

    def test_every_truncation_of_a_glb(self):
        text = json.dumps(importing.quad()).encode()
        text += b" " * (-len(text) % 4)
        glb = struct.pack("<4sII", b"glTF", 2, 20 + len(text)) + struct.pack("<II", len(text), 0x4E4F534A) + text
        for size in list(range(0, 24)) + [100, len(glb) - 1]:
            self.refused(self.write(glb[:size], "killer.glb"), seconds=importing.QUICK)


if __name__ == "__main__":
    importing.main()
