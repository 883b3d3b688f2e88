/* Noise taken out of views: regression in blocks on synthetic surfaces, and what frames take over from those before. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/view/bmfr.h"
#include "coordinator/view/history.h"
#include "shaders/shared/random.h"
#include "worker/base/memory.h"

enum { WIDTH = 88, HEIGHT = 56, COUNT = WIDTH * HEIGHT };

/* A picture of two walls that meet in a crease in its middle. */
struct walls {
    float normal[3][COUNT], position[3][COUNT], light[3][COUNT], deviation[COUNT];
    bool filtered[COUNT];
    struct kiln_bmfr picture;
};

static struct walls *make_walls(void)
{
    struct walls *w = NULL;
    assert_int_equal(kiln_allocate(&w, 1, sizeof *w, "walls", NULL), KILN_OK);
    w->picture = (struct kiln_bmfr){
        .width = WIDTH, .height = HEIGHT, .filtered = w->filtered, .deviation = w->deviation, .shift = {5, 11}};
    for (int c = 0; c < 3; c++) {
        w->picture.normal[c] = w->normal[c];
        w->picture.position[c] = w->position[c];
        w->picture.light[c] = w->light[c];
    }
    for (size_t i = 0; i < COUNT; i++) {
        const float x = 0.03f * ((float)(i % WIDTH) - 0.5f * WIDTH), y = 0.03f * (float)(i / WIDTH);
        w->filtered[i] = true;
        w->normal[x < 0.0f ? 0 : 2][i] = 1.0f;
        w->position[0][i] = 100.0f + fmaxf(x, 0.0f);
        w->position[1][i] = y;
        w->position[2][i] = fmaxf(-x, 0.0f);
    }
    return w;
}

/* Light that features explain within a block: quadratic along each wall, which differ. */
static float smooth_at(const struct walls *w, int c, size_t i)
{
    const float x = w->position[0][i] - 100.0f, y = w->position[1][i], z = w->position[2][i];
    return 2.0f + 0.5f * (float)c + w->normal[0][i] + 0.7f * x * x - 0.4f * y + 0.3f * z;
}

/* From -1 to 1, with variance 1/3. */
static float chance(uint32_t key, size_t i)
{
    return 2.0f * ((float)(kiln_hash2(key, (uint32_t)i) >> 8) + 0.5f) / 16777216.0f - 1.0f;
}

/* Sets smooth light with an even noise of this size, the same in all colours. */
static void set_light(struct walls *w, float noise)
{
    for (size_t i = 0; i < COUNT; i++) {
        for (int c = 0; c < 3; c++)
            w->light[c][i] = smooth_at(w, c, i) + noise * chance(7, i);
        w->deviation[i] = noise / sqrtf(3.0f);
    }
}

static double error_of(const struct walls *w)
{
    double sum = 0.0;
    for (size_t i = 0; i < COUNT; i++)
        for (int c = 0; c < 3 && w->filtered[i]; c++)
            sum += pow((double)(w->light[c][i] - smooth_at(w, c, i)), 2.0);
    return sqrt(sum / (3.0 * COUNT));
}

/* Light that features explain stays, whatever pixels show that take no part; of noise on it little is left. */
static void test_smooth(void **state)
{
    (void)state;
    struct walls *w = make_walls();
    set_light(w, 0.0f);
    for (size_t i = 0; i < COUNT; i++) {
        w->deviation[i] = 1.0f; /* so that the fit is taken */
        w->filtered[i] = i % 7 != 3;
        if (!w->filtered[i])
            w->light[0][i] = w->light[1][i] = w->light[2][i] = 1e6f;
    }
    assert_int_equal(kiln_bmfr_run(&w->picture, NULL), KILN_OK);
    assert_true(error_of(w) < 2e-4);
    set_light(w, 0.5f);
    const double before = error_of(w);
    assert_int_equal(kiln_bmfr_run(&w->picture, NULL), KILN_OK);
    assert_true(error_of(w) < 0.25 * before);
    kiln_free(&w);
}

/* Stripes that no feature explains, without noise, stay; so do pixels that take no part. */
static void test_kept(void **state)
{
    (void)state;
    struct walls *w = make_walls();
    set_light(w, 0.0f);
    for (size_t i = 0; i < COUNT; i++) {
        w->filtered[i] = i % 7 != 3;
        for (int c = 0; c < 3; c++)
            w->light[c][i] += w->filtered[i] ? (i % WIDTH / 4 % 2 == 0 ? 1.0f : 0.0f) : 1e6f;
        w->deviation[i] = 1e-3f;
    }
    float *light = NULL;
    assert_int_equal(kiln_allocate(&light, COUNT, sizeof *light, "light", NULL), KILN_OK);
    memcpy(light, w->light[1], COUNT * sizeof *light);
    assert_int_equal(kiln_bmfr_run(&w->picture, NULL), KILN_OK);
    for (size_t i = 0; i < COUNT; i++)
        assert_true(w->filtered[i] ? fabsf(w->light[1][i] - light[i]) < 1e-3f
                                   : memcmp(&w->light[1][i], &light[i], sizeof *light) == 0);
    kiln_free(&light);
    kiln_free(&w);
}

/* The same bits for any number of threads; other blocks, other bits. */
static void test_threads(void **state)
{
    (void)state;
    const int threads = omp_get_max_threads();
    struct walls *one = make_walls(), *other = make_walls();
    set_light(one, 0.5f);
    set_light(other, 0.5f);
    omp_set_num_threads(1);
    assert_int_equal(kiln_bmfr_run(&one->picture, NULL), KILN_OK);
    omp_set_num_threads(3);
    assert_int_equal(kiln_bmfr_run(&other->picture, NULL), KILN_OK);
    omp_set_num_threads(threads);
    assert_memory_equal(one->light, other->light, sizeof one->light);
    set_light(other, 0.5f);
    other->picture.shift[0]++;
    assert_int_equal(kiln_bmfr_run(&other->picture, NULL), KILN_OK);
    assert_memory_not_equal(one->light, other->light, sizeof one->light);
    kiln_free(&one);
    kiln_free(&other);
}

/* ---- frames ---- */

/* A wall at z = 0, and before its middle a board at z = 2, 0.8 m wide. */
struct scene {
    float normal[3][COUNT], position[3][COUNT], light[COUNT], variance[COUNT];
    bool surface[COUNT], bound[COUNT], board[COUNT];
    struct kiln_frame frame;
};

static float wall_light(float x, float y) { return 3.0f + 0.3f * x + 0.2f * y; }

/* Makes the frame that a camera 5 m before the wall sees. Its light is off by `off`. */
static void look(struct scene *s, double x, double y, float off)
{
    s->frame = (struct kiln_frame){.camera = {.position = dvec3(x, y, 5.0),
                                              .right = dvec3(1.0, 0.0, 0.0),
                                              .up = dvec3(0.0, 1.0, 0.0),
                                              .forward = dvec3(0.0, 0.0, -1.0),
                                              .extent_x = 0.5 * WIDTH / HEIGHT,
                                              .extent_y = 0.5},
                                   .width = WIDTH,
                                   .height = HEIGHT,
                                   .place = 0.25,
                                   .surface = s->surface,
                                   .bound = s->bound};
    const struct kiln_view_camera *c = &s->frame.camera;
    for (size_t i = 0; i < COUNT; i++) {
        const double u = (((double)(i % WIDTH) + 0.25) / WIDTH * 2.0 - 1.0) * c->extent_x,
                     v = (1.0 - ((double)(i / WIDTH) + 0.25) / HEIGHT * 2.0) * c->extent_y;
        s->board[i] = fabs(x + 3.0 * u) < 0.4;
        const double away = s->board[i] ? 3.0 : 5.0;
        s->position[0][i] = (float)(x + away * u);
        s->position[1][i] = (float)(y + away * v);
        s->position[2][i] = (float)(5.0 - away);
        s->normal[2][i] = 1.0f;
        s->surface[i] = true;
        s->light[i] = (s->board[i] ? 50.0f : wall_light(s->position[0][i], s->position[1][i])) + off;
        s->variance[i] = 1.0f;
    }
    for (int k = 0; k < 3; k++) {
        s->frame.normal[k] = s->normal[k];
        s->frame.position[k] = s->position[k];
    }
}

struct frames {
    struct scene *scene;
    struct kiln_history *history;
    struct kiln_layer layer;
};

static struct frames open_frames(void)
{
    struct frames f = {0};
    assert_int_equal(kiln_allocate(&f.scene, 1, sizeof *f.scene, "a scene", NULL), KILN_OK);
    assert_int_equal(kiln_history_create(&f.history, WIDTH, HEIGHT, NULL), KILN_OK);
    assert_int_equal(kiln_layer_create(&f.layer, f.history, 2, NULL), KILN_OK);
    return f;
}

static void add_frame(struct frames *f, double x, double y, float off)
{
    float *const planes[] = {f->scene->light, f->scene->variance};
    look(f->scene, x, y, off);
    kiln_history_find(f->history, &f->scene->frame);
    assert_int_equal(kiln_layer_blend(&f->layer, f->history, 0.1, true, planes, NULL), KILN_OK);
}

static void close_frames(struct frames *f)
{
    kiln_layer_destroy(&f->layer);
    kiln_history_destroy(&f->history);
    kiln_free(&f->scene);
}

/* A camera that stands still: the mean of all frames, until a new one has a tenth of the weight. */
static void test_still(void **state)
{
    (void)state;
    struct frames f = open_frames();
    for (int n = 1; n <= 11; n++) {
        add_frame(&f, 0.1, 0.2, (float)n);
        const float mean = n <= 10 ? 0.5f * (float)(n + 1) : 0.9f * 5.5f + 0.1f * 11.0f,
                    variance = n <= 10 ? 1.0f / (float)n : 0.81f * 0.1f + 0.01f;
        for (size_t i = 0; i < COUNT; i++) {
            const float own = f.scene->board[i] ? 50.0f : wall_light(f.scene->position[0][i], f.scene->position[1][i]);
            assert_true(fabsf(f.scene->light[i] - own - mean) < 1e-4f);
            assert_true(fabsf(f.scene->variance[i] - variance) < 1e-5f);
        }
    }
    close_frames(&f);
}

/* A camera that moves: each place keeps its light; what the board hid, and what comes into the picture, begins anew. */
static void test_moving(void **state)
{
    (void)state;
    const double step = 0.63, up = 0.05;
    struct frames f = open_frames();
    size_t two = 0, hidden = 0;
    add_frame(&f, 0.0, 0.0, 0.5f);
    add_frame(&f, step, up, -0.5f);
    for (size_t i = 0; i < COUNT; i++) {
        const float x = f.scene->position[0][i], y = f.scene->position[1][i];
        const bool was_hidden = fabs((double)x) * 3.0 / 5.0 < 0.4 - 0.06;
        const bool was_outside = (double)x > 5.0 * f.scene->frame.camera.extent_x + 0.1;
        if (f.scene->board[i])
            continue;
        const float frames = f.layer.frames[i], off = f.scene->light[i] - wall_light(x, y);
        assert_true(frames < 1.5f ? fabsf(off + 0.5f) < 1e-5f : fabsf(off) < 0.03f);
        assert_true(!(was_hidden || was_outside) || frames < 1.5f);
        two += frames > 1.5f;
        hidden += was_hidden;
    }
    assert_true(two > COUNT / 2);
    assert_true(hidden > 100);
    close_frames(&f);
}

/* Surfaces that move with the camera take nothing over unless it stands still. */
static void test_bound(void **state)
{
    (void)state;
    struct frames f = open_frames();
    const size_t own = COUNT / 2 + 3;
    f.scene->bound[own] = true;
    for (int n = 0; n < 4; n++)
        add_frame(&f, n < 3 ? 0.0 : 0.01, 0.0, 0.0f);
    assert_true(fabsf(f.layer.frames[own] - 1.0f) < 1e-6f);
    assert_true(f.layer.frames[own + 1] > 3.5f);
    add_frame(&f, 0.01, 0.0, 0.0f);
    assert_true(fabsf(f.layer.frames[own] - 2.0f) < 1e-6f);
    close_frames(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_smooth),  cmocka_unit_test(test_kept),
                                       cmocka_unit_test(test_threads), cmocka_unit_test(test_still),
                                       cmocka_unit_test(test_moving),  cmocka_unit_test(test_bound)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
