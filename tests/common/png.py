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


def of(width, height, channels, packed):
    """The bytes of a PNG of 8-bit RGB or RGBA, of its rows as zlib packs them."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2 if channels == 3 else 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def encoded(pixels):
    """The bytes of a PNG of 8-bit RGB or RGBA, (height, width, 3 or 4)."""
    pixels = np.asarray(pixels, np.uint8)
    height, width, channels = pixels.shape
    return of(width, height, channels, zlib.compress(b"".join(b"\0" + row.tobytes() for row in pixels)))


def data_uri(pixels):
    """The same as a data URI."""
    return "data:image/png;base64," + base64.b64encode(encoded(pixels)).decode()
