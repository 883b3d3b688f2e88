/* Targets: what light paths are aimed at (worker/light/aims.h).
 *
 * The triangles of objects with materials that are taken with their gloss are parted among targets: at first one an
 * object, then large ones are cut. Where the box of a target's triangles is large, less of what is sent towards it
 * meets them: frames of wire, and what lies in several places. A cut is at the middle of the triangles' centres along
 * the axis that leaves the least of a box; the largest target is cut next, until there are as many as may be or none
 * can be cut; then cuts are taken back that did not pay, so that what fills its sphere stays whole. Each target has a
 * sphere and a box about its triangles, with some slack for rounding. Rays are sent through whichever is seen smaller.
 *
 * Where smooth normals lean far from the true ones, because triangles are few, a part of a target's rays is sent evenly
 * over its triangles: what little is seen of one that is met edge on may bring much light (worker/NOTES.md).
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
    uint32_t *of_triangle;   /* of each world triangle its target; KILN_NONE: it is of none. NULL where count is 0 */
    size_t listed;           /* triangles of targets whose `even` is not 0, target by target */
    uint32_t *triangles;
    double *until; /* of each the share of its target's area up to its end */
    struct kiln_arena arena;
};

/* Objects are cut as long as there are at most `most` targets. KILN_SYSTEM. Release with kiln_targets_release, also
 * after an error. */
int kiln_targets_create(struct kiln_targets *targets, const struct kiln_lights *lights, size_t most,
                        struct kiln_error *error);
void kiln_targets_release(struct kiln_targets *targets);

/* ---- from afar: shaders/shared/targets.h ---- */

/* m2: kiln_target_outline from anywhere, the mean. */
double kiln_target_mean_outline(const struct kiln_target *target);

/* The triangle of a target whose `even` is not 0 that `pick`, in (0, 1), falls to, by area. */
uint32_t kiln_targets_pick(const struct kiln_targets *targets, const struct kiln_target *target, double pick);

/* ---- from a place ---- */

enum { KILN_BOX_PARTS = 6 };

/* The sides of a box that a place sees, as triangles. */
struct kiln_box_seen {
    double omega; /* sr, of all */
    size_t count;
    struct kiln_spherical_triangle parts[KILN_BOX_PARTS];
};

/* Whether the box is seen from there under less than `most` sr. Not from within, nor where it is so far, or so near,
 * that its solid angle has no digits left. */
bool kiln_target_see_box(const struct kiln_target *target, struct kiln_dvec3 from, double most,
                         struct kiln_box_seen *seen);

/* A direction to the box, unit, even in solid angle. */
struct kiln_dvec3 kiln_box_direction(const struct kiln_box_seen *seen, double pick, double u, double v);

#endif
