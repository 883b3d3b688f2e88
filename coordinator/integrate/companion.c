#include "coordinator/integrate/companion.h"

#include <math.h>
#include <string.h>

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

void kiln_companions_count(const struct kiln_companion *const *table, const struct kiln_solution *solution,
                           uint64_t *counts)
{
    for (size_t i = 0; table[i] != NULL; i++)
        if (table[i]->count != NULL)
            table[i]->count(solution, counts + i * KILN_COMPANION_COUNTS);
}

void kiln_companions_report(const struct kiln_companion *const *table, enum kiln_report_place place,
                            const struct kiln_companion_told *told, const uint64_t *counts, json_t *json)
{
    for (size_t i = 0; table[i] != NULL; i++) {
        struct kiln_companion_told own = *told;
        own.counts = counts != NULL ? counts + i * KILN_COMPANION_COUNTS : NULL;
        if (table[i]->report[place] != NULL)
            table[i]->report[place](&own, json);
    }
}

int kiln_companions_measure(const struct kiln_companion *const *table, const struct kiln_companion_sample *sample,
                            struct kiln_companion_measured *measured, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; table[i] != NULL; i++)
        measured[i] = (struct kiln_companion_measured){.seconds = 0.0};
    for (size_t i = 0; table[i] != NULL && status == KILN_OK; i++)
        if (table[i]->measure != NULL && table[i]->wanted(sample->params))
            status = table[i]->measure(sample, &measured[i], error);
    return status;
}

void kiln_companions_forget(const struct kiln_companion *const *table, struct kiln_companion_measured *measured)
{
    for (size_t i = 0; table[i] != NULL; i++) {
        json_decref(measured[i].json);
        measured[i].json = NULL;
        kiln_free(&measured[i].own);
    }
}

void kiln_companions_tell_measured(const struct kiln_companion *const *table,
                                   const struct kiln_companion_measured *measured, json_t *json)
{
    for (size_t i = 0; table[i] != NULL; i++)
        if (measured[i].json != NULL)
            (void)json_object_set(json, table[i]->name, measured[i].json);
}

double kiln_companions_seconds(const struct kiln_companion *const *table,
                               const struct kiln_companion_measured *measured, const struct kiln_step *step)
{
    double seconds = 0.0;
    for (size_t i = 0; table[i] != NULL; i++)
        if (table[i]->answer != NULL && kiln_companion_is_with(table, i, step))
            seconds += measured[i].seconds;
    return seconds;
}

double kiln_companions_dark(const struct kiln_companion *const *table, const struct kiln_companion_measured *measured,
                            const char *field)
{
    double share = 0.0;
    for (size_t i = 0; table[i] != NULL; i++)
        for (size_t k = 0; measured[i].dark != NULL && measured[i].dark[k] != NULL; k++)
            if (strcmp(measured[i].dark[k], field) == 0)
                share = fmax(share, measured[i].dark_share);
    return share;
}

struct kiln_companion_bytes kiln_companions_demand(const struct kiln_companion *const *table,
                                                   const struct kiln_companion_measured *measured,
                                                   const struct kiln_companion_demand *demand)
{
    struct kiln_companion_bytes bytes = {0};
    for (size_t i = 0; table[i] != NULL; i++) {
        struct kiln_companion_demand own = *demand;
        own.measured = &measured[i];
        if (table[i]->demand != NULL)
            table[i]->demand(&own, &bytes);
    }
    return bytes;
}

uint64_t kiln_companions_files(const struct kiln_companion *const *table, const struct kiln_companion_kept *kept,
                               const struct kiln_step *step)
{
    uint64_t bytes = 0;
    for (size_t i = 0; table[i] != NULL; i++)
        if (table[i]->files != NULL)
            bytes += table[i]->files(kept, step);
    return bytes;
}

uint64_t kiln_companions_saved_bytes(const struct kiln_companion *const *table,
                                     const struct kiln_integrate_params *params)
{
    uint64_t bytes = 0;
    for (size_t i = 0; table[i] != NULL; i++)
        if (table[i]->saved_bytes != NULL && table[i]->wanted(params))
            bytes += table[i]->saved_bytes(params->settings);
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
