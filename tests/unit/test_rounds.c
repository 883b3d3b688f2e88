#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "coordinator/field/field.h"
#include "coordinator/integrate/parts/parts.h"
#include "coordinator/integrate/parts/rounds.h"
#include "coordinator/integrate/parts/rounds_foretold.h"
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

/* Rounds that are foretold: harder light takes more samples; the error ends below the one asked for, or where texels
 * have the most samples, or where the room for them ends. */
static void rounds_to_come(void **state)
{
    (void)state;
    enum { TILES = 40 };
    const struct kiln_integrate_settings settings = {
        .samples_direct = 32, .samples_bounce = 16, .samples_indirect = 64, .published_error = 0.05};
    struct kiln_foretell_from from = {.settings = &settings, .most = INFINITY};
    struct kiln_tried_tile tiles[TILES];
    const float raw[] = {0.04f, 0.2f, 0.5f, 40.0f};
    double before = -1.0;
    for (size_t r = 0; r < sizeof raw / sizeof *raw; r++) {
        struct kiln_foretold foretold;
        for (size_t i = 0; i < TILES; i++)
            tiles[i] = (struct kiln_tried_tile){.raw = 0.5f * raw[r], .had = 2.0f, .weight = 64 * 255, .points = 64};
        assert_int_equal(kiln_rounds_foretell(&from, tiles, TILES, &foretold, NULL), KILN_OK);
        assert_true(foretold.tried == TILES && foretold.samples > before);
        assert_true(foretold.limited ? foretold.error > 0.05 : foretold.error <= 0.05);
        assert_true(foretold.limited == (raw[r] > 1.0f) && (foretold.rounds == 0) == (r == 0));
        assert_true((foretold.samples == 0.0) == (r == 0));
        before = foretold.samples;
    }
    struct kiln_foretold all, some;
    for (size_t i = 0; i < TILES; i++)
        tiles[i].raw = i % 2 == 0 ? 0.25f : 0.0f;
    assert_int_equal(kiln_rounds_foretell(&from, tiles, TILES, &all, NULL), KILN_OK);
    from.most = 0.5 * all.samples;
    assert_int_equal(kiln_rounds_foretell(&from, tiles, TILES, &some, NULL), KILN_OK);
    assert_true(some.samples <= from.most && some.error > all.error && !some.limited);
    from.most = INFINITY;
    from.level = 6; /* eight times the samples of the first round */
    for (size_t i = 0; i < TILES; i++)
        tiles[i].had = 16.0f;
    assert_int_equal(kiln_rounds_foretell(&from, tiles, TILES, &some, NULL), KILN_OK);
    assert_true(some.samples > all.samples);
    from.denoises = true;
    from.scale = 0.5; /* of the error, which takes a fourth of the samples */
    assert_int_equal(kiln_rounds_foretell(&from, tiles, TILES, &all, NULL), KILN_OK);
    assert_true(all.samples < 0.5 * some.samples);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(rounds_to_come), cmocka_unit_test(units_of_a_round),
                                       cmocka_unit_test(weights_of_parts), cmocka_unit_test(loss_between_texels)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
