#include "coordinator/output/map/write/writer.h"

#include <math.h>
#include <string.h>

#include "worker/base/memory.h"

/* Moves a plane of the map into the image, which then owns it; of a map in bands, copies its rows. */
static int move_plane(const struct kiln_map *map, const struct kiln_image *image, const char *name, float **plane,
                      struct kiln_error *error)
{
    float **values = &kiln_image_find(image, name)->values;
    const size_t first = kiln_map_first(map), count = kiln_map_end(map) - first;
    if (map->bands == NULL) {
        *values = *plane;
        *plane = NULL;
        return KILN_OK;
    }
    const int status = kiln_allocate_bare(values, count, sizeof **values, "an image's pixels", error);
#pragma omp parallel for schedule(static) if (status == KILN_OK && count > KILN_IMAGE_ALONE)
    for (size_t i = 0; i < (status == KILN_OK ? count : 0); i++)
        (*values)[i] = (*plane)[first + i];
    kiln_map_free(map, plane, sizeof **plane);
    return status;
}

/* Ratios always fit halves: their precision suffices, and none exceeds the largest half. */
static bool fits_half(const struct kiln_field *field)
{
    return field->unit != NULL && strcmp(field->unit, "1") == 0 && fmax(-field->low, field->high) <= KILN_HALF_MAX;
}

/* Creates an image with the channels of all fields in lightmaps, without values. */
static int make_channels(const struct kiln_writer *w, const struct kiln_map *map, struct kiln_image **image,
                         struct kiln_error *error)
{
    const struct kiln_field_set *fields = w->result->fields;
    const char **names = NULL;
    size_t count = 2;
    int status = kiln_allocate(&names, kiln_field_set_channels(fields) + count, sizeof *names, "channels", error);
    if (status != KILN_OK)
        return status;
    names[0] = "coverage.Y";
    names[1] = "validity.Y";
    for (size_t i = 0; i < fields->count; i++)
        for (uint32_t c = 0; fields->entry[i].in_lightmaps && c < fields->entry[i].field->components; c++)
            names[count++] = fields->entry[i].field->channels[c];
    status = kiln_image_create_empty(image, map->width, kiln_map_rows(map), names, count, error);
    kiln_free(&names);
    for (size_t i = 0; status == KILN_OK && i < fields->count; i++)
        for (uint32_t c = 0; fields->entry[i].in_lightmaps && c < fields->entry[i].field->components; c++)
            kiln_image_find(*image, fields->entry[i].field->channels[c])->half =
                w->params->half && fits_half(fields->entry[i].field);
    return status;
}

/* Computes a field that is a sum of other fields, from their final channels, which are filled and smoothed. */
static void add_terms(const struct kiln_image *image, const struct kiln_field_set *fields, size_t index)
{
    const struct kiln_field_entry *entry = &fields->entry[index];
    const size_t count = (size_t)image->width * image->height;
    for (uint32_t c = 0; c < entry->field->components; c++) {
        const float *of[KILN_FIELD_TERMS] = {NULL};
        for (size_t k = 0; k < entry->term_count; k++)
            of[k] = kiln_image_find(image, fields->entry[entry->terms[k]].field->channels[c])->values;
        float *total = kiln_image_find(image, entry->field->channels[c])->values;
#pragma omp parallel for schedule(static) if (count > KILN_IMAGE_ALONE)
        for (size_t i = 0; i < count; i++)
            total[i] = of[0][i] + of[1][i] + (of[2] != NULL ? of[2][i] : 0.0f);
    }
}

/* Allocates the channels that are computed from others, since all of their values will be written. */
static int make_room(const struct kiln_image *image, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t c = 0; c < image->channel_count && status == KILN_OK; c++)
        if (image->channels[c].values == NULL)
            status = kiln_allocate_bare(&image->channels[c].values, (size_t)image->width * image->height, sizeof(float),
                                        "an image's pixels", error);
    return status;
}

int kiln_writer_image(const struct kiln_writer *w, struct kiln_map *map, struct kiln_image **image,
                      struct kiln_error *error)
{
    const struct kiln_field_set *fields = w->result->fields;
    int status = make_channels(w, map, image, error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < w->layers.count; i++) {
        const struct kiln_layer *layer = &w->layers.layer[i];
        const struct kiln_field *field = fields->entry[layer->field].field;
        for (uint32_t c = 0; status == KILN_OK && fields->entry[layer->field].in_lightmaps && c < field->components;
             c++)
            status = move_plane(map, *image, field->channels[c], &map->planes[layer->plane + c], error);
    }
    if (status == KILN_OK)
        status = move_plane(map, *image, "coverage.Y", &map->coverage, error);
    if (status == KILN_OK)
        status = make_room(*image, error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < fields->count; i++)
        if (fields->entry[i].field->life == KILN_FIELD_SUM && fields->entry[i].in_lightmaps)
            add_terms(*image, fields, i);
    struct kiln_image_channel *validity = kiln_image_find(*image, "validity.Y");
    const size_t first = kiln_map_first(map), count = kiln_map_end(map) - first;
    kiln_image_find(*image, "coverage.Y")->half = validity->half = true;
#pragma omp parallel for schedule(static) if (count > KILN_IMAGE_ALONE)
    for (size_t i = 0; i < count; i++)
        validity->values[i] = 0.5f * (float)map->state[first + i];
    return KILN_OK;
}
