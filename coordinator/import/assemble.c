#include "coordinator/import/assemble.h"

#include <math.h>
#include <string.h>
#include <xxhash.h>

#include "worker/base/affine.h"
#include "worker/base/memory.h"

static const double area_floor = 1e-12;  /* 2 A / longest edge^2 that a triangle must exceed to be kept */
static const float smooth_floor = 1e-3f; /* difference of unit normals that is visible in shading */

/* Key of the hash table of stored vertices: the file's vertex and the normal. */
struct vertex_key {
    uint32_t source;
    struct kiln_vec3 normal;
};
struct vertex_slot {
    struct vertex_key key;
    uint32_t vertex; /* KILN_NONE: free slot */
};
struct vertex_table {
    struct vertex_slot *slots;
    size_t slot_count, used;
};

struct triangle {
    uint32_t corner[3];
    struct kiln_vec3 position[3], normal[3];
    struct kiln_vec3 geometric;
    bool turned; /* the last two corners are exchanged against the file */
};

static int table_resize(struct vertex_table *table, size_t slot_count, struct kiln_error *error)
{
    struct vertex_table old = *table;
    struct vertex_slot *slots = NULL;
    const int status = kiln_allocate(&slots, slot_count, sizeof *slots, "vertices", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < slot_count; i++)
        slots[i].vertex = KILN_NONE;
    for (size_t i = 0; i < old.slot_count; i++) {
        if (old.slots[i].vertex == KILN_NONE)
            continue;
        size_t slot = (size_t)XXH3_64bits(&old.slots[i].key, sizeof old.slots[i].key) & (slot_count - 1);
        while (slots[slot].vertex != KILN_NONE)
            slot = (slot + 1) & (slot_count - 1);
        slots[slot] = old.slots[i];
    }
    table->slots = slots;
    table->slot_count = slot_count;
    kiln_free(&old.slots);
    return KILN_OK;
}

static struct vertex_slot *table_find(const struct vertex_table *table, const struct vertex_key *key)
{
    size_t slot = (size_t)XXH3_64bits(key, sizeof *key) & (table->slot_count - 1);
    while (table->slots[slot].vertex != KILN_NONE && memcmp(&table->slots[slot].key, key, sizeof *key) != 0)
        slot = (slot + 1) & (table->slot_count - 1);
    return &table->slots[slot];
}

int kiln_mesh_begin(struct kiln_builder *builder, const char *name, uint32_t *index, struct kiln_error *error)
{
    struct kiln_mesh mesh = {.vertex_first = builder->sections[KILN_SECTION_POSITIONS].count,
                             .triangle_first = builder->sections[KILN_SECTION_TRIANGLES].count};
    size_t at;
    int status;
    KILN_TRY(kiln_builder_string(builder, name, strlen(name), &mesh.name, error));
    KILN_TRY(kiln_builder_append(builder, KILN_SECTION_MESHES, &mesh, 1, &at, error));
    *index = (uint32_t)at;
end:
    return status;
}

/* Stores a new vertex. */
static int add_vertex(struct kiln_builder *builder, struct kiln_mesh *mesh, const struct kiln_primitive *primitive,
                      uint32_t source, struct kiln_vec3 position, struct kiln_vec3 normal, uint32_t *vertex,
                      struct kiln_error *error)
{
    struct kiln_attributes a = {.color = {255, 255, 255, 255}};
    if (mesh->vertex_count >= KILN_NONE - 1)
        return kiln_fail(error, KILN_BAD_INPUT, "%s: the mesh has more than 2^32 - 2 vertices; split it",
                         primitive->where);
    primitive->attributes(primitive->context, source, &a);
    if (!isfinite(a.base.x) || !isfinite(a.base.y) || !isfinite(a.emission.x) || !isfinite(a.emission.y) ||
        !isfinite(a.lightmap.x) || !isfinite(a.lightmap.y) || !isfinite(a.normal.x) || !isfinite(a.normal.y) ||
        !isfinite(a.gloss.x) || !isfinite(a.gloss.y))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%s: a texture coordinate of vertex %u is infinite or not a number; repair the file",
                         primitive->where, source);
    const struct {
        enum kiln_scene_section section;
        const void *data;
    } columns[] = {{KILN_SECTION_POSITIONS, &position},           {KILN_SECTION_NORMALS, &normal},
                   {KILN_SECTION_TEXCOORD_BASE, &a.base},         {KILN_SECTION_TEXCOORD_EMISSION, &a.emission},
                   {KILN_SECTION_TEXCOORD_LIGHTMAP, &a.lightmap}, {KILN_SECTION_COLORS, a.color},
                   {KILN_SECTION_TEXCOORD_NORMAL, &a.normal},     {KILN_SECTION_TEXCOORD_GLOSS, &a.gloss}};
    for (size_t i = 0; i < sizeof columns / sizeof columns[0]; i++) {
        if (!kiln_builder_has(builder, columns[i].section))
            continue;
        const int status = kiln_builder_append(builder, columns[i].section, columns[i].data, 1, NULL, error);
        if (status != KILN_OK)
            return status;
    }
    if (a.base.x != a.emission.x || a.base.y != a.emission.y)
        mesh->flags |= KILN_MESH_HAS_EMISSION_UV;
    *vertex = (uint32_t)mesh->vertex_count++;
    return KILN_OK;
}

static int read_triangle(const struct kiln_primitive *primitive, size_t k, struct triangle *t, struct kiln_error *error)
{
    primitive->corners(primitive->context, k, t->corner);
    t->turned = primitive->turned;
    for (int c = 0; c < 3; c++) {
        if (t->corner[c] >= primitive->vertex_count)
            return kiln_fail(error, KILN_BAD_INPUT,
                             "%s: triangle %zu uses vertex %u, but there are %zu vertices; repair the file",
                             primitive->where, k, t->corner[c], primitive->vertex_count);
        t->normal[c] = vec3(0.0f, 0.0f, 0.0f);
        primitive->geometry(primitive->context, t->corner[c], &t->position[c], &t->normal[c]);
        const struct kiln_vec3 p = t->position[c];
        if (!(fabsf(p.x) <= KILN_COORDINATE_MAX && fabsf(p.y) <= KILN_COORDINATE_MAX &&
              fabsf(p.z) <= KILN_COORDINATE_MAX))
            return kiln_fail(error, KILN_BAD_INPUT,
                             "%s: the position of vertex %u is (%g, %g, %g), not a number within +-%g; repair the file",
                             primitive->where, t->corner[c], (double)p.x, (double)p.y, (double)p.z,
                             (double)KILN_COORDINATE_MAX);
        /* turns -0 into 0: the two are equal, but vertices are found by their bits */
        t->position[c] = vec3_add(p, vec3(0.0f, 0.0f, 0.0f));
    }
    return KILN_OK;
}

/* Whether the triangle has an area; computes its geometric normal. */
static bool has_area(struct triangle *t)
{
    const struct kiln_dvec3 p = dvec3_of(t->position[0]);
    const struct kiln_dvec3 a = dvec3_sub(dvec3_of(t->position[1]), p), b = dvec3_sub(dvec3_of(t->position[2]), p),
                            c = dvec3_sub(b, a);
    const double longest = fmax(dvec3_dot(a, a), fmax(dvec3_dot(b, b), dvec3_dot(c, c)));
    const struct kiln_dvec3 cross = dvec3_cross(a, b);
    const double length = dvec3_length(cross);
    if (!(length > area_floor * longest))
        return false;
    t->geometric = vec3_add(vec3_of(dvec3_scale(cross, 1.0 / length)), vec3(0.0f, 0.0f, 0.0f));
    return true;
}

static struct kiln_vec3 unit(struct kiln_vec3 n)
{
    /* computed in double: even normals of length 1e-30 or 1e30 have a direction */
    const struct kiln_dvec3 d = dvec3_of(n);
    const double length = dvec3_length(d);
    if (!(length > 0.0) || !isfinite(length))
        return vec3(0.0f, 0.0f, 0.0f);
    return vec3_add(vec3_of(dvec3_scale(d, 1.0 / length)), vec3(0.0f, 0.0f, 0.0f));
}

static struct kiln_vec3 opposite(struct kiln_vec3 n) { return vec3_sub(vec3(0.0f, 0.0f, 0.0f), n); }

/* Exchanges corners 1 and 2, which reverses the winding. */
static void flip_triangle(struct triangle *t)
{
    const uint32_t corner = t->corner[1];
    const struct kiln_vec3 position = t->position[1], normal = t->normal[1];
    t->corner[1] = t->corner[2];
    t->position[1] = t->position[2];
    t->normal[1] = t->normal[2];
    t->corner[2] = corner;
    t->position[2] = position;
    t->normal[2] = normal;
    t->geometric = opposite(t->geometric);
    t->turned = !t->turned;
}

/* Makes winding and normals agree on the front; returns whether they did not. */
static bool settle_front(struct triangle *t, bool trust_normals)
{
    float lean = 0.0f;
    for (int c = 0; c < 3; c++) {
        t->normal[c] = unit(t->normal[c]);
        lean += vec3_dot(t->normal[c], t->geometric);
    }
    if (!(lean < 0.0f))
        return false;
    if (trust_normals)
        flip_triangle(t);
    for (int c = 0; c < 3 && !trust_normals; c++)
        t->normal[c] = opposite(t->normal[c]);
    return true;
}

/* Makes the three normals unit vectors on the front side. Returns how many of the file's normals were zero. */
static unsigned settle_normals(struct triangle *t, bool given, struct kiln_assembly_counts *counts, uint32_t *flags)
{
    unsigned zero = 0;
    for (int c = 0; c < 3; c++) {
        struct kiln_vec3 n = t->normal[c];
        if (!given || vec3_dot(n, n) == 0.0f) {
            zero += given;
            n = t->geometric;
        } else if (vec3_dot(n, t->geometric) <= 0.0f) {
            counts->replaced_normals++;
            n = t->geometric;
        }
        if (vec3_length(vec3_sub(n, t->geometric)) > smooth_floor)
            *flags |= KILN_MESH_SMOOTH;
        t->normal[c] = n;
    }
    return zero;
}

/* Stores a triangle; `k` is its index in the primitive. */
static int store_triangle(struct kiln_builder *builder, struct kiln_mesh *mesh, const struct kiln_primitive *primitive,
                          size_t k, const struct triangle *t, struct vertex_table *table, struct kiln_error *error)
{
    uint32_t corner[3];
    for (int c = 0; c < 3; c++) {
        if (2 * (table->used + 1) > table->slot_count) {
            const int grown = table_resize(table, table->slot_count == 0 ? 64 : 2 * table->slot_count, error);
            if (grown != KILN_OK)
                return grown;
        }
        struct vertex_key key;
        memset(&key, 0, sizeof key);
        key.source = t->corner[c];
        key.normal = t->normal[c];
        struct vertex_slot *slot = table_find(table, &key);
        if (slot->vertex == KILN_NONE) {
            const int status =
                add_vertex(builder, mesh, primitive, t->corner[c], t->position[c], t->normal[c], &slot->vertex, error);
            if (status != KILN_OK)
                return status;
            slot->key = key;
            table->used++;
        }
        corner[c] = slot->vertex;
    }
    int status = kiln_builder_append(builder, KILN_SECTION_TRIANGLES, corner, 1, NULL, error);
    if (status == KILN_OK)
        status = kiln_builder_append(builder, KILN_SECTION_TRIANGLE_MATERIALS, &primitive->material, 1, NULL, error);
    const struct kiln_triangle_source source = {
        primitive->index | (primitive->posed && t->turned ? KILN_SOURCE_TURNED : 0u), (uint32_t)k};
    if (status == KILN_OK)
        status = kiln_builder_append(builder, KILN_SECTION_TRIANGLE_SOURCES, &source, 1, NULL, error);
    mesh->triangle_count++;
    return status;
}

int kiln_mesh_add(struct kiln_builder *builder, uint32_t index, const struct kiln_primitive *primitive,
                  struct kiln_assembly_counts *counts, struct kiln_error *error)
{
    struct kiln_mesh mesh = KILN_BUILDER_DATA(builder, const struct kiln_mesh, KILN_SECTION_MESHES)[index];
    struct vertex_table table = {0};
    uint64_t kept = 0, zero_normals = 0;
    mesh.flags |= primitive->posed ? (uint32_t)KILN_MESH_POSED : 0u;
    int status = KILN_OK;
    for (size_t k = 0; k < primitive->triangle_count && status == KILN_OK; k++) {
        struct triangle t = {0};
        status = read_triangle(primitive, k, &t, error);
        if (status != KILN_OK)
            break;
        if (!has_area(&t)) {
            counts->without_area++;
            continue;
        }
        kept++;
        if (primitive->has_normals && settle_front(&t, builder->trust_normals))
            builder->mesh_turned[index]++;
        const unsigned zero = settle_normals(&t, primitive->has_normals, counts, &mesh.flags);
        zero_normals += zero;
        counts->replaced_normals += zero;
        status = store_triangle(builder, &mesh, primitive, k, &t, &table, error);
    }
    kiln_free(&table.slots);
    if (status == KILN_OK && kept > 0 && zero_normals == 3 * kept)
        status = kiln_fail(error, KILN_BAD_INPUT, "%s: all its normals are zero; leave them out or export them again",
                           primitive->where);
    KILN_BUILDER_DATA(builder, struct kiln_mesh, KILN_SECTION_MESHES)[index] = mesh;
    return status;
}

/* Whether the mesh has area in the world; stops at the first triangle that has. */
static bool object_has_area(const struct kiln_builder *builder, const struct kiln_mesh *mesh, const double m[12])
{
    const struct kiln_vec3 *positions =
        KILN_BUILDER_DATA(builder, const struct kiln_vec3, KILN_SECTION_POSITIONS) + mesh->vertex_first;
    const uint32_t *corners =
        KILN_BUILDER_DATA(builder, const uint32_t, KILN_SECTION_TRIANGLES) + 3 * mesh->triangle_first;
    for (uint64_t t = 0; t < mesh->triangle_count; t++) {
        struct kiln_dvec3 w[3];
        for (int c = 0; c < 3; c++) {
            const struct kiln_dvec3 p = dvec3_of(positions[corners[3 * t + (uint64_t)c]]);
            w[c] = dvec3(m[0] * p.x + m[1] * p.y + m[2] * p.z, m[4] * p.x + m[5] * p.y + m[6] * p.z,
                         m[8] * p.x + m[9] * p.y + m[10] * p.z);
        }
        const struct kiln_dvec3 a = dvec3_sub(w[1], w[0]), b = dvec3_sub(w[2], w[0]);
        if (dvec3_length(dvec3_cross(a, b)) > area_floor * fmax(dvec3_dot(a, a), dvec3_dot(b, b)))
            return true;
    }
    return false;
}

int kiln_object_add(struct kiln_builder *builder, uint32_t mesh_index, const double transform[12], const char *name,
                    const char *original, const struct kiln_object_source *source, const char *where, bool *skipped,
                    struct kiln_error *error)
{
    const struct kiln_mesh *mesh = &KILN_BUILDER_DATA(builder, const struct kiln_mesh, KILN_SECTION_MESHES)[mesh_index];
    *skipped = false;
    double size = 0.0;
    for (int i = 0; i < 12; i++) {
        /* bounded so that no sum of products below overflows; kiln_builder_write checks the extent in world space */
        if (!(fabs(transform[i]) <= 1e30))
            return kiln_fail(error, KILN_BAD_INPUT,
                             "%s: its transform has a value that is infinite or not a number (%g); repair the file",
                             where, transform[i]);
        if (i % 4 != 3)
            size = fmax(size, fabs(transform[i]));
    }
    const double det = kiln_affine_determinant(transform);
    if (fabs(det) <= 1e-9 * size * size * size && !object_has_area(builder, mesh, transform)) {
        *skipped = true;
        return KILN_OK;
    }
    struct kiln_object object = {.mesh = mesh_index,
                                 .flipped = det < 0.0,
                                 .source_node = KILN_NONE,
                                 .source_mesh = KILN_NONE,
                                 .source_instance = KILN_NONE};
    if (source != NULL) {
        object.source_node = source->node;
        object.source_mesh = source->mesh;
        object.source_instance = source->instance;
    }
    memcpy(object.transform, transform, sizeof object.transform);
    int status = kiln_builder_string(builder, name, strlen(name), &object.name, error);
    if (status == KILN_OK)
        status = kiln_builder_string(builder, original, strlen(original), &object.original_name, error);
    return status != KILN_OK ? status : kiln_builder_append(builder, KILN_SECTION_OBJECTS, &object, 1, NULL, error);
}

static int note_object(struct kiln_builder *builder, size_t index, struct kiln_error *error)
{
    const struct kiln_object *object =
        &KILN_BUILDER_DATA(builder, const struct kiln_object, KILN_SECTION_OBJECTS)[index];
    const struct kiln_mesh *mesh =
        &KILN_BUILDER_DATA(builder, const struct kiln_mesh, KILN_SECTION_MESHES)[object->mesh];
    return kiln_builder_note(
        builder, builder->trust_normals ? KILN_NOTE_INFORMATION : KILN_NOTE_REPEATED, error,
        "object \"%.200s\": %llu of %llu triangles have normals that point to the back of their winding; %s",
        KILN_BUILDER_DATA(builder, const char, KILN_SECTION_STRINGS) + object->name,
        (unsigned long long)builder->mesh_turned[object->mesh], (unsigned long long)mesh->triangle_count,
        builder->trust_normals
            ? "the normals decide: these triangles were flipped"
            : "the winding decides: these normals were reversed (--trust normals flips the triangles instead)");
}

int kiln_note_winding(struct kiln_builder *builder, struct kiln_error *error)
{
    enum { NOTES_MAX = 8 };
    size_t count = 0;
    int status = KILN_OK;
    for (size_t i = 0; i < builder->sections[KILN_SECTION_OBJECTS].count; i++) {
        const uint32_t mesh = KILN_BUILDER_DATA(builder, const struct kiln_object, KILN_SECTION_OBJECTS)[i].mesh;
        if (builder->mesh_turned[mesh] > 0 && count++ < NOTES_MAX)
            KILN_TRY(note_object(builder, i, error));
    }
    if (count > NOTES_MAX)
        KILN_TRY(kiln_builder_note(
            builder, builder->trust_normals ? KILN_NOTE_INFORMATION : KILN_NOTE_REPEATED, error,
            "%zu more objects have triangles with normals that point to the back of their winding", count - NOTES_MAX));
end:
    return status;
}

/* ---- warning of coordinates too coarse for the texels ---- */

static double largest_coordinate(const struct kiln_builder *builder, const struct kiln_mesh *mesh)
{
    const struct kiln_vec3 *p =
        KILN_BUILDER_DATA(builder, const struct kiln_vec3, KILN_SECTION_POSITIONS) + mesh->vertex_first;
    float most = 0.0f;
    for (uint64_t v = 0; v < mesh->vertex_count; v++)
        most = fmaxf(most, fmaxf(fabsf(p[v].x), fmaxf(fabsf(p[v].y), fabsf(p[v].z))));
    return (double)most;
}

/* Returns the factor by which the transform stretches the basis axis that it stretches most. */
static double largest_scale(const double t[12])
{
    double most = 0.0;
    for (int c = 0; c < 3; c++)
        most = fmax(most, t[c] * t[c] + t[4 + c] * t[4 + c] + t[8 + c] * t[8 + c]);
    return sqrt(most);
}

/* Mean texel density over all objects, texels per metre; 0 if there is no area. */
static double mean_density(const struct kiln_mesh *meshes, const struct kiln_object *objects, size_t count)
{
    double texels = 0.0, area = 0.0;
    for (size_t i = 0; i < count; i++) {
        const struct kiln_mesh *mesh = &meshes[objects[i].mesh];
        const double scale = largest_scale(objects[i].transform);
        texels += mesh->uv_area * (double)objects[i].lightmap_width * (double)objects[i].lightmap_height;
        area += mesh->surface_area * scale * scale;
    }
    return area > 0.0 ? sqrt(texels / area) : 0.0;
}

int kiln_note_coarse_coordinates(struct kiln_builder *builder, struct kiln_error *error)
{
    const double float_step = 0x1p-23, texel_share = 0.1;
    const struct kiln_mesh *meshes = KILN_BUILDER_DATA(builder, const struct kiln_mesh, KILN_SECTION_MESHES);
    const struct kiln_object *objects = KILN_BUILDER_DATA(builder, const struct kiln_object, KILN_SECTION_OBJECTS);
    const size_t count = builder->sections[KILN_SECTION_OBJECTS].count;
    const double density = mean_density(meshes, objects, count);
    double *most = NULL, worst = 0.0;
    size_t coarse = 0, worst_object = 0;
    const int status =
        kiln_allocate(&most, builder->sections[KILN_SECTION_MESHES].count, sizeof *most, "meshes", error);
    if (status != KILN_OK)
        return status;
    for (size_t m = 0; m < builder->sections[KILN_SECTION_MESHES].count; m++)
        most[m] = largest_coordinate(builder, &meshes[m]);
    for (size_t i = 0; i < count; i++) {
        const double step = most[objects[i].mesh] * float_step * largest_scale(objects[i].transform);
        coarse += step * density > texel_share;
        worst_object = step > worst ? i : worst_object;
        worst = fmax(worst, step);
    }
    kiln_free(&most);
    if (coarse == 0)
        return KILN_OK;
    return kiln_builder_note(
        builder, KILN_NOTE_REPEATED, error,
        "%zu object%s coordinates in the file that are coarser than a tenth of a texel (most in \"%.200s\": %.3g m "
        "apart, a texel has %.3g m): model near the mesh's origin, and let the node's translation move it",
        coarse, coarse == 1 ? " has" : "s have",
        KILN_BUILDER_DATA(builder, const char, KILN_SECTION_STRINGS) + objects[worst_object].name, worst,
        1.0 / density);
}
