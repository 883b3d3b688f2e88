/* The second go: where nodes receive only the radiosity that they want (coordinator/field/radiosity_allgather.h), a
 * tile run whose rays have met an absent point is not taken (take.h). When a step is over, its node finds out what
 * these tile runs have met, asks for it, and computes them again: with all radiosity that they need, so that their
 * answers are the same bits as if everything had been sent.
 *
 * What was met is found by the gather itself. The absent units are numbered in order, and their numbers written in base
 * three; once for each digit the tile runs are computed with absent points that are no number in the red, the green or
 * the blue channel, as the unit's digit says. The channels in which a point's answer is no number are the digits of
 * what its rays have met, for a point that met one absent unit, and a few more units for one that met several. */
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

/* Collective, when all own tile runs of a step are taken or lack something. Afterwards all are taken. */
int kiln_second_go(const struct kiln_second_go *go, struct kiln_error *error);

#endif
