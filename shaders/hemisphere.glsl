/* Samples over the hemisphere of a point: thread (x, y) computes slice y of the samples of point x. The samples of a
 * point form four quarters, each of `per_quarter` slices; quarter q holds the samples k with k * 4 / samples == q.
 * Neighbouring threads take the same sample of neighbouring points, whose directions share a stratum
 * (shaders/shared/random.h). hemisphere_reduce.glsl sums up the slices.
 *
 * The including kernel defines what a ray adds. Before this file it has push constants with the members `chunk` and
 * `hemisphere`, `struct Sums`, the sums of a thread, and NO_SUMS, their zeros. It defines the functions that are
 * declared here. It may define these macros: HEMISPHERE_BEGIN runs before a point's rays, with its index in its block;
 * HEMISPHERE_RAY and HEMISPHERE_RAY_DONE run before and after each ray, with the sample's number; HEMISPHERE_NUMBER
 * maps i to the number of the i-th sample; HEMISPHERE_SKIPS tells whether to skip point p; HEMISPHERE_SEEDS tells
 * whether seeds are needed in any scene. All other code stands in kiln_kernel itself, since separate functions cost the
 * gather 4 % on an H200. */
#ifndef HEMISPHERE_BEGIN
#    define HEMISPHERE_BEGIN(index)
#endif
#ifndef HEMISPHERE_RAY
#    define HEMISPHERE_RAY(k)
#endif
#ifndef HEMISPHERE_NUMBER
#    define HEMISPHERE_NUMBER(i) i
#endif
#ifndef HEMISPHERE_RAY_DONE
#    define HEMISPHERE_RAY_DONE(k)
#endif
#ifndef HEMISPHERE_SKIPS
#    define HEMISPHERE_SKIPS(p) false
#endif
#ifndef HEMISPHERE_SEEDS
#    define HEMISPHERE_SEEDS false
#endif
#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/position.glsl"
#include "shaders/hemisphere_ray.glsl"

KILN_ARRAY(FloatArray, float, 4);

#ifdef KILN_GLOSS
uint ray_chance, ray_number; /* of the present ray, as parameters of chain_follow (chain.glsl) */
bool chains_good = true;     /* the device has ended no chain early */
#endif

/* Adds one sample of the point: a ray from `position` with the geometric normal `normal`, u and v in (0, 1) for its
 * direction, and `seed` for its random decisions. */
void add_ray(inout Sums sums, kiln_gpu_point p, vec3 position, vec3 normal, float u, float v, uint seed);

/* Runs after the rays of slice `row` of the point. `good`: the device did not end the loop over them early. */
void after_rays(inout Sums sums, kiln_gpu_point p, uint row, bool good);
/* Stores the sums of slice `row` of point `x` of the chunk: float c at hemisphere_floats(row, ..).at[c * total + x]. */
void store(Sums sums, uint x, uint row);

/* Floats of slice `row` of all points, `floats` per point. */
FloatArray hemisphere_floats(uint row, uint floats)
{
    return FloatArray(push.hemisphere.slices +
                      uint64_t(row * push.hemisphere.row_step * floats) * push.chunk.total * 4ul);
}

void kiln_kernel(uint x, uint y)
{
    const uint row = push.hemisphere.row_first + y;
    const uint index = kiln_point_of_thread(push.chunk, x);
    if (index == KILN_GPU_NONE || row >= 4u * push.hemisphere.per_quarter)
        return;
    const kiln_gpu_point p = PointArray(push.chunk.points).at[index];
    if (HEMISPHERE_SKIPS(p))
        return;
    /* quarter q holds the samples k with k * 4 / samples == q */
    const uint q = row / push.hemisphere.per_quarter, n = push.hemisphere.samples;
    const uint begin = kiln_quarter_first(q, n), end = kiln_quarter_first(q + 1u, n);
    const uint from = begin + (row % push.hemisphere.per_quarter) * push.hemisphere.slice,
               to = min(end, from + push.hemisphere.slice);
    HEMISPHERE_BEGIN(index);
    Sums sums = NO_SUMS;
    uint seed[4];
    for (uint d = 0u; d < 4u; d++)
        seed[d] = kiln_gather_seed(p.tile_key, push.hemisphere.stream, d);
    const uint key = kiln_hash2(p.key, push.hemisphere.stream), shared_digits = kiln_shared_digits(n);
    const uint shift_u = kiln_direction_shift(key, KILN_DIMENSION_U, shared_digits);
    const uint shift_v = kiln_direction_shift(key, KILN_DIMENSION_V, shared_digits);
    const uint chance = kiln_gather_chance(key);
    const uint shift_s = kiln_gather_shift(key, KILN_DIMENSION_S), shift_t = kiln_gather_shift(key, KILN_DIMENSION_T);
    const bool shares = hemisphere_shares(p);
    WordArray sobol = WordArray(push.hemisphere.sobol);
    vec3 position, normal;
    uint drawn = KILN_GPU_NONE;
    uint i = from;
    for (; i < to; i++) {
        const uint k = HEMISPHERE_NUMBER(i);
        const uint place = shares ? k / push.hemisphere.reuse : k;
        if (place != drawn) {
            const float s = kiln_unit_float(
                kiln_owen_scramble(sobol.at[2u * push.hemisphere.sobol_stride + place], seed[2]) ^ shift_s);
            const float t = kiln_unit_float(
                kiln_owen_scramble(sobol.at[3u * push.hemisphere.sobol_stride + place], seed[3]) ^ shift_t);
            float offset;
            kiln_position(p, push.chunk.parts, s, t, position, normal, offset);
            drawn = place;
        }
        const uint bits_u = kiln_owen_scramble(sobol.at[k], seed[0]) ^ shift_u;
        const uint bits_v = kiln_owen_scramble(sobol.at[push.hemisphere.sobol_stride + k], seed[1]) ^ shift_v;
        const float u = kiln_unit_float(bits_u), v = kiln_unit_float(bits_v);
#ifdef KILN_GLOSS
        ray_chance = chance;
        ray_number = push.hemisphere.first_sample + k;
#endif
        HEMISPHERE_RAY(k);
        add_ray(sums, p, position, normal, u, v,
                HEMISPHERE_SEEDS || HAS_ALPHA >= KILN_PASSAGE_BLEND
                    ? kiln_gather_ray_seed(chance, push.hemisphere.first_sample + k)
                    : 0u);
        HEMISPHERE_RAY_DONE(k);
    }
    after_rays(sums, p, row, i >= to);
    store(sums, index - push.chunk.origin, row);
}
