/* Tests of the fallback: when a device fails for good within a pass, Embree continues where it stopped, with the same
 * results as if Embree had done everything. The device here is Embree that fails on purpose. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/surface/surface_build.h"
#include "tests/unit/surface_scene.h"
#include "worker/backend/api.h"
#include "worker/backend/extended.h"
#include "worker/backend/fallback.h"
#include "worker/light/lights.h"
#include "worker/pass/direct.h"
#include "worker/pass/rows.h"

enum { LAST_GOOD = 9, OWN_FAILURE = KILN_IO };

/* Does the first LAST_GOOD tile runs, in parts of 4; of a batch with claims it claims 4 more. */
struct quitter {
    struct kiln_backend base;
    struct kiln_backend_api api;
    struct kiln_backend *embree;
};

struct answers {
    size_t next, stop; /* tile runs; stop: where the caller itself fails */
    const struct kiln_surface *surface;
    struct kiln_point_result *results;
};

static int keep(void *context, size_t first, size_t count, const void *part_results, struct kiln_error *error)
{
    struct answers *a = context;
    const struct kiln_point_result *results = part_results;
    assert_int_equal(first, a->next); /* each exactly once */
    a->next += count;
    if (a->next > a->stop)
        return kiln_fail(error, OWN_FAILURE, "the caller's own");
    for (size_t i = first; i < first + count; i++) {
        const struct kiln_tile_run *f = &a->surface->tile_runs[i];
        memcpy(a->results + f->first.at, results, f->count * sizeof *results);
        results += f->count;
    }
    return KILN_OK;
}

static int quit_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                    const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    if (batch->claims != NULL)
        assert_int_equal(batch->claims->claim(batch->claims->context, 0, LAST_GOOD + 4), LAST_GOOD + 4);
    for (size_t first = 0; first + 4 <= LAST_GOOD; first += 4) {
        const struct kiln_batch part = kiln_batch_range(batch, first, 4);
        const int status = kiln_backend_run(((struct quitter *)backend)->embree, pass, parameters, &part, rays, error);
        if (status != KILN_OK)
            return status;
    }
    return kiln_fail(error, KILN_NO_DEVICE, "the device is gone");
}

static int quit_set(struct kiln_backend *backend, enum kiln_resource_index index, struct kiln_error *error)
{
    return kiln_backend_give(((struct quitter *)backend)->embree, index, &backend->given, error);
}

static void quit_info(const struct kiln_backend *backend, struct kiln_backend_info *info)
{
    (void)backend;
    *info = (struct kiln_backend_info){.name = "quitter", .device_seconds = 2.5, .recoveries = 3};
}

static void quit_destroy(struct kiln_backend **backend)
{
    kiln_backend_destroy(&((struct quitter *)*backend)->embree);
    free(*backend);
    *backend = NULL;
}

/* kiln_claims.claim: all that is asked for; the context is what was claimed so far. */
static size_t claim_all(void *context, size_t first, size_t count)
{
    size_t *claimed = context;
    assert_int_equal(first, *claimed);
    *claimed += count;
    return count;
}

static void embree_goes_on(void **state)
{
    (void)state;
    static const double uv[4] = {0.02, 0.98, 0.02, 0.98};
    struct kiln_error error = {""};
    struct fixture *f = fixture_create();
    struct kiln_geometry *geometry = NULL;
    struct kiln_lights *lights = NULL;
    struct kiln_surface *surface = NULL;
    struct kiln_backend *embree = NULL;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f), floor = fixture_mesh(f);
    fixture_sheet(f, dvec3(-4, 0, 4), dvec3(8, 0, 0), dvec3(0, 0, -8), 4, uv, 0.3, grey);
    f->environment = (struct kiln_environment){.kind = KILN_ENVIRONMENT_CONSTANT, .radiance = {1.0f, 0.8f, 0.6f}};
    (void)fixture_object(f, floor, NULL, 64, 64);
    assert_int_equal(kiln_geometry_create(&geometry, &f->scene, &error), KILN_OK);
    assert_int_equal(kiln_lights_create(&lights, &f->scene, geometry, &error), KILN_OK);
    const struct kiln_surface_params surface_params = {
        .scene = &f->scene, .geometry = geometry, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&surface, &surface_params, &(struct kiln_surface_report){0}, &error), KILN_OK);
    const struct kiln_backend_params params = {
        .scene = &f->scene, .geometry = geometry, .lights = lights, .threads = 1};
    assert_int_equal(kiln_backend_create(&embree, "embree", &params, &error), KILN_OK);
    assert_int_equal(kiln_backend_set_surface(embree, surface, &error), KILN_OK);
    const size_t bytes = surface->count * sizeof(struct kiln_point_result);
    struct answers expected = {.stop = SIZE_MAX, .surface = surface, .results = malloc(bytes)};
    struct kiln_batch batch = {.count = surface->tile_run_count, .samples = 4, .take = keep, .context = &expected};
    uint64_t rays = 0;
    assert_int_equal(kiln_backend_run(embree, &kiln_pass_direct, NULL, &batch, &rays, &error), KILN_OK);
    kiln_backend_destroy(&embree);

    enum { DEVICE_FAILS, CALLER_FAILS, CLAIMED };
    for (int way = DEVICE_FAILS; way <= CLAIMED; way++) {
        const bool own = way == CALLER_FAILS;
        size_t claimed = 0;
        const struct kiln_claims claims = {claim_all, &claimed};
        struct quitter *q = calloc(1, sizeof *q);
        const uint64_t radiosity = 0; /* neither is read by the direct pass */
        struct kiln_rows rows = {.file = -1};
        struct kiln_backend *backend = &q->base;
        struct answers got = {.stop = own ? 5 : SIZE_MAX, .surface = surface, .results = malloc(bytes)};
        q->api = (struct kiln_backend_api){.name = "quitter",
                                           .destroy = quit_destroy,
                                           .info = quit_info,
                                           .set = quit_set,
                                           .claims = UINT32_MAX,
                                           .run = quit_run};
        q->base.api = &q->api;
        assert_int_equal(kiln_backend_create(&q->embree, "embree", &params, &error), KILN_OK);
        assert_int_equal(kiln_fallback_create(&backend, &params, &error), KILN_OK);
        assert_int_equal(kiln_backend_set_surface(backend, surface, &error), KILN_OK);
        assert_int_equal(kiln_backend_set_radiosity(backend, &radiosity, &error), KILN_OK);
        if (way == DEVICE_FAILS)
            kiln_backend_set_rows(backend, &rows);
        batch.context = &got;
        if (way == CLAIMED) { /* what the device has claimed is computed; what it has not is left */
            batch.claims = &claims;
            assert_int_equal(kiln_backend_run(backend, &kiln_pass_direct, NULL, &batch, &rays, &error), KILN_OK);
            assert_true(got.next == LAST_GOOD + 4 && claimed == got.next && got.next < batch.count);
            struct kiln_batch rest = kiln_batch_range(&batch, got.next, batch.count - got.next);
            rest.claims = &claims;
            assert_int_equal(kiln_backend_run(backend, &kiln_pass_direct, NULL, &rest, &rays, &error), KILN_OK);
            assert_true(claimed == batch.count && got.next == claimed);
            assert_memory_equal(got.results, expected.results, bytes);
            batch.claims = NULL;
        }
        for (int pass = 0; pass < 2 - own && way != CLAIMED; pass++) { /* the second is Embree's from the start */
            got.next = 0;
            assert_int_equal(kiln_backend_run(backend, &kiln_pass_direct, NULL, &batch, &rays, &error),
                             own ? OWN_FAILURE : KILN_OK);
            if (!own)
                assert_memory_equal(got.results, expected.results, bytes);
        }
        struct kiln_backend_info info;
        kiln_backend_info(backend, &info);
        assert_true(info.fell_back == !own && strcmp(info.name, own ? "quitter" : "embree") == 0 &&
                    info.recoveries == 3);
        assert_true(info.device_seconds >= 2.5);
        const struct kiln_backend *inner = kiln_backend_innermost(backend); /* which has all that was given */
        assert_true((inner->api == &kiln_backend_embree) == !own && inner->given.radiosity == &radiosity);
        assert_memory_equal(&inner->given, &backend->given, sizeof inner->given);
        free(got.results);
        kiln_backend_destroy(&backend);
    }
    free(expected.results);
    kiln_surface_destroy(&surface);
    kiln_lights_destroy(&lights);
    kiln_geometry_destroy(&geometry);
    fixture_destroy(f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(embree_goes_on)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
