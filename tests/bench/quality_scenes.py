"""The nine scenes of quality.py and their light: two that kiln generates, and seven files that are looked for by name
in folders of third-party scenes.

Nobody has tuned kiln to the last two. They are not in ../shared: "Apartment layout of a dream house" by Maxim Lukyanov
and "Hotel Room Ege Carpets Lotus Wave Grey" by Aaron Openshaw (both CC BY 4.0, sketchfab.com), in the repository
gkjohnson/3d-demo-data as models/dream-apartment/dream-apartment.glb and models/hotel-room-lotus-carpet/scene.glb. The
bench wants them as dream_apartment.glb and hotel_room.glb.
"""
import json
import os
import struct

import numpy as np

import measure

SKY = ('--environment', '1,1,1')
LAMP = {'at': (1.5, 2.9, 0.3), 'size': (0.3, 0.2, 0.3), 'radiance': 12.0}
WHITE = 0.8  # what the hotel's white paints reflect: all of the light in the file, in which bounces have no end


class Scene:
    """`title` and `light` are words for the table. A scene is generated, or `file` is looked for; `prepare` makes the
    scene that is baked, and more options, of it."""

    def __init__(self, title, light, generated=(), file=None, options=(), prepare=None):
        self.title, self.light, self.generated, self.file = title, light, generated, file
        self.options, self.prepare = options, prepare

    def ready(self, kiln, folders):
        """(path, options), or None where no folder has the file."""
        if self.generated:
            return measure.made(kiln, *self.generated), self.options
        for folder in folders:
            path = os.path.join(folder, self.file)
            if os.path.exists(path):
                return self.prepare(kiln, path) if self.prepare else (path, self.options)
        return None


def written(kiln, name, content):
    path = os.path.join(kiln.scratch, name)
    with open(path, 'wb') as file:
        file.write(content)
    return path


def with_lamp(kiln, path):
    """The scene of one buffer at `path`, and a box that shines, in an evening with little light outside."""
    with open(path, 'rb') as file:
        data = file.read()
    length = struct.unpack_from('<I', data, 12)[0]
    gltf, binary = json.loads(data[20:20 + length]), bytearray(data[28 + length:])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.array(LAMP['size']) / 2
    positions = (corners + LAMP['at']).astype(np.float32)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    indices = np.array([(a, b, c, a, c, d) for a, b, c, d in sides], np.uint16).ravel()
    for array, kind, component in ((positions, 'VEC3', 5126), (indices, 'SCALAR', 5123)):
        binary += b'\0' * (-len(binary) % 4)
        gltf['bufferViews'].append({'buffer': 0, 'byteOffset': len(binary), 'byteLength': array.nbytes})
        gltf['accessors'].append({'bufferView': len(gltf['bufferViews']) - 1, 'componentType': component,
                                  'count': len(array), 'type': kind})
        binary += array.tobytes()
    bounds = gltf['accessors'][-2]
    bounds['min'], bounds['max'] = positions.min(0).tolist(), positions.max(0).tolist()
    gltf['materials'].append({'name': 'lamp', 'emissiveFactor': [1, 0.85, 0.65], 'extensions': {
        'KHR_materials_emissive_strength': {'emissiveStrength': LAMP['radiance']}}})
    gltf.setdefault('extensionsUsed', []).append('KHR_materials_emissive_strength')
    count = len(gltf['accessors'])
    gltf['meshes'].append({'primitives': [{'attributes': {'POSITION': count - 2}, 'indices': count - 1,
                                           'material': len(gltf['materials']) - 1}]})
    gltf['nodes'].append({'name': 'lamp', 'mesh': len(gltf['meshes']) - 1})
    gltf['scenes'][0]['nodes'].append(len(gltf['nodes']) - 1)
    binary += b'\0' * (-len(binary) % 4)
    gltf['buffers'][0]['byteLength'] = len(binary)
    text = json.dumps(gltf).encode()
    text += b' ' * (-len(text) % 4)
    content = (struct.pack('<4sIIII', b'glTF', 2, 28 + len(text) + len(binary), len(text), 0x4e4f534a) + text
               + struct.pack('<II', len(binary), 0x004e4942) + bytes(binary))
    return written(kiln, 'living_room_lamp.glb', content), ('--environment', '0.1,0.12,0.15')


def with_paint(kiln, path):
    """The hotel room with white that is no mirror, under a sky."""
    paint = {'materials': {name: {'albedo': [WHITE] * 3} for name in ('FrontColor', 'material')}}
    return path, (*SKY, '--changes', written(kiln, 'hotel_room.yaml', json.dumps(paint).encode()))


SCENES = {
    'cornell': Scene('Cornell box', 'its lamp', generated=('cornell',)),
    'rooms': Scene('six rooms', 'their lamps', generated=('rooms', '--columns', 3, '--rows', 2)),
    'dining_room': Scene('dining room', 'its sun and sky', file='dining_room.glb'),
    'classroom': Scene('classroom', 'its sun and sky', file='classroom.glb'),
    'door_ajar': Scene('door ajar', 'its lamp', file='veach_ajar.glb'),
    'sponza': Scene('Sponza', 'its sun', file='crytek_sponza.glb'),
    'living_room': Scene('living room', 'a lamp, added', file='godot_living_room.glb', prepare=with_lamp),
    'dream_apartment': Scene('apartment', 'a sky of 1,1,1', file='dream_apartment.glb', options=SKY),
    'hotel_room': Scene('hotel room', 'a sky of 1,1,1', file='hotel_room.glb', prepare=with_paint),
}
