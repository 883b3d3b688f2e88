/* Comparison of two bakes of one scene on its surfaces, for lightmaps of different sizes or layouts: at sample points,
 * or at the texels of one of them.
 *
 * The sample points of an object are spread evenly over its area: the triangles in order are divided into `count` parts
 * of equal area, and each part gets one point. At each point lightmaps are read bilinearly, as an engine reads them,
 * and octrees by compare_leaves.h. The result is two images of count x 1 texels for kiln_compare_images; their dssim is
 * meaningless. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_COMPARE_SURFACE_H
#define KILN_COORDINATOR_VIEW_COMPARE_SURFACE_H

#include "coordinator/output/image.h"
#include "coordinator/view/compare_leaves.h"
#include "worker/scene/scene.h"

/* An object of a bake. */
struct kiln_compared {
    const struct kiln_scene *scene;
    uint32_t object;
    const struct kiln_image *lightmap;         /* NULL: its light is in leaves */
    const struct kiln_compared_leaves *leaves; /* NULL: its light is in a lightmap */
};

struct kiln_samples {
    /* channels R G B; validity.Y of the texel that contains the point; coverage.Y, the minimum over the texels read */
    struct kiln_image *a, *b;
    double (*positions)[3]; /* of the sample points, world, m */
    size_t count;
    double area; /* of the object, m2 */
};

/* Samples the light of an object in both bakes. KILN_BAD_INPUT if the object differs between the bakes (its triangles
 * and their corners; layout and lightmap may differ), or if a lightmap has no R, G, B. Release with
 * kiln_samples_destroy. */
int kiln_samples_take(struct kiln_samples *samples, const struct kiln_compared *a, const struct kiln_compared *b,
                      size_t count, struct kiln_error *error);
void kiln_samples_destroy(struct kiln_samples *samples);

/* Differences of two lightmaps, a and b, of an object, over those texels of b whose centres lie on the object and that
 * are buried in neither bake. Lightmap a is read bilinearly at these centres, so lightmaps of equal size and layout are
 * compared texel by texel. Texels are weighted by their area on the surface. */
enum { KILN_LAYERS = 3 }; /* all light, direct, indirect */
struct kiln_texel_sums {
    uint64_t texels, not_finite; /* compared; left out because a value is NaN or infinite */
    double area;                 /* m2 */
    double reference;            /* sum of area times all light in b, over R, G, B */
    double squares[KILN_LAYERS]; /* sums of area times (a - b)^2, over R, G, B */
};

/* Adds the texels of an object, whose light is in lightmaps in both. KILN_BAD_INPUT as kiln_samples_take. */
int kiln_texels_add(struct kiln_texel_sums *sums, const struct kiln_compared *a, const struct kiln_compared *b,
                    struct kiln_error *error);

/* Area of the object in the world, m2. */
double kiln_object_area(const struct kiln_scene *scene, uint32_t object);

#endif
