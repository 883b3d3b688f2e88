/* Light paths that land (shaders/land.glsl), where their rays have hit gloss: whether they land there; if not, how they
 * continue. */
#version 460
#extension GL_GOOGLE_include_directive : require
#define KILN_GLOSS 1
#define KILN_SCATTERS_GLOSS
#define KILN_LOBES_ASKED (KILN_LOBE_GLOSS | KILN_LOBE_COAT) /* a path lands, or continues by these */
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"

#include "shaders/land.glsl"
#include "shaders/shared/chain.h"

/* Whether the path lands on its surface, which is not the first one, instead of continuing. */
bool lands(Vertex v)
{
    if (CROSSES)
        return false;
    if (hit.back && (material_of(hit.triangle) & KILN_RECORD_DOUBLE_SIDED) == 0u)
        return false; /* there is no point on this side */
    const float diffuse = kiln_bsdf_choice_of(v.shares, KILN_LOBE_ALL).diffuse,
                chance = max(diffuse, kiln_land_least(path.surface));
    const bool here = real_unit(walk_draw(kiln_path_use(path.surface, KILN_PATH_END)).x) < real(chance);
    weight *= 1.0 / (here ? chance : 1.0 - chance);
    return here;
}

/* Draws the direction that continues the path; false: it contributes nothing. */
bool turn_whole(Vertex v, float pick, out vec3 towards)
{
    const uvec2 numbers = walk_draw(kiln_path_use(path.surface, KILN_PATH_BOUNCE));
    const uint which = CROSSES && path.surface == 1u ? sharp : others;
    towards = vec3(0.0);
    if (which == 0u)
        return false;
    const kiln_bsdf_choice choice = kiln_bsdf_choice_of(v.shares, which);
    kiln_bsdf_drawn d = kiln_bsdf_propose(v.lobes, choice, v.o, pick, float(real_unit(numbers.x)),
                                          float(real_unit(numbers.y)), KILN_IMPORTANCE);
    towards = v.frame * d.i;
    if (d.i.z == 0.0)
        return false;
    if (!d.delta) {
        const kiln_bsdf_value f = kiln_bsdf_evaluate_chosen(v.lobes, choice, v.o, d.i, KILN_IMPORTANCE, which);
        if (!(f.density > 0.0))
            return false;
        d.weight = f.value / f.density;
    }
    const vec3 front = (v.o.z > 0.0 ? v.m.normal : -v.m.normal) * v.frame;
    weight *= d.weight * kiln_shading_correction(v.o, d.i, front);
    return kiln_shading_agrees(d.i, front);
}

/* Whether the reflection at the surface is one that mirror images of lamps in flat mirrors represent. */
bool is_image(Vertex v, Way way)
{
    return LAND.plane_of != 0ul && path.surface == 1u && (more.flags & KILN_GPU_LAND_IS_POINT) != 0u && !hit.back &&
           way.delta && AimWords(LAND.plane_of).at[hit.triangle] != KILN_GPU_NONE &&
           dot(v.m.normal, way.direction) > 0.0;
}

/* As turn_whole, if other techniques share the light. */
bool turn_shared(Vertex v, out vec3 towards)
{
    Way way;
    Scatter s;
    towards = vec3(0.0);
    if (!way_draw(v, true, others, path.surface, way))
        return false;
    if (way.delta ? !way_mirrors(v, true, others, way)
                  : !(vertex_scatter(v, way.direction, v.from, others, s) && way_scatters(v, true, s, way)))
        return false;
    kiln_caustic_landing sums = sums_then();
    if (path.surface > 1u)
        kiln_caustic_meet(sums, real(abs(dot(v.m.normal, v.from))));
    kiln_caustic_pass_on(sums, path.surface == 1u, real(way.cosine), real(way.forward), real(way.backward), way.delta);
    keep_sums(sums);
    LAND_PATH(slot).flags = (more.flags & ~KILN_GPU_LAND_IMAGED) | (is_image(v, way) ? KILN_GPU_LAND_IMAGED : 0u);
    weight *= way.factor;
    towards = way.direction;
    return true;
}

/* Continues the path from its surface, by Russian roulette; false: the path ends. */
bool go_on(Vertex v)
{
    const uvec2 picks = walk_draw(kiln_path_use(path.surface, KILN_PATH_LOBE));
    const float chance = kiln_chain_chance(path.surface - 1u, SCENE.chain_length, kiln_chain_left(albedo, weight));
    vec3 towards;
    if (real_unit(picks.y) >= real(chance))
        return false;
    if (!(SHARES ? turn_shared(v, towards) : turn_whole(v, float(real_unit(picks.x)), towards)))
        return false;
    if (!shines(weight))
        return false;
    weight *= 1.0 / chance;
    SUBPATH(slot).origin = vertex_start(v, towards);
    SUBPATH(slot).direction = towards;
    SUBPATH(slot).weight = floats_of(weight);
    SUBPATH(slot).surface = path.surface + 1u;
    return true;
}

void shade_surface()
{
    if (!has_side(hit)) {
        finish(landing_of(BLOCKED, path.surface), flux_then());
        return;
    }
    const Vertex v = vertex_make(hit, path.direction, true);
    walk_key = more.key;
    walk_sample = more.number;
    weight *= attenuation(hit);
    if (path.surface > 1u && lands(v))
        finish(land(v, kiln_chain_taken_up(v.lobes, v.o.z)), flux_then());
    else if (go_on(v))
        go_onward(slot);
    else
        finish(landing_of(ABSORBED, path.surface), flux_then());
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    slot = slot_of(x);
    load();
    shade_surface();
}

#include "shaders/main.glsl"
