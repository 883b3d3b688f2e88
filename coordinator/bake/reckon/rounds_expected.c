#include "coordinator/bake/reckon/rounds_expected.h"

#include <math.h>

#define A_ROUND 2.5 /* samples of all rounds over those of the rounds before the last: mostly two levels, or three */
#define MOST 512.0  /* rounds end there, whatever the error is */

struct kiln_foretold kiln_rounds_expected(double asked, bool hard)
{
    const double first = hard ? KILN_ROUNDS_ERROR_HARD : KILN_ROUNDS_ERROR_PLAIN,
                 ratio = asked > 0.0 ? fmax(first / asked, 1.0) : 1.0, samples = fmin(ratio * ratio, MOST);
    return (struct kiln_foretold){.rounds = 1 + (uint32_t)ceil(log(samples) / log(A_ROUND)),
                                  .samples = samples,
                                  .error = first / sqrt(samples),
                                  .limited = ratio * ratio > MOST};
}
