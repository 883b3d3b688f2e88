#include <math.h>
#include <string.h>

#include "worker/pass/direct.h"
#include "worker/base/color.h"
#include "worker/pass/bidirectional.h"
#include "worker/pass/caustic.h"
#include "worker/pass/directional.h"
#include "worker/pass/directions.h"
#include "worker/pass/gather.h"
#include "worker/pass/guided.h"
#include "worker/pass/land.h"
#include "worker/pass/occlusion.h"
#include "worker/pass/links.h"
#include "worker/pass/patches.h"
#include "worker/pass/path.h"
#include "worker/pass/probes.h"
#include "worker/pass/radiance.h"
#include "worker/pass/reference.h"
#include "worker/pass/shapes.h"
#include "worker/pass/validity.h"
#include "worker/pass/weighed.h"

/* ---- how results compare ---- */

static void point_figures(const void *result, struct kiln_pass_figures *f)
{
    const struct kiln_point_mean mean = kiln_point_mean(result);
    f->count = mean.count;
    f->sound = isfinite(mean.error) && mean.error >= 0.0f;
    for (int c = 0; c < 3; c++) {
        f->value[c] = mean.irradiance[c];
        f->value[3 + c] = mean.incident[c];
    }
    for (int c = 0; c < 6; c++)
        f->sound = f->sound && isfinite(f->value[c]) && f->value[c] >= 0.0f;
    f->level = kiln_luminance_of_floats(mean.irradiance);
    f->error = (double)mean.error;
}

static void occlusion_figures(const void *result, struct kiln_pass_figures *f)
{
    const struct kiln_occlusion_result *r = result;
    f->count = r->count;
    f->value[0] = kiln_mean(r->open, r->count);
    for (int c = 0; c < 3; c++)
        f->value[1 + c] = kiln_mean(r->direction[c], r->count);
    f->sound = isfinite(r->error) && r->error >= 0.0f && f->value[0] >= 0.0f && f->value[0] <= 1.0f;
    for (int c = 1; c < 4; c++)
        f->sound = f->sound && fabsf(f->value[c]) <= 1.0f;
    f->level = (double)f->value[0];
    f->error = (double)kiln_mean(r->error, r->count);
}

/* ---- what results lack ---- */

static uint32_t channels_without(const float rgb[3])
{
    return (isnan(rgb[0]) ? 1u : 0u) | (isnan(rgb[1]) ? 2u : 0u) | (isnan(rgb[2]) ? 4u : 0u);
}

/* Channels that are missing in a gather result. The guided pass's result begins with the same struct, and shares this
 * function and the figures. */
static uint32_t gather_lacks(const void *result)
{
    return channels_without(((const struct kiln_point_result *)result)->incident);
}

static uint32_t directional_lacks(const void *result)
{
    return channels_without(((const struct kiln_directional_result *)result)->radiance[0]);
}

/* ---- the table ---- */

#define POINT_FIGURES                                                                                                  \
    .figures = point_figures, .figure_count = 6, .unit = "W/m2",                                                       \
    .figure_names = {"irradiance", "irradiance", "irradiance", "incident light", "incident light", "incident light"}

/* Not verified: its tests have yes-or-no answers, and few of them; errors of a point show in its light. */
const struct kiln_pass kiln_pass_validity = {.index = KILN_PASS_INDEX_validity,
                                             .name = "validity",
                                             .what = "validity",
                                             .domain = KILN_DOMAIN_TILE_RUNS,
                                             .result_bytes = sizeof(uint16_t)};

const struct kiln_pass kiln_pass_direct = {.index = KILN_PASS_INDEX_direct,
                                           .name = "direct",
                                           .what = "direct light",
                                           .domain = KILN_DOMAIN_TILE_RUNS,
                                           .result_bytes = sizeof(struct kiln_point_result),
                                           .is_sampled = true,
                                           .has_streams = true,
                                           .is_divisible = true,
                                           .is_masked = true,
                                           .is_stealable = true,
                                           POINT_FIGURES};

const struct kiln_pass kiln_pass_gather = {.index = KILN_PASS_INDEX_gather,
                                           .name = "gather",
                                           .what = "gathered light",
                                           .domain = KILN_DOMAIN_TILE_RUNS,
                                           .result_bytes = sizeof(struct kiln_point_result),
                                           .is_sampled = true,
                                           .has_streams = true,
                                           .reads_radiosity = true,
                                           .lacks = gather_lacks,
                                           .is_divisible = true,
                                           .is_masked = true,
                                           .is_stealable = true,
                                           POINT_FIGURES};

/* Not verified: probes have no standard error to compare with. */
const struct kiln_pass kiln_pass_probes = {.index = KILN_PASS_INDEX_probes,
                                           .name = "probes",
                                           .what = "light at probes",
                                           .domain = KILN_DOMAIN_POSITIONS,
                                           .parameter_bytes = sizeof(struct kiln_probe_parameters),
                                           .result_bytes = sizeof(struct kiln_probe_result),
                                           .is_sampled = true,
                                           .reads_radiosity = true};

const struct kiln_pass kiln_pass_occlusion = {
    .index = KILN_PASS_INDEX_occlusion,
    .name = "occlusion",
    .what = "ambient occlusion",
    .domain = KILN_DOMAIN_TILE_RUNS,
    .parameter_bytes = sizeof(struct kiln_occlusion_parameters),
    .result_bytes = sizeof(struct kiln_occlusion_result),
    .is_sampled = true,
    .is_masked = true,
    .is_stealable = true,
    .figures = occlusion_figures,
    .figure_count = 4,
    .unit = "of the hemisphere",
    .figure_names = {"open share", "open direction", "open direction", "open direction"}};

/* Not verified: it has no standard error to compare with. */
const struct kiln_pass kiln_pass_directional = {.index = KILN_PASS_INDEX_directional,
                                                .name = "directional",
                                                .what = "light by direction",
                                                .domain = KILN_DOMAIN_TILE_RUNS,
                                                .result_bytes = sizeof(struct kiln_directional_result),
                                                .is_sampled = true,
                                                .reads_radiosity = true,
                                                .is_masked = true,
                                                .lacks = directional_lacks,
                                                .is_stealable = true};

/* Not verified: the verifying backend processes tile runs only. */
const struct kiln_pass kiln_pass_path = {.index = KILN_PASS_INDEX_path,
                                         .name = "path",
                                         .what = "path-traced light",
                                         .domain = KILN_DOMAIN_PIXELS,
                                         .parameter_bytes = sizeof(struct kiln_path_parameters),
                                         .result_bytes = sizeof(struct kiln_path_result),
                                         .is_sampled = true,
                                         .is_divisible = true};

/* Not verified: it has no standard error to compare with. */
const struct kiln_pass kiln_pass_radiance = {.index = KILN_PASS_INDEX_radiance,
                                             .name = "radiance",
                                             .what = "radiance at probes",
                                             .domain = KILN_DOMAIN_POSITIONS,
                                             .parameter_bytes = sizeof(struct kiln_radiance_parameters),
                                             .result_bytes = sizeof(struct kiln_radiance_result),
                                             .is_sampled = true,
                                             .has_streams = true,
                                             .reads_radiosity = true};

const struct kiln_pass kiln_pass_guided = {.index = KILN_PASS_INDEX_guided,
                                           .name = "guided",
                                           .what = "gathered light",
                                           .domain = KILN_DOMAIN_TILE_RUNS,
                                           .parameter_bytes = sizeof(struct kiln_guided_parameters),
                                           .result_bytes = sizeof(struct kiln_guided_result),
                                           .is_sampled = true,
                                           .has_streams = true,
                                           .reads_radiosity = true,
                                           .lacks = gather_lacks,
                                           .is_divisible = true,
                                           .is_masked = true,
                                           .is_stealable = true,
                                           POINT_FIGURES};

const struct kiln_pass kiln_pass_caustic = {.index = KILN_PASS_INDEX_caustic,
                                            .name = "caustic",
                                            .what = "caustic light",
                                            .domain = KILN_DOMAIN_TILE_RUNS,
                                            .result_bytes = sizeof(struct kiln_point_result),
                                            .is_sampled = true,
                                            .has_streams = true,
                                            .is_divisible = true,
                                            .is_masked = true,
                                            .is_stealable = true,
                                            POINT_FIGURES};

/* Not verified: single paths cannot be compared. */
const struct kiln_pass kiln_pass_land = {.index = KILN_PASS_INDEX_land,
                                         .name = "land",
                                         .what = "light that lands",
                                         .domain = KILN_DOMAIN_LIGHT_PATHS,
                                         .parameter_bytes = sizeof(struct kiln_land_parameters),
                                         .result_bytes = sizeof(struct kiln_land_result)};

/* Not verified: the verifying backend processes tile runs only. */
const struct kiln_pass kiln_pass_bidirectional = {.index = KILN_PASS_INDEX_bidirectional,
                                                  .name = "bidirectional",
                                                  .what = "bidirectionally traced light",
                                                  .domain = KILN_DOMAIN_PIXELS,
                                                  .parameter_bytes = sizeof(struct kiln_bidirectional_parameters),
                                                  .result_bytes = sizeof(struct kiln_path_result),
                                                  .is_whole = true,
                                                  .is_sampled = true,
                                                  .is_divisible = true};

const struct kiln_pass kiln_pass_weighed = {.index = KILN_PASS_INDEX_weighed,
                                            .name = "weighed",
                                            .what = "caustic light, weighed",
                                            .domain = KILN_DOMAIN_TILE_RUNS,
                                            .parameter_bytes = sizeof(struct kiln_caustic_techniques),
                                            .result_bytes = sizeof(struct kiln_point_result),
                                            .is_sampled = true,
                                            .has_streams = true,
                                            .is_divisible = true,
                                            .is_masked = true,
                                            POINT_FIGURES};

const struct kiln_pass kiln_pass_reference = {.index = KILN_PASS_INDEX_reference,
                                              .name = "reference",
                                              .what = "light by paths",
                                              .domain = KILN_DOMAIN_TILE_RUNS,
                                              .parameter_bytes = sizeof(struct kiln_reference_parameters),
                                              .result_bytes = sizeof(struct kiln_reference_result),
                                              .is_sampled = true,
                                              .has_streams = true,
                                              .is_divisible = true,
                                              .is_masked = true,
                                              .is_stealable = true};

const struct kiln_pass kiln_pass_shapes = {.index = KILN_PASS_INDEX_shapes,
                                           .name = "shapes",
                                           .what = "shapes of patches",
                                           .domain = KILN_DOMAIN_TILE_RUNS,
                                           .result_bytes = sizeof(struct kiln_shape_result)};

/* Not verified: it has no standard error to compare with. */
const struct kiln_pass kiln_pass_patches = {.index = KILN_PASS_INDEX_patches,
                                            .name = "patches",
                                            .what = "light between patches",
                                            .domain = KILN_DOMAIN_TILE_RUNS,
                                            .parameter_bytes = sizeof(struct kiln_patches_parameters),
                                            .result_bytes = sizeof(struct kiln_patches_result),
                                            .is_sampled = true,
                                            .has_streams = true,
                                            .reads_radiosity = true,
                                            .is_stealable = true};

/* Not verified: its standard error does not cover differences by rounding. */
const struct kiln_pass kiln_pass_links = {.index = KILN_PASS_INDEX_links,
                                          .name = "links",
                                          .what = "light by links",
                                          .domain = KILN_DOMAIN_TILE_RUNS,
                                          .parameter_bytes = sizeof(struct kiln_links_parameters),
                                          .result_bytes = sizeof(struct kiln_point_result),
                                          .is_sampled = true,
                                          .has_streams = true,
                                          .reads_radiosity = true};

const struct kiln_pass kiln_pass_directions = {.index = KILN_PASS_INDEX_directions,
                                               .name = "directions",
                                               .what = "light by directions",
                                               .domain = KILN_DOMAIN_TILE_RUNS,
                                               .parameter_bytes = sizeof(struct kiln_directions_parameters),
                                               .result_bytes = sizeof(struct kiln_point_result),
                                               .is_sampled = true,
                                               .has_streams = true,
                                               .reads_radiosity = true,
                                               .is_stealable = true,
                                               POINT_FIGURES};

#define ROW(name) [KILN_PASS_INDEX_##name] = &kiln_pass_##name,
const struct kiln_pass *const kiln_passes[KILN_PASS_COUNT] = {KILN_PASS_LIST(ROW)};
#undef ROW

/* ---- results ---- */

double kiln_path_error(const struct kiln_path_result *result)
{
    const double n = result->count, mean = n > 0.0 ? kiln_luminance_of_floats(result->radiance) / n : 0.0;
    return n > 1.0 ? sqrt(fmax(0.0, (double)result->square / n - mean * mean) / (n - 1.0)) : 0.0;
}

int kiln_validity_keep(void *surface, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    const struct kiln_surface *s = surface;
    const struct kiln_tile_run *run = &s->tile_runs[first], *last = run + count - 1;
    const uint64_t points = kiln_tile_runs_points(run, last);
    const uint16_t *shares = results;
    uint16_t *visible = s->visible + kiln_own_of_global(s, run->first).at;
    for (uint64_t i = 0; i < points; i++)
        visible[i] = visible[i] != 0 ? shares[i] : 0;
    return KILN_OK;
}
