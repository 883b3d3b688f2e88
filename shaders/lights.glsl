/* Choosing among lights and sampling them: worker/light/lights.c, tree.c and environment.c, branch by branch, so that
 * the same random numbers give the same samples. Kinds of light that the scene lacks are compiled away (LIGHT_KINDS).
 *
 *   uint candidates = kiln_lights_choose(p, spread, n, limit, sky);     // limit <= KILN_CUT_MAX
 *   for (uint i = 0u; i < candidates; i++)
 *       if (kiln_lights_candidate(i, n, samples, choice))               // in kiln_lights_choices' order, with
 * kiln_lights_allot's samples for (uint k = 0u; k < choice.samples; k++) if (kiln_lights_sample(choice, k, p, n, pick,
 * u, v, s)) ...
 *
 * n is the geometric normal; the zero vector for a probe: every direction counts. `sky` false leaves the environment
 * out. A thread has one set of candidates at a time. Needs shaders/kernel.glsl and the push constants before it. */
#ifndef KILN_LIGHTS_GLSL
#define KILN_LIGHTS_GLSL

#include "shaders/real.glsl"
#include "shaders/material.glsl"
#include "shaders/shared/area_light.h"
#include "shaders/shared/color.h"
#include "shaders/shared/light_importance.h"
#include "shaders/shared/punctual_light.h"
#include "shaders/shared/warp.h"

#define KILN_STORED_REAL stored
#define KILN_STORED_NAME(name) name
#include "shaders/shared/layout_light_real.h"

const uint KILN_CHOICE_NODE = 0u, KILN_CHOICE_DIRECTIONAL = 1u, KILN_CHOICE_ENVIRONMENT = 2u;

struct kiln_light_choice {
    uint kind, index, samples; /* index: node or directional light */
};

/* The contribution to irradiance is value x max(0, n . direction) if nothing lies between p and p + distance x
 * direction. */
struct kiln_light_sample {
    real3 direction; /* unit */
    real distance;   /* m; KILN_INFINITY for light from outside */
    real3 value;     /* radiance / density of the direction */
    real backoff;    /* m: stop the shadow ray this much before the light */
    bool has_extent; /* a ray may meet it: an emitting triangle, or the environment */
    uint light;      /* its number among those of the tree, where it is one */
};

/* Which way and how far the shadow ray of a sample goes that starts `off` the place that the sample was drawn for. */
vec3 kiln_shadow_ray(kiln_light_sample s, real3 off, out float limit)
{
    limit = KILN_INFINITY;
    const real3 to = s.direction * s.distance - off;
    if (isinf(s.distance) || !(dot(to, to) > 0))
        return vec3(s.direction);
    const real distance = length(to);
    limit = float((distance - s.backoff) * KILN_SHADOW_LENGTH);
    return vec3(to * (1 / distance));
}

KILN_ARRAY(LightNodes, kiln_gpu_light_node, 8);
KILN_ARRAY(AreaLights, kiln_gpu_area_light, 8);
KILN_ARRAY(PointLights, kiln_gpu_point_light, 8);
KILN_ARRAY(DirectionalLights, kiln_gpu_directional_light, 8);
KILN_ARRAY(LightReals, stored, 8);
KILN_ARRAY(LightFloats, float, 4);

bool light_kind(uint bits) { return (LIGHT_KINDS & bits) != 0u; }
stored3 stored3_of(stored a[3]) { return stored3(a[0], a[1], a[2]); }
real3 real3_of(stored a[3]) { return real3(a[0], a[1], a[2]); }
vec3 vec3_of(float a[3]) { return vec3(a[0], a[1], a[2]); }
#define is_probe kiln_any_direction

#define KILN_FLOATS LightFloats
#define KILN_FLOAT_OF(array, i) array.at[i]
#include "shaders/shared/environment.h"

/* ---- importance of a cluster ---- */

real light_importance(uint index, real3 p, real spread, real3 n)
{
    const kiln_gpu_light_node node = LightNodes(SCENE.lights.nodes).at[index];
    return kiln_light_importance(kiln_light_bounds(real3_of(node.centre), real3_of(node.axis), real(node.radius),
                                                   real(node.floor2), real(node.cos_o), real(node.sin_o),
                                                   real(node.cos_e), real(node.power),
                                                   (node.flags & KILN_GPU_LIGHT_TWO_SIDED) != 0u, node.power > 0),
                                 p, spread, n);
}

/* ---- candidates (cut_tree, kiln_lights_choices and kiln_lights_allot of worker/light/lights.c) ---- */

uint cut_node[KILN_CUT_MAX];
real cut_importance[KILN_CUT_MAX];
uint cut_count, cut_leaves; /* cut_leaves: bit i is set where cut_node[i] is a single light */
real cut_total;             /* importance of all candidates */

void cut_set(uint i, uint node, real importance)
{
    cut_node[i] = node;
    cut_importance[i] = importance;
    const uint leaf = LightNodes(SCENE.lights.nodes).at[node].left == KILN_GPU_NONE ? 1u : 0u;
    cut_leaves = (cut_leaves & ~(1u << i)) | leaf << i;
}

/* The most important cluster that can be split and is worth it (KILN_CUT_SHARE); cut_count if there is none. */
uint cut_best()
{
    uint best = cut_count;
    real most = 0, total = 0;
    for (uint i = 0u; i < cut_count; i++) {
        total += cut_importance[i];
        if ((cut_leaves >> i & 1u) == 0u && (best == cut_count || cut_importance[i] > most)) {
            best = i;
            most = cut_importance[i];
        }
    }
    return most > KILN_CUT_SHARE * total ? best : cut_count;
}

void cut_split(uint best, real3 p, real spread, real3 n)
{
    const uint parent = cut_node[best];
    bool kept = false;
    for (uint c = 0u; c < 2u; c++) {
        const uint child =
            c == 0u ? LightNodes(SCENE.lights.nodes).at[parent].left : LightNodes(SCENE.lights.nodes).at[parent].right;
        const real importance = light_importance(child, p, spread, n);
        if (importance <= 0)
            continue;
        cut_set(kept ? cut_count++ : best, child, importance);
        kept = true;
    }
    if (!kept) { /* the parent's bound was loose: the cluster is behind the point's horizon after all */
        cut_count--;
        cut_set(best, cut_node[cut_count], cut_importance[cut_count]);
    }
}

void cut_tree(real3 p, real spread, real3 n, uint limit)
{
    cut_count = 0u;
    cut_leaves = 0u;
    if (SCENE.lights.nodes == 0ul) /* of the direct pass where lamps are patches: other kernels have lights */
        return;
    const real importance = light_importance(0u, p, spread, n);
    if (importance <= 0)
        return;
    cut_set(0u, 0u, importance);
    cut_count = 1u;
    while (cut_count != 0u && cut_count < limit) {
        const uint best = cut_best();
        if (best == cut_count)
            break;
        cut_split(best, p, spread, n);
    }
}

/* 0 for one that is behind the point. */
real sun_importance(uint i, real3 n)
{
    const kiln_gpu_directional_light light = DirectionalLights(SCENE.lights.directionals).at[i];
    const real cosine = is_probe(n) ? real(1) : dot(n, real3_of(light.towards));
    return kiln_sun_importance(real_luminance(real3(vec3_of(light.irradiance))), cosine);
}

real sky_importance() { return kiln_sky_importance(real_luminance(real3(vec3_of(SCENE.lights.mean)))); }

uint kiln_lights_choose(real3 p, real spread, real3 n, uint limit, bool sky)
{
    cut_count = 0u;
    cut_total = 0;
    if (light_kind(KILN_GPU_KIND_AREA | KILN_GPU_KIND_PUNCTUAL))
        cut_tree(p, spread, n, limit);
    for (uint i = 0u; i < cut_count; i++)
        cut_total += cut_importance[i];
    uint candidates = cut_count;
    if (light_kind(KILN_GPU_KIND_SUN)) {
        for (uint i = 0u; i < SCENE.lights.directional_count; i++)
            cut_total += sun_importance(i, n);
        candidates += SCENE.lights.directional_count;
    }
    if (light_kind(KILN_GPU_KIND_SKY | KILN_GPU_KIND_IMAGE) && sky && SCENE.lights.environment != 0u) {
        cut_total += sky_importance();
        candidates++;
    }
    return candidates;
}

bool kiln_lights_candidate(uint i, real3 n, uint samples, out kiln_light_choice choice)
{
    const uint suns = light_kind(KILN_GPU_KIND_SUN) ? SCENE.lights.directional_count : 0u;
    real importance;
    if (i < cut_count) {
        choice.kind = KILN_CHOICE_NODE;
        choice.index = cut_node[i];
        importance = cut_importance[i];
    } else if (i - cut_count < suns) {
        choice.kind = KILN_CHOICE_DIRECTIONAL;
        choice.index = i - cut_count;
        importance = sun_importance(choice.index, n);
    } else {
        choice.kind = KILN_CHOICE_ENVIRONMENT;
        choice.index = 0u;
        importance = sky_importance();
    }
    choice.samples = kiln_choice_samples(importance / cut_total, samples);
    return importance > 0;
}

/* ---- environment (worker/light/environment.c) ---- */

uvec2 sky_texel(real3 d)
{
    return uvec2(kiln_sky_column(d, real(SCENE.lights.rotation), SCENE.lights.width),
                 kiln_sky_row(d, SCENE.lights.height));
}

real sky_texel_density(uvec2 at)
{
    const uint width = SCENE.lights.width;
    const real chance = kiln_step_chance(LightFloats(SCENE.lights.marginal), 0u, at.y) *
                        kiln_step_chance(LightFloats(SCENE.lights.conditional), at.y * width, at.x);
    return kiln_sky_density(chance, real(LightReals(SCENE.lights.rows).at[SCENE.lights.height + 1u + at.y]), width);
}

/* Radiance arriving from outside along `direction` (pointing outwards). */
vec3 kiln_environment_radiance(real3 direction)
{
    if (SCENE.lights.environment == 0u)
        return vec3(0.0);
    if (!light_kind(KILN_GPU_KIND_IMAGE))
        return vec3_of(SCENE.lights.sky);
    const uvec2 at = sky_texel(direction);
    LightFloats texels = LightFloats(SCENE.lights.texels + 12ul * (uint64_t(at.y) * SCENE.lights.width + at.x));
    return vec3(texels.at[0], texels.at[1], texels.at[2]);
}

/* Density per steradian of kiln_environment_sample. */
real kiln_environment_density(real3 direction)
{
    return light_kind(KILN_GPU_KIND_IMAGE) ? sky_texel_density(sky_texel(direction)) : KILN_SPHERE_DENSITY;
}

real3 kiln_environment_sample(real u, real v, out real density)
{
    if (!light_kind(KILN_GPU_KIND_IMAGE)) {
        density = KILN_SPHERE_DENSITY;
        return kiln_sphere_direction(u, v);
    }
    const uint width = SCENE.lights.width;
    real fx, fy;
    const uint y = kiln_step_find(LightFloats(SCENE.lights.marginal), 0u, SCENE.lights.height, v, fy);
    const uint x = kiln_step_find(LightFloats(SCENE.lights.conditional), y * width, width, u, fx);
    density = sky_texel_density(uvec2(x, y));
    LightReals rows = LightReals(SCENE.lights.rows);
    return kiln_sky_direction(x, fx, fy, real(rows.at[y]), real(rows.at[y + 1u]), width, real(SCENE.lights.rotation));
}

/* Cosine-distributed about n; tangents in float, as in worker/light/lights.c. */
real3 cosine_direction(real3 n, real u, real v)
{
    vec3 t, b;
    kiln_basis(vec3(n), t, b);
    const real r = sqrt(u);
    real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * v, sine, cosine);
    return real_unit_vector(real3(t) * (r * cosine) + real3(b) * (r * sine) + n * sqrt(max(real(0), 1 - u)));
}

/* See worker/light/lights.h. */
uint kiln_lights_strategies(kiln_light_choice choice, real3 n)
{
    return light_kind(KILN_GPU_KIND_IMAGE) && choice.kind == KILN_CHOICE_ENVIRONMENT && choice.samples >= 2u &&
                   !is_probe(n)
               ? 2u
               : 1u;
}

bool sample_environment(kiln_light_choice choice, uint index, real3 n, real3 shading, real pick, real u, real v,
                        inout kiln_light_sample s)
{
    const bool two = shading != n;
    const bool probe = is_probe(n), both = kiln_lights_strategies(choice, n) == 2u;
    real density = 1;
    if (probe || (both && (index & 1u) == 1u))
        s.direction = kiln_environment_sample(u, v, density);
    else
        s.direction = cosine_direction(two && pick < KILN_RATIO(1, 2) ? shading : n, u, v);
    const real cosine = probe ? real(1) : dot(n, s.direction);
    if (!(cosine > 0))
        return false;
    if (!probe) {
        density = (two ? kiln_sky_two_cosines(cosine, dot(shading, s.direction)) : cosine) / KILN_REAL_PI;
        if (both)
            density = kiln_sky_cosine_density(choice.samples, kiln_environment_density(s.direction), density);
    }
    s.value = real3(kiln_environment_radiance(s.direction)) / density;
    s.has_extent = true;
    return true;
}

/* ---- point, spot and area lights (worker/light/lights.c) ---- */

/* Share of the intensity towards unit `direction` from the light. */
real point_light_cone(kiln_gpu_point_light light, real3 direction)
{
    if ((light.flags & KILN_GPU_LIGHT_IS_SPOT) == 0u)
        return 1;
    return kiln_spot_cone(dot(real3_of(light.direction), direction), real(light.cos_outer),
                          real(light.cos_inner - light.cos_outer));
}

bool sample_point_light(uint index, real3 p, real weight, inout kiln_light_sample s)
{
    const kiln_gpu_point_light light = PointLights(SCENE.lights.points).at[index];
    const real3 to = real3(stored3_of(light.position) - stored3(p));
    s.distance = length(to);
    if (!(s.distance > 0))
        return false;
    s.direction = to * (1 / s.distance);
    const real factor = weight * point_light_cone(light, -s.direction) *
                        kiln_light_range(real(light.range), s.distance) / (s.distance * s.distance);
    s.value = real3(vec3_of(light.intensity)) * factor;
    return factor > 0 && !isinf(factor); /* the square of a float's smallest distances is 0 */
}

vec3 textured_emission(kiln_gpu_area_light light, real3 on)
{
    real b1, b2;
    kiln_triangle_weights(real3_of(light.e1), real3_of(light.e2), on, b1, b2);
    return kiln_surface_emission(light.triangle, float(b1), float(b2));
}

/* The light's radiance `on` from its corner 0. */
vec3 area_light_radiance(kiln_gpu_area_light light, real3 on)
{
    const bool textured = light_kind(KILN_GPU_KIND_TEXTURED) && (light.flags & KILN_GPU_LIGHT_HAS_TEXTURE) != 0u;
    return textured ? textured_emission(light, on) : vec3_of(light.radiance);
}

/* kiln_light_backoff of the light; where samples are floats they are off by as much again. */
real light_backoff(kiln_gpu_area_light light, real distance, real cosine)
{
#ifdef KILN_DOUBLES
    const real rounding = real(light.rounding);
#else
    const real rounding = real(light.rounding) + 2.4e-7 * distance;
#endif
    return kiln_light_backoff(rounding, distance, cosine);
}

bool sample_area_light(uint index, real3 p, real weight, real u, real v, inout kiln_light_sample s)
{
    const kiln_gpu_area_light light = AreaLights(SCENE.lights.areas).at[index];
    const stored3 stored0 = stored3_of(light.p0) - stored3(p);
    const real side = real(-dot(stored0, stored3_of(light.normal))), height = abs(side); /* of p above the front face */
    /* In the light's own plane, as far as floats tell, nothing of it is seen. */
    if (((light.flags & KILN_GPU_LIGHT_TWO_SIDED) != 0u ? height : side) <=
        KILN_AREA_LIGHT_HEIGHT * real(light.rounding))
        return false;
    const real3 to0 = real3(stored0), e1 = real3_of(light.e1), e2 = real3_of(light.e2);
    const kiln_spherical_triangle t = kiln_spherical_triangle_of(to0, e1, e2, real(light.area), height);
    const bool spherical = kiln_spherical_triangle_wanted(t);
    real3 to;
    if (spherical) {
        const real3 direction = kiln_spherical_triangle_direction(t, u, v);
        to = direction * (height / abs(dot(direction, real3_of(light.normal))));
    } else {
        to = to0 + kiln_triangle_place(e1, e2, u, v);
    }
    s.distance = length(to);
    if (!(s.distance > 0) || isinf(s.distance))
        return false;
    s.direction = to * (1 / s.distance);
    const real seen = height / s.distance; /* cosine at the light */
    s.backoff = light_backoff(light, s.distance, seen);
    s.has_extent = true;
    s.value = real3(area_light_radiance(light, to - to0)) * weight *
              (spherical ? t.omega : seen * real(light.area) / (s.distance * s.distance));
    return true;
}

/* Walks from a cluster down to one light, each child by its importance for p; gives 1 / probability. */
bool pick_light(uint node, real3 p, real3 n, real pick, out uint light, out real weight)
{
    LightNodes nodes = LightNodes(SCENE.lights.nodes);
    weight = 1;
    light = 0u;
    for (uint left = nodes.at[node].left; left != KILN_GPU_NONE; left = nodes.at[node].left) {
        const uint right = nodes.at[node].right;
        const real a = light_importance(left, p, 0, n), b = light_importance(right, p, 0, n);
        if (a + b <= 0)
            return false;
        node = kiln_light_tree_step(a / (a + b), pick, weight) ? left : right;
    }
    light = nodes.at[node].right;
    return true;
}

/* Draws the choice's `index`-th sample with random numbers in (0,1): `pick` goes down the tree, u and v over the light.
 * False when it brings nothing. */
bool kiln_lights_sample(kiln_light_choice choice, uint index, real3 p, real3 n, real3 shading, real pick, real u,
                        real v, out kiln_light_sample s)
{
    s.direction = real3(0);
    s.value = real3(0);
    s.distance = real(KILN_INFINITY);
    s.backoff = 0;
    s.has_extent = false;
    s.light = KILN_GPU_NONE;
    if (light_kind(KILN_GPU_KIND_SKY | KILN_GPU_KIND_IMAGE) && choice.kind == KILN_CHOICE_ENVIRONMENT)
        return sample_environment(choice, index, n, shading, pick, u, v, s);
    if (light_kind(KILN_GPU_KIND_SUN) && choice.kind == KILN_CHOICE_DIRECTIONAL) {
        const kiln_gpu_directional_light light = DirectionalLights(SCENE.lights.directionals).at[choice.index];
        s.direction = real3_of(light.towards);
        s.value = real3(vec3_of(light.irradiance));
        return true;
    }
    if (!light_kind(KILN_GPU_KIND_AREA | KILN_GPU_KIND_PUNCTUAL))
        return false;
    uint light;
    real weight;
    if (!pick_light(choice.index, p, n, pick, light, weight))
        return false;
    s.light = light;
    const uint areas = SCENE.lights.area_count;
    if (light_kind(KILN_GPU_KIND_AREA) && (!light_kind(KILN_GPU_KIND_PUNCTUAL) || light < areas))
        return sample_area_light(light, p, weight, u, v, s);
    return sample_point_light(light - areas, p, weight, s);
}

#endif
