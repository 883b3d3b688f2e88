/* Tests of textures' means over polygons: polygons that share out a texture get all of it, whatever their size; masks
 * count by what the filter makes of them; and of the ways to parts of lamps. */
#include <setjmp.h> // IWYU pragma: keep
#include <stdarg.h> // IWYU pragma: keep
#include <stddef.h> // IWYU pragma: keep
#include <stdint.h> // IWYU pragma: keep

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "shaders/shared/area_light.h"
#include "worker/scene/texture.h"
#include "worker/scene/texture_means.h"

enum { WIDTH = 37, HEIGHT = 22 };

struct fixture {
    struct kiln_scene scene;
    struct kiln_texture texture;
    uint8_t texels[WIDTH * HEIGHT * 4];
};

static uint32_t next(uint32_t *random) { return *random = *random * 1664525u + 1013904223u; }

static void make(struct fixture *f)
{
    uint32_t random = 1;
    memset(f, 0, sizeof *f);
    for (size_t i = 0; i < sizeof f->texels; i++)
        f->texels[i] = (uint8_t)(next(&random) >> 24);
    f->texture = (struct kiln_texture){.width = WIDTH, .height = HEIGHT, .srgb = 1};
    f->scene = (struct kiln_scene){.textures = &f->texture, .texture_count = 1, .texels = f->texels};
}

/* By lookups all over the unit square. */
static void look_at_all(const struct fixture *f, uint32_t mode, double mean[4])
{
    enum { ACROSS = WIDTH * 20, DOWN = HEIGHT * 20 };
    memset(mean, 0, 4 * sizeof *mean);
    for (int i = 0; i < ACROSS * DOWN; i++) {
        float rgba[4];
        kiln_texture_sample(&f->scene, 0, ((float)(i % ACROSS) + 0.5f) / ACROSS, ((float)(i / ACROSS) + 0.5f) / DOWN,
                            rgba);
        const double covered = (double)kiln_coverage(mode, 0.5f, rgba[3]);
        for (int c = 0; c < 4; c++)
            mean[c] += (c < 3 ? (double)rgba[c] * covered : covered) / ((double)ACROSS * DOWN);
    }
}

/* The mean of the means over n x n parallelograms, which make up one that has each place of the texture once. */
static void share_out(const struct kiln_texture_means *means, int n, double slant, double sum[4])
{
    memset(sum, 0, 4 * sizeof *sum);
    for (int i = 0; i < n * n; i++) {
        const double x = (double)(i % n) / n, y = (double)(i / n) / n, d = 1.0 / n;
        const double corner[4][2] = {
            {x + slant * y, y}, {x + d + slant * y, y}, {x + d + slant * (y + d), y + d}, {x + slant * (y + d), y + d}};
        struct kiln_texture_mean mean;
        assert_true(kiln_texture_means_over(means, corner, 4, 8, NULL, &mean));
        for (int c = 0; c < 4; c++)
            sum[c] += mean.value[c] / ((double)n * n);
    }
}

static void shares_make_the_whole(void **state)
{
    (void)state;
    static const int sizes[] = {1, 2, 3, 5, 11, 40, 150};
    static struct fixture f;
    make(&f);
    for (uint32_t nearest = 0; nearest < 2; nearest++)
        for (uint32_t mode = KILN_ALPHA_OPAQUE; mode <= KILN_ALPHA_BLEND; mode++) {
            struct kiln_texture_means *means;
            double right[4], found[4];
            f.texture.nearest = nearest;
            assert_int_equal(
                kiln_texture_means_create(&means, &f.scene,
                                          (struct kiln_texture_look){.alpha_mode = mode, .alpha_cutoff = 0.5f}, NULL),
                KILN_OK);
            look_at_all(&f, mode, right);
            for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
                for (int slanted = 0; slanted < 2; slanted++) {
                    share_out(means, sizes[i], slanted, found);
                    /* where the coverage changes within a texel it is looked up */
                    const double bound = mode == KILN_ALPHA_OPAQUE || nearest ? 1e-4
                                         : mode == KILN_ALPHA_BLEND           ? 2e-3
                                                                              : 8e-3;
                    for (int c = 0; c < 4; c++)
                        if (fabs(found[c] - right[c]) > bound)
                            fail_msg("mode %u, nearest %u, %d x %d, channel %d: %g is not %g", mode, nearest, sizes[i],
                                     sizes[i], c, found[c], right[c]);
                }
            kiln_texture_means_destroy(&means);
        }
}

/* Within one texel of the nearest filter the mean is that texel, and a clamped texture goes on with its rim. */
static void small_and_far_polygons(void **state)
{
    (void)state;
    static struct fixture f;
    struct kiln_texture_means *means;
    struct kiln_texture_mean mean;
    make(&f);
    f.texture.nearest = 1;
    f.texture.wrap_u = f.texture.wrap_v = KILN_WRAP_CLAMP;
    assert_int_equal(
        kiln_texture_means_create(&means, &f.scene, (struct kiln_texture_look){.alpha_mode = KILN_ALPHA_OPAQUE}, NULL),
        KILN_OK);
    for (int far = 0; far < 2; far++) {
        const double x = far ? 3.0 : 5.2 / WIDTH, y = far ? -7.0 : 4.3 / HEIGHT, d = far ? 2.0 : 0.2 / WIDTH;
        const double corner[3][2] = {{x, y}, {x + d, y}, {x + 0.5 * d, y + d}};
        float rgba[4];
        kiln_texture_sample(&f.scene, 0, (float)corner[0][0], (float)corner[0][1], rgba);
        assert_true(kiln_texture_means_over(means, corner, 3, 8, NULL, &mean));
        for (int c = 0; c < 3; c++)
            assert_true(fabs(mean.value[c] - (double)rgba[c]) < 1e-5);
    }
    const double line[3][2] = {{0.1, 0.1}, {0.3, 0.3}, {0.2, 0.2}};
    assert_false(kiln_texture_means_over(means, line, 3, 8, NULL, &mean));
    kiln_texture_means_destroy(&means);
}

/* The halves on the way hold the place. */
static void paths_lead_to_the_place(void **state)
{
    (void)state;
    uint32_t random = 7;
    for (int i = 0; i < 2000; i++) {
        static const double whole[3][2] = {{0.0, 0.0}, {1.0, 0.0}, {0.0, 1.0}};
        const double root = sqrt(next(&random) * 0x1p-32), b1 = root * (next(&random) * 0x1p-32), b2 = root - b1;
        const uint32_t turn = (uint32_t)i % 3, path = kiln_subtriangle_path(b1, b2, turn);
        double v[3][2];
        for (uint32_t k = 0; k < 3; k++)
            memcpy(v[k], whole[(turn + k) % 3], sizeof v[k]);
        for (uint32_t depth = 0; depth < 24; depth++) {
            const bool second = (path >> (31 - depth) & 1u) != 0;
            double half[3][2];
            for (int k = 0; k < 2; k++) {
                half[0][k] = 0.5 * (v[1][k] + v[2][k]);
                half[1][k] = second ? v[2][k] : v[0][k];
                half[2][k] = second ? v[0][k] : v[1][k];
            }
            memcpy(v, half, sizeof v);
            const double ax = v[1][0] - v[0][0], ay = v[1][1] - v[0][1], bx = v[2][0] - v[0][0], by = v[2][1] - v[0][1],
                         px = b1 - v[0][0], py = b2 - v[0][1], twice = ax * by - ay * bx,
                         s = (px * by - py * bx) / twice, t = (ax * py - ay * px) / twice;
            assert_true(s > -1e-6 && t > -1e-6 && s + t < 1.0 + 1e-6);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(shares_make_the_whole),
                                       cmocka_unit_test(small_and_far_polygons),
                                       cmocka_unit_test(paths_lead_to_the_place)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
