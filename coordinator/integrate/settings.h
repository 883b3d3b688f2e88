/* Settings for the light of a bake: those of the integrators, and those of the lockstep runner. Plain values;
 * coordinator/bake/settings/light_settings.h fills them in from a job. */
#ifndef KILN_COORDINATOR_INTEGRATE_SETTINGS_H
#define KILN_COORDINATOR_INTEGRATE_SETTINGS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/job/choices.h"
#include "coordinator/job/faults.h"
#include "worker/pass/caustic_weights.h"
#include "worker/pass/occlusion.h"
#include "worker/pass/reference.h"

struct kiln_integrator;

struct kiln_integrate_settings {
    const struct kiln_integrator *integrator;

    /* the steps and their work; `next` of an integrator reads only these */
    enum kiln_schedule schedule;
    int64_t bounces; /* indirect bounces; -1: until little energy is left, then a tail */
    bool tail;       /* add the geometric tail after the last bounce, though `bounces` is given */
    uint32_t samples_direct, samples_bounce, samples_indirect;
    uint32_t samples_quantity;   /* rays of a quantity (quantity.h) */
    uint32_t indirect_scale;     /* side of a block in bounces (blocks.h), texels: a power of two; 1: no blocks */
    uint32_t final_scale;        /* side of a block in the final gather (nodes.h), likewise */
    enum kiln_caustics caustics; /* resolved, never AUTO; up to KILN_CAUSTICS_NONE there is no such step */
    bool caustics_tried; /* of KILN_CAUSTICS_VCM: pilots decide whether caustics are worth their noise (land_trial.h) */
    enum kiln_mis mis;   /* of KILN_CAUSTICS_VCM: how techniques are weighed */
    uint32_t photons, iterations; /* of the light paths (land.h) of a step; if iterations grow: of the first round */
    bool iterations_grow; /* iterations grow with the samples from round to round (rounds.h); needs a target error */
    double merge_radius, radius_alpha; /* of KILN_CAUSTICS_MERGE, _VCM (land.h): m, or KILN_MERGE_RADIUS_AUTO, _TEXEL */
    bool photons_given;                /* photons given by the user: too few are refused; else their number is raised */
    bool guide;     /* bounces learn the incident light, and the final gather samples by it (worker/pass/guided.h) */
    bool seen_only; /* the final gather and quantities skip unseen tile runs (struct kiln_rank_data) */
    bool compact;   /* exchange radiosity in 4 bytes a point where an integrator permits it: kiln_exchange_is_compact
                     */
    uint64_t seed;
    uint32_t parts;      /* number of parts of the bake (parts.h): KILN_PARTS to know its errors, or 1 */
    double target_error; /* relative; rounds follow until each texel's standard error is below it (rounds.h); 0: none */
    /* relative; rounds follow until 95 % of the texels stay below it with their published light (published.h); 0: none.
     * At most one of the two targets is given */
    double published_error;
    double time; /* with published_error: s of the whole run, after which there is no round; 0: any (rounds_time.h) */
    struct kiln_round_list rounds; /* with published_error: --rounds */
    bool goes_on;  /* private to parts.c: the steps are those of a part that starts from the light of earlier rounds */
    size_t lights; /* of the scene: emitting triangles, punctual lights, suns, the environment */

    /* range of gather rays, and the probes used beyond it (radiance.h); borrowed; NULL: unlimited rays. `next` of an
     * integrator does not read it */
    const struct kiln_radiance_settings *radiance;
    /* parameters of paths from surface points (reference/); borrowed; NULL: the integrator has none */
    const struct kiln_reference_parameters *reference;
    /* parameters of gathering from patches (radiosity/, patches.h); borrowed; NULL: the integrator has none */
    const struct kiln_patch_settings *patches;

    /* additional quantities (quantity.h); `next` of an integrator does not read these */
    const struct kiln_occlusion_parameters *occlusion; /* borrowed; NULL: no ambient occlusion */
    enum kiln_directional directional;

    /* how the ranks work together; none of these changes a result */
    bool work_stealing; /* idle ranks compute points for others of their node */
    enum kiln_rebalance rebalance;
    bool whole_objects;      /* new ranges of points begin at objects rather than at cells */
    bool probes;             /* probes gather the total radiosity of all points at the end */
    bool visible_only;       /* nodes receive the radiosity of what their points see (sight.h) */
    uint64_t exchange_limit; /* largest count of elements in an MPI call; 0: MPI's own limit */

    struct kiln_faults faults; /* for tests: which rank is slow */
};

/* Whether rounds of parts follow until the error is small enough. */
static inline bool kiln_has_rounds(const struct kiln_integrate_settings *settings)
{
    return settings->target_error > 0.0 || settings->published_error > 0.0;
}

#endif
