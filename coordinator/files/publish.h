/* How a file gets its final name: written aside in the same folder, synced, renamed, folder synced.
 *
 * A reader sees the old file or the whole new one, never a part, also after a power cut. The name used meanwhile is
 * fixed by the target (".NAME.part"), so what a killed process left is replaced by the next attempt and nothing piles
 * up; a folder therefore has one writer a file at a time (kiln_publish_claim lets others wait). No symbolic link is
 * followed at either name.
 *
 * A place is either below the folder of a bake, (DIRECTORY, NAME): then no folder on the way may be a link either
 * (folder.h), and what stands at NAME must be a regular file, or nothing. Or it is a path that a user gave, (NULL,
 * PATH): its folders may be links. A link at PATH itself is replaced, not followed; a folder is refused; a terminal,
 * /dev/null, /dev/stdout or a pipe that somebody reads gets the bytes as they are, once all are there; sockets and
 * disks are refused. None of these is collective. */
#ifndef KILN_COORDINATOR_FILES_PUBLISH_H
#define KILN_COORDINATOR_FILES_PUBLISH_H

#include <stddef.h>
#include <stdint.h>

#include "coordinator/files/folder.h"
#include "worker/base/status.h"

/* Stands within the first 4,096 bytes of every page and every PNG that kiln writes. */
#define KILN_MADE_BY "made by kiln"

/* KILN_IO when the file system of the folder `path` has not `bytes` and a tenth more to give (to this user), with both
 * numbers. For writers that cannot fail halfway: a rank whose part of a collective HDF5 call finds the disk full leaves
 * the others waiting in it for ever. */
int kiln_require_space(const char *path, uint64_t bytes, struct kiln_error *error);

/* A file on its way to its name. */
struct kiln_publish {
    struct kiln_folder folder;      /* that it lies in; private */
    int stream, scratch;            /* of a pipe or device: that, and the bytes meanwhile; -1: a file. Private */
    char base[512], aside[528];     /* names in the folder; private */
    char path[KILN_PATH_SIZE];      /* the final name, and */
    char temporary[KILN_PATH_SIZE]; /* the name aside, as the user knows them: for sentences */
    char opens[600];                /* opens the file aside, in this process: for libraries that want a name */
};

/* "/dev/stdout", "/dev/fd/3", "/proc/self/fd/3": the number of a descriptor of this process; -1: another name. A file
 * opened anew by such a name would be written from its beginning. */
int kiln_own_descriptor(const char *path);

/* Looks whether a file can be published at the place, and leaves nothing: better said before the work than after it. */
int kiln_publish_check(const char *directory, const char *name, struct kiln_error *error);

/* Begins; removes what a killed process left aside. Ends with kiln_publish_finish, kiln_publish_abandon or, without
 * touching any file, kiln_publish_close; all of them may be called after a failure, and twice. KILN_CANNOT_CREATE,
 * KILN_PERMISSION. */
int kiln_publish_begin(struct kiln_publish *p, const char *directory, const char *name, struct kiln_error *error);
void kiln_publish_close(struct kiln_publish *p);

/* Makes the file aside, which must not exist. The caller closes *descriptor (O_RDWR). */
int kiln_publish_open(struct kiln_publish *p, int *descriptor, struct kiln_error *error);

/* Both for a file that several processes may be about to write, as they may for one that is made from a scene: whoever
 * comes second waits for the first, and may then find that there is nothing left to do. *descriptor is an empty file,
 * O_RDWR; closing it, after the file was published or abandoned, lets the next one in. What a killed process left is
 * taken over. Where the file system has no locks (flock), nobody waits: then one at a time is the callers' business. */
int kiln_publish_claim(struct kiln_publish *p, const char *directory, const char *name, int *descriptor,
                       struct kiln_error *error);

/* Removes what a killed process left at names that begin with the one aside and go on: MPI-IO keeps locks and file
 * pointers in files of its own beside the one it opens, some of them named after a process. For one rank, before any
 * opens the file. */
void kiln_publish_sweep(const struct kiln_publish *p);

/* Opens the file aside again, to read it back. The caller closes *descriptor. */
int kiln_publish_reopen(const struct kiln_publish *p, int *descriptor, struct kiln_error *error);

/* Syncs the complete file aside, renames it, syncs the folder. On failure the file aside is removed. */
int kiln_publish_finish(struct kiln_publish *p, struct kiln_error *error);

/* The same without syncing anything, for what a power cut may take. On failure it is still aside. */
int kiln_publish_replace(struct kiln_publish *p, struct kiln_error *error);

/* Removes what was written so far; for clean-up paths, so it has nothing to say. */
void kiln_publish_abandon(struct kiln_publish *p);

/* Writes all bytes at `offset`, through interruptions and short writes. */
int kiln_write_all(int descriptor, const void *bytes, size_t size, size_t offset, const char *path,
                   struct kiln_error *error);

/* Publishes `size` bytes as the file at the place: the whole sequence for a small file, read back and compared before
 * the rename. */
int kiln_publish_bytes_below(const char *directory, const char *name, const void *bytes, size_t size,
                             struct kiln_error *error);
/* The same at a path that a user gave. */
int kiln_publish_bytes(const char *path, const void *bytes, size_t size, struct kiln_error *error);

/* The same as kiln_read_file for what is open, wherever it was read up to; the second closes it. */
int kiln_read_open(int descriptor, const char *path, size_t limit, char **bytes, size_t *size,
                   struct kiln_error *error);
int kiln_read_descriptor(int descriptor, const char *path, size_t limit, char **bytes, size_t *size,
                         struct kiln_error *error);

/* Reads a whole file of at most `limit` bytes; *bytes is from kiln_allocate, with a zero byte after the last (not
 * counted in *size). KILN_NO_INPUT, KILN_BAD_INPUT when it is larger. */
int kiln_read_file(const char *path, size_t limit, char **bytes, size_t *size, struct kiln_error *error);

#endif
