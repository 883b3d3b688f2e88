/* Parts: a bake that is to know its errors solves the light several times, each time from the beginning, with a share
 * of the samples. What the parts find is averaged; what they differ by shows the error of the average, with all noise
 * of the bounces, which neighbouring texels share and which no texel can tell from its own samples.
 *
 * Part k of K takes samples k n / K to (k + 1) n / K - 1 of a step with n samples (kiln_batch.first_sample): all parts
 * together have the samples that one solve would have, and each has one at least. An integrator solves a part as it
 * would solve all, and knows nothing of the others. Quantities (quantity.h) are computed once, after the last part.
 *
 * The standard error of a mean of K independent values x_k with the mean m is sqrt(sum (x_k - m)^2 / (K (K - 1))). Of
 * four values it is itself off by 40 %, so its square is averaged over the points of the tile run that are at most two
 * texels away. The parts' samples stratify one another, which makes the average better than independent parts would be:
 * the error is stated too large rather than too small. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_H

#include "coordinator/field/rank_data.h"
#include "coordinator/integrate/settings.h"
#include "coordinator/integrate/step.h"

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

/* Changes the mean over parts 0 .. part - 1 of `components` values to that over parts 0 .. part. */
static inline void kiln_part_mix(float *mean, const float *values, size_t components, uint32_t part)
{
    for (size_t c = 0; c < components; c++)
        mean[c] = part == 0 ? values[c] : mean[c] + (values[c] - mean[c]) / (float)(part + 1);
}
/* The standard error of that mean: of the mean before, whose error is `before`, and a value with the error `error`. */
double kiln_part_mix_error(double before, double error, uint32_t part);

/* Adds a luminance that part `part` found at a point to what it has found there. Nothing where no parts are kept. */
void kiln_part_add(const struct kiln_rank_data *data, struct kiln_own_point own, float luminance, uint32_t part);

/* Part `part` is over for all own points: indirect light is taken into its mean. After the last part that is the
 * result, and the parts' spread is the error. */
void kiln_part_end(const struct kiln_rank_data *own_data, uint32_t part, bool is_last);

#endif
