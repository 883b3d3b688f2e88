/* Tests of area light sampling: directions are uniform in the solid angle of a triangle; a prepared sampler draws the
 * same samples as kiln_lights_sample at its centre, gives the closed form's irradiance elsewhere, and refuses the
 * lights that it cannot prepare. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

#include "shaders/shared/random.h"
#include "worker/base/memory.h"
#include "worker/light/area_light_sampler.h"
#include "worker/light/tree.h"
#include "worker/sampling/sequence.h"

static double uniform(uint32_t *seed) { return kiln_unit_double(kiln_hash1((*seed)++)); }
static struct kiln_dvec3 unit(struct kiln_dvec3 a) { return dvec3_scale(a, 1.0 / dvec3_length(a)); }

static struct kiln_area_light triangle(struct kiln_dvec3 a, struct kiln_dvec3 b, struct kiln_dvec3 c)
{
    struct kiln_area_light light = {
        .p0 = a, .e1 = dvec3_sub(b, a), .e2 = dvec3_sub(c, a), .radiance = {1.0f, 2.0f, 3.0f}, .rounding = 1e-9};
    const struct kiln_dvec3 cross = dvec3_cross(light.e1, light.e2);
    light.area = 0.5 * dvec3_length(cross);
    light.normal = unit(cross);
    return light;
}

/* A light over the origin, facing down, about `distance` away. */
static struct kiln_area_light lamp(double size, double distance, uint32_t *seed)
{
    double r[7]; /* drawn in this order whatever the compiler */
    for (int i = 0; i < 7; i++)
        r[i] = uniform(seed);
    const struct kiln_dvec3 a = dvec3(size * (r[0] - 0.5), distance * (0.7 + 0.6 * r[1]), size * (r[2] - 0.5));
    const struct kiln_dvec3 b = dvec3(a.x + size * (0.2 + r[3]), distance * (0.7 + 0.6 * r[4]), a.z + 0.2 * size);
    return triangle(a, b, dvec3(a.x, distance * (0.7 + 0.6 * r[5]), a.z + size * (0.3 + r[6])));
}

static struct kiln_lights lights_of(struct kiln_area_light *areas, size_t count)
{
    struct kiln_lights lights = {.areas = areas, .area_count = count};
    assert_int_equal(kiln_light_tree_build(&lights, NULL), KILN_OK);
    return lights;
}

static const struct kiln_light_choice lone = {.kind = KILN_CHOICE_LIGHT_NODE, .index = 0, .samples = 64};

/* Girard's theorem, of unit vectors: the angles less pi. */
static double solid_angle(struct kiln_dvec3 a, struct kiln_dvec3 b, struct kiln_dvec3 c)
{
    const struct kiln_dvec3 ab = unit(dvec3_cross(a, b)), bc = unit(dvec3_cross(b, c)), ca = unit(dvec3_cross(c, a));
    return acos(-dvec3_dot(ab, ca)) + acos(-dvec3_dot(bc, ab)) + acos(-dvec3_dot(ca, bc)) - KILN_PI;
}

/* With v = 1 a direction is the point on the far edge that cuts off the share u; with any other v it lies on the arc to
 * it, at a height (its cosine with b) even between theirs. */
static void directions_are_even(void **state)
{
    (void)state;
    uint32_t seed = 19;
    for (int i = 0; i < 1000; i++) {
        const struct kiln_area_light light = lamp(3.0, 1.0, &seed);
        const struct kiln_dvec3 to0 = light.p0;
        const struct kiln_spherical_triangle t =
            kiln_spherical_triangle_of(to0, light.e1, light.e2, light.area, fabs(dvec3_dot(to0, light.normal)));
        const double u = 0.05 + 0.9 * uniform(&seed), v = 0.05 + 0.9 * uniform(&seed);
        const struct kiln_dvec3 edge = kiln_spherical_triangle_direction(t, u, 1.0),
                                inside = kiln_spherical_triangle_direction(t, u, v);
        assert_true(fabs(t.omega - solid_angle(t.a, t.b, t.c)) < 1e-9);
        assert_true(fabs(solid_angle(t.a, t.b, edge) - u * t.omega) < 1e-7);
        assert_true(fabs(dvec3_dot(edge, dvec3_cross(t.a, t.c))) < 1e-9 && fabs(dvec3_length(inside) - 1.0) < 1e-9);
        assert_true(fabs(dvec3_dot(inside, dvec3_cross(t.b, edge))) < 1e-9);
        assert_true(fabs((1.0 - dvec3_dot(inside, t.b)) - v * (1.0 - dvec3_dot(edge, t.b))) < 1e-9);
    }
}

static void put(struct kiln_area_light_samples *s, int lane, struct kiln_dvec3 place, double u, double v)
{
    s->u[lane] = u, s->v[lane] = v;
    s->place[0][lane] = place.x, s->place[1][lane] = place.y, s->place[2][lane] = place.z;
}

static void compare_at_centre(const struct kiln_lights *lights, const struct kiln_area_light_sampler *target,
                              struct kiln_dvec3 p, uint32_t *seed)
{
    const struct kiln_dvec3 up = dvec3(0, 1, 0);
    struct kiln_area_light_samples s;
    for (int l = 0; l < KILN_TARGET_LANES; l++)
        put(&s, l, p, uniform(seed), uniform(seed));
    kiln_area_light_sampler_draw(target, &s);
    for (int l = 0; l < KILN_TARGET_LANES; l++) {
        struct kiln_light_sample one;
        assert_true(kiln_lights_sample(lights, &lone, 0, p, up, up, 0.5, s.u[l], s.v[l], &one));
        const struct kiln_dvec3 to = dvec3(s.to[0][l], s.to[1][l], s.to[2][l]);
        assert_true(dvec3_length(dvec3_sub(to, dvec3_scale(one.direction, one.distance))) < 1e-7 * one.distance);
        assert_true(fabs(s.distance[l] / one.distance - 1.0) < 1e-7 &&
                    fabs(s.weight[l] * 2.0 / one.value[1] - 1.0) < 1e-6);
        assert_true(fabs(s.backoff[l] / one.backoff - 1.0) < 1e-6);
    }
}

static void same_as_one_by_one_at_the_centre(void **state)
{
    (void)state;
    uint32_t seed = 3;
    size_t spherical = 0, flat = 0;
    for (int i = 0; i < 400; i++) {
        struct kiln_area_light light = lamp(i % 2 == 0 ? 1.5 : 0.1, pow(10.0, 3.0 * uniform(&seed) - 2.0), &seed);
        struct kiln_lights lights = lights_of(&light, 1);
        struct kiln_area_light_sampler target;
        const struct kiln_dvec3 p = dvec3(0.2 * uniform(&seed), 0.0, 0.2 * uniform(&seed));
        if (kiln_area_light_sampler(&lights, &lone, p, 0.0, &target)) {
            compare_at_centre(&lights, &target, p, &seed);
            *(target.view.spherical ? &spherical : &flat) += 1;
        }
        kiln_free(&lights.nodes);
    }
    assert_true(spherical > 50 && flat > 50);
}

/* Lambert 1760, of a triangle wholly above the horizon, per radiance. */
static double polygon_irradiance(const struct kiln_area_light *light, struct kiln_dvec3 p, struct kiln_dvec3 n)
{
    const struct kiln_dvec3 v[3] = {light->p0, dvec3_add(light->p0, light->e1), dvec3_add(light->p0, light->e2)};
    double sum = 0.0;
    for (int i = 0; i < 3; i++) {
        const struct kiln_dvec3 a = unit(dvec3_sub(v[i], p)), b = unit(dvec3_sub(v[(i + 1) % 3], p)),
                                across = dvec3_cross(a, b);
        sum += atan2(dvec3_length(across), dvec3_dot(a, b)) * dvec3_dot(n, unit(across));
    }
    return 0.5 * fabs(sum);
}

static double sampled_irradiance(const struct kiln_area_light_sampler *target, struct kiln_dvec3 p, struct kiln_dvec3 n)
{
    enum { SAMPLES = 1 << 17 };
    double sum = 0.0;
    for (uint32_t k = 0; k < SAMPLES; k += KILN_TARGET_LANES) {
        struct kiln_area_light_samples s;
        for (uint32_t l = 0; l < KILN_TARGET_LANES; l++)
            put(&s, (int)l, p, kiln_unit_double(kiln_sobol(k + l, 0)), kiln_unit_double(kiln_sobol(k + l, 1)));
        kiln_area_light_sampler_draw(target, &s);
        for (int l = 0; l < KILN_TARGET_LANES; l++)
            sum += s.weight[l] * dvec3_dot(n, dvec3(s.to[0][l], s.to[1][l], s.to[2][l])) / s.distance[l];
    }
    return sum / SAMPLES;
}

/* Seen from any place that is near enough to the centre, at any distance, from in front and (two-sided) from behind. */
static void closed_form_from_other_places(void **state)
{
    (void)state;
    uint32_t seed = 7;
    for (int decade = -5; decade <= 5; decade++)
        for (int i = 0; i < 4; i++) {
            const double distance = pow(10.0, decade);
            struct kiln_area_light light = lamp(1.0, distance, &seed);
            light.rounding = 1e-9 * distance;
            light.two_sided = i % 2 == 1;
            if (light.two_sided)
                light.normal = dvec3_scale(light.normal, -1.0);
            struct kiln_lights lights = lights_of(&light, 1);
            struct kiln_area_light_sampler target;
            const struct kiln_dvec3 centre = dvec3(0.0, 0.0, 0.0), n = dvec3(0.0, 1.0, 0.0);
            if (kiln_area_light_sampler(&lights, &lone, centre, 0.0, &target)) {
                const double turn = 6.28 * uniform(&seed), far = 0.12 * target.view.height;
                const struct kiln_dvec3 p = dvec3(far * cos(turn), 0.0, far * sin(turn));
                assert_true(kiln_area_light_sampler(&lights, &lone, centre, 1.001 * far, &target));
                const double exact = polygon_irradiance(&light, p, n), sampled = sampled_irradiance(&target, p, n);
                if (!(fabs(sampled / exact - 1.0) < 1e-3))
                    fail_msg("at distance %g: %g instead of %g", distance, sampled, exact);
            } else {
                assert_true(distance < 1.0); /* a corner of the lamp comes near the point's plane, or below */
            }
            kiln_free(&lights.nodes);
        }
}

static void others_are_left_alone(void **state)
{
    (void)state;
    uint32_t seed = 11;
    struct kiln_area_light light[2] = {lamp(1.0, 1.0, &seed), lamp(1.0, 1.0, &seed)};
    struct kiln_area_light_sampler target;
    struct kiln_lights two = lights_of(light, 2), one = lights_of(light, 1);
    const struct kiln_dvec3 origin = dvec3(0, 0, 0), above = dvec3(0, 5, 0);
    const struct kiln_light_choice sky = {.kind = KILN_CHOICE_ENVIRONMENT, .samples = 8};
    assert_false(kiln_area_light_sampler(&two, &lone, origin, 0.0, &target)); /* the root is a cluster */
    assert_false(kiln_area_light_sampler(&one, &sky, origin, 0.0, &target));
    assert_false(kiln_area_light_sampler(&one, &lone, above, 0.0, &target)); /* from behind */
    assert_true(kiln_area_light_sampler(&one, &lone, origin, 0.0, &target));
    assert_false(kiln_area_light_sampler(&one, &lone, origin, 0.2 * target.view.height, &target));
    kiln_free(&two.nodes);
    kiln_free(&one.nodes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(directions_are_even), cmocka_unit_test(same_as_one_by_one_at_the_centre),
        cmocka_unit_test(closed_form_from_other_places), cmocka_unit_test(others_are_left_alone)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
