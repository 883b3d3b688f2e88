/* Writes irradiance at vertices as COLOR_1. */
#include <string.h>

#include "coordinator/export/child.h"
#include "coordinator/export/glb_lightmap.h"
#include "coordinator/export/gltf_rewrite.h"
#include "worker/base/memory.h"

void kiln_rewrite_corners_free(struct rewrite *a)
{
    for (size_t i = 0; i < a->corner_count; i++) {
        kiln_free(&a->corners[i].vertex);
        kiln_free(&a->corners[i].of_mesh);
    }
    kiln_free(&a->corners);
    a->corner_count = a->corner_capacity = 0;
}

/* Adds an object's light to a primitive. If the file has no normals, the scene's mesh may have several vertices, one
 * per face, for one of the file; that one gets their mean. `light`: of the object's vertices. */
static void color_primitive(struct rewrite *a, json_t *primitive, const struct written_corners *w,
                            const float (*light)[3])
{
    struct kiln_glb_build *b = &a->b;
    json_t *attributes = json_object_get(primitive, "attributes");
    float(*colors)[3] = NULL;
    uint32_t *corners = NULL;
    b->status = kiln_allocate(&colors, w->vertex_count, sizeof *colors, "colours of the exported scene", b->error);
    if (b->status == KILN_OK)
        b->status =
            kiln_allocate(&corners, w->vertex_count, sizeof *corners, "colours of the exported scene", b->error);
    for (size_t i = 0; b->status == KILN_OK && i < w->count; i++)
        if (w->of_mesh[i] != KILN_NONE) {
            const uint32_t vertex = w->vertex[i];
            corners[vertex]++;
            for (int c = 0; c < 3; c++)
                colors[vertex][c] += (light[w->of_mesh[i]][c] - colors[vertex][c]) / (float)corners[vertex];
        }
    if (b->status == KILN_OK && json_object_get(attributes, "COLOR_0") == NULL)
        kiln_glb_set(b, attributes, "COLOR_0", json_integer(kiln_export_white(b, w->vertex_count)));
    if (b->status == KILN_OK)
        kiln_glb_set(b, attributes, "COLOR_1",
                     json_integer(kiln_export_colors(b, (const float(*)[3])colors, w->vertex_count)));
    kiln_free(&colors);
    kiln_free(&corners);
}

/* Makes a copy of the object's mesh with its light, and assigns it to the object's node. */
static void color_object(struct rewrite *a, const struct kiln_object *object, const float (*light)[3])
{
    const json_t *meshes = json_object_get(a->b.root, "meshes");
    json_t *node = json_array_get(json_object_get(a->b.root, "nodes"), object->source_node),
           *mesh = json_deep_copy(json_array_get(meshes, a->mesh_of[object->mesh])),
           *primitives = json_object_get(mesh, "primitives");
    for (size_t i = 0; i < a->corner_count && a->b.status == KILN_OK; i++)
        if (a->corners[i].mesh == a->mesh_of[object->mesh])
            color_primitive(a, json_array_get(primitives, a->corners[i].primitive), &a->corners[i], light);
    kiln_glb_set(&a->b, node, "mesh", json_integer(kiln_glb_append(&a->b, a->b.root, "meshes", mesh)));
}

void kiln_rewrite_light(struct rewrite *a)
{
    const struct kiln_scene *scene = a->scene;
    const float(*light)[3] = a->light;
    for (size_t i = 0; i < scene->object_count && a->b.status == KILN_OK; i++) {
        const struct kiln_object *o = &scene->objects[i];
        if (o->source_instance == KILN_NONE && o->source_mesh < a->g.mesh_count)
            color_object(a, o, light);
        light += scene->meshes[o->mesh].vertex_count;
    }
}
