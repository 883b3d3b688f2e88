#include "coordinator/layout/topology.h"

#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum { PAIRED_MAX = 8 };
static const double DEGENERATE_HEIGHT = 1e-7;

static void transform_points(struct kiln_topology *t, const struct kiln_vec3 *positions, const double m[9])
{
    struct kiln_dvec3 low = dvec3(INFINITY, INFINITY, INFINITY), high = dvec3(-INFINITY, -INFINITY, -INFINITY);
    for (size_t i = 0; i < t->vertex_count; i++) {
        const struct kiln_dvec3 p = dvec3_of(positions[i]);
        low = dvec3(fmin(low.x, p.x), fmin(low.y, p.y), fmin(low.z, p.z));
        high = dvec3(fmax(high.x, p.x), fmax(high.y, p.y), fmax(high.z, p.z));
    }
    const struct kiln_dvec3 middle = dvec3_scale(dvec3_add(low, high), 0.5);
    for (size_t i = 0; i < t->vertex_count; i++) {
        const struct kiln_dvec3 p = dvec3_sub(dvec3_of(positions[i]), middle);
        t->points[i] = dvec3(m[0] * p.x + m[1] * p.y + m[2] * p.z, m[3] * p.x + m[4] * p.y + m[5] * p.z,
                             m[6] * p.x + m[7] * p.y + m[8] * p.z);
    }
}

static void measure_triangles(struct kiln_topology *t)
{
    for (size_t i = 0; i < t->triangle_count; i++) {
        const uint32_t *c = t->triangles + 3 * i;
        const struct kiln_dvec3 a = dvec3_sub(t->points[c[1]], t->points[c[0]]),
                                b = dvec3_sub(t->points[c[2]], t->points[c[0]]);
        const struct kiln_dvec3 d = dvec3_sub(b, a), n = dvec3_cross(a, b);
        const double longest = fmax(dvec3_dot(a, a), fmax(dvec3_dot(b, b), dvec3_dot(d, d))), twice = dvec3_length(n);
        if (!(twice > DEGENERATE_HEIGHT * longest) || !isfinite(twice)) {
            t->degenerate_count++;
            continue;
        }
        t->areas[i] = 0.5 * twice;
        t->normals[i] = dvec3_scale(n, 1.0 / twice);
    }
}

/* Welds vertices: weld[v] is the first vertex with the coordinates of v. */
static int weld_vertices(const struct kiln_topology *t, const struct kiln_vec3 *positions, uint32_t *weld,
                         struct kiln_error *error)
{
    const size_t size = kiln_layout_table_size(t->vertex_count);
    uint32_t *table = NULL;
    const int status = kiln_allocate(&table, size, sizeof *table, "welding vertices", error);
    if (status != KILN_OK)
        return status;
    memset(table, 0xff, size * sizeof *table);
    for (size_t i = 0; i < t->vertex_count; i++) {
        /* + 0 makes -0 and 0 the same bits. */
        const float key[3] = {positions[i].x + 0.0f, positions[i].y + 0.0f, positions[i].z + 0.0f};
        uint32_t bits[3];
        memcpy(bits, key, sizeof bits);
        size_t slot =
            (size_t)kiln_layout_mix(kiln_layout_mix((uint64_t)bits[0] << 32 | bits[1]) + bits[2]) & (size - 1);
        for (; table[slot] != KILN_NONE; slot = (slot + 1) & (size - 1)) {
            const struct kiln_vec3 other = positions[table[slot]];
            if (other.x == key[0] && other.y == key[1] && other.z == key[2])
                break;
        }
        if (table[slot] == KILN_NONE)
            table[slot] = (uint32_t)i;
        weld[i] = table[slot];
    }
    kiln_free(&table);
    return KILN_OK;
}

struct edge_table {
    const struct kiln_topology *topology;
    const uint32_t *weld;
    uint32_t *first; /* per hash of two ends: the first half-edge */
    uint32_t *next;  /* per half-edge: the next one along the same edge */
    size_t size;
};

static uint32_t edge_from(const struct edge_table *e, uint32_t half) { return e->weld[e->topology->triangles[half]]; }
static uint32_t edge_to(const struct edge_table *e, uint32_t half)
{
    return e->weld[e->topology->triangles[half - half % 3 + (half + 1) % 3]];
}

static void edge_insert(const struct edge_table *e, uint32_t half)
{
    const uint32_t a = edge_from(e, half), b = edge_to(e, half);
    const uint64_t key = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
    size_t slot = (size_t)kiln_layout_mix(key) & (e->size - 1);
    for (; e->first[slot] != KILN_NONE; slot = (slot + 1) & (e->size - 1)) {
        const uint32_t c = edge_from(e, e->first[slot]), d = edge_to(e, e->first[slot]);
        if ((c == a && d == b) || (c == b && d == a))
            break;
    }
    e->next[half] = e->first[slot];
    e->first[slot] = half;
}

static void join(struct kiln_topology *t, uint32_t a, uint32_t b)
{
    t->neighbours[a] = b / 3;
    t->neighbours[b] = a / 3;
}

/* Pairs the half-edges of one edge: opposite directions, best agreement of normals first. */
static void pair_edge(struct kiln_topology *t, const struct edge_table *e, uint32_t head)
{
    uint32_t half[PAIRED_MAX];
    size_t count = 0;
    for (uint32_t h = head; h != KILN_NONE; h = e->next[h]) {
        if (count == PAIRED_MAX)
            return;
        half[count++] = h;
    }
    for (;;) {
        double best = -2.0;
        size_t best_i = 0, best_j = 0;
        /* The list runs from the last half-edge to the first: walk it backwards, so that ties go to the lowest
         * triangles. */
        for (size_t i = count; i-- > 1;) {
            for (size_t j = i; j-- > 0;) {
                if (half[i] == KILN_NONE || half[j] == KILN_NONE || edge_from(e, half[i]) != edge_to(e, half[j]))
                    continue;
                const double agreement = dvec3_dot(t->normals[half[i] / 3], t->normals[half[j] / 3]);
                if (agreement > best + 1e-6) {
                    best = agreement;
                    best_i = i;
                    best_j = j;
                }
            }
        }
        if (best < -1.5)
            return;
        join(t, half[best_i], half[best_j]);
        half[best_i] = half[best_j] = KILN_NONE;
    }
}

static int find_neighbours(struct kiln_topology *t, const struct kiln_vec3 *positions, struct kiln_error *error)
{
    const size_t halves = 3 * t->triangle_count;
    struct edge_table e = {.topology = t, .size = kiln_layout_table_size(halves)};
    uint32_t *weld = NULL;
    int status = kiln_allocate(&weld, t->vertex_count, sizeof *weld, "welding vertices", error);
    if (status == KILN_OK)
        status = weld_vertices(t, positions, weld, error);
    if (status == KILN_OK)
        status = kiln_allocate(&e.first, e.size, sizeof *e.first, "a mesh's edges", error);
    if (status == KILN_OK)
        status = kiln_allocate(&e.next, halves, sizeof *e.next, "a mesh's edges", error);
    if (status != KILN_OK)
        goto cleanup;
    memset(e.first, 0xff, e.size * sizeof *e.first);
    memset(t->neighbours, 0xff, halves * sizeof *t->neighbours);
    e.weld = weld;
    for (size_t h = 0; h < halves; h++)
        if (t->areas[h / 3] > 0.0)
            edge_insert(&e, (uint32_t)h);
    for (size_t slot = 0; slot < e.size; slot++)
        if (e.first[slot] != KILN_NONE)
            pair_edge(t, &e, e.first[slot]);
cleanup:
    kiln_free(&e.next);
    kiln_free(&e.first);
    kiln_free(&weld);
    return status;
}

int kiln_topology_create(struct kiln_topology **topology, const struct kiln_vec3 *positions, size_t vertex_count,
                         const uint32_t *triangles, size_t triangle_count, const double linear[9],
                         struct kiln_error *error)
{
    struct kiln_topology *t = NULL;
    *topology = NULL;
    if (triangle_count > (UINT32_MAX - 1) / 3 || vertex_count >= UINT32_MAX)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "a mesh of %zu triangles and %zu vertices is too large to unwrap; split it", triangle_count,
                         vertex_count);
    int status = kiln_allocate(&t, 1, sizeof *t, "unwrapping a mesh", error);
    if (status != KILN_OK)
        return status;
    t->vertex_count = vertex_count;
    t->triangle_count = triangle_count;
    t->triangles = triangles;
    KILN_TRY(kiln_allocate(&t->points, vertex_count, sizeof *t->points, "unwrapping a mesh", error));
    KILN_TRY(
        kiln_arena_allocate(&t->arena, &t->normals, triangle_count, sizeof *t->normals, "unwrapping a mesh", error));
    KILN_TRY(kiln_arena_allocate(&t->arena, &t->areas, triangle_count, sizeof *t->areas, "unwrapping a mesh", error));
    KILN_TRY(kiln_arena_allocate(&t->arena, &t->neighbours, 3 * triangle_count, sizeof *t->neighbours,
                                 "unwrapping a mesh", error));
    transform_points(t, positions, linear);
    measure_triangles(t);
    KILN_TRY(find_neighbours(t, positions, error));
end:
    if (status != KILN_OK)
        kiln_topology_destroy(&t);
    *topology = t;
    return status;
}

void kiln_topology_destroy(struct kiln_topology **topology)
{
    struct kiln_topology *t = *topology;
    if (t == NULL)
        return;
    kiln_arena_release(&t->arena);
    kiln_free(&t->points);
    kiln_free(topology);
}
