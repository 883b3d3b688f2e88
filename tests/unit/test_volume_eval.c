/* Tests of interpolation in the irradiance volume, and of files that are not a volume. tests/output checks the content
 * of real files. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/files/publish.h"
#include "coordinator/output/volume_eval.h"
#include "worker/sampling/harmonics.h"

static const uint64_t size[3] = {4, 3, 1};
static const double origin[3] = {-1, 2, 5}, spacing[3] = {0.5, 2, 1};

/* Weights sum to 1 and reproduce a linear function of position. */
static void check_linear(double x, double y, double z, bool expect_outside)
{
    const double position[3] = {x, y, z};
    uint64_t at[8][3];
    double weight[8], sum = 0.0, middle[3] = {0};
    bool outside;
    const int count = kiln_volume_corners(size, origin, spacing, position, at, weight, &outside);
    assert_true(count >= 1 && count <= 8);
    for (int k = 0; k < count; k++) {
        sum += weight[k];
        for (int i = 0; i < 3; i++) {
            assert_true(at[k][i] < size[i]);
            middle[i] += weight[k] * (origin[i] + spacing[i] * (double)at[k][i]);
        }
    }
    assert_true(fabs(sum - 1.0) < 1e-12);
    assert_int_equal(outside, expect_outside);
    for (int i = 0; i < 3; i++) {
        const double last = origin[i] + spacing[i] * (double)(size[i] - 1);
        assert_true(fabs(middle[i] - fmin(fmax(position[i], origin[i]), last)) < 1e-12);
    }
}

static void test_corners(void **state)
{
    (void)state;
    check_linear(-0.3, 3.1, 5, false);
    check_linear(-1, 2, 5, false);
    check_linear(0.5, 6, 5, false);
    check_linear(0.25, 4, 5, false);
    check_linear(0.51, 4, 5, true);
    check_linear(-7, 100, 5, true);
    check_linear(0, 3, 5.1, true);
    check_linear(0, 3, -1e300, true);
}

static void test_a_probe_counts_alone_where_it_stands(void **state)
{
    (void)state;
    for (uint64_t x = 0; x < size[0]; x++) {
        const double position[3] = {origin[0] + spacing[0] * (double)x, 4, 5};
        uint64_t at[8][3];
        double weight[8];
        assert_int_equal(kiln_volume_corners(size, origin, spacing, position, at, weight, NULL), 1);
        assert_int_equal(at[0][0], x);
        assert_int_equal(at[0][1], 1);
        assert_true(weight[0] == 1.0);
    }
}

static void test_trust(void **state)
{
    (void)state;
    assert_true(kiln_volume_trust(0.0f) == 0.0f);
    assert_true(kiln_volume_trust(0.5f) == 0.0f);
    assert_true(kiln_volume_trust(0.625f) == 0.5f);
    assert_true(kiln_volume_trust(0.75f) == 1.0f);
    assert_true(kiln_volume_trust(1.0f) == 1.0f);
}

/* Radiance L(d) = 1 + d.y gives E(n) = pi + 2 pi / 3 n.y, by integration; the harmonics must say so. */
static void test_irradiance_of_known_light(void **state)
{
    (void)state;
    struct kiln_volume_probe light = {.validity = 1.0f};
    for (int c = 0; c < 3; c++) {
        light.harmonics[0][c] = (float)(kiln_harmonics_cosine(0) / 0.28209479177387814);
        light.harmonics[1][c] = (float)(kiln_harmonics_cosine(1) / 0.4886025119029199);
    }
    const double normals[4][3] = {{0, 1, 0}, {0, -1, 0}, {1, 0, 0}, {0.6, 0.8, 0}};
    for (int i = 0; i < 4; i++) {
        double irradiance[3];
        kiln_volume_irradiance(&light, normals[i], irradiance);
        for (int c = 0; c < 3; c++)
            assert_true(fabs(irradiance[c] - (KILN_PI + 2.0 * KILN_PI / 3.0 * normals[i][1])) < 1e-5);
    }
    for (int c = 0; c < 3; c++) /* a series that dips below zero */
        light.harmonics[1][c] *= 4.0f;
    double irradiance[3];
    kiln_volume_irradiance(&light, normals[1], irradiance);
    assert_true(irradiance[0] == 0.0 && irradiance[1] == 0.0 && irradiance[2] == 0.0);
}

static void add_plane(struct kiln_probe_occluders *o, const double normal[3], double away)
{
    for (int i = 0; i < KILN_OCCLUDER_DIRECTIONS; i++) {
        const double d[3] = {i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1};
        double now = 0.0, then = 0.0;
        for (int a = 0; a < 3; a++) {
            now += (double)o->planes[i][a] * d[a];
            then += normal[a] / away * d[a];
        }
        for (int a = 0; then > now && a < 3; a++) /* it is met first */
            o->planes[i][a] = (float)(normal[a] / away);
    }
}

/* Whether what the planes hide is seen and what they do not hide is not, at places all around. */
static void check_sees(const struct kiln_probe_occluders *o, const double normals[][3], const double *away, int count)
{
    for (int i = 0; i < 9 * 9 * 9; i++) {
        const double v[3] = {0.31 * (i % 9 - 4) + 0.01, 0.31 * (i / 9 % 9 - 4) - 0.02, 0.31 * (i / 81 - 4) + 0.03};
        double behind = 0.0;
        for (int k = 0; k < count; k++)
            behind = fmax(behind, (normals[k][0] * v[0] + normals[k][1] * v[1] + normals[k][2] * v[2]) / away[k]);
        const double sees = kiln_volume_sees(o, v);
        if (behind < 0.999)
            assert_true(sees == 1.0);
        else if (behind > 1.011)
            assert_true(sees == 0.0);
    }
}

/* No plane, planes of any slope, and two and three at a corner of a room: exact everywhere. */
static void test_planes_hide_what_is_behind_them(void **state)
{
    (void)state;
    const double slopes[4][3] = {{1, 0, 0}, {0, -0.6, 0.8}, {0.48, -0.6, 0.64}, {-0.28, 0, 0.96}};
    const double corner[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, -1}}, corner_away[3] = {0.9, 0.5, 0.35};
    struct kiln_probe_occluders o = {{{0}}};
    check_sees(&o, NULL, NULL, 0);
    for (int i = 0; i < 4; i++) {
        o = (struct kiln_probe_occluders){{{0}}};
        add_plane(&o, slopes[i], 0.7);
        check_sees(&o, &slopes[i], &(const double){0.7}, 1);
    }
    o = (struct kiln_probe_occluders){{{0}}};
    for (int i = 0; i < 3; i++) {
        add_plane(&o, corner[i], corner_away[i]);
        check_sees(&o, corner, corner_away, i + 1);
    }
}

/* Something that ends beside a direction in which nothing is: half of what is between is hidden. */
static void test_sight_past_an_edge(void **state)
{
    (void)state;
    struct kiln_probe_occluders o = {{{0}}};
    o.planes[14][0] = 2.0f; /* met along +x, half a metre away, and nowhere else */
    assert_true(kiln_volume_sees(&o, (const double[3]){0.6, 0.0, 0.0}) == 0.0);
    assert_true(kiln_volume_sees(&o, (const double[3]){0.6, 0.05, 0.0}) == 0.0);
    assert_true(kiln_volume_sees(&o, (const double[3]){0.6, 0.3, 0.0}) == 1.0);
    assert_true(kiln_volume_sees(&o, (const double[3]){-0.6, 0.0, 0.0}) == 1.0);
}

static void test_other_files_are_refused(void **state)
{
    (void)state;
    char folder[] = "/tmp/kiln-volume-XXXXXX", path[64];
    struct kiln_volume *volume = NULL;
    struct kiln_error error = {{0}};
    assert_non_null(mkdtemp(folder));
    (void)snprintf(path, sizeof path, "%s/volume.hdf", folder);
    assert_int_equal(kiln_volume_open(&volume, path, &error), KILN_NO_INPUT);
    assert_null(volume);
    assert_int_equal(kiln_publish_bytes(path, "not HDF5 at all", 15, NULL), 0);
    assert_int_equal(kiln_volume_open(&volume, path, &error), KILN_BAD_INPUT);
    assert_null(volume);
    assert_non_null(strstr(error.message, path));
    assert_int_equal(unlink(path), 0);
    assert_int_equal(rmdir(folder), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_corners),
                                       cmocka_unit_test(test_a_probe_counts_alone_where_it_stands),
                                       cmocka_unit_test(test_trust),
                                       cmocka_unit_test(test_irradiance_of_known_light),
                                       cmocka_unit_test(test_planes_hide_what_is_behind_them),
                                       cmocka_unit_test(test_sight_past_an_edge),
                                       cmocka_unit_test(test_other_files_are_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
