/* The surface points of a node's ranks, and what light transport knows of them, where all ranks of the node see them.
 *
 * A rank owns its share, and its backend computes it; while ranks give work away, another rank may compute a part of
 * it, and then reads the owner's surface and writes the owner's results. For that, the share's arrays are moved to
 * memory of the node (kiln_node_parts). Where nothing is given away, or the node's memory has no room, the arrays stay
 * a rank's own, and it sees no share but its own. */
#ifndef KILN_COORDINATOR_FIELD_RANK_DATA_H
#define KILN_COORDINATOR_FIELD_RANK_DATA_H

#include "coordinator/mpi/work_queue.h"
#include "coordinator/mpi/node_memory.h"
#include "worker/scene/surface.h"

/* What ranges of the global order are counted in. */
enum kiln_domain { KILN_DOMAIN_TILE_RUN, KILN_DOMAIN_POINT, KILN_DOMAIN_PIECE, KILN_DOMAIN_AREA_CDF, KILN_DOMAINS };

/* Shares of all ranks, in each unit: rank r has [of[unit][r], of[unit][r + 1]). */
struct kiln_range_bounds {
    uint64_t *of[KILN_DOMAINS]; /* ranks + 1 each */
};

struct kiln_rank_data {
    struct kiln_surface surface;   /* a view: the map as this rank has it, the own part as the share's owner has it */
    float *direct, *sum;           /* 3 a point, see struct kiln_solution and the integrator */
    uint16_t *error;               /* 1 a point: kiln_error_pack */
    uint64_t *next;                /* 1 a point: packed radiosity of the present step; or see kiln_next_compact */
    float *cost;                   /* 1 a tile run: seconds that it took in the present pass */
    struct kiln_work_queue *queue; /* what of the present pass may be taken */
};

/* The radiosity of a step that makes it in 4 bytes a point: it lies in the first half of `next`. */
static inline uint32_t *kiln_next_compact(const struct kiln_rank_data *data) { return (uint32_t *)data->next; }

struct kiln_node_data;

/* Collective on the node. The surface's own arrays now belong to the shares: with `lend` (the same on the node) they
 * are moved. The results are zero. KILN_SYSTEM for 2^32 tile runs or more. Destroy with kiln_node_data_destroy. */
int kiln_node_data_create(struct kiln_node_data **shares, struct kiln_node_memory *node, struct kiln_surface *surface,
                          bool lend, struct kiln_error *error);
/* Collective on the node. Of a surface whose arrays were moved only the map is left. */
void kiln_node_data_destroy(struct kiln_node_data **shares);
/* Collective on the node. `next` and the queues go; the rest stays. */
void kiln_node_data_end(struct kiln_node_data *shares);

/* Collective. The shares as they are: allocates and fills; release with kiln_range_bounds_destroy. */
int kiln_node_data_bounds(const struct kiln_node_data *shares, MPI_Comm communicator, struct kiln_range_bounds *cuts,
                          struct kiln_error *error);
int kiln_range_bounds_create(struct kiln_range_bounds *cuts, int ranks, struct kiln_error *error);
void kiln_range_bounds_destroy(struct kiln_range_bounds *cuts);

/* Collective on `communicator`, of which the shares' node is a part. Surface, direct, sum and error go over from the
 * shares `before`, those that are, to `after`; next, cost and queue are new. Messages have at most `limit` elements (0:
 * any). Needs as much memory again as the surface or the results meanwhile; where shared memory has no room for that,
 * the node's ranks see only their own shares from then on. After a failure, KILN_SYSTEM on all, nothing is of use but
 * kiln_node_data_destroy. */
int kiln_node_data_redistribute(struct kiln_node_data *shares, MPI_Comm communicator,
                                const struct kiln_range_bounds *before, const struct kiln_range_bounds *after,
                                uint64_t limit, struct kiln_error *error);
/* Bytes that the share takes in a move: of surface and results. */
uint64_t kiln_node_data_bytes(const struct kiln_node_data *shares);

/* How many of the node's ranks have shares that are seen here, and which of them is this rank's own: 1 and 0 where
 * nothing is lent. */
int kiln_node_data_count(const struct kiln_node_data *shares);
int kiln_node_data_own(const struct kiln_node_data *shares);
const struct kiln_rank_data *kiln_rank_data(const struct kiln_node_data *shares, int index);

#endif
