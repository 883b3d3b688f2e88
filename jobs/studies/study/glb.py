"""Writes small .glb scenes for studies and tests: quads, boxes and balls with a lightmap layout, diffuse materials and
others, punctual lights."""
import json
import math
import struct

import numpy as np


class Scene:
    def __init__(self):
        self.blob = bytearray()
        self.document = {'asset': {'version': '2.0', 'generator': 'kiln studies'}, 'scene': 0,
                         'scenes': [{'nodes': []}], 'nodes': [],
                         'meshes': [], 'materials': [], 'accessors': [], 'bufferViews': []}
        self.used = set()

    def load(self, path):
        """Begins with what a .glb holds."""
        with open(path, 'rb') as f:
            data = f.read()
        length = struct.unpack_from('<I', data, 12)[0]
        self.document = json.loads(data[20:20 + length])
        self.blob = bytearray(data[28 + length:28 + length + self.document['buffers'][0]['byteLength']])
        self.used = set(self.document.get('extensionsUsed', []))

    def environment(self, radiance):
        self.document['scenes'][0]['extras'] = {'environment': {'type': 'constant', 'radiance': list(radiance)}}

    def material(self, name, albedo=(0, 0, 0), radiance=(0, 0, 0), double_sided=False):
        """Diffuse, and `radiance` (W/m2/sr) leaving its front. Returns its number."""
        material = {'name': name, 'doubleSided': double_sided, 'pbrMetallicRoughness': {
            'baseColorFactor': [*map(float, albedo), 1.0], 'metallicFactor': 0.0, 'roughnessFactor': 1.0}}
        strongest = max(radiance)
        if strongest > 0:
            material['emissiveFactor'] = [float(c) / strongest for c in radiance]
            material['extensions'] = {'KHR_materials_emissive_strength': {'emissiveStrength': float(strongest)}}
            self.used.add('KHR_materials_emissive_strength')
        self.document['materials'].append(material)
        return len(self.document['materials']) - 1

    def accessor(self, array, kind, component, target):
        while len(self.blob) % 4:
            self.blob.append(0)
        raw = np.ascontiguousarray(array).tobytes()
        self.document['bufferViews'].append({'buffer': 0, 'byteOffset': len(self.blob), 'byteLength': len(raw),
                                             'target': target})
        self.blob += raw
        accessor = {'bufferView': len(self.document['bufferViews']) - 1, 'componentType': component,
                    'count': int(np.size(array) // {
            'SCALAR': 1, 'VEC2': 2, 'VEC3': 3}[kind]), 'type': kind}
        self.document['accessors'].append(accessor)
        return len(self.document['accessors']) - 1

    def mesh(self, name, positions, layout, triangles, material, **transform):
        """One mesh and one node of the same name, with a glTF transform. `positions` (n, 3), `layout` (n, 2) in 0..1,
        `triangles` (m, 3)."""
        positions = np.asarray(positions, np.float32)
        triangles = np.asarray(triangles, np.uint32)
        normals = np.zeros_like(positions, np.float64)
        for a, b, c in triangles:
            n = np.cross(positions[b].astype(float) - positions[a], positions[c].astype(float) - positions[a])
            length = np.linalg.norm(n)
            for corner in (a, b, c):
                normals[corner] += n / length if length > 0 else (0, 1, 0)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        position = self.accessor(positions, 'VEC3', 5126, 34962)
        self.document['accessors'][position]['min'] = [float(x) for x in np.fmin.reduce(positions)]
        self.document['accessors'][position]['max'] = [float(x) for x in np.fmax.reduce(positions)]
        layout = np.asarray(layout, np.float32)
        attributes = {'POSITION': position, 'NORMAL': self.accessor(normals.astype(np.float32), 'VEC3', 5126, 34962),
                      'TEXCOORD_0': self.accessor(layout, 'VEC2', 5126, 34962),
                      'TEXCOORD_1': self.accessor(layout, 'VEC2', 5126, 34962)}
        self.document['meshes'].append({'name': name, 'primitives': [{
            'attributes': attributes, 'indices': self.accessor(triangles.ravel(), 'SCALAR', 5125, 34963),
            'material': material,
            'mode': 4}]})
        self.node({'name': name, 'mesh': len(self.document['meshes']) - 1, **transform})

    def quad(self, name, corners, material, layout=((0, 1), (1, 1), (1, 0), (0, 0)), cuts=1):
        """A parallelogram, corners counter-clockwise seen from its front, cut `cuts` x `cuts`."""
        corners, layout = np.asarray(corners, float), np.asarray(layout, float)
        positions, uv, triangles = [], [], []
        for j in range(cuts + 1):
            for i in range(cuts + 1):
                s, t = i / cuts, j / cuts
                positions.append(corners[0] + s * (corners[1] - corners[0]) + t * (corners[3] - corners[0]))
                uv.append(layout[0] + s * (layout[1] - layout[0]) + t * (layout[3] - layout[0]))
        for j in range(cuts):
            for i in range(cuts):
                a = j * (cuts + 1) + i
                triangles += [(a, a + 1, a + cuts + 2), (a, a + cuts + 2, a + cuts + 1)]
        self.mesh(name, positions, uv, triangles, material)

    def node(self, node):
        self.document['nodes'].append(node)
        self.document['scenes'][0]['nodes'].append(len(self.document['nodes']) - 1)

    def light(self, name, light, **transform):
        """A light of KHR_lights_punctual on a node of its own."""
        self.used.add('KHR_lights_punctual')
        lights = self.document.setdefault('extensions', {}).setdefault('KHR_lights_punctual', {'lights': []})['lights']
        lights.append(light)
        self.node({'name': name, 'extensions': {'KHR_lights_punctual': {'light': len(lights) - 1}}, **transform})

    def write(self, path):
        document = {k: v for k, v in self.document.items() if v != []}
        if self.used:
            document['extensionsUsed'] = sorted(self.used)
        while len(self.blob) % 4:
            self.blob.append(0)
        if self.blob:
            document['buffers'] = [{'byteLength': len(self.blob)}]
        text = json.dumps(document, separators=(',', ':')).encode()
        text += b' ' * (-len(text) % 4)
        chunks = struct.pack('<II', len(text), 0x4E4F534A) + text
        if self.blob:
            chunks += struct.pack('<II', len(self.blob), 0x004E4942) + bytes(self.blob)
        with open(path, 'wb') as f:
            f.write(struct.pack('<III', 0x46546C67, 2, 12 + len(chunks)) + chunks)
        return path


FACES = [((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)), ((1, 0, 0), (0, 0, 0), (0, 1, 0), (1, 1, 0)),
         ((1, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1)),
         ((0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)), ((0, 1, 1), (1, 1, 1), (1, 1, 0), (0, 1, 0)),
         ((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1))]


def box(scene, name, low, high, material, inward=()):
    """One mesh of six quads that face outwards, but for those listed; each has a cell of a layout of 3 x 2."""
    low, high = np.array(low, float), np.array(high, float)
    positions, layout, triangles = [], [], []
    for i, face in enumerate(FACES):
        corners = [low + np.array(c) * (high - low) for c in face]
        a = len(positions)
        positions += corners
        u, v = i % 3 / 3, i // 3 / 2
        layout += [(u + s * 0.9 / 3 + 0.05 / 3, v + t * 0.9 / 2 + 0.05 / 2) for s,
                   t in ((0, 1), (1, 1), (1, 0), (0, 0))]
        order = [(a, a + 1, a + 2), (a, a + 2, a + 3)]
        triangles += [t[::-1] for t in order] if i in inward else order
    # every face has corners of its own, so that normals are flat and a winding can be turned alone
    scene.mesh(name, positions, layout, triangles, material)


GLASS = {"transmission": {"transmissionFactor": 1.0}, "volume": {"thicknessFactor": 0.1}}


def gloss(scene, name, color=(1, 1, 1), metallic=0.0, roughness=0.0, **extensions):
    """A material, with KHR_materials_... by their last words. Returns its number."""
    number = scene.material(name, color)
    material = scene.document["materials"][number]
    material["pbrMetallicRoughness"].update(metallicFactor=metallic, roughnessFactor=roughness)
    for word, values in extensions.items():
        material.setdefault("extensions", {})["KHR_materials_" + word] = values
        scene.used.add("KHR_materials_" + word)
    return number


def ball(scene, name, centre, radius, material, rings=24):
    """Smooth, of latitudes and longitudes."""
    points, triangles = [], []
    for i in range(rings + 1):
        for k in range(2 * rings):
            a, b = math.pi * i / rings, math.pi * k / rings
            points.append((centre[0] + radius * math.sin(a) * math.cos(b), centre[1] + radius * math.cos(a),
                           centre[2] - radius * math.sin(a) * math.sin(b)))
    for i in range(rings):
        for k in range(2 * rings):
            a, b = i * 2 * rings + k, i * 2 * rings + (k + 1) % (2 * rings)
            c, d = a + 2 * rings, b + 2 * rings
            triangles += [(a, c, d)] * (i < rings - 1) + [(a, d, b)] * (i > 0)
    scene.mesh(name, points, np.array(points)[:, :2] * 0.1 + 0.5, triangles, material)


def partition_room(path, twin):
    """A room whose middle wall, with a door in it, is one double-sided quad or two single-sided ones back to back; a
    lamp on one side."""
    scene = Scene()
    white = scene.material('white', (0.7, 0.6, 0.5))
    lamp = scene.material('lamp', (0, 0, 0), (20, 20, 20))
    middle = scene.material('middle', (0.7, 0.3, 0.6), double_sided=not twin)
    box(scene, 'room', (-2, 0, -1), (2, 2, 1), white, range(6))
    scene.quad('lamp', [(-1.2, 1.95, -0.2), (-0.8, 1.95, -0.2), (-0.8, 1.95, 0.2), (-1.2, 1.95, 0.2)], lamp)
    gap = 1e-4 if twin else 0.0
    scene.quad('lit', [(-gap, 0, -1), (-gap, 0, 0.4), (-gap, 2, 0.4), (-gap, 2, -1)], middle)
    if twin:
        scene.quad('dark', [(gap, 0, 0.4), (gap, 0, -1), (gap, 2, -1), (gap, 2, 0.4)], middle)
    return scene.write(path)


def without_normals(path, copy):
    """Writes the scene without its normals, which glTF defines as flat: what closed forms of facets are about."""
    scene = Scene()
    scene.load(path)
    for mesh in scene.document['meshes']:
        for primitive in mesh['primitives']:
            primitive['attributes'].pop('NORMAL', None)
    return scene.write(copy)


def with_few_texels(path, copy, kept, share):
    """Writes the scene with the lightmap layouts of all meshes but those of the nodes called `kept` scaled by `share`:
    for what only casts shadows."""
    scene = Scene()
    scene.load(path)
    meshes, views = scene.document['meshes'], scene.document['bufferViews']
    whole = {node['mesh'] for node in scene.document['nodes'] if node.get('name') in kept}
    layouts = lambda mesh: {p['attributes'].get('TEXCOORD_1', p['attributes']['TEXCOORD_0'])
                            for p in mesh['primitives']}
    spared = set().union(*(layouts(meshes[i]) for i in whole))
    for index in set().union(*(layouts(m) for m in meshes)) - spared:
        accessor = scene.document['accessors'][index]
        at = views[accessor['bufferView']].get('byteOffset', 0) + accessor.get('byteOffset', 0)
        size = 8 * accessor['count']
        scene.blob[at:at +
                   size] = (np.frombuffer(bytes(scene.blob[at:at + size]), np.float32) * np.float32(share)).tobytes()
        accessor.pop('min', None), accessor.pop('max', None)
    return scene.write(copy)
