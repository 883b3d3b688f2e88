#include "worker/backend/fallback.h"

#include <stdio.h>
#include <string.h>

#include "worker/base/memory.h"

struct fallback_backend {
    struct kiln_backend base;
    struct kiln_backend_api api;          /* the device's name, our functions */
    struct kiln_backend *device, *embree; /* one of them is NULL */
    struct kiln_backend_info last;        /* of the device, when it was given up */
    const struct kiln_surface *surface;
    const uint64_t *radiosity;
};

/* ---- changing over ---- */

static struct kiln_backend *present(struct fallback_backend *f) { return f->embree != NULL ? f->embree : f->device; }

/* After a call on the device returned `status`: KILN_OK when Embree has taken over and the call is to be made again. */
static int change_over(struct fallback_backend *f, int status, struct kiln_error *error)
{
    struct kiln_backend *embree = NULL;
    struct kiln_error other;
    if (status != KILN_NO_DEVICE || f->embree != NULL)
        return status;
    if (kiln_backend_create(&embree, "embree", &f->base.params, &other) != KILN_OK)
        return status;
    int result = f->surface != NULL ? kiln_backend_set_surface(embree, f->surface, &other) : KILN_OK;
    if (result == KILN_OK && f->radiosity != NULL)
        result = kiln_backend_set_radiosity(embree, f->radiosity, &other);
    if (result != KILN_OK) {
        kiln_backend_destroy(&embree);
        return status;
    }
    (void)fprintf(stderr, "kiln: warning: %s; going on with Embree\n",
                  error != NULL ? error->message : "the device failed");
    if (error != NULL)
        error->message[0] = '\0';
    f->embree = embree;
    kiln_backend_info(f->device, &f->last);
    kiln_backend_destroy(&f->device);
    return KILN_OK;
}

/* ---- passes ---- */

struct watched_pass {
    const struct kiln_batch *batch; /* the caller's */
    size_t next;                    /* first tile run not handed over */
    int taken;                      /* what the caller said last */
};

/* kiln_take_results that remembers how far it came. */
static int take_part(void *context, size_t tile_run_first, size_t tile_run_count,
                     const struct kiln_point_result *results, struct kiln_error *error)
{
    struct watched_pass *w = context;
    if (w->batch->take != NULL)
        w->taken = w->batch->take(w->batch->context, tile_run_first, tile_run_count, results, error);
    w->next = tile_run_first + tile_run_count;
    return w->taken;
}

typedef int (*trace_batch)(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples,
                           uint32_t stream, uint64_t *rays, struct kiln_error *error);

static int trace_direct(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint32_t stream,
                        uint64_t *rays, struct kiln_error *error)
{
    (void)stream;
    return kiln_backend_direct(backend, batch, samples, rays, error);
}

static int run_pass(struct fallback_backend *f, trace_batch trace, const struct kiln_batch *batch, uint32_t samples,
                    uint32_t stream, uint64_t *rays, struct kiln_error *error)
{
    struct watched_pass w = {.batch = batch, .next = batch->tile_run_first};
    const struct kiln_batch all = {batch->tile_run_first, batch->tile_run_count, take_part, &w};
    int status = trace(present(f), &all, samples, stream, rays, error);
    if (status == KILN_OK || w.taken != KILN_OK)
        return status;
    status = change_over(f, status, error);
    const struct kiln_batch rest = {w.next, batch->tile_run_first + batch->tile_run_count - w.next, batch->take,
                                    batch->context};
    return status == KILN_OK ? trace(f->embree, &rest, samples, stream, rays, error) : status;
}

static int fallback_direct(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples,
                           uint64_t *rays, struct kiln_error *error)
{
    return run_pass((struct fallback_backend *)backend, trace_direct, batch, samples, 0, rays, error);
}

static int fallback_gather(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples,
                           uint32_t stream, uint64_t *rays, struct kiln_error *error)
{
    return run_pass((struct fallback_backend *)backend, kiln_backend_gather, batch, samples, stream, rays, error);
}

/* ---- calls that are made again as a whole ---- */

static int fallback_validity(struct kiln_backend *backend, size_t tile_run_first, size_t tile_run_count,
                             uint16_t *visible, struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    int status = kiln_backend_validity(present(f), tile_run_first, tile_run_count, visible, error);
    if (status != KILN_OK && (status = change_over(f, status, error)) == KILN_OK)
        status = kiln_backend_validity(f->embree, tile_run_first, tile_run_count, visible, error);
    return status;
}

static int fallback_probes(struct kiln_backend *backend, const struct kiln_vec3 *positions, size_t count,
                           uint64_t index_first, uint32_t samples, struct kiln_probe_result *results, uint64_t *rays,
                           struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    int status = kiln_backend_probes(present(f), positions, count, index_first, samples, results, rays, error);
    if (status != KILN_OK && (status = change_over(f, status, error)) == KILN_OK)
        status = kiln_backend_probes(f->embree, positions, count, index_first, samples, results, rays, error);
    return status;
}

static int fallback_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                              const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                              struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    int status = kiln_backend_intersect(present(f), origins, directions, count, hits, error);
    if (status != KILN_OK && (status = change_over(f, status, error)) == KILN_OK)
        status = kiln_backend_intersect(f->embree, origins, directions, count, hits, error);
    return status;
}

static int fallback_set_surface(struct kiln_backend *backend, const struct kiln_surface *surface,
                                struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    f->surface = surface;
    f->radiosity = NULL;
    const int status = kiln_backend_set_surface(present(f), surface, error);
    return status != KILN_OK ? change_over(f, status, error) : KILN_OK; /* which hands it over too */
}

static int fallback_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    f->radiosity = radiosity;
    const int status = kiln_backend_set_radiosity(present(f), radiosity, error);
    return status != KILN_OK ? change_over(f, status, error) : KILN_OK;
}

/* A measurement of the device: no other one will do. */
static int fallback_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples,
                            uint32_t stream, double *seconds, uint64_t *rays, struct kiln_error *error)
{
    return kiln_backend_ceiling(present((struct fallback_backend *)backend), batch, samples, stream, seconds, rays,
                                error);
}

static void fallback_info(const struct kiln_backend *backend, struct kiln_backend_info *info)
{
    const struct fallback_backend *f = (const struct fallback_backend *)backend;
    kiln_backend_info(f->embree != NULL ? f->embree : f->device, info);
    info->fell_back = f->embree != NULL;
    info->device_seconds += f->last.device_seconds;
    info->recoveries += f->last.recoveries;
}

static void fallback_destroy(struct kiln_backend **backend)
{
    struct fallback_backend *f = (struct fallback_backend *)*backend;
    kiln_backend_destroy(&f->device);
    kiln_backend_destroy(&f->embree);
    kiln_free(backend);
}

int kiln_fallback_create(struct kiln_backend **backend, const struct kiln_backend_params *params,
                         struct kiln_error *error)
{
    struct fallback_backend *f = NULL;
    const int status = kiln_allocate(&f, 1, sizeof *f, "the backend", error);
    if (status != KILN_OK) {
        kiln_backend_destroy(backend);
        return status;
    }
    f->device = *backend;
    f->api = (struct kiln_backend_api){.name = f->device->api->name,
                                       .destroy = fallback_destroy,
                                       .info = fallback_info,
                                       .set_surface = fallback_set_surface,
                                       .set_radiosity = fallback_set_radiosity,
                                       .validity = fallback_validity,
                                       .direct = fallback_direct,
                                       .gather = fallback_gather,
                                       .probes = fallback_probes,
                                       .intersect = fallback_intersect,
                                       .ceiling = fallback_ceiling};
    f->base = (struct kiln_backend){.api = &f->api, .params = *params};
    *backend = &f->base;
    return KILN_OK;
}
