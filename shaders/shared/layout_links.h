/* Links on the device (worker/pass/links.h); part of shaders/shared/push.h. */

/* Members of struct kiln_link_node that are needed to evaluate links. */
struct kiln_gpu_link_node {
    KILN_VECTOR centre, normal;
    KILN_REAL32 radius, height, bend, area, most_area;
    KILN_WORD first, count;
    KILN_REAL32 covariance[6];
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_link_node, 80);

/* Leaf: a point that sends light, in the tree's order. */
struct kiln_gpu_link_leaf {
    KILN_VECTOR centre, normal, edge_s, edge_t;
    KILN_REAL32 area;
};
KILN_SIZE_IS(kiln_gpu_link_leaf, 52);

/* Light that nodes send: struct kiln_link_sent. */
struct kiln_gpu_link_sent {
    KILN_REAL32 radiosity[3];
    KILN_REAL32 moment[9];
    KILN_REAL32 now, before, spread_now, spread_before;
};
KILN_SIZE_IS(kiln_gpu_link_sent, 64);

/* Light that leaf points send, in the tree's order; stored after that of the nodes. */
struct kiln_gpu_link_leaf_light {
    KILN_REAL32 radiosity[3];
    KILN_REAL32 now, before;
};
KILN_SIZE_IS(kiln_gpu_link_leaf_light, 20);

/* A point that gathers. */
struct kiln_gpu_linked_point {
    KILN_VECTOR place, normal;
    KILN_WORD number;
    KILN_WORD run_and_bit; /* its tile run in the chunk, and, in the last six bits, its bit in the tile */
};
KILN_SIZE_IS(kiln_gpu_linked_point, 32);

/* A tile run of a chunk: its range of links, and its range of links to single points through coloured surfaces. Masks
 * have a bit for each point of the tile, the lower half first. */
struct kiln_gpu_link_run {
    KILN_WORD first, count, tinted_first, tinted_count;
    KILN_WORD shares[2]; /* mask of the tile's points that send light */
    KILN_REAL32 texel;   /* m: the longest edge of a point */
    KILN_REAL32 sharing; /* kiln_links_shared */
};
KILN_SIZE_IS(kiln_gpu_link_run, 32);

struct kiln_gpu_link {
    KILN_WORD to, asked[2], seen[2];
};
KILN_SIZE_IS(kiln_gpu_link, 20);

struct kiln_gpu_tinted_link { /* struct kiln_tinted_link */
    KILN_WORD to, bit;
    KILN_REAL32 through[3];
};
KILN_SIZE_IS(kiln_gpu_tinted_link, 20);

/* A row is the links that one thread sums. Its result is 8 floats: incident, irradiance (3 each), sum of factors,
 * variance. */
#define KILN_GPU_LINKS_A_ROW 256u
#define KILN_GPU_LINK_FLOATS 8u

struct kiln_gpu_link_sums { /* of all rows */
    KILN_REAL32 incident[3], irradiance[3];
    KILN_REAL32 row; /* -1: the device has ended a loop early */
    KILN_REAL32 variance;
    KILN_REAL32 shading[3]; /* the point's shading normal */
};
KILN_SIZE_IS(kiln_gpu_link_sums, 44);

/* A ray between two points: `own` by its global index, with KILN_GPU_LINK_BACK if the ray ends there; `other` by its
 * place in the tree's order. */
#define KILN_GPU_LINK_BACK 0x80000000u
struct kiln_gpu_link_ray {
    KILN_WORD own, other;
};
KILN_SIZE_IS(kiln_gpu_link_ray, 8);

/* Where a point is. */
struct kiln_gpu_link_place {
    KILN_VECTOR at;
};
KILN_SIZE_IS(kiln_gpu_link_place, 12);
