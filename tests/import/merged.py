"""Joins glTF files to one, as the parts of a job are put together: an oracle that knows nothing of kiln."""
import json
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
from gltf_file import File, write_glb  # noqa: E402

LIGHTS = "KHR_lights_punctual"


def local_matrix(node):
    """4 x 4, of one node."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    turn = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", [1, 1, 1]))
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def moved_textures(value, by):
    """A material with the indices of its textures moved."""
    if isinstance(value, dict):
        return {key: (old + by if key == "index" else moved_textures(old, by)) for key, old in value.items()}
    return [moved_textures(old, by) for old in value] if isinstance(value, list) else value


class Joined:
    def __init__(self):
        self.document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "buffers": [{}]}
        self.blob = b""

    def count(self, key):
        return len(self.document.get(key, []))

    def put(self, key, element):
        self.document.setdefault(key, []).append(element)

    def lights(self):
        return self.document.setdefault("extensions", {}).setdefault(LIGHTS, {}).setdefault("lights", [])

    def add(self, path, places):
        """Adds a file whose nodes have no children and no parents, as often as it has places (4 x 4 matrices)."""
        file = File(path)
        source = file.json
        first = {key: self.count(key) for key in ("bufferViews", "accessors", "images", "samplers", "textures",
                                                  "materials", "meshes", "cameras")}
        begin, first_light = len(self.blob), len(self.lights())
        self.blob += file.binary + b"\0" * (-len(file.binary) % 16)
        for view in source.get("bufferViews", []):
            self.put("bufferViews", {**view, "byteOffset": view.get("byteOffset", 0) + begin})
        for accessor in source.get("accessors", []):
            self.put("accessors", {**accessor, "bufferView": accessor["bufferView"] + first["bufferViews"]})
        for image in source.get("images", []):
            self.put("images", {**image, **({"bufferView": image["bufferView"] + first["bufferViews"]}
                                            if "bufferView" in image else {})})
        for sampler in source.get("samplers", []):
            self.put("samplers", sampler)
        for texture in source.get("textures", []):
            moved = {**texture, "source": texture["source"] + first["images"]}
            if "sampler" in texture:
                moved["sampler"] += first["samplers"]
            self.put("textures", moved)
        for material in source.get("materials", []):
            self.put("materials", moved_textures(material, first["textures"]))
        for mesh in source.get("meshes", []):
            self.put("meshes", {**mesh, "primitives": [self.primitive(p, first) for p in mesh["primitives"]]})
        for camera in source.get("cameras", []):
            self.put("cameras", camera)
        self.lights().extend(source.get("extensions", {}).get(LIGHTS, {}).get("lights", []))
        for name in source.get("extensionsUsed", []):
            if name not in self.document.setdefault("extensionsUsed", []):
                self.document["extensionsUsed"].append(name)
        for matrix in places:
            for index in source["scenes"][source.get("scene", 0)]["nodes"]:
                self.node(source["nodes"][index], matrix, first, first_light)

    def primitive(self, primitive, first):
        moved = {**primitive,
                 "attributes": {key: old + first["accessors"] for key, old in primitive["attributes"].items()}}
        if "indices" in primitive:
            moved["indices"] += first["accessors"]
        if "material" in primitive:
            moved["material"] += first["materials"]
        return moved

    def node(self, node, matrix, first, first_light):
        assert "children" not in node
        moved = {key: old for key, old in node.items() if key not in ("translation", "rotation", "scale", "matrix")}
        world = np.array(matrix, np.float64) @ local_matrix(node)
        moved["matrix"] = [float(x) for x in world.T.reshape(16)]
        if "mesh" in node:
            moved["mesh"] += first["meshes"]
        if "camera" in node:
            moved["camera"] += first["cameras"]
        if LIGHTS in node.get("extensions", {}):
            light = node["extensions"][LIGHTS]["light"]
            moved["extensions"] = {**node["extensions"], LIGHTS: {"light": light + first_light}}
        self.document["scenes"][0]["nodes"].append(self.count("nodes"))
        self.put("nodes", moved)

    def write(self, path):
        document = dict(self.document)
        if not self.lights():
            del document["extensions"][LIGHTS]
        document["buffers"] = [{"byteLength": len(self.blob)}]
        write_glb(path, json.loads(json.dumps(document)), self.blob)


def write_merged(path, parts):
    """parts: [(file, [4 x 4 matrix, ...]), ...]"""
    joined = Joined()
    for file, places in parts:
        joined.add(file, places)
    joined.write(path)
