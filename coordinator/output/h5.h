/* HDF5 writer: a thin layer over HDF5 that checks every return value. It works through MPI-IO, or for one process that
 * lays out the file while others write its chunks. Private to coordinator/output.
 *
 * HDF5 reports a failure once (-1), and then success at flush and close; so the first failure is remembered here.
 * HDF5's error output is disabled for the thread while a file is written; our messages name the file and the
 * dataset. */
#ifndef KILN_COORDINATOR_OUTPUT_H5_H
#define KILN_COORDINATOR_OUTPUT_H5_H

#include <hdf5.h>
#include <mpi.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/files/publish.h"
#include "coordinator/output/h5_driver.h"
#include "worker/base/status.h"

/* A file that is open for writing. */
struct kiln_h5 {
    hid_t file, transfer;     /* transfer: property list of collective transfers */
    const char *path, *opens; /* path for messages; path that opens the file */
    MPI_Comm communicator;
    int rank;
    int descriptor; /* of a file laid out by one process; else -1 */
    struct kiln_h5_writing writing;
};

/* A file that is not open. */
#define KILN_H5_NONE                                                                                                   \
    (struct kiln_h5) { .file = H5I_INVALID_HID, .transfer = H5I_INVALID_HID, .descriptor = -1 }

/* Collective. Creates the temporary file of `place` (publish.h; begun on every rank and borrowed until the file is
 * closed), with collective metadata and the latest format that HDF5 1.10 can read. On failure nothing is open. */
int kiln_h5_create(struct kiln_h5 *h5, MPI_Comm communicator, const struct kiln_publish *place,
                   struct kiln_error *error);

/* Creates the file for this process alone, not collective: `h5`, which must stay in place until the file is closed, has
 * MPI_COMM_SELF as its communicator. kiln_h5_place assigns the places of chunks; other processes write them, through
 * their own descriptors. The bytes are those of a file created through MPI-IO. */
int kiln_h5_lay_out(struct kiln_h5 *h5, struct kiln_publish *place, struct kiln_error *error);

/* Assigns a place to a chunk of a laid-out file: `bytes` compressed bytes at *address. `first` is its first element. */
int kiln_h5_place(struct kiln_h5 *h5, hid_t dataset, const char *name, const hsize_t *first, size_t bytes,
                  uint64_t *address, struct kiln_error *error);

/* Collective; the ranks agree on the worst `status`. Flushes and closes the file, also after a failure. Returns
 * `status` if that is not KILN_OK. A new file that failed is truncated first, because HDF5 1.10 cannot close a file
 * whose last bytes do not fit the disk, and then crashes in MPI_Finalize. If the file still cannot be closed, the
 * message is printed and the job aborted with the status, so that the failure is not taken for a lost rank. */
int kiln_h5_close(struct kiln_h5 *h5, int status, struct kiln_error *error);

/* Collective; the same arguments on all ranks. Creates a group. */
int kiln_h5_group(struct kiln_h5 *h5, const char *name, struct kiln_error *error);

/* Collective; the same arguments on all ranks. Write an attribute of the object `object` ("/" for the file). */
int kiln_h5_attribute_text(struct kiln_h5 *h5, const char *object, const char *name, const char *text,
                           struct kiln_error *error);
int kiln_h5_attribute(struct kiln_h5 *h5, const char *object, const char *name, hid_t type, const void *values,
                      size_t count, struct kiln_error *error);

enum { KILN_H5_RANK_MAX = 4 };

/* Description of a dataset: sizes (slowest dimension first), chunk sizes (0 in chunk[0]: contiguous, for small
 * datasets), and the values of its attributes. */
struct kiln_h5_dataset {
    const char *name;
    hid_t type;
    int rank;
    hsize_t size[KILN_H5_RANK_MAX], chunk[KILN_H5_RANK_MAX];
    const char *units, *description;
};

/* Collective. Creates the dataset and its two attributes. Chunked datasets use shuffle and a low level of deflate; fill
 * values are never written. Close *dataset with H5Dclose. */
int kiln_h5_make(struct kiln_h5 *h5, const struct kiln_h5_dataset *what, hid_t *dataset, struct kiln_error *error);

/* Collective. Creates a small contiguous dataset, which rank 0 writes. */
int kiln_h5_small(struct kiln_h5 *h5, const struct kiln_h5_dataset *what, const void *values, struct kiln_error *error);

/* The message that `act` ("written", ...) failed for the dataset or attribute `name`; returns its status. */
int kiln_h5_failed(const struct kiln_h5 *h5, const char *act, const char *name, struct kiln_error *error);

#endif
