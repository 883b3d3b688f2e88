#include "coordinator/integrate/patches/senders.h"

#include <stdlib.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

struct ranked {
    double power; /* W */
    uint64_t node;
};

struct kiln_senders {
    uint64_t points, member_count;
    uint64_t *members; /* points, node after node */
    uint64_t *first;   /* per node: start of its points in `points` */
    struct ranked *ranked;
    struct kiln_patch_node *chosen;
    uint64_t *shot; /* a bit a point */
    struct kiln_arena arena;
};

static uint64_t most_chosen(uint64_t nodes) { return (nodes + KILN_UNSHOT_ROUNDS - 1) / KILN_UNSHOT_ROUNDS; }
static uint64_t words_of(uint64_t points) { return (points + 63) / 64; }

int kiln_senders_create(struct kiln_senders **senders, uint64_t points, struct kiln_error *error)
{
    static const char what[] = "the patches that send";
    struct kiln_senders *s = NULL;
    int status;
    KILN_TRY(kiln_allocate(&s, 1, sizeof *s, what, error));
    s->points = points;
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->members, (size_t)points, sizeof *s->members, what, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->first, (size_t)points + 1, sizeof *s->first, what, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->ranked, (size_t)points, sizeof *s->ranked, what, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->chosen, (size_t)most_chosen(points), sizeof *s->chosen, what, error));
    KILN_TRY(kiln_arena_allocate(&s->arena, &s->shot, (size_t)words_of(points), sizeof *s->shot, what, error));
end:
    if (status != KILN_OK)
        kiln_senders_destroy(&s);
    *senders = s;
    return status;
}

void kiln_senders_destroy(struct kiln_senders **senders)
{
    if (*senders == NULL)
        return;
    kiln_arena_release(&(*senders)->arena);
    kiln_free(senders);
}

uint64_t kiln_senders_bytes(uint64_t points)
{
    return points * (2 * sizeof(uint64_t) + sizeof(struct ranked)) +
           most_chosen(points) * sizeof(struct kiln_patch_node) + words_of(points) * sizeof(uint64_t);
}

void kiln_senders_begin(struct kiln_senders *s) { s->member_count = 0; }

void kiln_senders_add(struct kiln_senders *s, uint64_t node, uint64_t point)
{
    s->first[node] = s->member_count;
    s->members[s->member_count++] = point;
}

/* Compares for sorting: by falling power, then by rising number. */
static int by_power(const void *a, const void *b)
{
    const struct ranked *x = a, *y = b;
    if (x->power != y->power)
        return x->power < y->power ? 1 : -1;
    return x->node < y->node ? -1 : x->node > y->node;
}

static int by_node(const void *a, const void *b)
{
    const struct ranked *x = a, *y = b;
    return x->node < y->node ? -1 : x->node > y->node;
}

/* Ranks the nodes that have power, the first of which send; returns how many do, in the order of the nodes. */
static uint64_t rank_nodes(struct kiln_senders *s, const struct kiln_patches_parameters *p)
{
    uint64_t count = 0;
    for (uint64_t i = 0; i < p->count; i++) {
        const double power = (double)p->nodes[i].patch.area * kiln_luminance_of_floats(p->nodes[i].radiosity);
        if (power > 0.0)
            s->ranked[count++] = (struct ranked){power, i};
    }
    qsort(s->ranked, (size_t)count, sizeof *s->ranked, by_power);
    const uint64_t most = most_chosen(p->count), chosen = count < most ? count : most;
    qsort(s->ranked, (size_t)chosen, sizeof *s->ranked, by_node);
    return chosen;
}

void kiln_senders_choose(struct kiln_senders *s, struct kiln_patches_parameters *p)
{
    const uint64_t count = rank_nodes(s, p);
    s->first[p->count] = s->member_count;
    memset(s->shot, 0, words_of(s->points) * sizeof *s->shot);
    for (uint64_t k = 0; k < count; k++) {
        const uint64_t node = s->ranked[k].node;
        s->chosen[k] = p->nodes[node];
        for (uint64_t i = s->first[node]; i < s->first[node + 1]; i++)
            s->shot[s->members[i] / 64] |= (uint64_t)1 << s->members[i] % 64;
    }
    p->nodes = s->chosen;
    p->count = count;
    p->shot = s->shot;
}
