/* An HDF5 file that somebody else may have written, opened so that nothing but its own bytes is read, and never more
 * than they can hold.
 *
 * All of it is looked at before a value is read. Refused are soft and external links, raw data in other files, virtual
 * datasets, committed and variable-length types, filters other than those kiln writes, objects with several names,
 * groups deeper than kiln's own, datasets with missing chunks, and more data than deflate can have packed into what is
 * stored. The file is read through a descriptor by a driver of its own, which opens nothing else. HDF5 itself can crash
 * on damaged bytes: who reads files of others does so in a confined child (reader.h). Not collective, not for two
 * threads at once. */
#ifndef KILN_COORDINATOR_OUTPUT_H5_FILE_H
#define KILN_COORDINATOR_OUTPUT_H5_FILE_H

#include <hdf5.h>
#include <stdint.h>

#include "worker/base/status.h"

struct kiln_h5_file;

/* `descriptor` is borrowed and open as long as the file; `path` is for sentences, borrowed too. KILN_BAD_INPUT. Close
 * with kiln_h5_file_close. */
int kiln_h5_file_open(struct kiln_h5_file **file, int descriptor, const char *path, struct kiln_error *error);
void kiln_h5_file_close(struct kiln_h5_file **file);

hid_t kiln_h5_file_id(const struct kiln_h5_file *file);

/* Calls `visit` for each dataset ("/points/albedo") until it returns something else than KILN_OK, which is returned. */
int kiln_h5_file_visit(struct kiln_h5_file *file, int (*visit)(void *context, const char *name, hid_t dataset),
                       void *context, struct kiln_error *error);

#endif
