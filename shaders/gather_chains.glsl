/* Chains of gather rays. The bounce and the weighed pass follow chains in a kernel separate from the rays where they
 * begin: the code for gloss takes many registers, which slows down everything in its kernel. gather.glsl traces the
 * rays and stores those that have met gloss; follow.glsl follows their chains; chains_add.comp adds the results of both
 * to the sums of the slice, in the order of its samples. For this the gather stores each ray's result from the first
 * ray of a slice that meets gloss.
 *
 * The data lie in the memory of the chunk behind its slices (apart.glsl). Include shaders/gather_sums.glsl and
 * shaders/chain.glsl first. */
#ifndef KILN_SHADERS_GATHER_CHAINS_GLSL
#define KILN_SHADERS_GATHER_CHAINS_GLSL

/* Adds the result of a ray at whose hit chain c begins. Losses on the chain are shares of the light that the ray's own
 * tint lets through. For each colour all shares sum to 1. */
void add_found(inout Sums sums, Chain c, vec3 tint, float facet, float weight)
{
    const vec3 left = HAS_ALPHA >= KILN_PASSAGE_TINT ? tint : vec3(1.0);
    const float mean = (left.r + left.g + left.b) * (1.0 / 3.0);
    sums.escaped += facet * mean * c.escaped;
    sums.blocked += facet * mean * c.blocked;
    sums.gloss += facet * (left * c.gloss + (left - mean) * (c.escaped + c.blocked));
    add_light(sums, c.radiosity, tint, facet, weight);
}

#ifdef KILN_APART
#    include "shaders/apart.glsl"

/* Keeps what a ray has found. */
void apart_keep(uint64_t ray, Sums s)
{
    ApartFound(ray).at[0] = kiln_gpu_apart_found(float[3](s.incident.r, s.incident.g, s.incident.b),
                                                 float[3](s.irradiance.r, s.irradiance.g, s.irradiance.b), s.escaped,
                                                 s.blocked, s.luminance, float[3](s.glass.r, s.glass.g, s.glass.b),
                                                 float[3](s.gloss.r, s.gloss.g, s.gloss.b));
}

void add_sums(inout Sums sums, Sums s)
{
    sums.incident += s.incident;
    sums.irradiance += s.irradiance;
    sums.glass += s.glass;
    sums.escaped += s.escaped;
    sums.blocked += s.blocked;
    sums.luminance += s.luminance;
}
#endif

#endif
