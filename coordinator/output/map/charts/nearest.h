/* Nearest-texel search: for every texel, the nearest texel of a given kind. Deterministic; depends on this object
 * only. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_CHARTS_NEAREST_H
#define KILN_COORDINATOR_OUTPUT_MAP_CHARTS_NEAREST_H

#include "coordinator/output/map/map.h"

/* Finds for every texel the index (y * width + x) of the nearest texel whose state is at least `least`: exact Euclidean
 * distance between centres, among equals the smaller column, then the smaller row (Meijster, Roerdink and Hesselink
 * 2000, in linear time). KILN_NONE everywhere if there is no such texel. `nearest` has width x height entries.
 * Not collective. */
int kiln_nearest_texels(const uint8_t *state, uint8_t least, uint32_t width, uint32_t height, uint32_t *nearest,
                        struct kiln_error *error);

/* Likewise for the texels that a map has. `state` is of all its texels. Collective if the map is one of bands. */
int kiln_map_nearest(const struct kiln_map *map, const uint8_t *state, uint8_t least, uint32_t *nearest,
                     struct kiln_error *error);

#endif
