"""Mutators for HDF5 files: what its library can be asked to write and no honest writer would, and single bytes of the
metadata with its checksums made to fit again."""
import ctypes
import glob
import os
import struct

import h5py
import numpy as np

import formats

SIGNATURES = (b'OHDR', b'OCHK', b'FRHP', b'FHDB', b'FHIB', b'BTHD', b'BTIN', b'BTLF', b'FAHD', b'FADB', b'EAHD',
              b'EAIB', b'EASB', b'EADB', b'SMTB', b'SMLI', b'FSHD', b'FSSE')
SUPERBLOCK = b'\x89HDF\r\n\x1a\n'


def library():
    for path in sorted(glob.glob('/usr/lib/*/libhdf5_serial.so.*') + glob.glob('/usr/lib/*/libhdf5_openmpi.so.*')):
        lib = ctypes.CDLL(path)
        if hasattr(lib, 'H5_checksum_lookup3'):
            lib.H5_checksum_lookup3.restype = ctypes.c_uint32
            lib.H5_checksum_lookup3.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint32)
            return lib
    raise OSError('libhdf5 with H5_checksum_lookup3 is not here')


LIBRARY = library()


def checksum(data):
    return LIBRARY.H5_checksum_lookup3(bytes(data), len(data), 0)


def blocks(data):
    """(offset, length) of each block of metadata that ends with a checksum, found by trying all lengths."""
    found = []
    if data[:8] == SUPERBLOCK and data[8] >= 2 and checksum(data[:44]) == struct.unpack_from('<I', data, 44)[0]:
        found.append((0, 44))
    for signature in SIGNATURES:
        at = data.find(signature)
        while at >= 0:
            base = ctypes.create_string_buffer(data[at:at + 4200], 4200)
            for length in range(8, min(4096, len(data) - at - 4)):
                if LIBRARY.H5_checksum_lookup3(base, length, 0) == struct.unpack_from('<I', data, at + length)[0]:
                    found.append((at, length))
                    break
            at = data.find(signature, at + 1)
    return found


def raw(r, data, table):
    """Changes within the metadata, checksums made to fit; now and then anywhere."""
    data = bytearray(data)
    for _ in range(r.choice((1, 1, 2, 3))):
        if not table or r.random() < 0.1:
            at = r.randrange(len(data))
            data[at] ^= 1 << r.randrange(8)
            continue
        first, length = r.choice(table)
        at = first + r.randrange(4 if first else 8, length)
        kind = r.random()
        if kind < 0.35:
            data[at] ^= 1 << r.randrange(8)
        elif kind < 0.6:
            data[at] = r.choice((0, 1, 2, 3, 4, 5, 8, 12, 16, 127, 128, 254, 255))
        else:
            size = min(r.choice((2, 4, 8)), first + length - at)
            data[at:at + size] = formats.packed(formats.integer(r, int.from_bytes(data[at:at + size], 'little')), size)
        if r.random() < 0.97:
            data[first + length:first + length + 4] = struct.pack('<I', checksum(data[first:first + length]))
    if r.random() < 0.03:
        del data[r.randrange(len(data)):]
    return bytes(data)


def every(file):
    """Paths of all groups and datasets, without following links that lead elsewhere."""
    found = []
    file.visit(found.append)
    return found


def keep_attributes(old, new):
    for key, value in old.items():
        try:
            new.attrs[key] = value
        except (OSError, TypeError, ValueError):
            pass


def bomb(group, name, like, chunk_bytes, chunks):
    """A dataset of zeros, packed a thousandfold."""
    kind = like.dtype if like is not None and like.dtype.kind in 'fiu' else np.dtype('f4')
    tail = like.shape[1:] if like is not None and len(like.shape) > 1 and all(like.shape[1:]) else ()
    row = int(np.prod(tail, dtype=np.int64)) * kind.itemsize
    rows = max(1, chunk_bytes // row)
    made = group.create_dataset(name, shape=(rows * chunks, *tail), dtype=kind, chunks=(rows, *tail),
                                compression='gzip')
    stream = formats.zeros_packed(rows * row)
    for i in range(chunks):
        made.id.write_direct_chunk((i * rows, *(0,) * len(tail)), stream)
    return made


def values_of(kind):
    most = float(np.finfo(kind).max)
    return [v for v in formats.NUMBERS if abs(v) <= most] + [float('nan'), float('inf'), float('-inf')]


def replace(r, file, path, outside):
    """Puts something else in a dataset's place."""
    link = file.get(path, getlink=True)
    old = file.get(path) if isinstance(link, h5py.HardLink) else None
    if not isinstance(old, h5py.Dataset):
        return
    kind, shape = old.dtype, old.shape
    kept = {}
    for key in old.attrs:
        try:
            kept[key] = old.attrs[key]
        except (OSError, TypeError, ValueError, KeyError):
            pass
    # what another mutation has put here is not read: it may lead outside, or to a FIFO
    values = old[()] if old.size is not None and old.size < 100000 and not old.is_virtual and not old.external else None
    group, name = old.parent, path.rsplit('/', 1)[-1]
    how = r.randrange(16)
    del group[name]
    new = None
    if how == 0:
        new = group.create_dataset(name,
                                   shape=tuple(r.choice((0, 1, n, n + 1, 2 * n, 1 << 20, 1 << 40)) for n in shape)
                                   or (3,), dtype=kind, chunks=tuple(max(1, min(n, 4)) for n in shape) or (1,),
                                   maxshape=(None,) * max(1, len(shape)))
    elif how == 1:
        new = group.create_dataset(name, shape=(1 << 40, *shape[1:]), dtype=kind,
                                   chunks=(16, *(max(1, n) for n in shape[1:])))
    elif how == 2:
        other = r.choice(('f8', 'f4', 'f2', 'i1', 'u8', '>f4', 'S5', [('a', 'f4'), ('b', 'S9')], h5py.string_dtype(),
                          h5py.vlen_dtype('f4'), h5py.ref_dtype, ('f4', (3, 3)), h5py.enum_dtype({'A': 1})))
        try:
            new = group.create_dataset(name, shape=shape, dtype=other)
        except (TypeError, ValueError):
            new = group.create_dataset(name, data=1)
    elif how == 3:
        new = group.create_dataset(name, shape=shape or (1,), dtype=kind,
                                   external=[(r.choice(outside), r.choice((0, 1 << 20)), h5py.h5f.UNLIMITED)])
    elif how == 4:
        group[name] = h5py.ExternalLink(r.choice(outside), r.choice(('/', path, 'x')))
    elif how == 5:
        group[name] = h5py.SoftLink(r.choice((path, '/', '/nowhere', name, '..', 'a' * 5000)))
    elif how == 6:
        layout = h5py.VirtualLayout(shape=shape or (1,), dtype=kind)
        layout[...] = h5py.VirtualSource(r.choice(outside), 'x', shape=shape or (1,))
        new = group.create_virtual_dataset(name, layout)
    elif how == 7:
        new = bomb(group, name, None if r.random() < 0.2 else type('Like', (), {'dtype': kind, 'shape': shape}),
                   1 << 24, r.choice((1, 16, 100)))
    elif how == 8:
        group.create_group(name)
    elif how == 9:
        new = group.create_dataset(name, data=h5py.Empty(kind))
    elif how == 10 and values is not None and kind.kind == 'f' and np.size(values):
        values = np.array(values)
        flat = values.reshape(-1)
        for _ in range(r.choice((1, 10, len(flat)))):
            flat[r.randrange(len(flat))] = kind.type(r.choice(values_of(kind)))
        new = group.create_dataset(name, data=values)
    elif how == 11 and values is not None and kind.kind in 'iu' and np.size(values):
        values = np.array(values)
        flat = values.reshape(-1)
        for _ in range(r.choice((1, 10, len(flat)))):
            flat[r.randrange(len(flat))] = np.array(formats.integer(r) & 0x7fffffffffffffff, dtype='u8').astype(kind)
        new = group.create_dataset(name, data=values)
    elif how == 12:
        new = group.create_dataset(name, shape=tuple(reversed(shape)), dtype=kind)
    elif how == 13:
        new = group.create_dataset(name, shape=(*shape, 3), dtype=kind)
    elif how == 14 and values is not None and np.size(values):
        new = group.create_dataset(name, data=np.ravel(values)[:r.randrange(np.size(values) + 1)])
    elif how == 15 and shape and all(shape):  # a chunk of the right name and the wrong bytes
        new = group.create_dataset(name, shape=shape, dtype=kind, chunks=tuple(max(1, n) for n in shape),
                                   compression='gzip', shuffle=r.random() < 0.5, fletcher32=r.random() < 0.5)
        new.id.write_direct_chunk((0,) * len(shape),
                                  r.choice((b'', b'x', formats.zeros_packed(1 << 24),
                                            bytes(r.getrandbits(8) for _ in range(200)))), r.choice((0, 0, 1, 2, 7)))
    if new is not None and r.random() < 0.9:
        for key, value in kept.items():
            try:
                new.attrs[key] = value
            except (OSError, TypeError, ValueError):
                pass


def attribute(r, file, path):
    item = file if path == '' else file.get(path) if isinstance(file.get(path, getlink=True), h5py.HardLink) else None
    if item is None:
        return
    names = list(item.attrs)
    name = r.choice(names) if names and r.random() < 0.9 else 'x'
    how = r.randrange(8)
    if how == 0 and name in item.attrs:
        del item.attrs[name]
    elif how == 1:
        item.attrs[name] = formats.integer(r) & 0x7fffffffffffffff
    elif how == 2:
        item.attrs[name] = r.choice(formats.NUMBERS + [float('nan'), float('inf')])
    elif how == 3:
        text = formats.word(r).replace('\0', '')
        if r.random() < 0.5:
            item.attrs.create(name, text.encode('utf-8', 'replace'))
        else:
            item.attrs.create(name, text, dtype=h5py.string_dtype())
    elif how == 4:
        item.attrs[name] = h5py.Empty('f4')
    elif how == 5:
        item.attrs[name] = np.full(r.choice((0, 1, 2, 3, 4, 1000, 5000)), r.choice(formats.NUMBERS))
    elif how == 6:
        item.attrs.create(name, np.bytes_(b'unterminated' * r.choice((1, 100))))
    else:
        try:
            value = item.attrs[name]
            item.attrs[name] = np.ravel(np.asarray(value))[::-1] if np.ndim(value) else [value] * 3
        except (KeyError, OSError, TypeError, ValueError):
            item.attrs[name] = 0


def grow(r, file, outside):
    """More things than there should be."""
    how = r.randrange(6)
    if how == 0:
        group = file
        for _ in range(r.choice((30, 300, 2000))):
            group = group.create_group('g')
    elif how == 1:
        for i in range(r.choice((100, 2000))):
            file.create_group('many%d' % i)
    elif how == 2:
        file['loop'] = file['/']
    elif how == 3:
        file['link'] = h5py.ExternalLink(r.choice(outside), '/')
    elif how == 4:
        file.create_dataset(formats.word(r).replace('\0', '').replace('/', '_') or 'x', shape=(1 << 40,), dtype='f4',
                            chunks=(1 << 10,))
    else:
        bomb(file, 'bomb', None, 1 << 24, r.choice((1, 64)))


def structure(r, path, outside):
    """Changes the file at `path`, a copy of a good one, through the library."""
    with h5py.File(path, 'r+') as file:
        paths = every(file)  # of the good file: what a mutation has made may be without an end
        for _ in range(r.choice((1, 1, 2))):
            kind = r.random()
            try:
                if kind < 0.55 and paths:
                    replace(r, file, r.choice(paths), outside)
                elif kind < 0.75:
                    attribute(r, file, r.choice(paths + ['']))
                elif kind < 0.85 and paths:
                    del file[r.choice(paths)]
                else:
                    grow(r, file, outside)
            except (OSError, ValueError, TypeError, KeyError, RuntimeError, OverflowError, NotImplementedError):
                continue  # the library would not write it
    if r.random() < 0.1:
        with open(path, 'r+b') as file:
            file.truncate(r.randrange(os.path.getsize(path)))
