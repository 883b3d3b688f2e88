#include "coordinator/bake/reckon/rounds_expected.h"

#include <math.h>

#define A_ROUND 2.0 /* samples of all rounds over those of the rounds before the last: two levels */
#define MOST 8192.0 /* rounds end there, whatever the error is: 32,768 samples of a part, of 4 in the first round */

struct kiln_foretold kiln_rounds_expected(double asked, bool hard)
{
    const double first = hard ? KILN_ROUNDS_ERROR_HARD : KILN_ROUNDS_ERROR_PLAIN,
                 ratio = asked > 0.0 ? fmax(first / asked, 1.0) : 1.0, samples = fmin(ratio * ratio, MOST);
    return (struct kiln_foretold){.rounds = 1 + (uint32_t)ceil(log(samples) / log(A_ROUND)),
                                  .samples = samples,
                                  .error = first / sqrt(samples),
                                  .limited = ratio * ratio > MOST};
}
