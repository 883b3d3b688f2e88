"""OBJ and MTL files: what comes out of each statement, what is refused, and what is large."""
import os
import struct

import importing
import png

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def picture(width, height, rgb=(255, 0, 0)):
    """The last column has another colour: an image of one becomes a factor of its material."""
    return png.encoded([[rgb] * (width - 1) + [rgb[::-1]]] * height)


def tga(width, height):
    return struct.pack("<BBBHHBHHHHBB", 0, 0, 2, 0, 0, 0, 0, 0, width, height, 24,
                       0) + b"\x10\x20\x30" * (width * height)


class Obj(importing.Case):
    def setUp(self):
        self.place = self.folder()

    def scene(self, text, mtl=None, name="scene.obj"):
        if mtl is not None:
            importing.write(self.place, "m.mtl", mtl if isinstance(mtl, bytes) else mtl.encode())
        return importing.write(self.place, name, text if isinstance(text, bytes) else text.encode())

    def read(self, text, mtl=None):
        return self.accepted(self.scene(text, mtl), "--lightmap-size", "16")

    def names(self, report):
        return [o["original_name"] for o in report["objects"]]

    def notes(self, report):
        return " / ".join(n["text"] for n in report["notes"])

    def material(self, report, name):
        return next(m for m in report["materials"] if m["name"] == name)

    def test_forms_of_a_face(self):
        for face in ("f 1 2 3 4", "f -4 -3 -2 -1", "f 1/1 2/1 3/1 4/1", "f 1//1 2//1 3//1 4//1",
                     "f 1/1/1 2/-1/-1 3/1/1 4/1/1", "f 1/ 2/ 3/ 4/",
                     "f 1 2 3\r\nf 1 3 4\r\n", "f 1 2 \\\n 3 4", "\tf  1\t2 3 4  # all of it",
                     "f 1 2 3\n\n\nf 1 3 4\n# end"):
            with self.subTest(face):
                report = self.read(SQUARE + "vt 0 0\nvn 0 0 1\n" + face)
                self.assertEqual((report["counts"]["triangles"], report["counts"]["vertices"]), (2, 4))
                self.assertAlmostEqual(report["surface"]["area"], 1.0, places=6)

    def test_vertices(self):
        report = self.read("v 0 0 0 2\nv 2 0 0 2\nv 0 3 0 0.5\nf 1 2 3\n")
        self.assertEqual(report["bounds"]["max"], [1.0, 6.0, 0.0])
        equal = self.read("v 0 0 0\nv 1 0 0\nv 0 1 0\nv -0 0 0\nv 1 0 0\nv 0 -1 0\nf 1 2 3\nf 4 6 5\n")
        self.assertEqual(equal["counts"]["vertices"], 4, "equal places are one vertex")
        near = self.read("v 0 0 0\nv 1e-6 0 0\nv 0 1e-6 0\nf 1 2 3\n")
        self.assertEqual(near["counts"]["triangles"], 1, "a scene of a micrometre is not welded together")

    def test_polygons(self):
        concave = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 3 1 0\nv 1 1 0\nv 0 4 0\nf 1 2 3 4 5 6\n"
        report = self.read(concave)
        self.assertEqual(report["counts"]["triangles"], 4)
        self.assertAlmostEqual(report["surface"]["area"], 7.0, places=5)  # a fan would have more
        self.assertAlmostEqual(self.read("v 0 0 0\nv 2 -1 0\nv 0.5 0 0\nv 2 1 0\nf 1 2 3 4\n")["surface"]["area"], 0.5,
                               places=5)

    def test_objects_and_groups(self):
        f = "f 1 2 3\n"
        for text, names in (("f 1 2 3\n", ["defaultobject"]), ("o a b \nf 1 2 3\n", ["a b"]), ("o a\ng b\n" + f, ["b"]),
                            ("g a\n" + f + "g a\n" + f, ["a"]),
                            ("g a\n" + f + "g b\n" + f + "g a\n" + f, ["a", "b", "a"]),
                            ("o a\n" + f + "o b\n" + f + "o a\n" + f, ["a", "b"]),
                            ("o empty\no full\n" + f, ["full"]), (f + "o a\n" + f, ["defaultobject", "a"])):
            with self.subTest(text):
                self.assertEqual(self.names(self.read(SQUARE + text)), names)
        self.assertEqual(
            len({o["name"] for o in self.read(SQUARE + "g a\n" + f + "g b\n" + f + "g a\n" + f)["objects"]}), 3)

    def test_materials(self):
        mtl = ("# two\nnewmtl red one\nKd 0.5 0.25 0.125\nKe 1 2 3\nNs 3\nillum 2\n\tnewmtl half\r\nKd 0.4\r\nd "
               "0.5\r\nPr 0.3\nPm 1\nnewmtl tr\nTr 0.25\n"
               "newmtl halo\nd -halo 0.75\nnewmtl none\n")
        text = "mtllib m.mtl\n" + SQUARE + "usemtl red one\nf 1 2 3\nusemtl nowhere\nf 1 3 4\n"
        report = self.read(text, mtl)
        self.assertEqual([m["name"] for m in report["materials"]],
                         ["DefaultMaterial", "red one", "half", "tr", "halo", "none", "nowhere"])
        red, half = self.material(report, "red one"), self.material(report, "half")
        self.assertEqual((red["base_color"], red["emission"], red["alpha"]),
                         ([0.5, 0.25, 0.125, 1.0], [1.0, 2.0, 3.0], "opaque"))
        self.assertEqual([round(v, 6) for v in half["base_color"]], [0.4, 0.4, 0.4, 0.5])
        self.assertEqual(half["alpha"], "blend")
        self.assertEqual(self.material(report, "tr")["base_color"][3], 0.75)
        self.assertEqual(self.material(report, "halo")["base_color"][3], 0.75)
        self.assertAlmostEqual(self.material(report, "none")["base_color"][0], 0.6, places=6)
        self.assertIn("'nowhere'", self.notes(report))
        self.assertIn("2 statements Pr, Pm", self.notes(report))
        self.assertEqual(report["counts"]["triangles_emissive"], 1)

    def test_material_files(self):
        importing.write(self.place, "two words.mtl", b"newmtl a\nKd 0.1 0.1 0.1\n")
        importing.write(self.place, "b.mtl", b"newmtl b\nKd 0.2 0.2 0.2\n")
        importing.write(self.place, "c.mtl", b"\xef\xbb\xbfnewmtl c\nKd 0.3 0.3 0.3\n")
        importing.write(self.place, "d.mtl", b"\xff\xfe" + "newmtl d\nKd 0.4 0.4 0.4\n".encode("utf-16-le"))
        report = self.read("mtllib two words.mtl\nmtllib b.mtl c.mtl\nmtllib ./d.mtl\n" + SQUARE + "f 1 2 3\n")
        self.assertEqual([m["name"] for m in report["materials"]], ["DefaultMaterial", "a", "b", "c", "d"])

    def test_maps(self):
        importing.write(self.place, "a b.png", picture(4, 2))
        importing.write(self.place, "t.tga", tga(3, 5))
        os.mkdir(os.path.join(self.place, "sub"))
        importing.write(os.path.join(self.place, "sub"), "c.png", picture(2, 2))
        importing.write(os.path.join(self.place, "sub"), "s.mtl", b"newmtl s\nmap_Kd c.png\n")
        mtl = ("newmtl a\nmap_Kd -s 2 2 2 -o 0.5 0 -clamp on -mm 0 1 -bm 1 a b.png\nmap_Ke a b.png\nnewmtl b\nmap_kd "
               ".\\a b.png\nmap_d a b.png\n"
               "newmtl c\nmap_Kd t.tga\nKe 0 0 0\nmap_Ka nowhere.png\nbump nowhere.png\n")
        report = self.read("mtllib m.mtl\nmtllib sub/s.mtl\n" + SQUARE +
                           "vt 0 0\nvt 1 1\nusemtl a\nf 1/1 2/2 3/1\nusemtl b\nf 1/1 3/2 4/1\n", mtl)
        self.assertEqual([(t["width"], t["height"]) for t in report["textures"]],
                         [(4, 2), (4, 2), (4, 2), (3, 5), (2, 2)])
        self.assertEqual(self.material(report, "a")["emission"], [1.0, 1.0, 1.0])
        self.assertTrue(self.material(report, "s")["base_color_texture"])
        self.assertIn("opacity map", self.notes(report))

    def test_what_is_left_out_is_said(self):
        report = self.read(SQUARE + "s 1\ncstype bezier\ncurv 0 1 1 2\nend\nl 1 2\np 1\nfoo bar\nf 1 2 3\n")
        for words in ("3 statements of free-form", "2 points or lines", "'foo' in line 11"):
            self.assertIn(words, self.notes(report))

    def test_refusals(self):
        face = "f 1 2 3\n"
        for text, mtl, words in ((SQUARE + "f 1 2 x", None, ["line 5", "x"]),
                                 (SQUARE + "f 1 2 3/1", None, ["line 5", "vt 1 of 0"]),
                                 (SQUARE + "f 1 2 -5", None, ["line 5", "-5 of 4"]),
                                 (SQUARE + "f 1 2 99999999999999999999999", None, ["line 5"]),
                                 (SQUARE + "f 1/2/3/4 1 1", None, ["line 5"]), (SQUARE + "f / 1 2", None, ["line 5"]),
                                 ("v 1 2\n", None, ["line 1", "2 of 3"]),
                                 ("v 1 2 3 4 5\n", None, ["line 1"]), ("v 1 2 3 0\n", None, ["line 1", "w"]),
                                 ("v 1 2 nan\n", None, ["line 1", "nan"]),
                                 ("vt\n", None, ["line 1"]), ("vn 0 1\n", None, ["line 1"]), ("", None, ["no face"]),
                                 (SQUARE + "l 1 2\n", None, ["no face"]),
                                 ("mtllib\n" + face, None, ["mtllib"]),
                                 ("mtllib none.mtl\n" + SQUARE + face, None, ["none.mtl", "missing"]),
                                 ("mtllib m.mtl", "map_Kd x.png\n", ["m.mtl", "line 1", "before any newmtl"]),
                                 ("mtllib m.mtl", "newmtl a\nKd 2 0 0\n", ["line 2", "outside"]),
                                 ("mtllib m.mtl", "newmtl a\nKd spectral x.rfl 1\n", ["line 2", "spectral"]),
                                 ("mtllib m.mtl", "newmtl a\nd x\n", ["line 2"]),
                                 ("mtllib m.mtl", "newmtl a\nKe -1 0 0\n", ["line 2", "outside"]),
                                 ("mtllib m.mtl", "newmtl a\nmap_Kd -clamp on\n", ["m.mtl", "line 2", "map"]),
                                 ("mtllib m.mtl\n" + SQUARE + face, "newmtl a\nmap_Kd m.mtl\n", ["map_Kd", "neither"])):
            with self.subTest(text=text, mtl=mtl):
                self.refused(self.scene(text, mtl), words, seconds=importing.QUICK)
        self.refused(self.scene(SQUARE + face, name="scene.ply"), ["files of this name"])

    def test_map_coordinates(self):
        """Doubles are read, and each object is stored about its own centre: nothing of a far one is bent."""
        for far in (4500000.1234, -123456789.0625, 1e9 + 0.25):
            corners = ((0, 0), (1.25, 0), (1.25, 0.5), (0, 0.5))
            text = "".join(f"v {far + x!r} 30 {2 * far + z!r}\n" for x, z in corners)
            report = self.accepted(self.scene(text + "f 4 3 2 1\no b\nf 1 2 3\nf 1 3 4\n"), "--lightmap-size", 4)
            for found, right in zip(report["bounds"]["min"] + report["bounds"]["max"],
                                    (far, 30, 2 * far, far + 1.25, 30, 2 * far + 0.5)):
                self.assertAlmostEqual(found, right, delta=1e-6 + 4e-16 * abs(right))
            for o in report["objects"]:
                self.assertAlmostEqual(o["area"], 0.625, delta=1e-6)

    def test_up_and_unit(self):
        """A box of 1 x 2 x 3 units: z up turns it upright, and a unit scales it, its texels too."""
        text = "v 0 0 0\nv 1 0 0\nv 1 2 3\nv 0 2 3\nvn 0 -3 2\nf 1//1 2//1 3//1 4//1\n"
        for options, low, high in (((), (0, 0, 0), (1, 2, 3)), (("--up", "z"), (0, 0, -2), (1, 3, 0)),
                                   (("--unit", "cm"), (0, 0, 0), (0.01, 0.02, 0.03)),
                                   (("--unit", "2.5", "--up", "y"), (0, 0, 0), (2.5, 5, 7.5)),
                                   (("--unit", "ft", "--up", "z"), (0, 0, -0.6096), (0.3048, 0.9144, 0))):
            with self.subTest(options=options):
                report = self.accepted(self.scene(text), "--lightmap-size", 4, *options)
                for found, right in zip(report["bounds"]["min"] + report["bounds"]["max"], low + high):
                    self.assertAlmostEqual(found, right, places=6)
                self.assertFalse(report["objects"][0]["mirrored"])
                self.assertNotIn("point to the back", self.notes(report))
        fine = self.accepted(self.scene(text), "--unit", "mm", "--texels-per-metre", 4000)
        self.assertAlmostEqual(fine["objects"][0]["area"], 13 ** 0.5 * 1e-6, delta=1e-10)
        self.assertGreater(fine["objects"][0]["lightmap"][0], 3)

    def test_pictures_of_hostile_kinds(self):
        """What stb_image would take besides: none of it gets there."""
        hostile = {"loop.hdr": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 8\n\2\2\0\x08",
                   "a.gif": b"GIF89a" + b"\x10" * 40, "a.psd": b"8BPS\0\1" + b"\0" * 40,
                   "a.bmp": b"BM" + struct.pack("<IIIIiiHHI", 60, 0, 54, 40, 5000, 5000, 1, 24, 0) + b"\0" * 20,
                   "a.tga": struct.pack("<BBBHHBHHHHBB", 0, 0, 10, 0, 0, 0, 0, 0, 5000, 5000, 24, 0) + b"\xff\1\2\3" *
                   4, "empty.png": b""}
        for name, data in hostile.items():
            importing.write(self.place, name, data)
            with self.subTest(name):
                answer = self.refused(self.scene("mtllib m.mtl\n" + SQUARE + "f 1 2 3\n", "newmtl a\nmap_Kd " + name),
                                      ["map_Kd"], seconds=importing.QUICK)
                self.assertLess(answer.memory, importing.MEMORY // 2)

    def test_hostile_file(self):
        path = os.path.join(importing.SHARED, "own", "hostile", "mtl_null", "s.obj")
        if not os.path.exists(path):
            self.skipTest("../shared/scenes/own/hostile is not here")
        self.refused(path, ["m.mtl", "line 1", "before any newmtl"])

    def test_many_of_everything(self):
        """Nothing takes time that grows with the square of the file."""
        square = SQUARE + "vt 0 0\n"
        many = 40000
        materials = "".join("newmtl m%d\nKd 0.5 0.5 0.5\n" % i for i in range(many))
        comb = "v 0 0 0\nv 1 0 0\n" + "".join("v %.9g %.9g 0\n" % (1 - i / 4998, 0.5 + i % 2) for i in range(4998))
        for name, text, mtl in (("materials", "mtllib m.mtl\n" + square + "f 1 2 3\n", materials),
                                ("uses", "mtllib m.mtl\n" + square +
                                 "".join("usemtl m%d\nf 1 2 3\n" % (i % 3) for i in range(many)), materials[:90]),
                                ("same picture", "mtllib m.mtl\n" + square + "f 1 2 3\n",
                                 "".join("newmtl m%d\nmap_Kd p.png\n" % i for i in range(many))),
                                ("unknown materials", square + "".join("usemtl %d\n" % i for i in range(many)) +
                                 "f 1 2 3\n", None),
                                ("empty objects", square + "".join("o %d\n" % i for i in range(many)) + "f 1 2 3\n",
                                 None),
                                ("one object again and again",
                                 square + "".join("o %d\n" % (i % 2) for i in range(many)) + "f 1 2 3\n", None),
                                ("comments", "#\n" * (10 * many) + square + "f 1 2 3\n", None),
                                ("continuations", square + "f 1 2 " + "\\\n" * many + "3\n", None)):
            with self.subTest(name):
                importing.write(self.place, "p.png", picture(64, 64))
                answer = importing.info(self.scene(text, mtl), "--lightmap-size", "16")
                self.assertEqual(answer.code, 0, answer.err)
                self.assertLess(answer.seconds, 6 * importing.QUICK)
                self.assertLess(answer.memory, importing.MEMORY)
        self.refused(self.scene(comb + "f " + " ".join(str(i + 1) for i in range(5000))), ["4096 corners"],
                     seconds=importing.QUICK)
        most = self.read("v 0 0 0\nv 1 0 0\n" +
                         "".join("v %.9g %.9g 0\n" % (1 - i / 4093, 0.5 + i % 2) for i in range(4094)) +
                         "f " + " ".join(str(i + 1) for i in range(4096)))
        self.assertAlmostEqual(most["surface"]["area"], 1.0, places=3)
        self.refused(self.scene("mtllib " + "m" * 100000), ["mtllib"], seconds=importing.QUICK)


if __name__ == "__main__":
    importing.main()
