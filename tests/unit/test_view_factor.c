/* View factors to parallelograms against closed forms (Howell, "A Catalog of Radiation Heat Transfer Configuration
 * Factors", B-4 and B-5), clipped at one horizon and at two. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "worker/light/view_factor.h"

/* A rectangle with a corner at `corner`. */
static struct kiln_parallelogram from_corner(struct kiln_dvec3 corner, struct kiln_dvec3 s, struct kiln_dvec3 t)
{
    return (struct kiln_parallelogram){dvec3_add(corner, dvec3_scale(dvec3_add(s, t), 0.5)), s, t};
}

static const struct kiln_dvec3 up = {0.0, 1.0, 0.0};

static void is_near(double found, double wanted, double relative)
{
    if (!(fabs(found - wanted) <= relative * fabs(wanted)))
        fail_msg("%.12g in the place of %.12g", found, wanted);
}

/* B-4: a x b at the height c, whose corner is over the piece. */
static void test_parallel(void **state)
{
    (void)state;
    static const double rows[][4] = {{1, 1, 1, 0.1385316060},
                                     {0.5, 0.5, 1, 0.05986411762},
                                     {0.5, 0.5, 0.001, 0.2499991817},
                                     {1, 1000, 1, 0.1767766952},
                                     {0.0005, 0.0005, 1, 7.957744502e-8}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const struct kiln_parallelogram p =
            from_corner(dvec3(0, rows[i][2], 0), dvec3(rows[i][0], 0, 0), dvec3(0, 0, rows[i][1]));
        is_near(kiln_view_factor_near(&p, up, up), rows[i][3], 1e-6);
        const struct kiln_parallelogram turned = {p.centre, p.edge_t, p.edge_s}; /* its other face */
        is_near(kiln_view_factor_near(&turned, up, up), rows[i][3], 1e-6);
    }
}

/* B-5: a wide and b high, upright on the plane of the piece at the distance c, beginning beside it. */
static void test_perpendicular(void **state)
{
    (void)state;
    static const double rows[][4] = {
        {1, 1, 1, 0.05573419700}, {1, 1, 0.001, 0.2497158452}, {1, 1, 100, 1.591284214e-7}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const double a = rows[i][0], b = rows[i][1], c = rows[i][2];
        const struct kiln_parallelogram p = from_corner(dvec3(0, 0, c), dvec3(b, 0, 0), dvec3(0, a, 0)),
                                        sunk = from_corner(dvec3(0, -3.0 * a, c), dvec3(b, 0, 0), dvec3(0, 4.0 * a, 0));
        is_near(kiln_view_factor_near(&p, up, up), rows[i][3], 1e-6);
        is_near(kiln_view_factor_near(&sunk, up, up), rows[i][3], 1e-6); /* of which three quarters are below */
    }
}

/* A wall without an end before the piece, and a normal at an angle to its own: of the light from elevations 0 to pi / 2
 * only what both horizons leave counts. */
static void test_two_horizons(void **state)
{
    (void)state;
    const double angle = 0.4;
    const struct kiln_dvec3 back = dvec3(0.0, cos(angle), -sin(angle)), front = dvec3(0.0, cos(angle), sin(angle));
    const struct kiln_parallelogram wall = from_corner(dvec3(-1e6, -1e6, 1.0), dvec3(2e6, 0, 0), dvec3(0, 2e6, 0));
    is_near(kiln_view_factor_near(&wall, up, up), 0.5, 1e-5);
    is_near(kiln_view_factor_near(&wall, up, back), 0.5 * (1.0 - sin(angle)), 1e-5);
    is_near(kiln_view_factor_near(&wall, up, front), 0.5 * (cos(angle) + sin(angle)), 1e-5);
    const struct kiln_parallelogram below = from_corner(dvec3(0, -2, 1), dvec3(1, 0, 0), dvec3(0, 1, 0));
    assert_true(kiln_view_factor_near(&below, up, up) == 0.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_parallel), cmocka_unit_test(test_perpendicular),
                                       cmocka_unit_test(test_two_horizons)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
