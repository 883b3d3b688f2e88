"""Files made to kill a reader: one row each in KILLERS, name: (make, statuses that will do). make(w) writes the case as
in readers.py and returns the arguments of kiln. Files that were found and cannot be made lie in corpus/hostile. What
kills the reader of glTF alone is in tests/import/test_killers.py."""
import json
import os
import shutil
import struct
import zlib

import h5py
import numpy as np

import formats
import hdf5
import readers

HOSTILE = os.path.join(readers.HERE, 'corpus', 'hostile')
REFUSED = (65,)
PLACE = ('0.3', '0.4', '0.5')


def hostile(*parts):
    return readers.read(os.path.join(HOSTILE, *parts))


# ---- environments and images ----

def sky(name, data):
    return lambda w: ['info', w.put('scene.gltf', readers.quad(False)), '--environment', w.put(name, data()),
                      *readers.SMALL]


def picture(data):
    def make(w):
        w.put('image.png', data())
        return ['info', w.put('scene.gltf', readers.quad()), *readers.SMALL]
    return make


HEAD = b'#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n'


def hdr_runs(width, height, rows, code=b'\xff\x00'):
    """Rows of runs of the same byte."""
    row = b'\2\2' + struct.pack('>H', width) + (code * (width // 127) +
                                                (bytes((128 + width % 127, 0)) if width % 127 else b'')) * 4
    return HEAD + b'-Y %d +X %d\n' % (height, width) + row * rows


def exr_of(channels='RGB', window=(0, 0, 7, 7), compression=3, chunks=(), more=(), version=2, table=True):
    lists = b''.join(c.encode() + b'\0' + struct.pack('<iB3xii', 2, 0, 1, 1)
                     for c in sorted(channels)) + b'\0' if isinstance(channels, str) else channels
    attributes = [(b'channels', b'chlist', lists), (b'compression', b'compression', bytes([compression])),
                  (b'dataWindow', b'box2i', struct.pack('<4i', *window)),
                  (b'displayWindow', b'box2i', struct.pack('<4i', *window)), (b'lineOrder', b'lineOrder', b'\0'),
                  (b'pixelAspectRatio', b'float', struct.pack('<f', 1)),
                  (b'screenWindowCenter', b'v2f', bytes(8)), (b'screenWindowWidth', b'float', struct.pack('<f', 1)),
                  *more]
    at = len(formats.exr_join(struct.pack('<I', version), attributes, b'')) + 8 * len(chunks)
    offsets, bodies = [], []
    for y, body in chunks:
        offsets.append(struct.pack('<Q', at))
        bodies.append(struct.pack('<iI', y, len(body)) + body)
        at += 8 + len(body)
    return formats.exr_join(struct.pack('<I', version), attributes,
                            (b''.join(offsets) if table else b'') + b''.join(bodies))


def exr_bomb(side):
    """A black square, a thousandth of its bytes: every block of 16 rows the same."""
    body = formats.zeros_packed(16 * side * 12)
    return exr_of(window=(0, 0, side - 1, side - 1), chunks=[(16 * i, body) for i in range(side // 16)])


def png_of(width, height, depth=8, kind=0, stream=b'', more=()):
    return formats.png_join([(b'IHDR', struct.pack('>IIBBBBB', width, height, depth, kind, 0, 0, 0)), *more,
                             (b'IDAT', stream), (b'IEND', b'')])


def png_bomb(side):
    return png_of(side, side, stream=formats.zeros_packed(side * (side + 1)))


def jpeg_of(width, height, kind=0xc0, scans=1):
    table = b'\xff\xdb\x00\x43\x00' + b'\x01' * 64
    huffman = b'\xff\xc4\x00\x14\x00' + b'\x01' + bytes(15) + b'\x00' + b'\xff\xc4\x00\x14\x10' + b'\x01' + bytes(
        15) + b'\x00'
    frame = bytes((0xff, kind)) + struct.pack('>HBHHB', 11, 8, height, width, 1) + b'\x01\x11\x00'
    scan = b'\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00' if kind == 0xc0 else b'\xff\xda\x00\x08\x01\x01\x00\x00\x00\x00'
    return b'\xff\xd8' + table + frame + huffman + (scan + bytes(20)) * scans + b'\xff\xd9'


# ---- scenes as text ----

def text_scene(name, data, more=()):
    def make(w):
        for other, bytes_of in more:
            w.put(other, bytes_of())
        return ['info', w.put(name, data()), *readers.SMALL]
    return make


TRIANGLE = b'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n'


def job(data):
    def make(w):
        w.put('scene.gltf', readers.quad(False))
        return ['info', w.put('job.yaml', data()), *readers.SMALL]
    return make


def laughs():
    rows = [b'a0: &a0 [lol, lol, lol, lol, lol, lol, lol, lol, lol, lol]']
    rows += [b'a%d: &a%d [%s]' % (i, i, b', '.join([b'*a%d' % (i - 1)] * 10)) for i in range(1, 10)]
    return b'\n'.join(rows) + b'\nscene: *a9\n'


# ---- bakes ----

def baked(name, change, *words):
    """A bake with one file replaced: change(w, path) makes it; the manifest says that it is right. words: a command,
    FOLDER stands for the bake."""
    def make(w):
        folder = w.copy('bake', w.seeds.bake)
        path = os.path.join(folder, name)
        change(w, path)
        if name != 'manifest' and os.path.isfile(path) and not os.path.islink(path):
            readers.reseal_bake(folder, name)
        return [w.output(word[6:]) if word.startswith('GIVEN/') else folder if word == 'FOLDER' else word
                for word in words]
    return make


VERIFY, PROBE, REPORT = ('verify', 'FOLDER'), ('probe', 'FOLDER',
                                               *PLACE), ('report', 'FOLDER', '-o', 'GIVEN/report.html')
VIEW, STATUS, EXPORT = ('view', 'FOLDER', '-o', 'GIVEN/view.png', '--width', '8', '--height',
                        '8'), ('status', 'FOLDER'), ('export', 'FOLDER', '-o', 'GIVEN/scene.glb')


def put(data):
    return lambda w, path: readers.write(path, data() if callable(data) else data)


def as_fifo(w, path):
    os.unlink(path)
    os.mkfifo(path)


def as_link(w, path):
    target = os.path.join(w.outside, 'secret.hdf')
    os.unlink(path)
    os.symlink(target, path)


def as_folder(w, path):
    os.unlink(path)
    os.mkdir(path)


def volume(change):
    """change(w, file, group of the point data)."""
    def made(w, path):
        with h5py.File(path, 'r+') as file:
            change(w, file, file['VTKHDF/PointData'])
    return made


def instead(group, name, **how):
    """Another dataset of that name, with the old one's attributes."""
    old = dict(group[name].attrs)
    del group[name]
    made = group.create_dataset(name, **how)
    for key, value in old.items():
        made.attrs[key] = value
    return made


def external(target):
    def change(w, file, group):
        shape = group['validity'].shape
        instead(group, 'validity', shape=shape, dtype='f4', external=[(target(w), 0, h5py.h5f.UNLIMITED)])
    return change


def outside_link(w, file, group):
    del group['validity']
    group['validity'] = h5py.ExternalLink(os.path.join(w.outside, 'secret.hdf'), '/VTKHDF/PointData/validity')


def virtual(target):
    def change(w, file, group):
        shape = group['validity'].shape
        layout = h5py.VirtualLayout(shape=shape, dtype='f4')
        layout[...] = h5py.VirtualSource(target(w), '/VTKHDF/PointData/validity', shape=shape)
        del group['validity']
        group.create_virtual_dataset('validity', layout)
    return change


def claims(w, file, group):
    instead(group, 'validity', shape=(1 << 20, 1 << 20, 1), dtype='f4', chunks=(1, 1 << 10, 1))


def nested(w, file, group):
    with h5py.File(file.filename, 'r+') as again:
        inner = again
        for _ in range(20000):
            inner = inner.create_group('g')


def many_groups(w, file, group):
    for i in range(30000):
        file.create_group('g%d' % i)


def inflates(w, file, group):
    del group['validity']
    hdf5.bomb(group, 'validity', None, 1 << 26, 64)


def inflates_wrong(w, file, group):
    """A chunk that is larger than it may be."""
    made = instead(group, 'validity', shape=group['validity'].shape, dtype='f4', chunks=group['validity'].shape,
                   compression='gzip')
    made.id.write_direct_chunk((0, 0, 0), formats.zeros_packed(1 << 25))


def rings(w, file, group):
    file['VTKHDF/again'] = file['/']
    group['soft'] = h5py.SoftLink('/VTKHDF/PointData/soft')


def attribute_of(size):
    def change(w, file, group):
        file['VTKHDF'].attrs['kiln_units'] = 'x' * size
        for name in ('Spacing', 'Origin', 'Dimensions'):
            if name in file['VTKHDF'].attrs:
                file['VTKHDF'].attrs[name] = np.full(7000, 1e300)
    return change


def manifest(change):
    def made(w, path):
        tree = json.loads(readers.unseal(readers.read(path)))
        text = change(w, tree)
        readers.write(path, readers.seal(text if isinstance(text, bytes) else json.dumps(tree).encode()))
    return made


def every_path(text):
    def change(w, tree):
        for entry in tree['files']:
            entry['path'] = text(w) if callable(text) else text
    return change


def many_entries(w, tree):
    tree['files'] *= 20000


def sections(**numbers):
    """A scene file with other offsets or counts in its table, resealed."""
    def made(w, path):
        data = readers.read(path)
        for name, (offset, count) in numbers.items():
            at = readers.SECTION_TABLE + 16 * readers.SECTIONS.index(name.replace('_', ' '))
            old = struct.unpack_from('<QQ', data, at)
            data = data[:at] + struct.pack('<QQ', old[0] if offset is None else offset, old[1] if count is None
                                           else count) + data[at + 16:]
        readers.write(path, readers.seal_scene(data))
    return made


# ---- checkpoints ----

def checkpoint(change, index=0):
    """change(w, tree) of the newest generation's manifest; may return bytes in its stead."""
    def make(w):
        folder = w.copy('bake', w.seeds.checkpoints[index])
        path = os.path.join(readers.generation_of(folder), 'manifest')
        tree = json.loads(readers.unseal(readers.read(path)))
        text = change(w, tree)
        readers.write(path, readers.seal(text if isinstance(text, bytes) else json.dumps(tree).encode()))
        return readers.resume(w, folder)
    return make


def set_block(i, value):
    def change(w, tree):
        for part in tree['parts']:
            for block in part['blocks']:
                block[i] = value
    return change


def set_part(key, value):
    def change(w, tree):
        for part in tree['parts']:
            part[key] = value
    return change


def special_part(how):
    def make(w):
        folder = w.copy('bake', w.seeds.checkpoints[0])
        path = os.path.join(readers.generation_of(folder), 'part-00000')
        how(w, path)
        return readers.resume(w, folder)
    return make


def linked_generation(w):
    """A generation that is a link to a folder elsewhere, among more than are kept: nothing there may be removed."""
    folder = w.copy('bake', w.seeds.checkpoints[0])
    elsewhere = os.path.join(w.outside, 'generation')
    if not os.path.exists(elsewhere):
        shutil.copytree(readers.generation_of(folder), elsewhere)
    os.symlink(elsewhere, os.path.join(folder, 'checkpoint', 'gen-000009'))
    os.symlink(elsewhere, os.path.join(folder, 'checkpoint', '.writing-000012'))
    return readers.resume(w, folder)


def status(data):
    def make(w):
        folder = w.copy('bake', w.seeds.checkpoints[0])
        readers.write(os.path.join(folder, 'checkpoint', 'status.json'), data)
        return ['status', folder]
    return make


DEEP = b'[' * 2000000
ANY = (0, 64, 65, 66, 74, 75)  # a damaged checkpoint is passed over, with a sentence, and the bake starts again
KILLERS = {
    'hdr: runs end early': (sky('sky.hdr', lambda: hostile('hdr_loop_49_bytes.hdr')), REFUSED),
    'hdr: 51 bytes claim 8192 x 8192': (sky('sky.hdr', lambda: hostile('hdr_8192_claim.hdr')), REFUSED),
    'hdr: runs of length 0': (sky('sky.hdr', lambda: HEAD + b'-Y 16 +X 16\n' + b'\2\2\0\x10' + b'\0' * 4000), REFUSED),
    'hdr: runs beyond a row': (sky('sky.hdr', lambda: HEAD + b'-Y 16 +X 16\n' + b'\2\2\0\x10' + b'\xff\1' * 4000),
                               REFUSED),
    'hdr: one row of 16384': (sky('sky.hdr', lambda: hdr_runs(16384, 16384, 1)), REFUSED),
    'hdr: a line without an end': (sky('sky.hdr', lambda: b'#?RADIANCE\n' + b'x' * 3000000), REFUSED),
    'hdr: numbers beyond 2^31': (sky('sky.hdr', lambda: HEAD + b'-Y 4294967297 +X 4294967297\n' + bytes(64)), REFUSED),
    'hdr: a FIFO': (lambda w: ['info', w.put('scene.gltf', readers.quad(False)), '--environment',
                               os.path.join(w.case, 'fifo'), *readers.SMALL], (64, 65, 66)),
    'hdr: /dev/zero': (lambda w: ['info', w.put('scene.gltf', readers.quad(False)), '--environment', '/dev/zero',
                                  *readers.SMALL], (64, 65, 66)),
    'exr: a thousandfold, 16384 x 16384': (sky('sky.exr', lambda: exr_bomb(16384)), REFUSED),
    'exr: claims 16384 x 16384': (sky('sky.exr', lambda: exr_of(window=(0, 0, 16383, 16383))), REFUSED),
    'exr: claims 2^31 x 2^31': (
        sky('sky.exr', lambda: exr_of(window=(-(1 << 31), -(1 << 31), (1 << 31) - 1, (1 << 31) - 1))), REFUSED),
    'exr: 3,000 channels': (
        sky('sky.exr',
            lambda: exr_of(channels=b''.join(b'c%04d\0' % i + struct.pack('<iB3xii', 2, 0, 1, 1) for i in range(3000)) +
                           b'\0', window=(0, 0, 4095, 2047))), REFUSED),
    'exr: a preview of 2^32': (
        sky('sky.exr', lambda: exr_of(more=[(b'preview', b'preview', struct.pack('<II', 65535, 65537) + bytes(100))])),
        REFUSED),
    'exr: tiles of 1 x 1': (
        sky('sky.exr', lambda: exr_of(window=(0, 0, 16383, 16383), version=2 | 0x200,
                                      more=[(b'tiles', b'tiledesc', struct.pack('<IIB', 1, 1, 0))])), REFUSED),
    'exr: tiles of 0 x 0': (
        sky('sky.exr', lambda: exr_of(version=2 | 0x200, more=[(b'tiles', b'tiledesc', struct.pack('<IIB', 0, 0, 1))])),
        REFUSED),
    'exr: deep': (
        sky('sky.exr',
            lambda: exr_of(version=2 | 0x800,
                           more=[(b'type', b'string', b'deepscanline'), (b'version', b'int', b'\1\0\0\0'),
                                 (b'chunkCount', b'int', b'\xff\xff\xff\x7f')])), REFUSED),
    'exr: an attribute of 4 GB': (sky('sky.exr', lambda: exr_of()[:8] + b'x\0string\0\xff\xff\xff\x7f' + bytes(100)),
                                  REFUSED),
    'exr: sampled every 2^30th': (
        sky('sky.exr',
            lambda: exr_of(channels=b''.join(c + b'\0' + struct.pack('<iB3xii', 2, 0, 1 << 30, 1 << 30)
                                             for c in (b'B', b'G', b'R')) + b'\0', window=(0, 0, 1 << 20, 1 << 20))),
        REFUSED),
    'exr: DWA of nothing': (sky('sky.exr', lambda: exr_of(window=(0, 0, 1023, 511), compression=8,
                                                          chunks=[(32 * i, bytes(88)) for i in range(16)])), REFUSED),
    'png: a thousandfold, 16384 x 16384': (picture(lambda: png_bomb(16384)), REFUSED),
    'png: claims 16384 x 16384': (picture(lambda: png_of(16384, 16384, 16, 6)), REFUSED),
    'png: claims 2^31': (picture(lambda: png_of((1 << 31) - 1, (1 << 31) - 1, 16, 6)), REFUSED),
    'png: inflates beyond its size': (picture(lambda: png_of(4, 4, stream=formats.zeros_packed(1 << 28))), (0, 65)),
    'png: 200,000 empty chunks': (
        picture(lambda: png_of(4, 4, stream=zlib.compress(bytes(20)), more=[(b'tEXt', b'')] * 200000)), (0, 65)),
    'jpeg: claims 65500 x 65500': (picture(lambda: jpeg_of(65500, 65500)), REFUSED),
    'jpeg: 16384 x 16384 of nothing': (picture(lambda: jpeg_of(16384, 16384)), REFUSED),
    'jpeg: 3,000 progressive scans': (picture(lambda: jpeg_of(4096, 4096, 0xc2, 3000)), REFUSED),
    'jpeg: no end': (picture(lambda: jpeg_of(64, 64)[:-2] + b'\xff' * 3000000), (0, 65)),
    'mtl: map_Kd before a material': (text_scene('s.obj', lambda: hostile('mtl_null', 's.obj'),
                                                 [('m.mtl', lambda: hostile('mtl_null', 'm.mtl'))]), (0, 65)),
    'mtl: 100,000 materials': (text_scene('s.obj', lambda: b'mtllib m.mtl\nusemtl m1\n' + TRIANGLE,
                                          [('m.mtl', lambda: b''.join(b'newmtl m%d\n' % i for i in range(100000)))]),
                               (0, 65)),
    'mtl: a name of 3 MB': (text_scene('s.obj', lambda: b'mtllib m.mtl\nusemtl a\n' + TRIANGLE,
                                       [('m.mtl', lambda: b'newmtl ' + b'a' * 3000000 + b'\n')]), (0, 65)),
    'mtl: a texture elsewhere': (text_scene('s.obj', lambda: b'mtllib m.mtl\nusemtl a\n' + TRIANGLE,
                                            [('m.mtl', lambda: b'newmtl a\nmap_Kd ../outside/secret.png\n')]), (0, 65)),
    'obj: a material file elsewhere': (
        text_scene('s.obj', lambda: b'mtllib ../outside/secret.mtl\nmtllib link/secret.mtl\nmtllib fifo\n' + TRIANGLE),
        (0, 65)),
    'obj: a face of 60,000 corners': (text_scene('s.obj', lambda: b'v 0 0 0\nv 1 0 0\nv 0 1 0\nf' + b' 1 2 3' * 20000 +
                                                 b'\n'), (0, 65)),
    'obj: 100,000 groups': (text_scene('s.obj', lambda: TRIANGLE +
                                       b''.join(b'g g%d\nusemtl m%d\n' % (i, i) for i in range(100000))), (0, 65)),
    'obj: its material file 10,000 times': (text_scene('s.obj', lambda: b'mtllib m.mtl\n' * 10000 + TRIANGLE,
                                                       [('m.mtl', lambda: b'newmtl a\n')]), (0, 65)),
    'obj: continued lines': (text_scene('s.obj', lambda: b'v 0 0 0 ' + b'\\\n' * 1000000 + TRIANGLE), (0, 65)),
    'obj: a number of 3 MB': (text_scene('s.obj', lambda: b'v ' + b'1' * 3000000 + b' 0 0\n' + TRIANGLE), REFUSED),
    'gltf: names with escapes': (text_scene('s.gltf', lambda: hostile('terminal_escape.gltf')), REFUSED),
    'gltf: 2 MB of arrays': (text_scene('s.gltf', lambda: DEEP), REFUSED),
    'gltf: an image of 8 MB of base64': (
        text_scene('s.gltf', lambda: readers.quad(uri='data:image/png;base64,' + 'A' * 8000000)), REFUSED),
    'job: a billion laughs': (job(laughs), REFUSED),
    'job: 300,000 brackets': (job(lambda: b'scene: ' + b'[' * 300000), REFUSED),
    'job: 300,000 nested lists': (job(lambda: b'- ' * 300000), REFUSED),
    'job: a key of 900 kB': (job(lambda: b'k' * 900000 + b': 1\n'), REFUSED),
    'job: an alias to itself': (job(lambda: b'scene: &a [*a]\nobjects: &b {x: *b}\n'), REFUSED),
    'job: a pattern of stars': (
        job(lambda: b'scene: scene.gltf\nobjects: {"' + b'*a' * 3000 + b'b": {exclude: true}}\n'), (0, 65)),
    'job: an output with a name of 8 kB': (job(lambda: b'scene: scene.gltf\noutput: ' + b'a' * 8000 + b'\n'),
                                           (0, 65, 66)),
    'volume: 2^40 values in 1,400 bytes': (baked('volume.hdf', put(lambda: hostile('hdf5', 'volume_2to40_sparse.hdf')),
                                                 *VERIFY), REFUSED),
    'volume: 2^40 values, probed': (baked('volume.hdf', put(lambda: hostile('hdf5', 'volume_2to40_sparse.hdf')),
                                          *PROBE), REFUSED),
    'volume: a flipped bit that HDF5 1.10.8 dies of': (
        baked('volume.hdf', put(lambda: hostile('verify_hdf5_crash', 'volume.hdf')), *VERIFY), REFUSED),
    'volume: the same, probed': (baked('volume.hdf', put(lambda: hostile('verify_hdf5_crash', 'volume.hdf')), *PROBE),
                                 REFUSED),
    'volume: values in /etc/passwd': (baked('volume.hdf', put(lambda: hostile('hdf5', 'volume_extfile.hdf')), *VERIFY),
                                      REFUSED),
    'volume: values in /etc/passwd, probed': (baked('volume.hdf', put(lambda: hostile('hdf5', 'volume_extfile.hdf')),
                                                    *PROBE), REFUSED),
    'volume: values in a FIFO far away': (baked('volume.hdf', put(lambda: hostile('hdf5', 'volume_extfifo.hdf')),
                                                *VERIFY), REFUSED),
    'volume: a link with a wrong checksum': (baked('volume.hdf', put(lambda: hostile('hdf5', 'volume_extlink.hdf')),
                                                   *VERIFY), REFUSED),
    'volume: a heap with a wrong checksum': (baked('volume.hdf', put(lambda: hostile('hdf5', 'volume_virtfifo.hdf')),
                                                   *VERIFY), REFUSED),
    'volume: values in a file elsewhere': (
        baked('volume.hdf', volume(external(lambda w: os.path.join(w.outside, 'secret.bin'))), *PROBE), REFUSED),
    'volume: values in a FIFO': (baked('volume.hdf', volume(external(lambda w: os.path.join(w.case, 'fifo'))), *VERIFY),
                                 REFUSED),
    'volume: values in /dev/zero': (baked('volume.hdf', volume(external(lambda w: '/dev/zero')), *VERIFY), REFUSED),
    'volume: a link to a file elsewhere': (baked('volume.hdf', volume(outside_link), *VERIFY), REFUSED),
    'volume: the same, probed': (baked('volume.hdf', volume(outside_link), *PROBE), REFUSED),
    'volume: virtual, from a file elsewhere': (
        baked('volume.hdf', volume(virtual(lambda w: os.path.join(w.outside, 'secret.hdf'))), *VERIFY), REFUSED),
    'volume: virtual, from a FIFO': (baked('volume.hdf', volume(virtual(lambda w: os.path.join(w.case, 'fifo'))),
                                           *PROBE), REFUSED),
    'volume: claims 2^40 in pieces': (baked('volume.hdf', volume(claims), *VERIFY), REFUSED),
    'volume: 20,000 groups in each other': (baked('volume.hdf', volume(nested), *VERIFY), REFUSED),
    'volume: 30,000 groups': (baked('volume.hdf', volume(many_groups), *VERIFY), (0, 65)),
    'volume: 4 GB of zeros': (baked('volume.hdf', volume(inflates), *VERIFY), REFUSED),
    'volume: a chunk that inflates to 32 MB': (baked('volume.hdf', volume(inflates_wrong), *VERIFY), (0, 65)),
    'volume: the same chunk, probed': (baked('volume.hdf', volume(inflates_wrong), *PROBE), REFUSED),
    'volume: rings of links': (baked('volume.hdf', volume(rings), *VERIFY), (0, 65)),
    'volume: long attributes': (baked('volume.hdf', volume(attribute_of(60000)), *PROBE), REFUSED),
    'volume: a FIFO': (baked('volume.hdf', as_fifo, *PROBE), (65, 66)),
    'volume: a symbolic link elsewhere': (baked('volume.hdf', as_link, *PROBE), (65, 66)),
    'volume: a folder': (baked('volume.hdf', as_folder, *PROBE), (65, 66)),
    'kiln.h5: a FIFO, verified': (baked('kiln.h5', as_fifo, *VERIFY), REFUSED),
    'kiln.h5: 2^40 values': (baked('kiln.h5', put(lambda: hostile('hdf5', 'volume_2to40_sparse.hdf')), *VERIFY),
                             REFUSED),
    'lightmap: a FIFO, compared': (baked('lightmaps/furnace.exr', as_fifo, 'compare', 'FOLDER', 'FOLDER'), (65, 66)),
    'lightmap: a FIFO, reported': (baked('lightmaps/furnace.exr', as_fifo, *REPORT), (0, 65, 66)),
    'lightmap: a FIFO, viewed': (baked('lightmaps/furnace.exr', as_fifo, *VIEW), (65, 66)),
    'lightmap: a symbolic link elsewhere': (baked('lightmaps/furnace.exr', as_link, *REPORT), (0, 65, 66)),
    'lightmap: a thousandfold, verified': (baked('lightmaps/furnace.exr', put(lambda: exr_bomb(4096)), *VERIFY),
                                           (0, 65)),
    'lightmap: a thousandfold, viewed': (baked('lightmaps/furnace.exr', put(lambda: exr_bomb(4096)), *VIEW), (0, 65)),
    'lightmap: claims 2^31 x 2^31': (
        baked('lightmaps/furnace.exr',
              put(lambda: exr_of(window=(-(1 << 31), -(1 << 31), (1 << 31) - 1, (1 << 31) - 1))), *VERIFY), REFUSED),
    'lightmap: chunks of no rows, which a division dies of': (
        baked('lightmaps/furnace.exr', put(lambda: hostile('exr_no_rows_a_chunk.exr')), *VERIFY), REFUSED),
    'scene file: 2^63 triangles': (baked('scene.kscene', sections(triangles=(None, 1 << 63)), *VERIFY), REFUSED),
    'scene file: sections beyond the end': (baked('scene.kscene', sections(objects=((1 << 64) - 64, 1)), *VERIFY),
                                            REFUSED),
    'scene file: no strings': (baked('scene.kscene', sections(strings=(None, 0)), *EXPORT), REFUSED),
    'run.json: 2 MB of brackets': (baked('run.json', put(DEEP), *REPORT), REFUSED),
    'run.json: 2 MB of brackets, status': (baked('run.json', put(DEEP), *STATUS), (0, 65)),
    'run.json: a FIFO': (baked('run.json', as_fifo, *REPORT), (65, 66)),
    'run.json: lightmaps elsewhere': (
        baked('run.json', lambda w,
              path: readers.write(path, readers.read(path).replace(b'lightmaps/', b'../../outside/')), *REPORT),
        (0, 65)),
    'manifest: 2 MB of brackets': (baked('manifest', lambda w, path: readers.write(path, readers.seal(DEEP)), *VERIFY),
                                   REFUSED),
    'manifest: files elsewhere': (baked('manifest', manifest(every_path('lightmaps/../../../outside/secret.bin')),
                                        *VERIFY), REFUSED),
    'manifest: files through a link': (baked('manifest', manifest(every_path('../link/secret.bin')), *VERIFY), REFUSED),
    'manifest: absolute files': (
        baked('manifest', manifest(every_path(lambda w: os.path.join(w.outside, 'secret.bin'))), *VERIFY), REFUSED),
    'manifest: names with escapes': (
        baked('manifest', manifest(every_path('\x1b[31mX\nkiln: 12 files: all as they were written')), *VERIFY),
        REFUSED),
    'manifest: 120,000 files': (baked('manifest', manifest(many_entries), *VERIFY), ANY),
    'manifest: a FIFO': (baked('manifest', as_fifo, *VERIFY), (65, 66)),
    'checkpoint: blocks of 2^62 values': (checkpoint(set_block(2, 1 << 62)), ANY),
    'checkpoint: blocks at 2^63 - 1': (checkpoint(set_block(4, (1 << 63) - 1)), ANY),
    'checkpoint: elements of 0 bytes': (checkpoint(set_block(3, 0)), ANY),
    'checkpoint: elements of 2^62 bytes': (checkpoint(set_block(3, 1 << 62)), ANY),
    'checkpoint: ranges from 2^63 - 1': (checkpoint(set_block(1, (1 << 63) - 1)), ANY),
    'checkpoint: -1 bytes': (checkpoint(set_part('bytes', -1)), ANY),
    'checkpoint: 2 MB of brackets': (checkpoint(lambda w, tree: DEEP), ANY),
    'checkpoint: 20,000 parts': (checkpoint(lambda w, tree: tree.update(parts=tree['parts'] * 20000)), ANY),
    'checkpoint: no parts': (checkpoint(lambda w, tree: tree.update(parts=[])), ANY),
    'checkpoint: a part that is a FIFO': (special_part(as_fifo), ANY),
    'checkpoint: a part that is a link': (special_part(as_link), ANY),
    'checkpoint: a generation that is a link': (linked_generation, (0, 65, 73, 74, 75)),
    'status: 2 MB of brackets': (status(DEEP), (0, 65)),
    'status: names with escapes': (
        status(b'{"state": "running", "phase": "\\u001b[2J\\nkiln: done", "host": "\\u0007", "ranks": 1, "updated": '
               b'1e300, "message": "\\u009b31m"}'), (0, 65, 66)),
    'status: cut UTF-8': (status(b'{"state": "stopped", "phase": "' + '日本語'.encode() * 40 + b'", "message": "' +
                                 'é'.encode() * 400 + b'"}'), (0, 65)),
}
