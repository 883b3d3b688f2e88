/* Choosing and sampling the lights of a scene (worker/light/lights.h explains the method).
 *
 * KILN_CONTEXT(kiln_lights, lights) has the arrays `nodes`, `areas`, `points` and `directionals`, and the numbers
 * area_count, point_count and directional_count. Each language defines before this header (worker/light/lights.c,
 * shaders/lights.glsl):
 *
 *   KILN_MAY_BE(kinds)               whether the scene has lights of these kinds, KILN_GPU_KIND_...; C does not ask
 *   KILN_SKY_IS_IMAGE(lights)        whether the environment is an image, and of that image
 *   KILN_SKY_WIDTH, _HEIGHT, _ROTATION, _MARGINAL, _CONDITIONAL(lights)
 *   KILN_SKY_COSINE(lights, y)       the cosine from +y at the upper edge of row y
 *   KILN_SKY_BAND(lights, y)         what that is above the next row's
 *   KILN_SUN_LUMINANCE(light), KILN_SKY_LUMINANCE(lights)
 *   KILN_LIGHT_NODE_IMPORTANCE(lights, index, p, spread, n)   kiln_light_importance of a cluster
 *   kiln_environment_radiance, kiln_area_light_radiance_on: what the environment sends, and what an area light sends at
 *                                    the place `on` from its corner 0 (textures are apart)
 *   KILN_CUT, a cut through the tree; KILN_CUT_LIGHT_NODE(cut, i), KILN_CUT_IMPORTANCE(cut, i),
 * KILN_CUT_IS_LEAF(lights, cut, i) of its cluster i, and kiln_cut_set, which sets it */
#ifndef KILN_SHADERS_SHARED_LIGHTS_H
#define KILN_SHADERS_SHARED_LIGHTS_H

#include "shaders/shared/area_light.h"
#include "shaders/shared/environment.h"
#include "shaders/shared/light_importance.h"
#include "shaders/shared/light_structs.h"
#include "shaders/shared/punctual_light.h"

/* ---- candidates ---- */

/* Returns the most important cluster of a cut that can be split and is worth it (KILN_CUT_SHARE), or `count` if there
 * is none. */
KILN_FUNCTION KILN_U32 kiln_cut_best(KILN_CONTEXT(kiln_lights, lights) KILN_CUT cut, KILN_U32 count)
{
    KILN_U32 best = count;
    kiln_real most = 0, total = 0;
    for (KILN_U32 i = 0u; i < count; i++) {
        total += KILN_CUT_IMPORTANCE(cut, i);
        if (!KILN_CUT_IS_LEAF(lights, cut, i) && (best == count || KILN_CUT_IMPORTANCE(cut, i) > most)) {
            best = i;
            most = KILN_CUT_IMPORTANCE(cut, i);
        }
    }
    return most > KILN_CUT_SHARE * total ? best : count;
}

/* Replaces a cluster by those of its children that may bring light. Returns the number of clusters in the cut. */
KILN_FUNCTION KILN_U32 kiln_cut_split(KILN_CONTEXT(kiln_lights, lights) KILN_CUT cut, KILN_U32 count, KILN_U32 best,
                                      kiln_real3 p, kiln_real spread, kiln_real3 n)
{
    const KILN_U32 parent = KILN_CUT_LIGHT_NODE(cut, best);
    bool kept = false;
    for (KILN_U32 c = 0u; c < 2u; c++) {
        const KILN_U32 child =
            c == 0u ? KILN_AT(KILN_LOAD(lights, nodes, parent)).left : KILN_AT(KILN_LOAD(lights, nodes, parent)).right;
        const kiln_real importance = KILN_LIGHT_NODE_IMPORTANCE(lights, child, p, spread, n);
        if (importance <= 0)
            continue;
        kiln_cut_set(KILN_PASS(lights) cut, kept ? count++ : best, child, importance);
        kept = true;
    }
    if (!kept) { /* the parent's bound was loose: the cluster is behind the point's horizon after all */
        count--;
        kiln_cut_set(KILN_PASS(lights) cut, best, KILN_CUT_LIGHT_NODE(cut, count), KILN_CUT_IMPORTANCE(cut, count));
    }
    return count;
}

/* Builds a cut: splits the most important inner cluster until `limit` (<= KILN_CUT_MAX) is reached or no split is worth
 * it. Returns the number of clusters. Needs a tree. */
KILN_FUNCTION KILN_U32 kiln_cut_tree(KILN_CONTEXT(kiln_lights, lights) KILN_CUT cut, kiln_real3 p, kiln_real spread,
                                     kiln_real3 n, KILN_U32 limit)
{
    const kiln_real importance = KILN_LIGHT_NODE_IMPORTANCE(lights, 0u, p, spread, n);
    if (importance <= 0)
        return 0u;
    kiln_cut_set(KILN_PASS(lights) cut, 0u, 0u, importance);
    KILN_U32 count = 1u;
    while (count != 0u && count < limit) {
        const KILN_U32 best = kiln_cut_best(KILN_PASS(lights) cut, count);
        if (best == count)
            break;
        count = kiln_cut_split(KILN_PASS(lights) cut, count, best, p, spread, n);
    }
    return count;
}

/* Importance of a directional light; 0 if it is behind the point. */
KILN_FUNCTION kiln_real kiln_sun_importance_at(KILN_CONTEXT(kiln_lights, lights) KILN_U32 index, kiln_real3 n)
{
    const KILN_ITEM(kiln_directional_light) light = KILN_LOAD(lights, directionals, index);
    const kiln_real cosine = kiln_any_direction(n) ? kiln_real_of(1) : real3_dot(n, KILN_AT(light).towards);
    return kiln_sun_importance(KILN_SUN_LUMINANCE(light), cosine);
}

/* ---- environment ---- */

KILN_FUNCTION kiln_real kiln_sky_texel_density(KILN_CONTEXT(kiln_lights, lights) KILN_U32 x, KILN_U32 y)
{
    const KILN_U32 width = KILN_SKY_WIDTH(lights);
    const kiln_real chance = kiln_step_chance(KILN_SKY_MARGINAL(lights), 0u, y) *
                             kiln_step_chance(KILN_SKY_CONDITIONAL(lights), KILN_TO_INDEX(y) * width, x);
    return kiln_sky_density(chance, KILN_SKY_BAND(lights, y), width);
}

/* Direction at the place (fx, fy) within the texel (x, y). */
KILN_FUNCTION kiln_real3 kiln_sky_in_texel(KILN_CONTEXT(kiln_lights, lights) KILN_U32 x, KILN_U32 y, kiln_real fx,
                                           kiln_real fy)
{
    return kiln_sky_direction(x, fx, fy, KILN_SKY_COSINE(lights, y), KILN_SKY_COSINE(lights, y + 1u),
                              KILN_SKY_WIDTH(lights), KILN_SKY_ROTATION(lights));
}

/* Probability density per steradian with which kiln_sky_sample draws a direction. */
KILN_FUNCTION kiln_real kiln_sky_direction_density(KILN_CONTEXT(kiln_lights, lights) kiln_real3 direction)
{
    if (!KILN_SKY_IS_IMAGE(lights))
        return KILN_SPHERE_DENSITY;
    return kiln_sky_texel_density(KILN_PASS(lights)
                                      kiln_sky_column(direction, KILN_SKY_ROTATION(lights), KILN_SKY_WIDTH(lights)),
                                  kiln_sky_row(direction, KILN_SKY_HEIGHT(lights)));
}

/* Samples a direction of the environment in proportion to luminance; u and v are in (0, 1). */
KILN_FUNCTION kiln_real3 kiln_sky_sample(KILN_CONTEXT(kiln_lights, lights) kiln_real u, kiln_real v,
                                         KILN_OUT(kiln_real) density)
{
    if (!KILN_SKY_IS_IMAGE(lights)) {
        KILN_AT(density) = KILN_SPHERE_DENSITY;
        return kiln_sphere_direction(u, v);
    }
    const KILN_U32 width = KILN_SKY_WIDTH(lights);
    kiln_real fx, fy;
    const KILN_U32 y = kiln_step_find(KILN_SKY_MARGINAL(lights), 0u, KILN_SKY_HEIGHT(lights), v, KILN_TO(fy));
    const KILN_U32 x = kiln_step_find(KILN_SKY_CONDITIONAL(lights), KILN_TO_INDEX(y) * width, width, u, KILN_TO(fx));
    KILN_AT(density) = kiln_sky_texel_density(KILN_PASS(lights) x, y);
    return kiln_sky_in_texel(KILN_PASS(lights) x, y, fx, fy);
}

/* Number of strategies that sample a choice. Samples of an environment image are drawn alternately by its luminance and
 * by the cosine, weighted by the balance heuristic. A constant sky, or a single sample, is drawn by the cosine only (a
 * probe: by the sky only). If the shading normal differs from the geometric one, half of the cosine-distributed
 * directions are about it (kiln_sky_two_cosines). */
KILN_FUNCTION KILN_U32 kiln_choice_strategies(KILN_CONTEXT(kiln_lights, lights) KILN_IN(KILN_STRUCT kiln_light_choice)
                                                  choice,
                                              kiln_real3 n)
{
    return KILN_SKY_IS_IMAGE(lights) && KILN_AT(choice).kind == KILN_CHOICE_ENVIRONMENT &&
                   KILN_AT(choice).samples >= 2u && !kiln_any_direction(n)
               ? 2u
               : 1u;
}

KILN_FUNCTION bool kiln_sample_environment(KILN_CONTEXT(kiln_lights, lights) KILN_IN(KILN_STRUCT kiln_light_choice)
                                               choice,
                                           KILN_U32 index, kiln_real3 n, kiln_real3 shading, kiln_real pick,
                                           kiln_real u, kiln_real v, KILN_INOUT(KILN_STRUCT kiln_light_sample) s)
{
    const bool two = real3_differ(shading, n);
    const bool probe = kiln_any_direction(n), both = kiln_choice_strategies(KILN_PASS(lights) choice, n) == 2u;
    kiln_real density = 1;
    kiln_real3 direction;
    if (probe || (both && (index & 1u) == 1u))
        direction = kiln_sky_sample(KILN_PASS(lights) u, v, KILN_TO(density));
    else
        direction = real_unit_vector(kiln_cosine_about(two && pick < KILN_RATIO(1, 2) ? shading : n, u, v));
    KILN_AT(s).direction = direction;
    const kiln_real cosine = probe ? kiln_real_of(1) : real3_dot(n, direction);
    if (!((two ? real_max(cosine, real3_dot(shading, direction)) : cosine) > 0))
        return false;
    if (!probe) {
        density = (two ? kiln_sky_two_cosines(cosine, real3_dot(shading, direction)) : cosine) / KILN_REAL_PI;
        if (both)
            density = kiln_sky_cosine_density(KILN_AT(choice).samples,
                                              kiln_sky_direction_density(KILN_PASS(lights) direction), density);
    }
    KILN_RGB(rgb);
    kiln_environment_radiance(KILN_PASS(lights) direction, rgb);
    for (int c = 0; c < 3; c++)
        KILN_AT(s).value[c] = kiln_real_of(rgb[c]) / density;
    KILN_AT(s).has_extent = true;
    return true;
}

/* ---- point, spot and area lights ---- */

KILN_FUNCTION bool kiln_sample_point_light(KILN_IN(KILN_STRUCT kiln_point_light) light, kiln_real3 p, kiln_real weight,
                                           KILN_INOUT(KILN_STRUCT kiln_light_sample) s)
{
    const kiln_real3 to = KILN_TO_REAL3(stored3_sub(KILN_AT(light).position, KILN_TO_STORED3(p)));
    const kiln_real distance = real3_length(to);
    KILN_AT(s).distance = distance;
    if (!(distance > 0))
        return false;
    const kiln_real3 direction = real3_scale(to, 1 / distance);
    KILN_AT(s).direction = direction;
    const kiln_real factor =
        kiln_punctual_share(light, real3_negate(direction), distance, weight) / (distance * distance);
    for (int c = 0; c < 3; c++)
        KILN_AT(s).value[c] = kiln_real_of(KILN_AT(light).intensity[c]) * factor;
    return factor > 0 && !real_is_infinite(factor); /* the square of a float's smallest distances is 0 */
}

/* Distance before the light at which a shadow ray ends, m. Samples in float add as large an error again. */
KILN_FUNCTION kiln_real kiln_area_light_backoff(KILN_IN(KILN_STRUCT kiln_area_light) light, kiln_real distance,
                                                kiln_real cosine)
{
#if defined(KILN_GLSL) && !defined(KILN_DOUBLES)
    return kiln_light_backoff(light.rounding + 2.4e-7 * distance, distance, cosine);
#else
    return kiln_light_backoff(KILN_AT(light).rounding, distance, cosine);
#endif
}

KILN_FUNCTION bool kiln_sample_area_light(KILN_CONTEXT(kiln_lights, lights) KILN_IN(KILN_STRUCT kiln_area_light) light,
                                          kiln_real3 p, kiln_real weight, kiln_real u, kiln_real v,
                                          KILN_INOUT(KILN_STRUCT kiln_light_sample) s)
{
    const kiln_stored3 stored0 = stored3_sub(KILN_AT(light).p0, KILN_TO_STORED3(p));
    /* height of p above the front face */
    const kiln_real side = kiln_real_of(-stored3_dot(stored0, KILN_AT(light).normal)), height = real_abs(side);
    /* A point in the light's own plane, within the precision of floats, sees nothing of the light. */
    if ((KILN_AT(light).two_sided ? height : side) <= KILN_AREA_LIGHT_HEIGHT * KILN_AT(light).rounding)
        return false;
    const kiln_real3 to0 = KILN_TO_REAL3(stored0), e1 = KILN_AT(light).e1, e2 = KILN_AT(light).e2;
    const KILN_STRUCT kiln_spherical_triangle t = kiln_spherical_triangle_of(to0, e1, e2, KILN_AT(light).area, height);
    const bool spherical = kiln_spherical_triangle_wanted(t);
    kiln_real3 to;
    if (spherical) {
        const kiln_real3 direction = kiln_spherical_triangle_direction(t, u, v);
        to = real3_scale(direction, height / real_abs(real3_dot(direction, KILN_TO_REAL3(KILN_AT(light).normal))));
    } else {
        to = real3_add(to0, kiln_triangle_place(e1, e2, u, v));
    }
    const kiln_real distance = real3_length(to);
    KILN_AT(s).distance = distance;
    if (!(distance > 0) || real_is_infinite(distance))
        return false;
    KILN_AT(s).direction = real3_scale(to, 1 / distance);
    const kiln_real seen = height / distance; /* cosine at the light */
    KILN_AT(s).backoff = kiln_area_light_backoff(light, distance, seen);
    KILN_AT(s).has_extent = true;
    const kiln_real inverse_density = spherical ? t.omega : seen * KILN_AT(light).area / (distance * distance);
    KILN_RGB(rgb);
    kiln_area_light_radiance_on(KILN_PASS(lights) light, real3_sub(to, to0), rgb);
    for (int c = 0; c < 3; c++)
        KILN_AT(s).value[c] = kiln_real_of(rgb[c]) * weight * inverse_density;
    return true;
}

/* Walks from a cluster down to one light, choosing children in proportion to their importance at p; `weight` gets 1 /
 * probability. */
KILN_FUNCTION bool kiln_pick_light(KILN_CONTEXT(kiln_lights, lights) KILN_U32 node, kiln_real3 p, kiln_real3 n,
                                   kiln_real pick, KILN_OUT(KILN_U32) light, KILN_OUT(kiln_real) weight)
{
    KILN_AT(weight) = 1;
    KILN_AT(light) = 0u;
    for (KILN_U32 left = KILN_AT(KILN_LOAD(lights, nodes, node)).left; left != KILN_NONE;
         left = KILN_AT(KILN_LOAD(lights, nodes, node)).left) {
        const KILN_U32 right = KILN_AT(KILN_LOAD(lights, nodes, node)).right;
        const kiln_real a = KILN_LIGHT_NODE_IMPORTANCE(lights, left, p, kiln_real_of(0), n),
                        b = KILN_LIGHT_NODE_IMPORTANCE(lights, right, p, kiln_real_of(0), n);
        if (a + b <= 0)
            return false;
        node = kiln_light_tree_step(a / (a + b), KILN_TO(pick), KILN_TO(KILN_AT(weight))) ? left : right;
    }
    KILN_AT(light) = KILN_AT(KILN_LOAD(lights, nodes, node)).right;
    return true;
}

/* Draws sample number `index` of a choice with random numbers in (0, 1): `pick` selects a light in the tree, u and v a
 * place on it. Returns false if the sample brings no light. */
KILN_FUNCTION bool kiln_sample_choice(KILN_CONTEXT(kiln_lights, lights) KILN_IN(KILN_STRUCT kiln_light_choice) choice,
                                      KILN_U32 index, kiln_real3 p, kiln_real3 n, kiln_real3 shading, kiln_real pick,
                                      kiln_real u, kiln_real v, KILN_OUT(KILN_STRUCT kiln_light_sample) s)
{
    KILN_AT(s).distance = KILN_REAL_INFINITE;
    KILN_AT(s).backoff = 0;
    KILN_AT(s).has_extent = false;
    KILN_AT(s).light = KILN_NONE;
    if (KILN_MAY_BE(KILN_GPU_KIND_SKY | KILN_GPU_KIND_IMAGE) && KILN_AT(choice).kind == KILN_CHOICE_ENVIRONMENT)
        return kiln_sample_environment(KILN_PASS(lights) choice, index, n, shading, pick, u, v, s);
    if (KILN_MAY_BE(KILN_GPU_KIND_SUN) && KILN_AT(choice).kind == KILN_CHOICE_DIRECTIONAL) {
        const KILN_ITEM(kiln_directional_light) sun = KILN_LOAD(lights, directionals, KILN_AT(choice).index);
        KILN_AT(s).direction = KILN_AT(sun).towards;
        for (int c = 0; c < 3; c++)
            KILN_AT(s).value[c] = kiln_real_of(KILN_AT(sun).irradiance[c]);
        return true;
    }
    if (!KILN_MAY_BE(KILN_GPU_KIND_AREA | KILN_GPU_KIND_PUNCTUAL))
        return false;
    KILN_U32 light;
    kiln_real weight;
    /* light below the horizon of one normal may count for the other */
    const kiln_real3 any = real3_make(kiln_real_of(0), kiln_real_of(0), kiln_real_of(0));
    if (!kiln_pick_light(KILN_PASS(lights) KILN_AT(choice).index, p, real3_differ(shading, n) ? any : n, pick,
                         KILN_TO(light), KILN_TO(weight)))
        return false;
    KILN_AT(s).light = light;
    const KILN_U32 areas = KILN_TO_U32(KILN_GET(lights, area_count));
    if (KILN_MAY_BE(KILN_GPU_KIND_AREA) && (!KILN_MAY_BE(KILN_GPU_KIND_PUNCTUAL) || light < areas))
        return kiln_sample_area_light(KILN_PASS(lights) KILN_LOAD(lights, areas, light), p, weight, u, v, s);
    return kiln_sample_point_light(KILN_LOAD(lights, points, light - areas), p, weight, s);
}

#endif
