/* A chain at a surface, where lights are sampled (part of chain.glsl): light samples, then the way on. A single loop,
 * so that the long code of scattering functions and of tracing exists once in a kernel: a round evaluates the
 * scattering of what the round before has drawn, draws what comes next, and traces a ray. */
#ifndef KILN_SHADERS_CHAIN_TURN_GLSL
#define KILN_SHADERS_CHAIN_TURN_GLSL

/* Purposes for which a round evaluates the scattering: a light sample, a way on, or the share of sharp lobes in it. */
const uint CHAIN_NOTHING = 0u, CHAIN_LIGHT = 1u, CHAIN_WAY = 2u, CHAIN_SHARE = 3u;

/* State from one round to the next. `local`: direction in the frame; `asked`: lobes; `brought`: light of a
 * sample, of which `through` arrives. A way's `share` of sharp lobes, and its value `all`. */
struct ChainRound {
    uint evaluates, asked;
    vec3 local, brought, through, share, all;
    kiln_bsdf_drawn way;
};

/* Evaluates the scattering for what the round before has drawn. */
void chain_evaluate(inout Chain c, inout ChainRound r)
{
    if (r.evaluates == CHAIN_NOTHING)
        return;
    const kiln_bsdf_value f = evaluate(r.local, r.asked);
    if (r.evaluates == CHAIN_LIGHT)
        c.light += chain_weight * (r.brought * f.value) * r.through;
    else if (r.evaluates == CHAIN_WAY) {
        r.all = f.value;
        r.way.weight = f.density > 0.0 ? f.value / f.density : vec3(0.0);
    } else
        r.share = mix(vec3(0.0), f.value / r.all, greaterThan(r.all, vec3(0.0)));
}

/* Draws sample `index` of candidate `next`, and moves both on. False: it has no shadow ray. */
bool chain_draw_light(Meeting m, uint surface, inout uint next, inout uint index, inout ChainRound r, out vec3 start,
                      out vec3 towards, out float limit)
{
    kiln_light_choice choice;
    kiln_light_sample s;
    const bool counts = kiln_lights_candidate(next, real3(m.normal), 1u, choice);
    bool shadow = false;
    choice.samples = walk_samples(choice);
    r.evaluates = CHAIN_NOTHING;
    if (counts && walk_draw_light(m, surface, choice, index, s)) {
        shadow = walk_shadow(m, s, start, towards, limit);
        r.brought = vec3(s.value / real(choice.samples));
        r.asked = scattering_lobes(s, others);
    }
    index = counts && index + 1u < choice.samples ? index + 1u : 0u;
    next += index == 0u ? 1u : 0u;
    return shadow;
}

/* Draws the way on; true: its weight is known. */
bool chain_draw_way(uint surface, float pick, inout ChainRound r)
{
    r.way = walk_propose(surface, others, pick);
    r.local = r.way.i;
    r.asked = others;
    r.share = vec3(r.way.delta || (sharp & others) == others ? 1.0 : 0.0);
    r.evaluates = CHAIN_WAY;
    return r.way.delta || r.way.i.z == 0.0;
}

/* Samples the lights at surface number `surface`, then draws and traces the ray that continues; false: the chain has
 * ended. */
bool chain_go_on(inout Chain c, Meeting m, uint surface, float pick, inout vec3 direction, inout kiln_hit hit)
{
    const uint candidates =
                   kiln_lights_choose(real3(m.position), 0, real3(m.normal), 1u, light_kind(KILN_GPU_KIND_IMAGE)),
               some = sharp & others;
    uint next = 0u, index = 0u;
    ChainRound r;
    r.evaluates = CHAIN_NOTHING;
    bool under_way = true, goes_on = false;
    while (under_way) {
        vec3 start, towards, tint;
        float limit = KILN_INFINITY;
        bool shadow = false, drawn = false, sends = false;
        chain_evaluate(c, r);
        if (r.evaluates == CHAIN_WAY && some != 0u && some != others) {
            r.evaluates = CHAIN_SHARE;
            r.asked = some;
        } else if (r.evaluates >= CHAIN_WAY)
            drawn = true;
        else if (next < candidates)
            shadow = chain_draw_light(m, surface, next, index, r, start, towards, limit);
        else
            drawn = chain_draw_way(surface, pick, r);
        if (drawn) {
            const bool faces = walk_sends(m, r.way, towards);
            sends = chain_leaves(r.way.weight, r.share) && faces;
            start = chain_start(m, towards);
            limit = KILN_INFINITY;
            under_way = false;
        }
        if (shadow || sends) {
            const kiln_hit met = kiln_trace_either(start, towards, limit, shadow,
                                                   walk_seed(kiln_path_use(surface, KILN_PATH_CHANCE)), tint);
            if (shadow) {
                r.through = tint;
                r.local = towards * frame;
                r.evaluates = tint != vec3(0.0) ? CHAIN_LIGHT : CHAIN_NOTHING;
            } else {
                direction = towards;
                hit = met;
                goes_on = chain_arrives(c, towards, met, tint);
            }
        }
    }
    c.good = c.good && !under_way;
    return goes_on;
}

#endif
