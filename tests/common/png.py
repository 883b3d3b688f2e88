"""Reads and writes PNG pictures of 8 bits a channel, colours without alpha."""
import base64
import struct
import zlib

import numpy as np


def read(path):
    """(height, width, 3), 0 to 255, top row first."""
    with open(path, 'rb') as f:
        data = f.read()
    assert data[:8] == b'\x89PNG\r\n\x1a\n', path
    width, height, depth, colours = struct.unpack_from('>IIBB', data, 16)
    assert (depth, colours) == (8, 2), path
    at, packed = 8, b''
    while at < len(data):
        length, kind = struct.unpack_from('>I4s', data, at)
        packed += data[at + 8:at + 8 + length] if kind == b'IDAT' else b''
        at += 12 + length
    raw, stride = zlib.decompress(packed), 3 * width
    above, rows = np.zeros(stride, np.int64), []
    for y in range(height):
        line = np.frombuffer(raw, np.uint8, stride, y * (stride + 1) + 1).astype(np.int64)
        above = _unfilter(raw[y * (stride + 1)], line, above)
        rows.append(above.reshape(width, 3))
    return np.stack(rows)


def _unfilter(kind, line, above):
    """The bytes of a row, from what is stored of it by filter `kind` (PNG specification, section 9)."""
    row = np.zeros_like(line)
    for i, value in enumerate(line):
        left, up, corner = (row[i - 3], above[i], above[i - 3]) if i >= 3 else (0, above[i], 0)
        estimate = left + up - corner
        near = min((left, up, corner), key=lambda one: abs(estimate - one))  # the first of the nearest
        row[i] = (value + (0, left, up, (left + up) // 2, near)[kind]) & 255
    return row


def data_uri(pixels):
    """A PNG of 8-bit RGB or RGBA, as a data URI."""
    pixels = np.asarray(pixels, np.uint8)
    height, width, channels = pixels.shape

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    kind = 2 if channels == 3 else 6
    data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)) + chunk(
        b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return "data:image/png;base64," + base64.b64encode(data).decode()
