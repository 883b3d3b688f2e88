/* Sums of power over the points of a tile run, added up together and point by point: the same bits. Answers of all
 * sizes; terms that are negative, or too large for parts of doubles to have an exact sum. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "coordinator/integrate/ledger.h"
#include "shaders/shared/random.h"

static double random_number(uint32_t *seed)
{
    *seed = kiln_hash1(*seed + 1);
    return ((double)*seed + 0.5) / 4294967296.0;
}

struct point {
    struct kiln_ledger_point point;
    struct kiln_point_mean mean;
    float albedo[3], sent[3];
};

static void make(struct point *p, uint32_t *seed, bool sends, double size, double sign)
{
    *p = (struct point){.mean = {.count = 16, .present = 1.0f}};
    p->mean.error = (float)(size * random_number(seed));
    p->mean.escaped = sends && random_number(seed) > 0.5 ? (float)random_number(seed) : 0.0f;
    p->mean.blocked = sends && random_number(seed) > 0.7 ? (float)random_number(seed) : 0.0f;
    for (int c = 0; c < 3; c++) {
        p->albedo[c] = (float)random_number(seed);
        p->sent[c] = (float)(size * random_number(seed));
        p->mean.incident[c] = (float)(sign * size * pow(random_number(seed), 8.0));
    }
    p->point = (struct kiln_ledger_point){
        .area = 0.01 * random_number(seed), .albedo = p->albedo, .sent = sends ? p->sent : NULL};
}

static void agree(uint32_t count, uint32_t seed, bool sends, double size, double sign)
{
    const double unit = 0x1p-75;
    struct kiln_tally alone = {0}, together = {0};
    struct kiln_tile_run_tally alone_run = {0}, together_run = {0};
    struct kiln_tally_run run;
    run.count = 0;
    for (uint32_t k = 0; k < count; k++) {
        struct point p;
        make(&p, &seed, sends, size, sign);
        kiln_tally_add(&p.point, &p.mean, unit, &alone, &alone_run);
        kiln_tally_note(&run, &p.point, &p.mean);
    }
    kiln_tally_add_run(&run, unit, &together, &together_run);
    assert_true(count < 32 || alone.sums[KILN_SUM_INCIDENT].value != 0);
    assert_memory_equal(&alone, &together, sizeof alone);
    assert_memory_equal(&alone_run.reflected, &together_run.reflected, sizeof alone_run.reflected);
    assert_memory_equal(&alone_run.variance, &together_run.variance, sizeof alone_run.variance);
}

static void sums_agree(void **state)
{
    (void)state;
    for (uint32_t count = 1; count <= KILN_TILE_TEXELS; count++)
        for (int sends = 0; sends < 2; sends++) {
            agree(count, count, sends != 0, 1.0, 1.0);
            agree(count, count, sends != 0, 1e-15, 1.0);
            agree(count, count, sends != 0, 1e7, 1.0);
            agree(count, count, sends != 0, 1.0, -1.0);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(sums_agree)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
