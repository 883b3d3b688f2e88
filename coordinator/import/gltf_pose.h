/* Poses of meshes: the positions of vertices under skins and morph targets. Private to coordinator/import/gltf*.c.
 *
 * With a skin, a vertex is at sum of w_i J_i B_i p, with its weights w_i (normalised to sum 1), the world transforms
 * J_i of its joints and their inverse bind matrices B_i; the transform of the mesh's own node is ignored (glTF 2.0,
 * 3.7.3.3). A normal is transformed by the inverse transpose of the blended matrix. Before the skin, morph targets
 * displace the vertex by sum of weight x displacement. */
#ifndef KILN_COORDINATOR_IMPORT_GLTF_POSE_H
#define KILN_COORDINATOR_IMPORT_GLTF_POSE_H

#include "coordinator/import/gltf_document.h"

enum { GLTF_JOINT_SETS = 2 }; /* JOINTS_0, JOINTS_1: eight joints for a vertex */

/* The pose of a mesh on one node. Zeros: the mesh as its file has it. */
struct gltf_pose {
    double (*joints)[12]; /* of its skin, joint x inverse bind matrix, row-major 3 x 4; owned; NULL: no skin */
    size_t joint_count;
    double node[12];  /* the node's transform, for primitives of a skinned node that have no joints */
    double origin[3]; /* m, world; subtracted from skinned positions, so that floats hold them */
    double *weights;  /* of morph targets; owned; NULL: none */
    size_t weight_count;
    bool own; /* the weights are the node's own, not those of the mesh */
};

/* Data of a primitive for a pose; NULL where absent. */
struct gltf_posed {
    const struct gltf_accessor *joints[GLTF_JOINT_SETS], *weights[GLTF_JOINT_SETS];
    struct gltf_morph {
        const struct gltf_accessor *position, *normal;
        double weight;
    } * morphs; /* morph targets of nonzero weight; owned */
    size_t morph_count;
    bool wrong_joint; /* a vertex names a joint that the skin does not have */
};

/* Reads the weights of a node's mesh and, if the node has a skin, its joints; `worlds` has the transform of each node,
 * `stride` bytes apart. Free with gltf_pose_free, also after a failure. */
void gltf_pose_read(struct gltf *g, size_t node_index, const json_t *node, uint32_t mesh, const double *worlds,
                    size_t stride, struct gltf_pose *pose);
void gltf_pose_free(struct gltf_pose *pose);
/* Whether the pose differs from the one that all other nodes of the mesh share. */
bool gltf_pose_is_own(const struct gltf_pose *pose);

/* Reads the accessors of a primitive with `count` vertices. Free with gltf_posed_free, also after a failure. */
void gltf_posed_read(struct gltf *g, struct gltf_place place, const json_t *primitive, const struct gltf_pose *pose,
                     size_t count, struct gltf_posed *posed);
void gltf_posed_free(struct gltf_posed *posed);
/* Moves a vertex; `normal` may be zero. */
void gltf_posed_move(const struct gltf_pose *pose, struct gltf_posed *posed, uint32_t vertex,
                     struct kiln_vec3 *position, struct kiln_vec3 *normal);
/* Whether the pose mirrors the primitive at a vertex: the winding of its triangles is then reversed. */
bool gltf_posed_mirrors(const struct gltf_pose *pose, struct gltf_posed *posed, uint32_t vertex);

#endif
