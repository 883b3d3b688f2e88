/* Paths of pixels in scenes with gloss (shaders/path.glsl), which go from kernel to kernel; part of
 * shaders/shared/push.h. Slot k * count + x has path k of pixel x of the dispatch. */

/* A path that goes on in another kernel, at the surface that it has met; or has ended, then only what it has brought.
 */
struct kiln_gpu_path_state {
    KILN_VECTOR direction;
    KILN_WORD triangle; /* with KILN_GPU_BOTH_BACK: met from behind */
    KILN_REAL32 u, v, distance;
    KILN_REAL32 weight[3], seen[3], radiance[3];
    KILN_WORD surface, bounces, chain; /* number of the surface; diffuse events, surfaces since the last of them */
    KILN_WORD rays;
    KILN_WORD good; /* 0: the device has ended a loop early */
};
KILN_SIZE_IS(kiln_gpu_path_state, 84);

/* Addresses that a kernel goes by, one of several that run one after the other. */
struct kiln_gpu_path_turn {
    KILN_ADDRESS states;
    KILN_ADDRESS list, counter;     /* words: slots whose paths it follows, and how many; 0: all begin */
    KILN_ADDRESS onward, go_onward; /* the same of those that another is to follow; 0: it follows all to their ends */
};
KILN_SIZE_IS(kiln_gpu_path_turn, 40);
