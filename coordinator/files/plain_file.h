/* Opening files that may be anything: only a plain file is taken, and nobody is waited for. Not collective. */
#ifndef KILN_COORDINATOR_FILES_PLAIN_FILE_H
#define KILN_COORDINATOR_FILES_PLAIN_FILE_H

#include "worker/base/status.h"

/* A file that the user himself named, which may lie behind links: opened for reading without waiting for anybody.
 * KILN_BAD_INPUT when it is no plain file. */
int kiln_open_plain(const char *path, int *descriptor, struct kiln_error *error);

/* The sentence and the status of an open call that failed with errno. Returns the status. */
int kiln_open_failed(const char *path, struct kiln_error *error);

/* KILN_OK when *descriptor belongs to a plain file; otherwise closes it, sets it to -1, and returns KILN_BAD_INPUT. */
int kiln_keep_plain(int *descriptor, const char *path, struct kiln_error *error);

#endif
