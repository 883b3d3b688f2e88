#include "coordinator/bake/reckon/kernels_kept.h"

#include <stdio.h>

#include "coordinator/files/kernel_cache.h"
#include "worker/scene/texture.h"

/* Kernels of a bake of diffuse light, more of one with gloss, more of one with light paths. A dining room with all of
 * these needs 37. */
enum { PLAIN = 16, OF_GLOSS = 10, OF_PATHS = 11 };

/* The kind of a bake: everything in it that chooses passes and their variants. */
static void kind_of(const struct kiln_job *job, const struct kiln_integrate_settings *settings,
                    const struct kiln_scene *scene, char *text, size_t size)
{
    uint32_t modes = 0, kinds = 0;
    for (size_t i = 0; i < scene->material_count; i++)
        modes |= 1u << scene->materials[i].alpha_mode | (uint32_t)(scene->materials[i].transmission > 0.0f) << 3 |
                 (uint32_t)(scene->materials[i].base_color_texture != KILN_NONE) << 4;
    for (size_t i = 0; i < scene->light_count; i++)
        kinds |= 1u << scene->lights[i].kind;
    (void)snprintf(
        text, size, "%s gloss%d caustics%d denoise%d probes%d guide%d store%d occlusion%d directional%d a%u l%u e%u",
        job->light.method != NULL ? job->light.method : "cells", kiln_job_takes_gloss(job) && scene->taken != NULL,
        (int)settings->caustics, kiln_job_denoises(job), job->volume.samples > 0, settings->guide, job->lightmaps.store,
        settings->occlusion != NULL, (int)settings->directional, modes, kinds, scene->environment->kind);
}

double kiln_kernels_missing(const struct kiln_job *job, const struct kiln_integrate_settings *settings,
                            const struct kiln_scene *scene)
{
    char kind[KILN_KERNEL_KIND];
    kind_of(job, settings, scene, kind, sizeof kind);
    if (kiln_kernel_cache_marked(job->machine.kernel_cache, kind))
        return 0.0;
    return PLAIN + (kiln_job_takes_gloss(job) && scene->taken != NULL ? OF_GLOSS : 0) +
           (settings->caustics >= KILN_CAUSTICS_LAND ? OF_PATHS : 0);
}

void kiln_kernels_mark(const struct kiln_job *job, const struct kiln_integrate_settings *settings,
                       const struct kiln_scene *scene)
{
    char kind[KILN_KERNEL_KIND];
    kind_of(job, settings, scene, kind, sizeof kind);
    kiln_kernel_cache_mark(job->machine.kernel_cache, kind);
}
