/* Evaluation of an irradiance volume: irradiance at any point, from volume.hdf. Reads a few probes at a time from the
 * file, so that memory does not grow with it. Not collective; needs no MPI. */
#ifndef KILN_COORDINATOR_OUTPUT_VOLUME_EVAL_H
#define KILN_COORDINATOR_OUTPUT_VOLUME_EVAL_H

#include <stdbool.h>
#include <stdint.h>

#include "coordinator/field/result.h"
#include "worker/base/status.h"

/* The light of a probe, or interpolated at a point. */
struct kiln_volume_probe {
    float harmonics[9][3]; /* irradiance: E(n) = sum_i harmonics[i] Y_i(n), W/m2 */
    float axes[6][3];      /* irradiance on faces looking along +x -x +y -y +z -z, W/m2 */
    float validity;        /* fraction of directions that hit no back face, 0 to 1 */
    float mean_distance;   /* to the surfaces around, m */
};

/* Occluders around a probe, and the offset of the place where its light was gathered. */
struct kiln_probe_surroundings {
    struct kiln_probe_occluders occluders;
    float offset[3]; /* m, from the probe's place in the grid */
};

struct kiln_volume;

/* Opens a volume. KILN_NO_INPUT; KILN_BAD_INPUT if it is not a volume of kiln (h5_file.h). A volume that somebody
 * else may have written must be read in a confined child (read/reader.h). Close with kiln_volume_close. */
int kiln_volume_open(struct kiln_volume **volume, const char *path, struct kiln_error *error);
/* Opens a volume from an open file, which is borrowed as long as the volume is open; `path` is for messages. */
int kiln_volume_open_file(struct kiln_volume **volume, int descriptor, const char *path, struct kiln_error *error);
void kiln_volume_close(struct kiln_volume **volume);

/* Reads the probe with grid indices `at` (x, y, z), which must exist. Occluders and offset are 0 in a file that has
 * none. */
int kiln_volume_read(const struct kiln_volume *volume, const uint64_t at[3], struct kiln_volume_probe *probe,
                     struct kiln_probe_surroundings *around, struct kiln_error *error);

/* Factor on the trilinear weight of a probe: 0 up to validity 0.5 (the probe is inside or behind geometry), 1 from 0.75
 * on, linear in between. */
float kiln_volume_trust(float validity);

/* Visibility of the point at v (m, relative to the probe) from a probe: 1 seen, 0 hidden, in between just behind a
 * surface. The probe has an occluding plane g for each of several directions d; the three directions nearest to v
 * count. Their planes hide v if both of these are above 1: the largest g . v; and the mean of g . d, weighted by the
 * components of v along the directions. This is exact for one wall, and for a corner of a room seen from inside; beside
 * the edge of an occluder that ends between two directions it is a guess. */
double kiln_volume_sees(const struct kiln_probe_occluders *occluders, const double v[3]);

struct kiln_volume_place {
    bool outside; /* of the grid */
    double seen;  /* share of the trusted probes' trilinear weight that sees the position, 0 to 1 */
};

/* Interpolates the light at a world position from the eight probes around it. The weight of a probe is its trilinear
 * weight x kiln_volume_trust x kiln_volume_sees (1e-6 at least); weights are normalised. Outside the grid the nearest
 * point on its boundary is used. KILN_BAD_INPUT if all weights are 0: the position is inside geometry. */
int kiln_volume_light(const struct kiln_volume *volume, const double position[3], struct kiln_volume_probe *light,
                      struct kiln_volume_place *place, struct kiln_error *error);

/* Irradiance on a surface with the given unit normal, from the harmonics. Negative values, which the series can have
 * for concentrated light, become 0. */
void kiln_volume_irradiance(const struct kiln_volume_probe *light, const double normal[3], double irradiance[3]);

/* Finds the grid indices and trilinear weights of up to eight probes around `position`, as kiln_volume_light does, but
 * without the file. Sets *outside (may be NULL) to whether it is outside the grid. Returns the number of probes with a
 * weight above 0. */
int kiln_volume_corners(const uint64_t size[3], const double origin[3], const double spacing[3],
                        const double position[3], uint64_t at[8][3], double weight[8], bool *outside);

#endif
