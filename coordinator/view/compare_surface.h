/* Two bakes of one scene at places on its surfaces, so that lightmaps of different sizes, or with other layouts, can be
 * compared.
 *
 * Places are spread evenly over an object's area: one in each of `count` equal parts of it, triangle by triangle. At
 * each, both lightmaps are read bilinearly, as an engine reads them. What comes out are two images of count x 1 texels
 * for kiln_compare_images; only its dssim has no meaning there. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_COMPARE_SURFACE_H
#define KILN_COORDINATOR_VIEW_COMPARE_SURFACE_H

#include "coordinator/output/image.h"
#include "worker/scene/scene.h"

/* One object of one bake. */
struct kiln_compared {
    const struct kiln_scene *scene;
    uint32_t object;
    const struct kiln_image *lightmap;
};

struct kiln_samples {
    /* R G B; validity.Y: of the texel that the place lies in; coverage.Y: the least of those that were read */
    struct kiln_image *a, *b;
    double (*positions)[3]; /* world, m */
    size_t count;
    double area; /* m2 of the object */
};

/* KILN_BAD_INPUT when the object is not the same in both (triangles and their corners; layout and lightmap may differ),
 * or a lightmap has no R, G, B. Release with kiln_samples_destroy. */
int kiln_samples_take(struct kiln_samples *samples, const struct kiln_compared *a, const struct kiln_compared *b,
                      size_t count, struct kiln_error *error);
void kiln_samples_destroy(struct kiln_samples *samples);

/* m2 in the world. */
double kiln_object_area(const struct kiln_scene *scene, uint32_t object);

#endif
