"""Environment images: Radiance and OpenEXR (made here byte by byte), and what is none."""
import os
import struct

import importing


def hdr(width, height, pixel=(128, 64, 32, 129)):
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (height, width) + bytes(pixel) * (width * height)


def exr(width, height, channels="BGR", kind=2, value=1.5, claimed=None):
    """A scan-line OpenEXR file without compression; kind 1 is half, 2 float."""
    text = lambda s: s.encode() + b"\0"
    attribute = lambda name, type_, data: text(name) + text(type_) + struct.pack("<i", len(data)) + data
    window = struct.pack("<4i", 0, 0, (claimed or width) - 1, (claimed or height) - 1)
    head = b"\x76\x2f\x31\x01" + struct.pack("<I", 2)
    head += attribute("channels", "chlist", b"".join(text(c) + struct.pack("<iB3xii", kind, 0, 1, 1) for c in channels) + b"\0")
    head += attribute("compression", "compression", b"\0") + attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    head += attribute("lineOrder", "lineOrder", b"\0") + attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    head += attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)) + attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
    sample = struct.pack("<e" if kind == 1 else "<f", value)
    line = sample * (width * len(channels))
    first = len(head) + 8 * height
    table = b"".join(struct.pack("<Q", first + i * (8 + len(line))) for i in range(height))
    return head + table + b"".join(struct.pack("<ii", y, len(line)) + line for y in range(height))


class Environment(importing.Case):
    def setUp(self):
        self.place = self.folder()
        self.scene = importing.write(self.place, "scene.gltf", importing.quad())
        self.elsewhere = self.folder()  # an image that the user names may lie anywhere

    def image(self, name, data):
        return importing.write(self.elsewhere, name, data)

    def test_images(self):
        for name, data in {"a.hdr": hdr(8, 4), "b.exr": exr(8, 4), "c.exr": exr(8, 4, kind=1), "d.exr": exr(8, 4, channels="Y"),
                           "e.exr": exr(8, 4, channels="ABGR")}.items():
            with self.subTest(name):
                found = self.accepted(self.scene, "--environment", self.image(name, data))["environment"]
                self.assertEqual((found["kind"], found["width"], found["height"]), ("lat-long image", 8, 4))

    def test_negative_values_are_noted(self):
        report = self.accepted(self.scene, "--environment", self.image("n.exr", exr(2, 2, value=-1.0)))
        self.assertTrue(any("12 negative values" in n["text"] for n in report["notes"]), report["notes"])

    def test_what_is_no_environment(self):
        os.mkfifo(os.path.join(self.elsewhere, "pipe.hdr"))
        for name, data, word in (("f.exr", exr(2, 2, value=float("nan")), "not a number"), ("g.exr", exr(2, 2, value=float("inf")), "infinite"),
                                 ("h.exr", exr(4, 4)[:-20], "decoded"), ("i.exr", exr(4, 4)[:60], "OpenEXR"),
                                 ("j.exr", exr(1, 1, claimed=60000), "pixels"), ("k.exr", exr(4, 4, channels="RX"), "R, G, B"),
                                 ("l.hdr", hdr(8, 4)[:-3], "cut off"), ("m.hdr", b"\x89PNG\r\n\x1a\n", "neither"), ("n.hdr", b"", "neither"),
                                 ("o.hdr", hdr(8, 4).replace(b"-Y 4 +X 8", b"-Y 99999 +X 99999"), "environment")):
            with self.subTest(name):
                answer = importing.info(self.scene, "--environment", self.image(name, data))
                self.assertEqual(answer.code, 65, answer.err)
                self.assertIn(name, answer.err)
                self.assertIn(word, answer.err)
                self.assertLess(answer.memory, importing.MEMORY)
        answer = importing.info(self.scene, "--environment", os.path.join(self.elsewhere, "pipe.hdr"))
        self.assertEqual(answer.code, 65, answer.err)
        self.assertEqual(importing.info(self.scene, "--environment", "/nowhere/sky.hdr").code, 66)


if __name__ == "__main__":
    importing.main()
