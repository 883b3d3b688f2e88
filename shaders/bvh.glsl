/* Common code of the kernels that build a BVH: addresses of its arrays, boxes, sums over a group of 64 threads. */
KILN_PUSH(kiln_gpu_bvh_push);

KILN_ARRAY(BvhRoots, kiln_gpu_bvh, 8);
KILN_ARRAY(BvhNodes, kiln_gpu_bvh_node, 16);
KILN_ARRAY(BvhSubtrees, kiln_gpu_bvh_subtree, 16);
KILN_ARRAY(BvhStates, kiln_gpu_bvh_state, 8);
KILN_ARRAY(BvhWords, uint, 4);
#define BVH BvhRoots(push.bvh).at[0]

struct bvh_box {
    vec3 lower, upper;
};

vec3 bvh_vector(const float v[3]) { return vec3(v[0], v[1], v[2]); }

bvh_box bvh_box_of(const kiln_gpu_bvh_node node) { return bvh_box(bvh_vector(node.lower), bvh_vector(node.upper)); }

bvh_box bvh_join(const bvh_box a, const bvh_box b) { return bvh_box(min(a.lower, b.lower), max(a.upper, b.upper)); }

/* Half the surface of a box, over the square of the world's extent. */
float bvh_area(const bvh_box box, float inverse_extent)
{
    const vec3 size = (box.upper - box.lower) * inverse_extent;
    return size.x * size.y + size.y * size.z + size.z * size.x;
}

/* Returns the least cost of two subtrees as at most `room` children of one node (Ylitie, Karras and Laine 2017, section
 * 3.2, equation 5). `first`: how many of these are for the first. */
float bvh_distribute(const float a[3], const float b[3], uint room, out uint first)
{
    float least = a[0] + b[room - 2u];
    first = 1u;
    for (uint k = 2u; k < room; k++) {
        const float cost = a[k - 1u] + b[room - k - 1u];
        if (cost < least) {
            least = cost;
            first = k;
        }
    }
    return least;
}

/* ---- sums ---- */

shared uint bvh_added[64];

/* Prefix sum over a group: the sum over the threads before this one. `total`: over all threads. */
uint bvh_before(uint lane, uint value, out uint total)
{
    bvh_added[lane] = value;
    barrier();
    for (uint reach = 1u; reach < 64u; reach *= 2u) {
        const uint more = lane >= reach ? bvh_added[lane - reach] : 0u;
        barrier();
        bvh_added[lane] += more;
        barrier();
    }
    total = bvh_added[63];
    const uint before = bvh_added[lane] - value;
    barrier();
    return before;
}

/* Replaces each of `count` words by the sum of the words before it, in one group. Returns the sum of all. */
uint bvh_rise(uint64_t words, uint count, uint lane)
{
    BvhWords sums = BvhWords(words);
    uint sum = 0u;
    for (uint from = 0u; from < count; from += 512u) {
        const uint own = from + 8u * lane;
        uint value[8], of_thread = 0u, of_tile;
        for (uint i = 0u; i < 8u; i++) {
            value[i] = own + i < count ? sums.at[own + i] : 0u;
            of_thread += value[i];
        }
        uint before = sum + bvh_before(lane, of_thread, of_tile);
        for (uint i = 0u; i < 8u && own + i < count; i++) {
            sums.at[own + i] = before;
            before += value[i];
        }
        sum += of_tile;
    }
    return sum;
}
