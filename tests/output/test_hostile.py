"""Results that somebody else wrote to do harm: each is answered with 65 and a sentence, soon, in little memory, and
without a byte of any other file. Where there is a manifest, one made to fit what was put there.

Volumes that HDF5 alone would follow out of the folder, unpack for hours or crash on; pictures that promise more than
they hold; links, FIFOs and devices in the place of files; run.json and manifests made to be costly; scene files whose
parts overlap.
"""
import hashlib
import json
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import zlib

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import sealing  # noqa: E402

KILN = os.environ["KILN"]
SHARED = os.path.normpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "..", "shared", "scenes",
                                       "own", "hostile"))
SANITIZED = "ASAN_OPTIONS" in os.environ
CPU = 60.0 if SANITIZED else 2.0  # most cases take hundredths of a second; CPU time, for the machine may be busy
MEMORY = (4 << 30) if SANITIZED else (256 << 20)
PLACE = ["1", "1", "1"]


class Answer:
    def __init__(self, code, out, err, cpu, memory):
        self.code, self.out, self.err, self.cpu, self.memory = code, out, err, cpu, memory


def kiln(*arguments, timeout=float(os.environ.get("KILN_TIMEOUT", "60"))):
    """CPU time and memory are of kiln and its children, each."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = subprocess.Popen([KILN, *arguments], stdin=subprocess.DEVNULL, stdout=out, stderr=err)
        begin = time.monotonic()
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid != 0:
                break
            if time.monotonic() - begin > timeout:
                child.kill()
            time.sleep(0.005)
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        err.seek(0)
        return Answer(child.returncode, out.read().decode("utf-8", "replace"), err.read().decode("utf-8", "replace"),
                      usage.ru_utime + usage.ru_stime,
                      usage.ru_maxrss * 1024)


failures = []


def expect(label, answer, code=65, word=None, memory=MEMORY):
    """65 and one sentence, in time and memory."""
    print(f"{label}: {answer.code}, {answer.cpu:.2f} s, {answer.memory >> 20} MiB: "
          f"{(answer.out + answer.err).strip()[:230]}")
    text = answer.out + answer.err
    problem = (f"ended with {answer.code}, not {code}" if answer.code != code
               else f"took {answer.cpu:.1f} s of CPU time" if answer.cpu > CPU
               else f"took {answer.memory >> 20} MiB" if answer.memory > memory else "said nothing"
               if "kiln: error: " not in answer.err and code != 0
               else f"does not say '{word}'" if word is not None and word not in text else None)
    if problem is not None:
        failures.append(f"{label} {problem}")


# ---- a small bake, and what is put in its place ----

def fresh(base, folder, name):
    copy = os.path.join(folder, name.replace(" ", "_").replace("/", "_"))
    shutil.copytree(base, copy)
    return copy


def probe_and_verify(label, base, folder, make, word=None):
    """`make(path)` puts a volume in the place of the bake's; some are read without a manifest too, and with the one of
    the bake."""
    name, bake = "volume.hdf", fresh(base, folder, label)
    path = os.path.join(bake, name)
    os.remove(path)
    make(path)
    if label.startswith(("raw data of another", "verify_hdf5")):
        expect(label + ", probe, other manifest", kiln("probe", bake, *PLACE), word="written")
    assert sealing.fit(bake, name)
    expect(f"{label}, probe", kiln("probe", bake, *PLACE), word=word)
    expect(f"{label}, verify", kiln("verify", bake), word=word)
    if label.startswith("raw data"):
        os.remove(os.path.join(bake, "manifest"))
        expect(label + ", probe, no manifest", kiln("probe", bake, *PLACE), word=word)
    shutil.rmtree(bake)


# ---- volumes ----

ARRAYS = {"irradiance_sh": 27, "irradiance_posx": 3, "irradiance_negx": 3, "irradiance_posy": 3, "irradiance_negy": 3,
          "irradiance_posz": 3, "irradiance_negz": 3, "validity": 1, "mean_distance": 1, "occluders": 81, "offset": 3}


def volume(path, side=(4, 4, 4), change=None, after=None):
    """A volume as kiln writes it; `change(group, name, shape)` makes a dataset of its own and says so; `after(file)`
    adds to it."""
    with h5py.File(path, "w", libver=("earliest", "v110")) as file:
        grid = file.create_group("VTKHDF")
        grid.attrs["WholeExtent"] = np.array([0, side[2] - 1, 0, side[1] - 1, 0, side[0] - 1], dtype=np.int64)
        grid.attrs["Origin"], grid.attrs["Spacing"] = np.zeros(3), np.ones(3)
        data = grid.create_group("PointData")
        for name, components in ARRAYS.items():
            shape = side if components == 1 else (*side, components)
            if change is None or not change(data, name, shape):
                data.create_dataset(name, data=np.full(shape, 0.75, dtype=np.float32),
                                    chunks=tuple(min(n, 16) for n in shape), compression="gzip",
                                    shuffle=True)
        if after is not None:
            after(file)


def only(array, make):
    """For `change`: `make(group, name, shape)` in the place of one array."""
    def change(group, name, shape):
        if name != array:
            return False
        make(group, name, shape)
        return True
    return change


def low_dataset(group, name, shape, prepare, chunks=None):
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    if chunks is not None:
        plist.set_chunk(chunks)
    prepare(plist)
    return h5py.h5d.create(group.id, name.encode(), h5py.h5t.NATIVE_FLOAT, h5py.h5s.create_simple(shape), plist)


def external(target):
    return only("validity", lambda g, n,
                s: low_dataset(g, n, s, lambda p: p.set_external(target.encode(), 0, int(np.prod(s)) * 4)))


def virtual(target):
    def make(group, name, shape):
        layout = h5py.VirtualLayout(shape=shape, dtype=np.float32)
        layout[...] = h5py.VirtualSource(target, "data", shape=shape)
        group.create_virtual_dataset(name, layout)
    return only("validity", make)


def nested(file):
    """Written bytes by bytes would be faster, but HDF5 makes 20,000 of these in some seconds."""
    group = file.create_group("deep").id
    for _ in range(20000):
        group = h5py.h5g.create(group, b"g")


def inflating(group, name, shape):
    """One chunk of 1 GiB that is stored in 1 MB."""
    rows, columns = 1 << 14, 1 << 14
    dataset = low_dataset(group, name, (rows, columns), lambda p: p.set_deflate(9), (rows, columns))
    packer, packed, block = zlib.compressobj(9), [], bytes(1 << 24)
    for _ in range(rows * columns * 4 >> 24):
        packed.append(packer.compress(block))
    packed.append(packer.flush())
    dataset.write_direct_chunk((0, 0), b"".join(packed), 0)


def many_chunks(group, name, shape):
    """2 GiB in chunks of 4 MiB, 4 kB each."""
    count, values = 512, 1 << 20
    dataset = low_dataset(group, name, (count, values), lambda p: p.set_deflate(9), (1, values))
    packed = zlib.compress(bytes(4 * values), 9)
    for i in range(count):
        dataset.write_direct_chunk((i, 0), packed, 0)


def volumes(base, folder):
    secret = os.path.join(folder, "secret")
    with open(secret, "wb") as file:
        file.write(np.full(64, 0.987654, dtype=np.float32).tobytes())
    other = os.path.join(folder, "other.h5")
    with h5py.File(other, "w") as file:
        file["data"] = np.full((4, 4, 4), 0.987654, dtype=np.float32)
    fifo = os.path.join(folder, "fifo")
    os.mkfifo(fifo)

    def sparse(shape):
        return lambda g, n, s: low_dataset(g, n, shape, lambda p: p.set_deflate(1),
                                           tuple(min(1 << 6, x) for x in shape))

    def committed(group, name, shape):
        group["type"] = np.dtype(np.float32)
        group.create_dataset(name, shape, dtype=group["type"])

    def references(file):
        file.create_dataset("look", (100,), dtype=h5py.regionref_dtype)

    def texts(file):
        file.create_dataset("look", (100,), dtype=h5py.string_dtype())

    def attributes(file):
        for i in range(2000):
            file["VTKHDF/PointData/validity"].attrs["a%d" % i] = np.zeros(64)

    def loop(file):
        file["VTKHDF/loop"] = h5py.SoftLink("/VTKHDF/loop")

    def again(file):
        file["VTKHDF/again"] = file["VTKHDF"]

    def twice(file):
        file["VTKHDF/twice"] = file["VTKHDF/PointData/validity"]

    def away(file):
        file["look"] = h5py.ExternalLink(other, "/data")

    def crowd(file):
        group = file.create_group("crowd")
        for i in range(3000):
            group.create_group("g%d" % i)

    cases = {
        "a sane volume": None,
        "raw data of another file": (external(secret), None, "in another file"),
        "raw data of a FIFO": (external(fifo), None, "in another file"),
        "raw data of a device": (external("/dev/zero"), None, "in another file"),
        "a virtual dataset": (virtual(other), None, "put together"),
        "a virtual dataset over a FIFO": (virtual(fifo), None, "put together"),
        "an external link": (None, away, "link"),
        "a soft link to itself": (None, loop, "link"),
        "a group in itself": (None, again, "names"),
        "a dataset of two names": (None, twice, "names"),
        "20,000 nested groups": (None, nested, "deeper"),
        "3,000 groups": (None, crowd, "256"),
        "a chunk that inflates a thousandfold": (only("validity", inflating), None, "16 MiB"),
        "chunks that inflate a thousandfold": (only("validity", many_chunks), None, "uncompressed"),
        "2^40 values": (only("validity", sparse((1 << 20, 1 << 20))), None, "not stored"),
        "2^63 values": (only("validity", sparse((1 << 21, 1 << 21, 1 << 21))), None, "not stored"),
        "a committed type": (only("validity", committed), None, None),
        "region references": (None, references, "type"),
        "texts of any length": (None, texts, "type"),
        "2,000 attributes": (None, attributes, "attributes"),
    }
    for label, case in cases.items():
        if case is None:
            bake = fresh(base, folder, label)
            volume(os.path.join(bake, "volume.hdf"))
            assert sealing.fit(bake, "volume.hdf")
            for command in (["verify", bake], ["probe", bake, *PLACE]):
                expect(label, kiln(*command), code=0)
            shutil.rmtree(bake)
        else:
            probe_and_verify(label, base, folder, lambda path, c=case: volume(path, change=c[0], after=c[1]), case[2])


def shared_volumes(base, folder):
    """What once did harm, from beside the repository."""
    found = [os.path.join(SHARED, "hdf5", n)
             for n in sorted(os.listdir(os.path.join(SHARED, "hdf5")))] if os.path.isdir(SHARED) else []
    for source in found + [p for p in [os.path.join(SHARED, "verify_hdf5_crash", "volume.hdf")] if os.path.exists(p)]:
        probe_and_verify(os.path.relpath(source, SHARED), base, folder, lambda path, s=source: shutil.copyfile(s, path))


# ---- what is no plain file ----

def places(base, folder):
    outside = os.path.join(folder, "outside")
    shutil.copytree(base, outside)
    for name, commands in (("volume.hdf", (["probe", None, *PLACE],)),
                           ("run.json", (["report", None], ["export", None, "-o", os.path.join(folder, "x", "s.glb")])),
                           ("scene.kscene", (["view", None, "--width", "40", "-o", os.path.join(folder, "v.png")],)),
                           ("lightmaps/floor.exr",
                            (["compare", None, base],
                             ["view", None, "--width", "40", "-o", os.path.join(folder, "v.png")]))):
        for kind in ("link", "FIFO", "device", "folder", "other"):
            bake = fresh(base, folder, "place")
            path = os.path.join(bake, name)
            os.remove(path)
            if kind == "link":
                os.symlink(os.path.join(outside, name), path)
            elif kind == "FIFO":
                os.mkfifo(path)
            elif kind == "device":
                try:
                    os.mknod(path, 0o600 | 0o020000, os.makedev(1, 5))
                except PermissionError:
                    shutil.rmtree(bake)
                    continue
            elif kind == "folder":
                os.mkdir(path)
            else: # of another bake: the same size, another byte
                with open(os.path.join(outside, name), "rb") as file:
                    data = bytearray(file.read())
                data[len(data) // 2] ^= 1
                with open(path, "wb") as file:
                    file.write(data)
            for manifest in (True, False):
                if not manifest and kind == "other":
                    break
                if not manifest:
                    os.remove(os.path.join(bake, "manifest"))
                for command in commands + ((["verify", None],) if manifest and kind in ("link", "FIFO") else ()):
                    expect(f"{name} is a {kind}, {command[0]}", kiln(*[bake if a is None else a for a in command]))
            shutil.rmtree(bake)
    for name in ("lightmaps", "manifest"):
        bake = fresh(base, folder, "place")
        os.rename(os.path.join(bake, name), os.path.join(bake, "elsewhere"))
        os.symlink("elsewhere", os.path.join(bake, name))
        expect(f"{name} is a link, compare", kiln("compare", bake, base), word="link")
        shutil.rmtree(bake)
    fifo = os.path.join(folder, "picture.exr")
    os.mkfifo(fifo)
    expect("compare of a FIFO", kiln("compare", fifo, fifo), word="plain")


# ---- pictures ----

def header(width, height, channels, flags=0, compression=3):
    """An EXR up to its chunk table."""
    def attribute(name, kind, raw):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(raw)) + raw
    listed = b"".join(n.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, 1, 1) for n in channels) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    return (struct.pack("<ii", 20000630, 2 | flags) + attribute("channels", "chlist", listed) +
            attribute("compression", "compression", bytes([compression])) +
            attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window) +
            attribute("lineOrder", "lineOrder", b"\0") +
            attribute("pixelAspectRatio", "float", struct.pack("<f", 1)) +
            attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)) +
            attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0")


def pictures(base, folder):
    good = os.path.join(base, "lightmaps", "floor.exr")
    with open(good, "rb") as file:
        whole = file.read()
    cases = {
        "a header that claims 2^30 pixels": header(1 << 15, 1 << 15, "RGB") + bytes(1 << 12),
        "a header that claims 2^61 pixels": header((1 << 31) - 1, (1 << 31) - 1, "R") + bytes(1 << 12),
        "100,000 channels": header(16, 16, ["c%06d" % i for i in range(100000)]) + bytes(1 << 12),
        "chunks that lie at one place": header(1 << 12, 1 << 12, "RGB") + struct.pack("<Q", 400) * 256 + bytes(1 << 12),
        "a deep picture": header(16, 16, "RGB", flags=0x800) + bytes(1 << 12),
        "several parts": header(16, 16, "RGB", flags=0x1000) + bytes(1 << 12),
        "tiles": header(16, 16, "RGB", flags=0x200) + bytes(1 << 12),
        "half a picture": whole[:len(whole) // 2],
        "no byte": b"",
    }
    for label, data in cases.items():
        bake = fresh(base, folder, "picture")
        with open(os.path.join(bake, "lightmaps", "floor.exr"), "wb") as file:
            file.write(data)
        sealing.fit(bake, "lightmaps/floor.exr")
        commands = [["verify", bake], ["compare", bake, base],
                    ["compare", os.path.join(bake, "lightmaps", "floor.exr"), good]]
        for command in commands + ([["view", bake, "--width", "40", "-o", os.path.join(folder, "v.png")]]
                                   if label.startswith(("a header", "chunks")) else []):
            expect(f"{label}, {command[0]}", kiln(*command))
        report = kiln("report", bake, "-o", os.path.join(folder, "report.html")) # says in the page what it cannot show
        expect(label + ", report", report, code=0)
        shutil.rmtree(bake)


# ---- texts and scenes ----

def texts(base, folder):
    bake = fresh(base, folder, "texts")
    os.remove(os.path.join(bake, "manifest"))
    path = os.path.join(bake, "run.json")
    with open(path) as file:
        run = json.load(file)
    bombs = {"20 million numbers": "[" + "0," * 20000000 + "0]", "a million brackets": "[" * 1000000,
             "a number too large": '{"a": 1' + "0" * 400 + "}",
             "half a string": '{"a": "\\', "not UTF-8": None}
    for label, text in bombs.items():
        with open(path, "wb") as file:
            file.write(b'{"a": "\xff\xfe"}' if text is None else text.encode())
        for command in (["report", bake], ["export", bake, "-o", os.path.join(folder, "x", "s.glb")]):
            expect(f"run.json with {label}, {command[0]}", kiln(*command))
    # costly to draw, and no markup from anywhere
    run["phases"] = [{"name": "<b>p", "seconds": 1.0} for _ in range(100000)]
    run["phases"][0]["per_rank"] = [1.0] * 100000
    run["energy"] = {"units": "</text><script>alert(1)</script>"}
    run["notes"] = ["<" * 1000000]
    with open(path, "w") as file:
        json.dump(run, file)
    page = os.path.join(folder, "report.html")
    expect("a run.json that is costly to draw, report", kiln("report", bake, "-o", page), code=0)
    if os.path.exists(page):
        with open(page) as file:
            text = file.read()
        if "<script>" in text:
            failures.append("the report holds a script from run.json")
        for what in ("phases", "ranks"):
            if f"The first 4096 of 100000 {what}." not in text:
                failures.append(f"the report does not say that {what} are left out")
    shutil.rmtree(bake)
    # manifests
    original = sealing.read(os.path.join(base, "manifest"))
    first = original["files"][0]
    for label, files in (("a file twice", original["files"] + [first]),
                         ("a path upwards", [{**first, "path": "lightmaps/../../secret"}]),
                         ("an absolute path", [{**first, "path": "/etc/passwd"}]),
                         ("a size below 0", [{**first, "bytes": -1}]),
                         ("no files", []), ("files that are none", [3, None]),
                         ("a hash that is none", [{**first, "xxh3_128": "g" * 32}])):
        bake = fresh(base, folder, "manifest")
        sealing.write(os.path.join(bake, "manifest"), {**original, "files": files})
        for command in (["verify", bake], ["probe", bake, *PLACE]):
            expect(f"a manifest with {label}, {command[0]}", kiln(*command), word="manifest")
        shutil.rmtree(bake)


# ---- checkpoints ----

def checkpoints(base, folder):
    """Parts and manifests that fit each other, with counts and values that lie: refused with a sentence, or passed
    over; nothing crashes."""
    scene, stopped = os.path.join(folder, "cornell.glb"), os.path.join(folder, "stopped")
    assert kiln("generate", "cornell", "-o", scene, "--quiet").code == 0
    command = ["bake", scene, "-o", None, "--texels-per-metre", "4", "--samples-indirect", "100000", "--bounces", "2",
               "--no-preview", "--samples-probe",
               "0", "--quiet", "--backend", "embree", "--threads", "1", "--max-time"]

    def bake_into(folder):
        """Until it has come to the light, which takes a slow machine longer."""
        for seconds in ("0.2", "1", "5", "20"):
            run = kiln(*[folder if a is None else a for a in command], seconds)
            if run.code != 75 or "a checkpoint was written" in run.err:
                return run
        return run

    run = bake_into(stopped)
    assert run.code == 75, run.err

    def block(manifest, name):
        return next(b for b in manifest["parts"][0]["blocks"] if b[0] == name)

    def values(name, kind, change):
        def act(manifest, data):
            _, _, count, size, offset = block(manifest, name)
            array = np.frombuffer(bytes(data[offset:offset + count * size]), dtype=kind).copy()
            change(array)
            data[offset:offset + count * size] = array.tobytes()
        return act

    def entry(name, place, value):
        def act(manifest, data):
            block(manifest, name)[place] = value
        return act

    def fill(value, first=0, last=None):
        def act(array):
            array[first:last] = value
        return act

    cases = {
        "infinite light": values("direct", "f4", fill(np.inf)),
        "light that is no number": values("sum", "f4", fill(np.nan)),
        "no unit": values("state", "f8", fill(0.0)),
        "a step that the bake has not": values("steps", "u4", fill(77, 0, 1)),
        "bounces without end": values("state", "u4", fill(0xffffffff, 0, 4)),
        "groups that are no number": values("group_total", "f8", fill(np.nan)),
        "an array that begins beyond all points": entry("direct", 1, (1 << 63) - 1),
        "an array longer than its file": entry("direct", 2, (1 << 62)),
        "an array beyond its file": entry("direct", 4, (1 << 62)),
        "elements of 2^40 bytes": entry("direct", 3, 1 << 40),
        "a million steps": entry("steps", 2, 1000000),
        "no steps": entry("steps", 2, 0),
        "no part": lambda manifest, data: manifest.update(parts=[]),
        "parts that are none": lambda manifest, data: manifest.update(parts=[None, 3]),
        "a part of fewer than no bytes": lambda manifest, data: manifest["parts"][0].update(bytes=-1),
        "a format without a version": lambda manifest, data: (manifest.update(format=99), manifest.pop("kiln")),
        "done ranges beyond all points": values("done", "u8", fill((1 << 64) - 1)),
        "groups that are not there": values("own_groups", "u8", fill((1 << 64) - 1)),
    }
    for label, change in cases.items():
        bake = fresh(stopped, folder, "resumed")
        generation = os.path.join(bake, "checkpoint", sorted(n for n in os.listdir(os.path.join(bake, "checkpoint"))
                                                             if n.startswith("gen-"))[-1])
        with open(os.path.join(generation, "part-00000"), "rb") as file:
            data = bytearray(file.read())
        manifest = sealing.read(os.path.join(generation, "manifest"))
        change(manifest, data)
        with open(os.path.join(generation, "part-00000"), "wb") as file:
            file.write(data)
        if manifest["parts"] and manifest["parts"][0] is not None:
            manifest["parts"][0]["xxh3_128"] = sealing.hash_of(data)
        sealing.write(os.path.join(generation, "manifest"), manifest)
        answer = bake_into(bake)
        told = answer.err.strip()
        print(f"a checkpoint with {label}: {answer.code}, {answer.cpu:.2f} s, {answer.memory >> 20} MiB: {told[:200]}")
        # passed over or of no consequence: the bake goes on to its time limit
        if answer.code not in (65, 74, 75) or (answer.code != 75 and "kiln: error: " not in told) or answer.memory > (
            4 << 30 if SANITIZED else 1 << 29):
            failures.append(f"a checkpoint with {label} ended with {answer.code}, {answer.memory >> 20} MiB")
        if answer.code == 75 and label.startswith(("infinite", "light", "no unit", "bounces")):
            failures.append(f"a checkpoint with {label} was gone on with")
        shutil.rmtree(bake)


# ---- what is opened ----

def fence(base, folder):
    """No system call names a file outside the bake's folder that the bake's files name. As strace sees it."""
    if shutil.which("strace") is None:
        print("the fence is not looked at: strace is not here")
        return
    other = os.path.join(folder, "other.h5")
    with h5py.File(other, "w") as file:
        file["data"] = np.full((4, 4, 4), 0.987654, dtype=np.float32)
    changes = {"external storage": dict(change=external(other)), "a virtual dataset": dict(change=virtual(other)),
               "an external link": dict(after=lambda file: file.__setitem__("look", h5py.ExternalLink(other, "/data")))}
    for label, made in changes.items():
        bake = fresh(base, folder, "fence")
        volume(os.path.join(bake, "volume.hdf"), **made)
        sealing.fit(bake, "volume.hdf")
        for command in (["verify", bake], ["probe", bake, *PLACE]):
            log = os.path.join(folder, "log")
            traced = subprocess.run(["strace", "-f", "-qq", "-e", "trace=open,openat,openat2,readlink,execve,connect",
                                     "-o", log, KILN, *command],
                                    capture_output=True, text=True)
            with open(log) as file:
                calls = file.read()
            if "volume.hdf" not in calls:
                print("the fence is not looked at: strace cannot trace here: " + traced.stderr[:200])
                return
            print(f"{label}, {command[0]}: {len(calls.splitlines())} calls")
            if other in calls:
                failures.append(f"{label}: {command[0]} opens {other}")
        shutil.rmtree(bake)


def main():
    if not sealing.available():
        print("skipped: libxxhash.so.0 is not here, which makes manifests fit")
        sys.exit(77)
    parts = sys.argv[1:] or ["volumes", "shared_volumes", "places", "pictures", "texts", "checkpoints", "fence"]
    with tempfile.TemporaryDirectory() as folder:
        scene, base = os.path.join(folder, "cornell.glb"), os.path.join(folder, "base")
        assert kiln("generate", "cornell", "-o", scene, "--quiet").code == 0
        made = kiln("bake", scene, "-o", base, "--texels-per-metre", "3", "--samples-direct", "1", "--samples-bounce",
                    "1", "--bounces", "1",
                    "--probe-spacing", "2", "--samples-probe", "4", "--no-preview", "--quiet", "--backend", "embree")
        assert made.code == 0, made.err
        expect("the bake itself", kiln("verify", base), code=0)
        for part in parts:
            room = os.path.join(folder, part)
            os.mkdir(room)
            globals()[part](base, room)
    for failure in failures:
        print("FAILED: " + failure)
    sys.exit(1 if failures else 0)


main()
