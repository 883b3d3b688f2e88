/* Data of the guided pass on the device; of shaders/shared/layout.h. */
#ifndef KILN_SHADERS_LAYOUT_GUIDE_H
#define KILN_SHADERS_LAYOUT_GUIDE_H

/* Word of each point of a chunk on its tile run: the point's number in it; the number of its last; sides of its guide,
 * in eights of cells (0: it has none); and the number of the guide that it follows, counted from 1 in the chunk (0: the
 * cosine). */
#define KILN_GPU_GUIDE_LAST_SHIFT 6u
#define KILN_GPU_GUIDE_SIDE_SHIFT 12u
#define KILN_GPU_GUIDE_NUMBER_SHIFT 14u
#define KILN_GPU_GUIDE_PLACE_MASK 63u
#define KILN_GPU_GUIDE_BIAS 256
KILN_FUNCTION KILN_U32 kiln_gpu_guide_side(KILN_U32 word) { return (word >> KILN_GPU_GUIDE_SIDE_SHIFT & 3u) * 8u; }

/* Root of the data that a chunk of the guided pass has besides, in front of the words and guides. */
struct kiln_gpu_guided {
    KILN_ADDRESS near_probes; /* words: of each point of the block, which probes it sees; 0: nobody knows */
    KILN_ADDRESS words;       /* of each point of the chunk, as above */
    KILN_ADDRESS guides;      /* KILN_GUIDE_SIZE floats each (shaders/shared/guide.h) */
    /* Where the pass learns, else 0. Words: of ray k of point x at k * total + x, what it found and where
     * (kiln_gpu_guide_ray) */
    KILN_ADDRESS rays;
    KILN_ADDRESS squares; /* floats: of cell c of the rays of point x at c * total + x, */
    /* words: the squares of point x are over 2^(2 e), with e + KILN_GPU_GUIDE_BIAS here; KILN_GPU_NONE: the device
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
/* A luminance, its last eight bits given for a cell: its error is below 2^-15. */
uint kiln_gpu_guide_ray(float luminance, uint cell) { return (floatBitsToUint(luminance) & 0xffffff00u) | cell; }
float kiln_gpu_guide_luminance(uint ray) { return uintBitsToFloat(ray & 0xffffff00u); }
uint kiln_gpu_guide_cell(uint ray) { return ray & 0xffu; }
#endif

#endif
