"""Compressed meshes: Draco, meshopt with its filters, quantized attributes. They are what their plain twins are, within
quantization; damaged ones get sentences."""
import ctypes
import json
import os
import random
import struct
import sys

import importing
from importing import kiln

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import numpy as np  # noqa: E402

FEATURES = importing.need_shared("own", "features")
MUTATIONS = int(os.environ.get("KILN_MUTATIONS", "24"))
SEED = int(os.environ.get("KILN_SEED", "20261122"))


def split(path):
    """JSON and binary chunk of a .glb."""
    with open(path, "rb") as file:
        data = file.read()
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20:20 + length]), bytearray(data[28 + length:])


def join(path, document, binary):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary = bytes(binary) + b"\0" * (-len(binary) % 4)
    with open(path, "wb") as file:
        file.write(struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(binary), len(text), 0x4E4F534A) + text +
                   struct.pack("<II", len(binary), 0x004E4942) + binary)
    return path


def compressed_ranges(document):
    """Where compressed bytes stand in the binary chunk."""
    views = document["bufferViews"]
    ranges = [(v["extensions"]["EXT_meshopt_compression"]["byteOffset"],
               v["extensions"]["EXT_meshopt_compression"]["byteLength"])
              for v in views if "EXT_meshopt_compression" in v.get("extensions", {})]
    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            draco = primitive.get("extensions", {}).get("KHR_draco_mesh_compression")
            if draco is not None:
                ranges.append((views[draco["bufferView"]].get("byteOffset", 0),
                               views[draco["bufferView"]]["byteLength"]))
    return ranges


class Meshopt:
    """The library's own encoders."""

    def __init__(self):
        self.library = ctypes.CDLL("libmeshoptimizer.so.2d")
        for name in ("encodeVertexBuffer", "encodeVertexBufferBound", "encodeIndexBuffer", "encodeIndexBufferBound",
                     "encodeIndexSequence",
                     "encodeIndexSequenceBound"):
            getattr(self.library, "meshopt_" + name).restype = ctypes.c_size_t

    def call(self, name, bound, data, *sizes):
        size = getattr(self.library, f"meshopt_{name}Bound")(*map(ctypes.c_size_t, bound))
        out = ctypes.create_string_buffer(size)
        used = getattr(self.library, "meshopt_" + name)(out, ctypes.c_size_t(size),
                                                        data.ctypes.data_as(ctypes.c_void_p),
                                                        *map(ctypes.c_size_t, sizes))
        assert used > 0
        return out.raw[:used]

    def vertices(self, data, stride):
        return self.call("encodeVertexBuffer", (len(data), stride), np.ascontiguousarray(data), len(data), stride)

    def filtered(self, name, values, stride, bits):
        values = np.ascontiguousarray(values, np.float32)
        out = np.zeros((len(values), stride), np.uint8)
        getattr(self.library, "meshopt_encodeFilter" + name)(out.ctypes.data_as(ctypes.c_void_p),
                                                             ctypes.c_size_t(len(values)), ctypes.c_size_t(stride),
                                                              ctypes.c_int(bits),
                                                             values.ctypes.data_as(ctypes.c_void_p))
        return self.vertices(out, stride)


def floats(document, binary, index):
    accessor = document["accessors"][index]
    view = document["bufferViews"][accessor["bufferView"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[accessor["type"]]
    kind = {5126: np.float32, 5123: np.uint16, 5125: np.uint32}[accessor["componentType"]]
    at = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    assert "byteStride" not in view or view["byteStride"] == width * np.dtype(kind).itemsize
    return np.frombuffer(bytes(binary), kind, accessor["count"] * width, at).reshape(-1, width)


class Compressed(importing.Case):
    def path(self, name):
        return os.path.join(FEATURES, name)

    def bake(self, scene):
        out = os.path.join(self.folder(), "out")
        answer = kiln("bake", scene, "-o", out, "--shared-texels", "keep",
                      "--texels-per-metre", 6, "--samples-direct", 128, "--samples-indirect",
                      256, "--samples-probe", 0,
                      "--bounces", 1, "--backend", "embree", "--no-preview", "--quiet", "--denoise", "none")
        self.assertEqual(answer.code, 0, answer.err)
        return {name: exr.read(os.path.join(out, "lightmaps", name))[0]["G"]
                for name in sorted(os.listdir(os.path.join(out, "lightmaps")))}

    def same_light(self, plain, other):
        self.assertEqual({n: v.shape for n, v in plain.items()}, {n: v.shape for n, v in other.items()})
        for name, values in plain.items():
            self.assertAlmostEqual(float(other[name].mean() / values.mean()), 1.0, delta=0.01, msg=name)
            self.assertLess(float(np.sqrt(((other[name] - values) ** 2).mean()) / values.mean()), 0.06, name)

    def test_twins(self):
        """The same light as the plain scene, and lightmaps that differ where they should."""
        plain = self.bake(self.path("uncompressed_twin_of_compressed.glb"))
        for name in ("draco_required.glb", "meshopt_required.glb", "quantized_required.glb"):
            with self.subTest(name):
                self.same_light(plain, self.bake(self.path(name)))
        self.same_light(plain, self.bake(self.filtered(os.path.join(self.folder(), "filtered.glb"))))

    def filtered(self, path):
        """The plain twin once more, with every mode and filter of meshopt that geometry has a use for."""
        document, binary = split(self.path("uncompressed_twin_of_compressed.glb"))
        coder, packed, size = Meshopt(), bytearray(binary), 0
        bits = iter((8, 16, 16, 12))
        for mesh in document["meshes"]:
            primitive = mesh["primitives"][0]
            names = dict(primitive["attributes"], indices=primitive["indices"])
            for name, index in names.items():
                values = floats(document, binary, index)
                accessor, extension, stride = document["accessors"][index], {"mode": "ATTRIBUTES"}, 4 * values.shape[1]
                if name == "indices":
                    wide, sequence = len(values) > 100, len(values) == 36
                    stride = 4 if wide else 2
                    accessor["componentType"] = 5125 if wide else 5123
                    extension["mode"] = "INDICES" if sequence else "TRIANGLES"
                    indices = np.ascontiguousarray(values.ravel(), np.uint32)
                    data = coder.call("encodeIndexSequence" if sequence else "encodeIndexBuffer",
                                      (len(indices), int(indices.max()) + 1), indices, len(indices))
                elif name == "NORMAL":
                    count = next(bits)
                    stride = 4 if count == 8 else 8
                    accessor.update(componentType=5120 if count == 8 else 5122, normalized=True)
                    extension["filter"] = "OCTAHEDRAL"
                    data = coder.filtered("Oct", np.hstack([values, np.zeros((len(values), 1))]), stride, count)
                elif name == "POSITION":
                    extension["filter"] = "EXPONENTIAL"
                    data = coder.filtered("Exp", values, stride, 18)
                else:
                    data = coder.vertices(values.view(np.uint8).reshape(len(values), stride), stride)
                extension.update(buffer=0, byteOffset=len(packed), byteLength=len(data), byteStride=stride,
                                 count=len(values))
                packed += data + b"\0" * (-len(data) % 4)
                view = {"buffer": 1, "byteOffset": size, "byteLength": stride * len(values),
                        "extensions": {"EXT_meshopt_compression": extension}}
                if name != "indices":
                    view["byteStride"] = stride
                size += -(-stride * len(values) // 4) * 4
                accessor["bufferView"] = len(document["bufferViews"])
                accessor.pop("byteOffset", None)
                document["bufferViews"].append(view)
        document["buffers"] = [{"byteLength": len(packed)},
                               {"byteLength": size, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}]
        document["extensionsUsed"] = sorted({*document.get("extensionsUsed", []), "EXT_meshopt_compression",
                                             "KHR_mesh_quantization"})
        document["extensionsRequired"] = ["EXT_meshopt_compression", "KHR_mesh_quantization"]
        return join(path, document, packed)

    def test_claims_are_checked(self):
        """Numbers of the document that the compressed data does not bear out."""
        for name, change, words in (
                ("draco_required.glb", lambda d: [a.update(count=5) for a in d["accessors"][1:5]],
                 ["POSITION", "5 elements", "has 4"]),
                ("draco_required.glb", lambda d: d["accessors"][0].update(count=9), ["indices", "9 elements", "has 6"]),
                ("draco_required.glb", lambda d: self.draco(d)["attributes"].update(NORMAL=77),
                 ["NORMAL", "attribute 77"]),
                ("draco_required.glb", lambda d: d["accessors"][3].update(type="VEC3"), ["TEXCOORD_0"]),
                ("draco_required.glb", lambda d: self.draco(d).update(bufferView=99), ["bufferView"]),
                ("draco_required.glb", lambda d: self.draco(d).pop("bufferView"), ["bufferView", "missing"]),
                ("draco_required.glb", lambda d: self.draco(d).pop("attributes"), ["attributes"]),
                ("draco_required.glb", lambda d: self.draco(d).update(bufferView=0), ["cannot be decoded"]),
                ("draco_required.glb", lambda d: d["meshes"][0]["primitives"][0].update(mode=5), ["mode"]),
                ("meshopt_required.glb", lambda d: self.meshopt(d).update(count=3 * 2 ** 29), ["count", "can hold"]),
                ("meshopt_required.glb", lambda d: self.meshopt(d).update(count=3), ["fewer than the view's"]),
                ("meshopt_required.glb", lambda d: self.meshopt(d).update(byteStride=3), ["byteStride"]),
                ("meshopt_required.glb", lambda d: self.meshopt(d).update(mode="STRIPS"), ["mode", "'STRIPS'"]),
                ("meshopt_required.glb", lambda d: self.meshopt(d).update(filter="OCTAHEDRAL"), ["byteStride"]),
                ("meshopt_required.glb", lambda d: self.meshopt(d).update(filter="SHARP"), ["filter", "'SHARP'"]),
                ("meshopt_required.glb", lambda d: self.meshopt(d).update(byteOffset=23000), ["byteLength"]),
                ("meshopt_required.glb", lambda d: self.meshopt(d).update(buffer=1), ["buffer", "has no bytes"]),
                ("meshopt_required.glb", lambda d: self.meshopt(d).update(byteLength=1000),
                 ["cannot be decompressed"])):
            document, binary = split(self.path(name))
            change(document)
            self.refused(join(os.path.join(self.folder(), "changed.glb"), document, binary), words)

    def draco(self, document):
        return document["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]

    def meshopt(self, document):
        return document["bufferViews"][1]["extensions"]["EXT_meshopt_compression"]

    def test_damage(self):
        """Bits flipped, bytes replaced, data cut off: a sentence or a scene, never a crash, little time and memory."""
        draw = random.Random(SEED)
        refused = 0
        for name in ("draco_required.glb", "meshopt_required.glb"):
            document, whole = split(self.path(name))
            ranges = compressed_ranges(document)
            for k in range(MUTATIONS):
                binary, (first, length) = bytearray(whole), draw.choice(ranges)
                if k % 4 == 0:
                    cut = draw.randrange(length)
                    binary[first + cut:first + length] = bytes(length - cut)
                else:
                    for _ in range(draw.choice((1, 1, 3, 20))):
                        at = first + min(draw.randrange(length), draw.choice((16, length)))
                        binary[min(at, first + length - 1)] ^= 1 << draw.randrange(8) if k % 2 else draw.randrange(256)
                path = join(os.path.join(self.folder(), "damaged.glb"), document, binary)
                answer = kiln("info", path, "--lightmap-max", 32, "--lightmap-size", 8)
                self.assertIn(answer.code, (0, 65), f"{name}, seed {SEED}, mutation {k}: {answer.err}")
                self.assertNotIn("importer died", answer.err, f"{name}, seed {SEED}, mutation {k}")
                self.assertLess(answer.memory, 4 * importing.MEMORY)
                refused += answer.code == 65
        self.assertGreater(refused, MUTATIONS // 4)


if __name__ == "__main__":
    importing.main()
