"""Nothing outside the scene's folder is opened, and nothing that is no regular file, whatever a scene names."""
import os

import importing
import png

GREY = png.encoded([[(128, 128, 128)]])


def textured(uri):
    return importing.quad(images=[{"uri": uri}], textures=[{"source": 0}],
                          materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0}}])


class Contained(importing.Case):
    def setUp(self):
        self.outside = self.folder()
        self.inside = os.path.join(self.outside, "scene")
        os.mkdir(self.inside)
        importing.write(self.outside, "secret.png", GREY)
        importing.write(self.outside, "secret.bin", importing.QUAD)

    def scene(self, uri, name="scene.gltf"):
        return importing.write(self.inside, name, textured(uri))

    def test_what_lies_in_the_folder_is_read(self):
        os.mkdir(os.path.join(self.inside, "deep"))
        importing.write(self.inside, "deep/a b.png", GREY)
        os.symlink("deep/a b.png", os.path.join(self.inside, "link.png"))
        for uri in ("deep/a%20b.png", "./deep/a%20b.png", "link.png"):
            with self.subTest(uri):
                self.assertEqual(self.accepted(self.scene(uri))["counts"]["textures"], 1)

    def test_ways_out_are_refused(self):
        os.symlink("../secret.png", os.path.join(self.inside, "link.png"))
        os.symlink(os.path.join(self.outside, "secret.png"), os.path.join(self.inside, "absolute.png"))
        os.symlink("..", os.path.join(self.inside, "up"))
        os.symlink("/proc/self/fd/0", os.path.join(self.inside, "magic.png"))
        os.symlink("round.png", os.path.join(self.inside, "round.png"))
        for uri in ("../secret.png", "%2e%2e/secret.png", "a/../../secret.png", "link.png", "absolute.png",
                    "up/secret.png", "magic.png", "round.png",
                    os.path.join(self.outside, "secret.png"), "file:///etc/passwd", "http://127.0.0.1:9/x.png",
                    "//127.0.0.1/x.png",
                    "/proc/self/environ", "..\\secret.png", "\\\\host\\share"):
            with self.subTest(uri):
                self.refused(self.scene(uri), ["images[0].uri"], seconds=importing.QUICK)

    def test_a_buffer_has_the_same_fence(self):
        os.symlink("../secret.bin", os.path.join(self.inside, "link.bin"))
        for uri in ("../secret.bin", "link.bin"):
            scene = importing.quad(buffers=[{"byteLength": len(importing.QUAD), "uri": uri}])
            self.refused(importing.write(self.inside, "scene.gltf", scene), ["buffers[0].uri"], seconds=importing.QUICK)

    def test_only_regular_files(self):
        os.mkfifo(os.path.join(self.inside, "pipe.png"))
        os.mkdir(os.path.join(self.inside, "folder.png"))
        for uri in ("pipe.png", "folder.png", ".", "/dev/zero", "/dev/stdin"):
            with self.subTest(uri):
                self.refused(self.scene(uri), seconds=importing.QUICK)
        if os.getuid() == 0:
            try:
                os.mknod(os.path.join(self.inside, "zero.png"), 0o666 | 0o020000, os.makedev(1, 5))
            except OSError:
                return  # a container without devices
            self.refused(self.scene("zero.png"), ["images[0].uri"], seconds=importing.QUICK)

    def test_the_scene_itself_is_a_regular_file(self):
        os.mkfifo(os.path.join(self.inside, "pipe.glb"))
        for name in ("pipe.glb", "."):
            answer = importing.kiln("info", os.path.join(self.inside, name))
            self.assertEqual(answer.code, 65, answer.err)
            self.assertLess(answer.seconds, importing.QUICK)
        self.assertEqual(importing.kiln("info", os.path.join(self.inside, "missing.glb")).code, 66)
        self.assertEqual(importing.kiln("info", "/dev/zero").code, 65)

    def test_long_names(self):
        for length in (1025, 100000):
            with self.subTest(length):
                self.refused(self.scene("a" * length), ["images[0].uri"], seconds=importing.QUICK)
        for name in ("a" * 250, "a" * 300, "a" * 1024, "/".join(["a"] * 400)):  # no such picture
            report = self.accepted(self.scene(name), "--lightmap-size", 4)
            self.assertIn("is missing", report["notes"][0]["text"])
            self.refused_strictly(name)

    def refused_strictly(self, uri):
        answer = importing.kiln("info", self.scene(uri), "--strict")
        self.assertEqual(answer.code, 65, answer.err)
        self.assertIn(uri[:80], answer.sentence())

    def test_odd_bytes_in_names(self):
        for uri in ("a%00b.png", "a%zz.png", "a%2", "%", ""):
            with self.subTest(uri):
                self.refused(self.scene(uri), ["images[0].uri"], seconds=importing.QUICK)

    def test_a_link_the_user_names_himself(self):
        """The folder is that of the real file, so its neighbours are found and the link's are not."""
        importing.write(self.inside, "near.png", GREY)
        path = os.path.join(self.outside, "link.gltf")
        os.symlink(self.scene("near.png"), path)
        self.assertEqual(self.accepted(path)["counts"]["textures"], 1)

    def test_material_files_of_an_obj(self):
        importing.write(self.outside, "secret.mtl", b"newmtl a\nKd 1 0 0\n")
        os.symlink("../secret.mtl", os.path.join(self.inside, "link.mtl"))
        importing.write(self.inside, "up.mtl", b"newmtl a\nmap_Kd ../secret.png\n")
        text = "mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n"
        scene = lambda library: importing.write(self.inside, "scene.obj", text.format(library).encode())
        for library in ("../secret.mtl", "link.mtl", os.path.join(self.outside, "secret.mtl")):
            with self.subTest(library):
                self.refused(scene(library), seconds=importing.QUICK)
        report = self.accepted(scene("up.mtl"))  # outside counts as missing
        self.assertEqual(report["counts"]["textures"], 0)
        self.assertIn("'../secret.png' is missing in the scene's folder", report["notes"][0]["text"])
        os.symlink("../secret.png", os.path.join(self.inside, "link.png"))
        importing.write(self.inside, "up.mtl", b"newmtl a\nmap_Kd link.png\n")
        self.refused(scene("up.mtl"), ["leads out"], seconds=importing.QUICK)


if __name__ == "__main__":
    importing.main()
