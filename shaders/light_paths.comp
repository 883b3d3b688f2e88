/* Paths of light of the bidirectional pass (worker/pass/bidirectional.h): thread x traces path `index` + x of a sample,
 * and keeps its vertices that are not of mirrors alone, in any order among all paths; each names the one before it. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"

KILN_PUSH(kiln_gpu_both_push);

#include "shaders/bidirectional.glsl"

/* The path under way. */
vec3 origin, direction, weight;
float scale; /* largest colour at the light, W */
kiln_path_sums sums;
uint bounces, chain, last, rays;
vec3 before; /* the place that the ray comes from */
uint body;   /* material of the body that the ray goes through; KILN_GPU_NONE: none */
Emitted emitted;

void keep(Vertex v, kiln_hit hit, uint surface)
{
    const uint place = atomicAdd(BothCounts(BOTH.counts).at[0].vertices, 1u);
    if (place < BOTH.room) {
        kiln_gpu_light_vertex l;
        l.position = v.m.position;
        l.from = v.from;
        l.flux = float[3](v.weight.r, v.weight.g, v.weight.b);
        l.vcm = float(v.sums.vcm);
        l.vc = float(v.sums.vc);
        l.vm = float(v.sums.vm);
        l.u = hit.u;
        l.v = hit.v;
        l.triangle = hit.triangle | (hit.back ? KILN_GPU_BOTH_BACK : 0u);
        l.bounces = v.bounces;
        l.number = surface;
        l.previous = last;
        LightVertices(BOTH.vertices + 72ul * place).at[0] = l;
    }
    last = place;
}

/* Of a point's or a spot's light what its range leaves at its first surface. */
float range_left(vec3 position)
{
    if (!light_kind(KILN_GPU_KIND_PUNCTUAL) || emitted.light < SCENE.lights.area_count || !emitted.has_place)
        return 1.0;
    const real range = real(PointLights(SCENE.lights.points).at[emitted.light - SCENE.lights.area_count].range);
    return float(kiln_light_range(range, length(real3(position) - emitted.origin)));
}

/* Traces the ray to surface number `surface`; false: the path ends. */
bool arrive(uint surface, out Vertex v, out kiln_hit hit)
{
    vec3 tint;
    rays++;
    hit = walk_trace(origin, direction, kiln_path_use(surface, KILN_PATH_CHANCE), tint);
    if (hit.triangle == KILN_GPU_NONE || !has_side(hit))
        return false;
    v = vertex_make(hit, direction, false);
    const float cosine = abs(dot(v.m.normal, v.from));
    if (!(cosine > 0.0))
        return false;
    v.weight = weight * tint;
    v.sums = sums;
    v.bounces = bounces;
    const vec3 way = v.m.position - before;
    if (surface == 0u) {
        v.weight *= range_left(v.m.position);
        const real connect = emission_connect(emitted.light, real3(v.m.position), real3(light_normal(v)),
                                              emitted.origin, emitted.direction);
        v.sums = kiln_path_begin_light(path_techniques(), connect, emitted.density, emitted.cosine, emitted.is_point);
#ifdef KILN_GLOSS
    } else if (body != KILN_GPU_NONE) {
        v.weight *= kiln_gloss_attenuation(body, hit.distance);
#endif
    }
    kiln_path_arrive(v.sums, surface > 0u || emitted.has_place ? real(dot(way, way)) : real(1), real(cosine));
    return true;
}

bool weigh_way(Vertex v, inout Way way)
{
#ifdef KILN_GLOSS
    if (way.delta)
        return way_mirrors(v, true, KILN_LOBE_ALL, way);
#endif
    Scatter s;
    return vertex_scatter(v, way.direction, v.from, KILN_LOBE_ALL, s) && way_scatters(v, true, s, way);
}

bool go_on(Vertex v, uint surface)
{
    Way way;
    if (!way_draw(v, true, KILN_LOBE_ALL, surface, way) || !weigh_way(v, way))
        return false;
    weight = v.weight * way.factor;
    const vec3 share = weight / scale;
    bounces = v.bounces + (way.diffuse && surface > 0u ? 1u : 0u);
    chain = way.diffuse ? 0u : chain + 1u;
    sums = v.sums;
    before = v.m.position;
    origin = vertex_start(v, way.direction);
    direction = way.direction;
    body = KILN_GPU_NONE;
#ifdef KILN_GLOSS
    if (v.m.gloss && (gloss_of(v.m.triangle) & KILN_GPU_GLOSS_VOLUME) != 0u && !(dot(v.front, direction) > 0.0))
        body = material_of(v.m.triangle) & KILN_RECORD_MATERIAL;
#endif
    kiln_path_leave(path_techniques(), sums, real(way.cosine), real(way.forward), real(way.backward), way.delta);
    return bounces <= BOTH.most && shines(share) && path_survives(surface, chain, share, weight);
}

bool begin()
{
    const uvec2 pick = walk_draw(KILN_EMISSION_USE), place = walk_draw(KILN_EMISSION_USE + 1u),
                aim = walk_draw(KILN_EMISSION_USE + 2u);
    if (!emission_draw(real_unit(pick.x), real_unit(place.x), real_unit(place.y), real_unit(aim.x), real_unit(aim.y),
                       emitted))
        return false;
    before = vec3(emitted.origin);
    origin = before;
    direction = vec3(emitted.direction);
    if (light_kind(KILN_GPU_KIND_AREA) && emitted.light < SCENE.lights.area_count) {
        const kiln_gpu_area_light light = AreaLights(SCENE.lights.areas).at[emitted.light];
        const real3 normal = real3_of(light.normal);
        const float offset = triangle_at(light.triangle).offset;
        origin += vec3(normal) * (dot(emitted.direction, normal) < 0 ? -offset : offset);
    }
    weight = emitted.flux;
    scale = max(weight.r, max(weight.g, weight.b));
    bounces = 0u;
    chain = 0u;
    body = KILN_GPU_NONE;
    return true;
}

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count || y > 0u)
        return;
    const uint path = uint(push.index) + x;
    walk_key = push.light_key;
    walk_sample = path;
    rays = 0u;
    last = KILN_GPU_NONE;
    bool under_way = kiln_path_allows(BOTH.path_length, 2u) && begin();
    for (uint surface = 0u; under_way; surface++) {
        Vertex v;
        kiln_hit hit;
        under_way = arrive(surface, v, hit);
        if (under_way && !v.is_delta)
            keep(v, hit, surface);
        under_way = under_way && kiln_path_allows(BOTH.path_length, surface + 3u) && go_on(v, surface);
    }
    BothWords(BOTH.last).at[path - push.path] = last;
    BothCounts counts = BothCounts(BOTH.counts);
    if (under_way || !still_loops(push.count))
        counts.at[0].stopped = 1u;
    const uint slot = 2u * (x % KILN_GPU_BOTH_RAYS);
    const uint old = atomicAdd(counts.at[0].rays[slot], rays);
    if (old + rays < old)
        atomicAdd(counts.at[0].rays[slot + 1u], 1u);
}

#include "shaders/main.glsl"
