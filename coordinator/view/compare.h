/* How far one lightmap is from another. Nothing here is collective.
 *
 * a is the tested image, b the reference; sums run over the texels T that are valid in both (channel validity.Y = 1
 * where an image has it, else every texel) and finite in both, and over the channels C compared. N = |T|, M = |C|.
 *
 *     rmse      sqrt(1/(N M) sum (a - b)^2)
 *     nrmse     the same over the texels wholly inside charts only (coverage.Y = 1 in both, where there is that
 * channel), divided by the mean of b over these texels and C; NaN when that mean is not above 0 rel_rmse  sqrt(1/(N M)
 * sum ((a - b) / (|b| + 0.01 m))^2), m = mean of |b| over T and C psnr      20 log10(p / rmse) in dB, p = largest |b|
 * over T and C; infinite for rmse 0 dssim     (1 - s) / 2, s = mean over T of the structural similarity (Wang et al.
 * 2004) of tone-mapped luminance, in an 11 x 11 Gaussian window of sigma 1.5 texels cut to T and renormalised, with K1
 * = 0.01, K2 = 0.03, range 1. Tone-mapped: t = e L / (1 + e L), L Rec. 709 luminance, e = 0.18 / exp(mean of ln L_b
 * over T where L_b > 0), the same e for both; 1 when there is no such texel dfpr      "deviation from pure radiosity"
 * (Kahl 2023, equation 6.1): 1/N sum over T of the Euclidean length of (a - b) over C dfpr_unit the same with both
 * divided by the largest value of b: what his threshold of 0.025 is for worst     the texel of T with the greatest
 * length of (a - b) over C, the first in row order among equals */
#ifndef KILN_COORDINATOR_VIEW_COMPARE_H
#define KILN_COORDINATOR_VIEW_COMPARE_H

#include "coordinator/output/image.h"

enum { KILN_COMPARE_CHANNELS_MAX = 16 };

struct kiln_channel_difference {
    char name[KILN_CHANNEL_NAME_SIZE];
    double rmse, mean_difference, mean;     /* of a - b; mean of b */
    double squares, differences, reference; /* sums over T */
};

struct kiln_difference {
    /* |T|; of them wholly inside charts; left out because a value is NaN or infinite */
    uint64_t texels, interior, not_finite;
    bool identical; /* same size, same channels, every channel's every value the same bits, margins too */
    double rmse, nrmse, rel_rmse, psnr, dssim, dfpr, dfpr_unit, mean;
    double worst; /* W/m2 */
    uint32_t worst_x, worst_y;
    uint32_t channel_count;
    struct kiln_channel_difference channels[KILN_COMPARE_CHANNELS_MAX];
    double weight;                    /* of each texel when it is added to a set: 1, or what area a sample stands for */
    double measure, interior_measure; /* sums of weights: what the sums below are divided by */
    /* what the metrics are made of: sums over T, or over its interior */
    double squares, interior_squares, interior_reference, relative_squares, lengths, similarity, reference, peak,
        largest;
};

/* Compares R, G, B when both have them, else all channels they share but validity.Y and coverage.Y. KILN_BAD_INPUT when
 * sizes differ or no channel is shared. Without a texel in T all metrics are 0 and psnr is infinite. */
int kiln_compare_images(const struct kiln_image *a, const struct kiln_image *b, struct kiln_difference *difference,
                        struct kiln_error *error);

/* Adds one image's difference to that of a set (zero-initialise it, but for identical = true) with the same channels:
 * each metric is then over all texels of all images, each weighing one->weight, with m and e of rel_rmse and dssim each
 * image's own. */
void kiln_difference_add(struct kiln_difference *set, const struct kiln_difference *one);

/* A picture of the difference for people: 8-bit RGB, 3 x width x height bytes into `bytes`. The length of (a - b) over
 * the reference's mean, from black (none) through blue, red and yellow to white (`full` and more); grey where nothing
 * is compared. */
int kiln_difference_picture(const struct kiln_image *a, const struct kiln_image *b, double full, uint8_t *bytes,
                            struct kiln_error *error);

#endif
