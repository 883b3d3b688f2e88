/* The land pass: light paths from the lamps through mirrors, glass and gloss to where diffuse surfaces take them up.
 *
 * A path begins by an aim (worker/light/aims.h) with the flux of its lamp over the density of its ray, and counts only
 * if the first surface that it meets is of its target, and that surface's material is taken with its gloss. From there
 * on it goes by the adjoint of the scattering functions (shaders/shared/bsdf.h: KILN_IMPORTANCE, with
 * kiln_shading_correction; Veach, "Robust Monte Carlo Methods for Light Transport Simulation", 1997, chapter 5),
 * through their lobes that are not diffuse, and what bodies absorb multiplies its weight. It lands on the first surface
 * that is only diffuse. On a side with surface points of a material with gloss, too, chance has it land: by the diffuse
 * part's share of what the surface sends on, kiln_land_least (shaders/shared/land.h) at least, so that the lightmaps of
 * mirrors have their light; else it goes on. It counts the more for either. It ends by chance like the chains of gather
 * rays (shaders/shared/chain.h: kiln_chain_chance), where it meets nothing, and on the backs of single-sided surfaces
 * that are not taken with their gloss. So a path lands once at most, and only after an event that is not diffuse: light
 * that lamps send straight is the direct pass's. With N paths of which those that land in the texel of point x carry
 * the flux phi, in W,
 *
 *     E(x) = sum of phi / (area of the texel that is there to be lit)
 *
 * whose mean is what the texel gets of such light: nothing is blurred, and no path is cut without the others counting
 * the more. Each phi is already divided by the number of the aim's paths. The variance of E is the sum of phi^2 over
 * the squared area, less what is due to paths being better than independent ones.
 *
 * Surfaces that let light straight through are passed by chance, as by gather rays. Receiver-only objects, which no ray
 * meets, get nothing: theirs is gathered. A place of a texel that a wall divides lands nowhere where it lies beyond the
 * wall.
 *
 * Paths for probes leave light in the spheres that they cross (spheres.h), from the first surface on, which sends them
 * on by its sharp lobes alone; they land only on surfaces that are only diffuse, and their landings are of no use:
 * devices do not hand them over.
 *
 * Items: light paths, numbered over the whole bake from 0 on; path i is number i % aims->paths of iteration
 * i / aims->paths. A result is a function of seed, i and the aims alone. Random numbers: those of path.h
 * (shaders/shared), of sample k = number of the path among those of its aim; surfaces count from 1 on, the ray that a
 * path begins with is 0. Rays: all. Devices
 * take none where they trace by their ray-tracing pipeline (kiln_backend_takes). */
#ifndef KILN_WORKER_PASS_LAND_H
#define KILN_WORKER_PASS_LAND_H

#include "worker/pass/pass.h"

struct kiln_aims;
struct kiln_caustic_techniques;
struct kiln_probe_spheres;

struct kiln_land_parameters {
    const struct kiln_aims *aims; /* borrowed; shared out (kiln_aims_share) */
    /* borrowed: what landings share their light with (weighed.h); NULL: they bring all of it */
    const struct kiln_caustic_techniques *techniques;
    /* borrowed, without techniques: spheres to which this call's paths add what they leave there; NULL: they land */
    const struct kiln_probe_spheres *spheres;
};

/* How a path ends. */
enum kiln_land_end {
    KILN_LAND_ASTRAY, /* what it met first was not its target: it does not count */
    KILN_LAND_LANDED, /* on a surface; beside every surface point where `point` says so */
    KILN_LAND_ESCAPED,
    KILN_LAND_BLOCKED, /* on the back of a single-sided surface */
    KILN_LAND_ABSORBED /* by gloss, or by chance: what it carried has been added to other paths, or is nothing */
};

struct kiln_land_result {
    uint64_t point; /* global number of the surface point; KILN_NO_POINT: none */
    float flux[3];  /* W, where the path ends; of ASTRAY and ABSORBED 0 */
    float shading;  /* times flux: what counts for the irradiance about the shading normal */
    float taken_up; /* times flux: what counts for `incident` (kiln_chain_taken_up; 1 on surfaces that are only diffuse)
                     */
    /* where there are other techniques, kiln_caustic_others: who knows the texel's area and rays weighs with it
     * (kiln_caustic_weight_landed); else 0 */
    float others;
    uint32_t aim;
    uint16_t end;    /* enum kiln_land_end */
    uint16_t length; /* surfaces met */
};

#endif
