/* What the files take out of the provenance text besides keeping it whole. Private to coordinator/output. */
#ifndef KILN_COORDINATOR_OUTPUT_PROVENANCE_H
#define KILN_COORDINATOR_OUTPUT_PROVENANCE_H

#include <stdbool.h>
#include <stdint.h>

/* The seed, which is `seed` or `settings.seed` of the JSON object. False when `text` is NULL or has none. */
bool kiln_provenance_seed(const char *text, int64_t *seed);

#endif
