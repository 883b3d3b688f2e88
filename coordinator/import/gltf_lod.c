/* Levels of detail of the objects in the node tree, from names of nodes, MSFT_lod and extras. */
#include <stdio.h>
#include <string.h>

#include "coordinator/import/gltf_document.h"
#include "coordinator/import/lods.h"
#include "worker/base/memory.h"

enum { LEVEL_MOST = 99, NAMED = 8 };

/* Level of detail that a node states for itself and the nodes below. */
struct level {
    uint32_t parent;         /* node; KILN_NONE: a root */
    uint32_t level;          /* level + 1; 0: the node states none, except perhaps in its name */
    uint32_t group;          /* group of MSFT_lod: the node with the extension, + 1 */
    uint32_t by;             /* nearest node, from this one up, that states a level; KILN_NONE: none */
    uint32_t name;           /* offset of its name in the builder, once that is there */
    bool named, baked, seen; /* its name states a level; it has an object at or below it; `by` is known */
};

/* The level that extras say; KILN_NONE: none. */
static uint32_t level_of_extras(const json_t *element)
{
    static const char *const keys[] = {"lod", "LOD", "lod_level", "lodLevel", "LODLevel"};
    const json_t *extras = json_object_get(element, "extras");
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++) {
        const json_t *value = json_object_get(extras, keys[i]);
        const double level = json_number_value(value);
        if (json_is_number(value) && level >= 0.0 && level <= LEVEL_MOST && level == (double)(uint32_t)level)
            return (uint32_t)level;
    }
    return KILN_NONE;
}

/* Reads MSFT_lod of a node: the nodes that it lists are the node's levels 1, 2, ... */
static void read_extension(struct gltf *g, struct level *levels, size_t count, size_t index, const json_t *node)
{
    const struct gltf_place place = {"nodes", index, ".extensions.MSFT_lod"};
    const json_t *extension = gltf_extension(g, (struct gltf_place){"nodes", index, ""}, node, "MSFT_lod");
    const json_t *ids = extension == NULL ? NULL : gltf_array(g, place, extension, "ids");
    for (size_t i = 0; i < json_array_size(ids) && g->status == KILN_OK; i++) {
        const json_t *value = json_array_get(ids, i);
        const json_int_t id = json_integer_value(value);
        if (!json_is_integer(value) || id < 0 || (uint64_t)id >= count) {
            gltf_fail(g, place, "ids", "has element %zu that is not one of the %zu nodes", i, count);
        } else if ((size_t)id != index && levels[id].group == 0) {
            levels[id].level = (uint32_t)i + 2;
            levels[id].group = levels[index].group = (uint32_t)index + 1;
            levels[index].level = levels[index].level == 0 ? 1 : levels[index].level;
        }
    }
}

static void read_node(struct gltf *g, struct level *levels, size_t count, size_t index)
{
    const struct gltf_place place = {"nodes", index, ""};
    const json_t *node = gltf_element(g, "nodes", index), *children = gltf_array(g, place, node, "children");
    const uint32_t mesh = gltf_index(g, place, node, "mesh", g->mesh_count);
    const char *name = gltf_string(g, place, node, "name"), *begin;
    uint32_t own, of_extras = level_of_extras(node);
    size_t length;
    for (size_t i = 0; i < json_array_size(children); i++)
        levels[json_integer_value(json_array_get(children, i))].parent = (uint32_t)index;
    if (of_extras == KILN_NONE && mesh != KILN_NONE && g->status == KILN_OK)
        of_extras = level_of_extras(gltf_element(g, "meshes", mesh));
    if (of_extras != KILN_NONE && levels[index].level == 0)
        levels[index].level = of_extras + 1;
    levels[index].named = name != NULL && kiln_lod_of_name(name, &own, &begin, &length);
    read_extension(g, levels, count, index, node);
}

/* Finds the nearest node, from this one up, that states a level, and stores it for all nodes passed. */
static uint32_t said_by(struct level *levels, uint32_t node)
{
    uint32_t at = node, by = KILN_NONE;
    for (; at != KILN_NONE; at = levels[at].parent) {
        if (levels[at].seen)
            by = levels[at].by;
        else if (levels[at].level != 0 || levels[at].named)
            by = at;
        else
            continue;
        break;
    }
    for (; node != at; node = levels[node].parent) {
        levels[node].by = by;
        levels[node].seen = true;
    }
    if (at != KILN_NONE) {
        levels[at].by = by;
        levels[at].seen = true;
    }
    return by;
}

static void mark_object(struct gltf *g, struct level *levels, size_t object)
{
    const uint32_t node = KILN_BUILDER_DATA(g->builder, struct kiln_object, KILN_SECTION_OBJECTS)[object].source_node;
    const uint32_t by = said_by(levels, node);
    if (by == KILN_NONE)
        return;
    struct level *l = &levels[by];
    const char *name = gltf_string(g, (struct gltf_place){"nodes", by, ""}, gltf_element(g, "nodes", by), "name");
    l->baked = true;
    if (l->name == 0 && name != NULL)
        gltf_take(g, kiln_builder_string(g->builder, name, strlen(name), &l->name, g->error));
    struct kiln_object_settings *settings = &g->builder->object_settings[object];
    settings->lod_level = l->level;
    settings->lod_group = l->group;
    settings->lod_member = by + 1;
    settings->lod_name = l->name;
}

/* Notes the levels of MSFT_lod that are not in the scene, by name: they do not become objects. */
static void note_outside(struct gltf *g, const struct level *levels, size_t count)
{
    char names[NAMED * 72] = "", more[40] = "";
    size_t outside = 0, used = 0;
    for (size_t i = 0; i < count; i++) {
        if (levels[i].group == 0 || levels[i].level < 2 || levels[i].baked || !levels[levels[i].group - 1].baked)
            continue;
        const char *name = json_string_value(json_object_get(gltf_element(g, "nodes", i), "name"));
        if (outside++ < NAMED)
            used += (size_t)snprintf(names + used, sizeof names - used, "%snode %zu (\"%.40s\")",
                                     outside == 1 ? "" : ", ", i, name == NULL ? "" : name);
    }
    if (outside > NAMED)
        (void)snprintf(more, sizeof more, " and %zu more", outside - NAMED);
    if (outside > 0)
        gltf_take(g, kiln_builder_note(g->builder, KILN_NOTE_WARNING, g->error,
                                       "%s%s: lower levels of detail (MSFT_lod) that the scene does not contain; they "
                                       "get no lightmaps",
                                       names, more));
}

void gltf_read_lods(struct gltf *g)
{
    const size_t count = gltf_length(g, "nodes"), objects = g->builder->sections[KILN_SECTION_OBJECTS].count;
    struct level *levels = NULL;
    if (g->status == KILN_OK)
        gltf_take(g, kiln_allocate(&levels, count, sizeof *levels, "levels of detail", g->error));
    for (size_t i = 0; i < count && g->status == KILN_OK; i++)
        levels[i].parent = levels[i].by = KILN_NONE;
    for (size_t i = 0; i < count && g->status == KILN_OK; i++)
        read_node(g, levels, count, i);
    for (size_t i = 0; i < objects && g->status == KILN_OK; i++)
        mark_object(g, levels, i);
    if (g->status == KILN_OK)
        note_outside(g, levels, count);
    kiln_free(&levels);
}
