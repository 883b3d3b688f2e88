#include "coordinator/output/h5.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/calls.h"

/* Deflate level 2 compresses floats to within 1 % of level 9, at several times its speed. */
enum { DEFLATE_LEVEL = 2 };

int kiln_h5_failed(const struct kiln_h5 *h5, const char *act, const char *name, struct kiln_error *error)
{
    if (h5->writing.error.message[0] != '\0')
        return kiln_fail(error, KILN_IO, "%s", h5->writing.error.message);
    if (h5->descriptor >= 0)
        return kiln_fail(error, KILN_IO, "'%s': HDF5 cannot %s '%s'", h5->path, act, name);
    return kiln_fail(error, KILN_IO,
                     "'%s': HDF5 cannot %s '%s' (is the disk full or the file system without MPI-IO support?)",
                     h5->path, act, name);
}

/* Closes an identifier if it is valid; true if that failed. */
static bool release(hid_t id, herr_t (*close)(hid_t)) { return id >= 0 && close(id) < 0; }

/* Makes a creation property list without time stamps, so that equal bakes give equal bytes. */
static hid_t timeless(hid_t class)
{
    const hid_t list = H5Pcreate(class);
    if (list >= 0 && H5Pset_obj_track_times(list, false) < 0) {
        (void)H5Pclose(list);
        return H5I_INVALID_HID;
    }
    return list;
}

static hid_t parallel_access(MPI_Comm communicator)
{
    const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
    if (access >= 0 && (H5Pset_fapl_mpio(access, communicator, MPI_INFO_NULL) < 0 ||
                        H5Pset_all_coll_metadata_ops(access, 1) < 0 || H5Pset_coll_metadata_write(access, 1) < 0 ||
                        H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_LATEST) < 0)) {
        (void)H5Pclose(access);
        return H5I_INVALID_HID;
    }
    return access;
}

static hid_t collective_transfer(void)
{
    const hid_t transfer = H5Pcreate(H5P_DATASET_XFER);
    if (transfer >= 0 && H5Pset_dxpl_mpio(transfer, H5FD_MPIO_COLLECTIVE) < 0) {
        (void)H5Pclose(transfer);
        return H5I_INVALID_HID;
    }
    return transfer;
}

int kiln_h5_create(struct kiln_h5 *h5, MPI_Comm communicator, const struct kiln_publish *place,
                   struct kiln_error *error)
{
    *h5 = KILN_H5_NONE;
    h5->path = place->temporary;
    h5->opens = place->opens;
    h5->communicator = communicator;
    if (MPI_Comm_rank(communicator, &h5->rank) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI cannot give the rank number");
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL); /* kiln prints a message of its own instead of HDF5's error stack */
    const hid_t access = parallel_access(communicator);
    h5->transfer = collective_transfer();
    int status = kiln_agree(
        communicator, access < 0 || h5->transfer < 0 ? kiln_h5_failed(h5, "set up", "parallel access", error) : KILN_OK,
        error);
    if (status == KILN_OK) {
        const hid_t list = timeless(H5P_FILE_CREATE);
        h5->file = H5Fcreate(place->opens, H5F_ACC_EXCL, list, access);
        (void)release(list, H5Pclose);
        if (h5->file < 0)
            status = kiln_fail(error, KILN_CANNOT_CREATE, "'%s' cannot be created as HDF5", place->temporary);
        status = kiln_agree(communicator, status, error);
    }
    if (access >= 0)
        (void)H5Pclose(access);
    if (status != KILN_OK) { /* the file is open on some ranks only, so it cannot be closed collectively */
        (void)release(h5->file, H5Fclose);
        (void)release(h5->transfer, H5Pclose);
        h5->file = h5->transfer = H5I_INVALID_HID;
    }
    return status;
}

int kiln_h5_lay_out(struct kiln_h5 *h5, struct kiln_publish *place, struct kiln_error *error)
{
    *h5 = KILN_H5_NONE;
    h5->path = h5->writing.path = place->temporary;
    h5->opens = place->opens;
    h5->communicator = MPI_COMM_SELF;
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    int status = kiln_publish_open(place, &h5->descriptor, error);
    if (status != KILN_OK)
        return status;
    const hid_t list = timeless(H5P_FILE_CREATE);
    h5->transfer = H5Pcreate(H5P_DATASET_XFER);
    if (list >= 0 && h5->transfer >= 0)
        h5->file = kiln_h5_driver_create(h5->descriptor, place->opens, list, &h5->writing);
    if (release(list, H5Pclose) || h5->file < 0)
        status = kiln_h5_failed(h5, "create", "/", error);
    return status;
}

/* Reserves the place of a chunk: HDF5 enters the chunk and passes its bytes to the driver, which ignores them. So any
 * pointer will do. */
int kiln_h5_place(struct kiln_h5 *h5, hid_t dataset, const char *name, const hsize_t *first, size_t bytes,
                  uint64_t *address, struct kiln_error *error)
{
    h5->writing.address = 0;
    h5->writing.place = true;
    const herr_t done = H5Dwrite_chunk(dataset, H5P_DEFAULT, 0, first, bytes, h5);
    h5->writing.place = false;
    *address = h5->writing.address;
    return done < 0 || *address == 0 ? kiln_h5_failed(h5, "make room for a chunk of", name, error) : KILN_OK;
}

/* Ends the job after a file could not be closed: HDF5 would crash on it in MPI_Finalize. */
static void give_up(const struct kiln_h5 *h5, int status, const struct kiln_error *error)
{
    struct kiln_error path;
    (void)kiln_fail(&path, status, "'%s' cannot be closed", h5->path);
    kiln_end_all_ranks(status, error != NULL ? error : &path);
}

/* Collective. Flushes the file, and repeats that only if a signal interrupted it: after another failure a second sync
 * would succeed and hide that failure. */
static int flush(struct kiln_h5 *h5, struct kiln_error *error)
{
    enum { DONE, INTERRUPTED, FAILED };
    int worst = DONE;
    do {
        errno = 0;
        const bool failed = H5Fflush(h5->file, H5F_SCOPE_GLOBAL) < 0;
        const int own = !failed ? DONE : errno == EINTR ? INTERRUPTED : FAILED;
        (void)MPI_Allreduce(&own, &worst, 1, MPI_INT, MPI_MAX, h5->communicator);
    } while (worst == INTERRUPTED);
    return worst == DONE ? KILN_OK : kiln_h5_failed(h5, "flush", "the file", error);
}

int kiln_h5_close(struct kiln_h5 *h5, int status, struct kiln_error *error)
{
    if (release(h5->transfer, H5Pclose) && status == KILN_OK)
        status = kiln_h5_failed(h5, "release", "the transfer settings", error);
    if (h5->file >= 0) {
        status = kiln_agree(h5->communicator, status, error);
        if (status == KILN_OK)
            status = flush(h5, error); /* the same on all ranks */
        h5->writing.fails = status != KILN_OK;
        if (status != KILN_OK && h5->descriptor < 0) {
            if (h5->rank == 0)
                (void)!truncate(h5->opens, 0); /* the file is useless anyway, so failure does not matter */
            (void)MPI_Barrier(h5->communicator);
        }
        if (H5Fclose(h5->file) < 0)
            give_up(h5, status == KILN_OK ? kiln_h5_failed(h5, "close", "the file", error) : status, error);
    }
    if (h5->descriptor >= 0 && kiln_fsync(h5->descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be synced to disk", h5->path);
    if (h5->descriptor >= 0 && kiln_close(h5->descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be closed", h5->path);
    h5->file = h5->transfer = H5I_INVALID_HID;
    h5->descriptor = -1;
    return status;
}

int kiln_h5_group(struct kiln_h5 *h5, const char *name, struct kiln_error *error)
{
    const hid_t list = timeless(H5P_GROUP_CREATE);
    const hid_t group = list < 0 ? H5I_INVALID_HID : H5Gcreate2(h5->file, name, H5P_DEFAULT, list, H5P_DEFAULT);
    const bool kept_list = release(list, H5Pclose);
    if (group < 0 || H5Gclose(group) < 0 || kept_list)
        return kiln_h5_failed(h5, "create the group", name, error);
    return KILN_OK;
}

static int put_attribute(struct kiln_h5 *h5, hid_t object, const char *name, hid_t type, hid_t space,
                         const void *values, struct kiln_error *error)
{
    const hid_t attribute =
        object < 0 ? H5I_INVALID_HID : H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    bool failed = attribute < 0 || H5Awrite(attribute, type, values) < 0;
    failed = (attribute >= 0 && H5Aclose(attribute) < 0) || failed;
    return failed ? kiln_h5_failed(h5, "write the attribute", name, error) : KILN_OK;
}

static int put_text(struct kiln_h5 *h5, hid_t object, const char *name, const char *text, struct kiln_error *error)
{
    const size_t length = strlen(text);
    const hid_t type = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR);
    int status = type < 0 || space < 0 || H5Tset_size(type, length > 0 ? length : 1) < 0 ||
                         H5Tset_strpad(type, H5T_STR_NULLPAD) < 0 || H5Tset_cset(type, H5T_CSET_UTF8) < 0
                     ? kiln_h5_failed(h5, "describe the attribute", name, error)
                     : put_attribute(h5, object, name, type, space, text, error);
    const bool kept_type = release(type, H5Tclose), kept_space = release(space, H5Sclose);
    if ((kept_type || kept_space) && status == KILN_OK)
        status = kiln_h5_failed(h5, "close the attribute", name, error);
    return status;
}

int kiln_h5_attribute_text(struct kiln_h5 *h5, const char *object, const char *name, const char *text,
                           struct kiln_error *error)
{
    const hid_t id = H5Oopen(h5->file, object, H5P_DEFAULT);
    int status = put_text(h5, id, name, text, error);
    if (id >= 0 && H5Oclose(id) < 0 && status == KILN_OK)
        status = kiln_h5_failed(h5, "close", object, error);
    return status;
}

int kiln_h5_attribute(struct kiln_h5 *h5, const char *object, const char *name, hid_t type, const void *values,
                      size_t count, struct kiln_error *error)
{
    const hsize_t size = count;
    const hid_t id = H5Oopen(h5->file, object, H5P_DEFAULT);
    const hid_t space = count == 1 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &size, NULL);
    int status = space < 0 ? kiln_h5_failed(h5, "describe the attribute", name, error)
                           : put_attribute(h5, id, name, type, space, values, error);
    const bool kept_object = release(id, H5Oclose), kept_space = release(space, H5Sclose);
    if ((kept_object || kept_space) && status == KILN_OK)
        status = kiln_h5_failed(h5, "close the attribute", name, error);
    return status;
}

static hid_t creation_list(const struct kiln_h5_dataset *what)
{
    const hid_t list = timeless(H5P_DATASET_CREATE);
    bool good = list >= 0 && H5Pset_fill_time(list, H5D_FILL_TIME_NEVER) >= 0;
    if (what->chunk[0] != 0)
        good = good && H5Pset_chunk(list, what->rank, what->chunk) >= 0 && H5Pset_shuffle(list) >= 0 &&
               H5Pset_deflate(list, DEFLATE_LEVEL) >= 0;
    if (!good && list >= 0)
        (void)H5Pclose(list);
    return good ? list : H5I_INVALID_HID;
}

int kiln_h5_make(struct kiln_h5 *h5, const struct kiln_h5_dataset *what, hid_t *dataset, struct kiln_error *error)
{
    const hid_t space = H5Screate_simple(what->rank, what->size, NULL), list = creation_list(what);
    *dataset = space < 0 || list < 0
                   ? H5I_INVALID_HID
                   : H5Dcreate2(h5->file, what->name, what->type, space, H5P_DEFAULT, list, H5P_DEFAULT);
    int status = *dataset < 0 ? kiln_h5_failed(h5, "create the dataset", what->name, error)
                              : put_text(h5, *dataset, "units", what->units, error);
    if (status == KILN_OK)
        status = put_text(h5, *dataset, "description", what->description, error);
    const bool kept_space = release(space, H5Sclose), kept_list = release(list, H5Pclose);
    if ((kept_space || kept_list) && status == KILN_OK)
        status = kiln_h5_failed(h5, "describe the dataset", what->name, error);
    status = kiln_agree(h5->communicator, status, error);
    if (status != KILN_OK && *dataset >= 0) {
        (void)H5Dclose(*dataset);
        *dataset = H5I_INVALID_HID;
    }
    return status;
}

/* Collective. Rank 0 writes the whole dataset, the other ranks write nothing. */
static int write_whole(struct kiln_h5 *h5, hid_t dataset, const struct kiln_h5_dataset *what, const void *values,
                       struct kiln_error *error)
{
    const hid_t space = H5Screate_simple(what->rank, what->size, NULL);
    const bool chosen = space >= 0 && (h5->rank == 0 || H5Sselect_none(space) >= 0);
    int status = kiln_agree(h5->communicator,
                            chosen ? KILN_OK : kiln_h5_failed(h5, "select a part of", what->name, error), error);
    if (status == KILN_OK) {
        const herr_t done = H5Dwrite(dataset, what->type, space, space, h5->transfer, values);
        status =
            kiln_agree(h5->communicator, done < 0 ? kiln_h5_failed(h5, "write", what->name, error) : KILN_OK, error);
    }
    if (release(space, H5Sclose) && status == KILN_OK)
        status = kiln_h5_failed(h5, "release a selection of", what->name, error);
    return status;
}

int kiln_h5_small(struct kiln_h5 *h5, const struct kiln_h5_dataset *what, const void *values, struct kiln_error *error)
{
    hid_t dataset = H5I_INVALID_HID;
    int status = kiln_h5_make(h5, what, &dataset, error);
    if (status == KILN_OK && what->size[0] > 0)
        status = write_whole(h5, dataset, what, values, error);
    if (dataset >= 0 && H5Dclose(dataset) < 0 && status == KILN_OK)
        status = kiln_h5_failed(h5, "close the dataset", what->name, error);
    return status;
}
