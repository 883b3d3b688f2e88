/* The land pass (worker/pass/land.h): thread x traces paths `index` + x, + x + `threads` and so on, one after the other
 * in one loop over surfaces, so that threads whose paths are short do not wait for those with long ones. Ways, random
 * numbers and estimators are those of worker/backend/embree/land.c. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"

KILN_PUSH(kiln_gpu_land_push);

const uint WHOLE = 0u, SHARED = 1u; /* what landings bring: all light, or what other techniques leave to them */
layout(constant_id = 6) const uint BRINGS = SHARED;

#include "shaders/bidirectional.glsl"

KILN_ARRAY(LandingArray, kiln_gpu_landing, 4);

#include "shaders/techniques.glsl"
#include "shaders/shared/chain.h"
#include "shaders/shared/land.h"

const uint ASTRAY = 0u, LANDED = 1u, ESCAPED = 2u, BLOCKED = 3u, ABSORBED = 4u; /* enum kiln_land_end */
const float FLOAT_MOST = 3.40282347e38;

/* The path under way. */
uint aim;
AimedRay first;
real3 flux;  /* W, at the lamp */
vec3 weight; /* what is left of it */
vec3 origin, direction;
bool imaged; /* it comes as from its lamp's mirror image */
kiln_caustic_landing sums;
kiln_gpu_landing landing;

/* The first ray; false: the lamp sends nothing along it. */
bool begin(uint64_t number)
{
    const uint64_t iteration = number / LAND.paths, path = number % LAND.paths;
    aim = aim_find(path);
    const uint64_t k = path - AimNumbers(LAND.first).at[aim];
    walk_key = kiln_land_key(push.seed, aim, uint(iteration), uint(iteration >> 32), uint(k >> 32));
    walk_sample = uint(k);
    landing = kiln_gpu_landing(float[3](0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, KILN_GPU_NONE, ASTRAY);
    imaged = false;
    weight = vec3(1.0);
    sums = kiln_caustic_landing(0, 0, 0);
    const uvec2 pick = walk_draw(kiln_path_use(0u, KILN_PATH_PICK)),
                place = walk_draw(kiln_path_use(0u, KILN_PATH_LIGHT)),
                turn = walk_draw(kiln_path_use(0u, KILN_PATH_BOUNCE));
    const AimNumber n = AimNumber(real_unit(pick.x), real_unit(pick.y), real_unit(place.x), real_unit(place.y),
                                  real_unit(turn.x), real_unit(turn.y));
    const bool drawn = aim_draw(aim, k, n, first);
    flux = first.flux / aim_paths(aim);
    origin = first.origin;
    direction = first.direction;
    return drawn && max(flux.x, max(flux.y, flux.z)) > 0;
}

/* Whether the path lands on surface number `surface`, which is not the first one, or goes on. */
bool lands(Vertex v, kiln_hit hit, uint surface)
{
    if (!v.m.gloss)
        return true;
    if (hit.back && (material_of(hit.triangle) & KILN_RECORD_DOUBLE_SIDED) == 0u)
        return false; /* there is no point on this side */
    const float diffuse = kiln_bsdf_choice_of(v.shares, KILN_LOBE_ALL).diffuse,
                chance = max(diffuse, kiln_land_least(surface));
    const bool here = real_unit(walk_draw(kiln_path_use(surface, KILN_PATH_END)).x) < real(chance);
    weight *= 1.0 / (here ? chance : 1.0 - chance);
    return here;
}

void land(Vertex v, kiln_hit hit)
{
    const float above = dot(v.m.normal, v.from);
    landing.u = hit.u;
    landing.v = hit.v;
    landing.triangle = imaged ? KILN_GPU_NONE : hit.triangle | (hit.back ? KILN_GPU_BOTH_BACK : 0u);
    landing.shading = above > 0.0 ? max(0.0, dot(v.m.shading, v.from)) / above : 1.0;
    landing.taken_up = v.m.gloss ? kiln_chain_taken_up(v.lobes, v.o.z) : 1.0;
    if (BRINGS == SHARED) {
        const real squared = real(hit.distance) * real(hit.distance);
        const real others = kiln_caustic_others(LAND.mis, sums, real(LAND.connections), squared, real(abs(above)));
        landing.others = float(min(others, real(FLOAT_MOST)));
        landing.sampled = float(min(sums.sampled / KILN_REAL_PI, real(FLOAT_MOST)));
    }
}

/* Draws the way on from a surface with gloss; false: it brings nothing. */
bool turn_whole(Vertex v, uint surface, float pick, out vec3 towards)
{
    const uvec2 numbers = walk_draw(kiln_path_use(surface, KILN_PATH_BOUNCE));
    const kiln_bsdf_choice choice = kiln_bsdf_choice_of(v.shares, others);
    kiln_bsdf_drawn d = kiln_bsdf_propose(v.lobes, choice, v.o, pick, float(real_unit(numbers.x)),
                                          float(real_unit(numbers.y)), KILN_IMPORTANCE);
    towards = v.frame * d.i;
    if (d.i.z == 0.0)
        return false;
    if (!d.delta) {
        const kiln_bsdf_value f = kiln_bsdf_evaluate_chosen(v.lobes, choice, v.o, d.i, KILN_IMPORTANCE, others);
        if (!(f.density > 0.0))
            return false;
        d.weight = f.value / f.density;
    }
    const vec3 front = (v.o.z > 0.0 ? v.m.normal : -v.m.normal) * v.frame;
    weight *= d.weight * kiln_shading_correction(v.o, d.i, front);
    return kiln_shading_agrees(d.i, front);
}

/* The densities of the other techniques over the path's own, once it has arrived at surface number `surface`. */
kiln_caustic_landing sums_at(Vertex v, uint surface)
{
    const real arrival = real(abs(dot(v.m.normal, v.from)));
    kiln_caustic_landing s = sums;
    if (surface > 1u) {
        kiln_caustic_meet(s, arrival);
        return s;
    }
    const real3 from = real3(first.direction), way = real3(v.m.position) - first.place;
    const Lit lit = lit_of(v);
    return kiln_caustic_emit(techniques_connect(first.light, lit, first.place, from),
                             techniques_emission(first.light, lit, first.place, from), first.cosine, first.is_point,
                             first.has_place ? dot(way, way) : real(1), arrival);
}

/* Whether what the path does at its surface is what the images of lamps in flat mirrors stand for. */
bool is_image(Vertex v, kiln_hit hit, uint surface, Way way)
{
    return LAND.plane_of != 0ul && surface == 1u && first.is_point && !hit.back && way.delta &&
           AimWords(LAND.plane_of).at[hit.triangle] != KILN_GPU_NONE && dot(v.m.normal, way.direction) > 0.0;
}

/* The same as turn_whole, where there are other techniques. */
bool turn_shared(Vertex v, kiln_hit hit, uint surface, out vec3 towards)
{
    Way way;
    Scatter s;
    towards = vec3(0.0);
    if (!way_draw(v, true, others, surface, way))
        return false;
    if (way.delta ? !way_mirrors(v, true, others, way)
                  : !(vertex_scatter(v, way.direction, v.from, others, s) && way_scatters(v, true, s, way)))
        return false;
    sums = sums_at(v, surface);
    kiln_caustic_pass_on(sums, surface == 1u, real(way.cosine), real(way.forward), real(way.backward), way.delta);
    imaged = is_image(v, hit, surface, way);
    weight *= way.factor;
    towards = way.direction;
    return true;
}

/* From surface number `surface` on, by chance; false: the path ends. */
bool go_on(Vertex v, kiln_hit hit, uint surface)
{
    const uvec2 picks = walk_draw(kiln_path_use(surface, KILN_PATH_LOBE));
    const float chance = kiln_chain_chance(surface - 1u, SCENE.chain_length, kiln_chain_left(albedo, weight));
    vec3 towards;
    if (real_unit(picks.y) >= real(chance))
        return false;
    if (!(BRINGS == SHARED ? turn_shared(v, hit, surface, towards)
                           : turn_whole(v, surface, float(real_unit(picks.x)), towards)))
        return false;
    if (!shines(weight))
        return false;
    weight *= 1.0 / chance;
    origin = vertex_start(v, towards);
    direction = towards;
    return true;
}

/* Traces the ray to surface number `surface`, from 1 on. False: the path has ended, and `landing` says how. */
bool arrive(uint surface)
{
    vec3 tint;
    const kiln_hit hit = walk_trace(origin, direction, kiln_path_use(surface, KILN_PATH_CHANCE), tint);
    if (hit.triangle == KILN_GPU_NONE) {
        landing.end =
            (surface == 1u ? ASTRAY : ESCAPED) | KILN_GPU_LAND_MISSED | (surface - 1u) << KILN_GPU_LAND_LENGTH;
        return false;
    }
    landing.end = surface << KILN_GPU_LAND_LENGTH;
    weight *= tint;
    if (surface == 1u) {
        const real met =
            (material_of(hit.triangle) & KILN_RECORD_GLOSS) != 0u ? aim_met(aim, first, hit.triangle) : real(0);
        if (!(met > 0))
            return false;
        flux *= met;
    }
    if (!has_side(hit)) {
        landing.end |= BLOCKED;
        return false;
    }
    const Vertex v = vertex_make(hit, direction, true);
    weight *= attenuation(hit);
    if (surface == 1u)
        flux *= kiln_light_range(first.range, real(hit.distance));
    if (surface > 1u && lands(v, hit, surface)) {
        land(v, hit);
        landing.end |= LANDED;
        return false;
    }
    if (go_on(v, hit, surface))
        return true;
    landing.end |= ABSORBED;
    return false;
}

void finish(uint at)
{
    const uint end = landing.end & KILN_GPU_LAND_END;
    if (end == LANDED || end == ESCAPED || end == BLOCKED) {
        const vec3 left = vec3(flux * real3(weight));
        landing.flux = float[3](left.r, left.g, left.b);
    }
    LandingArray(push.results + 44ul * at).at[0] = landing;
}

void kiln_kernel(uint x, uint y)
{
    if (x >= push.threads || y > 0u)
        return;
    uint at = x, surface = 0u;
    while (at < push.count) {
        bool under_way = true;
        if (surface == 0u)
            under_way = begin(push.index + at);
        surface++;
        if (under_way)
            under_way = arrive(surface);
        if (!under_way) {
            finish(at);
            at += push.threads;
            surface = 0u;
        }
    }
    const bool stopped = at < push.count || !still_loops(push.count);
    for (uint i = 0u; stopped && i < 1u; i++) /* the first one of the thread's tells of all */
        LandingArray(push.results + 44ul * x).at[0].end = KILN_GPU_LAND_STOPPED;
}

#include "shaders/main.glsl"
