/* Virtual file driver for HDF5 on an already open file. It opens nothing itself, neither by name nor for links within
 * the file. Not collective; not for two threads at the same time. */
#ifndef KILN_COORDINATOR_OUTPUT_H5_DRIVER_H
#define KILN_COORDINATOR_OUTPUT_H5_DRIVER_H

#include <hdf5.h>
#include <stdbool.h>
#include <stdint.h>

#include "worker/base/status.h"

/* State of writing a file. A chunk's place may be assigned here while another process writes its bytes. */
struct kiln_h5_writing {
    bool place;              /* raw data is not written: only its address is stored */
    uint64_t address;        /* last address stored, bytes from the beginning of the file */
    bool fails;              /* no write is executed any more, and no call fails: for an abandoned file */
    const char *path;        /* for messages */
    struct kiln_error error; /* last failure; empty: none */
};

/* Opens a file of `bytes` bytes for reading. `name` is only for HDF5's messages. */
hid_t kiln_h5_driver_read(int descriptor, uint64_t bytes, const char *name);

/* Creates an HDF5 file in an empty file, which others may write at the same time. `writing` and the descriptor are
 * borrowed until the file is closed. `create` is a property list. Space is allocated as by the MPI-IO driver, so that
 * both produce the same bytes. */
hid_t kiln_h5_driver_create(int descriptor, const char *name, hid_t create, struct kiln_h5_writing *writing);

#endif
