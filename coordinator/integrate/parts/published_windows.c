#include "coordinator/integrate/parts/published_windows.h"

#include <math.h>

#include "coordinator/integrate/parts/part_errors.h"

enum {
    REACH = 2, /* texels to each side of an eye's mean */
    SIDE = 8   /* of a tile, texels */
};
#define BIN_LEAST 1e-6   /* relative error of the first bin */
#define BIN_STEP 0.03125 /* of the natural logarithm */

/* The area of a whole texel, m2: the largest in the tile, or the object's mean where a tile has but edges of charts. */
static double whole_texel(const struct kiln_published *p, const struct kiln_surface *s, const struct kiln_tile_run *run)
{
    const uint64_t first = kiln_own_of_global(s, run->first).at;
    double most = p->texel[kiln_map_object(s, run->map)];
    for (uint64_t k = first; k < first + run->count; k++)
        most = fmax(most, (double)s->area[k]);
    return most;
}

void kiln_tile_light_weigh(const struct kiln_published *p, struct kiln_tile_light *t, const struct kiln_surface *s,
                           const struct kiln_tile_run *run)
{
    const double whole = whole_texel(p, s, run);
    const bool shown = kiln_map_is_result(s, run->map);
    struct kiln_own_point own = kiln_own_of_global(s, run->first);
    t->there = 0;
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, own.at++) {
        const int place = kiln_part_place((uint32_t)__builtin_ctzll(rest));
        if (!kiln_point_valid(s, own))
            continue;
        t->there |= (uint64_t)1u << place;
        t->weight[place] = !shown ? 0 : (uint32_t)ceil(KILN_WINDOW_FULL * fmin((double)s->area[own.at] / whole, 1.0));
    }
}

void kiln_tile_light_lay_out(const struct kiln_published *p, struct kiln_tile_light *t,
                             const struct kiln_rank_data *data, const struct kiln_tile_run *run,
                             const struct kiln_halves *denoised)
{
    struct kiln_own_point own = kiln_own_of_global(&data->surface, run->first);
    size_t k = 0;
    kiln_tile_light_weigh(p, t, &data->surface, run);
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, own.at++, k++) {
        const int place = kiln_part_place((uint32_t)__builtin_ctzll(rest));
        if ((t->there >> place & 1u) == 0)
            continue;
        t->all[place] = (float)kiln_part_light(data, own.at);
        for (int i = 0; i < KILN_PARTS; i++)
            t->part[i][place] = data->parts[KILN_PARTS * own.at + (uint64_t)i];
        for (int h = 0; h < KILN_HALVES; h++)
            t->denoised[h][place] = denoised != NULL ? denoised[k].light[h] : 0.0f;
    }
}

/* The window of a texel lies within the tile, so that it has all its texels. */
static int window_first(int at)
{
    const int first = at - REACH, last = SIDE - 2 * REACH - 1;
    return first < 0 ? 0 : first > last ? last : first;
}

struct kiln_window kiln_window_of(const struct kiln_tile_light *t, int place)
{
    const int u = window_first(place % SIDE), v = window_first(place / SIDE);
    struct kiln_window w = {.light = 0.0};
    double count = 0.0;
    if (t->weight[place] == 0) /* it is not looked at */
        return w;
    for (int y = v; y <= v + 2 * REACH; y++)
        for (int x = u; x <= u + 2 * REACH; x++) {
            const int at = y * SIDE + x;
            if ((t->there >> at & 1u) == 0)
                continue;
            const double weight = t->weight[at];
            count += weight;
            w.light += weight * (double)t->all[at];
            for (int k = 0; k < KILN_PARTS; k++)
                w.part[k] += weight * (double)t->part[k][at];
            for (int h = 0; h < KILN_HALVES; h++)
                w.denoised[h] += weight * (double)t->denoised[h][at];
        }
    w.light /= count;
    for (int k = 0; k < KILN_PARTS; k++)
        w.part[k] /= count;
    for (int h = 0; h < KILN_HALVES; h++)
        w.denoised[h] /= count;
    return w;
}

double kiln_window_variance(const struct kiln_window *w)
{
    double mean = 0.0, square = 0.0;
    for (int k = 0; k < KILN_PARTS; k++)
        mean += w->part[k] / KILN_PARTS;
    for (int k = 0; k < KILN_PARTS; k++)
        square += (w->part[k] - mean) * (w->part[k] - mean);
    return square / (KILN_PARTS * (KILN_PARTS - 1));
}

double kiln_window_contrast(const struct kiln_window *w, int way)
{
    double sum = w->part[0];
    for (int k = 1; k < KILN_PARTS; k++)
        sum += k - 1 == way ? w->part[k] : -w->part[k];
    return sum / KILN_PARTS;
}

/* ---- numbers of texels by their error ---- */

size_t kiln_error_bin(double error)
{
    const double at = log(fmax(error, BIN_LEAST) / BIN_LEAST) / BIN_STEP;
    return at >= KILN_ERROR_BINS - 1 ? KILN_ERROR_BINS - 1 : (size_t)at;
}

static double middle_of(size_t bin) { return BIN_LEAST * exp(((double)bin + 0.5) * BIN_STEP); }

double kiln_error_number_above(const uint64_t numbers[KILN_ERROR_BINS], double scale, double least, double x)
{
    double above = 0.0;
    for (size_t b = 0; b < KILN_ERROR_BINS; b++)
        if (numbers[b] > 0)
            above += (double)numbers[b] * erfc(x / (sqrt(2.0) * fmax(scale * middle_of(b), least)));
    return above;
}

double kiln_error_number(const uint64_t numbers[KILN_ERROR_BINS])
{
    double all = 0.0;
    for (size_t b = 0; b < KILN_ERROR_BINS; b++)
        all += (double)numbers[b];
    return all;
}

double kiln_error_normal_quantile(const uint64_t numbers[KILN_ERROR_BINS])
{
    const double most = (1.0 - KILN_PUBLISHED_SHARE) * kiln_error_number(numbers);
    double low = 0.0, high = 4.0 * BIN_LEAST * exp(KILN_ERROR_BINS * BIN_STEP);
    for (int i = 0; i < 60; i++) {
        const double middle = 0.5 * (low + high);
        if (kiln_error_number_above(numbers, 1.0, 0.0, middle) > most)
            low = middle;
        else
            high = middle;
    }
    return high;
}

double kiln_error_quantile(const uint64_t numbers[KILN_ERROR_BINS])
{
    const double all = kiln_error_number(numbers);
    double below = 0.0;
    size_t b = 0;
    while (b < KILN_ERROR_BINS - 1 && below + (double)numbers[b] < KILN_PUBLISHED_SHARE * all)
        below += (double)numbers[b++];
    const double within = numbers[b] > 0 ? (KILN_PUBLISHED_SHARE * all - below) / (double)numbers[b] : 0.0;
    return all > 0.0 ? BIN_LEAST * exp(((double)b + within) * BIN_STEP) : 0.0;
}
