#include "coordinator/layout/unwrap.h"

#include <string.h>

#include "coordinator/layout/pack.h"
#include "coordinator/layout/padding.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

static int add_vertex(struct kiln_unwrapped *u, uint32_t source, struct kiln_vec2 uv, uint32_t *index,
                      struct kiln_error *error)
{
    int status = kiln_arena_grow(&u->arena, &u->source, &u->capacity, u->vertex_count + 1, sizeof *u->source,
                                 "unwrapped vertices", error);
    if (status == KILN_OK)
        status = kiln_arena_grow(&u->arena, &u->uv, &u->uv_capacity, u->vertex_count + 1, sizeof *u->uv,
                                 "unwrapped vertices", error);
    if (status != KILN_OK)
        return status;
    u->source[u->vertex_count] = source;
    u->uv[u->vertex_count] = uv;
    *index = (uint32_t)u->vertex_count++;
    return KILN_OK;
}

static float unit(double value) { return (float)fmin(fmax(value, 0.0), 1.0); }

/* Writes the vertices and triangles of all charts. copy[v] is the last copy made of vertex v; made[v] is the chart it
 * was made for, plus 1. */
static int lay_charts(struct kiln_unwrapped *u, const struct kiln_topology *t, const struct kiln_charts *charts,
                      const struct kiln_packing *packing, uint32_t *copy, uint32_t *made, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < charts->count; i++) {
        const struct kiln_chart *chart = &charts->charts[i];
        const double *m = packing->maps[i];
        for (size_t k = 0; k < 3 * (size_t)chart->count && status == KILN_OK; k++) {
            const size_t corner = 3 * (size_t)charts->order[chart->first + k / 3] + k % 3;
            const uint32_t vertex = t->triangles[corner];
            if (made[vertex] != i + 1) {
                double ab[2];
                kiln_chart_project(chart, t->points[vertex], ab);
                const struct kiln_vec2 uv = {unit(m[0] * ab[0] + m[1] * ab[1] + m[2]),
                                             unit(m[3] * ab[0] + m[4] * ab[1] + m[5])};
                status = add_vertex(u, vertex, uv, &copy[vertex], error);
                made[vertex] = (uint32_t)i + 1;
            }
            u->triangles[corner] = copy[vertex];
        }
    }
    return status;
}

/* Gives each degenerate triangle a single point: a corner that lies on a chart, or else the first vertex. */
static int lay_degenerate(struct kiln_unwrapped *u, const struct kiln_topology *t, const uint32_t *copy,
                          const uint32_t *made, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < t->triangle_count && status == KILN_OK; i++) {
        if (t->areas[i] > 0.0)
            continue;
        const uint32_t *c = t->triangles + 3 * i;
        struct kiln_vec2 uv = u->vertex_count > 0 ? u->uv[0] : (struct kiln_vec2){0.5f, 0.5f};
        for (int k = 2; k >= 0; k--)
            if (made[c[k]] != 0)
                uv = u->uv[copy[c[k]]];
        for (size_t k = 0; k < 3 && status == KILN_OK; k++)
            status = add_vertex(u, c[k], uv, &u->triangles[3 * i + k], error);
    }
    return status;
}

static int lay_vertices(struct kiln_unwrapped *u, const struct kiln_topology *t, const struct kiln_charts *charts,
                        const struct kiln_packing *packing, struct kiln_error *error)
{
    uint32_t *copy = NULL, *made = NULL;
    int status;
    KILN_TRY(kiln_allocate(&copy, t->vertex_count, sizeof *copy, "unwrapped vertices", error));
    KILN_TRY(kiln_allocate(&made, t->vertex_count, sizeof *made, "unwrapped vertices", error));
    KILN_TRY(kiln_arena_allocate(&u->arena, &u->triangles, 3 * t->triangle_count, sizeof *u->triangles,
                                 "unwrapped triangles", error));
    KILN_TRY(lay_charts(u, t, charts, packing, copy, made, error));
    KILN_TRY(lay_degenerate(u, t, copy, made, error));
end:
    kiln_free(&made);
    kiln_free(&copy);
    return status;
}

/* Packs the charts and writes the new vertices. */
static int lay_out(struct kiln_unwrapped **unwrapped, const struct kiln_topology *topology,
                   const struct kiln_charts *charts, const struct kiln_unwrap_params *params, struct kiln_error *error)
{
    const uint32_t side = params->size > 0 ? params->size : 1;
    struct kiln_packing packing = {
        .width = side, .height = side, .cells = 1, .texels_per_metre = params->texels_per_metre};
    const struct kiln_pack_params pack = {.texels_per_metre = params->size > 0 ? 0.0 : params->texels_per_metre,
                                          .padding = params->padding,
                                          .limit = params->size > 0 ? params->size : params->max,
                                          .exact = params->size > 0};
    struct kiln_unwrapped *u = NULL;
    int status;
    KILN_TRY(kiln_allocate(&u, 1, sizeof *u, "unwrapping a mesh", error));
    if (charts->count > 0)
        KILN_TRY(kiln_pack(&packing, charts, topology, &pack, error));
    KILN_TRY(lay_vertices(u, topology, charts, &packing, error));
end:
    if (status == KILN_OK) {
        u->chart_count = charts->count;
        u->degenerate_count = topology->degenerate_count;
        u->width = packing.width;
        u->height = packing.height;
        u->texels_per_metre = packing.texels_per_metre;
        u->cells = packing.cells;
        *unwrapped = u;
    } else if (u != NULL) {
        kiln_unwrapped_destroy(&u);
    }
    kiln_free(&packing.maps);
    return status;
}

int kiln_unwrap(struct kiln_unwrapped **unwrapped, const struct kiln_vec3 *positions, size_t vertex_count,
                const uint32_t *triangles, size_t triangle_count, const struct kiln_unwrap_params *params,
                struct kiln_error *error)
{
    struct kiln_topology *topology = NULL;
    struct kiln_charts *charts = NULL;
    *unwrapped = NULL;
    int status =
        kiln_topology_create(&topology, positions, vertex_count, triangles, triangle_count, params->linear, error);
    if (status == KILN_OK)
        status = kiln_charts_create(&charts, topology, params->texels_per_metre, error);
    if (status == KILN_OK)
        status = lay_out(unwrapped, topology, charts, params, error);
    kiln_charts_destroy(&charts);
    kiln_topology_destroy(&topology);
    return status;
}

/* ---- charts that are given ---- */

/* Makes a flat mesh, in metres, of the existing layout. */
static int flat_topology(struct kiln_topology *t, const struct kiln_vec2 *uv, size_t vertex_count,
                         const uint32_t *triangles, size_t triangle_count, const double metres[2],
                         struct kiln_error *error)
{
    *t = (struct kiln_topology){.vertex_count = vertex_count, .triangle_count = triangle_count, .triangles = triangles};
    int status;
    KILN_TRY(kiln_allocate(&t->points, vertex_count, sizeof *t->points, "a mesh's layout", error));
    KILN_TRY(kiln_arena_allocate(&t->arena, &t->areas, triangle_count, sizeof *t->areas, "a mesh's layout", error));
    for (size_t i = 0; i < vertex_count; i++)
        t->points[i] = dvec3(metres[0] * (double)uv[i].x, metres[1] * (double)uv[i].y, 0.0);
    for (size_t i = 0; i < triangle_count; i++) {
        const uint32_t *c = triangles + 3 * i;
        const struct kiln_dvec3 a = dvec3_sub(t->points[c[1]], t->points[c[0]]),
                                b = dvec3_sub(t->points[c[2]], t->points[c[0]]);
        t->areas[i] = 0.5 * fabs(a.x * b.y - a.y * b.x);
        t->degenerate_count += !(t->areas[i] > 0.0);
    }
end:
    return status;
}

/* Computes the chart's bounding box and area from its triangles. */
static void measure_chart(struct kiln_chart *chart, const struct kiln_topology *t, const uint32_t *order)
{
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (size_t k = 0; k < 3 * (size_t)chart->count; k++) {
        const struct kiln_dvec3 p = t->points[t->triangles[3 * (size_t)order[chart->first + k / 3] + k % 3]];
        low[0] = fmin(low[0], p.x);
        low[1] = fmin(low[1], p.y);
        high[0] = fmax(high[0], p.x);
        high[1] = fmax(high[1], p.y);
    }
    for (size_t k = 0; k < chart->count; k++)
        chart->area += t->areas[order[chart->first + k]];
    chart->u = dvec3(1.0, 0.0, 0.0);
    chart->v = dvec3(0.0, 1.0, 0.0);
    for (int k = 0; k < 2; k++)
        chart->offset[k] = -low[k];
    chart->width = high[0] - low[0];
    chart->height = high[1] - low[1];
    chart->rectangular = chart->area >= (1.0 - 1e-5) * chart->width * chart->height;
}

/* Lists the triangles with an area, chart by chart; charts without any are left out. */
static int fill_charts(struct kiln_charts *charts, const struct kiln_topology *t, const uint32_t *chart, size_t count,
                       struct kiln_error *error)
{
    uint32_t *first = NULL;
    int status;
    KILN_TRY(kiln_allocate(&first, count + 1, sizeof *first, "a mesh's charts", error));
    KILN_TRY(kiln_allocate(&charts->order, t->triangle_count, sizeof *charts->order, "a mesh's charts", error));
    KILN_TRY(kiln_allocate(&charts->charts, count, sizeof *charts->charts, "a mesh's charts", error));
    for (size_t i = 0; i < t->triangle_count; i++)
        first[chart[i] + 1] += t->areas[i] > 0.0;
    for (size_t c = 0; c < count; c++) {
        first[c + 1] += first[c];
        if (first[c + 1] > first[c])
            charts->charts[charts->count++] = (struct kiln_chart){.first = first[c], .count = first[c + 1] - first[c]};
    }
    for (size_t i = 0; i < t->triangle_count; i++)
        if (t->areas[i] > 0.0) {
            /* moves the chart's entry of `first` towards the chart's end */
            charts->order[first[chart[i]]++] = (uint32_t)i;
            charts->order_count++;
        }
    for (size_t c = 0; c < charts->count; c++)
        measure_chart(&charts->charts[c], t, charts->order);
end:
    kiln_free(&first);
    return status;
}

int kiln_repack(struct kiln_unwrapped **unwrapped, const struct kiln_vec3 *positions, const struct kiln_vec2 *uv,
                size_t vertex_count, const uint32_t *triangles, size_t triangle_count, const double metres[2],
                const struct kiln_unwrap_params *params, struct kiln_error *error)
{
    struct kiln_topology topology = {0};
    struct kiln_charts charts = {0};
    uint32_t *chart = NULL;
    uint8_t *borders = NULL;
    size_t count = 0;
    *unwrapped = NULL;
    int status;
    KILN_TRY(flat_topology(&topology, uv, vertex_count, triangles, triangle_count, metres, error));
    KILN_TRY(kiln_allocate(&chart, triangle_count, sizeof *chart, "a mesh's charts", error));
    KILN_TRY(kiln_allocate(&borders, triangle_count, 1, "a mesh's charts", error));
    KILN_TRY(
        kiln_padding_charts(positions, uv, vertex_count, triangles, triangle_count, chart, borders, &count, error));
    KILN_TRY(fill_charts(&charts, &topology, chart, count, error));
    KILN_TRY(lay_out(unwrapped, &topology, &charts, params, error));
end:
    kiln_free(&charts.charts);
    kiln_free(&charts.order);
    kiln_free(&borders);
    kiln_free(&chart);
    kiln_free(&topology.points);
    kiln_arena_free(&topology.arena, &topology.areas);
    return status;
}

void kiln_unwrapped_destroy(struct kiln_unwrapped **unwrapped)
{
    if (*unwrapped == NULL)
        return;
    kiln_arena_release(&(*unwrapped)->arena);
    kiln_free(unwrapped);
}
