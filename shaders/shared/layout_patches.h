/* Patches on the device (worker/pass/patches.h); part of shaders/shared/push.h. */

/* Of struct kiln_patch what a point needs that gathers, and its albedo. */
struct kiln_gpu_patch {
    KILN_VECTOR place, normal;
    KILN_WORD number;
    KILN_REAL32 albedo[3];
};
KILN_SIZE_IS(kiln_gpu_patch, 40);

/* Of struct kiln_patch_node what says whether it faces a point, which is asked of every pair; */
struct kiln_gpu_node_facing {
    KILN_VECTOR centre;
    KILN_REAL32 area;
    KILN_VECTOR normal;
    KILN_WORD number;
};
KILN_SIZE_IS(kiln_gpu_node_facing, 32);

/* and the rest. */
struct kiln_gpu_node_shape {
    KILN_VECTOR place, edge_s, edge_t;
    KILN_REAL32 radiosity[3];
};
KILN_SIZE_IS(kiln_gpu_node_shape, 48);

/* Nodes lie in rows, one a thread; a row of a point has so many floats: incident, irradiance (3 each), the sum of its
 * factors, and how many pairs face each other. */
#define KILN_GPU_PATCH_FLOATS 8u

struct kiln_gpu_patch_sums { /* of all rows */
    KILN_REAL32 incident[3], irradiance[3];
    KILN_REAL32 row; /* -1: the device has ended a loop early */
};
KILN_SIZE_IS(kiln_gpu_patch_sums, 28);
