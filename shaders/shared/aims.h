/* Sampling of the first rays of landing light paths, and their densities; worker/light/aims.h explains how rays are
 * aimed.
 *
 * KILN_CONTEXT(kiln_aims, aims) has the arrays `lamps`, `until`, `lamp_of` and `first`. The including file must define
 * before, for its language (worker/light/aims.c, shaders/aims.glsl), shaders/shared/lights.h and:
 *
 *   KILN_AIM_COUNT(aims), KILN_AIM_LAMP(aims, aim), KILN_AIM_TARGET(aims, aim), KILN_AIM_AT(aims, lamp, target)
 *   KILN_AIM_EVEN(aims, aim)                 number of an aim's paths that are uniform over triangles
 *   KILN_TARGET(aims, index), KILN_TARGET_OF(aims, triangle), KILN_TARGET_PICK(aims, target, pick)
 *   struct kiln_box_seen, with `omega`, kiln_target_see_box and kiln_box_direction (worker/light/targets.h)
 *   KILN_AIM_CENTRE(aims), KILN_AIM_RADIUS(aims)        of a sphere about the scene
 *   KILN_AIM_LAMP_NUMBER(aims, light, direction)        the lamp that a light is a part of
 *   KILN_AIM_SUNS(aims), KILN_AIM_SKY(aims)             the numbers of the first directional light, of the environment
 *   kiln_aim_sky_sample, KILN_AIM_PER_CELL(aims, lamp, density)   sampling of the cells of a sky image
 *   KILN_AIM_NORMAL(aims, triangle), kiln_aim_corner, kiln_aim_place   normal, corner 0, a point of a world triangle
 *   KILN_AIM_OFFSET(aims, triangle, normal)             offset of ray origins from a surface, m
 *   KILN_AREA_LUMINANCE(light) */
#ifndef KILN_SHADERS_SHARED_AIMS_H
#define KILN_SHADERS_SHARED_AIMS_H

#include "shaders/shared/aimed_ray.h"
#include "shaders/shared/lights.h"
#include "shaders/shared/targets.h"

/* For emitting triangles: whether a cone is so wide that directions are drawn by the cosine instead; and the largest
 * solid angle, sr, at which a box is sampled rather than the cone. */
KILN_FUNCTION bool kiln_cone_is_wide(kiln_real height) { return height > KILN_RATIO(1, 2); }
KILN_FUNCTION kiln_real kiln_box_most(kiln_real height)
{
    return 2 * KILN_REAL_PI * (kiln_cone_is_wide(height) ? KILN_RATIO(1, 2) : height);
}

/* Cone of directions that are sampled at a point or spot light: 1 - cosine of its half-angle, and its axis. */
KILN_FUNCTION kiln_real kiln_point_cone(KILN_IN(KILN_STRUCT kiln_point_light) light,
                                        KILN_IN(KILN_STRUCT kiln_target) target, KILN_OUT(kiln_real3) axis)
{
    const kiln_real3 place = KILN_TO_REAL3(KILN_AT(light).position);
    const kiln_real height = kiln_cone_height(target, place), own = kiln_punctual_cone(light);
    const bool narrow = own < height;
    KILN_AT(axis) = narrow ? KILN_AT(light).direction : kiln_target_towards(target, place);
    return narrow ? own : height;
}

KILN_FUNCTION kiln_real kiln_area_sides(KILN_IN(KILN_STRUCT kiln_area_light) light)
{
    return kiln_real_of(KILN_AT(light).two_sided ? 2 : 1);
}

/* Luminance of the power of an area light, W. */
KILN_FUNCTION kiln_real kiln_area_flux(KILN_IN(KILN_STRUCT kiln_area_light) light)
{
    return KILN_REAL_PI * KILN_AT(light).area * kiln_area_sides(light) * KILN_AREA_LUMINANCE(light);
}

/* Density per m2 of points on an emitting triangle, if triangles of the lamp are chosen by flux. */
KILN_FUNCTION kiln_real kiln_area_chance(KILN_IN(KILN_STRUCT kiln_area_light) light, kiln_real lamp_flux)
{
    return kiln_area_flux(light) / lamp_flux / KILN_AT(light).area;
}
/* 1 / kiln_area_chance, in m2. GLSL rounds differently, since it divides by the chance. */
KILN_FUNCTION kiln_real kiln_area_spread(KILN_IN(KILN_STRUCT kiln_area_light) light, kiln_real lamp_flux)
{
#ifdef KILN_GLSL
    return light.area / (kiln_area_flux(light) / lamp_flux);
#else
    return light->area * lamp_flux / kiln_area_flux(light);
#endif
}

KILN_FUNCTION void kiln_aimed_set_flux(KILN_INOUT(KILN_STRUCT kiln_aimed_ray) ray, KILN_RGB_IN(light), kiln_real factor)
{
    for (int c = 0; c < 3; c++)
        KILN_AT(ray).flux[c] = kiln_real_of(light[c]) * factor;
}

/* ---- rays aimed at a target's sphere or box ---- */

/* Sets a ray that starts outside the scene and goes through a point at the target. */
KILN_FUNCTION void kiln_aim_outside(KILN_CONTEXT(kiln_aims, aims) KILN_IN(KILN_STRUCT kiln_target) target,
                                    kiln_real3 back, kiln_real3 through, KILN_INOUT(KILN_STRUCT kiln_aimed_ray) ray)
{
    const kiln_real away = KILN_AIM_RADIUS(aims) +
                           real3_length(real3_sub(KILN_AT(target).centre, KILN_AIM_CENTRE(aims))) +
                           kiln_target_reach(target);
    KILN_AT(ray).place = real3_add(through, real3_scale(back, away));
    KILN_AT(ray).origin = KILN_TO_VECTOR(KILN_AT(ray).place);
    KILN_AT(ray).direction = KILN_TO_VECTOR(real3_negate(back));
}

KILN_FUNCTION void kiln_aim_point(KILN_IN(KILN_STRUCT kiln_point_light) light, KILN_IN(KILN_STRUCT kiln_target) target,
                                  KILN_STRUCT kiln_aim_numbers n, KILN_INOUT(KILN_STRUCT kiln_aimed_ray) ray)
{
    const kiln_real3 place = KILN_TO_REAL3(KILN_AT(light).position);
    kiln_real3 axis, direction;
    KILN_STRUCT kiln_box_seen box;
    const kiln_real used = kiln_point_cone(light, target, KILN_TO(axis));
    const bool by_box = kiln_target_see_box(target, place, 2 * KILN_REAL_PI * used, KILN_TO(box));
    if (by_box)
        direction = kiln_box_direction(KILN_TO(box), n.side, n.u, n.v);
    else
        direction = kiln_cone_direction(axis, used, n.u, n.v);
    KILN_AT(ray).origin = KILN_TO_VECTOR(place);
    KILN_AT(ray).direction = KILN_TO_VECTOR(direction);
    KILN_AT(ray).place = place;
    KILN_AT(ray).range = KILN_AT(light).range;
    KILN_AT(ray).has_place = true;
    KILN_AT(ray).is_point = true;
    kiln_aimed_set_flux(ray, KILN_AT(light).intensity,
                        (by_box ? box.omega : 2 * KILN_REAL_PI * used) * kiln_punctual_profile(light, direction));
}

/* Picks an emitting triangle of a lamp by inverting the CDF `until`: the first triangle whose value is above `pick`,
 * else the last. */
KILN_FUNCTION KILN_U32 kiln_aim_area_of(KILN_CONTEXT(kiln_aims, aims) KILN_IN(KILN_STRUCT kiln_lamp) lamp,
                                        kiln_real pick)
{
    KILN_U32 low = KILN_AT(lamp).first, high = KILN_AT(lamp).first + KILN_AT(lamp).count - 1u;
    while (low < high) {
        const KILN_U32 middle = low + (high - low) / 2u;
        if (KILN_AT(KILN_LOAD(aims, until, middle)) > pick)
            high = middle;
        else
            low = middle + 1u;
    }
    return low;
}

/* Sets a ray that leaves an emitting triangle at the point `on`, relative to its corner 0. Its flux is `factor` times
 * the radiance there. */
KILN_FUNCTION bool kiln_aim_leave(KILN_CONTEXT(kiln_aims, aims) KILN_U32 index, kiln_real3 on, kiln_real side,
                                  kiln_real3 direction, kiln_real factor, KILN_INOUT(KILN_STRUCT kiln_aimed_ray) ray)
{
    KILN_CONTEXT_IS(kiln_lights, lights, aims->lights);
    const KILN_ITEM(kiln_area_light) light = KILN_LOAD(lights, areas, index);
    if (!(factor > 0))
        return false;
    const kiln_real3 normal = KILN_TO_REAL3(KILN_AT(light).normal);
    const KILN_VECTOR up = KILN_TO_VECTOR(real3_scale(normal, side));
    KILN_RGB(rgb);
    kiln_area_light_radiance_on(KILN_PASS(lights) light, on, rgb);
    KILN_AT(ray).place = real3_add(KILN_TO_REAL3(KILN_AT(light).p0), on);
    KILN_AT(ray).origin =
        vec3_madd(KILN_TO_VECTOR(KILN_AT(ray).place), up, KILN_AIM_OFFSET(aims, KILN_AT(light).triangle, up));
    KILN_AT(ray).direction = KILN_TO_VECTOR(direction);
    KILN_AT(ray).cosine = side * real3_dot(normal, direction);
    KILN_AT(ray).light = index;
    KILN_AT(ray).has_place = true;
    kiln_aimed_set_flux(ray, rgb, factor);
    return true;
}

KILN_FUNCTION bool kiln_aim_area(KILN_CONTEXT(kiln_aims, aims) KILN_IN(KILN_STRUCT kiln_lamp) lamp,
                                 KILN_IN(KILN_STRUCT kiln_target) target, KILN_STRUCT kiln_aim_numbers n,
                                 KILN_INOUT(KILN_STRUCT kiln_aimed_ray) ray)
{
    KILN_CONTEXT_IS(kiln_lights, lights, aims->lights);
    const KILN_U32 index = kiln_aim_area_of(KILN_PASS(aims) lamp, n.triangle);
    const KILN_ITEM(kiln_area_light) light = KILN_LOAD(lights, areas, index);
    const kiln_real3 on = kiln_triangle_place(KILN_AT(light).e1, KILN_AT(light).e2, n.s, n.t),
                     at = real3_add(KILN_TO_REAL3(KILN_AT(light).p0), on),
                     normal = KILN_TO_REAL3(KILN_AT(light).normal);
    const kiln_real height = kiln_cone_height(target, at);
    KILN_STRUCT kiln_box_seen box;
    const bool by_box = kiln_target_see_box(target, at, kiln_box_most(height), KILN_TO(box));
    /* factor: area / probability of the triangle, later also 1 / density of the direction */
    kiln_real factor = kiln_area_spread(light, KILN_AT(lamp).flux), side = 1;
    kiln_real3 direction;
    if (!by_box && kiln_cone_is_wide(height)) {
        side = KILN_AT(light).two_sided && n.side < KILN_RATIO(1, 2) ? kiln_real_of(-1) : kiln_real_of(1);
        direction = KILN_DEVICE_UNIT(kiln_cosine_about(real3_scale(normal, side), n.u, n.v));
        factor *= KILN_REAL_PI * kiln_area_sides(light);
    } else {
        if (by_box)
            direction = kiln_box_direction(KILN_TO(box), n.side, n.u, n.v);
        else
            direction = kiln_cone_direction(kiln_target_towards(target, at), height, n.u, n.v);
        const kiln_real cosine = real3_dot(normal, direction);
        side = KILN_AT(light).two_sided && cosine < 0 ? kiln_real_of(-1) : kiln_real_of(1);
        factor *= (by_box ? box.omega : 2 * KILN_REAL_PI * height) * side * cosine;
    }
    return kiln_aim_leave(KILN_PASS(aims) index, on, side, direction, factor, ray);
}

/* Samples the direction `back` towards a directional light or the environment, and its light `rgb`. Returns the density
 * of the direction. */
KILN_FUNCTION kiln_real kiln_aim_from_outside(KILN_CONTEXT(kiln_aims, aims) KILN_IN(KILN_STRUCT kiln_lamp) lamp,
                                              KILN_STRUCT kiln_aim_numbers n, KILN_OUT(kiln_real3) back,
                                              KILN_RGB_OUT(rgb), KILN_INOUT(KILN_STRUCT kiln_aimed_ray) ray)
{
    KILN_CONTEXT_IS(kiln_lights, lights, aims->lights);
    kiln_real density = 1;
    if (KILN_MAY_BE(KILN_GPU_KIND_SUN) && KILN_AT(lamp).kind == KILN_LAMP_DIRECTIONAL) {
        const KILN_ITEM(kiln_directional_light) sun = KILN_LOAD(lights, directionals, KILN_AT(lamp).first);
        KILN_AT(back) = KILN_AT(sun).towards;
        KILN_AT(ray).is_point = true;
        for (int c = 0; c < 3; c++)
            rgb[c] = KILN_AT(sun).irradiance[c];
        return density;
    }
    KILN_AT(back) = kiln_aim_sky_sample(KILN_PASS(aims) lamp, n.u, n.v, KILN_TO(density));
    kiln_environment_radiance(KILN_PASS(lights) KILN_AT(back), rgb);
    return density;
}

KILN_FUNCTION bool kiln_aim_by_outline(KILN_CONTEXT(kiln_aims, aims) KILN_IN(KILN_STRUCT kiln_lamp) lamp,
                                       KILN_IN(KILN_STRUCT kiln_target) target, KILN_STRUCT kiln_aim_numbers n,
                                       KILN_INOUT(KILN_STRUCT kiln_aimed_ray) ray)
{
    if (KILN_MAY_BE(KILN_GPU_KIND_AREA) && KILN_AT(lamp).kind == KILN_LAMP_AREA)
        return kiln_aim_area(KILN_PASS(aims) lamp, target, n, ray);
    if (KILN_MAY_BE(KILN_GPU_KIND_PUNCTUAL) && KILN_AT(lamp).kind == KILN_LAMP_POINT) {
        KILN_CONTEXT_IS(kiln_lights, lights, aims->lights);
        kiln_aim_point(KILN_LOAD(lights, points, KILN_AT(lamp).first), target, n, ray);
        return true;
    }
    kiln_real3 back;
    KILN_RGB(rgb);
    const kiln_real density = kiln_aim_from_outside(KILN_PASS(aims) lamp, n, KILN_TO(back), rgb, ray);
    kiln_aim_outside(KILN_PASS(aims) target, back, kiln_target_place(target, back, n.side, n.s, n.t), ray);
    kiln_aimed_set_flux(ray, rgb, kiln_target_outline(target, back) / density);
    return density > 0;
}

/* ---- rays uniform over the target's triangles ---- */

/* Density of uniform rays to a triangle: per m2 perpendicular to a fixed direction; or per steradian from a point. */
KILN_FUNCTION kiln_real kiln_even_across(KILN_CONTEXT(kiln_aims, aims) KILN_U32 triangle, kiln_real area,
                                         kiln_real3 direction)
{
    const kiln_real cosine = real_abs(real3_dot(KILN_OF_VECTOR(KILN_AIM_NORMAL(aims, triangle)), direction));
    return cosine > 0 ? 1 / (area * cosine) : kiln_real_of(0);
}
KILN_FUNCTION kiln_real kiln_even_from(KILN_CONTEXT(kiln_aims, aims) KILN_U32 triangle, kiln_real area,
                                       kiln_real3 place, kiln_real3 direction)
{
    const kiln_real3 normal = KILN_OF_VECTOR(KILN_AIM_NORMAL(aims, triangle));
    const kiln_real cosine = real3_dot(normal, direction),
                    height = real3_dot(real3_sub(kiln_aim_corner(KILN_PASS(aims) triangle), place), normal);
    if (!(cosine * height > 0))
        return kiln_real_of(0);
    const kiln_real far = height / cosine;
    return far * far / (area * real_abs(cosine));
}

/* Density of uniform rays to a triangle for any lamp, including the density of the point on an emitting triangle, or of
 * the direction of the sky. */
KILN_FUNCTION kiln_real kiln_even_density(KILN_CONTEXT(kiln_aims, aims) KILN_IN(KILN_STRUCT kiln_lamp) lamp,
                                          KILN_U32 light, KILN_U32 triangle, kiln_real3 place, kiln_real3 direction)
{
    KILN_CONTEXT_IS(kiln_lights, lights, aims->lights);
    const kiln_real target_area = KILN_AT(KILN_TARGET(aims, KILN_TARGET_OF(aims, triangle))).area;
    if (KILN_MAY_BE(KILN_GPU_KIND_AREA) && KILN_AT(lamp).kind == KILN_LAMP_AREA) {
        const KILN_ITEM(kiln_area_light) area = KILN_LOAD(lights, areas, light);
        if (!KILN_AT(area).two_sided && !(real3_dot(KILN_TO_REAL3(KILN_AT(area).normal), direction) > 0))
            return kiln_real_of(0);
        return kiln_area_chance(area, KILN_AT(lamp).flux) *
               kiln_even_from(KILN_PASS(aims) triangle, target_area, place, direction);
    }
    const kiln_real across = kiln_even_across(KILN_PASS(aims) triangle, target_area, direction);
    if (KILN_MAY_BE(KILN_GPU_KIND_SUN) && KILN_AT(lamp).kind == KILN_LAMP_DIRECTIONAL)
        return across;
    const kiln_real density = kiln_sky_direction_density(KILN_PASS(lights) real3_negate(direction));
    return KILN_AIM_PER_CELL(aims, lamp, density) * across;
}

/* Sets a ray from an emitting triangle of the lamp to `to`, a uniform point on the picked target triangle. The next
 * function does so for lamps outside the scene. */
KILN_FUNCTION bool kiln_aim_area_evenly(KILN_CONTEXT(kiln_aims, aims) KILN_IN(KILN_STRUCT kiln_lamp) lamp,
                                        KILN_STRUCT kiln_aim_numbers n, kiln_real3 to,
                                        KILN_INOUT(KILN_STRUCT kiln_aimed_ray) ray)
{
    KILN_CONTEXT_IS(kiln_lights, lights, aims->lights);
    const KILN_U32 index = kiln_aim_area_of(KILN_PASS(aims) lamp, n.triangle);
    const KILN_ITEM(kiln_area_light) light = KILN_LOAD(lights, areas, index);
    const kiln_real3 on = kiln_triangle_place(KILN_AT(light).e1, KILN_AT(light).e2, n.s, n.t),
                     at = real3_add(KILN_TO_REAL3(KILN_AT(light).p0), on),
                     direction = KILN_OF_VECTOR(KILN_TO_VECTOR(real3_normalize(real3_sub(to, at))));
    const kiln_real cosine = real3_dot(KILN_TO_REAL3(KILN_AT(light).normal), direction),
                    side = KILN_AT(light).two_sided && cosine < 0 ? kiln_real_of(-1) : kiln_real_of(1),
                    density = kiln_even_density(KILN_PASS(aims) lamp, index, KILN_AT(ray).triangle, at, direction);
    return density > 0 && kiln_aim_leave(KILN_PASS(aims) index, on, side, direction, side * cosine / density, ray);
}

KILN_FUNCTION bool kiln_aim_outside_evenly(KILN_CONTEXT(kiln_aims, aims) KILN_IN(KILN_STRUCT kiln_lamp) lamp,
                                           KILN_IN(KILN_STRUCT kiln_target) target, KILN_STRUCT kiln_aim_numbers n,
                                           kiln_real3 to, KILN_INOUT(KILN_STRUCT kiln_aimed_ray) ray)
{
    kiln_real3 back;
    KILN_RGB(rgb);
    kiln_real density = kiln_aim_from_outside(KILN_PASS(aims) lamp, n, KILN_TO(back), rgb, ray);
    kiln_aim_outside(KILN_PASS(aims) target, back, to, ray);
    density *= kiln_even_across(KILN_PASS(aims) KILN_AT(ray).triangle, KILN_AT(target).area,
                                KILN_OF_VECTOR(KILN_AT(ray).direction));
    if (density > 0)
        kiln_aimed_set_flux(ray, rgb, 1 / density);
    return density > 0;
}

KILN_FUNCTION bool kiln_aim_evenly(KILN_CONTEXT(kiln_aims, aims) KILN_IN(KILN_STRUCT kiln_lamp) lamp,
                                   KILN_IN(KILN_STRUCT kiln_target) target, KILN_STRUCT kiln_aim_numbers n,
                                   KILN_INOUT(KILN_STRUCT kiln_aimed_ray) ray)
{
    const bool outside = KILN_AT(lamp).kind != KILN_LAMP_AREA;
    KILN_AT(ray).triangle = KILN_TARGET_PICK(aims, target, n.side);
    const kiln_real3 to =
        kiln_aim_place(KILN_PASS(aims) KILN_AT(ray).triangle, outside ? n.s : n.u, outside ? n.t : n.v);
    if (KILN_MAY_BE(KILN_GPU_KIND_AREA) && !outside)
        return kiln_aim_area_evenly(KILN_PASS(aims) lamp, n, to, ray);
    return kiln_aim_outside_evenly(KILN_PASS(aims) lamp, target, n, to, ray);
}

/* ---- rays of both kinds ---- */

/* The number of the first light of a lamp. */
KILN_FUNCTION KILN_U32 kiln_aim_light_of(KILN_CONTEXT(kiln_aims, aims) KILN_IN(KILN_STRUCT kiln_lamp) lamp)
{
    KILN_CONTEXT_IS(kiln_lights, lights, aims->lights);
    const KILN_U32 kind = KILN_AT(lamp).kind, before = kind == KILN_LAMP_AREA ? 0u
                                                       : kind == KILN_LAMP_POINT
                                                           ? KILN_TO_U32(KILN_GET(lights, area_count))
                                                       : kind == KILN_LAMP_DIRECTIONAL ? KILN_AIM_SUNS(aims)
                                                                                       : KILN_AIM_SKY(aims);
    return before + KILN_AT(lamp).first;
}

/* Draws the first ray of path number k of an aim. False: the path carries no light. */
KILN_FUNCTION bool kiln_aim_draw(KILN_CONTEXT(kiln_aims, aims) KILN_U32 aim, KILN_U64 k, KILN_STRUCT kiln_aim_numbers n,
                                 KILN_INOUT(KILN_STRUCT kiln_aimed_ray) ray)
{
    const KILN_ITEM(kiln_lamp) lamp = KILN_LOAD(aims, lamps, KILN_AIM_LAMP(aims, aim));
    const KILN_ITEM(kiln_target) target = KILN_TARGET(aims, KILN_AIM_TARGET(aims, aim));
    KILN_AT(ray).range = 0;
    KILN_AT(ray).light = kiln_aim_light_of(KILN_PASS(aims) lamp);
    KILN_AT(ray).cosine = 1;
    KILN_AT(ray).has_place = false;
    KILN_AT(ray).is_point = false;
    KILN_AT(ray).triangle = KILN_NONE;
    return k < KILN_AIM_EVEN(aims, aim) ? kiln_aim_evenly(KILN_PASS(aims) lamp, target, n, ray)
                                        : kiln_aim_by_outline(KILN_PASS(aims) lamp, target, n, ray);
}

/* Finds the aim of a path, given its number in the iteration. */
KILN_FUNCTION KILN_U32 kiln_aim_find(KILN_CONTEXT(kiln_aims, aims) KILN_U64 path)
{
    KILN_U32 low = 0u, high = KILN_AIM_COUNT(aims); /* first[low] <= path < first[high] */
    while (high - low > 1u) {
        const KILN_U32 middle = low + (high - low) / 2u;
        if (KILN_AT(KILN_LOAD(aims, first, middle)) <= path)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Returns the number of an aim's paths in an iteration. */
KILN_FUNCTION kiln_real kiln_aim_paths(KILN_CONTEXT(kiln_aims, aims) KILN_U32 aim)
{
    return kiln_real_of(KILN_AT(KILN_LOAD(aims, first, aim + 1u)) - KILN_AT(KILN_LOAD(aims, first, aim)));
}

/* ---- densities ---- */

KILN_FUNCTION kiln_real kiln_aim_area_density(KILN_IN(KILN_STRUCT kiln_area_light) light, kiln_real lamp_flux,
                                              KILN_IN(KILN_STRUCT kiln_target) target, kiln_real3 place,
                                              kiln_real3 direction)
{
    const kiln_real height = kiln_cone_height(target, place),
                    cosine = real3_dot(KILN_TO_REAL3(KILN_AT(light).normal), direction),
                    chance = kiln_area_chance(light, lamp_flux);
    if (!KILN_AT(light).two_sided && !(cosine > 0))
        return kiln_real_of(0);
    KILN_STRUCT kiln_box_seen box;
    if (kiln_target_see_box(target, place, kiln_box_most(height), KILN_TO(box)))
        return chance / box.omega;
    return chance * (kiln_cone_is_wide(height)
                         ? real_abs(cosine) / (KILN_REAL_PI * kiln_area_sides(light))
                         : kiln_cone_density(kiln_target_towards(target, place), height, direction));
}

KILN_FUNCTION kiln_real kiln_aim_point_density(KILN_IN(KILN_STRUCT kiln_point_light) light,
                                               KILN_IN(KILN_STRUCT kiln_target) target, kiln_real3 direction)
{
    kiln_real3 axis;
    KILN_STRUCT kiln_box_seen box;
    const kiln_real height = kiln_point_cone(light, target, KILN_TO(axis));
    if (kiln_target_see_box(target, KILN_TO_REAL3(KILN_AT(light).position), 2 * KILN_REAL_PI * height, KILN_TO(box)))
        return 1 / box.omega;
    return kiln_cone_density(axis, height, direction);
}

/* Returns `paths` times the density of a ray aimed at the target's sphere or box. */
KILN_FUNCTION kiln_real kiln_outline_density(KILN_CONTEXT(kiln_aims, aims) KILN_IN(KILN_STRUCT kiln_lamp) lamp,
                                             KILN_U32 light, KILN_IN(KILN_STRUCT kiln_target) target, kiln_real paths,
                                             kiln_real3 place, kiln_real3 direction)
{
    KILN_CONTEXT_IS(kiln_lights, lights, aims->lights);
    if (KILN_MAY_BE(KILN_GPU_KIND_AREA) && KILN_AT(lamp).kind == KILN_LAMP_AREA)
        return paths *
               kiln_aim_area_density(KILN_LOAD(lights, areas, light), KILN_AT(lamp).flux, target, place, direction);
    if (KILN_MAY_BE(KILN_GPU_KIND_PUNCTUAL) && KILN_AT(lamp).kind == KILN_LAMP_POINT)
        return paths * kiln_aim_point_density(KILN_LOAD(lights, points, KILN_AT(lamp).first), target, direction);
    if (KILN_MAY_BE(KILN_GPU_KIND_SUN) && KILN_AT(lamp).kind == KILN_LAMP_DIRECTIONAL)
        return paths /
               kiln_target_outline(target, KILN_AT(KILN_LOAD(lights, directionals, KILN_AT(lamp).first)).towards);
    const kiln_real3 back = real3_negate(direction);
    const kiln_real density = paths * kiln_sky_direction_density(KILN_PASS(lights) back);
    return KILN_AIM_PER_CELL(aims, lamp, density) / kiln_target_outline(target, back);
}

/* Returns the balance-heuristic weight for the flux of an aim's ray that has first hit this world triangle. 0: the path
 * is dropped, since it has missed its target or its picked triangle. */
KILN_FUNCTION kiln_real kiln_aim_met(KILN_CONTEXT(kiln_aims, aims) KILN_U32 aim,
                                     KILN_IN(KILN_STRUCT kiln_aimed_ray) ray, KILN_U32 triangle)
{
    const kiln_real all = kiln_aim_paths(KILN_PASS(aims) aim), even = kiln_real_of(KILN_AIM_EVEN(aims, aim));
    const KILN_U32 index = KILN_AIM_TARGET(aims, aim), picked = KILN_AT(ray).triangle, light = KILN_AT(ray).light;
    if (KILN_TARGET_OF(aims, triangle) != index || (picked != KILN_NONE && picked != triangle))
        return kiln_real_of(0);
    if (!(even > 0))
        return kiln_real_of(1);
    const KILN_ITEM(kiln_lamp) lamp = KILN_LOAD(aims, lamps, KILN_AIM_LAMP(aims, aim));
    const kiln_real3 place = KILN_AT(ray).place, direction = KILN_OF_VECTOR(KILN_AT(ray).direction);
    const kiln_real by_outline = kiln_outline_density(KILN_PASS(aims) lamp, light, KILN_TARGET(aims, index), all - even,
                                                      place, direction),
                    by_triangle = even * kiln_even_density(KILN_PASS(aims) lamp, light, triangle, place, direction),
                    own = picked != KILN_NONE ? by_triangle / even : by_outline / (all - even);
    return own > 0 ? all * own / (by_outline + by_triangle) : kiln_real_of(0);
}

/* Density of an iteration's accepted paths at this ray, from the lamp of `light` to the target of a world triangle
 * (kiln_aims_density). */
KILN_FUNCTION kiln_real kiln_aim_density(KILN_CONTEXT(kiln_aims, aims) KILN_U32 light, KILN_U32 triangle,
                                         kiln_real3 place, kiln_real3 direction)
{
    const KILN_U32 target = KILN_TARGET_OF(aims, triangle);
    if (target == KILN_NONE)
        return kiln_real_of(0);
    const KILN_U32 number = KILN_AIM_LAMP_NUMBER(aims, light, direction), aim = KILN_AIM_AT(aims, number, target);
    const KILN_ITEM(kiln_lamp) lamp = KILN_LOAD(aims, lamps, number);
    const kiln_real all = kiln_aim_paths(KILN_PASS(aims) aim), even = kiln_real_of(KILN_AIM_EVEN(aims, aim)),
                    by_outline = kiln_outline_density(KILN_PASS(aims) lamp, light, KILN_TARGET(aims, target),
                                                      all - even, place, direction);
    return even > 0 ? by_outline + even * kiln_even_density(KILN_PASS(aims) lamp, light, triangle, place, direction)
                    : by_outline;
}

#endif
