/* Paths from surface points (worker/pass/reference.h): their beginning and end, in stages; thread x: the path in its
 * slot. Sample number `sampled` of the point begins as in the gather pass, and stores the point as a vertex for
 * connections and merging. At the end its light is added to the point's sums, sample after sample. Directions, random
 * numbers and estimators equal those of worker/backend/embree/reference.c. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/sum.glsl"

KILN_PUSH(kiln_gpu_both_push);

layout(constant_id = 6) const uint METHOD = 23u; /* KILN_GPU_BOTH_...: what the method does */
const bool POINTS = true, MERGES = (METHOD & KILN_GPU_BOTH_MERGES) != 0u, ALONE = (METHOD & KILN_GPU_BOTH_ALONE) != 0u;

#include "shaders/bidirectional.glsl"
#include "shaders/subpaths.glsl"
#include "shaders/position.glsl"
#include "shaders/hemisphere_ray.glsl"
#include "shaders/point_ends.glsl"

KILN_ARRAY(PointSums, kiln_gpu_point_sums, 4);

/* A position on the point, and two random numbers for a direction from there. */
struct Start {
    vec3 position, normal;
    float u, v;
};

float number_of(uint dimension, uint k, uint seed, uint shift)
{
    const uint word = WordArray(POINTS_THERE.sobol).at[dimension * POINTS_THERE.sobol_stride + k];
    return kiln_unit_float(kiln_owen_scramble(word, seed) ^ shift);
}

/* As shaders/hemisphere.glsl. */
Start start_of(kiln_gpu_point p, uint k)
{
    const uint stream = POINTS_THERE.stream, key = kiln_hash2(p.key, stream),
               shared_digits = kiln_shared_digits(POINTS_THERE.samples);
    const bool shares = hemisphere_shares(p);
    const uint place = shares ? k / POINTS_THERE.reuse : k;
    float number[4];
    for (uint d = 0u; d < 4u; d++) {
        const uint shift = d < 2u ? kiln_direction_shift(key, d, shared_digits) : kiln_gather_shift(key, d);
        number[d] = number_of(d, d < 2u ? k : place, kiln_gather_seed(p.tile_key, stream, d), shift);
    }
    Start s;
    s.u = number[0];
    s.v = number[1];
    float offset;
    kiln_position(p, POINTS_THERE.parts, number[2], number[3], s.position, s.normal, offset);
    return s;
}

/* Whether light paths may land on the point. */
bool lands_on(kiln_gpu_point p)
{
    if ((p.flags & KILN_GPU_POINT_RECEIVES_ONLY) != 0u)
        return false;
#ifdef KILN_GLOSS
    if ((p.flags & KILN_GPU_POINT_GLOSS) != 0u)
        return PointGlossArray(POINTS_THERE.parts + uint64_t(p.first_piece - KILN_GPU_POINT_GLOSS_PIECES) * 56ul)
                   .at[0]
                   .matt > 0.0;
#endif
    return true;
}

void leave_vertex(uint slot, Start s, vec3 axis, bool lands)
{
    kiln_gpu_eye_vertex e;
    e.position = s.position;
    e.from = axis;
    e.normal = s.normal;
    e.weight = float[3](1.0, 1.0, 1.0);
    e.vcm = 0.0;
    e.vc = 0.0;
    e.vm = 0.0;
    e.u = 0.0;
    e.v = 0.0;
    e.triangle = 0u; /* there is a vertex */
    e.surface = 0u;
    e.bounces = 1u;
    e.faces = 1u;
    e.lift = 0.0;
    e.vertex = KILN_GPU_NONE;
    if (!ALONE)
        e.vertex = BothWords(BOTH.last + 4ul * (uint(push.pixel + slot) - push.first)).at[0];
    e.cell = MERGES && lands ? 0u : 8u;
    e.photon = 0u;
    e.photon_end = 0u;
    EYE_VERTEX(slot) = e;
}

/* Sends the ray to the path's surface number 1. */
void send(uint slot, Start s, vec3 direction, float density, bool lands)
{
    kiln_path_sums sums = sums_of(0.0, 0.0, 0.0);
    kiln_path_leave(path_techniques(), sums, real(dot(s.normal, direction)), real(density), real(0), false);
    kiln_gpu_subpath path;
    path.origin = s.position;
    path.direction = direction;
    path.weight = float[3](1.0, 1.0, 1.0);
    path.vcm = float(sums.vcm);
    path.vc = lands ? float(sums.vc) : 0.0;
    path.vm = lands ? float(sums.vm) : 0.0;
    path.before = s.position;
    path.before_normal = s.normal;
    path.surface = 1u;
    path.bounces = 1u;
    path.chain = 0u;
    path.last_diffuse = 0u;
    path.last = KILN_GPU_NONE;
    path.body = KILN_GPU_NONE;
    path.scale = 1.0;
    path.triangle = KILN_GPU_NONE;
    path.u = 0.0;
    path.v = 0.0;
    path.distance = 0.0;
    path.tint = float[3](1.0, 1.0, 1.0);
    path.lift = 0.0;
    SUBPATH(slot) = path;
}

void init_from_point(uint slot, uint point)
{
    const kiln_gpu_point p = LitPoints(POINTS_THERE.points).at[point];
    const Start s = start_of(p, push.sampled - POINTS_THERE.first_sample);
    const HemisphereRay ray = hemisphere_ray(p, s.normal, s.u, s.v);
    const bool lands = lands_on(p);
    float taken_up = 1.0;
#ifdef KILN_GLOSS
    taken_up = kiln_taken_up(p, POINTS_THERE.parts, ray.shading);
#endif
    kiln_gpu_point_path of;
    of.shading = kiln_shading(p, s.normal);
    of.axis = ray.axis;
    of.point = point;
    of.key = point_key(point);
    of.seed = kiln_gather_ray_seed(point_chance(point), push.sampled);
    of.irradiance = ray.weight * 3.14159265358979;
    of.incident = ray.facet * taken_up * 3.14159265358979;
    of.goes = ray.facet > 0.0 && ray.cosine > 0.0 ? 1u : 0u;
    POINT_PATH(slot) = of;
    leave_vertex(slot, s, ray.axis, lands);
    if (of.goes != 0u)
        send(slot, s, ray.direction, ray.cosine * KILN_INVERSE_PI, lands);
}

void clear(uint slot)
{
    for (uint k = 0u; k < SUM_WORDS; k++)
        BothWords(BOTH.radiance + 4ul * (SUM_WORDS * uint64_t(slot) + k)).at[0] = 0u;
    POINT_PATH(slot).goes = 0u;
    EYE_VERTEX(slot).triangle = KILN_GPU_NONE;
}

void add_number(inout kiln_gpu_point_sums to, uint number, float value)
{
    kiln_sum sum = kiln_sum(to.high[number], to.low[number]);
    kiln_add(sum, value);
    to.high[number] = sum.high;
    to.low[number] = sum.low;
}

void end(uint slot)
{
    PointSums all = PointSums(push.sums + 104ul * slot);
    kiln_gpu_point_sums to = all.at[0];
    for (uint n = 0u; n < 9u; n++)
        add_number(to, n, brought_to_sum(slot, n / 3u, n % 3u));
    const vec3 irradiance =
        vec3(brought_to_sum(slot, 0u, 0u), brought_to_sum(slot, 0u, 1u), brought_to_sum(slot, 0u, 2u));
    const uint quarter =
        uint(uint64_t(push.sampled - POINTS_THERE.first_sample) * 4ul / uint64_t(POINTS_THERE.samples));
    add_number(to, 9u + quarter, float_luminance(irradiance));
    all.at[0] = to;
}

/* Begins points: with DRAW_AGAIN those that are partly buried, otherwise all others. */
void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    const uint slot = slot_of(x), point = point_of(uint(push.pixel) + slot);
    const uint state = WordArray(POINTS_THERE.states).at[point] & KILN_GPU_STATE_MASK;
    if (push.stage == KILN_GPU_STAGE_END) {
        end(slot);
        return;
    }
    if (DRAW_AGAIN == 0u)
        clear(slot);
    if (state == (DRAW_AGAIN != 0u ? KILN_GPU_STATE_BURIED : KILN_GPU_STATE_VALID))
        init_from_point(slot, point);
    if (!still_loops(push.count))
        BothCounts(BOTH.counts).at[0].stopped = 1u;
}

#include "shaders/main.glsl"
