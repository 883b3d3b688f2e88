/* Who packs what of lightmaps that are too large for their owners.
 *
 * An owner finishes its maps alone, but the strips of their images (exr_strips.h) can be packed anywhere. In a round
 * where a rank owns clearly more than the mean, the strips of its large objects are dealt so that all ranks have as
 * nearly the same work as can be: packing goes, like water into a vessel, to the ranks with the least to do. Pure
 * arithmetic on sizes, the same on all ranks; nothing is collective. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_STRIPS_H
#define KILN_COORDINATOR_OUTPUT_MAP_STRIPS_H

#include "coordinator/output/map/texel_gather.h"

/* Smaller objects are packed by their owners: half a second of one thread. */
#define KILN_STRIPS_LEAST (1ull << 19)

/* Work on a texel: what its owner does in any case, and what can be done elsewhere. Measured, in hundreds of
 * nanoseconds. */
enum { KILN_FINISH_WORK = 3, KILN_PACK_WORK = 12 };

/* An owner's strips form its stream: those of all its divided objects, largest object first, from the top of each,
 * written in this order. */
struct kiln_strip {
    uint32_t object, row; /* its first row */
    uint32_t owner, packer;
    uint32_t index, count; /* in the stream, and strips of the stream */
};

struct kiln_strip_deal {
    size_t count;
    struct kiln_strip *strips; /* stream after stream, in the order of owners */
};

/* Deals the strips of the objects of `round` that have at least `least_texels` texels. A rank that packs for others
 * owns no strips, and packers take turns in a stream. KILN_SYSTEM. */
int kiln_strip_deal_create(struct kiln_strip_deal **strips, const struct kiln_lightmap *lightmaps,
                           const struct kiln_assignment *deal, uint32_t round, uint32_t ranks, uint64_t least_texels,
                           struct kiln_error *error);
void kiln_strip_deal_destroy(struct kiln_strip_deal **strips);

/* Whether the object's strips are dealt. */
bool kiln_strip_deal_has(const struct kiln_strip_deal *strips, uint32_t object);

/* The rank's own stream: *first in `strips`; returns how many. */
size_t kiln_strip_stream(const struct kiln_strip_deal *strips, uint32_t rank, size_t *first);

/* Numbers in `strips` of what the rank packs for others, in the order that all keep: by how far into its stream a strip
 * is. Nobody waits in a circle then: the first unfinished strip of all waits for nothing. `list` has `count` entries of
 * room. Returns how many. */
size_t kiln_strip_list(const struct kiln_strip_deal *strips, uint32_t rank, size_t *list);

#endif
