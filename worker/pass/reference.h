/* The reference pass: all light that surface points get but what comes straight from the lights, by paths from each
 * point. It reads no radiosity: it is what a bake that gathers radiosity is held against.
 *
 *     E(x) = integral over the hemisphere of L(x, w) n.w dw
 *
 * where L is the radiance that surfaces send, of lights that lie on no straight way from x. What comes straight is the
 * direct pass's (direct.h). Rays leave points as in the gather pass (gather.h), with its places, directions and
 * weights. Of where a ray meets a surface a path goes on, as those of cameras do (path.h): of the rules for backs, for
 * surfaces that let light through, and for materials with gloss all of what stands there holds here, and all surfaces
 * count as they do for rays that bounce. Methods:
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
 * Bounces are counted as a bake does: light that has left `bounces` diffuse surfaces on its way is the last that
 * counts, be they before or after mirrors, gloss and glass. So what comes from lamps by way of these alone is no
 * bounce, and is always there.
 *
 * Light that comes to a point by a mirror from a lamp without size is found by merging alone, and not on points of
 * mirrors, where nothing is merged.
 *
 * Items: tile runs. Result: struct kiln_reference_result. Samples: rays of a point. Streams: as the gather pass, and
 * other numbers than that has for the same stream. Rays: the samples of all valid points, and all of their paths;
 * not those of paths of light that are merged.
 * Memory of vcm: 64 bytes for each vertex of the paths of light of four quarters, and once more for those of one; with
 * 2^18 paths of six vertices 0.5 GiB, of which `kiln plan` knows nothing. On a device those of one quarter, 76 and 52
 * bytes a vertex, traced again for each batch.
 *
 * On both backends bdpt and vcm follow the same paths by the same random numbers. Embree adds up in the order of a
 * point's samples and photons; Vulkan in whole units within a sample, whose sums have no order, and then in the order
 * of the samples, one of all points after the other. */
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
    /* m, of merging in the first quarter of the samples; 0 in a job: kiln_reference_radius. The pass wants it above 0
     * with vcm */
    double radius;
};

/* Paths of light that are merged, of a scene with so many surface points. */
static inline uint64_t kiln_reference_paths(uint64_t points)
{
    const uint64_t least = 1 << 14, most = 1 << 18;
    return points < least ? least : points > most ? most : points;
}

/* The radius of merging where none is given, m: as many discs as there are paths cover so many texels of the width
 * `texel`, m, once; but at most one texel. Of all points, so that all ranks have the same. */
static inline double kiln_reference_radius(double texel, uint64_t points)
{
    return texel * fmin(1.0, sqrt((double)points / (KILN_PI * (double)kiln_reference_paths(points))));
}

struct kiln_reference_result {
    struct kiln_point_result point; /* as of the gather pass; `escaped` and so on: of rays to the next diffuse parts */
    float last[3];                  /* what of point.incident has left `bounces` diffuse surfaces */
};

#endif
