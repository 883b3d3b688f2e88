#include "coordinator/bake/prepare/materials.h"

#include "coordinator/integrate/companion.h"
#include "coordinator/job/options.h"
#include "worker/pass/caustic_weights.h"

/* Whether a first round of light paths decides if caustics are computed (coordinator/integrate/land/land_trial.h). It
 * does if all options of paths are left to kiln, and no option needs the separate parts of light. */
static bool is_tried(const struct kiln_job *job)
{
    static const char *const of_paths[] = {"photons", "iterations", "merge-radius", "radius-alpha", "mis"};
    bool given = false;
    for (size_t i = 0; i < sizeof of_paths / sizeof *of_paths; i++)
        given = given || kiln_job_given(job, kiln_option_find_for(of_paths[i], KILN_FOR_BAKE));
    return !given && job->light.materials == KILN_GLOSS_MODE_AUTO && job->light.keep == KILN_KEEP_NONE &&
           job->relighting.folder == NULL && job->relighting.states == NULL && !job->relighting.listen &&
           job->scene.grouped == NULL;
}

void kiln_materials_settle(struct kiln_job *job, const struct kiln_scene *scene)
{
    if (scene->taken == NULL)
        job->light.materials = KILN_GLOSS_MODE_DIFFUSE;
    if (!kiln_job_takes_gloss(job)) {
        job->light.caustics = KILN_CAUSTICS_NONE;
        job->light.chain_length = 0; /* there are no chains */
    } else if (kiln_job_is_reference(job)) {
        job->light.caustics = KILN_CAUSTICS_NONE; /* light paths find caustics, in a step of their own */
    } else if (job->light.caustics == KILN_CAUSTICS_AUTO) {
        job->light.caustics = KILN_CAUSTICS_VCM;
        job->light.caustics_tried = is_tried(job);
    }
    if (job->light.caustics != KILN_CAUSTICS_VCM)
        job->light.mis = KILN_MIS_BALANCE; /* nothing shares */
    if (job->light.caustics < KILN_CAUSTICS_LAND)
        job->light.photons = job->light.iterations = 0; /* there are no light paths */
    if (job->light.caustics < KILN_CAUSTICS_MERGE) {
        job->light.merge_radius = job->light.paths.radius; /* 0 except with --method vcm, the only method that merges */
        job->light.radius_alpha = 0.0;
    }
}

int kiln_materials_check(const struct kiln_job *job, const struct kiln_scene *scene, struct kiln_error *error)
{
    uint32_t count = 0, first = 0;
    for (uint32_t i = 0; i < scene->material_count && job->light.diffuse_unasked; i++) {
        const struct kiln_gloss *gloss = kiln_gloss_find(scene, i);
        if (kiln_gloss_needed(&scene->materials[i], gloss, KILN_GLOSS_MODE_AUTO))
            first = count++ == 0 ? i : first;
    }
    if (count == 0)
        return KILN_OK;
    const struct kiln_material *m = &scene->materials[first];
    return kiln_fail(
        error, KILN_USAGE,
        "--method %s knows the diffuse part of materials alone, and %u of the scene's %s mirrors, gloss or "
        "glass ('%s': %s): give --materials diffuse to leave that light out, or --method cells",
        job->light.method, count, count == 1 ? "materials has" : "materials have", kiln_scene_string(scene, m->name),
        kiln_gloss_kind_name(kiln_gloss_kind(m, kiln_gloss_find(scene, first))));
}

/* Returns the reason why no material is baked with its gloss. */
static const char *why_none(enum kiln_gloss_mode asked)
{
    return asked == KILN_GLOSS_MODE_DIFFUSE
               ? "--materials diffuse"
               : "the scene has no metal, glass with a body, clear coat, or reflection of roughness below 0.5";
}

json_t *kiln_materials_json(const struct kiln_job *job, enum kiln_gloss_mode asked, const struct kiln_scene *scene,
                            const struct kiln_solution *solution)
{
    const struct kiln_caustic_trial trial = kiln_caustics_found(&solution->report.steps);
    static const char *const modes[] = {"auto", "diffuse", "full"};
    static const char *const caustics[] = {"auto", "none", "gather", "land", "merge", "vcm"};
    json_int_t of[KILN_GLOSS_KINDS] = {0}, taken = 0;
    json_t *json = json_pack("{s:s}", "mode", modes[asked]), *kinds = json_object();
    for (uint32_t i = 0; i < scene->material_count; i++) {
        const struct kiln_gloss *gloss = kiln_gloss_taken(scene, i);
        if (gloss == NULL)
            continue;
        taken++;
        of[kiln_gloss_kind(&scene->materials[i], gloss)]++;
    }
    for (int k = 0; k < KILN_GLOSS_KINDS; k++)
        if (of[k] > 0)
            (void)json_object_set_new(kinds, kiln_gloss_kind_name((enum kiln_gloss_kind)k), json_integer(of[k]));
    (void)json_object_set_new(json, "taken", json_integer(taken));
    if (taken == 0) {
        json_decref(kinds);
        (void)json_object_set_new(json, "why", json_string(why_none(asked)));
        return json;
    }
    (void)json_object_set_new(json, "kinds", kinds);
    (void)json_object_set_new(json, "caustics",
                              json_string(kiln_job_is_reference(job) ? job->light.method
                                          : trial.left_out           ? caustics[KILN_CAUSTICS_NONE]
                                                                     : caustics[job->light.caustics]));
    kiln_companions_report(kiln_companions, KILN_REPORT_MATERIALS,
                           &(struct kiln_companion_told){.job = job, .scene = scene, .solution = solution}, NULL, json);
    (void)json_object_set_new(json, "chain_length", json_integer((json_int_t)job->light.chain_length));
    return json;
}
