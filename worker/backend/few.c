#include "worker/backend/few.h"

#include <string.h>

#include "worker/base/arena.h"
#include "worker/light/light_groups.h"
#include "worker/pass/groups.h"

struct few_run {
    const struct kiln_batch *batch;
    const struct kiln_surface *surface;
    size_t bytes; /* of a result */
    /* one an item of the batch */
    struct kiln_selection *points, *others; /* masks: points that take fewer samples, and the other points */
    uint32_t *samples;                      /* of `points`; 0: it has none */
    size_t *place;                          /* where its results begin in `kept`; and the end */
    char *kept;
    struct kiln_groups *groups; /* whose light is computed as well; NULL: none */
    size_t group_floats;        /* of a point */
    float *kept_groups;         /* as `kept` */
    char *whole;                /* a part's results put together */
    size_t whole_room;
    struct kiln_arena arena;
};

static void release(struct few_run *r) { kiln_arena_release(&r->arena); }

static int make_room(struct few_run *r, struct kiln_error *error)
{
    const char *what = "points with fewer samples";
    const size_t count = r->batch->count;
    int status;
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->points, count, sizeof *r->points, what, error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->others, count, sizeof *r->others, what, error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->samples, count, sizeof *r->samples, what, error));
    KILN_TRY(kiln_arena_allocate(&r->arena, &r->place, count + 1, sizeof *r->place, what, error));
end:
    return status;
}

/* Divides the points of each item by their number of samples, and finds where results are kept. */
static int divide(struct few_run *r, struct kiln_error *error)
{
    const struct kiln_batch *batch = r->batch;
    for (size_t i = 0; i < batch->count; i++) {
        const uint32_t count = r->surface->tile_runs[batch->first + i].count;
        const uint64_t all = count < KILN_TILE_TEXELS ? (1ull << count) - 1 : UINT64_MAX;
        const struct kiln_selection *chosen = &batch->selections[i];
        const uint64_t asked = kiln_batch_leaves_out(batch, batch->first + i) ? 0 : all & chosen->computed;
        r->points[i].computed = asked & chosen->few;
        r->others[i].computed = asked & ~chosen->few;
        r->place[i + 1] = r->place[i] + (size_t)__builtin_popcountll(r->points[i].computed);
        if (r->points[i].computed != 0)
            r->samples[i] = kiln_batch_few(batch->samples_each != NULL ? batch->samples_each[i] : batch->samples);
    }
    const int status = kiln_arena_allocate(&r->arena, &r->kept, r->place[batch->count], r->bytes,
                                           "results of points with fewer samples", error);
    return status == KILN_OK && r->groups != NULL
               ? kiln_arena_allocate(&r->arena, &r->kept_groups, r->place[batch->count],
                                     r->group_floats * sizeof *r->kept_groups, "the light of groups", error)
               : status;
}

/* Keeps the groups' answers of a tile run, or restores them. Points with fewer samples have theirs from `place` on. */
static void move_groups(const struct few_run *r, const struct kiln_tile_run *run, uint64_t points, size_t place,
                        bool back)
{
    if (r->groups == NULL)
        return;
    float *kept = r->kept_groups + place * r->group_floats,
          *of_run = r->groups->answers + (run->first.at - r->groups->first) * r->group_floats;
    for (uint64_t rest = points; rest != 0; rest &= rest - 1, kept += r->group_floats) {
        float *answer = of_run + (size_t)__builtin_ctzll(rest) * r->group_floats;
        memcpy(back ? answer : kept, back ? kept : answer, r->group_floats * sizeof *kept);
    }
}

/* kiln_take_results of the points with fewer samples. */
static int keep(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    struct few_run *r = context;
    const struct kiln_tile_run *runs = &r->surface->tile_runs[first];
    for (size_t i = 0; i < count; i++) {
        const size_t item = first + i - r->batch->first;
        const char *of_run = (const char *)results + (runs[i].first.at - runs[0].first.at) * r->bytes;
        char *to = r->kept + r->place[item] * r->bytes;
        move_groups(r, &runs[i], r->points[item].computed, r->place[item], false);
        for (uint64_t rest = r->points[item].computed; rest != 0; rest &= rest - 1, to += r->bytes)
            memcpy(to, of_run + (size_t)__builtin_ctzll(rest) * r->bytes, r->bytes);
    }
    return KILN_OK;
}

/* kiln_take_results callback for the other points: passes on all results. */
static int put_together(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    struct few_run *r = context;
    const size_t begin = first - r->batch->first;
    const struct kiln_tile_run *runs = &r->surface->tile_runs[first];
    if (r->batch->take == NULL || r->place[begin] == r->place[begin + count])
        return r->batch->take == NULL ? KILN_OK : r->batch->take(r->batch->context, first, count, results, error);
    const size_t points = (size_t)kiln_tile_runs_points(runs, runs + count - 1);
    const int status =
        kiln_arena_grow(&r->arena, &r->whole, &r->whole_room, points, r->bytes, "a part's results", error);
    if (status != KILN_OK)
        return status;
    memcpy(r->whole, results, points * r->bytes);
    const char *from = r->kept + r->place[begin] * r->bytes;
    for (size_t i = 0; i < count; i++) {
        char *of_run = r->whole + (runs[i].first.at - runs[0].first.at) * r->bytes;
        move_groups(r, &runs[i], r->points[begin + i].computed, r->place[begin + i], true);
        for (uint64_t rest = r->points[begin + i].computed; rest != 0; rest &= rest - 1, from += r->bytes)
            memcpy(of_run + (size_t)__builtin_ctzll(rest) * r->bytes, from, r->bytes);
    }
    return r->batch->take(r->batch->context, first, count, r->whole, error);
}

static int run_both(struct few_run *r, struct kiln_backend *backend, const struct kiln_pass *pass,
                    const void *parameters, uint64_t *rays, struct kiln_error *error)
{
    struct kiln_batch few = kiln_batch_taken_by(r->batch, keep, r),
                      rest = kiln_batch_taken_by(r->batch, put_together, r);
    few.selections = r->points;
    few.samples = 0;
    few.samples_each = r->samples;
    few.first_sample = (uint32_t)((uint64_t)few.first_sample * kiln_batch_few(r->batch->samples) / r->batch->samples);
    rest.selections = r->others;
    const int status =
        r->place[r->batch->count] > 0 ? kiln_backend_run(backend, pass, parameters, &few, rays, error) : KILN_OK;
    return status == KILN_OK ? kiln_backend_run(backend, pass, parameters, &rest, rays, error) : status;
}

int kiln_backend_run_few(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                         const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    struct few_run r = {
        .batch = batch, .surface = backend->surface, .bytes = pass->result_bytes, .groups = backend->given.groups};
    if (r.groups != NULL)
        r.group_floats = (size_t)r.groups->lights->count * KILN_GROUP_FLOATS;
    int status;
    KILN_TRY(make_room(&r, error));
    KILN_TRY(divide(&r, error));
    KILN_TRY(run_both(&r, backend, pass, parameters, rays, error));
end:
    release(&r);
    return status;
}
