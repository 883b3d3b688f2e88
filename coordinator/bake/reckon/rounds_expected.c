#include "coordinator/bake/reckon/rounds_expected.h"

#include <math.h>

#define A_ROUND 2.5 /* samples of all rounds over those of the rounds before the last: mostly two levels, or three */

double kiln_rounds_expected(double asked, double first_error)
{
    const double first = first_error > 0.0 ? first_error : KILN_ROUNDS_FIRST_ERROR;
    return asked > 0.0 ? pow(fmax(first / asked, 1.0), KILN_ROUNDS_POWER) : 1.0;
}

double kiln_rounds_number(double times) { return 1.0 + ceil(log(fmax(times, 1.0)) / log(A_ROUND)); }
