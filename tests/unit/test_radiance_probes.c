/* Radiance probes: the maps cover all directions, harmonics of a constant have one coefficient and those of a harmonic
 * come back, all bases have the far field of a smooth closed form, a ray asks only probes that it may, and the grid
 * lies in the scene's box. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/integrate/probes/radiance_grid.h"
#include "worker/sampling/harmonics.h"

static const struct kiln_geometry box = {.bounds_min = {-4.0f, -1.0f, -2.0f}, .bounds_max = {4.0f, 1.0f, 2.0f}};

static struct kiln_probe_grid grid_of(int basis, uint32_t side, uint32_t samples, double spacing)
{
    struct kiln_probe_grid grid;
    const struct kiln_radiance_settings settings = {
        .spacing = spacing, .basis = basis, .side = side, .samples = samples};
    assert_int_equal(kiln_probe_grid_make(&grid, &settings, &box, NULL), KILN_OK);
    return grid;
}

/* Each place of a map points at its element, and the elements' solid angles add up to the sphere. */
static void maps_cover_the_sphere(void **state)
{
    (void)state;
    for (int basis = 0; basis < 3; basis++) {
        const struct kiln_probe_grid grid = grid_of(basis, 5, 100, 0.5);
        const uint32_t count = kiln_probe_elements(grid.basis, grid.side);
        struct kiln_probe_element *elements = calloc(count, sizeof *elements);
        double all = 0.0, harmonics[KILN_HARMONICS] = {0.0};
        kiln_probe_elements_make(&grid, elements);
        for (uint32_t e = 0; e < count; e++) {
            all += elements[e].solid_angle;
            assert_true(elements[e].solid_angle > 0.0);
            for (int h = 0; h < KILN_HARMONICS; h++)
                harmonics[h] += elements[e].harmonics[h];
            for (int i = 0; i < 16; i++) {
                const float s = 0.03f + 0.94f * (float)(i % 4) / 3.0f, t = 0.03f + 0.94f * (float)(i / 4) / 3.0f;
                const struct kiln_vec3 at = kiln_probe_point(grid.basis, grid.side, e, s, t);
                assert_int_equal(kiln_probe_element(grid.basis, grid.side, vec3_scale(at, 0.3f)), e);
            }
        }
        assert_true(fabs(all - 4.0 * KILN_PI) < 1e-9 && fabs(harmonics[0] - 2.0 * sqrt(KILN_PI)) < 1e-3);
        for (int h = 1; h < KILN_HARMONICS; h++)
            assert_true(fabs(harmonics[h]) < 1e-9);
        free(elements);
    }
}

/* Radiance 2 + Y_h(w) is kept as it is, within what elements of a finite size take from it. */
static void harmonics_come_back(void **state)
{
    (void)state;
    const struct kiln_probe_grid grid = grid_of(KILN_PROBE_HARMONICS, 0, 1024, 0.5);
    const uint32_t count = kiln_probe_elements(grid.basis, grid.side);
    struct kiln_probe_element *elements = calloc(count, sizeof *elements);
    struct kiln_radiance_result *results = calloc(count, sizeof *results);
    float data[3 * KILN_HARMONICS];
    assert_int_equal(grid.side, 32);
    assert_int_equal(grid.floats, 27);
    kiln_probe_elements_make(&grid, elements);
    for (int h = 0; h < KILN_HARMONICS; h++) {
        for (uint32_t e = 0; e < count; e++) {
            double y[KILN_HARMONICS];
            const struct kiln_dvec3 at = dvec3_of(kiln_probe_point(grid.basis, grid.side, e, 0.5f, 0.5f));
            kiln_harmonics(dvec3_scale(at, 1.0 / dvec3_length(at)), y);
            results[e].radiance[1] = 2.0f + (float)y[h];
        }
        kiln_probe_keep(&grid, elements, results, data);
        for (int i = 0; i < KILN_HARMONICS; i++) {
            const double expected = (i == h ? 1.0 : 0.0) + (i == 0 ? 4.0 * sqrt(KILN_PI) : 0.0);
            assert_true(fabs((double)data[3 * i + 1] - expected) < 0.01 && fabsf(data[3 * i]) < 1e-6f);
        }
    }
    struct kiln_radiance_probes probes = {
        .grid = grid, .positions = &(struct kiln_vec3){0.0f, 0.0f, 0.0f}, .data = data};
    float radiance[3];
    kiln_probe_ask(&probes, 0, vec3(0.0f, 0.0f, 0.0f), vec3(0.6f, 0.8f, 0.0f), 1.0f, radiance);
    assert_true(fabs((double)radiance[1] - 2.0 - 0.5462742152960396 * (0.36 - 0.64)) < 0.02);
    free(results);
    free(elements);
}

/* Smooth radiance that has a closed form: exp(1.2 z), of which the harmonics up to band 2 do not have all. Its
 * irradiance at a surface that faces +z is the integral of it times the cosine. */
#define SMOOTH 1.2
static double smooth_radiance(struct kiln_vec3 d) { return exp(SMOOTH * (double)d.z / (double)vec3_length(d)); }
static double smooth_irradiance(void)
{
    return 2.0 * KILN_PI * ((SMOOTH - 1.0) * exp(SMOOTH) + 1.0) / (SMOOTH * SMOOTH);
}

/* Mean of the radiance over each element, as the radiance pass has it: places even on the map, weighed by their solid
 * angle. */
static void fill_in(const struct kiln_probe_grid *grid, struct kiln_radiance_result *results)
{
    enum { ALONG = 16 };
    for (uint32_t e = 0; e < kiln_probe_elements(grid->basis, grid->side); e++) {
        double sum = 0.0, weights = 0.0;
        for (int i = 0; i < ALONG * ALONG; i++) {
            const struct kiln_vec3 at = kiln_probe_point(
                grid->basis, grid->side, e, ((float)(i % ALONG) + 0.5f) / ALONG, ((float)(i / ALONG) + 0.5f) / ALONG);
            const double weight = pow((double)vec3_length(at), -3.0);
            sum += weight * smooth_radiance(at);
            weights += weight;
        }
        results[e].radiance[0] = results[e].radiance[1] = results[e].radiance[2] = (float)(sum / weights);
    }
}

/* Measures the answers of a probe in the middle of the scene: the root mean square error of its radiance over all
 * directions, relative to the mean radiance, and the relative error of the irradiance. */
static void ask_everywhere(int basis, uint32_t side, double *radiance_error, double *irradiance_error)
{
    enum { ALONG = 200 };
    const struct kiln_probe_grid grid = grid_of(basis, side, 1024, 0.5);
    const uint32_t count = kiln_probe_elements(grid.basis, grid.side);
    struct kiln_probe_element *elements = calloc(count, sizeof *elements);
    struct kiln_radiance_result *results = calloc(count, sizeof *results);
    float *data = calloc(grid.floats, sizeof *data);
    const struct kiln_vec3 middle = vec3(0.0f, 0.0f, 0.0f);
    const struct kiln_radiance_probes probes = {.grid = grid, .positions = &middle, .data = data};
    double square = 0.0, mean = 0.0, irradiance = 0.0;
    kiln_probe_elements_make(&grid, elements);
    fill_in(&grid, results);
    kiln_probe_keep(&grid, elements, results, data);
    for (int i = 0; i < ALONG * ALONG; i++) {
        const double z = 2.0 * (i / ALONG + 0.5) / ALONG - 1.0, turn = 2.0 * KILN_PI * (i % ALONG + 0.5) / ALONG,
                     r = sqrt(1.0 - z * z);
        const struct kiln_vec3 d = vec3((float)(r * cos(turn)), (float)(r * sin(turn)), (float)z);
        float found[3];
        kiln_probe_ask(&probes, 0, middle, d, kiln_probe_far(grid, middle, d), found);
        square += pow((double)found[1] - smooth_radiance(d), 2.0) / (ALONG * ALONG);
        mean += smooth_radiance(d) / (ALONG * ALONG);
        irradiance += fmax(z, 0.0) * (double)found[1] * 4.0 * KILN_PI / (ALONG * ALONG);
    }
    *radiance_error = sqrt(square) / mean;
    *irradiance_error = fabs(irradiance / smooth_irradiance() - 1.0);
    free(data);
    free(results);
    free(elements);
}

/* Maps of more elements come nearer and nearer, in proportion to an element's side, and the irradiance in proportion to
 * its square. */
static void all_bases_have_the_same_far_field(void **state)
{
    (void)state;
    double radiance, irradiance, before[2];
    ask_everywhere(KILN_PROBE_HARMONICS, 0, &radiance, &irradiance);
    assert_true(radiance < 0.04 && irradiance < 0.005);
    for (int basis = KILN_PROBE_OCTAHEDRAL; basis <= (int)KILN_PROBE_CUBE; basis++) {
        ask_everywhere(basis, 4, &before[0], &before[1]);
        for (uint32_t side = 8; side <= 32; side *= 2) {
            ask_everywhere(basis, side, &radiance, &irradiance);
            assert_true(radiance < 0.6 * before[0] && irradiance < 0.4 * before[1]);
            before[0] = radiance;
            before[1] = irradiance;
        }
        assert_true(radiance < 0.05 && irradiance < 0.005);
    }
}

/* By their weights, and only of those that are seen. */
static void drawn_as_weighted(void **state)
{
    (void)state;
    enum { DRAWS = 20000 };
    uint32_t drawn[8] = {0};
    const struct kiln_vec3 f = vec3(0.25f, 0.5f, 0.0f);
    const uint32_t seen = 1u | 2u | 8u | 64u;
    for (int i = 0; i < DRAWS; i++)
        drawn[kiln_probe_choose(seen, f, ((float)i + 0.5f) / DRAWS)]++;
    const double weights[8] = {0.375, 0.125, 0.0, 0.125};
    for (uint32_t c = 0; c < 8; c++) {
        const double expected = (seen >> c & 1u) != 0 ? weights[c] / 0.625 : 0.0;
        assert_true(fabs((double)drawn[c] / DRAWS - expected) < 1e-3);
        assert_true((seen >> c & 1u) != 0 || drawn[c] == 0);
        assert_int_equal(kiln_probe_choose(1u << c, f, 0.999f), c);
    }
}

static void the_grid_lies_in_the_box(void **state)
{
    (void)state;
    const struct kiln_probe_grid grid = grid_of(KILN_PROBE_OCTAHEDRAL, 0, 64, 1.0);
    assert_true(grid.size[0] == 8 && grid.size[1] == 2 && grid.size[2] == 4);
    for (uint64_t i = 0; i < kiln_probes_count(&grid); i++) {
        const struct kiln_vec3 at = kiln_probe_grid_position(&grid, i);
        assert_true(fabsf(at.x) <= 3.5f && fabsf(at.y) <= 0.5f && fabsf(at.z) <= 1.5f);
    }
    assert_int_equal(kiln_probe_cell(&grid, vec3(-9.0f, 0.0f, -9.0f)), 0);
    const uint32_t last = kiln_probe_cell(&grid, vec3(9.0f, 9.0f, 9.0f));
    assert_int_equal(kiln_probe_at_corner(&grid, last, 7), kiln_probes_count(&grid) - 1);
    const struct kiln_probe_grid one = grid_of(KILN_PROBE_OCTAHEDRAL, 0, 64, 3.0); /* a probe thick along y and z */
    assert_true(one.size[0] == 3 && one.size[1] == 1 && one.size[2] == 1);
    assert_int_equal(kiln_probe_corners(one), 3);
    assert_true(kiln_probe_far(grid, vec3(0.0f, 0.5f, 0.0f), vec3(0.0f, 1.0f, 0.0f)) == 0.5f);
    struct kiln_probe_grid many;
    struct kiln_error error;
    const struct kiln_radiance_settings fine = {.spacing = 1e-3, .samples = 1};
    assert_int_equal(kiln_probe_grid_make(&many, &fine, &box, &error), KILN_USAGE);
    assert_non_null(strstr(error.message, "--radiance-probe-spacing"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(maps_cover_the_sphere), cmocka_unit_test(harmonics_come_back),
                                       cmocka_unit_test(all_bases_have_the_same_far_field),
                                       cmocka_unit_test(drawn_as_weighted), cmocka_unit_test(the_grid_lies_in_the_box)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
