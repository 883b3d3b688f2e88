/* Chains of the weighed pass (worker/pass/weighed.h): as worker/backend/embree/chain_weighed.c. Replaces chain.glsl,
 * and follows the same rule for chains. Before it stand the kernel's push constants, with the address of struct
 * kiln_gpu_both and the number of samples. */
#include "shaders/bidirectional.glsl"
#include "shaders/techniques.glsl"
#include "shaders/chain.glsl"

/* Sums of the chain under way. */
kiln_caustic_gathered sums_of_chain;
Lit lit_before; /* the surface where the chain's ray started */

real weigh_hit(uint light, real3 place, real3 direction)
{
    return kiln_caustic_weight_hit(LAND.mis, sums_of_chain, techniques_connect(light, lit_before, place, direction),
                                   techniques_emission(light, lit_before, place, direction));
}

void shade_light(inout Chain c, kiln_hit hit, Meeting m, vec3 direction)
{
    if ((material_of(hit.triangle) & KILN_RECORD_EMITS) == 0u)
        return;
    const uint light = kiln_area_light_at(hit.triangle, hit.u, hit.v);
    real weight = 1;
    if (light != KILN_GPU_NONE &&
        !(hit.back && (AreaLights(SCENE.lights.areas).at[light].flags & KILN_GPU_LIGHT_TWO_SIDED) == 0u))
        weight = weigh_hit(light, real3(m.position), real3(-direction));
    c.light += chain_weight * float(weight) * kiln_surface_emission(hit.triangle, hit.u, hit.v);
}

void shade_background(inout Chain c, vec3 direction)
{
    if (SCENE.lights.environment == 0u)
        return;
    const real3 from = real3(-direction);
    c.light += chain_weight * float(weigh_hit(emission_environment(), from, from)) *
               kiln_environment_radiance(real3(direction));
}

/* Whether the surface has, besides the diffuse part, only mirrors and smooth glass: light samples contribute nothing
 * there. */
bool is_smooth(Vertex v)
{
    const kiln_bsdf_choice c = kiln_bsdf_choice_of(v.shares, others);
    return c.near == 0.0 && c.far == 0.0 && (c.gloss == 0.0 || (v.mirrors & KILN_LOBE_GLOSS) != 0u) &&
           (c.coat == 0.0 || (v.mirrors & KILN_LOBE_COAT) != 0u);
}

/* Returns the number of light samples at a surface: of the tree, of the environment, of each directional light. */
uint sample_count(Vertex v) { return is_smooth(v) ? 0u : 2u + SCENE.lights.directional_count; }

/* Draws light sample number `i`; false: it contributes nothing. */
bool draw_sample(Vertex v, uint surface, uint i, out kiln_light_sample s, out uint light)
{
    const bool tree = i == 0u, sky = i == 1u;
    const uvec2 place = walk_draw(kiln_path_use(surface, sky ? KILN_PATH_SKY : KILN_PATH_LIGHT)),
                pick = walk_draw(kiln_path_use(surface, KILN_PATH_PICK));
    const real3 n = real3(light_normal(v));
    light = sky ? emission_environment() : emission_directional(i - 2u);
    if (sky) {
        real density = 0;
        s = kiln_light_sample(real3(0), real(KILN_INFINITY), real3(0), 0, true, light);
        if (!light_kind(KILN_GPU_KIND_IMAGE))
            return false;
        s.direction = kiln_sky_sample(real_unit(place.x), real_unit(place.y), density);
        s.value = real3(kiln_environment_radiance(s.direction)) / density;
        return density > 0;
    }
    if (tree && !light_kind(KILN_GPU_KIND_AREA | KILN_GPU_KIND_PUNCTUAL))
        return false;
    const kiln_light_choice choice =
        kiln_light_choice(tree ? KILN_CHOICE_LIGHT_NODE : KILN_CHOICE_DIRECTIONAL, tree ? 0u : i - 2u, 1u);
    const bool drawn = kiln_sample_choice(choice, 0u, real3(v.m.position), n, n, real_unit(pick.x), real_unit(place.x),
                                          real_unit(place.y), s);
    light = tree ? s.light : light;
    return drawn;
}

/* Adds the light of a sample, scattered by f. */
void add_sample(inout Chain c, Vertex v, kiln_light_sample s, uint light, Scatter f)
{
    const bool outside = isinf(s.distance);
    const real3 place = real3(v.m.position), end = outside ? place : place + s.direction * s.distance;
    const real squared = outside ? real(1) : s.distance * s.distance;
    real cosine = 1;
    if (light_kind(KILN_GPU_KIND_AREA) && light < SCENE.lights.area_count)
        cosine = abs(dot(real3_of(AreaLights(SCENE.lights.areas).at[light].normal), s.direction));
    const Lit lit = lit_of(v);
    const real connect = techniques_connect(light, lit, end, -s.direction);
    if (!(connect > 0))
        return;
    const real emission = techniques_emission(light, lit, end, -s.direction);
    const vec3 direction = vec3(s.direction), start = vertex_start(v, direction);
    const real offset = real(dot(v.m.normal, direction) > 0.0 ? v.m.offset : -v.m.offset);
    float limit;
    const vec3 towards = kiln_shadow_ray(s, real3(v.m.normal) * offset, limit);
    const vec3 through = kiln_through(start, towards, limit);
    const real hit = s.has_extent ? real(f.to_light) * cosine / squared : real(0);
    const real weight = kiln_caustic_weight_sampled(LAND.mis, sums_of_chain, connect, emission,
                                                    real(f.cosine_i) / squared, hit, real(f.to_eye));
    vec3 left = chain_weight * float(weight) * through;
    if (!outside)
        left *= vertex_attenuation(v, direction, float(s.distance));
    c.light += left * vec3(s.value * real3(f.all) * real(f.cosine_i));
}

/* Samples the lights at surface number `surface`, and draws the direction that continues; false: it contributes
 * nothing. A single loop, so that the long code of scattering functions exists once. */
bool weighed_turn(inout Chain c, Vertex v, uint surface, out Way way)
{
    const uint samples = sample_count(v);
    bool goes_on = false;
    uint i = 0u;
    for (; i <= samples; i++) {
        const bool on = i == samples;
        kiln_light_sample s;
        Scatter f;
        uint light = KILN_GPU_NONE;
        vec3 towards;
        bool there;
        if (on) {
            there = way_draw(v, false, others, surface, way);
            towards = way.direction;
        } else {
            there = draw_sample(v, surface, i, s, light);
            towards = vec3(s.direction);
        }
        const bool mirrors = on && there && way.delta;
        if (mirrors)
            goes_on = way_mirrors(v, false, others, way);
        else if (there && vertex_scatter(v, v.from, towards, others, f)) {
            if (on)
                goes_on = way_scatters(v, false, f, way);
            else
                add_sample(c, v, s, light, f);
        }
    }
    c.good = c.good && i > samples;
    return goes_on;
}

/* Processes surface number `surface` of the chain. False: the chain has ended. */
bool weighed_step(inout Chain c, uint surface, inout vec3 direction, inout kiln_hit hit)
{
    const bool glossy = (material_of(hit.triangle) & KILN_RECORD_GLOSS) != 0u;
    const Vertex v = vertex_make(hit, direction, false);
    const float cosine = abs(dot(v.m.normal, direction));
    float pick;
    Way way;
    vec3 tint;
    if (!(cosine > 0.0))
        return false;
    kiln_caustic_arrive(sums_of_chain, real(hit.distance) * real(hit.distance), real(cosine));
    if (glossy)
        chain_weight *= attenuation(hit);
    if (surface > 0u)
        shade_light(c, hit, v.m, direction);
    if (!glossy || !chain_survives(surface, pick))
        return false;
    if (!weighed_turn(c, v, surface, way))
        return false;
    chain_weight *= way.factor;
    kiln_caustic_leave(sums_of_chain, real(way.cosine), real(way.forward), real(way.backward), way.delta);
    lit_before = lit_of(v);
    direction = way.direction;
    hit = walk_trace(vertex_start(v, direction), direction, kiln_path_use(surface, KILN_PATH_CHANCE), tint);
    chain_weight *= tint;
    if (hit.triangle == KILN_GPU_NONE)
        shade_background(c, direction);
    return hit.triangle != KILN_GPU_NONE && has_side(hit);
}

/* As chain_follow. `area`: m2 of the ray's point that can be lit. */
Chain chain_follow_weighed(uint chance, uint k, vec3 direction, kiln_hit hit, float area)
{
    Chain c = Chain(vec3(0.0), vec3(0.0), vec3(1.0), 0.0, 0.0, true);
    bool under_way = true;
    walk_key = kiln_chain_key(chance);
    walk_sample = k;
    chain_weight = vec3(1.0);
    sums_of_chain = kiln_caustic_gather(real(area), real(push.samples));
    for (uint surface = 0u; under_way; surface++)
        under_way = weighed_step(c, surface, direction, hit);
    c.good = c.good && !under_way;
    return c;
}
