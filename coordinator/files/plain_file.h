/* Opening of regular files: refuses everything else and never blocks. Not collective. */
#ifndef KILN_COORDINATOR_FILES_PLAIN_FILE_H
#define KILN_COORDINATOR_FILES_PLAIN_FILE_H

#include "worker/base/status.h"

/* Opens a file that the user named, whose path may contain links, for reading without blocking. KILN_BAD_INPUT if it is
 * not a regular file. */
int kiln_open_plain(const char *path, int *descriptor, struct kiln_error *error);

/* Opens the file `name` of an open folder with `flags` of open(2), without following a link and without blocking.
 * `path` is for messages. *descriptor is -1 on failure. KILN_NO_INPUT if it is missing; KILN_BAD_INPUT if it is a link
 * or not a regular file; with O_CREAT KILN_CANNOT_CREATE if it cannot be made. */
int kiln_openat_plain(int folder, const char *name, int flags, const char *path, int *descriptor,
                      struct kiln_error *error);

/* Sets the message for an open call that failed with errno, and returns its status. */
int kiln_open_failed(const char *path, struct kiln_error *error);

/* Returns KILN_OK if *descriptor is a regular file; otherwise closes it, sets it to -1 and returns KILN_BAD_INPUT. */
int kiln_keep_plain(int *descriptor, const char *path, struct kiln_error *error);

#endif
