#include "coordinator/plan/working_set.h"

#include <math.h>
#include <string.h>

#include "coordinator/integrate/probes/radiance_grid.h"
#include "coordinator/surface/surface_build.h"
#include "worker/base/memory.h"
#include "worker/scene/footprint.h"

enum { ALONG = 48 }; /* voxels along the scene's longest side */

struct voxels {
    struct kiln_vec3 low;
    float side; /* m */
    uint32_t size[3];
    uint32_t *of_point; /* of each surface point */
    uint8_t *near;      /* per voxel: 1 within the range of a rank's points */
    uint32_t *sums;     /* sums of `near` over all voxels before each one; larger by one on each axis */
};

static uint32_t along(float at, float low, float side, uint32_t size)
{
    const float n = (at - low) / side;
    return !(n > 0.0f) ? 0 : n >= (float)(size - 1) ? size - 1 : (uint32_t)n;
}

static void voxel_of(const struct voxels *v, struct kiln_vec3 at, uint32_t place[3])
{
    place[0] = along(at.x, v->low.x, v->side, v->size[0]);
    place[1] = along(at.y, v->low.y, v->side, v->size[1]);
    place[2] = along(at.z, v->low.z, v->side, v->size[2]);
}

static size_t index_of(const struct voxels *v, const uint32_t place[3])
{
    return ((size_t)place[2] * v->size[1] + place[1]) * v->size[0] + place[0];
}

static void find_points(struct voxels *v, const struct kiln_prepared *p)
{
    const struct kiln_surface *s = p->surface;
#pragma omp parallel for num_threads((int)p->threads) schedule(dynamic, 64)
    for (size_t f = 0; f < s->tile_run_count; f++) {
        struct kiln_point_cursor at = kiln_point_first(s, f);
        for (uint32_t i = 0; i < s->tile_runs[f].count; i++, kiln_point_next(s, &at)) {
            struct kiln_footprint footprint;
            uint32_t triangle, place[3];
            float b1, b2;
            kiln_footprint_prepare(&footprint, p->scene, p->geometry, s, &at);
            kiln_footprint_sample(&footprint, 0.5f, 0.5f, &triangle, &b1, &b2);
            voxel_of(v, kiln_triangle_position(p->geometry, triangle, b1, b2), place);
            v->of_point[at.point.at] = (uint32_t)index_of(v, place);
        }
    }
}

/* Spreads `near` by `reach` voxels along an axis, whose neighbours are `step` apart. */
static void spread(struct voxels *v, int axis, size_t step, uint32_t reach, uint8_t *line)
{
    const size_t count = (size_t)v->size[0] * v->size[1] * v->size[2];
    const uint32_t length = v->size[axis];
    for (size_t first = 0; first < count; first++) {
        if (first / step % length != 0)
            continue;
        for (uint32_t i = 0; i < length; i++)
            line[i] = v->near[first + i * step];
        for (uint32_t i = 0; i < length; i++)
            for (uint32_t k = i > reach ? i - reach : 0; v->near[first + i * step] == 0 && k < length && k <= i + reach;
                 k++)
                v->near[first + i * step] = line[k];
    }
}

/* Marks the voxels within `range` of the points [first, end). */
static void mark(struct voxels *v, uint64_t first, uint64_t end, double range)
{
    uint8_t line[ALONG + 1];
    const uint32_t reach = (uint32_t)fmin(ceil(range / (double)v->side), ALONG);
    memset(v->near, 0, (size_t)v->size[0] * v->size[1] * v->size[2]);
    for (uint64_t i = first; i < end; i++)
        v->near[v->of_point[i]] = 1;
    spread(v, 0, 1, reach, line);
    spread(v, 1, v->size[0], reach, line);
    spread(v, 2, (size_t)v->size[0] * v->size[1], reach, line);
}

/* Sum of `near` over the voxels before (x, y, z) on all axes. */
static uint32_t *sum_at(const struct voxels *v, uint32_t x, uint32_t y, uint32_t z)
{
    return &v->sums[((size_t)z * (v->size[1] + 1) + y) * (v->size[0] + 1) + x];
}

static void add_up(struct voxels *v)
{
    for (uint32_t z = 1; z <= v->size[2]; z++)
        for (uint32_t y = 1; y <= v->size[1]; y++)
            for (uint32_t x = 1, row = 0; x <= v->size[0]; x++) {
                row += v->near[((size_t)(z - 1) * v->size[1] + y - 1) * v->size[0] + x - 1];
                *sum_at(v, x, y, z) =
                    row + *sum_at(v, x, y - 1, z) + *sum_at(v, x, y, z - 1) - *sum_at(v, x, y - 1, z - 1);
            }
}

/* Whether the triangle's box has a voxel that is near. */
static bool is_near(const struct voxels *v, const struct kiln_geometry *g, uint64_t triangle)
{
    struct kiln_vec3 corner[3];
    uint32_t low[3], high[3];
    kiln_geometry_corners(g, triangle, corner);
    voxel_of(v,
             vec3(fminf(corner[0].x, fminf(corner[1].x, corner[2].x)),
                  fminf(corner[0].y, fminf(corner[1].y, corner[2].y)),
                  fminf(corner[0].z, fminf(corner[1].z, corner[2].z))),
             low);
    voxel_of(v,
             vec3(fmaxf(corner[0].x, fmaxf(corner[1].x, corner[2].x)),
                  fmaxf(corner[0].y, fmaxf(corner[1].y, corner[2].y)),
                  fmaxf(corner[0].z, fmaxf(corner[1].z, corner[2].z))),
             high);
    const uint32_t x = high[0] + 1, y = high[1] + 1, z = high[2] + 1;
    const uint32_t count = *sum_at(v, x, y, z) - *sum_at(v, low[0], y, z) - *sum_at(v, x, low[1], z) -
                           *sum_at(v, x, y, low[2]) + *sum_at(v, low[0], low[1], z) + *sum_at(v, low[0], y, low[2]) +
                           *sum_at(v, x, low[1], low[2]) - *sum_at(v, low[0], low[1], low[2]);
    return count > 0;
}

/* ---- ranks ---- */

/* Divides the points into `ranks` ranges, between cells, or with `runs` between tile runs. begins[r]: first point of
 * rank r. *imbalance: excess of the largest range over the mean; INFINITY if there are fewer cells than ranks. */
static int cut(const struct kiln_surface *s, bool runs, uint32_t ranks, uint64_t *begins, double *imbalance,
               struct kiln_error *error)
{
    const size_t count = runs ? s->tile_run_count : s->cell_first != NULL ? (size_t)s->cell_count : 0;
    uint64_t *points = NULL, most = 0;
    *imbalance = INFINITY;
    if (!runs && count < ranks)
        return KILN_OK;
    const int status = kiln_allocate(&points, count, sizeof *points, "the ranks' ranges", error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < count; i++)
        points[i] = runs ? s->tile_runs[i].count : s->cell_first[i + 1] - s->cell_first[i];
    kiln_partition_cut(points, count, ranks, begins);
    for (uint32_t r = 0; r <= ranks; r++) {
        const uint64_t unit = begins[r];
        begins[r] = unit == count ? s->point_count : runs ? s->tile_runs[unit].first.at : s->cell_first[unit];
        most = r > 0 && begins[r] - begins[r - 1] > most ? begins[r] - begins[r - 1] : most;
    }
    *imbalance = (double)most * ranks / (double)s->point_count - 1.0;
    kiln_free(&points);
    return KILN_OK;
}

/* Finds where each rank's points begin, and the end of the last, as the partition of a bake does. */
static int find_begins(const struct kiln_surface *s, uint32_t ranks, uint64_t *begins, struct kiln_error *error)
{
    double imbalance;
    int status = cut(s, false, ranks, begins, &imbalance, error);
    if (status == KILN_OK && !(imbalance <= KILN_PARTITION_IMBALANCE))
        status = cut(s, true, ranks, begins, &imbalance, error);
    return status;
}

static uint64_t probe_bytes(const struct kiln_probe_grid *grid)
{
    return grid->floats * sizeof(float) + sizeof(struct kiln_vec3);
}

/* Probes in voxels that are near. */
static uint64_t count_probes(const struct voxels *v, const struct kiln_probe_grid *grid)
{
    uint64_t near = 0;
    for (uint64_t i = 0; i < kiln_probes_count(grid); i++) {
        uint32_t place[3];
        voxel_of(v, kiln_probe_grid_position(grid, i), place);
        near += v->near[index_of(v, place)];
    }
    return near;
}

/* Working set of a rank with the points [first, end). A ray reads probes at the corners of the cell where it ends: at
 * most one spacing away, or 1.5 outside the grid at the scene's bounds. */
static struct kiln_rank_set rank_set(struct voxels *v, const struct kiln_prepared *p,
                                     const struct kiln_probe_grid *grid, uint64_t first, uint64_t end,
                                     double triangle_bytes)
{
    uint64_t triangles = 0;
    struct kiln_rank_set set = {.own_points = end - first};
    mark(v, first, end, (double)grid->range + 1.5 * (double)grid->spacing);
    set.probes = count_probes(v, grid);
    mark(v, first, end, (double)grid->range);
    add_up(v);
#pragma omp parallel for num_threads((int)p->threads) reduction(+ : triangles)
    for (size_t t = 0; t < p->geometry->triangle_count; t++)
        triangles += is_near(v, p->geometry, t);
    for (uint64_t i = 0; i < p->surface->point_count; i++)
        set.points += v->near[v->of_point[i]];
    set.triangles = triangles;
    set.bytes =
        (uint64_t)(triangle_bytes * (double)triangles) + set.points * sizeof(uint64_t) + set.probes * probe_bytes(grid);
    return set;
}

static void add_rank(struct kiln_working_set *set, const struct kiln_rank_set *rank)
{
    struct kiln_rank_set *most = &set->most;
    most->own_points = rank->own_points > most->own_points ? rank->own_points : most->own_points;
    most->triangles = rank->triangles > most->triangles ? rank->triangles : most->triangles;
    most->points = rank->points > most->points ? rank->points : most->points;
    most->probes = rank->probes > most->probes ? rank->probes : most->probes;
    most->bytes = rank->bytes > most->bytes ? rank->bytes : most->bytes;
    set->triangles_mean += (double)rank->triangles / set->rank_count;
    set->points_mean += (double)rank->points / set->rank_count;
    set->probes_mean += (double)rank->probes / set->rank_count;
    set->bytes_mean += (double)rank->bytes / set->rank_count;
}

static int make_voxels(struct voxels *v, const struct kiln_prepared *p, struct kiln_error *error)
{
    const struct kiln_vec3 low = p->geometry->bounds_min, size = vec3_sub(p->geometry->bounds_max, low);
    const float longest = fmaxf(size.x, fmaxf(size.y, size.z)), extents[3] = {size.x, size.y, size.z};
    const char *what = "the voxels of the working set";
    *v = (struct voxels){.low = low, .side = longest > 0.0f ? longest / ALONG : 1.0f};
    for (int a = 0; a < 3; a++)
        v->size[a] = (uint32_t)fminf(fmaxf(ceilf(extents[a] / v->side), 1.0f), ALONG);
    const size_t count = (size_t)v->size[0] * v->size[1] * v->size[2],
                 sums = ((size_t)v->size[0] + 1) * (v->size[1] + 1) * (v->size[2] + 1);
    int status;
    KILN_TRY(kiln_allocate(&v->near, count, 1, what, error));
    KILN_TRY(kiln_allocate(&v->sums, sums, sizeof *v->sums, what, error));
    KILN_TRY(kiln_allocate(&v->of_point, p->surface->point_count, sizeof *v->of_point, what, error));
end:
    return status;
}

int kiln_working_set_find(struct kiln_working_set *set, const struct kiln_prepared *prepared,
                          const struct kiln_job *job, double triangle_bytes, struct kiln_error *error)
{
    struct voxels v = {.side = 0.0f};
    struct kiln_probe_grid grid;
    uint64_t *begins = NULL;
    *set = (struct kiln_working_set){0};
    if (!kiln_job_has_probes(job))
        return KILN_OK;
    int status;
    KILN_TRY(kiln_probe_grid_make(&grid, &job->light.radiance, prepared->geometry, error));
    KILN_TRY(make_voxels(&v, prepared, error));
    KILN_TRY(kiln_allocate(&begins, (size_t)job->plan.ranks + 1, sizeof *begins, "the ranks' ranges", error));
    KILN_TRY(find_begins(prepared->surface, job->plan.ranks, begins, error));
    KILN_TRY(kiln_allocate(&set->ranks, job->plan.ranks, sizeof *set->ranks, "the ranks' working sets", error));
    set->rank_count = job->plan.ranks;
    set->probes = kiln_probes_count(&grid);
    set->probe_bytes = set->probes * probe_bytes(&grid);
    set->bytes_all = (uint64_t)(triangle_bytes * (double)prepared->geometry->triangle_count) +
                     prepared->surface->point_count * sizeof(uint64_t);
    find_points(&v, prepared);
end:
    for (uint32_t r = 0; r < set->rank_count; r++) {
        set->ranks[r] = rank_set(&v, prepared, &grid, begins[r], begins[r + 1], triangle_bytes);
        add_rank(set, &set->ranks[r]);
    }
    kiln_free(&v.near);
    kiln_free(&v.sums);
    kiln_free(&v.of_point);
    kiln_free(&begins);
    return status;
}

void kiln_working_set_release(struct kiln_working_set *set) { kiln_free(&set->ranks); }
