"""Whatever kiln reads, one row each in READERS: how a case of it is made, and the command that reads it.

A case is a folder, `case` in the work folder, that holds all that the command may read, and `given`, where it may
write. make(r, w) writes the files and returns the arguments of kiln."""
import base64
import ctypes
import glob
import json
import os
import re
import shutil
import struct
import subprocess
import sys

import numpy as np

import formats
import hdf5

HERE = os.path.dirname(os.path.abspath(__file__))
REPOSITORY = os.path.dirname(os.path.dirname(HERE))
sys.path.insert(0, os.path.join(REPOSITORY, 'tests', 'common'))
import exr as exr_file  # noqa: E402
import glb as glb_file  # noqa: E402

SMALL = ('--lightmap-size', '4')
BAKE = ('--backend', 'embree', '--lightmap-size', '4', '--samples-direct', '1', '--samples-bounce', '2',
        '--samples-indirect', '2', '--bounces', '2', '--samples-probe', '2',
        '--probe-spacing', '0.5', '--error-map', '--no-preview', '--threads', '1', '--quiet', '--watchdog', '0')
# of a bake that keeps its transport, and of one by radiosity, which has links
KEPT = ('--backend', 'embree', '--lightmap-size', '4', '--bounces', '2', '--samples-probe', '2', '--probe-spacing',
        '0.5', '--no-preview', '--no-export', '--threads', '1', '--quiet', '--watchdog', '0')
ROWS = (*KEPT, '--samples-direct', '1', '--samples-bounce', '2', '--samples-indirect', '2', '--photons', '500',
        '--iterations', '2', '--keep-transport', 'rows') # its mirror would else have 16 times as many light paths
LINKS = (*KEPT, '--method', 'radiosity', '--materials', 'diffuse', '--patches', 'links',
         '--keep-transport', 'links')
SINGLES = [x for x in formats.NUMBERS if abs(x) < 3.4e38] + [float('inf'), float('-inf'), float('nan')]
GROUPED = (*(o for o in BAKE if o != '--error-map'), '--materials', 'diffuse')
# as trees of JSON, which is YAML, too
GROUPS = {'lamps': {'materials': ['lamp']}, 'suns': {'lights': ['sun']}}
CHANGES = {'lights': {'sun': {'on': True, 'scale': 0.5, 'intensity': [100, 50, 25]}},
           'materials': {'white': {'albedo': [0.5, 0.4, 0.3]}, 'lamp': {'emission': [1, 2, 3], 'emission-scale': 2}},
           'environment': {'radiance': [1, 1, 1], 'scale': 2, 'rotation': 30}}
STATES = {'day': {'lights': {'sun': {'scale': 2}}},
          'night': {'lights': {'sun': {'on': False}}, 'environment': {'scale': 0}}}
SECTIONS = ('strings', 'materials', 'textures', 'texels', 'meshes', 'objects', 'lights', 'cameras', 'environment',
            'environment texels', 'positions', 'normals',
            'base', 'emission', 'lightmap', 'colors', 'triangles', 'triangle materials', 'sources', 'notes',
            'triangle sources', 'normal maps', 'texcoord normal', 'gloss', 'texcoord gloss')
# 1 x 1 pixel, a normal map without bumps
FLAT_PNG = 'iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGNoaPgPAAODAgAApfuJAAAAAElFTkSuQmCC'
# sizes in a scene file: of the header, by version, and of what stands before its table of sections
HEADERS, SECTION_TABLE = {3: 472, 4: 504, 5: 536}, 136


class Hash128(ctypes.Structure):
    _fields_ = [('low', ctypes.c_uint64), ('high', ctypes.c_uint64)]


XXHASH = ctypes.CDLL('libxxhash.so.0')
XXHASH.XXH3_128bits.restype = Hash128
XXHASH.XXH3_128bits.argtypes = (ctypes.c_char_p, ctypes.c_size_t)
XXHASH.XXH3_64bits.restype = ctypes.c_uint64
XXHASH.XXH3_64bits.argtypes = (ctypes.c_char_p, ctypes.c_size_t)
XXHASH.XXH3_64bits_withSeed.restype = ctypes.c_uint64
XXHASH.XXH3_64bits_withSeed.argtypes = (ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint64)
XXHASH.XXH3_128bits_withSeed.restype = Hash128
XXHASH.XXH3_128bits_withSeed.argtypes = (ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint64)


def xxh3(data):
    value = XXHASH.XXH3_128bits(data, len(data))
    return '%016x%016x' % (value.high, value.low)


def seal(text):
    """JSON with its hash as the last line (coordinator/files/checksummed_json.h)."""
    text = text if text.endswith(b'\n') else text + b'\n'
    return text + b'xxh3_128 ' + xxh3(text).encode() + b'\n'


def unseal(data):
    return data[:data.rindex(b'xxh3_128 ')]


def seal_scene(data):
    """A scene file whose size and hash are right (kiln_scene_content_hash)."""
    header = HEADERS.get(struct.unpack_from('<I', data.ljust(8), 4)[0], max(HEADERS.values()))
    if len(data) < header:
        return data
    data = data[:8] + struct.pack('<Q', len(data)) + bytes(16) + data[32:]
    rest = data[header:]
    value = XXHASH.XXH3_128bits_withSeed(rest, len(rest), XXHASH.XXH3_64bits(data[:header], header))
    return data[:16] + struct.pack('<QQ', value.low, value.high) + data[32:]


def read(path):
    with open(path, 'rb') as file:
        return file.read()


def write(path, data):
    with open(path, 'wb') as file:
        file.write(data)


# ---- good files to begin with ----

def quad(textured=True, uri='image.png', normal_map=False):
    """A square as a .gltf, with an image of its own file."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], '<f4').tobytes() + np.array(
        [[0, 0], [1, 0], [1, 1], [0, 1]], '<f4').tobytes() + np.array([0, 2, 1, 0, 3, 2], '<u2').tobytes()
    material = {'pbrMetallicRoughness': {'baseColorTexture': {'index': 0}}, 'emissiveTexture': {'index': 0},
                'emissiveFactor': [1, 1, 1]} if textured else {'emissiveFactor': [1, 1, 1]}
    tree = {'asset': {'version': '2.0'}, 'scene': 0, 'scenes': [{'nodes': [0]}],
            'nodes': [{'mesh': 0, 'name': 'square'}],
            'meshes': [{'primitives': [{'attributes': {'POSITION': 0, 'TEXCOORD_0': 1}, 'indices': 2, 'material': 0}]}],
            'materials': [material],
            'buffers': [{'byteLength': len(points), 'uri': 'data:application/octet-stream;base64,' +
                         base64.b64encode(points).decode()}],
            'bufferViews': [{'buffer': 0, 'byteLength': 48}, {'buffer': 0, 'byteOffset': 48, 'byteLength': 32},
                            {'buffer': 0, 'byteOffset': 80, 'byteLength': 12}],
            'accessors': [{'bufferView': 0, 'componentType': 5126, 'count': 4, 'type': 'VEC3', 'min': [0, 0, 0],
                           'max': [1, 0, 1]},
                          {'bufferView': 1, 'componentType': 5126, 'count': 4, 'type': 'VEC2'},
                          {'bufferView': 2, 'componentType': 5123, 'count': 6, 'type': 'SCALAR'}]}
    if textured:
        tree['images'], tree['textures'] = [{'uri': uri}], [{'source': 0}]
    if normal_map:
        material['normalTexture'] = {'index': 0, 'scale': 0.7, 'texCoord': 0,
                                     'extensions': {'KHR_texture_transform': {'scale': [2, 3]}}}
        material['pbrMetallicRoughness']['metallicRoughnessTexture'] = {'index': 0}
        material['extensions'] = {
            'KHR_materials_clearcoat': {'clearcoatFactor': 0.5, 'clearcoatNormalTexture': {'index': 0}},
            'KHR_materials_anisotropy': {'anisotropyStrength': 0.5, 'anisotropyTexture': {'index': 0, 'texCoord': 0}}}
    return json.dumps(tree).encode()


def images_of(glb):
    chunks = formats.glb_parts(glb)
    tree = json.loads(chunks[0][1])
    views = [tree['bufferViews'][i['bufferView']] for i in tree.get('images', []) if 'bufferView' in i]
    return [chunks[1][1][v.get('byteOffset', 0):][:v['byteLength']] for v in views]


def radiance(width, height, packed):
    head = b'#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1\n\n-Y %d +X %d\n' % (height, width)
    texels = [bytes((10 * y & 255, 20 * x & 255, 100, 128 + (x & 1))) for y in range(height) for x in range(width)]
    if not packed:
        return head + b''.join(texels)
    rows = []
    for y in range(height):
        row = texels[y * width:(y + 1) * width]
        rows.append(b'\2\2' + struct.pack('>H', width) +
                    b''.join(bytes([width]) + bytes(t[c] for t in row) if c < 2 else bytes((128 + width, row[0][c]))
                             for c in range(4)))
    return head + b''.join(rows)


class Seeds:
    """Good files, made once a run: from the repository, and by one small bake and two that were stopped (by one rank
    and by two)."""

    def __init__(self, folder, program, environment):
        self.folder, self.program, self.environment = folder, program, environment
        corpus = os.path.join(HERE, 'corpus', 'seeds')
        own = [os.path.join(REPOSITORY, 'tests', 'data', 'punctual_zoo.glb'),
               os.path.join(REPOSITORY, 'jobs', 'furnace.glb')]
        self.glb = [read(p) for p in sorted(glob.glob(os.path.join(corpus, '*.glb'))) + own]
        chunked = [formats.glb_parts(g) for g in self.glb]
        self.gltf = [quad(), quad(False), quad(normal_map=True), read(os.path.join(corpus, 'data_uri.gltf'))] + [
            self.inlined(c) for c in chunked if len(c) > 1 and len(c[1][1]) < 9000]
        self.obj = [(read(os.path.join(corpus, n + '.obj')), read(os.path.join(corpus, n + '.mtl')))
                    for n in ('box_ok', 'cornell_original')]
        pictures = images_of(read(os.path.join(corpus, 'image_formats.glb'))) + images_of(
            read(os.path.join(corpus, 'alpha_modes.glb')))
        self.png = [p for p in pictures if p[:4] == b'\x89PNG']
        self.jpeg = [p for p in pictures if p[:2] == b'\xff\xd8']
        self.hdr = [radiance(4, 2, False), radiance(16, 8, True), radiance(9, 3, True)]
        self.exr = self.exr_files()
        self.bake, self.mapped = self.made_bake(), self.mapped_bake()
        self.rows, self.links, self.groups = self.kept_bakes()
        self.checkpoints = [c for c in (self.stopped(1), self.stopped(2)) if c]
        self.blocks = {name: hdf5.blocks(read(os.path.join(self.bake, name))) for name in ('kiln.h5', 'volume.hdf')}

    @staticmethod
    def inlined(chunks):
        tree = json.loads(chunks[0][1])
        tree['buffers'][0]['uri'] = 'data:application/octet-stream;base64,' + base64.b64encode(chunks[1][1]).decode()
        return json.dumps(tree).encode()

    def exr_files(self):
        rng = np.random.default_rng(1)
        path, made = os.path.join(self.folder, 'seed.exr'), []
        for names, half, packing, size in (('RGB', (), 'ZIP', (4, 8)), ('RGB', ('R', 'G', 'B'), 'NONE', (3, 5)),
                                           ('Y', (), 'ZIPS', (8, 16)), ('RGBA', ('A',), 'ZIP', (40, 20))):
            exr_file.write(path, {c: rng.random(size, np.float32) for c in names}, half, packing)
            made.append(read(path))
        os.unlink(path)
        return made

    def run(self, words, codes, more=None):
        ended = subprocess.run(words, env={**self.environment, **(more or {})}, stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT, text=True, check=False, timeout=300)
        if ended.returncode not in codes:
            sys.exit('a seed cannot be made: %s ended with %d\n%s' % (' '.join(words), ended.returncode, ended.stdout))
        return ended.returncode

    def scene(self):
        """As a scene file: a checkpoint fits it, whichever build of the program goes on."""
        return os.path.join(self.bake, 'scene.kscene')

    def made_bake(self):
        target, scene = os.path.join(self.folder, 'bake'), os.path.join(self.folder, 'scene.glb')
        shutil.copy(os.path.join(REPOSITORY, 'jobs', 'furnace.glb'), scene)
        self.run([self.program, 'bake', scene, '-o', target, *BAKE], (0,))
        return target

    def mapped_bake(self):
        """A bake of a scene that has a normal map, and so more sections."""
        target, scene = os.path.join(self.folder, 'mapped'), os.path.join(self.folder, 'mapped.gltf')
        write(scene, quad(uri='data:image/png;base64,' + FLAT_PNG, normal_map=True))
        self.run([self.program, 'bake', scene, '-o', target, *BAKE], (0,))
        return target

    def kept_bakes(self):
        """Of a floor, a mirror, a lamp and a sun: bakes with rows and chains, with links, and with groups of lights."""
        scene, groups = os.path.join(self.folder, 'kept.glb'), os.path.join(self.folder, 'groups.yaml')
        room = glb_file.Scene()
        room.quad('floor', ((0, 0, 1), (1, 0, 1), (1, 0, 0), (0, 0, 0)), room.material('white', (0.7, 0.7, 0.7)))
        room.quad('mirror', ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)), room.material('mirror', (0.9, 0.9, 0.9)))
        room.document['materials'][-1]['pbrMetallicRoughness'].update(metallicFactor=1.0, roughnessFactor=0.0)
        room.quad('lamp', ((0, 1, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1)), room.material('lamp', radiance=(3, 2, 1)))
        room.light('sun', {'type': 'directional', 'name': 'sun', 'intensity': 100.0}, rotation=[-0.6, 0, 0, 0.8])
        room.environment((0.5, 0.6, 0.7))
        room.write(scene)
        write(groups, json.dumps(GROUPS).encode())
        made = []
        for name, options in (('rows', (*ROWS, '--materials', 'auto')), ('links', LINKS),
                              ('groups', (*GROUPED, '--light-groups', groups))):
            made.append(os.path.join(self.folder, 'kept-' + name))
            self.run([self.program, 'bake', scene, '-o', made[-1], *options], (0,))
        return made

    def stopped(self, ranks):
        """A bake that ended with a checkpoint: a bake whose last rank is slow, stopped."""
        target = os.path.join(self.folder, 'stopped%d' % ranks)
        launcher = ['mpirun', '--bind-to', 'none', '--oversubscribe', '-n', str(ranks)] if ranks > 1 else []
        if ranks > 1 and shutil.which('mpirun') is None:
            return None
        # s; where a machine is very slow there is nothing to keep yet
        for limit in ('0.8', '0.4', '0.2', '1.6', '0.1', '3.2', '0.05', '0.6'):
            self.run([*launcher, self.program, 'bake', self.scene(), '-o', target, *BAKE, '--no-work-stealing',
                      '--max-time', limit], (0, 75), {'KILN_SLOW_RANK': '%d:4000' % (ranks - 1)})
            if glob.glob(os.path.join(target, 'checkpoint', 'gen-*')):
                return target
            shutil.rmtree(target)
        sys.exit('a seed cannot be made: no bake was stopped with a checkpoint')


# ---- cases ----

class Work:
    """Where cases are: `case` and its files, made anew for each."""

    def __init__(self, folder, seeds):
        self.folder, self.seeds = folder, seeds
        self.case, self.given, self.outside = (os.path.join(folder, n) for n in ('case', 'given', 'outside'))
        for path in (self.case, self.given, self.outside, os.path.join(folder, 'tmp')):
            os.makedirs(path, exist_ok=True)
        for name in ('secret.bin', 'secret.png', 'secret.mtl', 'x', 'secret.hdr'):
            write(os.path.join(self.outside, name), b'what must stay unread\n' * 3)
        shutil.copy(os.path.join(seeds.bake, 'volume.hdf'), os.path.join(self.outside, 'secret.hdf'))
        self.references = ['../outside/secret.bin', os.path.join(self.outside, 'secret.bin'),
                           'file://' + os.path.join(self.outside, 'secret.png'), '..%2foutside%2fsecret.bin',
                           '..\\outside\\secret.bin', 'link/secret.bin', 'link/secret.png', './link/../link/secret.hdr',
                           '../outside', '/dev/zero', '/etc/passwd', '/proc/self/environ', 'fifo', 'a/../../outside/x']
        self.hdf5 = [os.path.join(self.outside, 'secret.hdf'), os.path.join(self.outside, 'secret.bin'),
                     '../outside/secret.hdf', '../../outside/secret.hdf', os.path.join(self.case, 'fifo'),
                     '/etc/passwd', '/dev/zero', 'fifo', '../fifo', 'secret.hdf', 'run.json']

    def clean(self):
        for folder in (self.case, self.given, os.path.join(self.folder, 'tmp')):
            for entry in os.scandir(folder):
                if entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(entry.path)
                else:
                    os.unlink(entry.path)
        os.symlink('../outside', os.path.join(self.case, 'link'))
        os.mkfifo(os.path.join(self.case, 'fifo'))

    def put(self, name, data):
        write(os.path.join(self.case, name), data)
        return os.path.join(self.case, name)

    def copy(self, name, source):
        target = os.path.join(self.case, name)
        shutil.copytree(source, target)
        return target

    def output(self, name):
        return os.path.join(self.given, name)


def look(r, path, *more):
    return [r.choice(('info', 'info', 'info', 'check')), path, *SMALL, *more]


def make_gltf(r, w):
    w.put('image.png', w.seeds.png[0])
    w.put('a.png', w.seeds.png[1])
    return look(r, w.put('scene.gltf', formats.gltf_text(r, r.choice(w.seeds.gltf))))


def make_glb(r, w):
    more = ('--repack',) if r.random() < 0.1 else ('--trust', 'normals') if r.random() < 0.1 else ()
    return look(r, w.put('scene.glb', formats.glb(r, r.choice(w.seeds.glb))), *more)


def make_image(r, w, kind):
    seed = r.choice(getattr(w.seeds, kind))
    w.put('image.png', getattr(formats, kind)(r, seed))
    return ['info', w.put('scene.gltf', quad()), *SMALL]


def make_environment(r, w, kind):
    seed = r.choice(getattr(w.seeds, kind))
    name = 'sky.' + (kind if r.random() < 0.97 else r.choice(('hdr', 'exr', 'png')))
    path = w.put(name, getattr(formats, kind)(r, seed))
    return ['info', w.put('scene.gltf', quad(False)), '--environment', path, *SMALL]


def make_obj(r, w):
    text, library = r.choice(w.seeds.obj)
    for name in ('box_ok.mtl', 'cornell_original.mtl'):
        w.put(name, library)
    return look(r, w.put('scene.obj', formats.obj(r, text)))


def make_mtl(r, w):
    text, library = r.choice(w.seeds.obj)
    w.put('a.png', w.seeds.png[0])
    library = library + b'map_Kd a.png\n' if r.random() < 0.5 else library
    library = formats.mtl(r, library)
    for name in ('box_ok.mtl', 'cornell_original.mtl'):
        w.put(name, library)
    return look(r, w.put('scene.obj', text))


def option_names(cache=[]):
    """The keys of a job file, from the table of options."""
    if not cache:
        text = read(os.path.join(REPOSITORY, 'coordinator', 'job', 'options.c')).decode()
        cache += sorted(set(re.findall(r'{\.name = "([a-z-]+)"', text))) + ['scene', 'objects', 'no-such-key']
    return cache


JOBS = [b'# a job\nscene: scene.gltf\nquality: draft\nlightmap-size: 8\nbounces: all\nerror-map: true\n',
        b'scene: scene.gltf\ntexels-per-metre: 16\nprobe-spacing: 0.5\nschedule: equal\nbounces: 12\nenvironment: '
        b'"1,1,1"\nseed: 7\n',
        b'scene: scene.gltf\nobjects:\n  "sq*": {density-scale: 2, role: both}\n  square:\n    lightmap-size: 4\n    '
        b'sides: two\n',
        b'scene: scene.gltf\nbackend: embree\nthreads: 2\npartition: cells\nmax-time: 60\ncheckpoint-every: 10\n'
        b'exposure: 1.5\n']


def make_job(r, w):
    w.put('scene.gltf', quad(False))
    job = w.put('job.yaml', formats.yaml(r, r.choice(JOBS), option_names()))
    if r.random() < 0.4:
        return ['submit', job, '--dry-run', '-o', w.output('bake')]
    return ['info', job, *SMALL]


WALK = (b'from.x from.y from.z to.x to.y to.z field-of-view time\n0.3 0.4 0.5 0.3 0.4 0 60 0\n'
        b'0.4 0.4 0.6 0.1 0.4 0 50 1\n0.5 0.3 0.5 0.2 0.4 0 40 2.5\n')
COLUMNS = WALK.split(b'\n', 1)[0].split() + [b'"to.x"', b'roll', b'#']


def make_camera_path(r, w):
    folder = w.copy('bake', w.seeds.bake)
    path = w.put('walk.csv', formats.lines(r, WALK, COLUMNS).replace(b' ', b','))
    return ['view', folder, '--path', path, '--frames', r.choice(('1', '2', '3')), '--width', '4', '--height', '4',
            '-o', w.output(r.choice(('f.png', 'f.exr')))]


def scene_file(r, data):
    """Numbers of the header, of the table of sections or within one section; the hash is made right."""
    kind = r.random()
    for _ in range(r.choice((1, 1, 2))):
        if kind < 0.15:
            data = formats.field(r, data, r.choice((0, 4)), 4) if r.random() < 0.3 else formats.field(
                r, data, r.randrange(32, SECTION_TABLE, 8), 8)
        elif kind < 0.45:
            data = formats.field(r, data, SECTION_TABLE + 8 * r.randrange(2 * len(SECTIONS)), 8)
        elif kind < 0.97:
            filled = [i for i in range(len(SECTIONS))
                      if struct.unpack_from('<Q', data, SECTION_TABLE + 16 * i + 8)[0] > 0]
            i = r.choice(filled)
            first = struct.unpack_from('<Q', data, SECTION_TABLE + 16 * i)[0]
            later = [o for o in (struct.unpack_from('<Q', data, SECTION_TABLE + 16 * j)[0] for j in filled)
                     if o > first]
            end = min(later + [len(data)])
            if not first < end <= len(data):
                return data
            part = data[first:end]
            part = formats.floats(r, part) if r.random() < 0.7 else formats.havoc(r, part, 2)[:len(part)].ljust(
                len(part), b'\0')
            data = data[:first] + part + data[end:]
        else:
            return formats.havoc(r, data)
    return data


def make_scene_file(r, w):
    data = scene_file(r, read(os.path.join(r.choice((w.seeds.bake, w.seeds.mapped)), 'scene.kscene')))
    return [r.choice(('info', 'check')), w.put('scene.kscene', seal_scene(data) if r.random() < 0.95 else data)]


def reseal_bake(folder, name):
    """The manifest says of this file what is now true."""
    path = os.path.join(folder, 'manifest')
    manifest = json.loads(unseal(read(path)))
    data = read(os.path.join(folder, name))
    for entry in manifest['files']:
        if entry['path'] == name:
            entry['bytes'], entry['xxh3_128'] = len(data), xxh3(data)
    write(path, seal(json.dumps(manifest).encode()))


def asked(r, w, folder, *weighted):
    """A command that reads a bake; `weighted`: (name, weight)."""
    names, weights = zip(*weighted)
    command = r.choices(names, weights)[0]
    place = ('0.3', '0.4', '0.5') if r.random() < 0.7 else tuple(repr(r.uniform(-2, 2)) for _ in range(3))
    return {'verify': ['verify', folder], 'probe': ['probe', folder, *place],
            'view': ['view', folder, '-o', w.output('view.png'), '--width', '16', '--height', '16'],
            'report': ['report', folder, '-o', w.output('report.html')], 'compare': ['compare', folder, w.seeds.bake]
            if r.random() < 0.5 else ['compare', w.seeds.bake, folder],
            'export': ['export', folder, '-o', w.output('scene.glb')],
            'status': ['status', folder, *(('--json',) if r.random() < 0.5 else ())],
            'info': ['info', os.path.join(folder, 'scene.kscene')],
            'look': ['info', os.path.join(folder, 'scene.glb'), *SMALL],
            'again': ['bake', w.seeds.scene(), '-o', folder, *BAKE]}[command]


def make_hdf5(r, w, name, *weighted):
    folder = w.copy('bake', w.seeds.bake)
    path = os.path.join(folder, name)
    if r.random() < 0.5:
        hdf5.structure(r, path, w.hdf5)
    else:
        write(path, hdf5.raw(r, read(path), w.seeds.blocks[name]))
    reseal_bake(folder, name)
    return asked(r, w, folder, *weighted)


def make_lightmap(r, w):
    folder = w.copy('bake', w.seeds.bake)
    name = r.choice(sorted(os.path.relpath(p, folder)
                           for p in glob.glob(os.path.join(folder, 'lightmaps', '**', '*.exr'), recursive=True)))
    path = os.path.join(folder, name)
    if r.random() < 0.02:
        os.unlink(path)
        os.mkfifo(path)
    elif r.random() < 0.02:
        os.unlink(path)
        os.symlink(os.path.join(w.outside, 'secret.bin'), path)
    else:
        write(path, formats.exr(r, read(path)))
        reseal_bake(folder, name)
    return asked(r, w, folder, ('verify', 4), ('compare', 3), ('view', 1), ('report', 2), ('export', 1))


def make_bake_scene(r, w):
    folder = w.copy('bake', r.choice((w.seeds.bake, w.seeds.mapped)))
    path = os.path.join(folder, 'scene.kscene')
    write(path, seal_scene(scene_file(r, read(path))))
    reseal_bake(folder, 'scene.kscene')
    return asked(r, w, folder, ('verify', 2), ('info', 2), ('view', 1), ('report', 2), ('export', 2), ('compare', 1))


def make_bake_glb(r, w):
    folder = w.copy('bake', w.seeds.bake)
    path = os.path.join(folder, 'scene.glb')
    write(path, formats.glb(r, read(path)))
    reseal_bake(folder, 'scene.glb')
    return asked(r, w, folder, ('verify', 1), ('look', 3), ('export', 2), ('report', 1))


def mutated_json(r, text):
    if r.random() < 0.1:
        return formats.mutate_json_text(r, text)
    return formats.dumps(formats.mutate_tree(r, json.loads(text)))


def make_run(r, w):
    folder = w.copy('bake', w.seeds.bake)
    path = os.path.join(folder, 'run.json')
    write(path, mutated_json(r, read(path)))
    reseal_bake(folder, 'run.json')
    return asked(r, w, folder, ('report', 4), ('status', 3), ('export', 2), ('view', 1), ('probe', 2), ('verify', 2),
                 ('compare', 2), ('again', 0.1))


def make_manifest(r, w):
    folder = w.copy('bake', w.seeds.bake)
    path = os.path.join(folder, 'manifest')
    tree = json.loads(unseal(read(path)))
    if r.random() < 0.5:
        entry = r.choice(tree['files'])
        entry[r.choice(('path', 'path', 'bytes', 'xxh3_128'))] = r.choice(
            (formats.word(r), formats.integer(r), formats.word(r)))
        text = formats.dumps(tree)
    else:
        text = mutated_json(r, json.dumps(tree).encode())
    write(path, seal(text) if r.random() < 0.95 else text)
    return asked(r, w, folder, ('verify', 20), ('report', 3), ('status', 3), ('probe', 3), ('compare', 2), ('again', 1))


def resume(w, folder):
    return ['bake', w.seeds.scene(), '-o', folder, *BAKE]


def generation_of(folder):
    return sorted(glob.glob(os.path.join(folder, 'checkpoint', 'gen-*')))[-1]


def make_checkpoint_manifest(r, w):
    folder = w.copy('bake', r.choice(w.seeds.checkpoints))
    path = os.path.join(generation_of(folder), 'manifest')
    tree = json.loads(unseal(read(path)))
    if r.random() < 0.6:
        part = r.choice(tree['parts'])
        if r.random() < 0.75 and part['blocks']:
            block = r.choice(part['blocks'])
            i = r.randrange(len(block))
            block[i] = formats.word(r) if i == 0 and r.random() < 0.5 else formats.integer(r, block[i] if i else 0)
        elif r.random() < 0.3:
            part['blocks'] = part['blocks'] * r.choice((2, 20)) if r.random() < 0.5 else part['blocks'][:-1]
        elif r.random() < 0.5:
            tree['parts'] = tree['parts'] * r.choice((2, 300)) if r.random() < 0.5 else tree['parts'][:-1]
        else:
            part['bytes'] = formats.integer(r, part['bytes'])
        text = formats.dumps(tree)
    else:
        text = mutated_json(r, json.dumps(tree).encode())
    write(path, seal(text) if r.random() < 0.95 else text)
    return resume(w, folder)


def make_checkpoint_part(r, w):
    folder = w.copy('bake', r.choice(w.seeds.checkpoints))
    generation = generation_of(folder)
    path = r.choice(sorted(glob.glob(os.path.join(generation, 'part-*'))))
    manifest = os.path.join(generation, 'manifest')
    tree = json.loads(unseal(read(manifest)))
    part = tree['parts'][int(path.rsplit('-', 1)[1])]
    data = read(path)
    if r.random() < 0.02:
        os.unlink(path)
        r.choice((lambda: os.mkfifo(path), lambda: os.symlink(os.path.join(w.outside, 'secret.bin'), path),
                  lambda: os.mkdir(path)))()
    else:
        blocks = [b for b in part['blocks'] if b[2] * b[3] > 0]
        if blocks and r.random() < 0.8:
            block = r.choice(blocks)
            first, size = block[4], block[2] * block[3]
            piece = data[first:first + size]
            for _ in range(r.choice((1, 3, 50))):
                at = r.randrange(size)
                wide = min(size - at, r.choice((1, 4, 8)))
                value = formats.packed(formats.integer(r), wide) if r.random() < 0.5 else struct.pack(
                    '<d', r.choice(formats.NUMBERS + [float('nan'), float('inf')]))[:wide]
                piece = piece[:at] + value + piece[at + wide:]
            data = data[:first] + piece + data[first + size:]
        else:
            data = formats.havoc(r, data)
        write(path, data)
        part['bytes'], part['xxh3_128'] = len(data), xxh3(data)
        write(manifest, seal(json.dumps(tree).encode()))
    return resume(w, folder)


def reseal_transport(r, folder, name):
    """The manifest says of a kept file what is now true; now and then it does not."""
    if r.random() < 0.95:
        reseal_bake(folder, os.path.join('transport', name))


def instead(r, w, path):
    """In the place of a file something else."""
    os.unlink(path)
    r.choice((lambda: os.mkfifo(path), lambda: os.symlink(os.path.join(w.outside, 'secret.bin'), path),
              lambda: os.mkdir(path), lambda: None))()


def relit(r, w, folder, *more):
    return ['relight', folder, *more, '-o', w.output('relit'), '--threads', '1', '--quiet', '--watchdog', '0',
            '--no-preview'] if r.random() < 0.8 else ['verify', folder]


def make_transport_index(r, w):
    """Values of other types and options that a bake had no use for: paths above all."""
    folder = w.copy('bake', r.choice((w.seeds.rows, w.seeds.links)))
    path = os.path.join(folder, 'transport', 'index')
    tree = json.loads(unseal(read(path)))
    if r.random() < 0.5:
        value = r.choice((*w.references, os.path.join(w.outside, 'x'), formats.word(r), None, 1, [], {}, True, 'none'))
        tree['job'][r.choice(option_names())] = value
        text = formats.dumps(tree)
    elif r.random() < 0.2:
        tree['scene'] = r.choice((*w.references, None, 7))
        text = formats.dumps(tree)
    else:
        text = mutated_json(r, json.dumps(tree).encode())
    write(path, seal(text) if r.random() < 0.95 else text)
    reseal_transport(r, folder, 'index')
    return relit(r, w, folder)


def make_rows(r, w):
    folder = w.copy('bake', w.seeds.rows)
    name = r.choice(sorted(n for n in os.listdir(os.path.join(folder, 'transport')) if n != 'index'))
    path = os.path.join(folder, 'transport', name)
    if r.random() < 0.05:
        instead(r, w, path)
        return relit(r, w, folder)
    data = read(path)
    if r.random() < 0.8 and len(data) > 4096:  # behind the header
        data = data[:4096] + formats.havoc(r, data[4096:])
    else:
        data = formats.havoc(r, data)
    write(path, data)
    reseal_transport(r, folder, name)
    return relit(r, w, folder)


def seal_links(data):
    """The codes' hashes in the table are right (coordinator/integrate/patches/link_file.c)."""
    if len(data) < 4096:
        return data
    runs, key = struct.unpack_from('<Q8xQ', data, 32)
    for at in range(4096, min(len(data) - 31, 4096 + 32 * min(runs, 10000)), 32):
        first, offset, size = struct.unpack_from('<QQI', data, at)
        code = data[offset:offset + size]
        if len(code) == size:
            check = XXHASH.XXH3_64bits_withSeed(code, size, key ^ (first * 0x9e3779b97f4a7c15 & (1 << 64) - 1))
            data = data[:at + 24] + struct.pack('<Q', check) + data[at + 32:]
    return data


def make_links(r, w):
    folder = w.copy('bake', w.seeds.links)
    path = os.path.join(folder, 'transport', 'links')
    if r.random() < 0.05:
        instead(r, w, path)
        return relit(r, w, folder)
    data, what = read(path), r.random()
    runs = struct.unpack_from('<Q', data, 32)[0]
    if what < 0.2:
        data = formats.field(r, data, r.choice(range(0, 56, 8)), 8)
    elif what < 0.5:
        entry = 4096 + 32 * r.randrange(max(1, runs))
        data = formats.field(r, data, entry + r.choice((0, 8, 16, 20)), r.choice((4, 8)))
    elif what < 0.8:
        at = 4096 + 32 * runs
        piece = data[at:]
        for _ in range(r.choice((1, 3, 20))):
            i = r.randrange(max(1, len(piece) - 4))
            piece = piece[:i] + struct.pack('<f', r.choice(SINGLES)) + piece[i + 4:]
        data = data[:at] + piece
    else:
        data = formats.havoc(r, data)
    write(path, seal_links(data))
    reseal_transport(r, folder, 'links')
    return relit(r, w, folder)


def make_yaml(r, w, kind):
    """Changes and states of kept light, and groups of a bake's lights."""
    tree = {'changes': CHANGES, 'states': STATES, 'groups': GROUPS}[kind]
    if r.random() < 0.7:
        text = formats.dumps(formats.mutate_tree(r, tree))
    else:
        names = ['lights', 'materials', 'environment', 'objects', 'sun', 'lamp', 'on', 'scale', 'color', 'radiance',
                 *w.references]
        rows = '\n'.join('%s: %s' % (name, json.dumps(value)) for name, value in tree.items())
        text = formats.yaml(r, rows.encode(), names)
    path = w.put(kind + '.yaml', text)
    if r.random() < 0.03:  # links that the user names may be followed
        os.unlink(path)
        r.choice((lambda: os.mkfifo(path), lambda: os.mkdir(path), lambda: None))()
    if kind == 'groups':
        return ['bake', os.path.join(w.seeds.folder, 'kept.glb'), '-o', w.output('bake'), *GROUPED, '--light-groups',
                path]
    return ['relight', w.seeds.rows, *((path,) if kind == 'changes' else ('--states', path)), '-o', w.output('relit'),
            '--threads', '1', '--quiet', '--watchdog', '0', '--no-preview']


def argument(r):
    """A word that a command line can have."""
    return formats.word(r).encode('utf-8', 'replace').decode().replace('\0', '?')


def make_mixture(r, w):
    """Groups of a bake, in its report, its tables and its lightmaps."""
    folder = w.copy('bake', w.seeds.groups)
    names = ['run.json', 'kiln.h5', 'scene.kscene', *(os.path.join('lightmaps', n) for n in
             sorted(os.listdir(os.path.join(folder, 'lightmaps'))))]
    name = r.choice(names)
    path = os.path.join(folder, name)
    if r.random() < 0.03:
        instead(r, w, path)
    else:
        data = read(path)
        write(path, mutated_json(r, data) if name == 'run.json' else
              hdf5.raw(r, data, hdf5.blocks(data)) if name == 'kiln.h5' else
              formats.exr(r, data) if name.endswith('.exr') else seal_scene(scene_file(r, data)))
        reseal_bake(folder, name)
    return ['mix', folder, '-o', w.output('mixed'), '--quiet', '--set', 'lamps=%s' % r.choice(('0.5', '0', '2,1,0')),
            *(('--set', argument(r) + '=1') if r.random() < 0.2 else ())]


def make_status(r, w):
    folder = w.copy('bake', r.choice(w.seeds.checkpoints))
    path = os.path.join(folder, 'checkpoint', 'status.json')
    text = read(path) if os.path.exists(path) else STATUS
    write(path, mutated_json(r, text) if r.random() < 0.85 else formats.havoc(r, text))
    return ['status', folder, *(('--json',) if r.random() < 0.5 else ())]


STATUS = json.dumps({'state': 'stopped', 'phase': 'direct', 'share': 0.5, 'left': 3.0, 'seconds': 12.0, 'ranks': 2,
                     'host': 'node1', 'process': 12345, 'started': 1, 'updated': 1.7e9,
                     'beat': 3, 'generation': 1, 'saved': 1.7e9, 'code': 75, 'message': 'stopped as asked'}).encode()

# By the release build alone: the command ends while Embree starts its threads, which in a fork do not come to an end.
PLAIN = ('rows',)
# name: (share of the cases, make)
READERS = {
    'gltf': (14, make_gltf),
    'glb': (12, make_glb),
    'png': (7, lambda r, w: make_image(r, w, 'png')),
    'jpeg': (6, lambda r, w: make_image(r, w, 'jpeg')),
    'hdr': (7, lambda r, w: make_environment(r, w, 'hdr')),
    'exr': (7, lambda r, w: make_environment(r, w, 'exr')),
    'obj': (8, make_obj),
    'mtl': (5, make_mtl),
    'job': (7, make_job),
    'camera path': (1, make_camera_path),
    'scene': (5, make_scene_file),
    'kiln.h5': (3, lambda r,
                w: make_hdf5(r, w, 'kiln.h5', ('verify', 6), ('report', 2), ('compare', 1), ('view', 0.5))),
    'volume.hdf': (4, lambda r, w: make_hdf5(r, w, 'volume.hdf', ('probe', 6), ('verify', 4), ('report', 1))),
    'lightmap': (3, make_lightmap),
    'bake scene': (2, make_bake_scene),
    'bake glb': (1, make_bake_glb),
    'run': (2, make_run),
    'manifest': (2, make_manifest),
    'checkpoint': (0.7, make_checkpoint_manifest),
    'part': (0.7, make_checkpoint_part),
    'status': (2, make_status),
    'index': (3, make_transport_index),
    'rows': (2, make_rows),
    'links': (2, make_links),
    'changes': (2, lambda r, w: make_yaml(r, w, 'changes')),
    'states': (1, lambda r, w: make_yaml(r, w, 'states')),
    'groups': (1, lambda r, w: make_yaml(r, w, 'groups')),
    'mixture': (2, make_mixture),
}
