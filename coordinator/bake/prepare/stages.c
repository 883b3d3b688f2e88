#include "coordinator/bake/prepare/stages.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "coordinator/integrate/light_left.h"

/* Whether a job has a stage. */
static bool always(const struct kiln_job *job)
{
    (void)job;
    return true;
}
static bool has_states(const struct kiln_job *job) { return job->relighting.states != NULL || job->relighting.listen; }
static bool is_whole(const struct kiln_job *job) { return !has_states(job); }
static bool has_views(const struct kiln_job *job) { return is_whole(job) && job->light.only_visible_from != NULL; }
static bool has_volume(const struct kiln_job *job) { return is_whole(job) && job->volume.samples != 0; }
static bool checks_density(const struct kiln_job *job) { return is_whole(job) && job->lightmaps.check_density; }
static bool has_lightmaps(const struct kiln_job *job)
{
    return is_whole(job) && job->lightmaps.store == KILN_STORE_KIND_LIGHTMAP;
}
static bool has_vertices(const struct kiln_job *job) { return is_whole(job) && job->lightmaps.vertex_light; }
static bool has_scene(const struct kiln_job *job) { return is_whole(job) && job->write_scene; }
static bool has_preview(const struct kiln_job *job) { return is_whole(job) && job->preview; }

/* Times of stages but light and probes, of processor time measured in the Cornell box and the dining room: seconds
 * whatever the scene, and seconds of one thread for a triangle and for a surface point. Threads share the latter two.
 * `rough`: as in struct kiln_stage. */
static const struct row {
    const char *name;
    bool (*is_there)(const struct kiln_job *job);
    double fixed, triangle, point;
    bool rough;
} rows[] = {
    {"import", always, 0.15, 4e-6, 0.0, false},
    {"scene and BVH", always, 0.01, 2e-6, 0.0, false},
    {"surface points", always, 0.02, 2e-6, 1.5e-6, false},
    {"validity", always, 0.02, 2e-6, 2e-6, false},
    {KILN_STAGE_STATES, has_states, 1.0, 0.0, 20e-6, true},
    {"views", has_views, 0.5, 0.0, 0.0, false},
    {"emission", is_whole, 0.05, 0.0, 0.0, false},
    {KILN_STAGE_LIGHT, is_whole, 0.0, 0.0, 0.0, true},
    {"probes", has_volume, 0.0, 0.0, 0.0, true},
    {"texel density", checks_density, 0.2, 0.0, 10e-6, false},
    {"lightmaps", has_lightmaps, 0.05, 0.0, 15e-6, false},
    {"vertices", has_vertices, 0.05, 0.0, 2e-6, false},
    {"kiln.h5", is_whole, 0.05, 0.0, 2e-6, false},
    {"volume.hdf", has_volume, 0.03, 0.0, 0.0, false},
    {"scene.glb", has_scene, 0.05, 0.5e-6, 0.0, false},
    {"preview", has_preview, 0.3, 4e-6, 0.0, false},
    {"manifest", is_whole, 0.03, 0.0, 0.1e-6, false},
};
static_assert(sizeof rows / sizeof *rows <= KILN_STAGES_MAX, "all stages fit");

/* Seconds of tracing so many rays. */
static double seconds_of(struct kiln_backend_choice choice, bool device, double rays)
{
    choice.question.rays = rays;
    choice.question.triangles = choice.question.triangles > 0 ? choice.question.triangles : 1;
    kiln_backend_predict(&choice);
    return device ? choice.vulkan_seconds : choice.embree_seconds;
}

/* Samples of all rounds over those of the settings, a quarter of which the first round has. */
static double rounds_of(const struct kiln_job *job)
{
    const double asked = job->light.published_error;
    if (!kiln_job_has_rounds(job))
        return 1.0;
    return asked > 0.0 ? 0.25 * kiln_light_left_rounds(asked) : 1.0;
}

struct kiln_stage_facts kiln_stage_facts(const struct kiln_job *job, const struct kiln_prepared *p, uint64_t probes)
{
    const uint64_t threads = (uint64_t)p->threads * (uint64_t)p->ranks;
    const bool device = p->choice.asked ? !p->choice.processors
                                        : job->machine.backend != NULL && strcmp(job->machine.backend, "vulkan") == 0;
    const struct kiln_backend_choice choice = {.question =
                                                   kiln_backend_ask(job, p->scene, threads, (uint32_t)p->ranks)};
    const double probe_rays = (double)probes * job->volume.samples;
    const double points = p->surface != NULL ? (double)p->surface->point_count : (double)choice.question.points,
                 each = points > 0.0 && choice.question.points > 0 ? points / (double)choice.question.points : 1.0;
    return (struct kiln_stage_facts){
        .job = job,
        .triangles = (double)choice.question.triangles,
        .points = points,
        .probes = (double)probes,
        .threads = (double)(threads > 0 ? threads : 1),
        .light_seconds =
            seconds_of(choice, device, rounds_of(job) * each * fmax(choice.question.rays - probe_rays, 0.0)),
        .probe_seconds = seconds_of(choice, device, probe_rays)};
}

size_t kiln_stages_make(const struct kiln_stage_facts *f, struct kiln_stage stages[KILN_STAGES_MAX])
{
    size_t count = 0;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        if (!rows[i].is_there(f->job))
            continue;
        double seconds = rows[i].fixed + (rows[i].triangle * f->triangles + rows[i].point * f->points) / f->threads;
        if (strcmp(rows[i].name, KILN_STAGE_LIGHT) == 0)
            seconds += f->light_seconds;
        if (strcmp(rows[i].name, "probes") == 0)
            seconds += f->probe_seconds;
        stages[count++] = (struct kiln_stage){rows[i].name, seconds, rows[i].rough};
    }
    return count;
}
