/* Pixel paths in scenes with gloss (shaders/path.glsl), handed from kernel to kernel; part of shaders/shared/push.h.
 * Slot k * count + x has path k of pixel x of the dispatch. */

/* State of a path that another kernel continues, at the surface that it has hit. After its end only `radiance` is
 * valid. */
struct kiln_gpu_path_state {
    KILN_VECTOR direction;
    KILN_WORD triangle; /* with KILN_GPU_BOTH_BACK: met from behind */
    KILN_REAL32 u, v, distance;
    KILN_REAL32 weight[3], seen[3], radiance[3];
    KILN_WORD surface, bounces, chain; /* number of the surface; diffuse events; surfaces since the last one */
    KILN_WORD rays;
    KILN_WORD good; /* 0: the device has ended a loop early */
};
KILN_SIZE_IS(kiln_gpu_path_state, 84);

/* Work lists of a kernel, one of several that run one after the other. */
struct kiln_gpu_path_turn {
    KILN_ADDRESS states;
    KILN_ADDRESS list, counter;     /* words: slots whose paths it follows, and their number; 0: all paths begin */
    KILN_ADDRESS onward, go_onward; /* slots for the next kernel, and how many; 0: paths are traced to their ends */
};
KILN_SIZE_IS(kiln_gpu_path_turn, 40);
