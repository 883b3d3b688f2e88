/* Writer of the lightmaps: DIR/lightmaps/OBJECT.exr. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_WRITE_LIGHTMAPS_H
#define KILN_COORDINATOR_OUTPUT_MAP_WRITE_LIGHTMAPS_H

#include "coordinator/output/map/denoise/regression.h"
#include "coordinator/output/map/lightmap_report.h"
#include "coordinator/output/output.h"

/* Collective. Writes DIR/lightmaps/OBJECT.exr for every object that is not caster-only, and
 * DIR/lightmaps/back/OBJECT.exr for published backs. Channels: those of all fields of the bake that are in lightmaps
 * (coordinator/field/fields.c); coverage.Y, the fraction of the texel's square that the layout covers (half);
 * validity.Y: 1 gathered, 0.5 on a surface but filled from neighbours, 0 margin (half).
 *
 * With `denoise` the light is first denoised (regression.h), and error.Y is the remaining error. Invalid points are
 * filled. Seams between charts of an object and between objects that touch (joints.h) are smoothed. Margins are dilated
 * over the whole image, each texel from the chart that reads it. A lightmap that is large compared with the work of the
 * other ranks is in bands (bands.h): all ranks work on it, and each writes its rows of the file. Any other lightmap is
 * finished by one rank; if that rank has more to do than others, several ranks pack it (strips.h). The bytes do not
 * depend on this division of work. With `half`, a file whose values exceed half precision is written as float, and its
 * attribute kiln:precision says so. `reports` has surface->map_count entries or is NULL, and must be NULL on all ranks
 * or on none. `denoising` receives the seconds that denoising took on this rank; may be NULL. */
int kiln_write_lightmaps(const struct kiln_bake_result *result, const struct kiln_output_params *params,
                         struct kiln_lightmap_report *reports, double *denoising, struct kiln_error *error);

/* Number of texels that a rank processes at a time, for maps with `planes` planes; a larger lightmap is processed
 * whole. It is a quarter of `texels`, all texels of the rank, but at least two million (at about 90 bytes each 180 MB,
 * or 540 MB with many planes), and at most four times that. With fewer rounds threads wait less for one another. */
static inline uint64_t kiln_lightmap_texels(uint32_t planes, double texels)
{
    const double least = (double)(1 << 21), quarter = 0.25 * texels;
    const uint64_t some = (uint64_t)(quarter < least ? least : quarter > 4.0 * least ? 4.0 * least : quarter);
    return planes <= 64 ? some : 64 * some / planes;
}

/* Most bytes of neighbours that are kept of a lightmap while it is denoised. */
enum { KILN_LIGHTMAP_KEPT = KILN_REGRESSION_KEPT };

#endif
