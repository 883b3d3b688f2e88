/* Paths of pixels: thread x follows samples first_sample .. first_sample + samples - 1 of pixel `index` + x, and adds
 * them to the sums of earlier dispatches in `sums`, sample after sample, so that the division into dispatches does not
 * matter. Directions, random numbers and estimators equal those of worker/backend/embree/path.c.
 *
 * With KILN_GLOSS some surfaces are not only diffuse. Code for these would slow down paths at other surfaces, so two
 * kernels alternate: path_diffuse.comp, with KILN_WALK_DIFFUSE, begins paths and follows them until they hit gloss;
 * path.comp follows them from there until they hit a diffuse surface. path_add.comp sums up. */
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/shared/streams.h"

KILN_PUSH(kiln_gpu_path_push);

#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#define KILN_WALK_LIGHTS
#define KILN_LIFTS
#include "shaders/walk.glsl"

#include "shaders/path_sums.glsl"

/* The path under way. */
vec3 weight, radiance; /* weight of incoming radiance at the camera; radiance collected so far */
vec3 seen;             /* weight for the next surface's emission: 0 if light samples have accounted for it */
uint bounces, chain;   /* diffuse events so far; other surfaces since the last one */
uint rays;
bool good; /* the device has ended no loop early */

kiln_hit trace(vec3 origin, vec3 direction, uint surface)
{
    vec3 tint;
    const kiln_hit hit = walk_trace(origin, direction, kiln_path_use(surface, KILN_PATH_CHANCE), tint);
    if (HAS_ALPHA >= KILN_PASSAGE_TINT) {
        weight *= tint;
        seen *= tint;
    }
    return hit;
}

/* Returns the surface that the camera sees along the ray; its triangle is KILN_GPU_NONE if there is only the
 * environment. */
kiln_hit look(vec3 origin, vec3 direction)
{
    kiln_hit hit;
    rays++;
    for (uint i = 0u; i <= KILN_PATH_UNSEEN; i++) {
        hit = trace(origin, direction, 0u);
        if (hit.triangle == KILN_GPU_NONE)
            return hit;
        if ((triangle_at(hit.triangle).flags & KILN_GPU_PATH_HIDDEN) == 0u && has_side(hit))
            return hit;
        origin += direction * kiln_path_beyond(hit.distance, push.extent);
    }
    hit.triangle = KILN_GPU_NONE;
    return hit;
}

/* ---- the way on ---- */

vec3 cosine_about(vec3 axis, float u, float v, out float cosine)
{
    vec3 s, t;
    kiln_basis(axis, s, t);
    const float radius = sqrt(u), turn = 6.283185307179586 * v;
    cosine = sqrt(1.0 - u);
    return axis * cosine + s * (radius * cos(turn)) + t * (radius * sin(turn));
}

#ifdef KILN_GLOSS
/* Draws a direction at a surface that is not only diffuse. Chooses at random between the diffuse part and the other
 * lobes, so that bounces can be counted. */
bool turn_by_lobes(Meeting m, uint surface, out vec3 direction, out bool diffuse)
{
    const uvec2 picks = walk_draw(kiln_path_use(surface, KILN_PATH_LOBE));
    const float chance = kiln_bsdf_choice_of(shares, KILN_LOBE_ALL).diffuse;
    vec3 value, share;
    diffuse = real_unit(picks.x) < real(chance);
    const bool sends =
        walk_send(m, surface, diffuse ? KILN_LOBE_DIFFUSE : others, kiln_unit_float(picks.y), direction, value, share);
    weight *= value / (diffuse ? chance : 1.0 - chance);
    seen = weight * share;
    return sends && max(weight.r, max(weight.g, weight.b)) > 0.0;
}
#endif

/* Draws the continuing direction, weighted as in the gather pass; false: it contributes nothing. `diffuse`: whether the
 * diffuse part was drawn. */
bool turn(Meeting m, uint surface, out vec3 direction, out bool diffuse)
{
    diffuse = true;
#ifdef KILN_MEETS_GLOSS
    if (m.gloss)
        return turn_by_lobes(m, surface, direction, diffuse);
#endif
    seen = vec3(0.0);
    const uvec2 numbers = walk_draw(kiln_path_use(surface, KILN_PATH_BOUNCE));
    const vec3 both = m.normal + m.shading;
    float cosine;
    direction = cosine_about(both == vec3(0.0) ? both : normalize(both), kiln_unit_float(numbers.x),
                             kiln_unit_float(numbers.y), cosine);
    const float share = kiln_shading_weight(dot(m.shading, direction), cosine);
    weight *= share;
    return share > 0.0 && (m.lifted || dot(m.normal, direction) > 0.0);
}

/* Russian roulette at surface number `surface`, for paths without a limit of bounces, or between mirrors. */
bool survives(uint surface)
{
    const bool endless = push.bounces == KILN_PATH_ALL_BOUNCES || (HAS_GLOSS && chain >= KILN_PATH_CHAIN);
    if (!endless || surface < KILN_PATH_CERTAIN)
        return true;
    const float chance = kiln_path_chance(weight.r, weight.g, weight.b);
    weight /= chance;
    return kiln_unit_float(walk_draw(kiln_path_use(surface, KILN_PATH_END)).x) < chance;
}

/* Traces from surface number `surface` to the next; false: the path ends. */
bool go_on(Meeting m, uint surface, out vec3 direction, out kiln_hit hit)
{
    const bool sky = light_kind(KILN_GPU_KIND_SKY), no_more = (HAS_GLOSS ? bounces : surface) == push.bounces;
    bool diffuse;
    if ((!m.gloss && no_more && !sky) || !survives(surface) || !turn(m, surface, direction, diffuse))
        return false;
    const bool last = diffuse && no_more;
    if (last && !sky)
        return false;
    bounces += diffuse ? 1u : 0u;
    chain = diffuse ? 0u : chain + 1u;
    rays++;
    hit = trace(meeting_start(m, direction), direction, surface + 1u);
    if (hit.triangle != KILN_GPU_NONE)
        return !last && has_side(hit);
    if (sky)
        radiance += weight * kiln_environment_radiance(real3(direction));
    else if (HAS_GLOSS && light_kind(KILN_GPU_KIND_IMAGE))
        radiance += seen * kiln_environment_radiance(real3(direction));
    return false;
}

/* ---- paths ---- */

void camera_ray(uint64_t pixel, out vec3 origin, out vec3 direction)
{
    const uvec2 place = walk_draw(0u);
    const uint row = uint(pixel / push.width), column = uint(pixel - uint64_t(row) * push.width);
    const real x = (real(column) + real_unit(place.x)) / real(push.width) * 2 - 1,
               y = 1 - (real(row) + real_unit(place.y)) / real(push.height) * 2;
    const vec3 aside = push.right * float(x) + push.up * float(y);
    const bool parallel = push.orthographic != 0u;
    origin = parallel ? push.position + aside : push.position;
    direction = normalize(parallel ? push.forward : push.forward + aside);
    if (push.lens_radius > 0.0) {
        const uvec2 spot = walk_draw(KILN_PATH_LENS);
        const vec3 start =
            kiln_path_lens(push.right, push.up, push.lens_radius, float(real_unit(spot.x)), float(real_unit(spot.y)));
        origin += start;
        direction = normalize((push.forward + aside) * push.focus_distance - start);
    }
}

/* Shades surface number `surface`, at `hit`. False: the path ends there. */
bool shade_surface(uint surface, inout vec3 direction, inout kiln_hit hit)
{
    const bool first = surface == 0u;
    Meeting m = meet(hit, direction, first);
    if (HAS_SMOOTH != 0u && (first || m.gloss)) {
        const kiln_gpu_path_triangle t = triangle_at(hit.triangle);
        m.lifted = is_coarse(hit.triangle, t, hit.back);
        if (m.lifted)
            m.lift = lift_at(t, hit.back, hit.u, hit.v);
    }
#ifdef KILN_GLOSS
    const vec3 left = attenuation(hit);
    weight *= left;
    seen *= left;
#endif
    const bool shows = HAS_GLOSS ? seen != vec3(0.0) : first;
    if (shows && (material_of(m.triangle) & KILN_RECORD_EMITS) != 0u)
        radiance += (HAS_GLOSS ? seen : weight) * kiln_surface_emission(m.triangle, m.u, m.v);
    if (!m.gloss)
        weight *= kiln_surface_color(m.triangle, m.u, m.v, first);
    bool under_way = m.gloss || max(weight.r, max(weight.g, weight.b)) > 0.0;
    under_way = under_way && kiln_path_allows(push.path_length, surface + 2u);
    if (under_way) {
#ifdef KILN_GLOSS
        good = walk_lights(m, surface, KILN_LOBE_ALL, weight, radiance, rays) && good;
#else
        good = walk_lights(m, surface, 0u, weight, radiance, rays) && good;
#endif
        under_way = go_on(m, surface, direction, hit);
    }
    return under_way;
}

/* Begins a path; false: it hits no surface. */
bool init_from_camera(uint64_t pixel, out vec3 direction, out kiln_hit hit)
{
    vec3 origin;
    weight = vec3(1.0);
    seen = vec3(1.0);
    radiance = vec3(0.0);
    bounces = 0u;
    chain = 0u;
    camera_ray(pixel, origin, direction);
    hit = look(origin, direction);
    if (hit.triangle == KILN_GPU_NONE)
        radiance = weight * kiln_environment_radiance(real3(direction));
    return hit.triangle != KILN_GPU_NONE;
}

uint pixel_key(uint64_t pixel) { return kiln_hash2(kiln_hash2(push.seed, uint(pixel)), uint(pixel >> 32)); }

#ifdef KILN_GLOSS
#    include "shaders/path_apart.glsl"
#else
void follow(uint64_t pixel)
{
    vec3 direction;
    kiln_hit hit;
    bool under_way = init_from_camera(pixel, direction, hit);
    for (uint surface = 0u; under_way; surface++)
        under_way = shade_surface(surface, direction, hit);
    good = good && !under_way;
}

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count || y > 0u)
        return;
    const uint64_t pixel = push.index + x;
    PathSums all = PathSums(push.sums + uint64_t(x) * 40ul);
    kiln_gpu_path_sums sums = all.at[0];
    walk_key = pixel_key(pixel);
    rays = 0u;
    good = true;
    uint k = 0u;
    for (; k < push.samples; k++) {
        walk_sample = push.first_sample + k;
        follow(pixel);
        path_add(sums, radiance);
    }
    path_end(sums, good && k >= push.samples && still_loops(push.count), rays);
    all.at[0] = sums;
}
#endif

#include "shaders/main.glsl"
