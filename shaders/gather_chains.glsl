/* Chains of gather rays. The bounce and the weighed pass follow chains apart from the rays they begin with: the code
 * for gloss takes many of a device's registers, and slows down all that runs in its kernel. gather.glsl traces the rays
 * and leaves those that have met gloss; follow.glsl follows their chains; chains_add.comp adds what both have found to
 * the sums of the slice, in the order of its samples. So from the first ray of a slice on that has met gloss the gather
 * keeps what each ray finds.
 *
 * All that lies in the room of the chunk behind its slices, as apart.glsl says. Before it stand
 * shaders/gather_sums.glsl and shaders/chain.glsl. */
#ifndef KILN_SHADERS_GATHER_CHAINS_GLSL
#define KILN_SHADERS_GATHER_CHAINS_GLSL

/* Adds the findings of a ray at whose hit chain c begins. Losses on the chain are shares of what the ray's own tint
 * leaves. For each colour all shares add up to the whole. */
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
