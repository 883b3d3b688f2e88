/* Error metrics between two lightmaps. Nothing here is collective.
 *
 * a is the tested image, b the reference. Sums run over the set T of texels that are valid in both images (validity.Y =
 * 1 if an image has that channel, else all texels) and finite in both, and over the set C of compared channels. N =
 * |T|, M = |C|.
 *
 * - rmse: sqrt(1/(N M) sum (a - b)^2).
 *
 * - nrmse: rmse over the texels wholly inside charts (coverage.Y = 1 in each image that has that channel), divided by
 * the mean of b over these texels and C; NaN unless that mean is above 0.
 *
 * - rel_rmse: sqrt(1/(N M) sum ((a - b) / (|b| + 0.01 m))^2), where m is the mean of |b| over T and C.
 *
 * - psnr: 20 log10(p / rmse) in dB, where p is the largest |b| over T and C; infinite if rmse is 0.
 *
 * - dssim: (1 - s) / 2, where s is the mean over T of the structural similarity (Wang et al. 2004) of tone-mapped
 *   luminance, in an 11 x 11 Gaussian window of sigma 1.5 texels that is cut to T and renormalised, with K1 = 0.01,
 *   K2 = 0.03 and range 1. The tone mapping is t = e L / (1 + e L), with Rec. 709 luminance L and, for both images,
 *   e = 0.18 / exp(mean of ln L_b over the texels of T where L_b > 0), or 1 if there is no such texel.
 *
 * - picture_psnr, picture_dissimilarity: PSNR and dissimilarity of tone-mapped 8-bit pictures of both images: sRGB
 *   codes k = round(255 srgb(e c / (1 + e L))), c in R, G, B, with L and e as above; one grey without R, G, B.
 *   picture_psnr is 20 log10(255 / rmse of k) in dB; picture_dissimilarity is 1 / s - 1, where s is the structural
 *   similarity of the luminance of k / 255. Rodrigues (2021) and Sun (2020) use these metrics for views.
 *
 * - dfpr: "deviation from pure radiosity" (Kahl 2023, equation 6.1): 1/N sum over T of the Euclidean length of (a - b)
 *   over C.
 *
 * - dfpr_unit: dfpr with both images divided by the largest value of b. Kahl's threshold of 0.025 applies to it.
 *
 * - dfpr_8bit: dfpr as Kahl's own tool computes it: the mean over all pixels of the images, valid or not, of the
 *   Euclidean length over C of the difference of k / 255, with 8-bit codes k = round(255 min(max(v / l, 0), 1)). l is
 *   the largest value of b over T and C, or 1 if that is not above 0, since Kahl saves lightmaps with the brightest
 *   light at 1. His scenes have one lightmap; with several, l is the largest value of all (kiln_compare_codes). A value
 *   that is not finite has code 0.
 *
 * - worst: the texel of T with the greatest length of (a - b) over C, the first in row order among equals. */
#ifndef KILN_COORDINATOR_VIEW_COMPARE_H
#define KILN_COORDINATOR_VIEW_COMPARE_H

#include "coordinator/output/image.h"

enum { KILN_COMPARE_CHANNELS_MAX = 16 };

struct kiln_channel_difference {
    char name[KILN_CHANNEL_NAME_SIZE];
    double rmse, mean_difference, mean;     /* root mean square and mean of a - b; mean of b */
    double squares, differences, reference; /* sums over T of (a - b)^2, a - b, b */
};

struct kiln_difference {
    /* |T|; texels of T wholly inside charts; texels left out because a value is NaN or infinite */
    uint64_t texels, interior, not_finite;
    bool identical; /* same size, same channels, and all values have the same bits, margins included */
    double rmse, nrmse, rel_rmse, psnr, dssim, picture_psnr, picture_dissimilarity, dfpr, dfpr_unit, dfpr_8bit, mean;
    double worst; /* W/m2 */
    uint32_t worst_x, worst_y;
    uint32_t channel_count;
    struct kiln_channel_difference channels[KILN_COMPARE_CHANNELS_MAX];
    double weight;                    /* of each texel when it is added to a set: 1, or the area of a sample point */
    double measure, interior_measure; /* sums of weights, by which the sums below are divided */
    /* terms of the metrics: sums over T, or over the texels wholly inside charts */
    double squares, interior_squares, interior_reference, relative_squares, lengths, similarity, picture_similarity,
        picture_squares, reference, peak, largest;
    double pixels, code_lengths; /* all pixels, and the sum over them of the lengths of dfpr_8bit */
};

/* Compares R, G, B if both images have them, else all common channels except validity.Y and coverage.Y. KILN_BAD_INPUT
 * if the sizes differ or there is no common channel. If T is empty, all metrics are 0 and psnr is infinite. */
int kiln_compare_images(const struct kiln_image *a, const struct kiln_image *b, struct kiln_difference *difference,
                        struct kiln_error *error);

/* Adds the difference of one image to that of a set of images with the same channels. Initialise the set with zeros,
 * and identical = true. Each metric of the set is over all texels of all images, weighted by one->weight. m of rel_rmse
 * and e of dssim stay those of each image; so does l of dfpr_8bit, until kiln_compare_codes. */
void kiln_difference_add(struct kiln_difference *set, const struct kiln_difference *one);

/* Recomputes dfpr_8bit of a compared image with l = `largest`, the value of the whole set; the set must then be summed
 * again. Statuses of kiln_compare_images. */
int kiln_compare_codes(const struct kiln_image *a, const struct kiln_image *b, double largest,
                       struct kiln_difference *difference, struct kiln_error *error);

/* Draws the difference as 8-bit RGB, 3 x width x height bytes at `bytes`. It shows the length of (a - b) relative to
 * the mean of the reference, from black (0) through blue, red and yellow to white (`full` or more). Texels that are not
 * compared are grey. */
int kiln_difference_picture(const struct kiln_image *a, const struct kiln_image *b, double full, uint8_t *bytes,
                            struct kiln_error *error);

#endif
