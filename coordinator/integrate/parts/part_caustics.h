/* Caustics of a bake with an error of published light (published.h).
 *
 * Their samples and light paths go by levels of their own (rounds.h), and a round may have none. So part k of each
 * round keeps the caustics that it has found so far apart: their luminance, by which their share of the error is
 * judged, and their radiosity. All that sums up light of a part keeps these, and changes when they do: the mean over
 * all samples of caustics that the parts of this number have had.
 *
 * Light paths land in all tile runs. So caustics change in finished tile runs, too. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_PART_CAUSTICS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_PART_CAUSTICS_H

#include "coordinator/integrate/integrate.h"
#include "coordinator/integrate/integrator.h"

/* Whether the step is of a part that has caustics from earlier rounds. */
static inline bool kiln_part_has_caustics(const struct kiln_rank_data *data, const struct kiln_step *step)
{
    return data->parts_caustic != NULL && step->part >= KILN_PARTS;
}

/* Stores a point's caustics, of the luminance and radiosity given, of a part of the first round. `bit`: the point's
 * place in its tile, for stochastic rounding. */
void kiln_part_keep_caustics(const struct kiln_rank_data *data, struct kiln_own_point own,
                             const struct kiln_tile_run *run, uint32_t bit, float luminance, const float radiosity[3],
                             const struct kiln_step *step);

/* Averages a point's caustics of a later round, of luminance and radiosity given, into those that its part has, and
 * changes by the difference what contains these: the part's light, what it sends, the sum of direct light and caustics,
 * and the total radiosity. */
void kiln_part_mix_caustics(const struct kiln_rank_data *data, struct kiln_own_point own,
                            const struct kiln_tile_run *run, uint32_t bit, float luminance, const float radiosity[3],
                            const struct kiln_taking *taking);

/* Luminance of the caustics that the step's part has at a point. */
float kiln_part_caustics_light(const struct kiln_rank_data *data, struct kiln_own_point own,
                               const struct kiln_step *step);
/* Adds the radiosity of these to `sum`, and that of all parts' mean to `total`. W/m2. */
void kiln_part_add_caustics(const struct kiln_rank_data *data, struct kiln_own_point own, const struct kiln_step *step,
                            float sum[3], float total[3]);

/* The share of caustics in the variance of a tile run's light, from 0 to 1: of means over 5 x 5 texels, as the four
 * parts have them. */
double kiln_part_caustics_share(const struct kiln_rank_data *data, const struct kiln_tile_run *run);

/* Need of caustics in unfinished tile runs. Zero at first. Integers, so that sums are the same for any ranks. */
struct kiln_caustics_need {
    uint64_t points, all, caustics;
};

/* Adds a tile run: `square`, the mean square of its errors over the allowed error, of which caustics have `share`. */
void kiln_caustics_need_add(struct kiln_caustics_need *need, uint64_t points, double square, double share);
/* Collective. Adds up over the ranks. */
void kiln_caustics_need_reduce(struct kiln_caustics_need *need, MPI_Comm communicator);

/* Growth of the samples of caustics that the next round should have, over that of all other samples. The variance v / m
 * of caustics, and w / n of all other light, falls with their samples m and n, whose costs are c for all points, and d
 * for the unfinished. The sum of both is least at given cost with m / n = root of v d / w c. `caustics`, `others`: m
 * and n, in units of the first round. `share`: of the points, unfinished. 0: caustics are below a tenth of the error.
 */
double kiln_caustics_growth(const struct kiln_caustics_need *need, double caustics, double others, double share);

#endif
