/* Rays of the bidirectional pass, in three forms that ASKS selects: rays to the next surface of the path in thread x's
 * slot; shadow rays of light to a path, to whose radiance the light let through is added; shadow rays of light to the
 * camera, where it is added to the film. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_both_push);

layout(constant_id = 6) const uint METHOD = KILN_GPU_RAYS_NEXT; /* KILN_GPU_RAYS_..., with KILN_GPU_BOTH_... */
const uint ASKS = METHOD & KILN_GPU_BOTH_FORM;
const bool POINTS = (METHOD & KILN_GPU_BOTH_POINTS) != 0u, LANDS = (METHOD & KILN_GPU_BOTH_LANDS) != 0u;

#define KILN_LIFTS
#include "shaders/bidirectional.glsl"
#include "shaders/subpaths.glsl"

bool is_seen(kiln_hit at) { return (triangle_at(at.triangle).flags & KILN_GPU_PATH_HIDDEN) == 0u && has_side(at); }

/* Nearest surface up to `limit`. `looks`: only of those that the camera sees. */
kiln_hit nearest(vec3 origin, vec3 direction, float limit, uint chance, bool looks, out vec3 tint)
{
    kiln_hit hit;
    bool goes = true;
    tint = vec3(1.0);
    for (uint k = 0u; k <= KILN_PATH_UNSEEN && goes; k++) {
        vec3 part;
        hit = kiln_trace_within(origin, direction, limit, chance, part);
        tint *= part;
        goes = looks && hit.triangle != KILN_GPU_NONE && !is_seen(hit);
        const float beyond = kiln_path_beyond(hit.distance, BOTH.extent);
        origin += direction * beyond;
        limit -= beyond;
    }
    if (goes)
        hit.triangle = KILN_GPU_NONE;
    return hit;
}

#ifdef KILN_GLOSS
/* Lists the slot with paths that have hit gloss or cross a body, or with all others. */
void sort(uint slot, kiln_hit hit, uint body)
{
    const bool gloss = body != KILN_GPU_NONE ||
                       (hit.triangle != KILN_GPU_NONE && (material_of(hit.triangle) & KILN_RECORD_GLOSS) != 0u);
    const uint place = gloss ? push.room + atomicAdd(TALLY.shadows, 1u) : atomicAdd(TALLY.paths, 1u);
    BothWords(push.onward + 4ul * place).at[0] = slot;
}
#endif

/* Height by which rays are lifted that start at the path's hit (meeting_lift of worker/backend/embree/meeting.h). */
float lift_off(kiln_hit hit, bool seen)
{
    if (HAS_SMOOTH == 0u || LANDS || hit.triangle == KILN_GPU_NONE ||
        !(seen || (HAS_GLOSS && (material_of(hit.triangle) & KILN_RECORD_GLOSS) != 0u)))
        return 0.0;
    const kiln_gpu_path_triangle t = triangle_at(hit.triangle);
    return is_coarse(hit.triangle, t, hit.back) ? lift_at(t, hit.back, hit.u, hit.v) : 0.0;
}

void intersect_closest(uint slot)
{
    const kiln_gpu_subpath s = SUBPATH(slot);
    const bool of_light = LANDS || push.light != KILN_GPU_OF_CAMERA;
    if (POINTS && !of_light && POINT_PATH(slot).goes == 0u) {
#ifdef KILN_GLOSS
        sort(slot, hit_of(KILN_GPU_NONE, 0.0, 0.0, 0.0), KILN_GPU_NONE);
#endif
        return;
    }
    if (LANDS)
        draw_for_landing(slot);
    else if (of_light)
        draw_for_light(slot);
    else
        draw_for_eye(slot);
    uint chance = path_chance(walk_key, walk_sample, s.surface);
    if (POINTS && !of_light && s.surface == 1u)
        chance = POINT_PATH(slot).seed;
    vec3 tint;
    const bool seen = !POINTS && !of_light && s.surface == 0u; /* by the camera itself */
    const kiln_hit hit = nearest(s.origin, s.direction, KILN_INFINITY, chance, seen, tint);
    SUBPATH(slot).triangle =
        hit.triangle == KILN_GPU_NONE ? KILN_GPU_NONE : hit.triangle | (hit.back ? KILN_GPU_BOTH_BACK : 0u);
    SUBPATH(slot).u = hit.u;
    SUBPATH(slot).v = hit.v;
    SUBPATH(slot).distance = hit.distance;
    SUBPATH(slot).tint = floats_of(tint);
    SUBPATH(slot).lift = lift_off(hit, seen);
#ifdef KILN_GLOSS
    sort(slot, hit, s.body);
#endif
}

/* Adds to a pixel of the film: 64-bit numbers, the lower half first. */
void add_to_film(uint pixel, vec3 rgb)
{
    const real3 count = roundEven(real3(rgb) / real(BOTH.unit));
    const bool holds = count.x < real(9007199254740992.0LF) && count.y < real(9007199254740992.0LF) &&
                       count.z < real(9007199254740992.0LF); /* 2^53 */
    if (!holds) {
        BothCounts(BOTH.counts).at[0].too_much = 1u;
        return;
    }
    const u64vec3 units = u64vec3(count);
    for (uint c = 0u; c < 3u; c++)
        if (units[c] != 0ul && !add_words(BOTH.film + 24ul * pixel + 8ul * c, 2u, uint(units[c]), uint(units[c] >> 32)))
            BothCounts(BOTH.counts).at[0].too_much = 1u;
}

/* Traces a shadow ray between light and a path's vertex or the camera, and adds the light let through. */
void intersect_shadow(uint number)
{
    const kiln_gpu_shadow_ray r = SHADOW_RAY(number);
    const vec3 brings = vec3_in(r.brings);
    if (ASKS == KILN_GPU_RAYS_TO_PATHS) {
        const vec3 through = kiln_through(r.origin, r.direction, r.limit);
        Counted light = Counted(brings * through, vec3(0.0));
        vec2 counts = vec2(0.0);
        if (POINTS) {
            const kiln_gpu_point_ray p = POINT_RAY(number);
            light.last = vec3_in(p.last) * through;
            counts = vec2(p.irradiance, p.incident);
        }
        add_light_to(r.to, light, counts);
    } else {
        vec3 tint;
        if (nearest(r.origin, r.direction, r.limit, r.chance, true, tint).triangle == KILN_GPU_NONE)
            add_to_film(r.to, brings * tint);
    }
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    if (ASKS == KILN_GPU_RAYS_NEXT)
        intersect_closest(slot_of(x));
    else
        intersect_shadow(push.offset + x);
    if (!still_loops(push.count))
        BothCounts(BOTH.counts).at[0].stopped = 1u;
}

#include "shaders/main.glsl"
