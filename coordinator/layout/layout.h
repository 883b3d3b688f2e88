/* Lightmap layouts: takes a mesh's second UV set when it is a valid one, unwraps otherwise; decides lightmap sizes. */
#ifndef KILN_COORDINATOR_LAYOUT_LAYOUT_H
#define KILN_COORDINATOR_LAYOUT_LAYOUT_H

#include "coordinator/import/builder.h"

/* Zero means default in every field. */
struct kiln_layout_params {
    double texels_per_metre; /* 0: chosen so that the whole scene has about 2^18 texels; more where charts need room */
    uint32_t lightmap_size;  /* every lightmap N x N; 0: by density */
    uint32_t lightmap_max;   /* cap on a side; default 4096 */
    uint32_t padding;        /* texels between charts; default 2, which holds under bilinear filtering */
    bool repack;             /* lay the charts of given layouts out anew where less than two texels lie between them */
};

/* Where the density is chosen here, an object with a layout of its file's gets what puts two texels between its charts
 * (padding.h) along all but 1 % of their borders, up to four times the density, as long as the scene stays below 2^20
 * texels: those objects first where a texel is worth most. Where charts lie closer in what comes out, a note says in
 * how many lightmaps and along how much of the borders, and which density would do; the header's padding_factor says
 * the latter, too.
 *
 * For each mesh: checks the second UV set (inside 0..1, finite, no overlap between triangles beyond what rounding at
 * chart seams gives, not collapsed); where it fails or is absent, unwraps (charts by normal and connectivity, planar or
 * LSCM parametrisation with bounded stretch, packed with padding), splitting vertices where charts meet. For each
 * object sets lightmap_width and lightmap_height. Fills mesh.uv_area, surface_area, KILN_MESH_UNWRAPPED. Adds notes
 * that say why a UV set was refused. Deterministic. */
int kiln_layout(struct kiln_builder *builder, const struct kiln_layout_params *params, struct kiln_error *error);

#endif
