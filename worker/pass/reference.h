/* The reference pass: all indirect light of surface points, by path tracing from each point. It reads no radiosity, and
 * so serves as the reference for bakes that gather radiosity.
 *
 *     E(x) = integral over the hemisphere of L(x, w) n.w dw
 *
 * where L is the radiance that surfaces send. Unscattered light of lamps and sky is excluded; it belongs to the direct
 * pass (direct.h). Rays leave points as in the gather pass (gather.h), with its places, directions and weights. From
 * its first hit a path goes on as a camera path does (path.h). The same rules hold for backs, for surfaces that let
 * light through, and for materials with gloss; every surface is treated like the surfaces after a camera path's first.
 * Methods:
 *
 *   path   lights are sampled at each surface, and met by sharp lobes; on Vulkan by all lobes, weighed by the balance
 *          heuristic: the same light by another estimator
 *   bdpt   a path of light goes with each sample of a point, a function of (seed, point, sample); the point's path and
 *          that are connected in all ways (bidirectional_weights.h), the point itself too. Nothing lands on the point
 *   vcm    the same, and the vertices of as many paths of light as the scene has surface points (2^14 to 2^18) are
 *          merged with those of the point's path, and with the point itself: biased by the radius. Each quarter of the
 *          samples has such paths of its own, numbered over the whole bake, and the k-th quarter's radius is
 *          `radius` (k + 1)^(-1/8), quarters counted over all parts of a bake. Every caller traces them all, whatever
 *          its items are
 *
 * Bounces are counted as in a bake: light counts if it was scattered by at most `bounces` diffuse surfaces, before or
 * after mirrors, gloss and glass. Caustics straight from lamps involve no bounce, and always count.
 *
 * Light of a lamp without size that reaches a point by a mirror is found by merging only; on points of mirrors, where
 * nothing is merged, it is missing.
 *
 * Items: tile runs. Result: struct kiln_reference_result. Samples: rays of a point. Streams: as the gather pass, but a
 * stream has other random numbers here. Rays: the samples of all valid points, and all rays of their paths, but not
 * those of merged light paths. Memory of vcm: 64 bytes for each vertex of the paths of light of four quarters, and once
 * more for those of one; with 2^18 paths of six vertices 0.5 GiB, of which `kiln plan` knows nothing. On a device: only
 * the light paths of one quarter, 76 and 52 bytes a vertex, traced again for each batch.
 *
 * On both backends bdpt and vcm follow the same paths by the same random numbers. Embree adds up in the order of a
 * point's samples and photons. Vulkan adds integers within a sample, so that order does not matter, and then adds
 * samples in order, each for all points at once. */
#ifndef KILN_WORKER_PASS_REFERENCE_H
#define KILN_WORKER_PASS_REFERENCE_H

#include <math.h>

#include "worker/pass/path.h"
#include "worker/pass/point.h"

enum { KILN_REFERENCE_STREAM = 0x30000 }; /* added to the stream, which is below 0x10000 */

enum kiln_reference_method { KILN_REFERENCE_PATH, KILN_REFERENCE_BDPT, KILN_REFERENCE_VCM };

struct kiln_reference_parameters {
    enum kiln_reference_method method;
    uint32_t bounces; /* diffuse surfaces on the way of light; or KILN_PATH_ALL_BOUNCES */
    /* m, radius of merging in the first quarter of the samples. In a job 0 means kiln_reference_radius; with vcm the
     * pass needs a value above 0. */
    double radius;
};

/* Number of light paths to merge, for a scene with this number of surface points. */
static inline uint64_t kiln_reference_paths(uint64_t points)
{
    const uint64_t least = 1 << 14, most = 1 << 18;
    return points < least ? least : points > most ? most : points;
}

/* Default radius of merging, m: such that as many discs as there are light paths have the total area of all texels of
 * width `texel`, m; but at most one texel. `points`: of the whole scene, so that all ranks get the same. */
static inline double kiln_reference_radius(double texel, uint64_t points)
{
    return texel * fmin(1.0, sqrt((double)points / (KILN_PI * (double)kiln_reference_paths(points))));
}

struct kiln_reference_result {
    struct kiln_point_result point; /* as in the gather pass; `escaped` etc.: of rays to the next diffuse parts */
    float last[3];                  /* part of point.incident that left exactly `bounces` diffuse surfaces */
};

#endif
