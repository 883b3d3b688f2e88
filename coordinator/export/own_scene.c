/* Writes a .glb from kiln's own scene file, for scenes whose source is not glTF. One node per object; a mesh's
 * triangles are grouped by material. Vertices, coordinates and textures are those that were baked. */
#include <math.h>
#include <string.h>

#include "coordinator/files/json.h"
#include "coordinator/export/child.h"
#include "coordinator/export/glb_lightmap.h"
#include "coordinator/output/image.h"
#include "worker/base/memory.h"
#include "worker/scene/gloss.h"

struct own {
    struct kiln_glb_build b;
    const struct kiln_scene *scene;
    json_t *plan;
    const struct kiln_vec2 *coordinates;
    const float (*light)[3]; /* light per vertex, starting at the next object's first vertex; NULL: none */
    bool emission_set;       /* some material's emission has its own coordinates: all meshes get TEXCOORD_2 */
    size_t first, end;       /* objects that are written */
    const char *place;       /* lights and cameras whose names begin so are written; NULL: all */
    size_t place_length;
    /* indices in the file of the scene's meshes, materials and textures; KILN_NONE: not written */
    uint32_t *meshes, *materials, *textures;
};

static json_t *name_of(const struct own *o, uint32_t offset)
{
    return kiln_json_string(kiln_scene_string(o->scene, offset));
}

/* ---- textures and materials ---- */

static void add_texture(struct own *o, const struct kiln_texture *t)
{
    static const int wraps[] = {10497, 33071, 33648}; /* in the order of KILN_WRAP_REPEAT ... */
    char *png = NULL;
    size_t size = 0;
    unsigned char *bytes;
    if (o->b.status == KILN_OK)
        o->b.status =
            kiln_png_encode_channels(o->scene->texels + t->first, t->width, t->height, 4, &png, &size, o->b.error);
    const uint32_t view = kiln_glb_view(&o->b, size, 0, 0, &bytes);
    if (bytes != NULL)
        memcpy(bytes, png, size);
    kiln_free(&png);
    const uint32_t image = kiln_glb_append(&o->b, o->b.root, "images",
                                           json_pack("{s:s, s:i}", "mimeType", "image/png", "bufferView", (int)view));
    const uint32_t sampler = kiln_glb_append(&o->b, o->b.root, "samplers",
                                             json_pack("{s:i, s:i, s:i}", "magFilter", t->nearest ? 9728 : 9729,
                                                       "wrapS", wraps[t->wrap_u], "wrapT", wraps[t->wrap_v]));
    (void)kiln_glb_append(&o->b, o->b.root, "textures",
                          json_pack("{s:i, s:i}", "sampler", (int)sampler, "source", (int)image));
}

static json_t *texture_use(const struct own *o, uint32_t texture, int set)
{
    return json_pack("{s:i, s:i}", "index", (int)o->textures[texture], "texCoord", set);
}

static void set_emission(struct own *o, json_t *json, const struct kiln_material *m)
{
    const float most = fmaxf(m->emission[0], fmaxf(m->emission[1], m->emission[2]));
    const double scale = most > 1.0f ? (double)most : 1.0;
    if (!(most > 0.0f))
        return;
    kiln_glb_set(&o->b, json, "emissiveFactor",
                 json_pack("[f, f, f]", (double)m->emission[0] / scale, (double)m->emission[1] / scale,
                           (double)m->emission[2] / scale));
    if (m->emission_texture != KILN_NONE)
        kiln_glb_set(&o->b, json, "emissiveTexture", texture_use(o, m->emission_texture, o->emission_set ? 2 : 0));
    if (most > 1.0f) {
        kiln_glb_set(&o->b, json, "extensions",
                     json_pack("{s:{s:f}}", "KHR_materials_emissive_strength", "emissiveStrength", scale));
        kiln_glb_use(&o->b, "KHR_materials_emissive_strength");
    }
}

/* The set of the gloss's coordinates: after that of emission, if there is one. */
static int gloss_set(const struct own *o) { return o->emission_set ? 3 : 2; }

/* The gloss with the file's indices of textures. */
static struct kiln_gloss renumbered(const struct own *o, const struct kiln_gloss *gloss)
{
    struct kiln_gloss written = *gloss;
    for (int use = 0; use < KILN_GLOSS_USES; use++)
        if (written.textures[use].texture != KILN_NONE)
            written.textures[use].texture = o->textures[written.textures[use].texture];
    return written;
}

static void add_material(struct own *o, uint32_t index)
{
    const struct kiln_material *m = &o->scene->materials[index];
    const struct kiln_gloss *gloss = kiln_gloss_find(o->scene, index);
    static const char *const modes[] = {"OPAQUE", "MASK", "BLEND"};
    json_t *surface = json_pack("{s:[f, f, f, f], s:f, s:f}", "baseColorFactor", (double)m->base_color[0],
                                (double)m->base_color[1], (double)m->base_color[2], (double)m->base_color[3],
                                "metallicFactor", (double)m->metallic, "roughnessFactor", (double)m->roughness);
    if (m->base_color_texture != KILN_NONE)
        kiln_glb_set(&o->b, surface, "baseColorTexture", texture_use(o, m->base_color_texture, 0));
    json_t *json = json_pack("{s:o, s:o, s:s, s:b}", "name", name_of(o, m->name), "pbrMetallicRoughness", surface,
                             "alphaMode", modes[m->alpha_mode], "doubleSided", (int)m->double_sided);
    if (m->alpha_mode == KILN_ALPHA_MASK)
        kiln_glb_set(&o->b, json, "alphaCutoff", json_real((double)m->alpha_cutoff));
    set_emission(o, json, m);
    if (gloss != NULL) {
        const struct kiln_gloss written = renumbered(o, gloss);
        kiln_export_gloss(&o->b, json, &written, gloss_set(o));
    }
    (void)kiln_glb_append(&o->b, o->b.root, "materials", json);
}

/* ---- meshes ---- */

static uint32_t add_accessor(struct own *o, const void *data, size_t count, size_t element, int component,
                             const char *type, int target, json_t **json)
{
    unsigned char *bytes;
    const uint32_t view = kiln_glb_view(&o->b, count * element, 0, target, &bytes);
    if (bytes != NULL)
        memcpy(bytes, data, count * element);
    *json = json_pack("{s:i, s:i, s:I, s:s}", "bufferView", (int)view, "componentType", component, "count",
                      (json_int_t)count, "type", type);
    return kiln_glb_append(&o->b, o->b.root, "accessors", *json);
}

static json_t *add_attribute(struct own *o, const void *data, const struct kiln_mesh *mesh, size_t element,
                             const char *type)
{
    json_t *json;
    const char *first = (const char *)data + mesh->vertex_first * element;
    return json_integer(
        add_accessor(o, first, mesh->vertex_count, element, KILN_GLTF_FLOAT, type, KILN_GLTF_ARRAY_BUFFER, &json));
}

static json_t *add_positions(struct own *o, const struct kiln_mesh *mesh)
{
    const struct kiln_vec3 *p = o->scene->positions + mesh->vertex_first;
    struct kiln_vec3 low = p[0], high = p[0];
    json_t *json;
    for (uint64_t v = 1; v < mesh->vertex_count; v++) {
        low = vec3(fminf(low.x, p[v].x), fminf(low.y, p[v].y), fminf(low.z, p[v].z));
        high = vec3(fmaxf(high.x, p[v].x), fmaxf(high.y, p[v].y), fmaxf(high.z, p[v].z));
    }
    const uint32_t index =
        add_accessor(o, p, mesh->vertex_count, sizeof *p, KILN_GLTF_FLOAT, "VEC3", KILN_GLTF_ARRAY_BUFFER, &json);
    kiln_glb_set(&o->b, json, "min", json_pack("[f, f, f]", (double)low.x, (double)low.y, (double)low.z));
    kiln_glb_set(&o->b, json, "max", json_pack("[f, f, f]", (double)high.x, (double)high.y, (double)high.z));
    return json_integer(index);
}

static bool is_white(const uint8_t *colors, size_t count)
{
    for (size_t i = 0; i < 4 * count; i++)
        if (colors[i] != 255)
            return false;
    return true;
}

static json_t *add_attributes(struct own *o, const struct kiln_mesh *mesh)
{
    const struct kiln_scene *s = o->scene;
    const uint8_t *colors = s->colors + 4 * mesh->vertex_first;
    json_t *attributes = json_object(), *json;
    kiln_glb_set(&o->b, attributes, "POSITION", add_positions(o, mesh));
    kiln_glb_set(&o->b, attributes, "NORMAL", add_attribute(o, s->normals, mesh, sizeof *s->normals, "VEC3"));
    kiln_glb_set(&o->b, attributes, "TEXCOORD_0",
                 add_attribute(o, s->texcoord_base, mesh, sizeof *s->texcoord_base, "VEC2"));
    if (o->emission_set || s->texcoord_gloss != NULL ||
        (mesh->flags & KILN_MESH_NO_LAYOUT) == 0) /* sets have no gap between them */
        kiln_glb_set(&o->b, attributes, "TEXCOORD_1",
                     add_attribute(o, o->coordinates, mesh, sizeof *o->coordinates, "VEC2"));
    if (o->emission_set)
        kiln_glb_set(&o->b, attributes, "TEXCOORD_2",
                     add_attribute(o, s->texcoord_emission, mesh, sizeof *s->texcoord_emission, "VEC2"));
    if (s->texcoord_gloss != NULL)
        kiln_glb_set(&o->b, attributes, o->emission_set ? "TEXCOORD_3" : "TEXCOORD_2",
                     add_attribute(o, s->texcoord_gloss, mesh, sizeof *s->texcoord_gloss, "VEC2"));
    if (!is_white(colors, mesh->vertex_count)) {
        const uint32_t index = add_accessor(o, colors, mesh->vertex_count, 4, KILN_GLTF_UNSIGNED_BYTE, "VEC4",
                                            KILN_GLTF_ARRAY_BUFFER, &json);
        kiln_glb_set(&o->b, json, "normalized", json_true());
        kiln_glb_set(&o->b, attributes, "COLOR_0", json_integer(index));
    }
    return attributes;
}

/* Adds a primitive with all triangles of one material, starting at the first one. `done`, per triangle: already
 * written. */
static void add_primitive(struct own *o, const struct kiln_mesh *mesh, json_t *mesh_json, json_t *attributes,
                          uint64_t first, uint8_t *done)
{
    const struct kiln_scene *s = o->scene;
    const uint32_t material = s->triangle_materials[mesh->triangle_first + first];
    uint32_t *indices = NULL;
    size_t count = 0;
    json_t *json;
    o->b.status = kiln_allocate(&indices, 3 * (mesh->triangle_count - first), sizeof *indices,
                                "indices of the exported scene", o->b.error);
    for (uint64_t t = first; t < mesh->triangle_count && o->b.status == KILN_OK; t++) {
        if (done[t] || s->triangle_materials[mesh->triangle_first + t] != material)
            continue;
        done[t] = 1;
        memcpy(indices + count, s->triangles + 3 * (mesh->triangle_first + t), 3 * sizeof *indices);
        count += 3;
    }
    if (o->b.status == KILN_OK) {
        const uint32_t index = add_accessor(o, indices, count, sizeof *indices, KILN_GLTF_UNSIGNED_INT, "SCALAR",
                                            KILN_GLTF_ELEMENT_ARRAY_BUFFER, &json);
        (void)kiln_glb_append(&o->b, mesh_json, "primitives",
                              json_pack("{s:O, s:i, s:i}", "attributes", attributes, "indices", (int)index, "material",
                                        (int)o->materials[material]));
    }
    kiln_free(&indices);
}

static void add_mesh(struct own *o, const struct kiln_mesh *mesh)
{
    uint8_t *done = NULL;
    json_t *json = json_pack("{s:o, s:[]}", "name", name_of(o, mesh->name), "primitives"),
           *attributes = add_attributes(o, mesh);
    if (o->b.status == KILN_OK)
        o->b.status = kiln_allocate(&done, mesh->triangle_count, 1, "triangles of the exported scene", o->b.error);
    for (uint64_t t = 0; t < mesh->triangle_count && o->b.status == KILN_OK; t++)
        if (!done[t])
            add_primitive(o, mesh, json, attributes, t, done);
    json_decref(attributes);
    (void)kiln_glb_append(&o->b, o->b.root, "meshes", json);
    kiln_free(&done);
}

/* ---- nodes ---- */

/* Appends a node and lists it in the scene. */
static void add_node(struct own *o, json_t *node)
{
    const uint32_t index = kiln_glb_append(&o->b, o->b.root, "nodes", node);
    json_t *scene = json_array_get(json_object_get(o->b.root, "scenes"), 0);
    (void)kiln_glb_append(&o->b, scene, "nodes", json_integer(index));
}

/* A column-major 4 x 4 matrix from a row-major 3 x 4 one. */
static json_t *matrix_json(const double m[12])
{
    json_t *array = json_array();
    for (int c = 0; c < 4; c++)
        for (int r = 0; r < 4; r++)
            (void)json_array_append_new(array, json_real(r < 3 ? m[4 * r + c] : c == 3 ? 1.0 : 0.0));
    return array;
}

/* Makes a mesh with the same primitives and the object's own light as COLOR_1; returns its index. */
static uint32_t add_lit_mesh(struct own *o, size_t mesh)
{
    const size_t count = o->scene->meshes[mesh].vertex_count;
    json_t *copy = json_deep_copy(json_array_get(json_object_get(o->b.root, "meshes"), o->meshes[mesh])),
           *primitives = json_object_get(copy, "primitives");
    const uint32_t light = kiln_export_colors(&o->b, o->light, count), none = UINT32_MAX;
    uint32_t white = none;
    o->light += count;
    for (size_t i = 0; i < json_array_size(primitives); i++) {
        json_t *attributes = json_object_get(json_array_get(primitives, i), "attributes");
        if (json_object_get(attributes, "COLOR_0") == NULL) {
            white = white == none ? kiln_export_white(&o->b, count) : white;
            kiln_glb_set(&o->b, attributes, "COLOR_0", json_integer(white));
        }
        kiln_glb_set(&o->b, attributes, "COLOR_1", json_integer(light));
    }
    return kiln_glb_append(&o->b, o->b.root, "meshes", copy);
}

static void add_object(struct own *o, size_t index)
{
    static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    const struct kiln_object *object = &o->scene->objects[index];
    json_t *link = json_array_get(json_object_get(o->plan, "objects"), index - o->first);
    const uint32_t mesh = o->light != NULL ? add_lit_mesh(o, object->mesh) : o->meshes[object->mesh];
    json_t *node = json_pack("{s:o, s:i}", "name", name_of(o, object->name), "mesh", (int)mesh);
    if (memcmp(identity, object->transform, sizeof identity) != 0)
        kiln_glb_set(&o->b, node, "matrix", matrix_json(object->transform));
    if (!json_is_null(link))
        kiln_export_link(&o->b, node, link);
    add_node(o, node);
}

/* Makes a node whose matrix has the columns right, up, backward. */
static json_t *placed(const double position[3], struct kiln_vec3 right, struct kiln_vec3 up, struct kiln_vec3 forward)
{
    const struct kiln_vec3 columns[3] = {right, up, vec3_scale(forward, -1.0f)};
    double m[12];
    for (int c = 0; c < 3; c++) {
        m[c] = (double)columns[c].x;
        m[4 + c] = (double)columns[c].y;
        m[8 + c] = (double)columns[c].z;
        m[4 * c + 3] = position[c];
    }
    return matrix_json(m);
}

static json_t *light_json(const struct own *o, const struct kiln_light *l)
{
    static const char *const kinds[] = {"point", "spot", "directional"};
    const double most = fmax((double)l->intensity[0], fmax((double)l->intensity[1], (double)l->intensity[2])),
                 scale = most > 0.0 ? most : 1.0;
    json_t *json = json_pack("{s:o, s:s, s:[f, f, f], s:f}", "name", name_of(o, l->name), "type", kinds[l->kind],
                             "color", (double)l->intensity[0] / scale, (double)l->intensity[1] / scale,
                             (double)l->intensity[2] / scale, "intensity", most);
    if (l->range > 0.0f)
        (void)json_object_set_new(json, "range", json_real((double)l->range));
    if (l->kind == KILN_LIGHT_SPOT)
        (void)json_object_set_new(json, "spot",
                                  json_pack("{s:f, s:f}", "innerConeAngle", acos((double)l->cos_inner),
                                            "outerConeAngle", acos((double)l->cos_outer)));
    return json;
}

static void add_light(struct own *o, const struct kiln_light *l)
{
    json_t *extensions = kiln_glb_object(&o->b, o->b.root, "extensions");
    json_t *lights = extensions == NULL ? NULL : kiln_glb_object(&o->b, extensions, "KHR_lights_punctual");
    const uint32_t index = kiln_glb_append(&o->b, lights, "lights", light_json(o, l));
    const struct kiln_vec3 forward = {l->direction[0], l->direction[1], l->direction[2]};
    const struct kiln_vec3 away = fabsf(forward.y) < 0.9f ? vec3(0.0f, 1.0f, 0.0f) : vec3(1.0f, 0.0f, 0.0f);
    const struct kiln_vec3 right = vec3_normalize(vec3_cross(forward, away)), up = vec3_cross(right, forward);
    kiln_glb_use(&o->b, "KHR_lights_punctual");
    add_node(o, json_pack("{s:o, s:o, s:{s:{s:i}}, s:{s:b}}", "name", name_of(o, l->name), "matrix",
                          placed(l->position, right, up, forward), "extensions", "KHR_lights_punctual", "light",
                          (int)index, "extras", "kiln_baked", 1));
}

static void add_camera(struct own *o, const struct kiln_camera *c)
{
    static const double near = 0.01, far = 1e4;
    const double extent = (double)c->extent_y, aspect = c->aspect > 0.0f ? (double)c->aspect : 1.0;
    json_t *lens = c->orthographic ? json_pack("{s:f, s:f, s:f, s:f}", "xmag", extent * aspect, "ymag", extent, "znear",
                                               near, "zfar", far)
                                   : json_pack("{s:f, s:f}", "yfov", extent, "znear", near);
    if (!c->orthographic && c->aspect > 0.0f)
        kiln_glb_set(&o->b, lens, "aspectRatio", json_real(aspect));
    const char *kind = c->orthographic ? "orthographic" : "perspective";
    const uint32_t index =
        kiln_glb_append(&o->b, o->b.root, "cameras", json_pack("{s:s, s:o}", "type", kind, kind, lens));
    add_node(o, json_pack("{s:o, s:o, s:i}", "name", name_of(o, c->name), "matrix",
                          placed(c->position, vec3(c->right[0], c->right[1], c->right[2]),
                                 vec3(c->up[0], c->up[1], c->up[2]), vec3(c->forward[0], c->forward[1], c->forward[2])),
                          "camera", (int)index));
}

static void begin(struct own *o)
{
    const struct kiln_environment *e = o->scene->environment;
    o->b.root = json_pack("{s:{s:s, s:s}, s:i, s:[{}]}", "asset", "version", "2.0", "generator", "kiln " KILN_VERSION,
                          "scene", 0, "scenes");
    json_t *scene = json_array_get(json_object_get(o->b.root, "scenes"), 0);
    if (e->kind == KILN_ENVIRONMENT_CONSTANT)
        kiln_glb_set(&o->b, scene, "extras",
                     json_pack("{s:{s:s, s:[f, f, f]}}", "environment", "type", "constant", "radiance",
                               (double)e->radiance[0], (double)e->radiance[1], (double)e->radiance[2]));
    for (size_t i = 0; i < o->scene->mesh_count; i++)
        o->emission_set |= (o->scene->meshes[i].flags & KILN_MESH_HAS_EMISSION_UV) != 0;
}

/* ---- what is written ---- */

static int allocate_indices(struct own *o, struct kiln_error *error)
{
    const struct kiln_scene *s = o->scene;
    int status;
    KILN_TRY(kiln_allocate(&o->meshes, s->mesh_count, sizeof *o->meshes, "meshes of the exported scene", error));
    KILN_TRY(kiln_allocate(&o->materials, s->material_count, sizeof *o->materials, "the exported materials", error));
    KILN_TRY(kiln_allocate(&o->textures, s->texture_count, sizeof *o->textures, "the exported textures", error));
end:
    return status;
}

static void mark_texture(struct own *o, uint32_t texture)
{
    if (texture != KILN_NONE)
        o->textures[texture] = 1;
}

/* Marks the meshes of the objects, their materials, and the textures of these. */
static void mark_used(struct own *o)
{
    const struct kiln_scene *s = o->scene;
    for (size_t i = o->first; i < o->end; i++)
        o->meshes[s->objects[i].mesh] = 1;
    for (size_t i = 0; i < s->mesh_count; i++)
        for (uint64_t t = 0; o->meshes[i] != 0 && t < s->meshes[i].triangle_count; t++)
            o->materials[s->triangle_materials[s->meshes[i].triangle_first + t]] = 1;
    for (size_t i = 0; i < s->material_count; i++) {
        if (o->materials[i] == 0)
            continue;
        mark_texture(o, s->materials[i].base_color_texture);
        mark_texture(o, s->materials[i].emission_texture);
        const struct kiln_gloss *gloss = kiln_gloss_find(s, (uint32_t)i);
        for (int use = 0; gloss != NULL && use < KILN_GLOSS_USES; use++)
            mark_texture(o, gloss->textures[use].texture);
    }
}

/* Turns marks to indices. `all`: everything is written. */
static void number(uint32_t *marks, size_t count, bool all)
{
    uint32_t next = 0;
    for (size_t i = 0; i < count; i++)
        marks[i] = all || marks[i] != 0 ? next++ : KILN_NONE;
}

static int choose(struct own *o, struct kiln_error *error)
{
    const struct kiln_scene *s = o->scene;
    const bool all = o->place == NULL;
    const int status = allocate_indices(o, error);
    if (status != KILN_OK)
        return status;
    if (!all)
        mark_used(o);
    number(o->meshes, s->mesh_count, all);
    number(o->materials, s->material_count, all);
    number(o->textures, s->texture_count, all);
    return KILN_OK;
}

static bool is_here(const struct own *o, uint32_t name)
{
    const char *text = kiln_scene_string(o->scene, name);
    return o->place == NULL || (strncmp(text, o->place, o->place_length) == 0 && text[o->place_length] == '/');
}

static void add_all(struct own *o)
{
    const struct kiln_scene *s = o->scene;
    const bool lit = !json_is_true(json_object_get(o->plan, "drop_baked_lights"));
    for (size_t i = 0; i < s->texture_count && o->b.status == KILN_OK; i++)
        if (o->textures[i] != KILN_NONE)
            add_texture(o, &s->textures[i]);
    for (size_t i = 0; i < s->material_count && o->b.status == KILN_OK; i++)
        if (o->materials[i] != KILN_NONE)
            add_material(o, (uint32_t)i);
    for (size_t i = 0; i < s->mesh_count && o->b.status == KILN_OK; i++)
        if (o->meshes[i] != KILN_NONE)
            add_mesh(o, &s->meshes[i]);
    for (size_t i = o->first; i < o->end && o->b.status == KILN_OK; i++)
        add_object(o, i);
    for (size_t i = 0; i < s->light_count && lit && o->b.status == KILN_OK; i++)
        if (is_here(o, s->lights[i].name))
            add_light(o, &s->lights[i]);
    for (size_t i = 0; i < s->camera_count && o->b.status == KILN_OK; i++)
        if (is_here(o, s->cameras[i].name))
            add_camera(o, &s->cameras[i]);
    kiln_export_root(&o->b, o->plan);
}

static int write(struct own *o, int file, const char *name, struct kiln_error *error)
{
    int status;
    KILN_TRY(choose(o, error));
    begin(o);
    add_all(o);
    status = o->b.status == KILN_OK ? kiln_glb_build_write(&o->b, file, name) : o->b.status;
end:
    kiln_glb_build_free(&o->b);
    kiln_free(&o->meshes);
    kiln_free(&o->materials);
    kiln_free(&o->textures);
    return status;
}

int kiln_export_own(const struct kiln_export_task *task, struct kiln_error *error)
{
    struct own o = {.b = {.subject = task->scene_file, .error = error},
                    .scene = task->scene,
                    .plan = task->plan,
                    .coordinates = task->coordinates,
                    .light = task->light,
                    .end = task->scene->object_count};
    return write(&o, KILN_CHILD_OUTPUT, task->output, error);
}

int kiln_export_own_place(const struct kiln_export_task *task, size_t first, int file, struct kiln_error *error)
{
    const struct kiln_scene *s = task->scene;
    struct own o = {.b = {.subject = task->scene_file, .error = error},
                    .scene = s,
                    .plan = task->plan,
                    .coordinates = task->coordinates,
                    .light = task->light,
                    .first = first,
                    .end = kiln_scene_place_end(s, first),
                    .place = kiln_scene_string(s, s->objects[first].name),
                    .place_length = kiln_scene_place(s, first)};
    return write(&o, file, task->output, error);
}
