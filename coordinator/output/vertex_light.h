/* Irradiance at vertices: for meshes whose light is to be interpolated over their triangles, without a lightmap.
 *
 * The values minimise, for each object, the integral over its surface of the squared difference between the light that
 * is interpolated from its vertices and the light E of its surface points (Kavan, Bargteil, Sloan, "Least Squares
 * Vertex Baking", EGSR 2011, equation 5):
 *
 *     minimise over e    integral (sum of e_i phi_i(x) - E(x))² dx  +  lambda sum over triangles A sum over edges (e_i
 * - e_j)²
 *
 * with phi_i the weight of vertex i, linear on triangles, and A a triangle's area. So the value of a vertex is not just
 * the light at its position, which would be too dark in corners and beside walls. The second term is small (lambda =
 * 1e-4); it gives light to vertices whose surface is buried. Vertices of a mesh with the same position and normal are
 * one unknown, so the light is continuous where the mesh was cut only for its lightmap. Negative values, which the
 * minimum may have beside sharp shadows, become 0. */
#ifndef KILN_COORDINATOR_OUTPUT_VERTEX_LIGHT_H
#define KILN_COORDINATOR_OUTPUT_VERTEX_LIGHT_H

#include "coordinator/field/result.h"
#include "worker/base/arena.h"

/* Irradiance at vertices: rank 0 has all vertices, other ranks none. */
struct kiln_vertex_light {
    size_t object_count;
    uint64_t *first;        /* object_count + 1: where an object's vertices begin, as its mesh has them */
    float (*irradiance)[3]; /* first[object_count] vertices, in the result's unit; fronts */
    /* object_count: root mean square difference between interpolated and points' luminance, over the mean luminance */
    float *error;
    struct kiln_arena arena;
};

/* Collective. The same bits for any number of ranks and threads. Release with kiln_vertex_light_release. KILN_SYSTEM;
 * KILN_STOPPED. */
int kiln_vertex_light_fit(struct kiln_vertex_light *light, const struct kiln_bake_result *result,
                          struct kiln_error *error);
void kiln_vertex_light_release(struct kiln_vertex_light *light);

#endif
