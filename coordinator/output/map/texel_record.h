/* Texel record: one surface point as it is sent to the rank of its lightmap. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_TEXEL_RECORD_H
#define KILN_COORDINATOR_OUTPUT_MAP_TEXEL_RECORD_H

#include <stdint.h>

/* One surface point, sent to the lightmap `map`. It is a texel of the lightmap `from`, which equals `map` except for a
 * ghost (ghosts.h). `triangle` is the world triangle of its first piece; `values` has one value for each plane. */
struct kiln_texel_record {
    uint32_t map, from, x, y, triangle, valid;
    float area, coverage;
    float values[];
};

#endif
