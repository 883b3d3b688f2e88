/* Irradiance at any place from volume.hdf. Reads the file directly, a few probes at a time: no memory for the whole of
 * it. Not collective; needs no MPI. */
#ifndef KILN_COORDINATOR_OUTPUT_VOLUME_EVAL_H
#define KILN_COORDINATOR_OUTPUT_VOLUME_EVAL_H

#include <stdbool.h>
#include <stdint.h>

#include "worker/base/status.h"

/* Light at a place, from one probe or several. */
struct kiln_volume_probe {
    float harmonics[9][3]; /* irradiance: E(n) = sum_i harmonics[i] Y_i(n), W/m2 */
    float axes[6][3];      /* irradiance on faces looking along +x -x +y -y +z -z, W/m2 */
    float validity;        /* 0..1, share of directions that meet no back face */
    float mean_distance;   /* m */
};

struct kiln_volume;

/* KILN_NO_INPUT, KILN_BAD_INPUT when it is no kiln volume (h5_file.h). A volume that somebody else may have
 * written is read in a confined child (read/reader.h). */
int kiln_volume_open(struct kiln_volume **volume, const char *path, struct kiln_error *error);
/* The same of an open file, which is borrowed as long as the volume is open; `path` is for sentences. */
int kiln_volume_open_file(struct kiln_volume **volume, int descriptor, const char *path, struct kiln_error *error);
void kiln_volume_close(struct kiln_volume **volume);

/* Probes along each axis, position of the first and distance between them in metres. */
void kiln_volume_extent(const struct kiln_volume *volume, uint64_t size[3], double origin[3], double spacing[3]);

/* One probe, by its place in the grid (x, y, z), which must be inside. */
int kiln_volume_read(const struct kiln_volume *volume, const uint64_t at[3], struct kiln_volume_probe *probe,
                     struct kiln_error *error);

/* How much a probe counts beside its trilinear weight: nothing up to validity 0.5 (inside geometry, or behind it),
 * wholly from 0.75 on, linear between. */
float kiln_volume_trust(float validity);

/* Light at a world position: the eight probes around it, trilinear weight x trust, weights made to sum to 1. Outside
 * the grid the nearest place on its border is taken and *outside is set (may be NULL). KILN_BAD_INPUT when none of the
 * eight can be trusted: the place is inside geometry. */
int kiln_volume_light(const struct kiln_volume *volume, const double position[3], struct kiln_volume_probe *light,
                      bool *outside, struct kiln_error *error);

/* Irradiance for unit normal n from the harmonics; the series can dip below 0 where light is concentrated, which
 * becomes 0. */
void kiln_volume_irradiance(const struct kiln_volume_probe *light, const double normal[3], double irradiance[3]);

/* The arithmetic of kiln_volume_light without the file: grid places and trilinear weights of the up to eight probes
 * around `position`; *outside as above. Returns how many have a weight above 0. */
int kiln_volume_corners(const uint64_t size[3], const double origin[3], const double spacing[3],
                        const double position[3], uint64_t at[8][3], double weight[8], bool *outside);

#endif
