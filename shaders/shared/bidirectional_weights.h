/* How the techniques of bidirectional paths weigh against each other: the balance heuristic (Veach, "Robust Monte Carlo
 * Methods for Light Transport Simulation", 1997, section 9.2), by the recursion of vertex connection and merging
 * (Georgiev, Krivanek, Davidovic and Slusallek, "Light Transport Simulation with Vertex Connection and Merging",
 * SIGGRAPH Asia 2012; Georgiev, "Implementing Vertex Connection and Merging", technical report, 2012, equations 31 to
 * 38). A path that has s vertices of a light's subpath and t of an eye's can be found
 *
 *     s = 0              the eye's subpath meets the emitter;
 *     s = 1              a sample of the lights is connected to the eye's subpath;
 *     t = 1              a vertex of light is connected to the camera;
 *     else               two vertices are connected,
 *     merged             a vertex of light lies within the radius of the eye's vertex: for each inner vertex.
 *
 * Each subpath carries three sums, from which the weight of each technique follows at once. Densities are those with
 * which subpaths are drawn, per steradian where they say `density`; chances of going on (roulette) and of surfaces that
 * let light through are no part of them: for one path they are the same numbers in all its weights, whose sum is 1
 * whatever they are. Pure functions. */
#ifndef KILN_SHADERS_SHARED_BIDIRECTIONAL_WEIGHTS_H
#define KILN_SHADERS_SHARED_BIDIRECTIONAL_WEIGHTS_H

#include "shaders/shared/real.h"

/* Sums that a subpath carries: dVCM, dVC and dVM of Georgiev's technical report (2012). */
struct kiln_path_sums {
    kiln_real vcm, vc, vm;
};

/* Which techniques there are: m2, pi times the squared radius times the light subpaths that may be merged with; and one
 * over it. Both 0: no merging. (Merging alone needs no weights.) */
struct kiln_path_techniques {
    kiln_real merges, connections;
};

/* A subpath of light leaves its light: `connect` and `emission` are densities of kiln_emission_connect and
 * kiln_emission_density, `cosine` that at the light; `is_point`: the eye's subpath cannot meet it. */
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

/* A subpath arrives at a surface. `squared`: m2, of the distance; 1 from the environment and directional lights.
 * `cosine`: of the geometric normal there. */
KILN_FUNCTION void kiln_path_arrive(KILN_INOUT(KILN_STRUCT kiln_path_sums) s, kiln_real squared, kiln_real cosine)
{
    KILN_AT(s).vcm *= squared / cosine;
    KILN_AT(s).vc /= cosine;
    KILN_AT(s).vm /= cosine;
}

/* The subpath leaves the surface. `forward`, `backward`: densities of the way on, and of the way back from there;
 * `cosine`: of the way on. */
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

/* s = 0, of an eye's subpath with at least one surface before the emitter, or before it leaves the scene. */
KILN_FUNCTION kiln_real kiln_path_weight_met(KILN_IN(KILN_STRUCT kiln_path_sums) eye, kiln_real connect,
                                             kiln_real emission)
{
    return 1 / (1 + connect * KILN_AT(eye).vcm + emission * KILN_AT(eye).vc);
}

/* s = 1. `towards`: the cosine at the eye's vertex over the squared distance, without the latter from outside. `hit`:
 * density with which the eye's subpath meets the sample, in the measure of `connect`; 0 of points. `backward`: density
 * with which a subpath of light goes on the way that the eye's has come. */
KILN_FUNCTION kiln_real kiln_path_weight_sampled(KILN_IN(KILN_STRUCT kiln_path_techniques) t,
                                                 KILN_IN(KILN_STRUCT kiln_path_sums) eye, kiln_real connect,
                                                 kiln_real emission, kiln_real towards, kiln_real hit,
                                                 kiln_real backward)
{
    return 1 / (hit / connect + 1 +
                emission / connect * towards * (KILN_AT(t).merges + KILN_AT(eye).vcm + KILN_AT(eye).vc * backward));
}

/* t = 1. `camera`: density per m2 of the camera's rays at the vertex, over the number of subpaths of light. `backward`:
 * density with which an eye's subpath goes on the way that light has come. */
KILN_FUNCTION kiln_real kiln_path_weight_seen(KILN_IN(KILN_STRUCT kiln_path_techniques) t,
                                              KILN_IN(KILN_STRUCT kiln_path_sums) light, kiln_real camera,
                                              kiln_real backward)
{
    return 1 / (1 + camera * (KILN_AT(t).merges + KILN_AT(light).vcm + KILN_AT(light).vc * backward));
}

/* Two vertices connected: densities per m2 with which the eye's subpath finds the light's vertex and the other way
 * round, and those of going on the ways that the other subpath has come. */
KILN_FUNCTION kiln_real kiln_path_weight_connected(KILN_IN(KILN_STRUCT kiln_path_techniques) t,
                                                   KILN_IN(KILN_STRUCT kiln_path_sums) eye,
                                                   KILN_IN(KILN_STRUCT kiln_path_sums) light, kiln_real finds_light,
                                                   kiln_real light_backward, kiln_real finds_eye,
                                                   kiln_real eye_backward)
{
    return 1 / (1 + finds_light * (KILN_AT(t).merges + KILN_AT(light).vcm + KILN_AT(light).vc * light_backward) +
                finds_eye * (KILN_AT(t).merges + KILN_AT(eye).vcm + KILN_AT(eye).vc * eye_backward));
}

/* Merged at the eye's vertex: densities of the way that light has come, by the eye's subpath, and of the way that the
 * eye's has come, by light. */
KILN_FUNCTION kiln_real kiln_path_weight_merged(KILN_IN(KILN_STRUCT kiln_path_techniques) t,
                                                KILN_IN(KILN_STRUCT kiln_path_sums) eye,
                                                KILN_IN(KILN_STRUCT kiln_path_sums) light, kiln_real light_backward,
                                                kiln_real eye_backward)
{
    return 1 / (1 + KILN_AT(light).vcm * KILN_AT(t).connections + KILN_AT(light).vm * light_backward +
                KILN_AT(eye).vcm * KILN_AT(t).connections + KILN_AT(eye).vm * eye_backward);
}

#endif
