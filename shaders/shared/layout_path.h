/* Data of the path pass that C and GLSL share; part of shaders/shared/push.h. */

/* A world triangle, with the data that paths need at a hit. */
struct kiln_gpu_path_triangle {
    KILN_VECTOR p, e1, e2;                    /* corner 0, and the edges to corners 1 and 2 */
    KILN_VECTOR normal;                       /* geometric, unit */
    KILN_VECTOR shading0, shading1, shading2; /* shading normal of each corner, unit; only for smooth triangles */
    KILN_REAL32 offset;                       /* m: offset along the normal, on either side, at which rays start */
    KILN_WORD flags;
    KILN_REAL32 lift[3]; /* smooth triangles: struct kiln_lift of edges 0 1, 0 2, 1 2; below 0: of the back */
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
