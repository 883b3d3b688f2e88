#include "coordinator/integrate/probes/radiance_report.h"

void kiln_radiance_report_settings(const struct kiln_companion_told *told, json_t *json)
{
    const struct kiln_job *job = told->job;
    const struct kiln_radiance_settings *r = &job->light.radiance;
    static const char *const bases[] = {"sh", "octahedral", "cubemap"};
    if (!kiln_job_has_probes(job))
        return;
    json_object_set_new(json, "tracing_range", json_real(r->range));
    json_object_set_new(json, "probe_basis", json_string(bases[r->basis]));
    json_object_set_new(json, "distant_projection", json_string(r->approximate ? "approximate" : "exact"));
}

void kiln_radiance_report_step(const struct kiln_companion_told *told, json_t *json)
{
    if (told->solution->report.radiance.probes == 0 || !(told->step->probe_seconds > 0.0))
        return;
    (void)json_object_set_new(json, "probe_rays", json_integer((json_int_t)told->step->probe_rays));
    (void)json_object_set_new(json, "probe_seconds", json_real(told->step->probe_seconds));
}

/* The radiance probes. A bake of which only files were missing does not know which of them were moved. */
static json_t *radiance_json(const struct kiln_radiance_report *r)
{
    json_t *json = json_pack("{s:f, s:I, s:I, s:i, s:i, s:I, s:b}", "spacing", r->spacing, "probes",
                             (json_int_t)r->probes, "bytes", (json_int_t)r->bytes, "side", (int)r->side, "samples",
                             (int)r->samples, "rays", (json_int_t)r->rays, "biased", true);
    if (r->placed)
        (void)json_object_update_new(json, json_pack("{s:I, s:I, s:I}", "moved", (json_int_t)r->moved, "off",
                                                     (json_int_t)r->off, "points_without", (json_int_t)r->alone));
    return json;
}

void kiln_radiance_report_light(const struct kiln_companion_told *told, json_t *json)
{
    if (kiln_job_has_probes(told->job))
        (void)json_object_set_new(json, "radiance_probes", radiance_json(&told->solution->report.radiance));
}
