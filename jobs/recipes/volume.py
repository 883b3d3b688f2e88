#!/usr/bin/python3
"""Reads the irradiance volume of a bake: light at any point, for moving objects. Needs h5py and numpy.

    python3 volume.py DIR/volume.hdf X Y Z NX NY NZ

prints E in W/m2 (or lux) on a surface at X Y Z that faces NX NY NZ.

Metres, the axes of the glTF file (y up), linear RGB. Radiance of a diffuse surface there: albedo * E / pi."""
import sys

import h5py
import numpy as np


class Volume:
    def __init__(self, path):
        with h5py.File(path, 'r') as f:
            grid, data = f['VTKHDF'].attrs, f['VTKHDF/PointData']
            self.origin, self.spacing = np.array(grid['Origin']), np.array(grid['Spacing'])
            self.harmonics = data['irradiance_sh'][...]  # [z, y, x, 27]; 27 = 9 coefficients of 3 channels
            self.validity = data['validity'][...]  # [z, y, x]; low where a probe is inside geometry
            self.occluders = data['occluders'][...]  # [z, y, x, 81]; 81 = 27 directions (z, y, x of -1 0 1) of 3 axes
            self.offset = data['offset'][...]  # [z, y, x, 3]; m, where its light is from: probes are moved out of walls
            self.size = np.array(self.validity.shape[::-1])

    def light(self, position):
        """The 9 coefficients (9, 3) at a point, from the eight probes around it (outside the grid: around the nearest
        point on its border), by distance and by what each sees; None if all of them are inside geometry."""
        position = np.asarray(position, float)
        place = np.clip((position - self.origin) / self.spacing, 0, self.size - 1)
        low = np.minimum(place.astype(int), np.maximum(self.size - 2, 0))
        fraction, total, sum_ = place - low, 0.0, np.zeros(27)
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(corner, fraction, 1 - fraction))
            if weight > 0:
                x, y, z = low + corner
                weight *= np.clip(4 * (self.validity[z, y, x] - 0.5), 0, 1)  # no light from inside a wall
                probe = self.origin + self.spacing * (x, y, z) + self.offset[z, y, x]
                weight *= max(self.sees((x, y, z), position - probe), 1e-6)
                sum_ += weight * self.harmonics[z, y, x]
                total += weight
        return (sum_ / total).reshape(9, 3) if total > 0 else None

    def sees(self, probe, v):
        """1 if the probe sees the place v metres from it, 0 if a surface lies between, in between just behind one."""
        order = np.argsort(-np.abs(v))  # the axes v has most, less and least of; the directions 1, 1 + 2, 1 + 2 + 3
        directions = np.cumsum(np.eye(3, dtype=int)[order] * np.where(v[order] < 0, -1, 1)[:, None], axis=0)
        planes = self.occluders[probe[::-1]].reshape(3, 3, 3, 3)[tuple(directions.T[::-1] + 1)]
        between = -np.diff(np.abs(v[order]), append=0) @ np.sum(planes * directions, axis=1)
        return np.clip((1.01 - min(between, np.max(planes @ v))) / 0.01, 0, 1)

    def irradiance(self, position, normal):
        """E (3,) on a surface at `position` that faces `normal`, or None."""
        light = self.light(position)
        return None if light is None else np.maximum(basis(normal) @ light, 0)


def basis(normal):
    """The nine real spherical harmonics of bands 0 to 2; E(n) = sum of c_i Y_i(n), for c includes the cosine."""
    x, y, z = np.asarray(normal, float) / np.linalg.norm(normal)
    return np.array([0.28209479, 0.48860251 * y, 0.48860251 * z, 0.48860251 * x, 1.09254843 * x * y, 1.09254843 * y * z,
                     0.31539157 * (3 * z * z - 1), 1.09254843 * x * z, 0.54627422 * (x * x - y * y)])


if __name__ == '__main__':
    if len(sys.argv) != 8:
        sys.exit(__doc__)
    e = Volume(sys.argv[1]).irradiance([float(a) for a in sys.argv[2:5]], [float(a) for a in sys.argv[5:8]])
    print('inside geometry: choose another point' if e is None else 'E = %.6g %.6g %.6g' % tuple(e))
