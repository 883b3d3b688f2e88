#include "worker/scene/geometry.h"

#include <float.h>
#include <stdbool.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/scene/coincident.h"
#include "worker/scene/gloss.h"
#include "worker/scene/holes.h"
#include "worker/scene/solids.h"

/* triangles or vertices that one thread takes at a time: one large mesh then keeps all threads busy */
enum { CHUNK = 1 << 16 };

/* Working data of kiln_geometry_create. */
struct expansion {
    const struct kiln_scene *scene;
    struct kiln_geometry *geometry;
    float *alpha_floor; /* per material: the least alpha that its factor and texture can give */
    /* per material: a triangle whose alpha may be at or below this (MASK), or below this (BLEND), is not opaque */
    float *alpha_limit;
    /* per mesh, and one more at the end: its first chunk of triangles */
    uint64_t *mesh_chunk;
    uint64_t *chunk_alpha; /* per chunk: the alpha triangles of the mesh before it */
    uint64_t *mesh_alpha;  /* per mesh: its alpha triangles */
    /* per object, and one more at the end: its first work item */
    uint64_t *object_triangle_chunk, *object_vertex_chunk;
    /* per object, and one more at the end: its first world vertex */
    uint64_t *object_vertex;
    struct kiln_arena arena;
};

static uint64_t chunks_of(uint64_t count) { return (count + CHUNK - 1) / CHUNK; }

/* The last index whose `first` is at most `item`. Among equal entries (empty runs) that is the run that holds the
 * item. */
static size_t run_of(const uint64_t *first, size_t count, uint64_t item)
{
    size_t low = 0, high = count;
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (first[middle] <= item)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static uint8_t lowest_texture_alpha(const struct kiln_scene *scene, uint32_t index)
{
    const struct kiln_texture *texture = &scene->textures[index];
    const uint8_t *texel = scene->texels + texture->first;
    const uint64_t count = (uint64_t)texture->width * texture->height;
    uint8_t lowest = 255;
    for (uint64_t i = 0; i < count && lowest > 0; i++)
        lowest = texel[4 * i + 3] < lowest ? texel[4 * i + 3] : lowest;
    return lowest;
}

static void find_alpha_limits(struct expansion *e)
{
    const struct kiln_scene *scene = e->scene;
#pragma omp parallel for schedule(dynamic)
    for (size_t m = 0; m < scene->material_count; m++) {
        const struct kiln_material *material = &scene->materials[m];
        e->alpha_limit[m] = -1.0f;
        e->alpha_floor[m] = 1.0f;
        if (material->transmission > 0.0f)
            e->alpha_limit[m] = 1.0f; /* not opaque, whatever its alpha */
        if (material->alpha_mode == KILN_ALPHA_OPAQUE || material->transmission > 0.0f)
            continue;
        e->alpha_limit[m] = material->alpha_mode == KILN_ALPHA_MASK ? material->alpha_cutoff : nextafterf(1.0f, 0.0f);
        e->alpha_floor[m] = material->base_color[3];
        if (material->base_color_texture != KILN_NONE)
            e->alpha_floor[m] *= (float)lowest_texture_alpha(scene, material->base_color_texture) / 255.0f;
    }
}

static bool is_alpha(const struct expansion *e, const struct kiln_mesh *mesh, uint64_t triangle)
{
    const uint32_t material = e->scene->triangle_materials[triangle];
    const float limit = e->alpha_limit[material];
    if (limit < 0.0f)
        return false;
    uint8_t lowest = 255;
    for (int c = 0; c < 3; c++) {
        const uint64_t vertex = mesh->vertex_first + e->scene->triangles[3 * triangle + (uint64_t)c];
        const uint8_t alpha = e->scene->colors[4 * vertex + 3];
        lowest = alpha < lowest ? alpha : lowest;
    }
    return e->alpha_floor[material] * ((float)lowest / 255.0f) <= limit;
}

/* Counts the alpha triangles of each mesh and of its chunks, so that chunks can be expanded independently. */
static void count_alpha(struct expansion *e)
{
    const struct kiln_scene *scene = e->scene;
    const uint64_t chunk_count = e->mesh_chunk[scene->mesh_count];
#pragma omp parallel for schedule(dynamic)
    for (uint64_t chunk = 0; chunk < chunk_count; chunk++) {
        const size_t m = run_of(e->mesh_chunk, scene->mesh_count, chunk);
        const struct kiln_mesh *mesh = &scene->meshes[m];
        const uint64_t first = (chunk - e->mesh_chunk[m]) * CHUNK;
        const uint64_t last = first + CHUNK < mesh->triangle_count ? first + CHUNK : mesh->triangle_count;
        uint64_t count = 0;
        for (uint64_t t = first; t < last; t++)
            count += is_alpha(e, mesh, mesh->triangle_first + t) ? 1 : 0;
        e->chunk_alpha[chunk] = count;
    }
    for (size_t m = 0; m < scene->mesh_count; m++) {
        uint64_t before = 0;
        for (uint64_t chunk = e->mesh_chunk[m]; chunk < e->mesh_chunk[m + 1]; chunk++) {
            const uint64_t count = e->chunk_alpha[chunk];
            e->chunk_alpha[chunk] = before;
            before += count;
        }
        e->mesh_alpha[m] = before;
    }
}

static bool is_unmet(const struct kiln_scene *scene, size_t object)
{
    return (scene->objects[object].flags & KILN_OBJECT_RECEIVER_ONLY) != 0;
}

static int plan(struct expansion *e, struct kiln_error *error)
{
    const struct kiln_scene *scene = e->scene;
    struct kiln_geometry *g = e->geometry;
    uint64_t triangles = 0, vertices = 0, opaque = 0, alpha = 0;
    uint64_t opaque_receivers = 0, alpha_receivers = 0; /* of receiver-only objects */
    for (size_t o = 0; o < scene->object_count; o++) {
        const uint32_t m = scene->objects[o].mesh;
        const struct kiln_mesh *mesh = &scene->meshes[m];
        e->object_triangle_chunk[o + 1] = e->object_triangle_chunk[o] + chunks_of(mesh->triangle_count);
        e->object_vertex_chunk[o + 1] = e->object_vertex_chunk[o] + chunks_of(mesh->vertex_count);
        e->object_vertex[o] = vertices;
        triangles += mesh->triangle_count;
        vertices += mesh->vertex_count;
        uint64_t *own_opaque = is_unmet(scene, o) ? &opaque_receivers : &opaque,
                 *own_alpha = is_unmet(scene, o) ? &alpha_receivers : &alpha;
        g->ranges[o].opaque_first = *own_opaque;
        g->ranges[o].opaque_count = mesh->triangle_count - e->mesh_alpha[m];
        g->ranges[o].alpha_first = *own_alpha;
        g->ranges[o].alpha_count = e->mesh_alpha[m];
        *own_opaque += g->ranges[o].opaque_count;
        *own_alpha += g->ranges[o].alpha_count;
        if (triangles >= UINT32_MAX || vertices >= UINT32_MAX || scene->triangle_count >= UINT32_MAX)
            return kiln_fail(
                error, KILN_BAD_INPUT,
                "the scene has more than %u triangles or vertices once its instances are expanded (object %zu of %zu, "
                "'%s', brings them to %llu and %llu): leave out objects or bake it in parts",
                UINT32_MAX - 1, o + 1, scene->object_count, kiln_scene_string(scene, scene->objects[o].name),
                (unsigned long long)triangles, (unsigned long long)vertices);
    }
    e->object_vertex[scene->object_count] = vertices;
    for (size_t o = 0; o < scene->object_count; o++) {
        g->ranges[o].opaque_first += is_unmet(scene, o) ? opaque : 0;
        g->ranges[o].alpha_first += opaque + opaque_receivers + (is_unmet(scene, o) ? alpha : 0);
    }
    g->vertex_count = vertices;
    g->triangle_count = triangles;
    g->opaque_count = opaque + opaque_receivers;
    g->opaque_receivers = opaque_receivers;
    g->alpha_receivers = alpha_receivers;
    return KILN_OK;
}

/* Computes world positions in double, subtracts the centre, and rounds to float: one rounding, of the smaller
 * number. */
static int place_vertices(struct expansion *e, struct kiln_error *error)
{
    const struct kiln_scene *scene = e->scene;
    const double *centre = scene->header->centre;
    const uint64_t items = e->object_vertex_chunk[scene->object_count];
    uint64_t first_bad = UINT64_MAX;
#pragma omp parallel for schedule(dynamic) reduction(min : first_bad)
    for (uint64_t item = 0; item < items; item++) {
        const size_t o = run_of(e->object_vertex_chunk, scene->object_count, item);
        const double *m = scene->objects[o].transform;
        const struct kiln_mesh *mesh = &scene->meshes[scene->objects[o].mesh];
        const uint64_t first = (item - e->object_vertex_chunk[o]) * CHUNK;
        const uint64_t last = first + CHUNK < mesh->vertex_count ? first + CHUNK : mesh->vertex_count;
        for (uint64_t v = first; v < last; v++) {
            const struct kiln_dvec3 p = dvec3_of(scene->positions[mesh->vertex_first + v]);
            float *out = e->geometry->vertices + 3 * (e->object_vertex[o] + v);
            for (int row = 0; row < 3; row++) {
                const double *r = m + 4 * row;
                out[row] = (float)(r[0] * p.x + r[1] * p.y + r[2] * p.z + (r[3] - centre[row]));
                if (!(fabsf(out[row]) <= 1e18f) && e->object_vertex[o] + v < first_bad)
                    first_bad = e->object_vertex[o] + v;
            }
        }
    }
    if (first_bad == UINT64_MAX)
        return KILN_OK;
    const size_t o = run_of(e->object_vertex, scene->object_count, first_bad);
    return kiln_fail(error, KILN_BAD_INPUT,
                     "object '%s': vertex %llu of its mesh has a position that is not a number or lies more than 1e18 "
                     "m from the scene's centre: "
                     "check the object's transform",
                     kiln_scene_string(scene, scene->objects[o].name),
                     (unsigned long long)(first_bad - e->object_vertex[o]));
}

static void expand_triangle(const struct expansion *e, size_t o, uint64_t stored, uint64_t world)
{
    const struct kiln_scene *scene = e->scene;
    const struct kiln_object *object = &scene->objects[o];
    struct kiln_geometry *g = e->geometry;
    const uint32_t *corner = scene->triangles + 3 * stored;
    const uint32_t order[3] = {corner[0], corner[object->flipped ? 2 : 1], corner[object->flipped ? 1 : 2]};
    struct kiln_hit_record *record = &g->records[world];
    record->object = (uint32_t)o;
    const uint32_t m = scene->triangle_materials[stored];
    const struct kiln_material *material = &scene->materials[m];
    const bool emits = material->emission[0] > 0.0f || material->emission[1] > 0.0f || material->emission[2] > 0.0f;
    const struct kiln_gloss *gloss = kiln_gloss_taken(scene, m);
    record->material = m | (material->double_sided ? KILN_RECORD_DOUBLE_SIDED : 0u) | (emits ? KILN_RECORD_EMITS : 0u) |
                       (gloss != NULL ? KILN_RECORD_GLOSS : 0u) |
                       (gloss != NULL && gloss->transmission > 0.0f ? KILN_RECORD_CLEAR : 0u);
    g->stored_triangle[world] = (uint32_t)stored;
    for (uint64_t c = 0; c < 3; c++)
        g->indices[3 * world + c] = (uint32_t)e->object_vertex[o] + order[c];
    double texel[3][2];
    kiln_geometry_texel_corners(scene, g, world, texel);
    for (int axis = 0; axis < 2; axis++) {
        record->texel[axis] = (float)texel[0][axis];
        record->texel[2 + axis] = (float)(texel[1][axis] - texel[0][axis]);
        record->texel[4 + axis] = (float)(texel[2][axis] - texel[0][axis]);
    }
}

static void expand_triangles(struct expansion *e)
{
    const struct kiln_scene *scene = e->scene;
    struct kiln_geometry *g = e->geometry;
    const uint64_t items = e->object_triangle_chunk[scene->object_count];
#pragma omp parallel for schedule(dynamic)
    for (uint64_t item = 0; item < items; item++) {
        const size_t o = run_of(e->object_triangle_chunk, scene->object_count, item);
        const uint32_t m = scene->objects[o].mesh;
        const struct kiln_mesh *mesh = &scene->meshes[m];
        const uint64_t chunk = item - e->object_triangle_chunk[o];
        const uint64_t first = chunk * CHUNK;
        const uint64_t last = first + CHUNK < mesh->triangle_count ? first + CHUNK : mesh->triangle_count;
        uint64_t alpha = g->ranges[o].alpha_first + e->chunk_alpha[e->mesh_chunk[m] + chunk];
        uint64_t opaque = g->ranges[o].opaque_first + first - e->chunk_alpha[e->mesh_chunk[m] + chunk];
        for (uint64_t t = first; t < last; t++) {
            const uint64_t stored = mesh->triangle_first + t;
            expand_triangle(e, o, stored, is_alpha(e, mesh, stored) ? alpha++ : opaque++);
        }
    }
}

static uint32_t passage_of(const struct kiln_scene *scene, uint32_t index)
{
    const struct kiln_material *material = &scene->materials[index];
    if (scene->panes != NULL && scene->panes[index].eta != 0.0f)
        return KILN_PASSAGE_PANE;
    if (material->transmission > 0.0f)
        return KILN_PASSAGE_TINT;
    return material->alpha_mode == KILN_ALPHA_BLEND ? KILN_PASSAGE_BLEND : KILN_PASSAGE_MASK;
}

static void find_passage(const struct kiln_scene *scene, struct kiln_geometry *g)
{
    const uint32_t most = scene->panes != NULL ? KILN_PASSAGE_PANE : KILN_PASSAGE_TINT;
    for (size_t t = g->opaque_count; t < g->triangle_count && g->passage < most; t++) {
        const uint32_t passage = passage_of(scene, g->records[t].material & KILN_RECORD_MATERIAL);
        g->passage = passage > g->passage ? passage : g->passage;
    }
}

static void find_bounds(struct kiln_geometry *g)
{
    if (g->triangle_count == 0)
        return;
    float x0 = FLT_MAX, y0 = FLT_MAX, z0 = FLT_MAX, x1 = -FLT_MAX, y1 = -FLT_MAX, z1 = -FLT_MAX;
    /* over corners, not vertices: a vertex that no triangle uses is not in the scene */
    const size_t count = 3 * g->triangle_count;
#pragma omp parallel for reduction(min : x0, y0, z0) reduction(max : x1, y1, z1)
    for (size_t i = 0; i < count; i++) {
        const float *p = g->vertices + 3 * (size_t)g->indices[i];
        x0 = fminf(x0, p[0]), y0 = fminf(y0, p[1]), z0 = fminf(z0, p[2]);
        x1 = fmaxf(x1, p[0]), y1 = fmaxf(y1, p[1]), z1 = fmaxf(z1, p[2]);
    }
    g->bounds_min = vec3(x0, y0, z0);
    g->bounds_max = vec3(x1, y1, z1);
    const float x = fmaxf(fabsf(x0), fabsf(x1)), y = fmaxf(fabsf(y0), fabsf(y1)), z = fmaxf(fabsf(z0), fabsf(z1));
    g->extent = fmaxf(x, fmaxf(y, z));
}

static void count_two_sided(struct kiln_geometry *g)
{
    for (size_t t = 0; t < g->triangle_count; t++)
        g->ranges[g->records[t].object].two_sided += (g->records[t].material & KILN_RECORD_DOUBLE_SIDED) != 0 ? 1 : 0;
}

/* Allocates an array of the geometry itself. */
static int allocate_kept(struct kiln_geometry *g, void *pointer, size_t count, size_t size, const char *what,
                         struct kiln_error *error)
{
    const int status = g->memory.allocate(g->memory.context, pointer, count, size, what, error);
    void *array;
    memcpy(&array, pointer, sizeof array);
    if (status == KILN_OK)
        kiln_expect_whole(array, count, size);
    return status;
}

static int allocate_plan(struct expansion *e, struct kiln_error *error)
{
    const struct kiln_scene *scene = e->scene;
    const char *what = "the expansion of the scene's objects";
    int status;
    KILN_TRY(
        kiln_arena_allocate(&e->arena, &e->alpha_floor, scene->material_count, sizeof *e->alpha_floor, what, error));
    KILN_TRY(
        kiln_arena_allocate(&e->arena, &e->alpha_limit, scene->material_count, sizeof *e->alpha_limit, what, error));
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->mesh_chunk, scene->mesh_count + 1, sizeof *e->mesh_chunk, what, error));
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->mesh_alpha, scene->mesh_count, sizeof *e->mesh_alpha, what, error));
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->object_triangle_chunk, scene->object_count + 1,
                                 sizeof *e->object_triangle_chunk, what, error));
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->object_vertex_chunk, scene->object_count + 1,
                                 sizeof *e->object_vertex_chunk, what, error));
    KILN_TRY(kiln_arena_allocate(&e->arena, &e->object_vertex, scene->object_count + 1, sizeof *e->object_vertex, what,
                                 error));
    KILN_TRY(allocate_kept(e->geometry, &e->geometry->ranges, scene->object_count, sizeof *e->geometry->ranges, what,
                           error));
end:
    if (status != KILN_OK)
        return status;
    for (size_t m = 0; m < scene->mesh_count; m++)
        e->mesh_chunk[m + 1] = e->mesh_chunk[m] + chunks_of(scene->meshes[m].triangle_count);
    return kiln_arena_allocate(&e->arena, &e->chunk_alpha, e->mesh_chunk[scene->mesh_count], sizeof *e->chunk_alpha,
                               what, error);
}

static int allocate_world(struct kiln_geometry *g, struct kiln_error *error)
{
    int status =
        allocate_kept(g, &g->vertices, 3 * g->vertex_count + 4, sizeof *g->vertices, "the world's vertices", error);
    KILN_TRY(status);
    KILN_TRY(allocate_kept(g, &g->indices, 3 * g->triangle_count, sizeof *g->indices, "the world's triangles", error));
    KILN_TRY(allocate_kept(g, &g->records, g->triangle_count, sizeof *g->records, "the world's hit records", error));
    KILN_TRY(allocate_kept(g, &g->stored_triangle, g->triangle_count, sizeof *g->stored_triangle,
                           "the world's triangles", error));
end:
    return status;
}

int kiln_geometry_create(struct kiln_geometry **geometry, const struct kiln_scene *scene, struct kiln_error *error)
{
    return kiln_geometry_create_in(geometry, scene, &kiln_own_memory, error);
}

int kiln_geometry_create_in(struct kiln_geometry **geometry, const struct kiln_scene *scene,
                            const struct kiln_allocator *memory, struct kiln_error *error)
{
    struct expansion e = {.scene = scene};
    *geometry = NULL;
    int status = kiln_allocate(&e.geometry, 1, sizeof *e.geometry, "the world's geometry", error);
    if (status == KILN_OK)
        e.geometry->memory = *memory;
    if (status == KILN_OK && scene->material_count > (size_t)KILN_RECORD_MATERIAL + 1)
        status = kiln_fail(error, KILN_BAD_INPUT,
                           "the scene has %zu materials and at most %u are possible: merge equal ones",
                           scene->material_count, KILN_RECORD_MATERIAL + 1);
    if (status == KILN_OK)
        status = allocate_plan(&e, error);
    if (status == KILN_OK) {
        find_alpha_limits(&e);
        count_alpha(&e);
        status = plan(&e, error);
    }
    if (status == KILN_OK)
        status = allocate_world(e.geometry, error);
    if (status == KILN_OK)
        status = place_vertices(&e, error);
    if (status == KILN_OK) {
        expand_triangles(&e);
        find_bounds(e.geometry);
        status = kiln_solids_make_one_sided(e.geometry, scene, error);
    }
    if (status == KILN_OK)
        status = kiln_holes_mark(e.geometry, scene, error);
    if (status == KILN_OK)
        status = kiln_coincident_find(e.geometry, error);
    if (status == KILN_OK) {
        count_two_sided(e.geometry);
        find_passage(scene, e.geometry);
        *geometry = e.geometry;
        e.geometry = NULL;
    }
    kiln_geometry_destroy(&e.geometry);
    kiln_arena_release(&e.arena);
    return status;
}

int kiln_geometry_attach(struct kiln_geometry **geometry, const struct kiln_geometry *made,
                         void *(*place)(const void *context, const void *there), const struct kiln_allocator *memory,
                         struct kiln_error *error)
{
    const int status = kiln_allocate(geometry, 1, sizeof **geometry, "the world's geometry", error);
    if (status != KILN_OK)
        return status;
    struct kiln_geometry *g = *geometry;
    *g = *made;
    g->memory = *memory;
    g->vertices = place(memory->context, made->vertices);
    g->indices = place(memory->context, made->indices);
    g->records = place(memory->context, made->records);
    g->ranges = place(memory->context, made->ranges);
    g->stored_triangle = place(memory->context, made->stored_triangle);
    g->leaves = made->leaves != NULL ? place(memory->context, made->leaves) : NULL;
    return KILN_OK;
}

void kiln_geometry_destroy(struct kiln_geometry **geometry)
{
    struct kiln_geometry *g = *geometry;
    if (g == NULL)
        return;
    void *const arrays[] = {&g->vertices, &g->indices, &g->records, &g->ranges, &g->stored_triangle, &g->leaves};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays && g->memory.release != NULL; i++)
        g->memory.release(g->memory.context, arrays[i]);
    kiln_free(geometry);
}
