/* Folders below which no symbolic link is followed.
 *
 * The folder of a bake is named by the user, and may itself be a link. What lies in it may have been put there by
 * anybody who can write there, so everything below is reached from an open descriptor, one name after the other, and a
 * link in the place of a folder or a file is refused with a sentence that names it (KILN_CANNOT_CREATE). What is
 * removed is the link, never what it leads to. None of these is collective. */
#ifndef KILN_COORDINATOR_FILES_FOLDER_H
#define KILN_COORDINATOR_FILES_FOLDER_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "worker/base/status.h"

enum { KILN_PATH_SIZE = 4096 };

struct kiln_folder {
    int descriptor;            /* for openat and its like; -1: not open */
    char path[KILN_PATH_SIZE]; /* as the user knows it, for sentences */
};

/* "DIR/NAME" into path. KILN_CANNOT_CREATE when it does not fit. */
int kiln_path_join(char path[KILN_PATH_SIZE], const char *directory, const char *name, struct kiln_error *error);

/* Makes the folder a user named; one that is there already is fine. KILN_CANNOT_CREATE, KILN_PERMISSION. */
int kiln_make_directory(const char *path, struct kiln_error *error);
/* The same with the folders that it lies in. */
int kiln_make_directories(const char *path, struct kiln_error *error);

/* Opens DIRECTORY/BELOW; `below` is NULL or a name such as "lightmaps/back", whose folders are made when missing with
 * `make`. KILN_NO_INPUT when one is missing, KILN_CANNOT_CREATE for a link or a file in its place, KILN_PERMISSION.
 * Close with kiln_folder_close, also after a failure. */
int kiln_folder_open(struct kiln_folder *folder, const char *directory, const char *below, bool make,
                     struct kiln_error *error);
void kiln_folder_close(struct kiln_folder *folder);

/* Syncs the folder's entries to disk. */
int kiln_folder_sync(const struct kiln_folder *folder, struct kiln_error *error);

/* openat in DIRECTORY/NAME's folder, with O_NOFOLLOW and O_CLOEXEC. *descriptor is -1 on failure; a link is
 * KILN_CANNOT_CREATE, else the status is errno's. Only a regular file is opened for reading: KILN_BAD_INPUT for what
 * else there is. */
int kiln_open_below(const char *directory, const char *name, int flags, mode_t mode, int *descriptor,
                    struct kiln_error *error);

/* unlinkat of DIRECTORY/NAME. 0, or -1 and errno: ENOENT where a folder on the way is missing, ELOOP where one is a
 * link. */
int kiln_unlink_below(const char *directory, const char *name);

/* kiln_read_file (publish.h) of DIRECTORY/NAME. */
int kiln_read_file_below(const char *directory, const char *name, size_t limit, char **bytes, size_t *size,
                         struct kiln_error *error);

/* KILN_OK where at DIRECTORY/NAME there is nothing or a regular file (with `folder`: a folder), so that a result can be
 * put there; else KILN_CANNOT_CREATE, with what is in the way. Folders on the way that are missing are fine. */
int kiln_check_below(const char *directory, const char *name, bool folder, struct kiln_error *error);

#endif
