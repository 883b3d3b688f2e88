/* Values that output files extract from the provenance text (kiln_provenance). Private to coordinator/output. */
#ifndef KILN_COORDINATOR_OUTPUT_PROVENANCE_H
#define KILN_COORDINATOR_OUTPUT_PROVENANCE_H

#include <stdbool.h>
#include <stdint.h>

/* Finds the seed, `seed` or `settings.seed` of the JSON object. False if `text` is NULL or has no seed. */
bool kiln_provenance_seed(const char *text, int64_t *seed);

#endif
