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
#include "coordinator/output/vertex_light.h"

struct kiln_backend;
struct kiln_points_ahead;

struct kiln_output_params {
    const char *directory;
    bool half, stitch;
    bool parts;                   /* the bake is in parts: its fields have the light of each part */
    bool denoise;                 /* the bake's fields must have the errors of direct and of indirect light */
    struct kiln_backend *backend; /* its device denoises large maps; NULL: the host does */
    bool denoise_direct;          /* only direct light: the error of indirect light is not noise */
    uint64_t least_divided; /* texels from which on a lightmap may be in bands, or packed by several ranks; 0: 2^19 */
    /* texels that a rank has in memory at a time; a larger lightmap is whole (map/texel_gather.h); 0: 2^21 */
    uint64_t texel_budget;
    /* kiln_provenance: one JSON object without time stamps, stored as an attribute of the HDF5 files */
    const char *provenance_json;
    const struct kiln_faults *faults; /* for tests; NULL: none */
    /* one byte for each lightmap, the same on all ranks: 0 keeps the file of an earlier call, unless the object touches
     * one that is written; NULL: all are written */
    const uint8_t *only;
    /* for kiln.h5: columns that were packed while light was computed, its threads stopped; NULL: none */
    const struct kiln_points_ahead *ahead;
    uint64_t kept; /* for kiln.h5: bytes that a rank may keep packed; 0: KILN_POINTS_KEPT_MOST */
    /* for kiln.h5, on rank 0: irradiance at vertices; NULL: none */
    const struct kiln_vertex_light *vertices;
};

/* Upper bound of the size of kiln.h5 in bytes; so much disk space must be free before it is begun. */
uint64_t kiln_h5_space(const struct kiln_scene *scene, const struct kiln_surface *surface,
                       const struct kiln_field_set *fields);
/* Number of columns of kiln.h5: datasets with one row for each point of lightmaps. */
size_t kiln_h5_columns(const struct kiln_field_set *fields);
/* Writes DIR/kiln.h5, each rank its own points (kiln_h5_points.h); the same bytes on any number of ranks. Groups:
 * /points, /irradiance and those of further fields with the columns of columns.h, /objects, /cells and /vertices.
 * Provenance is stored in attributes, and every dataset has `units` and `description`. */
int kiln_write_h5(const struct kiln_bake_result *result, const struct kiln_output_params *params,
                  struct kiln_error *error);

/* Upper bound of the size of volume.hdf in bytes; reads only the size of the volume. */
uint64_t kiln_volume_space(const struct kiln_volume_result *volume);
/* Writes DIR/volume.hdf as VTKHDF ImageData. Its PointData are irradiance_sh (27 components: the nine coefficients c_i
 * of irradiance in RGB, E(n) = sum_i c_i Y_i(n), without further factors), irradiance_posx ... irradiance_negz,
 * validity and mean_distance. If light groups are kept apart, /groups/NAME has the light of each group (45 components:
 * those of irradiance_sh, then RGB along the six axes). */
int kiln_write_volume(const struct kiln_bake_result *result, const struct kiln_volume_result *volume,
                      const struct kiln_output_params *params, struct kiln_error *error);

#endif
