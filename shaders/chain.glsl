/* Chains: how a ray goes on from a surface whose material is taken with its gloss, until diffuse surfaces answer
 * (shaders/shared/chain.h has the rule). Ways, random numbers and estimators are those of
 * worker/backend/embree/chain.c.
 *
 * Before it stand KILN_GLOSS, shaders/trace/trace.glsl and shaders/surface.glsl. A kernel looks either for the
 * radiosity of diffuse surfaces or, with KILN_WALK_LIGHTS, for lamps and sky. */
#ifndef KILN_SHADERS_CHAIN_GLSL
#define KILN_SHADERS_CHAIN_GLSL

#ifndef KILN_LOBES_ASKED /* the light of diffuse parts is stored, and chains continue by these */
#    define KILN_LOBES_ASKED (KILN_LOBE_GLOSS | KILN_LOBE_COAT)
#endif
#include "shaders/shared/chain.h"
#include "shaders/walk.glsl"

/* Result of a chain, by colour, for the ray at whose hit it begins. Without the ray's own tint. */
struct Chain {
    vec3 radiosity; /* W/m2: of diffuse surfaces; times 1 / pi it is radiance */
    vec3 light;     /* W/(m2 sr): of lamps and sky, by paths with a lobe that is not diffuse */
    /* shares of the arriving light: escaped, from nowhere; blocked, from backs (means over the colours' weights);
     * gloss, absorbed or tinted by the chain's surfaces; the rest comes from diffuse surfaces */
    vec3 gloss;
    float escaped, blocked;
    bool good; /* the device has ended no loop early */
};

/* Weights of the chain in progress. chain_weight: of incoming radiance at the chain's beginning. chain_seen: the same
 * for emission of the next surface; 0 if light samples have accounted for it. */
vec3 chain_weight, chain_seen;

/* Whether a chain begins at a ray's hit. */
bool chain_begins(kiln_hit hit) { return (material_of(hit.triangle) & KILN_RECORD_GLOSS) != 0u && has_side(hit); }

bool has_points(kiln_hit hit) { return !hit.back || (material_of(hit.triangle) & KILN_RECORD_DOUBLE_SIDED) != 0u; }

/* Adds the radiosity at the hit. `out_`: share that leaves towards the chain; `in_`: share of incoming light that the
 * surface takes up. */
void add_radiosity(inout Chain c, kiln_hit hit, float in_, float out_)
{
    c.gloss -= chain_weight * in_;
#ifdef KILN_CHAIN_RADIOSITY
    c.radiosity += chain_weight * out_ * kiln_store_radiosity(kiln_store_enter(hit.triangle, hit.u, hit.v, hit.back));
#endif
}

/* Adds the light that surface number `surface` emits. */
void add_emission(inout Chain c, kiln_hit hit, uint surface)
{
#ifdef KILN_WALK_LIGHTS
    const bool left = (KILN_WALK_LEAVES & KILN_LEAVES_AREAS) != 0u;
    if (surface > 0u && !left && chain_seen != vec3(0.0) && (material_of(hit.triangle) & KILN_RECORD_EMITS) != 0u)
        c.light += chain_seen * kiln_surface_emission(hit.triangle, hit.u, hit.v);
#endif
}

/* Whether the chain continues from surface number `surface`. `pick`: the rest of the random number, to choose a lobe.
 */
bool chain_survives(uint surface, out float pick)
{
    const uvec2 picks = walk_draw(kiln_path_use(surface, KILN_PATH_LOBE));
    const float goes_on = kiln_chain_chance(surface, SCENE.chain_length, kiln_chain_left(albedo, chain_weight));
    pick = kiln_unit_float(picks.x);
    if (!(goes_on > 0.0) || !(kiln_unit_float(picks.y) < goes_on))
        return false;
    chain_weight /= goes_on;
    return true;
}

/* Takes over a way on, by its weight and the share of sharp lobes in it. False: nothing is left. */
bool chain_leaves(vec3 value, vec3 share)
{
    chain_weight *= value;
    chain_seen = chain_weight * share;
    return max(chain_weight.r, max(chain_weight.g, chain_weight.b)) > 0.0;
}

vec3 chain_start(Meeting m, vec3 direction)
{
    return m.position + m.normal * (dot(m.normal, direction) > 0.0 ? m.offset : -m.offset);
}

/* Takes over the hit of the ray that continues; false: the chain has ended. */
bool chain_arrives(inout Chain c, vec3 direction, kiln_hit hit, vec3 tint)
{
    if (HAS_ALPHA >= KILN_PASSAGE_TINT) {
        chain_weight *= tint;
        chain_seen *= tint;
    }
    const bool meets = hit.triangle != KILN_GPU_NONE;
    if (meets && has_side(hit))
        return true;
    const float mean = (chain_weight.r + chain_weight.g + chain_weight.b) * (1.0 / 3.0);
    c.escaped += meets ? 0.0 : mean;
    c.blocked += meets ? mean : 0.0;
    c.gloss -= mean;
#ifdef KILN_WALK_LIGHTS
    const bool sky = light_kind(KILN_GPU_KIND_SKY);
    if (!meets && (sky || (KILN_WALK_LEAVES & KILN_LEAVES_IMAGE) == 0u))
        c.light += (sky ? chain_weight : chain_seen) * kiln_environment_radiance(real3(direction));
#endif
    return false;
}

#ifdef KILN_WALK_LIGHTS
#    include "shaders/chain_turn.glsl"
#else
/* Draws and traces the ray that continues from surface number `surface`; false: the chain has ended. */
bool chain_go_on(inout Chain c, Meeting m, uint surface, float pick, inout vec3 direction, inout kiln_hit hit)
{
    vec3 value, share, tint;
    const bool sends = walk_send(m, surface, others, pick, direction, value, share);
    if (!chain_leaves(value, share) || !sends)
        return false;
    hit = walk_trace(chain_start(m, direction), direction, kiln_path_use(surface, KILN_PATH_CHANCE), tint);
    return chain_arrives(c, direction, hit, tint);
}
#endif

/* Processes surface number `surface` of the chain. False: the chain has ended. */
bool chain_step(inout Chain c, uint surface, inout vec3 direction, inout kiln_hit hit)
{
    Meeting m;
    const bool glossy = (material_of(hit.triangle) & KILN_RECORD_GLOSS) != 0u;
    float in_ = 1.0, out_ = 1.0;
    if (glossy) {
        m = meet(hit, direction, false);
        const vec3 left = attenuation(hit);
        chain_weight *= left;
        chain_seen *= left;
        in_ = has_points(hit) && lobes.matt > 0.0 ? kiln_diffuse_in(lobes, from) : 0.0;
        out_ = in_ / (from.z > 0.0 ? lobes.under_front : lobes.under_back); /* kiln_diffuse_out */
    }
    if (in_ > 0.0)
        add_radiosity(c, hit, in_, out_);
    add_emission(c, hit, surface);
    float pick;
    if (!glossy || !chain_survives(surface, pick))
        return false;
    return chain_go_on(c, m, surface, pick, direction, hit);
}

/* Follows the chain of a ray for whose hit chain_begins is true. `chance` and `k`: seed of the ray's random decisions
 * (kiln_gather_chance), and number of the sample. */
Chain chain_follow(uint chance, uint k, vec3 direction, kiln_hit hit)
{
    Chain c = Chain(vec3(0.0), vec3(0.0), vec3(1.0), 0.0, 0.0, true);
    bool under_way = true;
    walk_key = kiln_chain_key(chance);
    walk_sample = k;
    chain_weight = vec3(1.0);
    chain_seen = vec3(0.0);
    for (uint surface = 0u; under_way; surface++)
        under_way = chain_step(c, surface, direction, hit);
    c.good = c.good && !under_way;
    return c;
}

#endif
