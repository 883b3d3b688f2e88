/* The table that ends a bake, and notes with advice that follows from its times. Not collective; for rank 0. */
#ifndef KILN_COORDINATOR_BAKE_REPORT_RUN_TABLE_H
#define KILN_COORDINATOR_BAKE_REPORT_RUN_TABLE_H

#include <jansson.h>
#include <stdio.h>

/* Creates an array of notes, each with a remedy: about lost light; about the phase that loses most time because its
 * slowest rank takes more than 5 % longer than the mean; about writing files, if that takes more than 10 % of the bake;
 * and about charts that lie too close together. Losses of less than a second get no note, and files of less than five
 * seconds. NULL if memory is short. Release with json_decref. */
json_t *kiln_run_notes(const json_t *report);

/* Prints the phases (minimum, mean and maximum seconds over the ranks, imbalance = maximum / mean - 1, and mean
 * relative to the time of the bake; of one rank its seconds alone), the energy balance, the error reached and what
 * would help most (reached.h), and the report's notes. */
void kiln_run_table(FILE *stream, const json_t *report);

#endif
