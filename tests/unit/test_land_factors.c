/* Factors of techniques from the moments of their regions' points (coordinator/integrate/land_factors.h). */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "coordinator/integrate/land_factors.h"

enum { TILES = 24, EACH = 4, POINTS = TILES * EACH }; /* 8 tiles a region */

struct points {
    struct kiln_surface surface;
    struct kiln_lightmap map;
    struct kiln_tile_run runs[TILES];
    struct kiln_caustic_moments moments[POINTS];
};

static void make(struct points *p)
{
    *p = (struct points){.surface = {.tile_count = TILES, .count = POINTS, .tile_run_count = TILES}};
    p->surface.lightmaps = &p->map;
    p->surface.tile_runs = p->runs;
    for (uint32_t t = 0; t < TILES; t++)
        p->runs[t] = (struct kiln_tile_run){.first = {(uint64_t)t * EACH}, .tile = t, .count = EACH};
    for (uint32_t i = 0; i < POINTS; i++) {
        struct kiln_caustic_moments *m = &p->moments[i];
        const float level = 1.0f + (float)(i % 5);
        if (i / EACH / 8 == 0) /* hits are sure of their light, samples are not; a net of rays makes either better */
            *m = (struct kiln_caustic_moments){.square = {4.0f * level, 3.0f * level},
                                               .variance = {1.0f * level, 3.0f * level},
                                               .net = {0.5f * level, 1.0f * level}};
        else if (i / EACH / 8 == 1) /* beyond all bounds; and nothing is sampled */
            *m = (struct kiln_caustic_moments){.square = {1e6f, 0.0f}, .variance = {1.0f, 0.0f}, .net = {1e6f, 0.0f}};
    }
}

static struct kiln_land_factors find(struct points *p, enum kiln_mis mis)
{
    struct kiln_land_factors f = {0};
    assert_int_equal(kiln_land_factors_create(&f, &p->surface, NULL), KILN_OK);
    assert_int_equal(f.regions, 3);
    assert_int_equal(kiln_land_factors_find(&f, MPI_COMM_SELF, mis, p->moments, &p->surface, NULL), KILN_OK);
    assert_true(kiln_land_factors_sane(&f));
    return f;
}

static void expect(struct points *p, enum kiln_mis mis, size_t region, double sample, double land)
{
    struct kiln_land_factors f = find(p, mis);
    print_message("rule %d, region %zu: %.6f, %.6f\n", (int)mis, region, (double)f.of[region].sample,
                  (double)f.of[region].land);
    assert_true(fabs((double)f.of[region].sample / sample - 1.0) < 1e-6);
    assert_true(fabs((double)f.of[region].land / land - 1.0) < 1e-6);
    kiln_land_factors_release(&f);
}

static void factors_are_ratios_of_moments(void **state)
{
    (void)state;
    struct points p;
    make(&p);
    expect(&p, KILN_MIS_VARIANCE, 0, 1.0 / 4.0, 1.0 / 4.0);
    expect(&p, KILN_MIS_CORRELATION, 0, 3.0 / 2.0, 1.0 / 2.0);
    expect(&p, KILN_MIS_VARIANCE, 1, 1.0 / 16.0, 1.0 / 16.0);
    expect(&p, KILN_MIS_CORRELATION, 1, 16.0, 16.0);
    expect(&p, KILN_MIS_VARIANCE, 2, 1.0, 1.0); /* nothing is known */
}

/* Exchanges solve A alpha = b where that is within bounds, else make the variance least there. */
static void exchanges_make_the_variance_least(void **state)
{
    (void)state;
    struct points p;
    make(&p);
    for (uint32_t i = 0; i < POINTS; i++) {
        const float level = 1.0f + (float)(i % 7);
        const uint32_t region = i / EACH / 8;
        p.moments[i] = (struct kiln_caustic_moments){.product = {0.0f}};
        if (region < 2) /* of 0.3 and -0.5; and of others beyond -1 */
            for (int k = 0; k < KILN_CAUSTIC_PRODUCTS; k++)
                p.moments[i].product[k] =
                    level * (float[2][KILN_CAUSTIC_PRODUCTS]){{2.0f, 1.0f, 4.0f, -0.1f, 1.7f},
                                                              {2.0f, 1.0f, 1.0f, 0.0f, 9.0f}}[region][k];
    }
    struct kiln_land_factors f = find(&p, KILN_MIS_OPTIMAL);
    const double expected[3][2] = {{0.3, -0.5}, {0.5, -1.0}, {0.0, 0.0}};
    for (int r = 0; r < 3; r++)
        for (int e = 0; e < KILN_CAUSTIC_EXCHANGES; e++)
            assert_true(fabs((double)f.of[r].exchange[e] - expected[r][e]) < 1e-6 && f.of[r].sample == 1.0f);
    f.of[1].exchange[0] = 1.5f;
    assert_false(kiln_land_factors_sane(&f));
    kiln_land_factors_release(&f);
}

/* Points in another order have the same bits. */
static void any_order_is_the_same(void **state)
{
    (void)state;
    struct points p, other;
    make(&p);
    for (uint32_t i = 0; i < POINTS; i++)
        for (int t = 0; t < KILN_CAUSTIC_GATHERS; t++)
            p.moments[i].square[t] += 0.1f * (float)(i * i % 37);
    other = p;
    other.surface.lightmaps = &other.map;
    other.surface.tile_runs = other.runs;
    for (uint32_t t = 0; t < TILES; t++) {
        other.runs[t].tile = TILES - 1 - t;
        memcpy(&other.moments[(size_t)t * EACH], &p.moments[(size_t)(TILES - 1 - t) * EACH], EACH * sizeof *p.moments);
    }
    struct kiln_land_factors one = find(&p, KILN_MIS_VARIANCE), two = find(&other, KILN_MIS_VARIANCE);
    assert_memory_equal(one.of, two.of, one.regions * sizeof *one.of);
    two.of[1].land = NAN;
    assert_false(kiln_land_factors_sane(&two));
    kiln_land_factors_release(&one);
    kiln_land_factors_release(&two);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(factors_are_ratios_of_moments),
                                       cmocka_unit_test(exchanges_make_the_variance_least),
                                       cmocka_unit_test(any_order_is_the_same)};
    (void)MPI_Init(NULL, NULL);
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    (void)MPI_Finalize();
    return failed;
}
