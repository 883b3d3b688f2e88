#include "coordinator/cli/compare_area.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/files/json.h"
#include "coordinator/output/image.h"
#include "coordinator/output/read/results.h"
#include "coordinator/view/compare_surface.h"

struct pair {
    struct kiln_results *results[2]; /* a, b */
    struct kiln_scene *scenes[2];
    struct kiln_texel_sums sums;
    double differing; /* number of values whose bits differ */
};

/* Counts the values of two images that have other bits; all of the larger one if they differ in size or channels. */
static double count_differing(const struct kiln_image *a, const struct kiln_image *b)
{
    const size_t sizes[2] = {(size_t)a->width * a->height, (size_t)b->width * b->height};
    uint64_t differing = 0;
    if (a->width != b->width || a->height != b->height || a->channel_count != b->channel_count)
        return fmax((double)(sizes[0] * a->channel_count), (double)(sizes[1] * b->channel_count));
    for (size_t c = 0; c < a->channel_count; c++) {
        const bool same_name = strcmp(a->channels[c].name, b->channels[c].name) == 0;
        for (size_t i = 0; i < sizes[0]; i++)
            differing += !same_name || memcmp(&a->channels[c].values[i], &b->channels[c].values[i], sizeof(float)) != 0;
    }
    return (double)differing;
}

static int add_object(struct pair *p, uint32_t object, struct kiln_error *error)
{
    static const char *const wanted[] = {"R",        "G",          "B",          "direct.R",   "direct.G",
                                         "direct.B", "indirect.R", "indirect.G", "indirect.B", "validity.Y"};
    struct kiln_compared in[2];
    struct kiln_image *images[2] = {NULL, NULL};
    struct kiln_error inner = {{0}};
    char name[300];
    int status = KILN_OK;
    for (int i = 0; status == KILN_OK && i < 2; i++) {
        (void)snprintf(name, sizeof name, "lightmaps/%s.exr",
                       kiln_scene_string(p->scenes[i], p->scenes[i]->objects[object].name));
        status = kiln_results_image(p->results[i], name, wanted, sizeof wanted / sizeof *wanted, &images[i], error);
        in[i] = (struct kiln_compared){.scene = p->scenes[i], .object = object, .lightmap = images[i]};
    }
    if (status == KILN_OK) {
        p->differing += count_differing(images[0], images[1]);
        status = kiln_texels_add(&p->sums, &in[0], &in[1], &inner);
        if (status != KILN_OK)
            (void)kiln_fail(error, status, "%s cannot be compared with the reference's: %s", name, inner.message);
    }
    kiln_image_destroy(&images[0]);
    kiln_image_destroy(&images[1]);
    return status;
}

static int add_all(struct pair *p, struct kiln_error *error)
{
    const struct kiln_scene *scene = p->scenes[1];
    int status = KILN_OK;
    if (p->scenes[0]->object_count != scene->object_count)
        return kiln_fail(error, KILN_BAD_INPUT, "the reference has %u objects, and the bake has %u",
                         (unsigned)scene->object_count, (unsigned)p->scenes[0]->object_count);
    for (uint32_t i = 0; i < scene->object_count; i++)
        if (((scene->objects[i].flags | p->scenes[0]->objects[i].flags) & KILN_OBJECT_CASTER_ONLY) == 0)
            KILN_TRY(add_object(p, i, error));
    if (!(p->sums.reference > 0.0))
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "the reference has no light: there is no error to measure"));
end:
    return status;
}

/* Returns the error of a layer: the root mean square difference over the mean light of the reference, sqrt(squares / 3
 * A) / (light / 3 A) with area A. It is 0 if all bits are equal; otherwise rounding of lightmaps as they are read would
 * show as an error. */
static double error_of(const struct pair *p, int layer)
{
    return p->differing > 0.0 ? sqrt(3.0 * p->sums.area * p->sums.squares[layer]) / p->sums.reference : 0.0;
}

json_t *kiln_compare_by_area(struct kiln_results *a, struct kiln_results *b)
{
    struct pair p = {.results = {a, b}};
    struct kiln_error error = {{0}};
    int status;
    KILN_TRY(kiln_results_scene(a, &p.scenes[0], &error));
    KILN_TRY(kiln_results_scene(b, &p.scenes[1], &error));
    KILN_TRY(add_all(&p, &error));
end:
    kiln_scene_close(&p.scenes[0]);
    kiln_scene_close(&p.scenes[1]);
    if (status != KILN_OK)
        return json_pack("{s:o}", "why", kiln_json_string(error.message));
    return json_pack("{s:f, s:f, s:f, s:f}", "nrmse", error_of(&p, 0), "nrmse_direct", error_of(&p, 1),
                     "nrmse_indirect", error_of(&p, 2), "values_that_differ", p.differing);
}
