/* The bounce pass. Each thread computes a slice of a point's samples (hemisphere.glsl), a few cosine-distributed rays,
 * and sums up the radiosity that they find. gather_reduce.glsl sums up the slices. Variants by macro:
 *
 * KILN_GUIDED: the guided pass (guide.glsl). KILN_GLOSS: rays continue in chains (chain.glsl); those of the bounce pass
 * itself have a kernel of their own (gather_chains.glsl). KILN_GLOSS and KILN_CAUSTIC: the caustic pass, which looks
 * only for lamps and sky by chains. KILN_GLOSS and KILN_WEIGHED: the weighed pass, whose chains also have a kernel of
 * their own. KILN_KEEP: the gather pass of bakes that keep the hits of rays (kept_rows.glsl). KILN_DIRECTIONS: the
 * directions pass (directions.glsl); with KILN_BRIGHT also rays to bright patches (bright.glsl). */
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/shared/streams.h"

#ifdef KILN_GUIDED
KILN_PUSH(kiln_gpu_guided_push);
#    include "shaders/guide.glsl"
#    define NEAR_PROBES GuidedRef(push.guided).at[0].near_probes
#    define HEMISPHERE_RAY_DONE(k) guide_keep(k)
#    define GUIDE_BEGIN(index) guide_begin((index)-push.chunk.origin);
#elif defined(KILN_WEIGHED)
KILN_PUSH(kiln_gpu_weighed_push);
#    define PROBES push.both /* any address will do: the pass reads no probes */
#    define NEAR_PROBES push.both
#    define KILN_APART
#    define APART_RAY_BYTES KILN_GPU_APART_WEIGHED_RAY_BYTES
#    define GUIDE_BEGIN(index)                                                                                         \
        apart_begin(index);                                                                                            \
        point_area = AreaArray(push.areas).at[(index)-push.chunk.origin] * p.present;
void apart_begin(uint index);
float point_area; /* m2: area of the thread's point that can be lit */
KILN_ARRAY(AreaArray, float, 4);
#elif defined(KILN_KEEP)
KILN_PUSH(kiln_gpu_rows_push);
#    include "shaders/kept_rows.glsl"
#    define PROBES push.rows /* any address will do: such rays read no probes */
#    define NEAR_PROBES push.rows
#    define GUIDE_BEGIN(index) row_begin((index)-push.chunk.origin);
#    define HEMISPHERE_RAY_DONE(k) row_keep(k)
#elif defined(KILN_DIRECTIONS)
KILN_PUSH(kiln_gpu_directions_push);
uint set_sample;
#    define PROBES push.lights /* any address will do: such rays read no probes */
#    define NEAR_PROBES push.lights
#    ifdef KILN_BRIGHT
void bright_begin(uint x); /* bright.glsl */
uint bright_number(uint i);
uint bright_u, bright_v;
#        define GUIDE_BEGIN(index) bright_begin((index)-push.chunk.origin);
#        define HEMISPHERE_NUMBER(i) bright_number(i)
#        define HEMISPHERE_RAY(k)                                                                                      \
            set_sample = k;                                                                                            \
            bright_u = bits_u;                                                                                         \
            bright_v = bits_v
#    else
void set_begin(uint key); /* directions.glsl */
#        define GUIDE_BEGIN(index) set_begin(p.key);
#        define HEMISPHERE_RAY(k) set_sample = k
#    endif
#else
KILN_PUSH(kiln_gpu_gather_push);
#    define NEAR_PROBES push.near_probes
#    if defined(KILN_GLOSS) && !defined(KILN_CAUSTIC)
#        define KILN_APART
#        define APART_RAY_BYTES KILN_GPU_APART_RAY_BYTES
#        define GUIDE_BEGIN(index) apart_begin(index);
void apart_begin(uint index);
#    else
#        define GUIDE_BEGIN(index)
#    endif
#endif
#ifndef PROBES
#    define PROBES push.probes
#endif
#ifdef KILN_APART
uint apart_first, apart_sample, apart_point; /* gather_chains.glsl */
#    define APART_POINTS push.chunk.total
#    define APART_SAMPLES push.hemisphere.samples
#    define APART_ROWS (4u * push.hemisphere.per_quarter * push.hemisphere.row_step)
#    define APART_ROOM                                                                                                 \
        (push.hemisphere.slices + 4ul * (uint64_t(APART_ROWS) * SLICE_FLOATS) * uint64_t(APART_POINTS))
#    define HEMISPHERE_RAY(k) apart_sample = k
#endif

const uint TRACE_ONLY = 0u, SURFACES = 1u, SURFACES_AND_PROBES = 2u; /* work per ray; TRACE_ONLY is for benchmarks */
layout(constant_id = 6) const uint LOOKUP = SURFACES;

uint near_probes; /* of the thread's point */
#define HEMISPHERE_BEGIN(index)                                                                                        \
    GUIDE_BEGIN(index)                                                                                                 \
    if (LOOKUP == SURFACES_AND_PROBES)                                                                                 \
    near_probes = NearArray(NEAR_PROBES).at[index]
#define HEMISPHERE_SEEDS (LOOKUP == SURFACES_AND_PROBES)
KILN_ARRAY(NearArray, uint, 4);

#include "shaders/gather_sums.glsl"
#include "shaders/hemisphere.glsl"
#ifdef KILN_KEEP
/* Returns the ray's hit as a word of its row. */
uint row_word_of(kiln_hit hit)
{
    if (hit.triangle == KILN_GPU_NONE)
        return KILN_ROW_ESCAPED;
    const kiln_store_way to = kiln_store_enter(hit.triangle, hit.u, hit.v, hit.back);
    if (hit.back && (to.material & KILN_RECORD_DOUBLE_SIDED) == 0u)
        return KILN_ROW_BLOCKED;
    uint64_t point;
    return kiln_store_point(to, point) ? uint(point) : KILN_ROW_NO_POINT;
}
#endif
#include "shaders/radiance_probes.glsl"
#ifdef KILN_BRIGHT
#    include "shaders/bright.glsl"
#elif defined(KILN_DIRECTIONS)
#    include "shaders/directions.glsl"
#endif
#ifdef KILN_GLOSS
#    ifndef KILN_CAUSTIC
#        define KILN_CHAIN_RADIOSITY
#    elif !defined(KILN_APART)
#        define KILN_WALK_LIGHTS
#    endif
#    include "shaders/chain.glsl"
#    include "shaders/taken_up.glsl"
#endif
#if defined(KILN_APART) || (defined(KILN_GLOSS) && !defined(KILN_CAUSTIC))
#    include "shaders/gather_chains.glsl"
#endif

/* Nearest hit of a ray; if the point sees probes, within their range. */
kiln_hit nearest(vec3 position, vec3 direction, uint seed, out vec3 tint)
{
    if (LOOKUP != SURFACES_AND_PROBES || (near_probes & KILN_PROBE_SEEN) == 0u)
        return kiln_trace_by_chance(position, direction, seed, tint);
    const float range = ProbesRef(PROBES).value.grid.range;
    tint = vec3(1.0);
    if (range > 0.0)
        return kiln_trace_within(position, direction, range, seed, tint);
    return kiln_hit(KILN_GPU_NONE, 0.0, 0.0, 0.0, false);
}

#ifdef KILN_APART
bool apart_left; /* the present ray has met gloss, and its chain is followed later */

void apart_begin(uint index)
{
    apart_first = KILN_GPU_NONE;
    apart_point = index - push.chunk.origin;
}

/* Stores the chain of the present ray for follow.glsl. */
void apart_leave(vec3 direction, kiln_hit hit, vec3 tint, float facet, float weight)
{
    const uint64_t kept = apart_ray(apart_sample, apart_point);
    const kiln_gpu_apart_ray ray =
        kiln_gpu_apart_ray(direction, hit.triangle | (hit.back ? KILN_GPU_BOTH_BACK : 0u), hit.u, hit.v, hit.distance,
                           float[3](tint.r, tint.g, tint.b), facet, weight, ray_taken_up, ray_chance, ray_number);
#    ifdef KILN_WEIGHED
    ApartWeighedRays(kept).at[0] = kiln_gpu_apart_weighed_ray(ray, point_area);
#    else
    ApartRays(kept).at[0] = ray;
#    endif
    const uint place = atomicAdd(APART_COUNT, 1u);
    ApartWords(apart_list()).at[place] = apart_sample * APART_POINTS + apart_point;
    apart_left = true;
}
#elif defined(KILN_GLOSS)
/* Adds the result of a ray at whose hit a chain begins. */
void add_chain(inout Sums sums, vec3 direction, kiln_hit hit, vec3 tint, float facet, float weight)
{
    const Chain c = chain_follow(ray_chance, ray_number, direction, hit);
    chains_good = chains_good && c.good;
#    ifdef KILN_CAUSTIC
    add_light(sums, 3.14159265358979 * c.light, tint, facet, weight);
    sums.glass = vec3(0.0);
#    else
    add_found(sums, c, tint, facet, weight);
#    endif
}
#endif

#ifdef KILN_APART /* result of a ray, except for the light of its chain */
#    define ADD_RAY find_ray
#else
#    define ADD_RAY add_ray
#endif
void ADD_RAY(inout Sums sums, kiln_gpu_point p, vec3 position, vec3 normal, float u, float v, uint seed)
{
    const bool smooth_point = HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u;
    const vec3 soft = kiln_shading(p, normal);
    vec3 axis = normal;
    float tilt = 1.0;
    if (smooth_point) {                  /* half-way: see kiln_facet_weight */
        const vec3 both = normal + soft; /* 0 where the triangle is too small to have a normal */
        axis = both == vec3(0.0) ? both : normalize(both);
        tilt = dot(normal, axis);
    }
#ifdef KILN_GUIDED
    guide_direction(u, v);
#endif
    float cosine;
#ifdef KILN_BRIGHT
    const vec3 direction = set_direction(axis, position, u, v, cosine);
    if (!leads)
        return;
#elif defined(KILN_DIRECTIONS)
    const vec3 direction = set_direction(axis, u, v, cosine);
#else
    const vec3 direction = hemisphere_cosine(axis, u, v, cosine);
#endif
    vec3 tint;
    const kiln_hit hit = nearest(position, direction, seed, tint);
    if (LOOKUP == TRACE_ONLY) {
        sums.escaped += hit.triangle == KILN_GPU_NONE ? 1.0 : hit.u;
        return;
    }
    float facet = 1.0, weight = 1.0;
    if (smooth_point) {
        facet = kiln_facet_weight(dot(normal, direction), tilt, cosine);
        weight = kiln_shading_weight(dot(soft, direction), cosine);
    }
#ifdef KILN_GUIDED
    facet *= guide_weight;
    weight *= guide_weight;
#endif
#ifdef KILN_DIRECTIONS
    const float whole_facet = facet, whole_weight = weight;
    facet *= set_weight;
    weight *= set_weight;
#endif
#ifdef KILN_GLOSS
    ray_taken_up = kiln_taken_up(p, push.chunk.parts, smooth_point ? dot(soft, direction) : cosine);
    if (hit.triangle != KILN_GPU_NONE && facet > 0.0 && chain_begins(hit)) { /* not from below the facet */
#    ifdef KILN_APART
        apart_leave(direction, hit, tint, facet, weight);
#    else
        add_chain(sums, direction, hit, tint, facet, weight);
#    endif
        return;
    }
#endif
#ifdef KILN_CAUSTIC
    return;
#endif
    if (LOOKUP == SURFACES_AND_PROBES && hit.triangle == KILN_GPU_NONE && (near_probes & KILN_PROBE_SEEN) != 0u) {
        const kiln_probe_grid grid = ProbesRef(PROBES).value.grid;
        const float far = kiln_probe_far(grid, position, direction);
        if (far > grid.range) {
            const uint probe = kiln_probe_of_ray(PROBES, near_probes, position, direction, seed);
            const vec3 radiance = facet > 0.0 ? kiln_probe_ask(PROBES, probe, position, direction, far) : vec3(0.0);
            add_light(sums, 3.14159265358979 * radiance, tint, facet, weight);
            return;
        }
    }
#ifdef KILN_KEEP
    row_word = row_word_of(hit);
    row_weights = vec2(facet, weight);
#endif
    if (hit.triangle == KILN_GPU_NONE) {
        sums.escaped += facet;
        return;
    }
    const kiln_store_way to = kiln_store_enter(hit.triangle, hit.u, hit.v, hit.back);
    if (hit.back && (to.material & KILN_RECORD_DOUBLE_SIDED) == 0u) {
        sums.blocked += facet;
        return;
    }
#ifdef KILN_DIRECTIONS
    uint64_t point;
    const bool sends = whole_facet > 0.0 && kiln_store_point(to, point);
    const vec3 found = sends ? kiln_radiosity_unpack(RadiosityWords(push.lights + point * 8ul).at[0]) : vec3(0.0);
#    ifdef KILN_BRIGHT
    if (sends)
        bright_weigh(uint(point), position, direction, cosine);
    add_light(sums, bright.scale * found, tint, whole_facet * set_weight, whole_weight * set_weight);
#    else
    add_light(sums, set_scale * found, tint, facet, weight);
#    endif
#else
    add_light(sums, facet > 0.0 ? kiln_store_radiosity(to) : vec3(0.0), tint, facet, weight);
#endif
}

#ifdef KILN_APART
/* From the first ray of the slice that meets gloss, results of rays are stored, and summed up later. */
void add_ray(inout Sums sums, kiln_gpu_point p, vec3 position, vec3 normal, float u, float v, uint seed)
{
    Sums found = NO_SUMS;
    const uint before = apart_first;
    apart_left = false;
    find_ray(found, p, position, normal, u, v, seed);
    if (apart_left)
        apart_first = min(before, apart_sample);
    else if (before != KILN_GPU_NONE)
        apart_keep(apart_ray(apart_sample, apart_point), found);
    else
        add_sums(sums, found);
}
#endif

void after_rays(inout Sums sums, kiln_gpu_point p, uint row, bool good)
{
#ifdef KILN_GLOSS
    good = good && chains_good;
#endif
    if (!good)
        sums.escaped = SUMS_NOT_GOOD;
}

void store(Sums sums, uint x, uint row)
{
#ifdef KILN_APART
    if (LOOKUP != TRACE_ONLY)
        ApartWords(apart_slice(row * push.hemisphere.row_step, x)).at[0] = apart_first;
#endif
    FloatArray floats = hemisphere_floats(row, SLICE_FLOATS);
    const uint step = push.chunk.total;
    for (uint c = 0u; c < 3u; c++) {
        floats.at[c * step + x] = sums.incident[c];
        floats.at[(3u + c) * step + x] = STORES_BOTH ? sums.irradiance[c] : sums.incident[c];
    }
    floats.at[6u * step + x] = sums.escaped;
    floats.at[7u * step + x] = sums.blocked;
    floats.at[8u * step + x] = sums.luminance;
    for (uint c = 0u; c < 3u && HAS_ALPHA >= KILN_PASSAGE_TINT; c++)
        floats.at[(9u + c) * step + x] = sums.glass[c];
#if defined(KILN_GLOSS) && !defined(KILN_CAUSTIC)
    for (uint c = 0u; c < 3u; c++)
        floats.at[(TINTED_FLOATS + c) * step + x] = sums.gloss[c];
#endif
}

#include "shaders/main.glsl"
