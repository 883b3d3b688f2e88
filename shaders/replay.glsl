/* The gather pass from rows (shaders/shared/rows.h): hits of rays are read instead of traced, for LIGHTS lights at
 * once, which share one read of the rows. For each light the sums equal those of gather.glsl and gather_reduce.glsl, in
 * the same order: floats within a slice, and pairs of floats over slices, which stay in the registers of one thread.
 *
 * Neighbouring threads process the same point under neighbouring lights, whose radiosity is interleaved: that of point
 * i under light l is pair i * LIGHTS_THERE + l of push.lights; row y of threads has lights from y * LIGHTS on. A
 * workgroup has POINTS points and reads RAYS words of each at a time. The including file defines put_answer, which uses
 * the answer of point x under a light. It may define LIGHTS_THERE, and ROW_POINTS, a bound below which words are
 * surface points. */
#ifndef LIGHTS_THERE
#    define LIGHTS_THERE LIGHTS
#    define ROW_POINTS KILN_ROW_POINTS
#endif
#extension GL_EXT_control_flow_attributes : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/shared/rows.h"
#include "shaders/shared/streams.h"
#include "shaders/radiosity.glsl"

KILN_PUSH(kiln_gpu_replay_push);
layout(constant_id = 6) const uint LIGHTS = 1u;

const uint LANES = KILN_ROW_LANES(LIGHTS);
const uint THREADS = 64u, POINTS = THREADS / LANES, RAYS = 16u;
const uint ROUNDS = POINTS * RAYS / THREADS;

const uint TINTED_FLOATS = KILN_GPU_SLICE_FLOATS, MOST_FLOATS = KILN_GPU_SLICE_FLOATS, LUMINANCE = 8u;
#include "shaders/totals.glsl"
#include "shaders/gather_answer.glsl"

void put_answer(uint x, uint light, kiln_gpu_result r);

KILN_ARRAY(PointArray, kiln_gpu_point, 8);
KILN_ARRAY(WordArray, uint, 4);
KILN_ARRAY(WeightArray, vec2, 4);
KILN_ARRAY(RadiosityWords, uvec2, 8);

/* Ray i of the workgroup's point p is at p * ROW + i: threads that run together access different banks. */
const uint ROW = RAYS + 1u;
shared uint words[POINTS * ROW];
shared vec2 weights[HAS_SMOOTH != 0u ? POINTS * ROW : 1u];

uint state_of(uint x)
{
    return x < push.chunk.total ? WordArray(push.chunk.states).at[push.chunk.origin + x] & KILN_GPU_STATE_MASK
                                : KILN_GPU_STATE_INVALID;
}

/* Per point of the workgroup: not 0 if it has smooth normals; and whether any point has. */
shared uint smooth_points[HAS_SMOOTH != 0u ? POINTS : 1u];
shared uint any_smooth;

void find_smooth(uint first)
{
    const uint p = gl_LocalInvocationID.x, x = first + p;
    if (HAS_SMOOTH == 0u)
        return;
    if (p == 0u)
        any_smooth = 0u;
    barrier();
    if (p < POINTS && state_of(x) != KILN_GPU_STATE_INVALID) {
        smooth_points[p] = PointArray(push.chunk.points).at[push.chunk.origin + x].flags & KILN_GPU_POINT_SMOOTH;
        if (smooth_points[p] != 0u)
            any_smooth = 1u;
    }
}

vec2 weights_of(uint p, uint x, uint k)
{
    return smooth_points[p] != 0u ? WeightArray(push.weights + uint64_t(x) * uint64_t(8u * push.samples)).at[k]
                                  : vec2(1.0);
}

/* Reads samples [from, from + RAYS) of the workgroup's points; the first is point `first` of the chunk. Each row begins
 * with a word for the host only. Words in rows of invalid points are never used. */
void bring_rays(uint first, uint from)
{
    const uint some = min(ROUNDS, 4u);
    for (uint round = 0u; round < ROUNDS; round += some) {
        uint word[4];
        [[unroll]] for (uint j = 0u; j < 4u; j++)
        {
            const uint e = (round + j) * THREADS + gl_LocalInvocationID.x, x = first + e / RAYS, k = from + e % RAYS;
            if (j < some && x < push.chunk.total && k < push.samples)
                word[j] = WordArray(push.rows + uint64_t(x) * uint64_t(4u * (1u + push.samples))).at[1u + k];
        }
        [[unroll]] for (uint j = 0u; j < 4u; j++)
        {
            const uint e = (round + j) * THREADS + gl_LocalInvocationID.x, p = e / RAYS, k = from + e % RAYS;
            if (j >= some)
                continue;
            words[p * ROW + e % RAYS] = word[j];
            if (HAS_SMOOTH != 0u && any_smooth != 0u && first + p < push.chunk.total && k < push.samples)
                weights[p * ROW + e % RAYS] = weights_of(p, first + p, k);
        }
    }
}

/* The present slice, and the sums over earlier slices. */
struct Sums {
    float slice[MOST_FLOATS];
    kiln_sum sums[MOST_FLOATS], quarter;
    float quarters[4];
    uint q, end, quarter_end; /* the samples at which the slice and its quarter end */
    bool good;
};

void begin_slice(inout Sums s)
{
    [[unroll]] for (uint c = 0u; c < MOST_FLOATS; c++)
        s.slice[c] = 0.0;
}

void begin_quarter(inout Sums s, uint slice)
{
    s.quarter = kiln_sum(0.0, 0.0);
    s.quarter_end = kiln_quarter_first(s.q + 1u, push.samples);
    s.end = min(s.quarter_end, kiln_quarter_first(s.q, push.samples) + slice);
}

/* Ends the slice that ends at sample s.end, and its quarter if that ends too; skips quarters without samples. */
void end_slice(inout Sums s, uint slice)
{
    [[unroll]] for (uint c = 0u; c < MOST_FLOATS; c++)
    {
        if (HAS_SMOOTH != 0u || c < 3u || c >= 6u)
            kiln_add(s.sums[c], s.slice[c]);
    }
    kiln_add(s.quarter, s.slice[LUMINANCE]);
    begin_slice(s);
    if (s.end < s.quarter_end) {
        s.end = min(s.quarter_end, s.end + slice);
        return;
    }
    s.quarters[0] = s.q == 0u ? float_of(s.quarter) : s.quarters[0];
    s.quarters[1] = s.q == 1u ? float_of(s.quarter) : s.quarters[1];
    s.quarters[2] = s.q == 2u ? float_of(s.quarter) : s.quarters[2];
    s.quarters[3] = s.q == 3u ? float_of(s.quarter) : s.quarters[3];
    do {
        s.q++;
        begin_quarter(s, slice);
    } while (s.q < 4u && kiln_quarter_first(s.q, push.samples) == s.quarter_end);
}

/* Hit of a ray of the thread's point, and the radiosity there. Behind the last ray: no hit. */
struct Ray {
    uint word;
    uvec2 packed; /* radiosity of the hit under the thread's light */
    vec2 weight;
};

Ray ray_of(uint i, bool there, uint64_t lights)
{
    Ray ray;
    ray.word = there ? words[i] : KILN_ROW_NO_POINT;
    ray.weight = HAS_SMOOTH != 0u && any_smooth != 0u && there ? weights[i] : vec2(1.0);
    const bool sends = ray.word < ROW_POINTS && ray.weight.x > 0.0;
    ray.packed = RadiosityWords(lights + uint64_t(sends ? ray.word : 0u) * uint64_t(8u * LIGHTS_THERE)).at[0];
    ray.packed = sends ? ray.packed : uvec2(0u);
    return ray;
}

void add_ray(inout Sums s, Ray ray)
{
    const vec3 rgb = kiln_radiosity_unpack(ray.packed);
    if (HAS_SMOOTH != 0u)
        s.good = s.good && !(ray.weight.x < 0.0);
    [[unroll]] for (uint c = 0u; c < 3u; c++)
    {
        s.slice[c] += ray.weight.x * rgb[c];
        if (HAS_SMOOTH != 0u)
            s.slice[3u + c] += ray.weight.y * rgb[c];
    }
    s.slice[6] += ray.word == KILN_ROW_ESCAPED ? ray.weight.x : 0.0;
    s.slice[7] += ray.word == KILN_ROW_BLOCKED ? ray.weight.x : 0.0;
    s.slice[LUMINANCE] += ray.weight.y * float_luminance(rgb);
}

/* Adds samples [from, from + RAYS) of the workgroup's point p, under the light whose radiosity begins at `lights`. The
 * next slice ends after sample `from`. Four rays are loaded at a time. */
void add_rays(inout Sums s, uint p, uint64_t lights, uint from, uint slice)
{
    const uint to = min(from + RAYS, push.samples);
    for (uint k = from; k < to;) {
        const uint until = min(to, s.end);
        for (; k < until; k += 4u) {
            const uint i = p * ROW + k - from;
            const Ray a = ray_of(i, true, lights), b = ray_of(i + 1u, k + 1u < until, lights),
                      c = ray_of(i + 2u, k + 2u < until, lights), d = ray_of(i + 3u, k + 3u < until, lights);
            add_ray(s, a);
            add_ray(s, b);
            add_ray(s, c);
            add_ray(s, d);
        }
        k = until;
        if (k == s.end)
            end_slice(s, slice);
    }
}

/* Makes the answer of point x from its sums. */
kiln_gpu_result answer_of(Sums s, uint x)
{
    Totals totals;
    [[unroll]] for (uint c = 0u; c < MOST_FLOATS; c++)
        totals.sum[c] = float_of(s.sums[HAS_SMOOTH == 0u && c >= 3u && c < 6u ? c - 3u : c]);
    totals.quarters = s.quarters;
    if (!s.good || s.q < 4u)
        totals.sum[6] = -1.0e9;
    return gather_answer(totals, push.samples, PointArray(push.chunk.points).at[push.chunk.origin + x].present);
}

void kiln_kernel(uint thread, uint y)
{
    const uint p = gl_LocalInvocationID.x / LANES, lane = gl_LocalInvocationID.x % LANES, light = y * LIGHTS + lane,
               first = thread / THREADS * POINTS, x = first + p, state = state_of(x);
    const bool there = lane < LIGHTS && light < LIGHTS_THERE;
    const uint slice = state == KILN_GPU_STATE_BURIED ? push.slice / push.split : push.slice;
    Sums s;
    begin_slice(s);
    [[unroll]] for (uint c = 0u; c < MOST_FLOATS; c++)
        s.sums[c] = kiln_sum(0.0, 0.0);
    s.quarters = float[4](0.0, 0.0, 0.0, 0.0);
    s.q = 0u;
    s.good = true;
    begin_quarter(s, slice);
    find_smooth(first);
    for (uint from = 0u; from < push.samples; from += RAYS) {
        barrier();
        bring_rays(first, from);
        barrier();
        if (state != KILN_GPU_STATE_INVALID && there)
            add_rays(s, p, push.lights + uint64_t(8u * light), from, slice);
    }
    if (x >= push.chunk.total || !there)
        return;
    kiln_gpu_result r = no_answer();
    if (state != KILN_GPU_STATE_INVALID)
        r = answer_of(s, x);
    put_answer(x, light, r);
}

#include "shaders/main.glsl"
