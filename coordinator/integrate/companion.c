#include "coordinator/integrate/companion.h"

#include "worker/base/memory.h"

const struct kiln_companion *kiln_companion_answering(const struct kiln_companion *const *table,
                                                      const struct kiln_step *step)
{
    for (size_t i = 0; table != NULL && table[i] != NULL; i++)
        if (table[i]->answer != NULL && kiln_companion_is_with(table, i, step))
            return table[i];
    return NULL;
}

bool kiln_companions_select(const struct kiln_companion *const *table, const struct kiln_step *step)
{
    for (size_t i = 0; table != NULL && table[i] != NULL; i++)
        if (table[i]->select != NULL && kiln_companion_is_with(table, i, step))
            return true;
    return false;
}

int kiln_companions_find(const struct kiln_companion *const *table, const struct kiln_integrate_params *params,
                         const struct kiln_rank_data *data, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; table != NULL && table[i] != NULL && status == KILN_OK; i++)
        if (table[i]->find != NULL && table[i]->wanted(params))
            status = table[i]->find(params, data, error);
    return status;
}

bool kiln_companions_are_sane(const struct kiln_companion *const *table, const struct kiln_step_report *report)
{
    bool sane = true;
    for (size_t i = 0; table != NULL && table[i] != NULL; i++)
        sane = sane && (table[i]->is_sane == NULL || table[i]->is_sane(report));
    return sane;
}

double kiln_companions_share(const struct kiln_companion *const *table, const struct kiln_step *step)
{
    double share = 1.0;
    for (size_t i = 0; table != NULL && table[i] != NULL; i++)
        if (table[i]->share != NULL && kiln_companion_is_with(table, i, step))
            share *= table[i]->share(step);
    return share;
}

struct kiln_companion_bytes kiln_companions_demand(const struct kiln_companion *const *table,
                                                   const struct kiln_companion_demand *demand)
{
    struct kiln_companion_bytes bytes = {0};
    for (size_t i = 0; table != NULL && table[i] != NULL; i++)
        if (table[i]->demand != NULL)
            table[i]->demand(demand, &bytes);
    return bytes;
}

struct kiln_selection kiln_companions_selection(const struct kiln_companion *const *table,
                                                const struct kiln_integrate_settings *settings,
                                                const struct kiln_step *step, const struct kiln_rank_data *data,
                                                size_t tile_run)
{
    struct kiln_selection selection = {.computed = UINT64_MAX};
    for (size_t i = 0; table != NULL && table[i] != NULL && selection.computed != 0; i++)
        if (table[i]->select != NULL && kiln_companion_is_with(table, i, step))
            table[i]->select(settings, step, data, tile_run, &selection);
    return selection;
}

int kiln_companions_choose(const struct kiln_companion *const *table, const struct kiln_integrate_settings *settings,
                           const struct kiln_step *step, const struct kiln_rank_data *data, struct kiln_batch *batch,
                           struct kiln_selection **selections, size_t *room, struct kiln_error *error)
{
    int status = KILN_OK;
    if (!kiln_companions_select(table, step))
        return KILN_OK;
    KILN_TRY(kiln_grow(selections, room, batch->count, sizeof **selections, "the points of a batch", error));
    for (size_t i = 0; i < batch->count; i++)
        (*selections)[i] = kiln_companions_selection(table, settings, step, data, batch->first + i);
    batch->selections = *selections;
end:
    return status;
}
