#include "coordinator/integrate/cells/tile_error.h"

#include <math.h>

#include "coordinator/integrate/cells/late.h"
#include "coordinator/integrate/cells/schedule.h"
#include "coordinator/integrate/cells/tail.h"
#include "coordinator/integrate/cells/light_mean.h"
#include "coordinator/integrate/parts/parts.h"
#include "coordinator/integrate/tile_sums.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/arena.h"
#include "worker/base/color.h"
#include "worker/scene/radiosity.h"

/* Sums over a tile's points, in steps of STEPS. Light is relative to all light of the point so far, power to the mean
 * power of all points. ANSWERS counts the points with an answer of their own: one per block (blocks.h). */
enum { NOW, BEFORE, SQUARE, POINTS, ANSWERS, POWER, POWER_BEFORE, SUMS };
#define STEPS 0x1p32
/* Fraction of the scene's points that are added to an object's, as bright as its own. So a small object that traps its
 * light, like a cup, does not prolong the bake; a dark room does. */
#define LEAST_OBJECT 1e-3
enum { RATIO_TILES = 8 }; /* least tiles of an object whose ratio has a standard error that can be trusted */
#define HAD_STEPS 0x1p12  /* of an object, of up to 2^32 points */
#define POWER_MOST 0x1p20 /* of a point, likewise */
#define SHARE_MOST 0x1p10 /* limit of a point's share: its square times STEPS times 64 points fits into 64 bits */

/* Means over all valid points of the light received so far: as radiosity, W/m2, and as power, W. */
struct means {
    double light, power;
};

static void add_point(const struct kiln_integration *in, struct kiln_own_point point, bool is_first,
                      const struct means *mean, uint64_t sums[static SUMS])
{
    const struct kiln_surface *surface = &in->solution->own->surface;
    const double had = kiln_luminance_of_floats(&in->solution->own->sum[3 * point.at]);
    float last[3], before[3];
    if (!kiln_point_valid(surface, point) || !(had > 0.0))
        return;
    kiln_tail_last(in, point, last);
    kiln_radiosity_unpack(in->solution->radiosity[kiln_global_of_own(surface, point).at], before);
    const double all = had + KILN_LATE_DARK * mean->light, now = fmin(kiln_luminance_of_floats(last) / all, SHARE_MOST);
    sums[NOW] += (uint64_t)(now * STEPS);
    sums[BEFORE] += (uint64_t)(fmin(kiln_luminance_of_floats(before) / all, SHARE_MOST) * STEPS);
    sums[SQUARE] += (uint64_t)(now * now * STEPS);
    sums[POINTS]++;
    const double area = (double)surface->area[point.at] / mean->power;
    sums[POWER] += (uint64_t)(fmin(area * kiln_luminance_of_floats(last), POWER_MOST) * STEPS);
    sums[POWER_BEFORE] += (uint64_t)(fmin(area * kiln_luminance_of_floats(before), POWER_MOST) * STEPS);
    sums[ANSWERS] += is_first;
}

/* Adds this rank's points to the sums of their tiles, except points of tile runs that have ended. */
static void add_points(const struct kiln_integration *in, const struct means *mean, uint64_t *tiles)
{
    const struct kiln_rank_data *own = in->solution->own;
    const struct kiln_surface *surface = &own->surface;
#pragma omp parallel for schedule(static)
    for (size_t f = 0; f < surface->tile_run_count; f++) {
        const struct kiln_tile_run *run = &surface->tile_runs[f];
        struct kiln_own_point point = kiln_own_of_global(surface, run->first);
        uint64_t sums[SUMS] = {0}, *tile = &tiles[SUMS * (surface->lightmaps[run->map].tile_first + run->tile)];
        if (own->samples_bounce[f] == 0)
            continue;
        for (uint32_t k = 0; k < run->count; k++, point.at++)
            add_point(in, point, own->block == NULL || own->block[point.at] == k, mean, sums);
        for (int k = 0; k < SUMS; k++)
            kiln_tiles_add(&tile[k], sums[k]);
    }
}

/* Returns the ratio of a geometric series, starting with direct light, whose last of `bounces` terms has this share of
 * the sum. */
static double ratio_by_share(double share, size_t bounces)
{
    double low = 0.0, high = KILN_TAIL_RATIO_MOST;
    for (int i = 0; i < 40; i++) {
        const double middle = 0.5 * (low + high);
        double power = 1.0, all = 1.0;
        for (size_t k = 0; k < bounces; k++) {
            power *= middle;
            all += power;
        }
        if (power < share * all)
            low = middle;
        else
            high = middle;
    }
    return high;
}

/* Returns the relative uncertainty of a tile's last bounce: the standard error of the mean m of n values x, sqrt(sum (x
 * - m)^2 / (n (n - 1))) / m, divided by sqrt(n), with n the number of answers. `square` is n sum x^2 / (sum x)^2. The
 * undivided standard error would count all differences within a tile as noise; with few samples it would hide tiles
 * that trap light. A dining room with 16 samples then ended after 9 bounces, 0.8 % too dark, instead of after 164. */
static double spread_of(const double sums[static SUMS])
{
    const double answers = sums[ANSWERS], square = sums[POINTS] * sums[SQUARE] / (sums[NOW] * sums[NOW]);
    return answers > 1.0 ? sqrt(fmax(0.0, square - 1.0) / (answers - 1.0) / answers) : 1.0;
}

/* Estimates a tile's ratio. It differs from q only as far as both its last two bounces and its share differ
 * significantly. */
static double ratio_of(const double sums[static SUMS], double share, size_t bounces, double q)
{
    const double ratio = sums[NOW] / sums[BEFORE], unsure = KILN_TILE_SIGMAS * spread_of(sums);
    const double low = ratio * (1.0 - sqrt(2.0) * unsure), high = ratio * (1.0 + sqrt(2.0) * unsure);
    const double least = fmin(low, ratio_by_share(share * (1.0 - unsure), bounces));
    if (least > q)
        return fmin(least, KILN_TAIL_RATIO_MOST);
    return fmin(q, fmax(high, ratio_by_share(share * (1.0 + unsure), bounces)));
}

/* Error of the tail in a tile or an object, relative to its last bounce: `off` is the error; `most` the larger one of
 * the estimated tail and its own. */
struct miss {
    double off, most;
};

static struct miss miss_of_ratio(double ratio, const struct kiln_tail_fit *fit, double q)
{
    const double tail = q / (1.0 - q), own = ratio / (1.0 - ratio);
    return (struct miss){fabs(own - tail) + fmin(fit->error, 1.0) * tail, fmax(own, tail)};
}

static struct miss miss_of(const double sums[static SUMS], const struct kiln_tail_fit *fit, double q, size_t bounces)
{
    if (!(sums[NOW] > 0.0) || !(sums[BEFORE] > 0.0))
        return (struct miss){0.0, 0.0};
    return miss_of_ratio(ratio_of(sums, sums[NOW] / sums[POINTS], bounces, q), fit, q);
}

/* Converts a tile's sums from fixed point. */
static void take_sums(const uint64_t tile[static SUMS], double sums[static SUMS])
{
    for (int k = 0; k < SUMS; k++)
        sums[k] = (double)tile[k] / (k == POINTS || k == ANSWERS ? 1.0 : STEPS);
}

/* Error that the tail would make in an object: sums over its tiles of `off` and of `most` (struct miss), each times the
 * power of the tile's last bounce; sums of the powers of the last bounce and of the one before, of their squares, and
 * of their products; number of tiles with power. Powers are relative to the mean power of all points. */
struct missed {
    double off, most;
    double now, before, now2, before2, product;
    size_t tiles;
};

/* Adds a tile to the errors of its object, and keeps the tile with the largest error. */
static void look_at_tile(const struct kiln_integration *in, const double sums[static SUMS], uint32_t object,
                         struct miss miss, struct missed *missed)
{
    struct kiln_integrate_report *report = &in->solution->report;
    const double share = sums[POINTS] > 0.0 ? sums[NOW] / sums[POINTS] : 0.0,
                 error = share * miss.off / (1.0 + share * miss.most);
    missed->off += sums[POWER] * miss.off;
    missed->most += sums[POWER] * miss.most;
    missed->now += sums[POWER];
    missed->before += sums[POWER_BEFORE];
    missed->now2 += sums[POWER] * sums[POWER];
    missed->before2 += sums[POWER_BEFORE] * sums[POWER_BEFORE];
    missed->product += sums[POWER] * sums[POWER_BEFORE];
    missed->tiles += sums[POWER] > 0.0;
    if (error > report->tail_tile_error) {
        report->tail_tile_error = error;
        report->tail_pocket = object;
    }
}

/* Estimates the miss of each tile, by all threads. */
static void find_misses(const struct kiln_surface *surface, const uint64_t *tiles, const struct kiln_tail_fit *fit,
                        size_t bounces, struct miss *misses)
{
    const double q = fmin(kiln_luminance(fit->ratio), KILN_TAIL_RATIO_MOST);
#pragma omp parallel for schedule(dynamic, 64)
    for (uint64_t t = 0; t < surface->tile_count; t++) {
        double sums[SUMS];
        take_sums(&tiles[SUMS * t], sums);
        misses[t] = miss_of(sums, fit, q, bounces);
    }
}

/* Visits all tiles, in the same order on all ranks. */
static void look_at_tiles(const struct kiln_integration *in, const uint64_t *tiles, const struct miss *misses,
                          struct missed *missed)
{
    const struct kiln_surface *surface = &in->solution->own->surface;
    in->solution->report.tail_tile_error = 0.0;
    in->solution->report.tail_pocket = 0;
    for (uint32_t map = 0; map < surface->map_count; map++) {
        const struct kiln_lightmap *m = &surface->lightmaps[map];
        const uint32_t object = kiln_map_object(surface, map);
        if (!kiln_map_is_result(surface, map))
            continue;
        for (uint64_t t = m->tile_first; t < m->tile_first + (uint64_t)m->tiles_x * m->tiles_y; t++) {
            double sums[SUMS];
            take_sums(&tiles[SUMS * t], sums);
            look_at_tile(in, sums, object, misses[t], &missed[object]);
        }
    }
}

/* Error that the tail would make in an object by the ratio of its powers, as far as it differs significantly from q: by
 * the standard error of a ratio of sums over tiles (Cochran, "Sampling Techniques", section 6.4). */
static double off_of_object(const struct missed *m, const struct kiln_tail_fit *fit)
{
    if (m->tiles < RATIO_TILES || !(m->before > 0.0))
        return 0.0;
    const double q = fmin(kiln_luminance(fit->ratio), KILN_TAIL_RATIO_MOST), ratio = m->now / m->before,
                 square = m->now2 - 2.0 * ratio * m->product + ratio * ratio * m->before2,
                 unsure = KILN_TILE_SIGMAS * sqrt(fmax(square, 0.0)) / m->before,
                 least = fmin(ratio - unsure, KILN_TAIL_RATIO_MOST), most = ratio + unsure;
    return m->now * miss_of_ratio(fmin(fmax(q, least), most), fit, q).off;
}

/* Points of an object, and the power that they have received so far, in steps of HAD_STEPS of the mean power. */
enum { HAD_POWER, HAD_POINTS, HADS };

/* Returns the largest relative error of an object's mean. `had`: HADS of each object, including ended tiles. */
static double largest_of_objects(const struct kiln_integration *in, const uint64_t *had, const struct missed *missed,
                                 const struct kiln_tail_fit *fit)
{
    const size_t objects = in->solution->own->surface.object_count;
    double largest = 0.0, points = 0.0;
    for (size_t o = 0; o < objects; o++)
        points += (double)had[HADS * o + HAD_POINTS];
    for (size_t o = 0; o < objects; o++) {
        const double own = (double)had[HADS * o + HAD_POWER] / HAD_STEPS, of = (double)had[HADS * o + HAD_POINTS],
                     all = own > 0.0 ? own * (1.0 + LEAST_OBJECT * points / of) + missed[o].most : 0.0,
                     off = fmax(missed[o].off, off_of_object(&missed[o], fit));
        largest = fmax(largest, all > 0.0 ? off / all : 0.0);
    }
    return largest;
}

/* Adds up, by object, the power that this rank's points have received so far. A small part of the mean light
 * (KILN_LATE_DARK) is added, so that much darker points count less. */
static void add_had(const struct kiln_integration *in, const struct means *mean, uint64_t *had)
{
    const struct kiln_surface *surface = &in->solution->own->surface;
#pragma omp parallel for schedule(static)
    for (size_t f = 0; f < surface->tile_run_count; f++) {
        const struct kiln_tile_run *run = &surface->tile_runs[f];
        struct kiln_own_point point = kiln_own_of_global(surface, run->first);
        uint64_t *of = &had[HADS * (size_t)kiln_map_object(surface, run->map)], power = 0, points = 0;
        for (uint32_t k = 0; k < run->count && kiln_map_is_result(surface, run->map); k++, point.at++) {
            const double own = kiln_luminance_of_floats(&in->solution->own->sum[3 * point.at]);
            const double all = (double)surface->area[point.at] * (own + KILN_LATE_DARK * mean->light);
            if (!kiln_point_valid(surface, point) || !(own > 0.0))
                continue;
            power += (uint64_t)(fmin(all / mean->power, POWER_MOST) * HAD_STEPS);
            points++;
        }
        kiln_tiles_add(&of[HAD_POWER], power);
        kiln_tiles_add(&of[HAD_POINTS], points);
    }
}

int kiln_tile_error(const struct kiln_integration *in, double *largest, struct kiln_error *error)
{
    const struct kiln_surface *surface = &in->solution->own->surface;
    const struct kiln_step_reports part = kiln_part_reports(&in->solution->report.steps);
    const size_t first = kiln_cells_first(in->settings), count = (size_t)surface->tile_count * SUMS;
    const size_t bounces = part.count - first - 1;
    struct kiln_tail_fit fit;
    struct kiln_arena arena = {0};
    uint64_t *tiles = NULL, *had = NULL;
    struct missed *missed = NULL;
    struct miss *misses = NULL;
    struct means mean = {0.0, 0.0};
    int status = kiln_arena_allocate(&arena, &tiles, count, sizeof *tiles, "what is left in tiles", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&arena, &had, HADS * (size_t)surface->object_count, sizeof *had,
                                     "what is left in objects", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&arena, &missed, surface->object_count, sizeof *missed, "what is left in objects",
                                     error);
    if (status == KILN_OK)
        status =
            kiln_arena_allocate(&arena, &misses, surface->tile_count, sizeof *misses, "what is left in tiles", error);
    status = kiln_agree(in->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_light_mean(in, in->solution->own->sum, NULL, &mean.light, error);
    if (status == KILN_OK)
        status = kiln_light_mean(in, in->solution->own->sum, surface->area, &mean.power, error);
    *largest = 0.0;
    if (status == KILN_OK) {
        kiln_cells_fit_tail(part.of + first, part.count - first, &fit);
        add_points(in, &mean, tiles);
        add_had(in, &mean, had);
        kiln_tiles_reduce(in->communicator, in->settings, tiles, count);
        kiln_tiles_reduce(in->communicator, in->settings, had, HADS * (uint64_t)surface->object_count);
        find_misses(surface, tiles, &fit, bounces, misses);
        look_at_tiles(in, tiles, misses, missed);
        *largest = largest_of_objects(in, had, missed, &fit);
    }
    kiln_arena_release(&arena);
    return status;
}
