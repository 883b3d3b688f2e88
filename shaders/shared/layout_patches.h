/* Patches on the device (worker/pass/patches.h); part of shaders/shared/push.h. */

/* Members of struct kiln_patch that a gathering point needs, with its albedo, its tile run among this rank's, and its
 * place in that run. */
struct kiln_gpu_patch {
    KILN_VECTOR place, normal;
    KILN_WORD number;
    KILN_REAL32 albedo[3];
    KILN_WORD run, place_in_run;
};
KILN_SIZE_IS(kiln_gpu_patch, 48);

/* Members of struct kiln_patch_node that decide whether a node faces a point: read for every pair. */
struct kiln_gpu_patch_node_facing {
    KILN_VECTOR centre;
    KILN_REAL32 area;
    KILN_VECTOR normal;
    KILN_WORD number;
};
KILN_SIZE_IS(kiln_gpu_patch_node_facing, 32);

/* Other members of struct kiln_patch_node, read only for nodes that face the point. */
struct kiln_gpu_patch_node_shape {
    KILN_VECTOR place, edge_s, edge_t;
    KILN_REAL32 radiosity[3];
};
KILN_SIZE_IS(kiln_gpu_patch_node_shape, 48);

/* A row is the nodes that one thread sums. Its result for a point is 8 floats: incident, irradiance (3 each), sum of
 * factors, and three counts of pairs packed in base KILN_GPU_PAIRS_BASE: facing pairs times base^2, known ones of these
 * times base, and traced ones. A row has at most KILN_GPU_PAIRS_BASE - 1 pairs. */
#define KILN_GPU_PATCH_FLOATS 8u
#define KILN_GPU_PAIRS_BASE 128u
#define KILN_GPU_PAIRS_WORDS 3u /* counts of a point: traced, known, facing */

/* Ways to find the visibility of pairs other than rays: bits of patches.comp's specialisation constant. */
#define KILN_GPU_SIGHT_VOXELS 1u /* voxels replace rays */
#define KILN_GPU_SIGHT_KEPT 2u   /* known visibility is reused, and new results are kept */

/* The voxel grid (worker/scene/voxels.h), and kept visibility (worker/backend/vulkan/visibility.h). `reals`, in the
 * kernel's `real`, are the grid's corner and cells a metre. */
struct kiln_gpu_sight {
    KILN_ADDRESS words, reals;
    KILN_ADDRESS runs; /* struct kiln_gpu_sight_run of each own tile run */
    KILN_WORD n[3];
    KILN_WORD groups; /* of 64 columns */
};
KILN_SIZE_IS(kiln_gpu_sight, 40);
#define KILN_GPU_GRID_REALS 4u

/* Kept visibility of a tile run: words, in this order, with g groups and n points: mask of known columns of each group
 * (2 g), mask of columns with a partly open pair (2 g), place of the tile pair's bits (g), states found (g), and for
 * each tile pair with bits the bits of its points (2 n). */
struct kiln_gpu_sight_run {
    KILN_ADDRESS words;                   /* 0: there is no room */
    KILN_WORD count, room, used;          /* points; tile pairs with bits: capacity, and number used */
    KILN_WORD open, shut, mixed, unknown; /* numbers of tile pairs, as in struct kiln_visibility_counts */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_sight_run, 40);

/* Place of a tile pair's bits: a number among those with bits, or one of these values. */
#define KILN_GPU_PAIRS_NONE 0xffffffffu    /* unknown */
#define KILN_GPU_PAIRS_NOTHING 0xfffffffeu /* no pair was requested */
#define KILN_GPU_PAIRS_ALL_OPEN 0xfffffffdu
#define KILN_GPU_PAIRS_ALL_SHUT 0xfffffffcu
#define KILN_GPU_PAIRS_BITS 0xfffffffbu /* numbers of tile pairs with bits are below this */

/* Visibility states of pairs, as in enum kiln_pairs; KILN_GPU_PAIRS_NEW: found in this step. */
#define KILN_GPU_PAIRS_OPEN 1u
#define KILN_GPU_PAIRS_SHUT 2u
#define KILN_GPU_PAIRS_PARTIAL 4u
#define KILN_GPU_PAIRS_NEW 8u

struct kiln_gpu_patch_sums { /* of all rows */
    KILN_REAL32 incident[3], irradiance[3];
    KILN_REAL32 row; /* -1: the device has ended a loop early */
};
KILN_SIZE_IS(kiln_gpu_patch_sums, 28);

/* Distribution by which a chunk's points choose rays to bright patches (worker/pass/directions.h). `sums`,
 * `cluster_power` and `power` are in the kernel's `real`. */
struct kiln_gpu_bright {
    KILN_ADDRESS clusters;      /* two words each: begin and end of its points in `members` */
    KILN_ADDRESS cluster_power; /* power of each cluster */
    KILN_ADDRESS members;       /* words: numbers of the clusters' points */
    KILN_ADDRESS cluster_of;    /* words: cluster of each point; KILN_GPU_NONE: none */
    KILN_ADDRESS power;         /* power of each point */
    KILN_ADDRESS patches;       /* struct kiln_gpu_bright_patch of each point */
    KILN_ADDRESS receiver_of;   /* words: receiver of each point of the chunk */
    KILN_ADDRESS receivers;     /* struct kiln_gpu_bright_receiver */
    KILN_ADDRESS sums;          /* rows of `count`: cumulative weights of the clusters */
    KILN_WORD count;            /* of clusters */
    KILN_REAL32 scale;          /* scale of all radiosity */
};
KILN_SIZE_IS(kiln_gpu_bright, 80);
KILN_OFFSET_IS(kiln_gpu_bright, count, 72);

struct kiln_gpu_bright_receiver {
    KILN_WORD by_cosine; /* number of its points' samples that are cosine-distributed */
    KILN_WORD row;       /* row of `sums`; unused if all samples are cosine-distributed */
};
KILN_SIZE_IS(kiln_gpu_bright_receiver, 8);

struct kiln_gpu_bright_patch {
    KILN_VECTOR place, edge_s, edge_t, normal;
};
KILN_SIZE_IS(kiln_gpu_bright_patch, 48);
