/* Aims: where light paths begin, and at what they are aimed (worker/pass/land.h).
 *
 * Caustics are a small part of all light: most light of lamps and sky meets diffuse surfaces first. So paths are aimed
 * at *targets*: triangles of objects with materials that are taken with their gloss, within spheres and boxes
 * (targets.h). A *lamp* is an emitting object, a point or spot light, a directional light, a constant environment, or a
 * cell of an environment image (sky_cells.h). A pair of a lamp and a target is an aim; each aim gets consecutive paths
 * of an iteration, at least one. A path of an aim counts only if the first surface that it meets is its target's, so
 * every light path belongs to exactly one aim and has the density of this aim alone.
 *
 * Rays of a lamp are sent towards the target's bounding sphere (radius r, centre c), or towards its bounding box if its
 * solid angle is smaller:
 *
 *   emitting object     a triangle by its flux, a place on it by its area, then the cone about the sphere, or over the
 *                       box's solid angle, evenly; by the cosine over the hemisphere (of a two-sided triangle either)
 *                       where the cone is wide
 *   point, spot         the cone about the sphere, or the box, or the spot's own where that is narrower; all round from
 *                       within
 *   directional         a disc of radius r before the sphere, or what is seen of the box, from outside the scene
 *   environment         a direction of the cell by luminance, then likewise
 *
 * The first paths of an aim may instead be spread evenly over the target's triangles (targets.h): a triangle is picked
 * by its area, then a place on it, then a place on the lamp and the ray from there. Such a path counts only if the
 * triangle that it meets first is the one that was picked. So both kinds of paths can make the same ray, and each is
 * weighted by the sum of both densities (balance heuristic). The weight is known only after the first hit
 * (kiln_aims_met).
 *
 * Numbers of paths are proportional to weights: at first the estimated flux towards the target, later learnt values
 * (kiln_aims_weigh). Not collective; a pure function of scene, lights and weights. Read by several threads at once. */
#ifndef KILN_WORKER_LIGHT_AIMS_H
#define KILN_WORKER_LIGHT_AIMS_H

#include "shaders/shared/aimed_ray.h"
#include "worker/base/arena.h"
#include "worker/light/lights.h"
#include "worker/light/sky_cells.h"
#include "worker/light/targets.h"

struct kiln_aim {
    uint32_t lamp, target;
    double flux; /* estimated flux of the lamp towards the target, luminance, W */
    double even; /* fraction of paths spread evenly over the target's triangles; 0 for points, spots */
};

struct kiln_aims {
    const struct kiln_lights *lights; /* borrowed */
    size_t lamp_count, count;
    struct kiln_lamp *lamps;
    struct kiln_sky_cells sky; /* count 0: the environment is no image */
    struct kiln_targets targets;
    struct kiln_aim *aims; /* target by target of each lamp */
    double *until;         /* by emitting triangle: cumulative share of its lamp's flux, itself included */
    uint32_t *lamp_of;     /* lamp of each emitting triangle */
    uint64_t paths;        /* of an iteration; 0: kiln_aims_share was not called yet */
    uint64_t *first;       /* first path of each aim; `count` + 1 entries */
    struct kiln_dvec3 centre;
    double radius; /* of a sphere about the scene, m */
    struct kiln_arena arena;
};

enum { KILN_AIMS_MOST = 1 << 24, KILN_AIM_NUMBERS = 6 };

/* Creates all aims; `count` is 0 without lamps or without materials taken with their gloss. Objects are cut into
 * several targets while there are at most `most` aims. Borrows the lights. KILN_SYSTEM; KILN_USAGE for more than
 * KILN_AIMS_MOST aims. Destroy with kiln_aims_destroy. */
int kiln_aims_create(struct kiln_aims **aims, const struct kiln_lights *lights, size_t most, struct kiln_error *error);
void kiln_aims_destroy(struct kiln_aims **aims);

/* Distributes `paths` >= aims->count paths among the aims: one each, the others in proportion to `weights`, which are
 * not negative. NULL: in proportion to flux. */
void kiln_aims_share(struct kiln_aims *aims, uint64_t paths, const double *weights);

/* Computes weights from the results of earlier paths. `moments`: by aim, the sum of the squared contributions of its
 * paths, relative to the aim's flux; `paths`: their number. A weight proportional to the root of the mean square
 * minimises the variance. A tenth is by flux, so that aims whose light was not found yet keep paths. `even`: the
 * fraction of the weights that is the same for all aims. */
void kiln_aims_weigh(const struct kiln_aims *aims, const double *moments, const double *paths, double even,
                     double *weights);

/* Whether the aim's lamp is of one of the kinds in `leaves`, bits KILN_LEAVES_... (shaders/shared/streams.h). A
 * constant sky is of no kind. */
bool kiln_aims_is_left(const struct kiln_aims *aims, size_t aim, uint32_t leaves);

/* The aim of a path of an iteration, path < aims->paths. */
size_t kiln_aims_find(const struct kiln_aims *aims, uint64_t path);
/* As kiln_aims_find; fast if the path has the same aim as the path before it. */
static inline size_t kiln_aims_find_next(const struct kiln_aims *aims, uint64_t path, size_t before)
{
    const bool same = before < aims->count && aims->first[before] <= path && path < aims->first[before + 1];
    return same ? before : kiln_aims_find(aims, path);
}

/* Number of the aim's first paths that are spread evenly over the target's triangles. */
uint64_t kiln_aims_even(const struct kiln_aims *aims, size_t aim);

/* Draws the ray of path k of an aim from random numbers in (0, 1): triangle of the lamp; its side, side of the target's
 * box, or triangle of the target; place (2); direction (2). False: the path brings no light. */
bool kiln_aims_draw(const struct kiln_aims *aims, size_t aim, uint64_t k, const double numbers[KILN_AIM_NUMBERS],
                    struct kiln_aimed_ray *ray);

/* Factor for the flux of an aim's ray whose first hit is this world triangle. 0: the path does not count. */
double kiln_aims_met(const struct kiln_aims *aims, size_t aim, const struct kiln_aimed_ray *ray, uint32_t triangle);

/* Density with which all paths of an iteration begin by this ray, from the lamp of `light`, which hits the world
 * triangle first, and count there: the sum of each number of paths times the density of kiln_aims_draw. Per m2 and
 * steradian; for points per steradian, for directional lights per m2. `light` as in struct kiln_aimed_ray; `place`: on
 * an emitting triangle; `direction`: unit, from the light. 0 if the triangle belongs to no target. */
double kiln_aims_density(const struct kiln_aims *aims, uint32_t light, uint32_t triangle, struct kiln_dvec3 place,
                         struct kiln_dvec3 direction);

/* Target that a world triangle belongs to; KILN_NONE: none. */
static inline uint32_t kiln_aims_target(const struct kiln_aims *aims, uint32_t triangle)
{
    return aims->targets.of_triangle != NULL ? aims->targets.of_triangle[triangle] : KILN_NONE;
}

#endif
