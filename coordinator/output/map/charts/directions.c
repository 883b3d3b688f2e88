#include <math.h>

#include "coordinator/output/map/stage.h"

static void normalise_texel(float *const axes[3], size_t texel)
{
    double square = 0.0;
    for (int c = 0; c < 3; c++)
        square += (double)axes[c][texel] * (double)axes[c][texel];
    const double scale = square > 0.0 ? 1.0 / sqrt(square) : 0.0;
    for (int c = 0; c < 3; c++)
        axes[c][texel] = (float)((double)axes[c][texel] * scale);
}

/* Normalizes the directions of all texels with values of their own, some of which are means. Directions of length 0
 * stay. */
static void normalise(struct kiln_map *map, const uint32_t *nearest)
{
    const size_t first = kiln_map_first(map), end = kiln_map_end(map);
    for (uint32_t p = 0; p < map->has->count; p++) {
        if (!map->has->direction[p])
            continue;
#pragma omp parallel for schedule(static)
        for (size_t i = first; i < end; i++)
            if (nearest[i] == i)
                normalise_texel(&map->planes[p], i);
    }
}

static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    (void)error;
    normalise(work->map, work->nearest);
    return KILN_OK;
}

const struct kiln_map_stage kiln_map_stage_directions = {
    .name = "directions", .features = KILN_MAP_NEAREST, .run = run};
