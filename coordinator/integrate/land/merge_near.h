/* Surface points near a surface point, for merging (merge.h). Not collective. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_MERGE_NEAR_H
#define KILN_COORDINATOR_INTEGRATE_LAND_MERGE_NEAR_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

/* A point as other ranks see it. */
struct kiln_merge_place {
    uint64_t key; /* lightmap and texel: does not depend on the order of points, which cells change */
    struct kiln_vec3 position, normal;
    float lit;    /* m2, area that can be lit; 0: the point takes no part */
    float widest; /* m, farthest distance to spread its light; 0: no other point is near */
};
_Static_assert(sizeof(struct kiln_merge_place) == 40, "a record has no gaps");

#define KILN_MERGE_ALIKE 0.5f /* cosine between normals of points that are near each other */
#define KILN_MERGE_FLAT 0.25f /* largest distance from each other's planes, over the radius */

/* Whether two points are near each other; symmetric. */
static inline bool kiln_merge_are_near(const struct kiln_merge_place *a, const struct kiln_merge_place *b, float radius)
{
    const struct kiln_vec3 d = vec3_sub(b->position, a->position);
    return vec3_dot(d, d) <= radius * radius && vec3_dot(a->normal, b->normal) >= KILN_MERGE_ALIKE &&
           fabsf(vec3_dot(d, a->normal)) <= KILN_MERGE_FLAT * radius &&
           fabsf(vec3_dot(d, b->normal)) <= KILN_MERGE_FLAT * radius;
}

/* Hash grids over the points that take part. One grid has cells as wide as the radius; the others, for points with a
 * smaller `widest`, have cells of a half, a quarter, and so on. So a point examines few others even where texels of one
 * object are small beside those of another. */
struct kiln_merge_grid;

/* Creates grids over borrowed places, fewer than 2^32; radius > 0, m. The grids do not depend on the number of threads.
 * Places may become less wide afterwards. KILN_SYSTEM. Destroy them in any case. */
int kiln_merge_grid_create(struct kiln_merge_grid **grid, const struct kiln_merge_place *places, size_t count,
                           float radius, uint32_t threads, struct kiln_error *error);
void kiln_merge_grid_destroy(struct kiln_merge_grid **grid);

/* Returns the level for points of a width: its cells are as wide, or less than twice as wide. The level of a place, as
 * wide as it was when the grid was made, has all points near it; the place takes part. */
int kiln_merge_grid_level(const struct kiln_merge_grid *grid, float widest);
int kiln_merge_grid_level_of(const struct kiln_merge_grid *grid, size_t at);
/* Width of a level's cells, m; and the cell of a position. */
double kiln_merge_grid_side(const struct kiln_merge_grid *grid, int level);
void kiln_merge_grid_cell(const struct kiln_merge_grid *grid, int level, struct kiln_vec3 position, int64_t cell[3]);

/* The box of some points, and how far they look, m. */
struct kiln_merge_box {
    struct kiln_vec3 low, high;
    float radius;
};

/* Numbers of places; zero before the first search. The caller frees `of`. */
struct kiln_merge_candidates {
    uint32_t *of;
    size_t count, room;
};

/* Finds the places that lie within the radius of a box, and within their own `widest` of it. They are ordered by the z,
 * y and x of their cells in the level, then by key. Those near points of that level in the box are among them.
 * KILN_SYSTEM. */
int kiln_merge_grid_find(const struct kiln_merge_grid *grid, int level, const struct kiln_merge_box *box,
                         struct kiln_merge_candidates *found, struct kiln_error *error);

#endif
