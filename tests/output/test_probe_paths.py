"""Light paths at the probes of an irradiance volume: lamps by way of mirrors and glass as computed by hand, walls that
cut spheres, what is left to gather rays, a furnace, and the same bits on any ranks; on a device, too."""
import json
import math
import os
import sys
import tempfile
import unittest

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
import price  # noqa: E402
from program import InOneFolder, kiln, run_json  # noqa: E402

# the scenes are cubes of 2 m: 3 x 3 x 3 probes, the middle one at the origin, with spheres of 1/3 m
SMALL = ("--backend", "embree", "--materials", "auto", "--lightmap-size", "4", "--bounces", "0", "--samples-direct",
         "4", "--samples-probe", "64", "--probe-spacing", "%.9f" % (2 / 3), "--denoise", "none", "--no-preview",
         "--no-export", "--quiet")
PATHS = ("--caustics", "land", "--photons", "20000", "--iterations", "4")
AXES = ("posx", "negx", "posy", "negy", "posz", "negz")


def glossy(scene, name, albedo, roughness, double_sided=False, **extensions):
    """A metal of that roughness; with extensions no metal."""
    number = scene.material(name, (albedo,) * 3, double_sided=double_sided)
    material = scene.document["materials"][number]
    material["pbrMetallicRoughness"].update(metallicFactor=0.0 if extensions else 1.0, roughnessFactor=roughness)
    if extensions:
        material["extensions"] = extensions
        scene.used.update(extensions)
    return number


def corners(scene):
    """Specks that give the scene its extent, and do nothing else to its light."""
    black = scene.material("speck", double_sided=True)
    for name, (x, y, z) in (("low", (-1, -1, -1)), ("high", (1, 1, 1))):
        scene.mesh(name, [(x, y, z), (x - math.copysign(1e-3, x), y, z), (x, y, z - math.copysign(1e-3, z))],
                   [(0, 0), (1, 0), (0, 1)], [(0, 1, 2)], black)
    return black


def level(scene, name, y, material):
    """A square of 2 m that looks up."""
    scene.quad(name, [(-1, y, 1), (1, y, 1), (1, y, -1), (-1, y, -1)], material)


def sun(scene, angle=0.0, strength=3.0):
    """From above; from -x where its angle from there is more than 0."""
    half, a = math.sqrt(0.5), math.radians(angle) / 2  # about x, then about z
    c, s = math.cos(a), math.sin(a)
    scene.light("sun", {"type": "directional", "intensity": strength, "color": [1, 1, 1]},
                rotation=[-half * c, -half * s, half * s, half * c])


class ProbePaths(InOneFolder):
    def bake(self, scene, *options, ranks=0):
        """The folder of a bake of a scene, or of a scene's file."""
        folder = tempfile.mkdtemp(dir=self.folder)
        path = scene if isinstance(scene, str) else scene.write(os.path.join(folder, "scene.glb"))
        kiln("bake", path, "-o", os.path.join(folder, "bake"), *SMALL, *options, ranks=ranks)
        return os.path.join(folder, "bake")

    @staticmethod
    def volume(folder):
        with h5py.File(os.path.join(folder, "volume.hdf")) as file:
            return {name: data[...] for name, data in file["VTKHDF/PointData"].items()}

    def at_origin(self, folder):
        """Irradiance along the axes, in green."""
        volume = self.volume(folder)
        return {axis: float(volume["irradiance_" + axis][1, 1, 1, 1]) for axis in AXES}

    def close(self, found, tolerance, **expected):
        for axis in AXES:
            self.assertAlmostEqual(found[axis], expected.get(axis, 0.0), delta=tolerance, msg=(axis, found))

    def test_mirror(self):
        """A mirror sends the sun up; gather rays alone do not find it."""
        scene = glb.Scene()
        corners(scene)
        level(scene, "mirror", -1, glossy(scene, "silver", 0.8, 0.0))
        sun(scene, angle=20.0)
        along, up = 3.0 * math.sin(math.radians(20)), 3.0 * math.cos(math.radians(20))
        share = 0.8 + 0.2 * (1 - math.cos(math.radians(20))) ** 5
        path = scene.write(os.path.join(self.folder, "mirror.glb"))
        for way in ("land", "merge", "vcm"):
            folder = self.bake(path, *PATHS, "--caustics", way)
            found = self.at_origin(folder)
            self.close(found, 0.02, negx=(1 + share) * along, posy=up, negy=share * up)
            # harmonics hold the mean of all directions: radiance over the sphere times Y00, times pi
            mean = self.volume(folder)["irradiance_sh"][1, 1, 1, 1]
            self.assertAlmostEqual(mean / (0.282095 * math.pi * 3.0), 1 + share, delta=0.01)
        self.close(self.at_origin(self.bake(path, "--caustics", "gather")), 1e-5, negx=along, posy=up)

    def test_lamp(self):
        """A point by a mirror: as from its image. What falls straight from an image on a surface is a harmonic
        function of the place, whose mean over a sphere is that in the middle."""
        scene = glb.Scene()
        corners(scene)
        level(scene, "mirror", -1, glossy(scene, "silver", 0.9, 0.0))
        scene.light("lamp", {"type": "point", "intensity": 5.0, "color": [1, 1, 1]}, translation=[0.1, 0.5, 0])
        found = self.at_origin(self.bake(scene, *PATHS))
        distance = math.hypot(0.1, 2.5)
        self.assertAlmostEqual(found["negy"], 0.9 * 5.0 * 2.5 / distance ** 3, delta=0.02)
        self.assertAlmostEqual(found["posy"], 5.0 * 0.5 / math.hypot(0.1, 0.5) ** 3, delta=1e-3)

    def test_pane(self):
        """Of the sun a pane of glass of index n = 1.5 lets 2 n / (n^2 + 1) through, with all reflections within."""
        scene = glb.Scene()
        corners(scene)
        glass = glossy(scene, "glass", 1.0, 0.0, KHR_materials_transmission={"transmissionFactor": 1.0},
                       KHR_materials_volume={"thicknessFactor": 0.1}, KHR_materials_ior={"ior": 1.5})
        glb.box(scene, "pane", (-1, 0.8, -1), (1, 0.9, 1), glass)
        sun(scene)
        self.close(self.at_origin(self.bake(scene, *PATHS)), 0.02, posy=3.0 * 2 * 1.5 / (1.5 ** 2 + 1))

    def test_walls(self):
        """A wall that cuts the sphere takes nothing from the light of the probe's own side, and the light of the other
        side does not count; behind it there is none."""
        for lit in (False, True):
            scene = glb.Scene()
            black = corners(scene)
            level(scene, "mirror", -1, glossy(scene, "silver", 0.8, 0.0))
            scene.quad("wall", [(0.15, -1, 1), (0.15, -1, -1), (0.15, 1, -1), (0.15, 1, 1)], black)
            scene.quad("roof", [(x, 1, z) for x, z in (((0.15, 1), (1, 1), (1, -1), (0.15, -1)) if lit else
                                                       ((-1, 1), (0.15, 1), (0.15, -1), (-1, -1)))], black)
            sun(scene)
            found = self.at_origin(self.bake(scene, *PATHS))
            self.close(found, 0.03, **({"posy": 3.0, "negy": 2.4} if lit else {}))

    def test_what_rays_find(self):
        """Rough metal, and a sky that is everywhere the same, are the gather rays': the same bits without light
        paths."""
        rough, sky = glb.Scene(), glb.Scene()
        for scene, roughness in ((rough, 0.7), (sky, 0.0)):
            corners(scene)
            level(scene, "metal", -1, glossy(scene, "metal", 0.8, roughness))
        sun(rough)
        for scene, more in ((rough, ()), (sky, ("--environment", "1,2,3"))):
            with_paths, without = (self.volume(self.bake(scene, *more, *way))
                                   for way in (PATHS, ("--caustics", "gather")))
            self.assertGreater(float(without["irradiance_negy"].max()), 0.1)
            for name, data in with_paths.items():
                np.testing.assert_array_equal(data, without[name], err_msg=name)

    def test_gloss(self):
        """Of a small lamp rays of a few probes find enough, where they are many: by a mirror, by gloss and by both
        one after the other, as much as paths and rays bring together."""
        scene = glb.Scene()
        corners(scene)
        level(scene, "metal", -1, glossy(scene, "metal", 0.8, 0.35))
        scene.quad("lamp", [(x / 5, 1, z / 5) for x, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))],
                   scene.material("lamp", (0,) * 3, (1,) * 3))
        glb.box(scene, "mirror", (0.7, -0.9, -0.9), (0.9, 0.9, 0.9), glossy(scene, "silver", 0.9, 0.0))
        folders = [self.bake(scene, *way) for way in (PATHS, ("--caustics", "gather", "--samples-probe", "131072"))]
        for axis in AXES:
            paths, rays = (self.volume(folder)["irradiance_" + axis][:, :, :2, 1].mean() for folder in folders)
            self.assertAlmostEqual(paths / max(rays, 0.1), rays / max(rays, 0.1), delta=0.02, msg=axis)

    def test_furnace(self):
        """Walls of albedo 0.5 that emit 1 make a radiance of 2 everywhere; a mirror in the room changes nothing. Nor
        does it under a sky with an image that is 1 all over."""
        scene = glb.Scene()
        glb.box(scene, "room", (-1, -1, -1), (1, 1, 1), scene.material("glow", (0.5,) * 3, (1,) * 3), range(6))
        glb.box(scene, "mirror", (-0.3, -0.3, -0.3), (0.1, 0.1, 0.1), glossy(scene, "silver", 1.0, 0.0))
        folder = self.bake(scene, *PATHS, "--bounces", "10", "--samples-direct", "64", "--samples-bounce", "64",
                           "--lightmap-size", "8", "--samples-probe", "1024")
        light = self.volume(folder)["irradiance_sh"][..., 1] * 0.282095 / (2 * math.pi)
        self.assertAlmostEqual(float(light.mean()), 1.0, delta=0.02)
        self.assertLess(float(abs(light - 1.0).max()), 0.06)
        scene, sky = glb.Scene(), os.path.join(self.folder, "sky.hdr")
        with open(sky, "wb") as file:  # mantissas of 128 and the exponent 1: 128 / 256 * 2
            file.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + bytes((128, 128, 128, 129)) * 8)
        corners(scene)
        glb.box(scene, "mirror", (-0.9, -0.9, -0.9), (0.9, -0.8, 0.9), glossy(scene, "silver", 1.0, 0.0))
        for way in (PATHS, ("--caustics", "gather")):
            folder = self.bake(scene, *way, "--environment", sky, "--samples-probe", "4096")
            self.close(self.at_origin(folder), 0.03 * math.pi, **dict.fromkeys(AXES, math.pi))

    def test_same_bits(self):
        """Any ranks and threads; with probes inside of geometry, more paths in run.json than without."""
        scene = glb.Scene()
        corners(scene)
        level(scene, "mirror", -1, glossy(scene, "silver", 0.8, 0.1))
        glb.box(scene, "box", (-0.5, -0.6, -0.5), (0.4, 0.3, 0.4), scene.material("grey", (0.5,) * 3))
        sun(scene, angle=30.0)
        path = scene.write(os.path.join(self.folder, "bits.glb"))
        more = (*PATHS, "--photons", "5001", "--probe-spacing", "0.25")
        alone = self.bake(path, *more, "--threads", "1")
        expected = self.volume(alone)
        self.assertTrue(all((expected["state"] == state).any() for state in (0, 1, 2)))
        for ranks, threads in ((3, 1), (4, 2)):
            found = self.volume(self.bake(path, *more, "--threads", str(threads), ranks=ranks))
            for name, data in expected.items():
                np.testing.assert_array_equal(found[name], data, err_msg=name)
        rays = []
        for folder in (alone, self.bake(path, "--caustics", "gather", "--probe-spacing", "0.25")):
            rays.append(run_json(folder)["rays"]["probes"])
        self.assertGreater(rays[0], rays[1] + 4 * 5001)

    @price.long
    def test_device(self):
        """A device traces the paths itself, and brings what Embree does but for rounding; the same bits on any ranks. A
        software device takes minutes to make the kernels."""
        listed = kiln("info", "--devices", "--json")
        if not any(d["fit"] for d in json.loads(listed.stdout)["vulkan"]):
            self.skipTest("no Vulkan device")
        scene = glb.Scene()
        corners(scene)
        level(scene, "mirror", -1, glossy(scene, "silver", 0.8, 0.1))
        glb.box(scene, "box", (-0.5, -0.6, -0.5), (0.4, 0.3, 0.4), scene.material("grey", (0.5,) * 3))
        scene.light("lamp", {"type": "point", "intensity": 5.0, "color": [1, 1, 1]}, translation=[0.1, 0.8, 0])
        path = scene.write(os.path.join(self.folder, "device.glb"))
        more = (*PATHS, "--photons", "5001", "--probe-spacing", "0.25", "--samples-probe", "4",
                "--watchdog", "0")
        embree, one, three = (self.bake(path, *more, "--backend", backend, ranks=ranks)
                              for backend, ranks in (("embree", 0), ("vulkan", 0), ("vulkan", 3)))
        expected, found, other = (self.volume(folder) for folder in (embree, one, three))
        self.assertTrue(all((found["state"] == state).any() for state in (0, 1, 2)))
        for name, data in found.items():
            np.testing.assert_array_equal(other[name], data, err_msg=name)
        for axis in AXES:
            a, b = (volume["irradiance_" + axis][..., 1] for volume in (expected, found))
            self.assertLess(float(abs(a - b).max()), 1e-3 * float(a.max()), axis)
        self.assertEqual(run_json(one)["volume"]["light_paths"], {"traced": 4 * 5001, "on_host": 0})


if __name__ == "__main__":
    unittest.main()
