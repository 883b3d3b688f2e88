/* Lists the features of a document that kiln does not use: extensions anywhere, and features of glTF itself. */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "coordinator/import/gltf_document.h"
#include "worker/base/memory.h"

enum { EXTENSIONS_MOST = 64, NAME_LENGTH = 80, PLACES = 12, LIST_LENGTH = 256 };

/* Top-level arrays of a glTF document whose elements may have extensions. `one`, `several`: the elements' names in
 * messages. The last row stands for all other places. */
static const struct {
    const char *key, *one, *several;
} places[PLACES] = {{"nodes", "node", "nodes"},
                    {"scenes", "scene", "scenes"},
                    {"materials", "material", "materials"},
                    {"meshes", "mesh part", "mesh parts"},
                    {"textures", "texture", "textures"},
                    {"images", "image", "images"},
                    {"cameras", "camera", "cameras"},
                    {"animations", "animation part", "animation parts"},
                    {"skins", "skin", "skins"},
                    {"accessors", "accessor", "accessors"},
                    {"bufferViews", "buffer view", "buffer views"},
                    {"", "entry at the top of the file", "entries at the top of the file"}};

/* Extensions that are read, or that kiln export writes. */
static const char *const read_ones[] = {"KHR_lights_punctual",        "KHR_materials_emissive_strength",
                                        "KHR_texture_transform",      "EXT_mesh_gpu_instancing",
                                        "KHR_mesh_quantization",      "KHR_draco_mesh_compression",
                                        "EXT_meshopt_compression",    "KHR_materials_ior",
                                        "KHR_materials_specular",     "KHR_materials_clearcoat",
                                        "KHR_materials_transmission", "KHR_materials_volume",
                                        "KHR_materials_unlit",        "KHR_materials_anisotropy",
                                        "KHR_materials_dispersion",   "KHR_materials_pbrSpecularGlossiness",
                                        "KHR_node_visibility",        "KILN_lightmap"};

/* Effects that are missing in a bake that ignores an extension, by the extension's name or a part of it. The first
 * matching row is used. `what` ends a sentence. */
static const struct {
    const char *part, *what;
} effects[] = {
    {"lightmap", NULL},
    {"MSFT_lod",
     "of the levels of detail at one place the finest is baked, and materials of other levels are not chosen"},
    {"_light", "the light that it describes is missing: export such lamps as KHR_lights_punctual or as emitting "
               "surfaces, or give --environment"},
    {"environment", "the light that it describes is missing: give the surroundings with --environment"},
    {"sky", "the light that it describes is missing: give the surroundings with --environment"},
    {"gaussian", "its surfaces are missing: export meshes"},
};

struct extension {
    char name[NAME_LENGTH];
    uint64_t counts[PLACES];
};

struct walk {
    struct extension extensions[EXTENSIONS_MOST];
    size_t used;
    uint64_t others;
    size_t place; /* where the walk is */
};

static bool is_read(const char *name)
{
    for (size_t i = 0; i < sizeof read_ones / sizeof read_ones[0]; i++)
        if (strcmp(name, read_ones[i]) == 0)
            return true;
    return false;
}

static bool holds(const char *name, const char *part)
{
    const size_t length = strlen(part);
    for (; *name != '\0'; name++)
        if (strncasecmp(name, part, length) == 0)
            return true;
    return false;
}

/* Returns the effect that is missing in a bake that ignores the extension; NULL: unknown. */
static const char *effect_of(const char *name)
{
    for (size_t i = 0; i < sizeof effects / sizeof effects[0]; i++)
        if (holds(name, effects[i].part))
            return effects[i].what;
    return NULL;
}

static struct extension *find(struct walk *w, const char *name)
{
    for (size_t i = 0; i < w->used; i++)
        if (strncmp(w->extensions[i].name, name, NAME_LENGTH - 1) == 0)
            return &w->extensions[i];
    if (w->used == EXTENSIONS_MOST)
        return NULL;
    (void)snprintf(w->extensions[w->used].name, NAME_LENGTH, "%s", name);
    return &w->extensions[w->used++];
}

/* Returns the number of entries of an extension at the top of the file: the length of its first list. */
static uint64_t entries_of(const json_t *extension)
{
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)(uintptr_t)extension, key, value)
    {
        if (json_is_array(value))
            return json_array_size(value);
    }
    return 1;
}

static void walk_value(struct walk *w, const json_t *value);

static void walk_extensions(struct walk *w, const json_t *extensions)
{
    const char *name;
    json_t *value;
    json_object_foreach((json_t *)(uintptr_t)extensions, name, value)
    {
        struct extension *e = is_read(name) ? NULL : find(w, name);
        if (e != NULL)
            e->counts[w->place] += w->place == PLACES - 1 ? entries_of(value) : 1;
        else if (!is_read(name))
            w->others++;
        walk_value(w, value);
    }
}

/* Visits a value recursively, except "extras", which belong to applications. The JSON parser limits the depth. */
static void walk_value(struct walk *w, const json_t *value)
{
    const char *key;
    json_t *member;
    size_t i;
    json_array_foreach(value, i, member) walk_value(w, member);
    json_object_foreach((json_t *)(uintptr_t)value, key, member)
    {
        if (strcmp(key, "extensions") == 0)
            walk_extensions(w, member);
        else if (strcmp(key, "extras") != 0)
            walk_value(w, member);
    }
}

static size_t place_of(const char *key)
{
    size_t place = 0;
    while (place + 1 < PLACES && strcmp(key, places[place].key) != 0)
        place++;
    return place;
}

static void walk_document(struct walk *w, const json_t *root)
{
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)(uintptr_t)root, key, value)
    {
        w->place = place_of(key);
        if (strcmp(key, "extensions") == 0)
            walk_extensions(w, value);
        else if (strcmp(key, "extras") != 0)
            walk_value(w, value);
    }
}

/* "2 nodes, 1 scene" */
static void list_counts(const struct extension *e, char list[LIST_LENGTH])
{
    size_t length = 0;
    list[0] = '\0';
    for (size_t p = 0; p < PLACES && length < LIST_LENGTH; p++)
        if (e->counts[p] > 0)
            length += (size_t)snprintf(list + length, LIST_LENGTH - length, "%s%llu %s", length > 0 ? ", " : "",
                                       (unsigned long long)e->counts[p],
                                       e->counts[p] == 1 ? places[p].one : places[p].several);
}

static void note_extension(struct gltf *g, const struct extension *e)
{
    const char *effect = effect_of(e->name);
    char list[LIST_LENGTH];
    list_counts(e, list);
    if (effect != NULL)
        gltf_take(g, kiln_builder_note(g->builder, KILN_NOTE_REPEATED, g->error, "%s (%s) is not read: %s", e->name,
                                       list[0] != '\0' ? list : "named in extensionsUsed only", effect));
    for (size_t p = 0; p < PLACES && effect == NULL; p++)
        kiln_kinds_add(&g->unused, e->counts[p], "%s with %s", e->counts[p] == 1 ? places[p].one : places[p].several,
                       e->name);
    if (effect == NULL && list[0] == '\0')
        kiln_kinds_add(&g->unused, 1, "mention of %s in extensionsUsed", e->name);
}

static void count_extensions(struct gltf *g)
{
    struct walk w = {.used = 0};
    const json_t *used = gltf_array(g, (struct gltf_place){0}, g->root, "extensionsUsed");
    walk_document(&w, g->root);
    for (size_t i = 0; i < json_array_size(used); i++) {
        const char *name = json_string_value(json_array_get(used, i));
        if (name != NULL && !is_read(name))
            w.others += find(&w, name) == NULL;
    }
    for (size_t i = 0; i < w.used && g->status == KILN_OK; i++)
        note_extension(g, &w.extensions[i]);
    kiln_kinds_add(&g->unused, w.others, "uses of further extensions");
}

/* Counts attributes that are not read: further colours, application-specific ones, and joints without a skin. */
static void count_attributes(struct gltf *g, const json_t *primitive, bool skinned)
{
    const char *name;
    json_t *value;
    json_object_foreach(json_object_get(primitive, "attributes"), name, value)
    {
        const bool joint = strncmp(name, "JOINTS_", 7) == 0 || strncmp(name, "WEIGHTS_", 8) == 0;
        if (name[0] == '_' || (strncmp(name, "COLOR_", 6) == 0 && strcmp(name, "COLOR_0") != 0) || (joint && !skinned))
            kiln_kinds_add(&g->unused, 1, "vertex attributes %.60s", name);
    }
}

static void count_meshes(struct gltf *g)
{
    uint64_t without_node = 0;
    for (size_t i = 0; i < g->mesh_count; i++) {
        const json_t *primitives = json_object_get(json_array_get(json_object_get(g->root, "meshes"), i), "primitives");
        without_node += g->mesh_uses[i] == 0;
        for (size_t k = 0; k < json_array_size(primitives) && g->mesh_uses[i] != 0; k++)
            count_attributes(g, json_array_get(primitives, k), (g->mesh_uses[i] & GLTF_USED_SKINNED) != 0);
    }
    kiln_kinds_add(&g->unused, without_node, "meshes on no node of the scene");
}

/* Counts the file's lights that no node refers to. */
static void count_lights(struct gltf *g)
{
    const json_t *all = json_object_get(json_object_get(g->root, "extensions"), "KHR_lights_punctual");
    const size_t count = json_array_size(json_object_get(all, "lights")), nodes = gltf_length(g, "nodes");
    uint8_t *carried = NULL;
    uint64_t left = 0;
    if (g->status == KILN_OK)
        gltf_take(g, kiln_allocate(&carried, count, 1, "lights", g->error));
    for (size_t i = 0; i < nodes && g->status == KILN_OK; i++) {
        const json_t *extensions = json_object_get(json_array_get(json_object_get(g->root, "nodes"), i), "extensions"),
                     *light = json_object_get(json_object_get(extensions, "KHR_lights_punctual"), "light");
        if (json_is_integer(light) && (size_t)json_integer_value(light) < count)
            carried[json_integer_value(light)] = 1;
    }
    for (size_t i = 0; i < count && g->status == KILN_OK; i++)
        left += carried[i] == 0;
    kiln_free(&carried);
    kiln_kinds_add(&g->unused, left, "lights on no node");
}

static void count_materials(struct gltf *g)
{
    uint64_t occlusion = 0;
    for (size_t i = 0; i < g->material_count; i++)
        occlusion +=
            json_object_get(json_array_get(json_object_get(g->root, "materials"), i), "occlusionTexture") != NULL;
    kiln_kinds_add(&g->unused, occlusion, "occlusion maps");
}

void gltf_note_unused(struct gltf *g)
{
    const size_t scenes = gltf_length(g, "scenes"), animations = gltf_length(g, "animations");
    count_extensions(g);
    kiln_kinds_add(&g->unused, animations, "animations: the nodes are baked as they stand");
    kiln_kinds_add(&g->unused, scenes > 1 ? scenes - 1 : 0, "further scenes");
    kiln_kinds_add(&g->unused, g->outside_nodes, "nodes with a mesh, a light or a camera outside the scene");
    kiln_kinds_add(&g->unused, g->hidden_nodes, "invisible nodes (KHR_node_visibility), they and those below them");
    kiln_kinds_add(&g->unused, g->strange_cameras, "cameras of a kind that kiln does not know");
    kiln_kinds_add(&g->unused, g->points_and_lines, "primitives of points or lines");
    count_meshes(g);
    count_lights(g);
    count_materials(g);
    if (g->status == KILN_OK)
        gltf_take(
            g, kiln_kinds_note(&g->unused, g->builder, KILN_NOTE_UNUSED, "in the file, but not in a bake", g->error));
}
