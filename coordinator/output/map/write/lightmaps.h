/* Writer of the lightmaps: DIR/lightmaps/OBJECT.exr. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_WRITE_LIGHTMAPS_H
#define KILN_COORDINATOR_OUTPUT_MAP_WRITE_LIGHTMAPS_H

#include "coordinator/output/map/lightmap_report.h"
#include "coordinator/output/output.h"

/* Collective. Writes DIR/lightmaps/OBJECT.exr for every object that is not caster-only, and
 * DIR/lightmaps/back/OBJECT.exr for published backs. Channels: those of all fields of the bake that are in lightmaps
 * (coordinator/field/fields.c); coverage.Y, the fraction of the texel's square that the layout covers (half);
 * validity.Y: 1 gathered, 0.5 on a surface but filled from neighbours, 0 margin (half).
 *
 * With `denoise` noise is taken out (regression.h) before anything else, and error.Y is what is left of it. Invalid
 * points are filled, seams between charts of an object and between objects that touch (joints.h) are smoothed, and
 * margins are dilated over the whole image, each texel from the chart that reads it. A lightmap that is large compared
 * with the work of the other ranks is in bands (bands.h): all ranks work on it, and each writes its rows of the file.
 * Others are finished by one rank, and packed by several where that has more to do than others (strips.h). The bytes do
 * not depend on who does what. With `half`, a file whose values exceed half precision is written as float, and
 * its attribute kiln:precision says so. `reports` has surface->map_count entries or is NULL, and must be NULL on all
 * ranks or on none. `denoising`: s of its time that denoising took on this rank; NULL: nobody asks. */
int kiln_write_lightmaps(const struct kiln_bake_result *result, const struct kiln_output_params *params,
                         struct kiln_lightmap_report *reports, double *denoising, struct kiln_error *error);

/* Texels that a rank processes at a time, unless one lightmap is larger, of maps of so many planes: a quarter of
 * `texels`, which it has in all, but two million at least, of about 90 bytes each, about 180 MB, or 540 MB of many
 * planes; and four times as much at most. The fewer rounds, the less threads wait for one another. */
static inline uint64_t kiln_lightmap_texels(uint32_t planes, double texels)
{
    const double least = (double)(1 << 21), quarter = 0.25 * texels;
    const uint64_t some = (uint64_t)(quarter < least ? least : quarter > 4.0 * least ? 4.0 * least : quarter);
    return planes <= 64 ? some : 64 * some / planes;
}

#endif
