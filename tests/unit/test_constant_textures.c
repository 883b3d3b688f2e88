/* Tests of textures of one colour: they become factors; textures with two colours stay. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "coordinator/import/constant_textures.h"
#include "worker/scene/texture.h"

enum { ONE, SAME, LAST_DIFFERS, LINEAR, TEXTURES };

static const struct kiln_texture textures[TEXTURES] = {
    [ONE] = {.first = 0, .width = 1, .height = 1, .srgb = 1},
    [SAME] = {.first = 4, .width = 3, .height = 2, .srgb = 1},
    [LAST_DIFFERS] = {.first = 28, .width = 3, .height = 2, .srgb = 1},
    [LINEAR] = {.first = 52, .width = 1, .height = 2, .srgb = 0},
};
static const uint8_t colour[4] = {200, 100, 51, 102};

static struct kiln_builder *make(void)
{
    struct kiln_builder *builder = NULL;
    uint8_t texels[60];
    for (size_t i = 0; i < sizeof texels; i++)
        texels[i] = colour[i % 4];
    texels[28 + 20 + 2]++;
    assert_int_equal(kiln_builder_create(&builder, NULL), 0);
    assert_int_equal(kiln_builder_append(builder, KILN_SECTION_TEXTURES, textures, TEXTURES, NULL, NULL), 0);
    assert_int_equal(kiln_builder_append(builder, KILN_SECTION_TEXELS, texels, sizeof texels, NULL, NULL), 0);
    for (uint32_t t = 0; t < TEXTURES; t++) {
        const struct kiln_material m = {.emission = {3.0f, 5.0f, 7.0f},
                                        .base_color = {0.5f, 0.25f, 1.0f, 0.75f},
                                        .transmission = 0.5f,
                                        .emission_texture = t,
                                        .base_color_texture = t,
                                        .transmission_texture = t == LINEAR ? t : KILN_NONE};
        assert_int_equal(kiln_builder_append(builder, KILN_SECTION_MATERIALS, &m, 1, NULL, NULL), 0);
    }
    return builder;
}

static void near(float a, double b)
{
    if (!(fabs((double)a - b) <= 1e-6 * b))
        fail_msg("%.9g is not %.9g", (double)a, b);
}

static double decoded(uint8_t code) { return pow((code / 255.0 + 0.055) / 1.055, 2.4); } /* IEC 61966-2-1 */

static void test_one_colour_becomes_a_factor(void **state)
{
    struct kiln_builder *builder = make();
    (void)state;
    assert_int_equal(kiln_fold_constant_textures(builder), 7);
    const struct kiln_material *m = KILN_BUILDER_DATA(builder, const struct kiln_material, KILN_SECTION_MATERIALS);
    static const float emission[3] = {3.0f, 5.0f, 7.0f}, base[4] = {0.5f, 0.25f, 1.0f, 0.75f};
    for (int t = 0; t < TEXTURES; t++) {
        const bool folded = t != LAST_DIFFERS;
        for (int c = 0; c < 3; c++) {
            const double factor = !folded ? 1.0 : t == LINEAR ? colour[c] / 255.0 : decoded(colour[c]);
            near(m[t].emission[c], (double)emission[c] * factor);
            near(m[t].base_color[c], (double)base[c] * factor);
        }
        near(m[t].base_color[3], folded ? 0.75 * 102.0 / 255.0 : 0.75); /* alpha is never sRGB */
        near(m[t].transmission, t == LINEAR ? 0.5 * 200.0 / 255.0 : 0.5);
        assert_int_equal(m[t].emission_texture, folded ? KILN_NONE : (uint32_t)t);
        assert_int_equal(m[t].base_color_texture, folded ? KILN_NONE : (uint32_t)t);
        assert_int_equal(m[t].transmission_texture, KILN_NONE);
    }
    kiln_builder_destroy(&builder);
}

/* A folded texture gives the value that looking it up gave. */
static void test_as_looked_up(void **state)
{
    struct kiln_builder *builder = make();
    float rgba[4];
    (void)state;
    const struct kiln_scene scene = {
        .textures = textures,
        .texture_count = TEXTURES,
        .texels = KILN_BUILDER_DATA(builder, const uint8_t, KILN_SECTION_TEXELS),
    };
    kiln_texture_sample(&scene, SAME, 0.3f, 0.6f, rgba);
    (void)kiln_fold_constant_textures(builder);
    const struct kiln_material *m = KILN_BUILDER_DATA(builder, const struct kiln_material, KILN_SECTION_MATERIALS);
    for (int c = 0; c < 3; c++)
        near(m[SAME].emission[c], (double)(2 * c + 3) * (double)rgba[c]);
    kiln_builder_destroy(&builder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_one_colour_becomes_a_factor),
                                       cmocka_unit_test(test_as_looked_up)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
