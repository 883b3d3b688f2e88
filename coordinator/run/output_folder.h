/* The folder that a command writes its results to (-o): everything that commands do with it from before their first
 * file until after their last, so that a command that was killed, was stopped or had no room on its disk can be run
 * again.
 *
 * Begin makes the folder, with missing parents. A folder that the command has for itself (kind) is locked (lock.h). One
 * in which it replaces and removes files is marked too: DIR/.kiln.unfinished holds the name of the command. The mark is
 * written before any other file, and stays until the command has written its last one. It tells kiln's files from those
 * of somebody else: the command of that name goes on where there is a mark, or begins anew, and removes the temporary
 * files (publish.h) of a killed process. Without a mark a folder must be empty, or have results of this command. A
 * command that only locks the folder takes the mark away, for its files are not to be replaced.
 *
 * End unlocks the folder, and removes it if this command has made it and there is nothing in it but the mark.
 *
 * For one rank; nothing here is collective. */
#ifndef KILN_COORDINATOR_RUN_OUTPUT_FOLDER_H
#define KILN_COORDINATOR_RUN_OUTPUT_FOLDER_H

#include <stdbool.h>

#include "coordinator/run/lock.h"
#include "worker/base/status.h"

enum kiln_output_folder_kind {
    KILN_FOLDER_SHARED, /* several commands may write there at a time, each its own files: exports, plans */
    KILN_FOLDER_LOCKED, /* one command at a time, also where others have files: bakes, views that are gone on with */
    KILN_FOLDER_OWNED   /* the same, and all files are the command's: mixtures, benches */
};

struct kiln_output_folder_params {
    const char *directory;
    enum kiln_output_folder_kind kind;
    const char *owner; /* KILN_FOLDER_OWNED: the command as users write it, at most 63 bytes: "kiln mix" */
    bool (*has_results)(const char *directory, const void *context); /* the same: whether the command's are there */
    const void *context;
    bool no_locks; /* for tests: as kiln_lock_take has it */
};

struct kiln_output_folder;

/* KILN_USAGE if the folder must be the command's own and has files of somebody else; KILN_CANNOT_CREATE if another
 * process is at work in it; KILN_PERMISSION, KILN_IO. End with kiln_output_folder_end. */
int kiln_output_folder_begin(struct kiln_output_folder **folder, const struct kiln_output_folder_params *params,
                             struct kiln_error *error);
/* `finished`: all results are there. *folder may be NULL. */
void kiln_output_folder_end(struct kiln_output_folder **folder, bool finished);

/* The lock, as long as the folder; NULL: it is shared. */
const struct kiln_lock *kiln_output_folder_lock(const struct kiln_output_folder *folder);

#endif
