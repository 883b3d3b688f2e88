#include "coordinator/integrate/cells/tile_error.h"

#include <math.h>

#include "coordinator/integrate/cells/late.h"
#include "coordinator/integrate/cells/schedule.h"
#include "coordinator/integrate/cells/tail.h"
#include "coordinator/integrate/cells/tiles.h"
#include "coordinator/integrate/parts.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"
#include "worker/scene/radiosity.h"

/* Sums over a tile's points, in steps of STEPS; relative to what each point has had. ANSWERS are the points whose
 * answers are their own: of those of a block (blocks.h), one. */
enum { NOW, BEFORE, SQUARE, POINTS, ANSWERS, SUMS };
#define STEPS 0x1p32
#define SHARE_MOST 0x1p10 /* of a point, so that its square times STEPS times 64 points fits into 64 bits */

static void add_point(const struct kiln_integration *in, struct kiln_own_point point, bool is_first, double mean,
                      uint64_t sums[static SUMS])
{
    const struct kiln_surface *surface = &in->solution->own->surface;
    const double had = kiln_luminance_of_floats(&in->solution->own->sum[3 * point.at]);
    float last[3], before[3];
    if (!kiln_point_valid(surface, point) || !(had > 0.0))
        return;
    kiln_tail_last(in, point, last);
    kiln_radiosity_unpack(in->solution->radiosity[kiln_global_of_own(surface, point).at], before);
    const double all = had + KILN_LATE_DARK * mean, now = fmin(kiln_luminance_of_floats(last) / all, SHARE_MOST);
    sums[NOW] += (uint64_t)(now * STEPS);
    sums[BEFORE] += (uint64_t)(fmin(kiln_luminance_of_floats(before) / all, SHARE_MOST) * STEPS);
    sums[SQUARE] += (uint64_t)(now * now * STEPS);
    sums[POINTS]++;
    sums[ANSWERS] += is_first;
}

/* Adds the own points that have not ended to the sums of their tiles. */
static void add_points(const struct kiln_integration *in, double mean, uint64_t *tiles)
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

/* The ratio at which the last of `bounces` after direct light would have this share of all. */
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

/* How unsure a tile's last bounce is, relative: the standard error of the mean m of n values x,
 * sqrt(sum (x - m)^2 / (n (n - 1))) / m, divided by sqrt(n); n is that of the answers. `square` is n sum x^2 / (sum
 * x)^2. The whole standard error takes all that differs within a tile for chance, and few samples then hide tiles that
 * keep their light: with it a dining room of 16 samples ended after 9 bounces, 0.8 % too dark, instead of after 164. */
static double spread_of(const uint64_t sums[static SUMS])
{
    const double points = (double)sums[POINTS], answers = (double)sums[ANSWERS], now = (double)sums[NOW] / STEPS;
    const double square = points * (double)sums[SQUARE] / STEPS / (now * now);
    return answers > 1.0 ? sqrt(fmax(0.0, square - 1.0) / (answers - 1.0) / answers) : 1.0;
}

/* A tile's ratio, as far from q as both its last two bounces and its share say beyond chance. */
static double ratio_of(const uint64_t sums[static SUMS], double share, size_t bounces, double q)
{
    const double ratio = (double)sums[NOW] / (double)sums[BEFORE], unsure = KILN_TILE_SIGMAS * spread_of(sums);
    const double low = ratio * (1.0 - sqrt(2.0) * unsure), high = ratio * (1.0 + sqrt(2.0) * unsure);
    const double least = fmin(low, ratio_by_share(share * (1.0 - unsure), bounces));
    if (least > q)
        return fmin(least, KILN_TAIL_RATIO_MOST);
    return fmin(q, fmax(high, ratio_by_share(share * (1.0 + unsure), bounces)));
}

static double error_of(const uint64_t sums[static SUMS], const struct kiln_tail_fit *fit, double q, size_t bounces)
{
    if (sums[NOW] == 0 || sums[BEFORE] == 0)
        return 0.0;
    const double share = (double)sums[NOW] / STEPS / (double)sums[POINTS], tail = q / (1.0 - q);
    const double ratio = ratio_of(sums, share, bounces, q), own = ratio / (1.0 - ratio);
    const double off = fabs(own - tail) + fmin(fit->error, 1.0) * tail;
    return share * off / (1.0 + share * fmax(own, tail));
}

/* Of all tiles, whose sums are `count` numbers. */
static double largest_error(const uint64_t *tiles, size_t count, const struct kiln_tail_fit *fit, size_t bounces)
{
    const double q = fmin(kiln_luminance(fit->ratio), KILN_TAIL_RATIO_MOST);
    double largest = 0.0;
#pragma omp parallel for schedule(static) reduction(max : largest)
    for (size_t t = 0; t < count; t += SUMS)
        largest = fmax(largest, error_of(&tiles[t], fit, q, bounces));
    return largest;
}

int kiln_tile_error(const struct kiln_integration *in, double *largest, struct kiln_error *error)
{
    const struct kiln_surface *surface = &in->solution->own->surface;
    const struct kiln_step_reports part = kiln_part_reports(&in->solution->report.steps);
    const size_t first = kiln_cells_first(in->settings), count = (size_t)surface->tile_count * SUMS;
    struct kiln_tail_fit fit;
    uint64_t *tiles = NULL;
    double mean = 0.0;
    int status = kiln_agree(in->communicator,
                            kiln_allocate(&tiles, count, sizeof *tiles, "what is left in tiles", error), error);
    if (status == KILN_OK)
        status = kiln_tiles_mean(in, in->solution->own->sum, &mean, error);
    *largest = 0.0;
    if (status == KILN_OK) {
        kiln_cells_fit_tail(part.of + first, part.count - first, &fit);
        add_points(in, mean, tiles);
        kiln_tiles_reduce(in, tiles, count);
        *largest = largest_error(tiles, count, &fit, part.count - first - 1);
    }
    kiln_free(&tiles);
    return status;
}
