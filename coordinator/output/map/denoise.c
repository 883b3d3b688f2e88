#include <math.h>
#include <time.h>

#include "coordinator/output/map/regression.h"
#include "coordinator/output/map/stage.h"
#include "worker/base/memory.h"

/* Texels smaller than this part of the distance from the scene's centre have no places of their own in float. */
static const float least_size = 0x1p-20f;

static bool wanted(const struct kiln_output_params *params) { return params->denoise; }

static double seconds_now(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* The point of a gathered texel. False if it has no size or normal of use: it then keeps its value, and is no
 * neighbour. */
static bool make_point(const struct kiln_map_work *work, size_t texel, struct kiln_neighbour_point *point)
{
    const struct kiln_map *map = work->map;
    float square = 0.0f, farthest = 0.0f;
    *point = (struct kiln_neighbour_point){.area = map->area[texel], .index = (uint32_t)texel};
    for (uint32_t c = 0; c < 3; c++) {
        point->position[c] = map->planes[work->layers->position + c][texel];
        point->normal[c] = map->planes[work->layers->normal + c][texel];
        square += point->normal[c] * point->normal[c];
        farthest = fmaxf(farthest, fabsf(point->position[c]));
    }
    point->size = map->coverage[texel] > 0.0f ? sqrtf(map->area[texel] / map->coverage[texel]) : 0.0f;
    return point->size > least_size * farthest && isnormal(point->size) && isfinite(point->area) && square > 0.5f &&
           square < 2.0f;
}

static int collect_points(const struct kiln_map_work *work, struct kiln_neighbour_point **points, size_t *count,
                          struct kiln_error *error)
{
    const size_t texels = kiln_map_texels(work->map);
    size_t gathered = 0;
    for (size_t i = 0; i < texels; i++)
        gathered += work->map->state[i] == KILN_TEXEL_VALID;
    *count = 0;
    const int status = kiln_allocate(points, gathered, sizeof **points, "the points of a lightmap", error);
    for (size_t i = 0; status == KILN_OK && i < texels; i++)
        if (work->map->state[i] == KILN_TEXEL_VALID && make_point(work, i, *points + *count))
            *count += 1;
    return status;
}

/* The planes of direct and of indirect light, with those of their errors. */
static void find_lights(const struct kiln_map_work *work, struct kiln_regression_light lights[2])
{
    static const char *const errors[] = {"error_direct", "error_indirect"};
    static const uint32_t first[] = {KILN_MAP_DIRECT, KILN_MAP_INDIRECT};
    float **planes = work->map->planes;
    for (int l = 0; l < 2; l++)
        lights[l] = (struct kiln_regression_light){
            .rgb = {planes[first[l]], planes[first[l] + 1], planes[first[l] + 2]},
            .variance = planes[kiln_layers_plane(work->layers, work->result->fields, errors[l])]};
}

static void square_plane(float *values, size_t count)
{
    for (size_t i = 0; i < count; i++)
        values[i] *= values[i];
}

/* What of the error's square neighbours share, as they share the noise of the bounces that they gather: no regression
 * takes that out. Of a bake in parts the error knows of it, while the errors of direct and of indirect light are those
 * of a point's own samples. */
static float shared_part(const struct kiln_neighbour_grid *grid, const struct kiln_regression_light lights[2],
                         const float *error)
{
    double all = 0.0, own = 0.0;
    for (size_t i = 0; i < grid->count; i++) {
        const uint32_t at = grid->points[i].index;
        all += (double)error[at] * (double)error[at];
        own += (double)lights[0].variance[at] + (double)lights[1].variance[at];
    }
    return all > own ? (float)(1.0 - own / all) : 0.0f;
}

/* The error of the sum of both: what is left, and never more than it was. */
static void state_error(const struct kiln_neighbour_grid *grid, const struct kiln_regression_light lights[2],
                        float shared, float *error)
{
    for (size_t i = 0; i < grid->count; i++) {
        const uint32_t at = grid->points[i].index;
        error[at] =
            fminf(error[at], sqrtf(lights[0].variance[at] + lights[1].variance[at] + shared * error[at] * error[at]));
    }
}

static int denoise(struct kiln_map_work *work, const struct kiln_neighbour_grid *grid, struct kiln_error *error)
{
    struct kiln_regression_light lights[2];
    find_lights(work, lights);
    for (int l = 0; l < 2; l++)
        square_plane(lights[l].variance, kiln_map_texels(work->map));
    const float shared = work->params->parts ? shared_part(grid, lights, work->map->planes[KILN_MAP_ERROR]) : 0.0f;
    const int status = kiln_regression_run(grid, lights, 2, error);
    if (status != KILN_OK)
        return status;
    state_error(grid, lights, shared, work->map->planes[KILN_MAP_ERROR]);
    for (int l = 0; l < 2; l++) {
        work->report->noise_before[l] = lights[l].before;
        work->report->noise_after[l] = lights[l].after;
    }
    return KILN_OK;
}

/* Takes noise out of direct and of indirect light, apart, and lowers the error to what is left. */
static int run(struct kiln_map_work *work, struct kiln_error *error)
{
    const double begin = seconds_now();
    struct kiln_neighbour_point *points = NULL;
    struct kiln_neighbour_grid *grid = NULL;
    size_t count = 0;
    int status = collect_points(work, &points, &count, error);
    if (status == KILN_OK && count > 0)
        status = kiln_neighbour_grid_create(&grid, &points, count, error);
    if (status == KILN_OK && count > 0)
        status = denoise(work, grid, error);
    kiln_free(&points);
    kiln_neighbour_grid_destroy(&grid);
    work->report->denoise_seconds = seconds_now() - begin;
    return status;
}

const struct kiln_map_stage kiln_map_stage_denoise = {.name = "denoise",
                                                      .wanted = wanted,
                                                      .features = KILN_MAP_POSITION | KILN_MAP_NORMAL,
                                                      .fields = {"error_direct", "error_indirect"},
                                                      .run = run};
