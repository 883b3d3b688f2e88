/* Tests of normal maps in views: the factors on irradiance against closed forms, and the tangent frame. */
#include <setjmp.h> // IWYU pragma: keep
#include <stdarg.h> // IWYU pragma: keep
#include <stddef.h> // IWYU pragma: keep
#include <stdint.h> // IWYU pragma: keep

#include <cmocka.h>

#include <math.h>

#include "coordinator/view/normal_map.h"
#include "tests/unit/surface_scene.h"

static void near(double a, double b, double tolerance)
{
    if (!(fabs(a - b) <= tolerance))
        fail_msg("%.9g is not %.9g within %g", a, b, tolerance);
}

/* The unit vector that is `degrees` off the y axis, towards `azimuth`. */
static struct kiln_dvec3 leaning(double degrees, double azimuth)
{
    const double t = degrees * KILN_PI / 180.0, a = azimuth * KILN_PI / 180.0;
    return dvec3(sin(t) * cos(a), cos(t), sin(t) * sin(a));
}

/* Adds light of so much irradiance on a facing surface, from direction d. */
static void add_lamp(float sh[KILN_NORMAL_HARMONICS], struct kiln_dvec3 d, double irradiance)
{
    double y[KILN_HARMONICS];
    kiln_harmonics(d, y);
    for (int i = 0; i < KILN_NORMAL_HARMONICS; i++)
        sh[i] += (float)(irradiance * y[i]);
}

/* Adds light of radiance 1 from all directions within `degrees` of the y axis. */
static void add_cap(double sum[KILN_NORMAL_HARMONICS], double degrees)
{
    enum { RINGS = 400, STEPS = 64 };
    for (int i = 0; i < RINGS; i++)
        for (int j = 0; j < STEPS; j++) {
            const double low = degrees * i / RINGS, high = degrees * (i + 1) / RINGS;
            const double solid = 2.0 * KILN_PI / STEPS * (cos(low * KILN_PI / 180.0) - cos(high * KILN_PI / 180.0));
            double y[KILN_HARMONICS];
            kiln_harmonics(leaning(0.5 * (low + high), 360.0 * j / STEPS), y);
            for (int k = 0; k < KILN_NORMAL_HARMONICS; k++)
                sum[k] += solid * y[k];
        }
}

/* One lamp: what bands 0 and 1 make of it, 1/4 + n.d / 2, and exactly the ratio of cosines by its direction. */
static void one_lamp(void **state)
{
    (void)state;
    double worst = 0.0;
    const struct kiln_dvec3 n = leaning(0.0, 0.0);
    for (double lamp = 0.0; lamp <= 80.0; lamp += 10.0)
        for (double tilt = 0.0; tilt <= 30.0; tilt += 10.0)
            for (double azimuth = 0.0; azimuth < 360.0; azimuth += 30.0) {
                float sh[KILN_NORMAL_HARMONICS] = {0};
                const struct kiln_dvec3 d = leaning(lamp, 20.0), m = leaning(tilt, azimuth);
                const double before = dvec3_dot(n, d), after = fmax(0.0, dvec3_dot(m, d));
                add_lamp(sh, d, 3.0);
                near(kiln_normal_sh_irradiance(sh, m), 3.0 * (0.25 + 0.5 * dvec3_dot(m, d)), 1e-6);
                near(kiln_normal_factor_sh(sh, n, m), (0.25 + 0.5 * dvec3_dot(m, d)) / (0.25 + 0.5 * before), 1e-6);
                near(kiln_normal_factor_dominant(dvec3_scale(d, 0.3), 1.0, n, m), after / before, 1e-12);
                near(kiln_normal_factor_dominant(d, 0.5, n, m), 0.5 + 0.5 * after / before, 1e-12);
                near(kiln_normal_factor_dominant(d, 0.0, n, m), 1.0, 0.0);
                if (lamp <= 60.0 && tilt <= 20.0)
                    worst = fmax(worst, fabs(kiln_normal_factor_sh(sh, n, m) - after / before));
            }
    /* of a lamp within 60 degrees, whose factor on a tilt of 20 degrees is 0.35 to 1.53 */
    near(worst, 0.3219, 0.0001);
}

/* Light that is the same from everywhere does not see a normal; a uniform hemisphere gives a tilted surface the part of
 * it that is above. Both forms are exact. */
static void even_light(void **state)
{
    (void)state;
    double all[KILN_NORMAL_HARMONICS] = {0}, half[KILN_NORMAL_HARMONICS] = {0};
    float everywhere[KILN_NORMAL_HARMONICS], hemisphere[KILN_NORMAL_HARMONICS];
    const struct kiln_dvec3 n = leaning(0.0, 0.0);
    add_cap(all, 180.0);
    add_cap(half, 90.0);
    for (int i = 0; i < KILN_NORMAL_HARMONICS; i++) {
        everywhere[i] = (float)all[i];
        hemisphere[i] = (float)half[i];
    }
    near(kiln_normal_sh_irradiance(hemisphere, n), KILN_PI, 1e-4);
    for (double tilt = 0.0; tilt <= 90.0; tilt += 15.0) {
        const struct kiln_dvec3 m = leaning(tilt, 77.0);
        near(kiln_normal_factor_sh(everywhere, n, m), 1.0, 1e-5);
        near(kiln_normal_factor_sh(hemisphere, n, m), 0.5 * (1.0 + dvec3_dot(n, m)), 1e-4);
        /* the mean direction of a uniform hemisphere is n, of length 1/2 */
        near(half[1] / (half[0] * sqrt(3.0)), 0.5, 1e-4);
        near(kiln_normal_factor_dominant(n, 0.5, n, m), 0.5 * (1.0 + dvec3_dot(n, m)), 1e-12);
    }
}

/* Where the light grazes the surface or comes from below: between 0 and the bound, 1 for the unmapped normal, without a
 * step. */
static void bounded_and_continuous(void **state)
{
    (void)state;
    const struct kiln_dvec3 n = leaning(0.0, 0.0);
    double most_sh = 0.0, most_dominant = 0.0;
    for (double tilt = 0.0; tilt <= 90.0; tilt += 5.0) {
        double last[2] = {0.0, 0.0};
        for (double lamp = 0.0; lamp <= 180.0; lamp += 0.01) {
            float sh[KILN_NORMAL_HARMONICS] = {0};
            const struct kiln_dvec3 d = leaning(lamp, 0.0), m = leaning(tilt, 0.0);
            add_lamp(sh, d, 1e-3);
            const double f[2] = {kiln_normal_factor_sh(sh, n, m), kiln_normal_factor_dominant(d, 1.0, n, m)};
            assert_true(f[0] >= 0.0 && f[0] <= 12.0 && f[1] >= 0.0 && f[1] <= 8.0);
            near(kiln_normal_factor_sh(sh, n, n), 1.0, 1e-9);
            near(kiln_normal_factor_dominant(d, 1.0, n, n), 1.0, 1e-9);
            if (lamp > 0.0)
                assert_true(fabs(f[0] - last[0]) < 0.02 && fabs(f[1] - last[1]) < 0.02);
            last[0] = f[0];
            last[1] = f[1];
            most_sh = fmax(most_sh, f[0]);
            most_dominant = fmax(most_dominant, f[1]);
        }
        assert_true(last[0] == 1.0 && last[1] == 1.0); /* from right below: E stays */
    }
    assert_true(most_sh > 4.0 && most_dominant > 7.0); /* the bounds are not far off */
    const float black[KILN_NORMAL_HARMONICS] = {0}, broken[KILN_NORMAL_HARMONICS] = {NAN, INFINITY, 1, 1};
    near(kiln_normal_factor_sh(black, n, leaning(20, 0)), 1.0, 0.0);
    near(kiln_normal_factor_sh(broken, n, leaning(20, 0)), 1.0, 0.0);
    near(kiln_normal_factor_dominant(dvec3(0, 0, 0), 1.0, n, leaning(20, 0)), 1.0, 0.0);
    near(kiln_normal_factor_dominant(dvec3(NAN, 0, 1), 1.0, n, leaning(20, 0)), 1.0, 0.0);
}

/* ---- tangent frame ---- */

struct plate {
    struct fixture *f;
    struct kiln_geometry *geometry;
    struct kiln_normal_map map;
};

/* A square in the plane z = 0 that faces +z, whose texture coordinates are u = a x + b y, v = c x + d y, and a map
 * whose one texel is `rgb`. */
static void make_plate(struct plate *p, const double uv[4], const double transform[12], const uint8_t rgb[3])
{
    uint32_t texture;
    p->f = fixture_create();
    uint8_t *texel = fixture_texture(p->f, 1, 1, &texture);
    memcpy(texel, rgb, 3);
    const uint32_t material = fixture_material(p->f, 1, 1, 1), mesh = fixture_mesh(p->f);
    for (int i = 0; i < 4; i++) {
        const double x = i == 1 || i == 2, y = i >= 2;
        fixture_vertex(p->f, x, y, 0, uv[0] * x + uv[1] * y, uv[2] * x + uv[3] * y);
    }
    fixture_triangle(p->f, 0, 1, 2, material);
    fixture_triangle(p->f, 0, 2, 3, material);
    fixture_object(p->f, mesh, transform, 8, 8);
    p->map = (struct kiln_normal_map){.material = material, .texture = texture, .scale = 1.0f};
    p->f->scene.normal_maps = &p->map;
    p->f->scene.normal_map_count = 1;
    p->f->scene.texcoord_normal = p->f->base;
    assert_int_equal(kiln_geometry_create(&p->geometry, &p->f->scene, NULL), KILN_OK);
}

static struct kiln_dvec3 mapped(const struct plate *p, struct kiln_dvec3 n)
{
    const struct kiln_dvec3 a = kiln_normal_map_apply(&p->f->scene, p->geometry, &p->map, 0, 0.2f, 0.3f, n),
                            b = kiln_normal_map_apply(&p->f->scene, p->geometry, &p->map, 1, 0.2f, 0.3f, n);
    near(a.x, b.x, 1e-6);
    near(a.y, b.y, 1e-6);
    near(a.z, b.z, 1e-6);
    near(dvec3_length(a), 1.0, 1e-12);
    return a;
}

static void drop_plate(struct plate *p)
{
    kiln_geometry_destroy(&p->geometry);
    fixture_destroy(p->f);
}

/* The map's normal leans by (0.6, 0.2) of its height, along u and against v. */
static void the_frame_follows_the_coordinates(void **state)
{
    (void)state;
    static const double straight[12] = {1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7},
                        mirrored[12] = {-1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7},
                        turned[12] = {0, -2, 0, 5, 2, 0, 0, 6, 0, 0, 2, 7};
    static const uint8_t leaning_map[3] = {242, 166, 255}; /* 0.898, 0.302, 1 */
    const double x = 2 * 242 / 255.0 - 1, y = 2 * 166 / 255.0 - 1, length = sqrt(x * x + y * y + 1);
    const struct {
        double uv[4];
        const double *transform;
        double lean[2];                               /* along the world's x and y */
    } cases[] = {{{1, 0, 0, -1}, straight, {x, y}},   /* u right, v down: the texture as one looks at it */
                 {{3, 0, 0, -7}, straight, {x, y}},   /* repeated: directions only */
                 {{-1, 0, 0, -1}, straight, {-x, y}}, /* mirrored coordinates: a left-handed frame */
                 {{1, 0, 0, 1}, straight, {x, -y}},   /* v up: upside down */
                 {{0, 1, 1, 0}, straight, {-y, x}},   /* u up, v right */
                 {{1, 0, 0, -1}, turned, {-y, x}},    /* the object turned by a quarter */
                 {{1, 0, 0, -1}, mirrored, {-x, y}}}; /* the object mirrored */
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct plate p;
        make_plate(&p, cases[i].uv, cases[i].transform, leaning_map);
        const struct kiln_dvec3 m = mapped(&p, dvec3(0, 0, 1));
        near(m.x, cases[i].lean[0] / length, 1e-6);
        near(m.y, cases[i].lean[1] / length, 1e-6);
        near(m.z, 1.0 / length, 1e-6);
        /* about a leaning shading normal it keeps its angle to that */
        near(dvec3_dot(mapped(&p, leaning(30, 0)), leaning(30, 0)), 1.0 / length, 1e-6);
        p.map.scale = 0.5f;
        const struct kiln_dvec3 half = mapped(&p, dvec3(0, 0, 1));
        near(half.x / half.z, 0.5 * cases[i].lean[0], 1e-6);
        near(half.y / half.z, 0.5 * cases[i].lean[1], 1e-6);
        assert_ptr_equal(kiln_normal_map_of(&p.f->scene, 1), &p.map);
        p.map.material = 1; /* of another material */
        assert_null(kiln_normal_map_of(&p.f->scene, 1));
        drop_plate(&p);
    }
}

/* Coordinates without area, and a texel that is no direction: the normal stays. */
static void without_a_frame_the_normal_stays(void **state)
{
    (void)state;
    static const double none[4] = {0, 0, 0, 0}, line[4] = {1, 1, 1, 1}, square[4] = {1, 0, 0, -1};
    static const uint8_t leaning_map[3] = {242, 166, 255};
    const double *uv[] = {none, line};
    for (int i = 0; i < 2; i++) {
        struct plate p;
        make_plate(&p, uv[i], NULL, leaning_map);
        const struct kiln_dvec3 m = mapped(&p, dvec3(0, 0, 1));
        assert_true(m.x == 0.0 && m.y == 0.0 && m.z == 1.0);
        drop_plate(&p);
    }
    struct plate p;
    make_plate(&p, square, NULL, leaning_map);
    const struct kiln_dvec3 m = mapped(&p, dvec3(1, 0, 0)); /* the u axis itself */
    assert_true(m.x == 1.0 && m.y == 0.0 && m.z == 0.0);
    drop_plate(&p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_lamp),
        cmocka_unit_test(even_light),
        cmocka_unit_test(bounded_and_continuous),
        cmocka_unit_test(the_frame_follows_the_coordinates),
        cmocka_unit_test(without_a_frame_the_normal_stays),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
