/* Parts: a bake that is to know its errors solves the light several times, each time from the beginning, with a share
 * of the samples. What the parts find is averaged; what they differ by shows the error of the average, with all noise
 * of the bounces, which neighbouring texels share and which no texel can tell from its own samples.
 *
 * K = KILN_PARTS parts are a round. In the first round part k takes samples k n / K to (k + 1) n / K - 1 of a step with
 * n samples (kiln_batch.first_sample; n is rounded up to a multiple of K): all parts together have the samples that one
 * solve would have. An integrator solves a part as it would solve all, and knows nothing of the others. Quantities
 * (quantity.h) are computed once, after the last part.
 *
 * What the parts differ by shows the error of their mean: part_errors.h.
 *
 * With a target error the first round has fewer samples, and more rounds follow until the error is what was asked for
 * (rounds.h). The mean is over all samples: parts of different rounds count by theirs. The first round alone is in the
 * energy ledger. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_PARTS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_PARTS_H

#include "coordinator/integrate/integrate.h"

/* The place of the first report of the part that the last of `count` reports is of. */
size_t kiln_part_first(const struct kiln_step_report *reports, size_t count);

/* The integrator's reports of the part under way: a view. */
static inline struct kiln_step_reports kiln_part_reports(const struct kiln_step_reports *reports)
{
    const size_t first = kiln_part_first(reports->of, reports->count);
    return (struct kiln_step_reports){reports->of + first, reports->count - first, 0};
}

/* The integrator's step after those reported, of the same part or the first of the next; false: there is none. Pure:
 * see kiln_integrator.next. */
bool kiln_parts_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step);

/* Samples of all parts before a part, over its own, in a step that counts for the result. */
static inline double kiln_part_before(const struct kiln_step *step)
{
    return step->part == 0 ? 0.0 : (double)step->first_sample / (double)step->samples;
}
/* Changes the mean over all samples before the part to that with the part's values. */
static inline void kiln_part_mix(float *mean, const float *values, size_t components, const struct kiln_step *step)
{
    for (size_t c = 0; c < components; c++)
        mean[c] = step->part == 0 ? values[c] : mean[c] + (values[c] - mean[c]) / (float)(kiln_part_before(step) + 1.0);
}
/* The standard error of that mean: of the mean before, whose error is `before`, and a value with the error `error`. */
double kiln_part_mix_error(double before, double error, const struct kiln_step *step);

/* Whether the results of a tile run's points still change in the part. */
static inline bool kiln_part_changes(const struct kiln_rank_data *data, const struct kiln_tile_run *tile_run,
                                     uint32_t part)
{
    return part < KILN_PARTS || data->samples == NULL || data->samples[tile_run - data->surface.tile_runs] > 0;
}

/* Begins a part's luminance at a point with that of direct light; then adds that of caustics. Nothing where no parts
 * are kept. */
void kiln_part_begin(const struct kiln_rank_data *data, struct kiln_own_point own, float luminance,
                     const struct kiln_step *step);
void kiln_part_add(const struct kiln_rank_data *data, struct kiln_own_point own, float luminance,
                   const struct kiln_step *step);

/* Collective. A step of the integrator is over. If it was the last of its part, indirect light is taken into its mean;
 * after a round, the error is looked at, in the report of the step; after the last part, the means are the result, and
 * the parts' spread is the error. `unit` is that of exact sums of power, W. KILN_SYSTEM. */
int kiln_part_end(const struct kiln_integrate_params *params, struct kiln_solution *solution, double unit,
                  struct kiln_error *error);

#endif
