#include "coordinator/field/reach.h"

#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/exchange.h"
#include "worker/base/memory.h"

int kiln_reach_create(struct kiln_reach **reach, const uint64_t *first, uint64_t count, struct kiln_error *error)
{
    struct kiln_reach *r = NULL;
    int status = kiln_allocate(&r, 1, sizeof *r, "the reach of a node", error);
    if (status == KILN_OK) {
        r->count = count;
        r->first = first;
        status = kiln_allocate(&r->states, (size_t)count, sizeof *r->states, "the reach of a node", error);
    }
    *reach = r;
    if (status != KILN_OK)
        kiln_reach_destroy(reach);
    return status;
}

void kiln_reach_destroy(struct kiln_reach **reach)
{
    if (*reach != NULL)
        kiln_free(&(*reach)->states);
    kiln_free(reach);
}

/* The unit that a point is in. */
static uint64_t unit_of(const struct kiln_reach *r, uint64_t point)
{
    uint64_t low = 0, high = r->count;
    while (low + 1 < high) {
        const uint64_t middle = low + (high - low) / 2;
        if (r->first[middle] <= point)
            low = middle;
        else
            high = middle;
    }
    return low;
}

struct kiln_reach_units kiln_reach_units(const struct kiln_reach *r, uint64_t first, uint64_t count)
{
    if (count == 0 || r->count == 0)
        return (struct kiln_reach_units){0, 0};
    return (struct kiln_reach_units){unit_of(r, first), unit_of(r, first + count - 1) + 1};
}

void kiln_reach_replace(uint8_t *states, uint64_t count, enum kiln_reach_state from, enum kiln_reach_state to)
{
    for (uint64_t i = 0; i < count; i++)
        states[i] = states[i] == from ? (uint8_t)to : states[i];
}

/* ---- telling ---- */

/* Sets the counts: each member is sent the states of its units, and sends those of this rank's units. */
static void set_counts(const struct kiln_reach *r, const uint64_t *ranges, uint64_t own, struct kiln_exchange *e)
{
    for (int m = 0; m < e->ranks; m++) {
        const struct kiln_reach_units theirs = kiln_reach_units(r, ranges[2 * m], ranges[2 * m + 1]);
        e->sent[m] = theirs.end - theirs.begin;
        e->sent_at[m] = theirs.begin;
        e->got[m] = own;
        e->got_at[m] = (uint64_t)m * own;
    }
}

int kiln_reach_tell(const struct kiln_reach *r, MPI_Comm lane, uint64_t limit, const uint64_t *ranges,
                    struct kiln_reach_asked *asked, struct kiln_error *error)
{
    const char *what = "what nodes want of each other";
    struct kiln_exchange e;
    kiln_free(&asked->states);
    int status;
    KILN_TRY(kiln_exchange_create(&e, lane, limit, what, error));
    asked->units = kiln_reach_units(r, ranges[2 * e.rank], ranges[2 * e.rank + 1]);
    const uint64_t own = asked->units.end - asked->units.begin;
    set_counts(r, ranges, own, &e);
    status = kiln_allocate(&asked->states, own * (uint64_t)e.ranks, sizeof *asked->states, what, error);
    status = kiln_exchange_send(&e, status, sizeof *asked->states, r->states, asked->states, error);
end:
    kiln_exchange_release(&e);
    return status;
}

/* ---- types ---- */

/* Consecutive runs of values, in the form of an MPI indexed type. */
struct stretches {
    int *lengths;
    MPI_Aint *places;
    size_t count, length_room, place_room;
    uint64_t values;
};

static void add_stretch(struct stretches *s, uint64_t begin, uint64_t end, size_t size)
{
    struct kiln_error error;
    if (s->count > 0 &&
        s->places[s->count - 1] + (MPI_Aint)((size_t)s->lengths[s->count - 1] * size) == (MPI_Aint)(begin * size) &&
        (uint64_t)s->lengths[s->count - 1] + (end - begin) <= INT32_MAX) {
        s->lengths[s->count - 1] += (int)(end - begin);
        s->values += end - begin;
        return;
    }
    if (kiln_grow(&s->lengths, &s->length_room, s->count + 1, sizeof *s->lengths, "messages between nodes", &error) !=
            KILN_OK ||
        kiln_grow(&s->places, &s->place_room, s->count + 1, sizeof *s->places, "messages between nodes", &error) !=
            KILN_OK)
        kiln_end_all_ranks(KILN_SYSTEM, &error); /* others wait for it already */
    s->lengths[s->count] = (int)(end - begin);
    s->places[s->count++] = (MPI_Aint)(begin * size);
    s->values += end - begin;
}

/* In pieces that int can count. */
static void add_range(struct stretches *s, uint64_t begin, uint64_t end, size_t size)
{
    for (uint64_t at = begin, next; at < end; at = next) {
        next = end - at < INT32_MAX ? end : at + INT32_MAX;
        add_stretch(s, at, next, size);
    }
}

uint64_t kiln_reach_type(const struct kiln_reach *r, const uint8_t *states, uint64_t first, uint32_t mask,
                         uint64_t begin, uint64_t end, MPI_Datatype element, size_t size, MPI_Datatype *type)
{
    struct stretches s = {0};
    const struct kiln_reach_units units = kiln_reach_units(r, begin, end - begin);
    for (uint64_t u = units.begin; u < units.end; u++) {
        const uint64_t from = r->first[u] > begin ? r->first[u] : begin,
                       to = r->first[u + 1] < end ? r->first[u + 1] : end;
        if ((mask >> states[u - first] & 1u) != 0)
            add_range(&s, from, to, size);
    }
    if (s.count > 0) {
        (void)MPI_Type_create_hindexed((int)s.count, s.lengths, s.places, element, type);
        (void)MPI_Type_commit(type);
    }
    kiln_free(&s.lengths);
    kiln_free(&s.places);
    return s.values;
}
