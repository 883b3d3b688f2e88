/* Sorts triangles along a Morton curve (Morton, 1966) by a stable radix sort. For each digit, from the least
 * significant on: each group counts its keys, the counts are summed up, and each key gets its place. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

#include "shaders/bvh.glsl"

KILN_ARRAY(BvhKeys, uint64_t, 8);
KILN_ARRAY(BvhReals, float, 4);

const uint OWN = KILN_BVH_SORTED / 64u; /* keys of a thread, side by side */

shared uint digits[KILN_BVH_DIGITS][64];

vec3 corner_of(uint triangle, uint corner)
{
    const uint vertex = BvhWords(BVH.indices + 12ul * triangle).at[corner];
    BvhReals p = BvhReals(BVH.vertices + 12ul * vertex);
    return vec3(p.at[0], p.at[1], p.at[2]);
}

bvh_box box_of(uint triangle)
{
    const vec3 a = corner_of(triangle, 0u), b = corner_of(triangle, 1u), c = corner_of(triangle, 2u);
    return bvh_box(min(a, min(b, c)) - BVH.margin, max(a, max(b, c)) + BVH.margin);
}

/* Spreads the 21 lowest bits: two zeros follow each of them. */
uint64_t apart(uint number)
{
    uint64_t bits = uint64_t(number & 0x1fffffu);
    bits = (bits | bits << 32) & 0x001f00000000fffful;
    bits = (bits | bits << 16) & 0x001f0000ff0000fful;
    bits = (bits | bits << 8) & 0x100f00f00f00f00ful;
    bits = (bits | bits << 4) & 0x10c30c30c30c30c3ul;
    return (bits | bits << 2) & 0x1249249249249249ul;
}

void write_code(uint i)
{
    const uint triangle = i < BVH.before ? i : i + BVH.skipped;
    const bvh_box box = box_of(triangle);
    const vec3 place = (0.5 * (box.lower + box.upper) - bvh_vector(BVH.origin)) * BVH.steps;
    const uvec3 cell = uvec3(clamp(place, vec3(0.0), vec3(2097151.0)));
    BvhKeys(BVH.keys[0]).at[i] = apart(cell.x) << 2 | apart(cell.y) << 1 | apart(cell.z);
    BvhWords(BVH.values[0]).at[i] = triangle;
}

uint digit_at(uint i) { return uint(BvhKeys(BVH.keys[push.from]).at[i] >> push.shift) & (KILN_BVH_DIGITS - 1u); }

/* Counts the digits of a thread's own keys. */
void count_digits(uint group, uint lane)
{
    const uint own = group * KILN_BVH_SORTED + lane * OWN;
    for (uint d = 0u; d < KILN_BVH_DIGITS; d++)
        digits[d][lane] = 0u;
    for (uint i = own; i < own + OWN && i < push.count; i++)
        digits[digit_at(i)][lane]++;
    barrier();
}

void count_group(uint group, uint lane)
{
    count_digits(group, lane);
    if (lane >= KILN_BVH_DIGITS)
        return;
    uint sum = 0u;
    for (uint i = 0u; i < 64u; i++)
        sum += digits[lane][i];
    const uint groups = (push.count + KILN_BVH_SORTED - 1u) / KILN_BVH_SORTED;
    BvhWords(BVH.histogram).at[lane * groups + group] = sum;
}

void place_group(uint group, uint lane)
{
    const uint groups = (push.count + KILN_BVH_SORTED - 1u) / KILN_BVH_SORTED;
    count_digits(group, lane);
    if (lane < KILN_BVH_DIGITS) {
        uint place = BvhWords(BVH.histogram).at[lane * groups + group];
        for (uint i = 0u; i < 64u; i++) {
            const uint here = digits[lane][i];
            digits[lane][i] = place;
            place += here;
        }
    }
    barrier();
    const uint own = group * KILN_BVH_SORTED + lane * OWN;
    for (uint i = own; i < own + OWN && i < push.count; i++) {
        const uint64_t key = BvhKeys(BVH.keys[push.from]).at[i];
        const uint place = digits[uint(key >> push.shift) & (KILN_BVH_DIGITS - 1u)][lane]++;
        BvhKeys(BVH.keys[1u - push.from]).at[place] = key;
        BvhWords(BVH.values[1u - push.from]).at[place] = BvhWords(BVH.values[push.from]).at[i];
    }
}

/* Sums up a group's words of the histogram; with `fill`, replaces each by the sum of those before it. */
void add_words(uint group, uint lane, bool fill)
{
    BvhWords words = BvhWords(BVH.histogram);
    const uint own = group * KILN_BVH_ADDED + 8u * lane;
    uint value[8], of_thread = 0u, of_group;
    for (uint i = 0u; i < 8u; i++) {
        value[i] = own + i < push.count ? words.at[own + i] : 0u;
        of_thread += value[i];
    }
    uint before = bvh_before(lane, of_thread, of_group);
    if (!fill) {
        if (lane == 0u)
            BvhWords(BVH.sums).at[group] = of_group;
        return;
    }
    before += BvhWords(BVH.sums).at[group];
    for (uint i = 0u; i < 8u && own + i < push.count; i++) {
        words.at[own + i] = before;
        before += value[i];
    }
}

void write_leaf(uint i)
{
    const uint triangle = BvhWords(BVH.values[push.from]).at[i];
    const bvh_box box = box_of(triangle);
    BvhNodes(BVH.nodes + 32ul * i).at[0] =
        kiln_gpu_bvh_node(float[3](box.lower.x, box.lower.y, box.lower.z), triangle,
                          float[3](box.upper.x, box.upper.y, box.upper.z), KILN_GPU_NONE);
    const float cost = bvh_area(box, BVH.inverse_extent);
    BvhSubtrees(BVH.subtrees).at[i] = kiln_gpu_bvh_subtree(KILN_GPU_LEAF | 1u, float[3](cost, cost, cost));
    BvhWords(BVH.clusters[0]).at[i] = i;
}

void kiln_kernel(uint x, uint y)
{
    const uint group = x / 64u, lane = x % 64u;
    if (push.stage == KILN_BVH_CODE && x < push.count)
        write_code(x);
    if (push.stage == KILN_BVH_COUNT && group * KILN_BVH_SORTED < push.count)
        count_group(group, lane);
    if ((push.stage == KILN_BVH_ADD || push.stage == KILN_BVH_FILL) && group * KILN_BVH_ADDED < push.count)
        add_words(group, lane, push.stage == KILN_BVH_FILL);
    if (push.stage == KILN_BVH_RISE && group == 0u)
        bvh_rise(BVH.sums, push.count, lane);
    if (push.stage == KILN_BVH_PLACE && group * KILN_BVH_SORTED < push.count)
        place_group(group, lane);
    if (push.stage == KILN_BVH_LEAVES && x < push.count)
        write_leaf(x);
}

#include "shaders/main.glsl"
