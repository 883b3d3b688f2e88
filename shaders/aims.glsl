/* Targets of light paths that land: declarations that shaders/shared/aims.h needs. Include shaders/lights.glsl and
 * shaders/emission.glsl first, and define LAND (struct kiln_gpu_land). */
#include "shaders/shared/aimed_ray.h"
#include "shaders/shared/targets.h"

#include "shaders/box_seen.glsl"

KILN_ARRAY(AimLamps, kiln_gpu_lamp, 4);
KILN_ARRAY(AimTargets, kiln_gpu_target, 4);
KILN_ARRAY(AimNumbers, uint64_t, 8);
KILN_ARRAY(AimWords, uint, 4);
KILN_ARRAY(AimFloats, float, 4);

#define kiln_aims_until(index) real(AimFloats(LAND.until).at[index])
#define kiln_aims_first(aim) AimNumbers(LAND.first).at[aim]

kiln_lamp kiln_aims_lamps(uint index)
{
    const kiln_gpu_lamp lamp = AimLamps(LAND.lamps).at[index];
    return kiln_lamp(lamp.kind, lamp.first, lamp.count, real(lamp.flux));
}

kiln_target target_at(uint index)
{
    const kiln_gpu_target t = AimTargets(LAND.targets).at[index];
    return kiln_target(real3(t.centre), real3(t.low), real3(t.high), real(t.radius), real(t.area), t.listed, t.count);
}

/* Chooses a triangle of the target by `pick`: the first whose cumulative share of area exceeds it, else the last. */
uint target_pick(kiln_target target, real pick)
{
    uint low = target.first, high = target.first + target.count - 1u;
    while (low < high) {
        const uint middle = low + (high - low) / 2u;
        if (real(AimFloats(LAND.shares).at[middle]) > pick)
            high = middle;
        else
            low = middle + 1u;
    }
    return AimWords(LAND.triangles).at[low];
}

/* The lamp that a light is a part of. */
uint lamp_of_light(uint light)
{
    const uint areas = SCENE.lights.area_count;
    AimWords lamps = AimWords(LAND.lamp_of);
    if (light < areas)
        return lamps.at[light];
    return (areas > 0u ? lamps.at[areas - 1u] + 1u : 0u) + (light - areas);
}

real3 kiln_aim_corner(uint triangle) { return real3(triangle_at(triangle).p); }
real3 kiln_aim_place(uint triangle, real u, real v)
{
    const kiln_gpu_path_triangle t = triangle_at(triangle);
    return real3(t.p) + kiln_triangle_place(real3(t.e1), real3(t.e2), u, v);
}

#define KILN_AIM_COUNT(aims) LAND.aim_count
#define KILN_AIM_LAMP(aims, aim) ((aim) / LAND.target_count)
#define KILN_AIM_TARGET(aims, aim) ((aim) % LAND.target_count)
#define KILN_AIM_AT(aims, lamp, target) ((lamp)*LAND.target_count + (target))
#define KILN_AIM_EVEN(aims, aim) AimNumbers(LAND.even).at[aim]
#define KILN_TARGET(aims, index) target_at(index)
#define KILN_TARGET_OF(aims, triangle) AimWords(LAND.of_triangle).at[triangle]
#define KILN_TARGET_PICK(aims, target, pick) target_pick(target, pick)
#define KILN_AIM_CENTRE(aims) real3(LAND.centre)
#define KILN_AIM_RADIUS(aims) real(LAND.radius)
#define KILN_AIM_LAMP_NUMBER(aims, light, direction) lamp_of_light(light)
#define KILN_AIM_SUNS(aims) emission_directional(0u)
#define KILN_AIM_SKY(aims) emission_environment()
#define KILN_AIM_PER_CELL(aims, lamp, density) (density)
#define kiln_aim_sky_sample(lamp, u, v, density) kiln_sky_sample(u, v, density)
#define KILN_AIM_NORMAL(aims, triangle) triangle_at(triangle).normal
#define KILN_AIM_OFFSET(aims, triangle, normal) triangle_at(triangle).offset
#define KILN_AREA_LUMINANCE(light) real_luminance(real3(light.radiance))

#include "shaders/shared/aims.h"
