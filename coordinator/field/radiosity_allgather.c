#include "coordinator/field/radiosity_allgather.h"

#include <limits.h>
#include <sched.h>
#include <string.h>

#include "coordinator/mpi/waiting.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/assert_same.h"
#include "worker/scene/radiosity.h"

enum { GROUPS_MOST = 8, GROUP_POINTS = 512 };

/* Ranks of different nodes that exchange with each other, one of each. */
struct lane {
    MPI_Comm communicator;
    int members;
    bool own;         /* this rank's own values go here; else it only receives for its node */
    uint64_t *ranges; /* of each member: first, count; 0 values where it only receives */
    int *counts, *places;
    uint32_t started; /* groups of this bounce */
    double since;     /* when the last one was */
    uint64_t bytes;   /* of it, to receive */
    MPI_Request *requests;
    size_t request_count, request_room;
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
    uint64_t received;
    double scale;
    bool under_way;
};

uint64_t *kiln_radiosity_allgather_values(const struct kiln_radiosity_allgather *allgather)
{
    return allgather->values;
}
uint64_t kiln_radiosity_allgather_received(const struct kiln_radiosity_allgather *allgather)
{
    return allgather->received;
}

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
        kiln_node_block(x->node, &x->values, x->params.total, sizeof *x->values, "the radiosity of all points", error);
    if (status == KILN_OK && x->nodes > 1)
        status = kiln_node_block(x->node, &x->incoming, x->params.total, sizeof *x->incoming,
                                 "the radiosity on its way", error);
    return status;
}

/* Collective. All ranks share with their nodes, or none does: the lanes depend on it. */
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
    int status = kiln_allocate(&lane->ranges, 2 * members, sizeof *lane->ranges, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&lane->counts, members, sizeof *lane->counts, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&lane->places, members, sizeof *lane->places, what, error);
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
        /* ranks of other lanes too: the next split is everybody's */
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
        kiln_free(&x->lanes[i].requests);
    }
    kiln_free(&x->lanes);
    kiln_node_destroy(&x->private_node);
    kiln_free(allgather);
}

void kiln_radiosity_allgather_set_range(struct kiln_radiosity_allgather *x, struct kiln_global_point first,
                                        uint64_t count)
{
    kiln_assert_ranges(x->params.communicator, first.at, count, x->params.total, "the ranks' new points");
    x->params.first = first;
    x->params.count = count;
    for (size_t i = 0; i < x->lane_count; i++)
        learn_ranges(x, &x->lanes[i]);
}

/* ---- a group ---- */

/* Own points from the first on that come before group `group` of `groups`; the same arithmetic on all ranks. */
static uint64_t group_begin(uint64_t count, uint32_t group, uint32_t groups)
{
    return count / groups * group + count % groups * group / groups;
}

static MPI_Request *new_request(struct lane *lane)
{
    struct kiln_error error;
    if (kiln_grow(&lane->requests, &lane->request_room, lane->request_count + 1, sizeof *lane->requests,
                  "messages between nodes", &error) != KILN_OK)
        kiln_end_all_ranks(KILN_SYSTEM, &error); /* others wait for it already */
    return &lane->requests[lane->request_count++];
}

/* Beyond what int holds: one member's part after the other, in pieces. */
static void start_pieces(const struct kiln_radiosity_allgather *x, struct lane *lane, void *all, size_t size,
                         MPI_Datatype type, uint32_t group, uint32_t groups)
{
    for (int m = 0; m < lane->members; m++) {
        const uint64_t first = lane->ranges[2 * m], count = lane->ranges[2 * m + 1];
        const uint64_t end = group_begin(count, group + 1, groups);
        for (uint64_t at = group_begin(count, group, groups); at < end;) {
            const uint64_t piece = end - at < x->params.limit ? end - at : x->params.limit;
            (void)MPI_Ibcast((char *)all + (first + at) * size, (int)piece, type, m, lane->communicator,
                             new_request(lane));
            at += piece;
        }
    }
}

/* Begins to send and receive a group of all members. */
static void start_group(struct kiln_radiosity_allgather *x, struct lane *lane, void *all, size_t size, uint32_t group,
                        uint32_t groups)
{
    const MPI_Datatype type = size == sizeof(uint64_t) ? MPI_UINT64_T : MPI_UINT32_T;
    uint64_t sum = 0;
    for (int m = 0; m < lane->members; m++)
        sum += group_begin(lane->ranges[2 * m + 1], group + 1, groups) -
               group_begin(lane->ranges[2 * m + 1], group, groups);
    const uint64_t own = group_begin(x->params.count, group + 1, groups) - group_begin(x->params.count, group, groups);
    lane->since = MPI_Wtime();
    lane->bytes = (sum - (lane->own ? own : 0)) * size;
    x->received += lane->bytes;
    if (x->params.total > x->params.limit) {
        start_pieces(x, lane, all, size, type, group, groups);
        return;
    }
    MPI_Request *request = new_request(lane);
    /* read when the call begins, and until it ends by some libraries: see finish */
    for (int m = 0; m < lane->members; m++) {
        const uint64_t count = lane->ranges[2 * m + 1], begin = group_begin(count, group, groups);
        lane->places[m] = (int)(lane->ranges[2 * m] + begin);
        lane->counts[m] = (int)(group_begin(count, group + 1, groups) - begin);
    }
    (void)MPI_Iallgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, all, lane->counts, lane->places, type, lane->communicator,
                          request);
}

/* Whether all that was started is over. Never waits. */
static bool settled(const struct kiln_radiosity_allgather *x, struct lane *lane)
{
    int complete = 1;
    if (lane->request_count == 0)
        return true;
    (void)MPI_Testall((int)lane->request_count, lane->requests, &complete, MPI_STATUSES_IGNORE);
    if (complete != 0) {
        kiln_trace_add(x->params.trace, KILN_TRACE_TRAVEL, "group of points", lane->since, MPI_Wtime(),
                       (int64_t)lane->bytes);
        lane->request_count = 0;
    }
    return complete != 0;
}

static void wait_for(struct lane *lane)
{
    (void)MPI_Waitall((int)lane->request_count, lane->requests, MPI_STATUSES_IGNORE);
    lane->request_count = 0;
}

void kiln_radiosity_allgather_all(struct kiln_radiosity_allgather *x)
{
    for (size_t i = 0; i < x->lane_count; i++)
        start_group(x, &x->lanes[i], x->values, sizeof *x->values, 0, 1);
    for (size_t i = 0; i < x->lane_count; i++)
        wait_for(&x->lanes[i]);
    kiln_node_wait(x->node);
}

/* ---- a bounce ---- */

void kiln_radiosity_allgather_begin(struct kiln_radiosity_allgather *x)
{
    x->under_way = true;
    for (size_t i = 0; i < x->lane_count; i++)
        x->lanes[i].started = 0;
}

/* Puts the own values of a group where they are sent from. */
static void put_group(struct kiln_radiosity_allgather *x, const uint32_t *next, uint32_t group)
{
    const uint64_t begin = group_begin(x->params.count, group, x->params.groups),
                   end = group_begin(x->params.count, group + 1, x->params.groups);
    memcpy(x->incoming + x->params.first.at + begin, next + begin, (end - begin) * sizeof *next);
}

/* Starts the next group of a lane, when its values are there and the one before is through: the counts of a call are
 * its own until then. */
static void advance_lane(struct kiln_radiosity_allgather *x, struct lane *lane, const uint32_t *next, uint64_t done)
{
    const uint32_t groups = x->params.groups;
    while (settled(x, lane) && lane->started < groups) {
        const uint32_t group = lane->started;
        if (lane->own && done < group_begin(x->params.count, group + 1, groups))
            return;
        if (lane->own)
            put_group(x, next, group);
        lane->started++;
        start_group(x, lane, x->incoming, sizeof *x->incoming, group, groups);
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
                start_group(x, lane, x->incoming, sizeof *x->incoming, lane->started++, x->params.groups);
            }
            busy = busy || lane->request_count > 0 || lane->started < groups;
        }
        if (busy)
            (void)sched_yield(); /* a rank that is not done may want the core */
    }
    kiln_waiting_end();
}

/* From 4 bytes to 8; none of them is rounded. */
static void expand(const struct kiln_radiosity_allgather *x, const uint32_t *from, uint64_t *to, uint64_t count)
{
    const double scale = x->scale;
#pragma omp parallel for schedule(static) num_threads((int)x->params.threads)
    for (uint64_t i = 0; i < count; i++) {
        float rgb[3];
        kiln_radiosity_expand(from[i], scale, rgb);
        to[i] = kiln_radiosity_pack(rgb, 0);
    }
}

/* This rank's part of all points, from `incoming` to `values`. */
static void expand_part(struct kiln_radiosity_allgather *x)
{
    const uint64_t ranks = (uint64_t)kiln_node_ranks(x->node), rank = (uint64_t)kiln_node_rank(x->node),
                   total = x->params.total;
    const uint64_t begin = total / ranks * rank + total % ranks * rank / ranks;
    const uint64_t end = total / ranks * (rank + 1) + total % ranks * (rank + 1) / ranks;
    expand(x, x->incoming + begin, x->values + begin, end - begin);
}

void kiln_radiosity_allgather_finish(struct kiln_radiosity_allgather *x, const uint32_t *next)
{
    kiln_assert_same(x->params.communicator, x->under_way, "whether radiosity is on its way");
    kiln_assert_same_bytes(x->params.communicator, &x->scale, sizeof x->scale, "the scale of radiosity");
    x->under_way = false;
    if (x->nodes > 1) {
        drive(x, next, x->params.groups);
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
