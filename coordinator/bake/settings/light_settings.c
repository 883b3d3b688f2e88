#include "coordinator/bake/settings/light_settings.h"

#include "coordinator/integrate/integrator.h"
#include "coordinator/job/options.h"

/* Samples in whose place each of four parts of the first round has a sixteenth, where --quality asks for an error
 * (integrate/parts/rounds.h). */
enum { FIRST_DIRECT = 32, FIRST_BOUNCE = 16, FIRST_INDIRECT = 64 };
/* Iterations of a part's light paths there: pilots take as many as one, and a device takes longer for many small ones.
 * And the rays of a point, in all parts, that light paths are counted by. */
enum { FIRST_ITERATIONS = 4, FIRST_RAYS = FIRST_INDIRECT / 4 };

/* Number of iterations of a step of light paths in the first round. */
static uint32_t iterations_of(const struct kiln_job *job)
{
    if (kiln_job_goes_on(job) && !kiln_job_given(job, kiln_option_find_for("iterations", KILN_FOR_BAKE)))
        return job->light.iterations > 0 ? FIRST_ITERATIONS : 0;
    return job->light.iterations == KILN_ITERATIONS_ALL ? KILN_ITERATIONS_FIRST : job->light.iterations;
}

uint32_t kiln_light_photons(const struct kiln_job *job, uint64_t points)
{
    enum { LEAST = 1 << 15, MOST = 1 << 21, RAYS_A_PATH = 4 };
    if (job->light.photons > 0 || job->light.iterations == 0)
        return job->light.photons;
    const uint64_t rays = kiln_job_goes_on(job) ? FIRST_RAYS : job->light.samples_indirect,
                   photons = points * rays / RAYS_A_PATH / iterations_of(job),
                   bounded = photons < LEAST  ? LEAST
                             : photons > MOST ? MOST
                                              : photons;
    return (uint32_t)(bounded / kiln_job_parts(job)); /* each part of a bake has its own */
}

struct kiln_integrate_settings kiln_light_settings(const struct kiln_job *job, const struct kiln_lights *lights,
                                                   uint64_t points)
{
    const bool rounds = job->light.published_error > 0.0;
    return (struct kiln_integrate_settings){
        .integrator = kiln_integrator_find(job->light.method != NULL ? job->light.method : kiln_integrator_names[0]),
        .schedule = job->light.schedule,
        .bounces = job->light.bounces,
        .tail = job->light.tail,
        .samples_direct = rounds ? FIRST_DIRECT : job->light.samples_direct,
        .samples_bounce = rounds ? FIRST_BOUNCE : job->light.samples_bounce,
        .samples_indirect = rounds ? FIRST_INDIRECT : job->light.samples_indirect,
        .samples_quantity = job->light.samples_indirect,
        .indirect_scale = 1u << job->light.indirect_scale,
        .final_scale = 1u << job->light.final_scale,
        .caustics = kiln_job_has_caustics(job) ? (enum kiln_caustics)job->light.caustics : KILN_CAUSTICS_NONE,
        .caustics_tried = job->light.caustics_tried,
        .mis = (enum kiln_mis)job->light.mis,
        .photons = kiln_light_photons(job, points),
        .iterations = iterations_of(job),
        .iterations_grow = job->light.iterations == KILN_ITERATIONS_ALL,
        .merge_radius = job->light.merge_radius,
        .radius_alpha = job->light.radius_alpha,
        .photons_given = job->light.photons > 0,
        .guide = job->light.guide > 0,
        .seen_only = job->light.only_visible_from != NULL,
        .compact = kiln_exchange_is_compact(job->ranks.exchange, points),
        .seed = job->light.seed,
        .parts = kiln_job_parts(job),
        .target_error = job->light.target_error,
        .published_error = job->light.published_error,
        .time = job->light.time,
        .rounds = job->light.round_list,
        .lights = lights->area_count + lights->point_count + lights->directional_count + lights->environment,
        .radiance = kiln_job_has_probes(job) ? &job->light.radiance : NULL,
        .reference = kiln_job_is_reference(job) ? &job->light.paths : NULL,
        .patches = kiln_job_is_radiosity(job) ? &job->light.patches : NULL,
        .occlusion = job->light.occlusion.distance > 0.0 ? &job->light.occlusion : NULL,
        .directional = (enum kiln_directional)job->light.directional,
        .work_stealing = job->ranks.work_stealing,
        .rebalance = (enum kiln_rebalance)job->ranks.rebalance,
        .whole_objects = job->ranks.partition_objects,
        .probes = job->volume.samples > 0,
        .visible_only = job->ranks.exchange_points == KILN_EXCHANGE_VISIBLE,
        .exchange_limit = job->faults.exchange_limit,
        .faults = job->faults};
}
