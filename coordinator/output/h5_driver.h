/* Virtual file driver for HDF5: a file that is open already. It opens nothing itself, neither by name nor for links
 * within the file. Not collective; not for two threads at the same time. */
#ifndef KILN_COORDINATOR_OUTPUT_H5_DRIVER_H
#define KILN_COORDINATOR_OUTPUT_H5_DRIVER_H

#include <hdf5.h>
#include <stdbool.h>
#include <stdint.h>

#include "worker/base/status.h"

/* How a file is written: a chunk may be given its place while its bytes are written by somebody else. */
struct kiln_h5_writing {
    bool place;              /* raw data is not written: where it belongs is noted instead */
    uint64_t address;        /* of what was noted last, bytes from the beginning of the file */
    bool fails;              /* nothing is written any more, and no call fails: for a file that is given up */
    const char *path;        /* for messages */
    struct kiln_error error; /* of what failed last; empty: nothing has */
};

/* Opens the file of so many bytes to read it. `name` is for HDF5's messages alone. */
hid_t kiln_h5_driver_read(int descriptor, uint64_t bytes, const char *name);

/* Creates an HDF5 file in an empty file, which others may write at the same time. `writing` and the descriptor are
 * borrowed until the file is closed. `create` is a property list. Space is given out as the driver of MPI-IO does it,
 * so that a file has the same bytes through either. */
hid_t kiln_h5_driver_create(int descriptor, const char *name, hid_t create, struct kiln_h5_writing *writing);

#endif
