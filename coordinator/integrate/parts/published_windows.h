/* Light of tile runs as an eye sees it, and numbers of texels by their error: internal to published.c and
 * published_denoised.c. Terms and formulas: published.h. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_PUBLISHED_WINDOWS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_PUBLISHED_WINDOWS_H

#include "coordinator/integrate/parts/published.h"

enum {
    KILN_WINDOW_WAYS = KILN_PARTS - 1, /* to halve the parts */
    KILN_WINDOW_TEXELS = 64,           /* of a tile */
    KILN_WINDOW_FULL = 255,            /* weight of a texel that is covered whole */
    KILN_ERROR_BINS = 512              /* of errors, by their logarithm */
};

/* A tile run's light at its places in the tile, row by row. */
struct kiln_tile_light {
    float part[KILN_PARTS][KILN_WINDOW_TEXELS];
    float all[KILN_WINDOW_TEXELS];
    float denoised[KILN_HALVES][KILN_WINDOW_TEXELS];
    uint32_t weight[KILN_WINDOW_TEXELS]; /* by coverage; 0: no lightmap shows it */
    uint64_t there;                      /* places with light */
};

/* Means over the texels around a texel. */
struct kiln_window {
    double light, part[KILN_PARTS], denoised[KILN_HALVES];
};

/* Sets the places with light, and their weights. */
void kiln_tile_light_weigh(const struct kiln_published *published, struct kiln_tile_light *tile,
                           const struct kiln_surface *surface, const struct kiln_tile_run *run);

/* `denoised`: of the points of the tile run; NULL: 0. */
void kiln_tile_light_lay_out(const struct kiln_published *published, struct kiln_tile_light *tile,
                             const struct kiln_rank_data *data, const struct kiln_tile_run *run,
                             const struct kiln_halves *denoised);

struct kiln_window kiln_window_of(const struct kiln_tile_light *tile, int place);

/* Variance of the mean of the parts. */
double kiln_window_variance(const struct kiln_window *window);

/* Half of what two halves of the parts differ by: as large as the error of their mean. `way`: which of the other parts
 * is with part 0. */
double kiln_window_contrast(const struct kiln_window *window, int way);

/* A twentieth of the mean luminance of the tile run's object. */
static inline double kiln_published_dark(const struct kiln_published *published, const struct kiln_rank_data *data,
                                         const struct kiln_tile_run *run)
{
    return published->dark[kiln_map_object(&data->surface, run->map)];
}

/* Mean over a tile run's points of the squared relative error of raw light; *weight: of them all. `contrasts`: counts
 * its texels by what halves of the parts differ by, in all ways; NULL: does not. */
double kiln_published_raw_square(const struct kiln_published *published, const struct kiln_tile_light *tile,
                                 double dark, uint32_t *weight, uint64_t *contrasts);

size_t kiln_error_bin(double error);
double kiln_error_number(const uint64_t numbers[KILN_ERROR_BINS]);
/* The error that KILN_PUBLISHED_SHARE of the texels stay below; and if errors of bins are standard errors. */
double kiln_error_quantile(const uint64_t numbers[KILN_ERROR_BINS]);
double kiln_error_normal_quantile(const uint64_t numbers[KILN_ERROR_BINS]);
/* Number of texels whose error is above x, if standard errors of bins are times `scale`, and `least` at least. */
double kiln_error_number_above(const uint64_t numbers[KILN_ERROR_BINS], double scale, double least, double x);

#endif
