/* Distributes the radiosity computed by each rank to all ranks, in its packed form. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_RADIOSITY_EXCHANGE_H
#define KILN_COORDINATOR_INTEGRATE_RUN_RADIOSITY_EXCHANGE_H

#include "coordinator/integrate/solution.h"
#include "coordinator/run/control.h"
#include "coordinator/run/trace.h"

/* Which values go out. */
enum kiln_exchange_source {
    KILN_EXCHANGE_IN_PLACE,     /* the radiosity of own points in solution->radiosity, 8 bytes each */
    KILN_EXCHANGE_NEXT,         /* own->next, 8 bytes */
    KILN_EXCHANGE_NEXT_COMPACT, /* own->next, 4 bytes each: the rest of an exchange that began during the step */
};

/* All borrowed. */
struct kiln_radiosity_exchange {
    struct kiln_solution *solution;
    struct kiln_control *control;
    struct kiln_trace *trace; /* may be NULL */
    uint32_t threads;
};

/* Collective. Afterwards solution->radiosity has the radiosity of all points. The time is added to the report of a
 * step. */
void kiln_exchange_radiosity(const struct kiln_radiosity_exchange *exchange, enum kiln_exchange_source source,
                             struct kiln_step_report *report);

/* Collective, after all light is known. Exchanges the points' total radiosity, albedo x (direct + indirect),
 * likewise. */
void kiln_exchange_total_radiosity(const struct kiln_radiosity_exchange *exchange, struct kiln_step_report *report);

#endif
