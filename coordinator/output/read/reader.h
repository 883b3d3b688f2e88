/* Reader: a confined child process that parses result files, so that no library in this process reads bytes that
 * somebody else may have written.
 *
 * The child receives one open file after the other over a socket and cannot open files itself. Its memory and CPU time
 * are limited according to the size of the file (coordinator/confined/fence.h). It returns a message, some numbers, or
 * the floats of an image in shared memory, which are checked here. A file that crashes the child, or takes longer than
 * its size justifies, is KILN_BAD_INPUT with a message; the next file gets a new child. Not collective. A reader is for
 * one thread at a time; several readers may work at the same time. */
#ifndef KILN_COORDINATOR_OUTPUT_READ_READER_H
#define KILN_COORDINATOR_OUTPUT_READ_READER_H

#include "coordinator/output/image.h"
#include "coordinator/output/volume_eval.h"

struct kiln_reader;

/* `threads`: number of threads of the child; 0: the default of OpenMP. The child is started for the first file, and
 * ends together with the thread that reads that file. Destroy with kiln_reader_destroy; *reader may be NULL. */
int kiln_reader_create(struct kiln_reader **reader, int threads, struct kiln_error *error);
void kiln_reader_destroy(struct kiln_reader **reader);

/* In the following functions `descriptor` is a regular file open for reading, which is borrowed. Messages begin with
 * `path`, whose extension gives the format. */

/* Does the same as kiln_ranges_check (ranges.h). */
int kiln_reader_ranges(struct kiln_reader *reader, int descriptor, const char *path, struct kiln_error *error);
/* Does the same as kiln_exr_read (exr.h); with a path that ends in .h5 or .hdf, as kiln_datasets_read (rows.h) of the
 * datasets `wanted`. */
int kiln_reader_image(struct kiln_reader *reader, int descriptor, const char *path, const char *const *wanted,
                      size_t wanted_count, struct kiln_image **image, struct kiln_error *error);
/* Reads all channels of the file at this path with kiln_reader_image. */
int kiln_reader_image_at(struct kiln_reader *reader, const char *path, struct kiln_image **image,
                         struct kiln_error *error);
/* Does the same as kiln_volume_light (volume_eval.h) for this volume. */
int kiln_reader_light(struct kiln_reader *reader, int descriptor, const char *path, const double position[3],
                      struct kiln_volume_probe *light, struct kiln_volume_place *place, struct kiln_error *error);

/* Main function of the confined child, which parses result files (reader_child.c); not a command for users. argv is as
 * it was spawned. Returns the exit status. */
int kiln_reader_child(int argc, char **argv);

#endif
