/* Joints: borders at which the surface of one object continues in the surface of another. Joints and the seams of each
 * mesh (chart_graph.h) together are the adjacency of all lightmaps of a scene.
 *
 * A joint is the common part of two mesh edges of two objects with published lightmaps. At each edge its mesh must end
 * or fold (kiln_mesh_ends). Neither vertices nor lengths of the edges need to match. The conditions are:
 *   - the edges lie on one line. The tolerance is a sixteenth of a texel plus KILN_JOINT_GAP of the scene's extent, the
 *     gap that transforms in float leave; objects further apart do not touch;
 *   - the shading normals are alike (KILN_SEAM_COSINE) at both ends; the backs of an object have the normals of its
 *     front, reversed;
 *   - the triangles lie on opposite sides of the edge.
 * So two sides of an object, objects at an angle, and objects that lie upon each other have no joints. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_SEAMS_JOINTS_H
#define KILN_COORDINATOR_OUTPUT_MAP_SEAMS_JOINTS_H

#include "coordinator/output/map/charts/chart_graph.h"
#include "worker/scene/surface.h"

#define KILN_JOINT_GAP 0x1p-18

struct kiln_joint {
    uint32_t map[2];            /* lightmaps of side 0 and side 1, in ascending order */
    struct kiln_seam_edge edge; /* texel coordinates in these */
};

struct kiln_joints {
    size_t count;
    struct kiln_joint *joints; /* by the lightmaps of side 0, then by place in its mesh */
    size_t map_count;
    uint32_t *group; /* for each lightmap: the lowest number among the lightmaps joined to it, directly or through
                      * others. KILN_NONE: no joint */
};

/* Finds all joints. `extent` is the largest absolute coordinate in the scene, m from its centre. Reads only the global
 * arrays of the surface, so all ranks find the same joints, with any number of threads. Not collective. Takes time and
 * memory only where the bounding boxes of objects overlap. */
int kiln_joints_find(struct kiln_joints **joints, const struct kiln_scene *scene, const struct kiln_surface *surface,
                     double extent, struct kiln_error *error);
void kiln_joints_destroy(struct kiln_joints **joints);

#endif
