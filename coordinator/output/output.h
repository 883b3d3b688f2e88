/* Everything a bake leaves in its folder. All functions here that take a kiln_bake_result are collective over its
 * communicator; an error on one rank is an error on all, with the first failing rank's sentence. So is KILN_STOPPED,
 * when result->stop says so.
 *
 * Files are written under a temporary name in the same folder, re-read and checked, synced, and renamed when complete:
 * a reader never sees half a file, and a published file is never opened for writing again. */
#ifndef KILN_COORDINATOR_OUTPUT_OUTPUT_H
#define KILN_COORDINATOR_OUTPUT_OUTPUT_H

#include "coordinator/field/result.h"
#include "coordinator/job/faults.h"

struct kiln_output_params {
    const char *directory;
    bool half, stitch, error_map;
    uint64_t least_divided; /* texels of a lightmap that several ranks may pack; 0: KILN_STRIPS_LEAST */
    /* what ran, as one JSON object: kept as an attribute of the HDF5 files; no time stamps */
    const char *provenance_json;
    const struct kiln_faults *faults; /* for tests; NULL: none */
};

/* What kiln_write_lightmaps reports for run.json, one a lightmap of the surface, on rank 0 (others: zero counts). */
struct kiln_lightmap_report {
    uint32_t map;
    uint64_t valid, filled, dilated; /* texels: gathered here, filled from valid neighbours, margin */
    uint64_t contested, foreign;     /* texels that several charts read: of the margin, of a chart (borders.h) */
    double border, border_disturbed; /* texels of chart borders, and of those that read another chart */
    double seam_difference_before, seam_difference_after; /* root mean square over seam samples, relative to the mean */
    double texels_per_metre;                              /* that the object really got */
    /* over valid texels: luminance of irradiance, by area; root mean square of the standard error, relative to it */
    double mean, error;
};

/* DIR/lightmaps/OBJECT.exr for every object but the caster-only ones, and DIR/lightmaps/back/OBJECT.exr for backs,
 * where they are published. Channels R G B = direct + indirect; layers direct.R.. and indirect.R.., error.Y when
 * error_map is set, coverage.Y (share of the texel's square that the layout covers; half) and validity.Y (1 gathered,
 * 0.5 on a surface but filled from neighbours, 0 margin; half). Invalid points are filled, chart seams of an object
 * smoothed, margins dilated over the whole image, each texel from the chart that reads it. Which rank writes an object,
 * and which ones pack it, does not change a byte: one that is large beside what other ranks have to write is packed by
 * several (strips.h). With `half` a file whose values would leave half precision is written as float, and its attribute
 * kiln:precision says why. `reports` has surface->map_count entries or is NULL; if it is given on one rank it is given
 * on all. */
int kiln_write_lightmaps(const struct kiln_bake_result *result, const struct kiln_output_params *params,
                         struct kiln_lightmap_report *reports, struct kiln_error *error);

/* DIR/kiln.h5, packed by all ranks and threads and written by rank 0: /points (position, normal, object, texel, area,
 * albedo, valid, cell), /irradiance (direct, indirect, total, error), /objects, /cells, provenance as attributes;
 * `units` and `description` on every dataset. */
/* What the file takes at most, for which there must be room before it is begun. */
uint64_t kiln_h5_space(const struct kiln_scene *scene, const struct kiln_surface *surface);
int kiln_write_h5(const struct kiln_bake_result *result, const struct kiln_output_params *params,
                  struct kiln_error *error);

/* DIR/volume.hdf, VTKHDF ImageData: PointData irradiance_sh (27 components, the nine coefficients of irradiance divided
 * by nothing: E(n) = sum_i c_i Y_i(n)), irradiance_posx ... irradiance_negz, validity, mean_distance. */
/* As kiln_h5_space; of the volume its size is looked at. */
uint64_t kiln_volume_space(const struct kiln_volume_result *volume);
int kiln_write_volume(const struct kiln_bake_result *result, const struct kiln_volume_result *volume,
                      const struct kiln_output_params *params, struct kiln_error *error);

#endif
