"""Pictures: how much memory they may take, where they are found, and what becomes of a scene without them."""
import json
import os

import importing
from test_killers import bomb_png, data_uri, flat_jpeg, textured

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 0 -1\nv 0 0 -1\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"


class Sizes(importing.Case):
    """What an image may take follows from memory, not from how well it is compressed."""

    def info(self, scene, **limits):
        return importing.info(importing.write(self.folder(), "scene.gltf", scene), "--lightmap-size", "4", **limits)

    def test_a_large_dark_picture(self):
        scene = textured([{"uri": data_uri(flat_jpeg(8192, 8192))}])
        answer = self.info(scene)
        self.assertEqual(answer.code, 0, answer.err)
        short = self.info(scene, space=1 << 30)
        if not importing.SANITIZED:
            self.assertEqual(short.code, 65, short.err)
            self.assertIn("images[0], 8192 x 8192 pixels", short.sentence())
            self.assertIn("memory", short.sentence())

    def test_plain_pictures(self):
        """Four of about 4096 x 4096 and one colour each."""
        pictures = [bomb_png(4096 - i) for i in range(4)]
        answer = self.info(textured([{"uri": data_uri(p)} for p in pictures]))
        self.assertEqual(answer.code, 0, answer.err)
        self.assertEqual([t["width"] for t in answer.json()["textures"]], [4096, 4095, 4094, 4093])

    def test_too_many(self):
        """Refused by their headers, before any is decoded."""
        whole = bomb_png(8000)
        pictures = [whole[:-i] + b"?" + whole[-i + 1:] for i in range(50, 61)]  # broken, which nobody gets to see
        answer = self.info(textured([{"uri": data_uri(p)} for p in pictures]))
        self.assertEqual(answer.code, 65, answer.err)
        self.assertIn("million pixels", answer.sentence())
        self.assertLess(answer.memory, importing.MEMORY)
        self.assertLess(answer.seconds, importing.QUICK)


class Places(importing.Case):
    def setUp(self):
        self.place = self.folder()

    def write(self, name, data=None):
        os.makedirs(os.path.dirname(os.path.join(self.place, name)), exist_ok=True)
        return importing.write(self.place, name, data or bomb_png(2))

    def obj(self, path, mtl="scene.mtl", library=None):
        self.write(mtl, f"newmtl a\nKd 1 1 1\nmap_Kd {path}\n".encode())
        return self.write("scene.obj", f"mtllib {library or mtl}\nusemtl a\n{SQUARE}".encode())

    def notes(self, path, *options):
        answer = importing.info(path, "--lightmap-size", 4, *options)
        self.assertEqual(answer.code, 0, answer.err)
        return "\n".join(n["text"] for n in answer.json()["notes"])

    def test_paths_of_another_computer(self):
        self.write("Wood.PNG")
        self.write("textures/Brick.png")
        for name, found in (("C:\\work\\wood.png", "Wood.PNG"), ("/x/y/wood.png", "Wood.PNG"),
                            ("WOOD.png", "Wood.PNG"),
                            ("..\\..\\Wood.PNG", "Wood.PNG"), ("D:\\p\\Textures\\brick.PNG", "textures/Brick.png"),
                            ("TEXTURES/brick.png", "textures/Brick.png"), ("file:///x/y/wood.png", "Wood.PNG")):
            with self.subTest(name):
                notes = self.notes(self.obj(name))
                self.assertIn(f"'{name}' is not in the scene's folder; '{found}', which is, is used", notes)
                self.assertNotIn("missing", notes)
        for name in ("textures\\Brick.png", "./Wood.PNG", "textures/Brick.png"):
            with self.subTest(name):
                self.assertNotIn("is used", self.notes(self.obj(name)))

    def test_beside_the_material_file(self):
        self.write("sub/near.png")
        notes = self.notes(self.obj("X:\\NEAR.png", mtl="sub/s.mtl"))
        self.assertIn("'sub/near.png', which is, is used", notes)
        notes = self.notes(self.obj("near.png", mtl="sub/s.mtl", library="SUB\\S.mtl"))
        self.assertIn("'sub/s.mtl', which is, is used", notes)
        self.assertNotIn("near.png", notes)

    def test_gltf_too(self):
        """Names whose case is another one, backslashes; a way out stays one."""
        self.write("Textures/A.png")
        path = self.write("scene.gltf", json.dumps(textured([{"uri": "textures/a.PNG"}])).encode())
        self.assertIn("'Textures/A.png', which is, is used", self.notes(path))
        self.write("scene.gltf", json.dumps(textured([{"uri": "textures%5Ca.png"}])).encode())
        self.assertIn("'Textures/A.png', which is, is used", self.notes(path))
        self.write("DATA.bin", importing.QUAD)
        scene = importing.quad(buffers=[{"byteLength": len(importing.QUAD), "uri": "data.BIN"}])
        self.assertIn("'DATA.bin', which is, is used",
                      self.notes(self.write("scene.gltf", json.dumps(scene).encode())))
        self.write("scene.gltf", json.dumps(textured([{"uri": "../A.png"}])).encode())
        self.refused(path, ["leads out"])

    def test_a_link_that_leads_out_stays_one(self):
        outside = self.folder()
        importing.write(outside, "secret.png", bomb_png(2))
        os.symlink(os.path.join(outside, "secret.png"), os.path.join(self.place, "LINK.png"))
        os.symlink(outside, os.path.join(self.place, "away"))
        self.refused(self.obj("link.png"), ["leads out"])
        self.assertIn("missing", self.notes(self.obj("AWAY/secret.png")))

    def test_stand_ins(self):
        """White for colours, no emission, no metal; each picture is named once, and bakes say what shows."""
        texture = [{"source": i} for i in range(4)]
        materials = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [0.5, 0.5, 0.5, 1],
                                               "metallicRoughnessTexture": {"index": 1}},
                      "emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 2}}] * 2
        scene = importing.quad(images=[{"uri": f"{n}.png"} for n in ("base", "metal", "glow", "unused")],
                               textures=texture, materials=materials)
        scene["meshes"][0]["primitives"][0]["material"] = 0
        path = self.write("scene.gltf", json.dumps(scene).encode())
        (first, _) = self.accepted(path)["materials"]
        self.assertEqual((first["base_color"], first["metallic"], first["emission"]),
                         ([0.5, 0.5, 0.5, 1.0], 0.0, [0.0, 0.0, 0.0]))
        notes = self.notes(path)
        for name in ("base", "metal", "glow", "unused"):
            self.assertEqual(notes.count(f"'{name}.png'"), 1, notes)
        out = os.path.join(self.folder(), "out")
        baked = importing.kiln("bake", path, "-o", out, "--lightmap-size", 4, "--samples-probe", 0, "--no-preview",
                               "--environment", "1,1,1")
        self.assertEqual(baked.code, 0, baked.err)
        self.assertIn("'base.png' is missing", baked.err)
        strict = importing.kiln("bake", path, "-o", out, "--strict", "--lightmap-size", 4)
        self.assertEqual(strict.code, 65, strict.err)
        for name in ("base", "metal", "glow", "unused"):
            self.assertIn(f"'{name}.png'", strict.sentence())

    def test_a_picture_that_comes_later(self):
        """The scene of a bake is read again once a missing picture is there."""
        path = self.obj("late.png")
        out = os.path.join(self.folder(), "out")
        bake = lambda: importing.kiln("bake", path, "-o", out, "--lightmap-size", 4, "--samples-probe", 0,
                                      "--no-preview", "--no-resume")
        self.assertIn("'late.png' is missing", bake().err)
        self.write("late.png")
        again = bake()
        self.assertEqual(again.code, 0, again.err)
        self.assertNotIn("missing", again.err)

    def test_statements_that_nobody_reads(self):
        self.write("scene.mtl", b"newmtl a\nKa 0 0 0\nmap_Bump -bm 1 absent.png\nnorm absent.png\n"
                                b"refl -type sphere r.png\n")
        notes = self.notes(self.write("scene.obj", f"mtllib scene.mtl\nusemtl a\n{SQUARE}".encode()))
        self.assertIn("1 Ka; 1 map_Bump; 1 norm; 1 refl", notes)
        self.assertIn("material 'a': map_Bump: the picture 'absent.png' is missing", notes)
        self.assertIn("material 'a': refl: the picture 'r.png' is missing", notes)

    def test_many_names(self):
        """Looking for what is not there costs little, however many names and steps there are."""
        lines = "".join(f"newmtl m{i}\nmap_Kd {'a/' * 200}{i}.png\n" for i in range(3000))
        self.write("scene.mtl", lines.encode())
        answer = importing.info(self.write("scene.obj", f"mtllib scene.mtl\nusemtl m0\n{SQUARE}".encode()))
        self.assertEqual(answer.code, 0, answer.err)
        self.assertLess(answer.seconds, importing.SECONDS)
        self.assertIn("2744 more pictures are missing", answer.out)


if __name__ == "__main__":
    importing.main()
