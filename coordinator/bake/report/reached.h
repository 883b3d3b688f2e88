/* The error that a bake has reached, and the option that would help most against it. Not collective; for rank 0. */
#ifndef KILN_COORDINATOR_BAKE_REPORT_REACHED_H
#define KILN_COORDINATOR_BAKE_REPORT_REACHED_H

#include <jansson.h>
#include <stdio.h>

enum { KILN_REACHED_TEXT = 400 };

/* Makes {option, because} of the content of run.json: the one option that would make its light better, with a value,
 * and the reason as a sentence without a full stop. NULL: none is known to help. Release with json_decref.
 *
 * By what it goes, in this order: lightmaps that are not denoised; texels that lose more than noise does, where
 * --check-density has found that; time that has ended the rounds; a target that was not reached for other reasons; and
 * a finer target, with the time that it would take. The error falls with the root of the samples, so half the error
 * takes four times the light. */
json_t *kiln_best_option(const json_t *report);

/* Prints the error of published light and where it is worst, or that of raw samples if nothing else is known, and
 * `improve` of the report, which is what kiln_best_option has made. */
void kiln_reached_print(FILE *stream, const json_t *report);

#endif
