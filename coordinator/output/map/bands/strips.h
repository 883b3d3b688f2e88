/* Strip assignment: decides which ranks compress the strips of lightmaps that would take their owners too long.
 *
 * An owner computes its maps alone, but any rank can compress strips of their images (exr_strips.h). In a round in
 * which a rank owns clearly more than the mean, the strips of its large objects are distributed so that the work of all
 * ranks becomes as equal as possible; the ranks with the least work get the most strips (water-filling). The assignment
 * depends on sizes only and is the same on all ranks; nothing is collective. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_BANDS_STRIPS_H
#define KILN_COORDINATOR_OUTPUT_MAP_BANDS_STRIPS_H

#include "coordinator/output/map/bands/assignment.h"

/* Texels from which on the strips of an object may be distributed; fewer take one thread less than half a second. */
#define KILN_STRIPS_LEAST (1ull << 19)

/* Cost of a texel, measured, in units of 100 ns: the work that only its owner can do, and its compression. */
enum { KILN_FINISH_WORK = 3, KILN_PACK_WORK = 4 };

/* A strip of a distributed object. The strips of an owner form its stream, in which it writes them: objects by size,
 * largest first, and each from top to bottom. */
struct kiln_strip {
    uint32_t object, row; /* row: the first row of the strip */
    uint32_t owner, packer;
    uint32_t index, count; /* index in the stream, and number of strips in the stream */
};

struct kiln_strip_assignment {
    size_t count;
    struct kiln_strip *strips; /* one stream after the other, in the order of owners */
};

/* Assigns the strips of the objects of `round` that have at least `least_texels` texels. A rank that packs for other
 * ranks owns no distributed strips, and the packers of a stream take turns. KILN_SYSTEM if memory is short. */
int kiln_strip_assignment_create(struct kiln_strip_assignment **strips, const struct kiln_lightmap *lightmaps,
                                 const struct kiln_assignment *assignment, uint32_t round, uint32_t ranks,
                                 uint64_t least_texels, struct kiln_error *error);
void kiln_strip_assignment_destroy(struct kiln_strip_assignment **strips);

/* Whether the strips of the object are distributed. */
bool kiln_strip_assignment_has(const struct kiln_strip_assignment *strips, uint32_t object);

/* The stream of a rank: *first is the index of its first strip in `strips`; returns the number of its strips. */
size_t kiln_strip_stream(const struct kiln_strip_assignment *strips, uint32_t rank, size_t *first);

/* Lists the indices in `strips` of the strips that the rank packs for others, ordered by their relative position in
 * their streams. All ranks keep this order, which prevents deadlock: the first unfinished strip of all waits for
 * nothing. `list` has room for all strips. Returns the number of indices. */
size_t kiln_strip_list(const struct kiln_strip_assignment *strips, uint32_t rank, size_t *list);

#endif
