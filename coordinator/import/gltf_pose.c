#include "coordinator/import/gltf_pose.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "worker/base/affine.h"
#include "worker/base/memory.h"

enum { MAT4_COMPONENTS = 16, TARGETS_MOST = 4096 };

/* distance from the origin beyond which skinned positions get an origin of their own, m */
static const double far_away = 1024.0;

/* ---- morph targets ---- */

/* Reads morph weights: the node's, or else the mesh's; without any, all are 0. */
static void read_weights(struct gltf *g, size_t node_index, const json_t *node, uint32_t mesh, struct gltf_pose *pose)
{
    struct gltf_place place = {"nodes", node_index, ""};
    const json_t *list = gltf_array(g, place, node, "weights");
    pose->own = list != NULL;
    if (list == NULL) {
        place = (struct gltf_place){"meshes", mesh, ""};
        list = gltf_array(g, place, gltf_element(g, "meshes", mesh), "weights");
    }
    const size_t count = json_array_size(list);
    if (g->status == KILN_OK && count > TARGETS_MOST)
        gltf_fail(g, place, "weights", "has %zu elements, more than %d", count, TARGETS_MOST);
    if (g->status != KILN_OK || count == 0)
        return;
    gltf_take(g, kiln_allocate(&pose->weights, count, sizeof *pose->weights, "morph targets", g->error));
    for (size_t i = 0; i < count && g->status == KILN_OK; i++) {
        const json_t *value = json_array_get(list, i);
        pose->weights[i] = json_number_value(value);
        if (!json_is_number(value) || !kiln_number_fits(KILN_NUMBER_WEIGHT, pose->weights[i]))
            gltf_fail(g, place, "weights", "has element %zu that is not a number from %g to %g", i,
                      kiln_number_range(KILN_NUMBER_WEIGHT)->low, kiln_number_range(KILN_NUMBER_WEIGHT)->high);
    }
    pose->weight_count = g->status == KILN_OK ? count : 0;
}

static void read_targets(struct gltf *g, struct gltf_place place, const json_t *primitive, const struct gltf_pose *pose,
                         size_t count, struct gltf_posed *posed)
{
    const json_t *targets = gltf_array(g, place, primitive, "targets");
    g->morphs += json_array_size(targets);
    if (pose->weight_count == 0 || json_array_size(targets) == 0 || g->status != KILN_OK)
        return;
    gltf_take(g, kiln_allocate(&posed->morphs, pose->weight_count, sizeof *posed->morphs, "morph targets", g->error));
    for (size_t i = 0; i < pose->weight_count && g->status == KILN_OK; i++) {
        const json_t *target = json_array_get(targets, i);
        struct gltf_morph morph = {.weight = pose->weights[i]};
        if (morph.weight == 0.0 || target == NULL)
            continue;
        morph.position = gltf_attribute(g, place, target, "POSITION", 3, 3, count);
        morph.normal = gltf_attribute(g, place, target, "NORMAL", 3, 3, count);
        posed->morphs[posed->morph_count++] = morph;
    }
}

/* ---- skins ---- */

/* The accessor of the inverse bind matrices; NULL: they are all the identity. */
static const struct gltf_accessor *bind_accessor(struct gltf *g, struct gltf_place place, const json_t *skin,
                                                 size_t joint_count)
{
    const uint32_t index = gltf_index(g, place, skin, "inverseBindMatrices", g->accessor_count);
    if (index == KILN_NONE || g->status != KILN_OK)
        return NULL;
    const struct gltf_accessor *accessor = &g->accessors[index];
    if (accessor->components == MAT4_COMPONENTS && accessor->count >= joint_count)
        return accessor;
    gltf_fail(g, place, "inverseBindMatrices", "is accessor %u of %zu elements with %u components, not of %zu matrices",
              index, accessor->count, accessor->components, joint_count);
    return NULL;
}

/* Reads a matrix, which the accessor stores by columns, into rows. */
static void bind_matrix(const struct gltf_accessor *accessor, size_t index, double out[12])
{
    for (unsigned r = 0; r < 3; r++)
        for (unsigned c = 0; c < 4; c++)
            out[4 * r + c] = accessor == NULL ? (double)(r == c) : gltf_accessor_raw(accessor, index, 4 * c + r);
}

/* The transform of a node. */
static const double *transform_of(const double *worlds, size_t stride, size_t node)
{
    return (const double *)(const void *)((const char *)worlds + node * stride);
}

static size_t first_joint(struct gltf *g, uint32_t skin)
{
    return (size_t)json_integer_value(json_array_get(json_object_get(gltf_element(g, "skins", skin), "joints"), 0));
}

static void choose_origin(const double joint[12], double origin[3])
{
    for (int k = 0; k < 3; k++)
        origin[k] = fabs(joint[4 * k + 3]) > far_away ? rint(joint[4 * k + 3]) : 0.0;
}

static void read_joint(struct gltf *g, struct gltf_place place, const json_t *joints, size_t i,
                       const struct gltf_accessor *binds, const double *worlds, size_t stride, double out[12])
{
    const json_t *value = json_array_get(joints, i);
    const json_int_t node = json_integer_value(value);
    double bind[12];
    if (!json_is_integer(value) || node < 0 || (size_t)node >= gltf_length(g, "nodes")) {
        gltf_fail(g, place, "joints", "has element %zu that is not one of the nodes", i);
        return;
    }
    bind_matrix(binds, i, bind);
    kiln_affine_multiply(transform_of(worlds, stride, (size_t)node), bind, out);
    for (int k = 0; k < 12; k++)
        if (!(fabs(out[k]) <= 1e30))
            gltf_fail(g, place, "inverseBindMatrices",
                      "element %zu times its joint's transform is infinite or no number", i);
}

static void read_skin(struct gltf *g, uint32_t index, const double *worlds, size_t stride, struct gltf_pose *pose)
{
    const struct gltf_place place = {"skins", index, ""};
    const json_t *skin = gltf_element(g, "skins", index), *joints = gltf_array(g, place, skin, "joints");
    const size_t count = json_array_size(joints);
    const struct gltf_accessor *binds = bind_accessor(g, place, skin, count);
    g->skin_joints += count;
    if (g->status == KILN_OK && (count == 0 || g->skin_joints > 65536 + 4 * g->confine->total_bytes))
        gltf_fail(g, place, "joints", count == 0 ? "is empty or missing" : "brings the scene to more than it can need");
    if (g->status == KILN_OK)
        gltf_take(g, kiln_allocate(&pose->joints, count, sizeof *pose->joints, "joints", g->error));
    for (size_t i = 0; i < count && g->status == KILN_OK; i++)
        read_joint(g, place, joints, i, binds, worlds, stride, pose->joints[i]);
    pose->joint_count = g->status == KILN_OK ? count : 0;
}

void gltf_pose_read(struct gltf *g, size_t node_index, const json_t *node, uint32_t mesh, const double *worlds,
                    size_t stride, struct gltf_pose *pose)
{
    const struct gltf_place place = {"nodes", node_index, ""};
    *pose = (struct gltf_pose){.joints = NULL};
    memcpy(pose->node, transform_of(worlds, stride, node_index), sizeof pose->node);
    read_weights(g, node_index, node, mesh, pose);
    const uint32_t skin = gltf_index(g, place, node, "skin", gltf_length(g, "skins"));
    if (skin == KILN_NONE || g->status != KILN_OK)
        return;
    g->skins++;
    read_skin(g, skin, worlds, stride, pose);
    if (pose->joint_count > 0)
        choose_origin(transform_of(worlds, stride, first_joint(g, skin)), pose->origin);
}

void gltf_pose_free(struct gltf_pose *pose)
{
    kiln_free(&pose->joints);
    kiln_free(&pose->weights);
}

bool gltf_pose_is_own(const struct gltf_pose *pose) { return pose->own || pose->joints != NULL; }

/* ---- a primitive ---- */

void gltf_posed_read(struct gltf *g, struct gltf_place place, const json_t *primitive, const struct gltf_pose *pose,
                     size_t count, struct gltf_posed *posed)
{
    const json_t *attributes = gltf_object(g, place, primitive, "attributes");
    read_targets(g, place, primitive, pose, count, posed);
    for (unsigned set = 0; set < GLTF_JOINT_SETS && pose->joints != NULL; set++) {
        char joints[32], weights[32];
        (void)snprintf(joints, sizeof joints, "JOINTS_%u", set);
        (void)snprintf(weights, sizeof weights, "WEIGHTS_%u", set);
        posed->joints[set] = gltf_attribute(g, place, attributes, joints, 4, 4, count);
        posed->weights[set] = gltf_attribute(g, place, attributes, weights, 4, 4, count);
        if (g->status == KILN_OK && (posed->joints[set] == NULL) != (posed->weights[set] == NULL))
            gltf_fail(g, place, posed->joints[set] == NULL ? joints : weights, "is missing, and the other of them not");
    }
}

void gltf_posed_free(struct gltf_posed *posed) { kiln_free(&posed->morphs); }

static void add_scaled(double sum[12], const double m[12], double weight)
{
    for (int k = 0; k < 12; k++)
        sum[k] += weight * m[k];
}

/* The blended matrix of a vertex. */
static void blend(const struct gltf_pose *pose, struct gltf_posed *posed, uint32_t vertex, double out[12])
{
    double total = 0.0, sum[12] = {0.0};
    for (int set = 0; set < GLTF_JOINT_SETS; set++) {
        float weights[4] = {0.0f, 0.0f, 0.0f, 0.0f};
        if (posed->joints[set] == NULL)
            continue;
        gltf_accessor_float(posed->weights[set], vertex, weights);
        for (unsigned c = 0; c < 4; c++) {
            const double joint = gltf_accessor_raw(posed->joints[set], vertex, c);
            const bool known = joint >= 0.0 && joint < (double)pose->joint_count;
            posed->wrong_joint |= weights[c] != 0.0f && !known;
            if (!(weights[c] > 0.0f) || !known)
                continue;
            add_scaled(sum, pose->joints[(size_t)joint], (double)weights[c]);
            total += (double)weights[c];
        }
    }
    for (int k = 0; k < 12; k++)
        out[k] = total > 0.0 ? sum[k] / total : pose->node[k];
}

/* The matrix of cofactors of the 3 x 3 part: its determinant times its inverse transpose. */
static struct kiln_dvec3 turn_normal(const double m[12], struct kiln_dvec3 n, double sign)
{
    const struct kiln_dvec3 x = dvec3(m[0], m[4], m[8]), y = dvec3(m[1], m[5], m[9]), z = dvec3(m[2], m[6], m[10]);
    const struct kiln_dvec3 sum =
        dvec3_add(dvec3_scale(dvec3_cross(y, z), n.x),
                  dvec3_add(dvec3_scale(dvec3_cross(z, x), n.y), dvec3_scale(dvec3_cross(x, y), n.z)));
    const double length = dvec3_length(sum);
    return length > 0.0 ? dvec3_scale(sum, sign / length) : dvec3(0.0, 0.0, 0.0);
}

static double determinant(const double m[12])
{
    return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
           m[2] * (m[4] * m[9] - m[5] * m[8]);
}

static void morph(const struct gltf_posed *posed, uint32_t vertex, struct kiln_dvec3 *p, struct kiln_dvec3 *n)
{
    for (size_t i = 0; i < posed->morph_count; i++) {
        const struct gltf_morph *m = &posed->morphs[i];
        struct kiln_vec3 move = vec3(0.0f, 0.0f, 0.0f), turn = move;
        if (m->position != NULL)
            gltf_accessor_float(m->position, vertex, &move.x);
        if (m->normal != NULL)
            gltf_accessor_float(m->normal, vertex, &turn.x);
        *p = dvec3_add(*p, dvec3_scale(dvec3_of(move), m->weight));
        *n = dvec3_add(*n, dvec3_scale(dvec3_of(turn), m->weight));
    }
}

void gltf_posed_move(const struct gltf_pose *pose, struct gltf_posed *posed, uint32_t vertex,
                     struct kiln_vec3 *position, struct kiln_vec3 *normal)
{
    struct kiln_dvec3 p = dvec3_of(*position), n = dvec3_of(*normal);
    double m[12];
    morph(posed, vertex, &p, &n);
    if (pose->joints != NULL) {
        blend(pose, posed, vertex, m);
        p = dvec3(m[0] * p.x + m[1] * p.y + m[2] * p.z + (m[3] - pose->origin[0]),
                  m[4] * p.x + m[5] * p.y + m[6] * p.z + (m[7] - pose->origin[1]),
                  m[8] * p.x + m[9] * p.y + m[10] * p.z + (m[11] - pose->origin[2]));
        n = turn_normal(m, n, determinant(m) < 0.0 ? -1.0 : 1.0);
    }
    *position = vec3_of(p);
    *normal = vec3_of(n);
}

bool gltf_posed_mirrors(const struct gltf_pose *pose, struct gltf_posed *posed, uint32_t vertex)
{
    double m[12];
    if (pose->joints == NULL)
        return false;
    blend(pose, posed, vertex, m);
    return determinant(m) < 0.0;
}
