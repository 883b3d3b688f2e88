#include "worker/backend/extended.h"

#include <assert.h>
#include <string.h>

#include "worker/backend/api.h"
#include "worker/pass/rows.h"

/* ---- backends in front of others ---- */

struct kiln_backend *kiln_backend_innermost(const struct kiln_backend *backend)
{
    while (backend->api->inner != NULL)
        backend = backend->api->inner(backend);
    return (struct kiln_backend *)(uintptr_t)backend;
}

int kiln_backend_replace(struct kiln_backend *backend, int status, struct kiln_error *error)
{
    while (backend->api->replace == NULL && backend->api->inner != NULL)
        backend = backend->api->inner(backend);
    return backend->api->replace != NULL ? backend->api->replace(backend, status, error) : status;
}

/* Returns a backend's optional functions; all NULL: none. */
static const struct kiln_backend_extras *extras_of(const struct kiln_backend *backend)
{
    static const struct kiln_backend_extras nothing = {.clearance = NULL};
    return backend->api->extras != NULL ? backend->api->extras : &nothing;
}

/* ---- resources ---- */

int kiln_backend_set_others(struct kiln_backend *backend, struct kiln_others others, struct kiln_error *error)
{
    assert(backend->given.surface != NULL);
    return kiln_backend_give(backend, KILN_RESOURCE_others, &(struct kiln_resources){.others = others}, error);
}

int kiln_backend_set_probes(struct kiln_backend *backend, const struct kiln_radiance_probes *probes,
                            struct kiln_error *error)
{
    return kiln_backend_give(backend, KILN_RESOURCE_probes, &(struct kiln_resources){.probes = probes}, error);
}

/* Sets the rows. Like groups, rows are read by the passes themselves and not copied before, so this cannot fail. */
void kiln_backend_set_rows(struct kiln_backend *backend, struct kiln_rows *rows)
{
    (void)kiln_backend_give(backend, KILN_RESOURCE_rows, &(struct kiln_resources){.rows = rows}, NULL);
}

void kiln_backend_set_groups(struct kiln_backend *backend, struct kiln_groups *groups)
{
    (void)kiln_backend_give(backend, KILN_RESOURCE_groups, &(struct kiln_resources){.groups = groups}, NULL);
}

int kiln_backend_change_light(struct kiln_backend *backend, struct kiln_error *error)
{
    return kiln_backend_give(backend, KILN_RESOURCE_light, &(struct kiln_resources){.light = backend->params.lights},
                             error);
}

/* ---- passes ---- */

bool kiln_backend_takes(const struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters)
{
    const struct kiln_backend *b = kiln_backend_innermost(backend);
    return b->api->takes == NULL || b->api->takes(b, pass, parameters);
}

void kiln_backend_expect(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters)
{
    struct kiln_backend *b = kiln_backend_innermost(backend);
    if (b->api->expect != NULL && kiln_backend_takes(b, pass, parameters))
        b->api->expect(b, pass, parameters);
}

/* ---- functions that only some backends have ---- */

int kiln_backend_clearance(struct kiln_backend *backend, const struct kiln_sphere *spheres, size_t count, float *clear,
                           struct kiln_error *error)
{
    struct kiln_backend *b = kiln_backend_innermost(backend);
    memset(clear, 0, count * sizeof *clear);
    return extras_of(b)->clearance != NULL ? extras_of(b)->clearance(b, spheres, count, clear, error) : KILN_OK;
}

int kiln_backend_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                         struct kiln_error *error)
{
    struct kiln_backend *b = kiln_backend_innermost(backend);
    if (batch->count == 0)
        return KILN_OK;
    assert(batch->samples > 0 && batch->samples_each == NULL);
    return extras_of(b)->ceiling(b, batch, seconds, rays, error);
}

bool kiln_backend_replays(const struct kiln_backend *backend) { return extras_of(backend)->replay != NULL; }

bool kiln_backend_holds(const struct kiln_backend *backend) { return extras_of(backend)->hold != NULL; }

static int gone(const char *what, struct kiln_error *error)
{
    return kiln_fail(error, KILN_NO_DEVICE,
                     "the device failed, and %s of no use to Embree: relight again, with --backend embree", what);
}

int kiln_backend_replay(struct kiln_backend *backend, struct kiln_rows *rows, const uint64_t *const *lights,
                        size_t count, const struct kiln_batch *batch, struct kiln_error *error)
{
    struct kiln_backend *b = kiln_backend_innermost(backend);
    if (batch->count == 0 || count == 0)
        return KILN_OK;
    assert(kiln_backend_replays(backend) && !kiln_batch_has_few(batch) && count <= KILN_ROW_LIGHTS);
    return extras_of(b)->replay != NULL ? extras_of(b)->replay(b, rows, lights, count, batch, error)
                                        : gone("kept rays that lie in memory are", error);
}

int kiln_backend_hold(struct kiln_backend *backend, const struct kiln_held *begin, bool *held,
                      struct kiln_held_power *powers, struct kiln_error *error)
{
    struct kiln_backend *b = kiln_backend_innermost(backend);
    *held = false;
    if (extras_of(b)->hold == NULL || begin->count == 0 || b->surface->count != b->surface->point_count)
        return KILN_OK;
    assert(begin->count <= KILN_ROW_LIGHTS);
    return extras_of(b)->hold(b, begin, held, powers, error);
}

int kiln_backend_hold_step(struct kiln_backend *backend, struct kiln_rows *rows, const struct kiln_batch *batch,
                           const struct kiln_held_step *step, struct kiln_held_power *powers, struct kiln_error *error)
{
    struct kiln_backend *b = kiln_backend_innermost(backend);
    assert(batch->take == NULL && batch->selections == NULL && batch->first == 0 &&
           batch->count == backend->surface->tile_run_count);
    return extras_of(b)->hold_step != NULL ? extras_of(b)->hold_step(b, rows, batch, step, powers, error)
                                           : gone("light that stayed there is", error);
}

int kiln_backend_hold_fetch(struct kiln_backend *backend, uint32_t light, const struct kiln_held_fetch *to,
                            struct kiln_error *error)
{
    struct kiln_backend *b = kiln_backend_innermost(backend);
    return extras_of(b)->hold_fetch != NULL ? extras_of(b)->hold_fetch(b, light, to, error)
                                            : gone("light that stayed there is", error);
}

int kiln_backend_regress(struct kiln_backend *backend, const struct kiln_regression_work *work, bool *done,
                         struct kiln_error *error)
{
    struct kiln_backend *b = kiln_backend_innermost(backend);
    *done = false;
    if (extras_of(b)->regress == NULL || work->count == 0)
        return KILN_OK;
    assert(work->lights >= 1 && work->lights <= 2);
    const int status = extras_of(b)->regress(b, work, done, error);
    return status == KILN_OK ? KILN_OK : kiln_backend_replace(backend, status, error);
}
