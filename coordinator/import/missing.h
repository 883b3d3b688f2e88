/* Missing pictures that a scene names: each is reported as a note; with --strict all together are an error. */
#ifndef KILN_COORDINATOR_IMPORT_MISSING_H
#define KILN_COORDINATOR_IMPORT_MISSING_H

#include "coordinator/import/confine.h"

enum { KILN_MISSING_NAMES = 1400 };

/* Zero-initialise. */
struct kiln_missing {
    uint64_t count;
    char names[KILN_MISSING_NAMES]; /* as many as fit, for the error */
};

/* Adds a missing picture: `place` names its use ("images[2].uri"), `name` is its name in the file, `instead` is the end
 * of a sentence about its replacement. `matters`: light depends on the picture. */
int kiln_missing_add(struct kiln_missing *missing, struct kiln_confine *confine, struct kiln_builder *builder,
                     const char *place, const char *folder, const char *name, bool matters, const char *instead,
                     struct kiln_error *error);
/* Call it after the last picture: KILN_BAD_INPUT if any is missing and builder->strict. */
int kiln_missing_end(const struct kiln_missing *missing, const struct kiln_confine *confine,
                     struct kiln_builder *builder, struct kiln_error *error);

#endif
