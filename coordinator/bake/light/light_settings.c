#include "coordinator/bake/light/light_settings.h"

#include "coordinator/integrate/integrator.h"

/* Iterations of a step in the first round. */
static uint32_t iterations_of(const struct kiln_job *job)
{
    return job->iterations == KILN_ITERATIONS_ALL ? KILN_ITERATIONS_FIRST : job->iterations;
}

uint32_t kiln_light_photons(const struct kiln_job *job, uint64_t points)
{
    enum { LEAST = 1 << 15, MOST = 1 << 21, RAYS_A_PATH = 4 };
    if (job->photons > 0 || job->iterations == 0)
        return job->photons;
    const uint64_t photons = points * job->samples_indirect / RAYS_A_PATH / iterations_of(job),
                   bounded = photons < LEAST  ? LEAST
                             : photons > MOST ? MOST
                                              : photons;
    return (uint32_t)(bounded / kiln_job_parts(job)); /* each part of a bake has its own */
}

struct kiln_integrate_settings kiln_light_settings(const struct kiln_job *job, const struct kiln_lights *lights,
                                                   uint64_t points)
{
    return (struct kiln_integrate_settings){
        .integrator = kiln_integrator_find(job->method != NULL ? job->method : kiln_integrator_names[0]),
        .schedule = job->schedule,
        .bounces = job->bounces,
        .tail = job->tail,
        .samples_direct = job->samples_direct,
        .samples_bounce = job->samples_bounce,
        .samples_indirect = job->samples_indirect,
        .indirect_scale = 1u << job->indirect_scale,
        .final_scale = 1u << job->final_scale,
        .caustics = kiln_job_has_caustics(job) ? (enum kiln_caustics)job->caustics : KILN_CAUSTICS_NONE,
        .caustics_tried = job->caustics_tried,
        .mis = (enum kiln_mis)job->mis,
        .photons = kiln_light_photons(job, points),
        .iterations = iterations_of(job),
        .iterations_grow = job->iterations == KILN_ITERATIONS_ALL,
        .merge_radius = job->merge_radius,
        .radius_alpha = job->radius_alpha,
        .photons_given = job->photons > 0,
        .guide = job->guide > 0,
        .seen_only = job->only_visible_from != NULL,
        .compact = kiln_exchange_is_compact(job->exchange, points),
        .seed = job->seed,
        .parts = kiln_job_parts(job),
        .target_error = job->target_error,
        .lights = lights->area_count + lights->point_count + lights->directional_count + lights->environment,
        .radiance = kiln_job_has_probes(job) ? &job->radiance : NULL,
        .reference = kiln_job_is_reference(job) ? &job->paths : NULL,
        .patches = kiln_job_is_radiosity(job) ? &job->patches : NULL,
        .occlusion = job->occlusion.distance > 0.0 ? &job->occlusion : NULL,
        .directional = (enum kiln_directional)job->directional,
        .work_stealing = job->work_stealing,
        .rebalance = (enum kiln_rebalance)job->rebalance,
        .whole_objects = job->partition_objects,
        .probes = job->samples_probe > 0,
        .visible_only = job->exchange_points == KILN_EXCHANGE_VISIBLE,
        .exchange_limit = job->exchange_limit,
        .faults = job->faults};
}
