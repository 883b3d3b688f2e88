"""Mutators that know a format: each takes a random.Random and a good file's bytes, and gives bytes that are wrong in a
way somebody might have thought of. What protects a format from accidents (checksums, lengths, packing) is made to fit
again most of the time, so that the checks behind it are reached. HDF5 is in hdf5.py, what belongs to a bake or a
checkpoint in readers.py."""
import base64
import json
import struct
import zlib

INTEGERS = [0, 1, 2, 3, 4, 7, 8, 15, 16, 31, 32, 63, 64, 100, 127, 128, 255, 256, 1000, 1023, 1024, 4095, 4096, 8192,
            16383, 16384, 16385, 32767, 32768,
            65535, 65536, 99999, 1000000, (1 << 24) - 1, 1 << 24, (1 << 30), (1 << 31) - 1, 1 << 31, (1 << 31) + 1,
            (1 << 32) - 1, 1 << 32,
            (1 << 40), (1 << 52), (1 << 53), (1 << 62), (1 << 63) - 1, 1 << 63, (1 << 64) - 1, (1 << 64) - 8]
NUMBERS = [0.0, -0.0, 1e-45, 1e-38, 1e-30, 1e-7, 0.5, 1.0, -1.0, 2.0, 1e6, 1e9, 1e18, 1e30, 1e37, 3.4e38, 3.5e38, 1e39,
           1e150, 1e200, 1e300, 1.7e308, -1e30, -1e300]
WORDS = ['', ' ', '.', '..', '/', '\\', 'a' * 300, 'x' * 5000, 'é', '\u202e', '日本語', 'a\tb', 'a\nb',
         'a\rkiln: error: forged', '\x1b[2J\x1b[31mred', '\x07',
         '\x7f', '\u0080\u009b31m', 'nul\x00after', '%00', '%2e%2e/%2e%2e/x', 'con', '-', '--output', '-rf', '$(id)',
         '`id`', "'", '"', 'NaN', 'inf', '1e999',
         '%s%s%s%n', '\ufeff', '\ud83d\ude00', 'null', 'true', '0', '~', '*', '[a-z', '?']
OUTSIDE = []  # references that lead out of the folder given: set by the driver, which watches whether they are followed


def gloss(r):
    """Extensions of gloss with any numbers and textures."""
    texture = {'index': r.choice((0, 0, integer(r))), 'texCoord': r.choice((0, 1, integer(r)))}
    known = {'KHR_materials_ior': {'ior': r.choice(NUMBERS)},
             'KHR_materials_specular': {'specularFactor': r.choice(NUMBERS), 'specularTexture': texture,
                                        'specularColorFactor': [r.choice(NUMBERS)] * 3,
                                        'specularColorTexture': texture},
             'KHR_materials_transmission': {'transmissionFactor': 0.5, 'transmissionTexture': texture},
             'KHR_materials_volume': {'thicknessFactor': r.choice(NUMBERS), 'thicknessTexture': texture,
                                      'attenuationDistance': r.choice(NUMBERS),
                                      'attenuationColor': [r.choice(NUMBERS)] * 3},
             'KHR_materials_dispersion': {'dispersion': r.choice(NUMBERS)},
             'KHR_materials_clearcoat': {'clearcoatFactor': r.choice(NUMBERS), 'clearcoatTexture': texture,
                                         'clearcoatNormalTexture': {**texture, 'scale': r.choice(NUMBERS)}},
             'KHR_materials_anisotropy': {'anisotropyStrength': r.choice(NUMBERS), 'anisotropyTexture': texture,
                                          'anisotropyRotation': r.choice(NUMBERS)}}
    return {name: known[name] for name in r.sample(sorted(known), r.randrange(1, 4))}


def word(r):
    return r.choice(OUTSIDE) if OUTSIDE and r.random() < 0.25 else r.choice(WORDS)


def integer(r, near=0):
    kind = r.random()
    if kind < 0.6:
        return r.choice(INTEGERS)
    if kind < 0.75:
        return near + r.choice((-2, -1, 1, 2, 3, 100))
    if kind < 0.85:
        return -r.choice(INTEGERS)
    if kind < 0.92:
        return near * r.choice((2, 3, 10, 1000))
    return r.getrandbits(r.choice((4, 8, 16, 32, 48, 63)))


def packed(value, size):
    return (value & ((1 << 8 * size) - 1)).to_bytes(size, 'little')


# ---- bytes ----

def havoc(r, data, most=4):
    """Blind changes, for what no other mutator thinks of."""
    data = bytearray(data)
    for _ in range(r.randint(1, most)):
        kind, n = r.randrange(9), len(data)
        if n == 0:
            return bytes(r.getrandbits(8) for _ in range(r.randint(1, 40)))
        at = r.randrange(n)
        if kind < 2:
            data[at] ^= 1 << r.randrange(8)
        elif kind == 2:
            data[at] = r.choice((0, 1, 127, 128, 255, r.getrandbits(8)))
        elif kind == 3:
            size = r.choice((2, 4, 8))
            data[at:at + size] = packed(integer(r), size)
        elif kind == 4:
            data[at:at + r.randint(1, 64)] = b''
        elif kind == 5:
            data[at:at] = bytes(r.getrandbits(8) for _ in range(r.randint(1, 32)))
        elif kind == 6:
            end = at + r.randint(1, 128)
            data[r.randrange(n):0] = data[at:end]
        elif kind == 7:
            del data[at:]
        else:
            value = r.choice((0, 255, 32, 48))
            for i in range(at, min(n, at + r.randint(1, 64))):
                data[i] = value
    return bytes(data)


def field(r, data, at, size, big=False):
    """Another value for an integer of that size."""
    near = int.from_bytes(data[at:at + size], 'big' if big else 'little')
    value = packed(integer(r, near), size) if r.random() < 0.85 else packed(near ^ (1 << r.randrange(8 * size)), size)
    return data[:at] + (value[::-1] if big else value) + data[at + size:]


# ---- JSON ----

def places(tree, path=()):
    """Every value below the root, as (container, key)."""
    found = []
    stack = [tree]
    while stack:
        node = stack.pop()
        keys = node.keys() if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
        for key in keys:
            found.append((node, key))
            if isinstance(node[key], (dict, list)):
                stack.append(node[key])
    return found


class Raw(str):
    """JSON text that json.dumps would not write."""


def strange(r, old):
    """A value of another kind, or another value of the same kind."""
    kind = r.random()
    if isinstance(old, bool) or old is None:
        return r.choice((True, False, None, 0, 1, -1, 'true', [], {}))
    if isinstance(old, (int, float)) and kind < 0.7:
        value = integer(r, int(old) if abs(old) < 1e18
                        else 0) if isinstance(old, int) and r.random() < 0.8 else r.choice(NUMBERS)
        return value if r.random() < 0.95 else Raw(
            r.choice(('1e400', '-1e400', 'NaN', 'Infinity', '1' * 400, '0x10', '01', '1.', '+1', '1e', '-')))
    if isinstance(old, str) and kind < 0.7:
        return word(r) if r.random() < 0.7 else old + word(r) if r.random() < 0.5 else old[:r.randrange(len(old) + 1)]
    if isinstance(old, list) and kind < 0.6 and old:
        how = r.randrange(5)
        if how == 0:
            return old * r.choice((2, 3, 100))
        if how == 1:
            return old[:-1]
        if how == 2:
            return old + [old[0]]
        return [strange(r, v) if r.random() < 0.5 else v for v in old] if how == 3 else list(reversed(old))
    if isinstance(old, dict) and kind < 0.5:
        return {(word(r) if r.random() < 0.3 else k): v for k, v in old.items()}
    if kind > 0.97:
        depth = r.choice((10, 100, 2000, 5000))
        return Raw('[' * depth + ']' * depth) if r.random() < 0.5 else Raw('{"a":' * depth + '0' + '}' * depth)
    return r.choice((None, True, 0, -1, 1.5, integer(r), '', word(r), [], {}, [old], {'a': old}, [[]], [0] * 17))


def dumps(tree):
    """json.dumps that lets Raw through."""
    raw = []

    def mark(value):
        if isinstance(value, Raw):
            raw.append(str(value))
            return '\x02%d\x03' % (len(raw) - 1)
        if isinstance(value, dict):
            return {k: mark(v) for k, v in value.items()}
        if isinstance(value, list):
            return [mark(v) for v in value]
        return value
    text = json.dumps(mark(tree), ensure_ascii=False)
    for i, piece in enumerate(raw):
        text = text.replace('"\\u0002%d\\u0003"' % i, piece)
    return text.encode('utf-8', 'surrogatepass')


def mutate_tree(r, tree, most=3):
    """Changes a parsed tree in place, a few times; returns it."""
    for _ in range(r.randint(1, most)):
        found = places(tree)
        if not found:
            return strange(r, tree)
        node, key = r.choice(found)
        kind = r.random()
        if kind < 0.12:
            del node[key]
        elif kind < 0.2 and isinstance(node, dict):
            node[key + '_' if r.random() < 0.5 else word(r)] = node[key]
        elif kind < 0.28:
            other, place = r.choice(found)
            value = other[place]
            # a copy, for a tree that holds itself is none
            node[key] = json.loads(dumps(value)) if not has_raw(value) else 0
        else:
            node[key] = strange(r, node[key])
    return tree


def has_raw(value):
    if isinstance(value, dict):
        return any(has_raw(v) for v in value.values())
    if isinstance(value, list):
        return any(has_raw(v) for v in value)
    return isinstance(value, Raw)


def mutate_json_text(r, text):
    """What a parser sees: doubled keys, cut text, broken UTF-8, escapes, comments, a second document."""
    kind = r.randrange(8)
    if kind == 0:
        at = text.find(b'"')
        return text[:at] + b'"a":1,"a":2,' + text[at:] if at >= 0 else text
    if kind == 1:
        return text[:r.randrange(len(text) + 1)]
    if kind == 2:
        at = r.randrange(len(text) + 1)
        return text[:at] + r.choice((b'\xff', b'\xc0\x80', b'\xed\xa0\x80', b'\xf8\x88\x80\x80\x80', b'\x00', b'\x1b',
                                     b'\xef\xbb\xbf')) + text[at:]
    if kind == 3:
        return text + r.choice((b'{}', b'garbage', b'\x00' * 9, b' ' * 100000, text))
    if kind == 4:
        return text.replace(b':', r.choice((b'::', b'', b' : ')), 1)
    if kind == 5:
        return r.choice((b'\xef\xbb\xbf', b'// c\n', b'\xff\xfe', b'[' * 3000)) + text
    if kind == 6:
        return text.replace(b'"', r.choice((b'\\u0000"', b'\\ud800"', b'\\', b"'")), r.randint(1, 3))
    return havoc(r, text)


# ---- glTF ----

COMPONENT = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}


def gltf_tree(r, tree):
    """A change that means something in glTF; the tree is changed in place."""
    kind = r.randrange(22)
    one = lambda name: r.choice(tree[name]) if isinstance(tree.get(name), list) and tree.get(name) else None
    if kind < 4:
        accessor = one('accessors')
        if accessor:
            key = r.choice(('count', 'byteOffset', 'componentType', 'type', 'bufferView', 'normalized', 'sparse',
                            'max'))
            accessor[key] = {'componentType': r.choice(list(COMPONENT) + [5124, 5130, 0]),
                             'type': r.choice(('SCALAR', 'VEC2', 'VEC3', 'VEC4', 'MAT2', 'MAT3', 'MAT4', 'VEC9', '')),
                             'normalized': True, 'max': [r.choice(NUMBERS)] * 3,
                             'sparse': {'count': r.choice((1, 3, 1 << 31, integer(r))),
                                        'indices': {'bufferView': r.randrange(4), 'componentType': 5125,
                                        'byteOffset': r.choice((0, 4, 1 << 32))},
                                        'values': {'bufferView': r.randrange(4)}}}.get(
                                            key, integer(r, accessor.get(key, 0)
                                                         if isinstance(accessor.get(key, 0), int) else 0))
            if key == 'sparse' and r.random() < 0.5:
                accessor.pop('bufferView', None)
                accessor['count'] = r.choice((1 << 20, 1 << 28, 1 << 31, 10))
    elif kind < 6:
        view = one('bufferViews')
        if view:
            key = r.choice(('byteOffset', 'byteLength', 'byteStride', 'buffer'))
            view[key] = integer(r, view.get(key, 0) if isinstance(view.get(key, 0), int) else 0)
    elif kind == 6:
        buffer = one('buffers')
        if buffer:
            if r.random() < 0.5:
                buffer['byteLength'] = integer(r, buffer.get('byteLength', 0))
            else:
                buffer['uri'] = r.choice(
                    (word(r), 'data:application/octet-stream;base64,' + 'A' * r.choice((0, 1, 2, 3, 5, 1000)), 'data:,',
                     'data:;base64,====', 'fifo', 'scene.gltf'))
    elif kind < 9:
        nodes = tree.get('nodes')
        if isinstance(nodes, list) and nodes:
            node = r.choice(nodes)
            n = len(nodes)
            how = r.randrange(8)
            if how == 0:
                node['children'] = [r.randrange(n + 2) for _ in range(r.randint(1, 4))]
            elif how == 1:
                node['matrix'] = [r.choice(NUMBERS) for _ in range(16)]
            elif how == 2:
                node['scale'] = [r.choice(NUMBERS) for _ in range(3)]
            elif how == 3:
                node['translation'] = [r.choice(NUMBERS) for _ in range(3)]
            elif how == 4:
                node['name'] = word(r)
            elif how == 5:
                first = len(nodes)
                for i in range(r.choice((3, 100, 2000))):
                    nodes.append({'children': [first + i + 1]})
                nodes.append({'mesh': 0})
                node['children'] = [first]
            elif how == 6:
                node['extensions'] = {'EXT_mesh_gpu_instancing': {
                    'attributes': {r.choice(('TRANSLATION', 'ROTATION', 'SCALE', '_X')): r.randrange(6)}}}
                if r.random() < 0.7:
                    tree['extensionsUsed'] = tree['extensionsRequired'] = ['EXT_mesh_gpu_instancing']
            else:
                node['extras'] = {
                    'kiln': {r.choice(('density-scale', 'lightmap-size', 'exclude', 'role', 'sides', 'x')): r.choice(
                        (True, 0, -1, 1e300, 32768, 'two', word(r), []))}}
    elif kind < 12:
        mesh = one('meshes')
        if mesh and isinstance(mesh.get('primitives'), list) and mesh['primitives']:
            p = r.choice(mesh['primitives'])
            how = r.randrange(6)
            if isinstance(p, dict):
                if how == 0:
                    p['mode'] = r.choice((0, 1, 2, 3, 4, 5, 6, 7, -1, 1 << 32))
                elif how == 1:
                    p['indices'] = integer(r, 1)
                elif how == 2 and isinstance(p.get('attributes'), dict):
                    p['attributes'][r.choice(('POSITION', 'NORMAL', 'TEXCOORD_0', 'TEXCOORD_1', 'COLOR_0',
                                              'TEXCOORD_99', 'TANGENT'))] = r.choice((integer(r, 1), r.randrange(6)))
                elif how == 3:
                    p['material'] = integer(r)
                elif how == 4:
                    p['extensions'] = {r.choice(('KHR_draco_mesh_compression', 'EXT_meshopt_compression')): {
                        'bufferView': r.randrange(4), 'attributes': {'POSITION': r.randrange(3)}}}
                    tree['extensionsUsed'] = list(p['extensions'])
                else:
                    mesh['primitives'] *= r.choice((2, 5))
    elif kind < 15:
        material = one('materials')
        if material:
            how = r.randrange(7)
            if how == 0:
                material['emissiveFactor'] = [r.choice(NUMBERS) for _ in range(3)]
            elif how == 1:
                material['pbrMetallicRoughness'] = {'baseColorFactor': [r.choice(NUMBERS) for _ in range(4)],
                                                    'baseColorTexture': {'index': integer(r), 'texCoord': integer(r)}}
            elif how == 2:
                material['extensions'] = {'KHR_materials_emissive_strength': {'emissiveStrength': r.choice(NUMBERS)}}
            elif how == 3:
                material['alphaMode'] = r.choice(('MASK', 'BLEND', 'OPAQUE', 'x', 1))
                material['alphaCutoff'] = r.choice(NUMBERS)
            elif how == 4:
                material['extensions'] = {'KHR_materials_transmission': {'transmissionFactor': r.choice(NUMBERS),
                                                                         'transmissionTexture': {'index': integer(r)}}}
            elif how == 5:
                material['extensions'] = gloss(r)
            else:
                material['name'] = word(r)
    elif kind == 15:
        image = one('images')
        if image:
            image.pop('bufferView', None)
            image['uri'] = r.choice((word(r), 'data:image/png;base64,AAAA',
                                     'data:image/png;base64,' + base64.b64encode(bytes(300)).decode(), 'fifo', 'a.png'))
    elif kind == 16:
        tree['extensions'] = {'KHR_lights_punctual': {
            'lights': [{'type': r.choice(('point', 'spot', 'directional', 'x')), 'intensity': r.choice(NUMBERS),
                              'color': [r.choice(NUMBERS)] * 3, 'range': r.choice(NUMBERS),
                              'spot': {'innerConeAngle': r.choice(NUMBERS), 'outerConeAngle': r.choice(NUMBERS)}}]}}
        if isinstance(tree.get('nodes'), list) and tree['nodes'] and isinstance(tree['nodes'][0], dict):
            tree['nodes'][0]['extensions'] = {'KHR_lights_punctual': {'light': r.choice((0, 1, -1))}}
    elif kind == 17:
        tree[r.choice(('extensionsRequired', 'extensionsUsed'))] = r.choice(
            (['KHR_unknown'], [word(r)], 'x', [1], ['KHR_mesh_quantization']))
    elif kind == 18:
        tree['scene'] = integer(r)
    elif kind == 19:
        scene = one('scenes')
        if scene:
            scene['nodes'] = r.choice(([0] * 50, [integer(r)], [], [0, 0], None))
    elif kind == 20:
        texture = one('textures')
        if texture:
            texture[r.choice(('source', 'sampler'))] = integer(r)
    else:
        camera = {'type': r.choice(('perspective', 'orthographic')),
                  'perspective': {'yfov': r.choice(NUMBERS), 'znear': r.choice(NUMBERS)},
                  'orthographic': {'ymag': r.choice(NUMBERS)}}
        tree['cameras'] = [camera]
        if isinstance(tree.get('nodes'), list) and tree['nodes'] and isinstance(tree['nodes'][0], dict):
            tree['nodes'][0]['camera'] = 0
    return tree


def gltf_text(r, text):
    kind = r.random()
    if kind < 0.1:
        return mutate_json_text(r, text)
    tree = json.loads(text)
    for _ in range(r.choice((1, 1, 1, 2, 3))):
        if not isinstance(tree, dict):
            break
        try:
            tree = gltf_tree(r, tree) if r.random() < 0.6 and not has_raw(tree) else mutate_tree(r, tree, 1)
        except (TypeError, AttributeError, KeyError):
            continue  # an earlier change has left nothing to change there
    text = dumps(tree)
    return mutate_json_text(r, text) if kind > 0.97 else text


def glb_parts(data):
    at, chunks = 12, []
    while at + 8 <= len(data):
        size, kind = struct.unpack_from('<II', data, at)
        chunks.append((kind, data[at + 8:at + 8 + size]))
        at += 8 + size
    return chunks


def glb_join(chunks, version=2):
    body = b''.join(struct.pack('<II', len(c), k) + c for k, c in chunks)
    return struct.pack('<4sII', b'glTF', version, 12 + len(body)) + body


def floats(r, data, count=3):
    """Some of the 32-bit words become other floats or indices."""
    data = bytearray(data)
    for _ in range(r.randint(1, count)):
        if len(data) >= 4:
            at = r.randrange(len(data) // 4) * 4
            value = r.choice(NUMBERS + [float('nan'), float('inf'), float('-inf')])
            data[at:at + 4] = struct.pack('<f', value) if abs(value) < 3.4e38 or value != value or abs(value) == float(
                'inf') else packed(integer(r), 4)
            if r.random() < 0.4:
                data[at:at + 4] = packed(integer(r), 4)
    return bytes(data)


def glb(r, data):
    chunks = glb_parts(data)
    kind = r.random()
    if kind < 0.5:
        chunks[0] = (chunks[0][0], padded(gltf_text(r, chunks[0][1]), b' '))
        return glb_join(chunks)
    if kind < 0.75 and len(chunks) > 1:
        binary = floats(r, chunks[1][1]) if r.random() < 0.6 else havoc(r, chunks[1][1])
        if r.random() < 0.8:
            binary = binary[:len(chunks[1][1])].ljust(len(chunks[1][1]), b'\0')
        chunks[1] = (chunks[1][0], binary)
        return glb_join(chunks)
    if kind < 0.9:
        how = r.randrange(6)
        if how == 0:
            return glb_join(chunks, r.choice((0, 1, 3, 1 << 31)))
        if how == 1:
            return field(r, data, r.choice((0, 4, 8, 12, 16)), 4)
        if how == 2:
            return field(r, data, 20 + len(chunks[0][1]) + r.choice((0, 4)), 4)
        if how == 3:
            return glb_join(chunks * 2)
        if how == 4:
            return glb_join([(k, c + b'\0' * r.choice((1, 2, 3))) for k, c in chunks])
        return glb_join(list(reversed(chunks)))
    return havoc(r, data)


def padded(data, by):
    return data + by * (-len(data) % 4)


# ---- PNG ----

def png_chunks(data):
    at, chunks = 8, []
    while at + 12 <= len(data):
        size = struct.unpack_from('>I', data, at)[0]
        chunks.append((data[at + 4:at + 8], data[at + 8:at + 8 + size]))
        at += 12 + size
    return chunks


def png_join(chunks, r=None):
    out = [b'\x89PNG\r\n\x1a\n']
    for i, (kind, body) in enumerate(chunks):
        size, crc = len(body), zlib.crc32(kind + body)
        if r is not None and r.random() < 0.02:
            size = integer(r, size) & 0xffffffff
        if r is not None and r.random() < 0.02:
            crc ^= 1
        out.append(struct.pack('>I', size) + kind + body + struct.pack('>I', crc))
    return b''.join(out)


def zeros_packed(count, cache={}):
    """A deflate stream of so many zeros."""
    if count not in cache:
        pack = zlib.compressobj(9)
        step = bytes(1 << 20)
        cache[count] = b''.join(pack.compress(step) for _ in range(count >> 20)) + pack.compress(
            bytes(count & 0xfffff)) + pack.flush()
    return cache[count]


def png(r, data):
    chunks = png_chunks(data)
    for _ in range(r.choice((1, 1, 2))):
        kind = r.randrange(10)
        if kind < 3:
            head = bytearray(chunks[0][1])
            if len(head) == 13:
                at = r.randrange(7)
                if at < 2:
                    head[4 * at:4 * at + 4] = (integer(r, 8) & 0xffffffff).to_bytes(4, 'big')
                else:
                    head[6 + at] = r.choice((0, 1, 2, 3, 4, 5, 6, 7, 8, 16, 32, 255))
                chunks[0] = (chunks[0][0], bytes(head))
        elif kind < 6:
            whole = b''.join(c for k, c in chunks if k == b'IDAT')
            try:
                raw = zlib.decompress(whole)
            except zlib.error:
                continue
            how = r.randrange(5)
            if how == 0:
                raw = havoc(r, raw)
            elif how == 1:
                raw = bytes([r.choice((0, 1, 2, 3, 4, 5, 255))]) + raw[1:]
            elif how == 2:
                raw = raw[:r.randrange(len(raw) + 1)]
            elif how == 3:
                raw = raw * 50
            stream = zeros_packed(r.choice((1 << 20, 1 << 26))) if how == 4 else zlib.compress(raw, r.choice((0, 1, 9)))
            if r.random() < 0.3:
                stream = havoc(r, stream, 2)
            chunks = [c for c in chunks if c[0] != b'IDAT']
            cut = r.randrange(len(stream) + 1)
            chunks[1:1] = [(b'IDAT', stream)] if r.random() < 0.7 else [(b'IDAT', stream[:cut]),
                                                                        (b'IDAT', stream[cut:])]
        elif kind == 6:
            i = r.randrange(len(chunks))
            chunks[i:i] = [
                (r.choice((b'PLTE', b'tRNS', b'CgBI', b'gAMA', b'iCCP', b'IDAT', b'IEND', b'IHDR', b'abcd', b'ABCD')),
                            bytes(r.getrandbits(8) for _ in range(r.choice((0, 1, 3, 6, 13, 768, 771)))))]
        elif kind == 7 and len(chunks) > 1:
            del chunks[r.randrange(len(chunks))]
        elif kind == 8:
            r.shuffle(chunks)
        else:
            return havoc(r, png_join(chunks))
        if not chunks:
            return b'\x89PNG\r\n\x1a\n'
    return png_join(chunks, r)


# ---- JPEG ----

def jpeg(r, data):
    segments, at = [], 2
    while at + 4 <= len(data) and data[at] == 0xff and data[at + 1] != 0xda:
        size = struct.unpack_from('>H', data, at + 2)[0]
        segments.append((data[at + 1], data[at + 4:at + 2 + size]))
        at += 2 + size
    rest = data[at:]
    for _ in range(r.choice((1, 1, 2))):
        kind = r.randrange(10)
        if not segments:
            break
        i = r.randrange(len(segments))
        marker, body = segments[i]
        if kind < 3:
            frames = [j for j, s in enumerate(segments) if s[0] in (0xc0, 0xc1, 0xc2)]
            if frames:
                i = frames[0]
                marker, body = segments[i]
                body = field(r, body, r.choice((1, 3)), 2,
                             True) if r.random() < 0.6 and len(body) > 5 else havoc(r, body, 1)
                segments[i] = (marker, body)
        elif kind < 5:
            segments[i] = (marker, havoc(r, body, 2))
        elif kind == 5:
            segments[i] = (r.choice((0xc0, 0xc1, 0xc2, 0xc3, 0xc4, 0xc9, 0xdb, 0xdd, 0xe0, 0xee, 0xfe, 0x01, 0xd0)),
                           body)
        elif kind == 6:
            segments[i:i] = [segments[i]] * r.choice((1, 3, 500))
        elif kind == 7:
            del segments[i]
        elif kind == 8:
            rest = havoc(r, rest, 6)
        else:
            rest = rest[:14] + r.choice((b'', rest[14:] * 20, b'\xff\xd0' * 3000, b'\xff' * 5000, b'\0' * 5000,
                                         rest[14:] + rest))
    out = [b'\xff\xd8']
    for marker, body in segments:
        size = len(body) + 2
        if r.random() < 0.02:
            size = integer(r, size)
        out.append(bytes((0xff, marker)) + struct.pack('>H', size & 0xffff) + body)
    return b''.join(out) + rest


# ---- Radiance ----

def hdr(r, data):
    end = data.find(b'\n\n') + 2
    line = data.find(b'\n', end) + 1
    head, size, body = data[:end], data[end:line], data[line:]
    kind = r.randrange(10)
    if kind < 2:
        lines = head.split(b'\n')
        i = r.randrange(len(lines))
        lines[i] = r.choice(
            (b'', b'FORMAT=32-bit_rle_xyze', b'EXPOSURE=%s' % r.choice((b'0', b'-1', b'1e300', b'nan', b'x')),
             b'x' * 5000, b'#?RADIANCE', b'\x1b[31m', b'FORMAT=', b'\0'))
        head = b'\n'.join(lines)
    elif kind < 5:
        names = [b'-Y', b'+X'] if r.random() < 0.7 else [r.choice((b'-Y', b'+Y', b'-X', b'+X', b'Z', b'')),
                                                         r.choice((b'-Y', b'+Y', b'-X', b'+X', b''))]
        size = b'%s %d %s %d\n' % (names[0], integer(r, 4), names[1], integer(r, 8))
        if r.random() < 0.3:
            size = b'-Y %d +X %d\n' % (r.choice((1, 2, 4, 100, 8192, 16384)),
                                       r.choice((1, 7, 8, 9, 127, 128, 4096, 16384, 32767, 32768)))
        if r.random() < 0.5:
            width = size.split()[-1] if len(size.split()) == 4 else b'8'
            width = int(width) & 0x7fff
            rows = [b'\2\2' + struct.pack('>H', width) + run(r, width) * 4 for _ in range(r.choice((1, 4)))]
            body = b''.join(rows)
    elif kind < 8:
        body = havoc(r, body)
    elif kind == 8:
        body = body[:r.randrange(len(body) + 1)]
    else:
        i = r.randrange(max(1, len(body) - 1))
        body = body[:i] + bytes((r.choice((0, 127, 128, 129, 255, 2)),)) * r.choice((1, 2, 100)) + body[i:]
    return head + size + body


def run(r, width):
    """Run lengths that come to a row, or do not."""
    out = bytearray()
    while width > 0:
        n = min(width, r.choice((1, 5, 127)))
        if r.random() < 0.5:
            out += bytes((128 + n, r.getrandbits(8)))
        else:
            out += bytes([n]) + bytes(n)
        width -= n
        if r.random() < 0.02:
            out += bytes((r.choice((0, 128, 255)), 1))
    return bytes(out)


# ---- OpenEXR ----

def exr_split(data):
    """(version, [(name, type, value)], offset table with chunks) of a file with one part."""
    attributes, at = [], 8
    while data[at] != 0:
        end = data.index(b'\0', at)
        name, at = data[at:end], end + 1
        end = data.index(b'\0', at)
        kind, at = data[at:end], end + 1
        size = struct.unpack_from('<I', data, at)[0]
        attributes.append((name, kind, data[at + 4:at + 4 + size]))
        at += 4 + size
    return data[4:8], attributes, data[at + 1:]


def exr_join(version, attributes, rest, r=None):
    out = [b'\x76\x2f\x31\x01', version]
    for name, kind, value in attributes:
        size = len(value)
        if r is not None and r.random() < 0.02:
            size = integer(r, size) & 0xffffffff
        out.append(name + b'\0' + kind + b'\0' + struct.pack('<I', size) + value)
    return b''.join(out) + b'\0' + rest


def exr_chunks(data, attributes, rest):
    """Re-made offset table: [(y, packed bytes)] and back."""
    first = len(data) - len(rest)
    count = struct.unpack_from('<Q', rest, 0)[0] - first if len(rest) >= 8 else 0
    if count <= 0 or count % 8 or count > len(rest):
        return None
    chunks, at = [], count
    while at + 8 <= len(rest):
        y, size = struct.unpack_from('<iI', rest, at)
        chunks.append((y, rest[at + 8:at + 8 + size]))
        at += 8 + size
    return chunks


def exr(r, data):
    try:
        return mutated_exr(r, data)
    except (ValueError, IndexError, struct.error):  # two changes that do not go together
        return havoc(r, data)


def mutated_exr(r, data):
    version, attributes, rest = exr_split(data)
    chunks = exr_chunks(data, attributes, rest)
    for _ in range(r.choice((1, 1, 2))):
        kind = r.randrange(14)
        i = r.randrange(len(attributes))
        name, what, value = attributes[i]
        if kind < 4:
            boxes = [j for j, a in enumerate(attributes) if a[1] == b'box2i']
            if boxes:
                i = r.choice(boxes)
                numbers = list(struct.unpack('<4i', attributes[i][2][:16])) if len(attributes[i][2]) >= 16 else [
                    0, 0, 7, 7]
                j = r.randrange(4)
                numbers[j] = (integer(r, numbers[j]) + (1 << 31)) % (1 << 32) - (1 << 31)
                attributes[i] = attributes[i][:2] + (struct.pack('<4i', *numbers),)
                if r.random() < 0.5:
                    attributes = [(a[0], a[1], attributes[i][2] if a[1] == b'box2i' else a[2]) for a in attributes]
        elif kind < 6:
            channels = [j for j, a in enumerate(attributes) if a[1] == b'chlist']
            if channels:
                attributes[channels[0]] = attributes[channels[0]][:2] + (channel_list(r, attributes[channels[0]][2]),)
        elif kind == 6:
            attributes = [(a[0], a[1], bytes([r.choice((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 255))])
                           if a[0] == b'compression' else a[2]) for a in attributes]
        elif kind == 7:
            attributes[i] = (name, what, havoc(r, value, 1))
        elif kind == 8:
            attributes[i] = (
                r.choice((name, b'x' * 300, b'type', b'tiles', b'name', b'chunkCount',
                          word(r).encode('utf-8', 'replace').replace(b'\0', b''))),
                r.choice((what, b'string', b'int', b'box2i', b'preview', b'tiledesc', b'')), value)
        elif kind == 9:
            attributes[i:i] = [
                r.choice(((b'tiles', b'tiledesc',
                           struct.pack('<IIB', integer(r, 8) & 0xffffffff, integer(r, 8) & 0xffffffff,
                                       r.choice((0, 1, 2, 16, 255)))),
                                         (b'preview', b'preview',
                                          struct.pack('<II', integer(r) & 0xffffffff, integer(r) & 0xffffffff)),
                                         (b'chunkCount', b'int', packed(integer(r), 4)),
                                         (b'type', b'string',
                                          r.choice((b'scanlineimage', b'tiledimage', b'deepscanline', b'deeptile',
                                                    b'x'))), attributes[i]))]
        elif kind == 10 and len(attributes) > 1:
            del attributes[i]
        elif kind == 11:
            version = packed(2 | r.choice((0, 0x200, 0x400, 0x800, 0x1000, 0x1200, 0xffff00, 1)), 4)
        elif chunks:
            j = r.randrange(len(chunks))
            y, body = chunks[j]
            how = r.randrange(6)
            if how == 0:
                body = zeros_packed(r.choice((1 << 20, 1 << 26)))
            elif how == 1:
                body = havoc(r, body, 3)
            elif how == 2:
                y = (integer(r, y) + (1 << 31)) % (1 << 32) - (1 << 31)
            elif how == 3:
                try:
                    body = zlib.compress(havoc(r, zlib.decompress(body)))
                except zlib.error:
                    body = b''
            elif how == 4:
                body = b''
            else:
                chunks = chunks * 2
            if how < 5:
                chunks[j] = (y, body)
    if chunks is not None and r.random() < 0.85:
        head = len(exr_join(version, attributes, b''))
        at, table, bodies = head + 8 * len(chunks), [], []
        for y, body in chunks:
            offset, size = at, len(body)
            if r.random() < 0.02:
                offset = integer(r, offset) & (1 << 64) - 1
            if r.random() < 0.02:
                size = integer(r, size) & 0xffffffff
            table.append(struct.pack('<Q', offset))
            bodies.append(struct.pack('<iI', y, size) + body)
            at += 8 + len(body)
        rest = b''.join(table) + b''.join(bodies)
    out = exr_join(version, attributes, rest, r)
    return havoc(r, out, 2) if r.random() < 0.08 else out


def channel_list(r, value):
    channels, at = [], 0
    while at < len(value) and value[at] != 0:
        end = value.index(b'\0', at)
        channels.append((value[at:end], value[end + 1:end + 17]))
        at = end + 17
    kind = r.randrange(6)
    if kind == 0 and channels:
        i = r.randrange(len(channels))
        channels[i] = (r.choice((b'', b'A', b'B', b'R', b'layer.R', b'x' * 300, b'\x1b[31m', b'validity.Y')),
                       channels[i][1])
    elif kind == 1 and channels:
        i = r.randrange(len(channels))
        channels[i] = (channels[i][0], field(r, channels[i][1], r.choice((0, 4, 8, 12)), 4))
    elif kind == 2:
        channels = channels * r.choice((2, 100, 1000))
    elif kind == 3:
        channels = channels[1:]
    elif kind == 4:
        channels += [(b'zz%d' % i, packed(r.choice((0, 1, 2)), 4) + bytes(4) + packed(1, 4) * 2)
                     for i in range(r.choice((1, 50, 2000)))]
    else:
        return havoc(r, value, 2)
    return b''.join(n + b'\0' + d for n, d in channels) + b'\0'


# ---- text ----

OBJ_WORDS = [b'v', b'vt', b'vn', b'f', b'o', b'g', b'usemtl', b'mtllib', b's', b'l', b'p', b'vp', b'curv', b'#', b'\\',
             b'call', b'csh']
MTL_WORDS = [b'newmtl', b'Kd', b'Ka', b'Ks', b'Ke', b'd', b'Tr', b'illum', b'Ns', b'Ni', b'map_Kd', b'map_Ke', b'map_d',
             b'bump', b'refl', b'-s', b'-o', b'-mm', b'-clamp', b'on', b'Tf', b'Pr', b'Pm', b'Pc', b'Pcr', b'aniso',
             b'anisor', b'map_Ks', b'map_Ns', b'map_Pr', b'map_Pm']


def token(r, words):
    kind = r.random()
    if kind < 0.25:
        return r.choice(words)
    if kind < 0.5:
        return str(integer(r, r.randrange(10))).encode()
    if kind < 0.65:
        return repr(r.choice(NUMBERS)).encode()
    if kind < 0.75:
        return r.choice((b'nan', b'inf', b'-inf', b'1e400', b'1e-400', b'0x1p3', b'1.', b'.', b'-', b'+1', b'1,5',
                         b'1' * 400, b'1e' + b'9' * 50))
    if kind < 0.85:
        return b'/'.join(str(integer(r, 3)).encode() if r.random() < 0.7 else b'' for _ in range(r.randint(1, 4)))
    return word(r).encode('utf-8', 'surrogatepass')


def lines(r, data, words):
    """Text of lines with words: words, lines and their ends are changed."""
    rows = data.split(b'\n')
    for _ in range(r.choice((1, 1, 2, 4))):
        kind, i = r.randrange(10), r.randrange(len(rows))
        row = rows[i].split(b' ')
        j = r.randrange(len(row))
        if kind < 4:
            row[j] = token(r, words)
            rows[i] = b' '.join(row)
        elif kind == 4:
            row[j:j] = [token(r, words)]
            rows[i] = b' '.join(row)
        elif kind == 5:
            del row[j]
            rows[i] = b' '.join(row)
        elif kind == 6:
            rows[i:i] = [b' '.join(token(r, words) for _ in range(r.randint(0, 6)))]
        elif kind == 7:
            rows[i:i] = [rows[i]] * r.choice((1, 10, 3000))
        elif kind == 8:
            rows[i] = rows[i] + r.choice((b' ', b'\t', b'\r', b'\\', b'\0', b' \\\n', b'\xff', b' ' * 70000)) + (
                row[j] if r.random() < 0.5 else b'')
        else:
            del rows[i]
            if not rows:
                rows = [b'']
    out = b'\n'.join(rows)
    return havoc(r, out, 2) if r.random() < 0.05 else out


def obj(r, data):
    return lines(r, data, OBJ_WORDS)


def mtl(r, data):
    return lines(r, data, MTL_WORDS)


YAML_VALUES = ['[', ']', '{}', '{a: 1}', '[1, 2', '&a [*a, *a]', '*a', '!!binary x', '!x y', '| \n  a\n', '"\\x00"',
               '"\\e[31m"', "'", '- a', '? a', '~', '.nan', '.inf', '0o17',
               '0x10', '1_000', '1e5', '-0', '1e400', 'yes', 'no', 'on', 'off', '%YAML 9.9', '--- ', '...', '<<: *a',
               '@', '`', '\t', '# c', '12:30:45', '2020-01-01']


def yaml(r, data, keys):
    rows = data.decode().split('\n')
    for _ in range(r.choice((1, 1, 2, 4))):
        kind, i = r.randrange(10), r.randrange(len(rows))
        name, _, value = rows[i].partition(':')
        new = r.choice((str(integer(r)), repr(r.choice(NUMBERS)), word(r), r.choice(YAML_VALUES),
                        r.choice(YAML_VALUES)))
        if kind < 3:
            rows[i] = '%s: %s' % (name, new)
        elif kind < 6:
            rows[i:i] = ['%s: %s' % (r.choice(keys), new)]
        elif kind == 6:
            rows[i:i] = [rows[i]] * r.choice((1, 2, 1000))
        elif kind == 7:
            rows[i] = r.choice((' ', '  ', '\t', '- ', '? ')) + rows[i]
        elif kind == 8:
            rows[i:i] = r.choice((['a: &a [x, x]', 'b: &b [*a, *a, *a]', 'c: [*b, *b, *b, *b]'], ['[' * 3000],
                                  ['- ' * 3000], ['{a: ' * 2000], ['objects: {%s: {%s: %s}}' % (
                r.choice(('"*"', 'x', '"[a"', '"' + '*' * 50 + '"')),
                r.choice(('density-scale', 'lightmap-size', 'exclude', 'role', 'sides', 'q')), new)],
                                  ['scene: %s' % word(r)]))
        else:
            del rows[i]
            if not rows:
                rows = ['']
    out = '\n'.join(rows).encode('utf-8', 'surrogatepass')
    return havoc(r, out, 3) if r.random() < 0.15 else out
