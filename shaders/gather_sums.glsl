/* Sums over the rays of a slice of the gather pass (gather.glsl), and their layout in memory. */
#ifndef KILN_SHADERS_GATHER_SUMS_GLSL
#define KILN_SHADERS_GATHER_SUMS_GLSL

#ifdef KILN_GLOSS
struct Sums {
    vec3 incident, irradiance, glass, gloss;
    float escaped, blocked, luminance;
};
#    define NO_SUMS Sums(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), 0.0, 0.0, 0.0)
float ray_taken_up; /* share of the ray's light that counts as incident */
#else
struct Sums {
    vec3 incident, irradiance, glass;
    float escaped, blocked, luminance;
};
#    define NO_SUMS Sums(vec3(0.0), vec3(0.0), vec3(0.0), 0.0, 0.0, 0.0)
#endif

/* Adds the light of a ray, which found the radiosity `rgb`. */
void add_light(inout Sums sums, vec3 rgb, vec3 tint, float facet, float weight)
{
    if (HAS_ALPHA >= KILN_PASSAGE_TINT) {
        rgb *= tint;
        sums.glass += facet * (1.0 - tint);
    }
#ifdef KILN_GLOSS
    sums.incident += facet * ray_taken_up * rgb;
    sums.irradiance += weight * rgb;
#else
    sums.incident += facet * rgb;
    if (HAS_SMOOTH != 0u)
        sums.irradiance += weight * rgb;
#endif
#ifdef KILN_GUIDED
    guide_luminance = weight * float_luminance(rgb);
#endif
    sums.luminance += weight * float_luminance(rgb);
}

#ifdef KILN_GLOSS
const bool STORES_BOTH = true;
#else
const bool STORES_BOTH = HAS_SMOOTH != 0u;
#endif
const uint TINTED_FLOATS = HAS_ALPHA >= KILN_PASSAGE_TINT ? KILN_GPU_SLICE_TINTED_FLOATS : KILN_GPU_SLICE_FLOATS;
#if defined(KILN_GLOSS) && !defined(KILN_CAUSTIC)
const uint SLICE_FLOATS = TINTED_FLOATS + KILN_GPU_SLICE_GLOSS;
#else
const uint SLICE_FLOATS = TINTED_FLOATS;
#endif
const uint SLICE_FLOATS_MOST = KILN_GPU_SLICE_TINTED_FLOATS + KILN_GPU_SLICE_GLOSS;
const float SUMS_NOT_GOOD = -1.0e9; /* `escaped`: the device has ended a loop early */

#endif
