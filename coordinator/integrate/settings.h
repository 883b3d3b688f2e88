/* Settings for the light of a bake: those of the integrators, and those of the lockstep runner. Plain values;
 * coordinator/bake/light/light_settings.h fills them in from a job. */
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

    /* which steps there are, and what they compute; these are all that `next` of an integrator reads */
    enum kiln_schedule schedule;
    int64_t bounces; /* indirect bounces; -1: as many as there is energy for, and a tail */
    bool tail;       /* add the geometric tail after the last bounce, though `bounces` is given */
    uint32_t samples_direct, samples_bounce, samples_indirect;
    uint32_t indirect_scale;     /* texels a side of a block in bounces (blocks.h): a power of two; 1: each gathers */
    uint32_t final_scale;        /* likewise of a block in the final gather (nodes.h) */
    enum kiln_caustics caustics; /* settled; up to KILN_CAUSTICS_NONE there is no such step */
    bool caustics_tried; /* of KILN_CAUSTICS_VCM: pilots say first whether they are worth their noise (land_trial.h) */
    enum kiln_mis mis;   /* likewise */
    uint32_t photons, iterations; /* of light paths (land.h), of a step; of one in the first round, where they grow */
    bool iterations_grow; /* from round to round (rounds.h) with the samples of the step; needs a target error */
    double merge_radius, radius_alpha; /* of KILN_CAUSTICS_MERGE, _VCM (land.h): m, or KILN_MERGE_RADIUS_AUTO, _TEXEL */
    bool photons_given;                /* by the user: then fewer than are needed are refused, else more are taken */
    bool guide;     /* bounces learn where light comes from, and the final gather follows (worker/pass/guided.h) */
    bool seen_only; /* the final gather and quantities are of tile runs that are seen (struct kiln_rank_data) */
    bool compact; /* radiosity travels in 4 bytes a point where an integrator can afford that: kiln_exchange_is_compact
                   */
    uint64_t seed;
    uint32_t parts;      /* that the bake is computed in (parts.h): KILN_PARTS to know its errors, or 1 */
    double target_error; /* relative; parts are added until a texel's error is below it (parts.h); 0: none */
    size_t lights;       /* of the scene: emitting triangles, punctual lights, suns, the environment */

    /* where gather rays end, and the probes that answer then (radiance.h); borrowed; NULL: they have no end. `next` of
     * an integrator does not read it */
    const struct kiln_radiance_settings *radiance;
    /* what paths from surface points are traced with (reference/); borrowed; NULL: the integrator has none */
    const struct kiln_reference_parameters *reference;
    /* what patches gather from, pair by pair (radiosity/, patches.h); borrowed; NULL: the integrator has none */
    const struct kiln_patch_settings *patches;

    /* which quantities (quantity.h) are computed besides; `next` of an integrator does not read these */
    const struct kiln_occlusion_parameters *occlusion; /* borrowed; NULL: no ambient occlusion */
    enum kiln_directional directional;

    /* how the ranks work together; none of these changes a result */
    bool work_stealing; /* ranks that are done compute for others of their node */
    enum kiln_rebalance rebalance;
    bool whole_objects;      /* new ranges of points begin at objects rather than at cells */
    bool probes;             /* the total radiosity of all points is gathered by probes in the end */
    bool visible_only;       /* nodes receive the radiosity of what their points see (sight.h) */
    uint64_t exchange_limit; /* elements in one call of MPI; 0: what it can count */

    struct kiln_faults faults; /* for tests: which rank is slow */
};

#endif
