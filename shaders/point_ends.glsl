/* Surface points as ends of paths (worker/pass/reference.h), for connections and merging. Directions and estimators
 * equal those of worker/backend/embree/reference.c. Needs shaders/subpaths.glsl before it. */
#ifndef KILN_SHADERS_POINT_ENDS_GLSL
#define KILN_SHADERS_POINT_ENDS_GLSL

#ifdef KILN_GLOSS
#    include "shaders/taken_up.glsl"
#endif

/* Whether other paths can find this path's end by merging. Not if it is a surface point at which no light paths land.
 */
bool point_lands(kiln_gpu_eye_vertex eye) { return !POINTS || eye.surface > 0u || eye.cell < 8u; }

/* Returns the scattering of light from i at the point. No light is reflected. The point's bounce is already counted. */
Scatter point_scatter(kiln_gpu_eye_vertex eye, vec3 i)
{
    const float cosine = dot(eye.normal, i);
    return Scatter(vec3(1.0), vec3(0.0), max(0.0, dot(eye.from, i)) * KILN_INVERSE_PI, 0.0, 1.0, cosine, 1.0, cosine);
}

/* Weights of light from direction i, per W/m2 on a plane perpendicular to i. x: for the irradiance about the shading
 * normal. y: for the incident light, about the geometric normal, times the share that the material takes up. */
vec2 point_counts_from(uint slot, kiln_gpu_eye_vertex eye, vec3 i)
{
    const float shading = dot(POINT_PATH(slot).shading, i);
    float taken_up = 1.0;
#ifdef KILN_GLOSS
    taken_up = kiln_taken_up(LitPoints(POINTS_THERE.points).at[POINT_PATH(slot).point], POINTS_THERE.parts, shading);
#endif
    return vec2(max(0.0, shading), dot(eye.normal, i) * taken_up);
}

#endif
