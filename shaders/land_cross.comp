/* Light paths that land (shaders/land.glsl): adds their light to the spheres around probes (worker/pass/spheres.h) on
 * the way to the surface that their rays have hit, or to infinity. One thread per path.
 *
 * The grid is traversed slab by slab as in worker/backend/embree/spheres.c, but without lists of spheres: each grid
 * position has only the sphere of its own probe, however far that has been moved, so a ray meets each sphere once. Sums
 * are integers, so their order does not matter. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/shared/harmonics.h"

#include "shaders/land.glsl"

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer SphereArray { vec4 at[]; };

const float SEEN = 0.9999,            /* as in spheres.c, like what follows */
    LEAST_DIRECTION = 1.0e-9,         /* spacings a metre */
    MOMENT = 65536.0,                 /* KILN_SPHERE_MOMENT */
    MOMENT_MOST = 274877906944.0,     /* KILN_SPHERE_MOMENT_MOST: 2^38 */
    SUM_MOST = 2305843009213693952.0; /* 2^61 units, of one chord */
const bool TINTS = HAS_ALPHA >= KILN_PASSAGE_TINT;

vec3 start, slope; /* the ray in grid coordinates: its start in spacings, its slope in spacings per metre */
float way_end;     /* m; infinity: it meets nothing */
vec3 flux;         /* flux at its start, in units added for a chord as long as the largest diameter */
float relative;    /* luminance of its flux, relative to a mean path of its aim */
float pick;        /* the place on each chord */
uint chance;       /* seed of random decisions at surfaces that let light through */
uint64_t moments;  /* of the chords so far */
uint rays;

/* The integer nearest to x >= 0, made by shifting the float's 24 bits. */
uint64_t whole_of(float x)
{
    const uint bits = floatBitsToUint(x);
    const int shift = int(bits >> 23 & 0xffu) - 150;
    const uint64_t digits = uint64_t((bits & 0x7fffffu) | 0x800000u);
    if (shift >= 0)
        return digits << uint(shift);
    return shift < -24 ? 0ul : (digits + (1ul << uint(-shift - 1))) >> uint(-shift);
}

/* Adds to a 64-bit number, the lower half first; negative numbers are added modulo 2^64. */
void add_whole(uint64_t address, uint64_t number)
{
    const uint lower = uint(number), old = lower != 0u ? atomicAdd(BothWords(address).at[0], lower) : 0u;
    const uint upper = uint(number >> 32) + (old + lower < old ? 1u : 0u);
    if (upper != 0u)
        atomicAdd(BothWords(address).at[1], upper);
}

uint64_t signed_whole_of(float x)
{
    const uint64_t size = whole_of(min(abs(x), SUM_MOST));
    return x < 0.0 ? 0ul - size : size;
}

/* ---- one sphere ---- */

/* Whether the centre of a sphere sees the point at `distance` along the ray. `tint`: share of light that surfaces
 * before it let through. One loop, since the code that traces is long. */
bool sees(uint number, vec3 centre, float distance, out vec3 tint)
{
    const vec3 to = path.origin + path.direction * distance - centre;
    const float away = length(to);
    const bool asks = SEEN * away >= AimFloats(SPHERES.clear).at[number] && away > 0.0;
    bool seen = true;
    tint = vec3(1.0);
    for (uint k = asks ? 0u : 1u; k < (TINTS ? 2u : 1u) && seen; k++) {
        const bool sight = k == 0u;
        const vec3 origin = sight ? centre : path.origin, direction = sight ? to / away : path.direction;
        const float limit = sight ? SEEN * away : distance;
        const uvec3 o = floatBitsToUint(origin), d = floatBitsToUint(direction);
        const uint seed = sight ? kiln_ray_bits_seed(o.x, o.y, o.z, d.x, d.y, d.z) : chance;
        rays += sight ? 1u : 0u;
        if (!TINTS) {
            seen = !kiln_is_met(origin, direction, limit, seed);
        } else {
            vec3 part;
            const bool met = kiln_trace_within(origin, direction, limit, seed, part).triangle != KILN_GPU_NONE;
            seen = !sight || !met;
            tint = sight ? vec3(1.0) : part;
        }
    }
    return seen;
}

/* Returns the share of light, by colour, that is left at a distance in the ray's body. */
vec3 left_at(float distance)
{
    kiln_hit there = hit;
    there.distance = distance;
    return hit.triangle == KILN_GPU_NONE ? vec3(1.0) : attenuation(there);
}

/* Adds the light of a chord: as harmonics of the direction that it comes from, and as irradiance along the axes. */
void add_chord(uint number, vec3 brought)
{
    const vec3 back = -path.direction, positive = max(back, 0.0), negative = max(-back, 0.0);
    uint64_t sum = SPHERES.sums + 8ul * (uint64_t(KILN_GPU_SPHERE_SUMS) * number);
    float weights[15];
#define KILN_PUT(index, y) weights[index] = y;
    KILN_HARMONICS_EACH(KILN_PUT, back)
#undef KILN_PUT
    for (uint a = 0u; a < 3u; a++) {
        weights[9u + 2u * a] = positive[a];
        weights[10u + 2u * a] = negative[a];
    }
    for (uint k = 0u; k < 15u; k++, sum += 24ul) {
        add_whole(sum, signed_whole_of(brought.r * weights[k]));
        add_whole(sum + 8ul, signed_whole_of(brought.g * weights[k]));
        add_whole(sum + 16ul, signed_whole_of(brought.b * weights[k]));
    }
}

void cross_one(uint number)
{
    const vec4 sphere = SphereArray(SPHERES.spheres).at[number];
    const vec3 to = sphere.xyz - path.origin;
    const float middle = dot(to, path.direction);
    const vec3 off = to - path.direction * middle;
    const float square = sphere.w * sphere.w - dot(off, off);
    if (!(sphere.w > 0.0) || !(square > 0.0))
        return;
    const float half_chord = sqrt(square), begin = max(0.0, middle - half_chord),
                end = min(way_end, middle + half_chord), distance = begin + pick * (end - begin);
    vec3 tint;
    if (!(end > begin) || !sees(number, sphere.xyz, distance, tint))
        return;
    const float chord = (end - begin) / SPHERES.diameter, moment = relative * chord;
    add_chord(number, flux * tint * left_at(distance) * chord);
    moments += whole_of(floor(min(MOMENT * moment * moment, MOMENT_MOST)));
}

/* ---- which spheres ---- */

/* Clips the ray's interval [begin, end] to [low, high] along an axis; false: nothing is left. */
bool clip(uint axis, float low, float high, inout float begin, inout float end)
{
    if (abs(slope[axis]) < LEAST_DIRECTION)
        return start[axis] >= low && start[axis] <= high;
    const float a = (low - start[axis]) / slope[axis], b = (high - start[axis]) / slope[axis];
    begin = max(begin, min(a, b));
    end = min(end, max(a, b));
    return begin <= end;
}

/* First and last grid position along an axis. */
vec2 places(uint axis)
{
    return axis == 2u ? vec2(SPHERES.low, SPHERES.high) : vec2(0.0, float(SPHERES.size[axis]) - 1.0);
}

/* Range of grid positions whose spheres the interval [begin, end] may meet. */
ivec2 find_range(uint axis, float begin, float end)
{
    const float a = start[axis] + begin * slope[axis], b = start[axis] + end * slope[axis], reach = SPHERES.reach[axis];
    const vec2 all = places(axis);
    return ivec2(vec2(max(all.x, ceil(min(a, b) - reach)), min(all.y, floor(max(a, b) + reach))));
}

/* Crosses the spheres in one slab of the grid: probes whose index along the axis `along` is i. [begin, end]: the ray's
 * interval in the grid, m. */
void cross_slab(uint along, int i, float begin, float end)
{
    const float reach = SPHERES.reach[along];
    if (!clip(along, float(i) - reach, float(i) + reach, begin, end))
        return;
    ivec2 x = find_range(0u, begin, end), y = find_range(1u, begin, end), z = find_range(2u, begin, end);
    if (along == 0u)
        x = ivec2(i);
    else if (along == 1u)
        y = ivec2(i);
    else
        z = ivec2(i);
    const ivec3 count = max(ivec3(0), ivec3(x.y - x.x, y.y - y.x, z.y - z.x) + 1);
    for (int k = 0; k < count.x * count.y * count.z; k++) {
        const int row = k / count.x;
        const ivec3 at = ivec3(x.x + k % count.x, y.x + row % count.y, z.x + row / count.y);
        const uint64_t probe = (uint64_t(at.z) * SPHERES.size[1] + uint64_t(at.y)) * SPHERES.size[0] + uint64_t(at.x);
        if (probe >= SPHERES.first && probe - SPHERES.first < uint64_t(SPHERES.count))
            cross_one(uint(probe - SPHERES.first));
    }
}

void cross_spheres()
{
    float begin = 0.0, end = way_end;
    uint along = 0u;
    start = (path.origin - SPHERES.origin) / SPHERES.spacing;
    slope = path.direction / SPHERES.spacing;
    for (uint a = 0u; a < 3u; a++) {
        const vec2 all = places(a);
        along = abs(slope[a]) > abs(slope[along]) ? a : along;
        if (!clip(a, all.x - SPHERES.reach[a], all.y + SPHERES.reach[a], begin, end))
            return;
    }
    const ivec2 range = find_range(along, begin, end);
    for (int i = range.x; i <= range.y; i++)
        cross_slab(along, i, begin, end);
}

void leave_light()
{
    const real3 carried = flux_then() * real3(vec3_in(path.weight));
    way_end = hit.triangle == KILN_GPU_NONE ? KILN_INFINITY : hit.distance;
    flux = vec3(carried * real(SPHERES.units));
    relative = float(real_luminance(carried) * real(AimFloats(SPHERES.paths).at[more.aim]));
    walk_key = more.key;
    walk_sample = more.number;
    pick = float(real_unit(walk_draw(kiln_path_use(path.surface, KILN_PATH_SKY)).x));
    chance = path_chance(walk_key, walk_sample, path.surface);
    moments = 0ul;
    rays = 0u;
    cross_spheres();
    if (moments != 0ul)
        add_whole(SPHERES.moments + 8ul * more.aim, moments);
    if (rays != 0u)
        add_whole(SPHERES.moments + 8ul * SPHERES.aims, uint64_t(rays));
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    slot = slot_of(x);
    load();
    if (path.surface > 1u) /* light that reaches a probe directly from lamps is not counted here */
        leave_light();
    if (!still_loops(push.count))
        BothCounts(BOTH.counts).at[0].stopped = 1u;
}

#include "shaders/main.glsl"
