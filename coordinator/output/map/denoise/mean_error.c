#include <math.h>

#include "coordinator/job/job.h"
#include "coordinator/output/image.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/stage.h"
#include "worker/base/memory.h"

static bool wanted(const struct kiln_output_params *params) { return params->parts; }

/* Sums over a row: texel area; area x value of each part; and over the blocks that begin in the row, the sums of
 * add_block. */
enum { AREA, PARTS, ALONE = PARTS + KILN_PARTS, TOGETHER, TEXELS, PAIRS, SUMS };

static void sum_row(const struct kiln_map *map, float *const *parts, uint32_t y, double sums[SUMS])
{
    for (size_t i = (size_t)y * map->width; i < (y + (size_t)1) * map->width; i++) {
        if (map->state[i] != KILN_TEXEL_VALID)
            continue;
        sums[AREA] += (double)map->area[i];
        for (size_t k = 0; k < KILN_PARTS; k++)
            sums[PARTS + k] += (double)map->area[i] * (double)parts[k][i];
    }
}

/* The squared standard error of the mean of the parts' values. */
static double variance_of(const double values[KILN_PARTS])
{
    double mean = 0.0, square = 0.0;
    for (size_t k = 0; k < KILN_PARTS; k++)
        mean += values[k] / KILN_PARTS;
    for (size_t k = 0; k < KILN_PARTS; k++)
        square += (values[k] - mean) * (values[k] - mean);
    return square / (KILN_PARTS * (KILN_PARTS - 1));
}

enum { BLOCK = 4 }; /* side, in texels: bands begin with a block */

/* Adds the block whose first texel is (x, y) to the row's sums: the sum of its texels' variances, the variance of their
 * sum, and the numbers of texels and of pairs of texels. */
static void add_block(const struct kiln_map *map, float *const *parts, uint32_t x, uint32_t y, double row[SUMS])
{
    double sums[KILN_PARTS] = {0}, texels = 0.0;
    for (uint32_t j = y; j < y + BLOCK && j < map->height; j++)
        for (uint32_t i = x; i < x + BLOCK && i < map->width; i++) {
            const size_t at = (size_t)j * map->width + i;
            double values[KILN_PARTS];
            if (map->state[at] != KILN_TEXEL_VALID)
                continue;
            for (size_t k = 0; k < KILN_PARTS; k++)
                sums[k] += values[k] = (double)parts[k][at];
            row[ALONE] += variance_of(values);
            texels += 1.0;
        }
    row[TOGETHER] += variance_of(sums);
    row[TEXELS] += texels;
    row[PAIRS] += texels * (texels - 1.0);
}

/* Mean correlation of two texels of a block: mean covariance over mean variance. Neighbours share part of their noise,
 * since they gather the same noisy bounces. The variance of a block's sum is the sum of its texels' variances plus the
 * covariances of all pairs. */
static float shared_part(const double sums[SUMS])
{
    if (!(sums[PAIRS] > 0.0) || !(sums[TOGETHER] > sums[ALONE]) || !(sums[ALONE] > 0.0))
        return 0.0f;
    const double covariance = (sums[TOGETHER] - sums[ALONE]) / sums[PAIRS];
    return (float)fmin(covariance / (sums[ALONE] / sums[TEXELS]), 1.0);
}

/* Reports the standard error of the object's mean, and the part of the error that neighbours share. Changes nothing
 * else. */
static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    const struct kiln_map *map = work->map;
    float *const *parts = map->planes + work->reads[0];
    double means[KILN_PARTS] = {0}, mean = 0.0, sums[SUMS], (*rows)[SUMS] = NULL;
    int status = kiln_bands_agree(
        map, kiln_allocate(&rows, kiln_map_rows(map), sizeof *rows, "sums over a lightmap", error), error);
#pragma omp parallel for schedule(static) if (status == KILN_OK && kiln_map_texels(map) > KILN_IMAGE_ALONE)
    for (uint32_t y = map->first_row; y < (status == KILN_OK ? map->end_row : map->first_row); y++) {
        sum_row(map, parts, y, rows[y - map->first_row]);
        for (uint32_t x = 0; y % BLOCK == 0 && x < map->width; x += BLOCK)
            add_block(map, parts, x, y, rows[y - map->first_row]);
    }
    if (status == KILN_OK)
        status = kiln_bands_sum(map, rows[0], SUMS, sums, error);
    kiln_free(&rows);
    if (status != KILN_OK)
        return status;
    for (size_t k = 0; k < KILN_PARTS && sums[AREA] > 0.0; k++)
        mean += (means[k] = sums[PARTS + k] / sums[AREA]) / KILN_PARTS;
    work->report->mean_error = mean > 0.0 ? KILN_PARTS_STUDENT * sqrt(variance_of(means)) / mean : 0.0;
    work->shared = shared_part(sums);
    return KILN_OK;
}

const struct kiln_map_stage kiln_map_stage_mean_error = {
    .name = "mean error", .wanted = wanted, .fields = {"parts"}, .run = run};
