/* The closing table of a bake, and in words what its times ask for. Not collective; on rank 0. */
#ifndef KILN_COORDINATOR_BAKE_RUN_TABLE_H
#define KILN_COORDINATOR_BAKE_RUN_TABLE_H

#include <jansson.h>
#include <stdio.h>

/* An array of sentences, each with a remedy, from the report's phases: of the phase in which most is lost because a
 * rank takes longer than the mean (by more than 5 %), and of writing files when that is more than 10 % of the bake.
 * What costs less than a second is not worth a sentence. NULL without memory. json_decref it. */
json_t *kiln_run_notes(const json_t *report);

/* Writes phases (seconds over the ranks, imbalance: slowest over mean - 1, mean as a share of the bake), what was
 * reached, and the report's notes. */
void kiln_run_table(FILE *stream, const json_t *report);

#endif
