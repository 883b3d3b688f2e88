#include "coordinator/output/read/ranges.h"

#include <hdf5.h>
#include <jansson.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/field/field.h"
#include "coordinator/field/group_fields.h"
#include "coordinator/output/exr.h"
#include "coordinator/files/publish.h"
#include "coordinator/output/h5_file.h"
#include "coordinator/files/json_text.h"
#include "worker/base/memory.h"
#include "worker/pass/links_file.h"
#include "worker/scene/scene.h"

struct range {
    const char *name; /* of a channel or dataset */
    double low, high;
};

/* Ranges of channels and datasets other than fields (coordinator/field/field.h): masks of lightmaps, surfaces of views,
 * vertices, the volume. */
static const struct range others[] = {
    {"coverage.Y", 0.0, 1.001},
    {"validity.Y", 0.0, 1.0},
    {"albedo.R", 0.0, INFINITY},
    {"albedo.G", 0.0, INFINITY},
    {"albedo.B", 0.0, INFINITY},
    {"emission.R", 0.0, INFINITY},
    {"emission.G", 0.0, INFINITY},
    {"emission.B", 0.0, INFINITY},
    {"spread.R", 0.0, INFINITY},
    {"spread.G", 0.0, INFINITY},
    {"spread.B", 0.0, INFINITY},
    {"/vertices/irradiance", 0.0, INFINITY},
    {"/vertices/error", 0.0, INFINITY},
    {"/VTKHDF/PointData/validity", 0.0, 1.0},
    {"/VTKHDF/PointData/mean_distance", 0.0, INFINITY},
};

/* Whether the dataset or channel is the field's. */
static bool is_named(const struct kiln_field *field, const char *name)
{
    bool found = field->dataset != NULL && strcmp(field->dataset, name) == 0;
    for (uint32_t c = 0; field->channels != NULL && !found && c < field->components; c++)
        found = strcmp(field->channels[c], name) == 0;
    return found;
}

/* The range for a name. Only whole names match: users name groups of lights, so the end of a name means nothing. */
static struct range range_of(const char *name)
{
    size_t fields;
    const struct kiln_field *table = kiln_fields(&fields), *field = kiln_group_field_named(name);
    for (size_t i = 0; i < fields && field == NULL; i++)
        if (is_named(&table[i], name))
            field = &table[i];
    if (field != NULL)
        return (struct range){name, field->low, field->high};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (strcmp(others[i].name, name) == 0)
            return others[i];
    return (struct range){name, -INFINITY, INFINITY};
}

/* ---- EXR ---- */

static int check_channel(const char *path, const struct kiln_image *image, const struct kiln_image_channel *channel,
                         struct kiln_error *error)
{
    const struct range range = range_of(channel->name);
    const size_t count = (size_t)image->width * image->height;
    for (size_t i = 0; i < count; i++) {
        const double value = (double)channel->values[i];
        if (!isfinite(value) || value < range.low || value > range.high)
            return kiln_fail(error, KILN_BAD_INPUT, "'%s': %s is %g at texel (%zu, %zu)", path, channel->name, value,
                             i % image->width, i / image->width);
    }
    return KILN_OK;
}

static int check_exr(int descriptor, const char *path, struct kiln_error *error)
{
    struct kiln_image *image = NULL;
    int status = kiln_exr_read_open(descriptor, path, NULL, 0, &image, error);
    for (size_t c = 0; status == KILN_OK && c < image->channel_count; c++)
        status = check_channel(path, image, &image->channels[c], error);
    kiln_image_destroy(&image);
    return status == KILN_IO ? KILN_BAD_INPUT : status;
}

/* ---- HDF5 ---- */

enum { BLOCK_VALUES = 1 << 20, DIMENSIONS_MOST = 8 };

struct h5_check {
    const char *path;
    double *values; /* room for BLOCK_VALUES values */
    struct kiln_error *error;
};

static int check_values(const struct h5_check *check, const char *name, size_t count, hsize_t first)
{
    const struct range range = range_of(name);
    for (size_t i = 0; i < count; i++)
        if (!isfinite(check->values[i]) || check->values[i] < range.low || check->values[i] > range.high)
            return kiln_fail(check->error, KILN_BAD_INPUT, "'%s': %s is %g at value %llu", check->path, name,
                             check->values[i], (unsigned long long)(first + i));
    return KILN_OK;
}

/* Checks a dataset by rows of its slowest dimension, as many at a time as fit. */
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
    int status = step > 0 || row == 0 ? KILN_OK
                                      : kiln_fail(check->error, KILN_BAD_INPUT,
                                                  "'%s': rows of %s are too long to check", check->path, name);
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

static int check_dataset(void *context, const char *name, hid_t dataset)
{
    const struct h5_check *check = context;
    const hid_t type = H5Dget_type(dataset), space = H5Dget_space(dataset);
    int status = KILN_OK;
    if (type < 0 || space < 0)
        status = kiln_fail(check->error, KILN_BAD_INPUT, "'%s': %s cannot be opened", check->path, name);
    else if (H5Tget_class(type) == H5T_FLOAT)
        status = check_rows(check, name, dataset, space);
    if (space >= 0)
        (void)H5Sclose(space);
    if (type >= 0)
        (void)H5Tclose(type);
    return status;
}

static int check_h5(int descriptor, const char *path, struct kiln_error *error)
{
    struct h5_check check = {.path = path, .error = error};
    struct kiln_h5_file *file = NULL;
    int status;
    KILN_TRY(kiln_allocate(&check.values, BLOCK_VALUES, sizeof *check.values, "values to check", error));
    KILN_TRY(kiln_h5_file_open(&file, descriptor, path, error));
    KILN_TRY(kiln_h5_file_visit(file, check_dataset, &check, error));
end:
    kiln_h5_file_close(&file);
    kiln_free(&check.values);
    return status;
}

/* ---- others ---- */

static int check_json(int descriptor, const char *path, struct kiln_error *error)
{
    char *text = NULL;
    size_t size = 0;
    int status = kiln_read_open(descriptor, path, KILN_JSON_BYTES_MOST, &text, &size, error);
    json_t *json = status == KILN_OK ? kiln_json_text(text, size, path, error) : NULL;
    if (status == KILN_OK && json == NULL)
        status = KILN_BAD_INPUT;
    json_decref(json);
    kiln_free(&text);
    return status;
}

static int check_scene(int descriptor, const char *path, struct kiln_error *error)
{
    struct kiln_scene *scene = NULL;
    const int status = kiln_scene_open_descriptor(&scene, dup(descriptor), path, error);
    kiln_scene_close(&scene);
    return status;
}

/* ---- all ---- */

static const struct kind {
    const char *ending; /* of the path */
    int (*check)(int descriptor, const char *path, struct kiln_error *error);
} kinds[] = {{".exr", check_exr},   {".h5", check_h5},        {".hdf", check_h5},
             {".json", check_json}, {".kscene", check_scene}, {"transport/links", kiln_links_file_check}};

static const struct kind *kind_of(const char *path)
{
    const size_t length = strlen(path);
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        const size_t own = strlen(kinds[i].ending);
        if (length >= own && strcmp(path + length - own, kinds[i].ending) == 0)
            return &kinds[i];
    }
    return NULL;
}

bool kiln_ranges_has(const char *path) { return kind_of(path) != NULL; }

int kiln_ranges_check(int descriptor, const char *path, struct kiln_error *error)
{
    const struct kind *kind = kind_of(path);
    return kind != NULL ? kind->check(descriptor, path, error) : KILN_OK;
}
