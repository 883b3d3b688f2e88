/* A child process that takes files of results apart, so that no library reads in this process what somebody else may
 * have written.
 *
 * It is handed one open file after another over a socket and can open none itself; memory and CPU time follow the
 * file's size (confined/ fence.h). What comes back is a sentence, some numbers, or a picture's floats in memory that is
 * shared and checked here. A file that makes it die, or takes longer than its size warrants, is KILN_BAD_INPUT with a
 * sentence; the next file gets a new child. Not collective. One reader is for one thread at a time; several readers may
 * work side by side. */
#ifndef KILN_COORDINATOR_OUTPUT_READ_READER_H
#define KILN_COORDINATOR_OUTPUT_READ_READER_H

#include "coordinator/output/image.h"
#include "coordinator/output/volume_eval.h"

struct kiln_reader;

/* `threads` of the child; 0: as many as OpenMP has. The child starts with the first file, and is bound to the thread
 * that reads it first: it dies when that thread ends. Destroy with kiln_reader_destroy, which accepts NULL inside. */
int kiln_reader_create(struct kiln_reader **reader, int threads, struct kiln_error *error);
void kiln_reader_destroy(struct kiln_reader **reader);

/* In all of these `descriptor` is of a plain file open for reading, borrowed; `path` begins the sentences and its
 * ending says what it is. */

/* As kiln_ranges_check (ranges.h). */
int kiln_reader_ranges(struct kiln_reader *reader, int descriptor, const char *path, struct kiln_error *error);
/* As kiln_exr_read (exr.h). */
int kiln_reader_image(struct kiln_reader *reader, int descriptor, const char *path, const char *const *wanted,
                      size_t wanted_count, struct kiln_image **image, struct kiln_error *error);
/* As kiln_volume_light (volume_eval.h) of this volume. */
int kiln_reader_light(struct kiln_reader *reader, int descriptor, const char *path, const double position[3],
                      struct kiln_volume_probe *light, bool *outside, struct kiln_error *error);

/* Not a command for users: the confined child that takes results apart (reader_child.c). argv as it was spawned.
 * Returns its exit status. */
int kiln_reader_child(int argc, char **argv);

#endif
