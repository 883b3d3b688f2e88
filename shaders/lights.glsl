/* Lights: their memory layout, and declarations that shaders/shared/lights.h needs. Kinds of light that the scene does
 * not have are compiled away (LIGHT_KINDS). Needs shaders/kernel.glsl and the push constants before it. */
#ifndef KILN_LIGHTS_GLSL
#define KILN_LIGHTS_GLSL

#include "shaders/real.glsl"
#include "shaders/material.glsl"
#include "shaders/shared/area_light.h"
#include "shaders/shared/color.h"
#include "shaders/shared/light_importance.h"
#include "shaders/shared/light_structs.h"
#include "shaders/shared/punctual_light.h"

#define KILN_STORED_REAL stored
#define KILN_STORED_NAME(name) name
#include "shaders/shared/layout_light_real.h"

/* Direction and length `limit` of a sample's shadow ray, which starts `off` the position that the sample was drawn for.
 */
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

/* ---- declarations that shaders/shared/lights.h needs ---- */

#define KILN_CONTEXT_lights SCENE.lights
#define KILN_MAY_BE(kinds) light_kind(kinds)
#define KILN_FLOATS LightFloats
#define KILN_FLOAT_OF(array, i) array.at[i]
#define KILN_SKY_IS_IMAGE(lights) light_kind(KILN_GPU_KIND_IMAGE)
#define KILN_SKY_WIDTH(lights) SCENE.lights.width
#define KILN_SKY_HEIGHT(lights) SCENE.lights.height
#define KILN_SKY_ROTATION(lights) real(SCENE.lights.rotation)
#define KILN_SKY_MARGINAL(lights) LightFloats(SCENE.lights.marginal)
#define KILN_SKY_CONDITIONAL(lights) LightFloats(SCENE.lights.conditional)
#define KILN_SKY_COSINE(lights, y) real(LightReals(SCENE.lights.rows).at[y])
#define KILN_SKY_BAND(lights, y) real(LightReals(SCENE.lights.rows).at[SCENE.lights.height + 1u + (y)])
#define KILN_SUN_LUMINANCE(light) real_luminance(real3(light.irradiance))
#define KILN_LIGHT_NODE_IMPORTANCE(lights, index, p, spread, n) light_importance(index, p, spread, n)

#define kiln_lights_nodes(index) LightNodes(SCENE.lights.nodes).at[index]

kiln_area_light kiln_lights_areas(uint index)
{
    const kiln_gpu_area_light light = AreaLights(SCENE.lights.areas).at[index];
    return kiln_area_light(
        stored3_of(light.p0), real3_of(light.e1), real3_of(light.e2), stored3_of(light.normal), real(light.area),
        real(light.rounding), vec3_of(light.radiance), light.triangle, (light.flags & KILN_GPU_LIGHT_TWO_SIDED) != 0u,
        (light.flags & KILN_GPU_LIGHT_HAS_TEXTURE) != 0u, light.at, light.path, light.depth, light.turn);
}

kiln_point_light kiln_lights_points(uint index)
{
    const kiln_gpu_point_light light = PointLights(SCENE.lights.points).at[index];
    return kiln_point_light(stored3_of(light.position), real3_of(light.direction), vec3_of(light.intensity),
                            real(light.range), real(light.cos_inner), real(light.cos_outer),
                            (light.flags & KILN_GPU_LIGHT_IS_SPOT) != 0u);
}

kiln_directional_light kiln_lights_directionals(uint index)
{
    const kiln_gpu_directional_light light = DirectionalLights(SCENE.lights.directionals).at[index];
    return kiln_directional_light(real3_of(light.towards), vec3_of(light.irradiance));
}

real light_importance(uint index, real3 p, real spread, real3 n)
{
    const kiln_gpu_light_node node = LightNodes(SCENE.lights.nodes).at[index];
    return kiln_light_importance(kiln_light_bounds(real3_of(node.centre), real3_of(node.axis), real(node.radius),
                                                   real(node.floor2), real(node.cos_o), real(node.sin_o),
                                                   real(node.cos_e), real(node.power),
                                                   (node.flags & KILN_GPU_LIGHT_TWO_SIDED) != 0u, node.power > 0),
                                 p, spread, n);
}

/* The cut of the thread's point. */
uint cut_node[KILN_CUT_MAX];
real cut_importance[KILN_CUT_MAX];
uint cut_count, cut_leaves; /* cut_leaves: bit i is set where cut_node[i] is a single light */
real cut_total;             /* importance of all candidates */

#define KILN_CUT uint /* there is one */
#define KILN_CUT_LIGHT_NODE(cut, i) cut_node[i]
#define KILN_CUT_IMPORTANCE(cut, i) cut_importance[i]
#define KILN_CUT_IS_LEAF(lights, cut, i) ((cut_leaves >> i & 1u) != 0u)

void kiln_cut_set(KILN_CUT cut, uint i, uint node, real importance)
{
    cut_node[i] = node;
    cut_importance[i] = importance;
    const uint leaf = LightNodes(SCENE.lights.nodes).at[node].left == KILN_GPU_NONE ? 1u : 0u;
    cut_leaves = (cut_leaves & ~(1u << i)) | leaf << i;
}

#include "shaders/shared/environment.h"

/* Radiance arriving from outside along `direction` (pointing outwards). */
vec3 kiln_environment_radiance(real3 direction)
{
    if (SCENE.lights.environment == 0u)
        return vec3(0.0);
    if (!light_kind(KILN_GPU_KIND_IMAGE))
        return vec3_of(SCENE.lights.sky);
    const uint x = kiln_sky_column(direction, real(SCENE.lights.rotation), SCENE.lights.width),
               y = kiln_sky_row(direction, SCENE.lights.height);
    LightFloats texels = LightFloats(SCENE.lights.texels + 12ul * (uint64_t(y) * SCENE.lights.width + x));
    return vec3(texels.at[0], texels.at[1], texels.at[2]);
}
void kiln_environment_radiance(real3 direction, out vec3 rgb) { rgb = kiln_environment_radiance(direction); }

/* Radiance of the light at `on`, relative to its corner 0: emission x opacity (worker/light/lamp_textures.h). */
void kiln_area_light_radiance_on(kiln_area_light light, real3 on, out vec3 rgb)
{
    rgb = light.radiance;
    if (!light_kind(KILN_GPU_KIND_TEXTURED) || !light.textured)
        return;
    real b1, b2;
    kiln_triangle_weights(light.e1, light.e2, on, b1, b2);
    const float u = light.at[0] + float(b1) * (light.at[2] - light.at[0]) + float(b2) * (light.at[4] - light.at[0]),
                v = light.at[1] + float(b1) * (light.at[3] - light.at[1]) + float(b2) * (light.at[5] - light.at[1]);
    rgb = kiln_surface_emission(light.triangle, u, v);
    if (light.triangle >= SCENE.opaque_count)
        rgb *= kiln_surface_passage(light.triangle, u, v).opacity;
}

#include "shaders/shared/lights.h"

#include "shaders/light_choices.glsl"

#endif
