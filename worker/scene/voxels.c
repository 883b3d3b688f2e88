#include "worker/scene/voxels.h"

#include <float.h>
#include <stdlib.h>

#include "worker/base/memory.h"
#include "worker/scene/footprint.h"

/* Cells, which no line errs by that is reckoned in floats: along it KILN_VOXELS_FILTER_MOST sums of shares of its
 * length, which is 443 cells at most. */
#define FILTER_MARGIN (1.0 / 64.0)
/* Among which a triangle's plane is looked for: triangles of one wall mostly follow each other. */
enum { LAST_PLANES = 16 };
#define MANY (KILN_VOXEL_NO_PLANE - 1u) /* first of a cell's planes: it has too many */

struct kiln_voxels {
    struct kiln_dvec3 low; /* corner of the first cell, m */
    double side, scale;    /* of a cell, m; cells a metre */
    double margin;         /* cells: what comes nearer to a cell than this counts as in it */
    int n[3];
    uint64_t cells, filled;
    uint32_t *solid; /* a bit a cell */
    /* of a filter: see kiln_voxel_arrays */
    uint32_t *before, *plane_of;
    struct kiln_voxel_plane *planes;
    size_t plane_count, plane_room;
};

#define KILN_VOXEL_GRID const struct kiln_voxels *
#define KILN_VOXEL_LOW(grid) ((grid)->low)
#define KILN_VOXEL_SCALE(grid) ((grid)->scale)
#define KILN_VOXEL_COUNT(grid, axis) ((grid)->n[KILN_VOXEL_AXIS_##axis])
#define KILN_VOXEL_AXIS_x 0
#define KILN_VOXEL_AXIS_y 1
#define KILN_VOXEL_AXIS_z 2
#define KILN_VOXEL_WORD(grid, i) ((grid)->solid[i])
#define KILN_VOXEL_BEFORE(grid, i) ((grid)->before[i])
#define KILN_VOXEL_PLANE_OF(grid, i) ((grid)->plane_of[i])
#define KILN_VOXEL_PLANE_REAL(grid, i) (((const double *)(grid)->planes)[i])
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

/* Whether the triangle, in cells, comes into cell c, or nearer than the margin. */
static bool comes_into(const double triangle[3][3], const int c[3], double margin)
{
    const double half = 0.5 + margin;
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

/* What is done with a cell that a triangle comes into; `value` is the caller's. */
typedef void (*cell_function)(struct kiln_voxels *v, uint32_t cell, uint32_t value);

static void each_cell(struct kiln_voxels *v, const struct kiln_geometry *g, size_t number, cell_function function,
                      uint32_t value)
{
    struct kiln_vec3 p[3];
    double t[3][3];
    int low[3], high[3], c[3];
    kiln_geometry_corners(g, number, p);
    for (int i = 0; i < 3; i++)
        place_of(v, p[i], t[i]);
    for (int k = 0; k < 3; k++) {
        low[k] = clamped(fmin(t[0][k], fmin(t[1][k], t[2][k])) - v->margin, v->n[k]);
        high[k] = clamped(fmax(t[0][k], fmax(t[1][k], t[2][k])) + v->margin, v->n[k]);
    }
    for (c[2] = low[2]; c[2] <= high[2]; c[2]++)
        for (c[1] = low[1]; c[1] <= high[1]; c[1]++)
            for (c[0] = low[0]; c[0] <= high[0]; c[0]++)
                if (comes_into(t, c, v->margin))
                    function(v, cell_at(v, c), value);
}

/* cell_function */
static void fill(struct kiln_voxels *v, uint32_t cell, uint32_t value)
{
    (void)value;
    v->solid[cell / 32] |= 1u << cell % 32;
}

/* ---- planes of a filter's cells ---- */

/* How far a triangle's corners are from the plane, m. */
static double distance_from(const struct kiln_voxel_plane *plane, const struct kiln_vec3 corner[3])
{
    double most = 0.0;
    for (int i = 0; i < 3; i++)
        most = fmax(most, fabs(dvec3_dot(plane->n, dvec3_of(corner[i])) - plane->along));
    return most;
}

/* The plane of a triangle: among the last ones that were made, or a new one. Half of the distance that rays need from a
 * surface is what they may err by at a place that has moved by rounding. */
static int find_plane(struct kiln_voxels *v, const struct kiln_geometry *g, size_t number, uint32_t *plane,
                      struct kiln_error *error)
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(g, number, corner);
    const struct kiln_dvec3 o = dvec3_of(corner[0]);
    struct kiln_dvec3 n = dvec3_cross(dvec3_sub(dvec3_of(corner[1]), o), dvec3_sub(dvec3_of(corner[2]), o));
    const double length = dvec3_length(n);
    *plane = KILN_VOXEL_NO_PLANE;
    if (!(length > 0.0))
        return KILN_OK; /* a triangle without area */
    n = dvec3_scale(n, 1.0 / length);
    const double off = 0.5 * (double)kiln_offset_distance(g, (uint32_t)number, vec3_of(n));
    for (size_t i = 0; i < LAST_PLANES && i < v->plane_count; i++) {
        struct kiln_voxel_plane *last = &v->planes[v->plane_count - 1 - i];
        const double bent = distance_from(last, corner);
        if (bent > 0.25 * off || bent > 0.25 * last->off)
            continue;
        last->off = fmax(last->off, off + bent);
        *plane = (uint32_t)(v->plane_count - 1 - i);
        return KILN_OK;
    }
    const int status = kiln_grow(&v->planes, &v->plane_room, v->plane_count + 1, sizeof *v->planes, "planes", error);
    if (status != KILN_OK)
        return status;
    *plane = (uint32_t)v->plane_count;
    v->planes[v->plane_count++] = (struct kiln_voxel_plane){n, dvec3_dot(n, o), off};
    return KILN_OK;
}

/* cell_function: adds a plane to a cell that counts. */
static void add_plane(struct kiln_voxels *v, uint32_t cell, uint32_t plane)
{
    const uint32_t below = v->solid[cell / 32] & ((1u << cell % 32) - 1u);
    uint32_t *of = &v->plane_of[KILN_VOXEL_PLANES * (v->before[cell / 32] + KILN_COUNT_BITS(below))];
    uint32_t i = 0;
    if (of[0] == MANY)
        return;
    while (i < KILN_VOXEL_PLANES && of[i] != KILN_VOXEL_NO_PLANE && of[i] != plane)
        i++;
    if (i == KILN_VOXEL_PLANES || plane == KILN_VOXEL_NO_PLANE)
        of[0] = MANY;
    else
        of[i] = plane;
}

static void count_filled(struct kiln_voxels *v)
{
    v->filled = 0;
    for (size_t i = 0; i < words_of(v); i++) {
        if (v->before != NULL)
            v->before[i] = (uint32_t)v->filled;
        v->filled += KILN_COUNT_BITS(v->solid[i]);
    }
}

static int add_planes(struct kiln_voxels *v, const struct kiln_geometry *g, struct kiln_error *error)
{
    static const char what[] = "the planes of voxels";
    const size_t count = (size_t)KILN_VOXEL_PLANES * v->filled;
    int status = kiln_allocate(&v->plane_of, count, sizeof *v->plane_of, what, error);
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        v->plane_of[i] = KILN_VOXEL_NO_PLANE;
    for (size_t i = 0; status == KILN_OK && i < kiln_geometry_hittable_count(g); i++) {
        const size_t triangle = kiln_geometry_hittable(g, i);
        uint32_t plane;
        status = find_plane(v, g, triangle, &plane, error);
        if (status == KILN_OK)
            each_cell(v, g, triangle, add_plane, plane);
    }
    for (size_t i = 0; status == KILN_OK && i < count; i += KILN_VOXEL_PLANES)
        if (v->plane_of[i] == MANY)
            v->plane_of[i] = KILN_VOXEL_NO_PLANE;
    return status;
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

static int create(struct kiln_voxels **voxels, const struct kiln_geometry *g, uint32_t along, double margin,
                  struct kiln_error *error)
{
    struct kiln_voxels *v = NULL;
    int status = kiln_allocate(&v, 1, sizeof *v, "the voxels", error);
    if (status == KILN_OK) {
        v->margin = margin;
        measure(v, g, along);
        v->cells = (uint64_t)v->n[0] * (uint64_t)v->n[1] * (uint64_t)v->n[2];
        status = kiln_allocate(&v->solid, words_of(v), sizeof *v->solid, "the voxels", error);
    }
    *voxels = v;
    return status;
}

int kiln_voxels_create(struct kiln_voxels **voxels, const struct kiln_geometry *g, uint32_t along,
                       struct kiln_error *error)
{
    const int status = create(voxels, g, along, 1e-6, error);
    for (size_t t = 0; status == KILN_OK && t < g->opaque_count - g->opaque_receivers; t++)
        each_cell(*voxels, g, t, fill, 0);
    if (status == KILN_OK)
        count_filled(*voxels);
    else
        kiln_voxels_destroy(voxels);
    return status;
}

int kiln_voxels_create_filter(struct kiln_voxels **voxels, const struct kiln_geometry *g, uint32_t along,
                              struct kiln_error *error)
{
    int status = create(voxels, g, along, FILTER_MARGIN, error);
    struct kiln_voxels *v = *voxels;
    for (size_t i = 0; status == KILN_OK && i < kiln_geometry_hittable_count(g); i++)
        each_cell(v, g, kiln_geometry_hittable(g, i), fill, 0);
    if (status == KILN_OK)
        status = kiln_allocate(&v->before, words_of(v), sizeof *v->before, "the voxels", error);
    if (status == KILN_OK) {
        count_filled(v);
        status = add_planes(v, g, error);
    }
    if (status != KILN_OK)
        kiln_voxels_destroy(voxels);
    return status;
}

void kiln_voxels_destroy(struct kiln_voxels **voxels)
{
    if (*voxels == NULL)
        return;
    kiln_free(&(*voxels)->solid);
    kiln_free(&(*voxels)->before);
    kiln_free(&(*voxels)->plane_of);
    kiln_free(&(*voxels)->planes);
    kiln_free(voxels);
}

uint64_t kiln_voxels_bytes(uint32_t along) { return (uint64_t)along * along * along / 8 + 8; }

uint64_t kiln_voxels_filter_bytes(uint32_t along, uint64_t triangles)
{
    const uint64_t cells = (uint64_t)along * along * along;
    return 2 * (cells / 8 + 8) + KILN_VOXEL_PLANES * sizeof(uint32_t) * cells +
           2 * triangles * sizeof(struct kiln_voxel_plane);
}

/* ---- lines ---- */

bool kiln_voxels_open(const struct kiln_voxels *v, struct kiln_vec3 from, struct kiln_vec3 from_normal,
                      struct kiln_vec3 to, struct kiln_vec3 to_normal)
{
    return kiln_voxel_lets_see(v, dvec3_of(from), dvec3_of(from_normal), dvec3_of(to), dvec3_of(to_normal));
}

bool kiln_voxels_free(const struct kiln_voxels *v, struct kiln_vec3 from, struct kiln_vec3 to)
{
    return kiln_voxel_is_free(v, dvec3_of(from), dvec3_of(to));
}

_Static_assert(sizeof(struct kiln_voxel_plane) == KILN_VOXEL_PLANE_REALS * sizeof(double), "planes are numbers");

struct kiln_voxel_arrays kiln_voxels_arrays(const struct kiln_voxels *v)
{
    return (struct kiln_voxel_arrays){.low = v->low,
                                      .scale = v->scale,
                                      .n = {v->n[0], v->n[1], v->n[2]},
                                      .words = v->solid,
                                      .before = v->before,
                                      .plane_of = v->plane_of,
                                      .numbers = (const double *)v->planes,
                                      .word_count = words_of(v),
                                      .plane_of_count = v->before != NULL ? KILN_VOXEL_PLANES * v->filled : 0,
                                      .number_count = KILN_VOXEL_PLANE_REALS * v->plane_count,
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

/* Where a ray comes into the grid, and where it goes out; *axis: across which side it comes in, -1: it begins inside.
 * False: it goes by. */
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
