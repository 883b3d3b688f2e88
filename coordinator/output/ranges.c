#include "coordinator/output/ranges.h"

#include <hdf5.h>
#include <jansson.h>
#include <math.h>
#include <string.h>

#include "coordinator/output/exr.h"
#include "worker/base/memory.h"
#include "worker/scene/scene.h"

struct range {
    const char *ending; /* of a channel's or dataset's name */
    double low, high;
};

static const struct range ranges[] = {
    {"R", 0.0, INFINITY},          {"G", 0.0, INFINITY},        {"B", 0.0, INFINITY},        {"coverage.Y", 0.0, 1.001},
    {"validity.Y", 0.0, 1.0},      {"/direct", 0.0, INFINITY},  {"/indirect", 0.0, INFINITY}, {"/total", 0.0, INFINITY},
    {"/error", 0.0, INFINITY},     {"/albedo", 0.0, 1.0},       {"/area", 0.0, INFINITY},    {"/validity", 0.0, 1.0},
    {"/mean_distance", 0.0, INFINITY},
};

static struct range range_of(const char *name)
{
    const size_t length = strlen(name);
    for (size_t i = 0; i < sizeof ranges / sizeof *ranges; i++) {
        const size_t own = strlen(ranges[i].ending);
        if (length >= own && strcmp(name + length - own, ranges[i].ending) == 0)
            return ranges[i];
    }
    return (struct range){"", -INFINITY, INFINITY};
}

/* ---- EXR ---- */

static int check_channel(const char *path, const struct kiln_image *image, const struct kiln_image_channel *channel, struct kiln_error *error)
{
    const struct range range = range_of(channel->name);
    const size_t count = (size_t)image->width * image->height;
    for (size_t i = 0; i < count; i++) {
        const double value = (double)channel->values[i];
        if (!isfinite(value) || value < range.low || value > range.high)
            return kiln_fail(error, KILN_BAD_INPUT, "'%s': %s is %g at texel (%zu, %zu)", path, channel->name, value, i % image->width, i / image->width);
    }
    return KILN_OK;
}

static int check_exr(const char *path, struct kiln_error *error)
{
    struct kiln_image *image = NULL;
    int status = kiln_exr_read(path, NULL, 0, &image, error);
    for (size_t c = 0; status == KILN_OK && c < image->channel_count; c++)
        status = check_channel(path, image, &image->channels[c], error);
    kiln_image_destroy(&image);
    return status == KILN_IO ? KILN_BAD_INPUT : status;
}

/* ---- HDF5 ---- */

enum { BLOCK_VALUES = 1 << 20, DIMENSIONS_MOST = 8 };

struct h5_check {
    const char *path;
    double *values; /* BLOCK_VALUES */
    int status;
    struct kiln_error *error;
};

static int check_values(const struct h5_check *check, const char *name, size_t count, hsize_t first)
{
    const struct range range = range_of(name);
    for (size_t i = 0; i < count; i++)
        if (!isfinite(check->values[i]) || check->values[i] < range.low || check->values[i] > range.high)
            return kiln_fail(check->error, KILN_BAD_INPUT, "'%s': %s is %g at value %llu", check->path, name, check->values[i],
                             (unsigned long long)(first + i));
    return KILN_OK;
}

/* Rows of the slowest dimension, as many at a time as fit. */
static int check_rows(const struct h5_check *check, const char *name, hid_t dataset, hid_t space)
{
    hsize_t size[DIMENSIONS_MOST], start[DIMENSIONS_MOST] = {0};
    const int rank = H5Sget_simple_extent_ndims(space);
    if (rank < 1 || rank > DIMENSIONS_MOST || H5Sget_simple_extent_dims(space, size, NULL) != rank)
        return KILN_OK;
    hsize_t row = 1;
    for (int d = 1; d < rank; d++)
        row *= size[d];
    const hsize_t all = size[0], step = row > 0 && row <= BLOCK_VALUES ? BLOCK_VALUES / row : 0;
    int status = step > 0 || row == 0 ? KILN_OK : kiln_fail(check->error, KILN_BAD_INPUT, "'%s': rows of %s are too long to check", check->path, name);
    for (hsize_t first = 0; status == KILN_OK && row > 0 && first < all; first += step) {
        start[0] = first;
        size[0] = all - first < step ? all - first : step;
        const hid_t memory = H5Screate_simple(rank, size, NULL);
        if (memory < 0 || H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, size, NULL) < 0 ||
            H5Dread(dataset, H5T_NATIVE_DOUBLE, memory, space, H5P_DEFAULT, check->values) < 0)
            status = kiln_fail(check->error, KILN_BAD_INPUT, "'%s': %s cannot be read", check->path, name);
        else
            status = check_values(check, name, (size_t)(size[0] * row), first * row);
        if (memory >= 0)
            (void)H5Sclose(memory);
    }
    return status;
}

/* H5Ovisit: 1 ends it. */
static herr_t visit(hid_t file, const char *name, const H5O_info_t *info, void *context)
{
    struct h5_check *check = context;
    char full[512];
    if (info->type != H5O_TYPE_DATASET)
        return 0;
    (void)snprintf(full, sizeof full, "/%s", name);
    const hid_t dataset = H5Dopen2(file, name, H5P_DEFAULT), type = dataset >= 0 ? H5Dget_type(dataset) : -1;
    const hid_t space = dataset >= 0 ? H5Dget_space(dataset) : -1;
    if (type < 0 || space < 0)
        check->status = kiln_fail(check->error, KILN_BAD_INPUT, "'%s': %s cannot be opened", check->path, full);
    else if (H5Tget_class(type) == H5T_FLOAT)
        check->status = check_rows(check, full, dataset, space);
    if (space >= 0)
        (void)H5Sclose(space);
    if (type >= 0)
        (void)H5Tclose(type);
    if (dataset >= 0)
        (void)H5Dclose(dataset);
    return check->status != KILN_OK;
}

static int check_h5(const char *path, struct kiln_error *error)
{
    struct h5_check check = {.path = path, .error = error};
    H5E_auto2_t print;
    void *print_data;
    (void)H5Eget_auto2(H5E_DEFAULT, &print, &print_data);
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    check.status = kiln_allocate(&check.values, BLOCK_VALUES, sizeof *check.values, "values to check", error);
    const hid_t file = check.status == KILN_OK ? H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT) : -1;
    if (check.status == KILN_OK && file < 0)
        check.status = kiln_fail(error, KILN_BAD_INPUT, "'%s' cannot be opened as HDF5", path);
    if (file >= 0) {
        if (H5Ovisit(file, H5_INDEX_NAME, H5_ITER_INC, visit, &check) < 0 && check.status == KILN_OK)
            check.status = kiln_fail(error, KILN_BAD_INPUT, "'%s' cannot be read as HDF5", path);
        (void)H5Fclose(file);
    }
    (void)H5Eset_auto2(H5E_DEFAULT, print, print_data);
    kiln_free(&check.values);
    return check.status;
}

/* ---- others ---- */

static int check_json(const char *path, struct kiln_error *error)
{
    json_error_t where;
    json_t *json = json_load_file(path, 0, &where);
    if (json == NULL)
        return kiln_fail(error, KILN_BAD_INPUT, "'%s' is not JSON: line %d: %s", path, where.line, where.text);
    json_decref(json);
    return KILN_OK;
}

static int check_scene(const char *path, struct kiln_error *error)
{
    struct kiln_scene *scene = NULL;
    const int status = kiln_scene_open(&scene, path, error);
    kiln_scene_close(&scene);
    return status;
}

int kiln_ranges_check(const char *path, struct kiln_error *error)
{
    static const struct {
        const char *ending;
        int (*check)(const char *path, struct kiln_error *error);
    } kinds[] = {{".exr", check_exr}, {".h5", check_h5}, {".hdf", check_h5}, {".json", check_json}, {".kscene", check_scene}};
    const char *dot = strrchr(path, '.');
    for (size_t i = 0; dot != NULL && i < sizeof kinds / sizeof *kinds; i++)
        if (strcmp(dot, kinds[i].ending) == 0)
            return kinds[i].check(path, error);
    return KILN_OK;
}
