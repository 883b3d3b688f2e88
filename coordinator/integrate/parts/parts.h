/* Parts: a bake that shall know its errors solves the light several times from the beginning, each time with a fraction
 * of the samples. The results are averaged; their spread shows the error of the average. It includes all noise of the
 * bounces, which neighbouring texels share and which a texel cannot estimate from its own samples.
 *
 * A round has K = KILN_PARTS parts. In the first round part k takes samples k n / K to (k + 1) n / K - 1 of a step with
 * n samples (kiln_batch.first_sample; n is rounded up to a multiple of K): all parts together use the samples of a
 * single solve. An integrator solves a part like a whole bake, and knows nothing of the others. Quantities (quantity.h)
 * are computed once, after the last part.
 *
 * The error of the mean is derived from the spread of the parts: part_errors.h.
 *
 * With an error of published light, later rounds do not start at the lamps: the final gather of a part reads the
 * radiosity that the parts of the same number found in earlier rounds. It has no bounces, and finished tile runs cost
 * nothing. The noise of that radiosity weighs less with each round; parts of other numbers are independent of it. All
 * texels of a room share it: where light comes by a gap, few samples of the first round find the gap, and what they
 * found goes round between the walls. So later rounds, which read better light, weigh more than their samples: all that
 * a tile run has found with n samples weighs as n^2. With rounds of twice the samples before, this costs 13 % more
 * noise of its own; in a model of a room whose walls give back 0.6 of their light it saves 30 % of the noise that
 * texels share. tests/bench/NOTES.md has figures of scenes.
 *
 * With a target error the first round has fewer samples, and rounds follow until the target is reached (rounds.h). The
 * mean is over all samples: each part weighs by its number of samples. Only the first round is in the energy ledger. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_PARTS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_PARTS_H

#include "coordinator/integrate/integrate.h"
#include "coordinator/integrate/integrator.h"

/* Returns the index of the first report of the part to which the last of `count` reports belongs. */
size_t kiln_part_first(const struct kiln_step_report *reports, size_t count);

/* View of the integrator's reports that belong to the current part. */
static inline struct kiln_step_reports kiln_part_reports(const struct kiln_step_reports *reports)
{
    const size_t first = kiln_part_first(reports->of, reports->count);
    return (struct kiln_step_reports){reports->of + first, reports->count - first, 0};
}

/* Finds the step after those reported, of the same part or the first of the next; false: there is none. Pure: see
 * kiln_integrator.next. */
bool kiln_parts_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step);

/* Whether the step is of a part that goes on from the light of earlier rounds. */
static inline bool kiln_part_goes_on(const struct kiln_rank_data *data, const struct kiln_step *step)
{
    return data->parts_radiosity != NULL && step->part >= KILN_PARTS;
}

/* Packs what parts of the step's number have found in earlier rounds into `next`: what the final gather reads. */
void kiln_part_pack(const struct kiln_rank_data *data, const struct kiln_step *step);

/* Weight of the step's samples at a tile run. Where tile runs have taken samples as they needed them
 * (kiln_rank_data.samples_taken), it is the tile run's own, and grows as the square of the samples. */
struct kiln_part_weight kiln_part_weight(const struct kiln_rank_data *data, const struct kiln_tile_run *tile_run,
                                         const struct kiln_step *step);

/* The context of storing a tile run's results, with its weight. */
static inline struct kiln_taking kiln_part_weigh(const struct kiln_taking *taking, const struct kiln_rank_data *data,
                                                 const struct kiln_tile_run *tile_run)
{
    struct kiln_taking weighed = *taking;
    weighed.weight = kiln_part_weight(data, tile_run, taking->step);
    return weighed;
}

/* Updates `mean`, over the samples of all earlier parts, with this part's values. */
static inline void kiln_part_mix(float *mean, const float *values, size_t components,
                                 const struct kiln_part_weight *weight)
{
    for (size_t c = 0; c < components; c++)
        mean[c] = weight->before > 0.0 ? mean[c] + (values[c] - mean[c]) / (float)(weight->before + 1.0) : values[c];
}
/* Returns the standard error of the updated mean, from the error `before` of the old mean and the `error` of the part's
 * value. */
double kiln_part_mix_error(double before, double error, const struct kiln_part_weight *weight);

/* Whether the results of a tile run's points still change in the part. */
static inline bool kiln_part_changes(const struct kiln_rank_data *data, const struct kiln_tile_run *tile_run,
                                     uint32_t part)
{
    return part < KILN_PARTS || data->samples == NULL || data->samples[tile_run - data->surface.tile_runs] > 0;
}

/* kiln_part_begin sets a part's luminance at a point to that of direct light; kiln_part_add adds caustics. Both do
 * nothing if no parts are stored. */
void kiln_part_begin(const struct kiln_rank_data *data, struct kiln_own_point own, float luminance, uint32_t part,
                     const struct kiln_part_weight *weight);
void kiln_part_add(const struct kiln_rank_data *data, struct kiln_own_point own, float luminance, uint32_t part,
                   const struct kiln_part_weight *weight);

/* Averages a point's radiosity, W/m2, as the part found it, into that of the parts of its number. `more`: adds it to
 * what the part has found before. `bit`: the point's place in its tile, for stochastic rounding. */
void kiln_part_send(const struct kiln_rank_data *data, struct kiln_own_point own, const struct kiln_tile_run *run,
                    uint32_t bit, const float radiosity[3], const struct kiln_step *step,
                    const struct kiln_part_weight *weight, bool more);

/* Collective. Ends a step of the integrator. After the last step of a part, indirect light is added to its mean; after
 * a round, the error is evaluated and reported with the step; after the last part, the means become the result, and the
 * spread of the parts its error. `unit`: of exact sums of power, W. KILN_SYSTEM. */
int kiln_part_end(const struct kiln_integrate_params *params, struct kiln_solution *solution, double unit,
                  struct kiln_error *error);

#endif
