/* The directions pass: light that arrives at surface points from other surface points, one bounce, as the gather pass
 * (gather.h) finds it, by other directions than those drawn by the cosine (Kahl, "RTX Radiosity", 2023, section 5.4,
 * and his future work).
 *
 *     E(x) = mean over rays of  w B(hit(x, ray))
 *
 * By a set, the same for all points, turned about each point's normal by an angle that chance gives it for each stream:
 * w is the weight of the direction. Weights come to 1 in the mean, so a closed furnace is exact. What is the same all
 * about the normal a turn does not spread: the mean over many streams is off by what the set itself is off by.
 *
 * To bright patches: of n rays the last n_b go to places of patches, and the others are drawn by the cosine. The two
 * are combined by the balance heuristic (Veach and Guibas, "Optimally Combining Sampling Techniques for Monte Carlo
 * Rendering", SIGGRAPH 1995), so the mean is that of the gather pass:
 *
 *     w = 1 / (1 - s + s q / c),   s = n_b / n,  c = cos(x) / pi,  q = sum over k of  p(k) r(k)^2 / (A(k) cos(k))
 *
 * for a ray that meets a point of a cluster (below), over the patches k of that cluster whose parallelogram
 * (patches.h), drawn out by KILN_BRIGHT_SPREAD, the ray crosses at distance r(k); A(k) is its area. A ray to a patch
 * brings nothing if it meets a point of another cluster. Parallelograms are drawn out because those of texels that are
 * no square of one triangle may lie askew, and what they leave bare only the cosine would find.
 *
 * A patch is bright by as much as its radiosity is above the mean over all area, for what is even the cosine finds well
 * (Karlik et al., "MIS Compensation: Optimizing Sampling Techniques in Multiple Importance Sampling", SIGGRAPH Asia
 * 2019). Patches stand in clusters of up to 4 x 4 texels. A point's cluster chooses another by
 * power cos cos / (pi r^2), which is bounded where they are near or not flat, and in that a patch by power. The sum of
 * these is about the light that bright patches bring; s is its share in that and in what is left of the mean, rounded
 * to 0, 1/8, 1/4 or 1/2.
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
    float radius;                    /* m: of a sphere about the centre that has all patches' middles */
    bool is_flat;                    /* all normals are the same */
    double power;                    /* W, by luminance, of what is bright of its patches */
    uint32_t first, end;             /* of its points among `members` */
};

/* All arrays are borrowed; those of points are of all surface points, by global index. */
struct kiln_bright {
    const struct kiln_patch *points;
    const uint32_t *cluster_of; /* of points; KILN_NO_CLUSTER: none */
    const float *power;         /* of points, W: what is bright, by luminance, times the area */
    const uint32_t *members;    /* global indices */
    const struct kiln_bright_cluster *clusters;
    uint32_t count; /* of clusters */
    double rest;    /* W/m2: mean luminance of what is not bright */
};

struct kiln_directions_parameters {
    const struct kiln_direction *set; /* as many as samples; NULL: by the cosine */
    uint32_t set_count;
    const struct kiln_bright *bright; /* NULL: no rays to bright patches; not together with a set */
    const uint64_t *radiosity;        /* packed, of all surface points; NULL: what the backend has */
    double scale;                     /* of all radiosity */
};

#endif
