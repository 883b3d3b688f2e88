/* Packs charts into a lightmap: bottom-left first fit of their exact outlines, largest chart first. */
#ifndef KILN_COORDINATOR_LAYOUT_PACK_H
#define KILN_COORDINATOR_LAYOUT_PACK_H

#include "coordinator/layout/charts.h"

struct kiln_pack_params {
    double texels_per_metre; /* wanted density; with `exact` an upper bound, 0 for none */
    uint32_t padding;        /* texels between the texels that two charts touch */
    uint32_t limit;          /* largest side of the lightmap, texels */
    bool exact;              /* the lightmap is limit x limit, and the charts are made as large as fits */
};

struct kiln_packing {
    uint32_t width, height;  /* texels */
    double texels_per_metre; /* the density reached */
    /* 1; more if the charts do not fit with a texel each: they are then packed in a grid this many times finer, where
     * several charts share a texel */
    uint32_t cells;
    /* per chart: its position (a, b), m, lies at (m[0] a + m[1] b + m[2], m[3] a + m[4] b + m[5]) of 0..1 */
    double (*maps)[6];
};

/* Packs the charts. All keep the density, but a rectangular one is stretched by up to 1/8 so that its sides fall on
 * texel borders. Nothing lies in the outermost texels. The caller frees `packing->maps` with kiln_free.
 * Deterministic. */
int kiln_pack(struct kiln_packing *packing, const struct kiln_charts *charts, const struct kiln_topology *topology,
              const struct kiln_pack_params *params, struct kiln_error *error);

#endif
