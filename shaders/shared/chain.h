/* Chains: how a gather ray goes on from mirrors, glass and gloss until a diffuse surface answers. What both backends
 * share of it.
 *
 * A ray of a surface point that meets a surface whose material is taken with its gloss finds, at that surface,
 *
 *     B(y) out(o)     what its diffuse part sends to where the ray comes from: B(y) is the radiosity that is stored
 *                     there, out(o) is kiln_diffuse_out of the ray's direction (0 on a side that has no points),
 *
 * and goes on in one direction, which is drawn from its other lobes (coat, metal, glass, gloss), with the weight value
 * over density. So a chain finds diffuse light at each of its surfaces. It ends at the first surface that is only
 * diffuse, where it escapes, where it meets the back of a single-sided surface that is not taken with its gloss, or by
 * chance (kiln_chain_chance). What bodies of glass on its way absorb multiplies its weight (Beer's law).
 *
 * Light that has met no diffuse surface yet (the caustic pass) is found by the same chains, at each surface that they
 * go on from: a sharp lobe (kiln_path_sharp) finds what the surfaces that the chain meets next emit, and the sky; for
 * the other lobes, samples of the lights are drawn, as in the path pass (worker/pass/path.h), one of the tree of
 * lights, one of each directional light, two of an environment with an image. A sky of one radiance all over is found
 * by the chain's rays, whatever the lobe. Of lights that no ray can meet (points, spots, directional lights) samples
 * are drawn for sharp lobes too, where these are no mirrors. */
#ifndef KILN_SHADERS_SHARED_CHAIN_H
#define KILN_SHADERS_SHARED_CHAIN_H

#include "shaders/shared/path.h"
#include "shaders/shared/streams.h"

/* Surfaces of a chain that are met for certain while the chain's weight is not small; --chain-length. */
#define KILN_CHAIN_LENGTH 8u
/* A chain that is to have less than one over this of its first weight goes on with a chance of so many times the
 * weight: most gloss sends on a twentieth of what it meets. */
#define KILN_CHAIN_MORE 2.0f

/* Returns about the weight, of the colour of which that is most, that a chain would have left when lobes that are not
 * diffuse have sent it on: by the albedos for the direction that it comes from. */
KILN_FUNCTION float kiln_chain_left(KILN_STRUCT kiln_bsdf_albedo a, KILN_VECTOR weight)
{
    const KILN_VECTOR sent = vec3_add(vec3_add(a.gloss, a.coat), vec3_add(a.spread_near, a.spread_far));
    return kiln_bsdf_largest(vec3_mul(weight, sent));
}

/* With what chance a chain goes on from its surface number `surface` (0, 1, ...); it counts the more for it. Chance
 * decides before a direction is drawn and before lights are sampled, so that a chain that ends costs little. `left`:
 * kiln_chain_left. */
KILN_FUNCTION float kiln_chain_chance(KILN_U32 surface, KILN_U32 length, float left)
{
    if (surface >= length)
        return float_min(left, KILN_PATH_CHANCE_MOST);
    return float_min(KILN_CHAIN_MORE * left, 1.0f);
}

/* Returns the share of light from a direction that surface points on such a material take up, in the light that they
 * count as incident: kiln_diffuse_in_about where there is a diffuse part. `cosine` is the direction's with the shading
 * normal of the front, signed. */
KILN_FUNCTION float kiln_chain_taken_up(KILN_STRUCT kiln_bsdf_lobes lobes, float cosine)
{
    return lobes.matt > 0.0f ? kiln_diffuse_in_about(lobes, cosine) : 0.0f;
}

/* Returns the key of the random numbers of a texel's chains: `chance` is the texel's kiln_gather_chance. Numbers of ray
 * k at surface s of its chain are kiln_path_numbers(kiln_path_key(key, kiln_path_use(s, KILN_PATH_...)), k), with the
 * uses of path.h: KILN_PATH_LOBE (u picks the lobe, v says whether the chain goes on), KILN_PATH_BOUNCE (the
 * direction), KILN_PATH_CHANCE (the ray that leaves the surface, by kiln_hash2(kiln_path_key(...), k)), and those of
 * lights. */
KILN_FUNCTION KILN_U32 kiln_chain_key(KILN_U32 chance) { return kiln_hash1(chance + 0x636861u); }

#endif
