/* Writes the lightmap's coordinates back to the corners of the source's primitives.
 *
 * A vertex of the file whose corners lie in several charts is duplicated, once for each chart. All attributes, of morph
 * targets too, are then copied byte for byte into new accessors, and the primitive becomes a list of triangles. Where
 * no vertex has to be duplicated, and most are used, only the coordinates are added. Where the file's own TEXCOORD_1 is
 * what was baked, nothing changes. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/export/gltf_rewrite.h"
#include "worker/base/memory.h"

enum { FIRST_SET = 1, SETS_MOST = 64, TRIANGLES = 4, NAME = 32 };

/* A vertex of the file with one position in the layout. Each is written as a vertex of its own. */
struct layout_vertex {
    struct kiln_vec2 uv;
    uint32_t source; /* index of the vertex of the file */
    uint32_t next;   /* another layout vertex of the same vertex of the file, or KILN_NONE */
    uint32_t vertex; /* its index in the new primitive */
};

struct patch {
    struct rewrite *a;
    struct gltf_place where;
    json_t *json;
    const struct gltf_accessor *position, *indices;
    /* for a primitive with Draco compression: its accessors with decoded values */
    bool compressed;
    struct gltf_draco_use uses[GLTF_DRACO_ATTRIBUTES];
    struct gltf_accessor copies[GLTF_DRACO_ATTRIBUTES + 1];
    struct gltf_draco_values values;
    unsigned mode;
    size_t triangle_count;
    uint32_t *vertex_of; /* 3 per triangle: the layout vertices of its corners; KILN_NONE: not known (yet) */
    uint32_t *of_mesh;   /* 3 per triangle: vertices of the scene's mesh at its corners; KILN_NONE: not known (yet) */
    uint32_t *first;     /* per vertex of the file: its first layout vertex, or KILN_NONE */
    struct layout_vertex *layout_vertices;
    size_t layout_vertex_count, layout_vertex_capacity;
    size_t used;  /* how many vertices of the file have a layout vertex */
    bool changed; /* the coordinates differ from TEXCOORD_1 */
};

static void take(struct rewrite *a, int status)
{
    if (a->b.status == KILN_OK)
        a->b.status = status;
}

/* ---- choice of the texture coordinate set ---- */

/* Whether a texture below `json` uses set 1. */
static bool uses_set(const json_t *json)
{
    const char *key;
    json_t *value;
    size_t i;
    if (json_is_array(json))
        json_array_foreach(json, i, value) if (uses_set(value)) return true;
    if (json_is_object(json) && json_integer_value(json_object_get(json, "texCoord")) == FIRST_SET)
        return true;
    json_object_foreach((json_t *)(uintptr_t)json, key, value) if (uses_set(value)) return true;
    return false;
}

static const json_t *accessor_of(const json_t *primitive, unsigned set)
{
    char name[NAME];
    (void)snprintf(name, sizeof name, "TEXCOORD_%u", set);
    return json_object_get(json_object_get(primitive, "attributes"), name);
}

/* Chooses the set for a mesh's new coordinates: 1, or the first free one if a texture of its materials uses set 1. */
static uint32_t choose_set(const struct rewrite *a, const json_t *primitives)
{
    const json_t *materials = json_object_get(a->b.root, "materials");
    bool texture = false;
    for (size_t i = 0; i < json_array_size(primitives); i++) {
        const json_t *primitive = json_array_get(primitives, i), *material = json_object_get(primitive, "material");
        texture |= accessor_of(primitive, FIRST_SET) != NULL && json_is_integer(material) &&
                   uses_set(json_array_get(materials, (size_t)json_integer_value(material)));
    }
    for (uint32_t set = texture ? FIRST_SET + 1 : FIRST_SET; texture && set < SETS_MOST; set++) {
        bool taken = false;
        for (size_t i = 0; i < json_array_size(primitives); i++)
            taken |= accessor_of(json_array_get(primitives, i), set) != NULL;
        if (!taken)
            return set;
    }
    return FIRST_SET;
}

/* ---- compression ---- */

/* Returns an attribute's accessor: the file's, or the decoded one of a compressed primitive. */
static const struct gltf_accessor *accessor_named(const struct patch *p, const char *name, uint32_t index)
{
    for (size_t i = 0; p->compressed && i < GLTF_DRACO_ATTRIBUTES; i++)
        if (p->uses[i].name != NULL && strcmp(p->uses[i].name, name) == 0)
            return p->uses[i].accessor;
    return &p->a->g.accessors[index];
}

/* Decodes a primitive with KHR_draco_mesh_compression: its values become floats. */
static void decompress(struct patch *p, const json_t *attributes)
{
    struct gltf *g = &p->a->g;
    const uint32_t indices = gltf_index(g, p->where, p->json, "indices", g->accessor_count);
    const char *name;
    json_t *value;
    size_t count = 0;
    json_object_foreach((json_t *)(uintptr_t)attributes, name, value)
    {
        const uint32_t index = gltf_index(g, p->where, attributes, name, g->accessor_count);
        if (g->status == KILN_OK && (count == GLTF_DRACO_ATTRIBUTES || strncmp(name, "JOINTS_", 7) == 0))
            gltf_fail(g, p->where, "attributes", "are compressed with Draco; of such a primitive kiln cannot write %s",
                      name);
        if (g->status != KILN_OK)
            return;
        p->copies[count] = g->accessors[index];
        p->uses[count] = (struct gltf_draco_use){name, &p->copies[count]};
        count++;
    }
    if (indices != KILN_NONE)
        p->copies[GLTF_DRACO_ATTRIBUTES] = g->accessors[indices];
    gltf_read_draco(g, p->where, p->json, p->uses, count, &p->copies[GLTF_DRACO_ATTRIBUTES], &p->values);
    p->compressed = true;
}

/* ---- layout vertices ---- */

static uint32_t add_layout_vertex(struct patch *p, uint32_t source, struct kiln_vec2 uv)
{
    take(p->a, kiln_grow(&p->layout_vertices, &p->layout_vertex_capacity, p->layout_vertex_count + 1,
                         sizeof *p->layout_vertices, "vertices of the exported scene", p->a->b.error));
    if (p->a->b.status != KILN_OK)
        return KILN_NONE;
    p->used += p->first[source] == KILN_NONE;
    p->layout_vertices[p->layout_vertex_count] = (struct layout_vertex){.uv = uv, .source = source, .next = KILN_NONE};
    return (uint32_t)p->layout_vertex_count++;
}

/* Returns the layout vertex of a vertex of the file at `uv`, and makes it if it is new. The first one of a vertex stays
 * the first in the list. */
static uint32_t layout_vertex_at(struct patch *p, uint32_t source, struct kiln_vec2 uv)
{
    uint32_t last = KILN_NONE;
    for (uint32_t i = p->first[source]; i != KILN_NONE; last = i, i = p->layout_vertices[i].next)
        if (memcmp(&p->layout_vertices[i].uv, &uv, sizeof uv) == 0)
            return i;
    const uint32_t made = add_layout_vertex(p, source, uv);
    if (last == KILN_NONE)
        p->first[source] = made;
    else if (made != KILN_NONE)
        p->layout_vertices[last].next = made;
    return made;
}

static bool same_position(const struct gltf_accessor *accessor, uint32_t vertex, struct kiln_vec3 position)
{
    struct kiln_vec3 own = {0};
    gltf_accessor_float(accessor, vertex, &own.x);
    return own.x == position.x && own.y == position.y && own.z == position.z;
}

/* Matches the file's triangle with the scene's: corners in the same order, or with the last two exchanged. */
static bool match_corners(const struct patch *p, const struct kiln_mesh *mesh, uint64_t triangle, uint32_t corner[3],
                          uint32_t slot[3])
{
    const struct kiln_scene *scene = p->a->scene;
    const struct kiln_vec3 *positions = scene->positions + mesh->vertex_first;
    const uint32_t *own = scene->triangles + 3 * triangle;
    const bool posed = (mesh->flags & KILN_MESH_POSED) != 0; /* positions of a posed mesh differ from the file's */
    const unsigned turned = (scene->triangle_sources[triangle].primitive & KILN_SOURCE_TURNED) != 0;
    for (unsigned turn = posed ? turned : 0; turn < 2; turn++) {
        bool same = true;
        for (unsigned c = 0; c < 3; c++) {
            slot[c] = turn != 0 && c > 0 ? 3 - c : c;
            same = same && (posed || same_position(p->position, corner[slot[c]], positions[own[c]]));
        }
        if (same)
            return true;
    }
    return false;
}

static void read_corners(const struct patch *p, size_t k, uint32_t corner[3])
{
    gltf_triangle(p->mode, p->indices, k, corner);
    for (int c = 0; c < 3; c++)
        if (corner[c] >= p->position->count)
            gltf_fail(&p->a->g, p->where, "indices", "refer to vertex %u, but there are %zu", corner[c],
                      p->position->count);
    take(p->a, p->a->g.status);
}

/* Gives the corners of a triangle of the scene file the layout vertices of its layout. */
static void place_triangle(struct patch *p, const struct kiln_mesh *mesh, uint64_t triangle)
{
    const struct kiln_scene *scene = p->a->scene;
    const uint32_t k = scene->triangle_sources[triangle].triangle, *own = scene->triangles + 3 * triangle;
    uint32_t corner[3], slot[3];
    if (k < p->triangle_count)
        read_corners(p, k, corner);
    if (p->a->b.status == KILN_OK && (k >= p->triangle_count || !match_corners(p, mesh, triangle, corner, slot)))
        take(p->a, kiln_fail(p->a->b.error, KILN_BAD_INPUT,
                             "%.512s: %s[%zu]%s: triangle %u is not the one that was baked; bake again",
                             p->a->b.subject, p->where.array, p->where.index, p->where.below, k));
    for (int c = 0; c < 3 && p->a->b.status == KILN_OK; c++) {
        p->vertex_of[3 * (size_t)k + slot[c]] =
            layout_vertex_at(p, corner[slot[c]], p->a->coordinates[mesh->vertex_first + own[c]]);
        p->of_mesh[3 * (size_t)k + slot[c]] = own[c];
    }
}

/* Triangles without area have no position in the layout. Their corners take a layout vertex of their vertex, or of
 * another corner, or vertex 0. */
static void place_rest(struct patch *p)
{
    for (size_t k = 0; k < p->triangle_count && p->a->b.status == KILN_OK; k++) {
        uint32_t *layout_vertices = p->vertex_of + 3 * k, corner[3];
        struct kiln_vec2 uv = {0.0f, 0.0f};
        if (layout_vertices[0] != KILN_NONE)
            continue;
        read_corners(p, k, corner);
        for (int c = 2; c >= 0 && p->a->b.status == KILN_OK; c--)
            if (p->first[corner[c]] != KILN_NONE)
                uv = p->layout_vertices[p->first[corner[c]]].uv;
        for (int c = 0; c < 3 && p->a->b.status == KILN_OK; c++)
            layout_vertices[c] =
                p->first[corner[c]] != KILN_NONE ? p->first[corner[c]] : layout_vertex_at(p, corner[c], uv);
    }
}

/* Whether TEXCOORD_1 already has these coordinates. */
static bool is_unchanged(const struct patch *p)
{
    const json_t *index = accessor_of(p->json, FIRST_SET);
    if (index == NULL || json_integer_value(index) < 0 || (size_t)json_integer_value(index) >= p->a->g.accessor_count)
        return false;
    const struct gltf_accessor *own = accessor_named(p, "TEXCOORD_1", (uint32_t)json_integer_value(index));
    for (size_t i = 0; i < p->layout_vertex_count && own->components == 2 && own->count == p->position->count; i++) {
        struct kiln_vec2 uv;
        gltf_accessor_float(own, p->layout_vertices[i].source, &uv.x);
        if (uv.x != p->layout_vertices[i].uv.x || uv.y != p->layout_vertices[i].uv.y)
            return false;
    }
    return own->components == 2 && own->count == p->position->count;
}

/* ---- writing ---- */

/* Returns the JSON of an accessor. NULL when out of memory, which kiln_glb_append reports. */
static json_t *accessor_json(uint32_t view, unsigned component, size_t count, const char *type)
{
    return json_pack("{s:i, s:i, s:I, s:s}", "bufferView", (int)view, "componentType", (int)component, "count",
                     (json_int_t)count, "type", type);
}

/* Sets the primitive's attribute for the lightmap's set. Sets below it that do not exist are set, too, since glTF
 * allows no gap. */
static void set_texcoord(struct patch *p, uint32_t set, uint32_t accessor)
{
    json_t *attributes = json_object_get(p->json, "attributes");
    char name[NAME];
    for (uint32_t s = 0; s <= set; s++) {
        (void)snprintf(name, sizeof name, "TEXCOORD_%u", s);
        if (s == set || json_object_get(attributes, name) == NULL)
            kiln_glb_set(&p->a->b, attributes, name, json_integer(accessor));
    }
}

/* Adds coordinates for all vertices of the file. Vertices that no triangle uses get 0. */
static void add_coordinates(struct patch *p, uint32_t set)
{
    struct kiln_glb_build *b = &p->a->b;
    unsigned char *bytes;
    const size_t count = p->position->count;
    const uint32_t view = kiln_glb_view(b, count * sizeof(struct kiln_vec2), 0, KILN_GLTF_ARRAY_BUFFER, &bytes);
    for (size_t v = 0; v < count && bytes != NULL; v++) {
        const struct kiln_vec2 nothing = {0.0f, 0.0f};
        memcpy(bytes + v * sizeof nothing, p->first[v] == KILN_NONE ? &nothing : &p->layout_vertices[p->first[v]].uv,
               sizeof nothing);
    }
    set_texcoord(p, set, kiln_glb_append(b, b->root, "accessors", accessor_json(view, KILN_GLTF_FLOAT, count, "VEC2")));
}

/* Numbers the new vertices. The first layout vertex of each vertex of the file comes first, in the file's order; the
 * others follow in the order of their making. `order` receives the layout vertex of each new vertex. */
static void number_layout_vertices(struct patch *p, uint32_t *order)
{
    uint32_t next = 0;
    for (size_t v = 0; v < p->position->count; v++)
        if (p->first[v] != KILN_NONE) {
            p->layout_vertices[p->first[v]].vertex = next;
            order[next++] = p->first[v];
        }
    for (size_t i = 0; i < p->layout_vertex_count; i++)
        if (p->first[p->layout_vertices[i].source] != i) {
            p->layout_vertices[i].vertex = next;
            order[next++] = (uint32_t)i;
        }
}

/* Sets min and max to the new elements' bounds, if the old accessor had them. */
static void set_bounds(struct patch *p, json_t *made, const json_t *old, const struct gltf_accessor *accessor,
                       const uint32_t *order)
{
    if (json_object_get(old, "min") == NULL && json_object_get(old, "max") == NULL)
        return;
    json_t *low = json_array(), *high = json_array();
    for (unsigned c = 0; c < accessor->components; c++) {
        double least = INFINITY, most = -INFINITY;
        for (size_t v = 0; v < p->layout_vertex_count; v++) {
            const double value = gltf_accessor_raw(accessor, p->layout_vertices[order[v]].source, c);
            least = fmin(least, value);
            most = fmax(most, value);
        }
        (void)json_array_append_new(low, accessor->component == KILN_GLTF_FLOAT ? json_real(least)
                                                                                : json_integer((json_int_t)least));
        (void)json_array_append_new(high, accessor->component == KILN_GLTF_FLOAT ? json_real(most)
                                                                                 : json_integer((json_int_t)most));
    }
    kiln_glb_set(&p->a->b, made, "min", low);
    kiln_glb_set(&p->a->b, made, "max", high);
}

/* Copies an attribute's elements to a new accessor. */
static uint32_t copy_attribute(struct patch *p, const char *name, uint32_t index, const uint32_t *order)
{
    struct kiln_glb_build *b = &p->a->b;
    const struct gltf_accessor *accessor = accessor_named(p, name, index);
    const json_t *old = json_array_get(json_object_get(b->root, "accessors"), index);
    const char *type = json_string_value(json_object_get(old, "type"));
    const size_t size = gltf_component_size(accessor->component) * accessor->components, stride = (size + 3) / 4 * 4;
    unsigned char *bytes;
    if (accessor->count != p->position->count || type == NULL || strncmp(type, "MAT", 3) == 0) {
        gltf_fail(&p->a->g, p->where, name, "is accessor %u, whose elements are not one for each of %zu vertices",
                  index, p->position->count);
        take(p->a, p->a->g.status);
        return 0;
    }
    const uint32_t view =
        kiln_glb_view(b, stride * p->layout_vertex_count, stride == size ? 0 : stride, KILN_GLTF_ARRAY_BUFFER, &bytes);
    for (size_t v = 0; v < p->layout_vertex_count && bytes != NULL; v++) {
        const unsigned char *from = gltf_accessor_element(accessor, p->layout_vertices[order[v]].source);
        memset(bytes + v * stride, 0, stride);
        if (from != NULL)
            memcpy(bytes + v * stride, from, size);
    }
    json_t *made = accessor_json(view, accessor->component, p->layout_vertex_count, type);
    if (accessor->normalized)
        kiln_glb_set(b, made, "normalized", json_true());
    set_bounds(p, made, old, accessor, order);
    static const char *const kept[] = {"name", "extras"};
    for (size_t i = 0; i < sizeof kept / sizeof kept[0]; i++)
        if (json_object_get(old, kept[i]) != NULL)
            kiln_glb_set(b, made, kept[i], json_incref(json_object_get(old, kept[i])));
    return kiln_glb_append(b, b->root, "accessors", made);
}

/* Copies all attributes of a primitive or morph target except the one called `left_out`. */
static void copy_attributes(struct patch *p, json_t *attributes, const char *left_out, const uint32_t *order)
{
    const char *name;
    json_t *value;
    void *next;
    json_object_foreach_safe(attributes, next, name, value)
    {
        if (p->a->b.status != KILN_OK || (left_out != NULL && strcmp(name, left_out) == 0))
            continue;
        const uint32_t index = gltf_index(&p->a->g, p->where, attributes, name, p->a->g.accessor_count);
        take(p->a, p->a->g.status);
        if (p->a->b.status == KILN_OK)
            kiln_glb_set(&p->a->b, attributes, name, json_integer(copy_attribute(p, name, index, order)));
    }
}

static void write_indices(struct patch *p)
{
    struct kiln_glb_build *b = &p->a->b;
    const bool small = p->layout_vertex_count <= UINT16_MAX;
    const size_t size = small ? 2 : 4, count = 3 * p->triangle_count;
    unsigned char *bytes;
    const uint32_t view = kiln_glb_view(b, size * count, 0, KILN_GLTF_ELEMENT_ARRAY_BUFFER, &bytes);
    for (size_t i = 0; i < count && bytes != NULL; i++) {
        const uint32_t index = p->layout_vertices[p->vertex_of[i]].vertex;
        for (size_t k = 0; k < size; k++)
            bytes[i * size + k] = (unsigned char)(index >> (8 * k));
    }
    json_t *made = accessor_json(view, small ? KILN_GLTF_UNSIGNED_SHORT : KILN_GLTF_UNSIGNED_INT, count, "SCALAR");
    kiln_glb_set(b, p->json, "indices", json_integer(kiln_glb_append(b, b->root, "accessors", made)));
    (void)json_object_del(p->json, "mode");
}

/* Writes the lightmap's coordinates in the order of the new vertices. */
static void write_coordinates(struct patch *p, uint32_t set, const uint32_t *order)
{
    struct kiln_glb_build *b = &p->a->b;
    unsigned char *bytes;
    const uint32_t view =
        kiln_glb_view(b, p->layout_vertex_count * sizeof(struct kiln_vec2), 0, KILN_GLTF_ARRAY_BUFFER, &bytes);
    for (size_t v = 0; v < p->layout_vertex_count && bytes != NULL; v++)
        memcpy(bytes + v * sizeof(struct kiln_vec2), &p->layout_vertices[order[v]].uv, sizeof(struct kiln_vec2));
    set_texcoord(
        p, set,
        kiln_glb_append(b, b->root, "accessors", accessor_json(view, KILN_GLTF_FLOAT, p->layout_vertex_count, "VEC2")));
}

static void rewrite(struct patch *p, uint32_t set)
{
    uint32_t *order = NULL;
    char name[NAME];
    const json_t *targets = json_object_get(p->json, "targets");
    (void)snprintf(name, sizeof name, "TEXCOORD_%u", set);
    take(p->a,
         kiln_allocate(&order, p->layout_vertex_count, sizeof *order, "vertices of the exported scene", p->a->b.error));
    if (p->a->b.status == KILN_OK)
        number_layout_vertices(p, order);
    if (p->a->b.status == KILN_OK)
        copy_attributes(p, json_object_get(p->json, "attributes"), name, order);
    for (size_t i = 0; i < json_array_size(targets) && p->a->b.status == KILN_OK; i++)
        copy_attributes(p, json_array_get(targets, i), NULL, order);
    if (p->a->b.status == KILN_OK)
        write_coordinates(p, set, order);
    if (p->a->b.status == KILN_OK)
        write_indices(p);
    kiln_free(&order);
}

/* ---- primitives ---- */

static bool begin_patch(struct patch *p)
{
    struct gltf *g = &p->a->g;
    const json_t *attributes = gltf_object(g, p->where, p->json, "attributes");
    const uint32_t position = gltf_index(g, p->where, attributes, "POSITION", g->accessor_count);
    const uint32_t indices = gltf_index(g, p->where, p->json, "indices", g->accessor_count);
    p->mode = (unsigned)gltf_whole(g, p->where, p->json, "mode", 0, 6, TRIANGLES);
    if (g->status == KILN_OK && position == KILN_NONE)
        gltf_fail(g, p->where, "attributes.POSITION", "is missing");
    take(p->a, g->status);
    if (p->a->b.status != KILN_OK || p->mode < TRIANGLES)
        return false;
    if (gltf_extension(g, p->where, p->json, "KHR_draco_mesh_compression") != NULL)
        decompress(p, attributes);
    take(p->a, g->status);
    if (p->a->b.status != KILN_OK)
        return false;
    p->position = accessor_named(p, "POSITION", position);
    p->indices = p->compressed          ? &p->copies[GLTF_DRACO_ATTRIBUTES]
                 : indices == KILN_NONE ? NULL
                                        : &g->accessors[indices];
    const size_t corners = p->indices == NULL ? p->position->count : p->indices->count;
    p->triangle_count = p->mode == TRIANGLES ? corners / 3 : corners < 3 ? 0 : corners - 2;
    take(p->a, kiln_allocate(&p->vertex_of, 3 * p->triangle_count, sizeof *p->vertex_of,
                             "corners of the exported scene", p->a->b.error));
    if (p->a->b.status == KILN_OK)
        take(p->a, kiln_allocate(&p->of_mesh, 3 * p->triangle_count, sizeof *p->of_mesh,
                                 "corners of the exported scene", p->a->b.error));
    if (p->a->b.status == KILN_OK)
        take(p->a, kiln_allocate(&p->first, p->position->count, sizeof *p->first, "vertices of the exported scene",
                                 p->a->b.error));
    if (p->a->b.status != KILN_OK)
        return false;
    memset(p->vertex_of, 0xff, 3 * p->triangle_count * sizeof *p->vertex_of);
    memset(p->of_mesh, 0xff, 3 * p->triangle_count * sizeof *p->of_mesh);
    memset(p->first, 0xff, p->position->count * sizeof *p->first);
    return p->triangle_count > 0;
}

/* Makes layout vertices for a primitive of mesh `mesh`. The primitive's triangles are consecutive in the mesh, from
 * *next on. Tells whether the coordinates are new. */
static void place_primitive(struct patch *p, const struct kiln_mesh *mesh, uint32_t index, uint64_t *next)
{
    const uint64_t end = mesh->triangle_first + mesh->triangle_count;
    for (; *next < end && (p->a->scene->triangle_sources[*next].primitive & ~KILN_SOURCE_TURNED) == index &&
           p->a->b.status == KILN_OK;
         ++*next)
        place_triangle(p, mesh, *next);
    if (p->a->b.status == KILN_OK)
        p->changed = (mesh->flags & KILN_MESH_NO_LAYOUT) == 0 && !is_unchanged(p);
    if (p->a->b.status == KILN_OK)
        place_rest(p);
}

/* Removes the compression extension, if any: the new values are not compressed. */
static bool drop_compression(json_t *primitive)
{
    json_t *extensions = json_object_get(primitive, "extensions");
    const bool dropped = json_object_del(extensions, "KHR_draco_mesh_compression") == 0;
    if (extensions != NULL && json_object_size(extensions) == 0)
        (void)json_object_del(primitive, "extensions");
    return dropped;
}

/* Writes the coordinates of a primitive. Returns whether it has new vertices. */
static bool write_primitive(struct patch *p, uint32_t set)
{
    const bool compressed = drop_compression(p->json);
    if (!compressed && p->layout_vertex_count == p->used && 2 * p->used >= p->position->count) {
        add_coordinates(p, set);
        return false;
    }
    rewrite(p, set);
    return true;
}

/* Hands the primitive's corners over to `a`. `anew`: its vertices were replaced by the layout vertices. */
static void keep_corners(struct patch *p, size_t mesh, size_t primitive, bool anew)
{
    struct rewrite *a = p->a;
    take(a, kiln_grow(&a->corners, &a->corner_capacity, a->corner_count + 1, sizeof *a->corners,
                      "corners of the exported scene", a->b.error));
    if (a->b.status != KILN_OK)
        return;
    for (size_t i = 0; i < 3 * p->triangle_count; i++) {
        const struct layout_vertex *v = &p->layout_vertices[p->vertex_of[i]];
        p->vertex_of[i] = anew ? v->vertex : v->source;
    }
    a->corners[a->corner_count++] =
        (struct written_corners){.mesh = mesh,
                                 .primitive = primitive,
                                 .count = 3 * p->triangle_count,
                                 .vertex_count = anew ? p->layout_vertex_count : p->position->count,
                                 .vertex = p->vertex_of,
                                 .of_mesh = p->of_mesh};
    p->vertex_of = p->of_mesh = NULL;
}

static void end_patch(struct patch *p)
{
    gltf_draco_values_free(&p->values);
    kiln_free(&p->layout_vertices);
    kiln_free(&p->first);
    kiln_free(&p->vertex_of);
    kiln_free(&p->of_mesh);
}

/* Visits the mesh's primitives: first to find out whether any has new coordinates, then to write them. */
static bool patch_primitives(struct rewrite *a, size_t index, const struct kiln_mesh *mesh, json_t *primitives,
                             bool write, uint32_t set)
{
    uint64_t next = mesh->triangle_first;
    bool changed = false;
    for (size_t i = 0; i < json_array_size(primitives) && a->b.status == KILN_OK; i++) {
        char below[40];
        (void)snprintf(below, sizeof below, ".primitives[%zu]", i);
        struct patch p = {.a = a, .where = {"meshes", index, below}, .json = json_array_get(primitives, i)};
        if (begin_patch(&p))
            place_primitive(&p, mesh, (uint32_t)i, &next);
        const bool whole = p.position != NULL && a->b.status == KILN_OK && p.triangle_count > 0,
                   anew = write && whole && (p.changed || set != FIRST_SET) && write_primitive(&p, set);
        if (write && whole && a->light != NULL && a->b.status == KILN_OK)
            keep_corners(&p, index, i, anew);
        changed |= p.changed;
        end_patch(&p);
    }
    if (a->b.status == KILN_OK && next != mesh->triangle_first + mesh->triangle_count)
        take(a, kiln_fail(a->b.error, KILN_BAD_INPUT, "%.512s: meshes[%zu] is not the one that was baked; bake again",
                          a->b.subject, index));
    return changed;
}

static void patch_mesh(struct rewrite *a, size_t index, const struct kiln_mesh *mesh)
{
    json_t *primitives =
        gltf_array(&a->g, (struct gltf_place){"meshes", index, ""}, gltf_element(&a->g, "meshes", index), "primitives");
    take(a, a->g.status);
    a->set_of[index] = FIRST_SET;
    if (a->b.status != KILN_OK)
        return;
    const bool changed = patch_primitives(a, index, mesh, primitives, false, FIRST_SET);
    if (a->b.status != KILN_OK || (!changed && a->light == NULL))
        return;
    if (changed)
        a->set_of[index] = choose_set(a, primitives);
    (void)patch_primitives(a, index, mesh, primitives, true, a->set_of[index]);
}

/* Finds the mesh of the file for each scene mesh. If a mesh of the file was baked in several poses, the later poses get
 * copies of it. The copies share its accessors, and the poses' nodes refer to them. */
static void part_poses(struct rewrite *a)
{
    const struct kiln_scene *scene = a->scene;
    json_t *meshes = json_object_get(a->b.root, "meshes"), *nodes = json_object_get(a->b.root, "nodes");
    uint8_t *taken = NULL;
    const size_t count = a->g.mesh_count;
    take(a, kiln_allocate(&taken, count, 1, "meshes", a->b.error));
    take(a, kiln_allocate(&a->mesh_of, scene->mesh_count, sizeof *a->mesh_of, "meshes", a->b.error));
    if (a->b.status == KILN_OK)
        memset(a->mesh_of, 0xff, scene->mesh_count * sizeof *a->mesh_of);
    for (size_t i = 0; i < scene->object_count && a->b.status == KILN_OK; i++) {
        const struct kiln_object *o = &scene->objects[i];
        if (o->source_mesh >= count || o->source_node >= json_array_size(nodes))
            take(a, kiln_fail(a->b.error, KILN_BAD_INPUT,
                              "%.512s: it has no mesh %u or node %u, which were baked; bake again", a->b.subject,
                              o->source_mesh, o->source_node));
        else if (a->mesh_of[o->mesh] == KILN_NONE)
            a->mesh_of[o->mesh] = !taken[o->source_mesh]
                                      ? o->source_mesh
                                      : kiln_glb_append(&a->b, a->b.root, "meshes",
                                                        json_deep_copy(json_array_get(meshes, o->source_mesh)));
        if (a->b.status != KILN_OK)
            continue;
        taken[o->source_mesh] = 1;
        if (a->mesh_of[o->mesh] != o->source_mesh)
            kiln_glb_set(&a->b, json_array_get(nodes, o->source_node), "mesh", json_integer(a->mesh_of[o->mesh]));
    }
    a->g.mesh_count = json_array_size(json_object_get(a->b.root, "meshes"));
    kiln_free(&taken);
}

void kiln_rewrite_meshes(struct rewrite *a)
{
    const struct kiln_scene *scene = a->scene;
    uint8_t *done = NULL;
    if (scene->triangle_sources == NULL && scene->triangle_count > 0)
        take(a, kiln_fail(a->b.error, KILN_BAD_INPUT,
                          "%.512s: the bake's scene file does not record where its triangles come from; bake again",
                          a->b.subject));
    if (a->b.status == KILN_OK)
        part_poses(a);
    take(a, kiln_allocate(&done, scene->mesh_count, 1, "meshes", a->b.error));
    take(a, kiln_allocate(&a->set_of, a->g.mesh_count, sizeof *a->set_of, "meshes", a->b.error));
    for (size_t i = 0; i < scene->object_count && a->b.status == KILN_OK; i++) {
        const uint32_t mesh = scene->objects[i].mesh;
        if (!done[mesh])
            patch_mesh(a, a->mesh_of[mesh], &scene->meshes[mesh]);
        done[mesh] = 1;
    }
    kiln_free(&done);
}
