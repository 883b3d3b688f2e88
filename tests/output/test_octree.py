"""What a bake into an octree leaves behind: leaves in kiln.h5, a preview, and no lightmaps; views of it are those of
lightmaps; light at vertices needs no layout; a bake that was stopped goes on to the same bits; options that do not fit
are refused."""
import glob
import json
import os
import signal
import subprocess
import sys
import time
import unittest

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import harness  # noqa: E402
from program import KILN, InOneFolder, content, kiln, run_json  # noqa: E402

CORNELL = os.path.join(harness.REPOSITORY, "jobs", "cornell.glb")
LEAF = 0.21
LIGHT = ("--samples-direct", "64", "--samples-bounce", "16", "--samples-indirect", "64", "--bounces", "2", "--denoise",
         "none", "--samples-probe", "0", "--backend", "embree", "--threads", "1", "--quiet")


def light_of(bake):
    """What must have the same bits."""
    with h5py.File(os.path.join(bake, "kiln.h5"), "r") as f, open(os.path.join(bake, "scene.glb"), "rb") as scene:
        return {name: f[name][...].tobytes() for name in ("irradiance/total", "irradiance/error",
                                                          "vertices/irradiance", "vertices/error")}, scene.read()


def children_of(process):
    with open("/proc/%d/task/%d/children" % (process, process)) as f:
        return [int(child) for child in f.read().split()]


def json_of(path):
    data = content(path)
    return json.loads(data[20:20 + int.from_bytes(data[12:16], "little")])


def rgb(path):
    channels, _ = harness.read_exr(path)
    return np.stack([channels[c] for c in "RGB"], -1).astype(np.float64)


class Octree(InOneFolder):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.bakes = {}
        for store, more in (("lightmap", ("--texels-per-metre", 1 / LEAF, "--no-preview")),
                            ("octree", ("--leaf-size", LEAF))):
            cls.bakes[store] = os.path.join(cls.folder, store)
            kiln("bake", CORNELL, "-o", cls.bakes[store], "--store", store, "--vertex-light", *more, *LIGHT)

    def test_store_vertex(self):
        """--store vertex: an octree's light, fitted to the vertices."""
        folder = os.path.join(self.folder, "vertex")
        kiln("bake", CORNELL, "-o", folder, "--store", "vertex", "--leaf-size", LEAF, "--no-preview", *LIGHT)
        with h5py.File(os.path.join(folder, "kiln.h5"), "r") as f, \
                h5py.File(os.path.join(self.bakes["octree"], "kiln.h5"), "r") as octree:
            self.assertTrue(np.array_equal(f["vertices/irradiance"][...], octree["vertices/irradiance"][...]))
        mesh = json_of(os.path.join(folder, "scene.glb"))["meshes"][-1]
        self.assertIn("COLOR_1", mesh["primitives"][0]["attributes"])
        refused = kiln("bake", CORNELL, "-o", folder, "--store", "vertex", "--no-vertex-light", code=64)
        self.assertIn("exclude each other", refused.stderr)

    def test_files(self):
        names = set(os.listdir(self.bakes["octree"]))
        self.assertEqual(names, {"kiln.h5", "manifest", "preview.png", "run.json", "scene.glb", "scene.kscene"})
        kiln("verify", self.bakes["octree"])
        report = run_json(self.bakes["octree"])
        self.assertEqual(report["store"]["kind"], "octree")
        self.assertEqual(report["store"]["leaf_size"], LEAF)
        self.assertTrue(all(o["lightmap"] is None for o in report["objects"]))
        page = os.path.join(self.folder, "report.html")
        kiln("report", self.bakes["octree"], "-o", page, "--quiet")
        with open(page) as f:
            text = f.read()
        self.assertNotIn("<h2>Lightmaps", text)
        self.assertIn("leaves/m", text)
        look = kiln("info", os.path.join(self.bakes["octree"], "scene.kscene"), code=None)
        self.assertIn("octrees", look.stdout)

    def test_leaves(self):
        with h5py.File(os.path.join(self.bakes["octree"], "kiln.h5"), "r") as f:
            self.assertNotIn("points/texel", f)
            self.assertNotIn("objects/lightmap", f)
            self.assertEqual(f.attrs["leaf_size"], LEAF)
            leaf, position = f["points/leaf"][...], f["points/position"][...]
            normal, facing, thing = f["points/normal"][...], f["points/facing"][...], f["points/object"][...]
            place = (position - f.attrs["leaf_origin"]) / LEAF - leaf
        self.assertTrue((place > -1e-4).all() and (place < 1 + 1e-4).all(), "centroids lie in their leaves")
        along = normal[np.arange(len(facing)), facing // 2] * np.where(facing % 2, -1, 1)
        self.assertGreater(along.min(), 0.577)
        keys = np.column_stack([thing, facing, leaf])
        self.assertEqual(len(np.unique(keys, axis=0)), len(keys), "one point in each leaf")

    def test_view(self):
        pictures = []
        for store, bake in self.bakes.items():
            pictures.append(os.path.join(self.folder, store + ".exr"))
            kiln("view", bake, "-o", pictures[-1], "--width", 96, "--quiet", "--threads", 1)
        a, b = map(rgb, pictures)
        self.assertLess(abs(b.mean() / a.mean() - 1), 0.01)
        self.assertLess(np.sqrt(((a - b) ** 2).mean()) / a.mean(), 0.05)
        self.assertTrue(((a > 0) == (b > 0)).all(), "no place is without light")
        shown = os.path.join(self.folder, "direct.exr")
        kiln("view", self.bakes["octree"], "-o", shown, "--width", 96, "--quiet", "--threads", 1, "--show", "direct")
        self.assertGreater(rgb(shown).max(), 0)
        error = kiln("view", self.bakes["octree"], "-o", shown, "--quiet", "--show", "sh", code=66).stderr
        self.assertIn("has no dataset", error)

    def test_vertices(self):
        light = []
        for bake in self.bakes.values():
            with h5py.File(os.path.join(bake, "kiln.h5"), "r") as f:
                light.append(f["vertices/irradiance"][...].mean())
        self.assertLess(abs(light[1] / light[0] - 1), 0.05)

    def test_scene(self):
        """scene.glb has the light at vertices, no lightmaps, and the source's coordinates."""
        scene, source = (json_of(path) for path in (os.path.join(self.bakes["octree"], "scene.glb"), CORNELL))
        coordinates = [[p["attributes"].get("TEXCOORD_1") for m in s["meshes"][:len(source["meshes"])]
                        for p in m["primitives"]] for s in (scene, source)]
        self.assertEqual(*coordinates)
        self.assertTrue(any("COLOR_1" in p["attributes"] for m in scene["meshes"] for p in m["primitives"]))
        self.assertNotIn(".exr", json.dumps(scene))
        there = os.path.join(self.folder, "there", "scene.glb")
        kiln("export", self.bakes["octree"], "-o", there, "--quiet")
        with open(there, "rb") as f, open(os.path.join(self.bakes["octree"], "scene.glb"), "rb") as g:
            self.assertEqual(f.read(), g.read())
        self.assertIn("has none", kiln("export", self.bakes["octree"], "-o", there, "--atlas", 512, code=64).stderr)

    def test_some_views(self):
        """What the camera sees has light, as with lightmaps, and its view is that of the whole bake."""
        folder, shares, pictures = os.path.join(self.folder, "some"), [], []
        for store, size in (("lightmap", ("--texels-per-metre", 1 / LEAF)), ("octree", ("--leaf-size", LEAF))):
            kiln("bake", CORNELL, "-o", folder, "--store", store, *size, *LIGHT, "--no-preview", "--only-visible-from",
                 "all")
            with h5py.File(os.path.join(folder, "kiln.h5"), "r") as f:
                shares.append((f["irradiance/total"][...].sum(1) > 0).mean())
        self.assertGreater(shares[1], 0.5)
        self.assertLess(shares[1], shares[0] + 0.05)  # bricks are smaller than tiles
        for bake in (folder, self.bakes["octree"]):
            pictures.append(os.path.join(self.folder, "some.exr"))
            kiln("view", bake, "-o", pictures[-1], "--width", 96, "--quiet", "--threads", 1)
            pictures[-1] = rgb(pictures[-1])
        self.assertLess(abs(pictures[0].mean() / pictures[1].mean() - 1), 0.02)

    def test_means(self):
        """run.json has each object's mean and error by its leaves, which are near those by lightmaps."""
        objects, lightmaps = (run_json(self.bakes[store])["objects"] for store in ("octree", "lightmap"))
        with h5py.File(os.path.join(self.bakes["octree"], "kiln.h5"), "r") as f:
            light, error = f["irradiance/total"][...] @ (0.2126, 0.7152, 0.0722), f["irradiance/error"][...]
            area, thing, valid = f["points/area"][...], f["points/object"][...], f["points/valid"][...] > 0
            ends, off = f["vertices/first"][...], f["vertices/error"][...]
        self.assertEqual(run_json(self.bakes["octree"])["vertices"]["count"], ends[-1])
        for i, (a, b) in enumerate(zip(objects, lightmaps)):
            own = valid & (thing == i)
            mean = np.average(light[own], weights=area[own])
            self.assertEqual(a["valid"], own.sum())
            self.assertLess(abs(a["mean"] / mean - 1), 1e-5)
            noise = np.sqrt(np.average(error[own] ** 2, weights=area[own])) / mean
            self.assertLess(abs(a["relative_error"] / noise - 1), 1e-5)
            self.assertLess(abs(a["vertex_error"] / off[i] - 1), 1e-6)
            self.assertLess(abs(a["mean"] / b["mean"] - 1), 0.05)  # the lamp has 49 leaves

    def test_compare(self):
        """Octrees with the same leaves are compared leaf by leaf; others, and lightmaps, where they are read."""
        def compare(a, b):
            return json.loads(kiln("compare", a, b, "--json").stdout)
        folders = [os.path.join(self.folder, name) for name in ("seed", "wide")]
        for folder, more in zip(folders, (("--leaf-size", LEAF, "--seed", 7), ("--leaf-size", 2 * LEAF))):
            kiln("bake", CORNELL, "-o", folder, "--store", "octree", "--no-preview", *more, *LIGHT)
        rows = []
        for bake in (self.bakes["octree"], folders[0]):
            with h5py.File(os.path.join(bake, "kiln.h5"), "r") as f:
                rows.append(f["irradiance/total"][...].astype(float))
                area, thing, valid = f["points/area"][...], f["points/object"][...], f["points/valid"][...] > 0
        found = compare(self.bakes["octree"], folders[0])
        self.assertFalse(found["identical"])
        for i, o in enumerate(run_json(folders[0])["objects"]):
            own = valid & (thing == i)
            rmse = np.sqrt(np.average(((rows[0] - rows[1])[own] ** 2).mean(1), weights=area[own]))
            self.assertLess(abs(found["objects"][o["name"]]["rmse"] / rmse - 1), 0.05)
        self.assertTrue(compare(folders[0], folders[0])["identical"])
        for a, b, most in ((folders[1], folders[0], 0.15), (self.bakes["lightmap"], self.bakes["octree"], 0.12)):
            found = compare(a, b)
            self.assertTrue(found["sampled"] and not found["identical"])
            self.assertLess(found["nrmse"], most)
            self.assertLess(abs(found["channels"]["G"]["mean_difference"] / found["channels"]["G"]["mean"]), 0.02)

    def test_ranks_and_kill(self):
        """The same bits over 3 and 4 ranks, the latter after one of them was killed."""
        command = (CORNELL, "--store", "vertex", "--leaf-size", LEAF, "--no-preview", *LIGHT)
        for ranks, kill in ((3, False), (4, True)):
            folder = os.path.join(self.folder, "ranks%d" % ranks)
            start = ["mpirun", "-n", str(ranks), KILN, "bake", *map(str, command), "-o", folder]
            environment = {**os.environ, **harness.MPI_ENVIRONMENT}
            if kill:
                environment["KILN_SLOW_RANK"] = "1:300"
                bake = subprocess.Popen([*start, "--checkpoint-every", "0.1"], env=environment,
                                        stderr=subprocess.DEVNULL)
                while bake.poll() is None and not glob.glob(os.path.join(folder, "checkpoint", "gen-*")):
                    time.sleep(0.01)
                self.assertIsNone(bake.poll(), "the bake is still under way")
                os.kill(children_of(bake.pid)[1], signal.SIGKILL)
                self.assertNotEqual(bake.wait(), 0)
                del environment["KILN_SLOW_RANK"]
            done = subprocess.run(start, env=environment, capture_output=True, text=True)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(run_json(folder)["restarts"] > 0, kill)
            self.assertEqual(light_of(folder), light_of(self.bakes["octree"]))

    def test_goes_on(self):
        folder = os.path.join(self.folder, "stopped")
        command = ("bake", CORNELL, "-o", folder, "--store", "octree", "--leaf-size", LEAF, "--vertex-light", *LIGHT)
        kiln(*command, "--max-time", 1, "--checkpoint-every", 0.1, code=75, environment={"KILN_SLOW_RANK": "0:100"})
        kiln(*command)
        with h5py.File(os.path.join(folder, "kiln.h5"), "r") as f, \
                h5py.File(os.path.join(self.bakes["octree"], "kiln.h5"), "r") as g:
            self.assertEqual(f["irradiance/total"][...].tobytes(), g["irradiance/total"][...].tobytes())

    def test_refused(self):
        for options, what in ((("--leaf-size", 1), "--store octree"),
                              (("--store", "octree", "--export"), "--vertex-light"),
                              (("--store", "octree", "--denoise", "regression"), "needs lightmaps"),
                              (("--store", "octree", "--check-density"), "needs lightmaps")):
            self.assertIn(what, kiln("bake", CORNELL, "-o", os.path.join(self.folder, "no"), *options, code=64).stderr)
        error = kiln("bake", CORNELL, "-o", os.path.join(self.folder, "no"), "--store", "octree", "--leaf-size", 1e-9,
                     code=65).stderr
        self.assertIn("--leaf-size", error)


if __name__ == "__main__":
    unittest.main()
