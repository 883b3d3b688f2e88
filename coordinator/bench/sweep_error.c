#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bench/sweep.h"

/* ---- the reference ---- */

int kiln_reference_open(struct kiln_sweep *sweep, struct kiln_error *error)
{
    int status = kiln_results_open(&sweep->reference_results, sweep->reference, error);
    if (status == KILN_OK)
        status = kiln_results_json(sweep->reference_results, "run.json", &sweep->reference_report, error);
    if (status == KILN_OK)
        status = kiln_results_scene(sweep->reference_results, &sweep->reference_scene, error);
    if (status != KILN_OK)
        return status;
    sweep->density = (double)sweep->reference_scene->header->texels_per_metre;
    sweep->cell_size =
        json_number_value(json_object_get(json_object_get(sweep->reference_report, "balance"), "cell_size"));
    sweep->reference_error =
        json_number_value(json_object_get(json_object_get(sweep->reference_report, "error"), "mean_relative"));
    return KILN_OK;
}

void kiln_reference_close(struct kiln_sweep *sweep)
{
    kiln_scene_close(&sweep->reference_scene);
    kiln_results_close(&sweep->reference_results);
    json_decref(sweep->reference_report);
    sweep->reference_report = NULL;
}

/* ---- comparing ---- */

struct pair {
    struct kiln_results *results[2]; /* of the bake, of the reference */
    struct kiln_scene *scenes[2];
    double differing; /* values that have other bits in the two */
};

/* The files that a scene was read from must be the same ones as the reference's. */
static int check_sources(const struct kiln_sweep *sweep, const json_t *report, struct kiln_error *error)
{
    const json_t *bake = json_object_get(json_object_get(report, "scene"), "sources"),
                 *reference = json_object_get(json_object_get(sweep->reference_report, "scene"), "sources");
    bool same = json_array_size(bake) == json_array_size(reference);
    for (size_t i = 0; same && i < json_array_size(bake); i++)
        same = json_equal(json_object_get(json_array_get(bake, i), "xxh3_128"),
                          json_object_get(json_array_get(reference, i), "xxh3_128"));
    return same ? KILN_OK
                : kiln_fail(error, KILN_BAD_INPUT,
                            "'%.300s' is a bake of another scene than '%.300s', or the scene has changed since: give "
                            "another --reference, or another --output",
                            sweep->reference, sweep->job->scene);
}

/* How many values of two images have other bits; all of the larger one if they differ in size or channels. */
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

static int add_object(struct pair *p, uint32_t object, struct kiln_texel_sums *sums, struct kiln_error *error)
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
        status = kiln_texels_add(sums, &in[0], &in[1], &inner);
        if (status != KILN_OK)
            (void)kiln_fail(error, status, "%s cannot be compared with the reference's: %s", name, inner.message);
    }
    kiln_image_destroy(&images[0]);
    kiln_image_destroy(&images[1]);
    return status;
}

static int add_all(const struct kiln_sweep *sweep, struct pair *p, struct kiln_texel_sums *sums,
                   struct kiln_error *error)
{
    const struct kiln_scene *scene = p->scenes[1];
    int status = KILN_OK;
    if (p->scenes[0]->object_count != scene->object_count)
        return kiln_fail(error, KILN_BAD_INPUT, "'%.500s' has %u objects, and the scene has %u: give another reference",
                         sweep->reference, (unsigned)scene->object_count, (unsigned)p->scenes[0]->object_count);
    for (uint32_t i = 0; status == KILN_OK && i < scene->object_count; i++)
        if (((scene->objects[i].flags | p->scenes[0]->objects[i].flags) & KILN_OBJECT_CASTER_ONLY) == 0)
            status = add_object(p, i, sums, error);
    if (status == KILN_OK && !(sums->reference > 0.0))
        status =
            kiln_fail(error, KILN_BAD_INPUT, "'%.500s' has no light: there is no error to measure", sweep->reference);
    return status;
}

int kiln_reference_compare(struct kiln_sweep *sweep, const json_t *report, struct kiln_setting_result *result,
                           struct kiln_error *error)
{
    struct pair p = {.results = {NULL, sweep->reference_results}, .scenes = {NULL, sweep->reference_scene}};
    struct kiln_texel_sums sums = {0};
    int status = check_sources(sweep, report, error);
    if (status == KILN_OK)
        status = kiln_results_open(&p.results[0], sweep->trial, error);
    if (status == KILN_OK)
        status = kiln_results_scene(p.results[0], &p.scenes[0], error);
    if (status == KILN_OK)
        status = add_all(sweep, &p, &sums, error);
    /* sqrt(sum of squares / 3 A) / (sum of light / 3 A); equal images are read with rounding */
    for (int i = 0; status == KILN_OK && i < KILN_LAYERS; i++)
        result->error[i] = p.differing > 0.0 ? sqrt(3.0 * sums.area * sums.squares[i]) / sums.reference : 0.0;
    result->differing = fmax(result->differing, p.differing);
    kiln_scene_close(&p.scenes[0]);
    kiln_results_close(&p.results[0]);
    return status;
}
