/* The node tree: objects, lights, cameras; and the scene's environment. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/import/gltf_pose.h"
#include "coordinator/job/object_settings.h"
#include "worker/base/affine.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

static const uint64_t expanded_max = (uint64_t)1 << 30, objects_max = (uint64_t)1 << 20;

struct node {
    double local[12], world[12]; /* row-major 3 x 4 */
    uint32_t parent;             /* KILN_NONE: a root */
    bool reached;                /* the chosen scene contains it */
    bool hidden;                 /* KHR_node_visibility hides it, or a node above it */
};

struct tree {
    struct node *nodes;
    uint32_t *order; /* parents before children */
    size_t count, ordered;
};

static const double identity[12] = KILN_AFFINE_IDENTITY;

static void read_matrix(struct gltf *g, struct gltf_place place, const double m[16], double out[12])
{
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            out[4 * r + c] = m[4 * c + r];
    if (m[3] != 0.0 || m[7] != 0.0 || m[11] != 0.0 || m[15] != 1.0) {
        gltf_fail(g, place, "matrix", "has the last row (%g, %g, %g, %g) instead of (0, 0, 0, 1)", m[3], m[7], m[11],
                  m[15]);
        return;
    }
    const double size = kiln_affine_size(out);
    if (size == 0.0 || fabs(kiln_affine_determinant(out)) < 1e-18 * size * size * size)
        gltf_fail(g, place, "matrix", "is singular (it maps everything to a plane, a line or a point)");
}

static void read_local(struct gltf *g, struct gltf_place place, const json_t *json, double out[12])
{
    double matrix[16], t[3] = {0, 0, 0}, q[4] = {0, 0, 0, 1}, s[3] = {1, 1, 1};
    memcpy(out, identity, sizeof identity);
    const bool has_matrix = gltf_numbers(g, place, json, KILN_NUMBER_MATRIX, 16, matrix);
    const bool has_t = gltf_numbers(g, place, json, KILN_NUMBER_TRANSLATION, 3, t);
    const bool has_q = gltf_numbers(g, place, json, KILN_NUMBER_ROTATION, 4, q);
    const bool has_s = gltf_numbers(g, place, json, KILN_NUMBER_SCALE, 3, s);
    if (g->status != KILN_OK)
        return;
    if (has_matrix && (has_t || has_q || has_s))
        gltf_fail(g, place, "matrix", "is given together with translation, rotation or scale");
    else if (has_matrix)
        read_matrix(g, place, matrix, out);
    else if (!kiln_quaternion_unit(q))
        gltf_fail(g, place, "rotation", "is not a unit quaternion");
    else
        kiln_affine_compose(t, q, s, out);
}

static void read_children(struct gltf *g, struct tree *tree, size_t index, const json_t *json)
{
    const struct gltf_place place = {"nodes", index, ""};
    const json_t *children = gltf_array(g, place, json, "children");
    for (size_t i = 0; i < json_array_size(children) && g->status == KILN_OK; i++) {
        const json_t *value = json_array_get(children, i);
        const json_int_t child = json_integer_value(value);
        if (!json_is_integer(value) || child < 0 || (uint64_t)child >= tree->count)
            gltf_fail(g, place, "children", "has element %zu that is not one of the %zu nodes", i, tree->count);
        else if (tree->nodes[child].parent != KILN_NONE || (size_t)child == index)
            gltf_fail(g, place, "children", "refers to node %lld, which %s", (long long)child,
                      (size_t)child == index ? "is the node itself" : "already has a parent");
        else
            tree->nodes[child].parent = (uint32_t)index;
    }
}

/* Orders the nodes, parents before children: breadth first from the roots. Nodes that are not reached lie in a cycle,
 * as no node has two parents. */
static void order_nodes(struct gltf *g, struct tree *tree)
{
    for (size_t i = 0; i < tree->count; i++)
        if (tree->nodes[i].parent == KILN_NONE)
            tree->order[tree->ordered++] = (uint32_t)i;
    for (size_t at = 0; at < tree->ordered; at++) {
        const json_t *children = json_object_get(gltf_element(g, "nodes", tree->order[at]), "children");
        for (size_t i = 0; i < json_array_size(children); i++)
            tree->order[tree->ordered++] = (uint32_t)json_integer_value(json_array_get(children, i));
    }
    if (tree->ordered == tree->count)
        return;
    for (size_t i = 0; i < tree->count; i++)
        tree->nodes[i].reached = false;
    for (size_t at = 0; at < tree->ordered; at++)
        tree->nodes[tree->order[at]].reached = true;
    for (size_t i = 0; i < tree->count; i++)
        if (!tree->nodes[i].reached) {
            gltf_fail(g, (struct gltf_place){"nodes", i, ""}, "children", "form a cycle");
            return;
        }
}

static bool is_visible(struct gltf *g, size_t index, const json_t *json)
{
    const json_t *extension = gltf_extension(g, (struct gltf_place){"nodes", index, ""}, json, "KHR_node_visibility");
    const struct gltf_place place = {"nodes", index, ".extensions.KHR_node_visibility"};
    return extension == NULL || gltf_bool(g, place, extension, "visible", true);
}

static void read_tree(struct gltf *g, struct tree *tree)
{
    tree->count = gltf_length(g, "nodes");
    if (g->status == KILN_OK)
        gltf_take(g, kiln_allocate(&tree->nodes, tree->count, sizeof *tree->nodes, "nodes", g->error));
    if (g->status == KILN_OK)
        gltf_take(g, kiln_allocate(&tree->order, tree->count, sizeof *tree->order, "nodes", g->error));
    for (size_t i = 0; i < tree->count && g->status == KILN_OK; i++)
        tree->nodes[i].parent = KILN_NONE;
    for (size_t i = 0; i < tree->count && g->status == KILN_OK; i++) {
        const json_t *json = gltf_element(g, "nodes", i);
        read_local(g, (struct gltf_place){"nodes", i, ""}, json, tree->nodes[i].local);
        read_children(g, tree, i, json);
        tree->nodes[i].hidden = !is_visible(g, i, json);
    }
    if (g->status == KILN_OK)
        order_nodes(g, tree);
}

/* Marks the nodes that the scene contains and computes their world transforms. */
static void place_nodes(struct gltf *g, struct tree *tree, size_t scene_index, const json_t *scene)
{
    const struct gltf_place place = {"scenes", scene_index, ""};
    const json_t *roots = gltf_array(g, place, scene, "nodes");
    for (size_t i = 0; i < tree->count; i++)
        tree->nodes[i].reached = false;
    for (size_t i = 0; i < json_array_size(roots) && g->status == KILN_OK; i++) {
        const json_t *value = json_array_get(roots, i);
        const json_int_t root = json_integer_value(value);
        if (!json_is_integer(value) || root < 0 || (uint64_t)root >= tree->count)
            gltf_fail(g, place, "nodes", "has element %zu that is not one of the %zu nodes", i, tree->count);
        else if (tree->nodes[root].parent != KILN_NONE)
            gltf_fail(g, place, "nodes", "refers to node %lld, which is the child of another node", (long long)root);
        else
            tree->nodes[root].reached = true;
    }
    for (size_t at = 0; at < tree->ordered && g->status == KILN_OK; at++) {
        struct node *node = &tree->nodes[tree->order[at]];
        if (node->parent != KILN_NONE) {
            node->reached = tree->nodes[node->parent].reached;
            node->hidden |= tree->nodes[node->parent].hidden;
        }
        kiln_affine_multiply(node->parent == KILN_NONE ? identity : tree->nodes[node->parent].world, node->local,
                             node->world);
    }
}

static bool direction(const double world[12], int axis, double sign, float out[3])
{
    const struct kiln_dvec3 d = dvec3(sign * world[axis], sign * world[4 + axis], sign * world[8 + axis]);
    const double length = dvec3_length(d);
    if (!(length > 1e-30) || !isfinite(length))
        return false;
    const struct kiln_vec3 unit = vec3_of(dvec3_scale(d, 1.0 / length));
    memcpy(out, &unit, sizeof unit);
    return true;
}

static bool position(const double world[12], double out[3])
{
    for (int k = 0; k < 3; k++) {
        out[k] = world[4 * k + 3];
        if (!(fabs(out[k]) <= (double)KILN_COORDINATE_MAX))
            return false;
    }
    return true;
}

static const char *first_name(const char *a, const char *b)
{
    return a != NULL && a[0] != '\0' ? a : b != NULL ? b : "";
}

static void spot_cone(struct gltf *g, struct gltf_place place, const json_t *json, struct kiln_light *light)
{
    const json_t *spot = gltf_object(g, place, json, "spot");
    const double inner = gltf_number(g, place, spot, KILN_NUMBER_INNER_CONE, 0.0);
    const double outer = gltf_number(g, place, spot, KILN_NUMBER_OUTER_CONE, KILN_PI / 4);
    if (g->status == KILN_OK && inner > outer)
        gltf_fail(g, place, "spot.innerConeAngle", "is %g, more than the outer angle of %g", inner, outer);
    if (g->status == KILN_OK && !(inner < outer))
        g->hard_spots++;
    light->cos_inner = (float)cos(inner);
    light->cos_outer = (float)cos(outer);
}

static void add_light(struct gltf *g, size_t node_index, const json_t *node, const double world[12])
{
    const struct gltf_place at_node = {"nodes", node_index, ".extensions.KHR_lights_punctual"};
    const json_t *use = gltf_extension(g, (struct gltf_place){"nodes", node_index, ""}, node, "KHR_lights_punctual");
    if (use == NULL)
        return;
    const json_t *all = gltf_extension(g, (struct gltf_place){0}, g->root, "KHR_lights_punctual");
    const json_t *lights = gltf_array(g, (struct gltf_place){0}, all, "lights");
    const uint32_t index = gltf_index(g, at_node, use, "light", json_array_size(lights));
    if (g->status == KILN_OK && index == KILN_NONE)
        gltf_fail(g, at_node, "light", "is missing");
    const json_t *json = json_array_get(lights, index);
    const struct gltf_place place = {"extensions.KHR_lights_punctual.lights", index, ""};
    if (g->status == KILN_OK && !json_is_object(json))
        gltf_fail(g, place, "", "is not an object");
    if (g->status != KILN_OK)
        return;
    struct kiln_light light = {.direction = {0.0f, 0.0f, -1.0f}, .cos_inner = -1.0f, .cos_outer = -1.0f};
    double color[3] = {1.0, 1.0, 1.0};
    (void)gltf_numbers(g, place, json, KILN_NUMBER_LIGHT_COLOR, 3, color);
    const double intensity = gltf_number(g, place, json, KILN_NUMBER_LIGHT_INTENSITY, 1.0);
    light.range = (float)gltf_number(g, place, json, KILN_NUMBER_LIGHT_RANGE, 0.0);
    const char *type = gltf_string(g, place, json, "type");
    if (type != NULL && strcmp(type, "directional") == 0)
        light.kind = KILN_LIGHT_DIRECTIONAL;
    else if (type != NULL && strcmp(type, "point") == 0)
        light.kind = KILN_LIGHT_POINT;
    else if (type != NULL && strcmp(type, "spot") == 0)
        light.kind = KILN_LIGHT_SPOT;
    else
        gltf_fail(g, place, "type", "is '%.20s', not one of directional, point, spot", type == NULL ? "" : type);
    if (light.kind == KILN_LIGHT_SPOT)
        spot_cone(g, place, json, &light);
    for (int c = 0; c < 3; c++) {
        if (!kiln_number_fits(KILN_NUMBER_LIGHT, color[c] * intensity))
            gltf_fail(g, place, "intensity", "times the colour is %g, more than %g", color[c] * intensity,
                      kiln_number_range(KILN_NUMBER_LIGHT)->high);
        light.intensity[c] = (float)(color[c] * intensity);
    }
    if (g->status != KILN_OK)
        return;
    if (!position(world, light.position) ||
        (!direction(world, 2, -1.0, light.direction) && light.kind != KILN_LIGHT_POINT)) {
        g->skipped_lights++; /* scaled to zero: it has no direction */
        return;
    }
    const char *name = first_name(gltf_string(g, at_node, node, "name"), gltf_string(g, place, json, "name"));
    gltf_take(g, kiln_builder_string(g->builder, name, strlen(name), &light.name, g->error));
    gltf_take(g, kiln_builder_append(g->builder, KILN_SECTION_LIGHTS, &light, 1, NULL, g->error));
}

/* Reads a camera's lens. Returns false on an error, or if the camera's type is unknown. */
static bool camera_lens(struct gltf *g, struct gltf_place place, const json_t *json, struct kiln_camera *camera)
{
    const char *type = gltf_string(g, place, json, "type");
    if (type != NULL && strcmp(type, "perspective") == 0) {
        const json_t *lens = gltf_object(g, place, json, "perspective");
        camera->extent_y = (float)gltf_number(g, place, lens, KILN_NUMBER_YFOV, 0.0);
        camera->aspect = (float)gltf_number(g, place, lens, KILN_NUMBER_ASPECT, 0.0);
    } else if (type != NULL && strcmp(type, "orthographic") == 0) {
        const json_t *lens = gltf_object(g, place, json, "orthographic");
        camera->orthographic = 1;
        const double x = fabs(gltf_number(g, place, lens, KILN_NUMBER_XMAG, 0.0));
        const double y = fabs(gltf_number(g, place, lens, KILN_NUMBER_YMAG, 0.0));
        camera->extent_y = (float)y;
        camera->aspect = y > 0.0 ? (float)(x / y) : 0.0f;
    } else if (g->status == KILN_OK) {
        g->strange_cameras++;
        return false;
    }
    if (g->status == KILN_OK && (!(camera->extent_y > 0.0f) || !isfinite(camera->aspect)))
        gltf_fail(g, place, "", "has no angle of view or no height");
    return g->status == KILN_OK;
}

static void add_camera(struct gltf *g, size_t node_index, const json_t *node, const double world[12])
{
    const struct gltf_place at_node = {"nodes", node_index, ""};
    const uint32_t index = gltf_index(g, at_node, node, "camera", gltf_length(g, "cameras"));
    if (index == KILN_NONE || g->status != KILN_OK)
        return;
    const struct gltf_place place = {"cameras", index, ""};
    const json_t *json = gltf_element(g, "cameras", index);
    struct kiln_camera camera = {0};
    const bool known = camera_lens(g, place, json, &camera);
    const char *name = first_name(gltf_string(g, at_node, node, "name"), gltf_string(g, place, json, "name"));
    if (g->status != KILN_OK || !known || !position(world, camera.position) ||
        !direction(world, 2, -1.0, camera.forward) || !direction(world, 1, 1.0, camera.up) ||
        !direction(world, 0, 1.0, camera.right))
        return;
    gltf_take(g, kiln_builder_string(g->builder, name, strlen(name), &camera.name, g->error));
    gltf_take(g, kiln_builder_append(g->builder, KILN_SECTION_CAMERAS, &camera, 1, NULL, g->error));
}

static void add_object(struct gltf *g, const struct kiln_object_source *source, uint32_t mesh, const char *wish,
                       const char *original, const double world[12])
{
    const size_t node_index = source->node;
    char name[KILN_NAME_LENGTH + 1], where[640];
    bool skipped = false;
    (void)snprintf(where, sizeof where, "%.512s: nodes[%zu]", g->confine->scene, node_index);
    g->objects++;
    g->expanded += KILN_BUILDER_DATA(g->builder, struct kiln_mesh, KILN_SECTION_MESHES)[mesh].triangle_count;
    if (g->objects > objects_max || g->objects > 65536 + g->confine->total_bytes)
        gltf_fail(g, (struct gltf_place){"nodes", node_index, ""}, "",
                  "brings the scene to %llu objects, more than kiln accepts from files of its size",
                  (unsigned long long)g->objects);
    if (g->expanded > expanded_max)
        gltf_fail(g, (struct gltf_place){"nodes", node_index, ""}, "",
                  "brings the scene to %llu triangles with instances expanded, more than %llu",
                  (unsigned long long)g->expanded, (unsigned long long)expanded_max);
    if (g->status == KILN_OK)
        gltf_take(g, kiln_names_unique(&g->names, wish, name, g->error));
    if (g->status == KILN_OK)
        gltf_take(g, kiln_object_add(g->builder, mesh, world, name, original, source, where, &skipped, g->error));
    g->without_area_objects += skipped;
}

/* Reads EXT_mesh_gpu_instancing: each instance becomes an object of its own. */
static void add_instances(struct gltf *g, const struct kiln_object_source *node, const json_t *extension, uint32_t mesh,
                          const char *name, const double world[12])
{
    static const struct {
        const char *name;
        unsigned components;
    } kinds[3] = {{"TRANSLATION", 3}, {"ROTATION", 4}, {"SCALE", 3}};
    const struct gltf_place place = {"nodes", node->node, ".extensions.EXT_mesh_gpu_instancing"};
    const json_t *attributes = gltf_object(g, place, extension, "attributes");
    const struct gltf_accessor *accessors[3] = {NULL, NULL, NULL};
    size_t count = 0;
    for (int k = 0; k < 3 && g->status == KILN_OK; k++) {
        const uint32_t index = gltf_index(g, place, attributes, kinds[k].name, g->accessor_count);
        if (index == KILN_NONE)
            continue;
        accessors[k] = &g->accessors[index];
        if (accessors[k]->components != kinds[k].components)
            gltf_fail(g, place, kinds[k].name, "has %u components instead of %u", accessors[k]->components,
                      kinds[k].components);
        else if (count != 0 && accessors[k]->count != count)
            gltf_fail(g, place, kinds[k].name, "has %zu instances, another attribute has %zu", accessors[k]->count,
                      count);
        count = accessors[k]->count;
    }
    for (size_t i = 0; i < count && g->status == KILN_OK; i++) {
        float value[3][4] = {{0, 0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1, 0}};
        double t[3], q[4], s[3], local[12], placed[12];
        for (int k = 0; k < 3; k++)
            if (accessors[k] != NULL)
                gltf_accessor_float(accessors[k], i, value[k]);
        for (int c = 0; c < 3; c++) {
            t[c] = (double)value[0][c];
            s[c] = (double)value[2][c];
        }
        for (int c = 0; c < 4; c++)
            q[c] = (double)value[1][c];
        if (!kiln_quaternion_unit(q)) {
            gltf_fail(g, place, "ROTATION", "of instance %zu is not a unit quaternion", i);
            return;
        }
        kiln_affine_compose(t, q, s, local);
        kiln_affine_multiply(world, local, placed);
        char wish[160];
        (void)snprintf(wish, sizeof wish, "%.100s_%zu", name, i);
        const struct kiln_object_source source = {node->node, node->mesh, (uint32_t)i};
        add_object(g, &source, mesh, wish, name, placed);
    }
}

enum { SETTING_NOTES_MAX = 16 };

/* Reads one key of a node's settings. An unknown key may be a slip, or another program's: it is noted and otherwise
 * ignored. */
static void read_setting(struct gltf *g, size_t node_index, const char *key, const json_t *value,
                         struct kiln_object_settings *settings)
{
    char where[640];
    bool known = false;
    (void)snprintf(where, sizeof where, "%.512s: nodes[%zu].extras", g->confine->scene, node_index);
    gltf_take(g, kiln_object_settings_read(settings, key, value, where, KILN_BAD_INPUT, &known, g->error));
    if (g->status == KILN_OK && !known && g->unknown_settings++ < SETTING_NOTES_MAX)
        gltf_take(g, kiln_builder_note(
                         g->builder, 1, g->error,
                         "nodes[%zu].extras: kiln has no setting '%.80s' for an object; the nearest one is '%s'",
                         node_index, key, kiln_object_settings_nearest(key)));
}

/* Reads the settings node.extras.kiln = {KEY: value} and node.extras["kiln-KEY"] or ["kiln_KEY"]: see settings.h. */
static void read_settings(struct gltf *g, size_t node_index, const json_t *node, struct kiln_object_settings *settings)
{
    const json_t *extras = json_object_get(node, "extras");
    const char *key;
    json_t *value;
    json_object_foreach(json_object_get(extras, "kiln"), key, value)
    {
        if (g->status == KILN_OK)
            read_setting(g, node_index, key, value, settings);
    }
    json_object_foreach((json_t *)(uintptr_t)extras, key, value)
    {
        /* "kiln_lightmap" is written by kiln export: it is no setting */
        if (g->status == KILN_OK && (strncmp(key, "kiln-", 5) == 0 || strncmp(key, "kiln_", 5) == 0) &&
            strcmp(key + 5, "lightmap") != 0)
            read_setting(g, node_index, key + 5, value, settings);
    }
}

/* Makes the builder's mesh of a node in its pose. A skinned mesh is placed by its skin and not by its node; *world is
 * set accordingly. */
static uint32_t posed_mesh(struct gltf *g, size_t node_index, const json_t *node, uint32_t index,
                           const struct tree *tree, double world[12])
{
    struct gltf_pose pose;
    gltf_pose_read(g, node_index, node, index, tree->nodes[0].world, sizeof *tree->nodes, &pose);
    const uint32_t mesh = gltf_mesh(g, index, &pose);
    g->mesh_uses[index] |= (uint8_t)(pose.joints != NULL ? GLTF_USED | GLTF_USED_SKINNED : GLTF_USED);
    memcpy(world, tree->nodes[node_index].world, 12 * sizeof *world);
    if (pose.joints != NULL)
        memcpy(world, identity, sizeof identity);
    for (int k = 0; k < 3 && pose.joints != NULL; k++)
        world[4 * k + 3] = pose.origin[k];
    gltf_pose_free(&pose);
    return mesh;
}

static void add_mesh(struct gltf *g, size_t node_index, const json_t *node, const struct tree *tree)
{
    const struct gltf_place place = {"nodes", node_index, ""};
    const uint32_t index = gltf_index(g, place, node, "mesh", g->mesh_count);
    double world[12];
    if (index == KILN_NONE || g->status != KILN_OK)
        return;
    const uint32_t mesh = posed_mesh(g, node_index, node, index, tree, world);
    if (mesh == KILN_NONE)
        return;
    char number[32];
    (void)snprintf(number, sizeof number, "node_%zu", node_index);
    const char *original = first_name(gltf_string(g, place, node, "name"), "");
    const char *mesh_name =
        gltf_string(g, (struct gltf_place){"meshes", index, ""}, gltf_element(g, "meshes", index), "name");
    const char *wish = first_name(original, first_name(mesh_name, number));
    const size_t first = g->builder->sections[KILN_SECTION_OBJECTS].count;
    struct kiln_object_settings settings = {0};
    read_settings(g, node_index, node, &settings);
    settings.size_of_file = settings.density_scale != 0.0 || settings.lightmap_size != 0;
    const json_t *instancing = gltf_extension(g, place, node, "EXT_mesh_gpu_instancing");
    const struct kiln_object_source source = {(uint32_t)node_index, index, KILN_NONE};
    if (instancing != NULL)
        add_instances(g, &source, instancing, mesh, wish, world);
    else
        add_object(g, &source, mesh, wish, original, world);
    for (size_t i = first; i < g->builder->sections[KILN_SECTION_OBJECTS].count; i++)
        g->builder->object_settings[i] = settings;
}

/* Reads scenes[i].extras.environment: {"type": "constant", "radiance": [r, g, b]}, or "sunsky" with
 * constant_sky_radiance. */
static void add_environment(struct gltf *g, size_t scene_index, const json_t *scene)
{
    const struct gltf_place place = {"scenes", scene_index, ".extras.environment"};
    const json_t *json = json_object_get(json_object_get(scene, "extras"), "environment");
    struct kiln_environment environment = {0};
    double radiance[3];
    if (json_is_object(json)) {
        const char *type = gltf_string(g, place, json, "type");
        const enum kiln_number which =
            type != NULL && strcmp(type, "sunsky") == 0 ? KILN_NUMBER_SUN_SKY_RADIANCE : KILN_NUMBER_SKY_RADIANCE;
        const bool known = type != NULL && (strcmp(type, "constant") == 0 || strcmp(type, "sunsky") == 0);
        if (known && gltf_numbers(g, place, json, which, 3, radiance)) {
            environment.kind = KILN_ENVIRONMENT_CONSTANT;
            for (int c = 0; c < 3; c++)
                environment.radiance[c] = (float)radiance[c];
        } else if (g->status == KILN_OK) {
            gltf_take(g,
                      kiln_builder_note(
                          g->builder, 1, g->error,
                          "scenes[%zu].extras.environment has a type that kiln does not know ('%.40s') and is left out",
                          scene_index, type == NULL ? "" : type));
        }
    }
    gltf_take(g, kiln_builder_append(g->builder, KILN_SECTION_ENVIRONMENT, &environment, 1, NULL, g->error));
}

/* Checks the mesh reference of a hidden node, whose mesh is not stored. */
static void mark_mesh(struct gltf *g, size_t node_index, const json_t *node)
{
    const uint32_t index = gltf_index(g, (struct gltf_place){"nodes", node_index, ""}, node, "mesh", g->mesh_count);
    if (index != KILN_NONE && g->status == KILN_OK)
        g->mesh_uses[index] |= GLTF_USED | GLTF_USED_SKINNED;
}

static bool holds_something(const json_t *node)
{
    return json_object_get(node, "mesh") != NULL || json_object_get(node, "camera") != NULL ||
           json_object_get(json_object_get(node, "extensions"), "KHR_lights_punctual") != NULL;
}

void gltf_read_scene(struct gltf *g)
{
    struct tree tree = {0};
    const size_t scene_count = gltf_length(g, "scenes");
    uint32_t scene_index = gltf_index(g, (struct gltf_place){0}, g->root, "scene", scene_count);
    const json_t *scene = NULL;
    g->mesh_count = gltf_length(g, "meshes");
    if (g->status == KILN_OK)
        gltf_take(g,
                  kiln_arena_allocate(&g->arena, &g->mesh_of, g->mesh_count, sizeof *g->mesh_of, "meshes", g->error));
    if (g->status == KILN_OK)
        gltf_take(
            g, kiln_arena_allocate(&g->arena, &g->mesh_uses, g->mesh_count, sizeof *g->mesh_uses, "meshes", g->error));
    for (size_t i = 0; i < g->mesh_count && g->status == KILN_OK; i++)
        g->mesh_of[i] = GLTF_UNREAD;
    read_tree(g, &tree);
    if (scene_index == KILN_NONE)
        scene_index = 0;
    if (g->status == KILN_OK && scene_count > 0)
        scene = gltf_element(g, "scenes", scene_index);
    if (g->status == KILN_OK)
        place_nodes(g, &tree, scene_index, scene);
    for (size_t i = 0; i < tree.count && g->status == KILN_OK; i++) {
        const json_t *node = gltf_element(g, "nodes", i);
        g->outside_nodes += !tree.nodes[i].reached && holds_something(node);
        g->hidden_nodes += tree.nodes[i].reached && tree.nodes[i].hidden;
        if (!tree.nodes[i].reached)
            continue;
        if (tree.nodes[i].hidden) {
            mark_mesh(g, i, node);
        } else {
            add_mesh(g, i, node, &tree);
            add_light(g, i, node, tree.nodes[i].world);
        }
        add_camera(g, i, node, tree.nodes[i].world);
    }
    if (g->status == KILN_OK)
        add_environment(g, scene_index, scene);
    kiln_free(&tree.nodes);
    kiln_free(&tree.order);
}
