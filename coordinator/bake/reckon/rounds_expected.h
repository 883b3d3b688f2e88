/* Expected samples of a bake in rounds (integrate/parts/rounds.h), whose error is asked for and whose samples follow.
 *
 * Noise falls with the root of the samples. With e the error that 95 % of the texels stay below, over the error asked
 * for, all points together need about e^2 times the samples of the first round: finished tiles get no more, but those
 * that are left need more than others. */
#ifndef KILN_COORDINATOR_BAKE_RECKON_ROUNDS_EXPECTED_H
#define KILN_COORDINATOR_BAKE_RECKON_ROUNDS_EXPECTED_H

#include <stdbool.h>

/* Error of published light that 95 % of the texels stay below after the first round, as typical figures: in plain
 * scenes, and in those with gloss or a sun. tests/bench/NOTES.md has the scenes: 0.1 to 0.25, and 0.3 to 1.9. */
#define KILN_ROUNDS_ERROR_PLAIN 0.14
#define KILN_ROUNDS_ERROR_HARD 0.75

/* Samples of all rounds over those of the first: of direct light and of final gathers, as a mean over the points.
 * `first_error`: the error after the first round, which a bake knows once it is over; 0: a typical one, by `hard`. */
double kiln_rounds_expected(double asked, double first_error, bool hard);

/* Number of rounds that these samples take; the first counts. */
double kiln_rounds_number(double times);

#endif
