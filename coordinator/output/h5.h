/* HDF5 with every return value looked at, alone or through MPI-IO. Private to coordinator/output.
 *
 * Errors: HDF5 says -1 once and then, at flush and close, that all is well; so each call's result is kept. Its own
 * printing is turned off for the thread while a file is written; what we say names the file and the dataset. */
#ifndef KILN_COORDINATOR_OUTPUT_H5_H
#define KILN_COORDINATOR_OUTPUT_H5_H

#include <hdf5.h>
#include <mpi.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/files/publish.h"
#include "worker/base/status.h"

/* An open file and how it is written. */
struct kiln_h5 {
    hid_t file, transfer;     /* transfer: collective */
    const char *path, *opens; /* for sentences; to open it by */
    MPI_Comm communicator;
    int rank;
};

/* Collective. Makes the file aside new (publish.h, where it was begun on every rank; borrowed until it is closed;
 * latest format that HDF5 1.10 readers know, collective metadata). On failure nothing is open. */
int kiln_h5_create(struct kiln_h5 *h5, MPI_Comm communicator, const struct kiln_publish *place,
                   struct kiln_error *error);

/* Collective; the ranks agree on the worst `status`. Flushes and closes; closes also what failed before. Returns
 * `status` when it is not 0. A new file that failed is emptied first: HDF5 1.10 cannot let go of a file whose last
 * bytes do not fit the disk, and brings the process down in MPI_Finalize; emptied, there is room. Where it cannot be
 * closed all the same, the sentence is told and the job aborted with the status, so that it is not taken for a rank
 * that was lost. */
int kiln_h5_close(struct kiln_h5 *h5, int status, struct kiln_error *error);

/* Collective; same arguments on all ranks. */
int kiln_h5_group(struct kiln_h5 *h5, const char *name, struct kiln_error *error);

/* Collective; same arguments on all ranks. Attributes of the object called `object` ("/" for the file). */
int kiln_h5_attribute_text(struct kiln_h5 *h5, const char *object, const char *name, const char *text,
                           struct kiln_error *error);
int kiln_h5_attribute(struct kiln_h5 *h5, const char *object, const char *name, hid_t type, const void *values,
                      size_t count, struct kiln_error *error);

enum { KILN_H5_RANK_MAX = 4 };

/* A dataset to be: sizes (slowest first), chunk sizes (0 in chunk[0]: contiguous, for small ones), and what must be
 * said. */
struct kiln_h5_dataset {
    const char *name;
    hid_t type;
    int rank;
    hsize_t size[KILN_H5_RANK_MAX], chunk[KILN_H5_RANK_MAX];
    const char *units, *description;
};

/* Collective. Makes the dataset (chunked ones with shuffle and deflate at a low level, fill values never written) and
 * its two attributes. Close *dataset with H5Dclose. */
int kiln_h5_make(struct kiln_h5 *h5, const struct kiln_h5_dataset *what, hid_t *dataset, struct kiln_error *error);

/* Collective. Makes a small contiguous dataset that rank 0 writes whole. */
int kiln_h5_small(struct kiln_h5 *h5, const struct kiln_h5_dataset *what, const void *values, struct kiln_error *error);

int kiln_h5_failed(const struct kiln_h5 *h5, const char *act, const char *name, struct kiln_error *error);

#endif
