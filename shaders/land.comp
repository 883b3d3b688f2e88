/* Light paths that land (shaders/land.glsl), the steps without gloss: paths begin in the slots of threads, or end where
 * their rays have hit a diffuse surface, or nothing. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"

#include "shaders/land.glsl"

void init_from_light()
{
    const uint64_t number = push.pixel + slot, iteration = number / LAND.paths, path = number % LAND.paths;
    const uint aim = kiln_aim_find(path);
    const uint64_t k = path - AimNumbers(LAND.first).at[aim];
    walk_key = kiln_land_key(push.seed, aim, uint(iteration), uint(iteration >> 32), uint(k >> 32));
    walk_sample = uint(k);
    const uvec2 pick = walk_draw(kiln_path_use(0u, KILN_PATH_PICK)),
                place = walk_draw(kiln_path_use(0u, KILN_PATH_LIGHT)),
                turn = walk_draw(kiln_path_use(0u, KILN_PATH_BOUNCE));
    const kiln_aim_numbers n = kiln_aim_numbers(real_unit(pick.x), real_unit(pick.y), real_unit(place.x),
                                                real_unit(place.y), real_unit(turn.x), real_unit(turn.y));
    kiln_aimed_ray ray;
    ray.flux = real3(0);
    const bool drawn = kiln_aim_draw(aim, k, n, ray) && (!CROSSES || AimFloats(SPHERES.paths).at[aim] > 0.0);
    const real3 flux = ray.flux / kiln_aim_paths(aim);
    if (!drawn || !(max(flux.x, max(flux.y, flux.z)) > 0)) { /* the lamp sends nothing along it */
        finish(landing_of(ASTRAY, 0u), flux);
        return;
    }
    SUBPATH(slot).origin = ray.origin;
    SUBPATH(slot).direction = ray.direction;
    SUBPATH(slot).weight = float[3](1.0, 1.0, 1.0);
    SUBPATH(slot).surface = 1u;
    SUBPATH(slot).body = KILN_GPU_NONE;
    LAND_PATH(slot) = kiln_gpu_land_path(
        real[3](flux.x, flux.y, flux.z), real[3](ray.place.x, ray.place.y, ray.place.z), ray.cosine, ray.range,
        ray.light, ray.triangle, aim, walk_key, walk_sample,
        (ray.is_point ? KILN_GPU_LAND_IS_POINT : 0u) | (ray.has_place ? KILN_GPU_LAND_HAS_PLACE : 0u));
    go_onward(slot);
}

void end()
{
    const bool first = path.surface == 1u, met = hit.triangle != KILN_GPU_NONE;
    kiln_gpu_landing landing;
    if (!met)
        landing = landing_of((first ? ASTRAY : ESCAPED) | KILN_GPU_LAND_MISSED, path.surface - 1u);
    else if (first || !has_side(hit))
        landing = landing_of(first ? ASTRAY : BLOCKED, path.surface);
    else
        landing = land(vertex_make(hit, path.direction, true), 1.0);
    if (!met) /* nothing was met that would tint it */
        weight = vec3_in(path.weight);
    finish(landing, flux_then());
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    slot = slot_of(x);
    if (BEGINS) {
        init_from_light();
    } else {
        load();
        end();
    }
}

#include "shaders/main.glsl"
