#include "coordinator/integrate/run/batches.h"

#include <assert.h>
#include <math.h>

#include "coordinator/job/faults.h"
#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/run/batch_results.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/extended.h"
#include "worker/base/memory.h"

enum { LEAVES = 8 };           /* a batch takes at most one part in so many of what is left */
#define LEAST_HELP 0.005       /* least work left to a rank, in s, for which others help it */
#define LEAST_DEVICE_HELP 0.03 /* s; for a device more, since it is not busy as a batch begins and ends */
#define LEAST_CLAIM 0.03       /* work that a device claims at once if others may help, s */
enum { CLAIMS = 2 };           /* which are under way at once */
/* initial rays per second and thread: a low value, so that the first batch is short even on slow machines */
#define RATE_START 2e4

/* ---- how much ---- */

/* Number of points of a range of consecutive tile runs. */
static uint64_t points_of(const struct kiln_surface *surface, struct kiln_range range)
{
    if (range.count == 0)
        return 0;
    const struct kiln_tile_run *first = &surface->tile_runs[range.first];
    return kiln_tile_runs_points(first, first + range.count - 1);
}

static double work_in(const struct kiln_batches *b, const struct kiln_rank_data *data, struct kiln_range range)
{
    const uint32_t *samples = kiln_batch_samples(b, data);
    double work = 0.0;
    if (samples == NULL)
        return (double)points_of(&data->surface, range);
    for (size_t f = range.first; f < range.first + range.count; f++)
        work += kiln_batch_work(b, &data->surface.tile_runs[f], &samples[f]);
    return work;
}

/* Returns the speed for another rank's points, which have to be copied here first. */
static double help_speed(const struct kiln_batches *b, double work, uint64_t points)
{
    return work / (work / kiln_batch_speed(b) + b->point_seconds * (double)points);
}

/* Whether a companion answers the step in the place of its pass. */
static bool is_answered(const struct kiln_batches *b)
{
    return kiln_companion_answering(b->params->companions, &b->report->step) != NULL;
}

/* Whether ranks may help each other in the step. Data of companions and links exist only on the owner of the points, so
 * such steps are not shared. */
static bool is_shared(const struct kiln_batches *b)
{
    return kiln_node_data_count(b->solution->node_data) > 1 && !is_answered(b) && b->report->step.pass->is_stealable;
}

/* Number of parts into which the remaining work is divided. */
static int parts_of(const struct kiln_batches *b)
{
    const int ranks = kiln_node_data_count(b->solution->node_data);
    return ranks < LEAVES ? ranks : LEAVES;
}

/* Returns the number of this rank's next tile runs that form a batch. There is at least one per thread, so that no core
 * is idle. Towards the end of the step batches shrink, so that others can take the rest. */
static size_t batch_of(const struct kiln_batches *b, struct kiln_range left)
{
    const struct kiln_rank_data *own = b->solution->own;
    const struct kiln_tile_run *tile_runs = own->surface.tile_runs + left.first;
    const uint32_t *samples = kiln_batch_samples(b, own);
    double wanted = kiln_batch_speed(b) * kiln_control_batch_seconds(b->params->control), work = 0.0;
    if (is_shared(b))
        wanted = fmin(wanted, fmax(work_in(b, own, left) / parts_of(b), KILN_LEAST_BATCH * kiln_batch_speed(b)));
    size_t count = 0;
    for (; count < left.count && (count < b->params->threads || work < wanted); count++)
        work += kiln_batch_work(b, &tile_runs[count], samples != NULL ? &samples[left.first + count] : NULL);
    return count;
}

/* Returns the number of tile runs, from the end of another rank's range, to take over. It is half of the number with
 * which both ranks would end at the same time, since there may be more helpers. */
static size_t help_of(const struct kiln_batches *b, const struct kiln_rank_data *data, struct kiln_range left)
{
    const struct kiln_tile_run *tile_runs = data->surface.tile_runs;
    const uint32_t *samples = kiln_batch_samples(b, data);
    const double all = work_in(b, data, left), own = help_speed(b, all, points_of(&data->surface, left)),
                 theirs = kiln_work_queue_speed(data->queue), fair = 0.5 * all * own / (own + theirs),
                 wanted = fmin(fmax(fair, b->least_help * own), own * kiln_control_batch_seconds(b->params->control));
    const size_t end = left.first + left.count;
    double work = 0.0;
    size_t count = 0;
    while (count < left.count && (count < b->params->threads || work < wanted)) {
        count++;
        work += kiln_batch_work(b, &tile_runs[end - count], samples != NULL ? &samples[end - count] : NULL);
    }
    return count;
}

/* ---- batches ---- */

/* Returns the samples of the present batch's tile runs from `first` on; NULL: the same for all. */
static const uint32_t *samples_from(const struct kiln_batches *b, size_t first)
{
    const uint32_t *samples = kiln_batch_samples(b, b->data);
    return samples != NULL ? samples + first : NULL;
}

/* Counts the points of the range that the step skips. */
static uint64_t points_left_out(const struct kiln_batches *b, struct kiln_range range)
{
    const uint32_t *samples = samples_from(b, range.first);
    uint64_t points = 0;
    for (size_t i = 0; samples != NULL && i < range.count; i++)
        points += samples[i] == 0 ? b->data->surface.tile_runs[range.first + i].count : 0;
    return points;
}

int kiln_batches_choose(struct kiln_batches *b, const struct kiln_rank_data *data, struct kiln_batch *batch,
                        struct kiln_error *error)
{
    b->data = data;
    return kiln_companions_choose(b->params->companions, b->params->settings, &b->report->step, data, batch,
                                  &b->selections, &b->selection_room, error);
}

/* Number of the next `count` tile runs that a device claims where others may help. */
static size_t share_of(const struct kiln_batches *b, struct kiln_range left, size_t count)
{
    const struct kiln_rank_data *own = b->solution->own;
    const struct kiln_tile_run *tile_runs = own->surface.tile_runs + left.first;
    const uint32_t *samples = kiln_batch_samples(b, own);
    const double wanted = fmax(work_in(b, own, left) / (CLAIMS * parts_of(b)), LEAST_CLAIM * kiln_batch_speed(b));
    double work = 0.0;
    size_t some = 0;
    for (; some < count && work < wanted; some++)
        work += kiln_batch_work(b, &tile_runs[some], samples != NULL ? &samples[left.first + some] : NULL);
    return some;
}

/* Implements kiln_claims.claim; `context` is the kiln_batches. Others may take the rest, so claims get smaller towards
 * the end of the step. A batch ends when its time is over. */
static size_t claim(void *context, size_t first, size_t count)
{
    struct kiln_batches *b = context;
    struct kiln_work_queue *queue = b->solution->own->queue;
    if (b->claimed > 0 && MPI_Wtime() - b->begun > kiln_control_batch_seconds(b->params->control))
        return 0;
    struct kiln_range left;
    size_t some;
    do {
        left = kiln_work_queue_left(queue);
        some = count < left.count ? count : left.count;
        if (is_shared(b))
            some = share_of(b, left, some);
    } while (some > 0 && !kiln_work_queue_take(queue, left, some));
    assert(some == 0 || left.first == first);
    (void)first;
    b->claimed += some;
    return some;
}

/* Runs the step's pass of the backend. */
static int trace_batch(struct kiln_batches *b, struct kiln_range range, struct kiln_error *error)
{
    struct kiln_backend *backend = b->params->backend;
    const struct kiln_step *step = &b->report->step;
    const struct kiln_claims claims = {claim, b};
    assert(b->data == b->solution->own || step->pass->is_stealable);
    struct kiln_batch batch = {.first = range.first,
                               .count = range.count,
                               .stream = step->stream,
                               .samples = step->samples,
                               .first_sample = step->first_sample,
                               .samples_each = samples_from(b, range.first),
                               .may_lack = b->taker->may_lack,
                               .claims = b->claims ? &claims : NULL,
                               .take = kiln_batch_take_part,
                               .take_some = kiln_batch_take_some,
                               .context = b};
    if (is_answered(b))
        return kiln_company_answer(b->company, step, &batch, error);
    const int status = kiln_batches_choose(b, b->data, &batch, error);
    return status == KILN_OK ? kiln_backend_run(backend, step->pass, step->parameters, &batch, &b->report->rays, error)
                             : status;
}

/* Computes a range of tile runs, of this rank or of another one. */
static int run_batch(struct kiln_batches *b, const struct kiln_rank_data *data, struct kiln_range range,
                     double *seconds, struct kiln_error *error)
{
    struct kiln_backend_info begin, end;
    const struct kiln_integrate_params *p = b->params;
    b->data = data;
    b->points = 0;
    b->taken = 0.0;
    b->claimed = 0;
    kiln_backend_info(p->backend, &begin);
    const double start = MPI_Wtime();
    b->since = b->begun = start;
    const int status = trace_batch(b, range, error);
    if (b->claims)
        range.count = b->claimed;
    if (data == b->solution->own)
        b->work->points_done += points_left_out(b, range);
    if (!b->claims)
        kiln_batch_be_slow(b, MPI_Wtime() - start);
    *seconds = MPI_Wtime() - start;
    kiln_backend_info(p->backend, &end);
    b->report->seconds += *seconds;
    kiln_trace_add(p->trace, data == b->solution->own ? KILN_TRACE_BATCH : KILN_TRACE_HELP, "batch", start,
                   start + *seconds, (int64_t)b->points);
    b->report->device_seconds += fmax(0.0, end.device_seconds - begin.device_seconds);
    if (b->points > 0) {
        const double bringing = data != b->solution->own ? b->point_seconds * (double)b->points : 0.0;
        kiln_batch_note_rate(b, b->taken, fmax(*seconds - bringing, 0.1 * *seconds));
    }
    return status;
}

/* Whether the backend claims work in small parts while it computes. */
static bool is_claimed(const struct kiln_batches *b)
{
    const struct kiln_step *step = &b->report->step;
    struct kiln_backend_info info;
    kiln_backend_info(b->params->backend, &info);
    return kiln_backend_claims(&info, step->pass, step->samples_field != NULL) && !is_answered(b) &&
           !kiln_companions_select(b->params->companions, step) && !b->company->whole_batches;
}

static int run_own(struct kiln_batches *b, double *seconds, struct kiln_error *error)
{
    const struct kiln_rank_data *own = b->solution->own;
    struct kiln_range left = kiln_work_queue_left(own->queue);
    size_t count;
    *seconds = 0.0;
    b->claims = is_claimed(b);
    if (b->claims)
        return left.count > 0 ? run_batch(b, own, left, seconds, error) : KILN_OK;
    do {
        left = kiln_work_queue_left(own->queue);
        count = batch_of(b, left);
    } while (!kiln_work_queue_take(own->queue, left, count));
    return count > 0 ? run_batch(b, own, (struct kiln_range){left.first, count}, seconds, error) : KILN_OK;
}

/* Returns the rank of the node that is expected to end last, and the rest of its work; NULL if none needs help. */
static const struct kiln_rank_data *who_is_behind(const struct kiln_batches *b, struct kiln_range *left)
{
    const struct kiln_node_data *node_data = b->solution->node_data;
    const struct kiln_rank_data *last = NULL;
    double longest = b->least_help;
    if (!is_shared(b))
        return NULL;
    for (int i = 0; i < kiln_node_data_count(node_data); i++) {
        const struct kiln_rank_data *data = kiln_rank_data(node_data, i);
        const struct kiln_range there = kiln_work_queue_left(data->queue);
        const double seconds =
            data == b->solution->own ? 0.0 : work_in(b, data, there) / kiln_work_queue_speed(data->queue);
        if (seconds > longest) {
            longest = seconds;
            last = data;
            *left = there;
        }
    }
    return last;
}

/* Computes a part of another rank's work, unless somebody was quicker. */
static int run_help(struct kiln_batches *b, const struct kiln_rank_data *data, struct kiln_range left, double *seconds,
                    struct kiln_error *error)
{
    struct kiln_backend *backend = b->params->backend;
    const size_t count = help_of(b, data, left);
    const struct kiln_range range = {left.first + left.count - count, count};
    const uint64_t points = points_of(&data->surface, range);
    *seconds = 0.0;
    if (!kiln_work_queue_steal(data->queue, left, count, points))
        return KILN_OK;
    b->claims = false;
    const struct kiln_others others = {&data->surface, range.first, range.count};
    int status;
    KILN_TRY(kiln_backend_set_others(backend, others, error));
    KILN_TRY(run_batch(b, data, range, seconds, error));
    KILN_TRY(kiln_backend_set_others(backend, (struct kiln_others){.surface = NULL}, error));
end:
    if (status != KILN_OK)
        return status; /* the part is not given back; this rank's failure ends the step */
    kiln_work_queue_return(data->queue, points);
    b->report->taken += points;
    return KILN_OK;
}

/* ---- the step ---- */

static bool is_done(const struct kiln_batches *b)
{
    return kiln_step_work_points(b->work, b->solution->own) == b->solution->own->surface.count;
}

static double part_done(const struct kiln_batches *b)
{
    const uint64_t count = b->solution->own->surface.count;
    return count > 0 ? (double)kiln_step_work_points(b->work, b->solution->own) / (double)count : 1.0;
}

/* Returns this rank's first tile run that is not begun. */
static size_t first_left(const struct kiln_batches *b)
{
    const struct kiln_rank_data *own = b->solution->own;
    return is_done(b) ? own->surface.tile_run_count : kiln_work_queue_left(own->queue).first;
}

/* Events that a rank without remaining work of its own waits for. */
struct wait {
    const struct kiln_batches *batches;
    bool was_done, may_help;
};

static bool has_news(void *context)
{
    const struct wait *wait = context;
    struct kiln_range left;
    return is_done(wait->batches) != wait->was_done || (wait->may_help && who_is_behind(wait->batches, &left) != NULL);
}

static enum kiln_event wait_for_others(struct kiln_batches *b)
{
    const struct kiln_integrate_params *p = b->params;
    struct wait wait = {b, is_done(b), b->status == KILN_OK};
    const double start = MPI_Wtime();
    kiln_batch_send_done(b, wait.was_done ? b->solution->own->surface.tile_run_count
                                          : kiln_work_queue_left(b->solution->own->queue).first);
    kiln_progress_advance(p->progress, kiln_step_work_points(b->work, b->solution->own));
    const enum kiln_event event =
        kiln_control_wait(p->control, wait.was_done, part_done(b), b->status, has_news, &wait);
    const double end = MPI_Wtime();
    b->solution->report.waiting_seconds += end - start;
    kiln_trace_add(p->trace, KILN_TRACE_WAIT, "for other ranks", start, end, -1);
    return event;
}

/* Does this rank's next action, and exchanges events with the other ranks. */
static enum kiln_event do_next(struct kiln_batches *b, struct kiln_error *error)
{
    struct kiln_range left;
    double seconds;
    if (b->status == KILN_OK && kiln_step_work_any(b->work, b->solution->own)) {
        b->status = run_own(b, &seconds, error);
    } else {
        const struct kiln_rank_data *behind = b->status == KILN_OK ? who_is_behind(b, &left) : NULL;
        if (behind == NULL)
            return wait_for_others(b);
        kiln_batch_send_done(b, first_left(b));
        b->status = run_help(b, behind, left, &seconds, error);
    }
    return kiln_control_poll(b->params->control, is_done(b), part_done(b), seconds, b->status);
}

void kiln_batches_begin(struct kiln_batches *b, struct kiln_step_report *report, struct kiln_error *error)
{
    const struct kiln_integrate_settings *settings = b->params->settings;
    struct kiln_backend_info info;
    kiln_backend_info(b->params->backend, &info);
    b->point_seconds = info.point_seconds;
    b->least_help = info.keeps_points ? LEAST_DEVICE_HELP : LEAST_HELP;
    b->slowness = kiln_faults_slowness(&settings->faults, (uint32_t)b->params->rank);
    b->report = report;
    /* another pass may be many times slower: its first batch must be short */
    if (b->pass != report->step.pass || b->with != report->step.with)
        b->rate = RATE_START * b->params->threads * kiln_company_weight(b->company, &report->step);
    b->pass = report->step.pass;
    b->with = report->step.with;
    b->status = report->step.pass->reads_radiosity
                    ? kiln_backend_set_radiosity(b->params->backend, b->solution->radiosity, error)
                    : KILN_OK;
    kiln_work_queue_set_speed(b->solution->own->queue, kiln_batch_speed(b));
}

int kiln_batches_run(struct kiln_batches *b, enum kiln_event *event, struct kiln_error *error)
{
    do
        *event = do_next(b, error);
    while (*event == KILN_EVENT_NONE);
    return *event == KILN_EVENT_FAIL || *event == KILN_EVENT_DONE
               ? kiln_agree(b->params->communicator, b->status, error)
               : KILN_OK;
}

void kiln_batches_release(struct kiln_batches *batches) { kiln_free(&batches->selections); }
