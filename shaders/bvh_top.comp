/* The last rounds of clustering, by one group of threads: few clusters are left, and each looks at all others. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

#include "shaders/bvh.glsl"
#include "shaders/bvh_join.glsl"

const uint OWN = KILN_BVH_TOP / 64u; /* clusters of a thread, side by side */

shared float boxes[6][KILN_BVH_TOP];
shared uint nodes[KILN_BVH_TOP], triangles[KILN_BVH_TOP], nearest[KILN_BVH_TOP], gone_before[KILN_BVH_TOP];
shared float costs[3][KILN_BVH_TOP];

struct cluster {
    bvh_box box;
    uint node;
    kiln_gpu_bvh_share share;
};

cluster cluster_at(uint i)
{
    return cluster(bvh_box(vec3(boxes[0][i], boxes[1][i], boxes[2][i]), vec3(boxes[3][i], boxes[4][i], boxes[5][i])),
                   nodes[i], kiln_gpu_bvh_share(triangles[i], float[3](costs[0][i], costs[1][i], costs[2][i])));
}

void put_cluster(uint i, const cluster c)
{
    for (uint k = 0u; k < 3u; k++) {
        boxes[k][i] = c.box.lower[k];
        boxes[3u + k][i] = c.box.upper[k];
        costs[k][i] = c.share.cost[k];
    }
    nodes[i] = c.node;
    triangles[i] = c.share.triangles;
}

void find_nearest(uint i, uint count, float inverse_extent)
{
    const bvh_box own = cluster_at(i).box;
    float least = uintBitsToFloat(0x7f800000u);
    uint found = KILN_GPU_NONE;
    for (uint j = 0u; j < count; j++) {
        const float area = bvh_area(bvh_join(own, cluster_at(j).box), inverse_extent);
        if (j != i && (found == KILN_GPU_NONE || bvh_is_nearer(area, i ^ j, least, i ^ found))) {
            least = area;
            found = j;
        }
    }
    nearest[i] = found;
}

bool is_gone(uint i, uint count) { return i < count && nearest[nearest[i]] == i && nearest[i] < i; }

/* The thread's cluster i after the round. */
cluster after_round(uint i, uint made)
{
    const cluster own = cluster_at(i);
    const uint partner = nearest[i];
    if (nearest[partner] != i)
        return own;
    const cluster other = cluster_at(partner);
    const bvh_box box = bvh_join(own.box, other.box);
    const uint node = BVH.count + made + gone_before[partner];
    const kiln_gpu_bvh_share share = bvh_share_of(own.share, other.share, bvh_area(box, BVH.inverse_extent));
    bvh_write_node(node, box, own.node, other.node);
    BvhShares(BVH.shares).at[node] = share;
    return cluster(box, node, share);
}

/* Joins pairs that have found each other; how many. */
uint join_pairs(uint lane, uint count, uint made)
{
    uint gone = 0u, of_all;
    for (uint i = OWN * lane; i < OWN * lane + OWN; i++)
        gone += is_gone(i, count) ? 1u : 0u;
    gone = bvh_before(lane, gone, of_all);
    for (uint i = OWN * lane; i < OWN * lane + OWN; i++) {
        gone_before[i] = gone;
        gone += is_gone(i, count) ? 1u : 0u;
    }
    barrier();
    cluster after[OWN];
    bool stays[OWN];
    for (uint k = 0u; k < OWN; k++) {
        const uint i = OWN * lane + k;
        stays[k] = i < count && !is_gone(i, count);
        if (stays[k])
            after[k] = after_round(i, made);
    }
    barrier();
    for (uint k = 0u; k < OWN; k++)
        if (stays[k])
            put_cluster(OWN * lane + k - gone_before[OWN * lane + k], after[k]);
    barrier();
    return of_all;
}

void kiln_kernel(uint x, uint y)
{
    if (x >= 64u)
        return;
    const kiln_gpu_bvh_state state = BvhStates(BVH.states).at[push.from];
    uint count = state.clusters, made = state.made;
    for (uint i = x; i < count; i += 64u) {
        const uint node = BvhWords(BVH.clusters[push.from]).at[i];
        put_cluster(i, cluster(bvh_box_of(BvhNodes(BVH.nodes + 32ul * node).at[0]), node,
                               BvhShares(BVH.shares).at[node]));
    }
    barrier();
    while (count > 1u) {
        for (uint i = x; i < count; i += 64u)
            find_nearest(i, count, BVH.inverse_extent);
        barrier();
        const uint joined = join_pairs(x, count, made);
        count -= joined;
        made += joined;
    }
}

#include "shaders/main.glsl"
