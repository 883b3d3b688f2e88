#include "coordinator/output/read/leaves.h"

#include <hdf5.h>

#include "coordinator/output/h5_file.h"
#include "worker/base/memory.h"

enum { COMPONENTS_MOST = 3 };

struct source {
    struct kiln_h5_file *file;
    const char *path;
    uint32_t points;
    struct kiln_image *image;
};

static int damaged(const struct source *s, const char *name, struct kiln_error *error)
{
    return kiln_fail(error, KILN_BAD_INPUT, "'%s': %s cannot be read as that of an octree's leaves; bake again",
                     s->path, name);
}

/* Points and components of a dataset: 0 and 0 if it is of another form. */
static void extent_of(hid_t dataset, hsize_t size[2])
{
    hsize_t found[H5S_MAX_RANK] = {0};
    const hid_t space = H5Dget_space(dataset);
    const int rank = space >= 0 ? H5Sget_simple_extent_dims(space, found, NULL) : -1;
    size[0] = rank == 1 || rank == 2 ? found[0] : 0;
    size[1] = rank == 1 ? 1 : rank == 2 ? found[1] : 0;
    if (space >= 0)
        (void)H5Sclose(space);
}

/* Reads a dataset into channels, a component each; the last component again where there are more channels. */
static int read_into(const struct source *s, const char *name, const char *const *channels, size_t count,
                     struct kiln_error *error)
{
    float *values = NULL;
    hsize_t size[2];
    const hid_t dataset = H5Dopen2(kiln_h5_file_id(s->file), name, H5P_DEFAULT);
    if (dataset < 0)
        return damaged(s, name, error);
    extent_of(dataset, size);
    int status = size[0] == s->points && size[1] > 0 && size[1] <= 64 ? KILN_OK : damaged(s, name, error);
    if (status == KILN_OK)
        status = kiln_allocate(&values, size[0], size[1] * sizeof *values, "an octree's leaves", error);
    if (status == KILN_OK && H5Dread(dataset, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) < 0)
        status = damaged(s, name, error);
    for (size_t c = 0; status == KILN_OK && c < count; c++) {
        float *to = kiln_image_find(s->image, channels[c])->values;
        const hsize_t from = c < size[1] ? c : size[1] - 1;
        for (hsize_t i = 0; i < size[0]; i++)
            to[i] = values[i * size[1] + from];
    }
    kiln_free(&values);
    (void)H5Dclose(dataset);
    return status;
}

static bool has(const struct source *s, const char *name)
{
    const hid_t dataset = H5Dopen2(kiln_h5_file_id(s->file), name, H5P_DEFAULT);
    if (dataset >= 0)
        (void)H5Dclose(dataset);
    return dataset >= 0;
}

static int count_points(struct source *s, struct kiln_error *error)
{
    hsize_t size[2] = {0, 0};
    const hid_t dataset = H5Dopen2(kiln_h5_file_id(s->file), "/points/leaf", H5P_DEFAULT);
    if (dataset >= 0) {
        extent_of(dataset, size);
        (void)H5Dclose(dataset);
    }
    if (size[1] != 3 || size[0] == 0 || size[0] > UINT32_MAX / 2)
        return damaged(s, "/points/leaf", error);
    s->points = (uint32_t)size[0];
    return KILN_OK;
}

static int read_all(const struct source *s, const char *dataset, struct kiln_error *error)
{
    static const char *const light[] = {"R", "G", "B"}, *const leaf[] = {"leaf.x", "leaf.y", "leaf.z"},
                             *const facing[] = {"facing"}, *const object[] = {"object"}, *const side[] = {"side"},
                             *const valid[] = {"valid"};
    int status = read_into(s, dataset, light, 3, error);
    if (status == KILN_OK)
        status = read_into(s, "/points/leaf", leaf, 3, error);
    if (status == KILN_OK)
        status = read_into(s, "/points/facing", facing, 1, error);
    if (status == KILN_OK)
        status = read_into(s, "/points/object", object, 1, error);
    if (status == KILN_OK)
        status = read_into(s, "/points/valid", valid, 1, error);
    return status == KILN_OK && has(s, "/points/side") ? read_into(s, "/points/side", side, 1, error) : status;
}

int kiln_leaves_read(int descriptor, const char *path, const char *dataset, struct kiln_image **image,
                     struct kiln_error *error)
{
    static const char *const channels[KILN_LEAF_CHANNEL_COUNT] = KILN_LEAF_CHANNELS;
    struct source s = {.path = path};
    *image = NULL;
    int status = kiln_h5_file_open(&s.file, descriptor, path, error);
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    if (status == KILN_OK)
        status = count_points(&s, error);
    if (status == KILN_OK && !has(&s, dataset))
        status = kiln_fail(error, KILN_NO_INPUT, "'%s' has no dataset %s", path, dataset);
    if (status == KILN_OK)
        status = kiln_image_create(&s.image, s.points, 1, channels, KILN_LEAF_CHANNEL_COUNT, error);
    if (status == KILN_OK)
        status = read_all(&s, dataset, error);
    kiln_h5_file_close(&s.file);
    if (status == KILN_OK)
        *image = s.image;
    else
        kiln_image_destroy(&s.image);
    return status;
}
