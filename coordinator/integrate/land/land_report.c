#include "coordinator/integrate/land/land_report.h"

#include "worker/pass/pass.h"

/* Objects that light paths do not meet, in a scene of lamps that rays do not meet. */
static json_int_t lacking_receivers(const struct kiln_scene *scene)
{
    json_int_t count = 0;
    for (size_t i = 0; i < scene->object_count && scene->light_count > 0; i++)
        count += (scene->objects[i].flags & KILN_OBJECT_RECEIVER_ONLY) != 0;
    return count;
}

/* Lists the passes that the host has traced for the device. */
static json_t *on_host_json(uint32_t passes)
{
    json_t *list = json_array();
    for (int i = 0; i < KILN_PASS_COUNT; i++)
        if ((passes >> i & 1u) != 0)
            (void)json_array_append_new(list, json_string(kiln_passes[i]->what));
    return list;
}

void kiln_landing_report_materials(const struct kiln_companion_told *told, json_t *json)
{
    static const char *const rules[] = {"balance", "power", "uniform"};
    const struct kiln_landing_report *landing = &told->solution->report.landing;
    const struct kiln_caustic_trial trial = kiln_caustics_found(&told->solution->report.steps);
    if (trial.tried)
        (void)json_object_set_new(json, "tried",
                                  json_pack("{s:b, s:f, s:f}", "left_out", trial.left_out, "brings", trial.brings,
                                            "error_of_the_rest", trial.rest));
    if (told->job->light.caustics == KILN_CAUSTICS_VCM)
        (void)json_object_set_new(json, "mis", json_string(rules[told->job->light.mis]));
    if (told->job->light.caustics >= KILN_CAUSTICS_LAND && lacking_receivers(told->scene) > 0)
        (void)json_object_set_new(json, "receivers_gather", json_integer(lacking_receivers(told->scene)));
    if (told->job->light.caustics >= KILN_CAUSTICS_LAND) {
        (void)json_object_set_new(json, "photons", json_integer((json_int_t)landing->photons));
        (void)json_object_set_new(json, "aims", json_integer((json_int_t)landing->aims));
        if (landing->rays > 0)
            (void)json_object_set_new(json, "rays", json_integer(landing->rays));
        (void)json_object_set_new(json, "iterations",
                                  told->job->light.iterations == KILN_ITERATIONS_ALL
                                      ? json_string("all")
                                      : json_integer((json_int_t)landing->iterations));
    }
    if (landing->on_host != 0)
        (void)json_object_set_new(json, "on_host", on_host_json(landing->on_host));
    if (told->job->light.caustics >= KILN_CAUSTICS_MERGE)
        (void)json_object_set_new(json, "merge_radius", json_real(landing->radius));
}

void kiln_landing_report_step(const struct kiln_companion_told *told, json_t *json)
{
    if (kiln_step_has(&told->step->step, KILN_WITH(landing)))
        (void)json_object_set_new(json, "iterations", json_integer((json_int_t)told->step->step.iterations));
}
