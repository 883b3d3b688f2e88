"""The three files of a bake, from a made-up result: the same on any number of ranks, complete, and what they should be.

files.py WRITER MPIEXEC: the program tests/output/write_synthetic.c and the launcher.
"""
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402

WRITER, MPIEXEC = sys.argv[1:3]
KILN = os.environ["KILN"]


def write(folder, ranks, *more):
    os.makedirs(folder)
    run = subprocess.run([MPIEXEC, "-n", str(ranks), WRITER, folder, *more], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    hidden = [n for _, _, names in os.walk(folder) for n in names if n.startswith(".")]
    assert not hidden, f"left behind: {hidden}"
    return [line.split() for line in run.stdout.splitlines()]


def digests(folder):
    """Bytes of the lightmaps; values of the HDF5 files."""
    found = {}
    for name in sorted(os.listdir(os.path.join(folder, "lightmaps"))):
        with open(os.path.join(folder, "lightmaps", name), "rb") as file:
            found[name] = hashlib.sha256(file.read()).hexdigest()
    for name in ("kiln.h5", "volume.hdf"):
        with h5py.File(os.path.join(folder, name)) as file:
            file.visititems(lambda n, d: found.update({name + "/" + n: hashlib.sha256(d[...].tobytes()).hexdigest()})
                            if isinstance(d, h5py.Dataset) else None)
    return found


def check_points(folder):
    with h5py.File(os.path.join(folder, "kiln.h5")) as file:
        def has_words(name, dataset):
            if isinstance(dataset, h5py.Dataset):
                assert dataset.attrs["units"] and dataset.attrs["description"], name
        file.visititems(has_words)
        assert json.loads(file.attrs["provenance"])["scene"] == "synthetic" and file.attrs["seed"] == 77
        assert file.attrs["format_version"] == 1
        points = {n: file["points/" + n][...] for n in file["points"]}
        light = {n: file["irradiance/" + n][...] for n in file["irradiance"]}
        sizes, names = file["objects/lightmap"][...], [n.decode() for n in file["objects/name"][...]]
        assert file["cells/points"][...].sum() == len(points["valid"])
    index = np.arange(len(points["valid"]))
    assert np.array_equal(points["valid"] == 0, index % 37 == 5)
    good = points["valid"] == 1
    direct = 2 + np.sin(0.01 * (index[:, None] * np.arange(1, 4)))
    assert np.abs(light["direct"] - direct)[good].max() < 1e-4
    assert np.array_equal(light["total"], light["direct"] + light["indirect"])
    assert not light["total"][~good].any()
    # the first object's square 0 maps x in 0..1 to u in 0.06..0.41, y in 0..1 to v in 0.11..0.83
    first = points["object"] == 0
    left = first & (points["texel"][:, 0] < 0.41 * 75 - 1) & (points["texel"][:, 0] > 0.06 * 75)
    u, v = (points["position"][left, 0] * 0.35 + 0.06) * 75, (points["position"][left, 1] * 0.72 + 0.11) * 64
    texel = points["texel"][left]
    assert ((u >= texel[:, 0] - 1e-5) & (u <= texel[:, 0] + 1 + 1e-5) & (v >= texel[:, 1] - 1e-5) & (
        v <= texel[:, 1] + 1 + 1e-5)).all()
    whole = (texel[:, 1] > 0.11 * 64) & (texel[:, 1] < 0.83 * 64 - 1)
    # exact at the middle of a texel that lies wholly in the square, whichever triangles cover it
    assert np.abs(u - texel[:, 0] - 0.5)[whole].max() < 1e-4 and np.abs(v - texel[:, 1] - 0.5)[whole].max() < 1e-4
    assert np.allclose(points["normal"], [0, 0, 1])
    assert points["position"][~first, 0].max() < 0 and points["position"][~first, 1].min() >= 3, "the mirrored object"
    return points, light, sizes, names


def at_seam(row, column, height, width):
    """Whether a sampler reads a texel at the seam, which is an edge of either square."""
    return ((np.abs(column - 0.41 * width) < 1.6) & (np.abs(row - 0.47 * height) < 0.36 * height + 1.6)) | (
        (np.abs(row - 0.17 * height) < 1.6) & (np.abs(column - 0.74 * width) < 0.19 * width + 1.6))


def check_lightmaps(folder, points, light, sizes, names, reports):
    for number, name in enumerate(names):
        channels, attributes = exr.read(os.path.join(folder, "lightmaps", name + ".exr"))
        height, width = channels["R"].shape
        assert (width, height) == tuple(sizes[number])
        assert attributes["kiln:units"] == "W m-2" and attributes["kiln:object"] == name and attributes[
            "kiln:seed"] == "77"
        mine = points["object"] == number
        x, y = points["texel"][mine].T
        state = np.zeros((height, width))
        state[y, x] = np.where(points["valid"][mine] == 1, 1, 0.5)
        assert np.array_equal(channels["validity.Y"], state), "validity.Y"
        assert ((channels["coverage.Y"] > 0) == (state > 0)).all()
        # gathered texels away from seams are untouched
        raw = np.full((height, width, 3), np.nan)
        raw[y, x] = light["direct"][mine]
        direct = np.stack([channels["direct." + c] for c in "RGB"], -1)
        untouched = (direct == raw).all(-1)
        assert untouched.sum() > 0.85 * (state == 1).sum()
        for c in "RGB":
            assert np.array_equal(channels[c],
                                  channels["direct." + c] + channels["indirect." + c]), "total is direct + indirect"
            assert np.isfinite(channels[c]).all() and channels[c].min() > 0.5, "every texel has light"
        # the margin is a copy of a nearest texel on the surface, but where a sampler reads it at a seam
        inside, outside = np.argwhere(state > 0), np.argwhere(state == 0)
        seam = at_seam(outside[:, 0] + 0.5, outside[:, 1] + 0.5, height, width)
        assert seam.sum() < 0.1 * len(outside)
        for spot in outside[~seam][::11]:
            distance = ((inside - spot) ** 2).sum(1)
            nearest = inside[distance == distance.min()]
            assert any(np.array_equal(direct[tuple(spot)], direct[tuple(n)]) for n in nearest), f"margin texel {spot}"
        # energy: smoothing moves light, it makes none
        area = np.zeros((height, width))
        area[y, x] = points["area"][mine]
        gathered = state == 1
        change = (area[..., None] * (direct - np.nan_to_num(raw)))[gathered].sum() / (area[..., None] * raw)[
            gathered].sum()
        assert abs(change) < 5e-3, f"{name}: smoothing seams changed the energy by {change}"
        report = reports[number]
        assert [int(v) for v in report[:4]] == [number, gathered.sum(), (state == 0.5).sum(), (state == 0).sum()]
        assert float(report[5]) < 0.2 * float(report[4]), f"{name}: seams {report[4]} before, {report[5]} after"


def check_half(folder):
    first, attributes = exr.read(os.path.join(folder, "lightmaps", "first.exr"))
    assert "65504" in attributes["kiln:precision"] and first["R"].max() > 65504, "what overflows is kept as float"
    with_half = dict(exr.read(os.path.join(folder, "lightmaps", "second.exr")).attributes["channels"])
    assert with_half["R"] == np.float16 and with_half["direct.R"] == np.float16


def check_volume(folder):
    path = os.path.join(folder, "volume.hdf")
    with h5py.File(path) as file:
        group = file["VTKHDF"]
        assert group.attrs["Type"] == b"ImageData" and list(group.attrs["Version"]) == [1, 0]
        assert list(group.attrs["WholeExtent"]) == [0, 4, 0, 3, 0, 2]
        assert list(group.attrs["Origin"]) == [-1, 0, 2] and list(group.attrs["Spacing"]) == [0.5, 0.25, 1]
        harmonics = group["PointData/irradiance_sh"][...]
        assert harmonics.shape == (3, 4, 5, 27)
        posx, validity = group["PointData/irradiance_posx"][...], group["PointData/validity"][...]
        assert posx.shape == (3, 4, 5, 3) and validity.shape == (3, 4, 5)
        distance = group["PointData/mean_distance"][...]
        occluders = group["PointData/occluders"][...]
        offset, state = group["PointData/offset"][...], group["PointData/state"][...]
    x = np.arange(5)
    assert np.allclose(posx[..., 0], 1 + x) and np.allclose(distance, 0.5 + np.arange(3)[:, None, None])
    assert np.allclose(harmonics[..., 0], np.pi * (1 + x) / 0.28209479,
                       rtol=1e-6), "the constant band is pi times radiance"
    assert occluders.shape == (3, 4, 5, 81) and np.count_nonzero(occluders) == 60
    number = np.arange(60).reshape(3, 4, 5)
    assert np.array_equal(offset[..., 1], number) and np.count_nonzero(offset) == 59, "where probes were moved"
    assert np.array_equal(state, number % 4), "what became of the probes"
    assert np.array_equal(occluders[..., 42], 1 + np.arange(60).reshape(3, 4, 5)), "what is around the probes"
    assert validity.argmin() == 3 and np.isclose(validity.min(), 0.1)

    def probe(*numbers):
        run = subprocess.run([KILN, "probe", folder, *map(str, numbers), "--json"], capture_output=True, text=True)
        return run, json.loads(run.stdout) if run.returncode == 0 else None

    # radiance (1 + d.y) (1 + i) at probe i along x: E(n) = pi (1 + i) (1 + 2/3 n.y) for red
    for at, normal in ((0.25, (0, 1, 0)), (0.9, (0, -1, 0)), (-1.0, (0.6, 0.8, 0))):
        _, answer = probe(at, 0.6, 3.5, *normal)
        wanted = np.pi * (1 + (at + 1) / 0.5) * (1 + 2 / 3 * normal[1])
        assert abs(answer["irradiance"][0] - wanted) < 1e-5 * wanted, (answer, wanted)
        assert answer["outside"] is False
    _, answer = probe(0.5, 0, 2)  # where the buried probe stands
    assert answer is None
    _, answer = probe(0.25, 0, 2, 0, 1, 0)  # between it and a good one: the good one alone
    assert abs(answer["irradiance"][0] - np.pi * 3 * 5 / 3) < 1e-4
    run, _ = probe(0.5, 0, 2)
    assert run.returncode == 65 and "inside" in run.stderr
    _, answer = probe(99, 0.5, 3)
    assert answer["outside"] is True
    run, _ = probe(0, 0, 0, 0, 0, 0)
    assert run.returncode == 64


def check_divided(folder):
    """Lightmaps in bands of all ranks: the same bytes and reports on any number of ranks, also where holes reach over
    bands, charts have nothing and objects touch; one that fails to pack ends all ranks, with its sentence."""
    made = [os.path.join(folder, str(n)) for n in (1, 2, 3, 5)]
    reports = [write(one, int(os.path.basename(one)), "divided") for one in made]
    joined = [(os.path.join(folder, mode + str(n)), n, mode)
              for n, mode in ((1, "joined"), (3, "joined"), (2, "rounds-joined"))]
    joined_reports = [write(*one) for one in joined]
    denoised = [os.path.join(folder, "denoised%d" % n) for n in (1, 3)]
    denoised_reports = [write(one, int(one[-1]), "denoised") for one in denoised]
    loose = [os.path.join(folder, "loose%d" % n) for n in (1, 3)]
    loose_reports = [write(one, int(one[-1]), "loose") for one in loose]
    for group, told in ((loose, loose_reports), (made, reports), ([one[0] for one in joined], joined_reports),
                        (denoised, denoised_reports)):
        reference = digests(group[0])
        assert all(report == told[0] for report in told), told
        for one in group[1:]:
            other = digests(one)
            assert other == reference, [n for n in reference if other.get(n) != reference[n]]
    assert joined_reports[0] != reports[0], "seams of objects that touch are smoothed"
    assert digests(denoised[0])["first.exr"] != digests(made[0])["first.exr"], "noise is taken out"
    assert all(int(report[2]) > 1000 for report in reports[0]), "holes"
    # what a killed process left does no harm, and files that are there are replaced
    with open(os.path.join(made[2], "lightmaps", ".first.exr.part"), "wb") as file:
        file.write(b"half a file" * 1000)
    subprocess.run([MPIEXEC, "-n", "3", WRITER, made[2], "divided"], check=True, capture_output=True)
    assert digests(made[2]) == digests(made[0])
    assert not [n for n in os.listdir(os.path.join(made[2], "lightmaps")) if n.startswith(".")]
    failing = os.path.join(folder, "failing")
    os.makedirs(failing)
    run = subprocess.run([MPIEXEC, "-n", "3", WRITER, failing, "divided"], capture_output=True, text=True, timeout=60,
                         env={**os.environ, "KILN_FAILING_PACKER": "2"})
    assert run.returncode == 71, run
    assert all(re.search(r"rank %d: 71: rank 2 on \S+: KILN_FAILING_PACKER" % r, run.stderr)
               for r in range(3)), run.stderr
    assert os.listdir(os.path.join(failing, "lightmaps")) in (["second.exr"],
                                                              []), os.listdir(os.path.join(failing, "lightmaps"))


def points_bytes(folder):
    with open(os.path.join(folder, "kiln.h5"), "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()


def check_points_file(folder, made):
    """kiln.h5, of which every rank writes its own chunks: the same bytes on any number of ranks, whether columns are
    packed ahead, all of them or some, or with direct light that is another one afterwards, and whether ranks keep what
    they pack; h5dump reads it."""
    reference = points_bytes(made[0])
    assert all(points_bytes(one) == reference for one in made[1:]), [points_bytes(one) for one in made]
    for ranks, how in ((1, "ahead"), (1, "changed"), (1, "stopped"), (2, "ahead"), (3, "unkept")):
        one = os.path.join(folder, how + str(ranks))
        reports = [list(map(int, line[1:])) for line in write(one, ranks, "divided", how) if line[0] == "ahead"]
        assert len(reports) == (0 if how == "unkept" else ranks), reports
        if how in ("ahead", "changed"):
            assert all(packed == direct == own for packed, direct, own, _ in reports), reports
            assert sum(size for *_, size in reports) > 0, reports
        assert points_bytes(one) == reference, (how, ranks)
    path = os.path.join(made[2], "kiln.h5")
    with h5py.File(path) as file:
        assert file["points/position"].id.get_num_chunks() > 1, "chunks of several ranks"
        valid = file["points/valid"][...].sum()
    dump = subprocess.run(["h5dump", "-d", "/points/valid", "-y", "-w", "0", path], capture_output=True, text=True)
    assert dump.returncode == 0, dump.stderr
    numbers = re.search(r"DATA \{(.*?)\}", dump.stdout, re.DOTALL).group(1)
    assert sum(map(int, numbers.split(","))) == valid


def check_touching(folder, apart):
    """Two objects that touch: the same bytes on any number of ranks, and whether their maps are kept in memory until
    they are written or made twice. The texels that change lie at the common edge, and at other seams, whose values
    weigh by their area relative to the mean area of the system."""
    made = [(os.path.join(folder, "%s%d" % (mode, ranks)), ranks, mode) for mode in ("touching", "rounds")
            for ranks in (1, 3)]
    for one, ranks, mode in made:
        write(one, ranks, mode)
    files = [{n: d for n, d in digests(one).items() if n.endswith(".exr")} for one, _, _ in made]
    assert len(files[0]) == 2 and all(f == files[0] for f in files), files
    for name, height in (("first", 64), ("second", 33)):
        before, after = (exr.read(os.path.join(f, "lightmaps", name + ".exr"))[0] for f in (apart, made[0][0]))
        row, column = 0.5 + np.argwhere((before["direct.G"] != after["direct.G"]) & (before["validity.Y"] > 0)).T
        joint, seam = np.abs(column - 0.06 * 75) < 1.6, at_seam(row, column, height, 75)
        assert joint.sum() > height / 2 and (joint | seam).all(), (row, column)
        assert np.array_equal(before["error.Y"], after["error.Y"])


def check_full_disk(folder):
    """On file systems too small for the lightmaps, and for the rest: exit 74 and a sentence, nothing half under its
    name."""
    command = ('mount -t tmpfs -o size="$1" tmpfs "$2" || exit 99; "$3" -n "$5" "$4" "$2" $6; code=$?; '
               'find "$2" -type f; exit $code')
    os.makedirs(folder)
    cases = (("60k", set(), 2, ""), ("400k", {"first.exr", "second.exr"}, 2, ""),
             ("700k", {"second.exr"}, 3, "divided"), ("100k", set(), 5, "divided"))
    for size, published, ranks, mode in cases:
        run = subprocess.run(["unshare", "--mount", "sh", "-c", command, "sh", size, folder, MPIEXEC, WRITER,
                              str(ranks), mode],
                             capture_output=True, text=True, timeout=60)
        if run.returncode in (1, 99, 127):
            print("no file system may be mounted here: the full disk was not tried")
            return
        assert run.returncode == 74, run
        assert "No space left" in run.stderr or "make room" in run.stderr, run.stderr
        found = {os.path.basename(line) for line in run.stdout.splitlines() if line.startswith(folder)}
        assert found - {"second.exr"} == published - {"second.exr"}, found


with tempfile.TemporaryDirectory() as temporary:
    folders = [os.path.join(temporary, str(n)) for n in (1, 2, 3, 5)]
    all_reports = [write(folder, int(os.path.basename(folder))) for folder in folders]
    assert all(r == all_reports[0] for r in all_reports), "reports differ between numbers of ranks"
    reference = digests(folders[0])
    for folder in folders[1:]:
        other = digests(folder)
        assert other == reference, [n for n in reference if other.get(n) != reference[n]]
    contents = check_points(folders[2])
    check_lightmaps(folders[2], *contents, all_reports[0])
    check_volume(folders[3])
    write(os.path.join(temporary, "half"), 2, "half")
    check_half(os.path.join(temporary, "half"))
    check_divided(os.path.join(temporary, "divided"))
    check_points_file(os.path.join(temporary, "points"), [os.path.join(temporary, "divided", n) for n in "1235"])
    check_touching(os.path.join(temporary, "touching"), folders[0])
    check_full_disk(os.path.join(temporary, "full"))
print("the same files on 1, 2, 3 and 5 ranks, and right")
