#include "coordinator/output/h5_file.h"

#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/job/job.h"
#include "coordinator/output/h5_driver.h"
#include "worker/base/memory.h"

/* Limits of files. kiln's own have at most groups within groups, a dozen objects in each, and chunks of 0.5 MiB. */
enum {
    DEPTH_MOST = 4,
    LINKS_MOST = 256,
    OBJECTS_MOST = 1024 + 2 * KILN_GROUPS_MAX,
    ATTRIBUTES_MOST = 64,
    NAME_SIZE = 512,
    RANK_MOST = 4,
    STRING_MOST = 1 << 16
};
#define CHUNK_BYTES_MOST ((uint64_t)16 << 20)
#define DEFLATE_MOST 1100u /* the compression ratio of deflate is 1,032 at most */
/* Limit of the uncompressed size of all datasets: a constant, plus a multiple of the stored size. The volume of a scene
 * without light compresses 50 : 1. */
#define INFLATED_ALWAYS ((uint64_t)256 << 20)
#define INFLATED_MOST 100u

struct kiln_h5_file {
    const char *path;
    hid_t id;
    uint64_t bytes;
    uint64_t stored, inflated; /* sizes of the datasets so far, bytes */
    unsigned objects;
    int (*visit)(void *context, const char *name, hid_t dataset);
    void *context;
    int status;
    struct kiln_error *error;
};

/* ---- checks ---- */

static int refuse(struct kiln_h5_file *f, const char *name, const char *what)
{
    f->status = kiln_fail(f->error, KILN_BAD_INPUT,
                          "'%s': %.200s %s: kiln writes no such file, it is damaged or somebody else's; bake again",
                          f->path, name, what);
    return f->status;
}

static bool type_is_plain(hid_t type)
{
    const H5T_class_t class = H5Tget_class(type);
    const size_t size = H5Tget_size(type);
    if (H5Tcommitted(type) != 0 || size == 0)
        return false;
    if (class == H5T_STRING)
        return H5Tis_variable_str(type) == 0 && size <= STRING_MOST;
    return (class == H5T_INTEGER || class == H5T_FLOAT) && size <= 8;
}

/* a x b, saturated. */
static uint64_t times(uint64_t a, uint64_t b)
{
    uint64_t product;
    return __builtin_mul_overflow(a, b, &product) ? UINT64_MAX : product;
}

static bool filters_are_ours(hid_t list)
{
    const int count = H5Pget_nfilters(list);
    bool good = count >= 0 && count <= 3;
    for (int i = 0; good && i < count; i++) {
        unsigned flags, values[8];
        size_t value_count = sizeof values / sizeof *values;
        const H5Z_filter_t filter = H5Pget_filter2(list, (unsigned)i, &flags, &value_count, values, 0, NULL, NULL);
        good = filter == H5Z_FILTER_DEFLATE || filter == H5Z_FILTER_SHUFFLE || filter == H5Z_FILTER_FLETCHER32;
    }
    return good;
}

/* Storage of a dataset, in bytes and chunks. */
struct storage {
    hsize_t size[RANK_MOST];
    int rank;
    uint64_t type_size, values, stored;
};

static int check_chunks(struct kiln_h5_file *f, const char *name, hid_t dataset, hid_t space, hid_t list,
                        const struct storage *s)
{
    hsize_t chunk[RANK_MOST], there = 0;
    uint64_t wanted = 1, bytes = s->type_size;
    if (H5Pget_chunk(list, RANK_MOST, chunk) != s->rank)
        return refuse(f, name, "has chunks of another shape than its values");
    for (int d = 0; d < s->rank; d++) {
        if (chunk[d] == 0)
            return refuse(f, name, "has chunks without values");
        wanted = times(wanted, s->size[d] / chunk[d] + (s->size[d] % chunk[d] != 0));
        bytes = times(bytes, chunk[d]);
    }
    if (bytes > CHUNK_BYTES_MOST)
        return refuse(f, name, "has chunks of more than 16 MiB");
    /* a chunk takes at least one byte, and more in the index */
    if (wanted > f->bytes || H5Dget_num_chunks(dataset, space, &there) < 0 || there != wanted)
        return refuse(f, name, "claims values that are not stored");
    if (times(wanted, bytes) / DEFLATE_MOST > s->stored + 64)
        return refuse(f, name, "claims more values than its bytes can hold");
    f->inflated += times(wanted, bytes);
    return KILN_OK;
}

static int check_total(struct kiln_h5_file *f, const char *name)
{
    if (f->stored > f->bytes)
        return refuse(f, name, "is stored in bytes that other datasets have too, or that the file has not");
    if (f->inflated > INFLATED_ALWAYS + times(INFLATED_MOST, f->bytes))
        return refuse(f, name,
                      "would take more than 256 MiB and a hundred times the file's size when it is uncompressed");
    return KILN_OK;
}

static int check_storage(struct kiln_h5_file *f, const char *name, hid_t dataset, hid_t space, hid_t list,
                         struct storage *s)
{
    s->rank = H5Sget_simple_extent_ndims(space);
    if (s->rank < 0 || s->rank > RANK_MOST ||
        (s->rank > 0 && H5Sget_simple_extent_dims(space, s->size, NULL) != s->rank))
        return refuse(f, name, "has more than four dimensions");
    s->values = H5Sget_simple_extent_type(space) == H5S_NULL ? 0 : 1;
    for (int d = 0; d < s->rank; d++)
        s->values = times(s->values, s->size[d]);
    s->stored = H5Dget_storage_size(dataset);
    f->stored += s->stored < f->bytes ? s->stored : f->bytes + 1;
    const H5D_layout_t layout = H5Pget_layout(list);
    if (layout == H5D_CHUNKED) {
        if (check_chunks(f, name, dataset, space, list, s) != KILN_OK)
            return f->status;
    } else if (layout != H5D_CONTIGUOUS && layout != H5D_COMPACT) {
        return refuse(f, name, "is put together from other files or datasets");
    } else if (times(s->values, s->type_size) > s->stored) {
        return refuse(f, name, "claims values that are not stored");
    } else {
        f->inflated += times(s->values, s->type_size);
    }
    return check_total(f, name);
}

static int check_dataset(void *context, const char *name, hid_t dataset)
{
    struct kiln_h5_file *f = context;
    struct storage storage = {.rank = 0};
    const hid_t type = H5Dget_type(dataset), space = H5Dget_space(dataset), list = H5Dget_create_plist(dataset);
    if (type < 0 || space < 0 || list < 0)
        (void)refuse(f, name, "cannot be opened");
    else if (!type_is_plain(type))
        (void)refuse(f, name, "has values of another type than numbers and short texts");
    else if (H5Pget_external_count(list) != 0)
        (void)refuse(f, name, "has its values in another file");
    else if (!filters_are_ours(list))
        (void)refuse(f, name, "is packed in a way that kiln does not use");
    else {
        storage.type_size = H5Tget_size(type);
        (void)check_storage(f, name, dataset, space, list, &storage);
    }
    if (list >= 0)
        (void)H5Pclose(list);
    if (space >= 0)
        (void)H5Sclose(space);
    if (type >= 0)
        (void)H5Tclose(type);
    return f->status;
}

/* ---- traversal ---- */

struct place {
    struct kiln_h5_file *file;
    const char *name; /* name of the group: "" or "/points" */
    int depth;
};

static int walk(struct kiln_h5_file *f, hid_t group, const char *name, int depth);

static void enter_group(const struct place *at, hid_t group, const char *link, const char *name)
{
    if (at->depth + 1 >= DEPTH_MOST) {
        (void)refuse(at->file, name, "is a group in groups deeper than kiln's own");
        return;
    }
    const hid_t inner = H5Gopen2(group, link, H5P_DEFAULT);
    if (inner < 0)
        (void)refuse(at->file, name, "cannot be opened");
    else {
        (void)walk(at->file, inner, name, at->depth + 1);
        (void)H5Gclose(inner);
    }
}

static void enter_dataset(const struct place *at, hid_t group, const char *link, const char *name)
{
    const hid_t dataset = H5Dopen2(group, link, H5P_DEFAULT);
    if (dataset < 0) {
        (void)refuse(at->file, name, "cannot be opened");
        return;
    }
    at->file->status = at->file->visit(at->file->context, name, dataset);
    (void)H5Dclose(dataset);
}

/* Callback of H5Literate; returns 1 to end it. */
static herr_t take_link(hid_t group, const char *link, const H5L_info_t *info, void *context)
{
    const struct place *at = context;
    struct kiln_h5_file *f = at->file;
    char name[NAME_SIZE];
    H5O_info_t object;
    const int length = snprintf(name, sizeof name, "%s/%s", at->name, link);
    if (length < 0 || length >= NAME_SIZE || strchr(link, '/') != NULL)
        (void)refuse(f, at->name, "holds an object whose name is too long");
    else if (info->type != H5L_TYPE_HARD)
        (void)refuse(f, name, "is a link to somewhere else");
    else if (++f->objects > OBJECTS_MOST)
        (void)refuse(f, name, "is one object too many");
    else if (H5Oget_info_by_name2(group, link, &object, H5O_INFO_BASIC | H5O_INFO_NUM_ATTRS, H5P_DEFAULT) < 0)
        (void)refuse(f, name, "cannot be opened");
    else if (object.rc != 1)
        (void)refuse(f, name, "has more names than one");
    else if (object.num_attrs > ATTRIBUTES_MOST)
        (void)refuse(f, name, "has more attributes than 64");
    else if (object.type == H5O_TYPE_GROUP)
        enter_group(at, group, link, name);
    else if (object.type == H5O_TYPE_DATASET)
        enter_dataset(at, group, link, name);
    else
        (void)refuse(f, name, "is neither a group nor a dataset");
    return f->status != KILN_OK;
}

static int walk(struct kiln_h5_file *f, hid_t group, const char *name, int depth)
{
    struct place at = {f, name, depth};
    H5G_info_t info;
    const char *shown = name[0] == '\0' ? "/" : name;
    if (H5Gget_info(group, &info) < 0)
        return refuse(f, shown, "cannot be read");
    const bool of_lights = strcmp(name, "/groups") == 0 || strcmp(name, "/groups_direct") == 0;
    if (info.nlinks > KILN_GROUPS_MAX && of_lights)
        return refuse(f, shown, "holds more objects than there may be groups of lights");
    if (info.nlinks > LINKS_MOST && !of_lights)
        return refuse(f, shown, "holds more objects than 256");
    if (H5Literate(group, H5_INDEX_NAME, H5_ITER_NATIVE, NULL, take_link, &at) < 0 && f->status == KILN_OK)
        return refuse(f, shown, "cannot be read");
    return f->status;
}

int kiln_h5_file_visit(struct kiln_h5_file *f, int (*visit)(void *context, const char *name, hid_t dataset),
                       void *context, struct kiln_error *error)
{
    f->visit = visit;
    f->context = context;
    f->status = KILN_OK;
    f->error = error;
    f->objects = 0;
    const hid_t root = H5Gopen2(f->id, "/", H5P_DEFAULT);
    if (root < 0)
        return refuse(f, "/", "cannot be opened");
    (void)walk(f, root, "", 0);
    (void)H5Gclose(root);
    return f->status;
}

int kiln_h5_file_open(struct kiln_h5_file **file, int descriptor, const char *path, struct kiln_error *error)
{
    struct stat found;
    *file = NULL;
    int status = kiln_allocate(file, 1, sizeof **file, "an HDF5 file", error);
    if (status != KILN_OK)
        return status;
    struct kiln_h5_file *f = *file;
    f->path = path;
    f->id = H5I_INVALID_HID;
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL); /* our sentence instead of its trace */
    (void)H5PLset_loading_state(0);              /* load no filter plug-ins */
    if (fstat(descriptor, &found) != 0 || !S_ISREG(found.st_mode))
        status = kiln_fail(error, KILN_BAD_INPUT, "'%s' is not a plain file", path);
    f->bytes = status == KILN_OK ? (uint64_t)found.st_size : 0;
    if (status == KILN_OK && (f->id = kiln_h5_driver_read(descriptor, f->bytes, path)) < 0)
        status = kiln_fail(error, KILN_BAD_INPUT, "'%s' cannot be opened as HDF5: it is damaged or cut off; bake again",
                           path);
    if (status == KILN_OK)
        status = kiln_h5_file_visit(f, check_dataset, f, error);
    if (status != KILN_OK)
        kiln_h5_file_close(file);
    return status;
}

void kiln_h5_file_close(struct kiln_h5_file **file)
{
    if (*file == NULL)
        return;
    if ((*file)->id >= 0)
        (void)H5Fclose((*file)->id);
    kiln_free(file);
}

hid_t kiln_h5_file_id(const struct kiln_h5_file *f) { return f->id; }
