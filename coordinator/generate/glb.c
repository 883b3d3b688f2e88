#include "coordinator/generate/glb.h"

#include <assert.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/files/publish.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

enum { GLTF_FLOAT = 5126, GLTF_UNSIGNED_INT = 5125, GLTF_ARRAY_BUFFER = 34962, GLTF_ELEMENT_ARRAY_BUFFER = 34963 };

struct kiln_glb {
    json_t *materials, *meshes, *nodes, *cameras, *lights, *accessors, *views, *extras;
    bool strength, transmission, volume, dispersion;
    uint8_t *binary;
    size_t size, capacity;
    uint64_t *mesh_triangles;
    size_t mesh_capacity;
    struct kiln_glb_totals totals;
};

static int out_of_memory(struct kiln_error *error)
{
    return kiln_fail(error, KILN_SYSTEM, "out of memory for the scene's description");
}

/* Appends a value to an array; it may be NULL when there was no memory for it. */
static int append(json_t *array, json_t *value, struct kiln_error *error)
{
    return value != NULL && json_array_append_new(array, value) == 0 ? KILN_OK : out_of_memory(error);
}

int kiln_glb_create(struct kiln_glb **glb, struct kiln_error *error)
{
    struct kiln_glb *made = NULL;
    const int status = kiln_allocate(&made, 1, sizeof *made, "the scene", error);
    if (status != KILN_OK)
        return status;
    made->materials = json_array();
    made->meshes = json_array();
    made->nodes = json_array();
    made->cameras = json_array();
    made->lights = json_array();
    made->accessors = json_array();
    made->views = json_array();
    made->extras = json_object();
    if (made->materials == NULL || made->meshes == NULL || made->nodes == NULL || made->cameras == NULL ||
        made->lights == NULL || made->accessors == NULL || made->views == NULL || made->extras == NULL) {
        kiln_glb_destroy(&made);
        return out_of_memory(error);
    }
    *glb = made;
    return KILN_OK;
}

void kiln_glb_destroy(struct kiln_glb **glb)
{
    if (*glb == NULL)
        return;
    json_t *const arrays[] = {(*glb)->materials, (*glb)->meshes,    (*glb)->nodes, (*glb)->cameras,
                              (*glb)->lights,    (*glb)->accessors, (*glb)->views, (*glb)->extras};
    for (size_t i = 0; i < sizeof arrays / sizeof arrays[0]; i++)
        json_decref(arrays[i]);
    kiln_free(&(*glb)->binary);
    kiln_free(&(*glb)->mesh_triangles);
    kiln_free(glb);
}

/* The shortest decimal that gives the same float: 0.14, not 0.14000000059604645. */
static json_t *json_float(float value)
{
    char text[32];
    for (int digits = 1; digits <= 9; digits++) {
        (void)snprintf(text, sizeof text, "%.*g", digits, (double)value);
        if (strtof(text, NULL) == value)
            break;
    }
    return json_real(strtod(text, NULL));
}

static json_t *json_floats(const float *values, size_t count)
{
    json_t *array = json_array();
    for (size_t i = 0; array != NULL && i < count; i++)
        if (json_array_append_new(array, json_float(values[i])) != 0) {
            json_decref(array);
            return NULL;
        }
    return array;
}

static json_t *json_reals(const double *values, size_t count)
{
    json_t *array = json_array();
    for (size_t i = 0; array != NULL && i < count; i++)
        if (json_array_append_new(array, json_real(values[i])) != 0) {
            json_decref(array);
            return NULL;
        }
    return array;
}

/* Sets the extensions of glass. Returns 0, or another number when there is no memory. */
static int add_glass(struct kiln_glb *glb, json_t *extensions, const struct kiln_glb_material *material)
{
    int failed =
        json_object_set_new(extensions, "KHR_materials_transmission", json_pack("{s:f}", "transmissionFactor", 1.0));
    failed |= json_object_set_new(extensions, "KHR_materials_ior",
                                  json_pack("{s:o*}", "ior", json_float(material->ior > 0 ? material->ior : 1.5f)));
    glb->transmission = true;
    if (material->thickness > 0) {
        json_t *volume = json_pack("{s:o*}", "thicknessFactor", json_float(material->thickness));
        if (material->attenuation_distance > 0) {
            failed |= json_object_set_new(volume, "attenuationDistance", json_float(material->attenuation_distance));
            failed |= json_object_set_new(volume, "attenuationColor", json_floats(material->attenuation_color, 3));
        }
        failed |= json_object_set_new(extensions, "KHR_materials_volume", volume);
        glb->volume = true;
    }
    if (material->dispersion > 0) {
        failed |= json_object_set_new(extensions, "KHR_materials_dispersion",
                                      json_pack("{s:o*}", "dispersion", json_float(material->dispersion)));
        glb->dispersion = true;
    }
    return failed;
}

int kiln_glb_add_material(struct kiln_glb *glb, const struct kiln_glb_material *material, uint32_t *index,
                          struct kiln_error *error)
{
    const float *emission = material->emission;
    float strength = fmaxf(emission[0], fmaxf(emission[1], emission[2]));
    const float color[4] = {material->base_color[0], material->base_color[1], material->base_color[2], 1.0f};
    json_t *object = json_pack("{s:s, s:{s:o*, s:o*, s:o*}}", "name", material->name, "pbrMetallicRoughness",
                               "baseColorFactor", json_floats(color, 4), "metallicFactor",
                               json_float(material->metallic), "roughnessFactor", json_float(material->roughness));
    json_t *extensions = json_object();
    int failed = object == NULL || extensions == NULL;
    if (strength > 0) {
        const float factor[3] = {emission[0] / strength, emission[1] / strength, emission[2] / strength};
        failed |= json_object_set_new(object, "emissiveFactor", json_floats(factor, 3));
        if (strength != 1.0f) {
            failed |= json_object_set_new(extensions, "KHR_materials_emissive_strength",
                                          json_pack("{s:o*}", "emissiveStrength", json_float(strength)));
            glb->strength = true;
        }
    }
    if (material->transmissive)
        failed |= add_glass(glb, extensions, material);
    if (failed == 0 && json_object_size(extensions) > 0)
        failed |= json_object_set(object, "extensions", extensions);
    json_decref(extensions);
    *index = (uint32_t)json_array_size(glb->materials);
    if (failed != 0) {
        json_decref(object);
        return out_of_memory(error);
    }
    return append(glb->materials, object, error);
}

/* Appends bytes as a new buffer view. All element sizes here are multiples of four, as glTF requires. */
static int add_view(struct kiln_glb *glb, const void *data, size_t bytes, int target, struct kiln_error *error)
{
    if ((double)glb->size + (double)bytes > KILN_GLB_LARGEST)
        return kiln_fail(error, KILN_USAGE,
                         "the scene needs more than %.0f bytes, and a .glb holds at most %.0f; ask for fewer triangles",
                         (double)glb->size + (double)bytes, KILN_GLB_LARGEST);
    int status = kiln_grow(&glb->binary, &glb->capacity, glb->size + bytes, 1, "the scene's vertices", error);
    if (status != KILN_OK)
        return status;
    memcpy(glb->binary + glb->size, data, bytes);
    status = append(glb->views,
                    json_pack("{s:i, s:I, s:I, s:i}", "buffer", 0, "byteOffset", (json_int_t)glb->size, "byteLength",
                              (json_int_t)bytes, "target", target),
                    error);
    glb->size += bytes;
    return status;
}

static int add_accessor(struct kiln_glb *glb, size_t view, size_t offset, size_t count, int component, const char *type,
                        int *index, struct kiln_error *error)
{
    *index = (int)json_array_size(glb->accessors);
    return append(glb->accessors,
                  json_pack("{s:I, s:I, s:i, s:I, s:s}", "bufferView", (json_int_t)view, "byteOffset",
                            (json_int_t)offset, "componentType", component, "count", (json_int_t)count, "type", type),
                  error);
}

static int add_attribute(struct kiln_glb *glb, json_t *attributes, const char *name, const void *data, size_t count,
                         size_t components, struct kiln_error *error)
{
    if (data == NULL)
        return KILN_OK;
    const size_t view = json_array_size(glb->views);
    int index = 0;
    int status;
    KILN_TRY(add_view(glb, data, count * components * sizeof(float), GLTF_ARRAY_BUFFER, error));
    KILN_TRY(add_accessor(glb, view, 0, count, GLTF_FLOAT, components == 3 ? "VEC3" : "VEC2", &index, error));
    if (json_object_set_new(attributes, name, json_integer(index)) != 0)
        KILN_TRY(out_of_memory(error));
end:
    return status;
}

/* Sets the bounds of a POSITION accessor, exact in float. */
static int set_bounds(struct kiln_glb *glb, json_t *attributes, const struct kiln_glb_mesh *mesh,
                      struct kiln_error *error)
{
    struct kiln_vec3 low = mesh->positions[0], high = low;
    for (size_t i = 1; i < mesh->vertex_count; i++) {
        const struct kiln_vec3 p = mesh->positions[i];
        low = vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
        high = vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
    }
    const double minimum[3] = {(double)low.x, (double)low.y, (double)low.z},
                 maximum[3] = {(double)high.x, (double)high.y, (double)high.z};
    json_t *accessor =
        json_array_get(glb->accessors, (size_t)json_integer_value(json_object_get(attributes, "POSITION")));
    if (json_object_set_new(accessor, "min", json_reals(minimum, 3)) != 0 ||
        json_object_set_new(accessor, "max", json_reals(maximum, 3)) != 0)
        return out_of_memory(error);
    return KILN_OK;
}

static int add_primitives(struct kiln_glb *glb, json_t *primitives, json_t *attributes,
                          const struct kiln_glb_mesh *mesh, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < mesh->primitive_count; i++) {
        const struct kiln_glb_primitive *primitive = &mesh->primitives[i];
        if (primitive->index_count == 0)
            continue;
        const size_t view = json_array_size(glb->views);
        int index = 0;
        KILN_TRY(add_view(glb, mesh->indices + primitive->index_first, primitive->index_count * sizeof(uint32_t),
                          GLTF_ELEMENT_ARRAY_BUFFER, error));
        KILN_TRY(add_accessor(glb, view, 0, primitive->index_count, GLTF_UNSIGNED_INT, "SCALAR", &index, error));
        KILN_TRY(append(primitives,
                        json_pack("{s:O, s:i, s:i, s:i}", "attributes", attributes, "indices", index, "material",
                                  (int)primitive->material, "mode", 4),
                        error));
    }
end:
    return status;
}

int kiln_glb_add_mesh(struct kiln_glb *glb, const struct kiln_glb_mesh *mesh, uint32_t *index, struct kiln_error *error)
{
    assert(mesh->vertex_count > 0);
    json_t *attributes = json_object(), *primitives = json_array();
    int status;
    KILN_TRY(attributes == NULL || primitives == NULL ? out_of_memory(error) : KILN_OK);
    KILN_TRY(add_attribute(glb, attributes, "POSITION", mesh->positions, mesh->vertex_count, 3, error));
    KILN_TRY(set_bounds(glb, attributes, mesh, error));
    KILN_TRY(add_attribute(glb, attributes, "NORMAL", mesh->normals, mesh->vertex_count, 3, error));
    KILN_TRY(add_attribute(glb, attributes, "TEXCOORD_0", mesh->texcoord_0, mesh->vertex_count, 2, error));
    KILN_TRY(add_attribute(glb, attributes, "TEXCOORD_1", mesh->texcoord_1, mesh->vertex_count, 2, error));
    KILN_TRY(add_primitives(glb, primitives, attributes, mesh, error));
end:
    *index = (uint32_t)json_array_size(glb->meshes);
    if (status == KILN_OK)
        status = kiln_grow(&glb->mesh_triangles, &glb->mesh_capacity, *index + 1, sizeof *glb->mesh_triangles,
                           "the meshes", error);
    if (status == KILN_OK)
        status = append(glb->meshes, json_pack("{s:s, s:O}", "name", mesh->name, "primitives", primitives), error);
    if (status == KILN_OK) {
        glb->mesh_triangles[*index] = 0;
        for (size_t i = 0; i < mesh->primitive_count; i++)
            glb->mesh_triangles[*index] += mesh->primitives[i].index_count / 3;
        glb->totals.triangles += glb->mesh_triangles[*index];
        glb->totals.meshes++;
    }
    json_decref(attributes);
    json_decref(primitives);
    return status;
}

static int add_node(struct kiln_glb *glb, const char *name, const char *key, json_t *value,
                    const struct kiln_glb_placement *placement, struct kiln_error *error)
{
    static const double none[4] = {0};
    json_t *node = json_pack("{s:s, s:o}", "name", name, key, value);
    if (node == NULL)
        return out_of_memory(error);
    int failed = 0;
    if (placement != NULL) {
        if (memcmp(placement->translation, none, sizeof placement->translation) != 0)
            failed |= json_object_set_new(node, "translation", json_reals(placement->translation, 3));
        if (memcmp(placement->rotation, none, sizeof placement->rotation) != 0)
            failed |= json_object_set_new(node, "rotation", json_reals(placement->rotation, 4));
        if (memcmp(placement->scale, none, sizeof placement->scale) != 0)
            failed |= json_object_set_new(node, "scale", json_reals(placement->scale, 3));
    }
    glb->totals.nodes++;
    if (failed != 0) {
        json_decref(node);
        return out_of_memory(error);
    }
    return append(glb->nodes, node, error);
}

int kiln_glb_add_node(struct kiln_glb *glb, const char *name, uint32_t mesh, const struct kiln_glb_placement *placement,
                      struct kiln_error *error)
{
    glb->totals.triangles_placed += glb->mesh_triangles[mesh];
    return add_node(glb, name, "mesh", json_integer(mesh), placement, error);
}

int kiln_glb_add_camera(struct kiln_glb *glb, const char *name, double angle, double aspect, double near,
                        const struct kiln_glb_placement *placement, struct kiln_error *error)
{
    const json_int_t index = (json_int_t)json_array_size(glb->cameras);
    const int status = append(glb->cameras,
                              json_pack("{s:s, s:s, s:{s:f, s:f, s:f}}", "name", name, "type", "perspective",
                                        "perspective", "yfov", angle, "aspectRatio", aspect, "znear", near),
                              error);
    return status != KILN_OK ? status : add_node(glb, name, "camera", json_integer(index), placement, error);
}

/* Adds a light and its node; `spot` are its cone's members, or NULL. */
static int add_light(struct kiln_glb *glb, const char *name, const char *type, const double color[3], double intensity,
                     json_t *spot, const struct kiln_glb_placement *placement, struct kiln_error *error)
{
    const json_int_t index = (json_int_t)json_array_size(glb->lights);
    const int status = append(glb->lights,
                              json_pack("{s:s, s:s, s:o*, s:f, s:o*}", "name", name, "type", type, "color",
                                        json_reals(color, 3), "intensity", intensity, "spot", spot),
                              error);
    if (status != KILN_OK)
        return status;
    return add_node(glb, name, "extensions", json_pack("{s:{s:I}}", "KHR_lights_punctual", "light", index), placement,
                    error);
}

int kiln_glb_add_sun(struct kiln_glb *glb, const char *name, const double color[3], double intensity,
                     const struct kiln_glb_placement *placement, struct kiln_error *error)
{
    return add_light(glb, name, "directional", color, intensity, NULL, placement, error);
}

int kiln_glb_add_point(struct kiln_glb *glb, const char *name, const double color[3], double intensity,
                       const struct kiln_glb_placement *placement, struct kiln_error *error)
{
    return add_light(glb, name, "point", color, intensity, NULL, placement, error);
}

int kiln_glb_add_spot(struct kiln_glb *glb, const char *name, const double color[3], double intensity, double inner,
                      double outer, const struct kiln_glb_placement *placement, struct kiln_error *error)
{
    json_t *spot = json_pack("{s:f, s:f}", "innerConeAngle", inner, "outerConeAngle", outer);
    return spot == NULL ? out_of_memory(error) : add_light(glb, name, "spot", color, intensity, spot, placement, error);
}

int kiln_glb_set_environment(struct kiln_glb *glb, const double radiance[3], struct kiln_error *error)
{
    json_t *environment = json_pack("{s:s, s:o*}", "type", "constant", "radiance", json_reals(radiance, 3));
    return json_object_set_new(glb->extras, "environment", environment) == 0 ? KILN_OK : out_of_memory(error);
}

int kiln_glb_set_note(struct kiln_glb *glb, const char *note, struct kiln_error *error)
{
    return json_object_set_new(glb->extras, "note", json_string(note)) == 0 ? KILN_OK : out_of_memory(error);
}

void kiln_glb_totals(const struct kiln_glb *glb, struct kiln_glb_totals *totals) { *totals = glb->totals; }

/* Sets a member array, unless it is empty, which glTF forbids. */
static int set_array(json_t *root, const char *name, json_t *array)
{
    return json_array_size(array) == 0 ? 0 : json_object_set(root, name, array);
}

static json_t *describe(const struct kiln_glb *glb)
{
    json_t *roots = json_array(), *used = json_array();
    json_t *root = json_pack("{s:{s:s, s:s}, s:i, s:[{s:O, s:O}]}", "asset", "version", "2.0", "generator",
                             "kiln generate", "scene", 0, "scenes", "nodes", roots, "extras", glb->extras);
    int failed = root == NULL || used == NULL;
    for (size_t i = 0; i < json_array_size(glb->nodes); i++)
        failed |= json_array_append_new(roots, json_integer((json_int_t)i));
    if (glb->strength)
        failed |= json_array_append_new(used, json_string("KHR_materials_emissive_strength"));
    if (glb->transmission) {
        failed |= json_array_append_new(used, json_string("KHR_materials_transmission"));
        failed |= json_array_append_new(used, json_string("KHR_materials_ior"));
    }
    if (glb->volume)
        failed |= json_array_append_new(used, json_string("KHR_materials_volume"));
    if (glb->dispersion)
        failed |= json_array_append_new(used, json_string("KHR_materials_dispersion"));
    if (json_array_size(glb->lights) > 0) {
        failed |= json_array_append_new(used, json_string("KHR_lights_punctual"));
        failed |= json_object_set_new(root, "extensions",
                                      json_pack("{s:{s:O}}", "KHR_lights_punctual", "lights", glb->lights));
    }
    failed |= set_array(root, "extensionsUsed", used);
    failed |= set_array(root, "materials", glb->materials);
    failed |= set_array(root, "meshes", glb->meshes);
    failed |= set_array(root, "nodes", glb->nodes);
    failed |= set_array(root, "cameras", glb->cameras);
    failed |= set_array(root, "accessors", glb->accessors);
    failed |= set_array(root, "bufferViews", glb->views);
    failed |= json_object_set_new(root, "buffers", json_pack("[{s:I}]", "byteLength", (json_int_t)glb->size));
    json_decref(roots);
    json_decref(used);
    if (failed != 0) {
        json_decref(root);
        return NULL;
    }
    return root;
}

/* A file that is written sequentially. */
struct target {
    int descriptor;
    size_t size; /* bytes written so far */
    const char *path;
};

static int put(struct target *t, const void *data, size_t size, struct kiln_error *error)
{
    const int status = kiln_write_all(t->descriptor, data, size, t->size, t->path, error);
    t->size += size;
    return status;
}

/* Writes the header, the JSON chunk padded with blanks and the BIN chunk padded with zeros; little-endian, as all
 * machines that kiln runs on. */
static int write_chunks(struct target *t, const struct kiln_glb *glb, const char *text, size_t length,
                        struct kiln_error *error)
{
    const size_t text_padding = (4 - length % 4) % 4, binary_padding = (4 - glb->size % 4) % 4;
    const uint32_t header[5] = {0x46546c67u, 2, (uint32_t)(28 + length + text_padding + glb->size + binary_padding),
                                (uint32_t)(length + text_padding), 0x4e4f534au};
    const uint32_t binary[2] = {(uint32_t)(glb->size + binary_padding), 0x004e4942u};
    int status;
    KILN_TRY(put(t, header, sizeof header, error));
    KILN_TRY(put(t, text, length, error));
    KILN_TRY(put(t, "   ", text_padding, error));
    KILN_TRY(put(t, binary, sizeof binary, error));
    KILN_TRY(put(t, glb->binary, glb->size, error));
    KILN_TRY(put(t, "\0\0\0", binary_padding, error));
end:
    return status;
}

static int write_file(struct kiln_glb *glb, const char *path, const char *text, struct kiln_error *error)
{
    const size_t length = strlen(text);
    glb->totals.bytes = 28 + (length + 3) / 4 * 4 + (glb->size + 3) / 4 * 4;
    if ((double)glb->totals.bytes > KILN_GLB_LARGEST)
        return kiln_fail(error, KILN_USAGE,
                         "the scene needs %llu bytes, and a .glb holds at most %.0f; ask for fewer triangles",
                         (unsigned long long)glb->totals.bytes, KILN_GLB_LARGEST);
    struct kiln_publish place;
    struct target target = {.path = path};
    int status = kiln_publish_claim(&place, NULL, path, &target.descriptor, error);
    if (status != KILN_OK)
        return status;
    status = write_chunks(&target, glb, text, length, error);
    if (status == KILN_OK)
        status = kiln_publish_finish(&place, error);
    else
        kiln_publish_abandon(&place);
    if (kiln_close(target.descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%.500s' cannot be closed", path);
    return status;
}

int kiln_glb_write(struct kiln_glb *glb, const char *path, struct kiln_error *error)
{
    json_t *root = describe(glb);
    char *text = root != NULL ? json_dumps(root, JSON_COMPACT | JSON_REAL_PRECISION(15)) : NULL;
    const int status = text != NULL ? write_file(glb, path, text, error) : out_of_memory(error);
    free(text);
    json_decref(root);
    return status;
}
