/* The loss by the size of the texels: light between texels, which no number of samples brings back.
 *
 * A lightmap of twice the texel size is made of the denoised light: the means of 2 x 2 whole texels, with values
 * between them as a renderer interpolates (bilinearly). What it is off at the finer texels, over the light there or a
 * twentieth of its object's mean, is what texels of that size lose. Halving a texel's size at least halves this: to a
 * quarter where light is smooth, and to half as many texels at the edges of shadows. So the bake's own texels lose
 * about half of that against texels of half their size, a quarter against the next, and in all as much as the coarse
 * ones lose against them. The loss of a bake is what 95 % of the texels stay below.
 *
 * The product of what two independent halves are off has no noise in the mean. */
#ifndef KILN_COORDINATOR_INTEGRATE_PARTS_TEXEL_LOSS_H
#define KILN_COORDINATOR_INTEGRATE_PARTS_TEXEL_LOSS_H

#include <stdint.h>

enum { KILN_LOSS_TEXELS = 64, KILN_LOSS_BINS = 256 };

/* Numbers of texels, by the logarithm of their loss. Zero at first; numbers of several ranks add up. */
struct kiln_texel_losses {
    uint64_t numbers[KILN_LOSS_BINS];
};

/* Adds the texels of a tile, row by row. `a`, `b`: light that two halves found, denoised. `whole`: bits of texels that
 * are covered whole. `dark`: a twentieth of the object's mean. */
void kiln_texel_losses_add(struct kiln_texel_losses *losses, const float a[KILN_LOSS_TEXELS],
                           const float b[KILN_LOSS_TEXELS], uint64_t whole, double dark);

/* The relative loss that 95 % of the texels stay below; 0: none is seen. */
double kiln_texel_losses_most(const struct kiln_texel_losses *losses);

#endif
