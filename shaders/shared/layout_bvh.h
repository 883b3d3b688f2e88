/* Building a BVH on the device; part of shaders/shared/push.h. worker/backend/vulkan/bvh_device.h says how. */

/* Nodes 0 .. count - 1 are the triangles along a curve, those that join two others follow in the order in which they
 * were made, the root last. */
struct kiln_gpu_bvh_node {
    KILN_REAL32 lower[3];
    KILN_WORD first; /* child; of a triangle its world number */
    KILN_REAL32 upper[3];
    KILN_WORD second; /* child; of a triangle KILN_GPU_NONE */
};
KILN_SIZE_IS(kiln_gpu_bvh_node, 32);

struct kiln_gpu_bvh_share { /* what is below a node */
    KILN_WORD triangles;    /* and KILN_GPU_LEAF where they are a leaf */
    /* what it costs least, by the surface area heuristic, as 1, at most 2, at most 3 children of a node of four; of
     * areas over the square of the world's extent */
    KILN_REAL32 cost[3];
};
KILN_SIZE_IS(kiln_gpu_bvh_share, 16);

struct kiln_gpu_bvh_state {
    KILN_WORD clusters, made; /* left to be joined; nodes made of two others */
};
KILN_SIZE_IS(kiln_gpu_bvh_state, 8);

/* A node of a layout to be filled. The children of one stand side by side in the list of all. */
struct kiln_gpu_bvh_task {
    KILN_WORD node;     /* of the tree */
    KILN_WORD triangle; /* place of the first below it */
    KILN_WORD child;    /* the first that is a node of the layout, in this list */
    KILN_WORD place;    /* in the layout */
    KILN_WORD below;    /* nodes of the layout below it */
    KILN_WORD free;     /* place of the first of these */
};
KILN_SIZE_IS(kiln_gpu_bvh_task, 24);

struct kiln_gpu_bvh {
    KILN_ADDRESS vertices, indices;
    KILN_ADDRESS keys[2];           /* 64-bit words: places along a curve through the world, before and after a pass */
    KILN_ADDRESS values[2];         /* words: world numbers of these triangles */
    KILN_ADDRESS histogram;         /* words: of digit d in group g at d * groups + g */
    KILN_ADDRESS sums;              /* words: one a group of threads */
    KILN_ADDRESS nodes;             /* struct kiln_gpu_bvh_node */
    KILN_ADDRESS shares;            /* struct kiln_gpu_bvh_share of each */
    KILN_ADDRESS clusters[2];       /* words: nodes that are left, before and after a round */
    KILN_ADDRESS nearest;           /* words: of each of these the place of the one to join */
    KILN_ADDRESS left, left_shares; /* nodes that the host joins, and what is below each */
    KILN_ADDRESS states; /* struct kiln_gpu_bvh_state: before and after; then a word, the children of a level */
    KILN_ADDRESS tasks;  /* struct kiln_gpu_bvh_task, level by level */
    KILN_ADDRESS layout_nodes, layout_triangles;
    KILN_REAL32 origin[3], steps; /* of the curve: where it begins, steps a metre */
    KILN_REAL32 margin;           /* of boxes, m */
    KILN_REAL32 inverse_extent;   /* 1/m */
    KILN_WORD count;              /* triangles that rays can hit */
    KILN_WORD before, skipped;    /* from the triangle `before` on, world numbers are higher by `skipped` */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_bvh, 192);

/* bvh_sort.comp, bvh_cluster.comp, bvh_layout.comp. */
struct kiln_gpu_bvh_push {
    KILN_ADDRESS bvh; /* struct kiln_gpu_bvh */
    KILN_WORD stage;
    KILN_WORD count; /* of what the stage takes: triangles, words to add up, tasks */
    KILN_WORD from;  /* which of two arrays is before: 0 or 1 */
    KILN_WORD shift; /* of a digit */
    KILN_WORD first; /* task of thread 0; the first child's is `next` */
    KILN_WORD next;
    KILN_WORD radius;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_bvh_push, 40);

#define KILN_BVH_SORTED 1024u /* keys that a group of threads takes, */
#define KILN_BVH_ADDED 512u   /* words or clusters */
#define KILN_BVH_DIGIT_BITS 4u
#define KILN_BVH_DIGITS 16u
#define KILN_BVH_RADIUS 32u /* at most */
#define KILN_BVH_TOP 32768u /* clusters at most that the host joins */
#define KILN_BVH_LEAF 3u    /* triangles at most */

#define KILN_BVH_CODE 0u   /* bvh_sort.comp: places along the curve, */
#define KILN_BVH_COUNT 1u  /* how often each digit is there, */
#define KILN_BVH_ADD 2u    /* the words before each: of groups, */
#define KILN_BVH_RISE 3u   /* of what groups have, */
#define KILN_BVH_FILL 4u   /* of each word, */
#define KILN_BVH_PLACE 5u  /* keys by their digits, */
#define KILN_BVH_LEAVES 6u /* and the first nodes */

#define KILN_BVH_NEAREST 0u /* bvh_cluster.comp: the nearest of each cluster, */
#define KILN_BVH_PAIR 1u    /* or its neighbour; */
#define KILN_BVH_GONE 2u    /* how many go, of groups, */
#define KILN_BVH_LEFT 3u    /* what is left, */
#define KILN_BVH_JOIN 4u
#define KILN_BVH_GIVE 5u /* and that, for the host */

#define KILN_BVH_OPEN 0u   /* bvh_layout.comp: how many children are nodes, of groups, */
#define KILN_BVH_LEVEL 1u  /* of all, */
#define KILN_BVH_NEXT 2u   /* the tasks of the next level; */
#define KILN_BVH_BELOW 3u  /* from the last level up: nodes below each, */
#define KILN_BVH_SETTLE 4u /* from the first level down: their places, */
#define KILN_BVH_WRITE 5u  /* and the layout */
