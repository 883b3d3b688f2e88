/* Packs charts into a lightmap: bottom-left first fit of their exact outlines, largest first. */
#ifndef KILN_COORDINATOR_LAYOUT_PACK_H
#define KILN_COORDINATOR_LAYOUT_PACK_H

#include "coordinator/layout/charts.h"

struct kiln_pack_params {
    double texels_per_metre; /* wanted; `exact`: an upper bound, 0 for none */
    uint32_t padding;        /* texels between the texels that two charts touch */
    uint32_t limit;          /* largest side, texels */
    bool exact;              /* the lightmap is limit x limit, charts as large as fit */
};

struct kiln_packing {
    uint32_t width, height;  /* texels */
    double texels_per_metre; /* what it came to */
    /* 1; more where the charts do not fit with a texel each: the packing was made in a grid that is this much finer,
     * and several charts share a texel */
    uint32_t cells;
    /* a chart: (a, b) in metres lies at (m[0] a + m[1] b + m[2], m[3] a + m[4] b + m[5]) of 0..1 */
    double (*maps)[6];
};

/* Charts keep the density; a rectangular one is stretched by up to 1/8 so that its sides fall on texel borders. Nothing
 * lies in the outermost texels. `packing->maps` is the caller's to free with kiln_free. Deterministic. */
int kiln_pack(struct kiln_packing *packing, const struct kiln_charts *charts, const struct kiln_topology *topology,
              const struct kiln_pack_params *params, struct kiln_error *error);

#endif
