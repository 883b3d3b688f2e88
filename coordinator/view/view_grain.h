/* Denoiser for the light by rough lobes in a view (view_gloss.h), which few rays per pixel sample.
 *
 * The light of a pixel is divided by the albedo of its lobes and averaged with that of neighbours on a similar surface:
 * an a-trous filter of three rounds over 5 x 5 pixels, spaced by 1, 2 and 4, with a bell-shaped kernel (Dammertz et
 * al., "Edge-Avoiding A-Trous Wavelet Transform for fast Global Illumination Filtering", HPG 2010). Weights fall with
 * the differences of normals (faster for sharper lobes), the distance from the tangent plane, the difference of
 * roughness, and the difference of luminance over the standard deviation, which falls from round to round (Schied et
 * al., "Spatiotemporal Variance-Guided Filtering", HPG 2017). The deviation is that of a pixel's mean over its rays,
 * averaged over similar neighbours, since few rays give a poor estimate. Larger differences, such as highlights, are
 * not noise and are kept. Light via mirrors and smooth glass is not filtered.
 *
 * Not collective. The same bits for any number of threads. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_GRAIN_H
#define KILN_COORDINATOR_VIEW_VIEW_GRAIN_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

/* A pixel with rays that meet rough lobes; data of the first rough surface on each ray. */
struct kiln_view_grain {
    size_t pixel;                      /* row by row */
    float light[3];                    /* radiance of the pixel by these lobes, W/(m2 sr) */
    float share[3];                    /* albedo of the lobes: `light` if radiance 1 came from all directions */
    struct kiln_vec3 normal, position; /* means over these rays; unit normal of the side that is hit */
    float alpha;                       /* mean roughness of the microfacets */
    float variance; /* variance of the luminance of `light`, a mean over rays; below 0: unknown, as there is one ray */
};

/* Denoises `light` of distinct pixels in a picture of width x height, each drawn with `rays` rays. KILN_SYSTEM; the
 * light is then unchanged. */
int kiln_view_grain_smooth(struct kiln_view_grain *grains, size_t count, uint32_t width, uint32_t height, uint32_t rays,
                           struct kiln_error *error);

#endif
