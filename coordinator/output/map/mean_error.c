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

/* Reports the standard error of the object's mean. Changes nothing. */
static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    (void)error;
    float *const *parts = work->map->planes + kiln_layers_plane(work->layers, work->result->fields, "parts");
    double means[KILN_PARTS] = {0}, mean = 0.0, square = 0.0;
    find_means(work->map, parts, means);
    for (size_t k = 0; k < KILN_PARTS; k++)
        mean += means[k] / KILN_PARTS;
    for (size_t k = 0; k < KILN_PARTS; k++)
        square += (means[k] - mean) * (means[k] - mean);
    work->report->mean_error = mean > 0.0 ? sqrt(square / (KILN_PARTS * (KILN_PARTS - 1))) / mean : 0.0;
    return KILN_OK;
}

const struct kiln_map_stage kiln_map_stage_mean_error = {
    .name = "mean error", .wanted = wanted, .fields = {"parts"}, .run = run};
