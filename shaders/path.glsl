/* Paths of pixels: thread x follows samples first_sample .. first_sample + samples - 1 of pixel `index` + x, and adds
 * them to what earlier dispatches have left in `sums`, sample after sample, so that it does not matter how they are
 * dealt out. Ways, random numbers and estimators are those of worker/backend/embree/path.c.
 *
 * path.comp is without surfaces that are not only diffuse, path_gloss.comp, with KILN_GLOSS, has them. */
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/shared/path.h"
#include "shaders/shared/streams.h"
#include "shaders/sum.glsl"

KILN_PUSH(kiln_gpu_path_push);

#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/lights.glsl"
#ifdef KILN_GLOSS
#    include "shaders/gloss.glsl"
const bool HAS_GLOSS = true;
#else
const bool HAS_GLOSS = false;
#endif

KILN_ARRAY(PathTriangles, kiln_gpu_path_triangle, 4);
KILN_ARRAY(PathSums, kiln_gpu_path_sums, 4);

/* The path under way. */
uint pixel_key, sample_number;
vec3 weight, radiance; /* what of the radiance that comes now reaches the camera; and what has */
vec3 seen;             /* as weight, of what the next surface emits itself: 0 where light samples have brought that */
uint bounces, chain;   /* diffuse surfaces that have sent the path on; others since the last one */
uint rays;
bool good; /* the device has ended no loop early */

struct Meeting { /* a surface that a path meets, on the side that it comes from */
    uint triangle;
    float u, v;
    vec3 position, normal, shading; /* normals: geometric and of the mesh */
    float offset;
    bool gloss; /* it is not only diffuse */
};

#ifdef KILN_GLOSS
/* Of the surface that the path is at, where it is not only diffuse: its scattering, the columns of the frame for that,
 * of its front, where the path comes from in it, the shares of the lobes for that, which of them are not diffuse, and
 * of these the ones whose light is what the path's rays meet. */
kiln_bsdf_lobes lobes;
mat3 frame;
vec3 from;
kiln_bsdf_choice shares;
uint others, sharp;
#endif

/* Two numbers of this sample, as fractions of 2^32. */
uvec2 draw(uint use)
{
    uint a, b;
    kiln_path_numbers(kiln_path_key(pixel_key, use), sample_number, a, b);
    return uvec2(a, b);
}

kiln_hit trace(vec3 origin, vec3 direction, uint surface)
{
    vec3 tint;
    const uint chance = kiln_path_key(pixel_key, kiln_path_use(surface, KILN_PATH_CHANCE));
    const kiln_hit hit = kiln_trace_by_chance(origin, direction, kiln_hash2(chance, sample_number), tint);
    if (HAS_ALPHA == KILN_PASSAGE_TINT) {
        weight *= tint;
        seen *= tint;
    }
    return hit;
}

uint material_of(uint triangle)
{
    return floatBitsToUint(RecordHalves(SCENE.records + uint64_t(triangle) * 32ul).at[1].w);
}

/* KILN_GPU_GLOSS_...; 0: it is diffuse */
uint gloss_of(uint triangle)
{
#ifdef KILN_GLOSS
    return kiln_gloss_flags(material_of(triangle) & KILN_RECORD_MATERIAL);
#else
    return 0u;
#endif
}

/* Whether a ray that comes from this side finds the surface there. */
bool has_side(kiln_hit hit)
{
    return !hit.back || (material_of(hit.triangle) & KILN_RECORD_DOUBLE_SIDED) != 0u ||
           (gloss_of(hit.triangle) & KILN_GPU_GLOSS_TRANSMITS) != 0u;
}

kiln_gpu_path_triangle triangle_at(uint triangle)
{
    return PathTriangles(push.triangles + uint64_t(triangle) * 92ul).at[0];
}

/* What the camera sees along the ray; its triangle is KILN_GPU_NONE: nothing but the environment. */
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

#ifdef KILN_GLOSS
/* The scattering of a surface that is not only diffuse; normals are those of the front. */
void find_lobes(kiln_gpu_path_triangle t, vec3 direction, inout Meeting m)
{
    /* a shading normal on the other side of the ray's direction would make a front of a back */
    if ((dot(m.shading, direction) < 0.0) != (dot(m.normal, direction) < 0.0))
        m.shading = m.normal;
    lobes = kiln_surface_lobes(material_of(m.triangle) & KILN_RECORD_MATERIAL, m.triangle, m.u, m.v, m.shading, t.e1,
                               t.e2, frame);
    from = -direction * frame;
    shares = kiln_bsdf_shares(lobes, from);
    others = KILN_LOBE_GLOSS | (lobes.coat.strength > 0.0 ? KILN_LOBE_COAT : 0u);
    sharp = others & kiln_path_sharp(lobes.alpha_x, lobes.alpha_y, lobes.p.coat_alpha, lobes.glass > 0.0);
}
#endif

/* Of the ray that has come in `direction`; `first`: it is the surface that the camera sees. */
Meeting meet(kiln_hit hit, vec3 direction, bool first)
{
    const kiln_gpu_path_triangle t = triangle_at(hit.triangle);
    Meeting m;
    m.triangle = hit.triangle;
    m.u = hit.u;
    m.v = hit.v;
    m.position = t.p + (t.e1 * hit.u + t.e2 * hit.v);
    m.normal = t.normal;
    m.shading = t.normal;
    m.offset = t.offset;
    m.gloss = gloss_of(hit.triangle) != 0u;
    if (HAS_SMOOTH != 0u && (first || m.gloss) && (t.flags & KILN_GPU_PATH_SMOOTH) != 0u) {
        const vec3 mesh = t.shading0 * (1.0 - hit.u - hit.v) + t.shading1 * hit.u + t.shading2 * hit.v;
        if (dot(mesh, t.normal) > 0.0)
            m.shading = normalize(mesh);
    }
#ifdef KILN_GLOSS
    if (m.gloss)
        find_lobes(t, direction, m);
#endif
    if (hit.back) {
        m.normal = -m.normal;
        m.shading = -m.shading;
    }
    return m;
}

#ifdef KILN_GLOSS
/* What the body that the ray has come through has left of the light: the ray meets its surface from within. */
void attenuate(kiln_hit hit)
{
    if (!hit.back || (gloss_of(hit.triangle) & KILN_GPU_GLOSS_VOLUME) == 0u)
        return;
    const vec3 share = kiln_gloss_attenuation(material_of(hit.triangle) & KILN_RECORD_MATERIAL, hit.distance);
    weight *= share;
    seen *= share;
}

kiln_bsdf_value evaluate(vec3 i, uint which)
{
    return kiln_bsdf_evaluate_chosen(lobes, kiln_bsdf_choice_of(shares, which), from, i, KILN_RADIANCE, which);
}

/* What a surface that is not only diffuse sends to the path of light from a direction, times the cosine: of light that
 * rays meet themselves, what its sharp lobes do is left to these. */
vec3 scatter(kiln_light_sample s, vec3 towards)
{
    return evaluate(towards * frame, s.has_extent ? KILN_LOBE_ALL & ~sharp : KILN_LOBE_ALL).value;
}
#endif

/* ---- straight from the lights ---- */

void add_sample(Meeting m, kiln_light_choice choice, kiln_light_sample s)
{
    const real3 n = real3(m.normal);
    const real cosine = dot(real3(m.shading), s.direction);
    if (!(dot(n, s.direction) > 0) || !(cosine > 0))
        return;
    rays++;
    float limit;
    vec3 value = vec3(s.value * (cosine / (real(choice.samples) * KILN_REAL_PI)));
    const vec3 towards = kiln_shadow_ray(s, n * real(m.offset), limit);
    const vec3 through = kiln_through(m.position + m.normal * m.offset, towards, limit);
#ifdef KILN_GLOSS
    if (m.gloss && through != vec3(0.0))
        value = vec3(s.value / real(choice.samples)) * scatter(s, towards);
#endif
    radiance += weight * value * through;
}

void add_direct(Meeting m, uint surface)
{
    const real3 n = real3(m.normal), p = real3(m.position), shading = real3(m.shading);
    const uint candidates = kiln_lights_choose(p, 0, n, 1u, light_kind(KILN_GPU_KIND_IMAGE));
    uint i = 0u;
    for (; i < candidates; i++) {
        kiln_light_choice choice;
        if (!kiln_lights_candidate(i, n, 1u, choice))
            continue;
        const bool sky = choice.kind == KILN_CHOICE_ENVIRONMENT;
        choice.samples = sky ? 2u : 1u;
        for (uint index = 0u; index < choice.samples; index++) {
            const uvec2 place = draw(kiln_path_use(surface, sky ? KILN_PATH_SKY + index : KILN_PATH_LIGHT)),
                        pick = draw(kiln_path_use(surface, KILN_PATH_PICK));
            kiln_light_sample s;
            if (kiln_lights_sample(choice, index, p, n, shading, real_unit(pick.x), real_unit(place.x),
                                   real_unit(place.y), s))
                add_sample(m, choice, s);
        }
    }
    good = good && i >= candidates;
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
/* Weighs a direction that is drawn from the lobes `which`, and gives the share of the sharp ones in it, by colour. One
 * loop, so that the long code of scattering functions stands here only once. */
vec3 weigh(uint which, inout kiln_bsdf_drawn d)
{
    const uint some = sharp & which;
    const bool all_sharp = d.delta || some == which;
    const uint parts = d.delta || d.i.z == 0.0 ? 0u : some == 0u || all_sharp ? 1u : 2u;
    vec3 share = vec3(all_sharp ? 1.0 : 0.0), all = vec3(0.0);
    for (uint part = 0u; part < parts; part++) {
        const kiln_bsdf_value s = evaluate(d.i, part == 0u ? which : some);
        if (part == 0u) {
            all = s.value;
            d.weight = s.density > 0.0 ? s.value / s.density : vec3(0.0);
        } else
            share = mix(vec3(0.0), s.value / all, greaterThan(all, vec3(0.0)));
    }
    return share;
}

/* The way on from a surface that is not only diffuse. Chance chooses whether the diffuse surface sends the path on or
 * the other lobes do, so that bounces can be counted. */
bool turn_by_lobes(Meeting m, uint surface, out vec3 direction, out bool diffuse)
{
    const uvec2 numbers = draw(kiln_path_use(surface, KILN_PATH_BOUNCE)),
                picks = draw(kiln_path_use(surface, KILN_PATH_LOBE));
    const float chance = kiln_bsdf_choice_of(shares, KILN_LOBE_ALL).diffuse;
    diffuse = real_unit(picks.x) < real(chance);
    const uint which = diffuse ? KILN_LOBE_DIFFUSE : others;
    kiln_bsdf_drawn d = kiln_bsdf_propose(lobes, kiln_bsdf_choice_of(shares, which), from, kiln_unit_float(picks.y),
                                          kiln_unit_float(numbers.x), kiln_unit_float(numbers.y), KILN_RADIANCE);
    const vec3 share = weigh(which, d);
    weight *= d.weight / (diffuse ? chance : 1.0 - chance);
    seen = weight * share;
    direction = frame * d.i;
    const bool same = (d.i.z > 0.0) == (from.z > 0.0); /* in truth as by the shading normal */
    return d.i.z != 0.0 && (dot(m.normal, direction) > 0.0) == same && max(weight.r, max(weight.g, weight.b)) > 0.0;
}
#endif

/* Chooses the way on, and weighs it as the gather pass does; false: it brings nothing. `diffuse`: the diffuse surface
 * sends the path on. */
bool turn(Meeting m, uint surface, out vec3 direction, out bool diffuse)
{
    diffuse = true;
#ifdef KILN_GLOSS
    if (m.gloss)
        return turn_by_lobes(m, surface, direction, diffuse);
#endif
    seen = vec3(0.0);
    const uvec2 numbers = draw(kiln_path_use(surface, KILN_PATH_BOUNCE));
    const vec3 both = m.normal + m.shading;
    float cosine;
    direction = cosine_about(both == vec3(0.0) ? both : normalize(both), kiln_unit_float(numbers.x),
                             kiln_unit_float(numbers.y), cosine);
    const float share = kiln_shading_weight(dot(m.shading, direction), cosine);
    weight *= share;
    return share > 0.0 && dot(m.normal, direction) > 0.0;
}

/* Whether a path that has no last surface, or goes from mirror to mirror, goes on from surface number `surface`. */
bool survives(uint surface)
{
    const bool endless = push.bounces == KILN_PATH_ALL_BOUNCES || (HAS_GLOSS && chain >= KILN_PATH_CHAIN);
    if (!endless || surface < KILN_PATH_CERTAIN)
        return true;
    const float chance = kiln_path_chance(weight.r, weight.g, weight.b);
    weight /= chance;
    return kiln_unit_float(draw(kiln_path_use(surface, KILN_PATH_END)).x) < chance;
}

/* From surface number `surface` to the next; false: the path ends. */
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
    const float side = m.gloss && !(dot(m.normal, direction) > 0.0) ? -m.offset : m.offset;
    hit = trace(m.position + m.normal * side, direction, surface + 1u);
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
    const uvec2 place = draw(0u);
    const uint row = uint(pixel / push.width), column = uint(pixel - uint64_t(row) * push.width);
    const real x = (real(column) + real_unit(place.x)) / real(push.width) * 2 - 1,
               y = 1 - (real(row) + real_unit(place.y)) / real(push.height) * 2;
    const vec3 aside = push.right * float(x) + push.up * float(y);
    const bool parallel = push.orthographic != 0u;
    origin = parallel ? push.position + aside : push.position;
    direction = normalize(parallel ? push.forward : push.forward + aside);
    if (push.lens_radius > 0.0) {
        const uvec2 spot = draw(KILN_PATH_LENS);
        const vec3 start = kiln_path_lens(push.right, push.up, push.lens_radius, float(real_unit(spot.x)),
                                          float(real_unit(spot.y)));
        origin += start;
        direction = normalize((push.forward + aside) * push.focus_distance - start);
    }
}

void follow(uint64_t pixel)
{
    vec3 origin, direction;
    weight = vec3(1.0);
    seen = vec3(1.0);
    radiance = vec3(0.0);
    bounces = 0u;
    chain = 0u;
    camera_ray(pixel, origin, direction);
    kiln_hit hit = look(origin, direction);
    if (hit.triangle == KILN_GPU_NONE) {
        radiance = weight * kiln_environment_radiance(real3(direction));
        return;
    }
    bool under_way = true;
    for (uint surface = 0u; under_way; surface++) {
        const bool first = surface == 0u;
        const Meeting m = meet(hit, direction, first);
#ifdef KILN_GLOSS
        attenuate(hit);
#endif
        const bool shows = HAS_GLOSS ? seen != vec3(0.0) : first;
        if (shows && (material_of(m.triangle) & KILN_RECORD_EMITS) != 0u)
            radiance += (HAS_GLOSS ? seen : weight) * kiln_surface_emission(m.triangle, m.u, m.v);
        if (!m.gloss)
            weight *= kiln_surface_color(m.triangle, m.u, m.v, first);
        under_way = m.gloss || max(weight.r, max(weight.g, weight.b)) > 0.0;
        if (under_way) {
            add_direct(m, surface);
            under_way = go_on(m, surface, direction, hit);
        }
    }
    good = good && !under_way;
}

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count || y > 0u)
        return;
    const uint64_t pixel = push.index + x;
    PathSums all = PathSums(push.sums + uint64_t(x) * 40ul);
    kiln_gpu_path_sums sums = all.at[0];
    pixel_key = kiln_hash2(kiln_hash2(push.seed, uint(pixel)), uint(pixel >> 32));
    rays = 0u;
    good = true;
    uint k = 0u;
    for (; k < push.samples; k++) {
        sample_number = push.first_sample + k;
        follow(pixel);
        const float luminance = float_luminance(radiance);
        const float added[4] = float[4](radiance.r, radiance.g, radiance.b, luminance * luminance);
        for (uint c = 0u; c < 4u; c++) {
            kiln_sum sum = kiln_sum(sums.high[c], sums.low[c]);
            kiln_add(sum, added[c]);
            sums.high[c] = sum.high;
            sums.low[c] = sum.low;
        }
    }
    good = good && k >= push.samples && sums.count != KILN_GPU_PATH_STOPPED;
    sums.count = good ? sums.count + push.samples : KILN_GPU_PATH_STOPPED;
    sums.rays += rays;
    all.at[0] = sums;
}

#include "shaders/main.glsl"
