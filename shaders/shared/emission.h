/* Emission sampling: the rays with which light paths leave the lights, and their densities (worker/light/emission.h
 * explains the sampling).
 *
 * KILN_CONTEXT(kiln_emission, emission) has the arrays `chance`, `up_to`, `parent` and `leaf` of that struct. The
 * including file must include shaders/shared/lights.h before, and define for its language (worker/light/emission.c,
 * shaders/emission.glsl): KILN_EMISSION_DIRECTIONAL(emission) and KILN_EMISSION_ENVIRONMENT(emission), the numbers of
 * the first directional light and of the environment; KILN_EMISSION_CENTRE(emission) and
 * KILN_EMISSION_RADIUS(emission) of the sphere about the scene. */
#ifndef KILN_SHADERS_SHARED_EMISSION_H
#define KILN_SHADERS_SHARED_EMISSION_H

#include "shaders/shared/emitted.h"
#include "shaders/shared/lights.h"

/* Area of the disc on which rays from outside the scene start, m2. */
KILN_FUNCTION kiln_real kiln_emission_disc(kiln_real radius) { return KILN_REAL_PI * radius * radius; }

/* ---- densities ---- */

/* Density of a ray that leaves a point of a light with this cosine, as `density` of struct kiln_emitted. `direction`:
 * unit, from the light; used for the environment only. */
KILN_FUNCTION kiln_real kiln_emitted_density(KILN_CONTEXT(kiln_emission, emission) KILN_U32 light, kiln_real cosine,
                                             kiln_real3 direction)
{
    KILN_CONTEXT_IS(kiln_lights, lights, emission->lights);
    const KILN_U32 areas = KILN_TO_U32(KILN_GET(lights, area_count));
    const kiln_real chance = KILN_AT(KILN_LOAD(emission, chance, light));
    if (light < areas) {
        const KILN_ITEM(kiln_area_light) area = KILN_LOAD(lights, areas, light);
        const kiln_real sides = kiln_real_of(KILN_AT(area).two_sided ? 2 : 1);
        return chance * cosine / (KILN_REAL_PI * KILN_AT(area).area * sides);
    }
    if (light < KILN_EMISSION_DIRECTIONAL(emission))
        return chance / kiln_punctual_angle(KILN_LOAD(lights, points, light - areas));
    if (light < KILN_EMISSION_ENVIRONMENT(emission))
        return chance / kiln_emission_disc(KILN_EMISSION_RADIUS(emission));
    return chance * kiln_sky_direction_density(KILN_PASS(lights) real3_negate(direction)) /
           kiln_emission_disc(KILN_EMISSION_RADIUS(emission));
}

/* Probability with which kiln_pick_light, descending the light tree, picks this light. */
KILN_FUNCTION kiln_real kiln_tree_chance(KILN_CONTEXT(kiln_emission, emission) KILN_U32 light, kiln_real3 p,
                                         kiln_real3 n)
{
    KILN_CONTEXT_IS(kiln_lights, lights, emission->lights);
    kiln_real chance = 1;
    for (KILN_U32 node = KILN_AT(KILN_LOAD(emission, leaf, light)); node != 0u;) {
        const KILN_U32 parent = KILN_AT(KILN_LOAD(emission, parent, node)),
                       left = KILN_AT(KILN_LOAD(lights, nodes, parent)).left,
                       right = KILN_AT(KILN_LOAD(lights, nodes, parent)).right;
        const kiln_real a = KILN_LIGHT_NODE_IMPORTANCE(lights, left, p, kiln_real_of(0), n),
                        b = KILN_LIGHT_NODE_IMPORTANCE(lights, right, p, kiln_real_of(0), n);
        if (!(a + b > 0))
            return kiln_real_of(0);
        chance *= (node == left ? a : b) / (a + b);
        node = parent;
    }
    return chance;
}

/* Density per m2 with which sampling from p finds a point on the area light. */
KILN_FUNCTION kiln_real kiln_area_light_density(KILN_IN(KILN_STRUCT kiln_area_light) light, kiln_real3 p,
                                                kiln_real3 place)
{
    const kiln_stored3 stored0 = stored3_sub(KILN_AT(light).p0, KILN_TO_STORED3(p));
    const kiln_real3 to = real3_sub(place, p);
    const kiln_real side = kiln_real_of(-stored3_dot(stored0, KILN_AT(light).normal)), height = real_abs(side),
                    squared = real3_dot(to, to);
    if ((KILN_AT(light).two_sided ? height : side) <= KILN_AREA_LIGHT_HEIGHT * KILN_AT(light).rounding)
        return kiln_real_of(0);
    const KILN_STRUCT kiln_spherical_triangle t = kiln_spherical_triangle_of(
        KILN_TO_REAL3(stored0), KILN_AT(light).e1, KILN_AT(light).e2, KILN_AT(light).area, height);
    return kiln_spherical_triangle_wanted(t) ? height / (real_sqrt(squared) * squared * t.omega)
                                             : 1 / KILN_AT(light).area;
}

/* Density with which one light sample from p finds this point of a light (kiln_emission_connect). */
KILN_FUNCTION kiln_real kiln_light_connect(KILN_CONTEXT(kiln_emission, emission) KILN_U32 light, kiln_real3 p,
                                           kiln_real3 n, kiln_real3 place, kiln_real3 direction)
{
    KILN_CONTEXT_IS(kiln_lights, lights, emission->lights);
    if (light < KILN_EMISSION_DIRECTIONAL(emission)) {
        const kiln_real chance = kiln_tree_chance(KILN_PASS(emission) light, p, n);
        return light < KILN_GET(lights, area_count)
                   ? chance * kiln_area_light_density(KILN_LOAD(lights, areas, light), p, place)
                   : chance;
    }
    return light < KILN_EMISSION_ENVIRONMENT(emission)
               ? kiln_real_of(1)
               : kiln_sky_direction_density(KILN_PASS(lights) real3_negate(direction));
}

/* Finds the area light at a point of a world triangle, given by the barycentric weights of corners 1 and 2. KILN_NONE:
 * there is none. */
KILN_FUNCTION KILN_U32 kiln_area_light_at(KILN_CONTEXT(kiln_lights, lights) KILN_U32 triangle, kiln_real b1,
                                          kiln_real b2)
{
    const KILN_U32 count = KILN_TO_U32(KILN_GET(lights, area_count));
    KILN_U32 low = 0u, high = count;
    while (low < high) { /* area lights are sorted by triangle */
        const KILN_U32 middle = (low + high) / 2u;
        if (KILN_AT(KILN_LOAD(lights, areas, middle)).triangle < triangle)
            low = middle + 1u;
        else
            high = middle;
    }
    if (low == count || KILN_AT(KILN_LOAD(lights, areas, low)).triangle != triangle)
        return KILN_NONE;
    if (!KILN_MAY_BE(KILN_GPU_KIND_TEXTURED) || KILN_AT(KILN_LOAD(lights, areas, low)).depth == 0u)
        return low;
    const KILN_U32 path = kiln_subtriangle_path(b1, b2, KILN_AT(KILN_LOAD(lights, areas, low)).turn);
    for (high = count; low + 1u < high;) { /* the last light of the triangle whose path is not above */
        const KILN_U32 middle = (low + high) / 2u;
        if (KILN_AT(KILN_LOAD(lights, areas, middle)).triangle == triangle &&
            KILN_AT(KILN_LOAD(lights, areas, middle)).path <= path)
            low = middle;
        else
            high = middle;
    }
    const KILN_ITEM(kiln_area_light) found = KILN_LOAD(lights, areas, low);
    return (path ^ KILN_AT(found).path) >> (32u - KILN_AT(found).depth) == 0u ? low : KILN_NONE;
}

/* ---- drawing ---- */

/* Picks a light by inverting the CDF `up_to` at `pick`. */
KILN_FUNCTION KILN_U32 kiln_emission_pick(KILN_CONTEXT(kiln_emission, emission) kiln_real pick)
{
    KILN_U32 low = 0u, high = KILN_EMISSION_ENVIRONMENT(emission); /* the last */
    while (low < high) {
        const KILN_U32 middle = (low + high) / 2u;
        if (pick < KILN_AT(KILN_LOAD(emission, up_to, middle)))
            high = middle;
        else
            low = middle + 1u;
    }
    while (low > 0u && !(KILN_AT(KILN_LOAD(emission, chance, low)) > 0)) /* the sum is rounded */
        low--;
    return low;
}

KILN_FUNCTION void kiln_draw_from_area(KILN_CONTEXT(kiln_emission, emission) KILN_IN(KILN_STRUCT kiln_area_light) light,
                                       kiln_real u, kiln_real v, kiln_real s, kiln_real t,
                                       KILN_INOUT(KILN_STRUCT kiln_emitted) ray)
{
    const kiln_real3 on = kiln_triangle_place(KILN_AT(light).e1, KILN_AT(light).e2, u, v),
                     normal = KILN_TO_REAL3(KILN_AT(light).normal);
    const bool back = KILN_AT(light).two_sided && s < KILN_RATIO(1, 2);
    if (KILN_AT(light).two_sided)
        s = back ? 2 * s : 2 * s - 1;
    const kiln_real r = real_sqrt(s), up = real_sqrt(real_max(kiln_real_of(0), 1 - s));
    kiln_real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * t, KILN_TO(sine), KILN_TO(cosine));
    KILN_AT(ray).origin = real3_add(KILN_TO_REAL3(KILN_AT(light).p0), on);
    KILN_AT(ray).direction = real_unit_vector(kiln_about_axis(normal, r * cosine, r * sine, back ? -up : up));
    KILN_AT(ray).cosine = real_abs(real3_dot(KILN_AT(ray).direction, normal));
    KILN_AT(ray).density =
        kiln_emitted_density(KILN_PASS(emission) KILN_AT(ray).light, KILN_AT(ray).cosine, KILN_AT(ray).direction);
    KILN_AT(ray).has_place = true;
    KILN_RGB(rgb);
    kiln_area_light_radiance_on(KILN_PASS(emission->lights) light, on, rgb);
    kiln_emitted_set_flux(ray, rgb, KILN_AT(ray).cosine);
}

KILN_FUNCTION void kiln_draw_from_point(KILN_CONTEXT(kiln_emission, emission) KILN_IN(KILN_STRUCT kiln_point_light)
                                            light,
                                        kiln_real s, kiln_real t, KILN_INOUT(KILN_STRUCT kiln_emitted) ray)
{
    const kiln_real3 direction = kiln_punctual_sample(light, s, t);
    KILN_AT(ray).direction = KILN_AT(light).spot ? real_unit_vector(direction) : direction;
    KILN_AT(ray).origin = KILN_TO_REAL3(KILN_AT(light).position);
    KILN_AT(ray).density =
        kiln_emitted_density(KILN_PASS(emission) KILN_AT(ray).light, kiln_real_of(1), KILN_AT(ray).direction);
    KILN_AT(ray).has_place = true;
    KILN_AT(ray).is_point = true;
    kiln_emitted_set_flux(ray, KILN_AT(light).intensity, kiln_punctual_profile(light, KILN_AT(ray).direction));
}

/* Samples a ray that starts outside the scene, on a disc perpendicular to its direction. `light`: radiance or
 * irradiance that it carries. */
KILN_FUNCTION void kiln_draw_from_outside(KILN_CONTEXT(kiln_emission, emission) KILN_RGB_IN(light), kiln_real u,
                                          kiln_real v, KILN_INOUT(KILN_STRUCT kiln_emitted) ray)
{
    const kiln_real sphere = KILN_EMISSION_RADIUS(emission), r = sphere * real_sqrt(u);
    kiln_real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * v, KILN_TO(sine), KILN_TO(cosine));
    KILN_AT(ray).origin = real3_add(KILN_EMISSION_CENTRE(emission),
                                    kiln_about_axis(KILN_AT(ray).direction, r * cosine, r * sine, -2 * sphere));
    KILN_AT(ray).density =
        kiln_emitted_density(KILN_PASS(emission) KILN_AT(ray).light, kiln_real_of(1), KILN_AT(ray).direction);
    kiln_emitted_set_flux(ray, light, kiln_real_of(1));
}

/* Samples a ray by random numbers in (0, 1). False: it carries no light. The scene must have lights. */
KILN_FUNCTION bool kiln_draw_emitted(KILN_CONTEXT(kiln_emission, emission) kiln_real pick, kiln_real u, kiln_real v,
                                     kiln_real s, kiln_real t, KILN_OUT(KILN_STRUCT kiln_emitted) ray)
{
    KILN_CONTEXT_IS(kiln_lights, lights, emission->lights);
    const KILN_U32 light = kiln_emission_pick(KILN_PASS(emission) pick),
                   areas = KILN_TO_U32(KILN_GET(lights, area_count)), suns = KILN_EMISSION_DIRECTIONAL(emission);
    KILN_AT(ray).light = light;
    KILN_AT(ray).cosine = 1;
    KILN_AT(ray).has_place = false;
    KILN_AT(ray).is_point = false;
    if (KILN_MAY_BE(KILN_GPU_KIND_AREA) && light < areas) {
        kiln_draw_from_area(KILN_PASS(emission) KILN_LOAD(lights, areas, light), u, v, s, t, ray);
    } else if (KILN_MAY_BE(KILN_GPU_KIND_PUNCTUAL) && light < suns) {
        kiln_draw_from_point(KILN_PASS(emission) KILN_LOAD(lights, points, light - areas), s, t, ray);
    } else if (light < KILN_EMISSION_ENVIRONMENT(emission)) {
        const KILN_ITEM(kiln_directional_light) sun = KILN_LOAD(lights, directionals, light - suns);
        KILN_AT(ray).direction = real3_negate(KILN_AT(sun).towards);
        KILN_AT(ray).is_point = true;
        kiln_draw_from_outside(KILN_PASS(emission) KILN_AT(sun).irradiance, u, v, ray);
    } else {
        kiln_real density;
        KILN_RGB(rgb);
        const kiln_real3 outwards = kiln_sky_sample(KILN_PASS(lights) s, t, KILN_TO(density));
        kiln_environment_radiance(KILN_PASS(lights) outwards, rgb);
        KILN_AT(ray).direction = real3_negate(outwards);
        kiln_draw_from_outside(KILN_PASS(emission) rgb, u, v, ray);
    }
    return KILN_AT(ray).density > 0 &&
           (KILN_AT(ray).flux[0] > 0 || KILN_AT(ray).flux[1] > 0 || KILN_AT(ray).flux[2] > 0);
}

#endif
