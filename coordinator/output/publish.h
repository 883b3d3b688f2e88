/* How a file gets its final name: written aside in the same folder, synced, renamed, folder synced.
 *
 * A reader sees the old file or the whole new one, never a part, also after a power cut. The name used meanwhile is fixed by
 * the target (".NAME.part"), so what a killed process left is replaced by the next attempt and nothing piles up; a folder
 * therefore has one writer a file at a time (kiln_publish_claim lets others wait). No symbolic link is followed at either name. None of
 * these is collective. */
#ifndef KILN_COORDINATOR_OUTPUT_PUBLISH_H
#define KILN_COORDINATOR_OUTPUT_PUBLISH_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

enum { KILN_PATH_SIZE = 4096 };

/* Stands within the first 4,096 bytes of every page and every PNG that kiln writes. */
#define KILN_MADE_BY "made by kiln"

/* "DIR/NAME" into path. KILN_CANNOT_CREATE when it does not fit. */
int kiln_path_join(char path[KILN_PATH_SIZE], const char *directory, const char *name, struct kiln_error *error);

/* Makes a folder; one that is there already is fine. KILN_CANNOT_CREATE, KILN_PERMISSION. */
int kiln_make_directory(const char *path, struct kiln_error *error);
/* The same with the folders that it lies in. */
int kiln_make_directories(const char *path, struct kiln_error *error);

/* KILN_IO when the file system of the folder `path` has not `bytes` and a tenth more to give (to this user), with both numbers.
 * For writers that cannot fail halfway: a rank whose part of a collective HDF5 call finds the disk full leaves the others
 * waiting in it for ever. */
int kiln_require_space(const char *path, uint64_t bytes, struct kiln_error *error);

/* The name to write `path` under for now; removes what a killed process left there. */
int kiln_publish_name(char temporary[KILN_PATH_SIZE], const char *path, struct kiln_error *error);

/* Removes what a killed process left at names that begin with `temporary` and go on: MPI-IO keeps locks and file pointers in files of its own
 * beside the one it opens, some of them named after a process. For one rank, before any opens the file. */
void kiln_publish_sweep(const char *temporary);

/* Opens a temporary name for writing, which must not exist. The caller closes *descriptor. */
int kiln_publish_open(const char *temporary, int *descriptor, struct kiln_error *error);

/* Both for a file that several processes may be about to write, as they may for one that is made from a scene: whoever comes second waits
 * for the first, and may then find that there is nothing left to do. *descriptor is an empty file, O_RDWR, which others may open by its
 * name; closing it, after the file was renamed or removed, lets the next one in. What a killed process left is taken over. Where the
 * file system has no locks (flock), nobody waits: then one at a time is the callers' business. */
int kiln_publish_claim(char temporary[KILN_PATH_SIZE], const char *path, int *descriptor, struct kiln_error *error);

/* Syncs the complete file at `temporary`, renames it to `path`, syncs the folder. On failure the temporary file is removed. */
int kiln_publish_finish(const char *temporary, const char *path, struct kiln_error *error);

/* Removes what was written so far; for clean-up paths, so it has nothing to say. */
void kiln_publish_abandon(const char *temporary);

/* Writes all bytes at `offset`, through interruptions and short writes. */
int kiln_write_all(int descriptor, const void *bytes, size_t size, size_t offset, const char *path, struct kiln_error *error);

/* Publishes `size` bytes as the file `path`: the whole sequence for a small file, read back and compared before the rename. */
int kiln_publish_bytes(const char *path, const void *bytes, size_t size, struct kiln_error *error);

/* Reads a whole file of at most `limit` bytes; *bytes is from kiln_allocate, with a zero byte after the last (not counted in
 * *size). KILN_NO_INPUT, KILN_BAD_INPUT when it is larger. */
int kiln_read_file(const char *path, size_t limit, char **bytes, size_t *size, struct kiln_error *error);

#endif
