/* Light data in the device's `real`: included once by GLSL, and by C once for float and once for double, with
 * KILN_STORED_REAL and KILN_STORED_NAME set (see worker/backend/vulkan/lights.c). In each struct the reals come first
 * and 32-bit words follow, so that one loop narrows any of them. */

struct KILN_STORED_NAME(kiln_gpu_light_node) { /* struct kiln_light_node, made ready */
    KILN_STORED_REAL centre[3];
    KILN_STORED_REAL radius, floor2; /* half the diagonal of the box, and radius^2 / 4 */
    KILN_STORED_REAL axis[3];
    KILN_STORED_REAL cos_o, sin_o, cos_e, power;
    KILN_WORD left, right; /* children; of a leaf left == KILN_GPU_NONE and right = the light */
    KILN_WORD flags, reserved;
};

struct KILN_STORED_NAME(kiln_gpu_area_light) { /* struct kiln_area_light */
    KILN_STORED_REAL p0[3], e1[3], e2[3], normal[3];
    KILN_STORED_REAL area, rounding;
    KILN_REAL32 radiance[3];
    KILN_WORD triangle, flags;
    KILN_REAL32 at[6]; /* barycentric weights of the world triangle's corners 1 and 2 at this light's corners */
    KILN_WORD path, depth, turn;
};

struct KILN_STORED_NAME(kiln_gpu_point_light) { /* struct kiln_point_light */
    KILN_STORED_REAL position[3], direction[3];
    KILN_STORED_REAL range, cos_inner, cos_outer;
    KILN_REAL32 intensity[3];
    KILN_WORD flags;
};

struct KILN_STORED_NAME(kiln_gpu_directional_light) { /* struct kiln_directional_light */
    KILN_STORED_REAL towards[3];
    KILN_REAL32 irradiance[3];
    KILN_WORD reserved;
};

struct KILN_STORED_NAME(kiln_gpu_direct_sums) { /* sums of one row of a point's samples; only the device writes them */
    KILN_STORED_REAL incident[3], irradiance[3];
    KILN_STORED_REAL variance; /* variance of the choices that are not in `luminances` */
    KILN_WORD rays;
    KILN_WORD stopped; /* 1: the device ended a loop early */
};
