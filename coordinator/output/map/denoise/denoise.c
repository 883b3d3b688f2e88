#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "coordinator/field/group_fields.h"
#include "coordinator/output/image.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/denoise/denoise_parts.h"
#include "coordinator/output/map/denoise/regression.h"
#include "coordinator/output/map/denoise/regression_device.h"
#include "coordinator/output/map/bands/slices.h"
#include "coordinator/output/map/stage.h"
#include "coordinator/output/map/texel_record.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

/* Least texel size, relative to the distance from the scene's centre: positions of smaller texels coincide in float. */
static const float least_size = 0x1p-20f;

/* Least number of points in a map for denoising it on a device. */
static const uint64_t device_least = 1 << 12;

static bool wanted(const struct kiln_output_params *params) { return params->denoise; }

static double seconds_now(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Whether a point has a usable size and normal. Otherwise it keeps its value and is no neighbour of others. */
static bool is_usable(const struct kiln_neighbour_point *point)
{
    float square = 0.0f, farthest = 0.0f;
    for (uint32_t c = 0; c < 3; c++) {
        square += point->normal[c] * point->normal[c];
        farthest = fmaxf(farthest, fabsf(point->position[c]));
    }
    return point->size > least_size * farthest && isnormal(point->size) && isfinite(point->area) && square > 0.5f &&
           square < 2.0f;
}

static float size_of(float area, float coverage) { return coverage > 0.0f ? sqrtf(area / coverage) : 0.0f; }

/* Number of texels that the map has on this rank. Arrays of values begin with these; values of ghosts follow. */
static size_t own_texels(const struct kiln_map_work *work)
{
    return kiln_map_end(work->map) - kiln_map_first(work->map);
}

static float *own_plane(const struct kiln_map_work *work, uint32_t plane)
{
    return work->map->planes[plane] + kiln_map_first(work->map);
}

/* The point of a gathered texel. */
static bool make_point(const struct kiln_map_work *work, size_t texel, struct kiln_neighbour_point *point)
{
    const struct kiln_map *map = work->map;
    *point = (struct kiln_neighbour_point){.area = map->area[texel],
                                           .size = size_of(map->area[texel], map->coverage[texel]),
                                           .order = (uint32_t)texel,
                                           .index = (uint32_t)(texel - kiln_map_first(map))};
    for (uint32_t c = 0; c < 3; c++) {
        point->position[c] = map->planes[work->layers->position + c][texel];
        point->normal[c] = map->planes[work->layers->normal + c][texel];
    }
    return is_usable(point);
}

static const struct kiln_texel_record *ghost_at(const struct kiln_map_work *work, size_t i)
{
    return (const void *)(work->ghosts.records + i * work->ghosts.size);
}

/* Makes the point of the i-th ghost; ghosts come after all texels. */
static bool make_ghost(const struct kiln_map_work *work, size_t i, struct kiln_neighbour_point *point)
{
    const struct kiln_texel_record *record = ghost_at(work, i);
    *point = (struct kiln_neighbour_point){.area = record->area,
                                           .size = size_of(record->area, record->coverage),
                                           .order = (uint32_t)(kiln_map_texels(work->map) + i),
                                           .index = (uint32_t)(own_texels(work) + i)};
    for (uint32_t c = 0; c < 3; c++) {
        point->position[c] = record->values[work->layers->position + c];
        point->normal[c] = record->values[work->layers->normal + c];
    }
    return is_usable(point);
}

static int compare_ghosts(const void *a, const void *b)
{
    const struct kiln_texel_record *p = a, *q = b;
    if (p->from != q->from)
        return p->from < q->from ? -1 : 1;
    if (p->y != q->y)
        return p->y < q->y ? -1 : 1;
    return (p->x > q->x) - (p->x < q->x);
}

/* Counts the gathered texels of each slice of the map; with `points`, only those with a usable point. */
static void count_slices(const struct kiln_map_work *work, bool points, int slices, size_t *counts)
{
#pragma omp parallel for num_threads(slices) schedule(static)
    for (int t = 0; t < slices; t++) {
        size_t begin, end, count = 0;
        struct kiln_neighbour_point point;
        kiln_slice(slices, t, own_texels(work), &begin, &end);
        for (size_t i = begin + kiln_map_first(work->map); i < end + kiln_map_first(work->map); i++)
            count += work->map->state[i] == KILN_TEXEL_VALID && (!points || make_point(work, i, &point));
        counts[t] = count;
    }
}

/* Replaces counts by their sums before each slice. Returns the sum of all. */
static size_t add_slices(int slices, size_t *counts)
{
    size_t sum = 0;
    for (int t = 0; t < slices; t++) {
        const size_t here = counts[t];
        counts[t] = sum;
        sum += here;
    }
    return sum;
}

/* Lists the points of the map's texels; each slice writes from its own beginning on. */
static void list_points(const struct kiln_map_work *work, int slices, const size_t *first,
                        struct kiln_neighbour_point *points)
{
#pragma omp parallel for num_threads(slices) schedule(static)
    for (int t = 0; t < slices; t++) {
        size_t begin, end, at = first[t];
        struct kiln_neighbour_point point;
        kiln_slice(slices, t, own_texels(work), &begin, &end);
        for (size_t i = begin + kiln_map_first(work->map); i < end + kiln_map_first(work->map); i++)
            if (work->map->state[i] == KILN_TEXEL_VALID && make_point(work, i, &point))
                points[at++] = point;
    }
}

/* Collective if the map is in bands. Lists the points of gathered texels and, if any rank has such texels, the ghosts,
 * sorted so that their order does not depend on how they arrived. */
static int collect_points(struct kiln_map_work *work, struct kiln_neighbour_point **points, size_t *count,
                          struct kiln_error *error)
{
    const size_t texels = kiln_map_texels(work->map), ghosts = work->ghosts.count;
    const int slices = kiln_slices(own_texels(work));
    size_t *counts = NULL;
    uint64_t anywhere = 0;
    *count = 0;
    int status;
    KILN_TRY(kiln_allocate(&counts, (size_t)slices, sizeof *counts, "the points of a lightmap", error));
    if (texels + ghosts >= UINT32_MAX)
        KILN_TRY(
            kiln_fail(error, KILN_CANNOT_CREATE,
                      "a lightmap of %u x %u texels with %zu beside it is too large to denoise; use --denoise none",
                      work->map->width, work->map->height, ghosts));
    count_slices(work, false, slices, counts);
    anywhere = add_slices(slices, counts);
    count_slices(work, true, slices, counts);
    *count = add_slices(slices, counts);
    KILN_TRY(kiln_allocate_bare(points, *count + ghosts, sizeof **points, "the points of a lightmap", error));
    list_points(work, slices, counts, *points);
end:
    kiln_free(&counts);
    if ((status = kiln_bands_agree(work->map, status, error)) == KILN_OK)
        status = kiln_bands_count(work->map, &anywhere, 1, error);
    if (status == KILN_OK && ghosts > 0)
        qsort(work->ghosts.records, ghosts, work->ghosts.size, compare_ghosts);
    for (size_t i = 0; status == KILN_OK && anywhere > 0 && i < ghosts; i++)
        *count += make_ghost(work, i, *points + *count);
    return status;
}

/* ---- light of groups ---- */

/* Light of groups (field/group_fields.h), six planes per group: three of direct light, three of the rest (indirect). */
struct group_light {
    size_t count, planes; /* planes: 6 of each group, direct light first */
    float **copies;       /* NULL: there are no ghosts */
    float *(*direct)[3], *(*indirect)[3];
    struct kiln_arena arena;
};

/* The plane of the first group's direct light; KILN_MAP_PLANES_MAX: there are no groups. */
static uint32_t group_plane(const struct kiln_map_work *work, size_t first)
{
    return first < work->result->fields->count ? kiln_layers_plane(work->layers, first) : KILN_MAP_PLANES_MAX;
}

/* Subtracts each group's direct light from its total light, or adds it again, by `sign`. */
static void part_groups(const struct group_light *g, size_t count, float sign)
{
    for (size_t k = 0; k < 3 * g->count; k++) {
        const float *direct = g->direct[k / 3][k % 3];
        float *rest = g->indirect[k / 3][k % 3];
#pragma omp parallel for schedule(static) if (count > KILN_IMAGE_ALONE)
        for (size_t i = 0; i < count; i++)
            rest[i] += sign * direct[i];
    }
}

static void copy_values(float *to, const float *from, size_t count)
{
#pragma omp parallel for schedule(static) if (count > KILN_IMAGE_ALONE)
    for (size_t i = 0; i < count; i++)
        to[i] = from[i];
}

static int copy_plane(const struct kiln_map_work *work, uint32_t plane, float **copy, struct kiln_error *error)
{
    const size_t texels = own_texels(work), ghosts = work->ghosts.count;
    const int status = kiln_allocate_bare(copy, texels + ghosts, sizeof **copy, "the values of a lightmap", error);
    if (status == KILN_OK)
        copy_values(*copy, own_plane(work, plane), texels);
    for (size_t i = 0; status == KILN_OK && i < ghosts; i++)
        (*copy)[texels + i] = ghost_at(work, i)->values[plane];
    return status;
}

static int take_groups(struct group_light *g, const struct kiln_map_work *work, struct kiln_error *error)
{
    const struct kiln_field_set *fields = work->result->fields;
    const size_t first = kiln_group_fields_first(fields), texels = own_texels(work);
    const uint32_t plane = group_plane(work, first);
    if (plane == KILN_MAP_PLANES_MAX)
        return KILN_OK;
    g->count = (fields->count - first) / KILN_GROUP_FIELDS;
    g->planes = 6 * g->count;
    int status = kiln_arena_allocate(&g->arena, &g->direct, g->count, sizeof *g->direct, "the light of groups", error);
    if (status == KILN_OK)
        status =
            kiln_arena_allocate(&g->arena, &g->indirect, g->count, sizeof *g->indirect, "the light of groups", error);
    if (status == KILN_OK && work->ghosts.count > 0)
        status = kiln_arena_allocate(&g->arena, &g->copies, g->planes, sizeof *g->copies, "the light of groups", error);
    for (size_t p = 0; p < g->planes && status == KILN_OK; p++) {
        if (g->copies != NULL)
            status = copy_plane(work, plane + (uint32_t)p, &g->copies[p], error);
        (p % 6 < 3 ? g->direct : g->indirect)[p / 6][p % 3] =
            g->copies != NULL ? g->copies[p] : own_plane(work, plane + (uint32_t)p);
    }
    if (status == KILN_OK)
        part_groups(g, texels + work->ghosts.count, -1.0f);
    return status;
}

static void give_groups(const struct group_light *g, const struct kiln_map_work *work)
{
    const size_t texels = own_texels(work);
    const uint32_t plane = group_plane(work, kiln_group_fields_first(work->result->fields));
    part_groups(g, texels, 1.0f);
    for (size_t p = 0; p < g->planes && g->copies != NULL; p++)
        copy_values(own_plane(work, plane + (uint32_t)p), g->copies[p], texels);
}

static void drop_groups(struct group_light *g)
{
    for (size_t p = 0; p < g->planes && g->copies != NULL; p++)
        kiln_free(&g->copies[p]);
    kiln_arena_release(&g->arena);
}

/* ---- light ---- */

enum { LIGHT_PLANES = 8 };

/* The planes of direct and of indirect light, each with that of its error. */
static void find_planes(const struct kiln_map_work *work, uint32_t planes[LIGHT_PLANES])
{
    static const uint32_t first[] = {KILN_MAP_DIRECT, KILN_MAP_INDIRECT};
    for (uint32_t l = 0; l < 2; l++) {
        for (uint32_t c = 0; c < 3; c++)
            planes[4 * l + c] = first[l] + c;
        planes[4 * l + 3] = work->reads[l];
    }
}

/* Values to denoise: the map's planes, or copies to which the values of the ghosts are appended. */
struct values {
    uint32_t planes[LIGHT_PLANES];
    float *copies[LIGHT_PLANES]; /* NULL: there are no ghosts */
    struct kiln_regression_light lights[2];
};

static int take_values(struct values *v, const struct kiln_map_work *work, struct kiln_error *error)
{
    float *at[LIGHT_PLANES];
    int status = KILN_OK;
    find_planes(work, v->planes);
    for (uint32_t p = 0; p < LIGHT_PLANES && status == KILN_OK; p++) {
        if (work->ghosts.count > 0)
            status = copy_plane(work, v->planes[p], &v->copies[p], error);
        at[p] = work->ghosts.count > 0 ? v->copies[p] : own_plane(work, v->planes[p]);
    }
    for (uint32_t l = 0; status == KILN_OK && l < 2; l++)
        v->lights[l] =
            (struct kiln_regression_light){.rgb = {at[4 * l], at[4 * l + 1], at[4 * l + 2]}, .variance = at[4 * l + 3]};
    return status;
}

/* Puts what was denoised into the map, unless it is there. */
static void give_values(const struct values *v, const struct kiln_map_work *work)
{
    for (uint32_t p = 0; p < LIGHT_PLANES; p++)
        if (v->copies[p] != NULL)
            copy_values(own_plane(work, v->planes[p]), v->copies[p], own_texels(work));
}

static void drop_values(struct values *v)
{
    for (uint32_t p = 0; p < LIGHT_PLANES; p++)
        kiln_free(&v->copies[p]);
}

static void square_plane(float *values, size_t count)
{
#pragma omp parallel for schedule(static) if (count > KILN_IMAGE_ALONE)
    for (size_t i = 0; i < count; i++)
        values[i] *= values[i];
}

/* Limits the variance of direct light. Where samples stratify smooth light well, the variance estimated from the rays
 * of a point is much too large. In a bake in parts the limit is twice the variance that the parts give for all light;
 * twice, since the parts are few values. */
static void limit_variance(const struct kiln_map_work *work, float *variance, size_t count)
{
    const size_t texels = own_texels(work);
#pragma omp parallel for schedule(static) if (count > KILN_IMAGE_ALONE)
    for (size_t i = 0; i < count; i++) {
        const float error =
            i < texels ? own_plane(work, KILN_MAP_ERROR)[i] : ghost_at(work, i - texels)->values[KILN_MAP_ERROR];
        variance[i] = fminf(variance[i], 2.0f * error * error);
    }
}

/* Sets the error of each point's total light: direct, indirect and caustic. Caustics are not denoised, since neighbours
 * do not know their edges. The squared error is the sum of the remaining noise, the bias, and the part `shared` of the
 * old squared error, which neighbours have in common and regression cannot remove. `caustic`: standard error of
 * caustics; NULL: there are none. The result may exceed the old error, which at some points is too low by chance. An
 * error whose square is not finite stays. */
static void state_error(const struct kiln_neighbour_point *points, size_t count,
                        const struct kiln_regression_light lights[2], const float *caustic, float shared, float *error,
                        size_t texels)
{
#pragma omp parallel for schedule(static) if (count > KILN_IMAGE_ALONE)
    for (size_t i = 0; i < count; i++) {
        const uint32_t at = points[i].index;
        float square =
            at < texels ? lights[0].variance[at] + lights[1].variance[at] + shared * error[at] * error[at] : INFINITY;
        if (at < texels && caustic != NULL)
            square += caustic[at] * caustic[at];
        if (isfinite(square))
            error[at] = sqrtf(square);
    }
}

/* ---- the regression ---- */

/* The device to denoise on, which pays off for maps of many points. `points` counts those of all ranks, so that results
 * do not depend on how a map is divided. */
static struct kiln_regression_device *device_for(const struct kiln_map_work *work, uint64_t points)
{
    return points >= device_least ? work->device : NULL;
}

static size_t light_count(const struct kiln_map_work *work) { return work->params->denoise_direct ? 1 : 2; }

/* Denoises all points of a map that is not in bands. `points` are in another order then. */
static int run_whole(struct kiln_map_work *work, struct kiln_neighbour_point **points, size_t count,
                     struct kiln_regression_light lights[2], struct kiln_error *error)
{
    struct kiln_neighbour_grid *grid = NULL;
    int status;
    KILN_TRY(kiln_neighbour_grid_create(&grid, points, count, error));
    KILN_TRY(kiln_regression_run(grid, lights, light_count(work), NULL, device_for(work, count), error));
    *points = grid->points;
    grid->points = NULL;
end:
    kiln_neighbour_grid_destroy(&grid);
    return status;
}

/* ---- bands ---- */

static int agree(void *context, int status, struct kiln_error *error)
{
    return kiln_bands_agree(context, status, error);
}

static int find_most(void *context, double *numbers, size_t count, struct kiln_error *error)
{
    return kiln_bands_most(context, numbers, count, error);
}

static int sum_up(void *context, uint64_t *numbers, size_t count, struct kiln_error *error)
{
    return kiln_bands_count(context, numbers, count, error);
}

/* Makes a sort key for each point; keys do not depend on which rank has the point. */
static int make_keys(const struct kiln_map_work *work, const struct kiln_neighbour_point *points, size_t count,
                     uint64_t **keys, struct kiln_error *error)
{
    const int status = kiln_allocate_bare(keys, count, sizeof **keys, "the points of a lightmap", error);
#pragma omp parallel for schedule(static) if (status == KILN_OK && count > KILN_IMAGE_ALONE)
    for (size_t i = 0; i < (status == KILN_OK ? count : 0); i++) {
        const size_t texels = own_texels(work);
        (*keys)[i] = points[i].order;
        if (points[i].index < texels)
            continue;
        const struct kiln_texel_record *record = ghost_at(work, points[i].index - texels);
        (*keys)[i] = (record->from + 1ull) << 32 |
                     (record->y * (uint64_t)work->result->surface->lightmaps[record->from].width + record->x);
    }
    return status;
}

/* The planes of all light: of direct and of indirect light, each with its variance, and those of groups. */
static int list_values(const struct kiln_regression_light lights[2], float ***values, size_t *planes,
                       struct kiln_error *error)
{
    const size_t groups = lights[0].other_count;
    *planes = LIGHT_PLANES + 6 * groups;
    const int status = kiln_allocate(values, *planes, sizeof **values, "the values of a lightmap", error);
    for (size_t l = 0; l < 2 && status == KILN_OK; l++) {
        for (size_t c = 0; c < 3; c++)
            (*values)[4 * l + c] = lights[l].rgb[c];
        (*values)[4 * l + 3] = lights[l].variance;
        for (size_t k = 0; k < 3 * groups; k++)
            (*values)[LIGHT_PLANES + 3 * groups * l + k] = lights[l].others[k / 3][k % 3];
    }
    return status;
}

/* The same light in other planes. */
static int take_planes(struct kiln_regression_light lights[2], float *const *values, size_t groups,
                       struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t l = 0; l < 2 && status == KILN_OK; l++) {
        lights[l] = (struct kiln_regression_light){.variance = values[4 * l + 3], .other_count = groups};
        memcpy(lights[l].rgb, values + 4 * l, sizeof lights[l].rgb);
        status = kiln_allocate(&lights[l].others, groups, sizeof *lights[l].others, "the light of groups", error);
        for (size_t k = 0; k < 3 * groups && status == KILN_OK; k++)
            lights[l].others[k / 3][k % 3] = values[LIGHT_PLANES + 3 * groups * l + k];
    }
    return status;
}

/* Denoises this rank's subdomain. */
static int run_part(struct kiln_map_work *work, struct kiln_subdomain *parts, uint64_t total,
                    struct kiln_regression_light lights[2], struct kiln_error *error)
{
    const struct kiln_regression_subdomain part = {.own = (uint32_t)parts->own,
                                                   .far = parts->far,
                                                   .agree = agree,
                                                   .most = find_most,
                                                   .sum = sum_up,
                                                   .context = work->map};
    struct kiln_regression_light inner[2] = {{.variance = NULL}};
    struct kiln_neighbour_grid *grid = NULL;
    int status = take_planes(inner, parts->values, lights[0].other_count, error);
    if (status == KILN_OK && parts->count > 0)
        status = kiln_neighbour_grid_create(&grid, &parts->points, parts->count, error);
    if ((status = kiln_bands_agree(work->map, status, error)) == KILN_OK)
        status = kiln_regression_run(grid, inner, light_count(work), &part, device_for(work, total), error);
    kiln_neighbour_grid_destroy(&grid);
    for (int l = 0; l < 2; l++) {
        lights[l].before = inner[l].before;
        lights[l].after = inner[l].after;
        kiln_free(&inner[l].others);
    }
    return status;
}

/* Collective. Denoises a lightmap in bands of rows. Its points are divided anew: each rank denoises those in one part
 * of space and sends them back (denoise_parts.h). `total`: points of all ranks. */
static int run_in_parts(struct kiln_map_work *work, const struct kiln_neighbour_point *points, size_t count,
                        uint64_t total, struct kiln_regression_light lights[2], struct kiln_error *error)
{
    struct kiln_subdomain *parts = NULL;
    float **values = NULL;
    uint64_t *keys = NULL;
    size_t planes = 0;
    int status = make_keys(work, points, count, &keys, error);
    if (status == KILN_OK)
        status = list_values(lights, &values, &planes, error);
    const struct kiln_subdomain_given given = {
        .map = work->map, .points = points, .keys = keys, .count = count, .planes = planes, .values = values};
    if ((status = kiln_bands_agree(work->map, status, error)) == KILN_OK)
        status = kiln_subdomain_create(&parts, &given, error);
    if (status == KILN_OK)
        status = run_part(work, parts, total, lights, error);
    if (status == KILN_OK)
        status = kiln_subdomain_give_back(parts, &given, error);
    kiln_subdomain_destroy(&parts);
    kiln_free(&values);
    kiln_free(&keys);
    return status;
}

/* ---- all of it ---- */

static int denoise(struct kiln_map_work *work, struct kiln_neighbour_point **points, size_t count, uint64_t total,
                   struct kiln_error *error)
{
    const size_t texels = own_texels(work);
    const uint32_t caustic = work->reads[KILN_MAP_IF_ANY];
    struct values v = {.copies = {NULL}};
    struct group_light groups = {0};
    int status = take_values(&v, work, error);
    if (status == KILN_OK)
        status = take_groups(&groups, work, error);
    if ((status = kiln_bands_agree(work->map, status, error)) == KILN_OK) {
        v.lights[0].others = groups.direct;
        v.lights[1].others = groups.indirect;
        v.lights[0].other_count = v.lights[1].other_count = groups.count;
        for (int l = 0; l < 2; l++)
            square_plane(v.lights[l].variance, texels + work->ghosts.count);
        if (work->params->parts)
            limit_variance(work, v.lights[0].variance, texels + work->ghosts.count);
        status = work->map->bands != NULL ? run_in_parts(work, *points, count, total, v.lights, error)
                                          : run_whole(work, points, count, v.lights, error);
    }
    if (status == KILN_OK) {
        state_error(*points, count, v.lights, caustic < KILN_MAP_PLANES_MAX ? own_plane(work, caustic) : NULL,
                    work->shared, own_plane(work, KILN_MAP_ERROR), texels);
        give_values(&v, work);
        give_groups(&groups, work);
    }
    drop_groups(&groups);
    for (int l = 0; status == KILN_OK && l < 2; l++) {
        work->report->noise_before[l] = v.lights[l].before;
        work->report->noise_after[l] = v.lights[l].after;
    }
    drop_values(&v);
    return status;
}

/* Denoises direct and indirect light separately, and the light of groups with the same weights; then updates the error
 * to what remains. Where the surface continues in another object, texels there are neighbours too. */
static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    const double begin = seconds_now();
    struct kiln_neighbour_point *points = NULL;
    size_t count = 0;
    int status = collect_points(work, &points, &count, error);
    uint64_t total = count;
    if (status == KILN_OK)
        status = kiln_bands_count(work->map, &total, 1, error);
    if (status == KILN_OK && total > 0)
        status = denoise(work, &points, count, total, error);
    kiln_free(&points);
    kiln_free(&work->ghosts.records);
    work->ghosts = (struct kiln_map_ghosts){0};
    work->report->denoise_seconds = seconds_now() - begin;
    work->denoising += work->report->denoise_seconds;
    return status;
}

const struct kiln_map_stage kiln_map_stage_denoise = {.name = "denoise",
                                                      .wanted = wanted,
                                                      .features = KILN_MAP_POSITION | KILN_MAP_NORMAL,
                                                      .fields = {"error_direct", "error_indirect"},
                                                      .if_any = "error_caustic",
                                                      .run = run};
