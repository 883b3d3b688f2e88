#include "coordinator/integrate/patches.h"

#include <limits.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"
#include "worker/pass/shapes.h"
#include "worker/scene/radiosity.h"

struct kiln_patches {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    struct kiln_patch *points; /* of all surface points; NULL: not found yet */
    float (*emission)[3];      /* of all, W/m2; NULL: what emits is sampled */
    struct kiln_patch_node *nodes;
    struct kiln_patches_parameters parameters;
};

int kiln_patches_create(struct kiln_patches **patches, const struct kiln_integrate_params *params,
                        struct kiln_solution *solution, struct kiln_error *error)
{
    struct kiln_patches *p = NULL;
    const int status = kiln_allocate(&p, 1, sizeof *p, "the patches", error);
    if (status == KILN_OK)
        *p = (struct kiln_patches){.params = params, .solution = solution};
    *patches = p;
    return status;
}

void kiln_patches_destroy(struct kiln_patches **patches)
{
    if (*patches == NULL)
        return;
    kiln_free(&(*patches)->points);
    kiln_free(&(*patches)->emission);
    kiln_free(&(*patches)->nodes);
    kiln_free(patches);
}

/* ---- shapes ---- */

/* kiln_take_results */
static int take_shapes(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct kiln_patches *p = context;
    const struct kiln_tile_run *run = &p->params->surface->tile_runs[first];
    const struct kiln_shape_result *shapes = results;
    const uint64_t points = kiln_tile_runs_points(run, run + count - 1);
    for (uint64_t i = 0; i < points; i++) {
        p->points[run->first.at + i] = shapes[i].patch;
        if (p->emission != NULL)
            memcpy(p->emission[run->first.at + i], shapes[i].emission, sizeof shapes[i].emission);
    }
    return KILN_OK;
}

/* Where the points of each rank begin, and how many there are. */
struct shares {
    int *first, *count;
};

static int find_shares(const struct kiln_patches *p, struct shares *shares, struct kiln_error *error)
{
    const struct kiln_integrate_params *params = p->params;
    struct kiln_range_bounds bounds = {{NULL}};
    int status = kiln_node_data_bounds(p->solution->node_data, params->communicator, &bounds, error);
    if (status != KILN_OK)
        return status;
    status = kiln_allocate(&shares->first, (size_t)params->ranks, sizeof *shares->first, "the ranks' patches", error);
    if (status == KILN_OK)
        status =
            kiln_allocate(&shares->count, (size_t)params->ranks, sizeof *shares->count, "the ranks' patches", error);
    for (int i = 0; i < params->ranks && status == KILN_OK; i++) {
        shares->first[i] = (int)bounds.of[KILN_DOMAIN_POINT][i];
        shares->count[i] = (int)(bounds.of[KILN_DOMAIN_POINT][i + 1] - bounds.of[KILN_DOMAIN_POINT][i]);
    }
    kiln_range_bounds_destroy(&bounds);
    return status;
}

/* Collective. Hands each rank's values, of `bytes` a point, to all. */
static void share(const struct kiln_patches *p, const struct shares *shares, void *values, size_t bytes)
{
    MPI_Datatype value;
    (void)MPI_Type_contiguous((int)bytes, MPI_BYTE, &value);
    (void)MPI_Type_commit(&value);
    (void)MPI_Allgatherv(MPI_IN_PLACE, 0, MPI_DATATYPE_NULL, values, shares->count, shares->first, value,
                         p->params->communicator);
    (void)MPI_Type_free(&value);
}

static int make_room(struct kiln_patches *p, struct kiln_error *error)
{
    const uint64_t points = p->params->surface->point_count;
    if (points > INT_MAX)
        return kiln_fail(error, KILN_USAGE, "--method radiosity is for %d surface points at most: give --method cells",
                         INT_MAX);
    int status =
        kiln_allocate(&p->points, (size_t)points, sizeof *p->points, "the patches of all surface points", error);
    if (status == KILN_OK && p->params->settings->emitters)
        status = kiln_allocate(&p->emission, (size_t)points, sizeof *p->emission, "what patches emit", error);
    if (status == KILN_OK)
        status = kiln_allocate(&p->nodes, (size_t)points, sizeof *p->nodes, "the nodes that points gather from", error);
    return status;
}

/* Collective. */
static int find_shapes(struct kiln_patches *p, struct kiln_error *error)
{
    const struct kiln_integrate_params *params = p->params;
    const struct kiln_batch batch = {.count = params->surface->tile_run_count, .take = take_shapes, .context = p};
    struct shares shares = {NULL, NULL};
    uint64_t rays = 0;
    int status = make_room(p, error);
    if (status == KILN_OK)
        status = kiln_backend_run(params->backend, &kiln_pass_shapes, NULL, &batch, &rays, error);
    status = kiln_agree(params->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_agree(params->communicator, find_shares(p, &shares, error), error);
    if (status == KILN_OK)
        share(p, &shares, p->points, sizeof *p->points);
    if (status == KILN_OK && p->emission != NULL)
        share(p, &shares, p->emission, sizeof *p->emission);
    kiln_free(&shares.first);
    kiln_free(&shares.count);
    return status;
}

/* ---- nodes ---- */

/* Each point that sends light is a node. The step before the first bounce gathers what is emitted. */
static void make_nodes(struct kiln_patches *p)
{
    const bool emitted = kiln_solution_step(p->solution)->step.bounce == 0;
    p->parameters.count = 0;
    for (uint64_t i = 0; i < p->params->surface->point_count; i++) {
        if (!(p->points[i].area > 0.0f))
            continue;
        struct kiln_patch_node *node = &p->nodes[p->parameters.count++];
        *node = (struct kiln_patch_node){.patch = p->points[i], .point = i};
        if (emitted)
            memcpy(node->radiosity, p->emission[i], sizeof node->radiosity);
        else
            kiln_radiosity_unpack(p->solution->radiosity[i], node->radiosity);
    }
}

int kiln_patches_update(struct kiln_patches *p, struct kiln_error *error)
{
    const int status = p->points == NULL ? find_shapes(p, error) : KILN_OK;
    if (status != KILN_OK)
        return status;
    p->parameters = (struct kiln_patches_parameters){.points = p->points, .nodes = p->nodes};
    make_nodes(p);
    kiln_solution_step(p->solution)->step.parameters = &p->parameters;
    return KILN_OK;
}
