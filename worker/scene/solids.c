#include "worker/scene/solids.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "worker/base/disjoint_sets.h"
#include "worker/base/memory.h"

/* A closed sheet folded onto itself has no volume. A piece is closed only if its volume is more than this times its
 * area times its extent. */
static const double LEAST_THICKNESS = 1e-6;

/* ---- the connected pieces of a mesh ---- */

struct pieces {
    uint32_t count;
    uint32_t *of;    /* per triangle of the mesh: its piece */
    uint8_t *closed; /* per piece: 1 if closed and turned outwards */
};

struct corner {
    float position[3];
    uint32_t vertex;
};

static int by_position(const void *a, const void *b)
{
    const struct corner *p = a, *q = b;
    for (int i = 0; i < 3; i++)
        if (p->position[i] < q->position[i] || p->position[i] > q->position[i])
            return p->position[i] < q->position[i] ? -1 : 1;
    return p->vertex < q->vertex ? -1 : p->vertex > q->vertex;
}

/* Finds for each vertex of the mesh the vertex with the least number at its position. */
static int weld(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint32_t *welded,
                struct kiln_error *error)
{
    struct corner *corners = NULL;
    const int status = kiln_allocate(&corners, mesh->vertex_count, sizeof *corners, "the vertices of a mesh", error);
    if (status != KILN_OK)
        return status;
    for (uint64_t v = 0; v < mesh->vertex_count; v++) {
        const struct kiln_vec3 p = scene->positions[mesh->vertex_first + v];
        corners[v] = (struct corner){{p.x + 0.0f, p.y + 0.0f, p.z + 0.0f}, (uint32_t)v};
    }
    qsort(corners, mesh->vertex_count, sizeof *corners, by_position);
    for (uint64_t i = 0; i < mesh->vertex_count; i++) {
        const bool same =
            i > 0 && memcmp(corners[i].position, corners[i - 1].position, sizeof corners[i].position) == 0;
        welded[corners[i].vertex] = same ? welded[corners[i - 1].vertex] : corners[i].vertex;
    }
    kiln_free(&corners);
    return KILN_OK;
}

/* A triangle's edge, from its lower to its higher vertex. */
struct edge {
    uint32_t low, high, triangle;
    int32_t way; /* 1: the triangle traverses it from low to high; -1: from high to low */
};

static int by_vertices(const void *a, const void *b)
{
    const struct edge *p = a, *q = b;
    if (p->low != q->low)
        return p->low < q->low ? -1 : 1;
    if (p->high != q->high)
        return p->high < q->high ? -1 : 1;
    return p->triangle < q->triangle ? -1 : p->triangle > q->triangle;
}

static size_t list_edges(const struct kiln_scene *scene, const struct kiln_mesh *mesh, const uint32_t *welded,
                         struct edge *edges)
{
    size_t count = 0;
    for (uint64_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *corner = scene->triangles + 3 * (mesh->triangle_first + t);
        for (int i = 0; i < 3; i++) {
            const uint32_t a = welded[corner[i]], b = welded[corner[i == 2 ? 0 : i + 1]];
            if (a != b)
                edges[count++] = (struct edge){a < b ? a : b, a < b ? b : a, (uint32_t)t, a < b ? 1 : -1};
        }
    }
    qsort(edges, count, sizeof *edges, by_vertices);
    return count;
}

/* Sums over a piece's triangles: six times the signed volume of the tetrahedra to the mesh's first vertex, twice the
 * area; and its bounds. */
struct piece_measure {
    double volume, area;
    struct kiln_dvec3 low, high;
};

static void measure(const struct kiln_scene *scene, const struct kiln_mesh *mesh, const struct pieces *pieces,
                    struct piece_measure *measures)
{
    const struct kiln_dvec3 origin = dvec3_of(scene->positions[mesh->vertex_first]);
    for (uint64_t t = 0; t < mesh->triangle_count; t++) {
        struct piece_measure *m = &measures[pieces->of[t]];
        struct kiln_dvec3 p[3];
        for (uint64_t i = 0; i < 3; i++) {
            p[i] = dvec3_sub(
                dvec3_of(scene->positions[mesh->vertex_first + scene->triangles[3 * (mesh->triangle_first + t) + i]]),
                origin);
            const bool first = !(m->area > 0.0) && i == 0;
            m->low = first ? p[i] : dvec3(fmin(m->low.x, p[i].x), fmin(m->low.y, p[i].y), fmin(m->low.z, p[i].z));
            m->high = first ? p[i] : dvec3(fmax(m->high.x, p[i].x), fmax(m->high.y, p[i].y), fmax(m->high.z, p[i].z));
        }
        const struct kiln_dvec3 cross = dvec3_cross(dvec3_sub(p[1], p[0]), dvec3_sub(p[2], p[0]));
        m->area += dvec3_length(cross);
        m->volume += dvec3_dot(p[0], dvec3_cross(p[1], p[2]));
    }
}

static int judge_pieces(const struct kiln_scene *scene, const struct kiln_mesh *mesh, struct pieces *pieces,
                        struct kiln_error *error)
{
    struct piece_measure *measures = NULL;
    const int status = kiln_allocate(&measures, pieces->count, sizeof *measures, "the pieces of a mesh", error);
    if (status != KILN_OK)
        return status;
    measure(scene, mesh, pieces, measures);
    for (uint32_t i = 0; i < pieces->count; i++) {
        const struct piece_measure *m = &measures[i];
        const double extent = dvec3_length(dvec3_sub(m->high, m->low));
        pieces->closed[i] = pieces->closed[i] && m->volume > LEAST_THICKNESS * m->area * extent;
    }
    kiln_free(&measures);
    return KILN_OK;
}

/* Joins triangles at their edges, numbers the pieces and determines which are closed. */
static int number_pieces(const struct kiln_mesh *mesh, const struct edge *edges, size_t edge_count,
                         struct pieces *pieces, struct kiln_error *error)
{
    uint32_t *parent = pieces->of;
    kiln_sets_begin(parent, mesh->triangle_count);
    for (size_t i = 1; i < edge_count; i++)
        if (edges[i].low == edges[i - 1].low && edges[i].high == edges[i - 1].high)
            kiln_sets_join(parent, edges[i].triangle, edges[i - 1].triangle);
    for (uint64_t t = 0; t < mesh->triangle_count; t++)
        pieces->count += kiln_sets_root(parent, (uint32_t)t) == t ? 1 : 0;
    uint32_t *number = NULL;
    int status = kiln_allocate(&pieces->closed, pieces->count, sizeof *pieces->closed, "the pieces of a mesh", error);
    if (status == KILN_OK)
        status = kiln_allocate(&number, mesh->triangle_count, sizeof *number, "the pieces of a mesh", error);
    if (status != KILN_OK)
        return status;
    uint32_t next = 0; /* a root is the least of its set, so its number is known before it is needed */
    for (uint64_t t = 0; t < mesh->triangle_count; t++)
        number[t] = kiln_sets_root(parent, (uint32_t)t) == t ? next++ : number[kiln_sets_root(parent, (uint32_t)t)];
    memcpy(pieces->of, number, mesh->triangle_count * sizeof *number);
    kiln_free(&number);
    memset(pieces->closed, 1, pieces->count);
    for (size_t i = 0, end; i < edge_count; i = end) {
        int32_t balance = 0;
        for (end = i; end < edge_count && edges[end].low == edges[i].low && edges[end].high == edges[i].high; end++)
            balance += edges[end].way;
        if (balance != 0)
            pieces->closed[pieces->of[edges[i].triangle]] = 0;
    }
    return KILN_OK;
}

static void pieces_destroy(struct pieces *pieces)
{
    kiln_free(&pieces->of);
    kiln_free(&pieces->closed);
}

static int find_pieces(const struct kiln_scene *scene, const struct kiln_mesh *mesh, struct pieces *pieces,
                       struct kiln_error *error)
{
    uint32_t *welded = NULL;
    struct edge *edges = NULL;
    int status;
    KILN_TRY(kiln_allocate(&welded, mesh->vertex_count, sizeof *welded, "the vertices of a mesh", error));
    KILN_TRY(kiln_allocate(&edges, 3 * mesh->triangle_count, sizeof *edges, "the edges of a mesh", error));
    KILN_TRY(kiln_allocate(&pieces->of, mesh->triangle_count, sizeof *pieces->of, "the pieces of a mesh", error));
    KILN_TRY(weld(scene, mesh, welded, error));
    KILN_TRY(number_pieces(mesh, edges, list_edges(scene, mesh, welded, edges), pieces, error));
    KILN_TRY(judge_pieces(scene, mesh, pieces, error));
end:
    kiln_free(&welded);
    kiln_free(&edges);
    return status;
}

/* ---- emitters inside closed pieces ---- */

/* A position from which light comes: that of a punctual light, or one on an emitting triangle. */
struct emitter {
    struct kiln_dvec3 place;
    uint32_t triangle; /* number of the world triangle; KILN_NONE: a punctual light */
};

struct emitters {
    struct emitter *list;
    size_t count, capacity;
};

static int add_emitter(struct emitters *e, struct kiln_dvec3 place, uint32_t triangle, struct kiln_error *error)
{
    const int status = kiln_grow(&e->list, &e->capacity, e->count + 1, sizeof *e->list, "the places of lights", error);
    if (status == KILN_OK)
        e->list[e->count++] = (struct emitter){place, triangle};
    return status;
}

static uint64_t world_triangle(const struct kiln_object_range *range, uint64_t k)
{
    return k < range->opaque_count ? range->opaque_first + k : range->alpha_first + (k - range->opaque_count);
}

static int list_object_emitters(const struct kiln_geometry *g, size_t object, struct emitters *e,
                                struct kiln_error *error)
{
    const struct kiln_object_range *range = &g->ranges[object];
    const uint64_t count = range->opaque_count + range->alpha_count;
    uint64_t emitting = 0, seen = 0;
    for (uint64_t k = 0; k < count; k++)
        emitting += (g->records[world_triangle(range, k)].material & KILN_RECORD_EMITS) != 0 ? 1 : 0;
    const uint64_t step = emitting / KILN_SOLID_EMITTERS + 1;
    for (uint64_t k = 0; k < count && emitting > 0; k++) {
        const uint64_t t = world_triangle(range, k);
        if ((g->records[t].material & KILN_RECORD_EMITS) == 0 || seen++ % step != 0)
            continue;
        struct kiln_vec3 c[3];
        kiln_geometry_corners(g, t, c);
        const struct kiln_dvec3 middle =
            dvec3_scale(dvec3_add(dvec3_of(c[0]), dvec3_add(dvec3_of(c[1]), dvec3_of(c[2]))), 1.0 / 3.0);
        const int status = add_emitter(e, middle, (uint32_t)t, error);
        if (status != KILN_OK)
            return status;
    }
    return KILN_OK;
}

static int list_emitters(const struct kiln_geometry *g, const struct kiln_scene *scene, struct emitters *e,
                         struct kiln_error *error)
{
    const double *centre = scene->header->centre;
    int status = KILN_OK;
    for (size_t i = 0; i < scene->light_count; i++) {
        const double *p = scene->lights[i].position;
        if (scene->lights[i].kind != KILN_LIGHT_DIRECTIONAL)
            KILN_TRY(add_emitter(e, dvec3(p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]), KILN_NONE, error));
    }
    for (size_t o = 0; o < scene->object_count; o++)
        KILN_TRY(list_object_emitters(g, o, e, error));
end:
    return status;
}

/* World bounds of a piece of an object. */
struct placed {
    struct kiln_vec3 low, high;
    bool solid;
};

static void place_pieces(const struct kiln_geometry *g, const struct kiln_mesh *mesh, size_t object,
                         const struct pieces *pieces, struct placed *placed)
{
    const struct kiln_object_range *range = &g->ranges[object];
    for (uint32_t i = 0; i < pieces->count; i++)
        placed[i] = (struct placed){vec3(INFINITY, INFINITY, INFINITY), vec3(-INFINITY, -INFINITY, -INFINITY),
                                    pieces->closed[i] != 0};
    for (uint64_t k = 0; k < range->opaque_count + range->alpha_count; k++) {
        const uint64_t t = world_triangle(range, k);
        struct placed *p = &placed[pieces->of[g->stored_triangle[t] - mesh->triangle_first]];
        const uint32_t flags = g->records[t].material, both = KILN_RECORD_EMITS | KILN_RECORD_DOUBLE_SIDED;
        p->solid = p->solid && t < g->opaque_count && (flags & both) != both;
        struct kiln_vec3 c[3];
        kiln_geometry_corners(g, t, c);
        for (int i = 0; i < 3; i++) {
            p->low = vec3(fminf(p->low.x, c[i].x), fminf(p->low.y, c[i].y), fminf(p->low.z, c[i].z));
            p->high = vec3(fmaxf(p->high.x, c[i].x), fmaxf(p->high.y, c[i].y), fmaxf(p->high.z, c[i].z));
        }
    }
}

/* The winding number of p: the number of times a ray from p leaves the piece, less the number of times it enters. The
 * ray's direction is parallel to no axis, so that it seldom hits an edge. */
static int winding_number(const struct kiln_geometry *g, const struct kiln_mesh *mesh, size_t object,
                          const struct pieces *pieces, uint32_t piece, struct kiln_dvec3 p, struct kiln_dvec3 direction)
{
    const struct kiln_object_range *range = &g->ranges[object];
    int sum = 0;
    for (uint64_t k = 0; k < range->opaque_count; k++) {
        const uint64_t t = range->opaque_first + k;
        if (pieces->of[g->stored_triangle[t] - mesh->triangle_first] != piece)
            continue;
        struct kiln_vec3 c[3];
        kiln_geometry_corners(g, t, c);
        struct kiln_dvec3 to[3];
        for (int i = 0; i < 3; i++)
            to[i] = dvec3_sub(dvec3_of(c[i]), p);
        const double u = dvec3_dot(direction, dvec3_cross(to[1], to[2])),
                     v = dvec3_dot(direction, dvec3_cross(to[2], to[0]));
        const double w = dvec3_dot(direction, dvec3_cross(to[0], to[1]));
        const bool leaves = u > 0.0 && v > 0.0 && w > 0.0, enters = u < 0.0 && v < 0.0 && w < 0.0;
        if (!leaves && !enters)
            continue;
        /* same sign as u + v + w: the triangle is ahead */
        const double volume = dvec3_dot(to[0], dvec3_cross(to[1], to[2]));
        if ((volume > 0.0) == leaves)
            sum += leaves ? 1 : -1;
    }
    return sum;
}

static bool is_inside(const struct kiln_geometry *g, const struct kiln_mesh *mesh, size_t object,
                      const struct pieces *pieces, uint32_t piece, struct kiln_dvec3 p)
{
    static const struct kiln_dvec3 directions[3] = {
        {0.5370, 0.7642, 0.3574}, {-0.8417, 0.2963, 0.4514}, {0.1873, -0.4219, -0.8871}};
    int votes = 0;
    for (int i = 0; i < 3; i++)
        votes += winding_number(g, mesh, object, pieces, piece, p, directions[i]) != 0 ? 1 : 0;
    return votes >= 2;
}

static bool within(const struct placed *box, struct kiln_dvec3 p)
{
    return p.x > (double)box->low.x && p.x < (double)box->high.x && p.y > (double)box->low.y &&
           p.y < (double)box->high.y && p.z > (double)box->low.z && p.z < (double)box->high.z;
}

static bool is_lit_inside(const struct kiln_geometry *g, const struct kiln_mesh *mesh, size_t object,
                          const struct pieces *pieces, uint32_t piece, const struct placed *box,
                          const struct emitters *emitters)
{
    for (size_t i = 0; i < emitters->count; i++) {
        const struct emitter *e = &emitters->list[i];
        const bool own = e->triangle != KILN_NONE && g->records[e->triangle].object == object &&
                         pieces->of[g->stored_triangle[e->triangle] - mesh->triangle_first] == piece;
        if (!own && within(box, e->place) && is_inside(g, mesh, object, pieces, piece, e->place))
            return true;
    }
    return false;
}

static int close_object(struct kiln_geometry *g, const struct kiln_scene *scene, size_t object,
                        const struct pieces *pieces, const struct emitters *emitters, uint8_t *out,
                        struct kiln_error *error)
{
    const struct kiln_mesh *mesh = &scene->meshes[scene->objects[object].mesh];
    struct placed *placed = NULL;
    const int status = kiln_allocate(&placed, pieces->count, sizeof *placed, "the pieces of an object", error);
    if (status != KILN_OK)
        return status;
    place_pieces(g, mesh, object, pieces, placed);
    for (uint32_t i = 0; i < pieces->count; i++)
        placed[i].solid = placed[i].solid && !is_lit_inside(g, mesh, object, pieces, i, &placed[i], emitters);
    const struct kiln_object_range *range = &g->ranges[object];
    for (uint64_t k = 0; k < range->opaque_count; k++) {
        const uint64_t t = range->opaque_first + k;
        out[t] = placed[pieces->of[g->stored_triangle[t] - mesh->triangle_first]].solid;
    }
    kiln_free(&placed);
    return KILN_OK;
}

/* ---- all objects ---- */

static bool has_two_sides(const struct kiln_scene *scene, const struct kiln_mesh *mesh)
{
    for (uint64_t t = 0; t < mesh->triangle_count; t++)
        if (scene->materials[scene->triangle_materials[mesh->triangle_first + t]].double_sided != 0)
            return true;
    return false;
}

static int find_all_pieces(const struct kiln_scene *scene, struct pieces *pieces, struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel for schedule(dynamic)
    for (size_t m = 0; m < scene->mesh_count; m++) {
        struct kiln_error own;
        const int failed =
            has_two_sides(scene, &scene->meshes[m]) ? find_pieces(scene, &scene->meshes[m], &pieces[m], &own) : KILN_OK;
        if (failed != KILN_OK) {
#pragma omp critical(kiln_solids_failure)
            status = kiln_fail(error, failed, "%s", own.message);
        }
    }
    return status;
}

static int close_all(struct kiln_geometry *g, const struct kiln_scene *scene, const struct pieces *pieces,
                     const struct emitters *emitters, uint8_t *solid, struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel for schedule(dynamic)
    for (size_t o = 0; o < scene->object_count; o++) {
        const struct pieces *own_pieces = &pieces[scene->objects[o].mesh];
        struct kiln_error own;
        const int failed =
            own_pieces->of != NULL ? close_object(g, scene, o, own_pieces, emitters, solid, &own) : KILN_OK;
        if (failed != KILN_OK) {
#pragma omp critical(kiln_solids_failure)
            status = kiln_fail(error, failed, "%s", own.message);
        }
    }
    for (size_t t = 0; t < g->opaque_count && status == KILN_OK; t++)
        if (solid[t])
            g->records[t].material &= ~KILN_RECORD_DOUBLE_SIDED;
    return status;
}

int kiln_solids_make_one_sided(struct kiln_geometry *geometry, const struct kiln_scene *scene, struct kiln_error *error)
{
    struct pieces *pieces = NULL;
    struct emitters emitters = {0};
    uint8_t *solid = NULL;
    bool any = false;
    for (size_t m = 0; m < scene->material_count; m++)
        any = any || scene->materials[m].double_sided != 0;
    if (!any)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_allocate(&pieces, scene->mesh_count, sizeof *pieces, "the pieces of meshes", error));
    KILN_TRY(kiln_allocate(&solid, geometry->triangle_count, sizeof *solid, "the world's triangles", error));
    KILN_TRY(find_all_pieces(scene, pieces, error));
    KILN_TRY(list_emitters(geometry, scene, &emitters, error));
    KILN_TRY(close_all(geometry, scene, pieces, &emitters, solid, error));
end:
    for (size_t m = 0; pieces != NULL && m < scene->mesh_count; m++)
        pieces_destroy(&pieces[m]);
    kiln_free(&pieces);
    kiln_free(&emitters.list);
    kiln_free(&solid);
    return status;
}
