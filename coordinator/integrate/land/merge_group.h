/* The points near each of a group of points that stand together: their candidates are gathered once, and compared in
 * SIMD lanes (merge.h). Not collective. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_MERGE_GROUP_H
#define KILN_COORDINATOR_INTEGRATE_LAND_MERGE_GROUP_H

#include "coordinator/integrate/land/merge_near.h"

enum { KILN_MERGE_CHUNK = 64 }; /* consecutive points that a thread looks at before it takes others; most of a group */

enum { KILN_MERGE_RINGS = 8 }; /* radii of kiln_merge_group_rings */

/* A group: numbers of its `count` points and of its candidates, and for each point two masks of `words` words, with a
 * bit a candidate that is near by the radius and by half of it. A point is not near itself here. Candidates are in the
 * order of the cells of their level, then by key, so sums in this order do not depend on groups. */
struct kiln_merge_group {
    uint32_t count, candidates, words;
    const uint32_t *points, *of;
    const uint64_t *near, *half;
};

/* Values of the candidates that are compared, by column. */
enum kiln_merge_column {
    KILN_MERGE_X,
    KILN_MERGE_Y,
    KILN_MERGE_Z,
    KILN_MERGE_NORMAL_X,
    KILN_MERGE_NORMAL_Y,
    KILN_MERGE_NORMAL_Z,
    KILN_MERGE_WIDEST,
    KILN_MERGE_COLUMNS
};

/* Memory of one thread for its searches; zero before the first. Release with kiln_merge_finder_release, in any case. */
struct kiln_merge_finder {
    struct kiln_merge_candidates found;
    float *columns; /* of candidates, filled to whole words of the masks; then of those near one point */
    struct kiln_merge_ranked *ranked;
    uint8_t *bytes; /* by candidate, of one point */
    uint32_t *which, *within;
    uint64_t *words;
    size_t column_room, ranked_room, byte_room, which_room, within_room, word_room, stride;
};
void kiln_merge_finder_release(struct kiln_merge_finder *finder);

/* Takes from `rest`, a mask of the points from `first` on, not empty, all that form a group with its first, and writes
 * their numbers in order. Returns how many. Without a grid: all. */
uint32_t kiln_merge_group_choose(const struct kiln_merge_grid *grid, const struct kiln_merge_place *places,
                                 size_t first, uint64_t *rest, uint32_t points[KILN_MERGE_CHUNK]);

/* Finds what is near the points of a group: points are near each other by the smallest of `radius`, m, and the `widest`
 * of both. The group is in the memory of the finder until its next search; `words_used`: how many of finder->words have
 * it. KILN_SYSTEM. */
int kiln_merge_group_find(const struct kiln_merge_grid *grid, const struct kiln_merge_place *places,
                          const uint32_t *points, uint32_t count, float radius, struct kiln_merge_finder *finder,
                          struct kiln_merge_group *group, size_t *words_used, struct kiln_error *error);
/* Reads a group from a copy of its words. Returns where the next begins. */
const uint64_t *kiln_merge_group_read(const uint64_t *words, struct kiln_merge_group *group);

/* Finds what is near point number `point` of the group last found, at `place`, and by how many of the radii, which are
 * less than that of the search. Returns how many are: candidates finder->which[], in order, by finder->within[]. */
size_t kiln_merge_group_rings(struct kiln_merge_finder *finder, const struct kiln_merge_group *group, size_t point,
                              const struct kiln_merge_place *place, const float radii[KILN_MERGE_RINGS]);

#endif
