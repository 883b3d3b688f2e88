/* The path pass: the radiance that pixels of a camera see, by path tracing. It reads no radiosity and no lightmap: it
 * is the reference for what views of a bake show.
 *
 * A camera with a lens blurs what does not lie at the distance that it is focused on; else the camera is a pinhole.
 *
 * A pixel is the mean over its paths (Kajiya, "The Rendering Equation", SIGGRAPH 1986). A path starts as a camera ray
 * through a place in the pixel and hits a first surface x0 with base colour c0. Its radiance is
 *
 *     L = Le(x0) + c0 / pi D(x0) + c0 w1 (albedo(x1) / pi D(x1) + albedo(x1) (albedo(x2) / pi D(x2) + ...))
 *
 * Le is what the surface emits towards the camera. D(x) is the direct irradiance. It has one sample of the light tree
 * (emitting triangles, points and spots, worker/light/lights.h), one of each directional light, and for an environment
 * image one sample by the cosine and one by luminance, combined by multiple importance sampling. A constant sky is
 * found by the rays that continue the path. These rays are cosine-distributed about the normal; the first one hits x1,
 * and so on for `bounces` surfaces after x0, without roulette. With KILN_PATH_ALL_BOUNCES paths have no last surface,
 * and end by chance (shaders/shared/path.h). `length` bounds the number of rays between light and camera, whatever
 * scatters them: 1 allows only Le, 2 also D.
 *
 * Where the scene's materials are taken with their gloss (kiln_scene_take_gloss), a glossy surface scatters light by
 * its whole material (shaders/shared/bsdf.h), about its shading normal. A random choice continues the path by the
 * diffuse part, which counts as a bounce, or by the other lobes, which does not. Direct light is D as above, with the
 * material in place of albedo / pi. Sharp lobes (kiln_path_sharp) are the exception: they see lamps and sky only if the
 * path hits them. Glass that bounds a body acts on both sides, and the body absorbs along the distance in it. Light
 * through glass is found by the path alone, since shadow rays do not bend. Thin smooth walls are not taken: they let
 * light straight through.
 *
 * Without gloss, the pass computes the light of a bake with the same number of bounces: surfaces are diffuse; D(x0) and
 * the direction to x1 are about the shading normal with the weights of the gather pass (gather.h; w1, whose mean is 1),
 * everything further about the geometric normal; a metal that the camera sees is shown by its base colour, and reflects
 * nothing else; materials have no normal maps. A ray that meets the back of a single-sided surface, or of a solid,
 * brings nothing. A surface that lets light through stops a ray with a probability equal to its opacity, else it tints
 * the ray; shadow rays are multiplied by all transmittances.
 *
 * Surfaces that scatter about their shading normal are x0 and glossy ones without glass. Their rays start above coarse
 * facets (shaders/shared/lift.h), and light in front of the shading normal counts even from below the facet.
 *
 * The camera sees what views of a bake show (coordinator/view/view.h): not the backs of single-sided surfaces, and not
 * objects that have no lightmap (KILN_OBJECT_CASTER_ONLY), unless they emit; camera rays go on behind these. A camera
 * ray that leaves the scene brings the environment.
 *
 * Items: pixels of the camera, row by row from the top, left to right. Result: struct kiln_path_result. Samples: paths
 * of a pixel. Rays: one a camera ray, and all others. */
#ifndef KILN_WORKER_PASS_PATH_H
#define KILN_WORKER_PASS_PATH_H

#include "shaders/shared/path.h"
#include "worker/pass/pass.h"

struct kiln_path_parameters {
    struct kiln_vec3 position; /* m, from the scene's centre */
    struct kiln_vec3 forward;  /* unit */
    /* half extents of the picture, from its middle to the right and upper edge: at distance 1; in metres if
     * orthographic */
    struct kiln_vec3 right, up;
    bool orthographic;      /* all rays go forward; else they start at `position`, or on a lens around it */
    float lens_radius;      /* m; 0: pinhole or orthographic camera */
    float focus_distance;   /* m along `forward` to the plane in focus; above 0 with a lens */
    uint32_t width, height; /* pixels */
    uint32_t bounces;       /* surfaces after the first; or KILN_PATH_ALL_BOUNCES */
    uint32_t length;        /* KILN_PATH_LENGTH_ANY, or the length of paths at most */
};

/* Sums over a pixel's paths. */
struct kiln_path_result {
    float radiance[3]; /* W/(m2 sr) */
    float square;      /* of the luminances' squares */
    uint32_t count;    /* paths */
};

/* Standard error of the mean luminance, W/(m2 sr). Computed as for independent paths, so it is an upper estimate. 0 for
 * fewer than two paths. */
double kiln_path_error(const struct kiln_path_result *result);

#endif
