/* Ray tracing in compute shaders: the ray, the triangle test, and the choice of the BVH layout. Part of
 * shaders/trace/trace.glsl.
 *
 * Watertight after Woop, Benthin and Wald, "Watertight ray/triangle intersection" (2013). Corners are projected along
 * the ray, each always by the same operations, so that triangles with a common corner get exactly the same projection.
 * The ray is inside where the three edge functions of the projected triangle do not differ in sign. An edge function is
 * the difference of two rounded products (never fused): exactly antisymmetric, and never of the wrong sign, only zero
 * when in doubt; zero counts as inside. Shears along the ray's main axis would permute the axes; instead corners are
 * projected onto two vectors perpendicular to the ray. */
#include "shaders/trace/alpha.glsl"

layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer TraceQuads { uvec4 at[]; };

struct kiln_ray {
    vec3 origin, direction;
    vec3 across, up;   /* right-handed: across x up = direction */
    float after;       /* hits up to this distance were found before, and let the ray through; */
    uint after_number; /* at exactly this distance: triangles up to this number */
    uint preferred;    /* KILN_EITHER, ... */
};

/* The nearest hit so far. `distance` is the ray's limit at first. A hit on a face of lower preference counts as farther
 * away: kiln_behind is then a part of `distance`. */
struct kiln_found {
    float distance, u, v;
    uint triangle;
    bool back;
};

/* Makes the ray, with two perpendicular unit vectors (Duff et al., "Building an orthonormal basis, revisited", 2017).
 */
kiln_ray kiln_ray_of(vec3 origin, vec3 direction, uint preferred)
{
    const float s = direction.z < 0.0 ? -1.0 : 1.0;
    precise const float a = -1.0 / (s + direction.z);
    precise const float b = direction.x * direction.y * a;
    precise const vec3 across = vec3(1.0 + s * direction.x * direction.x * a, s * b, -s * direction.x);
    precise const vec3 up = vec3(b, s + direction.y * direction.y * a, -direction.y);
    return kiln_ray(origin, direction, across, up, 0.0, KILN_GPU_NONE, preferred);
}

/* Inverse direction, for slab tests t = (plane - origin) / direction; finite even if the direction has a zero (the
 * margins of boxes cover the change). */
vec3 kiln_inverse(vec3 direction)
{
    const float tiny = 1.0e-18;
    const vec3 least =
        vec3(direction.x < 0.0 ? -tiny : tiny, direction.y < 0.0 ? -tiny : tiny, direction.z < 0.0 ? -tiny : tiny);
    return 1.0 / mix(direction, least, lessThan(abs(direction), vec3(tiny)));
}

float kiln_along(vec3 axis, vec3 place)
{
    precise const float sum = fma(axis.x, place.x, fma(axis.y, place.y, axis.z * place.z));
    return sum;
}

float kiln_edge(vec2 p, vec2 q)
{
    precise const float forward = p.x * q.y;
    precise const float backward = p.y * q.x;
    precise const float difference = forward - backward;
    return difference;
}

/* Returns kiln_edge with the rounding errors of its two products added, for triangles that are very narrow as seen from
 * the ray, whose edge functions are otherwise all zero. Where fma is not fused this adds nothing. */
float kiln_edge_remainder(vec2 p, vec2 q)
{
    precise const float forward = p.x * q.y, backward = p.y * q.x;
    precise const float lost_forward = fma(p.x, q.y, -forward), lost_backward = fma(p.y, q.x, -backward);
    precise const float difference = (forward - backward) + (lost_forward - lost_backward);
    return difference;
}

bool kiln_same_sign(vec3 w) { return min(min(w.x, w.y), w.z) >= 0.0 || max(max(w.x, w.y), w.z) <= 0.0; }

/* Distance of a hit of a ray from the origin 0, with barycentric weights w / area. Computed from the plane's normal,
 * since weights of a needle are imprecise by its length over its width, and along the axes the normal is exact. If the
 * triangle is seen edge-on, at less than half a degree, the weights are more precise. The distance is clamped to those
 * of the corners. */
float kiln_hit_distance(vec3 a, vec3 b, vec3 c, vec3 direction, vec3 w, float scale)
{
    precise const vec3 normal = cross(b - a, c - a);
    precise const float steepness = dot(normal, direction), height = dot(normal, a);
    const float at_a = kiln_along(direction, a), at_b = kiln_along(direction, b), at_c = kiln_along(direction, c);
    const bool edge_on = steepness * steepness <= 1.0e-4 * dot(normal, normal);
    precise const float weighted = fma(w.x * scale, at_a, fma(w.y * scale, at_b, w.z * scale * at_c));
    return clamp(edge_on ? weighted : height / steepness, min(min(at_a, at_b), at_c), max(max(at_a, at_b), at_c));
}

/* Whether faces of this side are treated as farther away. Only in kernels that test for buried positions do rays have a
 * preference of their own, instead of the scene's. */
bool kiln_is_later(const kiln_ray ray, bool back)
{
    if (KILN_ASKS_BURIED && ray.preferred != KILN_EITHER)
        return back == (ray.preferred == KILN_FRONT);
    return HAS_COINCIDENT != 0u && back;
}

/* Distance by which such a face is treated as farther away, m. */
float kiln_behind(vec3 a, vec3 b, vec3 c, vec3 direction)
{
    const vec3 normal = cross(b - a, c - a);
    const float cosine = abs(dot(normal, direction)) * inversesqrt(max(dot(normal, normal), 1.0e-37));
    return SCENE.trace.extent * KILN_COINCIDENT / max(cosine, KILN_COINCIDENT_LEAST_COSINE);
}

/* Tests a triangle; true if it is the new nearest hit. */
bool kiln_test(const kiln_ray ray, TraceQuads triangles, uint index, inout kiln_found found)
{
    const uvec4 first = triangles.at[3u * index];
    precise const vec3 a = uintBitsToFloat(first.xyz) - ray.origin;
    precise const vec3 b = uintBitsToFloat(triangles.at[3u * index + 1u].xyz) - ray.origin;
    precise const vec3 c = uintBitsToFloat(triangles.at[3u * index + 2u].xyz) - ray.origin;
    const vec2 flat_a = vec2(kiln_along(ray.across, a), kiln_along(ray.up, a));
    const vec2 flat_b = vec2(kiln_along(ray.across, b), kiln_along(ray.up, b));
    const vec2 flat_c = vec2(kiln_along(ray.across, c), kiln_along(ray.up, c));
    vec3 w = vec3(kiln_edge(flat_b, flat_c), kiln_edge(flat_c, flat_a), kiln_edge(flat_a, flat_b));
    if (!kiln_same_sign(w))
        return false;
    precise float area = w.x + w.y + w.z;
    if (area == 0.0) {
        w = vec3(kiln_edge_remainder(flat_b, flat_c), kiln_edge_remainder(flat_c, flat_a),
                 kiln_edge_remainder(flat_a, flat_b));
        area = w.x + w.y + w.z;
        if (area == 0.0 || !kiln_same_sign(w))
            return false;
    }
    precise const float scale = 1.0 / area;
    precise const float u = w.y * scale, v = w.z * scale;
    float t = kiln_hit_distance(a, b, c, ray.direction, w, scale);
    const uint number = first.w;
    bool beyond = t > 0.0;
    const bool prefers = HAS_COINCIDENT != 0u || KILN_ASKS_BURIED;
    if (prefers && beyond && kiln_is_later(ray, area > 0.0))
        t += kiln_behind(a, b, c, ray.direction);
    if (HAS_ALPHA != 0u)
        beyond = (!prefers || beyond) &&
                 (t > ray.after || (t == ray.after && ray.after_number != KILN_GPU_NONE && number > ray.after_number));
    if (!(beyond && (t < found.distance || (t == found.distance && number < found.triangle))))
        return false;
    found = kiln_found(t, u, v, number, area > 0.0);
    return true;
}

/* Whether a hit ends an any-hit search. A triangle that may let the ray through does not, since there may be more
 * before it. */
bool kiln_ends(const kiln_found found) { return HAS_ALPHA == 0u || found.triangle < SCENE.opaque_count; }

/* Tests the triangles of a leaf; true if the search is over. */
bool kiln_test_leaf(const kiln_ray ray, TraceQuads triangles, uint leaf, bool any, inout kiln_found found)
{
    const uint first = leaf & KILN_GPU_LEAF_FIRST, end = first + (leaf >> KILN_GPU_LEAF_COUNT_SHIFT & 3u) + 1u;
    for (uint i = first; i < end; i++)
        if (kiln_test(ray, triangles, i, found) && any && kiln_ends(found))
            return true;
    return false;
}

#include "shaders/trace/four.glsl"
#include "shaders/trace/eight.glsl"

kiln_found kiln_walk_once(const kiln_ray ray, float limit, bool any)
{
    kiln_found found = kiln_found(limit, 0.0, 0.0, KILN_GPU_NONE, false);
    if (TRAVERSAL == KILN_TRAVERSAL_EIGHT)
        kiln_walk_eight(ray, any, found);
    else
        kiln_walk_four(ray, any, found);
    return found;
}

/* Traverses the BVH. Surfaces that let light through are evaluated outside the traversal loops, which restart behind
 * each one that the ray passes: inside, the lookup made the whole kernel up to 400 times slower. Drivers inline
 * functions at every call, so the traversal is called in one place, or compiling takes long. A return from within this
 * loop lost the value of `share` on Mesa's software device. */
kiln_found kiln_walk(vec3 origin, vec3 direction, float limit, bool any, uint question, uint preferred, uint seed,
                     inout vec3 share)
{
    kiln_ray ray = kiln_ray_of(origin, direction, preferred);
    kiln_found found;
    bool passes = true;
    while (passes) {
        found = kiln_walk_once(ray, limit, any);
        passes = HAS_ALPHA != 0u && found.triangle != KILN_GPU_NONE && found.triangle >= SCENE.opaque_count &&
                 kiln_passes(question, seed, found.triangle, found.u, found.v, direction, share);
        ray.after = found.distance;
        ray.after_number = found.triangle;
    }
    return found;
}

kiln_hit kiln_trace_by_chance(vec3 origin, vec3 direction, uint seed, out vec3 tint)
{
    tint = vec3(1.0);
    const kiln_found found =
        kiln_walk(origin, direction, uintBitsToFloat(0x7f800000u), false, KILN_BY_CHANCE, KILN_EITHER, seed, tint);
    return kiln_hit(found.triangle, found.u, found.v, found.distance, found.back);
}

kiln_hit kiln_trace_within(vec3 origin, vec3 direction, float limit, uint seed, out vec3 tint)
{
    tint = vec3(1.0);
    const kiln_found found = kiln_walk(origin, direction, limit, false, KILN_BY_CHANCE, KILN_EITHER, seed, tint);
    return kiln_hit(found.triangle, found.u, found.v, found.distance, found.back);
}

bool kiln_is_met(vec3 origin, vec3 direction, float limit, uint seed)
{
    vec3 tint = vec3(1.0);
    return kiln_walk(origin, direction, limit, true, KILN_BY_CHANCE, KILN_EITHER, seed, tint).triangle != KILN_GPU_NONE;
}

const float KILN_ENDLESS = 3.0e38;

kiln_hit kiln_trace(vec3 origin, vec3 direction, float limit, uint preferred)
{
    vec3 share = vec3(1.0);
    const kiln_found found = kiln_walk(origin, direction, limit, false, KILN_SOLID, preferred, 0u, share);
    return kiln_hit(found.triangle, found.u, found.v, found.distance, found.back);
}

vec3 kiln_through(vec3 origin, vec3 direction, float limit)
{
    vec3 share = vec3(1.0);
    return kiln_walk(origin, direction, limit, true, KILN_THROUGH, KILN_EITHER, 0u, share).triangle != KILN_GPU_NONE
               ? vec3(0.0)
               : share;
}

kiln_hit kiln_trace_either(vec3 origin, vec3 direction, float limit, bool occlusion, uint seed, out vec3 tint)
{
    tint = vec3(1.0);
    const kiln_found found = kiln_walk(origin, direction, limit, occlusion, occlusion ? KILN_THROUGH : KILN_BY_CHANCE,
                                       KILN_EITHER, seed, tint);
    if (occlusion && found.triangle != KILN_GPU_NONE)
        tint = vec3(0.0);
    return kiln_hit(found.triangle, found.u, found.v, found.distance, found.back);
}
