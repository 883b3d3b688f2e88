/* The directions pass: one bounce of light between surface points, the same as in the gather pass (gather.h), but with
 * rays in other directions than cosine-distributed ones (Kahl, "RTX Radiosity", 2023, section 5.4, and his future
 * work).
 *
 *     E(x) = mean over rays of  w B(hit(x, ray))
 *
 * Direction set: all points use the same directions, turned about each point's normal by a random angle for each
 * stream; w is the weight of the direction. The mean weight is 1, so a closed furnace is exact. A turn does not vary
 * the angle to the normal, so the mean over many streams keeps the error that the set itself has in that angle.
 *
 * Bright patches: the last n_b of n rays are aimed at places on patches, the others are cosine-distributed. The two are
 * combined by the balance heuristic (Veach and Guibas, "Optimally Combining Sampling Techniques for Monte Carlo
 * Rendering", SIGGRAPH 1995), so the mean is that of the gather pass:
 *
 *     w = 1 / (1 - s + s q / c),   s = n_b / n,  c = cos(x) / pi,  q = sum over k of  p(k) r(k)^2 / (A(k) cos(k))
 *
 * for a ray that meets a point of a cluster (below). The sum is over the patches k of this cluster whose parallelogram
 * (patches.h), enlarged by KILN_BRIGHT_SPREAD, is crossed by the ray at distance r(k); A(k) is its area. A ray to a
 * patch brings nothing if it meets a point of another cluster. Parallelograms are enlarged because those of partial
 * texels may lie askew; gaps between them would be found by cosine rays only.
 *
 * The brightness of a patch is its radiosity minus the mean over all area, because cosine rays find even light well
 * (Karlik et al., "MIS Compensation: Optimizing Sampling Techniques in Multiple Importance Sampling", SIGGRAPH Asia
 * 2019). Patches are grouped into clusters of up to 4 x 4 texels. A point's cluster chooses another cluster with weight
 * power cos cos / (pi r^2), bounded if the two are near or not flat, and then a patch in it by power. The sum of these
 * weights estimates the light of bright patches; s is the share of this light in the sum of it and of the rest of the
 * mean, rounded to 0, 1/8, 1/4 or 1/2.
 *
 * Items: tile runs. Result: struct kiln_point_result. Samples: rays of a point. Streams: as the gather pass. Rays: the
 * samples of all valid points. Devices leave scenes whose materials are taken with their gloss to Embree. */
#ifndef KILN_WORKER_PASS_DIRECTIONS_H
#define KILN_WORKER_PASS_DIRECTIONS_H

#include "worker/pass/patches.h"
#include "worker/sampling/direction_set.h"

#define KILN_NO_CLUSTER UINT32_MAX
#define KILN_BRIGHT_SPREAD 1.6 /* of a side; a square that is turned by 45 degrees then covers itself */

struct kiln_bright_cluster {
    struct kiln_vec3 centre, normal; /* m from the scene's centre; unit; weighted by area */
    float radius;                    /* m: bounding sphere of the patches' middles, about the centre */
    bool is_flat;                    /* all normals are the same */
    double power;                    /* W, luminance: brightness times area of its patches */
    uint32_t first, end;             /* of its points among `members` */
};

/* All arrays are borrowed. Arrays "of points" have an entry for each surface point, by global index. */
struct kiln_bright {
    const struct kiln_patch *points;
    const uint32_t *cluster_of; /* of points; KILN_NO_CLUSTER: none */
    const float *power;         /* of points, W: luminance of the brightness times the area */
    const uint32_t *members;    /* global indices */
    const struct kiln_bright_cluster *clusters;
    uint32_t count; /* of clusters */
    double rest;    /* W/m2: mean luminance of the rest of the radiosity */
};

struct kiln_directions_parameters {
    const struct kiln_direction *set; /* as many as samples; NULL: by the cosine */
    uint32_t set_count;
    const struct kiln_bright *bright; /* NULL: no rays to bright patches; not together with a set */
    const uint64_t *radiosity;        /* packed, of all surface points; NULL: what the backend has */
    double scale;                     /* of all radiosity */
};

#endif
