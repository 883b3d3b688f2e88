"""Reads and writes single-part scanline OpenEXR files (none, ZIPS or ZIP; half, float, uint) with numpy alone.

Independent of kiln and of the OpenEXR library, so that studies and tests can tell what a file really says.
    channels, attributes = read(path)      channels: {"R": array[height, width] of float32, ...}
    write(path, {"R": array, ...}, half=("R",), compression="ZIP")
"""
import collections
import struct
import zlib

import numpy as np

Image = collections.namedtuple("Image", "channels attributes")
MAGIC = 20000630
TYPES = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}
LINES = {0: 1, 2: 1, 3: 16}
COMPRESSIONS = {"NONE": 0, "ZIPS": 2, "ZIP": 3}


def _text(data, at):
    end = data.index(b"\0", at)
    return data[at:end].decode(), end + 1


def _value(kind, raw):
    if kind == "string":
        return raw.decode()
    simple = {"int": "<i", "float": "<f", "double": "<d", "box2i": "<4i", "v2f": "<2f"}.get(kind)
    if simple:
        values = struct.unpack(simple, raw)
        return values[0] if len(values) == 1 else values
    if kind == "compression":
        return raw[0]
    if kind == "chlist":
        channels, at = [], 0
        while raw[at] != 0:
            name, at = _text(raw, at)
            pixel_type, _, x, y = struct.unpack_from("<iB3xii", raw, at)
            at += 16
            assert (x, y) == (1, 1), "subsampled channel"
            channels.append((name, TYPES[pixel_type]))
        return channels
    return raw


def _header(data):
    magic, version = struct.unpack_from("<ii", data, 0)
    assert magic == MAGIC, "not an OpenEXR file"
    assert version & 0x1a00 == 0, "tiled, deep or multi-part"
    at, attributes = 8, {}
    while data[at] != 0:
        name, at = _text(data, at)
        kind, at = _text(data, at)
        size = struct.unpack_from("<i", data, at)[0]
        attributes[name] = _value(kind, data[at + 4:at + 4 + size])
        at += 4 + size
    return attributes, at + 1


def _unpack(packed, size):
    """Undoes OpenEXR's deflate: differences, and low and high bytes apart."""
    if len(packed) == size:
        return packed
    raw = np.frombuffer(zlib.decompress(packed), np.uint8).astype(np.int64)
    assert len(raw) == size
    raw[1:] -= 128
    raw = (np.cumsum(raw) & 255).astype(np.uint8)
    out = np.empty(size, np.uint8)
    half = (size + 1) // 2
    out[0::2], out[1::2] = raw[:half], raw[half:]
    return out.tobytes()


def _pack(raw):
    data = np.frombuffer(raw, np.uint8)
    apart = np.concatenate([data[0::2], data[1::2]]).astype(np.int64)
    apart[1:] = np.diff(apart) + 128
    packed = zlib.compress((apart & 255).astype(np.uint8).tobytes())
    return packed if len(packed) < len(raw) else raw


def read(path):
    with open(path, "rb") as file:
        data = file.read()
    attributes, at = _header(data)
    x0, y0, x1, y1 = attributes["dataWindow"]
    width, height, lines = x1 - x0 + 1, y1 - y0 + 1, LINES[attributes["compression"]]
    chunks = -(-height // lines)
    channels = {name: np.empty((height, width), dtype) for name, dtype in attributes["channels"]}
    line_size = width * sum(dtype.itemsize for _, dtype in attributes["channels"])
    for offset in struct.unpack_from(f"<{chunks}Q", data, at):
        y, size = struct.unpack_from("<ii", data, offset)
        count = min(lines, y1 + 1 - y)
        raw = _unpack(data[offset + 8:offset + 8 + size], line_size * count)
        place = 0
        for row in range(y - y0, y - y0 + count):
            for name, dtype in attributes["channels"]:
                channels[name][row] = np.frombuffer(raw, dtype, width, place)
                place += width * dtype.itemsize
    return Image({n: c.astype(np.float32) if c.dtype.kind == "f" else c for n, c in channels.items()}, attributes)


def rgb(path, prefix=""):
    """[height, width, 3] of float32."""
    channels, _ = read(path)
    return np.stack([channels[prefix + c] for c in "RGB"], axis=-1)


def _attribute(name, kind, raw):
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(raw)) + raw


def write(path, channels, half=(), compression="ZIP", attributes=None):
    names = sorted(channels)
    height, width = channels[names[0]].shape
    kinds = {n: TYPES[1 if n in half else 2] for n in names}
    listed = b"".join(n.encode() + b"\0" + struct.pack("<iB3xii", 1 if n in half else 2, 0, 1, 1)
                      for n in names) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    header = struct.pack("<ii", MAGIC, 2)
    header += _attribute("channels", "chlist", listed)
    header += _attribute("compression", "compression", bytes([COMPRESSIONS[compression]]))
    header += _attribute("dataWindow", "box2i", window) + _attribute("displayWindow", "box2i", window)
    header += _attribute("lineOrder", "lineOrder", b"\0") + _attribute("pixelAspectRatio", "float",
                                                                       struct.pack("<f", 1))
    header += _attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0))
    header += _attribute("screenWindowWidth", "float", struct.pack("<f", 1))
    for name, text in (attributes or {}).items():
        header += _attribute(name, "string", text.encode())
    header += b"\0"
    lines = LINES[COMPRESSIONS[compression]]
    chunks = []
    for y in range(0, height, lines):
        raw = b"".join(channels[n][row].astype(kinds[n]).tobytes() for row in range(y, min(y + lines, height))
                       for n in names)
        packed = raw if compression == "NONE" else _pack(raw)
        chunks.append(struct.pack("<ii", y, len(packed)) + packed)
    at, table = len(header) + 8 * len(chunks), b""
    for chunk in chunks:
        table += struct.pack("<Q", at)
        at += len(chunk)
    with open(path, "wb") as file:
        file.write(header + table + b"".join(chunks))
