/* Tests of texture lookups against the formulas of glTF and sRGB, and of mean emission against dense sampling. */
#include <setjmp.h> // IWYU pragma: keep
#include <stdarg.h> // IWYU pragma: keep
#include <stddef.h> // IWYU pragma: keep
#include <stdint.h> // IWYU pragma: keep

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "worker/scene/texture.h"

/* One mesh of one triangle, one material, one 8 x 4 texture whose values are told by their position. */
struct fixture {
    struct kiln_scene scene;
    struct kiln_texture texture;
    struct kiln_material material;
    struct kiln_mesh mesh;
    uint8_t texels[8 * 4 * 4];
    struct kiln_vec2 uv[3];
    uint8_t colors[12];
    uint32_t triangle[3], triangle_material;
};

static void make(struct fixture *f)
{
    memset(f, 0, sizeof *f);
    uint32_t random = 1;
    for (size_t i = 0; i < sizeof f->texels; i++) {
        random = random * 1664525u + 1013904223u;
        f->texels[i] = (uint8_t)(random >> 24);
    }
    f->texture = (struct kiln_texture){.width = 8, .height = 4, .srgb = 1};
    f->material = (struct kiln_material){
        .base_color = {1, 1, 1, 1}, .emission = {2, 3, 4}, .base_color_texture = KILN_NONE, .emission_texture = 0};
    f->mesh = (struct kiln_mesh){.vertex_count = 3, .triangle_count = 1};
    f->triangle[1] = 1;
    f->triangle[2] = 2;
    memset(f->colors, 255, sizeof f->colors);
    f->scene = (struct kiln_scene){.textures = &f->texture,
                                   .texture_count = 1,
                                   .texels = f->texels,
                                   .materials = &f->material,
                                   .material_count = 1,
                                   .meshes = &f->mesh,
                                   .mesh_count = 1,
                                   .texcoord_base = f->uv,
                                   .texcoord_emission = f->uv,
                                   .colors = f->colors,
                                   .triangles = f->triangle,
                                   .triangle_materials = &f->triangle_material,
                                   .triangle_count = 1,
                                   .vertex_count = 3};
}

static double decoded(uint8_t code)
{
    const double c = code / 255.0;
    return c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4);
}

static double texel_value(const struct fixture *f, int x, int y, int channel)
{
    const uint8_t code = f->texels[4 * (8 * y + x) + channel];
    return channel == 3 ? code / 255.0 : decoded(code);
}

static void near(double a, double b, double tolerance)
{
    if (!(fabs(a - b) <= tolerance))
        fail_msg("%.9g is not %.9g within %g", a, b, tolerance);
}

static void codes_are_decoded_as_the_standard_says(void **state)
{
    (void)state;
    struct fixture f;
    make(&f);
    f.texture.width = f.texture.height = 1;
    for (int code = 0; code < 256; code++) {
        float rgba[4];
        memset(f.texels, code, 4);
        kiln_texture_sample(&f.scene, 0, 0.3f, 0.7f, rgba);
        near((double)rgba[0], decoded((uint8_t)code), 1e-7);
        near((double)rgba[3], code / 255.0, 1e-7);
    }
    f.texture.srgb = 0;
    float rgba[4];
    memset(f.texels, 51, 4);
    kiln_texture_sample(&f.scene, 0, 0.5f, 0.5f, rgba);
    near((double)rgba[1], 0.2, 1e-7);
}

static void centres_hit_their_texel_and_top_left_is_the_origin(void **state)
{
    (void)state;
    struct fixture f;
    make(&f);
    for (uint32_t nearest = 0; nearest < 2; nearest++)
        for (int y = 0; y < 4; y++)
            for (int x = 0; x < 8; x++) {
                float rgba[4];
                f.texture.nearest = nearest;
                kiln_texture_sample(&f.scene, 0, ((float)x + 0.5f) / 8.0f, ((float)y + 0.5f) / 4.0f, rgba);
                for (int c = 0; c < 4; c++)
                    near((double)rgba[c], texel_value(&f, x, y, c), 1e-6);
            }
}

static void bilinear_weights_the_four_nearest(void **state)
{
    (void)state;
    struct fixture f;
    make(&f);
    float rgba[4];
    kiln_texture_sample(&f.scene, 0, (2.5f + 0.25f) / 8.0f, (1.5f + 0.75f) / 4.0f, rgba);
    for (int c = 0; c < 4; c++) {
        const double expected = 0.75 * 0.25 * texel_value(&f, 2, 1, c) + 0.25 * 0.25 * texel_value(&f, 3, 1, c) +
                                0.75 * 0.75 * texel_value(&f, 2, 2, c) + 0.25 * 0.75 * texel_value(&f, 3, 2, c);
        near((double)rgba[c], expected, 1e-6);
    }
}

static void wrap_modes(void **state)
{
    (void)state;
    struct fixture f;
    make(&f);
    f.texture.nearest = 1;
    /* column of texel x = 8 k + i, and its mirror image in every odd period */
    for (int at = -24; at < 24; at++) {
        const int repeated = (at % 8 + 8) % 8, period = (at - repeated) / 8;
        const int expected[3] = {[KILN_WRAP_REPEAT] = repeated,
                                 [KILN_WRAP_CLAMP] = at < 0   ? 0
                                                     : at > 7 ? 7
                                                              : at,
                                 [KILN_WRAP_MIRROR] = period % 2 == 0 ? repeated : 7 - repeated};
        for (uint32_t mode = 0; mode < 3; mode++) {
            float rgba[4];
            f.texture.wrap_u = mode;
            kiln_texture_sample(&f.scene, 0, ((float)at + 0.5f) / 8.0f, 0.125f, rgba);
            near((double)rgba[0], texel_value(&f, expected[mode], 0, 0), 1e-7);
        }
    }
    /* bilinear across the border: repeat mixes first and last, clamp does not */
    float rgba[4];
    f.texture.nearest = 0;
    f.texture.wrap_u = KILN_WRAP_REPEAT;
    kiln_texture_sample(&f.scene, 0, 0.0f, 0.125f, rgba);
    near((double)rgba[1], 0.5 * (texel_value(&f, 0, 0, 1) + texel_value(&f, 7, 0, 1)), 1e-6);
    f.texture.wrap_u = KILN_WRAP_CLAMP;
    kiln_texture_sample(&f.scene, 0, 0.0f, 0.125f, rgba);
    near((double)rgba[1], texel_value(&f, 0, 0, 1), 1e-6);
}

static void huge_coordinates_are_harmless(void **state)
{
    (void)state;
    struct fixture f;
    make(&f);
    const float values[] = {1e30f, -1e30f, 3e38f, -3e38f, 1e7f, 123456.789f};
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++)
        for (uint32_t mode = 0; mode < 3; mode++) {
            float rgba[4];
            f.texture.wrap_u = f.texture.wrap_v = mode;
            kiln_texture_sample(&f.scene, 0, values[i], values[i], rgba);
            assert_true(rgba[0] >= 0.0f && rgba[0] <= 1.0f);
        }
    f.uv[1] = (struct kiln_vec2){1e30f, 0};
    f.uv[2] = (struct kiln_vec2){0, 1e30f};
    float mean[3];
    kiln_triangle_mean_emission(&f.scene, &f.mesh, 0, mean);
    assert_true(mean[0] >= 0.0f && mean[0] <= 2.0f);
}

/* The mean by brute force: a lattice of n^2 equal triangles' centres. */
static void sampled_mean(const struct fixture *f, int n, double mean[3])
{
    mean[0] = mean[1] = mean[2] = 0.0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < 2 * (n - i) - 1; j++) {
            const double up = j % 2 == 0 ? 1.0 : 2.0;
            float rgb[3];
            kiln_surface_emission(&f->scene, &f->mesh, 0, (float)((i + up / 3.0) / n), (float)((j / 2 + up / 3.0) / n),
                                  rgb);
            for (int c = 0; c < 3; c++)
                mean[c] += (double)rgb[c];
        }
    for (int c = 0; c < 3; c++)
        mean[c] /= (double)n * n;
}

static void means_of_triangles(void **state)
{
    (void)state;
    static const struct kiln_vec2 triangles[][3] = {
        {{0, 0}, {1, 0}, {0, 1}},                      /* half of the texture */
        {{0.1f, 0.2f}, {0.14f, 0.21f}, {0.11f, 0.3f}}, /* within few texels */
        {{-0.7f, 0.3f}, {2.2f, -0.4f}, {0.4f, 1.9f}},  /* across borders */
        {{3, 3}, {-2, 3.5f}, {1, -4}},                 /* many periods, the other way round */
        {{0.2f, 0.5f}, {0.9f, 0.5f}, {0.5f, 0.5f}},    /* a line */
        {{0.3f, 0.3f}, {0.3f, 0.3f}, {0.3f, 0.3f}},    /* a point */
    };
    struct fixture f;
    make(&f);
    for (size_t k = 0; k < sizeof triangles / sizeof triangles[0]; k++)
        for (uint32_t mode = 0; mode < 3; mode++)
            for (uint32_t nearest = 0; nearest < 2; nearest++) {
                double expected[3];
                float mean[3];
                memcpy(f.uv, triangles[k], sizeof f.uv);
                f.texture.wrap_u = mode;
                f.texture.wrap_v = (mode + 1) % 3;
                f.texture.nearest = nearest;
                sampled_mean(&f, 700, expected);
                kiln_triangle_mean_emission(&f.scene, &f.mesh, 0, mean);
                for (int c = 0; c < 3; c++)
                    near((double)mean[c], expected[c], (k == 4 ? 2e-2 : nearest ? 4e-3 : 1e-3) * expected[c]);
            }
}

/* A known integral: the texture's value times the area of its texel, over the square that both triangles fill. */
static void two_triangles_make_the_mean_of_the_image(void **state)
{
    (void)state;
    struct fixture f;
    make(&f);
    for (uint32_t nearest = 0; nearest < 2; nearest++) {
        float a[3], b[3];
        f.texture.nearest = nearest;
        f.uv[0] = (struct kiln_vec2){0, 0}, f.uv[1] = (struct kiln_vec2){1, 0}, f.uv[2] = (struct kiln_vec2){1, 1};
        kiln_triangle_mean_emission(&f.scene, &f.mesh, 0, a);
        f.uv[1] = (struct kiln_vec2){1, 1}, f.uv[2] = (struct kiln_vec2){0, 1};
        kiln_triangle_mean_emission(&f.scene, &f.mesh, 0, b);
        for (int c = 0; c < 3; c++) {
            double mean = 0.0;
            for (int i = 0; i < 32; i++)
                mean += texel_value(&f, i % 8, i / 8, c) / 32.0;
            near(0.5 * ((double)a[c] + (double)b[c]), (double)f.material.emission[c] * mean, 1e-6 * mean);
        }
    }
}

static void color_is_the_product_of_all_its_parts(void **state)
{
    (void)state;
    struct fixture f;
    make(&f);
    float rgba[4];
    f.uv[0] = f.uv[1] = f.uv[2] = (struct kiln_vec2){4.5f / 8.0f, 2.5f / 4.0f};
    f.material.base_color_texture = 0;
    f.material.base_color[0] = 0.5f;
    f.material.base_color[3] = 0.8f;
    f.material.metallic = 0.25f;
    memset(f.colors, 0, 12);
    for (int k = 0; k < 3; k++) {
        f.colors[4 * k] = 255;
        f.colors[4 * k + 3] = (uint8_t)(k == 1 ? 255 : 0);
    }
    kiln_surface_color(&f.scene, &f.mesh, 0, 0.5f, 0.25f, rgba);
    near((double)rgba[0], 0.5 * 0.75 * texel_value(&f, 4, 2, 0), 1e-6);
    near((double)rgba[1], 0.0, 1e-9);
    near((double)rgba[3], 0.8 * 0.5 * texel_value(&f, 4, 2, 3), 1e-6);
    f.material.emission_texture = KILN_NONE;
    float mean[3];
    kiln_triangle_mean_emission(&f.scene, &f.mesh, 0, mean);
    assert_true(mean[0] == 2.0f && mean[1] == 3.0f && mean[2] == 4.0f);
}

/* Opacity and what comes through, for every alpha mode, with and without transmission and its texture. */
static void light_is_let_through_by_alpha_and_transmission(void **state)
{
    (void)state;
    struct fixture f;
    make(&f);
    f.uv[0] = f.uv[1] = f.uv[2] = (struct kiln_vec2){4.5f / 8.0f, 2.5f / 4.0f};
    memset(f.colors, 255, 12);
    f.material.base_color[0] = 0.5f, f.material.base_color[1] = 0.25f, f.material.base_color[2] = 1.0f,
    f.material.base_color[3] = 0.8f;
    f.material.base_color_texture = KILN_NONE;
    f.material.metallic = 0.2f;
    f.material.alpha_cutoff = 0.5f;
    for (uint32_t i = 0; i < 12; i++) {
        const uint32_t mode = i % 3;
        f.material.alpha_mode = mode;
        f.material.transmission = i < 3 ? 0.0f : 0.7f;
        f.material.transmission_texture = i < 6 ? KILN_NONE : 0;
        f.material.base_color[3] = i < 9 ? 0.8f : 0.3f;
        const double a = mode == KILN_ALPHA_OPAQUE ? 1.0
                         : mode == KILN_ALPHA_MASK ? (i < 9 ? 1.0 : 0.0)
                                                   : (double)f.material.base_color[3];
        const double t = i < 3 ? 0.0 : i < 6 ? 0.7 : 0.7 * texel_value(&f, 4, 2, 0);
        struct kiln_passage p;
        kiln_surface_passage(&f.scene, &f.mesh, 0, 0.5f, 0.25f, 1.0f, &p);
        near((double)p.opacity, a * (1.0 - t), 1e-6);
        near((double)kiln_surface_opacity(&f.scene, &f.mesh, 0, 0.5f, 0.25f), a * (1.0 - t), 1e-6);
        for (int c = 0; c < 3; c++)
            near((double)p.through[c], 1.0 - a + a * t * 0.8 * (double)f.material.base_color[c], 1e-6);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(light_is_let_through_by_alpha_and_transmission),
        cmocka_unit_test(codes_are_decoded_as_the_standard_says),
        cmocka_unit_test(centres_hit_their_texel_and_top_left_is_the_origin),
        cmocka_unit_test(bilinear_weights_the_four_nearest),
        cmocka_unit_test(wrap_modes),
        cmocka_unit_test(huge_coordinates_are_harmless),
        cmocka_unit_test(means_of_triangles),
        cmocka_unit_test(two_triangles_make_the_mean_of_the_image),
        cmocka_unit_test(color_is_the_product_of_all_its_parts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
