/* The gather pass from rows (kept_rows.glsl): what rays have met is read in the place of traced, under up to
 * KILN_ROW_LIGHTS lights at once, which share one read of the rows. Of each light the sums are those of gather.glsl,
 * in the same order. Directions are made for points with smooth normals alone, whose rays weigh by them. Lights lie
 * side by side: the radiosity of point i under light l is pair i * LIGHTS + l of words. The slices of a light follow
 * those of the one before; replay_reduce.comp adds them up, or replay_take.comp. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/shared/streams.h"

KILN_PUSH(kiln_gpu_rows_push);
layout(constant_id = 6) const uint LIGHTS = 1u;

#include "shaders/kept_rows.glsl"
#define HEMISPHERE_BEGIN(index) row_begin((index)-push.chunk.origin)
#define HEMISPHERE_RAY(k) row_recall(k)
#define HEMISPHERE_PLACES(p) is_smooth(p)

struct Sums {
    vec3 incident[KILN_ROW_LIGHTS], irradiance[KILN_ROW_LIGHTS];
    float luminance[KILN_ROW_LIGHTS], escaped, blocked;
};
#define FOUR(x) x, x, x, x
#define SIXTEEN(x) FOUR(x), FOUR(x), FOUR(x), FOUR(x)
const vec3 NOTHING[KILN_ROW_LIGHTS] = vec3[](SIXTEEN(vec3(0.0)));
#define NO_SUMS Sums(NOTHING, NOTHING, float[](SIXTEEN(0.0)), 0.0, 0.0)

bool is_smooth(kiln_gpu_point p) { return HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u; }

#include "shaders/hemisphere.glsl"

/* What the ray finds under each light. */
void add_lights(inout Sums sums, bool sends, float facet, float weight)
{
    RadiosityWords lights = RadiosityWords(push.lights + uint64_t(sends ? row_word : 0u) * uint64_t(8u * LIGHTS));
    for (uint l = 0u; l < KILN_ROW_LIGHTS; l++) {
        if (l >= LIGHTS)
            break;
        const vec3 rgb = sends ? kiln_radiosity_unpack(lights.at[l]) : vec3(0.0);
        sums.incident[l] += facet * rgb;
        if (HAS_SMOOTH != 0u)
            sums.irradiance[l] += weight * rgb;
        sums.luminance[l] += weight * float_luminance(rgb);
    }
}

void add_ray(inout Sums sums, kiln_gpu_point p, vec3 position, vec3 normal, float u, float v, uint seed)
{
    float facet = 1.0, weight = 1.0;
    if (is_smooth(p)) {
        const vec3 soft = kiln_shading(p, normal), both = normal + soft;
        const vec3 axis = both == vec3(0.0) ? both : normalize(both);
        float cosine;
        const vec3 direction = hemisphere_cosine(axis, u, v, cosine);
        facet = kiln_facet_weight(dot(normal, direction), dot(normal, axis), cosine);
        weight = kiln_shading_weight(dot(soft, direction), cosine);
    }
    if (row_word == KILN_ROW_ESCAPED)
        sums.escaped += facet;
    else if (row_word == KILN_ROW_BLOCKED)
        sums.blocked += facet;
    else
        add_lights(sums, facet > 0.0 && row_word < KILN_ROW_POINTS, facet, weight);
}

void after_rays(inout Sums sums, kiln_gpu_point p, uint row, bool good)
{
    if (!good)
        sums.escaped = -1.0e9;
}

void store(Sums sums, uint x, uint row)
{
    const uint step = push.chunk.total, rows = 4u * push.hemisphere.per_quarter * push.hemisphere.row_step;
    for (uint l = 0u; l < KILN_ROW_LIGHTS; l++) {
        if (l >= LIGHTS)
            break;
        FloatArray floats = FloatArray(push.hemisphere.slices +
                                       uint64_t((l * rows + row * push.hemisphere.row_step) * KILN_GPU_SLICE_FLOATS) *
                                           push.chunk.total * 4ul);
        for (uint c = 0u; c < 3u; c++) {
            floats.at[c * step + x] = sums.incident[l][c];
            floats.at[(3u + c) * step + x] = HAS_SMOOTH != 0u ? sums.irradiance[l][c] : sums.incident[l][c];
        }
        floats.at[6u * step + x] = sums.escaped;
        floats.at[7u * step + x] = sums.blocked;
        floats.at[8u * step + x] = sums.luminance[l];
    }
}

#include "shaders/main.glsl"
