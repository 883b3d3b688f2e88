/* The path pass: the radiance that pixels of a camera see, by path tracing. It reads no radiosity and no lightmap: it
 * is the reference for what views of a bake show.
 *
 * A camera with a lens blurs what does not lie at the distance that it is focused on; else the camera is a pinhole.
 *
 * A pixel is the mean over its paths (Kajiya, "The Rendering Equation", SIGGRAPH 1986). A path begins as a camera ray
 * through a place in the pixel, and meets a first surface x0 with base colour c0. It brings
 *
 *     L = Le(x0) + c0 / pi D(x0) + c0 w1 (albedo(x1) / pi D(x1) + albedo(x1) (albedo(x2) / pi D(x2) + ...))
 *
 * Le is what the surface emits towards the camera. D(x) is the irradiance straight from the lights, by one sample of
 * all emitting triangles, points and spots, of which a tree chooses one (worker/light/lights.h), one of each
 * directional light, and of an environment with an image one by the cosine and one by its luminance, weighted against
 * each other. A sky of one radiance all over is met by the rays that go on. These are cosine-distributed about the
 * normal, x1 is what the first of them meets, and so on for `bounces` surfaces after x0, none of which is left to
 * chance. With KILN_PATH_ALL_BOUNCES paths have no last surface, and end by chance (shaders/shared/path.h). `length`
 * bounds the rays of a path from light to camera, whatever sends it on: with 1 only Le comes, with 2 also D.
 *
 * Where the scene's materials are taken with their gloss (kiln_scene_take_gloss), a surface that has any scatters light
 * by its whole material (shaders/shared/bsdf.h), about its shading normal. Chance chooses whether its diffuse part
 * sends the path on, which is a bounce, or its other lobes do, which is none. What lamps and sky send straight comes by
 * D as above, with the material in place of albedo / pi, but for sharp lobes (kiln_path_sharp): of these it is what the
 * path meets. Glass that bounds a body has both sides, and what the body absorbs is taken by the length of the way in
 * it; light that glass lets through comes by the path alone, for shadow rays do not bend. Thin smooth walls are not
 * taken: they let light straight through.
 *
 * Else it is the light that a bake with so many bounces gives: surfaces are diffuse; D(x0) and the direction to x1 are
 * about the shading normal with the weights of the gather pass (gather.h; w1, whose mean is 1), everything further
 * about the geometric normal; a metal that the camera sees is shown by its base colour, and reflects nothing else;
 * materials have no normal maps. A ray that meets the back of a single-sided surface, or of a solid's, brings nothing.
 * A ray meets a surface that lets light through with a chance that is its opacity, and is tinted by those that it
 * passes; shadow rays take the product of what they let through.
 *
 * Where a surface scatters light about its shading normal, x0 or one with gloss but no glass, its rays begin above
 * coarse facets (shaders/shared/lift.h), and light counts that the shading normal faces, be it from below the facet.
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
    /* from the picture's middle to its right and its upper edge: at distance 1; in metres when orthographic */
    struct kiln_vec3 right, up;
    bool orthographic;      /* all rays go forward; else they start at `position`, or on a lens around it */
    float lens_radius;      /* m; 0: a pinhole, and of orthographic ones */
    float focus_distance;   /* m along `forward`: what is there is sharp; above 0 with a lens */
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

/* Standard error of the mean luminance, W/(m2 sr), as if the paths were independent: they are better. 0 for fewer than
 * two. */
double kiln_path_error(const struct kiln_path_result *result);

#endif
