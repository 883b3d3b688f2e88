#include "coordinator/integrate/parts/light_trial.h"

#include <math.h>
#include <string.h>

#include "coordinator/integrate/packing.h"
#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/integrate/parts/published_windows.h"
#include "coordinator/integrate/parts/round_levels.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"
#include "worker/pass/reference.h"

enum {
    TILES_LEAST = 32, /* tile runs that a rank tries */
    ONE_OF = 32,      /* tile runs of which it tries one, if these are more */
    FIRST_HALVES = 2, /* what the first round has in halves of its samples */
    STREAM = 0xfffe   /* of paths */
};
/* Standard error of light that rays gather from points over that of light that they find along paths: a point's light
 * is a mean over its samples. tests/bench/NOTES.md has the scenes. */
#define GATHERED 0.7

/* Light of a tried tile run's points. */
struct tried {
    size_t tile_run;
    float direct[KILN_PARTS][KILN_WINDOW_TEXELS], paths[KILN_PARTS][KILN_WINDOW_TEXELS];
};

struct trial {
    const struct kiln_light_trial_params *params;
    struct tried *tried;
    size_t count;
    uint32_t *samples; /* of each own tile run: 0, or `part_samples` */
    size_t next;       /* of `tried`, to take results of */
    int part;
    bool paths; /* results are of paths, else of direct light */
    struct kiln_published published;
    struct kiln_tried_tile *errors; /* of `tried` */
    double *light, *area;           /* of each object, over the tried tile runs */
};

/* ---- light ---- */

static void take_tile_run(struct trial *t, struct tried *tried, const char *results, size_t result_bytes)
{
    const struct kiln_tile_run *run = &t->params->surface->tile_runs[tried->tile_run];
    for (uint32_t k = 0; k < run->count; k++) {
        struct kiln_point_result result;
        memcpy(&result, results + k * result_bytes, sizeof result); /* a result of paths begins with it */
        const struct kiln_point_mean mean = kiln_point_mean(&result);
        (t->paths ? tried->paths : tried->direct)[t->part][k] = (float)kiln_luminance_of_floats(mean.irradiance);
    }
}

/* kiln_take_results */
static int take(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    struct trial *t = context;
    const struct kiln_tile_run *runs = t->params->surface->tile_runs;
    const size_t bytes = t->paths ? sizeof(struct kiln_reference_result) : sizeof(struct kiln_point_result);
    (void)error;
    for (size_t i = first; i < first + count && t->next < t->count; i++)
        if (i == t->tried[t->next].tile_run) {
            const uint64_t before = kiln_tile_runs_points(&runs[first], &runs[i]) - runs[i].count;
            take_tile_run(t, &t->tried[t->next++], (const char *)results + before * bytes, bytes);
        }
    return KILN_OK;
}

static int run_pass(struct trial *t, bool paths, uint32_t part_samples, struct kiln_error *error)
{
    const struct kiln_reference_parameters parameters = {.method = KILN_REFERENCE_PATH,
                                                         .bounces = KILN_PATH_ALL_BOUNCES};
    const struct kiln_surface *surface = t->params->surface;
    uint64_t rays = 0;
    int status = KILN_OK;
    t->paths = paths;
    for (size_t i = 0; i < t->count; i++)
        t->samples[t->tried[i].tile_run] = part_samples;
    for (t->part = 0; t->part < KILN_PARTS && status == KILN_OK; t->part++) {
        const struct kiln_batch batch = {.count = surface->tile_run_count,
                                         .stream = paths ? STREAM : 0,
                                         .samples_each = t->samples,
                                         .first_sample = (uint32_t)t->part * part_samples,
                                         .take = take,
                                         .context = t};
        t->next = 0;
        status = paths ? kiln_backend_run(t->params->backend, &kiln_pass_reference, &parameters, &batch, &rays, error)
                       : kiln_backend_run(t->params->backend, &kiln_pass_direct, NULL, &batch, &rays, error);
    }
    return status;
}

/* ---- errors ---- */

static double mean_over_parts(const float part[KILN_PARTS][KILN_WINDOW_TEXELS], size_t k)
{
    double sum = 0.0;
    for (int i = 0; i < KILN_PARTS; i++)
        sum += (double)part[i][k];
    return sum / KILN_PARTS;
}

/* Light of a tried point. */
static double mean_of(const struct tried *tried, size_t k)
{
    return mean_over_parts(tried->direct, k) + mean_over_parts(tried->paths, k);
}

/* Area of a point of each object, and a twentieth of its mean light over the tried tile runs. */
static void find_objects(struct trial *t)
{
    const struct kiln_surface *s = t->params->surface;
    for (size_t i = 0; i < t->count; i++) {
        const struct kiln_tile_run *run = &s->tile_runs[t->tried[i].tile_run];
        const size_t object = kiln_map_object(s, run->map);
        const uint64_t first = kiln_own_of_global(s, run->first).at;
        double points = 0.0, area = 0.0;
        for (uint32_t k = 0; k < run->count; k++) {
            t->light[object] += mean_of(&t->tried[i], k) * (double)s->area[first + k];
            area += (double)s->area[first + k];
            points += 1.0;
        }
        t->area[object] += area;
        t->published.texel[object] = fmax(t->published.texel[object], area / points);
    }
    for (size_t o = 0; o < s->object_count; o++)
        t->published.dark[o] = t->area[o] > 0.0 ? KILN_PUBLISHED_DARK * t->light[o] / t->area[o] : 0.0;
}

static void lay_out(const struct trial *t, const struct tried *tried, struct kiln_tile_light *tile)
{
    const struct kiln_surface *s = t->params->surface;
    const struct kiln_tile_run *run = &s->tile_runs[tried->tile_run];
    size_t k = 0;
    *tile = (struct kiln_tile_light){.there = 0};
    kiln_tile_light_weigh(&t->published, tile, s, run);
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, k++) {
        const int place = kiln_part_place((uint32_t)__builtin_ctzll(rest));
        if ((tile->there >> place & 1u) == 0)
            continue;
        const double paths = mean_over_parts(tried->paths, k);
        tile->all[place] = (float)mean_of(tried, k);
        for (int part = 0; part < KILN_PARTS; part++)
            tile->part[part][place] =
                (float)((double)tried->direct[part][k] + paths + GATHERED * ((double)tried->paths[part][k] - paths));
    }
}

static struct kiln_tried_tile error_of(const struct trial *t, const struct tried *tried)
{
    const struct kiln_surface *s = t->params->surface;
    const struct kiln_tile_run *run = &s->tile_runs[tried->tile_run];
    struct kiln_tried_tile found = {.had = FIRST_HALVES, .points = run->count};
    struct kiln_tile_light tile;
    lay_out(t, tried, &tile);
    found.raw = (float)sqrt(kiln_published_raw_square(
        &t->published, &tile, t->published.dark[kiln_map_object(s, run->map)], &found.weight, NULL));
    return found;
}

/* ---- all ---- */

static int choose(struct trial *t, struct kiln_error *error)
{
    const struct kiln_surface *s = t->params->surface;
    const size_t runs = s->tile_run_count, wanted = runs / ONE_OF > TILES_LEAST ? runs / ONE_OF : TILES_LEAST,
                 bounded = kiln_tried_tiles_bounded(t->params->communicator, wanted);
    int status;
    t->count = bounded < runs ? bounded : runs;
    KILN_TRY(kiln_allocate(&t->tried, t->count, sizeof *t->tried, "the trial of light", error));
    KILN_TRY(kiln_allocate(&t->samples, runs, sizeof *t->samples, "the trial of light", error));
    KILN_TRY(kiln_allocate(&t->errors, t->count, sizeof *t->errors, "the trial of light", error));
    KILN_TRY(kiln_allocate(&t->light, s->object_count, sizeof *t->light, "the trial of light", error));
    KILN_TRY(kiln_allocate(&t->area, s->object_count, sizeof *t->area, "the trial of light", error));
    KILN_TRY(kiln_published_allocate(&t->published, s->object_count, 0, error));
    for (size_t i = 0; i < t->count; i++)
        t->tried[i].tile_run = (2 * i + 1) * runs / (2 * t->count);
end:
    return status;
}

/* Tries the own tile runs. */
static int try_own(struct trial *t, struct kiln_error *error)
{
    const struct kiln_integrate_settings *settings = t->params->settings;
    int status;
    KILN_TRY(choose(t, error));
    KILN_TRY(run_pass(t, false, kiln_round_first(settings->samples_direct, true), error));
    KILN_TRY(run_pass(t, true, kiln_round_first(settings->samples_indirect, true), error));
    find_objects(t);
    for (size_t i = 0; i < t->count; i++)
        t->errors[i] = error_of(t, &t->tried[i]);
end:
    return kiln_agree(t->params->communicator, status, error);
}

int kiln_light_trial_run(const struct kiln_light_trial_params *params, struct kiln_tried_tile **tiles, size_t *count,
                         struct kiln_error *error)
{
    struct trial t = {.params = params};
    int status;
    *tiles = NULL;
    *count = 0;
    KILN_TRY(try_own(&t, error));
    KILN_TRY(kiln_tried_tiles_gather(params->communicator, t.errors, t.count, tiles, count, error));
end:
    kiln_published_release(&t.published);
    kiln_free(&t.tried);
    kiln_free(&t.errors);
    kiln_free(&t.samples);
    kiln_free(&t.light);
    kiln_free(&t.area);
    return status;
}
