/* Sampler of a single area light for all sample positions of one surface point (shaders/shared/area_sampler.h); each
 * thread draws one sample.
 *
 *   if (kiln_light_is_target(choice, centre, spread)) {
 *       const kiln_area_light_sampler target = kiln_area_light_sampler_of(choice.index, centre);
 *       if (kiln_area_light_sampler_draw(target, place - centre, u, v, s)) ...
 *
 * Other choices use kiln_sample_choice. Whether the sampler applies, where the light is, and how high the point lies
 * above its plane, are computed from stored numbers; all else needs only floats. Include what shaders/lights.glsl
 * needs. */
#ifndef KILN_TARGET_GLSL
#define KILN_TARGET_GLSL

#include "shaders/lights.glsl"
#include "shaders/shared/area_sampler.h"

struct kiln_area_light_sampler {
    kiln_area_view view;
    uint light;
};

kiln_area_light_sampler kiln_area_light_sampler_of(uint node, vec3 centre)
{
    const uint light = LightNodes(SCENE.lights.nodes).at[node].right;
    return kiln_area_light_sampler(kiln_area_view_of(kiln_lights_areas(light), stored3(centre)), light);
}

bool kiln_is_lone_area_light(kiln_light_choice choice)
{
    if (!light_kind(KILN_GPU_KIND_AREA) || choice.kind != KILN_CHOICE_LIGHT_NODE)
        return false;
    const kiln_gpu_light_node node = LightNodes(SCENE.lights.nodes).at[choice.index];
    return node.left == KILN_GPU_NONE && node.right < SCENE.lights.area_count;
}

/* Whether this sampler can be used for a choice of lights, from positions within `spread` of the centre. */
bool kiln_light_is_target(kiln_light_choice choice, vec3 centre, float spread)
{
    if (!kiln_is_lone_area_light(choice))
        return false;
    const kiln_area_light light = kiln_lights_areas(LightNodes(SCENE.lights.nodes).at[choice.index].right);
    return kiln_area_is_near(light, stored3(centre), real(spread)) &&
           kiln_target_is_apart(kiln_area_view_of(light, stored3(centre)).seen);
}

/* Draws a sample from a position, `from` relative to the centre; false if it contributes nothing. */
bool kiln_area_light_sampler_draw(kiln_area_light_sampler t, real3 from, real u, real v, out kiln_light_sample s)
{
    const kiln_area_light light = kiln_lights_areas(t.light);
    real area = light.area, seen;
    real3 on, to;
    if (t.view.spherical)
        on = kiln_area_place(t.view, kiln_spherical_triangle_direction(t.view.seen, u, v), area);
    else
        on = t.view.to0 + kiln_triangle_place(light.e1, light.e2, u, v);
    const real weight = kiln_area_see(t.view, on, from, area, to, s.distance, seen);
    vec3 rgb;
    kiln_area_light_radiance_on(light, on - t.view.to0, rgb);
    s.direction = to * (1 / s.distance);
    s.value = real3(rgb) * weight;
    s.backoff = kiln_area_light_backoff(light, s.distance, seen);
    s.has_extent = true;
    s.light = t.light;
    return weight > 0 && !isinf(weight);
}

#endif
