/* Counts the texels of a lightmap that several charts of its layout share.
 *
 * A texel has one value, and rays that meet any chart in it read that value: light of one place appears at another,
 * however far away. Charts share texels where a layout was made for a finer lightmap than it gets, or where they
 * overlap. */
#ifndef KILN_COORDINATOR_LAYOUT_SHARING_H
#define KILN_COORDINATOR_LAYOUT_SHARING_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/arena.h"
#include "worker/base/status.h"
#include "worker/base/vector.h"

struct kiln_seam;

/* The layout of one mesh. Borrows the arrays it was opened with. Zero-initialise; close with kiln_sharing_close. */
struct kiln_sharing {
    const struct kiln_vec2 *uv;
    const uint32_t *triangles; /* 3 per triangle */
    size_t triangle_count, chart_count;
    uint32_t *chart; /* one per triangle, as kiln_padding_charts numbers them */
    /* edges shared by charts in space, and their distance in the layout */
    struct kiln_seam *seams;
    size_t seam_count;
    uint32_t *owners, *joined; /* working memory: per texel, per chart */
    size_t owner_capacity;
    struct kiln_arena arena;
};

/* Finds the charts of a mesh's layout and their seams. May be called again for another mesh. KILN_SYSTEM. */
int kiln_sharing_open(struct kiln_sharing *sharing, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                      size_t vertex_count, const uint32_t *triangles, size_t triangle_count, struct kiln_error *error);

/* Counts into *texels the texels of a lightmap that triangles of several charts overlap, each by more than 1/1000 texel
 * in both directions. Charts that continue each other in space, along an edge with the same layout coordinates up to
 * 1/16 texel (rounding), count as one. The lightmap is width x height texels in units of 1 << shift: rounded up, like
 * lightmaps of backs (worker/scene/surface.h). Triangles without area in the layout are ignored, since they lie on
 * another chart anyway. Takes 16 MiB at most, and time in proportion to texels and triangles. Deterministic.
 * KILN_SYSTEM. */
int kiln_sharing_count(struct kiln_sharing *sharing, uint32_t width, uint32_t height, uint32_t shift, uint64_t *texels,
                       struct kiln_error *error);

void kiln_sharing_close(struct kiln_sharing *sharing);

#endif
