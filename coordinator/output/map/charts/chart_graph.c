#include "coordinator/output/map/charts/chart_graph.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/disjoint_sets.h"
#include "worker/base/memory.h"

/* Distance in the layout below which points are the same point, in texels. */
#define SAME_TEXEL (1.0f / 64.0f)
/* Most triangles at an edge. Edges with more are skipped, since it is not defined which triangle continues which. */
enum { MOST_AT_AN_EDGE = 8 };

struct half_edge {
    uint32_t low, high; /* the two welded vertices of the edge */
    uint32_t triangle;
    uint32_t corner; /* the corner of the triangle at which the edge begins */
};

struct builder {
    const struct kiln_scene *scene;
    const struct kiln_mesh *mesh;
    float width, height;
    uint32_t *weld; /* for each vertex, the first vertex at the same position */
    struct half_edge *halves;
    size_t half_count;
    uint32_t *parent; /* union-find over triangles */
    uint8_t *inner;   /* for each triangle: bit k is set if its chart continues beyond edge k */
    struct kiln_chart_graph *graph;
    size_t edge_capacity;
    struct kiln_arena arena;
};

static int compare_positions(const void *a, const void *b, void *context)
{
    const struct kiln_vec3 *positions = context;
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    const struct kiln_vec3 p = positions[i], q = positions[j];
    if (p.x != q.x)
        return p.x < q.x ? -1 : 1;
    if (p.y != q.y)
        return p.y < q.y ? -1 : 1;
    if (p.z != q.z)
        return p.z < q.z ? -1 : 1;
    return i < j ? -1 : i > j;
}

static int weld_vertices(struct builder *b, struct kiln_error *error)
{
    const size_t count = b->mesh->vertex_count;
    const struct kiln_vec3 *positions = b->scene->positions + b->mesh->vertex_first;
    uint32_t *order = NULL;
    int status = kiln_arena_allocate(&b->arena, &b->weld, count, sizeof *b->weld, "welded vertices", error);
    if (status == KILN_OK)
        status = kiln_allocate(&order, count, sizeof *order, "welded vertices", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < count; i++)
        order[i] = (uint32_t)i;
    qsort_r(order, count, sizeof *order, compare_positions, (void *)(uintptr_t)positions);
    for (size_t i = 0; i < count; i++) {
        const struct kiln_vec3 p = positions[order[i]];
        const struct kiln_vec3 q = positions[order[i > 0 ? i - 1 : 0]];
        const int same = i > 0 && p.x == q.x && p.y == q.y && p.z == q.z;
        b->weld[order[i]] = same ? b->weld[order[i - 1]] : order[i];
    }
    kiln_free(&order);
    return KILN_OK;
}

static int compare_halves(const void *a, const void *b)
{
    const struct half_edge *p = a, *q = b;
    if (p->low != q->low)
        return p->low < q->low ? -1 : 1;
    if (p->high != q->high)
        return p->high < q->high ? -1 : 1;
    if (p->triangle != q->triangle)
        return p->triangle < q->triangle ? -1 : 1;
    return p->corner < q->corner ? -1 : p->corner > q->corner;
}

static uint32_t vertex_of(const struct builder *b, uint32_t triangle, uint32_t corner)
{
    return b->scene->triangles[3 * (b->mesh->triangle_first + triangle) + corner % 3];
}

static int list_halves(struct builder *b, struct kiln_error *error)
{
    const size_t triangles = b->mesh->triangle_count;
    const int status =
        kiln_arena_allocate(&b->arena, &b->halves, 3 * triangles, sizeof *b->halves, "a mesh's edges", error);
    if (status != KILN_OK)
        return status;
    for (uint32_t t = 0; t < triangles; t++)
        for (uint32_t c = 0; c < 3; c++) {
            const uint32_t from = b->weld[vertex_of(b, t, c)], to = b->weld[vertex_of(b, t, c + 1)];
            if (from == to)
                continue;
            b->halves[b->half_count++] = (struct half_edge){
                .low = from < to ? from : to, .high = from < to ? to : from, .triangle = t, .corner = c};
        }
    qsort(b->halves, b->half_count, sizeof *b->halves, compare_halves);
    return KILN_OK;
}

/* The vertex of the half edge at its lower (end 0) or higher (end 1) welded vertex. */
static uint32_t vertex_at(const struct builder *b, const struct half_edge *half, int end)
{
    const uint32_t first = vertex_of(b, half->triangle, half->corner),
                   second = vertex_of(b, half->triangle, half->corner + 1);
    return (b->weld[first] == half->low) == (end == 0) ? first : second;
}

static float length2(const float a[2], const float b[2]) { return hypotf(a[0] - b[0], a[1] - b[1]); }

static int join(struct builder *b, const struct half_edge *first, const struct half_edge *second,
                struct kiln_error *error)
{
    const struct half_edge *sides[2] = {first, second};
    struct kiln_seam_edge edge;
    struct kiln_vec3 normals[2][2];
    for (int s = 0; s < 2; s++)
        for (int e = 0; e < 2; e++) {
            const uint64_t vertex = b->mesh->vertex_first + vertex_at(b, sides[s], e);
            edge.texel[s][e][0] = b->scene->texcoord_lightmap[vertex].x * b->width;
            edge.texel[s][e][1] = b->scene->texcoord_lightmap[vertex].y * b->height;
            normals[s][e] = b->scene->normals[vertex];
        }
    if (length2(edge.texel[0][0], edge.texel[1][0]) < SAME_TEXEL &&
        length2(edge.texel[0][1], edge.texel[1][1]) < SAME_TEXEL) {
        kiln_sets_join(b->parent, first->triangle, second->triangle);
        b->inner[first->triangle] |= (uint8_t)(1u << first->corner);
        b->inner[second->triangle] |= (uint8_t)(1u << second->corner);
        return KILN_OK;
    }
    if (vec3_dot(normals[0][0], normals[1][0]) < KILN_SEAM_COSINE ||
        vec3_dot(normals[0][1], normals[1][1]) < KILN_SEAM_COSINE)
        return KILN_OK;
    if (length2(edge.texel[0][0], edge.texel[0][1]) < SAME_TEXEL ||
        length2(edge.texel[1][0], edge.texel[1][1]) < SAME_TEXEL)
        return KILN_OK; /* the edge has no length on the layout */
    const int status = kiln_arena_grow(&b->graph->arena, &b->graph->edges, &b->edge_capacity, b->graph->edge_count + 1,
                                       sizeof edge, "seams", error);
    if (status == KILN_OK)
        b->graph->edges[b->graph->edge_count++] = edge;
    return status;
}

static int join_all(struct builder *b, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t first = 0, end; status == KILN_OK && first < b->half_count; first = end) {
        end = first + 1;
        while (end < b->half_count && b->halves[end].low == b->halves[first].low &&
               b->halves[end].high == b->halves[first].high)
            end++;
        if (end - first > MOST_AT_AN_EDGE)
            continue;
        for (size_t i = first; status == KILN_OK && i < end; i++)
            for (size_t j = i + 1; status == KILN_OK && j < end; j++)
                status = join(b, &b->halves[i], &b->halves[j], error);
    }
    return status;
}

/* Numbers the charts in the order of their first triangle. */
static void number_charts(struct builder *b)
{
    struct kiln_chart_graph *t = b->graph;
    for (uint32_t i = 0; i < t->triangle_count; i++) {
        /* the root is the smallest of its set, so it has a number already unless it is i */
        const uint32_t root = kiln_sets_root(b->parent, i);
        t->chart[i] = root == i ? (uint32_t)t->chart_count++ : t->chart[root];
    }
}

static struct kiln_border_edge border_edge(const struct builder *b, uint32_t triangle, uint32_t corner)
{
    struct kiln_border_edge edge = {.chart = b->graph->chart[triangle]};
    for (uint32_t e = 0; e < 2; e++) {
        const struct kiln_vec2 uv =
            b->scene->texcoord_lightmap[b->mesh->vertex_first + vertex_of(b, triangle, corner + e)];
        edge.texel[e][0] = uv.x * b->width;
        edge.texel[e][1] = uv.y * b->height;
    }
    return edge;
}

static int list_borders(struct builder *b, struct kiln_error *error)
{
    struct kiln_chart_graph *graph = b->graph;
    size_t capacity = 0;
    int status = KILN_OK;
    for (uint32_t i = 0; i < 3 * graph->triangle_count && status == KILN_OK; i++) {
        if ((b->inner[i / 3] >> (i % 3) & 1u) != 0)
            continue;
        const struct kiln_border_edge edge = border_edge(b, i / 3, i % 3);
        if (!(length2(edge.texel[0], edge.texel[1]) > 0.0f))
            continue;
        status = kiln_arena_grow(&graph->arena, &graph->borders, &capacity, graph->border_count + 1, sizeof edge,
                                 "borders of charts", error);
        if (status == KILN_OK)
            graph->borders[graph->border_count++] = edge;
    }
    return status;
}

int kiln_chart_graph_create(struct kiln_chart_graph **graph, const struct kiln_scene *scene, uint32_t mesh,
                            uint32_t width, uint32_t height, struct kiln_error *error)
{
    int status = kiln_allocate(graph, 1, sizeof **graph, "a mesh's charts", error);
    if (status != KILN_OK)
        return status;
    struct builder b = {
        .scene = scene, .mesh = &scene->meshes[mesh], .width = (float)width, .height = (float)height, .graph = *graph};
    const size_t triangles = (*graph)->triangle_count = b.mesh->triangle_count;
    KILN_TRY(
        kiln_arena_allocate(&(*graph)->arena, &(*graph)->chart, triangles, sizeof(uint32_t), "a mesh's charts", error));
    KILN_TRY(kiln_arena_allocate(&b.arena, &b.parent, triangles, sizeof(uint32_t), "a mesh's charts", error));
    KILN_TRY(kiln_arena_allocate(&b.arena, &b.inner, triangles, 1, "a mesh's charts", error));
    KILN_TRY(weld_vertices(&b, error));
    KILN_TRY(list_halves(&b, error));
    for (uint32_t i = 0; i < triangles; i++)
        b.parent[i] = i;
    KILN_TRY(join_all(&b, error));
    number_charts(&b);
    KILN_TRY(list_borders(&b, error));
end:
    kiln_arena_release(&b.arena);
    if (status != KILN_OK)
        kiln_chart_graph_destroy(graph);
    return status;
}

void kiln_chart_graph_destroy(struct kiln_chart_graph **graph)
{
    if (*graph == NULL)
        return;
    kiln_arena_release(&(*graph)->arena);
    kiln_free(graph);
}

/* ---- where the surface ends ---- */

/* Whether the normals of both half-edges agree at both ends. */
static bool goes_on(const struct builder *b, const struct half_edge *first, const struct half_edge *second)
{
    const struct kiln_vec3 *normals = b->scene->normals + b->mesh->vertex_first;
    for (int e = 0; e < 2; e++)
        if (vec3_dot(normals[vertex_at(b, first, e)], normals[vertex_at(b, second, e)]) < KILN_SEAM_COSINE)
            return false;
    return true;
}

/* Finds the edges at which a smooth surface ends, among the half-edges [first, end) at one place in space. */
static void find_ends(const struct builder *b, size_t first, size_t end, uint8_t *ends)
{
    for (size_t i = first; i < end; i++) {
        bool found = end - first > MOST_AT_AN_EDGE;
        for (size_t j = first; !found && j < end; j++)
            found = j != i && goes_on(b, &b->halves[i], &b->halves[j]);
        if (!found)
            ends[b->halves[i].triangle] |= (uint8_t)(1u << b->halves[i].corner);
    }
}

int kiln_mesh_ends(uint8_t **ends, const struct kiln_scene *scene, uint32_t mesh, struct kiln_error *error)
{
    struct builder b = {.scene = scene, .mesh = &scene->meshes[mesh]};
    int status;
    KILN_TRY(kiln_allocate(ends, b.mesh->triangle_count, 1, "where a mesh ends", error));
    KILN_TRY(weld_vertices(&b, error));
    KILN_TRY(list_halves(&b, error));
    for (size_t first = 0, end; first < b.half_count; first = end) {
        end = first + 1;
        while (end < b.half_count && b.halves[end].low == b.halves[first].low &&
               b.halves[end].high == b.halves[first].high)
            end++;
        find_ends(&b, first, end, *ends);
    }
end:
    kiln_arena_release(&b.arena);
    return status;
}
