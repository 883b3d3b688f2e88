#include "coordinator/bake/light/denoised_sample.h"

#include <limits.h>
#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/output/map/denoise/regression.h"
#include "coordinator/output/map/denoise/regression_device.h"
#include "coordinator/output/points.h"

#include "worker/base/memory.h"
#include "worker/sampling/keys.h"
#include "worker/scene/footprint.h"

enum {
    SIDE = 48,      /* of a cube, texels */
    AROUND = 8,     /* texels around a cube whose tile runs are neighbours */
    MOST = 1 << 15, /* points in chosen cubes, about */
    NEAR = 8        /* cubes that a tile run can be in or near */
};
#define LEAST_SIZE 0x1p-20f /* of a texel, relative to its distance from the scene's centre: as in denoise.c */

/* A tile run in or near a chosen cube: the middle of its tile, m from the scene's centre, and its number of points. */
struct entry {
    float middle[3];
    uint32_t count;
};

/* A point of an entry. */
struct record {
    struct kiln_neighbour_point point; /* area 0: it is not valid */
    struct kiln_halves halves;
};

/* An entry as a member of a cube. */
struct member {
    int32_t cube[3];
    uint32_t entry;
};

struct sample {
    const struct kiln_denoised_sample *of;
    const struct kiln_rank_data *own;
    int rank, ranks;
    bool whole;        /* one cube has all points */
    double side;       /* of a cube, m */
    uint32_t chosen;   /* cubes are chosen whose hash is at most this */
    size_t *tile_runs; /* own tile runs that are entries */
    size_t own_entries, own_records;
    struct entry *entries; /* of all ranks, in the global order */
    struct record *records;
    size_t *first;                 /* record of each entry, and the end */
    size_t entry_count, first_own; /* first_own: first entry of this rank */
    struct member *members;        /* sorted by cube */
    size_t member_count;
    struct kiln_regression_device *device;
};

/* ---- cubes ---- */

/* Middle of a tile run's tile, in the plane of the triangle of its first point. */
static void find_middle(const struct sample *s, size_t tile_run, float middle[3])
{
    const struct kiln_surface *surface = &s->own->surface;
    const struct kiln_tile_run *run = &surface->tile_runs[tile_run];
    const struct kiln_lightmap *map = &surface->lightmaps[run->map];
    const uint32_t triangle = surface->pieces[kiln_point_first(surface, tile_run).piece];
    double uv[3][2], b[2] = {1.0 / 3.0, 1.0 / 3.0};
    struct kiln_vec3 p[3];
    kiln_geometry_map_corners(s->of->scene, s->of->geometry, triangle, map->shift, uv);
    kiln_geometry_corners(s->of->geometry, triangle, p);
    const double u[2] = {uv[1][0] - uv[0][0], uv[1][1] - uv[0][1]}, v[2] = {uv[2][0] - uv[0][0], uv[2][1] - uv[0][1]},
                 x = KILN_TILE_SIDE * (run->tile % map->tiles_x + 0.5) - uv[0][0],
                 y = KILN_TILE_SIDE * (run->tile / map->tiles_x + 0.5) - uv[0][1], area = u[0] * v[1] - u[1] * v[0];
    if (fabs(area) > 1e-3) {
        b[0] = (x * v[1] - y * v[0]) / area;
        b[1] = (y * u[0] - x * u[1]) / area;
    }
    const float *c[3] = {&p[0].x, &p[1].x, &p[2].x};
    for (int k = 0; k < 3; k++)
        middle[k] = (float)((double)c[0][k] + b[0] * ((double)c[1][k] - (double)c[0][k]) +
                            b[1] * ((double)c[2][k] - (double)c[0][k]));
}

/* One cube has the scene's centre in its middle. */
static int32_t cube_along(const struct sample *s, double x)
{
    return s->whole ? 0 : (int32_t)fmax(fmin(floor(x / s->side + 0.5), 1e9), -1e9);
}

static bool is_chosen(const struct sample *s, const int32_t cube[3])
{
    return kiln_hash2(kiln_hash2((uint32_t)cube[0], (uint32_t)cube[1]), (uint32_t)cube[2]) <= s->chosen;
}

/* Lists the chosen cubes that a tile run is in or near; returns their number. */
static size_t find_cubes(const struct sample *s, const float middle[3], int32_t cubes[NEAR][3])
{
    const double around = s->side * AROUND / SIDE;
    int32_t low[3], high[3], at[3];
    size_t count = 0;
    for (int k = 0; k < 3; k++) {
        low[k] = cube_along(s, (double)middle[k] - around);
        high[k] = cube_along(s, (double)middle[k] + around);
    }
    for (at[2] = low[2]; at[2] <= high[2]; at[2]++)
        for (at[1] = low[1]; at[1] <= high[1]; at[1]++)
            for (at[0] = low[0]; at[0] <= high[0]; at[0]++)
                if (is_chosen(s, at))
                    memcpy(cubes[count++], at, sizeof at);
    return count;
}

static bool is_in(const struct sample *s, const float middle[3], const int32_t cube[3])
{
    bool in = true;
    for (int k = 0; k < 3; k++)
        in = in && cube_along(s, (double)middle[k]) == cube[k];
    return in;
}

/* ---- entries ---- */

static bool is_candidate(const struct kiln_surface *surface, const struct kiln_tile_run *run)
{
    return kiln_map_is_result(surface, run->map) && kiln_map_part(surface, run->map) == 0;
}

/* Lists own tile runs that are entries; counts their points. */
static int list_own(struct sample *s, struct kiln_error *error)
{
    const struct kiln_surface *surface = &s->own->surface;
    int32_t cubes[NEAR][3];
    float middle[3];
    const int status =
        kiln_allocate(&s->tile_runs, surface->tile_run_count, sizeof *s->tile_runs, "a sample of the surface", error);
    for (size_t i = 0; status == KILN_OK && i < surface->tile_run_count; i++) {
        if (!is_candidate(surface, &surface->tile_runs[i]))
            continue;
        find_middle(s, i, middle);
        if (find_cubes(s, middle, cubes) == 0)
            continue;
        s->tile_runs[s->own_entries++] = i;
        s->own_records += surface->tile_runs[i].count;
    }
    return status;
}

static bool is_usable(const struct kiln_neighbour_point *p)
{
    float square = 0.0f, farthest = 0.0f;
    for (int k = 0; k < 3; k++) {
        square += p->normal[k] * p->normal[k];
        farthest = fmaxf(farthest, fabsf(p->position[k]));
    }
    return p->size > LEAST_SIZE * farthest && isnormal(p->size) && square > 0.5f && square < 2.0f;
}

/* Makes the records of an own tile run. */
static void make_records(const struct sample *s, size_t tile_run, const struct kiln_denoising_calls *calls,
                         struct record *records)
{
    const struct kiln_surface *surface = &s->own->surface;
    const struct kiln_bake_result result = {.scene = s->of->scene, .geometry = s->of->geometry, .surface = surface};
    const uint64_t first = kiln_own_of_global(surface, surface->tile_runs[tile_run].first).at;
    struct kiln_point_detail details[KILN_TILE_TEXELS];
    struct kiln_halves halves[KILN_TILE_TEXELS];
    const uint32_t count = kiln_tile_run_details(&result, tile_run, details);
    calls->give(calls->context, tile_run, halves);
    for (uint32_t i = 0; i < count; i++) {
        struct kiln_neighbour_point *p = &records[i].point;
        const float area = surface->area[first + i], coverage = details[i].coverage;
        records[i].halves = halves[i];
        p->size = coverage > 0.0f ? sqrtf(area / coverage) : 0.0f;
        for (int k = 0; k < 3; k++)
            p->position[k] = (float)(details[i].position[k] - s->of->scene->header->centre[k]);
        memcpy(p->normal, details[i].normal, sizeof p->normal);
        p->area = is_usable(p) && kiln_point_valid(surface, (struct kiln_own_point){first + i}) ? area : 0.0f;
    }
}

/* Collective. Gathers `count` elements of `size` bytes of each rank in the order of ranks. *total: of all; *before: of
 * lower ranks. */
static int gather(const struct sample *s, const void *own, size_t count, size_t size, void *all, size_t *total,
                  size_t *before, struct kiln_error *error)
{
    const int bytes = count * size < INT_MAX ? (int)(count * size) : -1;
    int *counts = NULL, *starts = NULL, status = KILN_OK;
    uint64_t sum = 0;
    KILN_TRY(kiln_allocate(&counts, (size_t)s->ranks, sizeof *counts, "a sample of the surface", error));
    KILN_TRY(kiln_allocate(&starts, (size_t)s->ranks, sizeof *starts, "a sample of the surface", error));
end:
    status = kiln_agree(s->of->communicator, status, error);
    if (status == KILN_OK)
        (void)MPI_Allgather(&bytes, 1, MPI_INT, counts, 1, MPI_INT, s->of->communicator);
    for (int r = 0; status == KILN_OK && r < s->ranks; r++) {
        starts[r] = (int)sum;
        sum += (uint64_t)(counts[r] < 0 ? INT_MAX : counts[r]);
        if (counts[r] < 0 || sum > INT_MAX)
            status = kiln_fail(error, KILN_SYSTEM,
                               "a sample of the surface has more than 2 GiB; give --denoise none, or --samples-direct, "
                               "which asks for no error");
    }
    if (status == KILN_OK)
        status = kiln_allocate_bare((void **)all, sum / size, size, "a sample of the surface", error);
    if ((status = kiln_agree(s->of->communicator, status, error)) == KILN_OK) {
        (void)MPI_Allgatherv(own, bytes, MPI_BYTE, *(void **)all, counts, starts, MPI_BYTE, s->of->communicator);
        *total = sum / size;
        *before = (size_t)starts[s->rank] / size;
    }
    kiln_free(&counts);
    kiln_free(&starts);
    return status;
}

/* Collective. All entries and records on all ranks. */
static int gather_all(struct sample *s, const struct kiln_denoising_calls *calls, struct kiln_error *error)
{
    struct entry *entries = NULL;
    struct record *records = NULL;
    size_t at = 0, total, before;
    int status;
    KILN_TRY(kiln_allocate(&entries, s->own_entries, sizeof *entries, "a sample of the surface", error));
    KILN_TRY(kiln_allocate(&records, s->own_records, sizeof *records, "a sample of the surface", error));
    for (size_t e = 0; e < s->own_entries; e++) {
        find_middle(s, s->tile_runs[e], entries[e].middle);
        entries[e].count = s->own->surface.tile_runs[s->tile_runs[e]].count;
        make_records(s, s->tile_runs[e], calls, records + at);
        at += entries[e].count;
    }
end:
    status = kiln_agree(s->of->communicator, status, error);
    if (status == KILN_OK)
        status =
            gather(s, entries, s->own_entries, sizeof *entries, &s->entries, &s->entry_count, &s->first_own, error);
    if (status == KILN_OK)
        status = gather(s, records, s->own_records, sizeof *records, &s->records, &total, &before, error);
    kiln_free(&entries);
    kiln_free(&records);
    return status;
}

/* ---- members of cubes ---- */

static int compare_members(const void *a, const void *b)
{
    const struct member *p = a, *q = b;
    for (int k = 0; k < 3; k++)
        if (p->cube[k] != q->cube[k])
            return p->cube[k] < q->cube[k] ? -1 : 1;
    return (p->entry > q->entry) - (p->entry < q->entry);
}

static int list_members(struct sample *s, struct kiln_error *error)
{
    int32_t cubes[NEAR][3];
    size_t room = 0;
    int status;
    KILN_TRY(kiln_allocate(&s->first, s->entry_count + 1, sizeof *s->first, "a sample of the surface", error));
    for (size_t e = 0; e < s->entry_count; e++) {
        s->first[e + 1] = s->first[e] + s->entries[e].count;
        const size_t count = find_cubes(s, s->entries[e].middle, cubes);
        KILN_TRY(kiln_grow(&s->members, &room, s->member_count + count, sizeof *s->members, "a sample of the surface",
                           error));
        for (size_t c = 0; c < count; c++) {
            struct member *m = &s->members[s->member_count++];
            memcpy(m->cube, cubes[c], sizeof m->cube);
            m->entry = (uint32_t)e;
        }
    }
    if (s->member_count > 1)
        qsort(s->members, s->member_count, sizeof *s->members, compare_members);
end:
    return status;
}

/* ---- one cube ---- */

/* The planes of a cube's points: light and variance of both halves. */
struct planes {
    float *of[2 * KILN_HALVES];
};

static size_t count_points(const struct sample *s, const struct member *members, size_t count)
{
    size_t points = 0;
    for (size_t m = 0; m < count; m++)
        points += s->entries[members[m].entry].count;
    return points;
}

/* Lists the valid points of a cube's members; returns their number. Indices count all points. `far`: of each, 1 if it
 * is not in the cube. */
static size_t take_points(const struct sample *s, const struct member *members, size_t count,
                          struct kiln_neighbour_point *points, const struct planes *planes, uint8_t *far)
{
    uint32_t index = 0;
    size_t valid = 0;
    for (size_t m = 0; m < count; m++) {
        const bool in = is_in(s, s->entries[members[m].entry].middle, members[m].cube);
        for (size_t r = s->first[members[m].entry]; r < s->first[members[m].entry + 1]; r++, index++) {
            far[index] = !in;
            if (!(s->records[r].point.area > 0.0f))
                continue;
            points[valid] = s->records[r].point;
            points[valid].order = points[valid].index = index;
            valid++;
            for (int h = 0; h < KILN_HALVES; h++) {
                planes->of[2 * h][index] = s->records[r].halves.light[h];
                planes->of[2 * h + 1][index] = s->records[r].halves.variance;
            }
        }
    }
    return valid;
}

/* Lets all points of a cell be as far as its nearest one. */
static void level_cells(const struct kiln_neighbour_grid *grid, uint8_t *far)
{
    for (size_t c = 0; c < grid->cell_count; c++) {
        uint8_t least = UINT8_MAX;
        for (uint32_t i = grid->first[c]; i < grid->first[c + 1]; i++)
            least = far[grid->points[i].index] < least ? far[grid->points[i].index] : least;
        for (uint32_t i = grid->first[c]; i < grid->first[c + 1]; i++)
            far[grid->points[i].index] = least;
    }
}

/* Denoises both halves; the last sweep leaves out the points around the cube. */
static int denoise_points(const struct sample *s, struct kiln_neighbour_point **points, size_t count,
                          const struct planes *planes, uint8_t *far, struct kiln_error *error)
{
    const struct kiln_regression_subdomain part = {.own = UINT32_MAX, .far = far};
    struct kiln_regression_light lights[KILN_HALVES] = {{.variance = NULL}};
    struct kiln_neighbour_grid *grid = NULL;
    for (int h = 0; h < KILN_HALVES; h++)
        lights[h] = (struct kiln_regression_light){.rgb = {planes->of[2 * h], planes->of[2 * h], planes->of[2 * h]},
                                                   .variance = planes->of[2 * h + 1]};
    int status = kiln_neighbour_grid_create(&grid, points, count, error);
    if (status == KILN_OK) {
        level_cells(grid, far);
        status = kiln_regression_run(grid, lights, KILN_HALVES, &part, s->device, error);
    }
    kiln_neighbour_grid_destroy(&grid);
    return status;
}

/* Writes the denoised light of the tile runs in the cube to `results`, by record. */
static void give_points(const struct sample *s, const struct member *members, size_t count, const struct planes *planes,
                        float (*results)[KILN_HALVES])
{
    size_t index = 0;
    for (size_t m = 0; m < count; m++) {
        const struct entry *entry = &s->entries[members[m].entry];
        if (is_in(s, entry->middle, members[m].cube))
            for (uint32_t i = 0; i < entry->count; i++)
                for (int h = 0; h < KILN_HALVES; h++)
                    results[s->first[members[m].entry] + i][h] = planes->of[2 * h][index + i];
        index += entry->count;
    }
}

static int denoise_cube(const struct sample *s, const struct member *members, size_t count,
                        float (*results)[KILN_HALVES], struct kiln_error *error)
{
    const size_t room = count_points(s, members, count);
    struct kiln_neighbour_point *points = NULL;
    struct planes planes = {{NULL}};
    uint8_t *far = NULL;
    int status;
    KILN_TRY(kiln_allocate(&points, room, sizeof *points, "a sample of the surface", error));
    KILN_TRY(kiln_allocate(&far, room, sizeof *far, "a sample of the surface", error));
    for (int p = 0; p < 2 * KILN_HALVES; p++)
        KILN_TRY(kiln_allocate(&planes.of[p], room, sizeof(float), "a sample of the surface", error));
    const size_t valid = take_points(s, members, count, points, &planes, far);
    if (valid > 0)
        KILN_TRY(denoise_points(s, &points, valid, &planes, far, error));
    give_points(s, members, count, &planes, results);
end:
    for (int p = 0; p < 2 * KILN_HALVES; p++)
        kiln_free(&planes.of[p]);
    kiln_free(&far);
    kiln_free(&points);
    return status;
}

/* ---- all cubes ---- */

/* Lists where each cube's members begin, and the end. */
static int list_cubes(const struct sample *s, size_t **cubes, size_t *count, struct kiln_error *error)
{
    const int status = kiln_allocate(cubes, s->member_count + 1, sizeof **cubes, "a sample of the surface", error);
    *count = 0;
    for (size_t m = 0; status == KILN_OK && m < s->member_count; m++)
        if (m == 0 || memcmp(s->members[m].cube, s->members[m - 1].cube, sizeof s->members[m].cube) != 0)
            (*cubes)[(*count)++] = m;
    if (status == KILN_OK)
        (*cubes)[*count] = s->member_count;
    return status;
}

/* Denoises this rank's cubes: each by one thread, or by all threads where there are fewer cubes than threads. */
static int denoise_cubes(const struct sample *s, float (*results)[KILN_HALVES], struct kiln_error *error)
{
    size_t *cubes = NULL, count = 0;
    int status = list_cubes(s, &cubes, &count, error);
    const bool at_once = status == KILN_OK && count / (size_t)s->ranks >= (size_t)omp_get_max_threads();
#pragma omp parallel for schedule(dynamic, 1) if (at_once)
    for (size_t c = 0; c < count; c++) {
        struct kiln_error mine = {{0}};
        if (c % (size_t)s->ranks != (size_t)s->rank)
            continue;
        const int done = denoise_cube(s, s->members + cubes[c], cubes[c + 1] - cubes[c], results, &mine);
        if (done != KILN_OK)
#pragma omp critical(kiln_denoised_sample)
            status = kiln_fail(error, done, "%s", mine.message);
    }
    kiln_free(&cubes);
    return status;
}

/* Calls `take` for own tile runs in chosen cubes. */
static void take_own(const struct sample *s, float (*results)[KILN_HALVES], const struct kiln_denoising_calls *calls)
{
    for (size_t e = 0; e < s->own_entries; e++) {
        const struct entry *entry = &s->entries[s->first_own + e];
        int32_t cube[3];
        for (int k = 0; k < 3; k++)
            cube[k] = cube_along(s, (double)entry->middle[k]);
        if (!is_chosen(s, cube))
            continue;
        struct kiln_halves halves[KILN_TILE_TEXELS];
        for (uint32_t i = 0; i < entry->count; i++)
            memcpy(halves[i].light, results[s->first[s->first_own + e] + i], sizeof halves[i].light);
        calls->take(calls->context, s->tile_runs[e], halves);
    }
}

static int begin(struct sample *s, struct kiln_error *error)
{
    const double points = fmax((double)s->own->surface.point_count, 1.0), texel = sqrt(s->of->area / points);
    struct kiln_backend_info info = {.regresses = false};
    (void)MPI_Comm_rank(s->of->communicator, &s->rank);
    (void)MPI_Comm_size(s->of->communicator, &s->ranks);
    s->whole = points <= MOST;
    s->side = texel > 0.0 ? SIDE * texel : 1.0;
    s->chosen = s->whole ? UINT32_MAX : (uint32_t)(MOST / points * 0x1p32);
    kiln_backend_info(s->of->backend, &info);
    return info.regresses ? kiln_regression_device_create(&s->device, s->of->backend, error) : KILN_OK;
}

int kiln_denoised_sample_run(void *context, const struct kiln_rank_data *own, const struct kiln_denoising_calls *calls,
                             struct kiln_error *error)
{
    struct sample s = {.of = context, .own = own};
    float(*results)[KILN_HALVES] = NULL;
    int status = begin(&s, error);
    if (status == KILN_OK)
        status = list_own(&s, error);
    KILN_TRY(kiln_agree(s.of->communicator, status, error));
    KILN_TRY(gather_all(&s, calls, error));
    status = list_members(&s, error);
    if (status == KILN_OK)
        status = kiln_allocate(&results, s.first[s.entry_count], sizeof *results, "a sample of the surface", error);
    if (status == KILN_OK)
        status = denoise_cubes(&s, results, error);
    KILN_TRY(kiln_agree(s.of->communicator, status, error));
    /* each number is written by one rank, and 0 on the others */
    (void)MPI_Allreduce(MPI_IN_PLACE, results, (int)(KILN_HALVES * s.first[s.entry_count]), MPI_UINT32_T, MPI_BOR,
                        s.of->communicator);
    take_own(&s, results, calls);
end:
    kiln_regression_device_destroy(&s.device);
    kiln_free(&results);
    kiln_free(&s.tile_runs);
    kiln_free(&s.entries);
    kiln_free(&s.records);
    kiln_free(&s.first);
    kiln_free(&s.members);
    return status;
}
