#include "coordinator/integrate/cells/adapt.h"

#include <math.h>

#include "coordinator/field/packed_error.h"
#include "coordinator/integrate/cells/light_mean.h"
#include "coordinator/integrate/tile_sums.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

/* The pilot has one of every PILOT_PART samples, at least PILOT_LEAST. With fewer, the noise of few samples of many
 * lights hides the noise at shadow edges. With fewer than DIRECT_LEAST samples in all, a pilot costs more than it
 * saves. */
enum { PILOT_PART = 8, PILOT_LEAST = 16, DIRECT_LEAST = 64 };
/* Most lights for which a pilot is traced. With more, each has few samples, whose spread hides that of the shadows, and
 * the loss by cutting a net in two is not made good: with 40 (20 square lamps) and 64 samples 8 % by rays. */
enum { LIGHTS_MOST = 16 };
/* Samples per point in the second step. They are a multiple of SAMPLES_STEP, so that quarters (kiln_quarter_first) are
 * equal; at least SAMPLES_LEAST, for shadows that the pilot has missed; at most SAMPLES_TIMES x samples_direct. */
enum { SAMPLES_STEP = 4, SAMPLES_LEAST = 8, SAMPLES_TIMES = 16 };
#define DARK 0.1                          /* of the mean irradiance: e */
#define NEIGHBOUR 0.25                    /* fraction of a neighbouring tile's spread that is used for a tile */
#define SPREAD_STEPS 0x1p24               /* fixed-point steps of a spread of 1 */
#define SPREAD_MOST 0x1p28                /* of a point */
enum { LEVELS = 128, LEVEL_OF_ONE = 64 }; /* levels: octaves of spread; level 0: no spread */

uint32_t kiln_adapt_pilot(const struct kiln_integrate_settings *settings)
{
    const uint32_t part = settings->samples_direct / PILOT_PART;
    if (settings->schedule != KILN_SCHEDULE_LEAN || settings->samples_direct < DIRECT_LEAST ||
        settings->lights > LIGHTS_MOST || settings->parts > 1)
        return 0;
    return part > PILOT_LEAST ? part : PILOT_LEAST;
}

double kiln_adapt_share(uint32_t pilot, uint32_t samples)
{
    const double first = (double)pilot * sqrt((double)pilot), second = (double)samples * sqrt((double)samples);
    return second / (first + second);
}

/* ---- spreads ---- */

/* Adds the spreads of this rank's points to the sums of their tiles, in steps of SPREAD_STEPS. */
static void add_spreads(const struct kiln_rank_data *own, double mean, uint64_t *tiles)
{
    const struct kiln_surface *surface = &own->surface;
#pragma omp parallel for schedule(static)
    for (size_t f = 0; f < surface->tile_run_count; f++) {
        const struct kiln_tile_run *run = &surface->tile_runs[f];
        const uint64_t first = kiln_own_of_global(surface, run->first).at;
        uint64_t sum = 0;
        for (uint64_t i = first; i < first + run->count; i++) {
            const double error = (double)kiln_error_unpack(own->error[i]),
                         light = fmax(0.0, kiln_luminance_of_floats(&own->direct[3 * i]));
            const double spread = error > 0.0 ? error / (light + DARK * mean) * (error / mean) : 0.0;
            sum += (uint64_t)(fmin(spread, SPREAD_MOST) * SPREAD_STEPS);
        }
        kiln_tiles_add(&tiles[surface->lightmaps[run->map].tile_first + run->tile], sum);
    }
}

static double tile_spread(const struct kiln_surface *surface, const uint64_t *tiles, uint64_t tile)
{
    const int points = __builtin_popcountll(surface->tiles[tile].mask);
    return points > 0 ? (double)tiles[tile] / points : 0.0;
}

/* The level of tile (x, y) of a lightmap: the octave of its spread, or of a share of a neighbour's. */
static uint32_t level_of(const struct kiln_surface *surface, const uint64_t *tiles, const struct kiln_lightmap *map,
                         uint32_t x, uint32_t y)
{
    double most = 0.0;
    int exponent;
    for (uint32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < map->tiles_y; v++)
        for (uint32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < map->tiles_x; u++) {
            const double spread = tile_spread(surface, tiles, map->tile_first + (uint64_t)v * map->tiles_x + u);
            most = fmax(most, u == x && v == y ? spread : NEIGHBOUR * spread);
        }
    if (!(most > 0.0))
        return 0;
    (void)frexp(most / SPREAD_STEPS, &exponent);
    return (uint32_t)(exponent < 1 - LEVEL_OF_ONE         ? 1
                      : exponent >= LEVELS - LEVEL_OF_ONE ? LEVELS - 1
                                                          : exponent + LEVEL_OF_ONE);
}

/* ---- samples ---- */

/* Budget of the second step. */
struct budget {
    uint64_t points[LEVELS]; /* of all tiles, by level */
    uint32_t mean, most;     /* samples of a point */
};

/* Returns the samples per point for a level; `one`: samples for a spread of 1. */
static uint32_t samples_at(const struct budget *budget, uint32_t level, double one)
{
    /* a power of two times a square root, which are the same on every machine */
    const double wanted = level > 0 ? one * sqrt(ldexp(1.0, (int)level - LEVEL_OF_ONE)) : 0.0;
    const uint32_t samples = !(wanted > SAMPLES_LEAST)       ? SAMPLES_LEAST
                             : wanted < (double)budget->most ? (uint32_t)wanted
                                                             : budget->most;
    return (samples + SAMPLES_STEP - 1) / SAMPLES_STEP * SAMPLES_STEP;
}

/* Finds the samples for a spread of 1, such that the mean over all points is at most the budget's. It is exceeded only
 * if the least numbers of samples exceed it. */
static double share_out(const struct budget *budget)
{
    double points = 0.0, low = 0x1p-60, high = 0x1p90;
    for (uint32_t level = 0; level < LEVELS; level++)
        points += (double)budget->points[level];
    for (int i = 0; i < 64; i++) {
        const double middle = sqrt(low) * sqrt(high);
        double total = 0.0;
        for (uint32_t level = 0; level < LEVELS; level++)
            total += (double)budget->points[level] * (double)samples_at(budget, level, middle);
        if (total <= points * (double)budget->mean)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Points of all tiles by level. */
static void count_levels(const struct kiln_surface *surface, const uint64_t *tiles, uint64_t points[LEVELS])
{
    for (uint32_t m = 0; m < surface->map_count; m++) {
        const struct kiln_lightmap *map = &surface->lightmaps[m];
#pragma omp parallel for schedule(static) reduction(+ : points[:LEVELS]) if (map->tiles_y > 16)
        for (uint32_t y = 0; y < map->tiles_y; y++)
            for (uint32_t x = 0; x < map->tiles_x; x++)
                points[level_of(surface, tiles, map, x, y)] += (uint64_t)__builtin_popcountll(
                    surface->tiles[map->tile_first + (uint64_t)y * map->tiles_x + x].mask);
    }
}

/* Chooses the samples of this rank's tile runs, from the spreads of all tiles. */
static void choose_samples(const struct kiln_rank_data *own, const uint64_t *tiles, struct budget *budget)
{
    const struct kiln_surface *surface = &own->surface;
    count_levels(surface, tiles, budget->points);
    const double one = share_out(budget);
#pragma omp parallel for schedule(static)
    for (size_t f = 0; f < surface->tile_run_count; f++) {
        const struct kiln_tile_run *run = &surface->tile_runs[f];
        const struct kiln_lightmap *map = &surface->lightmaps[run->map];
        const uint32_t level = level_of(surface, tiles, map, run->tile % map->tiles_x, run->tile / map->tiles_x);
        own->samples[f] = samples_at(budget, level, one);
    }
}

int kiln_adapt_samples(const struct kiln_integration *in, uint32_t mean, struct kiln_error *error)
{
    const struct kiln_rank_data *own = in->solution->own;
    const struct kiln_surface *surface = &own->surface;
    const uint64_t most = (uint64_t)SAMPLES_TIMES * in->settings->samples_direct;
    struct budget budget = {.mean = mean, .most = most < UINT32_MAX / 2 ? (uint32_t)most : UINT32_MAX / 2};
    uint64_t *tiles = NULL;
    double light = 0.0;
    int status;
    KILN_TRY(kiln_agree(
        in->communicator,
        kiln_allocate(&tiles, (size_t)surface->tile_count, sizeof *tiles, "the spreads of tiles", error), error));
    KILN_TRY(kiln_light_mean(in, own->direct, NULL, &light, error));
    if (light > 0.0)
        add_spreads(own, light, tiles);
    kiln_tiles_reduce(in->communicator, in->settings, tiles, surface->tile_count);
    choose_samples(own, tiles, &budget);
end:
    kiln_free(&tiles);
    return status;
}
