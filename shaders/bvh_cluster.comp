/* Rounds of parallel locally-ordered clustering (Meister and Bittner 2018, algorithm 1; shared tiles as in Benthin et
 * al. 2022): each cluster finds the one among its neighbours along the curve with which its box is smallest; two that
 * find each other are joined, in the place of the first; the others close up. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

#include "shaders/bvh.glsl"

/* Whether a neighbour is nearer than another: by the area of the box around both clusters; at equal area by the lower
 * key. Both clusters of a pair have the same key for it, and no two neighbours of a cluster have equal keys. So the
 * nearest pair of all is always joined; of many equal boxes half are joined (places 2 k and 2 k + 1 have the key 1). */
bool is_nearer(float area, uint key, float than_area, uint than_key)
{
    return area < than_area || (area == than_area && key < than_key);
}

/* Returns triangles and least cost of a joined pair (Ylitie et al. 2017, equations 2 to 5). They become a leaf if that
 * costs no more than a node with four children. A node and a triangle cost the same. */
kiln_gpu_bvh_subtree share_of(const kiln_gpu_bvh_subtree a, const kiln_gpu_bvh_subtree b, float area)
{
    const uint triangles = (a.triangles & ~KILN_GPU_LEAF) + (b.triangles & ~KILN_GPU_LEAF);
    uint first;
    const float apart = area + bvh_distribute(a.cost, b.cost, 4u, first), together = area * float(triangles);
    const bool leaf = triangles <= KILN_BVH_LEAF && together <= apart;
    const float one = leaf ? together : apart, two = min(one, bvh_distribute(a.cost, b.cost, 2u, first));
    const float three = min(two, bvh_distribute(a.cost, b.cost, 3u, first));
    return kiln_gpu_bvh_subtree(leaf ? KILN_GPU_LEAF | triangles : triangles, float[3](one, two, three));
}

void write_node(uint at, const bvh_box box, uint first, uint second)
{
    BvhNodes(BVH.nodes + 32ul * at).at[0] = kiln_gpu_bvh_node(float[3](box.lower.x, box.lower.y, box.lower.z), first,
                                                              float[3](box.upper.x, box.upper.y, box.upper.z), second);
}

const uint TILE = 64u + 2u * KILN_BVH_RADIUS;

shared float tile[6][TILE];

bvh_box in_tile(uint at)
{
    return bvh_box(vec3(tile[0][at], tile[1][at], tile[2][at]), vec3(tile[3][at], tile[4][at], tile[5][at]));
}

void fill_tile(uint group, uint lane, uint count)
{
    for (uint at = lane; at < 64u + 2u * push.radius; at += 64u) {
        const uint i = group * 64u + at - push.radius; /* below 0: beyond `count` */
        if (i >= count)
            continue;
        const uint node = BvhWords(BVH.clusters[push.from]).at[i];
        const kiln_gpu_bvh_node n = BvhNodes(BVH.nodes + 32ul * node).at[0];
        for (uint k = 0u; k < 3u; k++) {
            tile[k][at] = n.lower[k];
            tile[3u + k][at] = n.upper[k];
        }
    }
    barrier();
}

void find_nearest(uint group, uint lane, uint count)
{
    fill_tile(group, lane, count);
    const uint i = group * 64u + lane;
    if (i >= count)
        return;
    const float inverse_extent = BVH.inverse_extent;
    const bvh_box own = in_tile(lane + push.radius);
    float least = uintBitsToFloat(0x7f800000u);
    uint nearest = KILN_GPU_NONE;
    const uint end = min(i + push.radius + 1u, count);
    for (uint j = i - min(i, push.radius); j < end; j++) {
        const float area = bvh_area(bvh_join(own, in_tile(j + push.radius - group * 64u)), inverse_extent);
        if (j != i && (nearest == KILN_GPU_NONE || is_nearer(area, i ^ j, least, i ^ nearest))) {
            least = area;
            nearest = j;
        }
    }
    BvhWords(BVH.nearest).at[i] = nearest;
}

bool has_partner(BvhWords nearest, uint i, uint count)
{
    const uint j = nearest.at[i];
    return j < count && nearest.at[j] == i;
}

/* Whether the cluster is joined into one with a lower index, and disappears. */
bool is_gone(BvhWords nearest, uint i, uint count)
{
    return i < count && has_partner(nearest, i, count) && nearest.at[i] < i;
}

uint count_gone(BvhWords nearest, uint own, uint count)
{
    uint gone = 0u;
    for (uint i = own; i < own + KILN_BVH_ADDED / 64u; i++)
        gone += is_gone(nearest, i, count) ? 1u : 0u;
    return gone;
}

/* Joins clusters i and j to node number `made` of the new ones. */
uint join(uint i, uint j, uint made)
{
    const uint a = BvhWords(BVH.clusters[push.from]).at[i], b = BvhWords(BVH.clusters[push.from]).at[j];
    const bvh_box box =
        bvh_join(bvh_box_of(BvhNodes(BVH.nodes + 32ul * a).at[0]), bvh_box_of(BvhNodes(BVH.nodes + 32ul * b).at[0]));
    const uint node = BVH.count + made;
    write_node(node, box, a, b);
    BvhSubtrees(BVH.subtrees).at[node] =
        share_of(BvhSubtrees(BVH.subtrees).at[a], BvhSubtrees(BVH.subtrees).at[b], bvh_area(box, BVH.inverse_extent));
    return node;
}

void join_group(uint group, uint lane, const kiln_gpu_bvh_state state)
{
    BvhWords nearest = BvhWords(BVH.nearest);
    const uint own = group * KILN_BVH_ADDED + lane * (KILN_BVH_ADDED / 64u), count = state.clusters;
    uint of_group;
    uint gone = bvh_before(lane, count_gone(nearest, own, count), of_group) + BvhWords(BVH.sums).at[group];
    for (uint i = own; i < own + KILN_BVH_ADDED / 64u && i < count; i++) {
        if (is_gone(nearest, i, count)) {
            gone++;
            continue;
        }
        uint node = BvhWords(BVH.clusters[push.from]).at[i];
        if (has_partner(nearest, i, count)) {
            const uint partner = nearest.at[i];
            uint between = 0u; /* that go */
            for (uint j = i + 1u; j < partner; j++)
                between += is_gone(nearest, j, count) ? 1u : 0u;
            node = join(i, partner, state.made + gone + between);
        }
        BvhWords(BVH.clusters[1u - push.from]).at[i - gone] = node;
    }
}

void give(uint i)
{
    const uint node = BvhWords(BVH.clusters[push.from]).at[i];
    BvhNodes(BVH.left).at[i] = BvhNodes(BVH.nodes + 32ul * node).at[0];
    BvhSubtrees(BVH.left_subtrees).at[i] = BvhSubtrees(BVH.subtrees).at[node];
}

void kiln_kernel(uint x, uint y)
{
    const uint group = x / 64u, lane = x % 64u;
    const kiln_gpu_bvh_state state = BvhStates(BVH.states).at[push.from];
    const uint count = state.clusters;
    uint of_all;
    if (push.stage == KILN_BVH_NEAREST && group * 64u < count)
        find_nearest(group, lane, count);
    if (push.stage == KILN_BVH_PAIR && x < count)
        BvhWords(BVH.nearest).at[x] = x ^ 1u;
    if (push.stage == KILN_BVH_GONE && group * KILN_BVH_ADDED < count) {
        const uint own = group * KILN_BVH_ADDED + lane * (KILN_BVH_ADDED / 64u);
        bvh_before(lane, count_gone(BvhWords(BVH.nearest), own, count), of_all);
        if (lane == 0u)
            BvhWords(BVH.sums).at[group] = of_all;
    }
    if (push.stage == KILN_BVH_LEFT && group == 0u) {
        of_all = bvh_rise(BVH.sums, (count + KILN_BVH_ADDED - 1u) / KILN_BVH_ADDED, lane);
        if (lane == 0u)
            BvhStates(BVH.states).at[1u - push.from] = kiln_gpu_bvh_state(count - of_all, state.made + of_all);
    }
    if (push.stage == KILN_BVH_JOIN && group * KILN_BVH_ADDED < count)
        join_group(group, lane, state);
    if (push.stage == KILN_BVH_GIVE && x < count)
        give(x);
}

#include "shaders/main.glsl"
