#include "coordinator/integrate/cells/late.h"

#include <math.h>

#include "coordinator/integrate/cells/schedule.h"
#include "coordinator/integrate/cells/tail.h"
#include "coordinator/integrate/cells/light_mean.h"
#include "coordinator/integrate/parts/parts.h"
#include "coordinator/integrate/tile_sums.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

#define STEPS 0x1p32      /* of the fixed point in the share 1 */
#define SHARE_MOST 0x1p16 /* limit of a point's share, so that the sum over a tile fits into 64 bits */

void kiln_late_reset(const struct kiln_rank_data *own)
{
    for (size_t f = 0; own->samples_bounce != NULL && f < own->surface.tile_run_count; f++)
        own->samples_bounce[f] = 1;
}

void kiln_late_clear(const struct kiln_rank_data *own)
{
#pragma omp parallel for schedule(static)
    for (uint64_t i = 0; i < own->surface.count; i++)
        own->next[i] = 0;
}

/* The last bounce's radiosity over all so far, in steps of STEPS. */
static uint64_t share_of(const struct kiln_integration *in, struct kiln_own_point point, double mean)
{
    const struct kiln_rank_data *own = in->solution->own;
    const double so_far = kiln_luminance_of_floats(&own->sum[3 * point.at]);
    const uint16_t *albedo = &own->surface.albedo[3 * point.at];
    float last[3];
    if (!kiln_point_valid(&own->surface, point))
        return 0;
    if (!(so_far > 0.0))
        return albedo[0] > 0 || albedo[1] > 0 || albedo[2] > 0 ? (uint64_t)STEPS : 0;
    kiln_tail_last(in, point, last);
    return (uint64_t)(fmin(kiln_luminance_of_floats(last) / (so_far + KILN_LATE_DARK * mean), SHARE_MOST) * STEPS);
}

/* Adds the shares of this rank's points to the sums of their tiles. */
static void add_shares(const struct kiln_integration *in, double mean, uint64_t *tiles)
{
    const struct kiln_rank_data *own = in->solution->own;
    const struct kiln_surface *surface = &own->surface;
#pragma omp parallel for schedule(static)
    for (size_t f = 0; f < surface->tile_run_count; f++) {
        const struct kiln_tile_run *run = &surface->tile_runs[f];
        struct kiln_own_point point = kiln_own_of_global(surface, run->first);
        uint64_t sum = 0;
        if (own->samples_bounce[f] == 0)
            continue;
        for (uint32_t k = 0; k < run->count; k++, point.at++)
            sum += share_of(in, point, mean);
        kiln_tiles_add(&tiles[surface->lightmaps[run->map].tile_first + run->tile], sum);
    }
}

/* The largest mean share of a tile and its neighbours. */
static double largest_share(const struct kiln_surface *surface, const uint64_t *tiles, const struct kiln_tile_run *run)
{
    const struct kiln_lightmap *map = &surface->lightmaps[run->map];
    const uint32_t x = run->tile % map->tiles_x, y = run->tile / map->tiles_x;
    double most = 0.0;
    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < map->tiles_y; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < map->tiles_x; u++) {
            const uint64_t tile = map->tile_first + (uint64_t)v * map->tiles_x + u;
            const int points = __builtin_popcountll(surface->tiles[tile].mask);
            most = points > 0 ? fmax(most, (double)tiles[tile] / STEPS / points) : most;
        }
    return most;
}

static void end_tile_runs(const struct kiln_integration *in, const uint64_t *tiles, uint32_t samples)
{
    const struct kiln_rank_data *own = in->solution->own;
    const struct kiln_step_reports part = kiln_part_reports(&in->solution->report.steps);
    const size_t first = kiln_cells_first(in->settings);
    struct kiln_tail_fit fit;
    float factor[3];
    kiln_cells_fit_tail(part.of + first, part.count - first, &fit);
    for (int c = 0; c < 3; c++)
        fit.ratio[c] = fmax(fit.ratio[c], fit.latest[c]);
    kiln_tail_factors(&fit, factor);
    const double left = fmax(kiln_luminance_of_floats(factor), 1e-9);
#pragma omp parallel for schedule(static)
    for (size_t f = 0; f < own->surface.tile_run_count; f++) {
        const struct kiln_tile_run *run = &own->surface.tile_runs[f];
        if (own->samples_bounce[f] == 0)
            continue;
        const bool ends = left * largest_share(&own->surface, tiles, run) <= KILN_LATE_LEFT;
        own->samples_bounce[f] = ends ? 0 : samples;
        if (ends)
            kiln_tail_extend(in, kiln_own_of_global(&own->surface, run->first), run->count, factor);
    }
}

int kiln_late_choose(const struct kiln_integration *in, uint32_t samples, struct kiln_error *error)
{
    const struct kiln_surface *surface = &in->solution->own->surface;
    uint64_t *tiles = NULL;
    double mean = 0.0;
    int status;
    KILN_TRY(kiln_agree(
        in->communicator,
        kiln_allocate(&tiles, (size_t)surface->tile_count, sizeof *tiles, "what is left in tiles", error), error));
    KILN_TRY(kiln_light_mean(in, in->solution->own->sum, NULL, &mean, error));
    add_shares(in, mean, tiles);
    kiln_tiles_reduce(in->communicator, in->settings, tiles, surface->tile_count);
    end_tile_runs(in, tiles, samples);
end:
    kiln_free(&tiles);
    return status;
}
