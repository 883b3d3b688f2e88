/* Geometric details of surface points for output files: position, normal and coverage. They are computed again from the
 * pieces of surface when a file is written, so that they need no memory during the bake. Not collective, thread-safe.
 */
#ifndef KILN_COORDINATOR_OUTPUT_POINTS_H
#define KILN_COORDINATOR_OUTPUT_POINTS_H

#include "coordinator/field/result.h"

struct kiln_point_detail {
    uint32_t x, y;      /* texel in the object's lightmap */
    uint32_t leaf[3];   /* in an octree: integer grid coordinates of the leaf along x, y, z, from the leaves' origin */
    uint32_t triangle;  /* world triangle of its first piece */
    float coverage;     /* fraction of the texel's square that the layout covers, 0 to 1 */
    double position[3]; /* m, world: centroid of the covered part of the surface */
    float normal[3];    /* unit, world: mean shading normal there */
};

/* Computes the details of the points of this rank's tile run `tile_run`, in order. `details` has room for
 * KILN_TILE_TEXELS entries. Returns the number of points. */
uint32_t kiln_tile_run_details(const struct kiln_bake_result *result, size_t tile_run,
                               struct kiln_point_detail *details);

/* Transforms a normal by the inverse transpose of an object's matrix (worker/scene/scene.h). Returns a unit vector, or
 * the zero vector if the matrix or the normal is degenerate. */
struct kiln_dvec3 kiln_world_normal(const double m[12], struct kiln_dvec3 normal);

#endif
