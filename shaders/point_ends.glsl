/* Surface points as ends of paths (worker/pass/reference.h), for what is connected to them and merged there. Ways and
 * estimators are those of worker/backend/embree/reference.c. Needs shaders/subpaths.glsl before it. */
#ifndef KILN_SHADERS_POINT_ENDS_GLSL
#define KILN_SHADERS_POINT_ENDS_GLSL

#ifdef KILN_GLOSS
#    include "shaders/taken_up.glsl"
#endif

/* Whether other paths can find the end of this one: not that of a path which begins at a point on which nothing lands.
 */
bool point_lands(kiln_gpu_eye_vertex eye) { return !POINTS || eye.surface > 0u || eye.cell < 8u; }

/* Returns the scattering of light from i at the point. Nothing is sent on. The point's bounce is counted already. */
Scatter point_scatter(kiln_gpu_eye_vertex eye, vec3 i)
{
    const float cosine = dot(eye.normal, i);
    return Scatter(vec3(1.0), vec3(0.0), max(0.0, dot(eye.from, i)) * KILN_INVERSE_PI, 0.0, 1.0, cosine, 1.0, cosine);
}

/* Weights of light that comes to the point from direction i, per W/m2 on a plane across i. x: for the irradiance about
 * the shading normal. y: for the incident light, about the geometric normal and as far as the material takes it up. */
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
