#include "coordinator/output/map/write/writer.h"

#include "coordinator/mpi/agree.h"
#include "coordinator/output/map/seams/joined.h"
#include "worker/base/memory.h"

/* Begins the map of an object that touches others, and adds it to the joined system. The map is kept only if all maps
 * fit in one round; otherwise it is made again when its file is written. */
static int join_object(const struct kiln_writer *w, uint32_t object, struct kiln_error *error)
{
    if (!w->works[object].in_bands && kiln_stop_asked(w->result->stop))
        return kiln_give_up(error);
    const struct kiln_map_work *work = &w->works[object];
    int status = kiln_writer_begin(w, object, error);
    if (status == KILN_OK)
        status = kiln_joined_add(w->joined, object, work->map, work->graph, work->nearest, error);
    if (!w->keeps)
        kiln_writer_drop(w, object);
    return status;
}

/* Callback of kiln_writer_walk_rounds. Collective. */
static int join_together(struct kiln_writer *w, const struct kiln_assignment *assignment, uint32_t round, uint32_t *own,
                         size_t count, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; round >= assignment->own_rounds && i < count && status == KILN_OK; i++) {
        status = kiln_stop_asked(w->result->stop) ? kiln_give_up(error) : KILN_OK;
        if ((status = kiln_agree(w->result->communicator, status, error)) == KILN_OK)
            status = join_object(w, own[i], error);
    }
    if (round >= assignment->own_rounds)
        return status;
    return kiln_agree(w->result->communicator, kiln_writer_run_some(w, own, count, join_object, error), error);
}

int kiln_writer_choose(struct kiln_assignment *chosen, const struct kiln_assignment *all,
                       const struct kiln_joints *joints, bool joined, struct kiln_error *error)
{
    *chosen = *all;
    const int status =
        kiln_allocate(&chosen->owner, all->count, sizeof *chosen->owner, "the assignment of lightmaps", error);
    for (size_t i = 0; status == KILN_OK && i < all->count; i++)
        chosen->owner[i] = (joints->group[i] != KILN_NONE) == joined ? all->owner[i] : KILN_NONE;
    return status;
}

int kiln_writer_join(struct kiln_writer *w, const struct kiln_assignment *assignment, const struct kiln_joints *joints,
                     struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    const struct kiln_joined_params params = {.communicator = comm,
                                              .joints = joints,
                                              .lightmaps = w->result->surface->lightmaps,
                                              .assignment = assignment,
                                              .planes = &w->layers.planes};
    struct kiln_assignment touching = {0};
    int status = kiln_writer_choose(&touching, assignment, joints, true, error);
    if (status == KILN_OK)
        status = kiln_joined_create(&w->joined, &params, error);
    status = kiln_agree(comm, status, error);
    if (status == KILN_OK)
        status = kiln_writer_walk_rounds(w, &touching, &touching, w->ghosts, join_together, error);
    if (status == KILN_OK)
        status = kiln_joined_solve(w->joined, error);
    for (size_t i = 0; status == KILN_OK && i < joints->map_count; i++)
        w->works[i].joined = joints->group[i] != KILN_NONE ? w->joined : NULL;
    kiln_free(&touching.owner);
    return status;
}
