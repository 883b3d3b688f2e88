/* A temporary file without a name, for a scene that only one command needs. It vanishes when the process ends in any
 * way. */
#ifndef KILN_COORDINATOR_FILES_TEMPORARY_H
#define KILN_COORDINATOR_FILES_TEMPORARY_H

#include "worker/base/status.h"

struct kiln_temporary {
    int descriptor;      /* -1: none */
    char scene_file[32]; /* a path that opens the file in this process */
};

/* Creates an empty file in $TMPDIR or /tmp. Call kiln_temporary_remove afterwards, also after a failure. */
int kiln_temporary_make(struct kiln_temporary *temporary, struct kiln_error *error);
void kiln_temporary_remove(struct kiln_temporary *temporary);

#endif
