#include "coordinator/output/map/charts/claims.h"

#include <stdbool.h>

#include "worker/base/memory.h"

static const char purpose[] = "texels at borders of charts";
enum { FEWEST_SLOTS = 64 };

/* Where to look for the chart at the texel first: the high half of a product mixes all bits (Knuth, "Sorting and
 * Searching", 1998, section 6.4). */
static size_t place_of(uint32_t texel, uint32_t chart)
{
    return (size_t)((((uint64_t)texel << 32 | chart) * 0x9e3779b97f4a7c15ull) >> 32);
}

/* The slot of the chart at the texel, or the free one where it would be. */
static struct kiln_chart_claim_slot *slot_of(struct kiln_chart_claims *c, uint32_t texel, uint32_t chart)
{
    const size_t last = c->slot_count - 1;
    size_t i = place_of(texel, chart) & last;
    c->looked_at++;
    while (c->slots[i].claim != KILN_NONE && (c->slots[i].texel != texel || c->slots[i].chart != chart)) {
        i = (i + 1) & last;
        c->looked_at++;
    }
    return &c->slots[i];
}

/* Doubles the table once it is half full. */
static int make_room(struct kiln_chart_claims *c, struct kiln_error *error)
{
    if (2 * c->slots_used < c->slot_count)
        return KILN_OK;
    struct kiln_chart_claims larger = *c;
    larger.slot_count = c->slot_count > 0 ? 2 * c->slot_count : FEWEST_SLOTS;
    const int status = kiln_allocate_bare(&larger.slots, larger.slot_count, sizeof *larger.slots, purpose, error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < larger.slot_count; i++)
        larger.slots[i].claim = KILN_NONE;
    for (size_t i = 0; i < c->slot_count; i++)
        if (c->slots[i].claim != KILN_NONE)
            *slot_of(&larger, c->slots[i].texel, c->slots[i].chart) = c->slots[i];
    kiln_free(&c->slots);
    *c = larger;
    return KILN_OK;
}

/* Makes a claim at the end of the texel's list. */
static int append(struct kiln_chart_claims *c, uint32_t *last, uint32_t chart, uint32_t *claim,
                  struct kiln_error *error)
{
    const int status = kiln_grow(&c->claims, &c->capacity, c->count + 1, sizeof *c->claims, purpose, error);
    if (status != KILN_OK)
        return status;
    const uint32_t made = *claim = (uint32_t)c->count++;
    c->claims[made] = (struct kiln_chart_claim){.chart = chart, .source = KILN_NONE, .next = made};
    if (*last != KILN_NONE) {
        c->claims[made].next = c->claims[*last].next;
        c->claims[*last].next = made;
    }
    *last = made;
    return KILN_OK;
}

/* Looks among the first claims of the list. Returns whether there may be more of them. */
static bool look_in_list(struct kiln_chart_claims *c, uint32_t last, uint32_t chart, uint32_t *claim)
{
    uint32_t i = kiln_chart_claims_first(c, last);
    int listed = 0;
    for (; i != KILN_NONE && c->claims[i].chart != chart && listed < KILN_CLAIMS_LISTED; listed++)
        i = kiln_chart_claims_next(c, last, i);
    c->looked_at += (uint64_t)listed + 1;
    *claim = listed < KILN_CLAIMS_LISTED ? i : KILN_NONE;
    return listed == KILN_CLAIMS_LISTED;
}

/* Sets *claim to the index of the chart's claim of the texel. If there is none it is made, with weight 0 and no source.
 */
static int find(struct kiln_chart_claims *c, uint32_t *last, uint32_t texel, uint32_t chart, uint32_t *claim,
                struct kiln_error *error)
{
    const bool full = look_in_list(c, *last, chart, claim);
    if (*claim != KILN_NONE)
        return KILN_OK;
    if (!full)
        return append(c, last, chart, claim, error);
    int status = make_room(c, error);
    if (status != KILN_OK)
        return status;
    struct kiln_chart_claim_slot *slot = slot_of(c, texel, chart);
    if ((*claim = slot->claim) != KILN_NONE)
        return KILN_OK;
    if ((status = append(c, last, chart, claim, error)) != KILN_OK)
        return status;
    *slot = (struct kiln_chart_claim_slot){texel, chart, *claim};
    c->slots_used++;
    return KILN_OK;
}

/* Offsets of neighbouring texels, by distance; among equal ones the smaller column first, then the smaller row. */
static const int8_t around[KILN_CLAIMS_AROUND][2] = {
    {-1, 0},  {0, -1}, {0, 1},   {1, 0},  {-1, -1}, {-1, 1}, {1, -1}, {1, 1}, {-2, 0},  {0, -2}, {0, 2},  {2, 0},
    {-2, -1}, {-2, 1}, {-1, -2}, {-1, 2}, {1, -2},  {1, 2},  {2, -1}, {2, 1}, {-2, -2}, {-2, 2}, {2, -2}, {2, 2}};

/* Returns the chart's surface texel nearest to `texel`, or KILN_NONE. It is at most two texels away, since a chart only
 * reads texels next to its own. */
static uint32_t nearest_of_chart(const struct kiln_map *map, uint32_t texel, uint32_t chart)
{
    for (size_t k = 0; k < KILN_CLAIMS_AROUND; k++) {
        const int64_t x = (int64_t)(texel % map->width) + around[k][0],
                      y = (int64_t)(texel / map->width) + around[k][1];
        if (x < 0 || y < 0 || x >= map->width || y >= map->height)
            continue;
        const size_t other = (size_t)y * map->width + (size_t)x;
        if (map->state[other] != KILN_TEXEL_MARGIN && map->chart[other] == chart)
            return (uint32_t)other;
    }
    return KILN_NONE;
}

int kiln_chart_claims_add(struct kiln_chart_claims *c, const struct kiln_map *map, uint32_t *last, uint32_t texel,
                          uint32_t chart, float weight, struct kiln_error *error)
{
    const size_t before = c->count;
    uint32_t claim;
    const int status = find(c, last, texel, chart, &claim, error);
    if (status != KILN_OK)
        return status;
    if (claim == before)
        c->claims[claim].source = nearest_of_chart(map, texel, chart);
    c->claims[claim].weight += weight;
    return KILN_OK;
}

void kiln_chart_claims_free(struct kiln_chart_claims *c)
{
    kiln_free(&c->claims);
    kiln_free(&c->slots);
    *c = (struct kiln_chart_claims){0};
}
