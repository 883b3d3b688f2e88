/* One point on its way to a lightmap. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_TEXEL_RECORD_H
#define KILN_COORDINATOR_OUTPUT_MAP_TEXEL_RECORD_H

#include <stdint.h>

/* One point on its way to `map`. It is a texel of the lightmap `from`: the same, unless it is a ghost (ghosts.h).
 * `triangle` is the world triangle of its first piece; `values` are of all planes. */
struct kiln_texel_record {
    uint32_t map, from, x, y, triangle, valid;
    float area, coverage;
    float values[];
};

#endif
