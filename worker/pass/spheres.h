/* Spheres about the probes of an irradiance volume, in which the light paths of the land pass (land.h) leave light.
 *
 * Gather rays of a probe (probes.h) cannot reach a lamp without size by a mirror or smooth glass, and rarely reach a
 * small one. Light paths can. If a path with flux phi, in W, crosses a sphere along a chord of length s, coming from
 * direction w, it adds to the mean over the sphere's volume V (the track-length estimator of particle transport:
 * Spanier and Gelbard, "Monte Carlo Principles and Neutron Transport Problems", 1969)
 *
 *     L_lm += phi s / V  Y_lm(w),        E of an axis a += phi s / V  max(0, w.a)
 *
 * Division of light, by the first scattering event after the lamp. Lobes that are not sharp (kiln_path_sharp,
 * shaders/shared/path.h): chains of gather rays find the light by sampling lights. Sharp lobes: light paths find the
 * light of the kinds of lamps in `leaves`; for other lamps, and for a constant sky, chains find it by hitting the lamp.
 * So each light path counts once. Unscattered light of lamps is not counted here: paths add light to spheres from their
 * first surface on.
 *
 * Visibility. Only the part of a sphere that is visible from its middle counts, as walls may divide the sphere. On each
 * chord one place is drawn, and a ray from the middle decides whether the chord counts. V is the volume of the visible
 * part, measured by rays from the middle. So a probe beside a wall gets the mean of its own side.
 *
 * Sums are integers, so they do not depend on order, threads or ranks. */
#ifndef KILN_WORKER_PASS_SPHERES_H
#define KILN_WORKER_PASS_SPHERES_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/vector.h"
#include "worker/pass/sphere_cells.h"

/* Sums of one sphere: phi s times 9 harmonics, RGB for each, and times the 6 axes, in the order of struct
 * kiln_probe_result. */
enum { KILN_SPHERE_WEIGHTS = 9 + 6, KILN_SPHERE_SUMS = 3 * KILN_SPHERE_WEIGHTS };

/* Spheres of the probes [first, first + count) of a grid. Set these two first; `sphere`, `clear` and `cells` are then
 * made for them. */
struct kiln_probe_spheres {
    /* the grid; origin: the place of probe (0, 0, 0), m from the scene's centre. A probe lies within its box of the
     * grid. A sphere's radius is at most half of the smallest spacing */
    double origin[3], spacing[3], radius; /* m; radius: the largest */
    uint32_t leaves;                      /* kinds of lamps: KILN_LEAVES_... (shaders/shared/streams.h) */
    uint64_t size[3];
    uint64_t first, count;            /* the probes that get light, in z-major order */
    const struct kiln_sphere *sphere; /* count; borrowed, like what follows */
    const float *clear;               /* m: no surface is nearer to a sphere's middle (kiln_backend_clearance) */
    struct kiln_sphere_cells cells;
    double unit;    /* W m */
    uint64_t *sums; /* count x KILN_SPHERE_SUMS whole numbers of the unit, of either sign */
    /* by aim: sum of squares of [luminance of phi x paths of the aim / flux of the aim x s / (2 radius)], in units of
     * 1 / KILN_SPHERE_MOMENT */
    uint64_t *moments;
};

#define KILN_SPHERE_MOMENT 65536.0
#define KILN_SPHERE_MOMENT_MOST 0x1p38 /* of one chord */

#endif
