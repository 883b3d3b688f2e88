/* Triangulation of polygons. Private to coordinator/import/obj*.c. */
#ifndef KILN_COORDINATOR_IMPORT_OBJ_POLYGON_H
#define KILN_COORDINATOR_IMPORT_OBJ_POLYGON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/base/vector.h"

/* Maximum number of corners of a concave face; a convex face may have any number. */
enum { OBJ_CONCAVE_MAX = 4096 };

struct obj_corner {
    uint32_t next, previous;
    bool reflex, ear;
};

/* Working memory for the largest polygon so far. Zero-initialise; release with obj_polygon_destroy. */
struct obj_polygon {
    struct kiln_dvec3 *points; /* the caller writes the corners here, after obj_polygon_room */
    double (*flat)[2];
    struct obj_corner *ring; /* linked ring of the corners that are not clipped yet */
    uint32_t *reflex;        /* the corners that were reflex at first */
    size_t reflex_count;
    uint32_t *triangles; /* the result: 3 (count - 2) corners, in the polygon's winding */
    size_t capacity;
};

int obj_polygon_room(struct obj_polygon *polygon, size_t count, struct kiln_error *error);
/* Triangulates the polygon of `count` (3 or more) points by ear clipping, in the plane of its area vector (Newell's
 * method). A convex quadrilateral is cut from its first corner, a concave one from its reflex corner. With more
 * corners, ears are searched from the first corner on, so that a convex polygon becomes a fan about its last corner. A
 * polygon without ears (it crosses itself) becomes a fan. Returns false if the polygon is not convex and has more than
 * OBJ_CONCAVE_MAX corners. Takes up to 2 x count x count steps for a concave polygon. A polygon with more corners that
 * winds about itself becomes a fan after 2 x OBJ_CONCAVE_MAX x OBJ_CONCAVE_MAX steps. */
bool obj_polygon_cut(struct obj_polygon *polygon, size_t count);
void obj_polygon_destroy(struct obj_polygon *polygon);

#endif
