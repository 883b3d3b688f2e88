"""Smooth direct light on coarse texels is published as it was gathered, to its noise; a bake with a target error has
the layer of errors, and the means of objects lie within two of theirs."""
import os
import sys
import unittest

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import harness  # noqa: E402
from program import InOwnFolder, kiln, run_json  # noqa: E402

ANALYTIC = os.path.join(harness.SHARED, "own", "analytic")
COMMON = ("--backend", "embree", "--samples-probe", "0", "--no-preview", "--no-export", "--quiet", "--no-resume")


class SmoothLight(InOwnFolder):
    def bake(self, scene, *options):
        kiln("bake", scene, "-o", self.folder, *COMMON, *options)
        return run_json(self.folder)

    def published(self, entry):
        """Luminance and stated error of a lightmap."""
        channels, _ = harness.read_exr(os.path.join(self.folder, entry["lightmap"]))
        rgb = np.stack([channels[c] for c in "RGB"], -1).astype(float)
        return rgb @ harness.LUMINANCE, channels["error.Y"].astype(float)

    @unittest.skipUnless(os.path.isdir(ANALYTIC), "no " + ANALYTIC)
    def test_stays(self):
        """Spot: 0.37 % of the mean were lost to fits that were far from the light, against 0.04 % of noise, and with 64
        samples, whose own spread is much more than their error, 2.6 %; point: 0.82 %."""
        for name, samples, most in (("spot_cone", "1024", 5e-4), ("point_over_plane", "1024", 5e-4),
                                    ("par_rect", "1024", 5e-4), ("point_over_plane", "64", 1e-3),
                                    ("spot_cone", "64", 5e-3)):
            report = self.bake(os.path.join(ANALYTIC, name + ".glb"), "--bounces", "0", "--samples-direct", samples,
                               "--lightmap-size", "8", "--error-map")
            with h5py.File(os.path.join(self.folder, "kiln.h5")) as file:
                raw = file["irradiance/direct"][...] @ harness.LUMINANCE
                number, texel = file["points/object"][...], file["points/texel"][...]
            for index, entry in enumerate(report["objects"]):
                own = number == index
                if not entry["lightmap"] or raw[own].max() <= 0:
                    continue
                image, _ = self.published(entry)
                off = image[texel[own, 1], texel[own, 0]] - raw[own]
                moved = np.sqrt(np.mean(off ** 2)) / raw[own].mean()
                print("%s, %s samples: moved by %.3f %% of the mean" % (name, samples, 100 * moved))
                self.assertLess(moved, most)

    def test_target(self):
        """The layer is there as with --error-map. Of 8 seeds the means of objects lie within two stated errors, which
        are as large as four parts ask for (in a dining room 81 % did without that)."""
        scene = os.path.join(harness.REPOSITORY, "jobs", "cornell.glb")
        means, errors = [], []
        few = ("--lightmap-size", "8", "--samples-direct", "16", "--samples-bounce", "4", "--samples-indirect", "16",
               "--bounces", "2")
        for seed in range(8):
            objects = self.bake(scene, *few, "--target-error", "0.2", "--seed", str(seed))["objects"]
            means.append([entry["mean"] for entry in objects])
            errors.append([entry["mean"] * entry["mean_error"] for entry in objects])
        self.assertTrue(all(self.published(entry)[1].max() > 0 for entry in objects if entry["lightmap"]))
        means, errors = np.array(means), np.array(errors)
        off = np.abs(means - means.mean(0)) * np.sqrt(8 / 7)
        within = 100 * (off < 2 * errors).mean()
        print("%.1f %% of %d means within two stated errors; without Student's factor %.1f %%"
              % (within, means.size, 100 * (off < 2 / 1.591 * errors).mean()))
        self.assertGreaterEqual(within, 91)


if __name__ == "__main__":
    unittest.main()
