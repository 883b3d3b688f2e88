/* The path pass: what C and GLSL share of its data; part of shaders/shared/push.h. */

/* A world triangle as paths meet it. */
struct kiln_gpu_path_triangle {
    KILN_VECTOR p, e1, e2;                    /* corner 0, and the edges to corners 1 and 2 */
    KILN_VECTOR normal;                       /* geometric, unit */
    KILN_VECTOR shading0, shading1, shading2; /* of each corner, unit; unused but for smooth ones */
    KILN_REAL32 offset;                       /* m along the normal, on either side, from which rays start */
    KILN_WORD flags;
    KILN_REAL32 lift[3]; /* of smooth ones: struct kiln_lift of edges 0 1, 0 2 and 1 2, below 0 where of the back */
};
KILN_SIZE_IS(kiln_gpu_path_triangle, 104);
#define KILN_GPU_PATH_SMOOTH 1u
#define KILN_GPU_PATH_HIDDEN 2u /* the camera does not see it */

/* Sums over a pixel's paths so far: radiance and squared luminance, each as the sum of two floats. */
struct kiln_gpu_path_sums {
    KILN_REAL32 high[4], low[4];
    KILN_WORD count; /* paths; KILN_GPU_PATH_STOPPED: the device ended a loop early, the answer is not good */
    KILN_WORD rays;
};
KILN_SIZE_IS(kiln_gpu_path_sums, 40);
#define KILN_GPU_PATH_STOPPED 0xffffffffu
