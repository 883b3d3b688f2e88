"""--vertex-light: irradiance at vertices is the least-squares fit to the points' light.

Where all light is alike the vertices have it. Where it is not, the stated error is that of the interpolated light at
the points, and taking the nearest point's light for a vertex is worse. Vertices that a mesh has twice, at one place and
with one normal, have one value. One rank and three give the same bits. scene.glb has the values as COLOR_1, each
object's own, though two objects share a mesh."""
import json
import math
import os
import sys
import tempfile

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
from program import kiln  # noqa: E402

SIDE = 8  # of the floor, in squares


def bake(scene, folder, *options, ranks=0):
    kiln("bake", scene, "-o", folder, "--vertex-light", "--samples-probe", "0", "--no-preview", "--quiet",
         "--backend", "embree", "--threads", "1", *options, ranks=ranks)
    with h5py.File(os.path.join(folder, "kiln.h5"), "r") as file:
        return {name: file[name][...] for name in ("vertices/position", "vertices/irradiance", "vertices/first",
                                                   "vertices/error", "points/position", "points/area",
                                                   "irradiance/total")}


def furnace(path):
    scene = glb.Scene()
    glow = scene.material("glow", (0.5, 0.5, 0.5), (1, 1, 1))
    glb.box(scene, "room", (0, 0, 0), (1, 1, 1), glow, range(6))
    return scene.write(path)


def floor(path):
    """A floor of 4 m in squares under a lamp near one of its corners; each square has vertices of its own."""
    scene = glb.Scene()
    grey = scene.material("grey", (0.5, 0.5, 0.5))
    positions, layout, triangles = [], [], []
    for i in range(SIDE):
        for k in range(SIDE):
            first = len(positions)
            for s, t in ((0, 0), (1, 0), (1, 1), (0, 1)):
                positions.append(((i + s) * 4 / SIDE, 0, (k + t) * 4 / SIDE))
                layout.append(((i + s) / SIDE, (k + t) / SIDE))
            triangles += [(first, first + 2, first + 1), (first, first + 3, first + 2)]
    scene.mesh("floor", positions, layout, triangles, grey)
    scene.document["nodes"].append({"name": "lower", "mesh": 0, "translation": [0, -2, 5]})
    scene.document["scenes"][0]["nodes"].append(len(scene.document["nodes"]) - 1)
    scene.light("lamp", {"type": "point", "intensity": 100.0}, translation=[1, 0.7, 1.2])
    return scene.write(path)


def interpolated(position, irradiance, at):
    """The light at places of the floor, whose squares are cut from corner 0 to corner 2."""
    square = np.clip((at[:, [0, 2]] * SIDE / 4).astype(int), 0, SIDE - 1)
    s, t = (at[:, [0, 2]] * SIDE / 4 - square).T
    grid = np.zeros((SIDE + 1, SIDE + 1, 3))
    grid[tuple(np.rint(position[:, [0, 2]] * SIDE / 4).astype(int).T)] = irradiance
    x, z = square[:, :1] + [0, 1, 1, 0], square[:, 1:] + [0, 0, 1, 1]
    corners = grid[x, z]
    weights = np.where((s > t)[:, None], np.c_[1 - s, s - t, t, 0 * s], np.c_[1 - t, 0 * s, s, t - s])
    return np.einsum("pk,pkc->pc", weights, corners)


def exported(path):
    """{node's name: (positions in the world, COLOR_1)} of a .glb."""
    with open(path, "rb") as file:
        data = file.read()
    length = int.from_bytes(data[12:16], "little")
    document, blob = json.loads(data[20:20 + length]), data[28 + length:]

    def values(index):
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        assert accessor["componentType"] == 5126 and accessor["type"] == "VEC3"
        return np.frombuffer(blob, np.float32, 3 * accessor["count"], view.get("byteOffset", 0)).reshape(-1, 3)

    found = {}
    for node in document["nodes"]:
        for primitive in document["meshes"][node["mesh"]]["primitives"] if "mesh" in node else ():
            attributes = primitive["attributes"]
            assert document["accessors"][attributes["COLOR_0"]]["count"] == len(values(attributes["COLOR_1"]))
            found[node["name"]] = (values(attributes["POSITION"]) + np.float32(node.get("translation", [0, 0, 0])),
                                   values(attributes["COLOR_1"]))
    return found


def luminance(rgb):
    return rgb @ np.array([0.2126, 0.7152, 0.0722])


with tempfile.TemporaryDirectory() as folder:
    found = bake(furnace(os.path.join(folder, "furnace.glb")), os.path.join(folder, "furnace"),
                 "--texels-per-metre", "4", "--bounces", "12", "--samples-direct", "256",
                 "--samples-bounce", "64", "--samples-indirect", "256")
    light = found["vertices/irradiance"]
    assert np.all(abs(light / (2 * math.pi) - 1) < 0.03), light
    assert np.all(found["vertices/error"] < 0.03), found["vertices/error"]

    scene = floor(os.path.join(folder, "floor.glb"))
    options = ("--texels-per-metre", "40", "--bounces", "0", "--samples-direct", "16")
    found = bake(scene, os.path.join(folder, "floor"), *options)
    whole = 4 * SIDE * SIDE
    assert list(found["vertices/first"]) == [0, whole, 2 * whole]
    position, light = found["vertices/position"][:whole], found["vertices/irradiance"][:whole]
    own = found["points/position"][:, 1] > -1
    points, total, area = (found[name][own] for name in ("points/position", "irradiance/total", "points/area"))

    def error(vertices):
        off = luminance(interpolated(position, vertices, points)) - luminance(total)
        return math.sqrt(np.average(off * off, weights=area)) / np.average(luminance(total), weights=area)

    stated = float(found["vertices/error"][0])
    assert abs(error(light) - stated) < 0.05 * stated, (error(light), stated)
    nearest = total[((position[:, None] - points) ** 2).sum(axis=2).argmin(axis=1)]
    assert error(light) < 0.75 * error(nearest), (error(light), error(nearest))
    places = {}
    for place, rgb in zip(found["vertices/position"].round(5).tolist(), found["vertices/irradiance"].tolist()):
        assert places.setdefault(tuple(place), rgb) == rgb, (place, rgb)
    assert len(places) == 2 * (SIDE + 1) ** 2

    written = exported(os.path.join(folder, "floor", "scene.glb"))
    assert set(written) == {"floor", "lower"}, set(written)
    for name, (corners, colors) in written.items():
        assert len(corners) == len(colors) == whole
        for place, rgb in zip(corners.round(5).tolist(), colors.tolist()):
            assert np.allclose(places[tuple(place)], rgb, rtol=1e-6), (name, place, rgb)
    # what kiln export writes afterwards, with the lightmaps on one page
    there = os.path.join(folder, "there", "scene.glb")
    kiln("export", os.path.join(folder, "floor"), "-o", there, "--atlas", "512", "--quiet")
    later = exported(there)
    assert set(later) == set(written) and all(np.array_equal(later[name][1], written[name][1]) for name in written)

    again = bake(scene, os.path.join(folder, "ranks"), *options, ranks=3)
    for name in found:
        assert np.array_equal(found[name], again[name]), name
    print("error of the fit %.4f, of vertices with the nearest point's light %.4f" % (stated, error(nearest)))
