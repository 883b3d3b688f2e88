#include "worker/backend/extended.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

#include "worker/backend/api.h"
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

bool kiln_backend_may_use_device(const char *name) { return find(name) != &kiln_backend_embree; }

void kiln_backend_begin(struct kiln_backend_start **start, const char *name, const struct kiln_backend_params *params)
{
    const bool best = strcmp(name, "auto") == 0;
    const struct kiln_backend_api *api = best ? &kiln_backend_vulkan : find(name);
    *start = NULL;
    if (api != NULL && api->begin != NULL)
        kiln_backend_start_run(start, api, best, params);
}

/* Does the part of the creation that needs no scene, unless it has been begun already. */
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

/* Creates the backend, and the layers around it that the parameters request: fallback to Embree, then verification. */
static int create(struct kiln_backend **backend, const struct kiln_backend_api *api,
                  const struct kiln_backend_params *params, struct kiln_error *error)
{
    int status;
    KILN_TRY(begin(backend, api, params, error));
    KILN_TRY(api->create(backend, params, error));
    (*backend)->params = *params;
    if (api != &kiln_backend_embree && params->goes_on)
        KILN_TRY(kiln_fallback_create(backend, params, error));
    if (api != &kiln_backend_embree && params->verify_fraction > 0.0)
        KILN_TRY(kiln_verify_create(backend, params, error));
end:
    return status;
}

/* Creates the best available backend: Embree if no GPU works. */
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

const char *kiln_backend_name(const struct kiln_backend *backend) { return backend->api->name; }

void kiln_backend_info(const struct kiln_backend *backend, struct kiln_backend_info *info)
{
    backend->api->info(backend, info);
}

int kiln_backend_set_surface(struct kiln_backend *backend, const struct kiln_surface *surface, struct kiln_error *error)
{
    assert(surface != NULL);
    return kiln_backend_give(backend, KILN_RESOURCE_surface, &(struct kiln_resources){.surface = surface}, error);
}

int kiln_backend_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error)
{
    return kiln_backend_give(backend, KILN_RESOURCE_radiosity, &(struct kiln_resources){.radiosity = radiosity}, error);
}

/* Whether the arguments of kiln_backend_run are as the pass's description requires. */
static bool is_well_formed(const struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                           const struct kiln_batch *batch)
{
    const bool surface = pass->domain == KILN_DOMAIN_TILE_RUNS || pass->domain == KILN_DOMAIN_LIGHT_PATHS;
    const bool positions = pass->domain == KILN_DOMAIN_POSITIONS;
    return (parameters != NULL) == (pass->parameter_bytes > 0) && (batch->positions != NULL) == positions &&
           (!surface || backend->surface != NULL) && (!pass->reads_radiosity || backend->given.radiosity != NULL) &&
           (pass->has_streams || batch->stream == 0) && (pass->is_divisible || batch->first_sample == 0) &&
           (batch->selections == NULL || (pass->is_masked && (batch->samples > 0 || !kiln_batch_has_few(batch)))) &&
           (batch->samples_each != NULL ? pass->is_sampled : (batch->samples > 0) == pass->is_sampled);
}

/* The least of the batch's numbers of samples that exceeds `number`; 0: none. */
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

/* Runs the batch once for each of its numbers of samples, each time leaving out items with another number. */
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

/* Runs ranges of positions or pixels with equal numbers of samples. */
static int run_by_stretches(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                            const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    const uint32_t *each = batch->samples_each;
    int status = KILN_OK;
    for (size_t i = 0, end; i < batch->count && status == KILN_OK; i = end) {
        for (end = i + 1; end < batch->count && each[end] == each[i];)
            end++;
        struct kiln_batch part = kiln_batch_range(batch, batch->first + i, end - i);
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

/* Whether the backend claims the batch part by part. */
static bool is_claimed(const struct kiln_backend *backend, const struct kiln_pass *pass, const struct kiln_batch *batch)
{
    const bool mixed = (backend->api->mixed >> pass->index & 1u) != 0;
    return (backend->api->claims >> pass->index & 1u) != 0 && backend->given.rows == NULL &&
           !kiln_batch_has_few(batch) && (batch->samples_each == NULL || mixed);
}

/* Claims the batch as a whole. */
static int run_claimed(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                       const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    const size_t count = batch->claims->claim(batch->claims->context, batch->first, batch->count);
    const struct kiln_batch whole = kiln_batch_range(batch, batch->first, count);
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
    if (kiln_batch_has_few(batch))
        return kiln_backend_run_few(backend, pass, parameters, batch, rays, error);
    if (batch->samples_each == NULL)
        return backend->api->run(backend, pass, parameters, batch, rays, error);
    if ((backend->api->mixed >> pass->index & 1u) != 0)
        return run_mixed(backend, pass, parameters, batch, rays, error);
    if (pass->domain != KILN_DOMAIN_TILE_RUNS)
        return run_by_stretches(backend, pass, parameters, batch, rays, error);
    return run_by_numbers(backend, pass, parameters, batch, rays, error);
}

/* ---- rays ---- */

int kiln_backend_intersect_hinted(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                                  const struct kiln_vec3 *directions, size_t count, const struct kiln_ray_hints *hints,
                                  struct kiln_hit *hits, struct kiln_error *error)
{
    if (count == 0)
        return KILN_OK;
    struct kiln_backend *b = kiln_backend_innermost(backend);
    int status = b->api->intersect(b, origins, directions, count, hints, hits, error);
    if (status == KILN_OK || (status = kiln_backend_replace(backend, status, error)) != KILN_OK)
        return status;
    b = kiln_backend_innermost(backend);
    return b->api->intersect(b, origins, directions, count, hints, hits, error);
}

int kiln_backend_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                           const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                           struct kiln_error *error)
{
    static const struct kiln_ray_hints nothing = {.lengths = NULL};
    return kiln_backend_intersect_hinted(backend, origins, directions, count, &nothing, hits, error);
}
