/* Band sight: the texels of other bands that a band sees when it is denoised. Neighbours lie near each other in space,
 * wherever they are on the layout, and a point's light depends on points within 30 texels (regression.h). So a band
 * needs, besides its own points, all within KILN_BAND_SIGHT_TEXELS of the largest texels of the lightmap, at least.
 * They come as ghosts do (ghosts.h): tile runs whole. Space is divided into cells of half that side; all ranks learn
 * which cells each band has points in. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_BAND_SIGHT_H
#define KILN_COORDINATOR_OUTPUT_MAP_BAND_SIGHT_H

#include "coordinator/field/result.h"
#include "coordinator/output/map/texel_gather.h"

#define KILN_BAND_SIGHT_TEXELS 32.0f

/* The ranks that need a tile run of this rank besides the one that has its rows: places [first[t], first[t + 1]) for
 * tile run t. */
struct kiln_band_sight {
    size_t *first;
    uint32_t *ranks;
};

/* Collective. Finds them for all lightmaps in bands. */
int kiln_band_sight_create(struct kiln_band_sight **sight, const struct kiln_bake_result *result,
                           const struct kiln_assignment *assignment, struct kiln_error *error);
void kiln_band_sight_destroy(struct kiln_band_sight **sight);

#endif
