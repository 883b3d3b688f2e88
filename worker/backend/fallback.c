#include "worker/backend/fallback.h"

#include <stdio.h>
#include <string.h>

#include "worker/backend/api.h"
#include "worker/base/memory.h"

struct fallback_backend {
    struct kiln_backend base;
    struct kiln_backend_api api;          /* the device's name, our functions */
    struct kiln_backend *device, *embree; /* one of them is NULL */
    struct kiln_backend_info last;        /* information on the device when it was given up */
};

/* ---- changing over ---- */

static struct kiln_backend *present(const struct kiln_backend *backend)
{
    const struct fallback_backend *f = (const struct fallback_backend *)backend;
    return f->embree != NULL ? f->embree : f->device;
}

/* Handles `status` of a call on the device: returns KILN_OK if Embree has taken over and the call must be repeated. */
static int change_over(struct kiln_backend *backend, int status, struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    struct kiln_backend *embree = NULL;
    struct kiln_error other;
    if (status != KILN_NO_DEVICE || f->embree != NULL)
        return status;
    if (kiln_backend_create(&embree, "embree", &f->base.params, &other) != KILN_OK)
        return status;
    int result = KILN_OK;
    for (int r = 0; r < KILN_RESOURCE_COUNT && result == KILN_OK; r++)
        if (kiln_resource_is_given(&f->base.given, (enum kiln_resource_index)r))
            result = kiln_backend_give(embree, (enum kiln_resource_index)r, &f->base.given, &other);
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

struct watched_run {
    const struct kiln_batch *batch; /* the caller's */
    size_t next;                    /* first item not handed over; or, if items differ in their samples, */
    uint32_t *left;                 /* number of samples of each, 0 once handed over; else NULL */
    size_t end;                     /* end of the items claimed so far */
    int taken;                      /* what the caller said last */
};

/* kiln_take_results callback that records its progress. */
static int take_part(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    struct watched_run *w = context;
    if (w->batch->take != NULL)
        w->taken = w->batch->take(w->batch->context, first, count, results, error);
    w->next = first + count;
    if (w->left != NULL)
        memset(w->left + (first - w->batch->first), 0, count * sizeof *w->left);
    return w->taken;
}

/* Likewise kiln_take_some; the items that are left out have no samples in `left` either. */
static int take_some(void *context, size_t first, size_t count, const uint32_t *samples, const void *results,
                     struct kiln_error *error)
{
    struct watched_run *w = context;
    w->taken = w->batch->take_some(w->batch->context, first, count, samples, results, error);
    for (size_t i = 0; i < count; i++)
        if (samples[i] > 0)
            w->left[first + i - w->batch->first] = 0;
    return w->taken;
}

/* kiln_claims callback that records its progress. */
static size_t claim_part(void *context, size_t first, size_t count)
{
    struct watched_run *w = context;
    const struct kiln_claims *claims = w->batch->claims;
    const size_t claimed = claims->claim(claims->context, first, count);
    w->end = first + claimed;
    return claimed;
}

/* Returns the claimed items that have not been handed over. `left` must outlive the result. */
static struct kiln_batch rest_of(const struct watched_run *w)
{
    const struct kiln_batch *batch = w->batch;
    const size_t first = w->left == NULL ? w->next : batch->first;
    struct kiln_batch rest = kiln_batch_range(batch, first, w->end - first);
    if (w->left != NULL)
        rest.samples_each = w->left;
    return rest;
}

/* Runs the pass, and keeps results that the device has handed over. If the device fails, Embree computes the rest. */
static int fallback_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                        const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    struct watched_run w = {
        .batch = batch, .next = batch->first, .end = batch->first + (batch->claims == NULL ? batch->count : 0)};
    const struct kiln_claims claims = {claim_part, &w};
    struct kiln_batch watched = kiln_batch_taken_by(batch, take_part, &w);
    watched.claims = batch->claims != NULL ? &claims : NULL;
    watched.take_some =
        batch->take != NULL && batch->take_some != NULL && batch->samples_each != NULL ? take_some : NULL;
    int status = KILN_OK;
    if (batch->samples_each != NULL)
        status = kiln_allocate(&w.left, batch->count, sizeof *w.left, "the samples of a batch's items", error);
    if (status == KILN_OK) {
        if (w.left != NULL)
            memcpy(w.left, batch->samples_each, batch->count * sizeof *w.left);
        status = kiln_backend_run(present(backend), pass, parameters, &watched, rays, error);
        if (status != KILN_OK && w.taken == KILN_OK && (status = change_over(backend, status, error)) == KILN_OK) {
            const struct kiln_batch rest = rest_of(&w);
            status = kiln_backend_run(present(backend), pass, parameters, &rest, rays, error);
        }
    }
    kiln_free(&w.left);
    return status;
}

/* Sets a resource. Embree gets all of them when it takes over. */
static int fallback_set(struct kiln_backend *backend, enum kiln_resource_index index, struct kiln_error *error)
{
    const int status = kiln_backend_give(present(backend), index, &backend->given, error);
    return status != KILN_OK ? change_over(backend, status, error) : KILN_OK;
}

static void fallback_info(const struct kiln_backend *backend, struct kiln_backend_info *info)
{
    const struct fallback_backend *f = (const struct fallback_backend *)backend;
    kiln_backend_info(present(backend), info);
    info->fell_back = f->embree != NULL;
    info->device_seconds += f->last.device_seconds;
    info->once_seconds += f->last.once_seconds;
    info->once_processor += f->last.once_processor;
    info->returned += f->last.returned;
    info->recoveries += f->last.recoveries;
    info->kernels_found += f->last.kernels_found;
    info->kernels_made += f->last.kernels_made;
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
                                       .set = fallback_set,
                                       .mixed = UINT32_MAX,
                                       .claims = UINT32_MAX,
                                       .run = fallback_run,
                                       .extras = f->device->api->extras,
                                       .inner = present,
                                       .replace = change_over};
    f->base = (struct kiln_backend){.api = &f->api, .params = *params};
    *backend = &f->base;
    return KILN_OK;
}
