"""Environment images: Radiance and OpenEXR (made here byte by byte), and what is none."""
import os
import struct
import zlib

import importing

SPACE = 1 << 30  # of addresses: what an image may claim and not get


def hdr_head(width, height, kind=b"rgbe"):
    return b"#?RADIANCE\nFORMAT=32-bit_rle_%s\n\n-Y %d +X %d\n" % (kind, height, width)


def hdr(width, height, pixel=(128, 64, 32, 129)):
    return hdr_head(width, height) + bytes(pixel) * (width * height)


def hdr_runs(width, height, pixel=(128, 64, 32, 129), begin=b"\2\2"):
    """The shortest file there is for so many pixels: each row is runs of 127."""
    channel = lambda value: bytes((255, value)) * (width // 127) + (bytes((128 + width % 127, value)) if width % 127
                                                                    else b"")
    return hdr_head(width, height) + (begin + struct.pack(">H", width) + b"".join(map(channel, pixel))) * height


def exr_bomb(width, height, channels="BGR", compression=3, payload=None):
    """OpenEXR, half, deflated zeros: about a thousandth of its pixels' bytes."""
    lines = 16 if compression == 3 else 1
    size = 2 * width * len(channels)
    chunk = zlib.compress(b"\x80" * (size * lines), 9) if payload is None else payload
    head = exr(width, height, channels, kind=1, compression=compression, body=False)
    count = (height + lines - 1) // lines
    table = b"".join(struct.pack("<Q", len(head) + 8 * count + i * (8 + len(chunk))) for i in range(count))
    return head + table + b"".join(struct.pack("<ii", i * lines, len(chunk)) + chunk for i in range(count))


def exr(width, height, channels="BGR", kind=2, value=1.5, claimed=None, compression=0, body=True):
    """A scan-line OpenEXR file without compression; kind 1 is half, 2 float."""
    text = lambda s: s.encode() + b"\0"
    attribute = lambda name, type_, data: text(name) + text(type_) + struct.pack("<i", len(data)) + data
    window = struct.pack("<4i", 0, 0, (claimed or width) - 1, (claimed or height) - 1)
    head = b"\x76\x2f\x31\x01" + struct.pack("<I", 2)
    head += attribute("channels", "chlist",
                      b"".join(text(c) + struct.pack("<iB3xii", kind, 0, 1, 1) for c in channels) + b"\0")
    head += attribute("compression", "compression", bytes([compression])) + attribute(
        "dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    head += attribute("lineOrder", "lineOrder", b"\0") + attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    head += attribute("screenWindowCenter", "v2f",
                      struct.pack("<2f", 0, 0)) + attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
    if not body:
        return head
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
        for name, data in {"a.hdr": hdr(8, 4), "b.exr": exr(8, 4), "c.exr": exr(8, 4, kind=1),
                           "d.exr": exr(8, 4, channels="Y"),
                           "e.exr": exr(8, 4, channels="ABGR")}.items():
            with self.subTest(name):
                found = self.accepted(self.scene, "--environment", self.image(name, data))["environment"]
                self.assertEqual((found["kind"], found["width"], found["height"]), ("lat-long image", 8, 4))

    def answer(self, name, data, *options):
        return importing.info(self.scene, "--environment", self.image(name, data), *options, space=SPACE)

    def test_runs(self):
        """Runs and flat rows give the same light, and a picture of nothing but runs is taken."""
        flat, runs = (self.accepted(self.scene, "--environment", self.image(n, d))["environment"] for n, d in
                      (("flat.hdr", hdr(300, 4)), ("runs.hdr", hdr_runs(300, 4))))
        self.assertEqual(flat, runs)
        self.assertEqual(self.answer("wide.hdr", hdr_runs(2048, 1024)).code, 0)

    def test_killers(self):
        """Small files that claim much: each is answered at once, in little memory."""
        channels = ["C%03d" % i for i in range(300)] + ["B", "G", "R"]
        killers = {
            "loop.hdr": hdr_head(8, 1) + b"\2\2\0\x08", "claim.hdr": hdr_head(8192, 8192),
            "claim_flat.hdr": hdr_head(4096, 2048) + b"\x80" * 400,
            "claim_runs.hdr": hdr_runs(4096, 8)[:-3].replace(b"-Y 8 ", b"-Y 2048 "), "large.hdr": hdr_runs(8192, 4096),
            "zero_runs.hdr": hdr_head(8, 1) + b"\2\2\0\x08" + b"\0" * 1000000,
            "beyond.hdr": hdr_head(8, 1) + b"\2\2\0\x08" + b"\xff\1" * 40,
            "long_line.hdr": b"#?RADIANCE\n" + b"x" * 3000000, "no_end.hdr": b"#?RADIANCE\n" + b"a\n" * 1000000,
            "digits.hdr": hdr_head(10 ** 40, 10 ** 40),
            "zero.hdr": hdr_head(0, 0), "tall.hdr": hdr_head(1, 70000) + b"\1\2\3\4" * 70000,
            "old.hdr": hdr_head(100, 1) + b"\x80\x80\x80\x80\1\1\1\xff" * 50,
            "xyz.hdr": hdr_head(8, 1, b"xyze") + b"\x80" * 32,
            "large.exr": exr_bomb(8192, 4096), "claim.exr": exr(4, 4, claimed=2048),
            "reach.exr": exr_bomb(2048, 1024, compression=1, payload=b"\x7f\0" * 9),
            "lines.exr": exr(1, 1, claimed=65000),
            "channels.exr": exr_bomb(4096, 16, channels=channels, payload=b"\0" * 40),
            "dwa.exr": exr_bomb(64, 16, compression=8, payload=b"\0" * 40), "bright.exr": exr(8, 4, value=2e30)}
        for name, data in killers.items():
            with self.subTest(name):
                answer = self.answer(name, data)
                self.assertEqual(answer.code, 65, answer.err)
                self.assertIn(name, answer.err)
                self.assertIsNotNone(answer.sentence(), answer.err)
                self.assertNotIn("importer died", answer.err)
                self.assertLess(answer.memory, importing.MEMORY)
                self.assertLess(answer.seconds, importing.QUICK)

    def test_exposure(self):
        """A header's EXPOSURE and COLORCORR lines multiply; pixels are divided by their product, which is said."""
        body = hdr(8, 4, (128, 128, 128, 129))  # 1 1 1
        with_lines = lambda lines: body.replace(b"FORMAT", lines + b"FORMAT")
        for lines, right in ((b"EXPOSURE=2\n", (0.5, 0.5, 0.5)), (b"EXPOSURE= 2\nEXPOSURE=1e-1\n", (5, 5, 5)),
                             (b"COLORCORR=2 4 0.5\nEXPOSURE=0.5\n", (1, 0.5, 4)), (b"EXPOSURE=1\n", None)):
            with self.subTest(lines=lines):
                path = self.image("e.hdr", with_lines(lines))
                report = self.accepted(self.scene, "--environment", path, "--lightmap-size", 4)
                said = [n["text"] for n in report["notes"] if "EXPOSURE" in n["text"]]
                self.assertEqual(len(said), right is not None)
                if right is not None:
                    self.assertIn("multiplied by {:.6g}, {:.6g} and {:.6g}".format(*(1 / r for r in right)), said[0])
        for lines in (b"EXPOSURE=0\n", b"EXPOSURE=-1\n", b"EXPOSURE=x\n", b"EXPOSURE=nan\n", b"COLORCORR=1 2\n",
                      b"EXPOSURE=1e30\nEXPOSURE=1e30\n"):
            answer = self.answer("f.hdr", with_lines(lines))
            self.assertEqual(answer.code, 65, answer.err)
        for lines, said in ((b"PRIMARIES=0.64 0.33 0.29 0.6 0.15 0.06 0.333 0.333\n", False),
                            (b"PRIMARIES=0.708 0.292 0.17 0.797 0.131 0.046 0.3127 0.329\n", True)):
            report = self.accepted(self.scene, "--environment", self.image("p.hdr", with_lines(lines)))
            self.assertEqual(any("primaries" in n["text"] for n in report["notes"]), said)

    def test_a_large_plain_sky(self):
        """What a sky may take follows from memory: 8192 x 4096 pixels in 2 MB."""
        path = self.image("plain.hdr", hdr_runs(8192, 4096))
        report = self.accepted(self.scene, "--environment", path, "--lightmap-size", 4)
        self.assertEqual(report["environment"]["width"], 8192)

    def test_hostile_files(self):
        folder = importing.want_shared("own", "hostile")
        for name in ("hdr_loop_49_bytes.hdr", "hdr_8192_claim.hdr"):
            answer = importing.info(self.scene, "--environment", os.path.join(folder, name), space=SPACE)
            self.assertEqual(answer.code, 65, answer.err)
            self.assertLess(answer.memory, importing.MEMORY)
            self.assertLess(answer.seconds, importing.QUICK)

    def test_scaled_beyond_float(self):
        answer = self.answer("bright.exr", exr(8, 4, value=1e10), "--environment-scale", "1e10")
        self.assertEqual(answer.code, 64, answer.err)
        self.assertIn("--environment-scale", answer.err)

    def test_negative_values_are_noted(self):
        report = self.accepted(self.scene, "--environment", self.image("n.exr", exr(2, 2, value=-1.0)))
        self.assertTrue(any("12 negative values" in n["text"] for n in report["notes"]), report["notes"])

    def test_what_is_no_environment(self):
        os.mkfifo(os.path.join(self.elsewhere, "pipe.hdr"))
        for name, data, word in (("f.exr", exr(2, 2, value=float("nan")), "not a number"),
                                 ("g.exr", exr(2, 2, value=float("inf")), "infinite"),
                                 ("h.exr", exr(4, 4)[:-20], "decoded"), ("i.exr", exr(4, 4)[:60], "OpenEXR"),
                                 ("j.exr", exr(1, 1, claimed=60000), "pixels"),
                                 ("k.exr", exr(4, 4, channels="RX"), "R, G, B"),
                                 ("l.hdr", hdr(8, 4)[:-3], "cut off"), ("m.hdr", b"\x89PNG\r\n\x1a\n", "neither"),
                                 ("n.hdr", b"", "neither"),
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
