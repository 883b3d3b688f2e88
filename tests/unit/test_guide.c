/* Guides of tile runs: the warp has the density that its weights say, whatever was learnt; and where light comes from
 * all over there is no guide. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "worker/backend/guide.h"

enum { MOST = KILN_GUIDE_SIDE, STEPS = 1024 };

/* Light through a door, on a weak ground; 0: none at all. */
static void door(float *learnt, uint32_t side, float ground)
{
    for (uint32_t k = 0; k < side * side; k++)
        learnt[k] = ground;
    learnt[side / 2 * side + 3] = 50.0f;
    learnt[side / 2 * side + 4] = 20.0f;
}

/* The share of even points of the unit square that the warp takes to each cell is 1 / weight; means of the weight, and
 * of functions times the weight, are what they are without a guide. */
static void weights_undo_the_warp(void **state)
{
    (void)state;
    for (uint32_t side = MOST / 2; side <= MOST; side *= 2) {
        float learnt[MOST * MOST];
        float guide[KILN_GUIDE_SIZE];
        uint32_t hits[MOST * MOST] = {0};
        double one = 0.0, slope = 0.0, wave = 0.0;
        door(learnt, side, side == MOST ? 1.0f : 0.0f);
        assert_true(kiln_guide_make(guide, learnt, side));
        for (uint32_t k = 0; k < STEPS * STEPS; k++) {
            const float x = ((float)(k / STEPS) + 0.5f) / STEPS, y = ((float)(k % STEPS) + 0.5f) / STEPS;
            float u = x, v = y;
            uint32_t fine;
            const double weight = (double)kiln_guide_warp(guide, &u, &v, &fine);
            const uint32_t cell = (uint32_t)(u * (float)side) * side + (uint32_t)(v * (float)side);
            assert_true(u > 0.0f && u < 1.0f && v > 0.0f && v < 1.0f && weight < 10.0 / 3.0 + 1e-3);
            assert_int_equal(kiln_guide_coarse(fine, side), cell);
            assert_int_equal(kiln_guide_cell(guide, side, (uint32_t)ldexpf(x, 32), (uint32_t)ldexpf(y, 32)), cell);
            hits[cell]++;
            one += weight;
            slope += weight * (double)u;
            wave += weight * (double)(v * v);
        }
        const double points = (double)STEPS * STEPS;
        assert_true(fabs(one / points - 1.0) < 2e-3 && fabs(slope / points - 0.5) < 2e-3 &&
                    fabs(wave / points - 1.0 / 3.0) < 2e-3);
        for (uint32_t k = 0; k < side * side; k++) {
            const double share =
                hits[k] / points * side * side *
                (double)guide[KILN_GUIDE_WEIGHTS + k / side * (MOST / side) * MOST + k % side * (MOST / side)];
            assert_true(fabs(share - 1.0) < 0.1);
        }
        assert_true(hits[side / 2 * side + 3] > 5 * hits[3]);
    }
}

static void even_light_has_none(void **state)
{
    (void)state;
    float learnt[MOST * MOST] = {0};
    float guide[KILN_GUIDE_SIZE];
    assert_false(kiln_guide_make(guide, learnt, MOST)); /* nothing was found */
    for (uint32_t k = 0; k < MOST * MOST; k++)
        learnt[k] = 1.0f + 0.5f * (float)(k % 2);
    assert_false(kiln_guide_make(guide, learnt, MOST));
    learnt[0] = NAN;
    assert_false(kiln_guide_make(guide, learnt, MOST));
    assert_int_equal(kiln_guide_side(64), 16);
    assert_int_equal(kiln_guide_side(63), 8);
    assert_int_equal(kiln_guide_side(16), 8);
    assert_int_equal(kiln_guide_side(15), 0);
}

/* Light of any unit makes the same guide. */
static void scale_changes_nothing(void **state)
{
    (void)state;
    float learnt[MOST * MOST];
    float guide[KILN_GUIDE_SIZE], other[KILN_GUIDE_SIZE];
    door(learnt, MOST, 1.0f);
    assert_true(kiln_guide_make(guide, learnt, MOST));
    for (uint32_t k = 0; k < MOST * MOST; k++)
        learnt[k] *= 0x1p-100f;
    assert_true(kiln_guide_make(other, learnt, MOST));
    assert_memory_equal(guide, other, sizeof guide);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(weights_undo_the_warp), cmocka_unit_test(even_light_has_none),
                                       cmocka_unit_test(scale_changes_nothing)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
