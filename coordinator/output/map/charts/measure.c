#include <math.h>

#include "coordinator/output/image.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/stage.h"
#include "worker/base/memory.h"

/* Sums over the texels of a row. */
enum { COVERED, SURFACE, AREA, LIGHT, SQUARES, SUMS };

/* Luminance of a texel. `caustic`: the first plane of caustics; KILN_MAP_PLANES_MAX: there are none. */
static float luminance_at(const struct kiln_map *map, uint32_t caustic, size_t i)
{
    float rgb[3];
    for (int c = 0; c < 3; c++)
        rgb[c] = map->planes[KILN_MAP_DIRECT + c][i] + map->planes[KILN_MAP_INDIRECT + c][i] +
                 (caustic < KILN_MAP_PLANES_MAX ? map->planes[caustic + (uint32_t)c][i] : 0.0f);
    return kiln_rgb_luminance(rgb[0], rgb[1], rgb[2]);
}

static void sum_row(const struct kiln_map *map, uint32_t caustic, uint32_t y, double sums[SUMS])
{
    for (size_t i = (size_t)y * map->width; i < (y + (size_t)1) * map->width; i++) {
        const double own = (double)map->area[i], error = (double)map->planes[KILN_MAP_ERROR][i];
        sums[COVERED] += (double)map->coverage[i];
        sums[SURFACE] += own;
        if (map->state[i] != KILN_TEXEL_VALID)
            continue;
        sums[AREA] += own;
        sums[LIGHT] += own * (double)luminance_at(map, caustic, i);
        sums[SQUARES] += own * error * error;
    }
}

/* Statistics over gathered texels: mean luminance by area, and root mean square of the relative standard error. Also
 * the actual texels per metre of the object: square root of covered texels / area. */
static void report_sums(const double sums[SUMS], struct kiln_lightmap_report *report)
{
    report->mean = sums[AREA] > 0.0 ? sums[LIGHT] / sums[AREA] : 0.0;
    report->error = report->mean > 0.0 ? sqrt(sums[SQUARES] / sums[AREA]) / report->mean : 0.0;
    report->texels_per_metre = sums[SURFACE] > 0.0 ? sqrt(sums[COVERED] / sums[SURFACE]) : 0.0;
}

/* Reports on the map before later stages change it. Changes nothing. */
static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    const struct kiln_map *map = work->map;
    const uint32_t caustic = work->reads[KILN_MAP_IF_ANY];
    double(*rows)[SUMS] = NULL, sums[SUMS];
    int status = kiln_bands_agree(
        map, kiln_allocate(&rows, kiln_map_rows(map), sizeof *rows, "sums over a lightmap", error), error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(static) if (kiln_map_texels(map) > KILN_IMAGE_ALONE)
    for (uint32_t y = map->first_row; y < map->end_row; y++)
        sum_row(map, caustic, y, rows[y - map->first_row]);
    uint64_t valid = 0, filled = 0;
#pragma omp parallel for schedule(static) reduction(+ : valid, filled) if (kiln_map_texels(map) > KILN_IMAGE_ALONE)
    for (size_t i = kiln_map_first(map); i < kiln_map_end(map); i++) {
        valid += map->state[i] == KILN_TEXEL_VALID;
        filled += map->state[i] == KILN_TEXEL_FILLED;
    }
    uint64_t counts[] = {valid, filled};
    status = kiln_bands_sum(map, rows[0], SUMS, sums, error);
    if (status == KILN_OK)
        status = kiln_bands_count(map, counts, 2, error);
    kiln_free(&rows);
    if (status != KILN_OK)
        return status;
    report_sums(sums, work->report);
    work->report->valid = counts[0];
    work->report->filled = counts[1];
    return KILN_OK;
}

const struct kiln_map_stage kiln_map_stage_measure = {.name = "measure", .if_any = "caustic", .run = run};
