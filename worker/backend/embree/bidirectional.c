/* The bidirectional pass (worker/pass/bidirectional.h): sample by sample, on all threads. */
#include <math.h>
#include <omp.h>
#include <string.h>

#include "shaders/shared/color.h"
#include "worker/backend/embree/bidirectional_subpaths.h"
#include "worker/base/memory.h"

static struct bidirectional make(const struct embree_backend *b, const struct kiln_bidirectional_parameters *p,
                                 const struct kiln_emission *emission)
{
    const struct kiln_path_parameters *c = &p->camera;
    const uint32_t low = (uint32_t)b->params.seed, high = (uint32_t)(b->params.seed >> 32);
    const bool connects = p->method == KILN_BIDIRECTIONAL_BDPT || p->method == KILN_BIDIRECTIONAL_VCM ||
                          p->method == KILN_BIDIRECTIONAL_VCM_SINGLE;
    const bool own = p->method == KILN_BIDIRECTIONAL_VCM_SINGLE;
    const uint64_t paths = (uint64_t)c->width * c->height;
    return (struct bidirectional){
        .b = b,
        .parameters = p,
        .emission = emission,
        .paths = paths,
        .pixel = 4.0 * (double)vec3_length(c->right) * (double)vec3_length(c->up) / (double)paths,
        .most = c->bounces == KILN_PATH_ALL_BOUNCES ? INT64_MAX / 2 : (int64_t)c->bounces,
        .seed = kiln_hash2(low, high ^ KILN_PATH_SEED),
        .light_seed = kiln_hash2(low, high ^ KILN_LIGHT_PATH_SEED),
        .connects = connects,
        .merges = p->method != KILN_BIDIRECTIONAL_LIGHT && p->method != KILN_BIDIRECTIONAL_BDPT,
        .own_alone = own,
        .merged_paths = own ? 1.0 : (double)paths};
}

static void begin_sample(struct bidirectional *all, uint32_t k)
{
    all->radius = kiln_merge_radius(all->parameters->radius, k);
    const double area = KILN_PI * all->radius * all->radius * all->merged_paths;
    if (all->merges)
        all->techniques = (struct kiln_path_techniques){.merges = area, .connections = 1.0 / area};
}

/* Whether any thread has failed. */
static int check(const struct subpaths *walks, uint32_t threads, struct kiln_error *error)
{
    for (uint32_t t = 0; t < threads; t++)
        if (walks[t].status != KILN_OK) {
            if (error != NULL)
                *error = walks[t].error;
            return walks[t].status;
        }
    return KILN_OK;
}

int subpaths_trace_photons(const struct bidirectional *all, struct subpaths *walks, uint32_t k,
                           struct photon_grid **grid, struct kiln_error *error)
{
    const uint32_t threads = all->b->threads;
    struct photon_list *lists = NULL;
    int status = kiln_allocate(&lists, threads, sizeof *lists, "photons", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel num_threads((int)threads)
    {
        struct subpaths *w = &walks[omp_get_thread_num()];
        const unsigned saved = embree_enter();
        const double begin = embree_thread_seconds();
        w->photons.count = 0;
#pragma omp for schedule(dynamic, 64) nowait
        for (uint64_t i = 0; i < all->paths; i++) {
            subpaths_trace_light(w, i, k);
            subpaths_keep_photons(w, i);
        }
        w->seconds += embree_thread_seconds() - begin;
        embree_leave(saved);
    }
    for (uint32_t t = 0; t < threads; t++)
        lists[t] = walks[t].photons;
    status = check(walks, threads, error);
    if (status == KILN_OK)
        status = photon_grid_create(grid, lists, threads, all->radius, error);
    kiln_free(&lists);
    return status;
}

/* Adds a sample to a pixel's result. */
static void trace_pixel(struct subpaths *w, uint64_t pixel, uint32_t k, struct kiln_path_result *result)
{
    const struct bidirectional *all = w->all;
    const bool splats = all->connects || all->parameters->method == KILN_BIDIRECTIONAL_LIGHT;
    if (splats) {
        subpaths_trace_light(w, pixel, k);
        subpaths_splat(w);
    }
    if (all->own_alone) {
        w->photons.count = 0;
        subpaths_keep_photons(w, pixel);
    }
    subpaths_trace_eye(w, pixel, k);
    const double luminance = kiln_luminance(w->radiance);
    result->square += (float)(luminance * luminance);
    for (int c = 0; c < 3; c++)
        result->radiance[c] += (float)w->radiance[c];
    result->count++;
}

static int trace_sample(struct bidirectional *all, struct subpaths *walks, uint32_t k, const struct kiln_batch *part,
                        struct kiln_path_result *results, struct kiln_error *error)
{
    struct photon_grid *grid = NULL;
    begin_sample(all, k);
    int status = all->merges && !all->own_alone ? subpaths_trace_photons(all, walks, k, &grid, error) : KILN_OK;
    all->grid = grid;
    if (status == KILN_OK) {
#pragma omp parallel num_threads((int)all->b->threads)
        {
            struct subpaths *w = &walks[omp_get_thread_num()];
            const unsigned saved = embree_enter();
            const double begin = embree_thread_seconds();
#pragma omp for schedule(dynamic, 16) nowait
            for (size_t i = 0; i < part->count; i++)
                if (!kiln_batch_leaves_out(part, part->first + i))
                    trace_pixel(w, (uint64_t)part->first + i, k, &results[i]);
            w->seconds += embree_thread_seconds() - begin;
            embree_leave(saved);
        }
        status = check(walks, all->b->threads, error);
    }
    photon_grid_destroy(&grid);
    all->grid = NULL;
    return status;
}

int embree_bidirectional(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                         uint64_t *rays, struct kiln_error *error)
{
    const struct kiln_bidirectional_parameters *p = parameters;
    struct kiln_emission *emission = NULL;
    struct subpaths *walks = NULL;
    memset(results, 0, part->count * sizeof(struct kiln_path_result));
    int status;
    KILN_TRY(kiln_emission_create(&emission, b->params.lights, error));
    KILN_TRY(kiln_allocate(&walks, b->threads, sizeof *walks, "bidirectional paths", error));
    struct bidirectional all = make(b, p, emission);
    p->film->unit = kiln_emission_splat_unit(emission);
    for (uint32_t t = 0; t < b->threads; t++) {
        walks[t].all = &all;
        embree_context(b, &walks[t].context);
    }
    for (uint32_t i = 0; i < part->samples; i++)
        KILN_TRY(trace_sample(&all, walks, part->first_sample + i, part, results, error));
end:
    for (uint32_t t = 0; walks != NULL && t < b->threads; t++) {
        *rays += walks[t].rays;
        b->thread_seconds += walks[t].seconds;
        subpaths_release(&walks[t]);
    }
    kiln_free(&walks);
    kiln_emission_destroy(&emission);
    return status;
}
