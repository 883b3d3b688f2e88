#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "coordinator/field/field.h"
#include "coordinator/integrate/parts/parts.h"
#include "coordinator/integrate/parts/rounds.h"
#include "coordinator/integrate/parts/texel_loss.h"

/* A tile run takes enough, at most all, and a beginning of the round: all, a half, a quarter or an eighth. */
static void units_of_a_round(void **state)
{
    (void)state;
    assert_int_equal(kiln_round_units(0, 64), 0);
    assert_int_equal(kiln_round_units(1, 64), 8);
    assert_int_equal(kiln_round_units(8, 64), 8);
    assert_int_equal(kiln_round_units(9, 64), 16);
    assert_int_equal(kiln_round_units(33, 64), 64);
    assert_int_equal(kiln_round_units(UINT32_MAX, 64), 64);
    assert_int_equal(kiln_round_units(1, 1), 1);
    for (uint32_t need = 1; need < 100; need++)
        for (uint64_t more = 1; more < 100; more++) {
            const uint32_t units = kiln_round_units(need, more);
            assert_true(units > 0 && units <= more && (units >= need || units == more));
        }
}

/* The mean that a tile run ends with weighs what it found up to n samples of a part as n^2, whatever rounds it left
 * out.
 */
static void weights_of_parts(void **state)
{
    struct kiln_tile_run runs[2] = {{.count = 1}, {.count = 1}};
    uint32_t samples[2] = {4, 4}, taken[2] = {0, 0};
    struct kiln_rank_data data = {
        .surface = {.tile_runs = runs, .tile_run_count = 2}, .samples = samples, .samples_taken = taken};
    const uint32_t rounds[][2] = {{4, 4}, {0, 8}, {24, 6}, {10, 0}}; /* samples of each */
    float mean[2] = {0.0f, 0.0f}, found[2] = {0.0f, 0.0f};
    double sum[2] = {0.0, 0.0}, of_first[2] = {0.0, 0.0}, count[2] = {0.0, 0.0};
    (void)state;
    for (uint32_t part = 0; part < 4 * KILN_PARTS; part++) {
        const struct kiln_step step = {.part = part,
                                       .samples = 4,
                                       .first_sample = 4 * part,
                                       .samples_field = part < KILN_PARTS ? NULL : KILN_FIELD_SAMPLES};
        for (int i = 0; i < 2; i++) {
            samples[i] = rounds[part / KILN_PARTS][i];
            if (samples[i] > 0) {
                const struct kiln_part_weight weight = kiln_part_weight(&data, &runs[i], &step);
                const float value = (float)(1 + part * part % 7);
                kiln_part_mix(&mean[i], &value, 1, &weight);
                if (part % KILN_PARTS == 0)
                    found[i] += weight.share * (value - found[i]);
                const double now =
                    (double)(taken[i] + samples[i]) * (taken[i] + samples[i]) - (double)taken[i] * taken[i];
                sum[i] += now * (double)value;
                of_first[i] += part % KILN_PARTS == 0 ? now * (double)value : 0.0;
                count[i] += now;
            }
            taken[i] += part % KILN_PARTS == KILN_PARTS - 1 ? samples[i] : 0;
        }
    }
    for (int i = 0; i < 2; i++) {
        assert_float_equal(mean[i], (float)(sum[i] / count[i]), 1e-5f);
        assert_float_equal(found[i], (float)(of_first[i] / (count[i] / KILN_PARTS)), 1e-5f);
    }
}

static double loss_of(const float light[KILN_LOSS_TEXELS], const float other[KILN_LOSS_TEXELS], uint64_t whole)
{
    struct kiln_texel_losses losses = {{0}};
    for (int i = 0; i < 10; i++)
        kiln_texel_losses_add(&losses, light, other, whole, 0.01);
    return kiln_texel_losses_most(&losses);
}

/* Light that a plane fits loses nothing; an edge loses half of its height where it crosses texels of twice the size;
 * curved light a quarter of its second difference. Noise of one half alone is none. */
static void loss_between_texels(void **state)
{
    float plane[KILN_LOSS_TEXELS], edge[KILN_LOSS_TEXELS], curved[KILN_LOSS_TEXELS], noise[KILN_LOSS_TEXELS];
    (void)state;
    for (int i = 0; i < KILN_LOSS_TEXELS; i++) {
        const int u = i % 8, v = i / 8;
        plane[i] = 1.0f + 0.1f * (float)u + 0.2f * (float)v;
        edge[i] = u < 3 ? 1.0f : 3.0f;
        curved[i] = 100.0f + 0.5f * (float)(u * u);
        noise[i] = 1.0f + 0.1f * (float)(i * 37 % 5 - 2);
    }
    assert_float_equal(loss_of(plane, plane, UINT64_MAX), 0.0, 1e-3);
    assert_in_range((int)(1000.0 * loss_of(edge, edge, UINT64_MAX)), 300, 1000);
    /* between the means of pairs, x^2 / 2 is off by the mean of the pair, 1 / 8, less the interpolation's 3 / 8 */
    assert_float_equal(loss_of(curved, curved, UINT64_MAX), 0.005f, 2.5e-3f);
    assert_true(loss_of(edge, edge, 0) == 0.0);
    float flat[KILN_LOSS_TEXELS];
    for (int i = 0; i < KILN_LOSS_TEXELS; i++)
        flat[i] = 1.0f;
    assert_float_equal(loss_of(noise, flat, UINT64_MAX), 0.0, 1e-3);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(units_of_a_round), cmocka_unit_test(weights_of_parts),
                                       cmocka_unit_test(loss_between_texels)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
