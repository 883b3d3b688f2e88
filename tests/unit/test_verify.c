/* Tests of the verifying backend: it accepts a correct device, and reports several kinds of wrong results. The device
 * is Embree, whose results are changed here. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

#include "coordinator/surface/surface_build.h"
#include "shaders/shared/random.h"
#include "tests/unit/surface_scene.h"
#include "worker/backend/api.h"
#include "worker/backend/verify.h"
#include "worker/light/lights.h"
#include "worker/pass/direct.h"
#include "worker/pass/gather.h"
#include "worker/scene/radiosity.h"

enum lie { HONEST, ROUNDED, A_LITTLE_BRIGHTER, HALF, ONE_NAN, SOME_WRONG, FEW_WRONG, ONE_CUT_SHORT };

struct liar {
    struct kiln_backend base;
    struct kiln_backend_api api;
    struct kiln_backend *embree;
    enum lie lie;
    const struct kiln_surface *surface;
    const struct kiln_batch *batch; /* under way */
    uint64_t points, taken;
};

struct world {
    struct fixture *fixture;
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_surface *surface;
    struct kiln_backend *backend; /* verifies the liar */
    struct liar *liar;
    uint64_t *radiosity;
};

static float distort(enum lie lie, uint64_t point, float value)
{
    const uint32_t hash = kiln_hash1((uint32_t)point);
    switch (lie) {
    case ROUNDED:
        return value * (1.0f + 1e-6f * (float)(hash % 3));
    case A_LITTLE_BRIGHTER: /* by less than a hundredth of a texel's noise */
        return value * 1.001f;
    case HALF:
        return value * 0.5f;
    case ONE_NAN:
        return point == 1234 ? NAN : value;
    case SOME_WRONG: /* by a lot, up and down */
        return hash % 50 == 0 ? value * (hash % 100 == 0 ? 5.0f : 0.0f) : value;
    case FEW_WRONG:
        return point == 500 || point == 900 ? value * 3.0f : value;
    default:
        return value;
    }
}

static int take_and_lie(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    struct liar *l = context;
    struct kiln_point_result *told = NULL;
    size_t points = 0;
    const struct kiln_surface *s = l->surface;
    for (size_t i = first; i < first + count; i++)
        points += s->tile_runs[i].count;
    told = malloc(points * sizeof *told);
    memcpy(told, results, points * sizeof *told);
    for (size_t i = 0; i < points; i++) {
        for (int c = 0; c < 3; c++) {
            told[i].irradiance[c] = distort(l->lie, l->points + i, told[i].irradiance[c]);
            told[i].incident[c] = distort(l->lie, l->points + i, told[i].incident[c]);
        }
        if (l->lie == ONE_CUT_SHORT && l->points + i == 1234)
            told[i].count--;
    }
    l->points += points;
    const int status = l->batch->take(l->batch->context, first, count, told, error);
    free(told);
    return status;
}

static int count_taken(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)first;
    (void)results;
    (void)error;
    ((struct world *)context)->liar->taken += count;
    return KILN_OK;
}

static int lying_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                     const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    struct liar *l = (struct liar *)backend;
    if (pass == &kiln_pass_direct && l->lie == A_LITTLE_BRIGHTER) /* a plain sky has no noise to hide in */
        return kiln_backend_run(l->embree, pass, parameters, batch, rays, error);
    struct kiln_batch own = *batch;
    own.take = take_and_lie;
    own.context = l;
    l->batch = batch;
    return kiln_backend_run(l->embree, pass, parameters, &own, rays, error);
}

static int liar_set(struct kiln_backend *backend, enum kiln_resource_index index, struct kiln_error *error)
{
    ((struct liar *)backend)->surface = backend->surface;
    return kiln_backend_give(((struct liar *)backend)->embree, index, &backend->given, error);
}

static void liar_info(const struct kiln_backend *backend, struct kiln_backend_info *info)
{
    (void)backend;
    *info = (struct kiln_backend_info){.name = "liar", .device = "Liar 9000"};
}

static void liar_destroy(struct kiln_backend **backend)
{
    kiln_backend_destroy(&((struct liar *)*backend)->embree);
    free(*backend);
    *backend = NULL;
}

/* A sheet under a cube under a sky; every point sends out some light of its own colour. */
static struct world create(double share, enum lie lie)
{
    static const double lifted[12] = {1, 0, 0, 0, 0, 1, 0, 2, 0, 0, 1, 0}, uv[4] = {0.02, 0.98, 0.02, 0.98};
    struct kiln_error error = {""};
    struct world w = {.fixture = fixture_create(), .liar = calloc(1, sizeof *w.liar)};
    struct fixture *f = w.fixture;
    const uint32_t grey = fixture_material(f, 0.5f, 0.5f, 0.5f), cube = fixture_cube(f, 2, 0.0, grey),
                   floor = fixture_mesh(f);
    fixture_sheet(f, dvec3(-4, 0, 4), dvec3(8, 0, 0), dvec3(0, 0, -8), 4, uv, 0.3, grey);
    f->environment = (struct kiln_environment){.kind = KILN_ENVIRONMENT_CONSTANT, .radiance = {1.0f, 0.8f, 0.6f}};
    (void)fixture_object(f, cube, lifted, 60, 40);
    (void)fixture_object(f, floor, NULL, 64, 64);
    assert_int_equal(kiln_geometry_create(&w.geometry, &f->scene, &error), KILN_OK);
    assert_int_equal(kiln_lights_create(&w.lights, &f->scene, w.geometry, &error), KILN_OK);
    const struct kiln_surface_params surface = {.scene = &f->scene, .geometry = w.geometry, .ranks = 1, .threads = 1};
    assert_int_equal(kiln_surface_build(&w.surface, &surface, &(struct kiln_surface_report){0}, &error), KILN_OK);
    const struct kiln_backend_params params = {
        .scene = &f->scene, .geometry = w.geometry, .lights = w.lights, .threads = 2, .verify_fraction = share};
    w.liar->lie = lie;
    assert_int_equal(kiln_backend_create(&w.liar->embree, "embree", &params, &error), KILN_OK);
    w.liar->api = (struct kiln_backend_api){
        .name = "liar", .destroy = liar_destroy, .info = liar_info, .set = liar_set, .run = lying_run};
    w.liar->base.api = &w.liar->api;
    w.backend = &w.liar->base;
    assert_int_equal(kiln_verify_create(&w.backend, &params, &error), KILN_OK);
    assert_string_equal(kiln_backend_name(w.backend), "liar");
    w.radiosity = malloc(w.surface->point_count * sizeof *w.radiosity);
    for (uint32_t i = 0; i < w.surface->point_count; i++) {
        const float rgb[3] = {1.0f + 0.01f * (float)(i % 100), 1.0f, 2.0f - 0.01f * (float)(i % 50)};
        w.radiosity[i] = kiln_radiosity_pack(rgb, kiln_hash1(i));
    }
    assert_int_equal(kiln_backend_set_surface(w.backend, w.surface, &error), KILN_OK);
    assert_int_equal(kiln_backend_set_radiosity(w.backend, w.radiosity, &error), KILN_OK);
    return w;
}

static void destroy(struct world *w)
{
    kiln_backend_destroy(&w->backend);
    kiln_surface_destroy(&w->surface);
    kiln_lights_destroy(&w->lights);
    kiln_geometry_destroy(&w->geometry);
    fixture_destroy(w->fixture);
    free(w->radiosity);
}

static void check_info(const struct world *w, double share, enum lie lie, int status)
{
    struct kiln_backend_info info;
    uint64_t valid = 0;
    kiln_backend_info(w->backend, &info);
    for (uint64_t i = 0; i < w->surface->count; i++)
        valid += kiln_point_valid(w->surface, (struct kiln_own_point){i});
    assert_true(info.verified > 0 && info.beyond <= info.verified && !info.fell_back);
    if (status == KILN_OK)
        assert_true(share < 1.0 ? info.verified < valid : info.verified == 2 * valid);
    assert_true(lie == HONEST ? info.worst == 0.0 && info.beyond == 0 : info.worst > 0.0);
    assert_true((info.worst > 1.0) == (info.beyond > 0));
}

/* Both passes over the whole surface; the sentence of the first that fails. */
static int bake(double share, enum lie lie, struct kiln_error *error)
{
    struct world w = create(share, lie);
    uint64_t rays = 0;
    struct kiln_batch batch = {.count = w.surface->tile_run_count, .samples = 16, .take = count_taken, .context = &w};
    error->message[0] = '\0';
    int status = kiln_backend_run(w.backend, &kiln_pass_direct, NULL, &batch, &rays, error);
    w.liar->points = 0;
    batch.stream = 1;
    if (status == KILN_OK)
        status = kiln_backend_run(w.backend, &kiln_pass_gather, NULL, &batch, &rays, error);
    if (status == KILN_OK)
        assert_int_equal(w.liar->taken, 2 * w.surface->tile_run_count);
    check_info(&w, share, lie, status);
    destroy(&w);
    return status;
}

static void honest_devices_pass(void **state)
{
    (void)state;
    struct kiln_error error;
    assert_int_equal(bake(1.0, HONEST, &error), KILN_OK);
    assert_int_equal(bake(0.1, HONEST, &error), KILN_OK);
    assert_int_equal(bake(1.0, ROUNDED, &error), KILN_OK);
    assert_int_equal(bake(1.0, FEW_WRONG, &error), KILN_OK);
}

static void liars_are_found(void **state)
{
    (void)state;
    static const struct {
        enum lie lie;
        double share;
        const char *word;
    } cases[] = {{A_LITTLE_BRIGHTER, 1.0, "to the same side"},
                 {HALF, 1.0, "6 standard errors"},
                 {HALF, 0.1, "6 standard errors"},
                 {ONE_NAN, 1.0, "not numbers"},
                 {ONE_CUT_SHORT, 1.0, "another number of samples"},
                 {SOME_WRONG, 1.0, "too many texels"},
                 {SOME_WRONG, 0.3, "too many texels"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct kiln_error error;
        assert_int_equal(bake(cases[i].share, cases[i].lie, &error), KILN_NO_DEVICE);
        print_message("%s\n", error.message);
        assert_non_null(strstr(error.message, cases[i].word));
        assert_non_null(strstr(error.message, "Liar 9000"));
        assert_non_null(strstr(error.message, "object 'thing'"));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(honest_devices_pass), cmocka_unit_test(liars_are_found)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
