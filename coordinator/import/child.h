/* How the parent and the confined child talk: argv one way, one text the other (confined.h); and what a child does to
 * itself first.
 *
 * OUTPUT is only for sentences: the result goes to the descriptor KILN_CHILD_OUTPUT (confined.h).
 *
 * argv: PROGRAM import-child PATH OUTPUT TEXELS_PER_METRE SIZE MAX ENVIRONMENT SCALE ROTATION MEMORY SECONDS
 * PROGRAM_HASH OBJECTS TRUST REPACK */
#ifndef KILN_COORDINATOR_IMPORT_CHILD_H
#define KILN_COORDINATOR_IMPORT_CHILD_H

#include "coordinator/import/confine.h"
#include "coordinator/import/import.h"

enum { KILN_CHILD_ARGUMENTS = 16 };

/* Dies with the parent; limits on memory, CPU time, open files and file size; a fence around files: the folder of
 * params->path and params->environment may be read. Nothing may be opened for writing: the result goes to
 * KILN_CHILD_OUTPUT, which the parent opened. */
void kiln_child_confine(const struct kiln_import_params *params);

/* For struct kiln_confine's `mapped`: lets the limits that were not set by the user follow the bytes of the scene's
 * files. */
void (*kiln_child_follower(const struct kiln_import_params *params))(const struct kiln_confine *);

/* The child's last word on standard output: status and sentence. */
void kiln_child_answer(int status, const char *sentence);

/* Not a command for users: the confined child that reads a scene (child.c). argv as it was spawned. Returns its exit
 * status. */
int kiln_import_child(int argc, char **argv);

#endif
