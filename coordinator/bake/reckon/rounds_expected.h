/* Expected samples of a bake in rounds (integrate/parts/rounds.h), whose error is asked for and whose samples follow.
 *
 * Noise falls with the root of the samples, so a point whose error is e times the error asked for needs e^2 times its
 * samples. Errors differ from tile to tile, and finished tiles get no more: with e the error that 95 % of the texels
 * stay below, all points together need about e^KILN_ROUNDS_POWER times the samples of the first round. */
#ifndef KILN_COORDINATOR_BAKE_RECKON_ROUNDS_EXPECTED_H
#define KILN_COORDINATOR_BAKE_RECKON_ROUNDS_EXPECTED_H

/* Error of published light that 95 % of the texels stay below after the first round, as a typical figure: the geometric
 * mean over some scenes (tests/bench/NOTES.md), where it is 0.1 to 3. */
#define KILN_ROUNDS_FIRST_ERROR 0.35
#define KILN_ROUNDS_POWER 1.6

/* Samples of all rounds over those of the first: of direct light and of final gathers, as a mean over the points.
 * `first_error`: the error after the first round, which a bake knows once it is over; 0: the typical one. */
double kiln_rounds_expected(double asked, double first_error);

/* Number of rounds that these samples take; the first counts. */
double kiln_rounds_number(double times);

#endif
