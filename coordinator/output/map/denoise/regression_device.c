#include "coordinator/output/map/denoise/regression_device.h"

#include <pthread.h>
#include <string.h>

#include "worker/backend/extended.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

/* Largest number of points that go to the device together, unless one lightmap has more: enough to keep it busy for
 * some milliseconds, with arrays that stay on it for the next works. */
enum { TOGETHER = 1 << 18 };

/* A regression that a thread waits for. Input and output of a small one lie in arrays, which its own thread fills and
 * reads while the device computes others. */
struct request {
    const struct kiln_regression_work *work;
    struct request *next;
    struct kiln_gpu_regression_point *points; /* NULL: there are no arrays */
    struct kiln_gpu_regression_given *given;
    struct kiln_gpu_regression_result *results;
    size_t first; /* index of its first point among those of all requests run together */
    bool ended, done;
    bool together; /* the results lie in the array */
    int status;
    struct kiln_error error;
    struct kiln_arena arena;
};

struct kiln_regression_device {
    struct kiln_backend *backend;
    pthread_mutex_t lock; /* of what follows */
    pthread_cond_t changed;
    struct request *waiting, **end; /* in the order in which they came */
    bool busy;                      /* a thread has the device */
};

int kiln_regression_device_create(struct kiln_regression_device **device, struct kiln_backend *backend,
                                  struct kiln_error *error)
{
    *device = NULL;
    const int status = kiln_allocate(device, 1, sizeof **device, "denoising on a device", error);
    if (status != KILN_OK)
        return status;
    (*device)->backend = backend;
    (*device)->end = &(*device)->waiting;
    (void)pthread_mutex_init(&(*device)->lock, NULL);
    (void)pthread_cond_init(&(*device)->changed, NULL);
    return KILN_OK;
}

void kiln_regression_device_destroy(struct kiln_regression_device **device)
{
    if (*device == NULL)
        return;
    (void)pthread_cond_destroy(&(*device)->changed);
    (void)pthread_mutex_destroy(&(*device)->lock);
    kiln_free(device);
}

/* ---- several works as one ---- */

struct joined {
    struct request *first;
    struct kiln_regression_work work;
    uint32_t *cells, *firsts, (*ranges)[2];
    struct kiln_arena arena;
};

/* Calls `some` for each request that has some of the points [first, first + count), with its first such point, their
 * number, and their place in the arrays. */
static void split(const struct joined *j, size_t first, size_t count,
                  void (*some)(const struct request *request, size_t first, size_t count, size_t at, void *arrays),
                  void *arrays)
{
    for (const struct request *r = j->first; r != NULL; r = r->next) {
        const size_t begin = first > r->first ? first : r->first, last = r->first + r->work->count,
                     end = first + count < last ? first + count : last;
        if (begin < end)
            some(r, begin - r->first, end - begin, begin - first, arrays);
    }
}

struct given {
    struct kiln_gpu_regression_point *points;
    struct kiln_gpu_regression_given *given;
};

static void give_some(const struct request *r, size_t first, size_t count, size_t at, void *arrays)
{
    const struct given *to = arrays;
    const size_t lights = r->work->lights;
    memcpy(to->points + at, r->points + first, count * sizeof *to->points);
    memcpy(to->given + at * lights, r->given + first * lights, count * lights * sizeof *to->given);
}

static void give(void *context, size_t first, size_t count, struct kiln_gpu_regression_point *points,
                 struct kiln_gpu_regression_given *given)
{
    struct given to = {points, given};
    split(context, first, count, give_some, &to);
}

static void take_some(const struct request *r, size_t first, size_t count, size_t at, void *arrays)
{
    const struct kiln_gpu_regression_result *results = arrays;
    const size_t lights = r->work->lights;
    memcpy(r->results + first * lights, results + at * lights, count * lights * sizeof *results);
}

static void take(void *context, size_t first, size_t count, const struct kiln_gpu_regression_result *results)
{
    split(context, first, count, take_some, (void *)(uintptr_t)results);
}

/* Renumbers cells, ranges and places, so that the numbers of each request follow those of the one before. */
static void join_cells(struct joined *j)
{
    uint32_t place = 0, cell = 0, range = 0;
    for (const struct request *r = j->first; r != NULL; r = r->next) {
        const struct kiln_regression_work *w = r->work;
        const uint32_t ranges = w->first[w->cell_count];
        for (uint32_t i = 0; i < w->count; i++)
            j->cells[place + i] = w->cells[i] + cell;
        for (uint32_t i = 0; i < w->cell_count; i++)
            j->firsts[cell + i] = w->first[i] + range;
        for (uint32_t i = 0; i < ranges; i++)
            for (int k = 0; k < 2; k++)
                j->ranges[range + i][k] = w->ranges[i][k] + place;
        place += w->count;
        cell += (uint32_t)w->cell_count;
        range += ranges;
    }
    j->firsts[cell] = range;
}

static int join(struct joined *j, struct kiln_error *error)
{
    static const char what[] = "denoising on a device";
    size_t points = 0, cells = 0, ranges = 0;
    for (struct request *r = j->first; r != NULL; r = r->next) {
        r->first = points;
        points += r->work->count;
        cells += r->work->cell_count;
        ranges += r->work->first[r->work->cell_count];
    }
    int status;
    KILN_TRY(kiln_arena_allocate_bare(&j->arena, &j->cells, points, sizeof *j->cells, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&j->arena, &j->firsts, cells + 1, sizeof *j->firsts, what, error));
    KILN_TRY(kiln_arena_allocate_bare(&j->arena, &j->ranges, ranges, sizeof *j->ranges, what, error));
    join_cells(j);
end:
    j->work = (struct kiln_regression_work){.count = (uint32_t)points,
                                            .lights = j->first->work->lights,
                                            .cells = j->cells,
                                            .cell_count = cells,
                                            .first = j->firsts,
                                            .ranges = (const uint32_t(*)[2])j->ranges,
                                            .give = give,
                                            .take = take,
                                            .context = j};
    return status;
}

/* Does all of them as one. */
static int run_joined(struct kiln_backend *backend, struct request *first, bool *done, struct kiln_error *error)
{
    struct joined j = {.first = first};
    int status = join(&j, error);
    if (status == KILN_OK)
        status = kiln_backend_regress(backend, &j.work, done, error);
    kiln_arena_release(&j.arena);
    return status;
}

/* Runs requests with arrays together, or a single one without. */
static void run_list(struct kiln_backend *backend, struct request *first)
{
    struct kiln_error ignored;
    bool done = false;
    if (first->points != NULL && run_joined(backend, first, &done, &ignored) != KILN_OK)
        done = false;
    for (struct request *r = first; r != NULL; r = r->next) {
        r->together = done;
        if (done)
            r->done = true;
        else
            r->status = kiln_backend_regress(backend, r->work, &r->done, &r->error);
    }
}

/* ---- taking turns ---- */

/* Takes requests from the front of the queue: at least one, and more while their points fit together. */
static struct request *take_turn(struct kiln_regression_device *d)
{
    struct request *const first = d->waiting, *last = first;
    uint64_t points = first->work->count, ranges = first->work->first[first->work->cell_count];
    while (last->next != NULL && first->points != NULL && last->next->points != NULL) {
        const struct kiln_regression_work *w = last->next->work;
        points += w->count;
        ranges += w->first[w->cell_count];
        if (points > TOGETHER || ranges > UINT32_MAX)
            break;
        last = last->next;
    }
    d->waiting = last->next;
    if (d->waiting == NULL)
        d->end = &d->waiting;
    last->next = NULL;
    return first;
}

/* Runs queued requests on the device. Holds the lock, but releases it while the device computes. */
static void serve(struct kiln_regression_device *d)
{
    struct request *const first = take_turn(d);
    d->busy = true;
    (void)pthread_mutex_unlock(&d->lock);
    run_list(d->backend, first);
    (void)pthread_mutex_lock(&d->lock);
    d->busy = false;
    for (struct request *r = first, *next; r != NULL; r = next) {
        next = r->next; /* its thread may go on at once */
        r->ended = true;
    }
    (void)pthread_cond_broadcast(&d->changed);
}

/* Allocates the request's arrays and fills the input. There are none if it has more than TOGETHER points, or if memory
 * is short. It then goes to the device alone, which asks for its points by work->give. */
static void make_arrays(struct request *r)
{
    static const char what[] = "denoising on a device";
    const size_t count = r->work->count, lights = r->work->lights;
    int status = KILN_OK;
    if (count > TOGETHER)
        return;
    status = kiln_arena_allocate_bare(&r->arena, &r->given, count * lights, sizeof *r->given, what, NULL);
    if (status == KILN_OK)
        status = kiln_arena_allocate_bare(&r->arena, &r->results, count * lights, sizeof *r->results, what, NULL);
    if (status == KILN_OK)
        status = kiln_arena_allocate_bare(&r->arena, &r->points, count, sizeof *r->points, what, NULL);
    if (status == KILN_OK)
        r->work->give(r->work->context, 0, count, r->points, r->given);
}

static void free_arrays(struct request *r) { kiln_arena_release(&r->arena); }

/* Queues a request and waits until it is done. If no thread uses the device, runs all queued requests. */
static void wait_for(struct kiln_regression_device *d, struct request *own)
{
    (void)pthread_mutex_lock(&d->lock);
    *d->end = own;
    d->end = &own->next;
    while (!own->ended)
        if (d->busy)
            (void)pthread_cond_wait(&d->changed, &d->lock);
        else
            serve(d);
    (void)pthread_mutex_unlock(&d->lock);
}

int kiln_regression_device_run(struct kiln_regression_device *d, const struct kiln_regression_work *work, bool *done,
                               struct kiln_error *error)
{
    struct request own = {.work = work, .status = KILN_OK};
    *done = false;
    if (work->count == 0)
        return KILN_OK;
    make_arrays(&own);
    wait_for(d, &own);
    if (own.together)
        work->take(work->context, 0, work->count, own.results);
    free_arrays(&own);
    *done = own.done;
    if (own.status != KILN_OK && error != NULL)
        *error = own.error;
    return own.status;
}
