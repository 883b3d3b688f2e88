/* Safe HDF5 reader for files that somebody else may have written: it opens no other file, and reads no more data than
 * the file can contain.
 *
 * The structure of the file is checked before any value is read. Refused are soft and external links, raw data in other
 * files, virtual datasets, committed and variable-length types, filters that kiln does not write, objects with several
 * names, groups nested deeper than kiln's, datasets with missing chunks, and more data than deflate can have compressed
 * into the stored bytes. A virtual file driver of kiln reads the file through a descriptor and opens nothing. HDF5
 * itself can crash on damaged bytes, so files of others must be read in a confined child (reader.h). Not collective;
 * not for two threads at the same time. */
#ifndef KILN_COORDINATOR_OUTPUT_H5_FILE_H
#define KILN_COORDINATOR_OUTPUT_H5_FILE_H

#include <hdf5.h>
#include <stdint.h>

#include "worker/base/status.h"

struct kiln_h5_file;

/* Opens and checks a file. `descriptor` and `path`, which is for messages, are borrowed until the file is closed.
 * KILN_BAD_INPUT if the file is refused. Close with kiln_h5_file_close. */
int kiln_h5_file_open(struct kiln_h5_file **file, int descriptor, const char *path, struct kiln_error *error);
void kiln_h5_file_close(struct kiln_h5_file **file);

hid_t kiln_h5_file_id(const struct kiln_h5_file *file);

/* Calls `visit` for each dataset, with a name such as "/points/albedo", until it returns a status other than KILN_OK.
 * Returns the last status. */
int kiln_h5_file_visit(struct kiln_h5_file *file, int (*visit)(void *context, const char *name, hid_t dataset),
                       void *context, struct kiln_error *error);

#endif
