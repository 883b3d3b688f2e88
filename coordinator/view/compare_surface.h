/* Comparison of two bakes of one scene at sample points on its surfaces, for lightmaps of different sizes or layouts.
 *
 * The sample points of an object are spread evenly over its area: the triangles in order are divided into `count` parts
 * of equal area, and each part gets one point. At each point both lightmaps are read bilinearly, as an engine reads
 * them. The result is two images of count x 1 texels for kiln_compare_images, whose dssim has no meaning then. Nothing
 * here is collective. */
#ifndef KILN_COORDINATOR_VIEW_COMPARE_SURFACE_H
#define KILN_COORDINATOR_VIEW_COMPARE_SURFACE_H

#include "coordinator/output/image.h"
#include "worker/scene/scene.h"

/* An object of a bake. */
struct kiln_compared {
    const struct kiln_scene *scene;
    uint32_t object;
    const struct kiln_image *lightmap;
};

struct kiln_samples {
    /* channels R G B; validity.Y, of the texel that contains the point; coverage.Y, the least of the texels that were
     * read */
    struct kiln_image *a, *b;
    double (*positions)[3]; /* of the sample points, world, m */
    size_t count;
    double area; /* of the object, m2 */
};

/* Samples both lightmaps of an object. KILN_BAD_INPUT if the object differs between the bakes (its triangles and their
 * corners; layout and lightmap may differ), or if a lightmap has no R, G, B. Release with kiln_samples_destroy. */
int kiln_samples_take(struct kiln_samples *samples, const struct kiln_compared *a, const struct kiln_compared *b,
                      size_t count, struct kiln_error *error);
void kiln_samples_destroy(struct kiln_samples *samples);

/* Area of the object in the world, m2. */
double kiln_object_area(const struct kiln_scene *scene, uint32_t object);

#endif
