#include "coordinator/output/map/seams/seams.h"

#include <math.h>
#include <string.h>

#include "coordinator/field/group_fields.h"
#include "coordinator/output/image.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/charts/dilate.h"
#include "coordinator/output/map/seams/joined.h"
#include "coordinator/output/map/seams/seam_samples.h"
#include "coordinator/output/map/stage.h"
#include "worker/base/memory.h"

enum { ENTRIES = KILN_SEAM_ENTRIES };

/* Lists the texels that the samples read. `numbers` has an entry per texel of the map, which becomes its number in the
 * list. */
static int list_texels(const struct kiln_map *map, const struct kiln_seam_sample *samples, size_t sample_count,
                       uint32_t *numbers, uint32_t **texels, size_t *count, struct kiln_error *error)
{
    for (size_t i = 0; i < sample_count; i++)
        for (int k = 0; k < ENTRIES; k++)
            numbers[samples[i].at[k]] = 1;
    return kiln_seams_number(map, numbers, texels, count, error);
}

static void fill_system(struct kiln_seam_system *s, const struct kiln_map *map, const struct kiln_seam_sample *samples,
                        const uint32_t *texels, const uint32_t *numbers)
{
    for (size_t i = 0; i < s->sample_count; i++) {
        s->samples[i] = samples[i];
        for (int k = 0; k < ENTRIES; k++)
            s->samples[i].at[k] = numbers[samples[i].at[k]];
    }
    for (size_t i = 0; i < s->unknown_count; i++)
        s->area[i] = map->area[texels[i]];
    for (uint32_t p = 0, to = 0; p < map->has->count; p++)
        if (map->has->smooth[p]) {
            for (size_t i = 0; i < s->unknown_count; i++)
                s->planes[to][i] = map->planes[p][texels[i]];
            to++;
        }
}

static void take_values(const struct kiln_seam_system *s, struct kiln_map *map, uint32_t *nearest,
                        const uint32_t *texels)
{
    for (uint32_t p = 0, from = 0; p < map->has->count; p++)
        if (map->has->smooth[p]) {
            for (size_t i = 0; i < s->unknown_count; i++)
                kiln_seam_set(map, nearest, p, texels[i], s->planes[from][i]);
            from++;
        }
}

static int solve(struct kiln_map *map, uint32_t *nearest, const struct kiln_seam_sample *samples, size_t count,
                 struct kiln_error *error)
{
    struct kiln_seam_system *system = NULL;
    uint32_t *numbers = NULL, *texels = NULL;
    size_t unknowns = 0;
    int status;
    KILN_TRY(kiln_map_allocate(map, &numbers, sizeof *numbers, "a seam's texels", error));
    KILN_TRY(list_texels(map, samples, count, numbers, &texels, &unknowns, error));
    KILN_TRY(kiln_seam_system_create(&system, unknowns, count, kiln_map_smooth_planes(map->has), error));
    fill_system(system, map, samples, texels, numbers);
    KILN_TRY(kiln_seam_system_solve(system, 0, 1, error));
    take_values(system, map, nearest, texels);
end:
    kiln_map_free(map, &numbers, sizeof *numbers);
    kiln_free(&texels);
    kiln_seam_system_destroy(&system);
    return status;
}

int kiln_seams_smooth(struct kiln_map *map, const struct kiln_chart_graph *graph, uint32_t *nearest, bool smooth,
                      struct kiln_seam_report *report, struct kiln_error *error)
{
    struct kiln_seam_sample *samples = NULL;
    size_t count = 0;
    *report = (struct kiln_seam_report){0};
    int status = kiln_map_dilate(map, nearest, NULL, error);
    if (status == KILN_OK)
        status = kiln_seams_sample(map, graph, nearest, &samples, &count, error);
    report->samples = count;
    if (status == KILN_OK)
        status = kiln_map_mean_luminance(map, &report->mean, error);
    if (status == KILN_OK && count > 0) {
        const double unit = report->mean > 0.0 ? 1.0 / report->mean : 0.0;
        report->difference_before = report->difference_after = unit * kiln_seam_difference(map->planes, samples, count);
        if (smooth && report->difference_before > 0.0) {
            status = solve(map, nearest, samples, count, error);
            report->difference_after = unit * kiln_seam_difference(map->planes, samples, count);
        }
    }
    kiln_free(&samples);
    return status;
}

/* As kiln_seams_smooth, for a map in bands, whose seams have been solved already, with the differences. */
static int apply_band(struct kiln_map_work *work, struct kiln_seam_report *report, struct kiln_error *error)
{
    const struct kiln_joined_report *found = kiln_joined_report(work->joined, work->object);
    *report = (struct kiln_seam_report){.samples = found->samples};
    int status = kiln_map_dilate(work->map, work->nearest, NULL, error);
    if (status == KILN_OK)
        status = kiln_map_mean_luminance(work->map, &report->mean, error);
    if (status != KILN_OK)
        return status;
    const double unit = report->mean > 0.0 ? 1.0 / report->mean : 0.0;
    report->difference_before = unit * found->before;
    report->difference_after = unit * found->after;
    kiln_joined_apply(work->joined, work->object, work->map, work->nearest);
    return KILN_OK;
}

/* As kiln_seams_smooth, for the map of an object that touches others. */
static int apply_joined(struct kiln_map_work *work, struct kiln_seam_report *report, struct kiln_error *error)
{
    struct kiln_seam_sample *samples = NULL;
    size_t count = 0;
    if (work->map->bands != NULL)
        return apply_band(work, report, error);
    *report = (struct kiln_seam_report){0};
    int status;
    KILN_TRY(kiln_map_dilate(work->map, work->nearest, NULL, error));
    KILN_TRY(kiln_seams_sample(work->map, work->graph, work->nearest, &samples, &count, error));
    KILN_TRY(kiln_map_mean_luminance(work->map, &report->mean, error));
    const double unit = report->mean > 0.0 ? 1.0 / report->mean : 0.0;
    report->samples = count;
    report->difference_before = unit * kiln_seam_difference(work->map->planes, samples, count);
    kiln_joined_apply(work->joined, work->object, work->map, work->nearest);
    report->difference_after = unit * kiln_seam_difference(work->map->planes, samples, count);
end:
    kiln_free(&samples);
    return status;
}

/* ---- light of groups (field/group_fields.h) ----
 *
 * Each group's light is scaled by the factor by which smoothing changed the direct or indirect light of the texel. So
 * one solution serves all groups, and their sum stays the total. Where light grows by more than MOST_CHANGE, from next
 * to nothing, no factor is used: the last group, which has the light of no other group, gets the difference. */

enum { LIGHT = KILN_MAP_ERROR };
#define MOST_CHANGE 4.0f

/* Copies the map's light before it is smoothed, for the rows on this rank. */
static int keep_light(const struct kiln_map_work *work, float *before[LIGHT], struct kiln_error *error)
{
    const size_t first = kiln_map_first(work->map), count = kiln_map_end(work->map) - first;
    int status = kiln_map_dilate(work->map, work->nearest, NULL, error);
    for (int p = 0; p < LIGHT && status == KILN_OK; p++) {
        status = kiln_allocate(&before[p], count, sizeof(float), "the light of groups", error);
        if (status == KILN_OK)
            memcpy(before[p], work->map->planes[p] + first, count * sizeof(float));
    }
    return kiln_bands_agree(work->map, status, error);
}

/* Change of light: factor and addend. */
struct change {
    float factor, more;
};

static struct change change_of(float before, float after)
{
    const bool grows = after > MOST_CHANGE * before; /* from 0, too */
    return (struct change){grows || before == after ? 1.0f : after / before, grows ? after - before : 0.0f};
}

/* Changes one colour of a texel in all groups. planes[0]: direct light of the first group in this colour. */
static void change_groups(float **planes, size_t groups, size_t texel, struct change direct, struct change rest)
{
    for (size_t g = 0; g < groups; g++) {
        float *of = &planes[6 * g][texel], *all = &planes[6 * g + 3][texel];
        const float more = g + 1 == groups ? direct.more : 0.0f,
                    both = g + 1 == groups ? direct.more + rest.more : 0.0f;
        *all = direct.factor * *of + rest.factor * (*all - *of) + both;
        *of = direct.factor * *of + more;
    }
}

static void smooth_groups(const struct kiln_map_work *work, size_t first, float *const before[LIGHT])
{
    const struct kiln_field_set *fields = work->result->fields;
    float **planes = work->map->planes;
    const uint32_t plane = kiln_layers_plane(work->layers, first);
    const size_t groups = (fields->count - first) / KILN_GROUP_FIELDS;
    const size_t begin = kiln_map_first(work->map);
#pragma omp parallel for schedule(static) if (kiln_map_texels(work->map) > KILN_IMAGE_ALONE)
    for (size_t i = begin; i < kiln_map_end(work->map); i++)
        for (uint32_t c = 0; c < 3; c++) {
            const float direct = planes[KILN_MAP_DIRECT + c][i], indirect = planes[KILN_MAP_INDIRECT + c][i],
                        was = before[c][i - begin], rest = before[3 + c][i - begin];
            if (direct != was || indirect != rest)
                change_groups(planes + plane + c, groups, i, change_of(was, direct), change_of(rest, indirect));
        }
}

static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    struct kiln_seam_report seams;
    const bool smooth = work->params->stitch;
    const size_t groups = kiln_group_fields_first(work->result->fields);
    float *before[LIGHT] = {NULL};
    int status;
    KILN_TRY(smooth && groups < work->result->fields->count ? keep_light(work, before, error) : KILN_OK);
    KILN_TRY(work->joined != NULL ? apply_joined(work, &seams, error)
                                  : kiln_seams_smooth(work->map, work->graph, work->nearest, smooth, &seams, error));
    if (before[0] != NULL)
        smooth_groups(work, groups, before);
end:
    for (int p = 0; p < LIGHT; p++)
        kiln_free(&before[p]);
    if (status == KILN_OK) {
        work->report->seam_difference_before = seams.difference_before;
        work->report->seam_difference_after = seams.difference_after;
    }
    return status;
}

/* Number of samples from which solving takes longer than most other work on a map. */
enum { MANY_SAMPLES = 1 << 12 };

static bool is_long(const struct kiln_map_work *work)
{
    size_t samples = 0;
    const struct kiln_chart_graph *graph = work->joined == NULL && work->params->stitch ? work->graph : NULL;
    for (size_t i = 0; graph != NULL && i < graph->edge_count && samples < MANY_SAMPLES; i++)
        samples += kiln_seam_sample_count(&graph->edges[i]);
    return samples >= MANY_SAMPLES;
}

const struct kiln_map_stage kiln_map_stage_seams = {.name = "seams",
                                                    .after_joining = true,
                                                    .features = KILN_MAP_CHARTS | KILN_MAP_NEAREST,
                                                    .is_long = is_long,
                                                    .run = run};
