/* Filter for light of rough lobes in the pixels of a view (view_gloss.h): few rays each, without their noise.
 *
 * The light of a pixel is taken over what its lobes send on of light from all over, and averaged with that of pixels
 * around whose surface is much the same: three rounds over 5 x 5 pixels, 1, 2 and 4 apart, weighed by a bell in the
 * picture (Dammertz et al., "Edge-Avoiding A-Trous Wavelet Transform for fast Global Illumination Filtering", HPG
 * 2010), by normal (the closer the sharper the lobe), distance from the tangent plane, roughness, and by luminance over
 * the standard deviation there, which falls from round to round (Schied et al., "Spatiotemporal Variance-Guided
 * Filtering", HPG 2017). The deviation is what a pixel's rays say of their mean, averaged over such pixels around, for
 * few rays say little: what differs from pixel to pixel by more, such as highlights, is no noise. What mirrors and
 * smooth glass show is no grain, and stays as it is.
 *
 * Not collective. The same bits for any number of threads. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_GRAIN_H
#define KILN_COORDINATOR_VIEW_VIEW_GRAIN_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

/* A pixel some of whose rays meet rough lobes: the first ones on their way. */
struct kiln_view_grain {
    size_t pixel;                      /* row by row */
    float light[3];                    /* W/(m2 sr) of the pixel that come by them */
    float share[3];                    /* the same were light 1 from all over */
    struct kiln_vec3 normal, position; /* means over these rays; the normal on the side that is met, unit */
    float alpha;                       /* of the facets, mean */
    float variance; /* of the luminance of `light`, as a mean over rays; below 0: unknown, for there is one ray */
};

/* Replaces `light` by what is left without noise. The pixels are distinct ones of a picture of this size, and each
 * had so many rays. KILN_SYSTEM; the light is then as it was. */
int kiln_view_grain_smooth(struct kiln_view_grain *grains, size_t count, uint32_t width, uint32_t height, uint32_t rays,
                           struct kiln_error *error);

#endif
