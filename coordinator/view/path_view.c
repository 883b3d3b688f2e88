#include "coordinator/view/path_view.h"

#include <math.h>

#include "worker/base/memory.h"
#include "worker/scene/gloss.h"

/* Samples of a pixel that are computed by one call. Sums of such groups are added in order, so this number affects the
 * rounding of every result. */
enum { STRETCH = 64, STRETCH_BIDIRECTIONAL = 8 };

struct kiln_path_view kiln_path_view_of(const struct kiln_view_camera *camera, uint32_t width, uint32_t height,
                                        int64_t bounces, uint32_t samples)
{
    return (struct kiln_path_view){.parameters = {.position = vec3_of(camera->position),
                                                  .forward = vec3_of(camera->forward),
                                                  .right = vec3_of(dvec3_scale(camera->right, camera->extent_x)),
                                                  .up = vec3_of(dvec3_scale(camera->up, camera->extent_y)),
                                                  .orthographic = camera->orthographic,
                                                  .width = width,
                                                  .height = height,
                                                  .bounces = bounces < 0 ? KILN_PATH_ALL_BOUNCES : (uint32_t)bounces},
                                   .samples = samples};
}

/* ---- sums ---- */

int kiln_path_sums_create(struct kiln_path_sums *sums, size_t first, size_t count, struct kiln_error *error)
{
    *sums = (struct kiln_path_sums){.first = first, .count = count};
    return kiln_allocate(&sums->pixels, count, sizeof *sums->pixels, "the pixels of a view", error);
}

void kiln_path_sums_destroy(struct kiln_path_sums *sums) { kiln_free(&sums->pixels); }

/* Context that takes results. */
struct taking {
    struct kiln_path_sums *sums;
    const struct kiln_path_progress *progress;
    double done, all; /* paths */
};

/* kiln_take_results */
static int take(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    struct taking *t = context;
    const struct kiln_path_result *r = results;
    const struct kiln_path_progress *progress = t->progress;
    struct kiln_path_sum *sums = &t->sums->pixels[first - t->sums->first];
    uint64_t paths = 0;
#pragma omp parallel for reduction(+ : paths) if (count > 1 << 14)
    for (size_t i = 0; i < count; i++) {
        for (int c = 0; c < 3; c++)
            sums[i].radiance[c] += (double)r[i].radiance[c];
        sums[i].square += (double)r[i].square;
        paths += r[i].count;
    }
    t->done += (double)paths;
    if (progress != NULL && progress->tell != NULL)
        progress->tell(progress->context, t->done / t->all);
    return progress != NULL && kiln_stop_asked(progress->stop) ? kiln_give_up(error) : KILN_OK;
}

static uint32_t stretch_of(const struct kiln_path_view *view)
{
    return view->both_ways ? STRETCH_BIDIRECTIONAL : STRETCH;
}

int kiln_path_sums_add(struct kiln_path_sums *sums, struct kiln_backend *backend, const struct kiln_path_view *view,
                       uint32_t samples, const struct kiln_path_progress *progress, struct kiln_splat_film *film,
                       uint64_t *rays, struct kiln_error *error)
{
    const struct kiln_bidirectional_parameters of_both = {
        .camera = view->parameters, .method = view->method, .radius = view->radius, .film = film};
    const void *parameters = view->both_ways ? (const void *)&of_both : &view->parameters;
    const struct kiln_pass *pass = view->both_ways ? &kiln_pass_bidirectional : &kiln_pass_path;
    const uint32_t stretch = stretch_of(view), end = sums->samples + samples;
    struct taking taking = {.sums = sums, .progress = progress, .all = (double)sums->count * samples};
    struct kiln_batch batch = {.first = sums->first, .count = sums->count, .take = take, .context = &taking};
    int status = KILN_OK;
    while (sums->samples < end && status == KILN_OK) {
        batch.first_sample = view->first + sums->samples;
        batch.samples = end - sums->samples < stretch ? end - sums->samples : stretch;
        if (sums->count > 0)
            status = kiln_backend_run(backend, pass, parameters, &batch, rays, error);
        sums->samples += batch.samples;
    }
    return status;
}

static void develop(const struct kiln_path_sum *sum, uint32_t samples, float rgb[3], float *error)
{
    for (int c = 0; c < 3; c++)
        rgb[c] = (float)(sum->radiance[c] / samples);
    if (error == NULL)
        return;
    const double n = samples, mean = kiln_luminance((const double[3]){(double)rgb[0], (double)rgb[1], (double)rgb[2]});
    *error = n > 1.0 ? (float)sqrt(fmax(0.0, sum->square / n - mean * mean) / (n - 1.0)) : 0.0f;
}

void kiln_path_sums_develop(const struct kiln_path_sums *sums, float *rgb, float *errors)
{
    for (size_t i = 0; i < sums->count; i++)
        develop(&sums->pixels[i], sums->samples, rgb + 3 * i, errors != NULL ? errors + i : NULL);
}

int kiln_path_view_pixels(struct kiln_backend *backend, const struct kiln_path_view *view, size_t first, size_t count,
                          const struct kiln_path_progress *progress, struct kiln_splat_film *film, float *rgb,
                          float *errors, uint64_t *rays, struct kiln_error *error)
{
    struct kiln_path_sums sums;
    int status;
    KILN_TRY(kiln_path_sums_create(&sums, first, count, error));
    KILN_TRY(kiln_path_sums_add(&sums, backend, view, view->samples, progress, film, rays, error));
    kiln_path_sums_develop(&sums, rgb, errors);
end:
    kiln_path_sums_destroy(&sums);
    return status;
}

void kiln_path_view_add_film(const struct kiln_path_view *view, uint32_t samples, const struct kiln_splat_film *film,
                             float *rgb)
{
    const size_t count = (size_t)view->parameters.width * view->parameters.height;
    for (size_t i = 0; i < 3 * count; i++)
        rgb[i] = (float)((double)rgb[i] + (double)film->sums[i] * film->unit / samples);
}

int kiln_path_view_check(const struct kiln_scene *scene, struct kiln_error *error)
{
    for (size_t i = 0; i < scene->object_count; i++)
        if ((scene->objects[i].flags & KILN_OBJECT_RECEIVER_ONLY) != 0)
            return kiln_fail(error, KILN_USAGE,
                             "--method path: the object '%.200s' only receives light, and the path tracer has no rays "
                             "that meet it from the camera alone; --method lightmaps shows it",
                             kiln_scene_string(scene, scene->objects[i].name));
    return KILN_OK;
}

bool kiln_path_view_misses(const struct kiln_scene *scene, const struct kiln_lights *lights)
{
    bool mirrors = false;
    for (uint32_t i = 0; i < scene->material_count && !mirrors; i++)
        mirrors = kiln_gloss_taken(scene, i) != NULL && kiln_gloss_has_mirror(kiln_gloss_taken(scene, i));
    return mirrors && lights->point_count + lights->directional_count > 0;
}
