/* Additions to gather.glsl for guided directions. Samples of points whose tile run has a guide are warped by it. If the
 * pass learns, each ray stores the cell of its sample, and the luminance that it found over the root of its weight. */
#include "shaders/shared/guide.h"

KILN_ARRAY(GuidedRef, kiln_gpu_guided, 8);
KILN_ARRAY(GuideWords, uint, 4);

/* Addresses of the guide of the thread's point (0: cosine distribution) and of its rays' words (0: no learning); and
 * for these, the number of cells along a side. */
uint64_t guide_address, guide_rays;
uint guide_side;
/* of the ray: 1 / density, cell of the guide, weighted luminance that it found */
float guide_weight, guide_luminance;
uint guide_cell;

void guide_begin(uint x)
{
    const kiln_gpu_guided guided = GuidedRef(push.guided).at[0];
    const uint word = GuideWords(guided.words).at[x], number = word >> KILN_GPU_GUIDE_NUMBER_SHIFT;
    guide_side = kiln_gpu_guide_side(word);
    guide_address = number > 0u ? guided.guides + uint64_t(number - 1u) * (4u * KILN_GUIDE_SIZE) : 0ul;
    guide_rays = guide_side > 0u && guided.rays != 0ul ? guided.rays + uint64_t(x) * 4ul : 0ul;
    guide_luminance = 0.0;
}

void guide_direction(inout float u, inout float v)
{
    guide_weight = 1.0;
    guide_cell = uint(u * float(KILN_GUIDE_SIDE)) * KILN_GUIDE_SIDE + uint(v * float(KILN_GUIDE_SIDE));
    if (guide_address != 0ul)
        guide_weight = kiln_guide_warp(GuideRef(guide_address), u, v, guide_cell);
}

/* After sample k. */
void guide_keep(uint k)
{
    if (guide_rays == 0ul)
        return;
    GuideWords(guide_rays + uint64_t(k) * push.chunk.total * 4ul).at[0] =
        kiln_gpu_guide_ray(abs(guide_luminance) * inversesqrt(guide_weight), kiln_guide_coarse(guide_cell, guide_side));
    guide_luminance = 0.0;
}
