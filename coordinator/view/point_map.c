#include "coordinator/view/point_map.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/output/read/rows.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

#define SIDE "/points/side"
#define PART "/points/part"

struct kiln_point_dataset {
    struct kiln_image *image;                       /* a pixel for each point */
    const float *value[3], *object, *x, *y, *valid; /* valid NULL: all are */
    const float *side, *part;                       /* NULL: all are fronts; all are parts 0, which lightmaps show */
    uint32_t objects;
    float *own;              /* values that replace the dataset; NULL: the dataset is used */
    uint32_t *first, *point; /* the points of each object: point[first[o]] to point[first[o + 1] - 1] */
    struct kiln_arena arena;
};

static bool find_rows(struct kiln_point_dataset *r, const struct kiln_field *field)
{
    const uint32_t last = field->components - 1;
    for (uint32_t c = 0; c < 3; c++)
        r->value[c] = kiln_dataset_of(r->image, field->dataset, c < last ? c : last);
    r->object = kiln_dataset_of(r->image, "/points/object", 0);
    r->x = kiln_dataset_of(r->image, "/points/texel", 0);
    r->y = kiln_dataset_of(r->image, "/points/texel", 1);
    r->valid = strncmp(field->dataset, "/points/", 8) == 0 ? NULL : kiln_dataset_of(r->image, "/points/valid", 0);
    r->side = kiln_dataset_of(r->image, SIDE, 0);
    r->part = kiln_dataset_of(r->image, PART, 0);
    bool found = r->value[0] != NULL && r->value[1] != NULL && r->value[2] != NULL && r->object != NULL &&
                 r->x != NULL && r->y != NULL;
    for (uint32_t i = 0; found && i < r->image->width; i++)
        found = r->object[i] >= 0.0f && r->object[i] < (float)r->objects;
    return found;
}

/* Sorts the points by object. */
static int sort_rows(struct kiln_point_dataset *r, struct kiln_error *error)
{
    int status = kiln_arena_allocate(&r->arena, &r->first, (size_t)r->objects + 2, sizeof *r->first,
                                     "the points of a bake", error);
    if (status == KILN_OK)
        status =
            kiln_arena_allocate(&r->arena, &r->point, r->image->width, sizeof *r->point, "the points of a bake", error);
    if (status != KILN_OK)
        return status;
    for (uint32_t i = 0; i < r->image->width; i++)
        r->first[(uint32_t)r->object[i] + 2]++;
    for (uint32_t o = 0; o < r->objects; o++)
        r->first[o + 2] += r->first[o + 1];
    for (uint32_t i = 0; i < r->image->width; i++)
        r->point[r->first[(uint32_t)r->object[i] + 1]++] = i;
    return KILN_OK;
}

int kiln_point_dataset_read(struct kiln_point_dataset **rows, struct kiln_results *results,
                            const struct kiln_field *field, uint32_t objects, struct kiln_error *error)
{
    enum { ALWAYS = 4, MORE = 2, WAYS = 4 };
    static const char *const more[WAYS][MORE] = {{SIDE, PART}, {PART}, {SIDE}, {NULL}}; /* not all bakes have them */
    const char *datasets[ALWAYS + MORE] = {field->dataset, "/points/object", "/points/texel", "/points/valid"};
    int status = kiln_allocate(rows, 1, sizeof **rows, "the points of a bake", error);
    if (status != KILN_OK)
        return status;
    struct kiln_point_dataset *r = *rows;
    r->objects = objects;
    status = KILN_NO_INPUT;
    for (size_t way = 0; status == KILN_NO_INPUT && way < WAYS; way++) {
        size_t count = ALWAYS;
        for (size_t k = 0; k < MORE && more[way][k] != NULL; k++)
            datasets[count++] = more[way][k];
        status = kiln_results_image(results, "kiln.h5", datasets, count, &r->image, error);
    }
    if (status == KILN_OK && !find_rows(r, field))
        status = kiln_fail(error, KILN_BAD_INPUT, "kiln.h5 does not say where the values of %s lie; bake again",
                           field->dataset);
    if (status == KILN_OK)
        status = sort_rows(r, error);
    if (status != KILN_OK)
        kiln_point_dataset_destroy(rows);
    return status;
}

int kiln_point_dataset_replace(struct kiln_point_dataset *r, const float *values, size_t components, uint64_t count,
                               struct kiln_error *error)
{
    if (count != r->image->width)
        return kiln_fail(error, KILN_BAD_INPUT, "kiln.h5 has %u surface points, and the scene %llu; bake again",
                         r->image->width, (unsigned long long)count);
    const int status = kiln_arena_allocate(&r->arena, &r->own, components * (size_t)count, sizeof *r->own,
                                           "the points of a bake", error);
    if (status != KILN_OK)
        return status;
    memcpy(r->own, values, components * (size_t)count * sizeof *r->own);
    for (size_t c = 0; c < 3; c++)
        r->value[c] = r->own + (c < components ? c : components - 1) * (size_t)count;
    return KILN_OK;
}

void kiln_point_dataset_destroy(struct kiln_point_dataset **rows)
{
    if (*rows == NULL)
        return;
    kiln_image_destroy(&(*rows)->image);
    kiln_arena_release(&(*rows)->arena);
    kiln_free(rows);
}

int kiln_point_map_create(struct kiln_image **image, const struct kiln_point_dataset *r, uint32_t object, bool back,
                          uint32_t width, uint32_t height, struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    float *planes[3];
    int status = kiln_image_create(image, width, height, names, 3, error);
    if (status != KILN_OK)
        return status;
    (void)kiln_image_rgb(*image, "", planes);
    for (size_t c = 0; c < 3; c++)
        for (size_t i = 0; i < (size_t)width * height; i++)
            planes[c][i] = NAN;
    for (uint32_t k = r->first[object]; status == KILN_OK && k < r->first[object + 1]; k++) {
        const uint32_t i = r->point[k];
        if ((r->side != NULL && (r->side[i] > 0.0f) != back) || (r->part != NULL && r->part[i] > 0.0f) ||
            (r->valid != NULL && !(r->valid[i] > 0.0f)))
            continue;
        if (!(r->x[i] < (float)width && r->y[i] < (float)height))
            status = kiln_fail(error, KILN_BAD_INPUT,
                               "kiln.h5 has a point at texel %.0f, %.0f of object %u, which has %u x %u; bake again",
                               (double)r->x[i], (double)r->y[i], object, width, height);
        for (size_t c = 0; c < 3 && status == KILN_OK; c++)
            planes[c][(size_t)r->y[i] * width + (size_t)r->x[i]] = r->value[c][i];
    }
    if (status != KILN_OK)
        kiln_image_destroy(image);
    return status;
}
