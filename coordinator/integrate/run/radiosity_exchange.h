/* Hands the radiosity that the ranks have computed to all of them, in the form in which it was packed. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_RADIOSITY_EXCHANGE_H
#define KILN_COORDINATOR_INTEGRATE_RUN_RADIOSITY_EXCHANGE_H

#include "coordinator/integrate/solution.h"
#include "coordinator/run/control.h"
#include "coordinator/run/trace.h"

/* Which values go out. */
enum kiln_exchange_source {
    KILN_EXCHANGE_IN_PLACE,     /* what stands at the own points' place in solution->radiosity, 8 bytes */
    KILN_EXCHANGE_NEXT,         /* own->next, 8 bytes */
    KILN_EXCHANGE_NEXT_COMPACT, /* own->next, 4 bytes: the rest of what began to travel while the step went on */
};

/* All borrowed. */
struct kiln_radiosity_exchange {
    struct kiln_solution *solution;
    struct kiln_control *control;
    struct kiln_trace *trace; /* may be NULL */
    uint32_t threads;
};

/* Collective. Afterwards solution->radiosity is that of all points. The time is added to `report`, a step's. */
void kiln_exchange_radiosity(const struct kiln_radiosity_exchange *exchange, enum kiln_exchange_source source,
                             struct kiln_step_report *report);

/* Collective. The same of the points' total radiosity, albedo x (direct + indirect), when all light is known. */
void kiln_exchange_total_radiosity(const struct kiln_radiosity_exchange *exchange, struct kiln_step_report *report);

#endif
