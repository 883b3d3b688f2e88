/* A triangle in the coordinates of one texel of a lightmap, or of one leaf (worker/scene/leaves.h), and clipping it to
 * the texel or leaf. */
#ifndef KILN_WORKER_SCENE_TEXEL_H
#define KILN_WORKER_SCENE_TEXEL_H

#include <math.h>

#include "worker/scene/clip.h"
#include "worker/scene/leaves.h"

/* Grid position of a point's texel or leaf: column and row in the lightmap (or among leaves), and the layer of a leaf.
 */
struct kiln_texel_place {
    uint32_t x, y, layer;
    uint32_t shift; /* of the lightmap */
};

/* A triangle in coordinates relative to the lower corner of the texel or leaf, which is the square or cube 0..1. */
struct kiln_texel_triangle {
    double corner[3][2];
    double depth[3]; /* of leaves */
    bool layered;    /* leaves: the triangle is cut to depths 0..1 */
};

static inline void kiln_texel_triangle(const struct kiln_scene *scene, const struct kiln_geometry *geometry,
                                       uint32_t triangle, const struct kiln_texel_place *place,
                                       struct kiln_texel_triangle *to)
{
    double corner[3][2], leaf[3][3];
    to->layered = geometry->leaves != NULL;
    if (!to->layered) {
        kiln_geometry_map_corners(scene, geometry, triangle, place->shift, corner);
        kiln_clip_local(corner, place->x, place->y, to->corner);
        return;
    }
    kiln_leaf_corners(geometry, triangle, leaf);
    for (int c = 0; c < 3; c++) {
        to->corner[c][0] = leaf[c][0] - place->x;
        to->corner[c][1] = leaf[c][1] - place->y;
        to->depth[c] = leaf[c][2] - place->layer;
    }
}

/* Clips the triangle to the rectangle [x0, x1] x [y0, y1] of the texel or leaf by kiln_clip_triangle; for leaves also
 * to their range of depths. */
static inline uint32_t kiln_texel_clip(const struct kiln_texel_triangle *t, double x0, double y0, double x1, double y1,
                                       struct kiln_clip_corner polygon[KILN_CLIP_CORNERS])
{
    const uint32_t count = kiln_clip_triangle(t->corner, x0, y0, x1, y1, polygon);
    return t->layered && fabs(kiln_clip_twice_area(t->corner)) > 0.0 ? kiln_clip_depths(polygon, count, t->depth)
                                                                     : count;
}

#endif
