/* Spheres about the probes of an irradiance volume, in which the light paths of the land pass (land.h) leave light.
 *
 * Gather rays of a probe (probes.h) cannot find a lamp that has no size by way of a mirror or smooth glass, and hardly
 * a small one. Light paths can: of a path that carries the flux phi, in W, along a chord of length s of a sphere,
 * coming from direction w, the mean over the sphere's volume V gets (the track-length estimator of particle transport:
 * Spanier and Gelbard, "Monte Carlo Principles and Neutron Transport Problems", 1969)
 *
 *     L_lm += phi s / V  Y_lm(w),        E of an axis a += phi s / V  max(0, w.a)
 *
 * Who finds what. By the first event after the lamp: what lobes that are not sharp (kiln_path_sharp,
 * shaders/shared/path.h) send on is found by the samples of lights that chains of gather rays draw. What a sharp lobe
 * sends on is the light paths' of those kinds of lamps that `leaves` names, and found by rays that meet the lamp of the
 * others. A sky of one radiance all over is the rays'. So each way of light counts once. What lamps send straight to a
 * probe is not counted here: paths leave light from their first surface on.
 *
 * Sight. Only such places of a sphere count as its middle is seen from: a wall divides it. Of each chord one place is
 * drawn, and a ray from the middle says whether it counts; the volume V is that of all places that count, which are the
 * part of the sphere before what rays from the middle meet. So a probe beside a wall has the mean of its own side.
 *
 * What is kept are sums in whole numbers, which have no order: the same for any threads and ranks. */
#ifndef KILN_WORKER_PASS_SPHERES_H
#define KILN_WORKER_PASS_SPHERES_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/vector.h"
#include "worker/pass/sphere_cells.h"

/* Sums of one sphere: phi s times 9 harmonics, RGB for each, and times the 6 axes, in the order of struct
 * kiln_probe_result. */
enum { KILN_SPHERE_WEIGHTS = 9 + 6, KILN_SPHERE_SUMS = 3 * KILN_SPHERE_WEIGHTS };

/* `first` and `count` say which probes of the grid; then spheres, `clear` and cells are made for them. */
struct kiln_probe_spheres {
    /* the grid: the place of probe (0, 0, 0), m from the scene's centre. A probe lies within its box of the grid, and
     * its radius is half of the smallest spacing at most */
    double origin[3], spacing[3], radius; /* m; radius: the largest */
    uint32_t leaves;                      /* KILN_LEAVES_... (shaders/shared/streams.h) */
    uint64_t size[3];
    uint64_t first, count;            /* the probes that get light, in z-major order */
    const struct kiln_sphere *sphere; /* count; borrowed, like what follows */
    const float *clear;               /* m: within which of a sphere's middle nothing is (kiln_backend_clearance) */
    struct kiln_sphere_cells cells;
    double unit;    /* W m */
    uint64_t *sums; /* count x KILN_SPHERE_SUMS whole numbers of the unit, of either sign */
    /* of each aim: sums of the squares of luminance of phi x paths of the aim / flux of the aim, times s / (2 radius),
     * in 1 / KILN_SPHERE_MOMENT */
    uint64_t *moments;
};

#define KILN_SPHERE_MOMENT 65536.0
#define KILN_SPHERE_MOMENT_MOST 0x1p38 /* of one chord */

#endif
