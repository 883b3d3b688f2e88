#include "coordinator/integrate/patches/patches_report.h"

#include <assert.h>
#include <math.h>

/* Counts of a rank: of pairs of patches, and of tile pairs by what is known of them; of links. */
enum { BYTES, ASKED, KNOWN, OPEN, SHUT, MIXED, UNKNOWN, LINKS, LINK_BYTES, COUNTS };
static_assert((int)COUNTS <= (int)KILN_COMPANION_COUNTS, "the report has room for counts");

void kiln_patches_count(const struct kiln_solution *solution, uint64_t counts[KILN_COMPANION_COUNTS])
{
    const struct kiln_visibility_counts *c = &solution->report.visibility;
    counts[BYTES] = c->bytes;
    counts[ASKED] = c->asked;
    counts[KNOWN] = c->answered;
    counts[OPEN] = c->open;
    counts[SHUT] = c->shut;
    counts[MIXED] = c->mixed;
    counts[UNKNOWN] = c->unknown;
    counts[LINKS] = solution->report.links;
    counts[LINK_BYTES] = solution->report.link_bytes;
}

void kiln_patches_report_settings(const struct kiln_companion_told *told, json_t *settings)
{
    const struct kiln_job *job = told->job;
    const struct kiln_patch_settings *p = &job->light.patches;
    static const char *const undersample[] = {"none", "stride", "random", "mipmap"};
    if (!kiln_job_is_radiosity(job))
        return;
    static const char *const gather[] = {"pairs", "cosine", "even", "circles", "mixed"};
    json_object_set_new(settings, "gather", json_string(gather[p->gather]));
    if (p->gather != KILN_GATHER_PAIRS)
        json_object_set_new(settings, "directions",
                            json_integer(p->directions > 0 ? p->directions : job->light.samples_indirect));
    json_object_set_new(settings, "lights", json_string(p->lights == KILN_LIGHTS_PATCHES ? "patches" : "sampled"));
    json_object_set_new(settings, "patches", json_string(p->patches == KILN_PATCHES_LINKS ? "links" : "all"));
    if (p->patches == KILN_PATCHES_LINKS)
        json_object_set_new(settings, "link_error", json_real(p->link_error));
    static const char *const visibility[] = {"rays", "voxels"};
    json_object_set_new(settings, "visibility", json_string(visibility[p->visibility]));
    if (p->visibility != KILN_VISIBILITY_RAYS)
        json_object_set_new(settings, "voxels", json_integer(p->voxels));
    json_object_set_new(settings, "order", json_string(p->order == KILN_ORDER_UNSHOT ? "unshot" : "lockstep"));
    if (p->order == KILN_ORDER_UNSHOT)
        json_object_set_new(settings, "unshot_left", json_real(p->unshot_left));
    json_object_set_new(settings, "undersample", json_string(undersample[p->undersample]));
    if (p->undersample != KILN_SAMPLE_ALL)
        json_object_set_new(settings, "sampling_window", json_integer((json_int_t)1 << p->window));
    json_object_set_new(settings, "subdivide", json_real(p->subdivide));
    if (p->subdivide > 0.0)
        json_object_set_new(settings, "node_max", json_integer((json_int_t)1 << p->node_max));
    json_object_set_new(settings, "clamp", json_boolean(p->clamp));
    json_object_set_new(settings, "albedo_scale", json_real(p->albedo_scale));
}

/* Effect of the visibility that patches kept. Shares of the tile pairs with any pair that face each other: kept; kept
 * without a bit a pair (open, shut). And of all pairs those that no ray was traced for. */
static json_t *visibility_json(const uint64_t *counts)
{
    const double open = (double)counts[OPEN], shut = (double)counts[SHUT], kept = open + shut + (double)counts[MIXED],
                 all = fmax(1.0, kept + (double)counts[UNKNOWN]);
    return json_pack("{s:I, s:f, s:f, s:f, s:I, s:I}", "bytes", (json_int_t)counts[BYTES], "cached", kept / all, "open",
                     open / all, "shut", shut / all, "pairs", (json_int_t)counts[ASKED], "rays_saved",
                     (json_int_t)counts[KNOWN]);
}

void kiln_patches_report_ranks(const struct kiln_companion_told *told, json_t *json)
{
    const uint64_t *counts = told->counts;
    if (kiln_job_is_radiosity(told->job) && told->job->light.patches.visibility_cache > 0.0)
        (void)json_object_set_new(json, "visibility_cache", visibility_json(counts));
    if (counts[LINKS] > 0)
        (void)json_object_set_new(
            json, "links",
            json_pack("{s:I, s:I}", "count", (json_int_t)counts[LINKS], "bytes", (json_int_t)counts[LINK_BYTES]));
}
