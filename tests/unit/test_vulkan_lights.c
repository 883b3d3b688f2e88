/* Tests of light selection and sampling on the device against the host, for every kind of light, in double and float.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "shaders/shared/random.h"
#include "tests/unit/vulkan_device.h"
#include "tests/modules.h"
#include "worker/base/memory.h"
#include "worker/backend/vulkan/layout.h"
#include "worker/backend/vulkan/lights.h"
#include "worker/light/environment.h"
#include "worker/light/area_light_sampler.h"
#include "worker/light/tree.h"
#include "worker/sampling/sequence.h"

enum { QUERIES = 4000, CHOICES = 40 };

struct query {
    float p[3], n[3], shading[3], place[3], spread;
    uint32_t limit, samples, kind, index, count, k, pick, u, v;
};
struct answer {
    double direction[3], distance, value[3], backoff, sine, cosine, atan2, acos;
    uint32_t aimed, brings, choices, reserved, what[CHOICES], given[CHOICES];
};
struct push {
    uint64_t scene, queries, answers;
    uint32_t count;
};

/* How the device's numbers differ from the host's. */
struct differences {
    size_t choices, brings, samples; /* queries that differ in these, the last by more than the tolerance */
    /* by a target on both sides; of these, how many differ by more than the tolerance */
    size_t aimed, aimed_samples;
    double worst, aimed_worst; /* of the others */
};

static double uniform(uint32_t *seed) { return kiln_unit_double(kiln_hash1((*seed)++)); }
static struct kiln_dvec3 unit(struct kiln_dvec3 a) { return dvec3_scale(a, 1.0 / dvec3_length(a)); }
static struct kiln_dvec3 any_direction(uint32_t *seed)
{
    const double u = uniform(seed);
    return kiln_sphere_direction(u, uniform(seed));
}
static struct kiln_dvec3 array3(const float a[3]) { return dvec3((double)a[0], (double)a[1], (double)a[2]); }
static void store3(float to[3], struct kiln_dvec3 a)
{
    to[0] = (float)a.x;
    to[1] = (float)a.y;
    to[2] = (float)a.z;
}

/* A random place within `reach`, of which every eighth is a probe and half of the others have a shading normal, and a
 * random sample of one of its choices there. */
static bool make_query(const struct kiln_lights *lights, double reach, uint32_t *seed, struct query *q)
{
    struct kiln_light_choice choices[CHOICES];
    const struct kiln_dvec3 p =
        dvec3_scale(dvec3(uniform(seed) - 0.5, uniform(seed) - 0.5, uniform(seed) - 0.5), 2.0 * reach);
    const bool probe = uniform(seed) < 0.125;
    memset(q, 0, sizeof *q);
    store3(q->p, p);
    store3(q->n, probe ? dvec3(0, 0, 0) : any_direction(seed));
    uint32_t other = ~*seed;
    store3(q->shading, probe || uniform(&other) < 0.5 ? array3(q->n) : any_direction(&other));
    q->spread = uniform(seed) < 0.5 ? 0.0f : (float)(0.05 * reach * uniform(seed));
    store3(q->place, dvec3_add(array3(q->p), dvec3_scale(any_direction(seed), 0.99 * (double)q->spread)));
    q->limit = 1 + (uint32_t)(uniform(seed) * KILN_CUT_MAX);
    q->samples = 1 + (uint32_t)(uniform(seed) * 200);
    const size_t count = kiln_lights_choices(lights, array3(q->p), (double)q->spread, array3(q->n), q->limit, choices);
    if (count == 0)
        return false;
    (void)kiln_lights_allot(choices, count, q->samples);
    const struct kiln_light_choice *choice = &choices[(size_t)(uniform(seed) * (double)count)];
    q->kind = (uint32_t)choice->kind;
    q->index = choice->index;
    q->count = choice->samples;
    q->k = (uint32_t)(uniform(seed) * choice->samples);
    q->pick = kiln_hash1((*seed)++);
    q->u = kiln_hash1((*seed)++);
    q->v = kiln_hash1((*seed)++);
    return true;
}

static double apart(const double a[3], const double b[3])
{
    double difference = 0.0, size = 1e-300;
    for (int c = 0; c < 3; c++) {
        difference = fmax(difference, fabs(a[c] - b[c]));
        size = fmax(size, fmax(fabs(a[c]), fabs(b[c])));
    }
    return difference / size;
}

static void compare_choices(const struct kiln_lights *lights, const struct query *q, const struct answer *a,
                            struct differences *d)
{
    struct kiln_light_choice choices[CHOICES];
    const size_t count = kiln_lights_choices(lights, array3(q->p), (double)q->spread, array3(q->n), q->limit, choices);
    (void)kiln_lights_allot(choices, count, q->samples);
    bool same = count == a->choices;
    for (size_t i = 0; same && i < count; i++)
        same = a->what[i] == ((uint32_t)choices[i].kind << KILN_GPU_CHOICE_KIND_SHIFT | choices[i].index) &&
               a->given[i] == choices[i].samples;
    d->choices += !same;
}

/* The sample as the host draws it; returns whether by a target. */
static bool draw_sample(const struct kiln_lights *lights, const struct query *q, bool *brings,
                        struct kiln_light_sample *s)
{
    const struct kiln_light_choice choice = {.kind = q->kind, .index = q->index, .samples = q->count};
    const struct kiln_dvec3 place = array3(q->place);
    const double u = kiln_unit_double(q->u), v = kiln_unit_double(q->v);
    struct kiln_area_light_sampler target;
    if (!kiln_area_light_sampler(lights, &choice, array3(q->p), (double)q->spread, &target)) {
        *brings = kiln_lights_sample(lights, &choice, q->k, place, array3(q->n), array3(q->shading),
                                     kiln_unit_double(q->pick), u, v, s);
        return false;
    }
    struct kiln_area_light_samples t;
    for (int l = 0; l < KILN_TARGET_LANES; l++) {
        t.u[l] = u, t.v[l] = v;
        t.place[0][l] = place.x, t.place[1][l] = place.y, t.place[2][l] = place.z;
    }
    kiln_area_light_sampler_draw(&target, &t);
    *brings = t.weight[0] > 0.0;
    *s = (struct kiln_light_sample){.direction =
                                        dvec3_scale(dvec3(t.to[0][0], t.to[1][0], t.to[2][0]), 1.0 / t.distance[0]),
                                    .distance = t.distance[0],
                                    .backoff = t.backoff[0]};
    for (int c = 0; c < 3; c++)
        s->value[c] = (double)target.light->radiance[c] * t.weight[0];
    return true;
}

static void compare_sample(const struct kiln_lights *lights, const struct query *q, const struct answer *a,
                           double tolerance, double aimed_tolerance, struct differences *d)
{
    struct kiln_light_sample s;
    bool brings;
    const bool aimed = draw_sample(lights, q, &brings, &s);
    if (aimed != (a->aimed != 0) || brings != (a->brings != 0)) {
        d->brings++;
        return;
    }
    if (!brings)
        return;
    const double direction[3] = {s.direction.x, s.direction.y, s.direction.z};
    double off = fmax(apart(direction, a->direction), apart(s.value, a->value));
    if (isfinite(s.distance))
        off = fmax(off, fmax(fabs(a->distance / s.distance - 1.0), fabs(a->backoff - s.backoff) / s.distance));
    else if (isfinite(a->distance))
        off = INFINITY;
    d->aimed += aimed;
    if (!(off <= (aimed ? aimed_tolerance : tolerance)))
        *(aimed ? &d->aimed_samples : &d->samples) += 1;
    else
        *(aimed ? &d->aimed_worst : &d->worst) = fmax(aimed ? d->aimed_worst : d->worst, off);
}

static double compare_functions(const struct query *q, const struct answer *a, bool float64)
{
    double u = kiln_unit_double(q->u), v = kiln_unit_double(q->v);
    if (!float64) { /* what the device was given */
        u = (double)(float)u;
        v = (double)(float)v;
    }
    const double angle = (u - 0.5) * 20.0;
    return fmax(fmax(fabs(a->sine - sin(angle)), fabs(a->cosine - cos(angle))),
                fmax(fabs(a->atan2 - atan2(u - 0.5, v - 0.5)), fabs(a->acos - acos(2.0 * v - 1.0))));
}

/* Asks the device. */
static void answer_queries(struct gpu *gpu, const struct kiln_lights *lights, bool float64, const struct query *queries,
                           struct answer *answers)
{
    struct vulkan_lights on_device;
    struct kiln_gpu_scene scene = {0};
    assert_int_equal(vulkan_lights_create(gpu, lights, float64, &on_device, &scene.lights, NULL), KILN_OK);
    const uint32_t constants[] = {0, 0, 0, on_device.kinds, 0};
    const struct gpu_kernel_params params = {.name = "lights",
                                             .code =
                                                 float64 ? &kiln_code_vulkan_lights : &kiln_code_vulkan_lights_float,
                                             .constants = constants,
                                             .constant_count = 5};
    struct gpu_kernel *kernel = NULL;
    struct gpu_buffer buffers[3];
    assert_int_equal(gpu_kernel_create(gpu, &kernel, &params, NULL), KILN_OK);
    assert_int_equal(gpu_buffer_of(gpu, &buffers[0], &scene, sizeof scene, "a scene", NULL), KILN_OK);
    assert_int_equal(gpu_buffer_of(gpu, &buffers[1], queries, QUERIES * sizeof *queries, "queries", NULL), KILN_OK);
    assert_int_equal(gpu_buffer_create(gpu, &buffers[2], QUERIES * sizeof *answers, GPU_DEVICE, "answers", NULL),
                     KILN_OK);
    const struct push push = {buffers[0].address, buffers[1].address, buffers[2].address, QUERIES};
    const struct gpu_step step = {
        .kernel = kernel, .threads_x = QUERIES, .threads_y = 1, .constants = &push, .constant_bytes = sizeof push};
    assert_int_equal(gpu_run(gpu, &step, 1, NULL, NULL), KILN_OK);
    assert_int_equal(gpu_download(gpu, &buffers[2], 0, answers, QUERIES * sizeof *answers, NULL), KILN_OK);
    for (int i = 0; i < 3; i++)
        gpu_buffer_destroy(gpu, &buffers[i]);
    gpu_kernel_destroy(gpu, &kernel);
    vulkan_lights_destroy(gpu, &on_device);
}

static void compare_variant(struct gpu *gpu, const struct kiln_lights *lights, bool float64,
                            const struct query *queries, const char *name)
{
    const double tolerance = float64 ? 1e-9 : 1e-3, aimed_tolerance = float64 ? 1e-9 : 1e-4,
                 exact = float64 ? 1e-13 : 2e-6;
    const double share = float64 ? 0.0 : 0.01;
    struct answer *answers = calloc(QUERIES, sizeof *answers);
    struct differences d = {0};
    double worst = 0.0;
    answer_queries(gpu, lights, float64, queries, answers);
    for (size_t i = 0; i < QUERIES; i++) {
        compare_choices(lights, &queries[i], &answers[i], &d);
        compare_sample(lights, &queries[i], &answers[i], tolerance, aimed_tolerance, &d);
        worst = fmax(worst, compare_functions(&queries[i], &answers[i], float64));
    }
    print_message("%s, %s: of %d, choices differ in %zu, whether light comes in %zu, samples in %zu, the others by "
                  "%.1e; functions by %.1e; "
                  "of %zu samples of targets %zu, the others by %.1e\n",
                  name, float64 ? "double" : "float", QUERIES, d.choices, d.brings, d.samples, d.worst, worst, d.aimed,
                  d.aimed_samples, d.aimed_worst);
    free(answers);
    assert_true(worst <= exact);
    assert_true((double)d.aimed_samples <= share * (double)d.aimed);
    assert_true((double)d.samples <= share * QUERIES && (double)d.brings <= share * QUERIES &&
                (double)d.choices <= share * QUERIES);
}

static void compare(struct gpu *gpu, struct kiln_lights *lights, double reach, const char *name)
{
    struct query *queries = calloc(QUERIES, sizeof *queries);
    uint32_t seed = 1;
    assert_int_equal(kiln_light_tree_build(lights, NULL), KILN_OK);
    for (size_t i = 0; i < QUERIES;)
        i += make_query(lights, reach, &seed, &queries[i]);
    if (gpu_about(gpu)->float64)
        compare_variant(gpu, lights, true, queries, name);
    compare_variant(gpu, lights, false, queries, name);
    free(queries);
    kiln_free(&lights->nodes);
    lights->nodes = NULL;
}

static struct kiln_area_light triangle(struct kiln_dvec3 a, struct kiln_dvec3 b, struct kiln_dvec3 c, uint32_t *seed)
{
    struct kiln_area_light light = {.p0 = a,
                                    .e1 = dvec3_sub(b, a),
                                    .e2 = dvec3_sub(c, a),
                                    .radiance = {(float)uniform(seed), 1.0f, (float)uniform(seed)}};
    const struct kiln_dvec3 cross = dvec3_cross(light.e1, light.e2);
    light.area = 0.5 * dvec3_length(cross);
    light.normal = unit(cross);
    light.rounding = 8.0 * 0x1p-24 * fmax(dvec3_length(a), fmax(dvec3_length(b), dvec3_length(c)));
    light.two_sided = uniform(seed) < 0.3;
    return light;
}

/* Triangles of a size, and `thin` times as wide as long. */
static void fill_areas(struct kiln_area_light *areas, size_t count, double size, double thin, uint32_t *seed)
{
    for (size_t i = 0; i < count; i++) {
        const struct kiln_dvec3 a = dvec3(uniform(seed) * 2 - 1, uniform(seed) * 2 - 1, uniform(seed) * 2 - 1);
        const struct kiln_dvec3 along = dvec3_scale(any_direction(seed), size),
                                across = dvec3_scale(any_direction(seed), size * thin);
        areas[i] = triangle(a, dvec3_add(a, along), dvec3_add(a, across), seed);
    }
}

static void fill_points(struct kiln_point_light *points, size_t count, uint32_t *seed)
{
    for (size_t i = 0; i < count; i++) {
        const bool spot = i % 2 == 1;
        points[i] = (struct kiln_point_light){.position = dvec3_scale(any_direction(seed), uniform(seed)),
                                              .direction = any_direction(seed),
                                              .spot = spot,
                                              .intensity = {1.0f, (float)uniform(seed), 2.0f},
                                              .range = i % 3 == 0 ? 1.0 + uniform(seed) : 0.0};
        points[i].cos_outer = spot ? 0.9 * uniform(seed) : 0.0;
        points[i].cos_inner = spot ? points[i].cos_outer + (i % 5 == 1 ? 0.0 : 0.1 * uniform(seed)) : 0.0;
    }
}

static void area_lights(void **state)
{
    static const struct {
        const char *name;
        size_t count;
        double size, thin, reach;
    } cases[] = {{"one triangle", 1, 0.5, 1.0, 2.0},      {"near triangles", 20, 0.5, 1.0, 1.0},
                 {"far triangles", 20, 0.3, 1.0, 300.0},  {"huge triangles", 5, 300.0, 1.0, 2.0},
                 {"thin triangles", 20, 1.0, 0.01, 1.5},  {"tiny triangles", 30, 1e-4, 1.0, 1.0},
                 {"1,000 triangles", 1000, 0.1, 1.0, 1.5}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        uint32_t seed = 1000;
        struct kiln_area_light *areas = calloc(cases[i].count, sizeof *areas);
        struct kiln_lights lights = {.areas = areas, .area_count = cases[i].count};
        fill_areas(areas, cases[i].count, cases[i].size, cases[i].thin, &seed);
        compare(*state, &lights, cases[i].reach, cases[i].name);
        free(areas);
    }
}

static void points_and_suns(void **state)
{
    struct kiln_point_light points[40];
    struct kiln_directional_light suns[7];
    uint32_t seed = 5;
    fill_points(points, 40, &seed);
    for (size_t i = 0; i < 7; i++)
        suns[i] = (struct kiln_directional_light){.towards = any_direction(&seed),
                                                  .irradiance = {1.0f, (float)uniform(&seed), 0.1f}};
    struct kiln_lights lights = {.points = points, .point_count = 40};
    compare(*state, &lights, 1.5, "point and spot lights");
    for (size_t i = 1; i < 40; i++)
        for (int c = 0; c < 3; c++)
            points[i].intensity[c] *= 1e-8f;
    compare(*state, &lights, 1.5, "one bright light among dim ones");
    lights = (struct kiln_lights){.points = points, .point_count = 3, .directionals = suns, .directional_count = 7};
    compare(*state, &lights, 1.5, "suns");
}

static void everything(void **state)
{
    enum { W = 64, H = 32, AREAS = 50, POINTS = 20 };
    static float texels[W * H * 3];
    static struct kiln_area_light areas[AREAS];
    static struct kiln_point_light points[POINTS];
    uint32_t seed = 9;
    for (int i = 0; i < W * H * 3; i++)
        texels[i] = (float)uniform(&seed);
    texels[3 * (5 * W + 20)] = 500.0f;
    struct kiln_environment environment = {
        .kind = KILN_ENVIRONMENT_LATLONG, .radiance = {2, 1, 0.5f}, .rotation = 0.7f, .width = W, .height = H};
    const struct kiln_scene scene = {.environment = &environment, .environment_texels = texels};
    const struct kiln_directional_light sun = {.towards = {0, 1, 0}, .irradiance = {3, 2, 1}};
    struct kiln_lights lights = {.scene = &scene};
    assert_int_equal(kiln_environment_build(&lights, NULL), KILN_OK);
    compare(*state, &lights, 1.0, "an image");
    fill_areas(areas, AREAS, 0.5, 1.0, &seed);
    fill_points(points, POINTS, &seed);
    lights.areas = areas;
    lights.area_count = AREAS;
    lights.points = points;
    lights.point_count = POINTS;
    lights.directionals = (struct kiln_directional_light *)&sun;
    lights.directional_count = 1;
    compare(*state, &lights, 1.5, "everything");
    kiln_free(&lights.marginal);
    kiln_free(&lights.conditional);
    environment.kind = KILN_ENVIRONMENT_CONSTANT;
    lights = (struct kiln_lights){.scene = &scene};
    assert_int_equal(kiln_environment_build(&lights, NULL), KILN_OK);
    compare(*state, &lights, 1.0, "a plain sky");
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(area_lights), cmocka_unit_test(points_and_suns),
                                       cmocka_unit_test(everything)};
    if (!vulkan_device_is_there())
        return 77;
    return cmocka_run_group_tests(tests, vulkan_device_open, vulkan_device_close);
}
