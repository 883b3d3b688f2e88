#include "worker/backend/vulkan/spheres.h"

#include <math.h>

#include "worker/base/memory.h"
#include "worker/light/aims.h"
#include "worker/pass/spheres.h"

/* Margins for rounding on the device, in spacings: a fixed one, and one per spacing along an axis */
#define SLACK 1e-3
#define SLACK_OF_SIZE 1e-6

static const char what[] = "the spheres of probes";

_Static_assert(KILN_GPU_SPHERE_SUMS == KILN_SPHERE_SUMS, "whole numbers of a sphere");
_Static_assert(sizeof(struct kiln_sphere) == 4 * sizeof(float), "as kernels read it");

/* Reach of the spheres along each axis, in spacings: the largest distance from a probe's place in the grid to the far
 * side of its sphere. It has a margin for rounding on the device. */
static struct kiln_vec3 find_reach(const struct kiln_probe_spheres *s)
{
    double reach[3] = {0.0, 0.0, 0.0};
    for (size_t i = 0; i < s->count; i++) {
        const uint64_t number = s->first + i, at[3] = {number % s->size[0], number / s->size[0] % s->size[1],
                                                       number / (s->size[0] * s->size[1])};
        const struct kiln_sphere *sphere = &s->sphere[i];
        for (int a = 0; a < 3 && sphere->radius > 0.0f; a++) {
            const double off = fabs((double)sphere->centre[a] - s->origin[a] - (double)at[a] * s->spacing[a]);
            reach[a] = fmax(reach[a], (off + (double)sphere->radius) / s->spacing[a]);
        }
    }
    for (int a = 0; a < 3; a++)
        reach[a] += SLACK + SLACK_OF_SIZE * (double)s->size[a];
    return vec3((float)reach[0], (float)reach[1], (float)reach[2]);
}

static int upload(struct vulkan_backend *b, int array, const void *data, size_t bytes, struct kiln_error *error)
{
    return gpu_buffer_of(b->gpu, &b->spheres[array], data, bytes, what, error);
}

/* Uploads for each aim its number of paths over its flux, if its paths leave light in spheres. */
static int upload_paths(struct vulkan_backend *b, const struct kiln_aims *aims, uint32_t leaves,
                        struct kiln_error *error)
{
    float *paths = NULL;
    int status;
    KILN_TRY(kiln_allocate(&paths, aims->count, sizeof *paths, what, error));
    for (size_t i = 0; i < aims->count; i++)
        if (kiln_aims_is_left(aims, i, leaves) && aims->aims[i].flux > 0.0)
            paths[i] = (float)((double)(aims->first[i + 1] - aims->first[i]) / aims->aims[i].flux);
    KILN_TRY(upload(b, VULKAN_SPHERES_PATHS, paths, aims->count * sizeof *paths, error));
end:
    kiln_free(&paths);
    return status;
}

static struct kiln_gpu_spheres describe(const struct vulkan_backend *b, const struct kiln_aims *aims,
                                        const struct kiln_probe_spheres *s)
{
    const struct gpu_buffer *arrays = b->spheres;
    const uint64_t layer = s->size[0] * s->size[1];
    return (struct kiln_gpu_spheres){.spheres = arrays[VULKAN_SPHERES_SPHERES].address,
                                     .clear = arrays[VULKAN_SPHERES_CLEAR].address,
                                     .paths = arrays[VULKAN_SPHERES_PATHS].address,
                                     .sums = arrays[VULKAN_SPHERES_SUMS].address,
                                     .moments = arrays[VULKAN_SPHERES_MOMENTS].address,
                                     .first = s->first,
                                     .count = (uint32_t)s->count,
                                     .aims = (uint32_t)aims->count,
                                     .size = {(uint32_t)s->size[0], (uint32_t)s->size[1], (uint32_t)s->size[2]},
                                     .low = (uint32_t)(s->first / layer),
                                     .high = (uint32_t)((s->first + s->count - 1) / layer),
                                     .origin = vec3((float)s->origin[0], (float)s->origin[1], (float)s->origin[2]),
                                     .spacing = vec3((float)s->spacing[0], (float)s->spacing[1], (float)s->spacing[2]),
                                     .reach = find_reach(s),
                                     .diameter = (float)(2.0 * s->radius),
                                     .units = (float)(2.0 * s->radius / s->unit)};
}

int vulkan_spheres_create(struct both_run *r, const struct kiln_aims *aims, const struct kiln_probe_spheres *s,
                          struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    int status = upload(b, VULKAN_SPHERES_SPHERES, s->sphere, s->count * sizeof *s->sphere, error);
    if (status == KILN_OK)
        status = upload(b, VULKAN_SPHERES_CLEAR, s->clear, s->count * sizeof *s->clear, error);
    if (status == KILN_OK)
        status = upload_paths(b, aims, s->leaves, error);
    if (status == KILN_OK)
        status = both_make_zeros(r, &b->spheres[VULKAN_SPHERES_SUMS], s->count * KILN_SPHERE_SUMS * sizeof *s->sums,
                                 what, error);
    if (status == KILN_OK)
        status = both_make_zeros(r, &b->spheres[VULKAN_SPHERES_MOMENTS], (aims->count + 1) * sizeof *s->moments, what,
                                 error);
    const struct kiln_gpu_spheres root = describe(b, aims, s);
    return status == KILN_OK ? upload(b, VULKAN_SPHERES_ROOT, &root, sizeof root, error) : status;
}

int vulkan_spheres_add(struct vulkan_backend *b, const struct kiln_aims *aims, const struct kiln_probe_spheres *s,
                       uint64_t *rays, struct kiln_error *error)
{
    const size_t count = s->count * KILN_SPHERE_SUMS;
    uint64_t *sums = NULL, *moments = NULL;
    int status;
    KILN_TRY(kiln_allocate(&sums, count, sizeof *sums, what, error));
    KILN_TRY(kiln_allocate(&moments, aims->count + 1, sizeof *moments, what, error));
    KILN_TRY(gpu_download(b->gpu, &b->spheres[VULKAN_SPHERES_SUMS], 0, sums, count * sizeof *sums, error));
    KILN_TRY(gpu_download(b->gpu, &b->spheres[VULKAN_SPHERES_MOMENTS], 0, moments, (aims->count + 1) * sizeof *moments,
                          error));
#pragma omp parallel for schedule(static) num_threads((int)b->threads)
    for (size_t i = 0; i < count; i++)
        s->sums[i] += sums[i];
    for (size_t i = 0; i < aims->count; i++)
        s->moments[i] += moments[i];
    *rays += moments[aims->count];
    b->returned += count * sizeof *sums + (aims->count + 1) * sizeof *moments;
end:
    kiln_free(&sums);
    kiln_free(&moments);
    return status;
}

void vulkan_spheres_release(struct vulkan_backend *b)
{
    for (int i = 0; i < VULKAN_SPHERE_ARRAYS; i++)
        gpu_buffer_destroy(b->gpu, &b->spheres[i]);
}
