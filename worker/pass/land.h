/* The land pass: light paths from the lamps through mirrors, glass and gloss to where diffuse surfaces take them up.
 *
 * A path starts by an aim (worker/light/aims.h) with the flux of its lamp divided by the density of its ray. It counts
 * only if its first hit is on the aim's target, on a material taken with its gloss. It is continued by the adjoint of
 * the scattering functions (shaders/shared/bsdf.h: KILN_IMPORTANCE, with kiln_shading_correction; Veach, "Robust Monte
 * Carlo Methods for Light Transport Simulation", 1997, chapter 5), through lobes that are not diffuse; absorption in
 * bodies multiplies its weight. It lands on the first purely diffuse surface. On a glossy surface whose side has
 * surface points it lands by chance, so that the lightmaps of mirrors get light, too. The probability is the diffuse
 * part's share of the scattered light, but at least kiln_land_least (shaders/shared/land.h). The weight is divided by
 * the probability of landing or of going on. It ends by roulette like the chains of gather rays
 * (shaders/shared/chain.h: kiln_chain_chance), where it meets nothing, and on backs of single-sided surfaces that are
 * not taken with their gloss. So a path lands at most once, and only after a non-diffuse event: unscattered light of
 * lamps belongs to the direct pass. With phi, in W, the flux of each path that lands in the texel of point x,
 *
 *     E(x) = sum of phi / (present area of the texel, the part not cut out by opacity)
 *
 * This is an unbiased estimate of the texel's mean: nothing is blurred, and paths cut by roulette are compensated by
 * the others. Each phi is already divided by the number of the aim's paths. The variance of E is at most the sum of
 * phi^2 over the squared area, since stratified paths are better than independent ones.
 *
 * Surfaces that let light straight through are passed by chance, as by gather rays. Receiver-only objects, which no ray
 * meets, get nothing here: their caustics are gathered. In a texel divided by a wall, a path that hits a place beyond
 * the wall lands at no point.
 *
 * Paths for probes add light to the spheres that they cross (spheres.h), from their first surface on. That surface
 * scatters them by its sharp lobes only. They land on purely diffuse surfaces only; these landings are not used, and
 * devices do not report them.
 *
 * Items: light paths, numbered over the whole bake from 0 on; path i is number i % aims->paths of iteration i /
 * aims->paths. A result is a function of seed, i and the aims alone. Random numbers: as in shaders/shared/path.h, with
 * the sample index k = number of the path within its aim, and depth 0 for the first ray, 1 for the first surface, and
 * so on. Rays: all. Devices that trace with their ray-tracing pipeline do not run this pass (kiln_backend_takes). */
#ifndef KILN_WORKER_PASS_LAND_H
#define KILN_WORKER_PASS_LAND_H

#include "worker/pass/pass.h"

struct kiln_aims;
struct kiln_caustic_techniques;
struct kiln_probe_spheres;

struct kiln_land_parameters {
    const struct kiln_aims *aims; /* borrowed; paths are distributed (kiln_aims_share) */
    /* borrowed: other techniques to weight landings against (weighed.h); NULL: landings bring the full light */
    const struct kiln_caustic_techniques *techniques;
    /* borrowed; spheres that this call's paths add light to, if `techniques` is NULL; NULL: paths land on surfaces */
    const struct kiln_probe_spheres *spheres;
};

/* How a path ends. */
enum kiln_land_end {
    KILN_LAND_ASTRAY, /* the first hit was not the target: the path does not count */
    KILN_LAND_LANDED, /* on a surface; beside every surface point where `point` says so */
    KILN_LAND_ESCAPED,
    KILN_LAND_BLOCKED, /* on the back of a single-sided surface */
    KILN_LAND_ABSORBED /* by gloss, or ended by roulette, which other paths make up for */
};

struct kiln_land_result {
    uint64_t point; /* global number of the surface point; KILN_NO_POINT: none */
    float flux[3];  /* W, where the path ends; of ASTRAY and ABSORBED 0 */
    float shading;  /* factor of `flux` for the irradiance about the shading normal */
    float taken_up; /* factor of `flux` for `incident` (kiln_chain_taken_up); 1 on diffuse surfaces */
    /* kiln_caustic_others if there are other techniques, else 0; the owner of the texel, who knows its area and rays,
     * turns it into a weight (kiln_caustic_weight_landed) */
    float others;
    uint32_t aim;
    uint16_t end;    /* enum kiln_land_end */
    uint16_t length; /* surfaces met */
};

#endif
