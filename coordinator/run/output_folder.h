/* Output folder of a command (-o): begin and end of its use, such that a command can be run again after it was killed
 * or stopped, or after its disk was full.
 *
 * Begin makes the folder, with missing parents. It locks the folder (lock.h) unless the kind is shared. If the command
 * owns the folder, replacing and removing files, begin also writes a mark: DIR/.kiln.unfinished holds the name of the
 * command. The mark is written before any other file, and stays until the command has written its last one. It shows
 * that the files are kiln's: in a marked folder the same command may continue or start over, and removes the temporary
 * files (publish.h) of a killed process. A folder without a mark must be empty or have results of this command. A
 * command that only locks the folder removes a mark, since its files must not be replaced.
 *
 * End unlocks the folder. It removes the folder if this command has made it and nothing but the mark is in it.
 *
 * For one rank; nothing here is collective. */
#ifndef KILN_COORDINATOR_RUN_OUTPUT_FOLDER_H
#define KILN_COORDINATOR_RUN_OUTPUT_FOLDER_H

#include <stdbool.h>

#include "coordinator/run/lock.h"
#include "worker/base/status.h"

enum kiln_output_folder_kind {
    KILN_FOLDER_SHARED, /* several commands at a time, each with its own files: exports, plans */
    KILN_FOLDER_LOCKED, /* one command at a time; may have other files: bakes, views that are continued */
    KILN_FOLDER_OWNED   /* one command at a time, to which all files belong: mixtures, benches */
};

struct kiln_output_folder_params {
    const char *directory;
    enum kiln_output_folder_kind kind;
    const char *owner; /* KILN_FOLDER_OWNED: the command as users write it, at most 63 bytes: "kiln mix" */
    bool (*has_results)(const char *directory, const void *context); /* owned: whether its results exist */
    const void *context;
    bool no_locks; /* for tests: argument of kiln_lock_take */
};

struct kiln_output_folder;

/* Begins to use the folder. KILN_USAGE if the command must own it but it has other files; KILN_CANNOT_CREATE if another
 * process uses it; KILN_PERMISSION, KILN_IO. End with kiln_output_folder_end. */
int kiln_output_folder_begin(struct kiln_output_folder **folder, const struct kiln_output_folder_params *params,
                             struct kiln_error *error);
/* `finished`: all results are there. *folder may be NULL. */
void kiln_output_folder_end(struct kiln_output_folder **folder, bool finished);

/* Lock of the folder, valid until kiln_output_folder_end; NULL if the folder is shared. */
const struct kiln_lock *kiln_output_folder_lock(const struct kiln_output_folder *folder);

#endif
