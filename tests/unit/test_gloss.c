/* Tests of worker/scene/gloss.h: which materials are more than diffuse, and what a user sees in them. */
#include <setjmp.h> // IWYU pragma: keep
#include <stdarg.h> // IWYU pragma: keep
#include <stddef.h> // IWYU pragma: keep
#include <stdint.h> // IWYU pragma: keep

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "worker/scene/gloss.h"

static const struct kiln_material plain = {.base_color = {0.5f, 0.5f, 0.5f, 1.0f},
                                           .base_color_texture = KILN_NONE,
                                           .emission_texture = KILN_NONE,
                                           .transmission_texture = KILN_NONE,
                                           .roughness = 0.5f};

static void wanted(const struct kiln_material *m, const struct kiln_gloss *g, enum kiln_gloss_kind kind)
{
    assert_string_equal(kiln_gloss_kind_name(kiln_gloss_kind(m, g)), kiln_gloss_kind_name(kind));
    assert_int_equal(kiln_gloss_needed(m, g, KILN_GLOSS_MODE_AUTO), kind != KILN_GLOSS_KIND_DIFFUSE);
    assert_false(kiln_gloss_needed(m, g, KILN_GLOSS_MODE_DIFFUSE));
    assert_true(kiln_gloss_needed(m, g, KILN_GLOSS_MODE_FULL));
}

static void defaults_are_sound_and_say_what_the_material_says(void **state)
{
    (void)state;
    struct kiln_material m = plain;
    wanted(&m, NULL, KILN_GLOSS_KIND_DIFFUSE);
    m.roughness = 0.49f;
    wanted(&m, NULL, KILN_GLOSS_KIND_GLOSS);
    m.metallic = 0.25f;
    wanted(&m, NULL, KILN_GLOSS_KIND_METAL);
    m.transmission = 0.75f;
    wanted(&m, NULL, KILN_GLOSS_KIND_THIN_GLASS);
    const struct kiln_gloss g = kiln_gloss_default(&m, 7);
    assert_null(kiln_gloss_fault(&g, 8, 0));
    assert_non_null(kiln_gloss_fault(&g, 7, 0));
    assert_int_equal(g.material, 7);
    assert_true(g.metallic == 0.25f && g.mean_metallic == 0.25f && g.transmission == 0.75f && g.ior == 1.5f);
    assert_true(g.roughness == 0.49f && g.mean_roughness == 0.49f);
}

static void each_part_makes_its_kind(void **state)
{
    (void)state;
    struct kiln_gloss g = kiln_gloss_default(&plain, 0);
    wanted(&plain, &g, KILN_GLOSS_KIND_DIFFUSE);
    g.anisotropy = 1.0f; /* of a rough surface */
    g.ior = 2.0f;
    wanted(&plain, &g, KILN_GLOSS_KIND_DIFFUSE);
    g.mean_roughness = 0.1f;
    wanted(&plain, &g, KILN_GLOSS_KIND_GLOSS);
    g.specular = 0.0f; /* nothing is reflected: how rough that is does not matter */
    wanted(&plain, &g, KILN_GLOSS_KIND_DIFFUSE);
    g.metallic = 1.0f; /* the texture is black */
    wanted(&plain, &g, KILN_GLOSS_KIND_DIFFUSE);
    g.mean_metallic = 0.01f;
    wanted(&plain, &g, KILN_GLOSS_KIND_METAL);
    g.clearcoat = 0.1f;
    wanted(&plain, &g, KILN_GLOSS_KIND_CLEAR_COAT);
    g.transmission = 0.5f;
    wanted(&plain, &g, KILN_GLOSS_KIND_THIN_GLASS);
    g.flags = KILN_GLOSS_VOLUME;
    wanted(&plain, &g, KILN_GLOSS_KIND_VOLUME_GLASS);
    g.mean_metallic = 1.0f; /* metal lets nothing through */
    wanted(&plain, &g, KILN_GLOSS_KIND_CLEAR_COAT);
}

static void a_phong_lobe_is_as_wide_as_a_roughness(void **state)
{
    (void)state;
    struct kiln_gloss g = kiln_gloss_default(&plain, 0);
    /* alpha = roughness^2, and the exponent that belongs to alpha is 2 / alpha^2 - 2 */
    for (float roughness = 0.1f; roughness <= 1.0f; roughness += 0.1f) {
        const float alpha = roughness * roughness;
        assert_true(fabsf(kiln_gloss_phong_roughness(2.0f / (alpha * alpha) - 2.0f) - roughness) < 1e-4f);
    }
    g.model = KILN_GLOSS_PHONG;
    g.exponent = 1000.0f;
    g.mean_roughness = kiln_gloss_phong_roughness(g.exponent);
    memset(g.specular_color, 0, sizeof g.specular_color);
    wanted(&plain, &g, KILN_GLOSS_KIND_DIFFUSE); /* Ks is black */
    g.specular_color[1] = 0.5f;
    wanted(&plain, &g, KILN_GLOSS_KIND_GLOSS);
    g.mean_roughness = kiln_gloss_phong_roughness(20.0f);
    wanted(&plain, &g, KILN_GLOSS_KIND_DIFFUSE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(defaults_are_sound_and_say_what_the_material_says),
                                       cmocka_unit_test(each_part_makes_its_kind),
                                       cmocka_unit_test(a_phong_lobe_is_as_wide_as_a_roughness)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
