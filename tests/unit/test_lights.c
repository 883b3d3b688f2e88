/* Tests of lights against closed forms: unoccluded irradiance from triangles by Lambert's polygon formula; importance
 * that is never zero where light arrives; allotment of samples; point, spot and environment sampling. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

#include "shaders/shared/random.h"
#include "worker/base/memory.h"
#include "worker/light/environment.h"
#include "worker/light/lights.h"
#include "worker/light/tree.h"
#include "worker/sampling/sequence.h"

static double uniform(uint32_t *seed) { return kiln_unit_double(kiln_hash1((*seed)++)); }

static struct kiln_dvec3 unit(struct kiln_dvec3 a) { return dvec3_scale(a, 1.0 / dvec3_length(a)); }

/* Lambert 1760: irradiance at p (normal n) from a triangle wholly above p's horizon, per unit of radiance. */
static double polygon_irradiance(const struct kiln_dvec3 v[3], struct kiln_dvec3 p, struct kiln_dvec3 n)
{
    double sum = 0.0;
    for (int i = 0; i < 3; i++) {
        const struct kiln_dvec3 a = unit(dvec3_sub(v[i], p)), b = unit(dvec3_sub(v[(i + 1) % 3], p));
        sum += acos(fmax(-1.0, fmin(1.0, dvec3_dot(a, b)))) * dvec3_dot(n, unit(dvec3_cross(a, b)));
    }
    return 0.5 * fabs(sum);
}

static struct kiln_area_light triangle(struct kiln_dvec3 a, struct kiln_dvec3 b, struct kiln_dvec3 c, float radiance)
{
    struct kiln_area_light light = {
        .p0 = a, .e1 = dvec3_sub(b, a), .e2 = dvec3_sub(c, a), .radiance = {radiance, radiance, radiance}};
    const struct kiln_dvec3 cross = dvec3_cross(light.e1, light.e2);
    light.area = 0.5 * dvec3_length(cross);
    light.normal = unit(cross);
    return light;
}

/* Irradiance at p by sampling every choice, no occlusion. */
static double sampled_irradiance(const struct kiln_lights *lights, struct kiln_dvec3 p, struct kiln_dvec3 n,
                                 uint32_t samples, uint32_t seed)
{
    struct kiln_light_choice choices[KILN_CUT_MAX + 4];
    const size_t count = kiln_lights_choices(lights, p, 0.0, n, KILN_CUT_MAX, choices);
    kiln_lights_allot(choices, count, samples);
    double total = 0.0;
    for (size_t i = 0; i < count; i++) {
        const uint32_t strategies = kiln_lights_strategies(lights, &choices[i], n);
        for (uint32_t k = 0; k < choices[i].samples; k++) {
            const uint32_t scramble = kiln_hash2(seed, (uint32_t)i * 2 + k % strategies);
            double r[3];
            for (uint32_t d = 0; d < 3; d++)
                r[d] = kiln_unit_double(
                    kiln_owen_scramble(kiln_sobol(k / strategies, d < 2 ? d : 4), kiln_hash2(scramble, d)));
            struct kiln_light_sample s;
            if (kiln_lights_sample(lights, &choices[i], k, p, n, n, r[2], r[0], r[1], &s))
                total += s.value[1] * fmax(0.0, dvec3_dot(n, s.direction)) / choices[i].samples;
        }
    }
    return total;
}

/* Triangles at distances over thirteen decades, seen from in front. */
static void one_triangle_at_any_distance(void **state)
{
    (void)state;
    struct kiln_geometry geometry = {.extent = 1e-6f};
    for (int decade = -6; decade <= 6; decade++) {
        const double d = pow(10.0, decade);
        const struct kiln_dvec3 v[3] = {{0.3, d, -0.4}, {0.1, d, 0.6}, {-0.5, d, -0.2}};
        struct kiln_area_light light = triangle(v[0], v[1], v[2], 2.0f);
        assert_true(light.normal.y < 0.0);
        struct kiln_lights lights = {.areas = &light, .area_count = 1, .geometry = &geometry};
        assert_int_equal(kiln_light_tree_build(&lights, NULL), KILN_OK);
        const struct kiln_dvec3 p = {0.02, 0.0, 0.01}, n = {0, 1, 0};
        const double exact = 2.0 * polygon_irradiance(v, p, n), sampled = sampled_irradiance(&lights, p, n, 4096, 5);
        if (fabs(sampled / exact - 1.0) > 2e-3)
            fail_msg("at distance %g: %g instead of %g", d, sampled, exact);
        kiln_free(&lights.nodes);
    }
}

/* From behind nothing arrives, unless the light has two sides. */
static void sides_matter(void **state)
{
    (void)state;
    struct kiln_geometry geometry = {.extent = 1.0f};
    struct kiln_area_light light = triangle(dvec3(0, 1, 0), dvec3(1, 1, 0), dvec3(0, 1, 1), 1.0f);
    assert_true(light.normal.y < 0.0);
    struct kiln_lights lights = {.areas = &light, .area_count = 1, .geometry = &geometry};
    kiln_light_tree_build(&lights, NULL);
    const struct kiln_dvec3 above = {0.2, 2.0, 0.2}, down = {0, -1, 0};
    assert_true(sampled_irradiance(&lights, above, down, 64, 1) == 0.0);
    kiln_free(&lights.nodes);
    light.two_sided = true;
    kiln_light_tree_build(&lights, NULL);
    assert_true(sampled_irradiance(&lights, above, down, 64, 1) > 0.1);
    kiln_free(&lights.nodes);
}

/* Many random triangles: the tree's estimate is unbiased and its importance never zero where something arrives. */
static void many_triangles_through_the_tree(void **state)
{
    (void)state;
    enum { COUNT = 500 };
    struct kiln_geometry geometry = {.extent = 1.0f};
    struct kiln_area_light *areas = calloc(COUNT, sizeof *areas);
    uint32_t seed = 77;
    for (int i = 0; i < COUNT; i++) {
        const struct kiln_dvec3 c = {uniform(&seed) * 4 - 2, 1.0 + uniform(&seed), uniform(&seed) * 4 - 2};
        struct kiln_dvec3 v[3];
        for (int k = 0; k < 3; k++)
            v[k] = dvec3_add(c, dvec3(uniform(&seed) * 0.2, uniform(&seed) * 0.2, uniform(&seed) * 0.2));
        areas[i] = triangle(v[0], v[1], v[2], (float)uniform(&seed));
    }
    struct kiln_lights lights = {.areas = areas, .area_count = COUNT, .geometry = &geometry};
    kiln_light_tree_build(&lights, NULL);
    for (int point = 0; point < 20; point++) {
        const struct kiln_dvec3 p = {uniform(&seed) * 2 - 1, 0.0, uniform(&seed) * 2 - 1}, n = {0, 1, 0};
        double exact = 0.0;
        for (int i = 0; i < COUNT; i++) {
            const struct kiln_area_light *a = &areas[i];
            const struct kiln_dvec3 v[3] = {a->p0, dvec3_add(a->p0, a->e1), dvec3_add(a->p0, a->e2)};
            if (dvec3_dot(dvec3_sub(p, a->p0), a->normal) <= 0.0)
                continue;
            exact += (double)a->radiance[1] * polygon_irradiance(v, p, n);
            struct kiln_light_node leaf = {0};
            for (size_t k = 0; k < lights.node_count; k++)
                if (lights.nodes[k].left == KILN_NONE && lights.nodes[k].right == (uint32_t)i)
                    leaf = lights.nodes[k];
            assert_true(kiln_light_node_importance(&leaf, p, 0.0, n) > 0.0);
            assert_true(kiln_light_node_importance(&lights.nodes[0], p, 0.0, n) > 0.0);
        }
        double sampled = 0.0;
        for (uint32_t run = 0; run < 16; run++)
            sampled += sampled_irradiance(&lights, p, n, 1024, run) / 16;
        if (fabs(sampled / exact - 1.0) > 0.01)
            fail_msg("%g instead of %g", sampled, exact);
    }
    kiln_free(&lights.nodes);
    free(areas);
}

static void points_spots_and_ranges(void **state)
{
    (void)state;
    struct kiln_geometry geometry = {.extent = 1.0f};
    struct kiln_point_light light = {.position = {0, 2, 0}, .intensity = {7, 7, 7}};
    struct kiln_lights lights = {.points = &light, .point_count = 1, .geometry = &geometry};
    const struct kiln_dvec3 p = {0, 0, 0}, n = {0, 1, 0};
    kiln_light_tree_build(&lights, NULL);
    assert_true(fabs(sampled_irradiance(&lights, p, n, 1, 1) - 7.0 / 4.0) < 1e-12);
    light.range = 4.0;
    assert_true(fabs(sampled_irradiance(&lights, p, n, 1, 1) - 7.0 / 4.0 * (1.0 - 1.0 / 16.0)) < 1e-12);
    light.range = 1.9;
    assert_true(sampled_irradiance(&lights, p, n, 1, 1) == 0.0);
    kiln_free(&lights.nodes);
    light = (struct kiln_point_light){.position = {0, 2, 0},
                                      .direction = {0, -1, 0},
                                      .intensity = {7, 7, 7},
                                      .spot = true,
                                      .cos_inner = 0.95,
                                      .cos_outer = 0.9};
    kiln_light_tree_build(&lights, NULL);
    assert_true(fabs(sampled_irradiance(&lights, p, n, 1, 1) - 7.0 / 4.0) < 1e-12);
    assert_true(sampled_irradiance(&lights, dvec3(2, 0, 0), n, 1, 1) == 0.0);
    const double cosine = 2.0 / sqrt(4.0 + 0.64), t = (cosine - 0.9) / 0.05, expected = 7.0 * cosine / 4.64 * t * t;
    assert_true(fabs(sampled_irradiance(&lights, dvec3(0.8, 0, 0), n, 1, 1) / expected - 1.0) < 1e-12);
    kiln_free(&lights.nodes);
}

/* A sun of few texels in a dim sky: both strategies together give what the image's own sum says. */
static void environment_image(void **state)
{
    (void)state;
    enum { W = 64, H = 32 };
    static float texels[W * H * 3];
    for (int i = 0; i < W * H * 3; i++)
        texels[i] = 0.1f;
    for (int c = 0; c < 3; c++) {
        texels[3 * (5 * W + 20) + c] = 500.0f;
        texels[3 * (25 * W + 40) + c] = 300.0f; /* below the horizon */
    }
    const struct kiln_environment environment = {
        .kind = KILN_ENVIRONMENT_LATLONG, .radiance = {2, 2, 2}, .rotation = 0.7f, .width = W, .height = H};
    const struct kiln_scene scene = {.environment = &environment, .environment_texels = texels};
    struct kiln_geometry geometry = {.extent = 1.0f};
    struct kiln_lights lights = {.scene = &scene, .geometry = &geometry};
    assert_int_equal(kiln_environment_build(&lights, NULL), KILN_OK);
    assert_true(lights.environment);
    double exact = 0.0; /* by a fine midpoint rule over the upper hemisphere */
    const int fine = 1024;
    for (int i = 0; i < fine; i++)
        for (int j = 0; j < 2 * fine; j++) {
            const double theta = KILN_PI / 2 * (i + 0.5) / fine, phi = KILN_PI * (j + 0.5) / fine;
            float rgb[3];
            kiln_environment_radiance(&lights, dvec3(sin(theta) * cos(phi), cos(theta), sin(theta) * sin(phi)), rgb);
            exact += (double)rgb[1] * cos(theta) * sin(theta) * (KILN_PI / 2 / fine) * (KILN_PI / fine);
        }
    const double sampled = sampled_irradiance(&lights, dvec3(0, 0, 0), dvec3(0, 1, 0), 16384, 3);
    if (fabs(sampled / exact - 1.0) > 3e-3)
        fail_msg("%g instead of %g", sampled, exact);
    double density;
    for (uint32_t k = 0; k < 1000; k++) { /* the density of a drawn direction is the one found by looking it up */
        const struct kiln_dvec3 d = kiln_environment_sample(&lights, kiln_unit_double(kiln_sobol(k, 0)),
                                                            kiln_unit_double(kiln_sobol(k, 1)), &density);
        assert_true(fabs(dvec3_length(d) - 1.0) < 1e-12);
        assert_true(fabs(kiln_environment_density(&lights, d) / density - 1.0) < 1e-6);
    }
    kiln_free(&lights.marginal);
    kiln_free(&lights.conditional);
}

/* A bright light and a hundred that hardly matter beside it: these are one choice, whose samples tell their sum.
 * Without the bright one they are split as any. */
static void dim_lights_share_a_choice(void **state)
{
    (void)state;
    enum { DIM = 100, SAMPLES = 1 << 16 };
    struct kiln_geometry geometry = {.extent = 1.0f};
    struct kiln_point_light points[DIM + 1] = {{.position = {0, 2, 0}, .intensity = {1, 1, 1}}};
    const struct kiln_dvec3 p = {0, 0, 0}, n = {0, 1, 0};
    double exact = 0.0;
    uint32_t seed = 3;
    for (int i = 1; i <= DIM; i++) {
        points[i] = (struct kiln_point_light){
            .position = {uniform(&seed) - 0.5, 1.0 + uniform(&seed), uniform(&seed) - 0.5}, .intensity = {0, 1e-9f, 0}};
        const double d = dvec3_length(points[i].position);
        exact += (double)points[i].intensity[1] * points[i].position.y / (d * d * d);
    }
    struct kiln_lights lights = {.points = points, .point_count = DIM + 1, .geometry = &geometry};
    assert_int_equal(kiln_light_tree_build(&lights, NULL), KILN_OK);
    struct kiln_light_choice choices[KILN_CUT_MAX];
    const size_t count = kiln_lights_choices(&lights, p, 0.0, n, KILN_CUT_MAX, choices);
    assert_in_range(count, 2, 8); /* those that share a cluster with the bright one go apart from it on the way */
    double dim = 0.0;
    for (size_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < SAMPLES; k++) {
            struct kiln_light_sample s;
            const double pick = kiln_unit_double(kiln_sobol(k, 0));
            if (kiln_lights_sample(&lights, &choices[i], k, p, n, n, pick, 0.5, 0.5, &s) && s.value[0] == 0.0)
                dim += s.value[1] * dvec3_dot(n, s.direction) / SAMPLES;
        }
    if (fabs(dim / exact - 1.0) > 1e-3)
        fail_msg("%g instead of %g", dim, exact);
    kiln_free(&lights.nodes);
    lights.points++, lights.point_count = DIM;
    assert_int_equal(kiln_light_tree_build(&lights, NULL), KILN_OK);
    assert_int_equal(kiln_lights_choices(&lights, p, 0.0, n, KILN_CUT_MAX, choices), KILN_CUT_MAX);
    kiln_free(&lights.nodes);
}

/* The irradiance about a shading normal that is `angle` off the geometric one, under a constant sky; how much of it
 * comes from above the geometric horizon; and the most that a sample brings of it or of the irradiance about the
 * geometric normal. */
static double tilted_irradiance(const struct kiln_lights *lights, double angle, double *above, double *most)
{
    const struct kiln_dvec3 n = {0, 1, 0}, shading = {sin(angle), cos(angle), 0};
    const struct kiln_light_choice sky = {.kind = KILN_CHOICE_ENVIRONMENT, .samples = 16384};
    double total = 0.0;
    *above = *most = 0.0;
    for (uint32_t k = 0; k < sky.samples; k++) {
        struct kiln_light_sample s;
        if (!kiln_lights_sample(lights, &sky, k, dvec3(0, 0, 0), n, shading, kiln_unit_double(kiln_sobol(k, 2)),
                                kiln_unit_double(kiln_sobol(k, 0)), kiln_unit_double(kiln_sobol(k, 1)), &s))
            continue;
        const double cosine = dvec3_dot(n, s.direction), tilted = fmax(0.0, dvec3_dot(shading, s.direction));
        const double brought = s.value[1] * tilted / sky.samples;
        total += brought;
        *above += cosine > 0.0 ? brought : 0.0;
        *most = fmax(*most, s.value[1] * fmax(cosine, tilted));
    }
    return total;
}

/* A sky is pi about any shading normal: rays of smooth meshes begin above their facets, and what comes from below a
 * facet counts. From above the horizon of a normal at an angle a comes pi (1 + cos a) / 2 of it. No sample brings more
 * than twice what a sky brings at most. */
static void sky_about_a_shading_normal(void **state)
{
    (void)state;
    const struct kiln_environment environment = {.kind = KILN_ENVIRONMENT_CONSTANT, .radiance = {1.0f, 1.0f, 1.0f}};
    const struct kiln_scene scene = {.environment = &environment};
    struct kiln_lights lights = {.scene = &scene};
    assert_int_equal(kiln_environment_build(&lights, NULL), KILN_OK);
    for (double angle = 0.0; angle < 1.5; angle += 0.3) {
        double above, most;
        const double exact = 0.5 * KILN_PI * (1.0 + cos(angle)),
                     sampled = tilted_irradiance(&lights, angle, &above, &most);
        if (fabs(sampled / KILN_PI - 1.0) > 3e-3 || fabs(above / exact - 1.0) > 3e-3 ||
            most > 2.0 * KILN_PI * (1.0 + 1e-9))
            fail_msg("at %g rad: %g instead of %g, %g from above instead of %g, a sample of %g", angle, sampled,
                     KILN_PI, above, exact, most);
    }
}

static void every_choice_gets_a_sample(void **state)
{
    (void)state;
    struct kiln_light_choice choices[3] = {{.importance = 1e6}, {.importance = 1.0}, {.importance = 1e-30}};
    const uint32_t given = kiln_lights_allot(choices, 3, 64);
    assert_int_equal(choices[0].samples, 64);
    assert_int_equal(choices[1].samples, 1);
    assert_int_equal(choices[2].samples, 1);
    assert_int_equal(given, 66);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_triangle_at_any_distance),
        cmocka_unit_test(sides_matter),
        cmocka_unit_test(many_triangles_through_the_tree),
        cmocka_unit_test(points_spots_and_ranges),
        cmocka_unit_test(environment_image),
        cmocka_unit_test(sky_about_a_shading_normal),
        cmocka_unit_test(dim_lights_share_a_choice),
        cmocka_unit_test(every_choice_gets_a_sample),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
