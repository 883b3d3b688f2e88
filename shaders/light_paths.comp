/* Light paths of the bidirectional pass (worker/pass/bidirectional.h), one surface a stage. Thread x advances the path
 * in its slot. The first stage starts the path at a lamp. Each later stage takes it to the surface that its ray has
 * met, keeps a vertex there unless the surface has mirrors alone, and draws the way on. Vertices of all paths lie in
 * one list, in any order; each names the vertex before it on its path. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"

KILN_PUSH(kiln_gpu_both_push);

layout(constant_id = 6) const uint METHOD = 0u; /* KILN_GPU_BOTH_POINTS or not */
const bool POINTS = (METHOD & KILN_GPU_BOTH_POINTS) != 0u;

#define KILN_LIFTS
#include "shaders/bidirectional.glsl"
#include "shaders/subpaths.glsl"

uint slot;
kiln_gpu_subpath path;
kiln_emitted emitted; /* of a path that begins, or that has come to its first surface */

void keep(Vertex v)
{
    const uint place = atomicAdd(BothCounts(BOTH.counts).at[0].vertices, 1u);
    if (place < BOTH.room) {
        kiln_gpu_light_vertex l;
        l.position = v.m.position;
        l.from = v.from;
        l.flux = floats_of(v.weight);
        l.vcm = float(v.sums.vcm);
        l.vc = float(v.sums.vc);
        l.vm = float(v.sums.vm);
        l.u = path.u;
        l.v = path.v;
        l.triangle = path.triangle;
        l.bounces = v.bounces;
        l.number = path.surface;
        l.previous = path.last;
        l.path = push.path + slot;
        l.lift = v.m.lift;
        LIGHT_VERTEX(place) = l;
    }
    path.last = place;
    BothWords(BOTH.last + 4ul * (push.path + slot - push.first)).at[0] = place;
}

/* Returns the share of light that the range of a point or spot light leaves at the path's first surface. */
float range_left(vec3 position)
{
    if (!light_kind(KILN_GPU_KIND_PUNCTUAL) || emitted.light < SCENE.lights.area_count || !emitted.has_place)
        return 1.0;
    const real range = real(PointLights(SCENE.lights.points).at[emitted.light - SCENE.lights.area_count].range);
    return float(kiln_light_range(range, length(real3(position) - emitted.origin)));
}

/* Makes the vertex at the ray's hit; false: the ray hits nothing. */
bool arrive(out Vertex v)
{
    const kiln_hit hit = hit_of(path.triangle, path.u, path.v, path.distance);
    if (hit.triangle == KILN_GPU_NONE || !has_side(hit))
        return false;
    v = vertex_make(hit, path.direction, false);
    vertex_lift(path.lift, v);
    const float cosine = abs(dot(v.m.normal, v.from));
    if (!(cosine > 0.0))
        return false;
    v.weight = vec3_in(path.weight) * vec3_in(path.tint);
    v.sums = sums_of(path.vcm, path.vc, path.vm);
    v.bounces = path.bounces;
    const vec3 way = v.m.position - path.before;
    const bool first = path.surface == 0u;
    if (first) {
        v.weight *= range_left(v.m.position);
        const real connect = kiln_light_connect(emitted.light, real3(v.m.position), real3(light_normal(v)),
                                                emitted.origin, emitted.direction);
        v.sums = kiln_path_begin_light(path_techniques(), connect, emitted.density, emitted.cosine, emitted.is_point);
#ifdef KILN_GLOSS
    } else if (path.body != KILN_GPU_NONE) {
        v.weight *= kiln_gloss_attenuation(path.body, path.distance);
#endif
    }
    kiln_path_arrive(v.sums, !first || emitted.has_place ? real(dot(way, way)) : real(1), real(cosine));
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

bool go_on(Vertex v)
{
    Way way;
    if (!way_draw(v, true, KILN_LOBE_ALL, path.surface, way) || !weigh_way(v, way))
        return false;
    vec3 weight = v.weight * way.factor;
    const vec3 share = weight / path.scale;
    kiln_path_sums sums = v.sums;
    kiln_path_leave(path_techniques(), sums, real(way.landing), real(way.forward), real(way.backward), way.delta);
    path.bounces = v.bounces + (way.diffuse && (POINTS || path.surface > 0u) ? 1u : 0u);
    path.chain = way.diffuse ? 0u : path.chain + 1u;
    path.vcm = float(sums.vcm);
    path.vc = float(sums.vc);
    path.vm = float(sums.vm);
    path.before = v.m.position;
    path.origin = vertex_start(v, way.direction);
    path.direction = way.direction;
    path.body = KILN_GPU_NONE;
#ifdef KILN_GLOSS
    if (v.m.gloss && (gloss_of(v.m.triangle) & KILN_GPU_GLOSS_VOLUME) != 0u && !(dot(v.front, way.direction) > 0.0))
        path.body = material_of(v.m.triangle) & KILN_RECORD_MATERIAL;
#endif
    if (!(path.bounces <= BOTH.most && shines(share) && path_survives(path.surface, path.chain, share, weight)))
        return false;
    path.weight = floats_of(weight);
    path.surface++;
    return true;
}

bool emit()
{
    const uvec2 pick = walk_draw(KILN_EMISSION_USE), place = walk_draw(KILN_EMISSION_USE + 1u),
                aim = walk_draw(KILN_EMISSION_USE + 2u);
    return kiln_draw_emitted(real_unit(pick.x), real_unit(place.x), real_unit(place.y), real_unit(aim.x),
                             real_unit(aim.y), emitted);
}

bool init_from_light()
{
    BothWords(BOTH.last + 4ul * (push.path + slot - push.first)).at[0] = KILN_GPU_NONE;
    if (POINTS && push.light == KILN_GPU_OF_LIGHT_OWN && !point_is_there(point_of(push.path + slot)))
        return false;
    if (!kiln_path_allows(BOTH.path_length, 2u) || !emit())
        return false;
    path.before = vec3(emitted.origin);
    path.origin = path.before;
    path.direction = vec3(emitted.direction);
    if (light_kind(KILN_GPU_KIND_AREA) && emitted.light < SCENE.lights.area_count) {
        const kiln_gpu_area_light light = AreaLights(SCENE.lights.areas).at[emitted.light];
        const real3 normal = real3_of(light.normal);
        const float offset = triangle_at(light.triangle).offset;
        path.origin += vec3(normal) * (dot(emitted.direction, normal) < 0 ? -offset : offset);
    }
    path.weight = floats_of(emitted.flux);
    path.scale = max(emitted.flux.r, max(emitted.flux.g, emitted.flux.b));
    path.before_normal = vec3(0.0);
    path.vcm = 0.0;
    path.vc = 0.0;
    path.vm = 0.0;
    path.surface = 0u;
    path.bounces = 0u;
    path.chain = 0u;
    path.last_diffuse = 0u;
    path.last = KILN_GPU_NONE;
    path.body = KILN_GPU_NONE;
    return true;
}

bool shade_surface()
{
    Vertex v;
    path = SUBPATH(slot);
    if ((path.surface == 0u && !emit()) || !arrive(v))
        return false;
    if (!v.is_delta)
        keep(v);
    return kiln_path_allows(BOTH.path_length, path.surface + 3u) && go_on(v);
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    slot = slot_of(x);
    draw_for_light(slot);
    if (push.stage == KILN_GPU_STAGE_BEGIN ? init_from_light() : shade_surface()) {
        SUBPATH(slot) = path;
        go_onward(slot);
    }
}

#include "shaders/main.glsl"
