"""kiln generate: every scene is sound glTF, the same every time, and of the size asked for."""
import json
import os
import struct
import unittest

import numpy

from kiln_cli import InOwnFolder, kiln


def read_glb(path):
    with open(path, "rb") as file:
        data = file.read()
    magic, version, length, json_length, json_kind = struct.unpack("<4sIII4s", data[:20])
    assert (magic, version, length, json_kind) == (b"glTF", 2, len(data), b"JSON")
    binary_length, binary_kind = struct.unpack("<I4s", data[20 + json_length:28 + json_length])
    assert binary_kind == b"BIN\0" and 28 + json_length + binary_length == length
    return json.loads(data[20:20 + json_length]), data[28 + json_length:]


def accessor(document, binary, index):
    entry = document["accessors"][index]
    view = document["bufferViews"][entry["bufferView"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[entry["type"]]
    kind = {5126: "<f4", 5125: "<u4"}[entry["componentType"]]
    assert view["byteOffset"] % 4 == 0 and entry["count"] * width * 4 <= view["byteLength"]
    assert view["byteOffset"] + view["byteLength"] <= document["buffers"][0]["byteLength"] <= len(binary)
    return numpy.frombuffer(binary, kind, entry["count"] * width,
                            view["byteOffset"] + entry["byteOffset"]).reshape(-1, width)


def covered_twice(corners, size=256):
    """Texel centres of a size x size raster that lie strictly inside more than one triangle."""
    count = numpy.zeros((size, size), int)
    for a, b, c in corners * size:
        low = numpy.floor(numpy.minimum(numpy.minimum(a, b), c)).astype(int)
        high = numpy.ceil(numpy.maximum(numpy.maximum(a, b), c)).astype(int)
        x, y = numpy.meshgrid(numpy.arange(low[0], high[0]) + 0.5, numpy.arange(low[1], high[1]) + 0.5)
        sides = [(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in ((a, b), (b, c), (c, a))]
        inside = numpy.all([s > 1e-6 for s in sides], 0) | numpy.all([s < -1e-6 for s in sides], 0)
        count[low[1]:high[1], low[0]:high[0]] += inside
    return int((count > 1).sum())


class Generate(InOwnFolder):
    def setUp(self):
        super().setUp()
        listed = json.loads(kiln("generate", "--json").out)
        self.assertEqual(listed["status"], "done")
        self.names = [scene["name"] for scene in listed["scenes"]]

    def make(self, name, *options, file="scene.glb"):
        path = os.path.join(self.folder, file)
        answer = kiln("generate", name, "-o", path, "--json", *options)
        self.assertEqual(answer.code, 0, answer.err)
        self.assertEqual(json.loads(answer.out)["status"], "done")
        return path, json.loads(answer.out)

    def check(self, path, name):
        document, binary = read_glb(path)
        materials_used = set()
        for mesh in document["meshes"]:
            attributes = mesh["primitives"][0]["attributes"]
            positions = accessor(document, binary, attributes["POSITION"]).astype(float)
            normals = accessor(document, binary, attributes["NORMAL"]).astype(float)
            entry = document["accessors"][attributes["POSITION"]]
            numpy.testing.assert_array_equal(numpy.float32(entry["min"]), numpy.float32(positions.min(0)))
            numpy.testing.assert_array_equal(numpy.float32(entry["max"]), numpy.float32(positions.max(0)))
            triangles = numpy.vstack([accessor(document, binary, part["indices"]).reshape(-1, 3)
                                      for part in mesh["primitives"]])
            materials_used |= {part["material"] for part in mesh["primitives"]}
            self.assertLess(triangles.max(), len(positions))
            corners = positions[triangles]
            cross = numpy.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            area = 0.5 * numpy.linalg.norm(cross, axis=1)
            self.assertGreater(area.min(), 0, f"{name}: a triangle of no area in {mesh['name']}")
            self.assertGreater((cross * normals[triangles].mean(1)).sum(1).min(), 0,
                               f"{name}: a normal on the wrong side")
            numpy.testing.assert_allclose(numpy.linalg.norm(normals, axis=1), 1, atol=1e-6)
            if "TEXCOORD_1" in attributes:
                layout = accessor(document, binary, attributes["TEXCOORD_1"]).astype(float)
                self.assertTrue(0 <= layout.min() and layout.max() <= 1, f"{name}: layout outside the unit square")
                uv = layout[triangles]
                u, v = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
                density = numpy.sqrt(0.5 * abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / area)
                self.assertLess(density.max() / density.min(), 1.02, f"{name}: uneven layout of {mesh['name']}")
                if len(triangles) < 5000:
                    self.assertEqual(covered_twice(uv), 0, f"{name}: overlap in the layout of {mesh['name']}")
        self.assertEqual(materials_used, set(range(len(document["materials"]))),
                         f"{name}: a material that nothing wears")
        self.assertEqual({n["mesh"] for n in document["nodes"] if "mesh" in n}, set(range(len(document["meshes"]))))
        return document

    def test_every_scene_is_sound_and_repeatable(self):
        for name in self.names:
            path, report = self.make(name)
            document = self.check(path, name)
            self.assertEqual(report["bytes"], os.path.getsize(path))
            self.assertEqual(report["meshes"], len(document["meshes"]))
            again, _ = self.make(name, file="again.glb")
            with open(path, "rb") as first, open(again, "rb") as second:
                self.assertEqual(first.read(), second.read(), name)

    def test_the_importer_has_nothing_to_complain_of(self):
        """But for what the scenes are made to show."""
        def glass(index, thickness):
            return [f"materials[{index}] (KHR_materials_transmission): lets 100 % of the light through, tinted by its "
                    "base colour, as thin walls do; without --materials diffuse it is refracted and mirrored, too",
                    f"materials[{index}] (KHR_materials_volume): --materials diffuse bakes thin walls, not a body "
                    f"{thickness} m thick that bends light and absorbs it"]
        expected = {"cornell-offset": ["8 objects have coordinates in the file that are coarser than a tenth of a "
                                       "texel (most in \"back\": 0.0119 m apart, a texel has 0.0848 m): model "
                                       "near the mesh's origin, and let the node's translation move it"],
                    "cornell-shapes": ["3 of 11 meshes have no second UV set and are unwrapped"],
                    "cornell-statue": ["1 of 8 meshes have no second UV set and are unwrapped"],
                    "cornell-spheres": ["2 of 8 meshes have no second UV set and are unwrapped", *glass(5, 2)],
                    "cornell-water": ["1 of 7 meshes have no second UV set and are unwrapped", *glass(4, 1.2)],
                    "prism": glass(1, 0.3)}
        for name in self.names:
            path, report = self.make(name)
            answer = kiln("info", path, "--json", "--lightmap-size", 64)
            self.assertEqual(answer.code, 0, answer.err)
            info = json.loads(answer.out)
            # lightmaps of 64 x 64 are too small for some layouts, which is said
            found = sorted(note["text"] for note in info["notes"]
                           if "lightmaps with several charts" not in note["text"] and
                           "share texels" not in note["text"])
            self.assertEqual(found, expected.get(name, []), name)
            self.assertEqual(len(info["meshes"]), report["meshes"])
            self.assertEqual(len(info["cameras"]), 1)

    def test_glass_is_a_body(self):
        """Its mesh is closed and faces outwards: every edge is there once each way, and the volume is above 0."""
        for name, mesh_name, extensions in (
                ("cornell-spheres", "glass_ball", {"ior": {"ior": 1.5}, "volume": {"thicknessFactor": 2}}),
                ("cornell-water", "water", {"ior": {"ior": 1.33}, "volume": {
                    "thicknessFactor": 1.2, "attenuationDistance": 5, "attenuationColor": [0.6, 0.9, 0.95]}}),
                ("prism", "prism", {"ior": {"ior": 1.728}, "volume": {"thicknessFactor": 0.3},
                                    "dispersion": {"dispersion": 0.70175}})):
            document, binary = read_glb(self.make(name)[0])
            mesh, = [m for m in document["meshes"] if m["name"] == mesh_name]
            part, = mesh["primitives"]
            wanted = {"transmission": {"transmissionFactor": 1}, **extensions}
            self.assertEqual(document["materials"][part["material"]]["extensions"],
                             {"KHR_materials_" + key: value for key, value in wanted.items()})
            self.assertLessEqual({"KHR_materials_" + key for key in wanted}, set(document["extensionsUsed"]))
            positions = accessor(document, binary, part["attributes"]["POSITION"]).astype(float)
            _, welded = numpy.unique(positions, axis=0, return_inverse=True)
            triangles = accessor(document, binary, part["indices"]).reshape(-1, 3)
            around = welded.reshape(-1)[triangles]
            edges = numpy.vstack([around[:, [0, 1]], around[:, [1, 2]], around[:, [2, 0]]])
            self.assertEqual(len(numpy.unique(edges, axis=0)), len(edges), name)
            self.assertEqual({tuple(e) for e in edges}, {tuple(e[::-1]) for e in edges}, name)
            corners = positions[triangles]
            self.assertGreater(numpy.einsum("ij,ij->", corners[:, 0], numpy.cross(corners[:, 1], corners[:, 2])), 0)

    def test_the_prism_bends_its_beam_least(self):
        """The beam, traced through the mesh: 59.5 degrees, and 2.9 between the lines F and C; it ends on a wall."""
        document, binary = read_glb(self.make("prism")[0])
        part, = [m for m in document["meshes"] if m["name"] == "prism"][0]["primitives"]
        corners = accessor(document, binary, part["attributes"]["POSITION"]).astype(float)[
            accessor(document, binary, part["indices"]).reshape(-1, 3)]
        node, = [n for n in document["nodes"] if n["name"] == "beam"]
        spot = document["extensions"]["KHR_lights_punctual"]["lights"][0]["spot"]
        self.assertLess(spot["innerConeAngle"], spot["outerConeAngle"])
        x, y, z, w = node["rotation"]
        start = numpy.array([-2 * (x * z + w * y), -2 * (y * z - w * x), -1 + 2 * (x * x + y * y)])  # -z, turned

        def leaves(index):
            place, way, inside = numpy.array(node["translation"]), start, False
            for _ in range(2):
                hits = []
                for a, b, c in corners:
                    solved = numpy.linalg.solve(numpy.array([b - a, c - a, -way]).T, place - a) \
                        if abs(numpy.dot(numpy.cross(b - a, c - a), way)) > 1e-9 else (-1, -1, -1)
                    if min(solved[0], solved[1], 1 - solved[0] - solved[1]) > -1e-9 and solved[2] > 1e-6:
                        hits.append((solved[2], numpy.cross(b - a, c - a)))
                distance, normal = min(hits, key=lambda hit: hit[0])
                normal = normal / numpy.linalg.norm(normal) * (-1 if inside else 1)
                eta, cosine = (index if inside else 1 / index), -numpy.dot(normal, way)
                self.assertGreater(cosine, 0)
                place = place + distance * way
                way = eta * way + (eta * cosine - (1 - eta * eta * (1 - cosine * cosine))**0.5) * normal
                inside = not inside
            return place, way

        place, way = leaves(1.728)
        self.assertAlmostEqual(numpy.degrees(numpy.arccos(way @ start)), 59.5, delta=0.1)
        self.assertAlmostEqual(way[0], start[0], places=5)  # least: the way is symmetric
        spread = leaves(1.728 + 0.4 * 0.728 / 28.5)[1], leaves(1.728 - 0.6 * 0.728 / 28.5)[1]
        self.assertAlmostEqual(numpy.degrees(numpy.arccos(spread[0] @ spread[1])), 2.9, delta=0.1)
        wall = place + (5.5 - place[0]) / way[0] * way
        self.assertTrue(0 < wall[1] < 2.4 and 0.2 < wall[2] < 3.8, wall)

    def test_the_mirrors_are_plane_and_face_inwards(self):
        document, binary = read_glb(self.make("mirrors")[0])
        faces = 0
        for mesh in document["meshes"]:
            part, = mesh["primitives"]
            material = document["materials"][part["material"]]["pbrMetallicRoughness"]
            positions = accessor(document, binary, part["attributes"]["POSITION"])
            normal = accessor(document, binary, part["attributes"]["NORMAL"])[0]
            self.assertGreater(numpy.dot(numpy.array([2, 1.5, 2.5]) - positions[0], normal), 0, mesh["name"])
            if material["metallicFactor"] == 1:
                faces += 1
                self.assertEqual((material["roughnessFactor"], material["baseColorFactor"][:3]), (0, [0.9] * 3))
                self.assertEqual(normal[1], 0)
        self.assertEqual(faces, 4)

    def test_a_distinct_city_has_no_instances_and_its_parts_are_the_whole(self):
        whole, said = self.make("city", "--triangles", 40000, "--distinct")
        self.assertEqual(said["triangles"], said["triangles_with_instances"])
        self.assertLess(abs(said["triangles"] / 40000 - 1), 0.1)
        document, binary = read_glb(whole)
        self.assertEqual(len(document["meshes"]), sum("mesh" in node for node in document["nodes"]))
        shapes = {accessor(document, binary, m["primitives"][0]["attributes"]["POSITION"]).tobytes()
                  for m in document["meshes"]}
        self.assertEqual(len(shapes), len(document["meshes"]))
        ground = next(m for m in document["meshes"] if m["name"] == "ground")
        self.assertEqual(document["accessors"][ground["primitives"][0]["indices"]]["count"], 6)
        job, of_parts = self.make("city", "--triangles", 40000, "--distinct", "--parts", 3, file="town.yaml")
        self.assertEqual((of_parts["triangles"], of_parts["nodes"], of_parts["parts"]),
                         (said["triangles"], said["nodes"], 3))
        with open(job) as file:
            self.assertEqual(file.read(), "parts:\n" + "".join(
                f'  - {{name: part_{k}, file: "town-{k}.glb"}}\n' for k in (1, 2, 3)))
        nodes = [node for k in (1, 2, 3)
                 for node in read_glb(os.path.join(self.folder, f"town-{k}.glb"))[0]["nodes"] if "mesh" in node]
        self.assertEqual([(n["name"], n.get("translation"), n.get("rotation")) for n in nodes],
                         [(n["name"], n.get("translation"), n.get("rotation")) for n in document["nodes"]
                          if "mesh" in n])
        answer = kiln("info", job, "--json")
        self.assertEqual(json.loads(answer.out)["counts"]["objects"], len(nodes))

    def test_the_cornell_box_has_its_measures(self):
        path, _ = self.make("cornell")
        document, binary = read_glb(path)
        meshes = {mesh["name"]: mesh["primitives"][0] for mesh in document["meshes"]}
        light = accessor(document, binary, meshes["light"]["attributes"]["POSITION"])
        numpy.testing.assert_allclose([light.min(0), light.max(0)], [[2.13, 5.488, 2.27], [3.43, 5.488, 3.32]],
                                      rtol=1e-6)
        emission = document["materials"][meshes["light"]["material"]]
        strength = emission["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
        numpy.testing.assert_allclose(numpy.array(emission["emissiveFactor"]) * strength, [18.387, 13.9873, 6.75357],
                                      rtol=1e-5)
        tall = accessor(document, binary, meshes["tall_block"]["attributes"]["POSITION"])
        numpy.testing.assert_allclose([tall.min(0), tall.max(0)], [[2.65, 0, 2.47], [4.72, 3.3, 4.56]], rtol=1e-6)
        base = {m["name"]: m["pbrMetallicRoughness"]["baseColorFactor"][:3] for m in document["materials"]}
        self.assertEqual(base, {"white": [0.725, 0.71, 0.68], "green": [0.14, 0.45, 0.091], "red": [0.63, 0.065, 0.05],
                                "light": [0.78, 0.78, 0.78]})
        for name, factor in (("cornell-tiny", 1e-6), ("cornell-huge", 1e6)):
            scaled, binary = read_glb(self.make(name)[0])
            box = numpy.array([scaled["accessors"][m["primitives"][0]["attributes"]["POSITION"]]["max"]
                               for m in scaled["meshes"]])
            numpy.testing.assert_allclose(box.max(0), numpy.array([5.56, 5.488, 5.592]) * factor, rtol=1e-6)

    def test_sizes(self):
        for triangles in (1000, 30000, 1000000):
            _, report = self.make("city", "--triangles", triangles)
            self.assertLess(abs(report["triangles_with_instances"] / triangles - 1), 0.15)
        _, report = self.make("cornell-statue", "--triangles", 100000)
        self.assertLess(abs(report["triangles"] / 100000 - 1), 0.02)
        path, report = self.make("lights", "--columns", 100, "--rows", 50)
        document, binary = read_glb(path)
        lamps = [part for mesh in document["meshes"] for part in mesh["primitives"]
                 if "emissiveFactor" in document["materials"][part["material"]]]
        self.assertEqual(sum(document["accessors"][part["indices"]]["count"] for part in lamps), 3 * 10000)
        path, report = self.make("rooms", "--columns", 4, "--rows", 5)
        self.assertEqual(sum("mesh" in node for node in read_glb(path)[0]["nodes"]), 20)
        albedo = read_glb(self.make("furnace", "--albedo", 0.9)[0])[0]["materials"][0]["pbrMetallicRoughness"][
            "baseColorFactor"]
        self.assertEqual(albedo[:3], [0.9, 0.9, 0.9])

    def test_the_seed_counts(self):
        with open(self.make("city", "--seed", 1)[0], "rb") as file:
            first = file.read()
        with open(self.make("city", "--seed", 2)[0], "rb") as file:
            self.assertNotEqual(first, file.read())

    def test_refusals(self):
        path = os.path.join(self.folder, "x.glb")
        for code, pattern, arguments in (
                (64, r"'corneel'; the nearest one is 'cornell' .*furnace, city", ["corneel", "-o", path]),
                (64, r"say where the scene goes", ["cornell"]),
                (64, r"must end in .glb", ["cornell", "-o", "x.obj"]),
                (64, r"takes no --triangles", ["cornell", "-o", path, "--triangles", "5"]),
                (64, r"takes no --albedo", ["rooms", "-o", path, "--albedo", "0.2"]),
                (64, r"--albedo: 1 is out of range", ["furnace", "-o", path, "--albedo", "1"]),
                (64, r"from 1000 to 1000000000", ["city", "-o", path, "--triangles", "10"]),
                (64, r"name must end in .yaml", ["city", "-o", path, "--parts", "2"]),
                (64, r"the city has 4 houses", ["city", "-o", os.path.join(self.folder, "c.yaml"), "--triangles",
                                                "2000", "--parts", "5"]),
                (64, r"takes no --distinct or --parts", ["rooms", "-o", path, "--distinct"]),
                (64, r"28.00 GB .* 4.29 GB", ["cornell-statue", "-o", path, "--triangles", "1000000000"]),
                (73, r"'/proc/x.glb' cannot be created", ["cornell", "-o", "/proc/x.glb"]),
                (73, r"missing/x.glb' cannot be created",
                 ["cornell", "-o", os.path.join(self.folder, "missing/x.glb")])):
            answer = kiln("generate", *arguments)
            self.assertEqual(answer.code, code, answer.err)
            self.assertRegex(answer.sentence(), pattern)
            self.assertEqual(os.listdir(self.folder), [])


if __name__ == "__main__":
    unittest.main()
