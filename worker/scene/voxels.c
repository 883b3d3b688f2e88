#include "worker/scene/voxels.h"

#include <float.h>
#include <stdlib.h>

#include "worker/base/memory.h"

struct kiln_voxels {
    struct kiln_dvec3 low; /* corner of the first cell, m */
    double side;           /* of a cell, m */
    int n[3];
    uint64_t cells;
    uint64_t *solid; /* a bit a cell */
};

static void components(struct kiln_dvec3 v, double out[3]) { out[0] = v.x, out[1] = v.y, out[2] = v.z; }

static uint64_t cell_at(const struct kiln_voxels *v, const int c[3])
{
    return ((uint64_t)c[2] * (uint64_t)v->n[1] + (uint64_t)c[1]) * (uint64_t)v->n[0] + (uint64_t)c[0];
}

static int clamped(double x, int n) { return x < 0.0 ? 0 : x >= (double)n ? n - 1 : (int)x; }

/* In cells. */
static void place_of(const struct kiln_voxels *v, struct kiln_vec3 p, double at[3])
{
    components(dvec3_scale(dvec3_sub(dvec3_of(p), v->low), 1.0 / v->side), at);
}

/* ---- cells of triangles ---- */

/* Whether the axis parts the triangle from the unit cube about the origin with half side `half`. */
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

/* Whether the triangle, in cells, comes into cell c, or nearer than rounding. */
static bool comes_into(const double triangle[3][3], const int c[3])
{
    const double half = 0.5 + 1e-6;
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

static void add_triangle(struct kiln_voxels *v, const struct kiln_geometry *g, size_t number)
{
    struct kiln_vec3 p[3];
    double t[3][3];
    int low[3], high[3], c[3];
    kiln_geometry_corners(g, number, p);
    for (int i = 0; i < 3; i++)
        place_of(v, p[i], t[i]);
    for (int k = 0; k < 3; k++) {
        low[k] = clamped(fmin(t[0][k], fmin(t[1][k], t[2][k])) - 1e-6, v->n[k]);
        high[k] = clamped(fmax(t[0][k], fmax(t[1][k], t[2][k])) + 1e-6, v->n[k]);
    }
    for (c[2] = low[2]; c[2] <= high[2]; c[2]++)
        for (c[1] = low[1]; c[1] <= high[1]; c[1]++)
            for (c[0] = low[0]; c[0] <= high[0]; c[0]++)
                if (comes_into(t, c))
                    v->solid[cell_at(v, c) / 64] |= (uint64_t)1 << cell_at(v, c) % 64;
}

/* ---- life ---- */

static void measure(struct kiln_voxels *v, const struct kiln_geometry *g, uint32_t along)
{
    double size[3];
    components(dvec3_sub(dvec3_of(g->bounds_max), dvec3_of(g->bounds_min)), size);
    const double longest = fmax(size[0], fmax(size[1], size[2]));
    v->low = dvec3_of(g->bounds_min);
    v->side = longest > 0.0 ? longest / (double)along : 1.0;
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
    if (status == KILN_OK) {
        measure(v, g, along);
        v->cells = (uint64_t)v->n[0] * (uint64_t)v->n[1] * (uint64_t)v->n[2];
        status = kiln_allocate(&v->solid, (size_t)(v->cells + 63) / 64, sizeof *v->solid, "the voxels", error);
    }
    for (size_t t = 0; status == KILN_OK && t < g->opaque_count - g->opaque_receivers; t++)
        add_triangle(v, g, t);
    if (status != KILN_OK)
        kiln_voxels_destroy(&v);
    *voxels = v;
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

/* A line on its way along one axis: the share of it at which the next border lies, and what lies between two. */
struct axis {
    double next, apart;
    int64_t stride;
};

static struct axis axis_of(double from, double to, int cell, int end, int64_t stride)
{
    const double d = to - from;
    if (cell == end)
        return (struct axis){.next = DBL_MAX};
    return (struct axis){((double)cell + (d > 0.0 ? 1.0 : 0.0) - from) / d, 1.0 / fabs(d), d > 0.0 ? stride : -stride};
}

/* Rounding may take a line past the grid's border. */
static bool is_solid(const struct kiln_voxels *v, uint64_t at)
{
    return at < v->cells && (v->solid[at / 64] >> at % 64 & 1u) != 0;
}

/* An end of a line, in cells: its cell, and the plane of its surface. */
struct end {
    double at[3], n[3];
    int cell[3];
};

static void find_end(const struct kiln_voxels *v, struct kiln_vec3 place, struct kiln_vec3 normal, struct end *end)
{
    place_of(v, place, end->at);
    components(dvec3_of(normal), end->n);
    for (int k = 0; k < 3; k++)
        end->cell[k] = clamped(end->at[k], v->n[k]);
}

/* Whether the cell at `at` touches the end's, or its surface's plane goes through it. */
static bool is_of_end(const struct kiln_voxels *v, uint64_t at, const struct end *end)
{
    const uint64_t x = (uint64_t)v->n[0], y = (uint64_t)v->n[1];
    const int cell[3] = {(int)(at % x), (int)(at / x % y), (int)(at / (x * y))};
    double off = 0.0, reach = 1e-6;
    bool touches = true;
    for (int k = 0; k < 3; k++) {
        touches = touches && abs(cell[k] - end->cell[k]) <= 1;
        off += end->n[k] * ((double)cell[k] + 0.5 - end->at[k]);
        reach += 0.5 * fabs(end->n[k]);
    }
    return touches || fabs(off) <= reach;
}

/* A line between two places, in cells: the cell that it is in, and how many borders are left. */
struct line {
    struct axis x, y, z;
    uint64_t at;
    int left;
};

static struct line line_of(const struct kiln_voxels *v, const struct end *a, const struct end *b)
{
    const int64_t stride[3] = {1, v->n[0], (int64_t)v->n[0] * v->n[1]};
    struct line l = {.at = cell_at(v, a->cell)};
    struct axis *axis[3] = {&l.x, &l.y, &l.z};
    for (int k = 0; k < 3; k++) {
        l.left += abs(b->cell[k] - a->cell[k]);
        *axis[k] = axis_of(a->at[k], b->at[k], a->cell[k], b->cell[k], stride[k]);
    }
    return l;
}

/* Goes on to the next cell; returns the axis that it lies along. */
static inline int step(struct line *l)
{
    const int k = l->x.next < l->y.next && l->x.next < l->z.next ? 0 : l->y.next < l->z.next ? 1 : 2;
    struct axis *axis = k == 0 ? &l->x : k == 1 ? &l->y : &l->z;
    l->at += (uint64_t)axis->stride;
    axis->next += axis->apart;
    l->left--;
    return k;
}

/* It ends after as many borders as lie between the two. */
bool kiln_voxels_open(const struct kiln_voxels *v, struct kiln_vec3 from, struct kiln_vec3 from_normal,
                      struct kiln_vec3 to, struct kiln_vec3 to_normal)
{
    struct end a, b;
    find_end(v, from, from_normal, &a);
    find_end(v, to, to_normal, &b);
    for (struct line l = line_of(v, &a, &b); l.left > 0; (void)step(&l))
        if (is_solid(v, l.at) && !is_of_end(v, l.at, &a) && !is_of_end(v, l.at, &b))
            return false;
    return true;
}

/* ---- to be looked at ---- */

struct kiln_voxel_grid kiln_voxels_grid(const struct kiln_voxels *v)
{
    struct kiln_voxel_grid grid = {.low = v->low, .side = v->side, .n = {v->n[0], v->n[1], v->n[2]}};
    for (uint64_t i = 0; i < (v->cells + 63) / 64; i++)
        grid.filled += (uint64_t)__builtin_popcountll(v->solid[i]);
    return grid;
}

bool kiln_voxels_at(const struct kiln_voxels *v, struct kiln_vec3 place, struct kiln_voxel *voxel)
{
    double at[3];
    place_of(v, place, at);
    *voxel = (struct kiln_voxel){.axis = 0};
    for (int k = 0; k < 3; k++)
        voxel->cell[k] = clamped(at[k], v->n[k]);
    return is_solid(v, cell_at(v, voxel->cell));
}

/* Where a ray comes into the grid, and where it goes out; *axis: across which side it comes in, -1: it begins inside.
 * False: it goes by. */
static bool clip(const struct kiln_voxels *v, struct kiln_vec3 origin, struct kiln_vec3 direction, struct end *a,
                 struct end *b, int *axis)
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
    for (int k = 0; k < 3; k++) {
        a->at[k] = from[k] + in * d[k];
        b->at[k] = from[k] + out * d[k];
        a->cell[k] = clamped(a->at[k], v->n[k]);
        b->cell[k] = clamped(b->at[k], v->n[k]);
    }
    return out > in;
}

bool kiln_voxels_meet(const struct kiln_voxels *v, struct kiln_vec3 origin, struct kiln_vec3 direction,
                      struct kiln_voxel *met)
{
    struct end a, b;
    int axis;
    if (!clip(v, origin, direction, &a, &b, &axis))
        return false;
    struct line l = line_of(v, &a, &b);
    for (bool leaving = axis < 0;; axis = step(&l)) {
        const bool solid = is_solid(v, l.at);
        const uint64_t x = (uint64_t)v->n[0], y = (uint64_t)v->n[1];
        if (solid && !leaving) {
            *met = (struct kiln_voxel){{(int)(l.at % x), (int)(l.at / x % y), (int)(l.at / (x * y))}, axis};
            return true;
        }
        leaving = leaving && solid;
        if (l.left == 0)
            return false;
    }
}
