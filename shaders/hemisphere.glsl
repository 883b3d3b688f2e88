/* Samples over the hemisphere of a point: thread (x, y) takes slice y of the samples of point x. The samples of a point
 * fall into four quarters, each of `per_quarter` slices; quarter q holds the samples k with k * 4 / samples == q.
 * Neighbouring threads take the same sample of neighbouring points, whose directions share a stratum
 * (shaders/shared/random.h). hemisphere_reduce.glsl adds up the slices.
 *
 * The kernel that includes this says what a ray adds. Before it stand push constants with the members `chunk` and
 * `hemisphere`, and `struct Sums`, what a thread adds up. The kernel defines add_ray and calls hemisphere_rays. */
#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/position.glsl"

KILN_ARRAY(FloatArray, float, 4);

/* What one sample of the point adds: a ray from `position`, where the geometric normal is `normal`, with u and v in
 * (0, 1) for its direction and `seed` for its chances. */
void add_ray(inout Sums sums, kiln_gpu_point p, vec3 position, vec3 normal, float u, float v, uint seed);

/* `radius` away from the axis n, turned about it by v, and `cosine` along it. */
vec3 hemisphere_direction(vec3 n, float radius, float cosine, float v)
{
    const float turn = v - 0.5, a = abs(turn);
    const float sine = kiln_sine_turn(min(a, 0.5 - a));
    vec3 t, b;
    kiln_basis(n, t, b);
    return radius * kiln_sine_turn(0.25 - a) * t + radius * (turn < 0.0 ? -sine : sine) * b + cosine * n;
}

/* Cosine-distributed about the axis n, with which it has the cosine `cosine`. */
vec3 hemisphere_cosine(vec3 n, float u, float v, out float cosine)
{
    cosine = sqrt(1.0 - u);
    return hemisphere_direction(n, sqrt(u), cosine, v);
}

/* The slice of thread (x, y): samples from .. to - 1 of a point. */
struct Slice {
    uint index;    /* the point's, or KILN_GPU_NONE: the thread has nothing to do */
    uint row;      /* slice of all four quarters */
    uint from, to; /* none where `from` is not below `to` */
};

Slice hemisphere_slice(uint x, uint y)
{
    const uint row = push.hemisphere.row_first + y, per_quarter = push.hemisphere.per_quarter;
    Slice slice = Slice(kiln_point_of_thread(push.chunk, x), row, 0u, 0u);
    if (row >= 4u * per_quarter)
        slice.index = KILN_GPU_NONE;
    if (slice.index == KILN_GPU_NONE)
        return slice;
    const uint q = row / per_quarter, n = push.hemisphere.samples;
    const uint begin = kiln_quarter_first(q, n), end = kiln_quarter_first(q + 1u, n);
    slice.from = begin + (row % per_quarter) * push.hemisphere.slice;
    slice.to = min(end, slice.from + push.hemisphere.slice);
    return slice;
}

/* What the random numbers of a point's samples hang on. */
struct Numbers {
    uint seed[4], shift[4], chance;
    uint reuse; /* sample k starts at place k / reuse */
};

Numbers hemisphere_numbers(kiln_gpu_point p)
{
    const uint stream = push.hemisphere.stream, key = kiln_hash2(p.key, stream),
               shared_digits = kiln_shared_digits(push.hemisphere.samples);
    const bool shares = DRAW_AGAIN != 0u || (p.flags & (KILN_GPU_POINT_PARTIAL | KILN_GPU_POINT_MASKED)) != 0u;
    Numbers numbers;
    for (uint d = 0u; d < 4u; d++)
        numbers.seed[d] = kiln_gather_seed(p.tile_key, stream, d);
    numbers.shift[KILN_DIMENSION_U] = kiln_direction_shift(key, KILN_DIMENSION_U, shared_digits);
    numbers.shift[KILN_DIMENSION_V] = kiln_direction_shift(key, KILN_DIMENSION_V, shared_digits);
    numbers.shift[KILN_DIMENSION_S] = kiln_gather_shift(key, KILN_DIMENSION_S);
    numbers.shift[KILN_DIMENSION_T] = kiln_gather_shift(key, KILN_DIMENSION_T);
    numbers.chance = kiln_gather_chance(key);
    numbers.reuse = shares ? push.hemisphere.reuse : 1u;
    return numbers;
}

float hemisphere_number(Numbers numbers, uint k, uint dimension)
{
    const uint point = WordArray(push.hemisphere.sobol).at[dimension * push.hemisphere.sobol_stride + k];
    return kiln_unit_float(kiln_owen_scramble(point, numbers.seed[dimension]) ^ numbers.shift[dimension]);
}

/* Where a sample starts: position with its offset off the surface, geometric normal, that offset. */
struct Start {
    uint number; /* KILN_GPU_NONE: none yet */
    vec3 position, normal;
    float offset;
};

/* Goes on to the start of sample k. */
void hemisphere_start(inout Start start, kiln_gpu_point p, Numbers numbers, uint k)
{
    const uint number = k / numbers.reuse;
    if (number == start.number)
        return;
    kiln_position(p, push.chunk.parts, hemisphere_number(numbers, number, KILN_DIMENSION_S),
                  hemisphere_number(numbers, number, KILN_DIMENSION_T), start.position, start.normal, start.offset);
    start.number = number;
}

/* Adds the slice's rays. False: the device ended the loop early. */
bool hemisphere_rays(inout Sums sums, kiln_gpu_point p, Numbers numbers, Slice slice)
{
    Start start;
    start.number = KILN_GPU_NONE;
    uint k = slice.from;
    for (; k < slice.to; k++) {
        hemisphere_start(start, p, numbers, k);
        add_ray(sums, p, start.position, start.normal, hemisphere_number(numbers, k, KILN_DIMENSION_U),
                hemisphere_number(numbers, k, KILN_DIMENSION_V),
                HAS_ALPHA >= KILN_PASSAGE_BLEND ? kiln_gather_ray_seed(numbers.chance, k) : 0u);
    }
    return k >= slice.to;
}

/* Where the slice's first float goes; the next is `push.chunk.total` floats on. Slices have `floats` a point. */
FloatArray hemisphere_store(Slice slice, uint floats)
{
    const uint64_t row = uint64_t(slice.row * push.hemisphere.row_step * floats) * push.chunk.total;
    return FloatArray(push.hemisphere.slices + (row + slice.index - push.chunk.origin) * 4ul);
}
