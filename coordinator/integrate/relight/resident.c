#include "coordinator/integrate/relight/resident.h"

#include <time.h>

#include "coordinator/integrate/relight/transport.h"
#include "coordinator/integrate/run/batches.h"
#include "worker/backend/extended.h"
#include "worker/base/memory.h"

/* One step, and the rows of its rays. */
struct kept_step {
    struct kiln_step step;
    struct kiln_rows rows;
    struct kiln_resident_rows memory;
};

struct kiln_resident {
    const struct kiln_integrate_params *params;
    struct kept_step **steps;
    size_t count, room;
    uint64_t read, traced;
    double seconds, processor;
    uint8_t *missing; /* of each own tile run */
};

int kiln_resident_create(struct kiln_resident **resident, const struct kiln_integrate_params *params,
                         struct kiln_error *error)
{
    struct kiln_resident *r = NULL;
    int status = kiln_allocate(&r, 1, sizeof *r, "the kept transport", error);
    *resident = r;
    if (status != KILN_OK)
        return status;
    r->params = params;
    status = kiln_allocate(&r->missing, params->surface->tile_run_count, 1, "the kept transport", error);
    if (status != KILN_OK)
        kiln_resident_destroy(resident);
    return status;
}

void kiln_resident_destroy(struct kiln_resident **resident)
{
    struct kiln_resident *r = *resident;
    if (r == NULL)
        return;
    for (size_t i = 0; i < r->count; i++) {
        kiln_resident_rows_release(&r->steps[i]->memory);
        kiln_free(&r->steps[i]);
    }
    kiln_free(&r->steps);
    kiln_free(&r->missing);
    kiln_free(resident);
}

/* Whether two steps have the same rays: all parameters that rays or the omission of points depend on are equal. */
static bool same_rays(const struct kiln_step *a, const struct kiln_step *b)
{
    return a->stream == b->stream && a->samples == b->samples && a->first_sample == b->first_sample &&
           a->with == b->with && a->part == b->part && a->bounce == b->bounce;
}

static int add_step(struct kiln_resident *r, const struct kiln_step *step, struct kept_step **kept,
                    struct kiln_error *error)
{
    const struct kiln_integrate_params *p = r->params;
    int status = kiln_grow(&r->steps, &r->room, r->count + 1, sizeof(struct kept_step *), "the kept transport", error);
    if (status == KILN_OK)
        status = kiln_allocate(kept, 1, sizeof **kept, "the kept transport", error);
    if (status != KILN_OK)
        return status;
    r->steps[r->count++] = *kept;
    (*kept)->step = *step;
    status = kiln_resident_rows_create(&(*kept)->memory, p->surface, p->backend->params.scene, step->samples, error);
    if (status == KILN_OK)
        status = kiln_transport_load(p->transport, step, &(*kept)->memory, &(*kept)->rows, error);
    (*kept)->rows.resident = &(*kept)->memory;
    return status;
}

/* Context of kiln_take_results for rays whose rows were missing: the step and the surface. */
struct filling {
    const struct kiln_surface *surface;
    struct kept_step *kept;
};

static int take(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    const struct filling *f = context;
    const struct kiln_point_result *of = results;
    (void)error;
    for (size_t i = first; i < first + count; i++) {
        kiln_resident_take(&f->kept->memory, f->surface, i, of);
        of += f->surface->tile_runs[i].count;
    }
    return KILN_OK;
}

/* Runs the backend over consecutive tile runs without rows. */
static int fill_stretch(const struct kiln_resident *r, const struct kiln_solution *solution, struct kept_step *kept,
                        size_t first, size_t count, struct kiln_error *error)
{
    struct kiln_step_report report = {.step = kept->step};
    struct kiln_batches batches = {.params = r->params, .report = &report};
    struct filling filling = {&solution->own->surface, kept};
    struct kiln_batch batch = {.first = first,
                               .count = count,
                               .stream = kept->step.stream,
                               .samples = kept->step.samples,
                               .first_sample = kept->step.first_sample,
                               .take = take,
                               .context = &filling};
    uint64_t rays = 0;
    int status = kiln_batches_choose(&batches, solution->own, &batch, error);
    if (status == KILN_OK)
        status = kiln_backend_run(r->params->backend, kept->step.pass, NULL, &batch, &rays, error);
    kiln_batches_release(&batches);
    return status;
}

static int fill(struct kiln_resident *r, const struct kiln_solution *solution, struct kept_step *kept,
                struct kiln_error *error)
{
    const size_t count = solution->own->surface.tile_run_count;
    int status = KILN_OK;
    if (count > 0)
        status = kiln_backend_set_radiosity(r->params->backend, solution->radiosity, error);
    kept->rows.found = kept->rows.traced = kept->rows.kept = 0;
    kiln_backend_set_rows(r->params->backend, &kept->rows);
    for (size_t f = 0, next; f < count && status == KILN_OK; f = next) {
        for (next = f + 1; next < count && r->missing[next] == r->missing[f]; next++)
            ;
        if (r->missing[f] != 0)
            status = fill_stretch(r, solution, kept, f, next - f, error);
    }
    kiln_backend_set_rows(r->params->backend, NULL);
    r->read += kept->rows.found;
    r->traced += kept->rows.traced;
    return status;
}

int kiln_resident_step(struct kiln_resident *r, const struct kiln_solution *solution, const struct kiln_step *step,
                       const uint8_t *wanted, const struct kiln_resident_rows **rows, struct kiln_error *error)
{
    const double begin = MPI_Wtime();
    const clock_t used = clock();
    struct kiln_backend_info before, after; /* of what is made once others hear by themselves */
    struct kept_step *kept = NULL;
    int status = KILN_OK;
    bool any = false;
    kiln_backend_info(r->params->backend, &before);
    for (size_t i = 0; i < r->count && kept == NULL; i++)
        kept = same_rays(&r->steps[i]->step, step) ? r->steps[i] : NULL;
    if (kept == NULL)
        status = add_step(r, step, &kept, error);
    if (status != KILN_OK)
        return status;
    *rows = &kept->memory;
    for (size_t f = 0; f < solution->own->surface.tile_run_count; f++) {
        r->missing[f] = wanted[f] != 0 && kept->memory.ready[f] == 0;
        any = any || r->missing[f] != 0;
    }
    if (any)
        status = fill(r, solution, kept, error);
    kiln_backend_info(r->params->backend, &after);
    r->seconds += MPI_Wtime() - begin - (after.once_seconds - before.once_seconds);
    r->processor += (double)(clock() - used) / CLOCKS_PER_SEC - (after.once_processor - before.once_processor);
    return status;
}

struct kiln_rows *kiln_resident_for_backend(struct kiln_resident *r, const struct kiln_resident_rows *rows)
{
    struct kiln_rows *found = NULL;
    for (size_t i = 0; i < r->count && found == NULL; i++)
        found = &r->steps[i]->memory == rows ? &r->steps[i]->rows : NULL;
    return found;
}

struct kiln_resident_counts kiln_resident_counts(const struct kiln_resident *r)
{
    struct kiln_resident_counts counts = {r->read, r->traced, 0, r->seconds, r->processor};
    for (size_t i = 0; i < r->count; i++)
        counts.bytes += kiln_resident_rows_bytes(&r->steps[i]->memory, r->params->surface->tile_run_count);
    return counts;
}
