#include <assert.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "coordinator/integrate/transport_private.h"
#include "coordinator/mpi/agree.h"

enum { LEAVES = 8 };     /* a batch takes at most one part in so many of what is left */
#define LEAST_HELP 0.005 /* s of work that is left to a rank, for others to take any of it */

void transport_offer(struct transport_state *s)
{
    kiln_work_queue_begin(s->own->queue);
    s->sent = 0;
    s->held = false;
    if (s->todo_first < s->todo_count)
        kiln_work_queue_open(s->own->queue, s->todo[s->todo_first]);
}

void transport_settle(struct transport_state *s)
{
    if (kiln_node_data_count(s->out->node_data) > 1)
        kiln_node_wait(s->params->node); /* whoever comes here has returned what it took */
    assert(kiln_work_queue_away(s->own->queue) == 0);
    if (s->todo_first < s->todo_count)
        s->todo[s->todo_first] = kiln_work_queue_left(s->own->queue);
}

void transport_send_done(struct transport_state *s, size_t end)
{
    const struct kiln_surface *surface = s->params->surface;
    if (kiln_work_queue_away(s->own->queue) == 0)
        s->held = false;
    if (!s->held)
        s->sent = end;
    if (s->early && surface->tile_run_count > 0)
        kiln_radiosity_allgather_advance(
            s->out->allgather, s->own->next,
            s->sent < surface->tile_run_count ? surface->tile_runs[s->sent].first - surface->first : surface->count);
}

/* ---- how much ---- */

/* Points of a range: tile runs follow one another. */
static uint64_t points_of(const struct kiln_surface *surface, struct kiln_range range)
{
    if (range.count == 0)
        return 0;
    const struct kiln_tile_run *last = &surface->tile_runs[range.first + range.count - 1];
    return last->first + last->count - surface->tile_runs[range.first].first;
}

/* points a second */
static double speed_of(const struct transport_state *s) { return s->rate / (double)s->step.samples; }

/* How many tile runs of what is left of the own work make a batch: one a thread at least, so that no core is idle;
 * towards the end of the pass less and less, so that others can take the rest. */
static size_t batch_of(const struct transport_state *s, struct kiln_range left)
{
    const struct kiln_tile_run *tile_runs = s->params->surface->tile_runs + left.first;
    const int ranks = kiln_node_data_count(s->out->node_data), parts = ranks < LEAVES ? ranks : LEAVES;
    double wanted = speed_of(s) * kiln_control_batch_seconds(s->params->control);
    if (ranks > 1)
        wanted =
            fmin(wanted, fmax((double)points_of(s->params->surface, left) / parts, KILN_LEAST_BATCH * speed_of(s)));
    size_t count = 0;
    for (uint64_t points = 0; count < left.count && (count < s->params->threads || (double)points < wanted); count++)
        points += tile_runs[count].count;
    return count;
}

/* The same from the end, of what another rank could do without: half of what makes both end at the same time, for there
 * may be more helpers. */
static size_t help_of(const struct transport_state *s, const struct kiln_rank_data *share, struct kiln_range left)
{
    const struct kiln_tile_run *end = share->surface.tile_runs + left.first + left.count;
    const double own = speed_of(s), theirs = kiln_work_queue_speed(share->queue);
    const double fair = 0.5 * (double)points_of(&share->surface, left) * own / (own + theirs);
    const double wanted = fmin(fmax(fair, LEAST_HELP * own), own * kiln_control_batch_seconds(s->params->control));
    size_t count = 0;
    for (uint64_t points = 0; count < left.count && (count < s->params->threads || (double)points < wanted);)
        points += (end - ++count)->count;
    return count;
}

/* A batch's speed; not believed at once when it is much higher than before, as a device's first launches are slow. */
static void note_rate(struct transport_state *s, uint64_t points, double seconds)
{
    const double rate = (double)points * (double)s->step.samples / fmax(seconds, 1e-6);
    s->rate = fmin(rate, 4.0 * s->rate);
    kiln_work_queue_set_speed(s->own->queue, speed_of(s));
}

/* ---- batches ---- */

static void be_slow(const struct transport_state *s, double seconds)
{
    const double more = (s->slowness - 1.0) * seconds, whole = floor(more);
    const struct timespec pause = {(time_t)whole, (long)(1e9 * (more - whole))};
    if (more > 0.0)
        (void)nanosleep(&pause, NULL);
}

/* Traces a range of a share, the own or another's. */
static int run_batch(struct pass_work *w, const struct kiln_rank_data *share, struct kiln_range range, double *seconds,
                     struct kiln_error *error)
{
    struct kiln_backend_info begin, end;
    struct transport_state *s = w->state;
    const struct kiln_transport_params *p = s->params;
    const struct kiln_pass *const pass = s->step.kind == KILN_PASS_DIRECT ? &kiln_pass_direct : &kiln_pass_gather;
    const struct kiln_batch batch = {.first = range.first,
                                     .count = range.count,
                                     .stream = s->step.stream,
                                     .samples = s->step.samples,
                                     .take = transport_take_part,
                                     .context = w};
    assert(share == s->own || pass->is_stealable);
    w->share = share;
    w->points = 0;
    kiln_backend_info(p->backend, &begin);
    const double start = MPI_Wtime();
    w->since = start;
    const int status = kiln_backend_run(p->backend, pass, NULL, &batch, &w->pass->rays, error);
    be_slow(s, MPI_Wtime() - start);
    *seconds = MPI_Wtime() - start;
    kiln_backend_info(p->backend, &end);
    w->pass->seconds += *seconds;
    kiln_trace_add(p->trace, share == s->own ? KILN_TRACE_BATCH : KILN_TRACE_HELP, "batch", start, start + *seconds,
                   (int64_t)w->points);
    w->pass->device_seconds += fmax(0.0, end.device_seconds - begin.device_seconds);
    note_rate(s, w->points, *seconds);
    return status;
}

/* Whether any of the own work is left to take; goes on to the next range when the present one is gone. */
static bool has_own(struct transport_state *s)
{
    while (s->todo_first < s->todo_count && kiln_work_queue_left(s->own->queue).count == 0) {
        if (++s->todo_first == s->todo_count)
            break;
        s->held = s->held || kiln_work_queue_away(s->own->queue) > 0;
        kiln_work_queue_open(s->own->queue, s->todo[s->todo_first]);
    }
    return s->todo_first < s->todo_count;
}

static int run_own(struct pass_work *w, double *seconds, struct kiln_error *error)
{
    struct transport_state *s = w->state;
    struct kiln_range left;
    size_t count;
    do {
        left = kiln_work_queue_left(s->own->queue);
        count = batch_of(s, left);
    } while (!kiln_work_queue_take(s->own->queue, left, count));
    *seconds = 0.0;
    return count > 0 ? run_batch(w, s->own, (struct kiln_range){left.first, count}, seconds, error) : KILN_OK;
}

/* Whose work of the node is expected to last longest, and what is left of it; NULL where nobody needs help. */
static const struct kiln_rank_data *who_is_behind(const struct transport_state *s, struct kiln_range *left)
{
    const struct kiln_node_data *node_data = s->out->node_data;
    const struct kiln_rank_data *last = NULL;
    double longest = LEAST_HELP;
    for (int i = 0; i < kiln_node_data_count(node_data); i++) {
        const struct kiln_rank_data *share = kiln_rank_data(node_data, i);
        const struct kiln_range there = kiln_work_queue_left(share->queue);
        const double seconds =
            share == s->own ? 0.0 : (double)points_of(&share->surface, there) / kiln_work_queue_speed(share->queue);
        if (seconds > longest) {
            longest = seconds;
            last = share;
            *left = there;
        }
    }
    return last;
}

/* Computes a part of another rank's work, unless somebody was quicker. */
static int run_help(struct pass_work *w, const struct kiln_rank_data *share, struct kiln_range left, double *seconds,
                    struct kiln_error *error)
{
    struct transport_state *s = w->state;
    const size_t count = help_of(s, share, left);
    const struct kiln_range range = {left.first + left.count - count, count};
    const uint64_t points = points_of(&share->surface, range);
    *seconds = 0.0;
    if (!kiln_work_queue_steal(share->queue, left, count, points))
        return KILN_OK;
    int status = kiln_backend_set_surface(s->params->backend, &share->surface, error);
    if (status == KILN_OK)
        status = run_batch(w, share, range, seconds, error);
    if (status == KILN_OK)
        status = kiln_backend_set_surface(s->params->backend, s->params->surface, error);
    if (status != KILN_OK)
        return status; /* it stays away, and this rank's failure ends the pass */
    kiln_work_queue_return(share->queue, points);
    w->pass->taken += points;
    return KILN_OK;
}

/* ---- the pass ---- */

static uint64_t done_points(const struct transport_state *s)
{
    return s->points_done + kiln_work_queue_returned(s->own->queue);
}

static bool is_done(const struct transport_state *s) { return done_points(s) == s->params->surface->count; }

static double share_done(const struct transport_state *s)
{
    const uint64_t count = s->params->surface->count;
    return count > 0 ? (double)done_points(s) / (double)count : 1.0;
}

/* What a rank without own work to take waits for. */
struct wait {
    const struct transport_state *state;
    bool was_done, may_help;
};

static bool has_news(void *context)
{
    const struct wait *wait = context;
    struct kiln_range left;
    return is_done(wait->state) != wait->was_done || (wait->may_help && who_is_behind(wait->state, &left) != NULL);
}

static enum kiln_event wait_for_others(struct transport_state *s, int status)
{
    struct wait wait = {s, is_done(s), status == KILN_OK};
    const double start = MPI_Wtime();
    transport_send_done(s,
                        wait.was_done ? s->params->surface->tile_run_count : kiln_work_queue_left(s->own->queue).first);
    kiln_progress_advance(s->params->progress, done_points(s));
    const enum kiln_event event =
        kiln_control_wait(s->params->control, wait.was_done, share_done(s), status, has_news, &wait);
    const double end = MPI_Wtime();
    s->out->report.waiting_seconds += end - start;
    kiln_trace_add(s->params->trace, KILN_TRACE_WAIT, "for other ranks", start, end, -1);
    return event;
}

/* The next thing for this rank to do, and what the others say to it. */
static enum kiln_event do_next(struct pass_work *w, int *status, struct kiln_error *error)
{
    struct transport_state *s = w->state;
    struct kiln_range left;
    double seconds;
    if (*status == KILN_OK && has_own(s)) {
        *status = run_own(w, &seconds, error);
    } else {
        const struct kiln_rank_data *behind = *status == KILN_OK ? who_is_behind(s, &left) : NULL;
        if (behind == NULL)
            return wait_for_others(s, *status);
        transport_send_done(s, is_done(s) ? s->params->surface->tile_run_count
                                          : kiln_work_queue_left(s->own->queue).first);
        *status = run_help(w, behind, left, &seconds, error);
    }
    return kiln_control_poll(s->params->control, is_done(s), share_done(s), seconds, *status);
}

int transport_run_batches(struct pass_work *w, struct kiln_error *error)
{
    struct transport_state *s = w->state;
    int status = s->step.kind == KILN_PASS_DIRECT
                     ? KILN_OK
                     : kiln_backend_set_radiosity(s->params->backend, s->out->radiosity, error);
    kiln_work_queue_set_speed(s->own->queue, speed_of(s));
    for (;;) {
        switch (do_next(w, &status, error)) {
        case KILN_EVENT_NONE:
            break;
        case KILN_EVENT_SAVE: {
            const int saved = transport_save(s, false, error);
            if (saved != KILN_OK)
                return saved;
            break;
        }
        case KILN_EVENT_STOP:
            return transport_stop(s, false, error);
        case KILN_EVENT_FAIL:
        case KILN_EVENT_DONE:
            return kiln_agree(s->params->communicator, status, error);
        }
    }
}

int kiln_slow_rank(uint32_t *rank, double *factor, struct kiln_error *error)
{
    const char *text = getenv("KILN_SLOW_RANK");
    int end = 0;
    *rank = 0;
    *factor = 1.0;
    if (text == NULL || text[0] == '\0')
        return KILN_OK;
    if (sscanf(text, "%" SCNu32 ":%lf%n", rank, factor, &end) < 2 || text[end] != '\0' ||
        !(*factor >= 1.0 && *factor <= 1e6))
        return kiln_fail(error, KILN_USAGE,
                         "KILN_SLOW_RANK is '%.100s'; it is RANK:FACTOR, and the factor 1 to 1000000", text);
    return KILN_OK;
}

int transport_read_slowness(struct transport_state *s, struct kiln_error *error)
{
    uint32_t rank;
    const int status = kiln_slow_rank(&rank, &s->slowness, error);
    if (rank != (uint32_t)s->params->rank)
        s->slowness = 1.0;
    return status;
}
