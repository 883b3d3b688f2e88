"""W/m2 or lux: what the file says, or as asked, in every output."""
import json
import os
import sys
import tempfile

import h5py

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import exr  # noqa: E402
import glb  # noqa: E402
from program import kiln, run_json  # noqa: E402


def scene(path, generator="tests", lamp=True, extras=None, emission=(0, 0, 0)):
    made = glb.Scene()
    made.document["asset"]["generator"] = generator
    made.quad("floor", [[0, 0, 1], [1, 0, 1], [1, 0, 0], [0, 0, 0]], made.material("grey", (0.5, 0.5, 0.5), emission))
    if lamp:
        made.light("lamp", {"type": "point", "intensity": 100.0}, translation=[0.5, 2, 0.5])
    if extras:
        made.document["scenes"][0]["extras"] = extras
    return made.write(path)


BLENDER = "Khronos glTF Blender I/O v4.2.60"

with tempfile.TemporaryDirectory() as folder:
    def units(*options, **words):
        found = json.loads(kiln("info", scene(os.path.join(folder, "scene.glb"), **words), "--json", *options).stdout)
        return found["units"], found["units_because"], " ".join(n["text"] for n in found["notes"])

    assert units()[:2] == ("radiometric", "the file does not say")
    assert units(generator=BLENDER)[:2] == ("photometric", "Blender's exporter writes lights so")
    assert units(generator=BLENDER,
                 lamp=False)[0] == "radiometric", "without lamps there is nothing that Blender converts"
    assert units(generator=BLENDER, extras={"units": "radiometric"})[:2] == ("radiometric", "the file says so")
    assert units(extras={"units": "photometric"})[:2] == ("photometric", "the file says so")
    assert units("--units", "photometric")[:2] == ("photometric", "asked for")
    assert units("--units", "radiometric", generator=BLENDER)[0] == "radiometric"
    assert "683" in units(generator=BLENDER, emission=(1, 1, 1))[2] and "683" not in units(generator=BLENDER)[2]

    path = scene(os.path.join(folder, "lit.glb"), generator=BLENDER)
    values = []
    for choice, irradiance, text, radiance, flux in (("auto", "lx", "lx", "cd m-2", "lm"),
                                                     ("radiometric", "W m-2", "W/m2", "W m-2 sr-1", "W")):
        out = os.path.join(folder, choice)
        kiln("bake", path, "-o", out, "--units", choice, "--texels-per-metre", "8", "--probe-spacing", "0.5",
             "--quality", "draft", "--no-preview",
             "--quiet", "--backend", "embree")
        image = exr.read(os.path.join(out, "lightmaps", "floor.exr"))
        values.append(image.channels["R"])
        assert image.attributes["kiln:units"] == irradiance
        with h5py.File(os.path.join(out, "kiln.h5")) as file:
            for name in ("direct", "indirect", "total", "error"):
                assert file["irradiance"][name].attrs["units"].decode() == irradiance, name
            assert file["points/area"].attrs["units"].decode() == "m2"
        with h5py.File(os.path.join(out, "volume.hdf")) as file:
            for name in ("irradiance_sh", "irradiance_posx", "irradiance_negz"):
                assert file["VTKHDF/PointData"][name].attrs["units"].decode() == irradiance, name
        run = run_json(out)
        assert run["units"]["irradiance"] == irradiance and run["units"]["radiance"] == radiance and run["energy"][
            "units"] == flux, run["units"]
        place = ("0.5", "0.5", "0.5", "0", "1", "0")
        assert json.loads(kiln("probe", out, *place, "--json").stdout)["units"] == irradiance
        assert kiln("probe", out, *place).stdout.split("\n")[0].endswith(text)
        assert f" {text} (reference)" in kiln("compare", out, out).stdout
        view = os.path.join(out, "view.exr")
        kiln("view", out, "-o", view, "--width", "16")
        assert exr.read(view).attributes["kiln:units"] == radiance
        kiln("verify", out)
    assert (values[0] == values[1]).all(), "units name the numbers and change none"
print("units are what the file says, or as asked, everywhere")
