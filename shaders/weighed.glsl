/* Chains of the weighed pass (worker/pass/weighed.h): as worker/backend/embree/chain_weighed.c. Replaces chain.glsl,
 * and follows the same rule for chains. Before it stand the kernel's push constants, with the address of struct
 * kiln_gpu_both and the number of samples. */
#define KILN_LOBES_ASKED (KILN_LOBE_GLOSS | KILN_LOBE_COAT) /* as chain.glsl */
#define KILN_SCATTERS_GLOSS
#include "shaders/bidirectional.glsl"
#include "shaders/techniques.glsl"
#include "shaders/chain.glsl"

/* Sums of the chain under way. */
kiln_caustic_gathered sums_of_chain;
Lit lit_before; /* the surface where the chain's ray started */

/* Light that is sampled, and what its densities depend on (techniques.glsl). */
struct Sampled {
    uint light;
    real3 place, direction; /* on the light; from there to the surface */
    Lit lit;                /* the surface that it lights */
    vec3 radiance;          /* of light that the chain's ray has met */
    bool weighs;            /* techniques share it; else it counts in full */
};

/* Light that the ray to surface number `surface` has met: of a lamp, or from outside the scene. False: none. */
bool met_light(Vertex v, kiln_hit hit, uint surface, vec3 direction, out Sampled met)
{
    const bool outside = hit.triangle == KILN_GPU_NONE;
    met = Sampled(KILN_GPU_NONE, real3(-direction), real3(-direction), lit_before, vec3(0.0), true);
    if (outside) {
        if (!light_kind(KILN_GPU_KIND_SKY | KILN_GPU_KIND_IMAGE) || SCENE.lights.environment == 0u)
            return false;
        met.light = emission_environment();
        met.radiance = kiln_environment_radiance(real3(direction));
        return true;
    }
    if (surface == 0u || (material_of(hit.triangle) & KILN_RECORD_EMITS) == 0u)
        return false;
    met.light = kiln_area_light_at(hit.triangle, hit.u, hit.v);
    met.place = real3(v.m.position);
    met.radiance = kiln_surface_emission(hit.triangle, hit.u, hit.v);
    met.weighs = met.light != KILN_GPU_NONE &&
                 !(hit.back && (AreaLights(SCENE.lights.areas).at[met.light].flags & KILN_GPU_LIGHT_TWO_SIDED) == 0u);
    return true;
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

/* Weight of the light of a sample, scattered by f. `connect`, `emission`: its densities. */
real weigh_sample(kiln_light_sample s, uint light, Scatter f, real connect, real emission)
{
    const bool outside = isinf(s.distance);
    const real squared = outside ? real(1) : s.distance * s.distance;
    real cosine = 1;
    if (light_kind(KILN_GPU_KIND_AREA) && light < SCENE.lights.area_count)
        cosine = abs(dot(real3_of(AreaLights(SCENE.lights.areas).at[light].normal), s.direction));
    const real hit = s.has_extent ? real(f.to_light) * cosine / squared : real(0);
    return kiln_caustic_weight_sampled(LAND.mis, sums_of_chain, connect, emission, real(f.cosine_i) / squared, hit,
                                       real(f.to_eye));
}

/* Light of a sample, scattered by f, of which `through` arrives. */
vec3 sample_light(Vertex v, kiln_light_sample s, Scatter f, real weight, vec3 through)
{
    vec3 left = chain_weight * float(weight) * through;
    if (!isinf(s.distance))
        left *= vertex_attenuation(v, vec3(s.direction), float(s.distance));
    return left * vec3(s.value * real3(f.all) * real(f.cosine_i));
}

#include "shaders/weighed_turn.glsl"

/* Processes surface number `surface` of the chain, or that its ray has left the scene. False: the chain has ended. */
bool weighed_step(inout Chain c, uint surface, inout vec3 direction, inout kiln_hit hit)
{
    const bool outside = hit.triangle == KILN_GPU_NONE,
               glossy = !outside && (material_of(hit.triangle) & KILN_RECORD_GLOSS) != 0u;
    Vertex v;
    bool seen = true;
    if (!outside) {
        v = vertex_make(hit, direction, false);
        const float cosine = abs(dot(v.m.normal, direction));
        seen = cosine > 0.0;
        if (seen)
            kiln_caustic_arrive(sums_of_chain, real(hit.distance) * real(hit.distance), real(cosine));
        if (seen && glossy)
            chain_weight *= attenuation(hit);
    }
    return seen && weighed_turn(c, v, surface, glossy, direction, hit) &&
           (hit.triangle == KILN_GPU_NONE || has_side(hit));
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
