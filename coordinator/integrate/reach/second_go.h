/* The second go recomputes tile runs that lacked radiosity. Where nodes receive only the radiosity that they request
 * (coordinator/field/radiosity_allgather.h), a tile run whose rays met an absent point is not taken (take.h). After the
 * step its node determines the points met, requests them and computes these tile runs again, with all radiosity that
 * they need: the same bits as if everything had been sent.
 *
 * The gather itself determines the points met. Absent units are numbered in order, in base three. For each digit the
 * tile runs are computed once, with absent points that are NaN in the red, green or blue channel according to their
 * unit's digit. The channels in which a point's answer is NaN are the digits of the units that its rays met: exactly
 * for a point that met one absent unit, with a few units too many for one that met several. */
#ifndef KILN_COORDINATOR_INTEGRATE_REACH_SECOND_GO_H
#define KILN_COORDINATOR_INTEGRATE_REACH_SECOND_GO_H

#include "coordinator/integrate/run/batches.h"
#include "coordinator/integrate/reach/sight.h"

/* All borrowed. */
struct kiln_second_go {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution; /* its last report is that of the step */
    struct kiln_batches *batches;   /* of the step */
    struct kiln_taker *taker;       /* likewise */
};

/* Collective, when all own tile runs of a step are taken or lack radiosity. Afterwards all are taken. */
int kiln_second_go(const struct kiln_second_go *go, struct kiln_error *error);

#endif
