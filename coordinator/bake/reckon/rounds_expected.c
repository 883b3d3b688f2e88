#include "coordinator/bake/reckon/rounds_expected.h"

#include <math.h>

#define A_ROUND 2.5 /* samples of all rounds over those of the rounds before the last: mostly two levels, or three */
#define MOST 512.0  /* rounds end there, whatever the error is */

double kiln_rounds_expected(double asked, double first_error, bool hard)
{
    const double typical = hard ? KILN_ROUNDS_ERROR_HARD : KILN_ROUNDS_ERROR_PLAIN,
                 first = first_error > 0.0 ? first_error : typical,
                 ratio = asked > 0.0 ? fmax(first / asked, 1.0) : 1.0;
    return fmin(ratio * ratio, MOST);
}

double kiln_rounds_number(double times) { return 1.0 + ceil(log(fmax(times, 1.0)) / log(A_ROUND)); }
