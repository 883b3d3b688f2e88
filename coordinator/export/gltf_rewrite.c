/* Rewrites the source's glTF. Its JSON is read and checked as at import, and edited in place. Elements are only
 * appended, so that existing indices stay valid. All buffers and images are written into one .glb. */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "coordinator/export/gltf_rewrite.h"
#include "coordinator/export/child.h"
#include "coordinator/export/glb_lightmap.h"
#include "coordinator/scene/builder.h"
#include "worker/base/memory.h"

/* ---- check of the source: unchanged since the bake ---- */

/* Checks that every file read now has the same bytes as at import. */
static int check_sources(struct rewrite *a)
{
    const struct kiln_builder *now = a->g.builder;
    const struct kiln_source *sources = KILN_BUILDER_DATA(now, const struct kiln_source, KILN_SECTION_SOURCES);
    const char *strings = KILN_BUILDER_DATA(now, const char, KILN_SECTION_STRINGS);
    for (size_t i = 0; i < now->sections[KILN_SECTION_SOURCES].count; i++) {
        const char *path = strings + sources[i].path;
        bool known = false;
        for (size_t k = 0; k < a->scene->source_count && !known; k++) {
            const struct kiln_source *before = &a->scene->sources[k];
            known = strcmp(kiln_scene_string(a->scene, before->path), path) == 0;
            if (known &&
                (before->size != sources[i].size || memcmp(before->hash, sources[i].hash, sizeof before->hash) != 0))
                return kiln_fail(a->g.error, KILN_BAD_INPUT,
                                 "%.512s: '%.80s' has changed since it was baked; bake again, or restore the old file",
                                 a->g.confine->scene, path);
        }
        if (!known && i == 0)
            return kiln_fail(a->g.error, KILN_BAD_INPUT,
                             "%.512s: the bake was made from '%.80s', not from this file; name the scene with --scene",
                             a->g.confine->scene,
                             a->scene->source_count > 0 ? kiln_scene_string(a->scene, a->scene->sources[0].path)
                                                        : "another file");
    }
    return KILN_OK;
}

/* ---- buffers and images ---- */

static void move_to_one_buffer(struct rewrite *a, json_t *view, const size_t *base, const uint32_t *renamed)
{
    const json_int_t index = json_integer_value(json_object_get(view, "buffer"));
    if (!json_is_integer(json_object_get(view, "buffer")) || index < 0 || (size_t)index >= a->g.buffer_count)
        return;
    if (renamed[index] == 0) {
        const json_t *offset = json_object_get(view, "byteOffset");
        kiln_glb_set(&a->b, view, "byteOffset",
                     json_integer((json_int_t)base[index] + (json_int_t)json_number_value(offset)));
    }
    kiln_glb_set(&a->b, view, "buffer", json_integer(renamed[index]));
}

/* Joins the buffers that have bytes into the first buffer. Buffers without bytes (fallback buffers of compressed files)
 * follow it. */
static void join_buffers(struct rewrite *a)
{
    size_t *base = NULL;
    uint32_t *renamed = NULL;
    json_t *old = json_object_get(a->b.root, "buffers"), *joined = json_array();
    a->b.status = kiln_allocate(&base, a->g.buffer_count, sizeof *base, "buffers", a->b.error);
    if (a->b.status == KILN_OK)
        a->b.status = kiln_allocate(&renamed, a->g.buffer_count, sizeof *renamed, "buffers", a->b.error);
    uint32_t others = 0;
    for (size_t i = 0; a->b.status == KILN_OK && i < a->g.buffer_count; i++) {
        json_t *buffer = json_array_get(old, i);
        if (a->g.buffers[i].data == NULL) {
            renamed[i] = ++others;
            continue;
        }
        base[i] = kiln_glb_piece(&a->b, a->g.buffers[i].data, a->g.buffers[i].size);
        (void)json_object_del(buffer, "uri");
        if (json_array_size(joined) == 0)
            (void)json_array_append(joined, buffer);
    }
    if (json_array_size(joined) == 0 && others > 0 && a->b.status == KILN_OK)
        (void)json_array_append_new(joined, json_object());
    for (size_t i = 0; a->b.status == KILN_OK && i < a->g.buffer_count; i++)
        if (a->g.buffers[i].data == NULL)
            (void)json_array_append(joined, json_array_get(old, i));
    json_t *views = json_object_get(a->b.root, "bufferViews");
    for (size_t i = 0; a->b.status == KILN_OK && i < json_array_size(views); i++) {
        json_t *view = json_array_get(views, i), *extensions = json_object_get(view, "extensions");
        const char *key;
        json_t *extension;
        move_to_one_buffer(a, view, base, renamed);
        json_object_foreach(extensions, key, extension) if (json_is_object(extension))
            /* EXT_meshopt_compression refers to its buffer in this way */
            move_to_one_buffer(a, extension, base, renamed);
    }
    if (json_array_size(joined) > 0)
        kiln_glb_set(&a->b, a->b.root, "buffers", json_incref(joined));
    json_decref(joined);
    kiln_free(&renamed);
    kiln_free(&base);
}

static const char *image_kind(const unsigned char *data, size_t size)
{
    static const struct {
        const char *mime, *bytes;
        size_t at, count;
    } kinds[] = {{"image/png", "\x89PNG", 0, 4},
                 {"image/jpeg", "\xff\xd8\xff", 0, 3},
                 {"image/webp", "WEBP", 8, 4},
                 {"image/ktx2", "\xabKTX 20", 0, 7},
                 {"image/avif", "ftypavif", 4, 8}};
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++)
        if (size >= kinds[i].at + kinds[i].count && memcmp(data + kinds[i].at, kinds[i].bytes, kinds[i].count) == 0)
            return kinds[i].mime;
    return NULL;
}

/* Fetches the bytes of an image outside the buffers. False: the image stays where it is, because its file cannot be
 * read (then no baked texture uses it) or its format is not one of glTF's. */
static bool fetch_image(struct rewrite *a, size_t index, const char *uri, struct kiln_file *file, unsigned char **owned)
{
    char path[1025], found[1025], where[64];
    struct kiln_error dropped;
    if (strncmp(uri, "data:", 5) == 0) {
        struct gltf probe = {.error = &dropped, .confine = a->g.confine};
        gltf_decode_data(&probe, (struct gltf_place){"images", index, ""}, uri, owned, &file->size);
        file->data = *owned;
        return probe.status == KILN_OK;
    }
    (void)snprintf(where, sizeof where, "images[%zu].uri", index);
    return kiln_confine_decode(a->g.confine, uri, where, path, &dropped) == KILN_OK &&
           kiln_confine_find(a->g.confine, "", path, found) != KILN_FOUND_NOT &&
           kiln_confine_map(a->g.confine, a->g.builder, found, where, file, &dropped) == KILN_OK;
}

static void take_image(struct rewrite *a, size_t index)
{
    json_t *image = json_array_get(json_object_get(a->b.root, "images"), index);
    const char *uri = json_string_value(json_object_get(image, "uri"));
    struct kiln_file file = {0};
    unsigned char *owned = NULL, *bytes;
    if (uri == NULL)
        return;
    const bool there = fetch_image(a, index, uri, &file, &owned);
    const char *kind = there ? image_kind(file.data, file.size) : NULL;
    if (kind != NULL) {
        const uint32_t view = kiln_glb_view(&a->b, file.size, 0, 0, &bytes);
        if (bytes != NULL)
            memcpy(bytes, file.data, file.size);
        (void)json_object_del(image, "uri");
        kiln_glb_set(&a->b, image, "mimeType", json_string(kind));
        kiln_glb_set(&a->b, image, "bufferView", json_integer(view));
    }
    if (owned != NULL)
        kiln_free(&owned);
    else
        kiln_file_unmap(&file);
}

/* ---- extensions ---- */

static void remove_name(json_t *root, const char *list, const char *name)
{
    json_t *array = json_object_get(root, list);
    for (size_t i = json_array_size(array); i-- > 0;) {
        const char *text = json_string_value(json_array_get(array, i));
        if (text != NULL && strcmp(text, name) == 0)
            (void)json_array_remove(array, i);
    }
    if (array != NULL && json_array_size(array) == 0)
        (void)json_object_del(root, list);
}

/* Removes compression extensions that nothing needs any more: meshes with new coordinates are not compressed. */
static void settle_compression(struct rewrite *a)
{
    static const char name[] = "KHR_draco_mesh_compression";
    const json_t *meshes = json_object_get(a->b.root, "meshes");
    for (size_t i = 0; i < json_array_size(meshes); i++) {
        const json_t *primitives = json_object_get(json_array_get(meshes, i), "primitives");
        for (size_t k = 0; k < json_array_size(primitives); k++)
            if (json_object_get(json_object_get(json_array_get(primitives, k), "extensions"), name) != NULL)
                return;
    }
    remove_name(a->b.root, "extensionsUsed", name);
    remove_name(a->b.root, "extensionsRequired", name);
}

/* ---- nodes ---- */

/* The link of an object with the texture coordinate set of its mesh. New reference. */
static json_t *link_with_set(const struct rewrite *a, size_t object)
{
    const json_t *link = json_array_get(json_object_get(a->plan, "objects"), object);
    json_t *settled = json_copy((json_t *)(uintptr_t)link);
    (void)json_object_set_new(settled, "texCoord", json_integer(a->set_of[a->mesh_of[a->scene->objects[object].mesh]]));
    return settled;
}

/* The number of instances of a node in the source: the count of the first of its attributes. */
static uint64_t instances_of(const struct rewrite *a, const json_t *node)
{
    json_t *attributes =
        json_object_get(json_object_get(json_object_get(node, "extensions"), "EXT_mesh_gpu_instancing"), "attributes");
    const json_t *index = json_object_iter_value(json_object_iter(attributes));
    const json_t *accessor = json_array_get(json_object_get(a->b.root, "accessors"),
                                            json_is_integer(index) ? (size_t)json_integer_value(index) : SIZE_MAX);
    const json_int_t count = json_integer_value(json_object_get(accessor, "count"));
    return count > 0 ? (uint64_t)count : 0;
}

/* Adds the link of an instance. The instances of one node (EXT_mesh_gpu_instancing) have an array of links in their
 * order; null: none. */
static void link_instance(struct rewrite *a, json_t *node, size_t object, json_t *link)
{
    const struct kiln_object *o = &a->scene->objects[object];
    const uint64_t count = instances_of(a, node);
    if (o->source_instance >= count) {
        a->b.status = kiln_fail(a->b.error, KILN_BAD_INPUT,
                                "the baked scene's object %zu is instance %u of node %u, which has %llu instances in "
                                "the source: the scene has "
                                "changed since it was baked; bake again",
                                object, o->source_instance, o->source_node, (unsigned long long)count);
        return;
    }
    json_t *whole = json_object_get(json_object_get(node, "extensions"), KILN_LIGHTMAP_EXTENSION);
    if (json_object_get(whole, "instances") == NULL || !json_is_array(json_object_get(whole, "instances"))) {
        whole = json_pack("{s:[]}", "instances");
        kiln_export_link(&a->b, node, whole);
        json_decref(whole);
        whole = json_object_get(json_object_get(node, "extensions"), KILN_LIGHTMAP_EXTENSION);
    }
    json_t *array = json_object_get(whole, "instances");
    while (array != NULL && json_array_size(array) < o->source_instance)
        if (json_array_append_new(array, json_null()) != 0)
            break;
    (void)json_array_append(array, link);
}

/* Removes the links of an earlier export. */
static void remove_links(struct rewrite *a)
{
    json_t *nodes = json_object_get(a->b.root, "nodes");
    for (size_t i = 0; i < json_array_size(nodes); i++) {
        json_t *node = json_array_get(nodes, i);
        (void)json_object_del(json_object_get(node, "extensions"), KILN_LIGHTMAP_EXTENSION);
        (void)json_object_del(json_object_get(node, "extras"), "kiln_lightmap");
        (void)json_object_del(json_object_get(node, "extras"), "kiln_baked");
    }
}

static void link_nodes(struct rewrite *a)
{
    json_t *nodes = json_object_get(a->b.root, "nodes");
    for (size_t i = 0; i < a->scene->object_count && a->b.status == KILN_OK; i++) {
        const struct kiln_object *o = &a->scene->objects[i];
        json_t *node = json_array_get(nodes, o->source_node);
        if (json_is_null(json_array_get(json_object_get(a->plan, "objects"), i)) || o->source_mesh >= a->g.mesh_count ||
            !json_is_object(node))
            continue;
        json_t *link = link_with_set(a, i);
        if (o->source_instance != KILN_NONE)
            link_instance(a, node, i, link);
        else
            kiln_export_link(&a->b, node, link);
        json_decref(link);
    }
}

/* ---- lights ---- */

/* Marks the nodes that the baked scene contains. */
static void reach(struct rewrite *a, uint8_t *reached)
{
    const json_t *scenes = json_object_get(a->b.root, "scenes"), *nodes = json_object_get(a->b.root, "nodes");
    const json_int_t chosen = json_integer_value(json_object_get(a->b.root, "scene"));
    const json_t *roots = json_object_get(json_array_get(scenes, chosen < 0 ? 0 : (size_t)chosen), "nodes");
    const size_t count = json_array_size(nodes);
    uint32_t *stack = NULL;
    size_t depth = 0;
    if (a->b.status == KILN_OK)
        a->b.status = kiln_allocate(&stack, count, sizeof *stack, "nodes", a->b.error);
    for (const json_t *next = roots; a->b.status == KILN_OK && next != NULL;) {
        for (size_t i = 0; i < json_array_size(next); i++) {
            const json_int_t child = json_integer_value(json_array_get(next, i));
            /* each node once: so the stack never holds more than all nodes */
            if (child >= 0 && (size_t)child < count && !reached[child]) {
                reached[child] = 1;
                stack[depth++] = (uint32_t)child;
            }
        }
        static json_t *const none = NULL;
        next = none;
        while (depth > 0 && next == NULL)
            next = json_object_get(json_array_get(nodes, stack[--depth]), "children");
    }
    kiln_free(&stack);
}

static void drop_light(json_t *node)
{
    json_t *extensions = json_object_get(node, "extensions");
    (void)json_object_del(extensions, "KHR_lights_punctual");
    if (json_object_size(extensions) == 0)
        (void)json_object_del(node, "extensions");
}

/* Marks the scene's punctual lights as baked, or removes them, since lightmaps have their light. */
static void settle_lights(struct rewrite *a)
{
    const bool drop = json_is_true(json_object_get(a->plan, "drop_baked_lights"));
    json_t *nodes = json_object_get(a->b.root, "nodes");
    uint8_t *reached = NULL;
    size_t left = 0;
    if (a->b.status == KILN_OK)
        a->b.status = kiln_allocate(&reached, json_array_size(nodes), 1, "nodes", a->b.error);
    reach(a, reached);
    for (size_t i = 0; a->b.status == KILN_OK && i < json_array_size(nodes); i++) {
        json_t *node = json_array_get(nodes, i);
        if (json_object_get(json_object_get(node, "extensions"), "KHR_lights_punctual") == NULL)
            continue;
        left += !reached[i] || !drop;
        if (reached[i] && drop)
            drop_light(node);
        else if (reached[i] && kiln_glb_object(&a->b, node, "extras") != NULL)
            kiln_glb_set(&a->b, json_object_get(node, "extras"), "kiln_baked", json_true());
    }
    if (drop && left == 0 && json_object_get(json_object_get(a->b.root, "extensions"), "KHR_lights_punctual") != NULL) {
        drop_light(a->b.root);
        remove_name(a->b.root, "extensionsUsed", "KHR_lights_punctual");
        remove_name(a->b.root, "extensionsRequired", "KHR_lights_punctual");
    }
    kiln_free(&reached);
}

/* ---- the whole export ---- */

static void open_source(struct rewrite *a)
{
    struct gltf *g = &a->g;
    gltf_open(g);
    if (g->status == KILN_OK)
        g->status = check_sources(a);
    if (g->status == KILN_OK)
        gltf_check(g);
    if (g->status == KILN_OK)
        gltf_read_buffers(g);
    if (g->status == KILN_OK)
        gltf_read_accessors(g);
    g->mesh_count = gltf_length(g, "meshes");
    g->image_count = gltf_length(g, "images");
    if (g->status == KILN_OK)
        g->status = check_sources(a); /* checks external buffers, too */
    a->b.status = g->status;
    a->b.root = json_incref(g->root);
}

static void edit(struct rewrite *a)
{
    remove_links(a);
    if (a->b.status == KILN_OK)
        join_buffers(a);
    for (size_t i = 0; a->b.status == KILN_OK && i < a->g.image_count; i++)
        take_image(a, i);
    if (a->b.status == KILN_OK)
        a->b.status = check_sources(a); /* checks the image files */
    if (a->b.status == KILN_OK)
        kiln_rewrite_meshes(a);
    settle_compression(a);
    if (a->b.status == KILN_OK)
        link_nodes(a);
    if (a->b.status == KILN_OK && a->light != NULL)
        kiln_rewrite_light(a);
    settle_lights(a);
    kiln_export_root(&a->b, a->plan);
}

int kiln_export_gltf(const struct kiln_export_task *task, void (*mapped)(const struct kiln_confine *),
                     struct kiln_error *error)
{
    struct kiln_confine *confine = NULL;
    struct kiln_builder *builder = NULL;
    struct rewrite a = {.scene = task->scene,
                        .plan = task->plan,
                        .coordinates = task->coordinates,
                        .light = task->light,
                        .b = {.subject = task->source, .error = error}};
    int status = kiln_confine_create(&confine, task->source, error);
    if (status == KILN_OK)
        status = kiln_builder_create(&builder, error);
    if (status != KILN_OK)
        goto done;
    confine->mapped = mapped;
    confine->total_bytes = task->scene->mapped_bytes; /* the scene file is in memory, too */
    if (mapped != NULL)
        mapped(confine);
    a.g = (struct gltf){.confine = confine, .builder = builder, .error = error};
    open_source(&a);
    if (a.b.status == KILN_OK)
        edit(&a);
    status = a.b.status == KILN_OK ? kiln_glb_build_write(&a.b, KILN_CHILD_OUTPUT, task->output) : a.b.status;
    kiln_free(&a.set_of);
    kiln_free(&a.mesh_of);
    kiln_rewrite_corners_free(&a);
    kiln_glb_build_free(&a.b);
    gltf_close(&a.g);
done:
    kiln_builder_destroy(&builder);
    kiln_confine_destroy(&confine);
    return status;
}
