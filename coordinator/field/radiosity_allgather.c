#include "coordinator/field/radiosity_allgather.h"

#include <limits.h>
#include <sched.h>
#include <string.h>

#include "coordinator/field/reach.h"
#include "coordinator/mpi/waiting.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/assert_same.h"
#include "worker/scene/radiosity.h"

enum { GROUPS_MOST = 8, GROUP_POINTS = 512 };
enum { EXPAND_ALONE = 4096 }; /* most values that are expanded without threads */

/* Messages that are under way. */
struct requests {
    MPI_Request *of;
    size_t count, room;
};

/* Ranks of different nodes, one per node, that exchange with each other. */
struct lane {
    MPI_Comm communicator;
    int members;
    bool own;         /* this rank sends its own values in this lane; otherwise it only receives for its node */
    uint64_t *ranges; /* per member: first and count of its values; count 0 if it only receives */
    int *counts, *places;
    uint32_t started;              /* groups of this bounce */
    double since;                  /* when the last one was */
    uint64_t bytes;                /* of it, to receive */
    struct kiln_reach_asked asked; /* with a reach: requests of the members for this rank's points */
    /* pending messages: of groups, sent while the bounce continues; of exchanges that are waited for */
    struct requests groups, now;
};

struct kiln_radiosity_allgather {
    struct kiln_radiosity_allgather_params params;
    struct kiln_node_memory *private_node; /* when the real one is full */
    struct kiln_node_memory *node;
    int nodes;
    uint64_t *values;   /* all points */
    uint32_t *incoming; /* all points; NULL with one node */
    struct lane *lanes;
    size_t lane_count;
    uint64_t received, whole; /* bytes received, and bytes that would be received if nodes wanted everything */
    double scale;
    bool under_way;
    struct kiln_reach *reach; /* NULL: nodes receive all */
};

uint64_t *kiln_radiosity_allgather_values(const struct kiln_radiosity_allgather *allgather)
{
    return allgather->values;
}
uint64_t kiln_radiosity_allgather_received(const struct kiln_radiosity_allgather *allgather)
{
    return allgather->received;
}
uint64_t kiln_radiosity_allgather_whole(const struct kiln_radiosity_allgather *allgather) { return allgather->whole; }

void kiln_radiosity_allgather_set_scale(struct kiln_radiosity_allgather *allgather, double scale)
{
    allgather->scale = scale;
}

double kiln_radiosity_allgather_scale(const struct kiln_radiosity_allgather *allgather) { return allgather->scale; }

/* ---- life ---- */

/* Collective on the node. */
static int make_blocks(struct kiln_radiosity_allgather *x, struct kiln_error *error)
{
    int status =
        kiln_node_region(x->node, &x->values, x->params.total, sizeof *x->values, "the radiosity of all points", error);
    if (status == KILN_OK && x->nodes > 1)
        status = kiln_node_region(x->node, &x->incoming, x->params.total, sizeof *x->incoming,
                                  "the radiosity on its way", error);
    return status;
}

/* Collective. Chooses the node memory. All ranks share with their node, or none does, since the lanes depend on it. */
static int choose_node(struct kiln_radiosity_allgather *x, struct kiln_error *error)
{
    int leader = kiln_node_rank(x->params.node) == 0;
    x->node = x->params.node;
    (void)MPI_Allreduce(&leader, &x->nodes, 1, MPI_INT, MPI_SUM, x->params.communicator);
    int status = make_blocks(x, error);
    int full = status != KILN_OK && kiln_node_full(x->node);
    (void)MPI_Allreduce(MPI_IN_PLACE, &full, 1, MPI_INT, MPI_LOR, x->params.communicator);
    if (full == 0)
        return kiln_agree(x->params.communicator, status, error);
    status = kiln_node_create(&x->private_node, x->params.communicator, 1, error);
    if (status != KILN_OK)
        return status;
    x->node = x->private_node;
    (void)MPI_Comm_size(x->params.communicator, &x->nodes);
    return kiln_agree(x->params.communicator, make_blocks(x, error), error);
}

/* Collective on the lane. */
static void learn_ranges(const struct kiln_radiosity_allgather *x, struct lane *lane)
{
    const uint64_t own[2] = {x->params.first.at, lane->own ? x->params.count : 0};
    (void)MPI_Allgather(own, 2, MPI_UINT64_T, lane->ranges, 2, MPI_UINT64_T, lane->communicator);
}

/* Collective on the lane. */
static int fill_lane(const struct kiln_radiosity_allgather *x, struct lane *lane, struct kiln_error *error)
{
    const char *what = "the ranks' shares";
    (void)MPI_Comm_size(lane->communicator, &lane->members);
    const size_t members = (size_t)lane->members;
    int status;
    KILN_TRY(kiln_allocate(&lane->ranges, 2 * members, sizeof *lane->ranges, what, error));
    KILN_TRY(kiln_allocate(&lane->counts, members, sizeof *lane->counts, what, error));
    KILN_TRY(kiln_allocate(&lane->places, members, sizeof *lane->places, what, error));
end:
    status = kiln_agree(lane->communicator, status, error);
    if (status == KILN_OK)
        learn_ranges(x, lane);
    return status;
}

/* Collective. As many lanes as the largest node has ranks. */
static int make_lanes(struct kiln_radiosity_allgather *x, struct kiln_error *error)
{
    const int rank = kiln_node_rank(x->node), ranks = kiln_node_ranks(x->node);
    int most;
    (void)MPI_Allreduce(&ranks, &most, 1, MPI_INT, MPI_MAX, x->params.communicator);
    int status =
        kiln_allocate(&x->lanes, (size_t)(most / ranks + 1), sizeof *x->lanes, "the lanes between nodes", error);
    status = kiln_agree(x->params.communicator, status, error);
    for (int i = 0; i < most && status == KILN_OK && x->nodes > 1; i++) {
        MPI_Comm communicator;
        (void)MPI_Comm_split(x->params.communicator, i % ranks == rank ? 0 : MPI_UNDEFINED, 0, &communicator);
        if (communicator != MPI_COMM_NULL) {
            struct lane *lane = &x->lanes[x->lane_count++];
            *lane = (struct lane){.communicator = communicator, .own = i == rank};
            status = fill_lane(x, lane, error);
        }
        /* agree with the ranks of other lanes, too: the next split is collective over all ranks */
        status = kiln_agree(x->params.communicator, status, error);
    }
    return status;
}

int kiln_radiosity_allgather_create(struct kiln_radiosity_allgather **allgather,
                                    const struct kiln_radiosity_allgather_params *params, struct kiln_error *error)
{
    struct kiln_radiosity_allgather *x = NULL;
    *allgather = NULL;
    kiln_assert_same(params->communicator, params->total, "the number of points that are exchanged");
    kiln_assert_same(params->communicator, params->groups, "the number of groups of points");
    kiln_assert_same(params->communicator, params->limit, "the limit of elements in a call");
    kiln_assert_ranges(params->communicator, params->first.at, params->count, params->total, "the ranks' points");
    int status = kiln_agree(params->communicator, kiln_allocate(&x, 1, sizeof *x, "the exchange", error), error);
    if (status != KILN_OK) {
        kiln_free(&x);
        return status;
    }
    x->params = *params;
    if (x->params.limit == 0)
        x->params.limit = INT_MAX;
    if (x->params.groups == 0) {
        const uint64_t wanted = params->total / GROUP_POINTS;
        x->params.groups = wanted < 1 ? 1 : wanted > GROUPS_MOST ? GROUPS_MOST : (uint32_t)wanted;
    }
    status = choose_node(x, error);
    if (status == KILN_OK)
        status = make_lanes(x, error);
    *allgather = x;
    if (status != KILN_OK)
        kiln_radiosity_allgather_destroy(allgather);
    return status;
}

void kiln_radiosity_allgather_destroy(struct kiln_radiosity_allgather **allgather)
{
    struct kiln_radiosity_allgather *x = *allgather;
    if (x == NULL)
        return;
    for (size_t i = 0; i < x->lane_count; i++) {
        (void)MPI_Comm_free(&x->lanes[i].communicator);
        kiln_free(&x->lanes[i].ranges);
        kiln_free(&x->lanes[i].counts);
        kiln_free(&x->lanes[i].places);
        kiln_free(&x->lanes[i].groups.of);
        kiln_free(&x->lanes[i].now.of);
        kiln_free(&x->lanes[i].asked.states);
    }
    kiln_free(&x->lanes);
    kiln_reach_destroy(&x->reach);
    kiln_node_destroy(&x->private_node);
    kiln_free(allgather);
}

/* Collective. In each lane the members tell each other which units they want. */
static int tell_lanes(struct kiln_radiosity_allgather *x, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < x->lane_count && status == KILN_OK; i++) {
        struct lane *lane = &x->lanes[i];
        status = kiln_reach_tell(x->reach, lane->communicator, x->params.limit, lane->ranges, &lane->asked, error);
    }
    return kiln_agree(x->params.communicator, status, error);
}

int kiln_radiosity_allgather_set_range(struct kiln_radiosity_allgather *x, struct kiln_global_point first,
                                       uint64_t count, struct kiln_error *error)
{
    kiln_assert_ranges(x->params.communicator, first.at, count, x->params.total, "the ranks' new points");
    x->params.first = first;
    x->params.count = count;
    for (size_t i = 0; i < x->lane_count; i++)
        learn_ranges(x, &x->lanes[i]);
    return x->reach != NULL ? tell_lanes(x, error) : KILN_OK;
}

/* ---- a group ---- */

/* Index of the first of this rank's `count` points that belongs to group `group` of `groups`; computed alike on all
 * ranks. */
static uint64_t group_begin(uint64_t count, uint32_t group, uint32_t groups)
{
    return count / groups * group + count % groups * group / groups;
}

static MPI_Request *new_request(struct requests *r)
{
    struct kiln_error error;
    if (kiln_grow(&r->of, &r->room, r->count + 1, sizeof *r->of, "messages between nodes", &error) != KILN_OK)
        kiln_end_all_ranks(KILN_SYSTEM, &error); /* others wait for it already */
    return &r->of[r->count++];
}

enum { WANTED = 1u << KILN_REACH_WANTED, NEW = 1u << KILN_REACH_NEW, FETCHED = 1u << KILN_REACH_FETCHED };

/* Exchange of one group of the points of all members of a lane. */
struct message {
    void *all; /* array of all points, read and written */
    size_t size;
    uint32_t group, groups;
    uint32_t mask;       /* with a reach: only units that the receiver has in these states */
    struct requests *to; /* of the lane */
    uint64_t bytes;      /* that this rank receives: filled in */
};

static MPI_Datatype element_of(const struct message *g)
{
    return g->size == sizeof(uint64_t) ? MPI_UINT64_T : MPI_UINT32_T;
}

/* Starts the exchange of a message too large for int counts: each member's part in turn, in pieces. */
static void start_pieces(const struct kiln_radiosity_allgather *x, struct lane *lane, const struct message *g)
{
    for (int m = 0; m < lane->members; m++) {
        const uint64_t first = lane->ranges[2 * m], count = lane->ranges[2 * m + 1];
        const uint64_t end = group_begin(count, g->group + 1, g->groups);
        for (uint64_t at = group_begin(count, g->group, g->groups); at < end;) {
            const uint64_t piece = end - at < x->params.limit ? end - at : x->params.limit;
            (void)MPI_Ibcast((char *)g->all + (first + at) * g->size, (int)piece, element_of(g), m, lane->communicator,
                             new_request(g->to));
            at += piece;
        }
    }
}

/* Starts the exchange of all values of a group among the members of a lane, in one MPI call. If there are too many
 * points for the counts of a call, the values go in pieces. */
static void start_whole(struct kiln_radiosity_allgather *x, struct lane *lane, const struct message *g)
{
    if (x->params.total > x->params.limit) {
        start_pieces(x, lane, g);
        return;
    }
    MPI_Request *request = new_request(g->to);
    /* MPI reads these arrays when the call begins; some libraries read them until it ends (see finish) */
    for (int m = 0; m < lane->members; m++) {
        const uint64_t count = lane->ranges[2 * m + 1], begin = group_begin(count, g->group, g->groups);
        lane->places[m] = (int)(lane->ranges[2 * m] + begin);
        lane->counts[m] = (int)(group_begin(count, g->group + 1, g->groups) - begin);
    }
    (void)MPI_Iallgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, g->all, lane->counts, lane->places, element_of(g),
                          lane->communicator, request);
}

/* Makes the type of wanted values of the group's points of member `owner`, by the states of the receiver from unit
 * `unit` on. Returns the number of values; see kiln_reach_type. */
static uint64_t wanted_type(const struct kiln_radiosity_allgather *x, const struct lane *lane, const struct message *g,
                            int owner, const uint8_t *states, uint64_t unit, MPI_Datatype *type)
{
    const uint64_t first = lane->ranges[2 * owner], count = lane->ranges[2 * owner + 1];
    return kiln_reach_type(x->reach, states, unit, g->mask, first + group_begin(count, g->group, g->groups),
                           first + group_begin(count, g->group + 1, g->groups), element_of(g), g->size, type);
}

/* Starts the exchange of the group's wanted values, with a message for each pair of members that has any. Both members
 * know which pairs these are. The tag is the group's number; immediate exchanges have another one. */
static void start_wanted(struct kiln_radiosity_allgather *x, struct lane *lane, struct message *g)
{
    const int tag = g->to == &lane->now ? GROUPS_MOST : (int)g->group;
    const struct kiln_reach_units own = lane->asked.units;
    MPI_Datatype type;
    int self;
    (void)MPI_Comm_rank(lane->communicator, &self);
    g->bytes = 0;
    for (int m = 0; m < lane->members; m++) {
        const uint64_t values = m != self ? wanted_type(x, lane, g, m, x->reach->states, 0, &type) : 0;
        if (values == 0)
            continue;
        (void)MPI_Irecv(g->all, 1, type, m, tag, lane->communicator, new_request(g->to));
        (void)MPI_Type_free(&type);
        g->bytes += values * g->size;
    }
    for (int m = 0; m < lane->members; m++) {
        const uint8_t *states = lane->asked.states + (uint64_t)m * (own.end - own.begin);
        if (m == self || wanted_type(x, lane, g, self, states, own.begin, &type) == 0)
            continue;
        (void)MPI_Isend(g->all, 1, type, m, tag, lane->communicator, new_request(g->to));
        (void)MPI_Type_free(&type);
    }
}

/* Starts the exchange of one group in a lane, in either form. */
static void start_group(struct kiln_radiosity_allgather *x, struct lane *lane, struct message *g)
{
    uint64_t sum = 0;
    for (int m = 0; m < lane->members; m++)
        sum += group_begin(lane->ranges[2 * m + 1], g->group + 1, g->groups) -
               group_begin(lane->ranges[2 * m + 1], g->group, g->groups);
    const uint64_t own =
        group_begin(x->params.count, g->group + 1, g->groups) - group_begin(x->params.count, g->group, g->groups);
    g->bytes = (sum - (lane->own ? own : 0)) * g->size;
    /* requests beyond WANTED have no counterpart in an exchange of everything */
    if ((g->mask & WANTED) != 0)
        x->whole += g->bytes;
    if (x->reach != NULL)
        start_wanted(x, lane, g);
    else
        start_whole(x, lane, g);
    x->received += g->bytes;
}

/* The next group of a bounce. */
static void start_next(struct kiln_radiosity_allgather *x, struct lane *lane)
{
    struct message message = {.all = x->incoming,
                              .size = sizeof *x->incoming,
                              .group = lane->started++,
                              .groups = x->params.groups,
                              .mask = WANTED,
                              .to = &lane->groups};
    lane->since = MPI_Wtime();
    start_group(x, lane, &message);
    lane->bytes = message.bytes;
}

/* Whether all started messages of the groups are complete. Does not wait. */
static bool settled(const struct kiln_radiosity_allgather *x, struct lane *lane)
{
    int complete = 1;
    if (lane->groups.count == 0)
        return true;
    (void)MPI_Testall((int)lane->groups.count, lane->groups.of, &complete, MPI_STATUSES_IGNORE);
    if (complete != 0) {
        kiln_trace_add(x->params.trace, KILN_TRACE_TRAVEL, "group of points", lane->since, MPI_Wtime(),
                       (int64_t)lane->bytes);
        lane->groups.count = 0;
    }
    return complete != 0;
}

static void wait_for(struct requests *r)
{
    (void)MPI_Waitall((int)r->count, r->of, MPI_STATUSES_IGNORE);
    r->count = 0;
}

/* Exchanges, in all lanes and at once, the values that nodes have in the states `mask`. */
static void exchange_now(struct kiln_radiosity_allgather *x, void *all, size_t size, uint32_t mask)
{
    for (size_t i = 0; i < x->lane_count; i++) {
        struct message message = {.all = all, .size = size, .groups = 1, .mask = mask, .to = &x->lanes[i].now};
        start_group(x, &x->lanes[i], &message);
    }
    for (size_t i = 0; i < x->lane_count; i++)
        wait_for(&x->lanes[i].now);
}

/* On both sides. */
static void replace_states(struct kiln_radiosity_allgather *x, enum kiln_reach_state from, enum kiln_reach_state to)
{
    if (x->reach == NULL)
        return;
    kiln_reach_replace(x->reach->states, x->reach->count, from, to);
    for (size_t i = 0; i < x->lane_count; i++) {
        const struct kiln_reach_asked *asked = &x->lanes[i].asked;
        kiln_reach_replace(asked->states, (uint64_t)x->lanes[i].members * (asked->units.end - asked->units.begin), from,
                           to);
    }
}

void kiln_radiosity_allgather_all(struct kiln_radiosity_allgather *x)
{
    exchange_now(x, x->values, sizeof *x->values, WANTED | NEW);
    replace_states(x, KILN_REACH_NEW, KILN_REACH_WANTED);
    kiln_node_wait(x->node);
}

/* ---- the reach ---- */

/* This rank's range of all points of the node, as the ranks divide work among each other. */
struct part {
    uint64_t begin, end;
};
static struct part part_of(const struct kiln_radiosity_allgather *x)
{
    const uint64_t ranks = (uint64_t)kiln_node_ranks(x->node), rank = (uint64_t)kiln_node_rank(x->node),
                   total = x->params.total;
    return (struct part){total / ranks * rank + total % ranks * rank / ranks,
                         total / ranks * (rank + 1) + total % ranks * (rank + 1) / ranks};
}

void kiln_radiosity_allgather_mark(struct kiln_radiosity_allgather *x,
                                   uint64_t (*mark)(const void *context, uint64_t unit), const void *context)
{
    const struct part part = part_of(x);
    const struct kiln_reach *r = x->reach;
    const struct kiln_reach_units units = kiln_reach_units(r, part.begin, part.end - part.begin);
    kiln_node_wait(x->node);
    for (uint64_t u = units.begin; u < units.end; u++) {
        const uint64_t begin = r->first[u] > part.begin ? r->first[u] : part.begin,
                       end = r->first[u + 1] < part.end ? r->first[u + 1] : part.end;
        const uint64_t value = r->states[u] == KILN_REACH_ABSENT ? mark(context, u) : 0;
        for (uint64_t i = begin; i < end && r->states[u] == KILN_REACH_ABSENT; i++)
            x->values[i] = value;
    }
    kiln_node_wait(x->node);
}

static uint64_t absent(const void *context, uint64_t unit)
{
    (void)context, (void)unit;
    return kiln_radiosity_absent(KILN_RADIOSITY_ALL_CHANNELS);
}

void kiln_radiosity_allgather_mark_absent(struct kiln_radiosity_allgather *x)
{
    kiln_radiosity_allgather_mark(x, absent, NULL);
}

/* Collective on the node. Marks each unit that any of its ranks wants. Units with points of these ranks are marked,
 * too. */
static void merge_wishes(struct kiln_radiosity_allgather *x, uint8_t *wanted)
{
    uint64_t count = x->reach->count;
    for (uint64_t at = 0, some; at < count; at += some) {
        some = count - at < INT_MAX ? count - at : INT_MAX;
        (void)MPI_Allreduce(MPI_IN_PLACE, wanted + at, (int)some, MPI_UINT8_T, MPI_MAX,
                            kiln_node_communicator(x->params.node));
    }
    for (uint64_t u = 0; u < count; u++)
        if (wanted[u] != 0 && x->reach->states[u] == KILN_REACH_ABSENT)
            x->reach->states[u] = KILN_REACH_FETCHED;
}

int kiln_radiosity_allgather_want(struct kiln_radiosity_allgather *x, uint8_t *wanted, bool now,
                                  struct kiln_error *error)
{
    const struct kiln_reach_units own = kiln_reach_units(x->reach, x->params.first.at, x->params.count);
    for (uint64_t u = own.begin; u < own.end; u++)
        wanted[u] = 1;
    merge_wishes(x, wanted);
    const int status = tell_lanes(x, error);
    if (status != KILN_OK)
        return status;
    if (now)
        exchange_now(x, x->values, sizeof *x->values, FETCHED);
    replace_states(x, KILN_REACH_FETCHED, x->under_way ? KILN_REACH_NEW : KILN_REACH_WANTED);
    kiln_node_wait(x->node);
    return KILN_OK;
}

int kiln_radiosity_allgather_drop(struct kiln_radiosity_allgather *x, const uint8_t *wanted, struct kiln_error *error)
{
    for (uint64_t u = 0; u < x->reach->count; u++)
        if (wanted[u] == 0)
            x->reach->states[u] = KILN_REACH_ABSENT;
    const int status = tell_lanes(x, error);
    if (status == KILN_OK)
        kiln_radiosity_allgather_mark_absent(x);
    return status;
}

int kiln_radiosity_allgather_limit(struct kiln_radiosity_allgather *x, const uint64_t *first, uint64_t count,
                                   struct kiln_error *error)
{
    uint8_t *none = NULL;
    kiln_assert_same(x->params.communicator, count, "the number of units");
    if (x->nodes == 1)
        return KILN_OK;
    int status = kiln_reach_create(&x->reach, first, count, error);
    if (status == KILN_OK)
        status = kiln_allocate(&none, (size_t)count, sizeof *none, "the reach of a node", error);
    status = kiln_agree(x->params.communicator, status, error);
    if (status == KILN_OK)
        status = kiln_radiosity_allgather_want(x, none, false, error);
    if (status == KILN_OK)
        kiln_radiosity_allgather_mark_absent(x);
    else
        kiln_reach_destroy(&x->reach);
    kiln_free(&none);
    return status;
}

void kiln_radiosity_allgather_unlimit(struct kiln_radiosity_allgather *x) { kiln_reach_destroy(&x->reach); }

const uint8_t *kiln_radiosity_allgather_reach(const struct kiln_radiosity_allgather *x)
{
    return x->reach != NULL ? x->reach->states : NULL;
}

/* ---- a bounce ---- */

void kiln_radiosity_allgather_begin(struct kiln_radiosity_allgather *x)
{
    x->under_way = true;
    replace_states(x, KILN_REACH_NEW, KILN_REACH_WANTED);
    for (size_t i = 0; i < x->lane_count; i++)
        x->lanes[i].started = 0;
}

/* Copies this rank's values of a group to the array that they are sent from. */
static void put_group(struct kiln_radiosity_allgather *x, const uint32_t *next, uint32_t group)
{
    const uint64_t begin = group_begin(x->params.count, group, x->params.groups),
                   end = group_begin(x->params.count, group + 1, x->params.groups);
    memcpy(x->incoming + x->params.first.at + begin, next + begin, (end - begin) * sizeof *next);
}

/* Starts the next groups of a lane. A group starts when its values are there and the one before is complete: until then
 * MPI may still use the counts. */
static void advance_lane(struct kiln_radiosity_allgather *x, struct lane *lane, const uint32_t *next, uint64_t done)
{
    const uint32_t groups = x->params.groups;
    while (settled(x, lane) && lane->started < groups) {
        const uint32_t group = lane->started;
        if (lane->own && done < group_begin(x->params.count, group + 1, groups))
            return;
        if (lane->own)
            put_group(x, next, group);
        start_next(x, lane);
    }
}

void kiln_radiosity_allgather_advance(struct kiln_radiosity_allgather *x, const uint32_t *next, uint64_t done)
{
    for (size_t i = 0; i < x->lane_count && x->under_way; i++)
        advance_lane(x, &x->lanes[i], next, done);
}

/* Drives all lanes until each has started `groups`. */
static void drive(struct kiln_radiosity_allgather *x, const uint32_t *next, uint32_t groups)
{
    kiln_waiting_begin("a wait for radiosity");
    for (bool busy = true; busy;) {
        busy = false;
        for (size_t i = 0; i < x->lane_count; i++) {
            struct lane *lane = &x->lanes[i];
            if (settled(x, lane) && lane->started < groups) {
                if (lane->own && next != NULL)
                    put_group(x, next, lane->started);
                start_next(x, lane);
            }
            busy = busy || lane->groups.count > 0 || lane->started < groups;
        }
        if (busy)
            (void)sched_yield(); /* another rank that still computes may need the core */
    }
    kiln_waiting_end();
}

/* Expands values from the 4-byte to the 8-byte form, without rounding. */
static void expand(const struct kiln_radiosity_allgather *x, const uint32_t *from, uint64_t *to, uint64_t count)
{
    const double scale = x->scale;
#pragma omp parallel for schedule(static) num_threads((int)x->params.threads) if (count > EXPAND_ALONE)
    for (uint64_t i = 0; i < count; i++) {
        float rgb[3];
        kiln_radiosity_expand(from[i], scale, rgb);
        to[i] = kiln_radiosity_pack(rgb, 0);
    }
}

/* This rank's part of all points that the node has, from `incoming` to `values`. */
static void expand_part(struct kiln_radiosity_allgather *x)
{
    const struct part part = part_of(x);
    if (x->reach == NULL) {
        expand(x, x->incoming + part.begin, x->values + part.begin, part.end - part.begin);
        return;
    }
    const struct kiln_reach *r = x->reach;
    const struct kiln_reach_units units = kiln_reach_units(r, part.begin, part.end - part.begin);
    for (uint64_t u = units.begin; u < units.end; u++) {
        const uint64_t begin = r->first[u] > part.begin ? r->first[u] : part.begin,
                       end = r->first[u + 1] < part.end ? r->first[u + 1] : part.end;
        if (r->states[u] != KILN_REACH_ABSENT)
            expand(x, x->incoming + begin, x->values + begin, end - begin);
    }
}

/* Exchanges the values that nodes have asked for since the groups started. */
static void send_new(struct kiln_radiosity_allgather *x)
{
    if (x->reach == NULL)
        return;
    exchange_now(x, x->incoming, sizeof *x->incoming, NEW);
    replace_states(x, KILN_REACH_NEW, KILN_REACH_WANTED);
}

void kiln_radiosity_allgather_finish(struct kiln_radiosity_allgather *x, const uint32_t *next)
{
    kiln_assert_same(x->params.communicator, x->under_way, "whether radiosity is on its way");
    kiln_assert_same_bytes(x->params.communicator, &x->scale, sizeof x->scale, "the scale of radiosity");
    x->under_way = false;
    if (x->nodes > 1) {
        drive(x, next, x->params.groups);
        send_new(x);
        kiln_node_wait(x->node);
        expand_part(x);
    } else {
        expand(x, next, x->values + x->params.first.at, x->params.count);
    }
    kiln_node_wait(x->node);
}

void kiln_radiosity_allgather_abandon(struct kiln_radiosity_allgather *x)
{
    uint32_t started = 0;
    kiln_assert_same(x->params.communicator, x->under_way, "whether radiosity is on its way");
    if (!x->under_way)
        return;
    x->under_way = false;
    for (size_t i = 0; i < x->lane_count; i++)
        started = x->lanes[i].started > started ? x->lanes[i].started : started;
    (void)MPI_Allreduce(MPI_IN_PLACE, &started, 1, MPI_UINT32_T, MPI_MAX, x->params.communicator);
    drive(x, NULL, started);
}
