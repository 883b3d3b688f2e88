"""Manifests made to fit: JSON that ends with its own hash (coordinator/files/checksummed_json.h), with hashes of the
files as they are."""
import ctypes
import ctypes.util
import json
import os


class _Hash(ctypes.Structure):
    _fields_ = [("low", ctypes.c_uint64), ("high", ctypes.c_uint64)]


def _library():
    for name in (ctypes.util.find_library("xxhash"), "libxxhash.so.0"):
        try:
            library = ctypes.CDLL(name)
            library.XXH3_128bits.restype = _Hash
            library.XXH3_128bits.argtypes = [ctypes.c_char_p, ctypes.c_size_t]
            library.XXH3_64bits_withSeed.restype = ctypes.c_uint64
            library.XXH3_64bits_withSeed.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_uint64]
            return library
        except (OSError, TypeError, AttributeError):
            pass
    return None


_xxhash = _library()


def available():
    return _xxhash is not None


def hash_of(data):
    value = _xxhash.XXH3_128bits(bytes(data), len(data))
    return "%016x%016x" % (value.high, value.low)


def hash64(data, seed):
    return _xxhash.XXH3_64bits_withSeed(bytes(data), len(data), seed & (1 << 64) - 1)


def read(path):
    """What a sealed file says, whether or not its hash fits."""
    with open(path, "rb") as file:
        return json.loads(file.read().rsplit(b"xxh3_128 ", 1)[0])


def write(path, content):
    text = (json.dumps(content, indent=1) + "\n").encode()
    with open(path, "wb") as file:
        file.write(text + b"xxh3_128 " + hash_of(text).encode() + b"\n")


def fit(folder, *names):
    """Lets the manifest of a bake fit these of its files; False when one is no plain file."""
    manifest = read(os.path.join(folder, "manifest"))
    for name in names:
        path = os.path.join(folder, name)
        if os.path.islink(path) or not os.path.isfile(path):
            return False
        with open(path, "rb") as file:
            data = file.read()
        for entry in manifest["files"]:
            if entry["path"] == name:
                entry["bytes"], entry["xxh3_128"] = len(data), hash_of(data)
    write(os.path.join(folder, "manifest"), manifest)
    return True
