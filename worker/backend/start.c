#include "worker/backend/start.h"

#include <math.h>

#include "worker/backend/api.h"
#include "worker/base/memory.h"
#include "worker/base/thread.h"

struct kiln_backend_start {
    pthread_t thread;
    bool runs, best; /* best: of "auto" */
    const struct kiln_backend_api *api;
    struct kiln_backend_params params;
    bool has_gpu; /* looked for where `best` */
    bool taken;
    struct kiln_backend *backend;
    int status;
    struct kiln_error error;
    struct kiln_aside aside;
};

static bool find_gpu(const struct kiln_backend_api *api)
{
    enum { MOST = 64 };
    struct kiln_device list[MOST];
    size_t count = 0;
    if (api->devices(list, MOST, &count, NULL) != KILN_OK)
        return false;
    for (size_t i = 0; i < count && i < MOST; i++)
        if (list[i].fit && !list[i].software)
            return true;
    return false;
}

static void *run(void *context)
{
    struct kiln_backend_start *s = context;
    s->aside.begin = kiln_clock_seconds();
    s->has_gpu = s->best && find_gpu(s->api);
    if (s->has_gpu || !s->best)
        s->status = s->api->begin(&s->backend, &s->params, &s->error);
    s->aside.end = kiln_clock_seconds();
    return NULL;
}

void kiln_backend_start_run(struct kiln_backend_start **start, const struct kiln_backend_api *api, bool best,
                            const struct kiln_backend_params *params)
{
    struct kiln_backend_start *s = NULL;
    *start = NULL;
    if (kiln_allocate(&s, 1, sizeof *s, "the start of a device", NULL) != KILN_OK)
        return;
    s->best = best;
    s->api = api;
    s->params = *params;
    s->aside.count = 1;
    s->runs = kiln_thread_start(&s->thread, run, s);
    if (s->runs)
        *start = s;
    else
        kiln_free(&s);
}

/* Waits for the thread. */
static void join(struct kiln_backend_start *s)
{
    const double start = kiln_clock_seconds();
    if (!s->runs)
        return;
    (void)pthread_join(s->thread, NULL);
    s->runs = false;
    s->aside.waited = fmax(s->aside.end - fmax(start, s->aside.begin), 0.0);
}

bool kiln_backend_has_gpu(struct kiln_backend_start *start, const struct kiln_backend_api *api)
{
    if (start == NULL || !start->best)
        return find_gpu(api);
    join(start);
    return start->has_gpu;
}

bool kiln_backend_start_take(struct kiln_backend_start *start, const struct kiln_backend_api *api,
                             struct kiln_backend **backend, int *status, struct kiln_error *error)
{
    if (start == NULL || start->api != api || start->taken)
        return false;
    join(start);
    if (start->best && !start->has_gpu)
        return false;
    start->taken = true;
    *backend = start->backend;
    *status = start->status;
    if (*backend != NULL)
        (*backend)->starting = start->aside;
    if (*status != KILN_OK && error != NULL)
        *error = start->error;
    return true;
}

void kiln_backend_start_end(struct kiln_backend_start **start)
{
    struct kiln_backend_start *s = *start;
    if (s == NULL)
        return;
    join(s);
    if (!s->taken && s->backend != NULL)
        s->api->destroy(&s->backend);
    kiln_free(start);
}
