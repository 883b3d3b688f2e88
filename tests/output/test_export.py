"""kiln export and scene.glb: what an engine gets is the source scene, with the coordinates that were baked and links
that lead to the texels."""
import json
import os
import shutil
import struct
import sys
import tempfile
import zlib

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exported  # noqa: E402
import exr  # noqa: E402
import glb  # noqa: E402
import gltf_file  # noqa: E402
from program import kiln, run_json  # noqa: E402

DATA = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "data")
QUICK = ("--samples-direct", "1", "--samples-bounce", "1", "--samples-indirect", "1", "--bounces", "0",
         "--samples-probe", "0", "--no-preview", "--quiet")


def bake(scene, folder, *options, prefix=()):
    kiln("bake", scene, "-o", folder, *QUICK, *options, prefix=prefix)
    return folder


def check(folder, scene, links):
    """scene.glb of a bake against its source and what was baked."""
    file = gltf_file.File(os.path.join(folder, "scene.glb"))
    assert exported.check_against_bake(file, exported.SceneFile(os.path.join(folder, "scene.kscene"))) == links
    assert exported.check_against_source(file, gltf_file.File(scene)) > 0
    for page in file.json["extensions"]["KILN_lightmap"]["pages"]:
        assert exr.rgb(os.path.join(folder, page["file"])).shape == (page["height"], page["width"], 3)
    assert "files" in kiln("verify", folder).stdout
    with open(os.path.join(folder, "manifest")) as manifest:
        assert '"scene.glb"' in manifest.read()
    for o in run_json(folder)["objects"]:
        link = file.json["nodes"][o["node"]]["extensions"]["KILN_lightmap"]
        link = link["instances"][o["instance"]] if "instances" in link else link
        assert (o["node"], o["mesh"], o["lightmap"]) == (link["source"]["node"], link["source"]["mesh"],
                                                         link["file"])
    return file


def own_layout(folder):
    """A good TEXCOORD_1 stays: not an accessor changes."""
    scene = os.path.join(DATA, "cornell_original.glb")
    there = bake(scene, os.path.join(folder, "own"), "--lightmap-size", "16", "--shared-texels", "keep")
    file, source = check(there, scene, 8), gltf_file.File(scene)
    assert file.json["accessors"] == source.json["accessors"] and file.json["meshes"] == source.json["meshes"]
    assert file.binary[:len(source.binary)] == source.binary
    link = file.json["nodes"][0]["extensions"]["KILN_lightmap"]
    assert link == {"file": link["file"], "page": 0, "texCoord": 1, "scale": [1, 1], "offset": [0, 0],
                    "quantity": "irradiance", "unit": "W/m2",
                    "encoding": "exr", "source": {"node": 0, "mesh": 0}}
    again = bake(scene, os.path.join(folder, "ranks"), "--lightmap-size", "16", "--shared-texels", "keep",
                 prefix=("mpirun", "--bind-to", "none", "-n", "2"))
    with open(os.path.join(there, "scene.glb"), "rb") as a, open(os.path.join(again, "scene.glb"), "rb") as b:
        assert a.read() == b.read(), "two ranks write another scene.glb"
    without = bake(scene, os.path.join(folder, "without"), "--lightmap-size", "16", "--no-export")
    assert not os.path.exists(os.path.join(without, "scene.glb"))
    kiln("verify", without)
    return there


def unwrapped(folder):
    """kiln's own layout: vertices split, and nothing else changes."""
    for name, links in (("cornell_original", 8), ("two_rooms", 7)):
        scene = os.path.join(folder, name + "_bare.glb")
        gltf_file.strip(os.path.join(DATA, name + ".glb"), scene)
        check(bake(scene, os.path.join(folder, name + "_bare"), "--lightmap-size", "32"), scene, links)


PIXEL = (b"\x89PNG\r\n\x1a\n" + b"".join(struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k,
                                         d in (
    (b"IHDR", struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0)), (b"IDAT", zlib.compress(b"\0\xff\x80\x40")),
    (b"IEND", b""))))


def hard(folder):
    """What a careless writer loses: external files, strips, a triangle without area, shared accessors, bytes, a morph
    target, a texture that uses TEXCOORD_1, extras that are no object, instances."""
    at = os.path.join(folder, "hard")
    os.makedirs(at)
    s = glb.Scene()
    grid = np.array([[x, 0, z] for z in range(4) for x in range(4)], np.float32)
    position = s.accessor(grid, "VEC3", 5126, 34962)
    low, high = grid.min(0).tolist(), grid.max(0).tolist()
    s.document["accessors"][position].update(min=low, max=high)
    color = s.accessor(np.arange(16 * 4, dtype=np.uint8).reshape(16, 4), "SCALAR", 5121, 34962)
    s.document["accessors"][color].update(type="VEC4", count=16, normalized=True)
    shared = s.accessor(np.tile(np.float32([[0.25, 0.5]]), (16, 1)), "VEC2", 5126, 34962)
    moved = s.accessor(np.full((16, 3), 0.5, np.float32), "VEC3", 5126, 34962)
    s.document["accessors"][moved].update(min=[0.5] * 3, max=[0.5] * 3)
    rows = [s.accessor(np.array([[4 * r + 4 + k, 4 * r + k] for k in range(4)], np.uint16).reshape(-1), "SCALAR", 5123,
                       34963) for r in range(3)]
    thin = s.accessor(np.array([0, 5, 1, 0, 0, 1], np.uint16), "SCALAR", 5123, 34963)
    image = {"uri": "a%20pixel.png"}
    s.document.update(images=[image], textures=[{"source": 0}], samplers=[{}])
    s.document["materials"] = [
        {"name": "second set", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}},
         "doubleSided": True},
                               {"name": "plain", "doubleSided": True}]
    strip_of = lambda r, **more: {"attributes": {"POSITION": position, "COLOR_0": color, **more}, "indices": rows[r],
                                  "mode": 5, "material": 1}
    s.document["meshes"] = [
        {"name": "strips", "primitives": [strip_of(0), strip_of(1), {**strip_of(2), "targets": [{"POSITION": moved}]}],
         "weights": [0.0]},
        {"name": "textured",
         "primitives": [{"attributes": {"POSITION": position, "TEXCOORD_0": shared, "TEXCOORD_1": shared},
                         "indices": thin, "material": 0}]}]
    del s.document["meshes"][0]["weights"]
    s.document["meshes"][0]["primitives"][2].pop("targets")
    s.document["meshes"].append({"name": "bends", "primitives": [{**strip_of(2), "targets": [{"POSITION": moved}]}]})
    offsets = s.accessor(np.float32([[0, 5, 0], [0, 6, 0], [0, 7, 0]]), "VEC3", 5126, 34962)
    s.document["bufferViews"][-1].pop("target")
    s.document["nodes"] = [{"mesh": 0, "name": "s", "extras": "a word"},
                           {"mesh": 1, "name": "t", "translation": [0, 1, 0], "extras": {"mine": 1}},
                           {"mesh": 2, "name": "b", "translation": [0, 2, 0]},
                           {"mesh": 1, "name": "many",
                            "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": offsets}}}}]
    s.document["scenes"][0]["nodes"] = [0, 1, 2, 3]
    s.environment((1, 1, 1))
    s.document["extensionsUsed"] = ["EXT_mesh_gpu_instancing"]
    s.document["buffers"] = [{"byteLength": len(s.blob), "uri": "the%20buffer.bin"}]
    with open(os.path.join(at, "the buffer.bin"), "wb") as file:
        file.write(s.blob)
    with open(os.path.join(at, "a pixel.png"), "wb") as file:
        file.write(PIXEL)
    scene = os.path.join(at, "hard.gltf")
    with open(scene, "w") as file:
        json.dump(s.document, file)
    there = bake(scene, os.path.join(folder, "hard-bake"), "--lightmap-size", "32")
    file = gltf_file.File(os.path.join(there, "scene.glb"))
    assert exported.check_against_bake(file, exported.SceneFile(os.path.join(there, "scene.kscene"))) == 6
    assert exported.check_against_source(file, gltf_file.File(scene)) > 0
    assert all("uri" not in part for part in file.json["buffers"] + file.json["images"])
    nodes = file.json["nodes"]
    assert nodes[0]["extras"] == "a word" and nodes[1]["extras"]["mine"] == 1
    assert nodes[0]["extensions"]["KILN_lightmap"]["texCoord"] == 1 and nodes[1]["extensions"]["KILN_lightmap"][
        "texCoord"] == 2
    assert len(nodes[3]["extensions"]["KILN_lightmap"]["instances"]) == 3
    textured = file.json["meshes"][1]["primitives"][0]["attributes"]
    corners = file.corners(file.json["meshes"][1]["primitives"][0])
    assert (file.floats(textured["TEXCOORD_1"])[corners] == [0.25, 0.5]).all(), "the texture has lost its coordinates"
    for primitive in file.json["meshes"][0]["primitives"]:
        assert "TEXCOORD_0" in primitive["attributes"], "glTF wants no set left out"
    # the same in one file, from what was exported: its links are replaced
    twice = bake(os.path.join(there, "scene.glb"), os.path.join(folder, "hard-twice"), "--lightmap-size", "32")
    again = gltf_file.File(os.path.join(twice, "scene.glb"))
    assert exported.check_against_bake(again, exported.SceneFile(os.path.join(twice, "scene.kscene"))) == 6


def gloss(folder):
    """Everything that is said of a material stays: extensions, their textures, their sets of coordinates, for which the
    lightmap's makes room."""
    at = os.path.join(folder, "gloss.glb")
    kiln("generate", "prism", "-o", at)
    s = glb.Scene()
    s.load(at)
    use = {"index": 0, "texCoord": 1}
    moved = {**use, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0.25], "rotation": 1, "scale": [2, 3]}}}
    more = {"KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [1, 2, 3],
                                       "specularColorTexture": moved},
            "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatTexture": use,
                                        "clearcoatNormalTexture": {**use, "scale": 0.5}},
            "KHR_materials_anisotropy": {"anisotropyStrength": 0.5, "anisotropyTexture": use}}
    glass, = [m for m in s.document["materials"] if m["name"] == "flint_glass"]
    glass["extensions"].update(more)
    glass["extensions"]["KHR_materials_volume"].update(attenuationDistance=2.5, attenuationColor=[0.25, 0.5, 1])
    glass["pbrMetallicRoughness"].update(metallicRoughnessTexture=moved, metallicFactor=0.25, roughnessFactor=0.5)
    s.document["extensionsUsed"] += [*more, "KHR_texture_transform"]
    s.document.update(images=[{"uri": "a%20pixel.png"}], textures=[{"source": 0}],
                      buffers=[{"byteLength": len(s.blob), "uri": "the%20buffer.bin"}])
    for name, data in (("the buffer.bin", s.blob), ("a pixel.png", PIXEL),
                       ("gloss.gltf", json.dumps(s.document).encode())):
        with open(os.path.join(folder, name), "wb") as file:
            file.write(data)
    scene = os.path.join(folder, "gloss.gltf")
    there = bake(scene, os.path.join(folder, "gloss-bake"), "--lightmap-size", "8", "--repack", "--caustics", "none")
    file = check(there, scene, 7)
    assert file.json["materials"] == s.document["materials"]
    node, = [n for n in file.json["nodes"] if n["name"] == "prism"]
    assert node["extensions"]["KILN_lightmap"]["texCoord"] == 2
    before, after = (f.json["meshes"][node["mesh"]]["primitives"][0] for f in (gltf_file.File(scene), file))
    coordinates = [f.floats(p["attributes"]["TEXCOORD_1"])[f.corners(p)]
                   for f, p in ((gltf_file.File(scene), before), (file, after))]
    assert (coordinates[0] == coordinates[1]).all(), "gloss has lost its coordinates"
    out = os.path.join(folder, "gloss-out.glb")
    kiln("export", there, "-o", out)
    assert gltf_file.File(out).json["materials"] == s.document["materials"]
    # from the scene file alone, materials are written anew: read again, they are the same
    own = bake(os.path.join(there, "scene.kscene"), os.path.join(folder, "gloss-own"), "--caustics", "none")
    read = [[m["gloss"] for m in json.loads(kiln("info", path, "--json").stdout)["materials"]]
            for path in (scene, os.path.join(own, "scene.glb"))]
    assert read[0] == read[1] and len(read[0][1]["textures"]) == 5, read
    file = gltf_file.File(os.path.join(own, "scene.glb"))
    info = file.json["materials"][1]["pbrMetallicRoughness"]["metallicRoughnessTexture"]
    transform = info["extensions"]["KHR_texture_transform"]
    assert np.allclose([*transform["offset"], transform["rotation"], *transform["scale"]], [0.5, 0.25, 1, 2, 3])
    part = file.json["meshes"][node["mesh"]]["primitives"][0]
    assert info["texCoord"] == 2
    assert np.array_equal(np.unique(file.floats(part["attributes"]["TEXCOORD_2"]), axis=0),
                          np.unique(coordinates[0].reshape(-1, 2), axis=0))


def other_formats(folder):
    """No glTF: the scene comes from kiln's own scene file."""
    scene = os.path.join(folder, "plates.obj")
    with open(scene, "w") as file:
        file.write("mtllib plates.mtl\no low\nv 0 0 0\nv 0 0 1\nv 1 0 1\nv 1 0 0\nusemtl a\nf 1 2 3 4\no high\nv 0 1 "
                   "0\nv 0 1 1\nv 1 1 1\nusemtl b\nf 5 6 7\n")
    with open(os.path.join(folder, "plates.mtl"), "w") as file:
        file.write("newmtl a\nKd 0.5 0.25 0.125\nnewmtl b\nKd 0 0 0\nKe 3 2 1\n")
    there = bake(scene, os.path.join(folder, "obj"), "--lightmap-size", "16")
    file, baked = gltf_file.File(os.path.join(there, "scene.glb")), exported.SceneFile(
        os.path.join(there, "scene.kscene"))
    links = [n["extensions"]["KILN_lightmap"] for n in file.json["nodes"] if "KILN_lightmap" in n.get("extensions", {})]
    assert len(links) == len(baked.objects) == 2 and all("source" not in link for link in links)
    for node, o in zip(file.json["nodes"], baked.objects):
        there_too = exported._exported_triangles(file, node["mesh"], 1)
        assert (exported._sorted(there_too) == exported._sorted(baked.triangles_of(int(o["mesh"])))).all()
    lamp = next(m for m in file.json["materials"] if "emissiveFactor" in m)
    strength = lamp["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
    assert np.allclose(np.array(lamp["emissiveFactor"]) * strength, [3, 2, 1])
    kiln("export", there, "-o", os.path.join(folder, "obj-out", "scene.glb"), "--atlas", "64", "--quiet")
    # a scene file as the scene: the same
    kept = bake(os.path.join(there, "scene.kscene"), os.path.join(folder, "kscene"))
    assert os.path.exists(os.path.join(kept, "scene.glb"))


def read_png(path):
    """[height, width, 4] of an RGBA PNG."""
    with open(path, "rb") as file:
        data = file.read()
    width, height, depth, kind = struct.unpack_from(">IIBB", data, 16)
    assert (depth, kind) == (8, 6)
    packed, at = b"", 8
    while at < len(data):
        size, name = struct.unpack_from(">I4s", data, at)
        packed += data[at + 8:at + 8 + size] if name == b"IDAT" else b""
        at += 12 + size
    rows = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + 4 * width)
    out = np.zeros((height + 1, width + 1, 4), np.int64)
    for y in range(height):
        line = rows[y, 1:].reshape(width, 4).astype(np.int64)
        if rows[y, 0] in (0, 2):
            out[y + 1, 1:] = (line + (out[y, 1:] if rows[y, 0] == 2 else 0)) & 255
            continue
        for x in range(width):
            a, b, c = out[y + 1, x], out[y, x + 1], out[y, x]
            p = a + b - c
            pa, pb, pc = abs(p - a), abs(p - b), abs(p - c)
            paeth = np.where((pa <= pb) & (pa <= pc), a, np.where(pb <= pc, b, c))
            guess = {1: a, 3: (a + b) // 2, 4: paeth}[rows[y, 0]]
            out[y + 1, x + 1] = (line[x] + guess) & 255
    return out[1:, 1:]


def read_ktx2(path):
    with open(path, "rb") as file:
        data = file.read()
    assert data[:12] == b"\xabKTX 20\xbb\r\n\x1a\n"
    form, size, width, height, depth, layers, faces, levels, scheme = struct.unpack_from("<9I", data, 12)
    assert (form, size, depth, layers, faces, levels, scheme) == (97, 2, 0, 0, 1, 1, 0)
    descriptor, descriptor_size, words, words_size = struct.unpack_from("<4I", data, 48)
    assert struct.unpack_from("<I", data,
                              descriptor)[0] == descriptor_size == 92 and words == descriptor + descriptor_size
    assert b"KTXorientation\0rd\0" in data[words:words + words_size]
    at, length, plain = struct.unpack_from("<3Q", data, 80)
    assert at % 8 == 0 and length == plain == 8 * width * height == len(data) - at
    texels = np.frombuffer(data, "<f2", 4 * width * height, at).reshape(height, width, 4)
    assert (texels[..., 3] == 1).all()
    return texels[..., :3].astype(np.float64)


def decode(path, link):
    """A page as linear irradiance, as export.h and page_format.h say."""
    if link["encoding"] == "exr":
        return exr.rgb(path).astype(np.float64)
    if link["encoding"] == "ktx2":
        return read_ktx2(path)
    texels = read_png(path) / 255.0
    if link["encoding"] == "rgbm":
        return texels[..., :3] * texels[..., 3:] * link["range"]
    assert link["encoding"] == "rgbe"
    return texels[..., :3] * np.exp2(np.rint(texels[..., 3:] * 255) - 128)


def formats(folder, there):
    """Each decodes to the lightmap within what its bits hold."""
    for form in ("exr", "exr-half", "rgbm", "rgbe", "ktx2"):
        out = os.path.join(folder, "as-" + form, "scene.glb")
        kiln("export", there, "-o", out, "--format", form, "--quiet")
        file = gltf_file.File(out)
        assert exported.check_against_bake(file, exported.SceneFile(os.path.join(there, "scene.kscene"))) == 8
        for page, node in enumerate(file.json["nodes"][:8]):
            link = node["extensions"]["KILN_lightmap"]
            name = os.path.splitext(os.path.basename(link["file"]))[0]
            wanted = exr.rgb(os.path.join(there, "lightmaps", name + ".exr")).astype(np.float64)
            found = decode(os.path.join(os.path.dirname(out), link["file"]), link)
            most = wanted.max(-1, keepdims=True)
            bound = {"exr": 0 * most, "exr-half": 2.0 ** -11 * wanted + 2.0 ** -25,
                     "ktx2": 2.0 ** -11 * wanted + 2.0 ** -25, "rgbe": most / 255 * 1.001 + 1e-38,
                     "rgbm": (most + wanted.max() / 255) / 255 * 0.501}[form]
            assert found.shape == wanted.shape and (abs(found - wanted) <= bound).all(), (
                form, name, (abs(found - wanted) - bound).max())
    assert "--range" in kiln("export", there, "-o", os.path.join(folder, "x", "s.glb"), "--format", "rgbm", "--range",
                             "1e-9", code=65).stderr


def atlas(folder, there):
    """Pages hold the lightmaps' own texels wherever a bilinear filter reads, also of a mesh that several objects
    share."""
    zoo = bake(os.path.join(DATA, "punctual_zoo.glb"), os.path.join(folder, "shared"), "--lightmap-size", "12")
    bare = os.path.join(folder, "two_rooms_bare")
    for bake_folder, side, least in ((there, 40, 0.7), (zoo, 30, 0.6), (bare, 48, 0.7)):
        out = os.path.join(folder, "atlas-" + os.path.basename(bake_folder), "scene.glb")
        told = json.loads(kiln("export", bake_folder, "-o", out, "--atlas", side, "--json").stdout)
        used, points = exported.check_atlas(bake_folder, out, 500)
        print("%-16s %d pages of %d, %.1f %% used" % (os.path.basename(bake_folder), told["pages"], side, 100 * used))
        assert abs(used - told["used"]) < 1e-9 and used >= least and points > 0
        pages = gltf_file.File(out).json["extensions"]["KILN_lightmap"]["pages"]
        assert told["pages"] == len(pages) and all(max(page["width"], page["height"]) <= side for page in pages)
    assert "larger --atlas" in kiln("export", there, "-o", out, "--atlas", "16", code=65).stderr


def backs(folder):
    """Backs with lightmaps: a link to them for the same coordinates, on a page of an atlas too."""
    s, scene = glb.Scene(), os.path.join(folder, "sheet.glb")
    sheet, lamp = s.material("sheet", (0.5, 0.5, 0.5), double_sided=True), s.material("lamp", radiance=(1, 2, 3))
    square = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]], np.float32)
    unit = [[0.1, 0.1], [0.1, 0.9], [0.9, 0.9], [0.9, 0.1]]
    s.mesh("sheet", square, unit, [[0, 1, 2], [0, 2, 3]], sheet)
    s.mesh("lamp", square - [0, 1, 0], unit, [[0, 1, 2], [0, 2, 3]], lamp)
    s.write(scene)
    there = bake(scene, os.path.join(folder, "sheet"), "--lightmap-size", "8", "--sides", "two")
    link = gltf_file.File(os.path.join(there, "scene.glb")).json["nodes"][0]["extensions"]["KILN_lightmap"]
    wanted = exr.rgb(os.path.join(there, link["back"]["file"]))
    assert wanted.max() > 0 and link["back"]["file"] == "lightmaps/back/sheet.exr"
    for options in ((), ("--atlas", "32"), ("--format", "rgbm")):
        out = os.path.join(folder, "sheet-out" + "".join(options), "scene.glb")
        kiln("export", there, "-o", out, "--quiet", *options)
        file = gltf_file.File(out)
        link = file.json["nodes"][0]["extensions"]["KILN_lightmap"]
        assert "back" not in file.json["nodes"][1]["extensions"]["KILN_lightmap"]
        found = decode(os.path.join(os.path.dirname(out), link["back"]["file"]), {**link, **link["back"]})
        primitive = file.json["meshes"][0]["primitives"][0]
        uv = file.floats(primitive["attributes"]["TEXCOORD_1"])[file.corners(primitive)].mean(1) * link["scale"] + link[
            "offset"]
        centre = np.array([[unit[k] for k in triangle] for triangle in ((0, 1, 2), (0, 2, 3))], np.float32).mean(1)
        error = abs(exported.bilinear(found, uv)[0] - exported.bilinear(wanted, centre)[0]).max()
        assert error <= wanted.max() * (0.01 if options == ("--format", "rgbm") else 1e-4), (options, error)


def lights(folder):
    scene = os.path.join(DATA, "punctual_zoo.glb")
    there = bake(scene, os.path.join(folder, "zoo"), "--lightmap-size", "8")
    source = gltf_file.File(scene).json
    lit = [i for i, n in enumerate(source["nodes"]) if "KHR_lights_punctual" in n.get("extensions", {})]
    nodes = gltf_file.File(os.path.join(there, "scene.glb")).json["nodes"]
    assert lit and all(nodes[i]["extras"]["kiln_baked"] is True for i in lit)
    assert not any(n.get("extras", {}).get("kiln_baked") for i, n in enumerate(nodes) if i not in lit)
    out = os.path.join(folder, "dark", "scene.glb")
    kiln("export", there, "-o", out, "--drop-baked-lights", "--quiet")
    dark = gltf_file.File(out).json
    assert len(dark["nodes"]) == len(nodes) and "KHR_lights_punctual" not in json.dumps(
        [dark["nodes"], dark["extensions"], dark["extensionsUsed"]])


def refusals(folder):
    scene, out = os.path.join(folder, "moves.glb"), os.path.join(folder, "refused", "scene.glb")
    shutil.copy(os.path.join(DATA, "two_rooms.glb"), scene)
    there = bake(scene, os.path.join(folder, "moves"), "--lightmap-size", "8")
    nothing = os.path.join(folder, "nothing")
    os.makedirs(nothing)
    assert "bake" in kiln("export", nothing, "-o", out, code=66).stderr
    assert "own files" in kiln("export", there, "-o", os.path.join(there, "scene.glb"), code=64).stderr
    assert ".glb" in kiln("export", there, "-o", os.path.join(folder, "scene.fbx"), code=64).stderr
    os.rename(scene, scene + ".moved.glb")
    assert "--scene" in kiln("export", there, "-o", out, code=66).stderr
    assert "not from this file" in kiln("export", there, "-o", out, "--scene", scene + ".moved.glb", code=65).stderr
    itself = os.path.join(folder, "itself")
    os.makedirs(itself)
    shutil.copy(os.path.join(DATA, "two_rooms.glb"), os.path.join(itself, "scene.glb"))
    bake(os.path.join(itself, "scene.glb"), itself, "--lightmap-size", "8")
    with open(os.path.join(itself, "scene.glb"), "rb") as a, open(os.path.join(DATA, "two_rooms.glb"), "rb") as b:
        assert a.read() == b.read(), "the bake has written over its scene"
    other = os.path.join(folder, "elsewhere")
    os.makedirs(other)
    os.rename(scene + ".moved.glb", os.path.join(other, "moves.glb"))
    kiln("export", there, "-o", out, "--scene", os.path.join(other, "moves.glb"), "--quiet")
    with open(os.path.join(other, "moves.glb"), "r+b") as file:
        file.seek(-5, 2)
        last = file.read(1)
        file.seek(-5, 2)
        file.write(bytes([last[0] ^ 1]))
    os.remove(out)
    assert "has changed since it was baked" in kiln("export", there, "-o", out, "--scene",
                                                    os.path.join(other, "moves.glb"), code=65).stderr
    assert not os.path.exists(out) and not [n for n in os.listdir(os.path.dirname(out)) if n.startswith(".")]


def main():
    with tempfile.TemporaryDirectory() as folder:
        there = own_layout(folder)
        unwrapped(folder)
        hard(folder)
        gloss(folder)
        other_formats(folder)
        formats(folder, there)
        atlas(folder, there)
        backs(folder)
        lights(folder)
        refusals(folder)


if __name__ == "__main__":
    main()
