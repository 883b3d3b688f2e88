#include "coordinator/field/field.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "coordinator/field/group_fields.h"
#include "coordinator/field/packed_error.h"
#include "coordinator/field/rank_data.h"
#include "worker/pass/guided.h"
#include "worker/pass/patches.h"
#include "worker/scene/radiosity.h"

#define AT(member) offsetof(struct kiln_rank_data, member)

static bool has_probes(const struct kiln_job *job) { return kiln_job_has_probes(job); }
static bool wants_error_map(const struct kiln_job *job) { return job->lightmaps.error_map || kiln_job_has_rounds(job); }
static bool wants_occlusion(const struct kiln_job *job) { return job->light.occlusion.distance > 0.0; }
static bool wants_harmonics(const struct kiln_job *job) { return job->light.directional == KILN_DIRECTIONAL_SH1; }
static bool wants_dominant(const struct kiln_job *job) { return job->light.directional == KILN_DIRECTIONAL_DOMINANT; }
static bool wants_parts(const struct kiln_job *job) { return kiln_job_parts(job) > 1; }
static bool has_adaptive_samples(const struct kiln_job *job)
{
    return job->light.schedule == KILN_SCHEDULE_LEAN || kiln_job_has_rounds(job);
}
static bool has_late_bounces(const struct kiln_job *job)
{
    return job->light.schedule == KILN_SCHEDULE_LEAN && job->light.bounces < 0;
}
static bool has_views(const struct kiln_job *job) { return job->light.only_visible_from != NULL; }
static bool has_blocks(const struct kiln_job *job) { return job->light.indirect_scale > 0; }
static bool has_nodes(const struct kiln_job *job) { return job->light.final_scale > 0; }
static bool keeps_nodes(const struct kiln_job *job) { return job->light.patches.keep_nodes; }
static bool has_caustics(const struct kiln_job *job) { return kiln_job_has_caustics(job); }
static bool has_closing(const struct kiln_job *job)
{
    return kiln_job_is_radiosity(job) && job->light.patches.order == KILN_ORDER_UNSHOT;
}
static bool has_guide(const struct kiln_job *job) { return job->light.guide > 0; }
static bool receives_visible(const struct kiln_job *job) { return job->ranks.exchange_points == KILN_EXCHANGE_VISIBLE; }
static bool has_target(const struct kiln_job *job) { return kiln_job_has_rounds(job); }
static bool goes_on(const struct kiln_job *job) { return kiln_job_goes_on(job); }
static bool caustics_go_on(const struct kiln_job *job) { return kiln_job_goes_on(job) && kiln_job_has_caustics(job); }
static bool wants_errors_apart(const struct kiln_job *job)
{
    return job->lightmaps.error_map || kiln_job_denoises(job);
}
static bool wants_caustic_error(const struct kiln_job *job)
{
    return kiln_job_has_caustics(job) && wants_errors_apart(job);
}

static const char *const total_channels[] = {"R", "G", "B"};
static const char *const direct_channels[] = {"direct.R", "direct.G", "direct.B"};
static const char *const indirect_channels[] = {"indirect.R", "indirect.G", "indirect.B"};
static const char *const caustic_channels[] = {"caustic.R", "caustic.G", "caustic.B"};
static const char *const error_channels[] = {"error.Y"};
static const char *const occlusion_channels[] = {"ambient_occlusion.Y"};
static const char *const bent_normal_channels[] = {"bent_normal.X", "bent_normal.Y", "bent_normal.Z"};
static const char *const harmonics_channels[] = {"sh.L00.R",  "sh.L00.G",  "sh.L00.B", "sh.L1m1.R",
                                                 "sh.L1m1.G", "sh.L1m1.B", "sh.L10.R", "sh.L10.G",
                                                 "sh.L10.B",  "sh.L11.R",  "sh.L11.G", "sh.L11.B"};
static const char *const dominant_channels[] = {"dominant.X", "dominant.Y", "dominant.Z", "dominant.directionality"};

/* Table of all fields. The order is that of datasets in kiln.h5 and of planes in lightmaps; add new rows at the end of
 * their group. */
static const struct kiln_field table[] = {
    /* fields of the surface (see worker/scene/surface.h) */
    {.name = "tile_runs",
     .unit = "1",
     .type = KILN_FIELD_TILE_RUN,
     .components = 1,
     .domain = KILN_DOMAIN_TILE_RUN,
     .life = KILN_FIELD_SURFACE,
     .member = AT(surface.tile_runs)},
    {.name = "piece_base",
     .unit = "1",
     .type = KILN_FIELD_UINT64,
     .components = 1,
     .domain = KILN_DOMAIN_TILE_RUN,
     .length = KILN_FIELD_ONE_MORE,
     .life = KILN_FIELD_SURFACE,
     .member = AT(surface.piece_base)},
    {.name = "area_cdf_base",
     .unit = "1",
     .type = KILN_FIELD_UINT64,
     .components = 1,
     .domain = KILN_DOMAIN_TILE_RUN,
     .length = KILN_FIELD_ONE_MORE,
     .life = KILN_FIELD_SURFACE,
     .member = AT(surface.area_cdf_base)},
    {.name = "piece_count",
     .unit = "1",
     .type = KILN_FIELD_UINT16,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_SURFACE,
     .member = AT(surface.piece_count)},
    {.name = "pieces",
     .unit = "1",
     .type = KILN_FIELD_UINT32,
     .components = 1,
     .domain = KILN_DOMAIN_PIECE,
     .life = KILN_FIELD_SURFACE,
     .member = AT(surface.pieces)},
    {.name = "area_cdf",
     .unit = "1",
     .type = KILN_FIELD_FLOAT,
     .components = 1,
     .domain = KILN_DOMAIN_AREA_CDF,
     .life = KILN_FIELD_SURFACE,
     .member = AT(surface.area_cdf),
     .high = 1.0},
    {.name = "area",
     .unit = "m2",
     .type = KILN_FIELD_FLOAT,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_SURFACE,
     .member = AT(surface.area),
     .high = INFINITY,
     .dataset = "/points/area",
     .description = "surface in the texel"},
    {.name = "albedo",
     .unit = "1",
     .type = KILN_FIELD_UNORM16,
     .components = 3,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_SURFACE,
     .member = AT(surface.albedo),
     .high = 1.0,
     .dataset = "/points/albedo",
     .description = "mean diffuse albedo, linear RGB; above 0.95 neighbours round up and down in turn"},
    {.name = "visible",
     .unit = "1",
     .type = KILN_FIELD_UNORM16,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_SURFACE,
     .member = AT(surface.visible),
     .saved = KILN_FIELD_SAVED,
     .high = 1.0},
    /* results; the first three must be these: coordinator/output/map/map.h */
    {.name = "direct",
     .type = KILN_FIELD_FLOAT,
     .components = 3,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(direct),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .dataset = "/irradiance/direct",
     .description =
         "from lights, about the shading normal, linear RGB, as gathered: not denoised, not filled, seams not "
         "smoothed (the lightmaps are)",
     .of_direct = true,
     .channels = direct_channels,
     .smooth = true},
    {.name = "sum",
     .type = KILN_FIELD_FLOAT,
     .components = 3,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(sum),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .dataset = "/irradiance/indirect",
     .description =
         "from other surfaces, about the shading normal, linear RGB, as gathered: not denoised, not filled, seams not "
         "smoothed (the lightmaps are)",
     .noisy = true,
     .channels = indirect_channels,
     .smooth = true},
    {.name = "caustic",
     .type = KILN_FIELD_FLOAT,
     .components = 3,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(caustic),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .dataset = "/irradiance/caustic",
     .description =
         "from lights by way of mirrors, gloss and glass, about the shading normal, linear RGB, as gathered: "
         "not denoised, not filled, seams not smoothed (the lightmaps are filled)",
     .noisy = true,
     .channels = caustic_channels,
     .present = has_caustics},
    {.name = "total",
     .type = KILN_FIELD_FLOAT,
     .components = 3,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_SUM,
     .terms = {"direct", "sum", "caustic"},
     .high = INFINITY,
     .dataset = "/irradiance/total",
     .description = "direct + indirect (+ caustic), as gathered: not denoised, not filled, seams not smoothed (the "
                    "lightmaps are)",
     .noisy = true,
     .channels = total_channels},
    {.name = "error",
     .type = KILN_FIELD_ERROR,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(error),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .dataset = "/irradiance/error",
     .description = "standard error of the luminance of total",
     .noisy = true,
     .channels = error_channels,
     .in_lightmaps = wants_error_map},
    {.name = "ambient_occlusion",
     .unit = "1",
     .meaning = KILN_FIELD_FRACTION,
     .type = KILN_FIELD_UNORM16,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .saved = KILN_FIELD_SAVED,
     .high = 1.0,
     .dataset = "/occlusion/ambient_occlusion",
     .description = "what of the hemisphere about the shading normal, weighted by the cosine, is open: no surface "
                    "covers it within the distance of --ambient-occlusion; 1: all, 0: nothing",
     .channels = occlusion_channels,
     .attribute = "kiln:ambientOcclusion",
     .smooth = true,
     .present = wants_occlusion},
    {.name = "bent_normal",
     .unit = "1",
     .meaning = KILN_FIELD_DIRECTION,
     .type = KILN_FIELD_FLOAT,
     .components = 3,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .saved = KILN_FIELD_SAVED,
     .low = -1.0,
     .high = 1.0,
     .dataset = "/occlusion/bent_normal",
     .description = "unit vector in world space, as in the scene's file: the mean direction of what is open of the "
                    "hemisphere, weighted by the cosine; 0 0 0 where nothing is open",
     .noisy = true,
     .channels = bent_normal_channels,
     .attribute = "kiln:bentNormal",
     .smooth = true,
     .present = wants_occlusion},
    {.name = "sh",
     .is_radiance = true,
     .type = KILN_FIELD_FLOAT,
     .components = 12,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .saved = KILN_FIELD_SAVED,
     .low = -INFINITY,
     .high = INFINITY,
     .dataset = "/directional/sh",
     .description = "radiance that arrives above the surface, in real orthonormal spherical harmonics L_lm of world "
                    "space, as in the scene's file; (l, m) = (0, 0), (1, -1), (1, 0), (1, 1), RGB each. Irradiance "
                    "about a unit vector n: 0.886227 L00 + 1.023327 (L1m1 n.y + L10 n.z + L11 n.x)",
     .noisy = true,
     .channels = harmonics_channels,
     .attribute = "kiln:sh",
     .smooth = true,
     .present = wants_harmonics},
    {.name = "dominant",
     .unit = "1",
     .meaning = KILN_FIELD_DIRECTION,
     .type = KILN_FIELD_FLOAT,
     .components = 4,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .saved = KILN_FIELD_SAVED,
     .low = -1.0,
     .high = 1.0,
     .dataset = "/directional/dominant",
     .description = "unit vector towards the light, in world space, as in the scene's file, by luminance, and how much "
                    "of the light comes from there, 0 (none more than from elsewhere) to 1 (all)",
     .noisy = true,
     .channels = dominant_channels,
     .attribute = "kiln:dominant",
     .smooth = true,
     .present = wants_dominant},
    {.name = "error_direct",
     .type = KILN_FIELD_ERROR,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(error_direct),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .dataset = "/irradiance/error_direct",
     .description = "standard error of the luminance of direct",
     .noisy = true,
     .of_direct = true,
     .present = wants_errors_apart},
    {.name = "error_indirect",
     .type = KILN_FIELD_ERROR,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(error_indirect),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .dataset = "/irradiance/error_indirect",
     .description = "standard error of the luminance of indirect",
     .noisy = true,
     .present = wants_errors_apart},
    {.name = "error_caustic",
     .type = KILN_FIELD_ERROR,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(error_caustic),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .dataset = "/irradiance/error_caustic",
     .description = "standard error of the luminance of caustic",
     .noisy = true,
     .present = wants_caustic_error},
    {.name = "indirect_mean",
     .type = KILN_FIELD_FLOAT,
     .components = 3,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(indirect),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .present = wants_parts},
    {.name = "parts",
     .type = KILN_FIELD_FLOAT,
     .components = KILN_PARTS,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(parts),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .dataset = "/irradiance/parts",
     .description =
         "luminance of total as each of four independent parts of the bake found it; total is their mean, and "
         "the standard error of the mean over any set of points follows from what their means over it "
         "differ by (Student's t, 3 degrees of freedom)",
     .noisy = true,
     .present = wants_parts},
    {.name = "parts_radiosity",
     .unit = "W m-2",
     .type = KILN_FIELD_RADIOSITY,
     .components = KILN_PARTS,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(parts_radiosity),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .present = goes_on},
    {.name = "parts_caustic",
     .type = KILN_FIELD_FLOAT,
     .components = KILN_PARTS,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(parts_caustic),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .present = caustics_go_on},
    {.name = "parts_caustic_radiosity",
     .unit = "W m-2",
     .type = KILN_FIELD_RADIOSITY,
     .components = KILN_PARTS,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(parts_caustic_radiosity),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .present = caustics_go_on},
    {.name = "node",
     .unit = "texel",
     .type = KILN_FIELD_UINT16,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(node),
     .saved = KILN_FIELD_SAVED,
     .high = KILN_TILE_TEXELS,
     .dataset = "/radiosity/node",
     .description = "texels a side of the square that was one patch, when radiosity was last gathered from patches; 0: "
                    "the point sends no light",
     .present = keeps_nodes},
    {.name = "radiosity",
     .type = KILN_FIELD_FLOAT,
     .components = 3,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(radiosity),
     .saved = KILN_FIELD_SAVED,
     .high = INFINITY,
     .present = kiln_job_takes_gloss},
    {.name = KILN_FIELD_SAMPLES,
     .unit = "1",
     .type = KILN_FIELD_UINT32,
     .components = 1,
     .domain = KILN_DOMAIN_TILE_RUN,
     .life = KILN_FIELD_RESULT, /* decided in one step for another, and moved with the points in between */
     .member = AT(samples),
     .saved = KILN_FIELD_SAVED_IN_STEP,
     .high = 0x1p31,
     .present = has_adaptive_samples},
    {.name = KILN_FIELD_SAMPLES_BOUNCE,
     .unit = "1",
     .type = KILN_FIELD_UINT32,
     .components = 1,
     .domain = KILN_DOMAIN_TILE_RUN,
     .life = KILN_FIELD_RESULT,
     .member = AT(samples_bounce),
     .saved = KILN_FIELD_SAVED_IN_STEP,
     .high = 0x1p31,
     .present = has_late_bounces},
    {.name = KILN_FIELD_SAMPLES_DIRECT,
     .unit = "1",
     .type = KILN_FIELD_UINT32,
     .components = 1,
     .domain = KILN_DOMAIN_TILE_RUN,
     .life = KILN_FIELD_RESULT,
     .member = AT(samples_direct),
     .saved = KILN_FIELD_SAVED_IN_STEP,
     .high = 0x1p31,
     .present = has_target},
    {.name = KILN_FIELD_SAMPLES_TAKEN,
     .unit = "1",
     .type = KILN_FIELD_UINT32,
     .components = 1,
     .domain = KILN_DOMAIN_TILE_RUN,
     .life = KILN_FIELD_RESULT,
     .member = AT(samples_taken),
     .saved = KILN_FIELD_SAVED_IN_STEP,
     .high = 0x1p31,
     .present = goes_on},
    {.name = "block",
     .unit = "1",
     .type = KILN_FIELD_UINT16,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(block),
     .high = KILN_TILE_TEXELS,
     .present = has_blocks},
    {.name = "mixture",
     .unit = "1",
     .type = KILN_FIELD_UINT64,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(mixture),
     .high = 0x1p64,
     .present = has_nodes},
    {.name = "seen",
     .unit = "1",
     .type = KILN_FIELD_UINT16,
     .components = 1,
     .domain = KILN_DOMAIN_TILE_RUN,
     .life = KILN_FIELD_RESULT,
     .member = AT(seen),
     .high = 1.0,
     .present = has_views},
    {.name = "near_probes",
     .unit = "1",
     .type = KILN_FIELD_UINT32,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT, /* found once, and moves with the points */
     .member = AT(surface.near_probes),
     .present = has_probes},
    {.name = "guide",
     .type = KILN_FIELD_FLOAT,
     .components = KILN_GUIDE_FLOATS,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(surface.guide),
     .saved = KILN_FIELD_SAVED,
     .high = FLT_MAX,
     .present = has_guide},
    {.name = "closing",
     .unit = "1",
     .type = KILN_FIELD_FLOAT,
     .components = KILN_CLOSING_FLOATS,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_RESULT,
     .member = AT(surface.closing),
     .saved = KILN_FIELD_SAVED,
     .high = FLT_MAX,
     .present = has_closing},
    /* scratch of a step */
    {.name = "next",
     .type = KILN_FIELD_RADIOSITY,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_STEP,
     .member = AT(next),
     .saved = KILN_FIELD_SAVED_IN_STEP,
     .high = INFINITY},
    {.name = "cost",
     .unit = "s",
     .type = KILN_FIELD_FLOAT,
     .components = 1,
     .domain = KILN_DOMAIN_TILE_RUN,
     .life = KILN_FIELD_STEP,
     .member = AT(cost),
     .high = INFINITY},
    {.name = "lacking",
     .unit = "1",
     .type = KILN_FIELD_UINT32,
     .components = 1,
     .domain = KILN_DOMAIN_TILE_RUN,
     .life = KILN_FIELD_STEP,
     .member = AT(lacking),
     .high = 1.0,
     .present = receives_visible},
    {.name = "queue",
     .unit = "1",
     .type = KILN_FIELD_QUEUE,
     .components = 1,
     .domain = KILN_DOMAIN_TILE_RUN,
     .length = KILN_FIELD_ONE,
     .life = KILN_FIELD_STEP,
     .member = AT(queue)},
    {.name = "source",
     .type = KILN_FIELD_RADIOSITY,
     .components = 1,
     .domain = KILN_DOMAIN_POINT,
     .life = KILN_FIELD_ALLGATHER,
     .member = AT(source),
     .saved = KILN_FIELD_SAVED_IN_GATHER,
     .high = INFINITY},
};
enum { ROWS = sizeof table / sizeof *table };
static_assert((int)ROWS <= (int)KILN_FIELDS_MAX, "a bake may have all fields of the table");

const struct kiln_field *kiln_fields(size_t *count)
{
    *count = ROWS;
    return table;
}

const char *kiln_field_unit(const struct kiln_field *field, const struct kiln_units *units)
{
    if (field->unit != NULL)
        return field->unit;
    return field->is_radiance ? units->radiance : units->irradiance;
}

const char *kiln_field_shown_name(const struct kiln_field *field)
{
    return field->dataset != NULL ? strrchr(field->dataset, '/') + 1 : NULL;
}

const struct kiln_field *kiln_field_shown(const char *name)
{
    for (size_t i = 0; i < ROWS; i++)
        if (table[i].dataset != NULL && table[i].channels != NULL &&
            strcmp(kiln_field_shown_name(&table[i]), name) == 0)
            return &table[i];
    return NULL;
}

/* ---- the fields of a bake ---- */

size_t kiln_field_set_find(const struct kiln_field_set *set, const char *name)
{
    size_t i = 0;
    while (i < set->count && strcmp(set->entry[i].field->name, name) != 0)
        i++;
    return i;
}

int kiln_field_set_add(struct kiln_field_set *set, const struct kiln_field *field, bool in_lightmaps,
                       struct kiln_error *error)
{
    struct kiln_field_entry entry = {.field = field, .in_lightmaps = in_lightmaps && field->channels != NULL};
    if (set->count == KILN_FIELDS_MAX || field->components > KILN_FIELD_COMPONENTS_MAX ||
        kiln_field_set_find(set, field->name) < set->count)
        return kiln_fail(error, KILN_BUG,
                         "the field '%s' cannot be added: there are %zu of at most %d, it has %u components of at most "
                         "%d, and no two may have the same name",
                         field->name, set->count, (int)KILN_FIELDS_MAX, field->components,
                         (int)KILN_FIELD_COMPONENTS_MAX);
    for (size_t k = 0; field->life == KILN_FIELD_SUM && k < KILN_FIELD_TERMS && field->terms[k] != NULL; k++) {
        const size_t term = kiln_field_set_find(set, field->terms[k]);
        if (term < set->count)
            entry.terms[entry.term_count++] = term;
        else if (k < KILN_FIELD_TERMS_ALWAYS)
            return kiln_fail(error, KILN_BUG, "the field '%s' is a sum with '%s', which this bake does not have",
                             field->name, field->terms[k]);
    }
    set->entry[set->count++] = entry;
    return KILN_OK;
}

void kiln_field_set_choose(struct kiln_field_set *set, const struct kiln_job *job)
{
    set->count = 0;
    for (size_t i = 0; i < ROWS; i++) {
        if (table[i].present != NULL && !table[i].present(job))
            continue;
        const bool in_lightmaps = table[i].in_lightmaps == NULL || table[i].in_lightmaps(job);
        const int status = kiln_field_set_add(set, &table[i], in_lightmaps, NULL);
        assert(status == KILN_OK); /* a failure would be an error in the table itself */
        (void)status;
    }
    for (size_t g = 0; g < job->scene.group_count; g++)
        for (int k = 0; k < KILN_GROUP_FIELDS; k++)
            set->entry[set->count++] = (struct kiln_field_entry){
                .field = job->scene.group_rows[g] + k, .in_lightmaps = job->scene.group_rows[g][k].channels != NULL};
}

/* ---- sizes ---- */

size_t kiln_field_size(const struct kiln_field *field)
{
    static const size_t sizes[] = {[KILN_FIELD_FLOAT] = sizeof(float),
                                   [KILN_FIELD_ERROR] = sizeof(uint16_t),
                                   [KILN_FIELD_RADIOSITY] = sizeof(uint64_t),
                                   [KILN_FIELD_UNORM16] = sizeof(uint16_t),
                                   [KILN_FIELD_UINT16] = sizeof(uint16_t),
                                   [KILN_FIELD_UINT32] = sizeof(uint32_t),
                                   [KILN_FIELD_UINT64] = sizeof(uint64_t),
                                   [KILN_FIELD_TILE_RUN] = sizeof(struct kiln_tile_run),
                                   [KILN_FIELD_QUEUE] = sizeof(struct kiln_work_queue)};
    return field->components * sizes[field->type];
}

uint64_t kiln_field_count(const struct kiln_field *field, const uint64_t items[KILN_DOMAINS])
{
    return field->length == KILN_FIELD_ONE ? 1 : items[field->domain] + (field->length == KILN_FIELD_ONE_MORE ? 1 : 0);
}

uint64_t kiln_field_set_bytes(const struct kiln_field_set *set, enum kiln_field_life life,
                              const uint64_t items[KILN_DOMAINS])
{
    uint64_t bytes = 0;
    for (size_t i = 0; i < set->count; i++)
        if (set->entry[i].field->life == life)
            bytes += kiln_field_count(set->entry[i].field, items) * kiln_field_size(set->entry[i].field);
    return bytes;
}

uint64_t kiln_field_set_point_bytes(const struct kiln_field_set *set, enum kiln_field_life life)
{
    uint64_t bytes = 0;
    for (size_t i = 0; i < set->count; i++) {
        const struct kiln_field *f = set->entry[i].field;
        bytes += f->life == life && f->domain == KILN_DOMAIN_POINT ? kiln_field_size(f) : 0;
    }
    return bytes;
}

uint64_t kiln_field_set_saved_bytes(const struct kiln_field_set *set)
{
    uint64_t bytes = 0;
    for (size_t i = 0; i < set->count; i++) {
        const struct kiln_field *f = set->entry[i].field;
        bytes += f->saved != KILN_FIELD_NOT_SAVED && f->domain == KILN_DOMAIN_POINT ? kiln_field_size(f) : 0;
    }
    return bytes;
}

uint64_t kiln_field_set_light_bytes(const struct kiln_field_set *set, uint64_t own, uint64_t total)
{
    const uint64_t groups =
        (set->count - kiln_group_fields_first(set)) / KILN_GROUP_FIELDS; /* integrate/relight/groups.h */
    return total * (kiln_field_set_point_bytes(set, KILN_FIELD_ALLGATHER) + groups * sizeof(uint64_t)) +
           own *
               (kiln_field_set_point_bytes(set, KILN_FIELD_RESULT) + kiln_field_set_point_bytes(set, KILN_FIELD_STEP));
}

uint32_t kiln_field_set_channels(const struct kiln_field_set *set)
{
    uint32_t channels = 0;
    for (size_t i = 0; i < set->count; i++)
        channels += set->entry[i].in_lightmaps ? set->entry[i].field->components : 0;
    return channels;
}

uint64_t kiln_field_set_plane_bytes(const struct kiln_field_set *set)
{
    uint64_t floats = 0;
    for (size_t i = 0; i < set->count; i++) {
        const struct kiln_field *f = set->entry[i].field;
        floats += f->channels != NULL && f->life != KILN_FIELD_SUM ? f->components : 0;
    }
    return floats * sizeof(float);
}

uint64_t kiln_field_set_column_bytes(const struct kiln_field_set *set)
{
    uint64_t floats = 0;
    for (size_t i = 0; i < set->count; i++)
        floats += set->entry[i].field->dataset != NULL ? set->entry[i].field->components : 0;
    return floats * sizeof(float);
}

/* ---- values ---- */

void kiln_field_floats(const struct kiln_field *field, const void *values, uint64_t first, uint64_t items,
                       float *floats)
{
    const uint64_t begin = first * field->components, count = items * field->components;
    switch (field->type) {
    case KILN_FIELD_FLOAT:
        memcpy(floats, (const float *)values + begin, count * sizeof *floats);
        break;
    case KILN_FIELD_ERROR:
        for (uint64_t i = 0; i < count; i++)
            floats[i] = kiln_error_unpack(((const uint16_t *)values)[begin + i]);
        break;
    case KILN_FIELD_RADIOSITY:
        for (uint64_t i = 0; i < count; i++)
            kiln_radiosity_unpack(((const uint64_t *)values)[begin + i], floats + 3 * i);
        break;
    case KILN_FIELD_UNORM16:
        for (uint64_t i = 0; i < count; i++)
            floats[i] = (float)((const uint16_t *)values)[begin + i] / 65535.0f;
        break;
    case KILN_FIELD_UINT16:
        for (uint64_t i = 0; i < count; i++)
            floats[i] = (float)((const uint16_t *)values)[begin + i];
        break;
    case KILN_FIELD_UINT32:
    case KILN_FIELD_UINT64:
    case KILN_FIELD_TILE_RUN:
    case KILN_FIELD_QUEUE:
        break;
    }
}

/* Number of floats in an item; 0 for items that are not numbers. */
static uint32_t floats_of(const struct kiln_field *field)
{
    switch (field->type) {
    case KILN_FIELD_FLOAT:
    case KILN_FIELD_ERROR:
        return field->components;
    case KILN_FIELD_RADIOSITY:
        return 3 * field->components;
    case KILN_FIELD_UNORM16: /* all are in 0..1 */
    case KILN_FIELD_UINT16:
    case KILN_FIELD_UINT32:
    case KILN_FIELD_UINT64:
    case KILN_FIELD_TILE_RUN:
    case KILN_FIELD_QUEUE:
        break;
    }
    return 0;
}

/* Range check for checkpoint values. Light is summed in fixed point, which cannot hold larger values. NaN is out of any
 * range. */
bool kiln_field_is_sane(const struct kiln_field *field, const void *values, uint64_t count)
{
    const double most = field->type == KILN_FIELD_ERROR ? (double)FLT_MAX : 1e36;
    const float low = (float)fmax(field->low, -most), high = (float)fmin(field->high, most);
    const uint32_t floats = floats_of(field);
    bool sane = true;
    for (uint64_t i = 0; field->type == KILN_FIELD_UINT32 && i < count * field->components; i++)
        sane = sane && (double)((const uint32_t *)values)[i] <= field->high;
    for (uint64_t i = 0; floats > 0 && i < count; i++) {
        float value[3 * KILN_FIELD_COMPONENTS_MAX];
        kiln_field_floats(field, values, i, 1, value);
        for (uint32_t c = 0; c < floats; c++)
            sane = sane && value[c] >= low && value[c] <= high;
    }
    return sane;
}
