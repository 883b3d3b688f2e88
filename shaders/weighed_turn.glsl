/* A chain of the weighed pass at a surface (part of weighed.glsl): light that its ray has met, light samples, then the
 * way on. A single loop, so that the long code of densities, of scattering functions and of tracing exists once in a
 * kernel. */
#ifndef KILN_SHADERS_WEIGHED_TURN_GLSL
#define KILN_SHADERS_WEIGHED_TURN_GLSL

Sampled sampled_of(Vertex v, kiln_light_sample s, uint light)
{
    const bool outside = isinf(s.distance);
    const real3 place = real3(v.m.position), end = outside ? place : place + s.direction * s.distance;
    return Sampled(light, end, -s.direction, lit_of(v), vec3(0.0), true);
}

/* Weight of light that a ray has met (`met`), or of a sample, scattered by f. `counts` becomes false where no sample
 * would find it. */
real weigh_light(bool met, Sampled l, kiln_light_sample s, Scatter f, inout bool counts)
{
    const real connect = techniques_connect(l.light, l.lit, l.place, l.direction);
    real weight = 0;
    counts = counts && connect > 0;
    if (met || counts) {
        const real emission = techniques_emission(l.light, l.lit, l.place, l.direction);
        weight = met ? kiln_caustic_weight_hit(LAND.mis, sums_of_chain, connect, emission)
                     : weigh_sample(s, l.light, f, connect, emission);
    }
    return weight;
}

/* Takes over the way on, before its ray is traced. */
void leave_surface(Vertex v, Way way)
{
    chain_weight *= way.factor;
    kiln_caustic_leave(sums_of_chain, real(way.cosine), real(way.forward), real(way.backward), way.delta);
    lit_before = lit_of(v);
}

/* Traces the ray that leaves the surface in the direction `towards`: of the way `on`, or else the shadow ray of a
 * sample. `tint`: the share of its light that arrives. */
kiln_hit weighed_trace(Vertex v, uint surface, bool on, vec3 towards, kiln_light_sample s, out vec3 tint)
{
    const vec3 start = vertex_start(v, towards);
    const real offset = real(dot(v.m.normal, towards) > 0.0 ? v.m.offset : -v.m.offset);
    float limit = KILN_INFINITY;
    if (!on)
        towards = kiln_shadow_ray(s, real3(v.m.normal) * offset, limit);
    return kiln_trace_either(start, towards, limit, !on, walk_seed(kiln_path_use(surface, KILN_PATH_CHANCE)), tint);
}

/* Processes surface number `surface`, which is `glossy` or not, or outside the scene: adds the light that the ray has
 * met there, then that of light samples, then continues the chain. False: it has ended. */
bool weighed_turn(inout Chain c, Vertex v, uint surface, bool glossy, inout vec3 direction, inout kiln_hit hit)
{
    bool goes_on = false;
    uint i = 0u, end = 1u;
    for (; i < end; i++) {
        const bool arrives = i == 0u, on = !arrives && i + 1u == end;
        Sampled sampled;
        kiln_light_sample s;
        Scatter f;
        Way way;
        vec3 towards = direction, tint;
        uint light = KILN_GPU_NONE;
        bool there, traces = false;
        real weight = 1;
        float pick;
        if (arrives)
            there = met_light(v, hit, surface, direction, sampled);
        else if (on) {
            there = way_draw(v, false, others, surface, way);
            towards = way.direction;
        } else {
            there = draw_sample(v, surface, i - 1u, s, light);
            towards = vec3(s.direction);
            sampled = sampled_of(v, s, light);
        }
        const bool mirrors = on && there && way.delta;
        if (mirrors)
            traces = way_mirrors(v, false, others, way);
        else if (!arrives && there) {
            there = vertex_scatter(v, v.from, towards, others, f);
            traces = there && (!on || way_scatters(v, false, f, way));
        }
        if (!on && there && sampled.weighs)
            weight = weigh_light(arrives, sampled, s, f, traces);
        if (arrives && there)
            c.light += chain_weight * float(weight) * sampled.radiance;
        if (traces && on)
            leave_surface(v, way);
        if (traces) {
            const kiln_hit met = weighed_trace(v, surface, on, towards, s, tint);
            if (on) {
                direction = towards;
                hit = met;
                chain_weight *= tint;
                goes_on = true;
            } else
                c.light += sample_light(v, s, f, weight, tint);
        }
        if (arrives && glossy && chain_survives(surface, pick))
            end = sample_count(v) + 2u;
    }
    c.good = c.good && i >= end;
    return goes_on;
}

#endif
