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

/* Rays to bright patches (worker/pass/directions.h): what the points of a chunk choose by. `sums`, `cluster_power` and
 * `power` are of the kernel's `real`. */
struct kiln_gpu_bright {
    KILN_ADDRESS clusters;      /* two words each: its first point among the members, and their end */
    KILN_ADDRESS cluster_power; /* of each */
    KILN_ADDRESS members;       /* words: numbers of points */
    KILN_ADDRESS cluster_of;    /* word of each point; KILN_GPU_NONE: of none */
    KILN_ADDRESS power;         /* of each point */
    KILN_ADDRESS patches;       /* struct kiln_gpu_bright_patch of each point */
    KILN_ADDRESS receiver_of;   /* word of each point of the chunk */
    KILN_ADDRESS receivers;     /* struct kiln_gpu_bright_receiver */
    KILN_ADDRESS sums;          /* rows of `count`: of the clusters' weights up to each */
    KILN_WORD count;            /* of clusters */
    KILN_REAL32 scale;          /* of all radiosity */
};
KILN_SIZE_IS(kiln_gpu_bright, 80);
KILN_OFFSET_IS(kiln_gpu_bright, count, 72);

struct kiln_gpu_bright_receiver {
    KILN_WORD by_cosine; /* of its points' samples */
    KILN_WORD row;       /* of `sums`; any, where all samples are by the cosine */
};
KILN_SIZE_IS(kiln_gpu_bright_receiver, 8);

struct kiln_gpu_bright_patch {
    KILN_VECTOR place, edge_s, edge_t, normal;
};
KILN_SIZE_IS(kiln_gpu_bright_patch, 48);
