"""--caustics merge, vcm: light that lands counts nearby: flux stays, edges are not darkened, errors are as said."""
import os
import sys
import unittest

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import glb  # noqa: E402
import price  # noqa: E402
from program import InOneFolder, kiln, run_json  # noqa: E402

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
SMALL = ("--backend", "embree", "--materials", "auto", "--samples-probe", "0", "--denoise", "none", "--bounces", "0",
         "--samples-direct", "4", "--samples-bounce", "2", "--samples-indirect", "4", "--no-preview", "--quiet")
SPHERES = ("--texels-per-metre", "6", "--photons", "20000", "--iterations", "3")


def corner(path):
    """A mirror on the floor, with a wall at its end that a slant sun lights straight and by the mirror, both evenly;
    another wall beside it, which the sun's light passes along; and a third that goes on in the plane of the first,
    behind the mirror's reach."""
    scene = glb.Scene()
    white = scene.material("white", (0.5, 0.5, 0.5))
    mirror = scene.material("mirror", (1, 1, 1))
    scene.document["materials"][mirror]["pbrMetallicRoughness"].update(metallicFactor=1.0, roughnessFactor=0.0)
    scene.quad("lit", [(0, 0, 1), (0, 0, -1), (0, 2, -1), (0, 2, 1)], white)
    scene.quad("beside", [(0, 0, -1), (2, 0, -1), (2, 2, -1), (0, 2, -1)], white)
    scene.quad("mirror", [(0, 0, 1), (3, 0, 1), (3, 0, -1), (0, 0, -1)], mirror)
    scene.light("sun", {"type": "directional", "intensity": 1000.0}, rotation=[-0.5, 0.5, 0.0, 0.5**0.5])
    return scene.write(path)


class Merge(InOneFolder):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.number = 0
        cls.spheres = os.path.join(cls.folder, "spheres.glb")
        kiln("generate", "cornell-spheres", "-o", cls.spheres, "--quiet")

    def bake(self, scene, *options, ranks=0, code=0):
        """The folder of the bake; or what it says where it ends with another code."""
        Merge.number += 1
        folder = os.path.join(self.folder, "bake%d" % Merge.number)
        done = kiln("bake", scene, "-o", folder, *SMALL, *options, ranks=ranks, code=code)
        return folder if code == 0 else done.stderr

    def many_paths(self, photons, *fine):
        """The light that many paths bring, nearly without noise."""
        return self.light(self.bake(self.spheres, *fine, "--caustics", "land", "--photons", photons, "--iterations",
                                    "4", "--seed", "9"))

    @staticmethod
    def light(folder):
        """By object and texel, whatever the order of points is."""
        with h5py.File(os.path.join(folder, "kiln.h5")) as file:
            objects, texels = file["points/object"][...], file["points/texel"][...]
            order = np.lexsort((*texels.reshape(len(objects), -1).T, objects))
            values = {name: file["irradiance"][name][...][order] for name in file["irradiance"]}
            values.update({name: file["points"][name][...][order] for name in ("area", "object", "position", "texel")})
            values["names"] = [name.decode() for name in file["objects/name"][...]]
            return values

    @staticmethod
    def dots(light, name):
        """The share of a quad's texels that have less than 0.4 of the light of those about them."""
        on = light["object"] == light["names"].index(name)
        x, y = light["texel"][on].astype(int).T[-2:]
        image = np.full((y.max() + 1, x.max() + 1), np.nan)
        image[y, x] = light["caustic"][on] @ LUMINANCE
        around = np.nanmean([image[1 + i:image.shape[0] - 1 + i, 1 + j:image.shape[1] - 1 + j]
                             for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)], 0)
        return np.mean((image[1:-1, 1:-1] < 0.4 * around)[around > np.nanmean(image)])

    @staticmethod
    def report(folder):
        return run_json(folder)

    def test_edges(self):
        """The closed form: the mirror brings the wall what the sun does, in the middle, at edges and in corners."""
        scene = corner(os.path.join(self.folder, "corner.glb"))
        light = self.light(self.bake(scene, "--texels-per-metre", "8", "--caustics", "merge", "--photons", "200000",
                                     "--iterations", "2", "--merge-radius", "0.5", "--radius-alpha", "1"))
        wall = light["object"] == light["names"].index("lit")
        ratio = (light["caustic"] @ LUMINANCE)[wall] / (light["direct"] @ LUMINANCE)[wall].mean()
        away = 1 - np.abs(light["position"][wall][:, [1, 2]] - (1, 0))  # from edges, m
        edges = (away < 0.25).sum(1)
        for name, part, limit in (("middle", edges == 0, 0.02), ("edges", edges == 1, 0.02),
                                  ("corners", edges == 2, 0.04)):
            print("%-8s %.4f of the direct light on %d texels" % (name, ratio[part].mean(), part.sum()))
            self.assertLess(abs(ratio[part].mean() - 1), limit, name)
        beside = light["object"] == light["names"].index("beside")
        self.assertEqual(light["caustic"][beside].max(), 0.0)

    def test_flux(self):
        """What is merged is what landed, to rounding, by any radius; the ledger is the same. So small a radius that no
        texel has another within it is the texel."""
        land, texel, tiny, far = (self.bake(self.spheres, *SPHERES, "--caustics", *which)
                                  for which in (("land",), ("merge", "--merge-radius", "texel"),
                                                ("merge", "--merge-radius", "1e-6"),
                                                ("merge", "--merge-radius", "0.7")))
        of_land, power = self.light(land), {}
        for name, folder in (("land", land), ("texel", texel), ("tiny", tiny), ("far", far)):
            light = self.light(folder)
            power[name] = (light["caustic"] * light["area"][:, None]).sum(0)
            self.assertTrue(np.allclose(power[name], power["land"], rtol=1e-5), (name, power))
            self.assertAlmostEqual(self.report(folder)["energy"]["residual"],
                                   self.report(land)["energy"]["residual"], places=5)
            if name in ("texel", "tiny"):
                self.assertTrue(np.allclose(light["caustic"], of_land["caustic"], rtol=1e-5, atol=1e-7), name)
            self.assertEqual(light["caustic"].min(), 0.0 if name != "far" else light["caustic"].min())
        self.assertGreater((self.light(far)["caustic"] > 0).sum(), 1.02 * (of_land["caustic"] > 0).sum())

    def test_receivers(self):
        """What no path meets gathers its caustics, and takes no part in merging: then the floor has what it has with
        --caustics gather, with all of its rays, and flux and ledger are the others'."""
        rules = "{floor: {role: receiver-only}}"
        lights = {which: self.light(self.bake(self.spheres, *(SPHERES if which != "gather" else SPHERES[:2]),
                                              "--samples-indirect", "64", "--objects", rules, "--caustics", which))
                  for which in ("land", "merge", "vcm", "gather")}
        floor = lights["land"]["object"] == lights["land"]["names"].index("floor")
        self.assertGreater(lights["gather"]["caustic"][floor].max(), 0.1)
        power = {which: (light["caustic"] * light["area"][:, None])[~floor].sum(0) for which, light in lights.items()}
        for which in ("land", "merge"):
            self.assertTrue(np.array_equal(lights[which]["caustic"][floor], lights["gather"]["caustic"][floor]), which)
            self.assertTrue(np.allclose(power[which], power["land"], rtol=1e-5), power)
        self.assertTrue(np.array_equal(lights["vcm"]["caustic"][floor], lights["gather"]["caustic"][floor]))

    def test_rays_of_a_point(self):
        """Rays that share the light with paths are a fourth of a gather's, unless they show images of lamps in
        mirrors."""
        images = corner(os.path.join(self.folder, "images.glb"))
        for scene, options, rays in ((self.spheres, (), 4),
                                     (self.spheres, ("--target-error", "0.5"), 2), (images, (), 16)):
            report = self.report(self.bake(scene, "--texels-per-metre", "2", "--samples-indirect", "16", "--photons",
                                           "500", "--iterations", "1", "--caustics", "vcm", *options))
            self.assertEqual(report["materials"]["rays"], rays, options)

    def test_receivers_are_told_of(self):
        """Where lamps have no extent such objects lack what only light paths find, and a note says so."""
        scene = os.path.join(self.folder, "prism.glb")
        kiln("generate", "prism", "-o", scene, "--quiet")
        for options, told in (((), False), (("--objects", "{right: {role: receiver-only}}"), True)):
            report = self.report(self.bake(scene, *SPHERES, "--caustics", "land", *options))
            self.assertEqual("receivers_gather" in report["materials"], told)
            self.assertEqual(any("(1 here): of caustics" in note for note in report["notes"]), told)

    @price.long
    def test_rays(self):
        """--caustics vcm spreads what gather rays find, too: flux stays, and the error falls, here on a ball where rays
        find nearly all."""
        way = ("--texels-per-metre", "4", "--materials", "full", "--caustics", "vcm", "--photons", "200000",
               "--iterations", "1", "--samples-indirect", "4")
        texel, near, best = (self.light(self.bake(self.spheres, *way, *more)) for more in
                             (("--merge-radius", "texel"), (),
                              ("--merge-radius", "texel", "--samples-indirect", "1024", "--seed", "9")))
        power = [(light["caustic"] * light["area"][:, None]).sum(0, dtype=float) for light in (texel, near)]
        self.assertTrue(np.allclose(*power, rtol=1e-5), power)
        ball = best["object"] == best["names"].index("mirror_ball")
        off = [np.sqrt((light["area"] * ((light["caustic"] - best["caustic"]) @ LUMINANCE)**2)[ball].sum())
               for light in (texel, near)]
        print("error %.4f, spread %.4f" % tuple(off))
        self.assertLess(off[1], 0.4 * off[0])

    def test_shared(self):
        """--caustics vcm spreads what lands as far as it suits each place: flux stays or is told, so small a radius
        that no texel has another within it is the texel, the error falls, and a caustic's edge stays: what lies dark
        beside it does not get its light. Where nothing has landed by chance it is not dark."""
        fine = ("--texels-per-metre", "12")
        more = ("--photons", "20000", "--iterations", "4", "--caustics", "vcm")
        radii = (("--merge-radius", "texel"), ("--merge-radius", "1e-6"), ())
        folders = [self.bake(self.spheres, *fine, *more, *radius) for radius in radii]
        texel, tiny, near = (self.light(folder) for folder in folders)
        best = self.many_paths("120000", *fine)
        self.assertTrue(np.allclose(tiny["caustic"], texel["caustic"], rtol=1e-5, atol=1e-7))
        power = [(light["caustic"] * light["area"][:, None]).sum(0, dtype=float) for light in (texel, near)]
        power[1] += self.report(folders[2])["energy"]["unfound"]  # of objects that hardly any path has met
        self.assertTrue(np.allclose(*power, rtol=1e-5), power)
        off = [np.sqrt((light["area"] * ((light["caustic"] - best["caustic"]) @ LUMINANCE)**2).sum())
               for light in (texel, near)]
        dark = best["caustic"] @ LUMINANCE < 0.01 * (best["caustic"] @ LUMINANCE).mean()
        shares = [(light["area"] * (light["caustic"] @ LUMINANCE))[dark].sum() / (p @ LUMINANCE)
                  for light, p in zip((texel, near), power)]
        print("error %.4f, spread %.4f; in the dark %.5f, spread %.5f of the light" % (*off, *shares))
        self.assertLess(off[1], 0.7 * off[0])
        self.assertLess(shares[1], shares[0] + 0.005)
        dots = self.dots(near, "back")
        print("%.4f of the wall is dark by chance" % dots)
        self.assertLess(dots, 0.004)
        self.assertTrue(0.1 < self.report(folders[2])["materials"]["merge_radius"] < 0.6)

    def test_same_bits(self):
        """On 1, 2, 3 and 5 ranks (each way on more by hand); with cells of another size, and without cells; with a
        radius for each point; and with one that is found."""
        cells, objects = ("--cell-size", "1.5"), ("--partition", "objects")
        fine = ("--texels-per-metre", "12", "--photons", "2000")
        shared = ("--caustics", "vcm", "--texels-per-metre", "8", "--samples-indirect", "16")
        more_ranks = (((), 3), ((), 5)) if price.full else ()
        for options, runs in ((("--merge-radius", "0.5"), (((), 1), *more_ranks, (cells, 2))),
                              (shared, (((), 1), *more_ranks, (cells, 5), (objects, 3))), (fine, (((), 1), ((), 3)))):
            first, *others = (self.light(self.bake(self.spheres, *SPHERES, "--caustics", "merge", "--threads", "1",
                                                   *options, *more, ranks=ranks)) for more, ranks in runs)
            for other in others:
                for name in first:
                    self.assertTrue(np.array_equal(first[name], other[name]), name)
        report = run_json(os.path.join(self.folder, "bake%d" % Merge.number))
        self.assertGreater(report["materials"]["merge_radius"], 0.1)

    @price.long
    def test_gain(self):
        """With few paths and small texels the radius that is found makes the error less by half, and about as large as
        is said; the report has the radius."""
        fine = ("--texels-per-metre", "24")
        best, off = self.many_paths("400000", *fine), {}
        for which in ("land", "merge"):
            folder = self.bake(self.spheres, *fine, "--photons", "6000", "--iterations", "4", "--caustics", which)
            light = self.light(folder)
            wrong = (light["caustic"] - best["caustic"]) @ LUMINANCE
            off[which] = np.sqrt((light["area"] * wrong**2).sum())
            stated = np.sqrt((light["area"] * np.maximum(light["error"]**2 - best["error"]**2, 0)).sum())
            print("%s: error %.4f, stated %.4f" % (which, off[which], stated))
            self.assertTrue(0.5 * stated < off[which] < 2.0 * stated, which)
        self.assertLess(off["merge"], 0.6 * off["land"])
        self.assertTrue(0.05 < self.report(folder)["materials"]["merge_radius"] < 0.5)

    def test_wrong_values(self):
        for options in (("--merge-radius", "0"), ("--merge-radius", "x"), ("--radius-alpha", "1.5")):
            self.assertIn(options[0], self.bake(self.spheres, "--caustics", "merge", *options, code=64))
        for which, option, value in (("gather", "--photons", "9"), ("none", "--iterations", "2"),
                                     ("land", "--merge-radius", "1"), ("gather", "--radius-alpha", "0.5")):
            self.assertIn("leave %s out" % option, self.bake(self.spheres, "--caustics", which, option, value, code=64))


if __name__ == "__main__":
    unittest.main(verbosity=2)
