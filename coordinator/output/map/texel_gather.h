/* Texel gather: sends the points of each object to the rank that writes its lightmap.
 *
 * Objects are assigned to ranks by size: largest first, each to the rank with the fewest texels so far. One that alone
 * is a good part of what a rank has to do is in bands (bands.h): its points go to the ranks that have their rows. They
 * are written in rounds, so that a rank holds images of about `texel_budget` texels at a time, and at least one object,
 * however large the scene is. Within a round the points are sent in passes of bounded size, so that MPI counts stay far
 * below 2^31. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_TEXEL_GATHER_H
#define KILN_COORDINATOR_OUTPUT_MAP_TEXEL_GATHER_H

#include "coordinator/field/result.h"
#include "coordinator/output/map/ghosts.h"
#include "coordinator/output/map/layers.h"

/* The owner of a lightmap in bands: all ranks have some of it. */
#define KILN_IN_BANDS (KILN_NONE - 1)

/* The fewest texels of a lightmap in bands by default: fewer take one thread less than half a second. */
#define KILN_BANDS_LEAST (1ull << 19)

/* The assignment of lightmaps to ranks and rounds. It depends on sizes only and is the same on all ranks. Lightmaps
 * that are not published have the owner KILN_NONE. The first `own_rounds` rounds are of lightmaps that one rank owns,
 * the others of those in bands. */
struct kiln_assignment {
    size_t count;
    uint32_t rounds, own_rounds;
    uint32_t *owner, *round; /* of each lightmap */
};
/* In bands are lightmaps of at least `least_in_bands` texels, if they are more than a quarter of the texels that a rank
 * has in the mean. */
int kiln_assignment_create(struct kiln_assignment **assignment, const struct kiln_lightmap *lightmaps, size_t count,
                           uint32_t ranks, uint64_t texel_budget, uint64_t least_in_bands, struct kiln_error *error);
void kiln_assignment_destroy(struct kiln_assignment **assignment);

/* One point on its way to `map`. It is a texel of the lightmap `from`: the same, unless it is a ghost (ghosts.h).
 * `triangle` is the world triangle of its first piece; `values` are of all planes. */
struct kiln_texel_record {
    uint32_t map, from, x, y, triangle, valid;
    float area, coverage;
    float values[];
};

/* The schedule of messages, computed once. */
struct kiln_texel_gather;

/* `layers` are of the result's fields. `ghosts` (borrowed; NULL: none) are sent besides. `records_per_pass` bounds what
 * a rank sends in one pass (and about what it receives); 0 chooses 2^18, which is 15 MB with the planes that every map
 * has. */
int kiln_texel_gather_create(struct kiln_texel_gather **gather, const struct kiln_bake_result *result,
                             const struct kiln_assignment *assignment, const struct kiln_layers *layers,
                             const struct kiln_ghosts *ghosts, size_t records_per_pass, struct kiln_error *error);
void kiln_texel_gather_destroy(struct kiln_texel_gather **gather);

/* Collective. Sends this rank's points of all objects of the round, and calls `put` exactly once for each point of the
 * objects that this rank writes, and for each of their ghosts. The calls come from several threads at once, in an order
 * that depends on the partition. KILN_BUG if a value is not finite. */
int kiln_texel_gather_round(struct kiln_texel_gather *gather, uint32_t round,
                            void (*put)(void *context, const struct kiln_texel_record *record), void *context,
                            struct kiln_error *error);

#endif
