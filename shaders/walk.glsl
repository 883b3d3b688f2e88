/* Common code of paths (path.glsl) and chains (chain.glsl): they go from surface to surface, with random numbers of
 * their own, and sample the lights at each surface. Directions, random numbers and estimators equal those of
 * worker/backend/embree/meeting.c and walk.c.
 *
 * Before it stand shaders/trace/trace.glsl and shaders/surface.glsl. With KILN_GLOSS surfaces may be more than diffuse
 * (gloss.glsl), with KILN_WALK_LIGHTS lights are sampled (lights.glsl). A thread has one walk at a time. */
#ifndef KILN_SHADERS_WALK_GLSL
#define KILN_SHADERS_WALK_GLSL
#ifdef KILN_LIFTS
#    include "shaders/shared/lift.h"
#endif
#include "shaders/shared/path.h"
#include "shaders/shared/streams.h"
#ifdef KILN_WALK_LIGHTS
#    include "shaders/lights.glsl"
#endif
#ifdef KILN_GLOSS
#    include "shaders/gloss.glsl"
const bool HAS_GLOSS = true;
#else
const bool HAS_GLOSS = false;
#endif

/* With KILN_WALK_DIFFUSE, a kernel of a scene with gloss processes diffuse surfaces only. */
#if defined(KILN_GLOSS) && !defined(KILN_WALK_DIFFUSE)
#    define KILN_MEETS_GLOSS
const bool MEETS_GLOSS = true;
#else
const bool MEETS_GLOSS = false;
#endif

/* KILN_LEAVES_...: lamps whose light through sharp lobes is left out. */
#ifndef KILN_WALK_LEAVES
#    define KILN_WALK_LEAVES 0u
#endif

KILN_ARRAY(PathTriangles, kiln_gpu_path_triangle, 4);

uint walk_key, walk_sample; /* key of the random numbers; number of the sample */

struct Meeting { /* surface hit by a path, on the side of the ray */
    uint triangle;
    float u, v;
    vec3 position, normal, shading; /* normals: geometric and of the mesh */
    float offset;
    bool gloss; /* it is not only diffuse */
    bool back, coarse, lifted;
    float lift; /* as of struct meeting: set with KILN_LIFTS alone */
};

#ifdef KILN_GLOSS
/* Scattering of the walk's present surface, if it is not only diffuse. `frame`: columns of the frame of its front.
 * `from`: direction to the previous surface, in the frame. `albedo`: of the lobes in that direction. `shares`: sampling
 * shares of the lobes. `others`: lobes that are not diffuse. `sharp`: lobes whose light the walk's rays find. */
kiln_bsdf_lobes lobes;
mat3 frame;
vec3 from;
kiln_bsdf_albedo albedo;
kiln_bsdf_choice shares;
uint others, sharp;
#endif

/* Two random numbers of this sample, as fractions of 2^32. */
uvec2 walk_draw(uint use)
{
    uint a, b;
    kiln_path_numbers(kiln_path_key(walk_key, use), walk_sample, a, b);
    return uvec2(a, b);
}

/* Seed of the random decisions of a ray about surfaces that let light through. */
uint walk_seed(uint use) { return kiln_hash2(kiln_path_key(walk_key, use), walk_sample); }

/* The nearest hit of a ray; random number `use` decides about surfaces that let light through. */
kiln_hit walk_trace(vec3 origin, vec3 direction, uint use, out vec3 tint)
{
    return kiln_trace_by_chance(origin, direction, walk_seed(use), tint);
}

/* Whether the device still executes loops. A software device ends them after 65,535 iterations in all, each later one
 * at the end of its first iteration. That includes the loops of tracing, so a path may end as if its ray had hit
 * nothing. `threads`: of the dispatch, above 0. */
bool still_loops(uint threads)
{
    uint rounds = 0u;
    for (uint k = 0u; k < 3u * min(threads, 1u); k++)
        rounds++;
    return rounds == 3u;
}

uint material_of(uint triangle)
{
    return floatBitsToUint(RecordHalves(SCENE.records + uint64_t(triangle) * 32ul).at[1].w);
}

/* KILN_GPU_GLOSS_...; 0: the surface is diffuse */
uint gloss_of(uint triangle)
{
#ifdef KILN_GLOSS
    const uint material = material_of(triangle);
    return (material & KILN_RECORD_GLOSS) != 0u ? kiln_gloss_flags(material & KILN_RECORD_MATERIAL) : 0u;
#else
    return 0u;
#endif
}

/* Whether the hit side of a surface scatters light: a front, the back of a double-sided surface, or glass. */
bool has_side(kiln_hit hit)
{
    return !hit.back || (material_of(hit.triangle) & KILN_RECORD_DOUBLE_SIDED) != 0u ||
           (gloss_of(hit.triangle) & KILN_GPU_GLOSS_TRANSMITS) != 0u;
}

kiln_gpu_path_triangle triangle_at(uint triangle)
{
    return PathTriangles(SCENE.path_triangles + uint64_t(triangle) * 104ul).at[0];
}

/* Returns the normal of the front: the smooth mesh's if it is on the same side as the geometric one, else the latter.
 */
vec3 mesh_normal(kiln_gpu_path_triangle t, float u, float v)
{
    if (HAS_SMOOTH == 0u || (t.flags & KILN_GPU_PATH_SMOOTH) == 0u)
        return t.normal;
    const vec3 mesh = t.shading0 * (1.0 - u - v) + t.shading1 * u + t.shading2 * v;
    return dot(mesh, t.normal) > 0.0 ? normalize(mesh) : t.normal;
}

#ifdef KILN_GLOSS
/* Finds the scattering of a surface that is not only diffuse; normals are those of the front. */
void find_lobes(kiln_gpu_path_triangle t, vec3 direction, inout Meeting m)
{
    /* with a shading normal on the other side of the ray, front and back would be exchanged */
    if ((dot(m.shading, direction) < 0.0) != (dot(m.normal, direction) < 0.0))
        m.shading = m.normal;
    lobes = kiln_surface_lobes(material_of(m.triangle) & KILN_RECORD_MATERIAL, m.triangle, m.u, m.v, m.shading, t.e1,
                               t.e2, frame);
    from = -direction * frame;
    albedo = kiln_bsdf_albedo_of(lobes, from);
    shares = kiln_bsdf_shares_of(albedo);
    others = KILN_LOBE_GLOSS | (lobes.coat.strength > 0.0 ? KILN_LOBE_COAT : 0u);
    sharp = others & kiln_path_sharp(lobes.alpha_x, lobes.alpha_y, lobes.p.coat_alpha, lobes.glass > 0.0);
}
#endif

/* Returns the surface hit by a ray with this `direction`. `first`: the camera sees the surface. */
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
    m.back = hit.back;
    m.coarse = false;
    m.lifted = false;
    m.lift = 0.0;
    m.gloss = MEETS_GLOSS && (material_of(hit.triangle) & KILN_RECORD_GLOSS) != 0u;
    if (first || m.gloss)
        m.shading = mesh_normal(t, hit.u, hit.v);
#ifdef KILN_MEETS_GLOSS
    if (m.gloss)
        find_lobes(t, direction, m);
#endif
    if (hit.back) {
        m.normal = -m.normal;
        m.shading = -m.shading;
    }
    return m;
}

/* Start of a ray that leaves the surface in a direction. */
vec3 meeting_start(Meeting m, vec3 direction)
{
    const float above = m.offset + m.lift;
    return m.position + m.normal * (m.lifted || dot(m.normal, direction) > 0.0 ? above : -above);
}

#ifdef KILN_LIFTS
/* Parameters for lifting rays off this side of a triangle. */
kiln_lift lifts_of(kiln_gpu_path_triangle t, bool back)
{
    const vec3 height = max(vec3(0.0), vec3(t.lift[0], t.lift[1], t.lift[2]) * (back ? -1.0 : 1.0));
    return kiln_lift(float[6](height.x, height.y, height.x, height.z, height.y, height.z));
}

/* Whether rays are lifted: the triangle is a coarse facet of a smooth mesh, and not of glass. */
bool is_coarse(uint triangle, kiln_gpu_path_triangle t, bool back)
{
    if (HAS_SMOOTH == 0u || (t.flags & KILN_GPU_PATH_SMOOTH) == 0u ||
        (gloss_of(triangle) & KILN_GPU_GLOSS_TRANSMITS) != 0u)
        return false;
    const vec3 height = vec3(t.lift[0], t.lift[1], t.lift[2]) * (back ? -1.0 : 1.0);
    return max(height.x, max(height.y, height.z)) > 0.0;
}

/* Returns the lift of a ray's start at (u, v) of a triangle, m: its height above the usual offset. The lift is at most
 * the share KILN_LIFT_CLEAR of the distance to the next surface above, so that the start does not pass through that. */
float lift_at(kiln_gpu_path_triangle t, bool back, float u, float v)
{
    const float most = kiln_lift_at(lifts_of(t, back), u, v);
    if (!(most > 0.0))
        return 0.0;
    const vec3 normal = back ? -t.normal : t.normal;
    const kiln_hit above =
        kiln_trace(t.p + (t.e1 * u + t.e2 * v) + normal * t.offset, normal, most / KILN_LIFT_CLEAR, KILN_EITHER);
    return above.triangle == KILN_GPU_NONE ? most : KILN_LIFT_CLEAR * above.distance;
}
#endif

#ifdef KILN_GLOSS
/* Returns the share of light, by colour, that is left after the body that the ray has crossed: 1 unless the ray hits
 * the body's surface from within. */
vec3 attenuation(kiln_hit hit)
{
    if (!hit.back || (gloss_of(hit.triangle) & KILN_GPU_GLOSS_VOLUME) == 0u)
        return vec3(1.0);
    return kiln_gloss_attenuation(material_of(hit.triangle) & KILN_RECORD_MATERIAL, hit.distance);
}

kiln_bsdf_value evaluate(vec3 i, uint which)
{
    return kiln_bsdf_evaluate_chosen(lobes, kiln_bsdf_choice_of(shares, which), from, i, KILN_RADIANCE, which);
}

/* Computes the weight of a direction drawn from the lobes `which`, and the share of sharp lobes in it, by colour. A
 * single loop, so that the long code of scattering functions exists once. */
vec3 weigh(uint which, inout kiln_bsdf_drawn d)
{
    const uint some = sharp & which;
    const bool all_sharp = d.delta || some == which;
#    ifdef KILN_WALK_LIGHTS
    const uint parts = d.delta || d.i.z == 0.0 ? 0u : some == 0u || all_sharp ? 1u : 2u;
#    else
    const uint parts = d.delta || d.i.z == 0.0 ? 0u : 1u;
#    endif
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

/* Draws a direction from the lobes `which` of surface number `surface`, by `pick` in (0, 1). */
kiln_bsdf_drawn walk_propose(uint surface, uint which, float pick)
{
    const uvec2 numbers = walk_draw(kiln_path_use(surface, KILN_PATH_BOUNCE));
    return kiln_bsdf_propose(lobes, kiln_bsdf_choice_of(shares, which), from, pick, kiln_unit_float(numbers.x),
                             kiln_unit_float(numbers.y), KILN_RADIANCE);
}

/* Whether the surface sends anything in the direction drawn, which is `direction` outside the frame. */
bool walk_sends(Meeting m, kiln_bsdf_drawn d, out vec3 direction)
{
    direction = frame * d.i;
    const bool same = (d.i.z > 0.0) == (from.z > 0.0); /* in truth as by the shading normal */
    return d.i.z != 0.0 && (m.lifted ? same : (dot(m.normal, direction) > 0.0) == same);
}

/* Draws and weighs a direction. `value`: value over density, by colour. `share`: share of sharp lobes in it, if lights
 * are sampled. False: it contributes nothing. */
bool walk_send(Meeting m, uint surface, uint which, float pick, out vec3 direction, out vec3 value, out vec3 share)
{
    kiln_bsdf_drawn d = walk_propose(surface, which, pick);
    share = weigh(which, d);
    value = d.weight;
    return walk_sends(m, d, direction);
}
#endif

#ifdef KILN_WALK_LIGHTS
/* ---- straight from the lights ---- */

#    ifdef KILN_GLOSS
/* The lobes of `which` that scatter a sample's light: sharp ones are left out where rays or light paths find the light
 * themselves. */
uint scattering_lobes(kiln_light_sample s, uint which)
{
    const bool left = s.has_extent || (KILN_WALK_LEAVES & KILN_LEAVES_POINTS) != 0u;
    return left ? which & ~sharp : which;
}
#    endif

/* Number of samples of a choice of lights at a surface. */
uint walk_samples(kiln_light_choice choice) { return choice.kind == KILN_CHOICE_ENVIRONMENT ? 2u : 1u; }

/* Draws sample `index` of a choice at surface number `surface`; false: it brings no light. */
bool walk_draw_light(Meeting m, uint surface, kiln_light_choice choice, uint index, out kiln_light_sample s)
{
    const bool sky = choice.kind == KILN_CHOICE_ENVIRONMENT;
    const uvec2 place = walk_draw(kiln_path_use(surface, sky ? KILN_PATH_SKY + index : KILN_PATH_LIGHT)),
                pick = walk_draw(kiln_path_use(surface, KILN_PATH_PICK));
    return kiln_sample_choice(choice, index, real3(m.position), real3(m.normal), real3(m.shading), real_unit(pick.x),
                              real_unit(place.x), real_unit(place.y), s);
}

/* The shadow ray of a light sample. False: the surface does not face the light. */
bool walk_shadow(Meeting m, kiln_light_sample s, out vec3 start, out vec3 towards, out float limit)
{
    const real3 n = real3(m.normal);
    const float above = m.offset + m.lift;
    start = m.position + m.normal * above;
    towards = kiln_shadow_ray(s, n * real(above), limit);
    return (m.lifted || dot(n, s.direction) > 0) && dot(real3(m.shading), s.direction) > 0;
}

/* `weight` times the light of a sample scattered by the lobes `which`, W/(m2 sr). Counts shadow rays. */
vec3 walk_light(Meeting m, uint which, kiln_light_choice choice, kiln_light_sample s, vec3 weight, inout uint rays)
{
    vec3 start, towards;
    float limit;
    if (!walk_shadow(m, s, start, towards, limit))
        return vec3(0.0);
    rays++;
    vec3 value = vec3(s.value * (dot(real3(m.shading), s.direction) / (real(choice.samples) * KILN_REAL_PI)));
    const vec3 through = kiln_through(start, towards, limit);
#    ifdef KILN_MEETS_GLOSS
    if (m.gloss && through != vec3(0.0))
        value = vec3(s.value / real(choice.samples)) * evaluate(towards * frame, scattering_lobes(s, which)).value;
#    endif
    return weight * value * through;
}

/* Adds `weight` times the light, directly from lights, that the lobes `which` of surface number `surface` (if diffuse:
 * 1 / pi) scatter, W/(m2 sr), by colour. Takes one sample of the light tree, one of each directional light, two of an
 * environment with an image. Leaves out a constant sky, and light through sharp lobes that rays find themselves. False:
 * the device has ended a loop early. */
bool walk_lights(Meeting m, uint surface, uint which, vec3 weight, inout vec3 sum, inout uint rays)
{
    const real3 n = real3(m.normal), p = real3(m.position);
    const real3 about = m.lifted ? real3(0) : n; /* lights from below it, too */
    const uint candidates = kiln_lights_choose(p, 0, about, 1u, light_kind(KILN_GPU_KIND_IMAGE));
    uint i = 0u;
    for (; i < candidates; i++) {
        kiln_light_choice choice;
        if (!kiln_lights_candidate(i, about, 1u, choice))
            continue;
        choice.samples = walk_samples(choice);
        for (uint index = 0u; index < choice.samples; index++) {
            kiln_light_sample s;
            if (walk_draw_light(m, surface, choice, index, s))
                sum += walk_light(m, which, choice, s, weight, rays);
        }
    }
    return i >= candidates;
}
#endif

#endif
