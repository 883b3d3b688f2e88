#include "coordinator/integrate/land/land_state.h"

#include <math.h>
#include <string.h>

#include "coordinator/run/control.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/pass/point.h"

enum { RAY_TILE_RUNS = 16, FEW = 1 << 12 /* points that are not worth several threads */ };
#define LARGEST 6.0   /* largest merge radius, in mean texels, if landings share light with gather rays */
#define OWN_MOST 12.0 /* largest merge radius of a point, in texels of its lightmap, if no radius was given */
#define LANDINGS 16.0 /* effective number of landings in one iteration that a point's light should rest on */

/* Collective. Chooses the merge radius if none was given: by the first iteration or, if landings share light with
 * gather rays, a fixed number of texels. */
static int find_radius(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    const double power = kiln_luminance(p->emission->emitted), points = (double)p->surface->point_count,
                 texel = points > 0.0 ? sqrt(p->area / points) : 0.0;
    const struct kiln_merge_search search = {.landed = l->sums,
                                             .merged = l->merged,
                                             .iterations = kiln_landing_iterations(l),
                                             .alpha = p->settings->radius_alpha,
                                             .texel = texel,
                                             .scale = p->area > 0.0 ? power * power / p->area : 0.0};
    if (kiln_landing_shares(l)) {
        l->radius = p->settings->merge_radius == KILN_MERGE_RADIUS_AUTO ? LARGEST * texel : p->settings->merge_radius;
        return KILN_OK;
    }
    return l->iteration == 0 && p->settings->merge_radius == KILN_MERGE_RADIUS_AUTO
               ? kiln_merge_find_radius(l->merge, &search, &l->radius, error)
               : KILN_OK;
}

/* Adds up the areas of each object's front and of its two-sided triangles' backs, m2. */
static void add_areas(const struct kiln_geometry *g, const struct kiln_surface *s, double *areas)
{
    for (uint64_t t = 0; t < g->triangle_count; t++) {
        const struct kiln_hit_record *record = &g->records[t];
        const double area = kiln_geometry_triangle_area(g, t);
        areas[record->object] += area;
        if (s->whole_maps > s->object_count && (record->material & KILN_RECORD_DOUBLE_SIDED) != 0)
            areas[s->object_count + record->object] += area;
    }
}

/* Computes the largest merge radius for the points of each lightmap. It follows the mean texel width, which may be a
 * hundredth of another lightmap's. NULL for octrees, whose leaves have equal sizes. */
static int find_widest(const struct kiln_landing *l, float **widest, struct kiln_error *error)
{
    const struct kiln_surface *s = &l->solution->own->surface;
    double *areas = NULL;
    if (s->bricks != NULL)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_allocate(widest, s->map_count, sizeof **widest, "the widths of texels", error));
    KILN_TRY(kiln_allocate(&areas, s->map_count, sizeof *areas, "the areas of lightmaps", error));
    add_areas(l->params->backend->params.geometry, s, areas);
    for (uint32_t map = 0; map < s->map_count; map++) {
        const struct kiln_lightmap *lightmap = &s->lightmaps[map];
        uint64_t points = 0;
        if (kiln_map_part(s, map) > 0) {
            (*widest)[map] = (*widest)[map - s->whole_maps];
            continue;
        }
        for (uint64_t t = 0; t < (uint64_t)lightmap->tiles_x * lightmap->tiles_y; t++)
            points += (uint64_t)__builtin_popcountll(s->tiles[lightmap->tile_first + t].mask);
        (*widest)[map] = points > 0 ? (float)(OWN_MOST * sqrt(areas[map] / (double)points)) : INFINITY;
    }
end:
    kiln_free(&areas);
    return status;
}

/* Collective. */
static int begin_merging(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    float *widest = NULL;
    int status = l->places == NULL && p->settings->merge_radius == KILN_MERGE_RADIUS_AUTO
                     ? find_widest(l, &widest, error)
                     : KILN_OK;
    struct kiln_merge_params params = {.communicator = p->communicator,
                                       .world = &p->backend->params,
                                       .surface = &l->solution->own->surface,
                                       .lit = l->lit,
                                       .widest = widest,
                                       .threads = p->threads,
                                       .limit = p->settings->exchange_limit};
    if (status == KILN_OK && l->places == NULL)
        status = kiln_merge_find_places(&params, &l->places, error);
    status = kiln_agree(p->communicator, status, error);
    params.places = l->places;
    if (status == KILN_OK && l->merge == NULL)
        status = kiln_merge_create(&l->merge, &params, error);
    kiln_free(&widest);
    if (status == KILN_OK)
        status = find_radius(l, error);
    l->solution->report.landing.radius = fmax(l->radius, 0.0);
    l->merging = true;
    return status == KILN_OK ? kiln_merge_set_radius(l->merge, l->radius, error) : status;
}

/* Number of landings that a point's light should rest on. It grows with the iterations, so that radii shrink as those
 * of merge.h do. */
static double landings_of(const struct kiln_landing *l)
{
    return LANDINGS * pow((double)kiln_landing_iterations(l), l->params->settings->radius_alpha);
}

/* Number of steps of the same size whose light is averaged, with that of all parts up to this round. One for a given
 * number of samples. */
static double averaged_with(const struct kiln_landing *l)
{
    const struct kiln_step *step = &kiln_solution_step(l->solution)->step;
    const double before = (double)step->first_sample / (double)step->samples; /* of all parts up to this one */
    return l->params->settings->published_error > 0.0 ? before - (double)(step->part % KILN_PARTS) + KILN_PARTS : 1.0;
}

/* Collective. Spreads the light landed in iterations with the same radius to the points within it. */
static int merge_iterations(struct kiln_landing *l, struct kiln_error *error)
{
    const double radius = kiln_merge_radius_of(fmax(l->radius, 0.0), l->params->settings->radius_alpha, l->iteration);
    const int status = kiln_merge_spread(l->merge, l->sums, radius, l->merged, error);
    memset(l->sums, 0, l->solution->own->surface.count * sizeof *l->sums);
    return status;
}

/* Collective. Spreads the light landed in all iterations, and found by rays, to the points within each point's
 * radius. */
static int spread_all(struct kiln_landing *l, struct kiln_error *error)
{
    int status = kiln_merge_fit(l->merge, l->gathered, landings_of(l), averaged_with(l), error);
    if (status == KILN_OK)
        status = kiln_merge_spread(l->merge, l->gathered, l->radius, l->merged, error);
    const bool pools = l->params->settings->merge_radius == KILN_MERGE_RADIUS_AUTO; /* else it is as was asked for */
    return status == KILN_OK && pools ? kiln_landing_pool(l, error) : status;
}

/* Collective. Does one or the other. */
static int merge_sums(struct kiln_landing *l, int (*merge)(struct kiln_landing *, struct kiln_error *),
                      struct kiln_error *error)
{
    const double start = MPI_Wtime();
    kiln_control_blocking(l->params->control, "merging landings of light", 0.0);
    int status = l->merging ? KILN_OK : begin_merging(l, error);
    if (status == KILN_OK)
        status = merge(l, error);
    kiln_control_blocking(l->params->control, NULL, 0.0);
    kiln_solution_step(l->solution)->seconds += MPI_Wtime() - start;
    return status;
}

int kiln_landing_merge(struct kiln_landing *l, struct kiln_error *error)
{
    return merge_sums(l, merge_iterations, error);
}

/* Adds the light that rays found at a point, as one more landing: its luminance squared is its variance. */
static void add_gathered(const struct kiln_point_result *result, double area, double iterations,
                         struct kiln_landing_sum *sum)
{
    const struct kiln_point_mean mean = kiln_point_mean(result);
    const double scale = area * iterations, error = (double)mean.error * scale;
    for (int c = 0; c < 3; c++) {
        sum->irradiance[c] += (double)mean.irradiance[c] * scale;
        sum->incident[c] += (double)mean.incident[c] * scale;
    }
    sum->square += error * error;
    sum->count += kiln_luminance_of_floats(mean.irradiance) + kiln_luminance_of_floats(mean.incident) > 0.0;
}

/* kiln_take_results */
static int take_rays(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct kiln_landing *l = context;
    const struct kiln_surface *surface = &l->solution->own->surface;
    const struct kiln_point_result *of = results;
    const uint64_t begin = kiln_own_of_global(surface, surface->tile_runs[first].first).at,
                   points = kiln_tile_runs_points(&surface->tile_runs[first], &surface->tile_runs[first + count - 1]);
    const double iterations = (double)kiln_landing_iterations(l);
#pragma omp parallel for num_threads((int)l->params->threads) schedule(static) if (points > FEW)
    for (uint64_t i = 0; i < points; i++)
        add_gathered(&of[i], (double)l->lit[begin + i], iterations, &l->gathered[begin + i]);
    return KILN_OK;
}

/* Traces gather rays of tile runs before answers are given; the later step counts these rays. */
static int gather_rays(struct kiln_landing *l, uint64_t first, uint64_t count, uint64_t *rays, struct kiln_error *error)
{
    (void)rays;
    const struct kiln_step *step = &kiln_solution_step(l->solution)->step;
    struct kiln_batch batch = {.stream = step->stream,
                               .samples = kiln_landing_own_rays(l),
                               .first_sample = kiln_landing_first_ray(l),
                               .take = take_rays,
                               .context = l};
    const struct kiln_tile_run *runs = l->solution->own->surface.tile_runs;
    uint64_t now = 0;
    int status = KILN_OK;
    for (size_t f = (size_t)first, end = (size_t)(first + count); f < end; f += batch.count) {
        batch.first = f;
        batch.count = kiln_landing_same_kind(l, f, end) - f;
        if (!kiln_landing_is_receiver(l, f))
            KILN_TRY(kiln_landing_run_pass(l, &kiln_pass_weighed, &l->techniques, &batch, &now, error));
    }
    kiln_progress_advance(l->params->progress, kiln_tile_runs_points(runs, runs + first + count - 1));
end:
    return status;
}

int kiln_landing_spread(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = l->params;
    const struct kiln_surface *own = &l->solution->own->surface;
#pragma omp parallel for num_threads((int)p->threads) schedule(static)
    for (uint64_t i = 0; i < own->count; i++)
        l->gathered[i] = l->sums[i];
    kiln_progress_phase(p->progress, "caustics by rays", p->surface->count);
    kiln_control_begin(p->control, "caustics by rays");
    const int status = kiln_landing_work_through(
        l, 0, own->tile_run_count, kiln_landing_at_once(l, RAY_TILE_RUNS * p->threads), gather_rays, KILN_OK, error);
    return status == KILN_OK ? merge_sums(l, spread_all, error) : status;
}
