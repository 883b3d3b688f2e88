#include "coordinator/output/read/rows.h"

#include <hdf5.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/output/h5_file.h"
#include "worker/base/memory.h"

/* Components of a dataset, and channels of an image, at most. */
enum { COMPONENTS = 96, CHANNELS = 128 };

struct source {
    struct kiln_h5_file *file;
    const char *path;
    const char *const *datasets;
    size_t count;
    hsize_t rows;
    char names[CHANNELS][KILN_CHANNEL_NAME_SIZE];
    size_t channels;
    struct kiln_image *image;
};

static int damaged(const struct source *s, const char *name, struct kiln_error *error)
{
    return kiln_fail(error, KILN_BAD_INPUT, "'%s': %s cannot be read; bake again", s->path, name);
}

static bool name_channel(char name[KILN_CHANNEL_NAME_SIZE], const char *dataset, unsigned component)
{
    const int length = snprintf(name, KILN_CHANNEL_NAME_SIZE, "%s.%u", dataset, component);
    return length > 0 && length < KILN_CHANNEL_NAME_SIZE;
}

const float *kiln_dataset_of(const struct kiln_image *image, const char *dataset, unsigned component)
{
    char name[KILN_CHANNEL_NAME_SIZE];
    const struct kiln_image_channel *channel =
        name_channel(name, dataset, component) ? kiln_image_find(image, name) : NULL;
    return channel != NULL ? channel->values : NULL;
}

/* Numbers of rows and components of a dataset. A volume's dataset has three dimensions, or four with components; its
 * rows are the probes. 0 and 0 if it has another shape. */
static void extent_of(hid_t dataset, hsize_t size[2])
{
    hsize_t found[H5S_MAX_RANK] = {0};
    const hid_t space = H5Dget_space(dataset);
    const int rank = space >= 0 ? H5Sget_simple_extent_dims(space, found, NULL) : -1;
    size[0] = rank == 1 || rank == 2 ? found[0] : 0;
    size[1] = rank == 1 ? 1 : rank == 2 ? found[1] : 0;
    if (rank == 3 || rank == 4) {
        const bool small =
            found[0] < 1u << 28 && found[1] < 1u << 28 && found[0] * found[1] < 1u << 28 && found[2] < 1u << 28;
        size[0] = small ? found[0] * found[1] * found[2] : 0;
        size[1] = rank == 3 ? 1 : found[3];
    }
    if (space >= 0)
        (void)H5Sclose(space);
}

/* Opens a dataset that has as many rows as those before it. */
static int open_dataset(struct source *s, const char *name, hid_t *dataset, hsize_t size[2], struct kiln_error *error)
{
    *dataset = H5Dopen2(kiln_h5_file_id(s->file), name, H5P_DEFAULT);
    if (*dataset < 0)
        return kiln_fail(error, KILN_NO_INPUT, "'%s' has no dataset %s; kiln view --help all says what keeps it",
                         s->path, name);
    extent_of(*dataset, size);
    if (size[0] > 0 && size[0] <= UINT32_MAX / 2 && size[1] > 0 && size[1] <= COMPONENTS &&
        (s->rows == 0 || s->rows == size[0])) {
        s->rows = size[0];
        return KILN_OK;
    }
    (void)H5Dclose(*dataset);
    return damaged(s, name, error);
}

static int add_channels(struct source *s, const char *dataset, hsize_t components, struct kiln_error *error)
{
    for (unsigned c = 0; c < components; c++)
        if (s->channels == CHANNELS || !name_channel(s->names[s->channels++], dataset, c))
            return kiln_fail(error, KILN_BAD_INPUT, "'%s': %s cannot be read with so many others", s->path, dataset);
    return KILN_OK;
}

static int compare_names(const void *a, const void *b) { return strcmp(a, b); }

/* Makes the image for all datasets. */
static int make_image(struct source *s, struct kiln_error *error)
{
    const char *names[CHANNELS];
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < s->count; i++) {
        hsize_t size[2];
        hid_t dataset;
        status = open_dataset(s, s->datasets[i], &dataset, size, error);
        if (status == KILN_OK) {
            status = add_channels(s, s->datasets[i], size[1], error);
            (void)H5Dclose(dataset);
        }
    }
    qsort(s->names, s->channels, sizeof s->names[0], compare_names);
    for (size_t i = 0; i < s->channels; i++)
        names[i] = s->names[i];
    return status == KILN_OK ? kiln_image_create(&s->image, (uint32_t)s->rows, 1, names, s->channels, error) : status;
}

static int read_dataset(struct source *s, const char *name, struct kiln_error *error)
{
    float *values = NULL;
    hsize_t size[2];
    hid_t dataset;
    int status = open_dataset(s, name, &dataset, size, error);
    if (status != KILN_OK)
        return status;
    KILN_TRY(kiln_allocate(&values, size[0], size[1] * sizeof *values, "the rows of a dataset", error));
    if (H5Dread(dataset, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) < 0)
        KILN_TRY(damaged(s, name, error));
    for (unsigned c = 0; c < size[1]; c++) {
        char channel[KILN_CHANNEL_NAME_SIZE];
        (void)name_channel(channel, name, c);
        float *to = kiln_image_find(s->image, channel)->values;
        for (hsize_t i = 0; i < size[0]; i++)
            to[i] = values[i * size[1] + c];
    }
end:
    kiln_free(&values);
    (void)H5Dclose(dataset);
    return status;
}

int kiln_datasets_read(int descriptor, const char *path, const char *const *datasets, size_t count,
                       struct kiln_image **image, struct kiln_error *error)
{
    struct source s = {.path = path, .datasets = datasets, .count = count};
    *image = NULL;
    int status = kiln_h5_file_open(&s.file, descriptor, path, error);
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    if (status == KILN_OK)
        status = make_image(&s, error);
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        status = read_dataset(&s, datasets[i], error);
    kiln_h5_file_close(&s.file);
    if (status == KILN_OK)
        *image = s.image;
    else
        kiln_image_destroy(&s.image);
    return status;
}
