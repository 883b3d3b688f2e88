#include "coordinator/integrate/run/step_work.h"

#include <assert.h>

#include "worker/base/memory.h"

int kiln_step_work_begin(struct kiln_step_work *work, size_t tile_runs, struct kiln_error *error)
{
    work->points_done = 0;
    work->measured = true;
    work->todo_first = work->todo_count = 0;
    return kiln_step_work_add(work, 0, tile_runs, error);
}

int kiln_step_work_add(struct kiln_step_work *work, size_t first, size_t end, struct kiln_error *error)
{
    if (first >= end)
        return KILN_OK;
    const int status = kiln_grow(&work->todo, &work->todo_room, work->todo_count + 1, sizeof *work->todo,
                                 "what a step has to do", error);
    if (status == KILN_OK)
        work->todo[work->todo_count++] = (struct kiln_range){first, end - first};
    return status;
}

void kiln_step_work_offer(struct kiln_step_work *work, const struct kiln_rank_data *own)
{
    kiln_work_queue_begin(own->queue);
    work->sent = 0;
    work->has_gaps = false;
    if (work->todo_first < work->todo_count)
        kiln_work_queue_open(own->queue, work->todo[work->todo_first]);
}

void kiln_step_work_settle(struct kiln_step_work *work, const struct kiln_rank_data *own, struct kiln_node_memory *node,
                           int node_ranks)
{
    if (node_ranks > 1)
        kiln_node_wait(node); /* a rank that gets here has returned all work that it took */
    assert(kiln_work_queue_away(own->queue) == 0);
    if (work->todo_first < work->todo_count)
        work->todo[work->todo_first] = kiln_work_queue_left(own->queue);
}

bool kiln_step_work_any(struct kiln_step_work *work, const struct kiln_rank_data *own)
{
    while (work->todo_first < work->todo_count && kiln_work_queue_left(own->queue).count == 0) {
        if (++work->todo_first == work->todo_count)
            break;
        work->has_gaps = work->has_gaps || kiln_work_queue_away(own->queue) > 0;
        kiln_work_queue_open(own->queue, work->todo[work->todo_first]);
    }
    return work->todo_first < work->todo_count;
}

uint64_t kiln_step_work_done_before(struct kiln_step_work *work, const struct kiln_rank_data *own, size_t end)
{
    const struct kiln_surface *surface = &own->surface;
    if (kiln_work_queue_away(own->queue) == 0)
        work->has_gaps = false;
    if (!work->has_gaps && own->lacking == NULL)
        work->sent = end;
    while (!work->has_gaps && work->sent < end && own->lacking[work->sent] == 0)
        work->sent++;
    return work->sent < surface->tile_run_count ? kiln_own_of_global(surface, surface->tile_runs[work->sent].first).at
                                                : surface->count;
}

uint64_t kiln_step_work_points(const struct kiln_step_work *work, const struct kiln_rank_data *own)
{
    return work->points_done + kiln_work_queue_returned(own->queue);
}

void kiln_step_work_release(struct kiln_step_work *work) { kiln_free(&work->todo); }
