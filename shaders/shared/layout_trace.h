/* Data for tracing on the device; part of shaders/shared/layout.h. worker/backend/vulkan/bvh.c makes the layouts, the
 * files of shaders/trace walk them.
 *
 * TRAVERSAL, a specialisation constant, selects one of these layouts. Hits do not depend on it: every layout applies
 * the same triangle test and gives the nearest triangle, of equally near ones that of the lowest number. */
#define KILN_TRAVERSAL_FOUR 0u
#define KILN_TRAVERSAL_EIGHT 1u /* compressed */
/* the device's own acceleration structure, in kernels compiled with KILN_PIPELINE */
#define KILN_TRAVERSAL_PIPELINE 2u

/* A triangle for tracing, 48 bytes; world numbers as in worker/scene/geometry.h. */
struct kiln_gpu_triangle {
    KILN_REAL32 a[3];
    KILN_WORD number; /* KILN_GPU_NONE: a placeholder that no ray hits, for a world without triangles */
    KILN_REAL32 b[3];
    KILN_WORD unused_b;
    KILN_REAL32 c[3];
    KILN_WORD unused_c;
};
KILN_SIZE_IS(kiln_gpu_triangle, 48);

/* A child of a node of four: the index of a node; or, with KILN_GPU_LEAF, a leaf's first triangle (29 bits)
 * and one less than their count (2 bits). KILN_GPU_NONE: nothing. */
#define KILN_GPU_LEAF 0x80000000u
#define KILN_GPU_LEAF_COUNT_SHIFT 29u
#define KILN_GPU_LEAF_FIRST 0x1fffffffu

/* Node with four children, 128 bytes. Each row of bounds has a value a child: lower x, upper x, lower y, ... upper z. A
 * missing child has a box whose lower bounds are above its upper ones. */
struct kiln_gpu_bvh4_node {
    KILN_REAL32 bounds[6][4];
    KILN_WORD child[4], unused[4];
};
KILN_SIZE_IS(kiln_gpu_bvh4_node, 128);

/* Compressed node with eight children, 80 bytes (Ylitie, Karras and Laine, "Efficient incoherent ray traversal on GPUs
 * through compressed wide BVHs", 2017, section 3). Bounds are stored in steps of 2^(exponent - 127) from `origin`.
 * `meta` of a child: 0 none; a node 1 << 5 | 24 + slot; a leaf its count in unary digits << 5 | place of its first
 * triangle after triangle_first. */
struct kiln_gpu_bvh8_node {
    KILN_REAL32 origin[3];
    KILN_WORD exponents_inner; /* exponents of x, y, z in a byte each; mask of the slots that are nodes */
    KILN_WORD node_first, triangle_first;
    KILN_WORD meta[2];      /* bytes */
    KILN_WORD bounds[6][2]; /* bytes: lower x, y, z, upper x, y, z */
};
KILN_SIZE_IS(kiln_gpu_bvh8_node, 80);

/* Stack entries of a thread in each layout (one more for the end); bvh.c builds trees that need no more. */
#define KILN_GPU_STACK4 124u
#define KILN_GPU_STACK8 44u

/* Boxes are enlarged by this share of the world's extent. This exceeds the errors of the triangle test (14 units of
 * 2^-24 of a coordinate and the origin's together) and of the box test (5), for origins within 2.5 extents of the
 * world's centre. */
#define KILN_GPU_BOX_MARGIN 3.814697265625e-6f /* 2^-18 */

struct kiln_gpu_hit { /* an answer of intersect.comp; struct kiln_hit */
    KILN_WORD triangle;
    KILN_REAL32 u, v, distance;
    KILN_WORD back;
    KILN_REAL32 tint[3];
};
KILN_SIZE_IS(kiln_gpu_hit, 32);

struct kiln_gpu_trace {
    KILN_ADDRESS nodes, triangles; /* a BVH for compute; multiples of 16 */
    KILN_ADDRESS top_level;        /* acceleration structure of the ray-tracing pipeline */
    KILN_WORD triangle_count;      /* of `triangles` */
    KILN_REAL32 extent;            /* largest absolute coordinate of the world, m */
};
KILN_SIZE_IS(kiln_gpu_trace, 32);
