#include "worker/backend/hand_over.h"

int kiln_batch_hand_over(const struct kiln_batch *batch, const struct kiln_surface *surface, size_t bytes, size_t first,
                         size_t count, const void *results, struct kiln_error *error)
{
    const struct kiln_tile_run *tile_runs = surface->tile_runs;
    const size_t end = first + count;
    int status = KILN_OK;
    if (batch->take == NULL)
        return KILN_OK;
    if (batch->take_some != NULL && batch->samples_each != NULL)
        return batch->take_some(batch->context, first, count, batch->samples_each + (first - batch->first), results,
                                error);
    for (size_t f = first, next; f < end && status == KILN_OK; f = next) {
        const char *from = (const char *)results + (tile_runs[f].first.at - tile_runs[first].first.at) * bytes;
        next = kiln_batch_stretch(batch, f, end);
        if (!kiln_batch_leaves_out(batch, f))
            status = batch->take(batch->context, f, next - f, from, error);
    }
    return status;
}
