#include <math.h>

#include "coordinator/job/job.h"
#include "coordinator/output/map/stage.h"

static bool wanted(const struct kiln_output_params *params) { return params->parts; }

/* The mean luminance over the object that each part found, by area. */
static void find_means(const struct kiln_map *map, float *const *parts, double means[KILN_PARTS])
{
    double area = 0.0;
    for (size_t i = 0; i < kiln_map_texels(map); i++) {
        if (map->state[i] != KILN_TEXEL_VALID)
            continue;
        area += (double)map->area[i];
        for (size_t k = 0; k < KILN_PARTS; k++)
            means[k] += (double)map->area[i] * (double)parts[k][i];
    }
    for (size_t k = 0; k < KILN_PARTS && area > 0.0; k++)
        means[k] /= area;
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

/* Sums over blocks: of the variances of their texels, of the variance of their sum; texels, and pairs of them. */
struct blocks {
    double alone, together, texels, pairs;
};

enum { BLOCK = 4 }; /* side, in texels */

/* Adds the block whose first texel is (x, y). */
static void add_block(const struct kiln_map *map, float *const *parts, uint32_t x, uint32_t y, struct blocks *blocks)
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
            blocks->alone += variance_of(values);
            texels += 1.0;
        }
    blocks->together += variance_of(sums);
    blocks->texels += texels;
    blocks->pairs += texels * (texels - 1.0);
}

/* The mean covariance of two texels of a block over their mean variance: what neighbours share, as they share the noise
 * of the bounces that they gather. Of the sum over a block the variance is that of its texels alone, and the covariance
 * of all pairs. */
static float shared_part(const struct kiln_map *map, float *const *parts)
{
    struct blocks blocks = {0};
    for (uint32_t y = 0; y < map->height; y += BLOCK)
        for (uint32_t x = 0; x < map->width; x += BLOCK)
            add_block(map, parts, x, y, &blocks);
    if (!(blocks.pairs > 0.0) || !(blocks.together > blocks.alone) || !(blocks.alone > 0.0))
        return 0.0f;
    const double covariance = (blocks.together - blocks.alone) / blocks.pairs;
    return (float)fmin(covariance / (blocks.alone / blocks.texels), 1.0);
}

/* Reports the standard error of the object's mean, and finds what of the error neighbours share. Changes nothing else.
 */
static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    (void)error;
    float *const *parts = work->map->planes + kiln_layers_plane(work->layers, work->result->fields, "parts");
    double means[KILN_PARTS] = {0}, mean = 0.0;
    find_means(work->map, parts, means);
    for (size_t k = 0; k < KILN_PARTS; k++)
        mean += means[k] / KILN_PARTS;
    work->report->mean_error = mean > 0.0 ? sqrt(variance_of(means)) / mean : 0.0;
    work->shared = shared_part(work->map, parts);
    return KILN_OK;
}

const struct kiln_map_stage kiln_map_stage_mean_error = {
    .name = "mean error", .wanted = wanted, .fields = {"parts"}, .run = run};
