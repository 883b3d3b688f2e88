/* Weights of the techniques of bidirectional path tracing: the balance heuristic (Veach, "Robust Monte Carlo Methods
 * for Light Transport Simulation", 1997, section 9.2), by the recursion of vertex connection and merging
 * (Georgiev, Krivanek, Davidovic and Slusallek, "Light Transport Simulation with Vertex Connection and Merging",
 * SIGGRAPH Asia 2012; Georgiev, "Implementing Vertex Connection and Merging", technical report, 2012, equations 31 to
 * 38). A path with s vertices of a light subpath and t of an eye subpath can be found by these techniques:
 *
 *     s = 0              the eye's subpath meets the emitter;
 *     s = 1              a sample of the lights is connected to the eye's subpath;
 *     t = 1              a vertex of light is connected to the camera;
 *     else               two vertices are connected,
 *     merged             a vertex of light lies within the radius of the eye's vertex: for each inner vertex.
 *
 * Each subpath carries three sums, from which the weight of each technique follows at once. Densities are those with
 * which subpaths are sampled, per steradian where named `density`. They exclude the probabilities of Russian roulette
 * and of passing through transparent surfaces: these would be the same in all weights of a path, which sum to 1 without
 * them, too. Pure functions. */
#ifndef KILN_SHADERS_SHARED_BIDIRECTIONAL_WEIGHTS_H
#define KILN_SHADERS_SHARED_BIDIRECTIONAL_WEIGHTS_H

#include "shaders/shared/real.h"

/* Sums that a subpath carries: dVCM, dVC and dVM of Georgiev's technical report (2012). */
struct kiln_path_sums {
    kiln_real vcm, vc, vm;
};

/* Factors of merging: `merges` is pi x radius^2 x number of light subpaths for merging, m2; `connections` is 1 /
 * merges. Both 0: no merging. (Merging alone needs no weights.) */
struct kiln_path_techniques {
    kiln_real merges, connections;
};

/* Starts the sums of a light subpath. `connect` and `emission` are the densities of kiln_emission_connect and
 * kiln_emission_density, `cosine` that at the light; `is_point`: no eye subpath can hit the light. */
KILN_FUNCTION KILN_STRUCT kiln_path_sums kiln_path_begin_light(KILN_IN(KILN_STRUCT kiln_path_techniques) t,
                                                               kiln_real connect, kiln_real emission, kiln_real cosine,
                                                               bool is_point)
{
    const kiln_real vc = is_point ? kiln_real_of(0) : cosine / emission;
    KILN_STRUCT kiln_path_sums s;
    s.vcm = connect / emission;
    s.vc = vc;
    s.vm = vc * KILN_AT(t).connections;
    return s;
}

/* Updates the sums when a subpath arrives at a surface. `squared`: squared distance, m2; 1 from the environment and
 * directional lights. `cosine`: at the surface, with the geometric normal. */
KILN_FUNCTION void kiln_path_arrive(KILN_INOUT(KILN_STRUCT kiln_path_sums) s, kiln_real squared, kiln_real cosine)
{
    KILN_AT(s).vcm *= squared / cosine;
    KILN_AT(s).vc /= cosine;
    KILN_AT(s).vm /= cosine;
}

/* Updates the sums when the subpath leaves the surface. `forward`: density of the new direction; `backward`: density of
 * the reverse scattering; `cosine`: of the new direction. */
KILN_FUNCTION void kiln_path_leave(KILN_IN(KILN_STRUCT kiln_path_techniques) t,
                                   KILN_INOUT(KILN_STRUCT kiln_path_sums) s, kiln_real cosine, kiln_real forward,
                                   kiln_real backward, bool delta)
{
    const kiln_real ratio = cosine / forward;
    if (delta) { /* no other technique has its vertex here */
        KILN_AT(s).vcm = kiln_real_of(0);
        KILN_AT(s).vc = KILN_AT(s).vc * ratio * backward;
        KILN_AT(s).vm = KILN_AT(s).vm * ratio * backward;
        return;
    }
    KILN_AT(s).vc = ratio * (KILN_AT(s).vc * backward + KILN_AT(s).vcm + KILN_AT(t).merges);
    KILN_AT(s).vm = ratio * (KILN_AT(s).vm * backward + KILN_AT(s).vcm * KILN_AT(t).connections + 1);
    KILN_AT(s).vcm = 1 / forward;
}

/* Weight for s = 0: an eye subpath that hits the emitter or leaves the scene after at least one surface. */
KILN_FUNCTION kiln_real kiln_path_weight_met(KILN_IN(KILN_STRUCT kiln_path_sums) eye, kiln_real connect,
                                             kiln_real emission)
{
    return 1 / (1 + connect * KILN_AT(eye).vcm + emission * KILN_AT(eye).vc);
}

/* Weight for s = 1. `towards`: the cosine at the eye's vertex / squared distance; for light from outside the scene the
 * cosine alone. `hit`: density with which the eye subpath hits the sample, in the measure of `connect`; 0 for point
 * lights. `backward`: density with which a light subpath continues along the eye subpath, in reverse. */
KILN_FUNCTION kiln_real kiln_path_weight_sampled(KILN_IN(KILN_STRUCT kiln_path_techniques) t,
                                                 KILN_IN(KILN_STRUCT kiln_path_sums) eye, kiln_real connect,
                                                 kiln_real emission, kiln_real towards, kiln_real hit,
                                                 kiln_real backward)
{
    return 1 / (hit / connect + 1 +
                emission / connect * towards * (KILN_AT(t).merges + KILN_AT(eye).vcm + KILN_AT(eye).vc * backward));
}

/* Weight for t = 1. `camera`: density per m2 of the camera's rays at the vertex / number of light subpaths. `backward`:
 * density with which an eye subpath continues along the light subpath, in reverse. */
KILN_FUNCTION kiln_real kiln_path_weight_seen(KILN_IN(KILN_STRUCT kiln_path_techniques) t,
                                              KILN_IN(KILN_STRUCT kiln_path_sums) light, kiln_real camera,
                                              kiln_real backward)
{
    return 1 / (1 + camera * (KILN_AT(t).merges + KILN_AT(light).vcm + KILN_AT(light).vc * backward));
}

/* Weight for two connected vertices. `finds_light`, `finds_eye`: densities per m2 with which the eye subpath samples
 * the light vertex, and vice versa. `light_backward`, `eye_backward`: densities of then continuing along the light, or
 * the eye subpath, in reverse. */
KILN_FUNCTION kiln_real kiln_path_weight_connected(KILN_IN(KILN_STRUCT kiln_path_techniques) t,
                                                   KILN_IN(KILN_STRUCT kiln_path_sums) eye,
                                                   KILN_IN(KILN_STRUCT kiln_path_sums) light, kiln_real finds_light,
                                                   kiln_real light_backward, kiln_real finds_eye,
                                                   kiln_real eye_backward)
{
    return 1 / (1 + finds_light * (KILN_AT(t).merges + KILN_AT(light).vcm + KILN_AT(light).vc * light_backward) +
                finds_eye * (KILN_AT(t).merges + KILN_AT(eye).vcm + KILN_AT(eye).vc * eye_backward));
}

/* Weight for merging at the eye's vertex. `light_backward`: density with which the eye subpath continues along the
 * light subpath, in reverse; `eye_backward`: the same with the subpaths exchanged. */
KILN_FUNCTION kiln_real kiln_path_weight_merged(KILN_IN(KILN_STRUCT kiln_path_techniques) t,
                                                KILN_IN(KILN_STRUCT kiln_path_sums) eye,
                                                KILN_IN(KILN_STRUCT kiln_path_sums) light, kiln_real light_backward,
                                                kiln_real eye_backward)
{
    return 1 / (1 + KILN_AT(light).vcm * KILN_AT(t).connections + KILN_AT(light).vm * light_backward +
                KILN_AT(eye).vcm * KILN_AT(t).connections + KILN_AT(eye).vm * eye_backward);
}

#endif
