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

/* Creates grids over borrowed places; radius > 0, m. The grids do not depend on the number of threads. KILN_SYSTEM.
 * Destroy them in any case. */
int kiln_merge_grid_create(struct kiln_merge_grid **grid, const struct kiln_merge_place *places, size_t count,
                           float radius, uint32_t threads, struct kiln_error *error);
void kiln_merge_grid_destroy(struct kiln_merge_grid **grid);

/* Numbers of places near a place; zero before the first search. The caller frees `of`. */
struct kiln_merge_near {
    size_t *of, count, room;
};

/* Finds place `at` itself, then the others near it, ordered by cell and key. Their distance is at most `radius` and
 * their own `widest`; `radius` is at most the `widest` of `at` and the radius of the grid. Without a grid: `at` alone.
 * KILN_SYSTEM. */
int kiln_merge_grid_find(const struct kiln_merge_grid *grid, size_t at, float radius, struct kiln_merge_near *near,
                         struct kiln_error *error);

/* Sets of places by cells as wide as the radius: a byte for each of kiln_merge_grid_slots hashes of cells. Different
 * cells may share a byte, so a set has some places too many. */
size_t kiln_merge_grid_slots(const struct kiln_merge_grid *grid);
/* Adds the cell of place `at` to the set. Several threads may do so at once. */
void kiln_merge_grid_mark(const struct kiln_merge_grid *grid, size_t at, uint8_t *set);
/* Whether a cell of the set lies within the radius of place `at`. True if a marked place is near it. */
bool kiln_merge_grid_marked(const struct kiln_merge_grid *grid, size_t at, const uint8_t *set);

#endif
