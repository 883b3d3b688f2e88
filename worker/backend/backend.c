#include "worker/backend/backend.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

#include "worker/backend/fallback.h"
#include "worker/backend/few.h"
#include "worker/backend/start.h"
#include "worker/backend/verify.h"
#include "worker/base/memory.h"
#include "worker/pass/rows.h"

static const struct kiln_backend_api *const backends[] = {&kiln_backend_embree, &kiln_backend_vulkan};

static const struct kiln_backend_api *find(const char *name)
{
    for (size_t i = 0; i < sizeof backends / sizeof *backends; i++)
        if (strcmp(name, backends[i]->name) == 0)
            return backends[i];
    return NULL;
}

static int no_such_backend(const char *name, struct kiln_error *error)
{
    return kiln_fail(error, KILN_NO_DEVICE, "no backend is called '%s' here; known: auto, embree, vulkan", name);
}

int kiln_backend_devices(const char *name, struct kiln_device *list, size_t room, size_t *count,
                         struct kiln_error *error)
{
    const struct kiln_backend_api *api = find(name);
    *count = 0;
    return api != NULL ? api->devices(list, room, count, error) : no_such_backend(name, error);
}

void kiln_backend_begin(struct kiln_backend_start **start, const char *name, const struct kiln_backend_params *params)
{
    const bool best = strcmp(name, "auto") == 0;
    const struct kiln_backend_api *api = best ? &kiln_backend_vulkan : find(name);
    *start = NULL;
    if (api != NULL && api->begin != NULL)
        kiln_backend_start_run(start, api, best, params);
}

/* What needs no scene: as it was begun, or now. */
static int begin(struct kiln_backend **backend, const struct kiln_backend_api *api,
                 const struct kiln_backend_params *params, struct kiln_error *error)
{
    const double start = kiln_clock_seconds();
    int status = KILN_OK;
    *backend = NULL;
    if (api->begin == NULL || kiln_backend_start_take(params->start, api, backend, &status, error))
        return status;
    status = api->begin(backend, params, error);
    const double end = kiln_clock_seconds();
    if (status == KILN_OK)
        (*backend)->starting = (struct kiln_aside){.begin = start, .end = end, .waited = end - start, .count = 1};
    return status;
}

/* The backend itself, and around it what the parameters ask for: going on without the device, then checking it. */
static int create(struct kiln_backend **backend, const struct kiln_backend_api *api,
                  const struct kiln_backend_params *params, struct kiln_error *error)
{
    int status = begin(backend, api, params, error);
    if (status == KILN_OK)
        status = api->create(backend, params, error);
    if (status != KILN_OK)
        return status;
    (*backend)->params = *params;
    if (api != &kiln_backend_embree && params->goes_on)
        status = kiln_fallback_create(backend, params, error);
    if (status == KILN_OK && api != &kiln_backend_embree && params->verify_fraction > 0.0)
        status = kiln_verify_create(backend, params, error);
    return status;
}

/* A GPU that does not work is no reason not to bake. */
static int create_best(struct kiln_backend **backend, const struct kiln_backend_params *params,
                       struct kiln_error *error)
{
    struct kiln_error why;
    if (kiln_backend_has_gpu(params->start, &kiln_backend_vulkan)) {
        if (create(backend, &kiln_backend_vulkan, params, &why) == KILN_OK)
            return KILN_OK;
        if (kiln_stop_asked(params->stop))
            return kiln_give_up(error);
        (void)fprintf(stderr, "kiln: warning: %s; using Embree\n", why.message);
    }
    return create(backend, &kiln_backend_embree, params, error);
}

int kiln_backend_create(struct kiln_backend **backend, const char *name, const struct kiln_backend_params *params,
                        struct kiln_error *error)
{
    *backend = NULL;
    if (strcmp(name, "auto") == 0)
        return create_best(backend, params, error);
    const struct kiln_backend_api *api = find(name);
    return api != NULL ? create(backend, api, params, error) : no_such_backend(name, error);
}

void kiln_backend_destroy(struct kiln_backend **backend)
{
    if (*backend != NULL)
        (*backend)->api->destroy(backend);
}

int kiln_backend_set_surface(struct kiln_backend *backend, const struct kiln_surface *surface, struct kiln_error *error)
{
    assert(surface != NULL);
    backend->surface = backend->own = surface;
    backend->others = (struct kiln_others){.surface = NULL};
    return backend->api->set_surface(backend, surface, error);
}

int kiln_backend_set_others(struct kiln_backend *backend, struct kiln_others others, struct kiln_error *error)
{
    assert(backend->own != NULL);
    backend->surface = others.surface != NULL ? others.surface : backend->own;
    backend->others = others;
    return backend->api->set_others != NULL ? backend->api->set_others(backend, &backend->others, error)
                                            : backend->api->set_surface(backend, backend->surface, error);
}

int kiln_backend_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error)
{
    backend->radiosity = radiosity;
    return backend->api->set_radiosity(backend, radiosity, error);
}

int kiln_backend_set_probes(struct kiln_backend *backend, const struct kiln_radiance_probes *probes,
                            struct kiln_error *error)
{
    backend->probes = probes;
    return backend->api->set_probes(backend, probes, error);
}

/* Whether a call of kiln_backend_run keeps to the pass's row. */
static bool is_well_formed(const struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                           const struct kiln_batch *batch)
{
    const bool surface = pass->domain == KILN_DOMAIN_TILE_RUNS || pass->domain == KILN_DOMAIN_LIGHT_PATHS;
    const bool positions = pass->domain == KILN_DOMAIN_POSITIONS;
    return (parameters != NULL) == (pass->parameter_bytes > 0) && (batch->positions != NULL) == positions &&
           (!surface || backend->surface != NULL) && (!pass->reads_radiosity || backend->radiosity != NULL) &&
           (pass->has_streams || batch->stream == 0) && (pass->is_divisible || batch->first_sample == 0) &&
           (pass->is_masked || batch->point_masks == NULL) &&
           (batch->few_masks == NULL || (surface && batch->samples > 0 && batch->point_masks != NULL)) &&
           (batch->samples_each != NULL ? pass->is_sampled : (batch->samples > 0) == pass->is_sampled);
}

/* The least of the batch's numbers of samples above `number`; 0: there is none. */
static uint32_t number_above(const struct kiln_batch *batch, uint32_t number)
{
    uint32_t least = 0;
    for (size_t i = 0; i < batch->count; i++)
        if (batch->samples_each[i] > number && (least == 0 || batch->samples_each[i] < least))
            least = batch->samples_each[i];
    return least;
}

static uint32_t greatest_number(const struct kiln_batch *batch)
{
    uint32_t most = 0;
    for (size_t i = 0; i < batch->count; i++)
        most = batch->samples_each[i] > most ? batch->samples_each[i] : most;
    return most;
}

/* Runs the batch once for each of its numbers of samples, and leaves the items of others out. */
static int run_by_numbers(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                          const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    uint32_t *numbers = NULL;
    int status = kiln_allocate(&numbers, batch->count, sizeof *numbers, "the samples of a batch's items", error);
    struct kiln_batch part = *batch;
    part.samples_each = numbers;
    for (part.samples = number_above(batch, 0); part.samples > 0 && status == KILN_OK;
         part.samples = number_above(batch, part.samples)) {
        for (size_t i = 0; i < batch->count; i++)
            numbers[i] = batch->samples_each[i] == part.samples ? part.samples : 0;
        status = backend->api->run(backend, pass, parameters, &part, rays, error);
    }
    kiln_free(&numbers);
    return status;
}

/* Runs stretches of positions or pixels that have the same number of samples. */
static int run_by_stretches(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                            const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    const uint32_t *each = batch->samples_each;
    int status = KILN_OK;
    for (size_t i = 0, end; i < batch->count && status == KILN_OK; i = end) {
        for (end = i + 1; end < batch->count && each[end] == each[i];)
            end++;
        struct kiln_batch part = kiln_batch_part(batch, batch->first + i, end - i);
        part.samples = each[i];
        part.samples_each = NULL;
        if (each[i] > 0)
            status = backend->api->run(backend, pass, parameters, &part, rays, error);
    }
    return status;
}

/* Any numbers at once. */
static int run_mixed(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                     const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    struct kiln_batch all = *batch;
    all.samples = greatest_number(batch);
    return all.samples > 0 ? backend->api->run(backend, pass, parameters, &all, rays, error) : KILN_OK;
}

/* Whether what runs the batch asks for it part by part. */
static bool is_claimed(const struct kiln_backend *backend, const struct kiln_pass *pass, const struct kiln_batch *batch)
{
    const bool mixed = (backend->api->mixed >> pass->index & 1u) != 0;
    return (backend->api->claims >> pass->index & 1u) != 0 && backend->rows == NULL && batch->few_masks == NULL &&
           (batch->samples_each == NULL || mixed);
}

/* Claims the batch as a whole. */
static int run_claimed(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                       const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    const size_t count = batch->claims->claim(batch->claims->context, batch->first, batch->count);
    const struct kiln_batch whole = kiln_batch_part(batch, batch->first, count);
    return kiln_backend_run(backend, pass, parameters, &whole, rays, error);
}

int kiln_backend_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                     const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    if (batch->count == 0)
        return KILN_OK;
    if (batch->claims != NULL && !is_claimed(backend, pass, batch))
        return run_claimed(backend, pass, parameters, batch, rays, error);
    if (!is_well_formed(backend, pass, parameters, batch))
        return kiln_fail(error, KILN_BUG,
                         "the pass '%s' was given a batch, parameters or a state of the backend that do not fit it; "
                         "this is a bug of kiln: report it",
                         pass->name);
    backend->ran[pass->index] = true;
    if (batch->few_masks != NULL)
        return kiln_backend_run_few(backend, pass, parameters, batch, rays, error);
    if (batch->samples_each == NULL)
        return backend->api->run(backend, pass, parameters, batch, rays, error);
    if ((backend->api->mixed >> pass->index & 1u) != 0)
        return run_mixed(backend, pass, parameters, batch, rays, error);
    if (pass->domain != KILN_DOMAIN_TILE_RUNS)
        return run_by_stretches(backend, pass, parameters, batch, rays, error);
    return run_by_numbers(backend, pass, parameters, batch, rays, error);
}

int kiln_backend_change_light(struct kiln_backend *backend, struct kiln_error *error)
{
    return backend->api->change_light != NULL ? backend->api->change_light(backend, error) : KILN_OK;
}

int kiln_backend_replay(struct kiln_backend *backend, struct kiln_rows *rows, const uint64_t *const *lights,
                        size_t count, const struct kiln_batch *batch, struct kiln_error *error)
{
    if (batch->count == 0 || count == 0)
        return KILN_OK;
    assert(backend->api->replay != NULL && batch->few_masks == NULL && count <= KILN_ROW_LIGHTS);
    return backend->api->replay(backend, rows, lights, count, batch, error);
}

int kiln_backend_hold(struct kiln_backend *backend, const struct kiln_held *begin, bool *held,
                      struct kiln_held_power *powers, struct kiln_error *error)
{
    *held = false;
    if (backend->api->hold == NULL || begin->count == 0 || backend->surface->count != backend->surface->point_count)
        return KILN_OK;
    assert(begin->count <= KILN_ROW_LIGHTS);
    return backend->api->hold(backend, begin, held, powers, error);
}

int kiln_backend_hold_step(struct kiln_backend *backend, struct kiln_rows *rows, const struct kiln_batch *batch,
                           const struct kiln_held_step *step, struct kiln_held_power *powers, struct kiln_error *error)
{
    assert(batch->take == NULL && batch->point_masks == NULL && batch->first == 0 &&
           batch->count == backend->surface->tile_run_count);
    return backend->api->hold_step(backend, rows, batch, step, powers, error);
}

int kiln_backend_hold_fetch(struct kiln_backend *backend, uint32_t light, const struct kiln_held_fetch *to,
                            struct kiln_error *error)
{
    return backend->api->hold_fetch(backend, light, to, error);
}

int kiln_backend_regress(struct kiln_backend *backend, const struct kiln_regression_work *work, bool *done,
                         struct kiln_error *error)
{
    *done = false;
    if (backend->api->regress == NULL || work->count == 0)
        return KILN_OK;
    assert(work->lights >= 1 && work->lights <= 2);
    return backend->api->regress(backend, work, done, error);
}

int kiln_backend_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                           const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                           struct kiln_error *error)
{
    if (count == 0)
        return KILN_OK;
    return backend->api->intersect(backend, origins, directions, count, hits, error);
}

int kiln_backend_intersect_within(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                                  const struct kiln_vec3 *directions, const float *lengths, size_t count,
                                  struct kiln_hit *hits, struct kiln_error *error)
{
    if (count == 0)
        return KILN_OK;
    if (backend->api->intersect_within == NULL)
        return backend->api->intersect(backend, origins, directions, count, hits, error);
    return backend->api->intersect_within(backend, origins, directions, lengths, count, hits, error);
}

int kiln_backend_intersect_alike(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                                 const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                                 struct kiln_error *error)
{
    if (count == 0)
        return KILN_OK;
    return (backend->api->intersect_alike != NULL ? backend->api->intersect_alike : backend->api->intersect)(
        backend, origins, directions, count, hits, error);
}

int kiln_backend_clearance(struct kiln_backend *backend, const struct kiln_sphere *spheres, size_t count, float *clear,
                           struct kiln_error *error)
{
    memset(clear, 0, count * sizeof *clear);
    return backend->api->clearance != NULL ? backend->api->clearance(backend, spheres, count, clear, error) : KILN_OK;
}

int kiln_backend_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                         struct kiln_error *error)
{
    if (batch->count == 0)
        return KILN_OK;
    assert(batch->samples > 0 && batch->samples_each == NULL);
    return backend->api->ceiling(backend, batch, seconds, rays, error);
}
