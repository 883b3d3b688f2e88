/* What stands at the name that a command is to write to, looked at before any work is done. */
#ifndef KILN_COORDINATOR_FILES_OUTPUT_NAME_H
#define KILN_COORDINATOR_FILES_OUTPUT_NAME_H

#include "worker/base/status.h"

struct kiln_output_name {
    const char *option; /* "--output" */
    const char *path;
    const char *inputs[4]; /* files that the command reads; NULL: none there */
    const char *bakes[2];  /* folders of bakes that it reads or writes: their files are not to be replaced by it */
};

/* KILN_USAGE where it is one of the inputs, or a file that a bake itself writes; else as kiln_publish_check says.
 * Leaves nothing. Not collective. */
int kiln_output_name_check(const struct kiln_output_name *name, struct kiln_error *error);

#endif
