#include "coordinator/cli/mix_maps.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/field/group_fields.h"
#include "coordinator/output/exr.h"
#include "worker/base/memory.h"

enum { KINDS = 3, PLANES = 3 * KINDS, KEPT_MOST = 512 };

/* Prefixes of channel names, of all light, direct light and indirect light. */
static const char *const prefixes[KINDS] = {"", "direct.", "indirect."};

struct mixing {
    const struct kiln_mix_params *params;
    struct kiln_image *bake; /* the lightmap's image, with the layers of groups if they are in the same file */
    double *sum[PLANES];     /* by prefix and colour; NULL: the bake has no such layer */
};

static int layer_missing(const struct mixing *m, const char *name, const char *group, struct kiln_error *error)
{
    return kiln_fail(error, KILN_BAD_INPUT, "%.300s: %.300s has no layers of the group of lights '%s'; bake again",
                     m->params->bake, name, group);
}

/* Initializes the sums with the bake's light times the least factor. */
static int begin(struct mixing *m, const char *name, struct kiln_error *error)
{
    const size_t count = (size_t)m->bake->width * m->bake->height;
    for (int k = 0; k < PLANES; k++) {
        char channel[KILN_CHANNEL_NAME_SIZE];
        (void)snprintf(channel, sizeof channel, "%s%c", prefixes[k / 3], "RGB"[k % 3]);
        const struct kiln_image_channel *from = kiln_image_find(m->bake, channel);
        if (from == NULL && k < 3)
            return kiln_fail(error, KILN_BAD_INPUT, "%.300s: %.300s has no layer %s; bake again", m->params->bake, name,
                             channel);
        if (from == NULL)
            continue;
        const int status = kiln_allocate(&m->sum[k], count, sizeof(double), "a mixture", error);
        if (status != KILN_OK)
            return status;
        for (size_t i = 0; i < count; i++)
            m->sum[k][i] = m->params->factors->least[k % 3] * (double)from->values[i];
    }
    return KILN_OK;
}

/* Adds a group's share beyond the least factor, in all light, direct light and (as their difference) indirect light. */
static int add_group(struct mixing *m, const struct kiln_image *layers, size_t group, const char *name,
                     struct kiln_error *error)
{
    const struct kiln_mix_factors *f = m->params->factors;
    const size_t count = (size_t)m->bake->width * m->bake->height;
    char prefix[2][KILN_CHANNEL_NAME_SIZE];
    float *all[3], *direct[3];
    (void)snprintf(prefix[0], sizeof prefix[0], "group.%s.", f->names[group]);
    (void)snprintf(prefix[1], sizeof prefix[1], "group.%s.direct.", f->names[group]);
    if (!kiln_image_rgb(layers, prefix[0], all) || !kiln_image_rgb(layers, prefix[1], direct) ||
        layers->width != m->bake->width || layers->height != m->bake->height)
        return layer_missing(m, name, f->names[group], error);
    for (int c = 0; c < 3; c++) {
        const double factor = f->of[group][c] - f->least[c];
        for (size_t i = 0; i < count && factor > 0.0; i++) {
            const double whole = (double)all[c][i], first = (double)direct[c][i];
            m->sum[c][i] += factor * whole;
            if (m->sum[3 + c] != NULL)
                m->sum[3 + c][i] += factor * first;
            if (m->sum[6 + c] != NULL)
                m->sum[6 + c][i] += factor * (whole - first);
        }
    }
    return KILN_OK;
}

/* Whether all groups [first, last) have the least factor, so that nothing has to be added for them. */
static bool is_idle(const struct kiln_mix_factors *f, size_t first, size_t last)
{
    bool idle = true;
    for (size_t g = first; g < last; g++)
        for (int c = 0; c < 3; c++)
            idle = idle && !(f->of[g][c] > f->least[c]);
    return idle;
}

static int add_file(struct mixing *m, size_t n, const char *name, struct kiln_error *error)
{
    const struct kiln_mix_factors *f = m->params->factors;
    const size_t first = n * KILN_GROUPS_A_FILE,
                 last = first + KILN_GROUPS_A_FILE < f->count ? first + KILN_GROUPS_A_FILE : f->count;
    struct kiln_image *layers = NULL;
    char folder[KILN_GROUP_FOLDER], path[KILN_PATH_SIZE];
    if (is_idle(f, first, last))
        return KILN_OK;
    kiln_group_folder(n, folder);
    (void)snprintf(path, sizeof path, "%s%s", folder, name + strlen("lightmaps"));
    int status = kiln_results_image(m->params->results, path, NULL, 0, &layers, error);
    for (size_t g = first; g < last && status == KILN_OK; g++)
        status = add_group(m, layers, g, path, error);
    kiln_image_destroy(&layers);
    return status;
}

static int add_groups(struct mixing *m, const char *name, struct kiln_error *error)
{
    const struct kiln_mix_factors *f = m->params->factors;
    const size_t files = kiln_group_files(f->count);
    int status = KILN_OK;
    for (size_t n = 0; n < files; n++)
        KILN_TRY(add_file(m, n, name, error));
    for (size_t g = 0; files == 0 && g < f->count; g++)
        KILN_TRY(add_group(m, m->bake, g, name, error));
end:
    return status;
}

/* Layers that no light changes. */
static bool is_kept(const char *name)
{
    static const char *const kept[] = {"coverage.Y", "validity.Y", "ambient_occlusion.", "bent_normal."};
    bool found = false;
    for (size_t i = 0; i < sizeof kept / sizeof *kept; i++)
        found = found || strncmp(name, kept[i], strlen(kept[i])) == 0;
    return found;
}

/* The place of a layer of light; PLANES if it is none. */
static int plane_of(const struct mixing *m, const char *name)
{
    for (int k = 0; k < PLANES; k++) {
        char channel[KILN_CHANNEL_NAME_SIZE];
        (void)snprintf(channel, sizeof channel, "%s%c", prefixes[k / 3], "RGB"[k % 3]);
        if (m->sum[k] != NULL && strcmp(channel, name) == 0)
            return k;
    }
    return PLANES;
}

/* Makes the image of the mixture. Channels of light get the sums; others are kept. */
static int make_image(const struct mixing *m, struct kiln_image **image, struct kiln_error *error)
{
    const char *names[KEPT_MOST] = {NULL};
    const size_t count = (size_t)m->bake->width * m->bake->height;
    size_t channels = 0;
    for (size_t c = 0; c < m->bake->channel_count && channels < KEPT_MOST; c++)
        if (is_kept(m->bake->channels[c].name) || plane_of(m, m->bake->channels[c].name) < PLANES)
            names[channels++] = m->bake->channels[c].name;
    const int status = kiln_image_create(image, m->bake->width, m->bake->height, names, channels, error);
    for (size_t c = 0; c < channels && status == KILN_OK; c++) {
        struct kiln_image_channel *to = &(*image)->channels[c];
        const struct kiln_image_channel *from = kiln_image_find(m->bake, to->name);
        const int plane = plane_of(m, to->name);
        float most = 0.0f;
        for (size_t i = 0; i < count; i++) {
            to->values[i] = plane < PLANES ? fmaxf((float)m->sum[plane][i], 0.0f) : from->values[i];
            most = fmaxf(most, fabsf(to->values[i]));
        }
        to->half = from->half && most <= KILN_HALF_MAX;
    }
    return status;
}

static double mean_of(const struct kiln_image *image)
{
    const struct kiln_image_channel *coverage = kiln_image_find(image, "coverage.Y"),
                                    *validity = kiln_image_find(image, "validity.Y");
    float *rgb[3];
    double sum = 0.0;
    if (!kiln_image_rgb(image, "", rgb) || coverage == NULL || validity == NULL)
        return 0.0;
    for (size_t i = 0; i < (size_t)image->width * image->height; i++)
        if (validity->values[i] == 1.0f)
            sum += (double)coverage->values[i] * (double)kiln_rgb_luminance(rgb[0][i], rgb[1][i], rgb[2][i]);
    return sum;
}

static int put(const struct mixing *m, const char *name, const json_t *object, const struct kiln_image *image,
               struct kiln_error *error)
{
    bool half = true;
    const char *file = json_string_value(json_object_get(object, "file_name")),
               *original = json_string_value(json_object_get(object, "name"));
    for (size_t c = 0; c < image->channel_count; c++)
        half = half && image->channels[c].half;
    const struct kiln_exr_attribute attributes[] = {
        {.name = "kiln:version", .kind = KILN_EXR_STRING, .text = KILN_VERSION},
        {.name = "kiln:quantity",
         .kind = KILN_EXR_STRING,
         .text = "irradiance about the shading normal; R G B = direct + indirect; a mixture of groups of lights"},
        {.name = "kiln:units", .kind = KILN_EXR_STRING, .text = kiln_units_of_bake(m->params->results)->irradiance},
        {.name = "kiln:object", .kind = KILN_EXR_STRING, .text = file != NULL ? file : ""},
        {.name = "kiln:originalName", .kind = KILN_EXR_STRING, .text = original != NULL ? original : ""},
        {.name = "kiln:precision", .kind = KILN_EXR_STRING, .text = half ? "half" : "float"}};
    return kiln_exr_put(m->params->batch, m->params->directory, name, image, attributes,
                        sizeof attributes / sizeof *attributes, error);
}

int kiln_mix_map(const struct kiln_mix_params *params, const char *name, const json_t *object, double *ratio,
                 struct kiln_error *error)
{
    struct mixing m = {.params = params};
    struct kiln_image *image = NULL;
    int status;
    KILN_TRY(kiln_results_image(params->results, name, NULL, 0, &m.bake, error));
    KILN_TRY(begin(&m, name, error));
    KILN_TRY(add_groups(&m, name, error));
    KILN_TRY(make_image(&m, &image, error));
    const double before = mean_of(m.bake);
    *ratio = before > 0.0 ? mean_of(image) / before : 1.0;
    KILN_TRY(put(&m, name, object, image, error));
end:
    for (int k = 0; k < PLANES; k++)
        kiln_free(&m.sum[k]);
    kiln_image_destroy(&image);
    kiln_image_destroy(&m.bake);
    return status;
}
