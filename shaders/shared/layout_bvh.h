/* Building a BVH on the device; part of shaders/shared/push.h. worker/backend/vulkan/bvh_device.h says how. */

/* Node of the binary tree. Nodes 0 .. count - 1 are the triangles in curve order; inner nodes follow in the order in
 * which they were made, the root last. */
struct kiln_gpu_bvh_node {
    KILN_REAL32 lower[3];
    KILN_WORD first; /* child; of a triangle its world number */
    KILN_REAL32 upper[3];
    KILN_WORD second; /* child; of a triangle KILN_GPU_NONE */
};
KILN_SIZE_IS(kiln_gpu_bvh_node, 32);

struct kiln_gpu_bvh_subtree { /* statistics of a node's subtree */
    KILN_WORD triangles;      /* number of them; with KILN_GPU_LEAF if they become one leaf */
    /* least cost, by the surface area heuristic, of the subtree as 1, at most 2 or at most 3 children of a 4-wide node;
     * areas are relative to the square of the world's extent */
    KILN_REAL32 cost[3];
};
KILN_SIZE_IS(kiln_gpu_bvh_subtree, 16);

struct kiln_gpu_bvh_state {
    KILN_WORD clusters, made; /* clusters not yet merged; inner nodes made so far */
};
KILN_SIZE_IS(kiln_gpu_bvh_state, 8);

/* Task: a node of the wide layout to write. A node's children stand side by side in the list of tasks. */
struct kiln_gpu_bvh_task {
    KILN_WORD node;     /* node of the binary tree */
    KILN_WORD triangle; /* place in the layout of the first triangle below the node */
    KILN_WORD child;    /* index, in the list of tasks, of the first child that is a layout node */
    KILN_WORD place;    /* in the layout */
    KILN_WORD below;    /* number of layout nodes below this one */
    KILN_WORD free;     /* place in the layout of the first node below this one */
};
KILN_SIZE_IS(kiln_gpu_bvh_task, 24);

struct kiln_gpu_bvh {
    KILN_ADDRESS vertices, indices;
    KILN_ADDRESS keys[2];             /* 64-bit words: positions on the curve, before and after a sorting pass */
    KILN_ADDRESS values[2];           /* words: world numbers of the sorted triangles */
    KILN_ADDRESS histogram;           /* words: count of digit d in group g at d * groups + g */
    KILN_ADDRESS sums;                /* words: partial sum of each group of threads */
    KILN_ADDRESS nodes;               /* struct kiln_gpu_bvh_node */
    KILN_ADDRESS subtrees;            /* struct kiln_gpu_bvh_subtree of each */
    KILN_ADDRESS clusters[2];         /* words: unmerged clusters, before and after a round */
    KILN_ADDRESS nearest;             /* words: for each cluster the place of the one to merge with */
    KILN_ADDRESS left, left_subtrees; /* nodes that the host merges, and the share of each */
    KILN_ADDRESS states; /* struct kiln_gpu_bvh_state before and after a round; then a word, children of a level */
    KILN_ADDRESS tasks;  /* struct kiln_gpu_bvh_task, level by level */
    KILN_ADDRESS layout_nodes, layout_triangles;
    KILN_REAL32 origin[3], steps; /* space-filling curve: its origin, steps a metre */
    KILN_REAL32 margin;           /* margin added to boxes, m */
    KILN_REAL32 inverse_extent;   /* 1/m */
    KILN_WORD count;              /* triangles that rays can hit */
    KILN_WORD before, skipped;    /* triangles from `before` on have world numbers higher by `skipped` */
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_bvh, 192);

/* bvh_sort.comp, bvh_cluster.comp, bvh_layout.comp. */
struct kiln_gpu_bvh_push {
    KILN_ADDRESS bvh; /* struct kiln_gpu_bvh */
    KILN_WORD stage;
    KILN_WORD count; /* items of the stage: triangles, words to add up, or tasks */
    KILN_WORD from;  /* index of the input of two arrays: 0 or 1 */
    KILN_WORD shift; /* lowest bit of the digit to sort by */
    KILN_WORD first; /* task of thread 0; `next`: task of its first child */
    KILN_WORD next;
    KILN_WORD radius;
    KILN_WORD reserved;
};
KILN_SIZE_IS(kiln_gpu_bvh_push, 40);

#define KILN_BVH_SORTED 1024u /* keys a group of threads */
#define KILN_BVH_ADDED 512u   /* words or clusters a group of threads */
#define KILN_BVH_DIGIT_BITS 4u
#define KILN_BVH_DIGITS 16u
#define KILN_BVH_RADIUS 32u /* maximum search radius for the nearest cluster */
#define KILN_BVH_TOP 32768u /* the host merges the last clusters, at most so many */
#define KILN_BVH_LEAF 3u    /* maximum number of triangles in a leaf */

#define KILN_BVH_CODE 0u   /* bvh_sort.comp: computes positions on the curve */
#define KILN_BVH_COUNT 1u  /* counts the digits of each group */
#define KILN_BVH_ADD 2u    /* prefix sums: adds up the words of each group, */
#define KILN_BVH_RISE 3u   /* then forms prefix sums of the groups' sums, */
#define KILN_BVH_FILL 4u   /* then those of all words */
#define KILN_BVH_PLACE 5u  /* moves keys to their places by digit */
#define KILN_BVH_LEAVES 6u /* writes the nodes of triangles */

#define KILN_BVH_NEAREST 0u /* bvh_cluster.comp: finds each cluster's nearest one */
#define KILN_BVH_PAIR 1u    /* pairs each cluster with its neighbour instead */
#define KILN_BVH_GONE 2u    /* counts the clusters that disappear in each group */
#define KILN_BVH_LEFT 3u    /* sums these counts; updates kiln_gpu_bvh_state */
#define KILN_BVH_JOIN 4u
#define KILN_BVH_GIVE 5u /* copies the remaining clusters for the host */

#define KILN_BVH_OPEN 0u   /* bvh_layout.comp: counts the children that are nodes, a group */
#define KILN_BVH_LEVEL 1u  /* adds up the counts of a level */
#define KILN_BVH_NEXT 2u   /* writes the tasks of the next level */
#define KILN_BVH_BELOW 3u  /* from the last level up: counts the nodes below each */
#define KILN_BVH_SETTLE 4u /* from the first level down: assigns places */
#define KILN_BVH_WRITE 5u  /* writes the layout */
