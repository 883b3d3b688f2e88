/* The data of a node's ranks: their surface points and the results of light transport for them, in memory that all
 * ranks of the node share.
 *
 * Each rank owns a contiguous range of the global order of surface points, which its backend computes. With work
 * stealing another rank of the node may compute a part of them; it then reads the owner's surface and writes the
 * owner's results. For that, the owner's arrays are moved into memory of the node (kiln_rank_regions). Without work
 * stealing, or if the node's memory has no room, the arrays stay private to the rank, and it sees no other rank's.
 *
 * The bake's field set (field.h) determines the arrays: memory, layout and redistribution iterate over it. */
#ifndef KILN_COORDINATOR_FIELD_RANK_DATA_H
#define KILN_COORDINATOR_FIELD_RANK_DATA_H

#include "coordinator/field/field.h"
#include "coordinator/mpi/work_queue.h"
#include "coordinator/mpi/node_memory.h"
#include "worker/scene/surface.h"

/* Beginnings of the ranges of all ranks, in each domain: rank r has the items [of[domain][r], of[domain][r + 1]). */
struct kiln_range_bounds {
    uint64_t *of[KILN_DOMAINS]; /* ranks + 1 each */
};

/* The arrays of one rank. Arrays that code uses by name have a member; kiln_rank_field finds all. */
struct kiln_rank_data {
    struct kiln_surface surface; /* a view: the map is this rank's, the arrays of own points are the owner's */
    float *direct, *sum;         /* 3 a point, see struct kiln_solution and the integrator */
    float *caustic;              /* 3 a point: light by way of mirrors, gloss and glass; NULL: there is none */
    /* 3 a point: radiosity of the diffuse part of the surface; glossy surfaces reflect less than albedo x irradiance
     * diffusely. NULL: it is albedo x irradiance */
    float *radiosity;
    uint16_t *error;                         /* 1 a point: kiln_error_pack */
    uint16_t *error_direct, *error_indirect; /* errors of direct and indirect light, likewise; NULL: not wanted */
    uint16_t *error_caustic;                 /* likewise */
    float *indirect,
        *parts; /* 3 and KILN_PARTS a point, of a bake in parts (integrate/parts/parts.h); NULL: not in parts */
    /* KILN_PARTS a point: packed total radiosity as part k of each round found it; NULL: rounds start at the lamps */
    uint64_t *parts_radiosity;
    /* KILN_PARTS a point: luminance and packed radiosity of the caustics that part k of each round found
     * (integrate/parts/part_caustics.h); NULL: rounds start at the lamps, or there are none */
    float *parts_caustic;
    uint64_t *parts_caustic_radiosity;
    uint64_t *next;   /* 1 a point: packed radiosity of the present step; or see kiln_next_compact */
    uint64_t *source; /* 1 a point: packed radiosity that is gathered from; NULL: not known yet */
    /* 1 a tile run: samples of each of its points, in a step with adaptive samples; NULL: the bake has no such steps */
    uint32_t *samples;
    uint32_t *samples_bounce; /* likewise, samples of late bounces; NULL: their number is given */
    uint32_t *samples_direct; /* likewise, samples of direct light, in a bake with a target error */
    /* likewise, samples of the final gather that each part number has had before the round; NULL: rounds have no error
     * of published light */
    uint32_t *samples_taken;
    uint16_t *seen;    /* 1 a tile run: 0 if no view sees it (kiln_integrate_params); NULL: all are seen */
    uint16_t *block;   /* 1 a point: integrate/sparse/blocks.h; NULL: there are no blocks */
    uint16_t *node;    /* 1 a point: texels a side of its node (integrate/patches/patches.h); NULL: nobody asks */
    uint64_t *mixture; /* 1 a point: integrate/sparse/nodes.h; NULL: each point does its own final gather */
    float *cost;       /* 1 a tile run: seconds that it took in the present step */
    /* 1 a tile run, in the present step: 1 if its rays met a point whose radiosity is absent, so that its results were
     * rejected; NULL: all radiosity is there */
    uint32_t *lacking;
    struct kiln_work_queue *queue; /* the owner's work of the present step that may be stolen */
    void *more[KILN_FIELDS_MAX];   /* fields without a member, at their places in the set */
};

/* Radiosity of a step that makes it in 4 bytes a point; it is stored in the first half of `next`. */
static inline uint32_t *kiln_next_compact(const struct kiln_rank_data *data) { return (uint32_t *)data->next; }

struct kiln_node_data;

/* Allocates, and frees, a zeroed array for the set's field at index `index` in the field's member of `data`, whose
 * surface is set. For data that belong to no node. KILN_SYSTEM. */
int kiln_rank_data_add(struct kiln_rank_data *data, const struct kiln_field_set *fields, size_t index,
                       struct kiln_error *error);
void kiln_rank_data_remove(struct kiln_rank_data *data, const struct kiln_field_set *fields, size_t index);

/* Sets the pointers of `surface` (the rank's own) through which backends read fields to the arrays of `own`, which may
 * have moved. */
void kiln_rank_data_lend(const struct kiln_rank_data *own, struct kiln_surface *surface);

/* Collective on the node. The node data take over the surface's arrays of own points; with `lend` (the same on the
 * whole node) the arrays are moved into memory of the node. `fields` is copied. Results are zero. KILN_SYSTEM for 2^32
 * tile runs or more. Destroy with kiln_node_data_destroy. */
int kiln_node_data_create(struct kiln_node_data **node_data, struct kiln_node_memory *node,
                          struct kiln_surface *surface, const struct kiln_field_set *fields, bool lend,
                          struct kiln_error *error);
/* Collective on the node. If the arrays of a surface were moved, only its map remains. */
void kiln_node_data_destroy(struct kiln_node_data **node_data);
/* Collective on the node. Frees the scratch fields of steps; the others stay. */
void kiln_node_data_end(struct kiln_node_data *node_data);
/* Sets the radiosity of all points (radiosity_allgather.h), borrowed. The field `source` is its own part. */
void kiln_node_data_set_radiosity(struct kiln_node_data *node_data, uint64_t *radiosity);

/* Collective. Allocates and fills in the present ranges of all ranks; release with kiln_range_bounds_destroy. */
int kiln_node_data_bounds(const struct kiln_node_data *node_data, MPI_Comm communicator,
                          struct kiln_range_bounds *bounds, struct kiln_error *error);
int kiln_range_bounds_create(struct kiln_range_bounds *bounds, int ranks, struct kiln_error *error);
void kiln_range_bounds_destroy(struct kiln_range_bounds *bounds);

/* Collective on `communicator`, which contains the node. Moves surface and results from the ranges `before`, the
 * present ones, to `after`; the fields of a step are made anew, zero. Messages have at most `limit` elements (0: any).
 * Meanwhile the surface or the results need twice their memory; if shared memory has no room for that, each rank of the
 * node sees only its own data from then on. After a failure, KILN_SYSTEM on all ranks, only kiln_node_data_destroy may
 * be called. */
int kiln_node_data_redistribute(struct kiln_node_data *node_data, MPI_Comm communicator,
                                const struct kiln_range_bounds *before, const struct kiln_range_bounds *after,
                                uint64_t limit, struct kiln_error *error);
/* Bytes of this rank's surface and results, which a redistribution moves. */
uint64_t kiln_node_data_bytes(const struct kiln_node_data *node_data);

/* Number of ranks of the node whose data this rank sees, and its index among them: 1 and 0 without lending. */
int kiln_node_data_count(const struct kiln_node_data *node_data);
int kiln_node_data_own(const struct kiln_node_data *node_data);
const struct kiln_rank_data *kiln_rank_data(const struct kiln_node_data *node_data, int index);
const struct kiln_field_set *kiln_node_data_fields(const struct kiln_node_data *node_data);

/* The array of the set's field at place `index`; NULL for KILN_FIELD_SUM. */
void *kiln_rank_field(const struct kiln_rank_data *data, const struct kiln_field_set *fields, size_t index);
/* Gets an own point's components as published: kiln_field_floats, or for KILN_FIELD_SUM the sum of its terms. */
void kiln_rank_floats(const struct kiln_rank_data *data, const struct kiln_field_set *fields, size_t index,
                      struct kiln_own_point own, float floats[KILN_FIELD_COMPONENTS_MAX]);
/* Gets the components of up to KILN_TILE_TEXELS consecutive own points, one point after the other. */
void kiln_rank_float_run(const struct kiln_rank_data *data, const struct kiln_field_set *fields, size_t index,
                         struct kiln_own_point first, uint32_t points, float *floats);

#endif
