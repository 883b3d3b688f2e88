#include "worker/backend/backend.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>

#include "worker/backend/fallback.h"
#include "worker/backend/verify.h"
#include "worker/backend/vulkan/gpu.h"

static const struct kiln_backend_api *const backends[] = {&kiln_backend_embree, &kiln_backend_vulkan};

/* A driver that does not start counts as none. */
static bool has_gpu(void)
{
    enum { MOST = 64 };
    struct gpu_description list[MOST];
    size_t count = 0;
    if (gpu_list(list, MOST, &count, NULL) != KILN_OK)
        return false;
    for (size_t i = 0; i < count && i < MOST; i++)
        if (list[i].fit && !list[i].software)
            return true;
    return false;
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
    if (status == KILN_OK && api != &kiln_backend_embree && params->verify_share > 0.0)
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
    for (size_t i = 0; i < sizeof backends / sizeof *backends; i++)
        if (strcmp(name, backends[i]->name) == 0)
            return create(backend, backends[i], params, error);
    return kiln_fail(error, KILN_NO_DEVICE, "no backend is called '%s' here; known: auto, embree, vulkan", name);
}

void kiln_backend_destroy(struct kiln_backend **backend)
{
    if (*backend != NULL)
        (*backend)->api->destroy(backend);
}

int kiln_backend_set_surface(struct kiln_backend *backend, const struct kiln_surface *surface, struct kiln_error *error)
{
    assert(surface != NULL);
    return backend->api->set_surface(backend, surface, error);
}

int kiln_backend_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error)
{
    return backend->api->set_radiosity(backend, radiosity, error);
}

int kiln_backend_validity(struct kiln_backend *backend, size_t tile_run_first, size_t tile_run_count, uint16_t *visible,
                          struct kiln_error *error)
{
    if (tile_run_count == 0)
        return KILN_OK;
    return backend->api->validity(backend, tile_run_first, tile_run_count, visible, error);
}

int kiln_backend_direct(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint64_t *rays,
                        struct kiln_error *error)
{
    assert(samples > 0);
    if (batch->tile_run_count == 0)
        return KILN_OK;
    return backend->api->direct(backend, batch, samples, rays, error);
}

int kiln_backend_gather(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint32_t stream,
                        uint64_t *rays, struct kiln_error *error)
{
    assert(samples > 0);
    if (batch->tile_run_count == 0)
        return KILN_OK;
    return backend->api->gather(backend, batch, samples, stream, rays, error);
}

int kiln_backend_probes(struct kiln_backend *backend, const struct kiln_vec3 *positions, size_t count,
                        uint64_t index_first, uint32_t samples, struct kiln_probe_result *results, uint64_t *rays,
                        struct kiln_error *error)
{
    assert(samples > 0);
    if (count == 0)
        return KILN_OK;
    return backend->api->probes(backend, positions, count, index_first, samples, results, rays, error);
}

int kiln_backend_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                           const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                           struct kiln_error *error)
{
    if (count == 0)
        return KILN_OK;
    return backend->api->intersect(backend, origins, directions, count, hits, error);
}

int kiln_backend_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples,
                         uint32_t stream, double *seconds, uint64_t *rays, struct kiln_error *error)
{
    assert(samples > 0);
    if (batch->tile_run_count == 0)
        return KILN_OK;
    return backend->api->ceiling(backend, batch, samples, stream, seconds, rays, error);
}
