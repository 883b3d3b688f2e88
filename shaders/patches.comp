/* The patches pass: thread (x, y) processes row y of the nodes for point x. Neighbouring threads have neighbouring
 * points and the same nodes, which are read from the caches. Each thread searches for its next node that faces it
 * before a ray is traced, so that threads trace together. patches_reduce.comp sums up the rows. Visibility of pairs may
 * be known, or come from a grid (SIGHT).
 *
 * Computed in floats, except near nodes, whose factors are differences. */
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

layout(constant_id = 6) const uint SIGHT = 0u; /* KILN_GPU_SIGHT_... */

#include "shaders/sight.glsl"

#ifdef KILN_DOUBLES
#    define REAL_BYTES 8
#else
#    define REAL_BYTES 4
#endif

KILN_ARRAY(GridReals, real, REAL_BYTES);

/* The grid, for threads that read visibility from one. */
kiln_gpu_sight sight;
kiln_real3 grid_low;
real grid_scale;

#define KILN_VOXEL_GRID uint /* there is one */
#define KILN_VOXEL_LOW(grid) grid_low
#define KILN_VOXEL_SCALE(grid) grid_scale
#define KILN_VOXEL_COUNT(grid, axis) int(sight.n[KILN_VOXEL_AXIS_##axis])
#define KILN_VOXEL_AXIS_x 0
#define KILN_VOXEL_AXIS_y 1
#define KILN_VOXEL_AXIS_z 2
#define KILN_VOXEL_WORD(grid, i) Words(sight.words).at[i]

#include "shaders/shared/voxels.h"

const float NEAR = 8.0, FLAT = 9.5367431640625e-7; /* KILN_PATCHES_NEAR, KILN_PATCHES_FLAT */
const float PI = 3.14159265358979;

/* The point of the thread. */
kiln_gpu_patch own;
vec3 soft;         /* its shading normal */
bool smooth_point; /* its shading normal differs from the geometric one */

kiln_sum row, incident[3], irradiance[3];

/* A node that faces the point. */
struct Node {
    vec3 d;                      /* from the point to its centre */
    float cosine, other, square; /* cosines, each times the distance; squared distance */
    float area;
    vec3 normal, place, edge_s, edge_t, radiosity;
    uint number;
};

/* Mean of n.d / |d|^4 over a node, divided by |d|^-4 at its centre, to second order in the node's size. */
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

/* Whether a node must be integrated as a polygon: it is near, or crosses the horizon. */
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

/* Factors F of a node, about the geometric and about the shading normal. */
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

/* Adds the node's light, times the share `through` by colour. */
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

/* ---- what pairs see ---- */

const uint UNKNOWN = 0u, OPEN = KILN_GPU_PAIRS_OPEN, SHUT = KILN_GPU_PAIRS_SHUT, PARTIAL = KILN_GPU_PAIRS_PARTIAL;
const uint NO_WORD = 0xffffffffu;

/* Stored visibility of the point's tile run, and the present word of it: 32 columns. */
kiln_gpu_sight_run run;
uint point_in_chunk;
uint word, word_known, word_open, word_found, word_new, word_partial;
uint facing, known, traced; /* pairs of the row so far */

/* Stores the results of the present word. */
void leave_word()
{
    if (word == NO_WORD || word_found == 0u)
        return;
    Words words = Words(run.words);
    const uint found_at = kiln_found_at(sight.groups) + word / 2u;
    if (word_new != 0u)
        atomicOr(Words(kiln_open_word(push.open, word, push.chunk.total, point_in_chunk)).at[0], word_new);
    if ((words.at[found_at] & word_found) != word_found)
        atomicOr(words.at[found_at], word_found);
    if (word_partial != 0u)
        atomicOr(words.at[kiln_partial_at(sight.groups) + word], word_partial);
}

/* Returns the stored visibility of a pair that face each other: the point and node `number`. */
uint look(uint number)
{
    if (run.words == 0ul)
        return UNKNOWN;
    if (number / 32u != word) {
        leave_word();
        word = number / 32u;
        word_known = Words(run.words).at[word];
        word_open = Words(kiln_open_word(push.open, word, push.chunk.total, point_in_chunk)).at[0];
        word_found = word_new = word_partial = 0u;
    }
    const uint bit = 1u << number % 32u;
    return (word_known & bit) == 0u ? UNKNOWN : (word_open & bit) != 0u ? OPEN : SHUT;
}

/* Records the visibility found for the pair of the last call of look. */
void note(uint number, uint seen)
{
    const uint bit = 1u << number % 32u;
    word_found |= seen | KILN_GPU_PAIRS_NEW;
    word_new |= seen == OPEN ? bit : 0u;
    word_partial |= seen == PARTIAL ? bit : 0u;
}

/* Returns the visibility of a pair, from the grid. */
uint ask_grid(uint number, vec3 normal, vec3 place)
{
    const bool first = own.number < number;
    const kiln_real3 from = real3(first ? own.place : place), to = real3(first ? place : own.place);
    return kiln_voxel_lets_see(0u, from, real3(first ? own.normal : normal), to, real3(first ? normal : own.normal))
               ? OPEN
               : SHUT;
}

/* Returns the visibility of a pair that face each other, as far as it is known without a ray. */
uint sight_of(uint number, vec3 normal, uint k)
{
    uint seen = UNKNOWN;
    if (number == own.number)
        return SHUT;
    facing++;
    if ((SIGHT & KILN_GPU_SIGHT_KEPT) != 0u)
        seen = look(number);
    known += seen != UNKNOWN ? 1u : 0u;
    if ((SIGHT & KILN_GPU_SIGHT_VOXELS) != 0u && seen == UNKNOWN) {
        seen = ask_grid(number, normal, NodeQuads(push.shapes).at[3u * k].xyz);
        if ((SIGHT & KILN_GPU_SIGHT_KEPT) != 0u)
            note(number, seen);
    }
    return seen;
}

/* Traces the ray between the two points, from the one with the lower number, so that both points get the same result.
 * Returns the share of light let through; also 0 if the points coincide, and there is no ray. */
vec3 trace(Node node)
{
    const bool first = own.number < node.number;
    const vec3 from = first ? own.place : node.place, to = first ? node.place : own.place;
    const vec3 way = to - from;
    const float apart = sqrt(dot(way, way));
    if (!(apart > 0.0))
        return vec3(0.0);
    const vec3 through = kiln_through(from, way / apart, float(real(apart) * KILN_SHADOW_LENGTH));
    traced++;
    if ((SIGHT & KILN_GPU_SIGHT_KEPT) != 0u)
        note(node.number, through == vec3(0.0) ? SHUT : through == vec3(1.0) ? OPEN : PARTIAL);
    return through;
}

/* ---- nodes ---- */

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

/* Processes nodes k .. end-1. False: the device has ended the loop early. */
bool go_through(uint k, uint end)
{
    NodeQuads facings = NodeQuads(push.facing);
    const float coplanar = FLAT * SCENE.trace.extent;
    bool any = true;
    while (any) {
        vec4 centre_area, normal_number;
        uint seen = UNKNOWN;
        any = false;
        while (k < end && !any) {
            centre_area = facings.at[2u * k];
            normal_number = facings.at[2u * k + 1u];
            const vec3 d = centre_area.xyz - own.place;
            any = dot(own.normal, d) > coplanar && dot(normal_number.xyz, d) < -coplanar;
            if (any) {
                seen = sight_of(floatBitsToUint(normal_number.w), normal_number.xyz, k);
                any = seen != SHUT;
            }
            k++;
        }
        if (any) {
            const Node node = node_of(k - 1u, centre_area, normal_number);
            const vec3 through = seen == OPEN ? vec3(1.0) : trace(node);
            if (through != vec3(0.0))
                add_node(node, through);
        }
    }
    if ((SIGHT & KILN_GPU_SIGHT_KEPT) != 0u)
        leave_word();
    return !any && k >= end;
}

void store(uint x, uint y, bool good)
{
    FloatArray floats = FloatArray(push.slices + uint64_t(y * KILN_GPU_PATCH_FLOATS) * push.chunk.total * 4ul);
    const uint step = push.chunk.total;
    for (uint c = 0u; c < 3u; c++) {
        floats.at[c * step + x] = incident[c].high + incident[c].low;
        floats.at[(3u + c) * step + x] =
            HAS_SMOOTH != 0u ? irradiance[c].high + irradiance[c].low : incident[c].high + incident[c].low;
    }
    floats.at[6u * step + x] = row.high + row.low;
    floats.at[7u * step + x] =
        good ? float((facing * KILN_GPU_PAIRS_BASE + known) * KILN_GPU_PAIRS_BASE + traced) : -1.0e9;
}

void find_sight(uint x)
{
    sight = SightRef(push.sight).value;
    point_in_chunk = x;
    word = NO_WORD;
    if ((SIGHT & KILN_GPU_SIGHT_KEPT) != 0u)
        run = SightRuns(sight.runs).at[own.run];
    if ((SIGHT & KILN_GPU_SIGHT_VOXELS) != 0u) {
        GridReals reals = GridReals(sight.reals);
        grid_low = real3_make(reals.at[0], reals.at[1], reals.at[2]);
        grid_scale = reals.at[3];
    }
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
    if (SIGHT != 0u)
        find_sight(x);
    facing = known = traced = 0u;
    row = kiln_sum(0.0, 0.0);
    for (uint c = 0u; c < 3u; c++)
        incident[c] = irradiance[c] = kiln_sum(0.0, 0.0);
    const uint begin = y_row * push.nodes_a_row;
    store(x, y_row, go_through(begin, min(push.nodes, begin + push.nodes_a_row)));
}

#include "shaders/main.glsl"
