/* A file without a name for a scene that only one command needs: it goes with the process, whatever ends that. */
#ifndef KILN_COORDINATOR_FILES_TEMPORARY_H
#define KILN_COORDINATOR_FILES_TEMPORARY_H

#include "worker/base/status.h"

struct kiln_temporary {
    int descriptor;      /* -1: none */
    char scene_file[32]; /* opens it, in this process */
};

/* Makes an empty file in $TMPDIR or /tmp. Always call kiln_temporary_remove after it, also when it failed. */
int kiln_temporary_make(struct kiln_temporary *temporary, struct kiln_error *error);
void kiln_temporary_remove(struct kiln_temporary *temporary);

#endif
