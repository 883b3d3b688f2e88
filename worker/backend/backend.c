#include "worker/backend/backend.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

#include "worker/backend/fallback.h"
#include "worker/backend/verify.h"

static const struct kiln_backend_api *const backends[] = {&kiln_backend_embree, &kiln_backend_vulkan};

/* A driver that does not start counts as none. */
static bool has_gpu(void)
{
    enum { MOST = 64 };
    struct kiln_device list[MOST];
    size_t count = 0;
    if (kiln_backend_vulkan.devices(list, MOST, &count, NULL) != KILN_OK)
        return false;
    for (size_t i = 0; i < count && i < MOST; i++)
        if (list[i].fit && !list[i].software)
            return true;
    return false;
}

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

/* The backend itself, and around it what the parameters ask for: going on without the device, then checking it. */
static int create(struct kiln_backend **backend, const struct kiln_backend_api *api,
                  const struct kiln_backend_params *params, struct kiln_error *error)
{
    int status = api->create(backend, params, error);
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
    if (has_gpu()) {
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
    backend->surface = surface;
    return backend->api->set_surface(backend, surface, error);
}

int kiln_backend_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error)
{
    backend->radiosity = radiosity;
    return backend->api->set_radiosity(backend, radiosity, error);
}

/* Whether a call of kiln_backend_run keeps to the pass's row. */
static bool is_well_formed(const struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                           const struct kiln_batch *batch)
{
    const bool surface = pass->domain == KILN_DOMAIN_TILE_RUNS;
    return (parameters != NULL) == (pass->parameter_bytes > 0) && (batch->positions == NULL) == surface &&
           (!surface || backend->surface != NULL) && (!pass->reads_radiosity || backend->radiosity != NULL) &&
           (pass->has_streams || batch->stream == 0) && (pass->is_divisible || batch->first_sample == 0) &&
           (batch->samples_each != NULL ? pass->is_sampled : (batch->samples > 0) == pass->is_sampled);
}

/* The batch's items from number i on that the backend takes in one call: those with the same number of samples or, if
 * it takes `mixed` numbers, all before the next that is left out. */
static struct kiln_batch stretch_from(const struct kiln_batch *batch, size_t i, bool mixed)
{
    const uint32_t *each = batch->samples_each;
    uint32_t most = each[i];
    size_t end = i + 1;
    for (; end < batch->count && (each[end] == each[i] || (mixed && each[end] > 0 && each[i] > 0)); end++)
        most = each[end] > most ? each[end] : most;
    struct kiln_batch part = kiln_batch_part(batch, batch->first + i, end - i);
    part.samples = most;
    if (!mixed)
        part.samples_each = NULL;
    return part;
}

int kiln_backend_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                     const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    if (batch->count == 0)
        return KILN_OK;
    if (!is_well_formed(backend, pass, parameters, batch))
        return kiln_fail(error, KILN_BUG,
                         "the pass '%s' was given a batch, parameters or a state of the backend that do not fit it; "
                         "this is a bug of kiln: report it",
                         pass->name);
    backend->ran[pass->index] = true;
    if (batch->samples_each == NULL)
        return backend->api->run(backend, pass, parameters, batch, rays, error);
    int status = KILN_OK;
    const bool mixed = (backend->api->mixed >> pass->index & 1u) != 0;
    for (size_t i = 0; i < batch->count && status == KILN_OK;) {
        const struct kiln_batch part = stretch_from(batch, i, mixed);
        if (part.samples > 0)
            status = backend->api->run(backend, pass, parameters, &part, rays, error);
        i += part.count;
    }
    return status;
}

int kiln_backend_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                           const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                           struct kiln_error *error)
{
    if (count == 0)
        return KILN_OK;
    return backend->api->intersect(backend, origins, directions, count, hits, error);
}

int kiln_backend_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                         struct kiln_error *error)
{
    if (batch->count == 0)
        return KILN_OK;
    assert(batch->samples > 0 && batch->samples_each == NULL);
    return backend->api->ceiling(backend, batch, seconds, rays, error);
}
