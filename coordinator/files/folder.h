/* Access to files in a folder without following symbolic links.
 *
 * The folder of a bake is named by the user and may itself be a link. Its content may come from anybody who can write
 * there. So everything in it is opened relative to an open descriptor, one path component after the other, and a link
 * in the place of a folder or file is refused with a message that names it (KILN_CANNOT_CREATE). Removing a link
 * removes the link, never its target. None of these functions is collective. */
#ifndef KILN_COORDINATOR_FILES_FOLDER_H
#define KILN_COORDINATOR_FILES_FOLDER_H

#include <stdbool.h>
#include <stddef.h>
#include <sys/types.h>

#include "worker/base/status.h"

enum { KILN_PATH_SIZE = 4096 };

struct kiln_folder {
    int descriptor;            /* for openat and the like; -1: not open */
    char path[KILN_PATH_SIZE]; /* as the user gave it, for messages */
};

/* Writes "DIR/NAME" to `path`. KILN_CANNOT_CREATE if it does not fit. */
int kiln_path_join(char path[KILN_PATH_SIZE], const char *directory, const char *name, struct kiln_error *error);

/* Creates the folder `path` unless it exists, with missing parent folders. KILN_CANNOT_CREATE, KILN_PERMISSION. */
int kiln_make_directories(const char *path, struct kiln_error *error);

/* Opens the folder DIRECTORY/BELOW. `below` is NULL or a relative path such as "lightmaps/back"; with `make` its
 * missing folders are created. KILN_NO_INPUT if one is missing, KILN_CANNOT_CREATE if one is a link or a file,
 * KILN_PERMISSION. Close with kiln_folder_close, also after a failure. */
int kiln_folder_open(struct kiln_folder *folder, const char *directory, const char *below, bool make,
                     struct kiln_error *error);
void kiln_folder_close(struct kiln_folder *folder);

/* Creates the missing folders on the way to DIRECTORY/NAME, likewise. */
int kiln_make_parents(const char *directory, const char *name, struct kiln_error *error);

/* Syncs the folder's entries to disk. */
int kiln_folder_sync(const struct kiln_folder *folder, struct kiln_error *error);

/* Opens the file DIRECTORY/NAME by openat with O_NOFOLLOW and O_CLOEXEC. *descriptor is -1 on failure. The status is
 * KILN_CANNOT_CREATE for a link, KILN_BAD_INPUT for opening anything but a regular file for reading, else it follows
 * from errno. */
int kiln_open_below(const char *directory, const char *name, int flags, mode_t mode, int *descriptor,
                    struct kiln_error *error);

/* Removes DIRECTORY/NAME by unlinkat. Returns 0, or -1 and errno: ENOENT if a folder on the path is missing, ELOOP if
 * one is a link. */
int kiln_unlink_below(const char *directory, const char *name);

/* Removes the folder DIRECTORY/NAME likewise; ENOTEMPTY if it is not empty. */
int kiln_rmdir_below(const char *directory, const char *name);

/* Reads the file DIRECTORY/NAME, as kiln_read_file (publish.h) does. */
int kiln_read_file_below(const char *directory, const char *name, size_t limit, char **bytes, size_t *size,
                         struct kiln_error *error);

/* Checks that a result can be written to DIRECTORY/NAME: KILN_OK if nothing or a regular file (with `folder`: a folder)
 * is there, else KILN_CANNOT_CREATE with a message that says what is there. Folders on the path may be missing. */
int kiln_check_below(const char *directory, const char *name, bool folder, struct kiln_error *error);

#endif
