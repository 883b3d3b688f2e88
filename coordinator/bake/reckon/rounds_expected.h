/* Expected rounds of a bake whose error is asked for and whose samples follow (integrate/parts/rounds.h), where no
 * trial has told them.
 *
 * Noise falls with the root of the samples. With e the error that 95 % of the texels stay below, over the error asked
 * for, all points together need about e^2 times the samples of the first round: finished tiles get no more, but those
 * that are left need more than others. */
#ifndef KILN_COORDINATOR_BAKE_RECKON_ROUNDS_EXPECTED_H
#define KILN_COORDINATOR_BAKE_RECKON_ROUNDS_EXPECTED_H

#include <stdbool.h>

#include "coordinator/integrate/foretold.h"

/* Error of published light that 95 % of the texels stay below after the first round, as typical figures: in plain
 * scenes, and in those with gloss, a sun or a sky. tests/bench/NOTES.md has the scenes: 0.08 to 0.25, and 0.1 to 1.9.
 * The second stands for the harder half of these. The backend is chosen by it: to take a GPU for nothing costs its
 * start and its kernels, and to take processors for what is hard costs minutes. */
#define KILN_ROUNDS_ERROR_PLAIN 0.14
#define KILN_ROUNDS_ERROR_HARD 0.75

/* All rounds of a bake. Sets `rounds`, `samples` and `error`; nothing is tried. */
struct kiln_foretold kiln_rounds_expected(double asked, bool hard);

#endif
