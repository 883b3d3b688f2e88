/* When shares are cut anew: the rule by which bakes (rebalance.c) and their simulation (simulate_light.c) decide after
 * each pass. */
#ifndef KILN_COORDINATOR_INTEGRATE_REPARTITION_H
#define KILN_COORDINATOR_INTEGRATE_REPARTITION_H

#include "coordinator/integrate/transport.h"

#define KILN_BOUND_SLACK 0.05 /* of a mean share, by which a cut may lie off to fall between two cells (objects) */

/* The pass that is over, whose costs are known, and the one that comes. */
struct kiln_repartition_passes {
    enum kiln_pass_kind last, next;
    uint32_t last_samples, next_samples, next_bounce;
};

/* Whether it is done at all: `any_share` where every backend computes any rank's share (kiln_backend_info). */
bool kiln_repartition_is_allowed(const struct kiln_job *job, bool any_share);
/* Whether the last pass says enough of those to come. */
bool kiln_repartition_is_due(const struct kiln_job *job, const struct kiln_repartition_passes *passes);
/* Seconds in the passes to come, when `longest` was the work of the rank that had most (or of the mean rank of a node
 * whose ranks help each other) in the last one, and `mean` that of all. Negative where new cuts would hardly be more
 * even than these. */
double kiln_repartition_gain(const struct kiln_job *job, const struct kiln_repartition_passes *passes, double longest,
                             double mean);
/* Whether it is asked what moving would cost. */
bool kiln_repartition_is_asked(const struct kiln_job *job, double gain);
/* Seconds of a move in which the rank that gets most gets so many points of so many bytes. */
double kiln_repartition_cost(double points, double bytes);
bool kiln_repartition_pays(const struct kiln_job *job, double gain, double cost);

#endif
