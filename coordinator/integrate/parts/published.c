#include "coordinator/integrate/parts/published.h"

#include <math.h>

#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/job/job.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

enum {
    REACH = 2, /* texels to each side of an eye's mean */
    SIDE = 8,  /* of a tile, texels */
    BINS = 512 /* of errors, by their logarithm */
};
#define DARK 0.05        /* of an object's mean */
#define BIN_LEAST 1e-6   /* relative error of the first bin */
#define BIN_STEP 0.03125 /* of the natural logarithm */

/* A tile run's light at its places in the tile. */
struct tile_light {
    float part[KILN_PARTS][SIDE * SIDE];
    float all[SIDE * SIDE];
    uint64_t there; /* places with light */
};

static void lay_out(struct tile_light *t, const struct kiln_rank_data *data, const struct kiln_tile_run *run)
{
    struct kiln_own_point own = kiln_own_of_global(&data->surface, run->first);
    t->there = 0;
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, own.at++) {
        const int place = __builtin_ctzll(rest);
        if (!kiln_point_valid(&data->surface, own))
            continue;
        t->there |= (uint64_t)1u << place;
        t->all[place] = (float)kiln_part_light(data, own.at);
        for (int k = 0; k < KILN_PARTS; k++)
            t->part[k][place] = data->parts[KILN_PARTS * own.at + (uint64_t)k];
    }
}

/* The window of a texel lies within the tile, so that it has all its texels. */
static int window_first(int at)
{
    const int first = at - REACH, last = SIDE - 2 * REACH - 1;
    return first < 0 ? 0 : first > last ? last : first;
}

/* Variance of the mean over a window, and the light there. */
static double window(const struct tile_light *t, int u, int v, double *light)
{
    double sums[KILN_PARTS] = {0.0}, count = 0.0, mean = 0.0, square = 0.0;
    *light = 0.0;
    for (int y = v; y <= v + 2 * REACH; y++)
        for (int x = u; x <= u + 2 * REACH; x++) {
            const int place = y * SIDE + x;
            if ((t->there >> place & 1u) == 0)
                continue;
            count += 1.0;
            *light += (double)t->all[place];
            for (int k = 0; k < KILN_PARTS; k++)
                sums[k] += (double)t->part[k][place];
        }
    *light /= count;
    for (int k = 0; k < KILN_PARTS; k++)
        mean += sums[k] / KILN_PARTS;
    for (int k = 0; k < KILN_PARTS; k++)
        square += (sums[k] - mean) * (sums[k] - mean);
    return square / (count * count * KILN_PARTS * (KILN_PARTS - 1));
}

static size_t bin_of(double error)
{
    const double at = log(fmax(error, BIN_LEAST) / BIN_LEAST) / BIN_STEP;
    return at >= BINS - 1 ? BINS - 1 : (size_t)at;
}

double kiln_published_tile(struct kiln_published *p, const struct kiln_rank_data *data, const struct kiln_tile_run *run)
{
    struct tile_light t;
    double square = 0.0, count = 0.0;
    const double dark = p->dark[kiln_map_object(&data->surface, run->map)];
    lay_out(&t, data, run);
    for (uint64_t rest = t.there; rest != 0; rest &= rest - 1) {
        const int place = __builtin_ctzll(rest);
        double light;
        const double variance = p->gain * window(&t, window_first(place % SIDE), window_first(place / SIDE), &light),
                     allowed = fmax(light, dark);
        square += variance > 0.0 ? fmin(variance / (allowed * allowed), 1e12) : 0.0;
        count += 1.0;
    }
    if (!(count > 0.0))
        return 0.0;
    const double error = sqrt(square / count);
    p->numbers[bin_of(error)] += (uint64_t)count;
    return error;
}

/* Collective. Mean luminance of each object, by area, times DARK. */
static int find_dark(struct kiln_published *p, const struct kiln_integrate_params *params,
                     const struct kiln_rank_data *data, double unit, struct kiln_error *error)
{
    const size_t objects = data->surface.object_count;
    struct kiln_exact_sum *sums = NULL;
    int status;
    KILN_TRY(kiln_allocate(&sums, 2 * objects, sizeof *sums, "the objects' light", error));
    for (size_t i = 0; i < data->surface.tile_run_count; i++) {
        const struct kiln_tile_run *run = &data->surface.tile_runs[i];
        const struct kiln_own_point first = kiln_own_of_global(&data->surface, run->first);
        struct kiln_exact_sum *of = &sums[2 * kiln_map_object(&data->surface, run->map)];
        for (uint64_t k = first.at; k < first.at + run->count; k++)
            if (kiln_point_valid(&data->surface, (struct kiln_own_point){k})) {
                const double area = (double)data->surface.area[k];
                kiln_exact_add(&of[0], area * kiln_part_light(data, k), 1.0 / unit);
                kiln_exact_add(&of[1], area, 1.0 / kiln_exact_unit(params->area));
            }
    }
end:
    status = kiln_agree(params->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_exact_reduce(params->communicator, sums, 2 * objects, error);
    for (size_t o = 0; status == KILN_OK && o < objects; o++) {
        const double area = kiln_exact_value(&sums[2 * o + 1], kiln_exact_unit(params->area));
        p->dark[o] = area > 0.0 ? DARK * kiln_exact_value(&sums[2 * o], unit) / area : 0.0;
    }
    kiln_free(&sums);
    return status;
}

int kiln_published_begin(struct kiln_published *p, const struct kiln_integrate_params *params,
                         const struct kiln_rank_data *data, double gain, double unit, struct kiln_error *error)
{
    *p = (struct kiln_published){.gain = gain};
    int status = kiln_allocate(&p->dark, data->surface.object_count, sizeof *p->dark, "the objects' light", error);
    if (status == KILN_OK)
        status = kiln_allocate(&p->numbers, BINS, sizeof *p->numbers, "the texels' errors", error);
    status = kiln_agree(params->communicator, status, error);
    return status == KILN_OK ? find_dark(p, params, data, unit, error) : status;
}

/* Share of the points whose error is above x. */
static double share_above(const uint64_t numbers[BINS], double x)
{
    double above = 0.0, all = 0.0;
    for (size_t b = 0; b < BINS; b++)
        if (numbers[b] > 0) {
            const double error = BIN_LEAST * exp(((double)b + 0.5) * BIN_STEP);
            all += (double)numbers[b];
            above += (double)numbers[b] * erfc(x / (sqrt(2.0) * error));
        }
    return all > 0.0 ? above / all : 0.0;
}

double kiln_published_reached(struct kiln_published *p, MPI_Comm communicator)
{
    double low = 0.0, high = 4.0 * BIN_LEAST * exp(BINS * BIN_STEP);
    (void)MPI_Allreduce(MPI_IN_PLACE, p->numbers, BINS, MPI_UINT64_T, MPI_SUM, communicator);
    for (int i = 0; i < 60; i++) {
        const double middle = 0.5 * (low + high);
        if (share_above(p->numbers, middle) > 1.0 - KILN_PUBLISHED_SHARE)
            low = middle;
        else
            high = middle;
    }
    return high;
}

void kiln_published_release(struct kiln_published *p)
{
    kiln_free(&p->dark);
    kiln_free(&p->numbers);
}
