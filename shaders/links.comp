/* The links pass: thread (x, y) processes row y of the links of point x's tile run, and sums up the links of the point.
 * Neighbouring threads have points of one tile, and so the same links. links_reduce.comp sums up the rows.
 *
 * Factors equal those of worker/backend/link_sums.c and link_factors.h. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_links_push);

#include "shaders/position.glsl"
#include "shaders/real.glsl"
#include "shaders/shared/view_factor.h"

KILN_ARRAY(LinkedPoints, kiln_gpu_linked_point, 4);
KILN_ARRAY(LinkRuns, kiln_gpu_link_run, 4);
KILN_ARRAY(Links, kiln_gpu_link, 4);
KILN_ARRAY(TintedLinks, kiln_gpu_tinted_link, 4);
KILN_ARRAY(LinkNodes, kiln_gpu_link_node, 4);
KILN_ARRAY(LinkLeaves, kiln_gpu_link_leaf, 4);
KILN_ARRAY(LinkSent, kiln_gpu_link_sent, 4);
KILN_ARRAY(LinkLeafLights, kiln_gpu_link_leaf_light, 4);
KILN_ARRAY(FloatArray, float, 4);

const uint LEAF = 0x80000000u; /* KILN_LINK_LEAF */
const uint DRAWS = 4u;         /* KILN_LINK_DRAWS */
const real NEAR = real(8);     /* KILN_PATCHES_NEAR */
const real FLAT_NODE = KILN_RATIO(1, 10), RECTANGLE = KILN_RATIO(29, 10), UNSEEN = KILN_RATIO(3, 100),
           SPREAD = KILN_RATIO(3, 2), HALF = KILN_RATIO(1, 2);

/* The point of the thread. */
kiln_gpu_linked_point own;
kiln_gpu_link_run run;
uint bit;
real3 at, geometric, soft; /* its place; its normals */
bool smooth_point;         /* these may differ */

real row, variance;
real3 incident, irradiance;

/* ---- factors ---- */

/* How the point sees a node. */
struct View {
    real3 d;
    real square, distance_, other;
    bool whole;
};

/* View of a link's target: as one of several points of the tree, or as a whole node by its mean. */
struct Seen {
    View view;
    real radius;                /* of the node, 0 of a point */
    uint leaf;                  /* the point that represents the node, if it is not seen whole */
    real factor, shading;       /* about either normal */
    real3 slope, shading_slope; /* gradients of the factors by position in the node, if it is seen whole */
};

real3 covariance_times(kiln_gpu_link_node node, real3 v)
{
    return real3(real(node.covariance[0]) * v.x + real(node.covariance[3]) * v.y + real(node.covariance[4]) * v.z,
                 real(node.covariance[3]) * v.x + real(node.covariance[1]) * v.y + real(node.covariance[5]) * v.z,
                 real(node.covariance[4]) * v.x + real(node.covariance[5]) * v.y + real(node.covariance[2]) * v.z);
}

bool is_above(kiln_gpu_link_node node, real height)
{
    const real radius = real(node.radius);
    if (height >= radius || height <= 0)
        return height >= radius;
    return real(node.bend) < FLAT_NODE &&
           height * height >= RECTANGLE * dot(geometric, covariance_times(node, geometric));
}

View view_of(kiln_gpu_link_node node)
{
    View v;
    v.d = real3(node.centre) - at;
    v.square = dot(v.d, v.d);
    v.other = -dot(real3(node.normal), v.d);
    v.distance_ = sqrt(v.square);
    const real off = real(node.height) + real(node.bend) * (v.distance_ + real(node.radius));
    v.whole = v.other >= off && is_above(node, dot(geometric, v.d));
    return v;
}

/* Mean of n.d / |d|^4 over a node, divided by |d|^-4 at its centre. */
real node_height(kiln_gpu_link_node node, real3 n, View v)
{
    const real3 along = covariance_times(node, v.d);
    const real height = dot(n, v.d),
               trace = real(node.covariance[0]) + real(node.covariance[1]) + real(node.covariance[2]),
               more = (12 * dot(v.d, along) / v.square - 2 * trace) / v.square;
    const real stretched = more < 0 ? 1 / ((1 - HALF * more) * (1 - HALF * more)) : 1 + more;
    return max(real(0), height * stretched - 4 * dot(n, along) / v.square);
}

/* Gradient of a node's factor by the position in the node. */
real3 node_slope(kiln_gpu_link_node node, real3 n, View v)
{
    const real height = dot(n, v.d);
    return real(node.area) / (KILN_REAL_PI * v.square * v.square) *
           (v.other * n - height * real3(node.normal) - 4 * height * v.other / v.square * v.d);
}

/* As node_height, over a point's parallelogram. */
real leaf_height(kiln_gpu_link_leaf from, real3 n, real3 d, real square)
{
    const real height = dot(n, d);
    real sum = height;
    for (int i = 0; i < 2; i++) {
        const real3 edge = real3(i == 0 ? from.edge_s : from.edge_t);
        const real along = dot(d, edge) / square;
        sum += height * (along * along - dot(edge, edge) / (6 * square)) - dot(n, edge) * along / 3;
    }
    return max(real(0), sum);
}

/* Draws the point that represents node `to` for the thread's point, as an index in the tree's order; the same point as
 * in C but for rounding. */
uint choose_leaf(kiln_gpu_link_node node, uint to)
{
    const uint hash = kiln_hash1(to);
    uint64_t u = (uint64_t(hash) << 32) + uint64_t(own.number) * 0x9e3779b97f4a8000ul;
    uint k = node.first;
    for (uint i = 0u; i < DRAWS; i++) {
        k = node.first + uint((u >> 32) * uint64_t(node.count) >> 32);
        const float chance = float(kiln_hash2(hash + i, own.number)) * 2.3283064365386962890625e-10;
        if (chance * node.most_area < LinkLeaves(push.leaves).at[k].area)
            break;
        u += 0xc13fa9a902a63000ul; /* 0.75487766624669276 */
    }
    return k;
}

/* Computes the factors of a sending point, about both normals. `area`, if not 0, replaces the point's own. */
void leaf_factors(kiln_gpu_link_leaf from, real area, out real factor, out real shading)
{
    const real3 d = real3(from.centre) - at, s = real3(from.edge_s), t = real3(from.edge_t);
    const real cosine = dot(geometric, d), other = -dot(real3(from.normal), d), square = dot(d, d);
    factor = shading = real(0);
    if (!(cosine > 0 && other > 0))
        return;
    const real far = (area > 0 ? area : real(from.area)) * other / (KILN_REAL_PI * square * square);
    if (area > 0) {
        factor = far * cosine;
        shading = far * max(real(0), dot(soft, d));
        return;
    }
    const real reach = abs(dot(geometric, s)) + abs(dot(geometric, t));
    if (square < NEAR * NEAR * real(from.area) || cosine < HALF * reach) {
        factor = kiln_view_factor(d, s, t, geometric, geometric);
        shading = smooth_point ? kiln_view_factor(d, s, t, geometric, soft) : factor;
    } else {
        factor = far * leaf_height(from, geometric, d, square);
        shading = smooth_point ? far * leaf_height(from, soft, d, square) : factor;
    }
}

/* ---- what is seen ---- */

bool has_bit(uint mask[2], uint i) { return (mask[i >> 5] >> (i & 31u) & 1u) != 0u; }

/* Returns the number of points, a square of consecutive ones, that share one ray. */
uint shared_by(uint to)
{
    const real radius = (to & LEAF) != 0u ? real(0) : real(run.sharing) * real(LinkNodes(push.nodes).at[to].radius);
    return 4 * real(run.texel) <= radius ? 16u : 2 * real(run.texel) <= radius ? 4u : 1u;
}

/* Computes how the point sees a link's target. */
Seen seen_of(uint to)
{
    Seen s;
    real area = real(0);
    s.leaf = to & ~LEAF;
    s.view = View(real3(0), real(1), real(1), real(0), false);
    s.radius = real(0);
    if ((to & LEAF) == 0u) {
        const kiln_gpu_link_node node = LinkNodes(push.nodes).at[to];
        s.view = view_of(node);
        s.radius = real(node.radius);
        area = real(node.area);
        if (s.view.whole) {
            const real far = area * s.view.other / (KILN_REAL_PI * s.view.square * s.view.square);
            s.factor = far * node_height(node, geometric, s.view);
            s.slope = node_slope(node, geometric, s.view);
            s.shading = smooth_point ? far * node_height(node, soft, s.view) : s.factor;
            s.shading_slope = smooth_point ? node_slope(node, soft, s.view) : s.slope;
            return s;
        }
        s.leaf = choose_leaf(node, to);
    }
    s.slope = s.shading_slope = real3(0);
    leaf_factors(LinkLeaves(push.leaves).at[s.leaf], area, s.factor, s.shading); /* once: it is long, and inlined */
    return s;
}

/* Variance of the visibility of a link, estimated from neighbouring points with rays of their own. `others`: some of
 * these see the target and the point does not, or vice versa. */
real unsure_of(kiln_gpu_link link, out bool others)
{
    const uint side = shared_by(link.to);
    uint asked = 0u, other = 0u;
    if (has_bit(link.asked, bit) && has_bit(run.shares, bit))
        for (uint i = 1u; i < 4u; i++) {
            const uint beside = bit ^ (i * side);
            if (!has_bit(link.asked, beside) || !has_bit(run.shares, beside))
                continue;
            asked++;
            other += has_bit(link.seen, beside) != has_bit(link.seen, bit) ? 1u : 0u;
        }
    others = other > 0u;
    return (HALF * real(other) + UNSEEN) / real(asked + 1u);
}

/* ---- sums ---- */

/* Returns the light that a link's node or point sends, with the luminances that determine errors. */
kiln_gpu_link_sent sent_by(uint to)
{
    if ((to & LEAF) == 0u)
        return LinkSent(push.light).at[to];
    const kiln_gpu_link_leaf_light l = LinkLeafLights(push.light + uint64_t(push.node_count) * 64ul).at[to & ~LEAF];
    return kiln_gpu_link_sent(l.radiosity, float[9](0, 0, 0, 0, 0, 0, 0, 0, 0), l.now, l.before, 0.0, 0.0);
}

void add_variance(kiln_gpu_link_sent l, bool is_leaf, Seen s, real factor, real seen, real q)
{
    const real now = real(l.now), before = real(l.before), more = real(l.spread_now) - real(l.spread_before);
    real square = q * (now * now - before * before + more);
    if (!is_leaf && seen > 0) {
        const real rho = SPREAD * s.radius / s.view.distance_;
        square += s.view.whole ? rho * rho * more : now * now - before * before + more;
    }
    variance += factor * factor * square;
}

real along(real3 slope, kiln_gpu_link_sent l, uint c)
{
    return dot(slope, real3(l.moment[3u * c], l.moment[3u * c + 1u], l.moment[3u * c + 2u]));
}

void add_light(kiln_gpu_link_sent l, Seen s, vec3 through)
{
    float radiosity[3] = l.radiosity;
    if (!s.view.whole)
        radiosity = LinkLeafLights(push.light + uint64_t(push.node_count) * 64ul).at[s.leaf].radiosity;
    for (uint c = 0u; c < 3u; c++) {
        const real filter_ = real(through[c]), level = real(radiosity[c]),
                   arrives = filter_ * max(real(0), s.factor * level + along(s.slope, l, c));
        incident[c] += arrives;
        irradiance[c] +=
            smooth_point ? filter_ * max(real(0), s.shading * level + along(s.shading_slope, l, c)) : arrives;
    }
}

void add_link(uint to, vec3 through, bool sees, real q)
{
    const kiln_gpu_link_sent sent = sent_by(to);
    const Seen s = seen_of(to);
    const real seen = sees ? (real(through.r) + real(through.g) + real(through.b)) / 3 : real(0);
    if (sees) {
        row += s.factor * seen;
        add_light(sent, s, through);
    }
    add_variance(sent, (to & LEAF) != 0u, s, sees ? s.shading : s.factor, seen, q);
}

/* Adds link i of the tile run, if the point has it. */
void add_number(uint i)
{
    uint to;
    vec3 through = vec3(1.0);
    bool sees = true, others = false;
    real q = real(0);
    if (i >= run.count) {
        const kiln_gpu_tinted_link t = TintedLinks(push.tinted).at[run.tinted_first + i - run.count];
        if (t.bit != bit)
            return;
        to = t.to;
        through = vec3(t.through[0], t.through[1], t.through[2]);
    } else {
        const kiln_gpu_link link = Links(push.links).at[run.first + i];
        if (!has_bit(link.asked, bit))
            return;
        to = link.to;
        q = unsure_of(link, others);
        sees = has_bit(link.seen, bit);
    }
    if (sees || others)
        add_link(to, through, sees, q);
}

void store(uint x, uint y)
{
    FloatArray floats = FloatArray(push.slices + uint64_t(y * KILN_GPU_LINK_FLOATS) * push.chunk.total * 4ul);
    const uint step = push.chunk.total;
    for (uint c = 0u; c < 3u; c++) {
        floats.at[c * step + x] = float(incident[c]);
        floats.at[(3u + c) * step + x] = float(irradiance[c]);
    }
    floats.at[6u * step + x] = float(row);
    floats.at[7u * step + x] = float(variance);
}

void kiln_kernel(uint x, uint y)
{
    const uint index = push.chunk.first + x, y_row = push.row_first + y;
    if (x >= push.chunk.count ||
        (WordArray(push.chunk.states).at[index] & KILN_GPU_STATE_MASK) == KILN_GPU_STATE_INVALID)
        return;
    own = LinkedPoints(push.points).at[x];
    run = LinkRuns(push.runs).at[own.run_and_bit >> 6];
    bit = own.run_and_bit & 63u;
    const uint begin = y_row * KILN_GPU_LINKS_A_ROW,
               end = min(run.count + run.tinted_count, begin + KILN_GPU_LINKS_A_ROW);
    if (begin >= end)
        return;
    const kiln_gpu_point p = PointArray(push.chunk.points).at[index];
    at = real3(own.place);
    geometric = real3(own.normal);
    soft = real3(kiln_shading(p, own.normal));
    smooth_point = HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u;
    row = variance = real(0);
    incident = irradiance = real3(0);
    uint i = begin;
    for (; i < end; i++)
        add_number(i);
    if (i < end)
        row = real(-1000000000);
    store(x, y_row);
}

#include "shaders/main.glsl"
