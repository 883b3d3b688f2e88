/* Dilation: copies surface texels into the margins of a lightmap. Deterministic; depends on this object only. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_CHARTS_DILATE_H
#define KILN_COORDINATOR_OUTPUT_MAP_CHARTS_DILATE_H

#include "coordinator/output/map/map.h"

/* Copies to every margin texel the values of its texel in `nearest`: a surface texel, or itself. `dilated` (may be
 * NULL) is the number of margin texels of the whole lightmap, or 0 if it has no other texels. Collective if the map is
 * one of bands. */
int kiln_map_dilate(struct kiln_map *map, const uint32_t *nearest, uint64_t *dilated, struct kiln_error *error);

#endif
