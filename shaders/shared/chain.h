/* Chains: paths of gather rays that continue from mirrors, glass and gloss until a diffuse surface. Code common to both
 * backends.
 *
 * A gather ray that hits a surface with a glossy material gathers there
 *
 *     B(y) out(o)     the light of its diffuse part: B(y) is the stored radiosity, out(o) is kiln_diffuse_out of the
 *                     ray's direction (0 on a side that has no points),
 *
 * and continues in one direction sampled from the other lobes (coat, metal, glass, gloss), weighted by value / density.
 * So a chain gathers diffuse light at each of its surfaces. It ends at the first purely diffuse surface, when it leaves
 * the scene, at the back of a single-sided surface without glossy material, or by Russian roulette (kiln_chain_chance).
 * Its weight includes absorption in bodies of glass (Beer's law).
 *
 * The same chains gather light that has met no diffuse surface yet (the caustic pass), at each surface from which they
 * continue. For a sharp lobe (kiln_path_sharp) the chain itself finds the emission of the next surfaces and the sky.
 * For other lobes lights are sampled as in the path pass (worker/pass/path.h): one sample of the light tree, one of
 * each directional light, two of an environment image. A uniform sky is always found by the chain's rays. Lights that
 * no ray can hit (point, spot, directional) are sampled for sharp lobes, too, except mirrors. */
#ifndef KILN_SHADERS_SHARED_CHAIN_H
#define KILN_SHADERS_SHARED_CHAIN_H

#include "shaders/shared/path.h"
#include "shaders/shared/streams.h"

/* Number of the surface from which Russian roulette applies to every chain; on earlier surfaces it applies to chains of
 * small weight only. --chain-length. */
#define KILN_CHAIN_LENGTH 8u
/* Russian roulette of early surfaces: the probability of continuing is this factor times the relative weight left, at
 * most 1. Most glossy materials reflect a twentieth of the light. */
#define KILN_CHAIN_MORE 2.0f

/* Estimates the weight, of the largest colour, that a chain has left after scattering by the lobes that are not
 * diffuse: by their albedos for the direction that it comes from. */
KILN_FUNCTION float kiln_chain_left(KILN_STRUCT kiln_bsdf_albedo a, KILN_VECTOR weight)
{
    const KILN_VECTOR sent = vec3_add(vec3_add(a.gloss, a.coat), vec3_add(a.spread_near, a.spread_far));
    return kiln_bsdf_largest(vec3_mul(weight, sent));
}

/* Probability with which a chain continues from its surface number `surface` (0, 1, ...), by Russian roulette; its
 * weight is divided by it. The decision precedes sampling of direction and lights, so that a chain that ends costs
 * little. `left`: kiln_chain_left. */
KILN_FUNCTION float kiln_chain_chance(KILN_U32 surface, KILN_U32 length, float left)
{
    if (surface >= length)
        return float_min(left, KILN_PATH_CHANCE_MOST);
    return float_min(KILN_CHAIN_MORE * left, 1.0f);
}

/* Returns the fraction of light from a direction that enters the diffuse part of surface points with this material:
 * kiln_diffuse_in_about, or 0 without a diffuse part. Incident light of points is weighted by it. `cosine`: of the
 * direction with the shading normal of the front, signed. */
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
