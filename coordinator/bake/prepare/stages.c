#include "coordinator/bake/prepare/stages.h"

#include <assert.h>

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

/* The phases of the reckoning that a stage spans, from `first` to `last`, and its share of them. Without such phases it
 * takes `fixed` seconds. `rough`: as in struct kiln_stage. */
static const struct row {
    const char *name;
    bool (*is_there)(const struct kiln_job *job);
    enum kiln_reckon_phase first, last;
    double share, fixed;
    bool rough;
} rows[] = {
    {"import", always, KILN_RECKON_start, KILN_RECKON_import, 1.0, 0.0, false},
    {"scene and BVH", always, KILN_RECKON_world, KILN_RECKON_world, 1.0, 0.0, false},
    {"surface points", always, KILN_RECKON_points, KILN_RECKON_points, 1.0, 0.0, false},
    {"validity", always, KILN_RECKON_validity, KILN_RECKON_validity, 1.0, 0.0, false},
    {KILN_STAGE_STATES, has_states, KILN_RECKON_start, KILN_RECKON_start, 0.0, 1.0, true},
    {"views", has_views, KILN_RECKON_start, KILN_RECKON_start, 0.0, 0.5, false},
    {"emission", is_whole, KILN_RECKON_emission, KILN_RECKON_emission, 1.0, 0.0, false},
    {KILN_STAGE_LIGHT, is_whole, KILN_RECKON_kernels, KILN_RECKON_quantities, 1.0, 0.0, true},
    {"probes", has_volume, KILN_RECKON_probes, KILN_RECKON_probes, 1.0, 0.0, true},
    {"texel density", checks_density, KILN_RECKON_kernels, KILN_RECKON_quantities, 0.1, 0.2, false},
    {"lightmaps", has_lightmaps, KILN_RECKON_denoising, KILN_RECKON_lightmaps, 1.0, 0.0, false},
    {"vertices", has_vertices, KILN_RECKON_lightmaps, KILN_RECKON_lightmaps, 0.2, 0.05, false},
    {"kiln.h5", is_whole, KILN_RECKON_h5, KILN_RECKON_h5, 1.0, 0.0, false},
    {"volume.hdf", has_volume, KILN_RECKON_rest, KILN_RECKON_rest, 0.2, 0.0, false},
    {"scene.glb", has_scene, KILN_RECKON_rest, KILN_RECKON_rest, 0.4, 0.0, false},
    {"preview", has_preview, KILN_RECKON_preview, KILN_RECKON_preview, 1.0, 0.0, false},
    {"manifest", is_whole, KILN_RECKON_rest, KILN_RECKON_rest, 0.4, 0.0, false},
};
static_assert(sizeof rows / sizeof *rows <= KILN_STAGES_MAX, "all stages fit");

size_t kiln_stages_make(const struct kiln_job *job, const struct kiln_reckoned *expected,
                        struct kiln_stage stages[KILN_STAGES_MAX])
{
    size_t count = 0;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        double seconds = rows[i].fixed;
        for (uint32_t phase = rows[i].first; phase <= (uint32_t)rows[i].last; phase++)
            seconds += rows[i].share * expected->seconds[phase];
        if (rows[i].is_there(job))
            stages[count++] = (struct kiln_stage){rows[i].name, seconds, rows[i].rough};
    }
    return count;
}
