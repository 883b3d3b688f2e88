"""What an exported scene is held to, against its source and the bake's scene file; with numpy alone, independent of
kiln."""
import json
import os
import struct
import sys

import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import exr  # noqa: E402
import gltf_file  # noqa: E402

NONE = 0xffffffff
VERSIONS, HEADER = (3, 4, 5), 136  # of the scene file; later ones only have more sections
SECTIONS = ['strings', 'materials', 'textures', 'texels', 'meshes', 'objects', 'lights', 'cameras', 'environment',
            'environment_texels', 'positions',
            'normals', 'texcoord_base', 'texcoord_emission', 'texcoord_lightmap', 'colors', 'triangles',
            'triangle_materials', 'sources', 'notes',
            'triangle_sources']
TYPES = {
    'meshes': np.dtype([('name', '<u4'), ('flags', '<u4'), ('vertex', '<u8', 2), ('triangle', '<u8', 2),
                        ('area', '<f8', 2)]),
    'objects': np.dtype([('name', '<u4'), ('mesh', '<u4'), ('transform', '<f8', 12), ('size', '<u4', 2),
                         ('flipped', '<u4'), ('original', '<u4'),
                         ('node', '<u4'), ('source_mesh', '<u4'), ('flags', '<u4'), ('reason', '<u4'),
                         ('instance', '<u4'), ('unused', '<u4')]),
    'positions': np.dtype(('<f4', 3)), 'texcoord_lightmap': np.dtype(('<f4', 2)), 'triangles': np.dtype(('<u4', 3)),
}


class SceneFile:
    """The parts of a scene.kscene that say what was baked."""

    def __init__(self, path):
        with open(path, 'rb') as file:
            data = file.read()
        magic, version = struct.unpack_from('<II', data)
        assert magic == 0x4e434b4c and version in VERSIONS, 'another version of the scene file'
        places = struct.unpack_from('<%dQ' % (2 * len(SECTIONS)), data, HEADER)
        for i, name in enumerate(SECTIONS):
            if name in TYPES:
                setattr(self, name, np.frombuffer(data, TYPES[name], places[2 * i + 1], places[2 * i]))
        self.strings = data[places[0]:places[0] + places[1]]

    def string(self, at):
        return self.strings[at:self.strings.index(b'\0', at)].decode()

    def triangles_of(self, mesh):
        """[triangles, 3, 5]: each corner's position and lightmap coordinate."""
        m = self.meshes[mesh]
        corners = self.triangles[m['triangle'][0]:m['triangle'][0] + m['triangle'][1]].astype(np.int64) + int(
            m['vertex'][0])
        return np.concatenate([self.positions[corners] + np.float32(0), self.texcoord_lightmap[corners]], 2)


def has_area(corners):
    """Of float32 triangles, as the importer decides it."""
    p = corners.astype(np.float64)
    a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    longest = np.max([(a * a).sum(-1), (b * b).sum(-1), ((b - a) ** 2).sum(-1)], 0)
    return np.linalg.norm(np.cross(a, b), axis=-1) > 1e-12 * longest


def _sorted(triangles):
    """Rows of triangles in an order that does not depend on where a triangle begins."""
    rows = np.stack([np.roll(triangles, k, 1).reshape(len(triangles), -1) for k in range(3)], 1).view(np.uint32)
    least = np.array([min(r.tolist() for r in three) for three in rows], np.uint32).reshape(len(triangles), -1)
    return least[np.lexsort(least.T[::-1])]


def _exported_triangles(file, mesh, coordinate):
    parts = []
    for primitive in file.json['meshes'][mesh]['primitives']:
        corners = file.corners(primitive)
        positions = file.floats(primitive['attributes']['POSITION']).astype(np.float32)[corners] + np.float32(0)
        uv = file.floats(primitive['attributes']['TEXCOORD_%d' % coordinate]).astype(np.float32)[corners] if len(
            corners) else np.zeros((0, 3, 2), np.float32)
        parts.append(np.concatenate([positions, uv], 2)[has_area(positions)])
    return np.concatenate(parts)


def check_against_bake(file, scene, moved=False):
    """Every triangle that was baked is there, once, with its coordinates (unless those were `moved`, to an atlas);
    links are on the right nodes. Returns how many links."""
    links, meshes = 0, {}
    for index, o in enumerate(scene.objects):
        node = file.json['nodes'][o['node']]
        link = node['extensions']['KILN_lightmap']
        if isinstance(node.get('extras', {}), dict):
            assert node['extras']['kiln_lightmap'] == link, 'the extras say something else'
        if o['instance'] != NONE:
            link = link['instances'][o['instance']]
        assert link['source'] == {'node': o['node'], 'mesh': o['source_mesh']}
        assert node['mesh'] == o['source_mesh']
        page = file.json['extensions']['KILN_lightmap']['pages'][link['page']]
        assert page['file'] == link['file'] and page['encoding'] == link['encoding']
        meshes[int(o['source_mesh'])] = (int(o['mesh']), link['texCoord'])
        links += 1
    for source_mesh, (mesh, coordinate) in meshes.items():
        there, baked = _exported_triangles(file, source_mesh, coordinate), scene.triangles_of(mesh)
        if moved:
            there[..., 3:] = baked[..., 3:] = 0
        assert len(there) == len(baked), 'mesh %d: %d triangles, %d were baked' % (source_mesh, len(there), len(baked))
        assert (_sorted(there) == _sorted(baked)).all(), 'mesh %d: triangles differ from what was baked' % source_mesh
    used = file.json['extensionsUsed']
    assert used.count('KILN_lightmap') == 1 and 'KILN_lightmap' not in file.json.get('extensionsRequired', [])
    return links


def _without(value, *keys):
    return {k: v for k, v in value.items() if k not in keys}


def _same_but(a, b, keys, what):
    assert _without(a, *keys) == _without(b, *keys), '%s differ' % what


def _clean(node):
    """A node without what kiln adds."""
    node = json.loads(json.dumps(node))
    for part, names in (('extensions', ['KILN_lightmap']), ('extras', ['kiln_lightmap', 'kiln_baked'])):
        for name in names:
            if isinstance(node.get(part), dict):
                node[part].pop(name, None)
                if not node[part]:
                    del node[part]
    return node


def check_against_source(file, source):
    """All that the source has is as it was, corner by corner and byte by byte. Returns how many attributes were
    compared."""
    a, b = source.json, file.json
    for key in set(a) | set(b):
        if key not in ('accessors', 'bufferViews', 'buffers', 'meshes', 'nodes', 'images', 'extensions',
                       'extensionsUsed'):
            assert a.get(key) == b.get(key), '%s differ' % key
    _same_but(a.get('extensions', {}), b['extensions'], ['KILN_lightmap'], 'extensions')
    assert set(b['extensionsUsed']) == set(a.get('extensionsUsed', [])) | {'KILN_lightmap'}
    assert len(a.get('nodes', [])) == len(b.get('nodes', []))
    for i, (x, y) in enumerate(zip(a.get('nodes', []), b.get('nodes', []))):
        assert _clean(x) == _clean(y), 'node %d differs' % i
    for i, (x, y) in enumerate(zip(a.get('images', []), b.get('images', []))):
        _same_but(x, y, ['uri', 'bufferView', 'mimeType'], 'image %d' % i)
        assert source.image(i) == file.image(i), 'the bytes of image %d differ' % i
    compared = 0
    for m, (x, y) in enumerate(zip(a.get('meshes', []), b.get('meshes', []))):
        _same_but(x, y, ['primitives'], 'mesh %d' % m)
        for p, q in zip(x['primitives'], y['primitives']):
            _same_but(p, q, ['attributes', 'indices', 'mode', 'targets'], 'a primitive of mesh %d' % m)
            before, after = source.corners(p), file.corners(q)
            assert len(before) == len(after)
            sets = [(p['attributes'], q['attributes'])] + list(zip(p.get('targets', []), q.get('targets', [])))
            for old, new in sets:
                for name, accessor in old.items():
                    if name == 'TEXCOORD_1':
                        continue
                    u, v = source.json['accessors'][accessor], file.json['accessors'][new[name]]
                    assert [u.get(k) for k in ('componentType', 'type', 'normalized')] == [
                        v.get(k) for k in ('componentType', 'type', 'normalized')]
                    assert source.accessor(accessor)[before].tobytes() == file.accessor(new[name])[
                        after].tobytes(), '%s of mesh %d' % (name, m)
                    compared += 1
    return compared


# ---- atlases ----

def bilinear(image, uv):
    """What a sampler that clamps at the edge reads of image [height, width, 3] at uv [n, 2]; and how far the texels
    that it mixes lie apart."""
    size = np.array(image.shape[1::-1])
    at = np.clip(uv * size - 0.5, 0, size - 1)
    low = np.minimum(at.astype(np.int64), size - 1)
    high, f = np.minimum(low + 1, size - 1), at - low
    texels = [image[y, x].astype(np.float64) for y in (low[:, 1], high[:, 1]) for x in (low[:, 0], high[:, 0])]
    fx, fy = f[:, :1], f[:, 1:]
    value = (texels[0] * (1 - fx) + texels[1] * fx) * (1 - fy) + (texels[2] * (1 - fx) + texels[3] * fx) * fy
    return value, np.max(texels, 0) - np.min(texels, 0)


def _kept(path):
    """Texels of a lightmap that its layout covers, and their neighbours."""
    channels, _ = exr.read(path)
    covered = np.pad((channels['coverage.Y'] > 0) | (channels['validity.Y'] > 0.25), 2)
    rows = covered | np.roll(covered, 1, 0) | np.roll(covered, -1, 0)
    return int((rows | np.roll(rows, 1, 1) | np.roll(rows, -1, 1)).sum())


def _page_uv(file, node, instance):
    link = file.json['nodes'][node]['extensions']['KILN_lightmap']
    link = link['instances'][instance] if instance != NONE else link
    parts = [file.floats(p['attributes']['TEXCOORD_%d' % link['texCoord']])[file.corners(p)]
             for p in file.json['meshes'][file.json['nodes'][node]['mesh']]['primitives']]
    return link, np.concatenate(parts) * link['scale'] + link['offset']


def check_atlas(directory, path, samples, seed=1):
    """At random points of every object, on edges of triangles and at their corners too, the page's texels, read
    bilinearly, are what the bake's own lightmap says there. Returns (share of the pages that is kept, points
    compared)."""
    random = np.random.default_rng(seed)
    own, file, scene = gltf_file.File(os.path.join(directory, 'scene.glb')), gltf_file.File(path), SceneFile(
        os.path.join(directory, 'scene.kscene'))
    check_against_bake(file, scene, moved=True)
    pages = file.json['extensions']['KILN_lightmap']['pages']
    images = [exr.rgb(os.path.join(os.path.dirname(path), page['file'])) for page in pages]
    assert [i.shape[:2] for i in images] == [(p['height'], p['width']) for p in pages]
    kept = compared = 0
    for o in scene.objects:
        before, uv = _page_uv(own, o['node'], o['instance'])
        after, page_uv = _page_uv(file, o['node'], o['instance'])
        lightmap = os.path.join(directory, before['file'])
        kept += _kept(lightmap)
        positions = np.concatenate([own.floats(p['attributes']['POSITION']).astype(np.float32)[own.corners(p)]
                                    for p in own.json['meshes'][o['source_mesh']]['primitives']])
        triangle = random.choice(np.flatnonzero(has_area(positions)), samples)
        weights = random.dirichlet([1, 1, 1], samples)
        weights[::3, 0] = 0  # edges
        weights[::9, 1] = 0  # corners
        weights /= weights.sum(1, keepdims=True)
        mixed = lambda coordinates: (coordinates[triangle] * weights[:, :, None]).sum(1)
        wanted, apart = bilinear(exr.rgb(lightmap), mixed(uv))
        found, _ = bilinear(images[after['page']], mixed(page_uv))
        assert (abs(found - wanted) <= 1e-3 * apart + 1e-6 * wanted.max() + 1e-30).all(), before['file']
        compared += samples
    return kept / sum(i.shape[0] * i.shape[1] for i in images), compared
