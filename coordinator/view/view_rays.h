/* Batches of view rays: finds their first visible hits, passing through the backs of single-sided surfaces. Private to
 * coordinator/view. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_RAYS_H
#define KILN_COORDINATOR_VIEW_VIEW_RAYS_H

#include "coordinator/view/view.h"
#include "worker/base/arena.h"

/* A batch of rays. The caller fills in origins and directions (unit vectors). kiln_view_trace fills in the rest, and
 * moves the origins of rays that continue beyond a back. */
struct kiln_view_rays {
    size_t capacity;
    struct kiln_vec3 *origins, *directions;
    struct kiln_hit *hits; /* the distance counts from the last origin; passed + distance counts from the first one */
    float *passed;         /* distance of the last origin from the first, m; above 0: the ray went through a back */
    uint32_t *active;      /* indices of unfinished rays; below, their compacted data for tracing */
    struct kiln_vec3 *active_origins, *active_directions;
    struct kiln_hit *active_hits;
    struct kiln_arena arena;
};

int kiln_view_rays_create(struct kiln_view_rays **rays, size_t capacity, struct kiln_error *error);
void kiln_view_rays_destroy(struct kiln_view_rays **rays);

/* Traces rays 0..count-1. Rays that hit the back of a single-sided surface continue beyond it. */
int kiln_view_trace(const struct kiln_view_source *source, struct kiln_view_rays *rays, size_t count,
                    struct kiln_error *error);

/* Makes and traces side x side rays for each of `count` pixels from number `first` on, row by row. The rays of a pixel
 * are consecutive and go through the centres of a grid of subpixels. The batch must have room for all. */
int kiln_view_trace_pixels(const struct kiln_view_params *params, uint32_t side, struct kiln_view_rays *rays,
                           size_t first, size_t count, struct kiln_error *error);

/* Tells whether the hit is visible: on a surface, not on the back of a single-sided one, and not on a caster-only
 * object, which has no lightmap, unless the object emits. */
bool kiln_view_is_seen(const struct kiln_view_source *source, const struct kiln_hit *hit);

/* Tells whether a view ray continues from this hit, reflected or refracted by its material (view_gloss.h). */
bool kiln_view_goes_on(const struct kiln_view_source *source, const struct kiln_hit *hit);

#endif
