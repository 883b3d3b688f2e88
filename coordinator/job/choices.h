/* Choices that a job has and that other rooms act on: what the values of some options mean. */
#ifndef KILN_COORDINATOR_JOB_CHOICES_H
#define KILN_COORDINATOR_JOB_CHOICES_H

#include <stdbool.h>
#include <stdint.h>

/* The integrators, by the names that --method takes; the first one is the default. Each is a struct called
 * kiln_integrator_NAME (coordinator/integrate/integrator.h). */
#define KILN_METHOD_LIST(DO) DO(cells)

/* AUTO: compact from 2^22 surface points on. With fewer its rounding shows in the ratio of two bounces, which the tail
 * magnifies a hundred times where the albedo is 0.99; with more it averages out. */
enum kiln_exchange_form { KILN_EXCHANGE_AUTO = 0, KILN_EXCHANGE_COMPACT = 1, KILN_EXCHANGE_FULL = 2 };

static inline bool kiln_exchange_is_compact(int form, uint64_t points)
{
    return form == KILN_EXCHANGE_COMPACT || (form == KILN_EXCHANGE_AUTO && points >= 1u << 22);
}

/* Whether the points are distributed anew between steps: when that pays, never, after every step (for tests). */
enum kiln_rebalance { KILN_REBALANCE_AUTO = 0, KILN_REBALANCE_NEVER = 1, KILN_REBALANCE_ALWAYS = 2 };

enum kiln_schedule {
    KILN_SCHEDULE_LEAN = 0, /* cheap bounces, a tail, one final gather */
    KILN_SCHEDULE_EQUAL = 1 /* the same rays in every bounce, nothing else: the reference mode */
};

#endif
