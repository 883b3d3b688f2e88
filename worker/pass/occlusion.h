/* The occlusion pass: ambient occlusion and bent normals of surface points.
 *
 *     A(x) = integral over the hemisphere of V(x, w) (n.w / pi) dw        ambient occlusion, as the share that is open
 *     D(x) = integral over the hemisphere of V(x, w) w (n.w / pi) dw      its direction: D / |D| is the bent normal
 *
 * with n the shading normal and V(x, w) = 1 where a ray from x in direction w meets nothing within `distance`, else 0
 * (Zhukov, Iones and Kronin, "An Ambient Light Illumination Model", Eurographics Workshop on Rendering 1998; Landis,
 * "Production-Ready Global Illumination", SIGGRAPH 2002 course 16, for the bent normal). Directions below the geometric
 * surface are not open. A surface that lets light through is met with a chance that is its opacity; the backs of
 * surfaces close the hemisphere as their fronts do.
 *
 * Samples are drawn as in the gather pass (gather.h): places are uniform over the present part of the texel, directions
 * are in strata that the texels of a tile share.
 *
 * Items: tile runs. Result: struct kiln_occlusion_result, all zeros for a point that is not valid. Samples: rays of a
 * point. Rays: the samples of all valid points. */
#ifndef KILN_WORKER_PASS_OCCLUSION_H
#define KILN_WORKER_PASS_OCCLUSION_H

#include "worker/pass/pass.h"

struct kiln_occlusion_parameters {
    double distance; /* m, above 0: what is farther away does not count; INFINITY: everything counts */
};

/* Sums over a point's samples; kiln_mean of each gives A and D. */
struct kiln_occlusion_result {
    float open;         /* number of rays that meet nothing, 0 to count */
    float direction[3]; /* their directions added up, world; its length is 0 to count */
    /* standard error of `open`, from the spread over the four quarters of the samples; near low walls it may be half of
     * the true error */
    float error;
    uint32_t count; /* samples */
};

#endif
