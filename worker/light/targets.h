/* Targets: groups of glossy triangles that light paths are aimed at (worker/light/aims.h).
 *
 * The triangles of objects with materials that are taken with their gloss are grouped into targets: at first one an
 * object, then large ones are cut. Many rays miss triangles that fill little of their box, such as wire frames or
 * scattered pieces. A cut is at the median of the triangles' centres, along the axis that leaves the smallest boxes.
 * The largest target is cut next, until `most` is reached or none can be cut. Cuts without a gain are then undone, so
 * that a shape that fills its sphere stays one target. Each target has a sphere and a box about its triangles, with
 * some slack for rounding. Rays are sent through the one with the smaller solid angle.
 *
 * On coarse meshes smooth normals lean far from the geometric ones. There some of a target's rays are spread evenly
 * over its triangles: a triangle seen edge on has a small solid angle but may send on much light (worker/NOTES.md).
 *
 * Not collective; a pure function of scene and `most`. Read by several threads at once. */
#ifndef KILN_WORKER_LIGHT_TARGETS_H
#define KILN_WORKER_LIGHT_TARGETS_H

#include "shaders/shared/spherical_triangle.h"
#include "shaders/shared/targets.h"
#include "worker/base/arena.h"
#include "worker/light/lights.h"

struct kiln_targets {
    size_t count;
    struct kiln_target *all; /* object by object */
    uint32_t *of_triangle;   /* target of each world triangle; KILN_NONE: none. NULL if count is 0 */
    size_t listed;           /* triangles of targets whose `even` is not 0, target by target */
    uint32_t *triangles;
    double *until; /* by listed triangle: cumulative share of its target's area, itself included */
    struct kiln_arena arena;
};

/* Objects are cut as long as there are at most `most` targets. KILN_SYSTEM. Release with kiln_targets_release, also
 * after an error. */
int kiln_targets_create(struct kiln_targets *targets, const struct kiln_lights *lights, size_t most,
                        struct kiln_error *error);
void kiln_targets_release(struct kiln_targets *targets);

/* ---- targets seen from afar: shaders/shared/targets.h ---- */

/* Mean over all directions of the projected area kiln_target_outline, m2. */
double kiln_target_mean_outline(const struct kiln_target *target);

/* Picks a triangle by area with `pick` in (0, 1), from a target whose `even` is not 0. */
uint32_t kiln_targets_pick(const struct kiln_targets *targets, const struct kiln_target *target, double pick);

/* ---- targets seen from a place ---- */

enum { KILN_BOX_PARTS = 6 };

/* The sides of a target's box that are visible from a place, as triangles. */
struct kiln_box_seen {
    double omega; /* sr, of all */
    size_t count;
    struct kiln_spherical_triangle parts[KILN_BOX_PARTS];
};

/* Finds the visible sides of a target's box. Returns true if their solid angle is below `most` sr. False also inside
 * the box, and where it is so far or so near that the solid angle has no accurate digits. */
bool kiln_target_see_box(const struct kiln_target *target, struct kiln_dvec3 from, double most,
                         struct kiln_box_seen *seen);

/* Draws a unit direction to the box, uniform in solid angle. */
struct kiln_dvec3 kiln_box_direction(const struct kiln_box_seen *seen, double pick, double u, double v);

#endif
