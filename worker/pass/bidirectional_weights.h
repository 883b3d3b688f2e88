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
#ifndef KILN_WORKER_PASS_BIDIRECTIONAL_WEIGHTS_H
#define KILN_WORKER_PASS_BIDIRECTIONAL_WEIGHTS_H

#include <stdbool.h>

/* dVCM, dVC and dVM of the report. */
struct kiln_path_sums {
    double vcm, vc, vm;
};

/* Which techniques there are: m2, pi times the squared radius times the light subpaths that may be merged with; and one
 * over it. Both 0: no merging. (Merging alone needs no weights.) */
struct kiln_path_techniques {
    double merges, connections;
};

/* A subpath of light leaves its light: `connect` and `emission` are densities of kiln_emission_connect and
 * kiln_emission_density, `cosine` that at the light; `is_point`: the eye's subpath cannot meet it. */
static inline struct kiln_path_sums kiln_path_begin_light(const struct kiln_path_techniques *t, double connect,
                                                          double emission, double cosine, bool is_point)
{
    const double vc = is_point ? 0.0 : cosine / emission;
    return (struct kiln_path_sums){connect / emission, vc, vc * t->connections};
}

/* A subpath arrives at a surface. `squared`: m2, of the distance; 1 from the environment and directional lights.
 * `cosine`: of the geometric normal there. */
static inline void kiln_path_arrive(struct kiln_path_sums *s, double squared, double cosine)
{
    s->vcm *= squared / cosine;
    s->vc /= cosine;
    s->vm /= cosine;
}

/* It leaves the surface: the density of the way on, and of the way back from there; the cosine of the way on. */
static inline void kiln_path_leave(const struct kiln_path_techniques *t, struct kiln_path_sums *s, double cosine,
                                   double forward, double backward, bool delta)
{
    const double ratio = cosine / forward;
    if (delta) { /* no other technique has its vertex here */
        *s = (struct kiln_path_sums){0.0, s->vc * ratio * backward, s->vm * ratio * backward};
        return;
    }
    s->vc = ratio * (s->vc * backward + s->vcm + t->merges);
    s->vm = ratio * (s->vm * backward + s->vcm * t->connections + 1.0);
    s->vcm = 1.0 / forward;
}

/* s = 0, of an eye's subpath with at least one surface before the emitter, or before it leaves the scene. */
static inline double kiln_path_weight_met(const struct kiln_path_sums *eye, double connect, double emission)
{
    return 1.0 / (1.0 + connect * eye->vcm + emission * eye->vc);
}

/* s = 1. `towards`: the cosine at the eye's vertex over the squared distance, without the latter from outside. `hit`:
 * density with which the eye's subpath meets the sample, in the measure of `connect`; 0 of points. `backward`: density
 * with which a subpath of light goes on the way that the eye's has come. */
static inline double kiln_path_weight_sampled(const struct kiln_path_techniques *t, const struct kiln_path_sums *eye,
                                              double connect, double emission, double towards, double hit,
                                              double backward)
{
    return 1.0 / (hit / connect + 1.0 + emission / connect * towards * (t->merges + eye->vcm + eye->vc * backward));
}

/* t = 1. `camera`: density per m2 of the camera's rays at the vertex, over the number of subpaths of light. `backward`:
 * density with which an eye's subpath goes on the way that light has come. */
static inline double kiln_path_weight_seen(const struct kiln_path_techniques *t, const struct kiln_path_sums *light,
                                           double camera, double backward)
{
    return 1.0 / (1.0 + camera * (t->merges + light->vcm + light->vc * backward));
}

/* Two vertices connected: densities per m2 with which the eye's subpath finds the light's vertex and the other way
 * round, and those of going on the ways that the other subpath has come. */
static inline double kiln_path_weight_connected(const struct kiln_path_techniques *t, const struct kiln_path_sums *eye,
                                                const struct kiln_path_sums *light, double finds_light,
                                                double light_backward, double finds_eye, double eye_backward)
{
    return 1.0 / (1.0 + finds_light * (t->merges + light->vcm + light->vc * light_backward) +
                  finds_eye * (t->merges + eye->vcm + eye->vc * eye_backward));
}

/* Merged at the eye's vertex: densities of the way that light has come, by the eye's subpath, and of the way that the
 * eye's has come, by light. */
static inline double kiln_path_weight_merged(const struct kiln_path_techniques *t, const struct kiln_path_sums *eye,
                                             const struct kiln_path_sums *light, double light_backward,
                                             double eye_backward)
{
    return 1.0 / (1.0 + light->vcm * t->connections + light->vm * light_backward + eye->vcm * t->connections +
                  eye->vm * eye_backward);
}

#endif
