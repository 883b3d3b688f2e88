/* Results of batches as they come: handed to who takes them, with the work, speed and cost that they show. Internal to
 * batches.c. No function here is collective. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_BATCH_RESULTS_H
#define KILN_COORDINATOR_INTEGRATE_RUN_BATCH_RESULTS_H

#include "coordinator/integrate/run/batches.h"

/* Returns the samples of each tile run of `data` in the present step; NULL: the same for all. */
const uint32_t *kiln_batch_samples(const struct kiln_batches *batches, const struct kiln_rank_data *data);

/* Returns the work of a tile run: its points, weighted by its samples relative to those of the step. */
double kiln_batch_work(const struct kiln_batches *batches, const struct kiln_tile_run *run, const uint32_t *samples);

/* work a second */
static inline double kiln_batch_speed(const struct kiln_batches *b)
{
    return b->rate / (double)b->report->step.samples;
}

/* Records the speed of a batch. `seconds`: it took. */
void kiln_batch_note_rate(struct kiln_batches *batches, double work, double seconds);

/* Waits as long as a slow rank takes longer for what took `seconds`. */
void kiln_batch_be_slow(const struct kiln_batches *batches, double seconds);

/* Sends radiosity early, if the step does so: that of this rank's finished tile runs before `end`. */
void kiln_batch_send_done(struct kiln_batches *batches, size_t end);

/* Implements kiln_take_some; `context` is the kiln_batches. The cost of the part is divided among its tile runs by
 * their points. */
int kiln_batch_take_some(void *context, size_t first, size_t count, const uint32_t *samples, const void *results,
                         struct kiln_error *error);
/* kiln_take_results of the same. */
int kiln_batch_take_part(void *context, size_t first, size_t count, const void *results, struct kiln_error *error);

#endif
