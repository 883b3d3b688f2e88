/* Patches on the device (worker/pass/patches.h); part of shaders/shared/push.h. */

/* Parts of struct kiln_patch that a gathering point needs, and its albedo; its tile run among the own ones, and its
 * place in that. */
struct kiln_gpu_patch {
    KILN_VECTOR place, normal;
    KILN_WORD number;
    KILN_REAL32 albedo[3];
    KILN_WORD run, place_in_run;
};
KILN_SIZE_IS(kiln_gpu_patch, 48);

/* Parts of struct kiln_patch_node that tell whether it faces a point, which is asked of every pair; */
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
 * factors, and three numbers of pairs, of which a row has KILN_GPU_PAIRS_BASE - 1 at most: those that face each other
 * times KILN_GPU_PAIRS_BASE^2, of these those that were known times KILN_GPU_PAIRS_BASE, and those that were traced. */
#define KILN_GPU_PATCH_FLOATS 8u
#define KILN_GPU_PAIRS_BASE 128u
#define KILN_GPU_PAIRS_WORDS 3u /* of a point: traced, known, facing */

/* Means besides rays to find the sight of pairs: patches.comp's own constant. */
#define KILN_GPU_SIGHT_VOXELS 1u /* in the place of rays */
#define KILN_GPU_SIGHT_KEPT 2u   /* what is known is not asked again, and what is found is kept */

/* The grid (worker/scene/voxels.h), and what is kept (worker/backend/vulkan/visibility.h). `reals` are of the kernel's
 * `real`: the grid's corner, and cells a metre. */
struct kiln_gpu_sight {
    KILN_ADDRESS words, reals;
    KILN_ADDRESS runs; /* struct kiln_gpu_sight_run of each own tile run */
    KILN_WORD n[3];
    KILN_WORD groups; /* of 64 columns */
};
KILN_SIZE_IS(kiln_gpu_sight, 40);
#define KILN_GPU_GRID_REALS 4u

/* Stored sight of a tile run: words, in this order, with g groups and n points: known columns of each group (2 g),
 * columns that some pair is partly open in (2 g), where the tile pair's bits are (g), what its pairs were found to be
 * (g), and for each tile pair with bits those of its points (2 n). */
struct kiln_gpu_sight_run {
    KILN_ADDRESS words;                   /* 0: there is no room */
    KILN_WORD count, room, used;          /* points; tile pairs that may have bits, and that have some */
    KILN_WORD open, shut, mixed, unknown; /* tile pairs, as struct kiln_visibility_counts has them */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_sight_run, 40);

/* Where a tile pair's bits are, if it has none; else its number among those with bits. */
#define KILN_GPU_PAIRS_NONE 0xffffffffu    /* unknown */
#define KILN_GPU_PAIRS_NOTHING 0xfffffffeu /* no pair was asked for */
#define KILN_GPU_PAIRS_ALL_OPEN 0xfffffffdu
#define KILN_GPU_PAIRS_ALL_SHUT 0xfffffffcu
#define KILN_GPU_PAIRS_BITS 0xfffffffbu /* numbers are below */

/* States that pairs were found in, as enum kiln_pairs has them; KILN_GPU_PAIRS_NEW: in this step. */
#define KILN_GPU_PAIRS_OPEN 1u
#define KILN_GPU_PAIRS_SHUT 2u
#define KILN_GPU_PAIRS_PARTIAL 4u
#define KILN_GPU_PAIRS_NEW 8u

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
