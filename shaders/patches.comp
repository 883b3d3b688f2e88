/* The patches pass: thread (x, y) goes through row y of the nodes for point x. Neighbouring threads have neighbouring
 * points and the same nodes, which come from the caches; each looks for its next node that faces it before a ray is
 * traced, so that threads trace together. patches_reduce.comp adds up the rows.
 *
 * Floats, but for what is near: there the factors are differences. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/radiosity.h"

KILN_PUSH(kiln_gpu_patches_push);

#include "shaders/trace/trace.glsl"
#include "shaders/position.glsl"
#include "shaders/real.glsl"
#include "shaders/sum.glsl"
#include "shaders/shared/area_light.h"
#include "shaders/shared/view_factor.h"

KILN_ARRAY(OwnPatches, kiln_gpu_patch, 4);
layout(buffer_reference, scalar, buffer_reference_align = 16) readonly buffer NodeQuads { vec4 at[]; };
KILN_ARRAY(FloatArray, float, 4);

const float NEAR = 8.0, FLAT = 9.5367431640625e-7; /* KILN_PATCHES_NEAR, KILN_PATCHES_FLAT */
const float PI = 3.14159265358979;

/* The point of the thread. */
kiln_gpu_patch own;
vec3 soft;         /* its shading normal */
bool smooth_point; /* which differs from the geometric one */

kiln_sum row, incident[3], irradiance[3];

/* A node that faces the point. */
struct Node {
    vec3 d;                      /* from the point to its centre */
    float cosine, other, square; /* the cosines times the distance; of the distance */
    float area;
    vec3 normal, place, edge_s, edge_t, radiosity;
    uint number;
};

/* The mean over a node of n.d / |d|^4, over |d|^-4 at its middle, to the second order in its size. */
float mean_height(Node node, vec3 n)
{
    const float height = dot(n, node.d);
    float sum = height;
    for (int i = 0; i < 2; i++) {
        const vec3 edge = i == 0 ? node.edge_s : node.edge_t;
        const float along = dot(node.d, edge) / node.square;
        sum += height * (along * along - dot(edge, edge) / (6.0 * node.square)) - dot(n, edge) * along / 3.0;
    }
    return max(0.0, sum);
}

/* Whether a node counts as a polygon: it is near, or crosses the horizon. */
bool is_near(Node node)
{
    const float reach = abs(dot(own.normal, node.edge_s)) + abs(dot(own.normal, node.edge_t));
    return node.square < NEAR * NEAR * node.area || node.cosine < 0.5 * reach;
}

float near_factor(Node node, vec3 about)
{
    return float(
        kiln_view_factor(real3(node.d), real3(node.edge_s), real3(node.edge_t), real3(own.normal), real3(about)));
}

/* F about the geometric and about the shading normal. */
vec2 factors_of(Node node)
{
    const float far = node.area * node.other / (PI * node.square * node.square);
    if (push.most_factor > 0.0)
        return min(far * vec2(node.cosine, max(0.0, dot(soft, node.d))), vec2(push.most_factor));
    vec2 factors;
    if (is_near(node)) {
        factors.x = near_factor(node, own.normal);
        factors.y = smooth_point ? near_factor(node, soft) : factors.x;
    } else {
        factors.x = far * mean_height(node, own.normal);
        factors.y = smooth_point ? far * mean_height(node, soft) : factors.x;
    }
    return factors;
}

/* What the node sends, of each colour the share `through`. */
void add_node(Node node, vec3 through)
{
    const vec2 factors = factors_of(node);
    kiln_add(row, factors.x * ((through.r + through.g + through.b) * (1.0 / 3.0)));
    for (uint c = 0u; c < 3u; c++) {
        const float arrives = through[c] * node.radiosity[c], reflected = own.albedo[c] * factors.x * arrives;
        /* what the clamp leaves of it */
        const float left = push.most_added > 0.0 && reflected > push.most_added ? push.most_added / reflected : 1.0;
        kiln_add(incident[c], left * factors.x * arrives);
        if (HAS_SMOOTH != 0u)
            kiln_add(irradiance[c], left * factors.y * arrives);
    }
}

/* Traces the ray between the two places: the same whichever of the points asks, from the one with the lower number.
 * False: they are one place, and there is none. */
bool trace(Node node)
{
    const bool first = own.number < node.number;
    const vec3 from = first ? own.place : node.place, to = first ? node.place : own.place;
    const vec3 way = to - from;
    const float apart = sqrt(dot(way, way));
    if (!(apart > 0.0))
        return false;
    const vec3 through = kiln_through(from, way / apart, float(real(apart) * KILN_SHADOW_LENGTH));
    if (through != vec3(0.0))
        add_node(node, through);
    return true;
}

Node node_of(uint k, vec4 centre_area, vec4 normal_number)
{
    NodeQuads shapes = NodeQuads(push.shapes);
    const vec4 a = shapes.at[3u * k], b = shapes.at[3u * k + 1u], c = shapes.at[3u * k + 2u];
    Node node;
    node.d = centre_area.xyz - own.place;
    node.cosine = dot(own.normal, node.d);
    node.other = -dot(normal_number.xyz, node.d);
    node.square = dot(node.d, node.d);
    node.area = centre_area.w;
    node.normal = normal_number.xyz;
    node.number = floatBitsToUint(normal_number.w);
    node.place = a.xyz;
    node.edge_s = vec3(a.w, b.xy);
    node.edge_t = vec3(b.zw, c.x);
    node.radiosity = c.yzw;
    return node;
}

/* Goes through nodes k .. end-1; how many of them face the point, or -1e9: the device has ended the loop early. */
float go_through(uint k, uint end)
{
    NodeQuads facing = NodeQuads(push.facing);
    const float coplanar = FLAT * SCENE.trace.extent;
    float traced = 0.0;
    bool any = true;
    while (any) {
        vec4 centre_area, normal_number;
        any = false;
        while (k < end && !any) {
            centre_area = facing.at[2u * k];
            normal_number = facing.at[2u * k + 1u];
            const vec3 d = centre_area.xyz - own.place;
            any = dot(own.normal, d) > coplanar && dot(normal_number.xyz, d) < -coplanar;
            k++;
        }
        if (any && trace(node_of(k - 1u, centre_area, normal_number)))
            traced += 1.0;
    }
    return any || k < end ? -1.0e9 : traced;
}

void store(uint x, uint y, float traced)
{
    FloatArray floats = FloatArray(push.slices + uint64_t(y * KILN_GPU_PATCH_FLOATS) * push.chunk.total * 4ul);
    const uint step = push.chunk.total;
    for (uint c = 0u; c < 3u; c++) {
        floats.at[c * step + x] = incident[c].high + incident[c].low;
        floats.at[(3u + c) * step + x] =
            HAS_SMOOTH != 0u ? irradiance[c].high + irradiance[c].low : incident[c].high + incident[c].low;
    }
    floats.at[6u * step + x] = row.high + row.low;
    floats.at[7u * step + x] = traced;
}

void kiln_kernel(uint x, uint y)
{
    const uint index = push.chunk.first + x, y_row = push.row_first + y;
    if (x >= push.chunk.count || y_row * push.nodes_a_row >= push.nodes ||
        (WordArray(push.chunk.states).at[index] & KILN_GPU_STATE_MASK) == KILN_GPU_STATE_INVALID)
        return;
    const kiln_gpu_point p = PointArray(push.chunk.points).at[index];
    own = OwnPatches(push.points).at[x];
    soft = kiln_shading(p, own.normal);
    smooth_point = HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u;
    row = kiln_sum(0.0, 0.0);
    for (uint c = 0u; c < 3u; c++)
        incident[c] = irradiance[c] = kiln_sum(0.0, 0.0);
    const uint begin = y_row * push.nodes_a_row;
    store(x, y_row, go_through(begin, min(push.nodes, begin + push.nodes_a_row)));
}

#include "shaders/main.glsl"
