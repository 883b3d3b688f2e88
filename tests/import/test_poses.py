"""Skinned meshes stand where their joints' nodes put them, and morph targets have the weights that the file gives."""
import base64
import json
import os
import struct

import importing

CORNERS = [(0, 0, 0), (1, 0, 0), (1, 0, -1), (0, 0, -1)]


def matrix(x=0.0, y=0.0, z=0.0, scale=1.0):
    """Columns of a scale, then a translation."""
    return [scale, 0, 0, 0, 0, scale, 0, 0, 0, 0, scale, 0, x, y, z, 1]


def scene(nodes, skins=({"joints": [1]},), binds=None, joints=((0, 0, 0, 0),) * 4, weights=((1, 0, 0, 0),) * 4,
          weight_type=5126, roots=None, uv=True, **mesh):
    """A quad of 1 m on the floor, with joints and weights of its vertices. `nodes`: the first has the mesh."""
    kind = {5126: "f", 5121: "B"}[weight_type]
    parts = [b"".join(struct.pack("<3f", *p) for p in CORNERS), b"".join(struct.pack("<4B", *j) for j in joints),
             b"".join(struct.pack("<4" + kind, *w) for w in weights), struct.pack("<6H", 0, 1, 2, 0, 2, 3),
             b"".join(struct.pack("<16f", *m) for m in binds or [matrix()]),
             struct.pack("<12f", *[0, 3, 0] * 4), struct.pack("<8f", 0, 0, 1, 0, 1, 1, 0, 1),
             struct.pack("<12f", *[0, 1, 0] * 4)]
    data, views = b"", []
    for part in parts:
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(part)})
        data += part + b"\0" * (-len(part) % 4)
    accessor = lambda view, component, count, type, **more: {"bufferView": view, "componentType": component,
                                                             "count": count, "type": type, **more}
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 7, "JOINTS_0": 1, "WEIGHTS_0": 2}, "indices": 3}
    if uv:
        primitive["attributes"]["TEXCOORD_1"] = 6
    if "weights" in mesh or any("weights" in n for n in nodes):
        primitive["targets"] = [{"POSITION": 5}, {}]
    skins = [dict(s, inverseBindMatrices=4) if binds else s for s in skins]
    return {"asset": {"version": "2.0"}, "scene": 0,
            "scenes": [{"nodes": roots if roots is not None else list(range(len(nodes)))}],
            "nodes": nodes, "skins": skins, "meshes": [dict({"primitives": [primitive]}, **mesh)],
            "bufferViews": views,
            "accessors": [accessor(0, 5126, 4, "VEC3"), accessor(1, 5121, 4, "VEC4"),
                          accessor(2, weight_type, 4, "VEC4", **({} if kind == "f" else {"normalized": True})),
                          accessor(3, 5123, 6, "SCALAR"), accessor(4, 5126, len(binds or [0]), "MAT4"),
                          accessor(5, 5126, 4, "VEC3"), accessor(6, 5126, 4, "VEC2"), accessor(7, 5126, 4, "VEC3")],
            "buffers": [{"byteLength": len(data), "uri": "data:application/octet-stream;base64," +
                         base64.b64encode(data).decode()}]}


FIGURE = {"mesh": 0, "skin": 0, "translation": [0, 5, 0], "scale": [7, 7, 7]}


class Poses(importing.Case):
    def report(self, document):
        return self.accepted(importing.write(self.folder(), "scene.gltf", document))

    def stands(self, document, low, high):
        report = self.report(document)
        for found, right in ((report["bounds"]["min"], low), (report["bounds"]["max"], high)):
            for a, b in zip(found, right):
                self.assertAlmostEqual(a, b, delta=1e-6 * max(1.0, abs(b)))
        return report

    def test_joints_place_it(self):
        """The node's own transform has no part in it; what stands above a joint has."""
        self.stands(scene([FIGURE, {"translation": [1, 0, 0]}]), (1, 0, -1), (2, 0, 0))
        nodes = [FIGURE, {"translation": [1, 0, 0]}, {"translation": [0, 2, 0], "scale": [3, 3, 3], "children": [1]}]
        self.stands(scene(nodes, roots=[0, 2]), (3, 2, -3), (6, 2, 0))

    def test_inverse_bind_matrices(self):
        self.stands(scene([FIGURE, {"translation": [1, 0, 0], "scale": [2, 2, 2]}], binds=[matrix(-0.5, 1, 0)]),
                    (0, 2, -2), (2, 2, 0))

    def test_joints_are_blended(self):
        nodes = [FIGURE, {"translation": [4, 0, 0]}, {"translation": [0, 2, 0]}]
        for weights, kind in (((0.75, 0.25, 0, 0), 5126), ((3, 1, 0, 0), 5126), ((186, 62, 0, 0), 5121)):
            self.stands(scene(nodes, [{"joints": [1, 2]}], joints=((0, 1, 0, 0),) * 4, weights=(weights,) * 4,
                              weight_type=kind), (3, 0.5, -1), (4, 0.5, 0))

    def test_far_from_the_origin(self):
        """Joints in map coordinates: floats hold what is left."""
        x, y = 4500000.25, 5400000.125
        report = self.stands(scene([FIGURE, {"translation": [x, 30, y]}]), (x, 30, y - 1), (x + 1, 30, y))
        self.assertAlmostEqual(report["objects"][0]["area"], 1.0, places=6)

    def test_a_mirrored_pose_keeps_its_fronts(self):
        """Fronts and normals agree in the mirror image, too."""
        for sign in (1, -1):
            report = self.report(scene([FIGURE, {"scale": [sign, 1, 1]}]))
            self.assertFalse([n for n in report["notes"] if "point to the back" in n["text"]], report["notes"])
            self.assertAlmostEqual(report["objects"][0]["area"], 1.0, places=6)

    def test_one_mesh_in_two_poses(self):
        nodes = [FIGURE, {"translation": [1, 0, 0]}, dict(FIGURE, skin=1), {"translation": [10, 0, 0]}]
        document = scene(nodes, [{"joints": [1]}, {"joints": [3]}])
        report = self.stands(document, (1, 0, -1), (11, 0, 0))
        self.assertEqual((report["counts"]["objects"], report["counts"]["meshes"]), (2, 2))
        self.assertIn("2 skinned meshes are baked in the pose", "\n".join(n["text"] for n in report["notes"]))

    def test_export(self):
        """scene.glb has posed meshes with their layouts, one for each pose; a mirrored one, too."""
        nodes = [FIGURE, {"translation": [1, 0, 0]}, dict(FIGURE, skin=1), {"translation": [10, 0, 0],
                                                                            "scale": [-1, 1, 4]}]
        path = importing.write(self.folder(), "scene.gltf", scene(nodes, [{"joints": [1]}, {"joints": [3]}], uv=False))
        out = os.path.join(self.folder(), "out")
        baked = importing.kiln("bake", path, "-o", out, "--texels-per-metre", 8, "--samples-probe", 0, "--no-preview",
                               "--environment", "1,1,1")
        self.assertEqual(baked.code, 0, baked.err)
        with open(os.path.join(out, "scene.glb"), "rb") as file:
            data = file.read()
        document = json.loads(data[20:20 + struct.unpack_from("<I", data, 12)[0]])
        meshes = [document["nodes"][i]["mesh"] for i in (0, 2)]
        self.assertNotEqual(*meshes)
        layouts = {document["meshes"][m]["primitives"][0]["attributes"]["TEXCOORD_1"] for m in meshes}
        self.assertEqual(len(layouts), 2)
        again = self.accepted(os.path.join(out, "scene.glb"), "--texels-per-metre", 8)
        self.assertEqual([m["layout"] for m in again["meshes"]], ["own", "own"])
        self.assertEqual((again["bounds"]["min"], again["bounds"]["max"]), ([1, 0, -4], [10, 0, 0]))

    def test_weights_of_morph_targets(self):
        """The mesh's, or those of the node in their place; without any, the mesh as it is."""
        plain = {"mesh": 0}
        self.stands(scene([plain], []), (0, 0, -1), (1, 0, 0))
        document = scene([dict(plain, weights=[0, 0])], [])
        document["meshes"][0]["weights"] = [0.5, 1]
        self.stands(document, (0, 0, -1), (1, 0, 0))
        del document["nodes"][0]["weights"]
        self.stands(document, (0, 1.5, -1), (1, 1.5, 0))
        document["nodes"] += [dict(plain, weights=[1, 0])]
        document["scenes"] = [{"nodes": [0, 1]}]
        self.stands(document, (0, 1.5, -1), (1, 3, 0))

    def test_refusals(self):
        joint = {"translation": [1, 0, 0]}
        for document, word in ((scene([FIGURE, joint], joints=((1, 0, 0, 0),) * 4), "JOINTS_0"),
                               (scene([FIGURE, joint], [{"joints": []}]), "skins[0].joints"),
                               (scene([FIGURE, joint], [{"joints": [5]}]), "skins[0].joints"),
                               (scene([FIGURE, joint, joint], [{"joints": [1, 2]}], binds=[matrix()]),
                                "inverseBindMatrices"),
                               (scene([dict(FIGURE, skin=3), joint]), "nodes[0].skin")):
            self.refused(importing.write(self.folder(), "scene.gltf", document), [word])

    def test_many_poses_of_a_small_file(self):
        """What is stored for each node stays in proportion to the file."""
        document = scene([dict(FIGURE) for _ in range(3000)] + [{"translation": [1, 0, 0]}], [{"joints": [3000]}])
        answer = importing.info(importing.write(self.folder(), "scene.gltf", document), "--lightmap-size", 1,
                                timeout=100)
        self.assertIn(answer.code, (0, 65), answer.err)
        self.assertNotIn("importer died", answer.err)


if __name__ == "__main__":
    importing.main()
