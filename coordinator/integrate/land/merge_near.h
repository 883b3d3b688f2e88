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
    uint64_t key; /* lightmap and texel: not by the order of points, which cells change */
    struct kiln_vec3 position, normal;
    float lit;    /* m2 that is there to be lit; 0: it takes no part */
    float widest; /* m: how far its light is spread at most; 0: it is near no other */
};
_Static_assert(sizeof(struct kiln_merge_place) == 40, "a record has no gaps");

#define KILN_MERGE_ALIKE 0.5f /* cosine between normals of points that are near each other */
#define KILN_MERGE_FLAT 0.25f /* of the radius: how far they may lie from each other's planes */

/* Whether two points are near each other; the same for either of both. */
static inline bool kiln_merge_are_near(const struct kiln_merge_place *a, const struct kiln_merge_place *b, float radius)
{
    const struct kiln_vec3 d = vec3_sub(b->position, a->position);
    return vec3_dot(d, d) <= radius * radius && vec3_dot(a->normal, b->normal) >= KILN_MERGE_ALIKE &&
           fabsf(vec3_dot(d, a->normal)) <= KILN_MERGE_FLAT * radius &&
           fabsf(vec3_dot(d, b->normal)) <= KILN_MERGE_FLAT * radius;
}

/* Grids over the points that take part, each in a hash table: one with cells as wide as the radius, and for points
 * whose `widest` is less one with cells of a half, a quarter, and so on. So where texels of one object are small beside
 * those of another, a point looks at as few others as elsewhere. */
struct kiln_merge_grid;

/* Borrows the places; radius > 0, m. The same grid by any number of threads. KILN_SYSTEM. Destroy it in any case. */
int kiln_merge_grid_create(struct kiln_merge_grid **grid, const struct kiln_merge_place *places, size_t count,
                           float radius, uint32_t threads, struct kiln_error *error);
void kiln_merge_grid_destroy(struct kiln_merge_grid **grid);

/* Numbers of places; zero before the first search. The caller frees `of`. */
struct kiln_merge_near {
    size_t *of, count, room;
};

/* Place `at` itself, then the others that are near it by `radius`, which is at most its `widest` and that of the grid,
 * and by their own `widest`; by cell and key. Without a grid: itself alone. KILN_SYSTEM. */
int kiln_merge_grid_find(const struct kiln_merge_grid *grid, size_t at, float radius, struct kiln_merge_near *near,
                         struct kiln_error *error);

#endif
