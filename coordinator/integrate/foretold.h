/* Rounds of a bake that asks for an error of published light (parts/rounds.h), foretold. */
#ifndef KILN_COORDINATOR_INTEGRATE_FORETOLD_H
#define KILN_COORDINATOR_INTEGRATE_FORETOLD_H

#include <stdbool.h>
#include <stdint.h>

/* Rounds to come: after a trial all of them, after a round those that follow it. */
struct kiln_foretold {
    uint32_t tried; /* tile runs that it was learnt from; 0: typical figures, or none where `rounds` is 0 */
    uint32_t rounds;
    double samples; /* of direct light and of final gathers, over those of the first round, as a mean over all points */
    double error;   /* of published light at the end */
    bool limited;   /* rounds end before the error that is asked for: texels have the most samples that one gets */
};

#endif
