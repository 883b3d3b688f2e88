#include "worker/scene/voxels.h"

#include <float.h>
#include <stdlib.h>

#include "worker/base/memory.h"
#include "worker/scene/footprint.h"

#define MARGIN 1e-6 /* cells: tolerance within which a triangle counts as touching a cell */

struct kiln_voxels {
    struct kiln_dvec3 low; /* corner of the first cell, m */
    double side, scale;    /* of a cell, m; cells a metre */
    int n[3];
    uint64_t cells, filled;
    uint32_t *solid; /* a bit a cell */
};

#define KILN_VOXEL_GRID const struct kiln_voxels *
#define KILN_VOXEL_LOW(grid) ((grid)->low)
#define KILN_VOXEL_SCALE(grid) ((grid)->scale)
#define KILN_VOXEL_COUNT(grid, axis) ((grid)->n[KILN_VOXEL_AXIS_##axis])
#define KILN_VOXEL_AXIS_x 0
#define KILN_VOXEL_AXIS_y 1
#define KILN_VOXEL_AXIS_z 2
#define KILN_VOXEL_WORD(grid, i) ((grid)->solid[i])
#include "shaders/shared/voxels.h"

static void components(struct kiln_dvec3 v, double out[3]) { out[0] = v.x, out[1] = v.y, out[2] = v.z; }

static uint32_t cell_at(const struct kiln_voxels *v, const int c[3]) { return kiln_voxel_index(v, c[0], c[1], c[2]); }

static size_t words_of(const struct kiln_voxels *v) { return (size_t)(v->cells + 31) / 32; }

static int clamped(double x, int n) { return kiln_voxel_clamped(x, n); }

/* In cells. */
static void place_of(const struct kiln_voxels *v, struct kiln_vec3 p, double at[3])
{
    components(dvec3_scale(dvec3_sub(dvec3_of(p), v->low), v->scale), at);
}

/* ---- cells of triangles ---- */

/* Whether the axis separates the triangle from the cube about the origin with half side `half`. */
static bool parts(const double axis[3], const double corner[3][3], double half)
{
    double low = DBL_MAX, high = -DBL_MAX, reach = 0.0;
    for (int i = 0; i < 3; i++) {
        const double along = axis[0] * corner[i][0] + axis[1] * corner[i][1] + axis[2] * corner[i][2];
        low = fmin(low, along);
        high = fmax(high, along);
        reach += half * fabs(axis[i]);
    }
    return low > reach || high < -reach;
}

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

/* Whether the triangle, in cell coordinates, overlaps cell c. */
static bool comes_into(const double triangle[3][3], const int c[3])
{
    const double half = 0.5 + MARGIN;
    double corner[3][3], edge[3][3], axis[3];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            corner[i][k] = triangle[i][k] - ((double)c[k] + 0.5);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            edge[i][k] = corner[(i + 1) % 3][k] - corner[i][k];
    cross(edge[0], edge[1], axis);
    if (parts(axis, corner, half))
        return false;
    for (int i = 0; i < 3; i++) {
        const double unit[3] = {i == 0 ? 1.0 : 0.0, i == 1 ? 1.0 : 0.0, i == 2 ? 1.0 : 0.0};
        if (parts(unit, corner, half))
            return false;
        for (int k = 0; k < 3; k++) {
            cross(unit, edge[k], axis);
            if (parts(axis, corner, half))
                return false;
        }
    }
    return true;
}

static void fill_triangle(struct kiln_voxels *v, const struct kiln_geometry *g, size_t number)
{
    struct kiln_vec3 p[3];
    double t[3][3];
    int low[3], high[3], c[3];
    kiln_geometry_corners(g, number, p);
    for (int i = 0; i < 3; i++)
        place_of(v, p[i], t[i]);
    for (int k = 0; k < 3; k++) {
        low[k] = clamped(fmin(t[0][k], fmin(t[1][k], t[2][k])) - MARGIN, v->n[k]);
        high[k] = clamped(fmax(t[0][k], fmax(t[1][k], t[2][k])) + MARGIN, v->n[k]);
    }
    for (c[2] = low[2]; c[2] <= high[2]; c[2]++)
        for (c[1] = low[1]; c[1] <= high[1]; c[1]++)
            for (c[0] = low[0]; c[0] <= high[0]; c[0]++)
                if (comes_into(t, c)) {
                    const uint32_t cell = cell_at(v, c);
                    v->solid[cell / 32] |= 1u << cell % 32;
                }
}

static void count_filled(struct kiln_voxels *v)
{
    v->filled = 0;
    for (size_t i = 0; i < words_of(v); i++)
        v->filled += KILN_COUNT_BITS(v->solid[i]);
}

/* ---- life ---- */

static void measure(struct kiln_voxels *v, const struct kiln_geometry *g, uint32_t along)
{
    double size[3];
    components(dvec3_sub(dvec3_of(g->bounds_max), dvec3_of(g->bounds_min)), size);
    const double longest = fmax(size[0], fmax(size[1], size[2]));
    v->low = dvec3_of(g->bounds_min);
    v->side = longest > 0.0 ? longest / (double)along : 1.0;
    v->scale = 1.0 / v->side;
    for (int k = 0; k < 3; k++)
        v->n[k] = clamped(ceil(size[k] / v->side), (int)along + 1);
    for (int k = 0; k < 3; k++)
        v->n[k] = v->n[k] < 1 ? 1 : v->n[k];
}

int kiln_voxels_create(struct kiln_voxels **voxels, const struct kiln_geometry *g, uint32_t along,
                       struct kiln_error *error)
{
    struct kiln_voxels *v = NULL;
    int status = kiln_allocate(&v, 1, sizeof *v, "the voxels", error);
    *voxels = v;
    if (status != KILN_OK)
        return status;
    measure(v, g, along);
    v->cells = (uint64_t)v->n[0] * (uint64_t)v->n[1] * (uint64_t)v->n[2];
    status = kiln_allocate(&v->solid, words_of(v), sizeof *v->solid, "the voxels", error);
    for (size_t t = 0; status == KILN_OK && t < g->opaque_count - g->opaque_receivers; t++)
        fill_triangle(v, g, t);
    if (status == KILN_OK)
        count_filled(v);
    else
        kiln_voxels_destroy(voxels);
    return status;
}

void kiln_voxels_destroy(struct kiln_voxels **voxels)
{
    if (*voxels == NULL)
        return;
    kiln_free(&(*voxels)->solid);
    kiln_free(voxels);
}

uint64_t kiln_voxels_bytes(uint32_t along) { return (uint64_t)along * along * along / 8 + 8; }

/* ---- lines ---- */

bool kiln_voxels_open(const struct kiln_voxels *v, struct kiln_vec3 from, struct kiln_vec3 from_normal,
                      struct kiln_vec3 to, struct kiln_vec3 to_normal)
{
    return kiln_voxel_lets_see(v, dvec3_of(from), dvec3_of(from_normal), dvec3_of(to), dvec3_of(to_normal));
}

struct kiln_voxel_arrays kiln_voxels_arrays(const struct kiln_voxels *v)
{
    return (struct kiln_voxel_arrays){.low = v->low,
                                      .scale = v->scale,
                                      .n = {v->n[0], v->n[1], v->n[2]},
                                      .words = v->solid,
                                      .word_count = words_of(v),
                                      .filled = v->filled};
}

/* ---- to be looked at ---- */

struct kiln_voxel_grid kiln_voxels_grid(const struct kiln_voxels *v)
{
    return (struct kiln_voxel_grid){
        .low = v->low, .side = v->side, .n = {v->n[0], v->n[1], v->n[2]}, .filled = v->filled};
}

bool kiln_voxels_at(const struct kiln_voxels *v, struct kiln_vec3 place, struct kiln_voxel *voxel)
{
    double at[3];
    place_of(v, place, at);
    *voxel = (struct kiln_voxel){.axis = 0};
    for (int k = 0; k < 3; k++)
        voxel->cell[k] = clamped(at[k], v->n[k]);
    return kiln_voxel_is_solid(v, cell_at(v, voxel->cell));
}

static struct kiln_voxel_end end_in_cells(const struct kiln_voxels *v, struct kiln_dvec3 at)
{
    return (struct kiln_voxel_end){
        .at = at, .x = clamped(at.x, v->n[0]), .y = clamped(at.y, v->n[1]), .z = clamped(at.z, v->n[2])};
}

/* Clips a ray to the grid: where it enters and leaves. *axis: the axis of the side where it enters; -1: it begins
 * inside. False: it misses the grid. */
static bool clip(const struct kiln_voxels *v, struct kiln_vec3 origin, struct kiln_vec3 direction,
                 struct kiln_voxel_end *a, struct kiln_voxel_end *b, int *axis)
{
    double from[3], d[3], in = 0.0, out = DBL_MAX;
    place_of(v, origin, from);
    components(dvec3_of(direction), d);
    *axis = -1;
    for (int k = 0; k < 3; k++) {
        const double low = -from[k] / d[k], high = ((double)v->n[k] - from[k]) / d[k];
        if (d[k] == 0.0 && (from[k] < 0.0 || from[k] > (double)v->n[k]))
            return false;
        if (d[k] == 0.0)
            continue;
        if (fmin(low, high) > in)
            *axis = k;
        in = fmax(in, fmin(low, high));
        out = fmin(out, fmax(low, high));
    }
    const struct kiln_dvec3 place = dvec3(from[0], from[1], from[2]), way = dvec3(d[0], d[1], d[2]);
    *a = end_in_cells(v, dvec3_add(place, dvec3_scale(way, in)));
    *b = end_in_cells(v, dvec3_add(place, dvec3_scale(way, out)));
    return out > in;
}

bool kiln_voxels_meet(const struct kiln_voxels *v, struct kiln_vec3 origin, struct kiln_vec3 direction,
                      struct kiln_voxel *met)
{
    struct kiln_voxel_end a, b;
    int axis;
    if (!clip(v, origin, direction, &a, &b, &axis))
        return false;
    struct kiln_voxel_line l = kiln_voxel_line_of(v, &a, &b);
    for (bool leaving = axis < 0;; axis = kiln_voxel_step(&l)) {
        const bool solid = kiln_voxel_is_solid(v, l.at);
        const uint32_t x = (uint32_t)v->n[0], y = (uint32_t)v->n[1];
        if (solid && !leaving) {
            *met = (struct kiln_voxel){{(int)(l.at % x), (int)(l.at / x % y), (int)(l.at / (x * y))}, axis};
            return true;
        }
        leaving = leaving && solid;
        if (l.left == 0)
            return false;
    }
}
