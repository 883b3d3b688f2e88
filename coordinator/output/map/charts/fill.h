/* Filling: values for surface texels where no light could be gathered. Deterministic; depends on this object only. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_CHARTS_FILL_H
#define KILN_COORDINATOR_OUTPUT_MAP_CHARTS_FILL_H

#include "coordinator/output/map/map.h"

/* Fills every KILN_TEXEL_FILLED texel from its surroundings. Within a chart, layer by layer outward from the valid
 * texels: the mean of the known neighbours, with edge neighbours counting twice. A chart without valid texels takes the
 * nearest known texels of the object. An object without valid texels stays 0. Collective if the map is one of bands. */
int kiln_map_fill(struct kiln_map *map, struct kiln_error *error);

#endif
