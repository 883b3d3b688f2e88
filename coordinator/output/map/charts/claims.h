/* Claims: which charts read a texel, and with what weight. The claims of a texel form a list in the order in which they
 * are made. A claim is found among the first KILN_CLAIMS_LISTED of its texel by walking, and else in a hash table. So
 * making n claims takes time and memory in proportion to n, however many charts read one texel. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_CHARTS_CLAIMS_H
#define KILN_COORDINATOR_OUTPUT_MAP_CHARTS_CLAIMS_H

#include <stddef.h>
#include <stdint.h>

#include "coordinator/output/map/map.h"

enum {
    KILN_CLAIMS_LISTED = 8,
    KILN_CLAIMS_AROUND = 24 /* texels around a texel that may be a claim's source */
};

struct kiln_chart_claim {
    uint32_t chart, source; /* source: the nearest texel of the chart; KILN_NONE: it has none */
    uint32_t next;          /* next claim of the texel; after the last the first */
    float weight;           /* w of borders.h */
};

struct kiln_chart_claim_slot {
    uint32_t texel, chart, claim; /* claim: KILN_NONE: the slot is free */
};

/* Zeroed at first; who has it frees it with kiln_chart_claims_free. */
struct kiln_chart_claims {
    struct kiln_chart_claim *claims;
    size_t count, capacity;
    struct kiln_chart_claim_slot *slots; /* of claims behind the first ones of their texel */
    size_t slot_count, slots_used;       /* slot_count: 0 or a power of two */
    uint64_t looked_at;                  /* claims and slots that were looked at: the work done */
};

/* Adds to the weight with which a chart reads a texel. The chart's first claim of the texel goes to the end of the
 * texel's list. `last`: the texel's last claim, or KILN_NONE; updated. The map has the charts of the rows around.
 * Not collective. KILN_SYSTEM. */
int kiln_chart_claims_add(struct kiln_chart_claims *claims, const struct kiln_map *map, uint32_t *last, uint32_t texel,
                          uint32_t chart, float weight, struct kiln_error *error);

/* The first claim of the list with that last one, and the claim after `claim`; KILN_NONE: there is none. */
static inline uint32_t kiln_chart_claims_first(const struct kiln_chart_claims *claims, uint32_t last)
{
    return last != KILN_NONE ? claims->claims[last].next : KILN_NONE;
}

static inline uint32_t kiln_chart_claims_next(const struct kiln_chart_claims *claims, uint32_t last, uint32_t claim)
{
    return claim != last ? claims->claims[claim].next : KILN_NONE;
}

void kiln_chart_claims_free(struct kiln_chart_claims *claims);

#endif
