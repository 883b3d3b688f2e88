/* The links pass (worker/pass/links.h). For tile runs without stored links, shadow rays are traced to the points that
 * links represent (worker/backend/link_run.h), eight at a time; then sums are computed from stored data alone. */
#include "worker/pass/links.h"

#include <string.h>

#include "worker/backend/embree/frame.h"
#include "worker/backend/embree/patch_ray.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/backend/link_run.h"
#include "worker/base/memory.h"

/* Data that the pass's threads share. */
struct links_job {
    const struct kiln_links_parameters *p;
    const struct kiln_batch *part;
    const struct kiln_point_result *gathered; /* of the part's points: hits of their rays */
    int status;                               /* of the thread that has failed */
    struct kiln_error *error;
};

/* A ray to be traced for link number `link`, on behalf of the points in the mask. */
struct link_ray {
    uint32_t link;
    uint64_t of;
};

struct links_work {
    struct tile_run_frame frame;
    struct links_job *job;
    struct kiln_link_run run;
    const struct embree_backend *b; /* of the tile run under way */
    struct embree_context *context;
    struct RTCRay8 rays __attribute__((aligned(32)));
    int valid_rays[PACKET] __attribute__((aligned(32)));
    struct link_ray of[PACKET];
    uint32_t waiting;
    uint64_t traced;
};

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    (void)b, (void)part;
    struct links_work *w = NULL;
    const int status = kiln_allocate(&w, 1, sizeof *w, "the links pass", error);
    if (status == KILN_OK)
        w->job = *(struct links_job *const *)parameters;
    *work = w;
    return status;
}

static void work_destroy(void **work)
{
    struct links_work *w = *work;
    if (w == NULL)
        return;
    kiln_link_run_release(&w->run);
    kiln_free(work);
}

static bool has_failed(const struct links_job *job)
{
    int status;
#pragma omp atomic read
    status = job->status;
    return status != KILN_OK;
}

static void fail(struct links_job *job, int status, const struct kiln_error *error)
{
#pragma omp critical(kiln_links_status)
    if (job->status == KILN_OK) {
        (void)kiln_fail(job->error, status, "%s", error->message);
#pragma omp atomic write
        job->status = status;
    }
}

static int trace(struct links_work *w, struct kiln_error *error)
{
    double through[PACKET][3];
    int status = KILN_OK;
    for (uint32_t i = 0; i < PACKET; i++) {
        w->valid_rays[i] = i < w->waiting ? -1 : 0;
        through[i][0] = through[i][1] = through[i][2] = 1.0;
    }
    if (w->waiting > 0)
        embree_through8(w->b, w->context, w->valid_rays, &w->rays, through);
    for (uint32_t i = 0; i < w->waiting && status == KILN_OK; i++) {
        if (w->rays.tfar[i] < 0.0f)
            continue;
        status = kiln_link_run_see(&w->run, w->of[i].link, w->of[i].of, through[i], error);
    }
    w->traced += w->waiting;
    w->waiting = 0;
    return status;
}

/* kiln_link_ask */
static int ask(void *context, uint32_t link, uint64_t of, const struct kiln_link_sight *sight, struct kiln_error *error)
{
    struct links_work *w = context;
    if (!patch_ray(&w->rays, w->waiting, sight->from, sight->to))
        return KILN_OK;
    w->of[w->waiting++] = (struct link_ray){link, of};
    return w->waiting == PACKET ? trace(w, error) : KILN_OK;
}

/* Finds the ray statistics of the points, and their normals as in the frame. */
static void find_points(struct links_work *w, size_t tile_run, const struct kiln_point_result *gathered)
{
    struct kiln_found_links *f = &w->run.found;
    frame_build(&w->frame, w->b, tile_run, UINT64_MAX, 0);
    memset(f->point, 0, sizeof f->point);
    f->smooth = w->frame.smooth;
    for (uint32_t j = 0; j < w->frame.count; j++) {
        const uint32_t bit = w->run.bit[w->frame.place[j]];
        const struct kiln_vec3 s = frame_shading(&w->frame, j, w->run.patch[bit]->normal);
        kiln_link_run_meet(&w->run, bit, &gathered[w->frame.place[j]]);
        f->shading[bit][0] = s.x, f->shading[bit][1] = s.y, f->shading[bit][2] = s.z;
    }
    kiln_link_run_enter_found(&w->run);
}

static void give(const struct kiln_link_run *w, uint32_t points, struct kiln_point_result *results)
{
    for (uint32_t i = 0; i < points; i++) {
        const uint32_t bit = w->bit[i];
        const struct kiln_link_sums sums = kiln_link_run_sums(w, bit);
        if (w->found.point[bit].count > 0)
            results[i] = kiln_link_answer(&w->found.point[bit], &sums);
    }
}

/* ---- tile runs ---- */

/* Finds the tile run's links, for the current error, and closes its rows. */
static int find_run(struct links_work *w, struct kiln_error *error)
{
    int status = kiln_link_run_find(&w->run, error);
    if (status == KILN_OK)
        status = trace(w, error);
    if (status != KILN_OK)
        return status;
    kiln_link_run_drop_unseen(&w->run);
    kiln_link_run_add(&w->run);
    kiln_link_run_close(&w->run);
    return KILN_OK;
}

/* Refines links as far as the target requires. */
static int open_run(struct links_work *w, struct kiln_error *error)
{
    int status = KILN_OK;
    while (status == KILN_OK && kiln_link_run_opens(&w->run))
        status = find_run(w, error);
    return status;
}

/* Finds links that are not stored; for stored ones, closes the rows anew. Then refines links. */
static int make_run(struct links_work *w, size_t tile_run, bool is_kept, struct kiln_error *error)
{
    const struct kiln_tile_run *runs = w->b->surface->tile_runs, *run = &runs[tile_run];
    int status = KILN_OK;
    find_points(w, tile_run, w->job->gathered + (run->first.at - runs[w->job->part->first].first.at));
    if (is_kept) {
        kiln_link_run_add(&w->run);
        kiln_link_run_close(&w->run);
    } else {
        status = find_run(w, error);
    }
    return status == KILN_OK ? open_run(w, error) : status;
}

/* Keeps what has been found. */
static int keep(const struct links_work *w, const struct kiln_tile_run *run, struct kiln_kept_links **kept,
                struct kiln_error *error)
{
    struct kiln_kept_links *made;
    const int status = kiln_links_encode(&made, &w->run.found, run->first.at, run->mask, w->run.shares, error);
    if (status != KILN_OK)
        return status;
    made->is_judged = 1;
    kiln_links_replace(kept, made);
    return KILN_OK;
}

/* Whether rays must measure the losses of a tile run's rows; kept: NULL: nothing is stored. */
static bool asks_rays(const struct kiln_links_parameters *p, const struct kiln_kept_links *kept)
{
    return kept == NULL || kiln_link_run_is_to_judge(p, kept);
}

/* Processes a tile run: reads or finds its links, refines them, and computes the sums. */
static int do_run(struct links_work *w, size_t tile_run, struct kiln_error *error)
{
    const struct kiln_tile_run *run = &w->b->surface->tile_runs[tile_run];
    struct kiln_kept_links **kept = w->job->p->kept != NULL ? &w->job->p->kept[tile_run] : NULL;
    const bool is_kept = kept != NULL && *kept != NULL, asks = asks_rays(w->job->p, is_kept ? *kept : NULL);
    int status = KILN_OK;
    kiln_link_run_enter(&w->run, w->b->surface, run);
    w->run.summed = false;
    if (is_kept)
        KILN_TRY(kiln_link_run_take(&w->run, *kept, error));
    if (asks)
        KILN_TRY(make_run(w, tile_run, is_kept, error));
    if (asks && kept != NULL)
        KILN_TRY(keep(w, run, kept, error));
    if (!w->run.summed)
        kiln_link_run_add(&w->run);
end:
    return status;
}

static void links_tile_run(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                           void *results, uint64_t *rays)
{
    struct links_work *w = work;
    struct kiln_error error;
    if (has_failed(w->job))
        return;
    w->traced = 0;
    w->b = b;
    w->context = context;
    w->run.p = w->job->p;
    w->run.ask = ask;
    w->run.context = w;
    const int status = do_run(w, tile_run, &error);
    if (status != KILN_OK) {
        fail(w->job, status, &error);
        return;
    }
    give(&w->run, b->surface->tile_runs[tile_run].count, results);
    *rays += w->traced;
}

/* Selects tile runs whose rays must measure losses: their numbers of samples, 0 for others. False: none. */
static bool ask_rays(const struct kiln_links_parameters *p, const struct kiln_batch *part, uint32_t *samples)
{
    bool any = false;
    for (size_t i = 0; i < part->count; i++) {
        const bool asks = asks_rays(p, p->kept != NULL ? p->kept[part->first + i] : NULL);
        samples[i] = asks && !kiln_batch_leaves_out(part, part->first + i) ? part->samples : 0;
        any = any || samples[i] > 0;
    }
    return any;
}

int embree_links(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                 uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, links_tile_run,
                                              sizeof(struct kiln_point_result)};
    const struct kiln_links_parameters *p = parameters;
    const struct kiln_tile_run *runs = b->surface->tile_runs + part->first;
    struct kiln_point_result *gathered = NULL;
    uint32_t *samples = NULL;
    struct kiln_batch missing = *part;
    int status = kiln_allocate(&gathered, (size_t)kiln_tile_runs_points(runs, runs + part->count - 1), sizeof *gathered,
                               "what the rays of links meet", error);
    if (status == KILN_OK)
        status = kiln_allocate(&samples, part->count, sizeof *samples, "the links that are missing", error);
    missing.samples_each = samples;
    missing.stream = p->stream;
    if (status == KILN_OK && ask_rays(p, part, samples))
        status = embree_gather(b, NULL, &missing, gathered, rays, error);
    struct links_job job = {p, part, gathered, KILN_OK, error}, *shared = &job;
    if (status == KILN_OK)
        status = embree_each_tile_run(b, &pass, &shared, part, results, rays, error);
    kiln_free(&samples);
    kiln_free(&gathered);
    return status == KILN_OK ? job.status : status;
}
