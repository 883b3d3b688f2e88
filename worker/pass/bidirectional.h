/* The bidirectional pass: the radiance that pixels of a camera see, by paths that begin at the camera and at the
 * lights.
 *
 * It computes the same light as the path pass (path.h, which defines the terms): same camera, lens, materials,
 * visibility rules, number of diffuse surfaces after the first and length of paths. One thing differs: caustics of
 * points, spots and directional lights are found here but not by the path pass, whose shadow rays do not bend.
 *
 * Sample k of a pixel is one path from the camera. Each sample also has as many light paths as the picture has pixels,
 * numbered over the whole picture: path i of sample k is a function of (seed, i, k) and the scene alone. Methods:
 *
 *   light       paths of light, of which each vertex is connected to the camera; the camera's rays see emission only
 *   bdpt        path i of light and that of pixel i, by all techniques that connect
 *               (shaders/shared/bidirectional_weights.h)
 *   vcm         the same, and vertices of all paths of light are merged with the camera path's
 *   vcm_single  the same, but only path i's vertices are merged
 *   ppm, sppm   photon mapping: the camera path goes on through mirrors and smooth glass, and its first other vertex is
 *               merged (Hachisuka and Jensen, "Stochastic Progressive Photon Mapping", SIGGRAPH Asia 2009).
 *               With ppm the camera's paths are those of sample 0 in every sample, with sppm new ones
 *
 * Light that reaches a facet from below (path.h) is found by camera paths alone. Light paths never arrive at a facet
 * from below, so techniques that need one have density 0. With the methods light, ppm and sppm such light is missing.
 *
 * A vertex is merged with those within the radius, which in sample k is `radius` (k + 1)^((alpha - 1) / 2), alpha 3/4
 * (Knaus and Zwicker, "Progressive Photon Mapping: A Probabilistic Approach", TOG 2011): merging blurs, less with each
 * sample. Embree adds vertices in a fixed order; Vulkan adds integers in the film's unit, whose sum does not depend on
 * order.
 *
 * A light vertex that the camera sees may fall into any pixel. Its light is added to `film`, which covers the whole
 * picture, in fixed point; so the sum does not depend on order, threads, or which pixels a rank computes. Light path i
 * adds to the film when item i is computed. Methods that merge have each caller trace all paths of light of the
 * picture, whatever its items are: on R ranks that part of the work is done R times.
 *
 * Items: pixels of the camera. Result: struct kiln_path_result; neither its radiance nor its squares include the film's
 * light. Samples: paths of a pixel. Memory: where there is merging, 64 bytes for each vertex of a sample's paths of
 * light, twice; on a device 136. */
#ifndef KILN_WORKER_PASS_BIDIRECTIONAL_H
#define KILN_WORKER_PASS_BIDIRECTIONAL_H

#include <math.h>

#include "worker/pass/path.h"

enum kiln_bidirectional_method {
    KILN_BIDIRECTIONAL_LIGHT,
    KILN_BIDIRECTIONAL_BDPT,
    KILN_BIDIRECTIONAL_VCM,
    KILN_BIDIRECTIONAL_VCM_SINGLE,
    KILN_BIDIRECTIONAL_PPM,
    KILN_BIDIRECTIONAL_SPPM
};

/* Film of the whole picture: three sums a pixel over its samples, in units of `unit` W/(m2 sr). The pass sets the unit,
 * which is a function of the scene, and adds to the sums. */
struct kiln_splat_film {
    int64_t *sums; /* lent */
    double unit;
};

struct kiln_bidirectional_parameters {
    struct kiln_path_parameters camera;
    enum kiln_bidirectional_method method;
    double radius; /* m: of merging in sample 0, > 0 with methods that merge */
    struct kiln_splat_film *film;
};

/* The radius of merging in sample k, m. */
static inline double kiln_merge_radius(double radius, uint32_t k)
{
    return radius * pow((double)k + 1.0, (0.75 - 1.0) / 2.0);
}

#endif
