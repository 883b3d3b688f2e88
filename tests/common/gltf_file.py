"""Reads glTF (.glb, .gltf with files or data URIs beside it) with numpy alone: the JSON, and accessors as arrays.

Independent of kiln, so that tests can tell what an exported scene really holds."""
import base64
import json
import os
import struct
import urllib.parse

import numpy as np

COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {'SCALAR': 1, 'VEC2': 2, 'VEC3': 3, 'VEC4': 4, 'MAT4': 16}


class File:
    def __init__(self, path):
        self.path = path
        with open(path, 'rb') as file:
            data = file.read()
        self.binary = b''
        if data[:4] == b'glTF':
            length = struct.unpack_from('<I', data, 12)[0]
            self.json = json.loads(data[20:20 + length])
            if len(data) > 20 + length:
                self.binary = data[28 + length:]
        else:
            self.json = json.loads(data)
        self.buffers = [self._buffer(b) for b in self.json.get('buffers', [])]

    def _uri(self, uri):
        if uri.startswith('data:'):
            return base64.b64decode(uri.split(',', 1)[1])
        with open(os.path.join(os.path.dirname(self.path), urllib.parse.unquote(uri)), 'rb') as file:
            return file.read()

    def _buffer(self, buffer):
        return self._uri(buffer['uri']) if 'uri' in buffer else self.binary

    def view(self, index):
        view = self.json['bufferViews'][index]
        at = view.get('byteOffset', 0)
        return self.buffers[view['buffer']][at:at + view['byteLength']], view.get('byteStride')

    def image(self, index):
        """The bytes of an image file."""
        image = self.json['images'][index]
        return bytes(self.view(image['bufferView'])[0]) if 'bufferView' in image else self._uri(image['uri'])

    def _elements(self, view, offset, component, width, count):
        data, stride = self.view(view)
        dtype = np.dtype(COMPONENTS[component])
        size = dtype.itemsize * width
        stride = stride or size
        rows = np.lib.stride_tricks.as_strided(np.frombuffer(data, np.uint8)[offset:], (count, size), (stride, 1))
        return np.ascontiguousarray(rows).view(dtype).reshape(count, width)

    def accessor(self, index):
        """[count, width], as stored: not normalised."""
        a = self.json['accessors'][index]
        width, count = WIDTHS[a['type']], a['count']
        if 'bufferView' in a:
            values = self._elements(a['bufferView'], a.get('byteOffset', 0), a['componentType'], width, count)
        else:
            values = np.zeros((count, width), COMPONENTS[a['componentType']])
        if 'sparse' in a:
            s = a['sparse']
            at = self._elements(s['indices']['bufferView'], s['indices'].get('byteOffset', 0),
                                s['indices']['componentType'], 1, s['count'])[:, 0]
            values = values.copy()
            values[at] = self._elements(s['values']['bufferView'], s['values'].get('byteOffset', 0), a['componentType'],
                                        width, s['count'])
        return values

    def floats(self, index):
        """[count, width] of float64, normalised where the accessor says so."""
        values, a = self.accessor(index), self.json['accessors'][index]
        if not a.get('normalized') or values.dtype.kind == 'f':
            return values.astype(np.float64)
        return np.maximum(values / float(np.iinfo(values.dtype).max), -1.0)

    def corners(self, primitive):
        """[triangles, 3] vertex numbers; none for points and lines."""
        count = self.json['accessors'][primitive['attributes']['POSITION']]['count']
        order = self.accessor(primitive['indices'])[:,
                                                    0].astype(np.int64) if 'indices' in primitive else np.arange(count)
        mode = primitive.get('mode', 4)
        if mode == 4:
            return order.reshape(-1, 3)
        k = np.arange(max(len(order) - 2, 0))
        if mode == 5:
            return np.stack([order[k], order[k + 1 + k % 2], order[k + 2 - k % 2]], 1)
        if mode == 6:
            return np.stack([order[k + 1], order[k + 2], np.full(len(k), order[0])], 1)
        return np.zeros((0, 3), np.int64)


def write_glb(path, document, blob):
    text = json.dumps(document).encode()
    text += b' ' * (-len(text) % 4)
    blob = bytes(blob) + b'\0' * (-len(blob) % 4)
    with open(path, 'wb') as file:
        file.write(b'glTF' + struct.pack('<II', 2, 28 + len(text) + len(blob)) +
                   struct.pack('<I4s', len(text), b'JSON') + text)
        file.write(struct.pack('<I4s', len(blob), b'BIN\0') + blob)


def strip(source, target):
    """The same scene without its second UV set."""
    file = File(source)
    for mesh in file.json.get('meshes', []):
        for primitive in mesh['primitives']:
            primitive['attributes'].pop('TEXCOORD_1', None)
    write_glb(target, file.json, file.binary)
