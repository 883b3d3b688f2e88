/* A lone area light as all places of one surface point see it: worker/light/area_light_sampler.c.
 *
 *   if (kiln_light_is_target(choice, centre, spread)) {
 *       const kiln_area_light_sampler target = kiln_area_light_sampler_of(choice.index, centre);
 *       if (kiln_area_light_sampler_draw(target, place - centre, u, v, s)) ...
 *
 * Else the choice is left to kiln_lights_sample. Whether it is one, where the light is and how high the point is above
 * its plane is reckoned from what is stored; all else needs no more than floats. Needs what shaders/lights.glsl needs.
 */
#ifndef KILN_TARGET_GLSL
#define KILN_TARGET_GLSL

#include "shaders/lights.glsl"

struct kiln_area_light_sampler {
    kiln_spherical_triangle seen; /* from the centre */
    bool spherical;               /* by solid angle, else by area */
    real3 towards;                /* unit, normal to the light's plane, pointing at it */
    real height;                  /* m: of the centre above that plane */
    real3 to0;                    /* m: from the centre to corner 0 */
    uint light;
};

kiln_area_light_sampler kiln_area_light_sampler_of(uint node, vec3 centre)
{
    kiln_area_light_sampler t;
    t.light = LightNodes(SCENE.lights.nodes).at[node].right;
    const kiln_gpu_area_light light = AreaLights(SCENE.lights.areas).at[t.light];
    const stored3 to0 = stored3_of(light.p0) - stored3(centre);
    const stored side = -dot(to0, stored3_of(light.normal));
    t.to0 = real3(to0);
    t.height = real(abs(side));
    t.towards = real3(side > 0 ? -stored3_of(light.normal) : stored3_of(light.normal));
    t.seen = kiln_spherical_triangle_of(t.to0, real3_of(light.e1), real3_of(light.e2), real(light.area), t.height);
    t.spherical = kiln_spherical_triangle_wanted(t.seen);
    return t;
}

bool kiln_is_lone_area_light(kiln_light_choice choice)
{
    if (!light_kind(KILN_GPU_KIND_AREA) || choice.kind != KILN_CHOICE_NODE)
        return false;
    const kiln_gpu_light_node node = LightNodes(SCENE.lights.nodes).at[choice.index];
    return node.left == KILN_GPU_NONE && node.right < SCENE.lights.area_count;
}

/* Whether a choice is to be sampled as a target from a point within `spread` of the centre. */
bool kiln_light_is_target(kiln_light_choice choice, vec3 centre, float spread)
{
    if (!kiln_is_lone_area_light(choice))
        return false;
    const kiln_gpu_area_light light =
        AreaLights(SCENE.lights.areas).at[LightNodes(SCENE.lights.nodes).at[choice.index].right];
    const stored side = dot(stored3(centre) - stored3_of(light.p0), stored3_of(light.normal));
    const real height = real((light.flags & KILN_GPU_LIGHT_TWO_SIDED) != 0u ? abs(side) : side);
    if (!kiln_target_is_near(height, real(light.rounding), real(spread)))
        return false;
    return kiln_target_is_apart(kiln_area_light_sampler_of(choice.index, centre).seen);
}

/* From the centre to a place on the light, evenly in solid angle; `area`: 1 / density of that place on the light, m2.
 */
real3 target_spherical(kiln_area_light_sampler t, real u, real v, out real area)
{
    const real3 direction = kiln_spherical_triangle_direction(t.seen, u, v);
    const real cosine = dot(direction, t.towards), far = t.height / cosine;
    area = far * far * t.seen.omega / cosine;
    return far * direction;
}

real3 target_flat(kiln_area_light_sampler t, kiln_gpu_area_light light, real u, real v, out real area)
{
    area = real(light.area);
    return t.to0 + kiln_triangle_place(real3_of(light.e1), real3_of(light.e2), u, v);
}

/* One sample from a place, `from` the centre; false when it brings nothing. */
bool kiln_area_light_sampler_draw(kiln_area_light_sampler t, real3 from, real u, real v, out kiln_light_sample s)
{
    s.has_extent = true;
    s.light = t.light;
    const kiln_gpu_area_light light = AreaLights(SCENE.lights.areas).at[t.light];
    real area;
    real3 on;
    if (t.spherical)
        on = target_spherical(t, u, v, area);
    else
        on = target_flat(t, light, u, v, area);
    const real3 to = on - from;
    const real squared = dot(to, to);
    s.distance = sqrt(squared);
    s.direction = to * (1 / s.distance);
    const real seen = (t.height - dot(from, t.towards)) / s.distance; /* cosine at the light */
    const real weight = seen * area / squared;
    s.backoff = light_backoff(light, s.distance, seen);
    s.value = real3(area_light_radiance(light, on - t.to0)) * weight;
    return weight > 0 && !isinf(weight);
}

#endif
