#include "worker/backend/fallback.h"

#include <stdio.h>
#include <string.h>

#include "worker/base/memory.h"

struct fallback_backend {
    struct kiln_backend base;
    struct kiln_backend_api api;          /* the device's name, our functions */
    struct kiln_backend *device, *embree; /* one of them is NULL */
    struct kiln_backend_info last;        /* of the device, when it was given up */
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
    int result = f->base.own != NULL ? kiln_backend_set_surface(embree, f->base.own, &other) : KILN_OK;
    if (result == KILN_OK && f->base.others.surface != NULL)
        result = kiln_backend_set_others(embree, f->base.others, &other);
    if (result == KILN_OK && f->base.radiosity != NULL)
        result = kiln_backend_set_radiosity(embree, f->base.radiosity, &other);
    if (result == KILN_OK && f->base.probes != NULL)
        result = kiln_backend_set_probes(embree, f->base.probes, &other);
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
    size_t next;                    /* first item not handed over; or, where items differ in their samples, */
    uint32_t *left;                 /* the samples of each, 0 once it is handed over; else NULL */
    size_t end;                     /* of the items that are claimed so far */
    int taken;                      /* what the caller said last */
};

/* kiln_take_results that remembers how far it came. */
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

/* kiln_claims that remembers likewise. */
static size_t claim_part(void *context, size_t first, size_t count)
{
    struct watched_run *w = context;
    const struct kiln_claims *claims = w->batch->claims;
    const size_t claimed = claims->claim(claims->context, first, count);
    w->end = first + claimed;
    return claimed;
}

/* What has not been handed over of what was claimed; `left` lasts as long as that. */
static struct kiln_batch rest_of(const struct watched_run *w)
{
    const struct kiln_batch *batch = w->batch;
    const size_t first = w->left == NULL ? w->next : batch->first;
    struct kiln_batch rest = kiln_batch_part(batch, first, w->end - first);
    if (w->left != NULL)
        rest.samples_each = w->left;
    return rest;
}

/* What the device has handed over stands; Embree goes on with what it has not. */
static int fallback_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                        const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    struct watched_run w = {
        .batch = batch, .next = batch->first, .end = batch->first + (batch->claims == NULL ? batch->count : 0)};
    const struct kiln_claims claims = {claim_part, &w};
    struct kiln_batch watched = *batch;
    watched.claims = batch->claims != NULL ? &claims : NULL;
    watched.take = take_part;
    watched.context = &w;
    int status = KILN_OK;
    if (batch->samples_each != NULL)
        status = kiln_allocate(&w.left, batch->count, sizeof *w.left, "the samples of a batch's items", error);
    if (status == KILN_OK) {
        if (w.left != NULL)
            memcpy(w.left, batch->samples_each, batch->count * sizeof *w.left);
        kiln_backend_set_rows(present(f), f->base.rows);
        kiln_backend_set_groups(present(f), f->base.groups);
        status = kiln_backend_run(present(f), pass, parameters, &watched, rays, error);
        if (status != KILN_OK && w.taken == KILN_OK && (status = change_over(f, status, error)) == KILN_OK) {
            const struct kiln_batch rest = rest_of(&w);
            kiln_backend_set_rows(f->embree, f->base.rows);
            kiln_backend_set_groups(f->embree, f->base.groups);
            status = kiln_backend_run(f->embree, pass, parameters, &rest, rays, error);
        }
    }
    kiln_free(&w.left);
    return status;
}

static bool fallback_takes(const struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters)
{
    const struct fallback_backend *f = (const struct fallback_backend *)backend;
    return kiln_backend_takes(f->embree != NULL ? f->embree : f->device, pass, parameters);
}

static void fallback_expect(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    kiln_backend_expect(f->embree != NULL ? f->embree : f->device, pass, parameters);
}

/* ---- calls that are made again as a whole ---- */

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
    const int status = kiln_backend_set_surface(present(f), surface, error);
    return status != KILN_OK ? change_over(f, status, error) : KILN_OK; /* which hands it over too */
}

static int fallback_set_others(struct kiln_backend *backend, const struct kiln_others *others, struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    const int status = kiln_backend_set_others(present(f), *others, error);
    return status != KILN_OK ? change_over(f, status, error) : KILN_OK;
}

static int fallback_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    const int status = kiln_backend_set_radiosity(present(f), radiosity, error);
    return status != KILN_OK ? change_over(f, status, error) : KILN_OK;
}

static int fallback_set_probes(struct kiln_backend *backend, const struct kiln_radiance_probes *probes,
                               struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    const int status = kiln_backend_set_probes(present(f), probes, error);
    return status != KILN_OK ? change_over(f, status, error) : KILN_OK;
}

/* A measurement of the device: no other one will do. */
static int fallback_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds,
                            uint64_t *rays, struct kiln_error *error)
{
    return kiln_backend_ceiling(present((struct fallback_backend *)backend), batch, seconds, rays, error);
}

static int fallback_change_light(struct kiln_backend *backend, struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    const int status = kiln_backend_change_light(present(f), error);
    return status != KILN_OK ? change_over(f, status, error) : KILN_OK;
}

/* What is in memory is the device's: Embree would want more of it. */
static int fallback_replay(struct kiln_backend *backend, struct kiln_rows *rows, const uint64_t *const *lights,
                           size_t count, const struct kiln_batch *batch, struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    return f->embree == NULL ? kiln_backend_replay(f->device, rows, lights, count, batch, error)
                             : kiln_fail(error, KILN_NO_DEVICE,
                                         "the device failed, and kept rays that lie in memory are of no use to "
                                         "Embree: relight again, with --backend embree");
}

/* Light is held by the device or not at all: who asks for it can do without. */
static int fallback_hold(struct kiln_backend *backend, const struct kiln_held *begin, bool *held,
                         struct kiln_held_power *powers, struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    return f->embree == NULL ? kiln_backend_hold(f->device, begin, held, powers, error) : KILN_OK;
}

static int fallback_hold_step(struct kiln_backend *backend, struct kiln_rows *rows, const struct kiln_batch *batch,
                              const struct kiln_held_step *step, struct kiln_held_power *powers,
                              struct kiln_error *error)
{
    return kiln_backend_hold_step(((struct fallback_backend *)backend)->device, rows, batch, step, powers, error);
}

static int fallback_hold_fetch(struct kiln_backend *backend, uint32_t light, const struct kiln_held_fetch *to,
                               struct kiln_error *error)
{
    return kiln_backend_hold_fetch(((struct fallback_backend *)backend)->device, light, to, error);
}

/* What the device has not done the caller does. */
static int fallback_regress(struct kiln_backend *backend, const struct kiln_regression_work *work, bool *done,
                            struct kiln_error *error)
{
    struct fallback_backend *f = (struct fallback_backend *)backend;
    if (f->embree != NULL)
        return KILN_OK;
    const int status = kiln_backend_regress(f->device, work, done, error);
    return status != KILN_OK ? change_over(f, status, error) : KILN_OK;
}

static void fallback_info(const struct kiln_backend *backend, struct kiln_backend_info *info)
{
    const struct fallback_backend *f = (const struct fallback_backend *)backend;
    kiln_backend_info(f->embree != NULL ? f->embree : f->device, info);
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
                                       .set_surface = fallback_set_surface,
                                       .set_others = fallback_set_others,
                                       .set_radiosity = fallback_set_radiosity,
                                       .set_probes = fallback_set_probes,
                                       .mixed = UINT32_MAX,
                                       .claims = UINT32_MAX,
                                       .takes = fallback_takes,
                                       .expect = fallback_expect,
                                       .run = fallback_run,
                                       .intersect = fallback_intersect,
                                       .ceiling = fallback_ceiling,
                                       .change_light = fallback_change_light,
                                       .replay = f->device->api->replay != NULL ? fallback_replay : NULL,
                                       .hold = f->device->api->hold != NULL ? fallback_hold : NULL,
                                       .hold_step = fallback_hold_step,
                                       .hold_fetch = fallback_hold_fetch,
                                       .regress = fallback_regress};
    f->base = (struct kiln_backend){.api = &f->api, .params = *params};
    *backend = &f->base;
    return KILN_OK;
}
