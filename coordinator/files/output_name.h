/* Output name check: verifies, before any work is done, that a command may write to the path the user gave. */
#ifndef KILN_COORDINATOR_FILES_OUTPUT_NAME_H
#define KILN_COORDINATOR_FILES_OUTPUT_NAME_H

#include "worker/base/status.h"

struct kiln_output_name {
    const char *option; /* "--output" */
    const char *path;
    const char *inputs[4]; /* files that the command reads; NULL: unused */
    const char *bakes[2];  /* folders of bakes that it uses, whose files it must not replace; NULL: unused */
};

/* KILN_USAGE if the path is one of the inputs or a file that a bake itself writes; else the result of
 * kiln_publish_check. Creates nothing. Not collective. */
int kiln_output_name_check(const struct kiln_output_name *name, struct kiln_error *error);

#endif
