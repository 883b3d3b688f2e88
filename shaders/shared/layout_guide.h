/* Data of the guided pass on the device; of shaders/shared/layout.h. */
#ifndef KILN_SHADERS_LAYOUT_GUIDE_H
#define KILN_SHADERS_LAYOUT_GUIDE_H

/* Word of a point of a chunk, from its lowest bits on: the point's number in its tile run; the number of the run's last
 * point; the side of its guide in units of 8 cells (0: no guide); and the number, from 1 in the chunk, of the guide
 * that its rays follow (0: cosine sampling). */
#define KILN_GPU_GUIDE_LAST_SHIFT 6u
#define KILN_GPU_GUIDE_SIDE_SHIFT 12u
#define KILN_GPU_GUIDE_NUMBER_SHIFT 14u
#define KILN_GPU_GUIDE_PLACE_MASK 63u
#define KILN_GPU_GUIDE_BIAS 256
KILN_FUNCTION KILN_U32 kiln_gpu_guide_side(KILN_U32 word) { return (word >> KILN_GPU_GUIDE_SIDE_SHIFT & 3u) * 8u; }

/* Data of a chunk in the guided pass only, in front of the words and guides. */
struct kiln_gpu_guided {
    KILN_ADDRESS near_probes; /* words: probes that each point of the block sees; 0: unknown */
    KILN_ADDRESS words;       /* of each point of the chunk, as above */
    KILN_ADDRESS guides;      /* KILN_GUIDE_SIZE floats each (shaders/shared/guide.h) */
    /* Words, if the pass learns, else 0: luminance and cell found by ray k of point x, at k * total + x
     * (kiln_gpu_guide_ray) */
    KILN_ADDRESS rays;
    KILN_ADDRESS squares; /* floats: sum of squares in cell c of point x, at c * total + x */
    /* words: e + KILN_GPU_GUIDE_BIAS, where the squares of point x are divided by 2^(2 e); KILN_GPU_NONE: the device
     * ended its loops early */
    KILN_ADDRESS exponents;
};
KILN_SIZE_IS(kiln_gpu_guided, 48);

struct kiln_gpu_guided_result { /* struct kiln_guided_result */
    KILN_STRUCT kiln_gpu_result point;
    KILN_REAL32 learnt[4];
};
KILN_SIZE_IS(kiln_gpu_guided_result, 84);

#ifdef KILN_GLSL
/* Packs a luminance and a cell in a word: the cell replaces the last eight bits. The luminance is off by less than
 * 2^-15. */
uint kiln_gpu_guide_ray(float luminance, uint cell) { return (floatBitsToUint(luminance) & 0xffffff00u) | cell; }
float kiln_gpu_guide_luminance(uint ray) { return uintBitsToFloat(ray & 0xffffff00u); }
uint kiln_gpu_guide_cell(uint ray) { return ray & 0xffu; }
#endif

#endif
