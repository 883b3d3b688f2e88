/* Writers of the output files of a bake. All functions here that take a kiln_bake_result are collective over its
 * communicator. An error on one rank is an error on all, with the message of the first rank that failed; so is
 * KILN_STOPPED, which result->stop causes.
 *
 * Files are written under a temporary name in the same folder, read back and checked, synced, and renamed when
 * complete. A reader never sees an incomplete file, and a published file is never opened for writing again. */
#ifndef KILN_COORDINATOR_OUTPUT_OUTPUT_H
#define KILN_COORDINATOR_OUTPUT_OUTPUT_H

#include "coordinator/field/result.h"
#include "coordinator/job/faults.h"

struct kiln_output_params {
    const char *directory;
    bool half, stitch;
    bool denoise;           /* the bake's fields must have the errors of direct and of indirect light */
    uint64_t least_divided; /* texels from which on several ranks may pack a lightmap; 0: KILN_STRIPS_LEAST */
    /* kiln_provenance: one JSON object without time stamps, stored as an attribute of the HDF5 files */
    const char *provenance_json;
    const struct kiln_faults *faults; /* for tests; NULL: none */
};

/* Report of kiln_write_lightmaps on one lightmap, for run.json. Complete on rank 0; zeros on the others. */
struct kiln_lightmap_report {
    uint32_t map;
    uint64_t valid, filled, dilated; /* texels: gathered; filled from valid neighbours; margin */
    uint64_t contested, foreign;     /* texels that several charts read: of the margin; of a chart (map/borders.h) */
    double border, border_disturbed; /* length of chart borders, texels; of that, where they read another chart */
    double seam_difference_before, seam_difference_after; /* root mean square over seam samples, relative to the mean */
    double texels_per_metre;                              /* density that the object really has */
    /* over valid texels: mean luminance of irradiance, by area; root mean square of its standard error / that mean */
    double mean, error;
    /* denoising: sums over gathered texels of area x variance of luminance, as gathered and what is left, of direct and
     * of indirect light; time */
    double noise_before[2], noise_after[2], denoise_seconds;
};

/* Writes DIR/lightmaps/OBJECT.exr for every object that is not caster-only, and DIR/lightmaps/back/OBJECT.exr for
 * published backs. Channels: those of all fields of the bake that are in lightmaps (coordinator/field/fields.c);
 * coverage.Y, the fraction of the texel's square that the layout covers (half); validity.Y: 1 gathered, 0.5 on a
 * surface but filled from neighbours, 0 margin (half).
 *
 * With `denoise` noise is taken out (map/regression.h) before anything else, and error.Y is what is left of it. Invalid
 * points are filled, seams between charts of an object are smoothed, and margins are dilated over the whole
 * image, each texel from the chart that reads it. A lightmap that is large compared with the work of the other ranks is
 * packed by several ranks (map/strips.h). The bytes do not depend on which rank writes an object and which ranks pack
 * it. With `half`, a file whose values exceed half precision is written as float, and its attribute kiln:precision says
 * so. `reports` has surface->map_count entries or is NULL, and must be NULL on all ranks or on none. */
int kiln_write_lightmaps(const struct kiln_bake_result *result, const struct kiln_output_params *params,
                         struct kiln_lightmap_report *reports, struct kiln_error *error);

/* The largest size of kiln.h5 in bytes, for which there must be room before it is begun. */
uint64_t kiln_h5_space(const struct kiln_scene *scene, const struct kiln_surface *surface,
                       const struct kiln_field_set *fields);
/* Writes DIR/kiln.h5; all ranks and threads compress, rank 0 writes. Groups: /points and /irradiance with the
 * columns of columns.h, /objects and /cells. Provenance is stored
 * in attributes, and every dataset has `units` and `description`. */
int kiln_write_h5(const struct kiln_bake_result *result, const struct kiln_output_params *params,
                  struct kiln_error *error);

/* The same for volume.hdf; only the size of the volume is used. */
uint64_t kiln_volume_space(const struct kiln_volume_result *volume);
/* Writes DIR/volume.hdf as VTKHDF ImageData. Its PointData are irradiance_sh (27 components: the nine coefficients c_i
 * of irradiance in RGB, E(n) = sum_i c_i Y_i(n), without further factors), irradiance_posx ... irradiance_negz,
 * validity and mean_distance. */
int kiln_write_volume(const struct kiln_bake_result *result, const struct kiln_volume_result *volume,
                      const struct kiln_output_params *params, struct kiln_error *error);

#endif
