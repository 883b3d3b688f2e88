#include "coordinator/integrate/parts/tile_pool.h"

#include <math.h>

#include "coordinator/integrate/tile_sums.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

#define STEPS 0x1p40 /* of a value: sums of integers are exact. A tile weighs at most 2^14. */

/* A sum of values by weight. */
struct weighed {
    double value, weight;
};

/* Over the tile of a tile run and those around it. */
static struct weighed sum_around(const struct kiln_surface *s, const uint64_t *tiles, const struct kiln_tile_run *run)
{
    const struct kiln_lightmap *map = &s->lightmaps[run->map];
    const uint32_t x = run->tile % map->tiles_x, y = run->tile / map->tiles_x;
    struct weighed sum = {0.0, 0.0};
    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < map->tiles_y; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < map->tiles_x; u++) {
            const uint64_t *tile = tiles + 2 * (map->tile_first + (uint64_t)v * map->tiles_x + u);
            sum.value += (double)tile[0];
            sum.weight += (double)tile[1];
        }
    return sum;
}

int kiln_tile_pool(const struct kiln_integrate_params *p, const struct kiln_surface *s, double most,
                   const uint32_t *weights, double *values, struct kiln_error *error)
{
    uint64_t *tiles = NULL; /* of each: sum of values, in STEPS, and of weights */
    int status = kiln_allocate(&tiles, 2 * (size_t)s->tile_count, sizeof *tiles, "the noise of the tiles", error);
    KILN_TRY(kiln_agree(p->communicator, status, error));
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < s->tile_run_count; i++) {
        uint64_t *tile = tiles + 2 * (s->lightmaps[s->tile_runs[i].map].tile_first + s->tile_runs[i].tile);
        const double part = most > 0.0 ? fmin(values[i] / most, 1.0) : 0.0;
        kiln_tiles_add(&tile[0], (uint64_t)llround(part * STEPS) * weights[i]);
        kiln_tiles_add(&tile[1], weights[i]);
    }
    kiln_tiles_reduce(p->communicator, p->settings, tiles, 2 * s->tile_count);
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < s->tile_run_count; i++) {
        const struct weighed sum = sum_around(s, tiles, &s->tile_runs[i]);
        if (sum.weight > 0.0)
            values[i] = sum.value / sum.weight * (most / STEPS);
    }
end:
    kiln_free(&tiles);
    return status;
}
