/* Converts the binary tree to a layout (shaders/shared/layout_trace.h), as worker/backend/vulkan/bvh.c does. Finds,
 * level by level, the nodes of the layout; then from the last level up how many nodes are below each; then from the
 * first level down their places, in depth-first order; then writes all nodes at once. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

#include "shaders/bvh.glsl"

KILN_ARRAY(BvhTasks, kiln_gpu_bvh_task, 4);
KILN_ARRAY(BvhReals, float, 4);
KILN_ARRAY(BvhTriangles, kiln_gpu_triangle, 16);
KILN_ARRAY(BvhNodes4, kiln_gpu_bvh4_node, 16);

const uint WIDTH_MOST = 4u;
const float NOWHERE = 3.0e38;

BvhTasks task_at(uint i) { return BvhTasks(BVH.tasks + 24ul * i); }

/* The children of a node of the layout. */
struct family {
    uint count;
    uint node[WIDTH_MOST];
    uint leaf[WIDTH_MOST]; /* triangles; 0: a node */
};

bool is_leaf(uint node) { return (BvhSubtrees(BVH.subtrees).at[node].triangles & KILN_GPU_LEAF) != 0u; }

void take(inout family f, uint node)
{
    const uint triangles = BvhSubtrees(BVH.subtrees).at[node].triangles;
    f.node[f.count] = node;
    f.leaf[f.count] = (triangles & KILN_GPU_LEAF) != 0u ? triangles & ~KILN_GPU_LEAF : 0u;
    f.count++;
}

/* Returns the children that an inner node has in the layout: those of least cost. */
family gather(uint from)
{
    uint node[WIDTH_MOST], room[WIDTH_MOST], depth = 1u; /* nodes to open; largest number of children of each */
    family f;
    f.count = 0u;
    for (uint i = 0u; i < WIDTH_MOST; i++) {
        f.node[i] = KILN_GPU_NONE;
        f.leaf[i] = 0u;
    }
    node[0] = from;
    room[0] = is_leaf(from) ? 1u : WIDTH_MOST;
    while (depth > 0u) {
        depth--;
        const uint own = node[depth];
        uint most = room[depth];
        const kiln_gpu_bvh_subtree share = BvhSubtrees(BVH.subtrees).at[own];
        while (own != from && most > 1u && share.cost[most - 1u] == share.cost[most - 2u])
            most--;
        if (most == 1u) {
            take(f, own);
            continue;
        }
        const kiln_gpu_bvh_node opened = BvhNodes(BVH.nodes + 32ul * own).at[0];
        uint first;
        bvh_distribute(BvhSubtrees(BVH.subtrees).at[opened.first].cost,
                       BvhSubtrees(BVH.subtrees).at[opened.second].cost, most,
                       first);
        node[depth] = opened.second;
        room[depth++] = most - first;
        node[depth] = opened.first;
        room[depth++] = first;
    }
    return f;
}

uint nodes_of(const family f)
{
    uint count = 0u;
    for (uint i = 0u; i < f.count; i++)
        count += f.leaf[i] == 0u ? 1u : 0u;
    return count;
}

/* ---- level by level ---- */

/* Opens the tasks of a level. Their children are stored in the order of the parents. */
void open_group(uint group, uint lane, bool next)
{
    const uint x = group * 64u + lane, t = push.first + x;
    family f;
    f.count = 0u;
    if (x < push.count)
        f = gather(task_at(t).at[0].node);
    uint of_group;
    uint child = bvh_before(lane, nodes_of(f), of_group);
    if (!next && lane == 0u)
        BvhWords(BVH.sums).at[group] = of_group;
    if (!next || x >= push.count)
        return;
    child += push.next + BvhWords(BVH.sums).at[group];
    task_at(t).at[0].child = child;
    uint triangle = task_at(t).at[0].triangle;
    for (uint i = 0u; i < f.count; i++)
        triangle += f.leaf[i]; /* leaves have the first places */
    for (uint i = 0u; i < f.count; i++) {
        if (f.leaf[i] != 0u)
            continue;
        task_at(child++).at[0] = kiln_gpu_bvh_task(f.node[i], triangle, 0u, 0u, 0u, 0u);
        triangle += BvhSubtrees(BVH.subtrees).at[f.node[i]].triangles;
    }
}

/* End of task x's children: where the children of the next task begin, or `next`. */
uint end_of_children(uint x) { return x + 1u < push.count ? task_at(push.first + x + 1u).at[0].child : push.next; }

void count_below(uint x)
{
    const uint end = end_of_children(x);
    uint below = 0u;
    for (uint child = task_at(push.first + x).at[0].child; child < end; child++)
        below += 1u + task_at(child).at[0].below;
    task_at(push.first + x).at[0].below = below;
}

void settle(uint x)
{
    const kiln_gpu_bvh_task own = task_at(push.first + x).at[0];
    const uint end = end_of_children(x);
    uint free = own.free + end - own.child;
    for (uint child = own.child; child < end; child++) {
        task_at(child).at[0].place = own.free + child - own.child;
        task_at(child).at[0].free = free;
        free += task_at(child).at[0].below;
    }
}

/* ---- the layout ---- */

float[3] corner_of(uint triangle, uint corner)
{
    BvhReals p = BvhReals(BVH.vertices + 12ul * BvhWords(BVH.indices + 12ul * triangle).at[corner]);
    return float[3](p.at[0], p.at[1], p.at[2]);
}

/* Writes the triangles below a node, at most KILN_BVH_LEAF, from index `at` on. */
void write_triangles(uint node, uint at)
{
    uint stack[KILN_BVH_LEAF], depth = 1u;
    stack[0] = node;
    while (depth > 0u) {
        const kiln_gpu_bvh_node n = BvhNodes(BVH.nodes + 32ul * stack[--depth]).at[0];
        if (n.second == KILN_GPU_NONE) {
            BvhTriangles(BVH.layout_triangles + 48ul * at).at[0] = kiln_gpu_triangle(
                corner_of(n.first, 0u), n.first, corner_of(n.first, 1u), 0u, corner_of(n.first, 2u), 0u);
            at++;
        } else {
            stack[depth++] = n.second;
            stack[depth++] = n.first;
        }
    }
}

void write_four(uint place, const family f, const uint code[WIDTH_MOST])
{
    kiln_gpu_bvh4_node to;
    for (uint i = 0u; i < 4u; i++) {
        const bool there = i < f.count;
        kiln_gpu_bvh_node n;
        if (there)
            n = BvhNodes(BVH.nodes + 32ul * f.node[i]).at[0];
        for (uint k = 0u; k < 3u; k++) {
            to.bounds[2u * k][i] = there ? n.lower[k] : NOWHERE;
            to.bounds[2u * k + 1u][i] = there ? n.upper[k] : -NOWHERE;
        }
        to.child[i] = there ? code[i] : KILN_GPU_NONE;
        to.unused[i] = 0u;
    }
    BvhNodes4(BVH.layout_nodes + 128ul * place).at[0] = to;
}

void write_task(uint t)
{
    const kiln_gpu_bvh_task own = task_at(t).at[0];
    const family f = gather(own.node);
    uint code[WIDTH_MOST], triangle = own.triangle, node = own.free;
    for (uint i = 0u; i < f.count; i++) {
        if (f.leaf[i] == 0u) {
            code[i] = node++;
        } else {
            code[i] = KILN_GPU_LEAF | (f.leaf[i] - 1u) << KILN_GPU_LEAF_COUNT_SHIFT | triangle;
            write_triangles(f.node[i], triangle);
            triangle += f.leaf[i];
        }
    }
    write_four(own.place, f, code);
}

void kiln_kernel(uint x, uint y)
{
    const uint group = x / 64u, lane = x % 64u;
    if ((push.stage == KILN_BVH_OPEN || push.stage == KILN_BVH_NEXT) && group * 64u < push.count)
        open_group(group, lane, push.stage == KILN_BVH_NEXT);
    if (push.stage == KILN_BVH_LEVEL && group == 0u) {
        const uint of_level = bvh_rise(BVH.sums, (push.count + 63u) / 64u, lane);
        if (lane == 0u)
            BvhWords(BVH.states + 16ul).at[0] = of_level;
    }
    if (push.stage == KILN_BVH_BELOW && x < push.count)
        count_below(x);
    if (push.stage == KILN_BVH_SETTLE && x < push.count)
        settle(x);
    if (push.stage == KILN_BVH_WRITE && x < push.count)
        write_task(x);
}

#include "shaders/main.glsl"
