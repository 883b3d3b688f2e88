/* A folder of its own for a scene file that only one command needs. */
#ifndef KILN_COORDINATOR_CLI_TEMPORARY_H
#define KILN_COORDINATOR_CLI_TEMPORARY_H

#include "coordinator/output/publish.h"

struct kiln_temporary {
    char folder[KILN_PATH_SIZE];
    char scene_file[KILN_PATH_SIZE]; /* in it; need not exist */
};

/* Makes a folder in $TMPDIR or /tmp. Always call kiln_temporary_remove after it, also when it failed. */
int kiln_temporary_make(struct kiln_temporary *temporary, struct kiln_error *error);
void kiln_temporary_remove(const struct kiln_temporary *temporary);

#endif
