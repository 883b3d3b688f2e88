/* Paths of the bidirectional pass while they are in progress. Each has a slot. Several kernels one after the other do
 * the steps that the next surface needs, for all slots (Laine, Karras and Aila, "Megakernels considered harmful",
 * 2013). worker/backend/vulkan/bidirectional.h has the order of the kernels.
 *
 *   path_rays.comp      traces rays to surfaces; traces shadow rays, and adds the light let through
 *   light_paths.comp    light paths: begin, arrive at surfaces, store vertices, continue
 *   eye_paths.comp      camera paths: begin, arrive, sample lights, continue, end
 *   path_pairs.comp     finds light vertices to connect with a path's vertex, and photons to merge with it
 *   path_connect.comp, path_merge.comp, path_splat.comp   connect or merge one pair per thread; connect light to the
 * camera
 *   point_paths.comp    paths of surface points: begin, end
 *   land.comp, land_first.comp, land_on.comp   light paths that land (shaders/land.glsl)
 *
 * With POINTS paths begin at surface points (worker/pass/reference.h), and point_paths.comp replaces the camera: the
 * point is vertex 0 of its path, and its bounce is already counted.
 *
 * Including kernels define POINTS before, by their own specialisation constant. Needs shaders/bidirectional.glsl
 * before. */
#ifndef KILN_SHADERS_SUBPATHS_GLSL
#define KILN_SHADERS_SUBPATHS_GLSL

#include "shaders/shared/layout_land_real.h"

KILN_ARRAY(Subpaths, kiln_gpu_subpath, 4);
KILN_ARRAY(EyeVertices, kiln_gpu_eye_vertex, 4);
KILN_ARRAY(Pairs, kiln_gpu_both_pair, 4);
KILN_ARRAY(ShadowRays, kiln_gpu_shadow_ray, 4);
KILN_ARRAY(Tallies, kiln_gpu_both_tally, 4);
KILN_ARRAY(Photons, kiln_gpu_photon, 4);
KILN_ARRAY(BothPoints, kiln_gpu_both_points, 8);
KILN_ARRAY(PointPaths, kiln_gpu_point_path, 4);
KILN_ARRAY(PointRays, kiln_gpu_point_ray, 4);
KILN_ARRAY(LitPoints, kiln_gpu_point, 8);
KILN_ARRAY(LandPaths, kiln_gpu_land_path, 8);

#define SUBPATH(slot) Subpaths(BOTH.subpaths + 132ul * (slot)).at[0]
#define EYE_VERTEX(slot) EyeVertices(BOTH.eyes + 104ul * (slot)).at[0]
#define LAND_PATH(slot) LandPaths(BOTH.lands).at[slot]
#define LIGHT_VERTEX(number) LightVertices(BOTH.vertices + 80ul * (number)).at[0]
#define SHADOW_RAY(number) ShadowRays(BOTH.shadows + 48ul * (number)).at[0]
#define TALLY Tallies(push.tally).at[0]
#define POINTS_THERE BothPoints(BOTH.points).at[0]
#define POINT_PATH(slot) PointPaths(POINTS_THERE.paths + 48ul * (slot)).at[0]
#define POINT_RAY(number) PointRays(POINTS_THERE.rays + 20ul * (number)).at[0]

bool halts(uint64_t word) { return word != 0ul && BothWords(word).at[0] != 0u; }

/* Whether thread x has a path to process. */
bool has_work(uint x)
{
    return x < push.count && (push.counter == 0ul || push.offset + x < BothWords(push.counter).at[0]) &&
           !halts(push.halts[0]) && !halts(push.halts[1]);
}

/* The slot of thread x. */
uint slot_of(uint x)
{
    const uint number = push.offset + x;
    return push.list == 0ul ? number : BothWords(push.list + 4ul * number).at[0];
}

void go_onward(uint slot)
{
    const uint place = atomicAdd(TALLY.paths, 1u);
    BothWords(push.onward + 4ul * place).at[0] = slot;
}

/* Key of the random numbers of a pixel's paths. */
uint pixel_key(uint64_t pixel) { return kiln_hash2(kiln_hash2(push.seed, uint(pixel)), uint(pixel >> 32)); }

/* Index in the block of a point of the batch. */
uint point_of(uint number) { return POINTS_THERE.origin + number; }

bool point_is_there(uint point)
{
    return (BothWords(POINTS_THERE.states + 4ul * point).at[0] & KILN_GPU_STATE_MASK) != KILN_GPU_STATE_INVALID;
}

/* Key of random decisions along a point's rays, and key of its paths' random numbers. */
uint point_chance(uint point)
{
    return kiln_gather_chance(kiln_hash2(LitPoints(POINTS_THERE.points).at[point].key, POINTS_THERE.stream));
}
uint point_key(uint point) { return kiln_hash1(point_chance(point) + KILN_REFERENCE_LIGHT_SEED); }

/* Selects the random numbers of the path in a slot: a light path, a path that lands, or a path of the camera or a
 * surface point. */
void draw_for_light(uint slot)
{
    const bool own = POINTS && push.light == KILN_GPU_OF_LIGHT_OWN;
    walk_key = own ? kiln_hash2(point_key(point_of(push.path + slot)), POINTS_THERE.light_seed) : push.light_key;
    walk_sample = own ? push.sampled : push.path + slot;
}
void draw_for_landing(uint slot)
{
    walk_key = LAND_PATH(slot).key;
    walk_sample = LAND_PATH(slot).number;
}
void draw_for_eye(uint slot)
{
    walk_key = POINTS ? POINT_PATH(slot).key : pixel_key(push.pixel + slot);
    walk_sample = push.sampled;
}

vec3 vec3_in(float of[3]) { return vec3(of[0], of[1], of[2]); }
float[3] floats_of(vec3 of) { return float[3](of.x, of.y, of.z); }
kiln_path_sums sums_of(float vcm, float vc, float vm) { return kiln_path_sums(real(vcm), real(vc), real(vm)); }

kiln_hit hit_of(uint triangle, float u, float v, float distance)
{
    kiln_hit hit;
    hit.triangle = triangle == KILN_GPU_NONE ? KILN_GPU_NONE : triangle & ~KILN_GPU_BOTH_BACK;
    hit.back = triangle != KILN_GPU_NONE && (triangle & KILN_GPU_BOTH_BACK) != 0u;
    hit.u = u;
    hit.v = v;
    hit.distance = distance;
    return hit;
}

/* Requests a shadow ray of length `limit`, and returns its index. There is room for the rays of a dispatch. */
uint ask_shadow(vec3 origin, vec3 direction, float limit, vec3 brings, uint to, uint chance)
{
    const uint place = atomicAdd(TALLY.shadows, 1u);
    SHADOW_RAY(place) = kiln_gpu_shadow_ray(origin, direction, limit, floats_of(brings), to, chance);
    return place;
}

/* Light with counted diffuse events: all of it, and with POINTS the part with the largest number of events allowed. */
struct Counted {
    vec3 all, last;
};

/* As scatter_product. */
Counted counted_product(Scatter a, bool counts, vec3 b_all, vec3 b_diffuse, int allowed)
{
    Counted c = Counted(scatter_product(a, counts, b_all, b_diffuse, allowed), vec3(0.0));
    if (POINTS)
        c.last = c.all - scatter_product(a, counts, b_all, b_diffuse, allowed - 1);
    return c;
}

/* Weights at the surface point for light along the first ray of the path in a slot. */
vec2 point_counts(uint slot)
{
    return POINTS ? vec2(POINT_PATH(slot).irradiance, POINT_PATH(slot).incident) : vec2(0.0);
}

/* ask_shadow, for light to the path in a slot. `counts`: with POINTS, weights by point_counts or for another direction.
 */
void ask_light_to(vec3 origin, vec3 direction, float limit, Counted brings, vec2 counts, uint slot)
{
    const uint place = ask_shadow(origin, direction, limit, brings.all, slot, 0u);
    if (POINTS)
        POINT_RAY(place) = kiln_gpu_point_ray(floats_of(brings.last), counts.x, counts.y);
}

/* Adds to an integer of `count` 32-bit words, the lowest first; exact in any order. False: overflow. */
bool add_words(uint64_t words, uint count, uint lower, uint upper)
{
    uint carry = 0u;
    for (uint k = 0u; k < count; k++) {
        const uint sum = lower + carry, over = sum < carry ? 1u : 0u; /* at most one of both additions overflows */
        const uint old = sum != 0u ? atomicAdd(BothWords(words + 4ul * k).at[0], sum) : 0u;
        carry = over + (old + sum < old ? 1u : 0u);
        lower = upper;
        upper = 0u;
    }
    return (lower | carry) == 0u;
}

const uint SUM_WORDS = POINTS ? KILN_GPU_BOTH_POINT_WORDS : KILN_GPU_BOTH_SUM_WORDS; /* of a slot */

/* Adds to sum number `which` of the path in a slot. A float is a 24-bit integer times a power of 2, so its bits are
 * shifted to their place in the words. */
void add_to_sum(uint slot, uint which, vec3 rgb)
{
    for (uint c = 0u; c < 3u; c++) {
        const uint bits = floatBitsToUint(rgb[c]), exponent = bits >> 23 & 0xffu;
        const int shift = int(exponent) - 150 - int(BOTH.unit_power);
        if (exponent == 0u || !(rgb[c] > 0.0) || shift < -24)
            continue;
        uint64_t whole = uint64_t((bits & 0x7fffffu) | 0x800000u);
        if (shift < 0)
            whole = (whole + (1ul << uint(-shift - 1))) >> uint(-shift);
        const uint place = uint(max(shift, 0)), word = place / 32u;
        const uint64_t to = BOTH.radiance + 4ul * (SUM_WORDS * uint64_t(slot) + 9u * which + 3u * c + word);
        whole <<= place % 32u;
        if (exponent == 0xffu || word > 2u || !add_words(to, 3u - word, uint(whole), uint(whole >> 32)))
            BothCounts(BOTH.counts).at[0].too_much = 1u;
    }
}

/* Adds light to the sums of the path in a slot. */
void add_light_to(uint slot, Counted brings, vec2 counts)
{
    add_to_sum(slot, 0u, POINTS ? brings.all * counts.x : brings.all);
    if (POINTS) {
        add_to_sum(slot, 1u, brings.all * counts.y);
        add_to_sum(slot, 2u, brings.last * counts.y);
    }
}

/* Returns sum number `which` of the path in a slot, for one colour. */
float brought_to_sum(uint slot, uint which, uint color)
{
    BothWords words = BothWords(BOTH.radiance + 4ul * (SUM_WORDS * uint64_t(slot) + 9u * which + 3u * color));
    const real word = real(4294967296.0LF);
    const real count = (real(words.at[2]) * word + real(words.at[1])) * word + real(words.at[0]);
    return ldexp(float(count), int(BOTH.unit_power));
}

#endif
