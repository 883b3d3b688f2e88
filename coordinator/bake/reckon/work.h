/* Amounts of work of a bake before it runs: counts that follow from the job, the scene and typical figures. Nothing
 * here depends on a backend; rates.h has the times. */
#ifndef KILN_COORDINATOR_BAKE_RECKON_WORK_H
#define KILN_COORDINATOR_BAKE_RECKON_WORK_H

#include <stdbool.h>
#include <stdint.h>

#include "coordinator/integrate/foretold.h"
#include "coordinator/integrate/settings.h"
#include "coordinator/job/job.h"
#include "worker/scene/scene.h"

/* Kinds of rays from surface points. */
enum kiln_work_kind { KILN_WORK_DIRECT, KILN_WORK_BOUNCE, KILN_WORK_FINAL, KILN_WORK_QUANTITY, KILN_WORK_KINDS };

struct kiln_work_rays {
    double samples; /* of all points and steps; of direct light most send a shadow ray */
    double visits;  /* points that the steps prepare and whose answers are taken, over all steps */
    double steps;
};

/* Counts, of all ranks. */
struct kiln_work {
    double triangles; /* in the world, instances expanded */
    double texels, points;
    double far;     /* fraction of the points that lie far off the detail, whose rays meet next to nothing */
    double gloss;   /* fraction of the surface, by area, whose gloss light transport simulates */
    double lamps;   /* lights, and emitting triangles by twos */
    bool cut_out;   /* some surface has holes or lets light pass: rays ask more of what they meet */
    bool textured;  /* some material has a texture, which surface points read */
    bool from_afar; /* a sun or an environment shines: direct light has pilot samples, and edges of shadows */
    struct kiln_foretold rounds; /* rounds 0: there are none */
    uint32_t bounces;            /* assumed */
    struct kiln_work_rays light[KILN_WORK_KINDS];
    double pairs; /* of patches that send light to each other */
    /* light paths that land, pilots included; likewise of the planned steps, if no trial leaves caustics out
     * (integrate/land/land_trial.h) */
    double paths, paths_planned;
    double path_steps; /* steps that trace them, over all rounds */
    double shared;     /* gather rays that share the light of caustics with these paths */
    double spread;     /* points over which landings are spread, over all steps */
    double probes, probe_samples, probe_paths;
    bool takes_gloss, denoises;
    double preview; /* pixels over those of an unlimited preview; 0: none */
};

/* Least expected number of surface points of an object: texels of its lightmap that the layout covers. Texels at the
 * borders of charts come to these. */
double kiln_work_points_of(const struct kiln_scene *scene, size_t object);
/* Expected number of surface points of a scene, these and backs included. `both_sides`: of all, as fine as fronts. */
double kiln_work_points(const struct kiln_scene *scene, bool both_sides);

/* Assumed number of bounces, final gather included, where the job leaves it to the light. */
uint32_t kiln_work_bounces(const struct kiln_job *job, const struct kiln_scene *scene);

/* Samples and light paths of caustics in all rounds over those of the first, in which all others grow to `samples`. */
double kiln_work_caustics(double samples);

/* Counts the work of a job whose materials are settled, for the settings of its light. `points`: surface points, if
 * they are known; 0: kiln_work_points. `foretold`: all rounds, as a trial told them; NULL, or nothing tried: typical
 * ones (rounds_expected.h). Not collective. KILN_SYSTEM. */
int kiln_work_count(struct kiln_work *work, const struct kiln_job *job, const struct kiln_integrate_settings *settings,
                    const struct kiln_scene *scene, double points, const struct kiln_foretold *foretold,
                    struct kiln_error *error);

#endif
