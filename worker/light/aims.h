/* Aims: where light paths begin, and at what they are aimed (worker/pass/land.h).
 *
 * Light that bends is a little of all light: most of what lamps and sky send meets diffuse surfaces first. So paths are
 * aimed at *targets*: triangles of objects with materials that are taken with their gloss, within spheres and boxes
 * (targets.h). A *lamp* is an emitting object, a point or spot light, a directional light, or the environment, of which
 * an image is as many lamps as it is cut into cells (sky_cells.h). A
 * pair of a lamp and a target is an aim; each aim has a number of the paths of an iteration, in one stretch, at least
 * one. A path of an aim counts only if the first surface that it meets is its target's, so that the aims part the light
 * among them: each way of light is of one aim, and its density is that of this aim alone.
 *
 * Lamps send towards a target's sphere of radius r about c, or its box where that is seen smaller:
 *
 *   emitting object     a triangle by its flux, a place on it by its area, then the cone about the sphere, or over the
 *                       box's solid angle, evenly; by the cosine over the hemisphere (of a two-sided triangle either)
 *                       where the cone is wide
 *   point, spot         the cone about the sphere, or the box, or the spot's own where that is narrower; all round from
 *                       within
 *   directional         a disc of radius r before the sphere, or what is seen of the box, from outside the scene
 *   environment         a direction of the cell by luminance, then likewise
 *
 * Of an aim's paths the first ones may go evenly over the target's triangles (targets.h): one by its area, a place on
 * it evenly, a place on the lamp and the ray from there. Such a path counts only if the triangle that it meets first is
 * the one that was picked. So a ray that meets a triangle first has a density of two parts, and paths of both kinds are
 * weighed by the sum of both (balance heuristic), which only their first meeting tells (kiln_aims_met).
 *
 * The numbers of paths go by weights: at first about the flux sent towards the target, later what was learnt.
 * Not collective; a pure function of scene, lights and weights. Read by several threads at once. */
#ifndef KILN_WORKER_LIGHT_AIMS_H
#define KILN_WORKER_LIGHT_AIMS_H

#include "shaders/shared/aimed_ray.h"
#include "worker/base/arena.h"
#include "worker/light/lights.h"
#include "worker/light/sky_cells.h"
#include "worker/light/targets.h"

struct kiln_aim {
    uint32_t lamp, target;
    double flux; /* luminance of what the lamp sends towards the target, about, W */
    double even; /* the part of its paths that go evenly over the target's triangles; 0 from points and spots */
};

struct kiln_aims {
    const struct kiln_lights *lights; /* borrowed */
    size_t lamp_count, count;
    struct kiln_lamp *lamps;
    struct kiln_sky_cells sky; /* count 0: the environment is no image */
    struct kiln_targets targets;
    struct kiln_aim *aims; /* target by target of each lamp */
    double *until;         /* of each emitting triangle: share of its lamp's flux up to its end */
    uint32_t *lamp_of;     /* of each emitting triangle its lamp */
    uint64_t paths;        /* of an iteration; 0: not shared out yet */
    uint64_t *first;       /* of each aim its first path, and one more */
    struct kiln_dvec3 centre;
    double radius; /* of a sphere about the scene, m */
    struct kiln_arena arena;
};

enum { KILN_AIMS_MOST = 1 << 24, KILN_AIM_NUMBERS = 6 };

/* `count` is 0 where no lamp or no material with gloss is. Objects are cut into several targets as long as there are at
 * most `most` aims. Borrows the lights. KILN_SYSTEM; KILN_USAGE where there are more than KILN_AIMS_MOST. Destroy with
 * kiln_aims_destroy. */
int kiln_aims_create(struct kiln_aims **aims, const struct kiln_lights *lights, size_t most, struct kiln_error *error);
void kiln_aims_destroy(struct kiln_aims **aims);

/* Shares out `paths` >= aims->count paths: each aim gets one, and of the others a share by its weight, which is not
 * negative. NULL: by flux. */
void kiln_aims_share(struct kiln_aims *aims, uint64_t paths, const double *weights);

/* Weights by what was learnt of paths that were shared out before: of each aim the sum of the second moments of what
 * they brought, in terms of the aim's flux, and their number. A share proportional to the root of the mean moment makes
 * the variance least; a tenth goes by flux, so that no aim starves for what has not been found yet. `even`: part of the
 * weights that all aims have alike. */
void kiln_aims_weigh(const struct kiln_aims *aims, const double *moments, const double *paths, double even,
                     double *weights);

/* Whether the aim's lamp is of the kinds KILN_LEAVES_... (shaders/shared/streams.h). A sky of one radiance all over is
 * of none. */
bool kiln_aims_is_left(const struct kiln_aims *aims, size_t aim, uint32_t leaves);

/* The aim of a path of an iteration, path < aims->paths. */
size_t kiln_aims_find(const struct kiln_aims *aims, uint64_t path);
/* The same, quick where that is the aim of the path before. */
static inline size_t kiln_aims_find_next(const struct kiln_aims *aims, uint64_t path, size_t before)
{
    const bool same = before < aims->count && aims->first[before] <= path && path < aims->first[before + 1];
    return same ? before : kiln_aims_find(aims, path);
}

/* Number of an aim's paths, the first ones, that go evenly over the target's triangles. */
uint64_t kiln_aims_even(const struct kiln_aims *aims, size_t aim);

/* Draws the ray of path number k of an aim by random numbers in (0, 1): triangle, side (of it or of a box) or triangle
 * of the target, place (2), direction (2). False: it brings nothing. */
bool kiln_aims_draw(const struct kiln_aims *aims, size_t aim, uint64_t k, const double numbers[KILN_AIM_NUMBERS],
                    struct kiln_aimed_ray *ray);

/* Factor for the flux of an aim's ray that has met this world triangle first. 0: it does not count. */
double kiln_aims_met(const struct kiln_aims *aims, size_t aim, const struct kiln_aimed_ray *ray, uint32_t triangle);

/* How densely an iteration's paths that are aimed from the lamp of `light` at the target of a world triangle, and count
 * there, begin by this ray, which meets that triangle first: their numbers times the densities of kiln_aims_draw, per
 * m2 and steradian (of points per steradian, of directional lights per m2). `light` as in struct kiln_aimed_ray;
 * `place`: on an emitting triangle; `direction`: unit, from the light. 0 for triangles that are of no target. */
double kiln_aims_density(const struct kiln_aims *aims, uint32_t light, uint32_t triangle, struct kiln_dvec3 place,
                         struct kiln_dvec3 direction);

/* The target that a world triangle is of; KILN_NONE: none. */
static inline uint32_t kiln_aims_target(const struct kiln_aims *aims, uint32_t triangle)
{
    return aims->targets.of_triangle != NULL ? aims->targets.of_triangle[triangle] : KILN_NONE;
}

#endif
