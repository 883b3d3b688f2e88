#include "coordinator/integrate/repartition.h"

#include <math.h>

#define LEFT_UNEVEN 0.05       /* of the mean: what a new cut is expected to leave */
#define LEAST_GAIN 0.1         /* s: below, it is not even asked what a move costs */
#define PAYS 2.0               /* so many times its cost a move must gain */
#define MOVE_BYTES 300e6       /* a second and rank, packed, sent and unpacked */
#define MOVE_START 0.02        /* s */
enum { BOUNCES_EXPECTED = 3 }; /* where their number is not given */

static bool always(const struct kiln_job *job) { return job->rebalance == KILN_REBALANCE_ALWAYS; }

bool kiln_repartition_is_allowed(const struct kiln_job *job, bool any_share)
{
    return always(job) || (job->rebalance == KILN_REBALANCE_AUTO && any_share);
}

bool kiln_repartition_is_due(const struct kiln_job *job, const struct kiln_repartition_passes *passes)
{
    return always(job) || passes->last != KILN_PASS_DIRECT || passes->next != KILN_PASS_BOUNCE;
}

/* Samples of the next pass and those after it. */
static double samples_to_come(const struct kiln_job *job, const struct kiln_repartition_passes *passes)
{
    const double now = (double)passes->next_samples, bounce = (double)passes->next_bounce;
    if (passes->next == KILN_PASS_FINAL)
        return now;
    const double bounces = job->bounces >= 0 ? (double)job->bounces : bounce + BOUNCES_EXPECTED;
    if (job->schedule == KILN_SCHEDULE_EQUAL)
        return now * fmax(1.0, bounces - bounce + 1.0);
    return now * fmax(1.0, bounces - bounce) + (double)job->samples_indirect;
}

double kiln_repartition_gain(const struct kiln_job *job, const struct kiln_repartition_passes *passes, double longest,
                             double mean)
{
    return samples_to_come(job, passes) / (double)passes->last_samples * (longest - (1.0 + LEFT_UNEVEN) * mean);
}

bool kiln_repartition_is_asked(const struct kiln_job *job, double gain) { return always(job) || gain > LEAST_GAIN; }

double kiln_repartition_cost(double points, double bytes) { return MOVE_START + points * bytes / MOVE_BYTES; }

bool kiln_repartition_pays(const struct kiln_job *job, double gain, double cost)
{
    return always(job) || gain > PAYS * cost;
}
