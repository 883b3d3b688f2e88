/* Help for programs. */
#ifndef KILN_COORDINATOR_CLI_HELP_JSON_H
#define KILN_COORDINATOR_CLI_HELP_JSON_H

#include "worker/base/status.h"

struct kiln_command;

/* Prints the command and its options as one JSON object, with names, values, defaults and the commands that take them;
 * NULL: all commands. KILN_SYSTEM, KILN_IO. */
int kiln_help_json(const struct kiln_command *command, struct kiln_error *error);

#endif
