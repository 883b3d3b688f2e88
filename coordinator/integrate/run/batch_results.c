#include "coordinator/integrate/run/batch_results.h"

#include <assert.h>
#include <math.h>
#include <time.h>
#include <unistd.h>

const uint32_t *kiln_batch_samples(const struct kiln_batches *b, const struct kiln_rank_data *data)
{
    const struct kiln_field_set *fields = b->params->fields;
    const char *name = b->report->step.samples_field;
    if (name == NULL)
        return NULL;
    const size_t place = kiln_field_set_find(fields, name);
    assert(place < fields->count && fields->entry[place].field->domain == KILN_DOMAIN_TILE_RUN &&
           kiln_field_size(fields->entry[place].field) == sizeof(uint32_t));
    return kiln_rank_field(data, fields, place);
}

double kiln_batch_work(const struct kiln_batches *b, const struct kiln_tile_run *run, const uint32_t *samples)
{
    return samples == NULL ? (double)run->count
                           : (double)run->count * (double)*samples / (double)b->report->step.samples;
}

/* Records a batch's speed. A much higher speed than before is taken over gradually, since a device's first launches are
 * slow. If work is claimed, speed hardly matters, and is taken as measured. */
void kiln_batch_note_rate(struct kiln_batches *b, double work, double seconds)
{
    const double rate = work * (double)b->report->step.samples / fmax(seconds, 1e-6);
    b->rate = b->claims ? rate : fmin(rate, 4.0 * b->rate);
    kiln_work_queue_set_speed(b->solution->own->queue, kiln_batch_speed(b));
}

void kiln_batch_send_done(struct kiln_batches *b, size_t end)
{
    const struct kiln_rank_data *own = b->solution->own;
    const uint64_t points = kiln_step_work_done_before(b->work, own, end);
    if (b->report->step.early && own->surface.tile_run_count > 0)
        kiln_radiosity_allgather_advance(b->solution->allgather, kiln_next_compact(own), points);
}

void kiln_batch_be_slow(const struct kiln_batches *b, double seconds)
{
    const double more = (b->slowness - 1.0) * seconds, whole = floor(more);
    const struct timespec pause = {(time_t)whole, (long)(1e9 * (more - whole))};
    if (more > 0.0)
        (void)nanosleep(&pause, NULL);
}

/* Waits as long as the file named by KILN_HOLD exists. */
static void be_held(const struct kiln_batches *b)
{
    const char *file = b->params->settings->faults.hold;
    const struct timespec pause = {0, 20000000};
    while (file[0] != '\0' && b->pass->reads_radiosity && access(file, F_OK) == 0 &&
           !kiln_stop_asked(kiln_control_stop(b->params->control)))
        (void)nanosleep(&pause, NULL);
}

/* Points of the tile runs from `first` on that were computed, and their work; `samples` as in kiln_take_some. */
static uint64_t points_computed(struct kiln_batches *b, size_t first, size_t count, const uint32_t *samples,
                                double *work)
{
    const struct kiln_tile_run *tile_runs = b->data->surface.tile_runs + first;
    const uint32_t *each = kiln_batch_samples(b, b->data);
    uint64_t points = 0;
    *work = 0.0;
    for (size_t i = 0; i < count; i++)
        if (samples == NULL || samples[i] > 0) {
            points += tile_runs[i].count;
            *work += kiln_batch_work(b, &tile_runs[i], each != NULL ? &each[first + i] : NULL);
        }
    return points;
}

int kiln_batch_take_some(void *context, size_t first, size_t count, const uint32_t *samples, const void *results,
                         struct kiln_error *error)
{
    struct kiln_batches *b = context;
    const struct kiln_rank_data *data = b->data, *own = b->solution->own;
    const struct kiln_tile_run *tile_runs = data->surface.tile_runs + first;
    be_held(b);
    double work;
    const double before = b->since, now = MPI_Wtime(), seconds = b->slowness * (now - before);
    const uint64_t points = points_computed(b, first, count, samples, &work);
    b->since = now;
    const int status = kiln_taker_take(b->taker, data, first, count, samples, results, error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < count; i++)
        if (samples == NULL || samples[i] > 0)
            data->cost[first + i] = (float)(seconds / (double)points * (double)tile_runs[i].count);
    b->points += points;
    b->taken += work;
    if (data != own)
        return KILN_OK;
    if (b->claims) {
        kiln_batch_be_slow(b, now - before);
        b->since = MPI_Wtime();
        kiln_batch_note_rate(b, b->taken, b->since - b->begun);
    }
    b->work->points_done += points;
    kiln_progress_advance(b->params->progress, kiln_step_work_points(b->work, own));
    if (b->report->step.samples_field == NULL) /* otherwise tile runs before `first` may not be finished */
        kiln_batch_send_done(b, first + count);
    return KILN_OK;
}

int kiln_batch_take_part(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    return kiln_batch_take_some(context, first, count, NULL, results, error);
}
