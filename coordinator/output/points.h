/* What the files say of a surface point beyond its light: where it lies and how much of its texel it is. Computed again
 * from the pieces when a file is written, so that nothing of it is kept during the bake. Not collective, thread-safe.
 */
#ifndef KILN_COORDINATOR_OUTPUT_POINTS_H
#define KILN_COORDINATOR_OUTPUT_POINTS_H

#include "coordinator/field/result.h"

struct kiln_point_detail {
    uint32_t x, y;      /* texel in the object's lightmap */
    uint32_t triangle;  /* world triangle of its first piece */
    float coverage;     /* share of the texel's square on the layout, 0..1 */
    double position[3]; /* m, world: centroid of the covered part of the surface */
    float normal[3];    /* unit, world: mean shading normal there */
};

/* The points of own tile run `tile run`, in order; `details` holds KILN_TILE_TEXELS. Returns how many. */
uint32_t kiln_tile_run_details(const struct kiln_bake_result *result, size_t tile_run,
                               struct kiln_point_detail *details);

/* The global index of the tile run's first point minus surface->first: where its values stand in the own arrays. */
static inline uint64_t kiln_tile_run_offset(const struct kiln_surface *surface, size_t tile_run)
{
    return surface->tile_runs[tile_run].first - surface->first;
}

#endif
