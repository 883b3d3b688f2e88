#include "coordinator/output/h5_driver.h"

#include <errno.h>
#include <stdlib.h>
#include <unistd.h>

#include "coordinator/files/publish.h"
#include "worker/base/calls.h"

struct source {
    int descriptor;
    uint64_t bytes;
    struct kiln_h5_writing *writing; /* NULL: the file is read */
    bool *opened;                    /* set when the file is opened for writing; a second file is refused */
};

struct file {
    H5FD_t base; /* first member, as HDF5 requires */
    int descriptor;
    haddr_t size, used;
    struct kiln_h5_writing *writing;
};

#define ADDRESS_MOST ((haddr_t)INT64_MAX)

static struct file *file_of(H5FD_t *base) { return (struct file *)(void *)base; }

static H5FD_t *driver_open(const char *name, unsigned flags, hid_t access, haddr_t most)
{
    const struct source *source = H5Pget_driver_info(access);
    struct file *file = NULL;
    (void)name;
    (void)most;
    if (source == NULL || ((flags & H5F_ACC_RDWR) != 0) != (source->writing != NULL) ||
        (source->opened != NULL && *source->opened) || (file = calloc(1, sizeof *file)) == NULL)
        return NULL;
    if (source->opened != NULL)
        *source->opened = true;
    file->descriptor = source->descriptor;
    file->size = source->bytes;
    file->writing = source->writing;
    return &file->base;
}

static herr_t driver_close(H5FD_t *base)
{
    free(base);
    return 0;
}

static int driver_compare(const H5FD_t *a, const H5FD_t *b) { return a < b ? -1 : a > b; }

/* Returns the driver's features; HDF5 asks for them without a file, too. As with MPI-IO, space is allocated early, and
 * writes are not accumulated. */
static herr_t driver_query(const H5FD_t *base, unsigned long *flags)
{
    const bool writes = base != NULL && ((const struct file *)(const void *)base)->writing != NULL;
    *flags = H5FD_FEAT_DEFAULT_VFD_COMPATIBLE |
             (writes ? H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_AGGREGATE_SMALLDATA | H5FD_FEAT_ALLOCATE_EARLY
                     : H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE);
    return 0;
}

static haddr_t driver_used(const H5FD_t *base, H5FD_mem_t type)
{
    (void)type;
    return ((const struct file *)(const void *)base)->used;
}

static herr_t driver_use(H5FD_t *base, H5FD_mem_t type, haddr_t used)
{
    (void)type;
    file_of(base)->used = used;
    return 0;
}

static haddr_t driver_end(const H5FD_t *base, H5FD_mem_t type)
{
    (void)type;
    return ((const struct file *)(const void *)base)->size;
}

static herr_t driver_read(H5FD_t *base, H5FD_mem_t type, hid_t transfer, haddr_t address, size_t size, void *buffer)
{
    const struct file *file = file_of(base);
    char *next = buffer;
    (void)type;
    (void)transfer;
    if (address > file->size || size > file->size - address)
        return -1;
    while (size > 0) {
        const ssize_t got = pread(file->descriptor, next, size, (off_t)address);
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return -1;
        next += got;
        address += (haddr_t)got;
        size -= (size_t)got;
    }
    return 0;
}

static herr_t driver_write(H5FD_t *base, H5FD_mem_t type, hid_t transfer, haddr_t address, size_t size,
                           const void *buffer)
{
    struct file *file = file_of(base);
    struct kiln_h5_writing *writing = file->writing;
    (void)transfer;
    if (writing == NULL)
        return -1;
    file->size = address + size > file->size ? address + size : file->size;
    if (writing->place && type == H5FD_MEM_DRAW)
        writing->address = address;
    else if (!writing->fails)
        return kiln_write_all(file->descriptor, buffer, size, address, writing->path, &writing->error) == KILN_OK ? 0
                                                                                                                  : -1;
    return 0;
}

/* Extends the file to the end of the space given out: all others' data is in it. */
static herr_t driver_truncate(H5FD_t *base, hid_t transfer, hbool_t closing)
{
    struct file *file = file_of(base);
    (void)transfer;
    (void)closing;
    if (file->writing == NULL || file->size == file->used)
        return 0;
    file->size = file->used;
    if (file->writing->fails || kiln_truncate(file->descriptor, (off_t)file->used) == 0)
        return 0;
    (void)kiln_fail_errno(&file->writing->error, KILN_IO, "'%s' cannot be made longer", file->writing->path);
    return -1;
}

static const H5FD_class_t driver = {.name = "kiln_descriptor",
                                    .maxaddr = ADDRESS_MOST,
                                    .fc_degree = H5F_CLOSE_STRONG,
                                    .fapl_size = sizeof(struct source),
                                    .open = driver_open,
                                    .close = driver_close,
                                    .cmp = driver_compare,
                                    .query = driver_query,
                                    .get_eoa = driver_used,
                                    .set_eoa = driver_use,
                                    .get_eof = driver_end,
                                    .read = driver_read,
                                    .write = driver_write,
                                    .truncate = driver_truncate,
                                    .fl_map = H5FD_FLMAP_DICHOTOMY};

/* Makes an access property list that uses the driver. *kind: the driver's identifier, which may be released once the
 * file is open. */
static hid_t access_through(const struct source *source, hid_t *kind)
{
    *kind = H5FDregister(&driver);
    const hid_t access = *kind < 0 ? H5I_INVALID_HID : H5Pcreate(H5P_FILE_ACCESS);
    if (access >= 0 && H5Pset_driver(access, *kind, source) < 0) {
        (void)H5Pclose(access);
        return H5I_INVALID_HID;
    }
    return access;
}

static void leave(hid_t access, hid_t kind)
{
    if (access >= 0)
        (void)H5Pclose(access);
    if (kind >= 0)
        (void)H5FDunregister(kind);
}

hid_t kiln_h5_driver_read(int descriptor, uint64_t bytes, const char *name)
{
    bool opened = false;
    hid_t kind;
    const struct source source = {descriptor, bytes, NULL, &opened};
    const hid_t access = access_through(&source, &kind),
                file = access >= 0 ? H5Fopen(name, H5F_ACC_RDONLY, access) : H5I_INVALID_HID;
    leave(access, kind);
    return file;
}

hid_t kiln_h5_driver_create(int descriptor, const char *name, hid_t create, struct kiln_h5_writing *writing)
{
    hid_t kind;
    const struct source source = {descriptor, 0, writing, NULL};
    const hid_t access = access_through(&source, &kind),
                file = access >= 0 && H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_LATEST) >= 0
                           ? H5Fcreate(name, H5F_ACC_TRUNC, create, access)
                           : H5I_INVALID_HID;
    leave(access, kind);
    return file;
}
