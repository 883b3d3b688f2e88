#include "coordinator/view/path_view.h"

#include <math.h>

#include "worker/base/memory.h"

/* Paths of a pixel that are asked for at once. The sums of such stretches are added up in their order, so this number
 * is part of every result's bits. */
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

/* What is added up of a pixel. */
struct sum {
    double radiance[3], square;
    uint32_t count;
};

struct film {
    struct sum *sums;
    size_t first; /* pixel */
    const struct kiln_path_progress *progress;
    double done, all; /* paths */
};

/* kiln_take_results */
static int take(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    struct film *film = context;
    const struct kiln_path_result *r = results;
    const struct kiln_path_progress *progress = film->progress;
    for (size_t i = 0; i < count; i++) {
        struct sum *sum = &film->sums[first - film->first + i];
        for (int c = 0; c < 3; c++)
            sum->radiance[c] += (double)r[i].radiance[c];
        sum->square += (double)r[i].square;
        sum->count += r[i].count;
        film->done += r[i].count;
    }
    if (progress != NULL && progress->tell != NULL)
        progress->tell(progress->context, film->done / film->all);
    return progress != NULL && kiln_stop_asked(progress->stop) ? kiln_give_up(error) : KILN_OK;
}

static void develop(const struct sum *sum, float rgb[3], float *error)
{
    for (int c = 0; c < 3; c++)
        rgb[c] = (float)(sum->radiance[c] / sum->count);
    if (error == NULL)
        return;
    const double n = sum->count,
                 mean = kiln_luminance((const double[3]){(double)rgb[0], (double)rgb[1], (double)rgb[2]});
    *error = n > 1.0 ? (float)sqrt(fmax(0.0, sum->square / n - mean * mean) / (n - 1.0)) : 0.0f;
}

int kiln_path_view_pixels(struct kiln_backend *backend, const struct kiln_path_view *view, size_t first, size_t count,
                          const struct kiln_path_progress *progress, struct kiln_splat_film *splats, float *rgb,
                          float *errors, uint64_t *rays, struct kiln_error *error)
{
    const struct kiln_bidirectional_parameters of_both = {
        .camera = view->parameters, .method = view->method, .radius = view->radius, .film = splats};
    const void *parameters = view->both_ways ? (const void *)&of_both : &view->parameters;
    const uint32_t stretch = view->both_ways ? STRETCH_BIDIRECTIONAL : STRETCH;
    struct film film = {.first = first, .progress = progress, .all = (double)count * view->samples};
    int status = kiln_allocate(&film.sums, count, sizeof *film.sums, "the pixels of a view", error);
    struct kiln_batch batch = {.first = first, .count = count, .take = take, .context = &film};
    for (uint32_t done = 0; done < view->samples && status == KILN_OK; done += batch.samples) {
        batch.first_sample = done;
        batch.samples = view->samples - done < stretch ? view->samples - done : stretch;
        status = kiln_backend_run(backend, view->both_ways ? &kiln_pass_bidirectional : &kiln_pass_path, parameters,
                                  &batch, rays, error);
    }
    for (size_t i = 0; i < count && status == KILN_OK; i++)
        develop(&film.sums[i], rgb + 3 * i, errors != NULL ? errors + i : NULL);
    kiln_free(&film.sums);
    return status;
}

void kiln_path_view_add_film(const struct kiln_path_view *view, const struct kiln_splat_film *film, float *rgb)
{
    const size_t count = (size_t)view->parameters.width * view->parameters.height;
    for (size_t i = 0; i < 3 * count; i++)
        rgb[i] = (float)((double)rgb[i] + (double)film->sums[i] * film->unit / view->samples);
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
