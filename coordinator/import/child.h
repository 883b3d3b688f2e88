/* The import child: how the parent calls it (its argv; the answer is described in confined.h), and how the child
 * restricts itself before it reads anything.
 *
 * argv: PROGRAM import-child PATH OUTPUT TEXELS_PER_METRE SIZE MAX ENVIRONMENT SCALE ROTATION MEMORY SECONDS
 *       PROGRAM_HASH OBJECTS TRUST LAYOUT CHANGES UP UNIT STRICT
 *
 * OUTPUT is used in sentences only: the result goes to the descriptor KILN_CHILD_OUTPUT (confined.h). */
#ifndef KILN_COORDINATOR_IMPORT_CHILD_H
#define KILN_COORDINATOR_IMPORT_CHILD_H

#include "coordinator/import/confine.h"
#include "coordinator/import/import.h"

enum { KILN_CHILD_ARGUMENTS = 21 };

/* Restricts this process: it dies with its parent, and memory, CPU time, open files and file size are limited. If the
 * kernel has Landlock, only the folders of params->path and params->environment can be read. No file may be opened for
 * writing: the result goes to KILN_CHILD_OUTPUT, which the parent opened. */
void kiln_child_confine(const struct kiln_import_params *params);

/* Returns a callback for the `mapped` field of struct kiln_confine. It raises the limits that the user has not set in
 * proportion to the bytes of the scene's files. */
void (*kiln_child_follower(const struct kiln_import_params *params))(const struct kiln_confine *);

/* Writes the child's answer to standard output: status and sentence. Call it last. */
void kiln_child_answer(int status, const char *sentence);

/* Runs the confined child that reads a scene (child.c); not a command for users. argv as spawned. Returns its exit
 * status. */
int kiln_import_child(int argc, char **argv);

#endif
