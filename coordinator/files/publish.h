/* Atomic publication of files: a file is written under a temporary name in its folder, synced, renamed to its final
 * name, and then the folder is synced.
 *
 * A reader sees the old file or the complete new one, never a part, even after a power cut. The temporary name is
 * derived from the final one (".NAME.part"), so the next attempt replaces the file of a killed process, and nothing
 * accumulates. A process that a signal ends may remove its temporary files (left_behind.h). Each file may therefore
 * have only one writer at a time; with kiln_publish_claim others wait. No symbolic link is followed at either name.
 *
 * A destination is one of two kinds. (DIRECTORY, NAME) is a file in the folder of a bake: no folder on the path may be
 * a link (folder.h), and NAME must be a regular file or not exist. (NULL, PATH) is a path from the user. Its folders
 * may be links; a link at PATH itself is replaced, not followed; a folder is refused. A terminal, /dev/null,
 * /dev/stdout or a pipe with a reader gets the bytes once all of them exist; sockets and disks are refused. None of
 * these functions is collective. */
#ifndef KILN_COORDINATOR_FILES_PUBLISH_H
#define KILN_COORDINATOR_FILES_PUBLISH_H

#include <stddef.h>
#include <stdint.h>

#include "coordinator/files/folder.h"
#include "coordinator/files/left_behind.h"
#include "worker/base/status.h"

/* A mark that kiln writes within the first 4,096 bytes of every page and every PNG. */
#define KILN_MADE_BY "made by kiln"

/* Checks free disk space. KILN_IO, with both numbers, if the file system of the folder `path` has less than 1.1 x
 * `bytes` free for this user. For writers that must not fail halfway: when one rank finds the disk full in a collective
 * HDF5 call, the others wait in that call for ever. */
int kiln_require_space(const char *path, uint64_t bytes, struct kiln_error *error);

/* A file that is being published. */
struct kiln_publish {
    struct kiln_folder folder;      /* the folder of the file; private */
    int stream, scratch;            /* descriptors of a pipe or device and of its buffer; -1: a file. Private */
    struct kiln_left *left;         /* while the temporary file is there; private */
    char base[512], aside[528];     /* final and temporary name in the folder; private */
    char path[KILN_PATH_SIZE];      /* final path, for messages */
    char temporary[KILN_PATH_SIZE]; /* temporary path, for messages */
    char opens[600];                /* a path that opens the temporary file in this process, for libraries */
};

/* The number of this process's descriptor that a path such as "/dev/stdout", "/dev/fd/3" or "/proc/self/fd/3" names; -1
 * for other paths. Opening a file again by such a path would start at its beginning. */
int kiln_own_descriptor(const char *path);

/* Checks, before any work is done, that a file can be published at the destination. Creates nothing. */
int kiln_publish_check(const char *directory, const char *name, struct kiln_error *error);

/* Begins a publication and removes a temporary file that a killed process left. End it with kiln_publish_finish,
 * kiln_publish_abandon or, to leave all files as they are, kiln_publish_close. Each of these may be called after a
 * failure, and twice. KILN_CANNOT_CREATE, KILN_PERMISSION. */
int kiln_publish_begin(struct kiln_publish *p, const char *directory, const char *name, struct kiln_error *error);
void kiln_publish_close(struct kiln_publish *p);

/* Creates the temporary file, which must not exist. The caller closes *descriptor (O_RDWR). */
int kiln_publish_open(struct kiln_publish *p, int *descriptor, struct kiln_error *error);

/* Opens the temporary file that another process has created (O_RDWR), to write a part of it; that process publishes it.
 * End with kiln_publish_close. KILN_IO if it is not there. */
int kiln_publish_join(struct kiln_publish *p, const char *directory, const char *name, int *descriptor,
                      struct kiln_error *error);

/* Begins a publication and creates the temporary file, for a file that several processes may want to write, such as one
 * derived from a scene. The second process waits for the first, and may then find the finished file. *descriptor is an
 * empty file (O_RDWR); closing it after the file was published or abandoned lets the next process in. A temporary file
 * of a killed process is taken over. On a file system without flock no process waits, and callers have to exclude each
 * other. */
int kiln_publish_claim(struct kiln_publish *p, const char *directory, const char *name, int *descriptor,
                       struct kiln_error *error);

/* Removes files whose names begin with the temporary name, which a killed process may have left: MPI-IO keeps locks and
 * file pointers in such files. To be called by one rank, before any rank opens the file. */
void kiln_publish_sweep(const struct kiln_publish *p);

/* Syncs the complete temporary file, renames it, and syncs the folder. On failure the temporary file is removed. */
int kiln_publish_finish(struct kiln_publish *p, struct kiln_error *error);

/* Files that are published together: each is complete under its temporary name, and the batch syncs, renames and then
 * syncs the folder once for all of them. Two syncs for each file, one after the other, take seconds for a thousand
 * small files; a batch starts to write out each file when it is put in, so that the file system makes most of them
 * durable at once. The promise for each file is that of kiln_publish_finish. A batch is for files in the folder of a
 * bake. */
struct kiln_publish_batch;
int kiln_publish_batch_create(struct kiln_publish_batch **batch, struct kiln_error *error);

/* Puts the complete temporary file into the batch and ends *p. On failure the temporary file is removed. May be called
 * by several threads at once. */
int kiln_publish_put(struct kiln_publish_batch *batch, struct kiln_publish *p, struct kiln_error *error);

/* Publishes the files of the batch, which is empty afterwards. No file is renamed before all of them are synced; on
 * failure the temporary files that remain are removed. Not to be called while files are put in. */
int kiln_publish_batch_finish(struct kiln_publish_batch *batch, struct kiln_error *error);

/* Destroys a batch and removes the temporary files of its unpublished files. NULL is allowed. */
void kiln_publish_batch_destroy(struct kiln_publish_batch **batch);

/* Renames without any sync, for files that may be lost in a power cut. On failure the temporary file remains. */
int kiln_publish_replace(struct kiln_publish *p, struct kiln_error *error);

/* Removes the temporary file. For clean-up paths; reports nothing. */
void kiln_publish_abandon(struct kiln_publish *p);

/* Writes all bytes at `offset`; continues after signals and short writes. */
int kiln_write_all(int descriptor, const void *bytes, size_t size, size_t offset, const char *path,
                   struct kiln_error *error);

/* Publishes `size` bytes as the file at the destination: the complete sequence for a small file, which is read back and
 * compared before it is renamed. */
int kiln_publish_bytes_below(const char *directory, const char *name, const void *bytes, size_t size,
                             struct kiln_error *error);
/* Publishes `size` bytes likewise at a path from the user. */
int kiln_publish_bytes(const char *path, const void *bytes, size_t size, struct kiln_error *error);

/* Read an open file from its beginning, otherwise like kiln_read_file. kiln_read_descriptor also closes the file. */
int kiln_read_open(int descriptor, const char *path, size_t limit, char **bytes, size_t *size,
                   struct kiln_error *error);
int kiln_read_descriptor(int descriptor, const char *path, size_t limit, char **bytes, size_t *size,
                         struct kiln_error *error);

/* Reads a complete file of at most `limit` bytes. *bytes is from kiln_allocate and has a zero byte after the last,
 * which *size does not count. KILN_NO_INPUT; KILN_BAD_INPUT if the file is larger. */
int kiln_read_file(const char *path, size_t limit, char **bytes, size_t *size, struct kiln_error *error);

#endif
