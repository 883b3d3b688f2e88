/* Tests of the charts and seams of a mesh, and of seam smoothing. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <omp.h>
#include <stdio.h>

#include "coordinator/output/map/charts/dilate.h"
#include "coordinator/output/map/charts/nearest.h"
#include "coordinator/output/map/seams/seam_samples.h"
#include "coordinator/output/map/seams/seam_system.h"
#include "coordinator/output/map/seams/seams.h"
#include "tests/common/synthetic.h"

enum { WIDTH = 40, HEIGHT = 32 };

static void test_charts_and_seam(void **state)
{
    (void)state;
    struct synthetic s;
    struct kiln_chart_graph *graph = NULL;
    synthetic_scene(&s, WIDTH, HEIGHT);
    assert_int_equal(kiln_chart_graph_create(&graph, &s.scene, 0, WIDTH, HEIGHT, NULL), 0);
    assert_int_equal(graph->chart_count, 2);
    const uint32_t expected[4] = {0, 0, 1, 1};
    assert_memory_equal(graph->chart, expected, sizeof expected);
    assert_int_equal(graph->edge_count, 1);
    for (int e = 0; e < 2; e++) /* side 0 is the right edge of square 0, side 1 the top edge of square 1 */
        for (int side = 0; side < 2; side++) {
            const float *at = graph->edges[0].texel[side][e];
            assert_true(side == 0 ? at[0] == 0.41f * WIDTH : at[1] == 0.17f * HEIGHT);
        }
    kiln_chart_graph_destroy(&graph);
    for (int i = 4; i < 8; i++) /* a fold of 10 degrees: no seam, though the points are the same */
        s.normals[i] = vec3(sinf(0.1745f), 0, cosf(0.1745f));
    assert_int_equal(kiln_chart_graph_create(&graph, &s.scene, 0, WIDTH, HEIGHT, NULL), 0);
    assert_int_equal(graph->chart_count, 2);
    assert_int_equal(graph->edge_count, 0);
    kiln_chart_graph_destroy(&graph);
}

/* A map whose light is a function of the place in space plus, on square 1, an offset: a seam. */
static struct kiln_map *make_map(const struct synthetic *s, float offset, uint32_t **nearest)
{
    struct kiln_map *map = NULL;
    assert_int_equal(kiln_map_create(&map, WIDTH, HEIGHT, &kiln_map_light, NULL), 0);
    for (uint32_t y = 0; y < HEIGHT; y++)
        for (uint32_t x = 0; x < WIDTH; x++) {
            const uint32_t i = y * WIDTH + x;
            double area[2] = {0, 0};
            for (uint32_t t = 0; t < 4; t++)
                area[t / 2] += synthetic_area(s, 0, t, x, y);
            if (!(area[0] + area[1] > 0.0))
                continue;
            map->state[i] = KILN_TEXEL_VALID;
            map->chart[i] = area[1] > 0.0;
            map->area[i] = (float)(area[0] + area[1]);
            const float u = ((float)x + 0.5f) / WIDTH, v = ((float)y + 0.5f) / HEIGHT;
            const float along = area[1] > 0.0 ? (0.93f - u) / 0.38f : (v - 0.11f) / 0.72f; /* y in space */
            for (int c = 0; c < 3; c++) {
                map->planes[KILN_MAP_DIRECT + c][i] = 2.0f + along + (area[1] > 0.0 ? offset : 0.0f);
                map->planes[KILN_MAP_INDIRECT + c][i] = 1.0f + 0.3f * along;
            }
        }
    kiln_free(nearest); /* of a map made before */
    assert_int_equal(kiln_allocate(nearest, WIDTH * HEIGHT, sizeof **nearest, "nearest", NULL), 0);
    assert_int_equal(kiln_nearest_texels(map->state, KILN_TEXEL_FILLED, WIDTH, HEIGHT, *nearest, NULL), 0);
    return map;
}

static double energy(const struct kiln_map *map)
{
    double sum = 0.0;
    for (size_t i = 0; i < kiln_map_texels(map); i++)
        sum += (double)map->area[i] * ((double)map->planes[0][i] + (double)map->planes[3][i]);
    return sum;
}

static void test_smoothing(void **state)
{
    (void)state;
    struct synthetic s;
    struct kiln_chart_graph *graph = NULL;
    struct kiln_seam_report report;
    uint32_t *nearest = NULL;
    synthetic_scene(&s, WIDTH, HEIGHT);
    assert_int_equal(kiln_chart_graph_create(&graph, &s.scene, 0, WIDTH, HEIGHT, NULL), 0);
    struct kiln_map *map = make_map(&s, 0.4f, &nearest), *before = make_map(&s, 0.4f, &nearest);
    const double energy_before = energy(map);
    (void)kiln_map_dilate(before, nearest, NULL, NULL);
    assert_int_equal(kiln_seams_smooth(map, graph, nearest, true, &report, NULL), 0);
    printf("seam: %.4f of the mean before, %.4f after; energy changed by %.2g\n", report.difference_before,
           report.difference_after, energy(map) / energy_before - 1.0);
    assert_true(report.samples >= 40);
    assert_true(report.difference_before > 0.05);
    assert_true(report.difference_after < 0.1 * report.difference_before);
    assert_true(fabs(energy(map) / energy_before - 1.0) < 2e-3);
    size_t changed = 0, beyond = 0;
    for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
        if (map->planes[0][i] == before->planes[0][i])
            continue;
        changed++;
        assert_int_equal(nearest[i], i); /* so that it stays as it is when the map is dilated */
        beyond += map->state[i] == KILN_TEXEL_MARGIN;
        const float x = (float)(i % WIDTH) + 0.5f, y = (float)(i / WIDTH) + 0.5f; /* within a footprint of the seam */
        assert_true(fabsf(x - 0.41f * WIDTH) < 1.6f || fabsf(y - 0.17f * HEIGHT) < 1.6f);
        assert_true(map->planes[0][i] >= 2.0f - 0.2f && map->planes[0][i] <= 3.6f);
    }
    assert_true(changed > 20 && beyond > 5);
    kiln_map_destroy(&map);
    kiln_map_destroy(&before);
    kiln_free(&nearest);
    kiln_chart_graph_destroy(&graph);
}

/* A constant is left exactly alone; black next to light stays black; measuring changes nothing. */
static void test_what_stays(void **state)
{
    (void)state;
    struct synthetic s;
    struct kiln_chart_graph *graph = NULL;
    struct kiln_seam_report report;
    uint32_t *nearest = NULL;
    synthetic_scene(&s, WIDTH, HEIGHT);
    assert_int_equal(kiln_chart_graph_create(&graph, &s.scene, 0, WIDTH, HEIGHT, NULL), 0);
    struct kiln_map *map = make_map(&s, 0.4f, &nearest), *same = make_map(&s, 0.4f, &nearest);
    (void)kiln_map_dilate(same, nearest, NULL, NULL);
    assert_int_equal(kiln_seams_smooth(map, graph, nearest, false, &report, NULL), 0);
    assert_true(report.difference_after == report.difference_before && report.difference_before > 0.0);
    for (int p = 0; p < KILN_MAP_PLANES; p++)
        assert_memory_equal(map->planes[p], same->planes[p], WIDTH * HEIGHT * sizeof(float));
    for (size_t i = 0; i < WIDTH * HEIGHT; i++)
        for (int p = 0; p < 6; p++)
            map->planes[p][i] = map->state[i] == KILN_TEXEL_MARGIN ? 0.0f : 0.7f;
    assert_int_equal(kiln_seams_smooth(map, graph, nearest, true, &report, NULL), 0);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++)
        assert_true(map->planes[0][i] == 0.7f);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++)
        for (int p = 0; p < 6; p++)
            map->planes[p][i] = map->chart[i] == 0 ? 0.0f : map->planes[p][i];
    assert_int_equal(kiln_seams_smooth(map, graph, nearest, true, &report, NULL), 0);
    assert_int_equal(report.samples, 0);
    for (size_t i = 0; i < WIDTH * HEIGHT; i++)
        assert_true(map->chart[i] != 0 || map->planes[0][i] == 0.0f);
    kiln_map_destroy(&map);
    kiln_map_destroy(&same);
    kiln_free(&nearest);
    kiln_chart_graph_destroy(&graph);
}

/* A system whose planes take different numbers of steps, and some of whose values have to be held. */
static void make_system(struct kiln_seam_system **system, size_t unknowns, size_t samples)
{
    enum { PLANES = 9 };
    uint32_t state = 1;
    assert_int_equal(kiln_seam_system_create(system, unknowns, samples, PLANES, NULL), 0);
    struct kiln_seam_system *s = *system;
    for (size_t i = 0; i < samples; i++)
        for (int k = 0; k < KILN_SEAM_ENTRIES; k++) {
            state = state * 1664525u + 1013904223u;
            s->samples[i].at[k] = (state >> 8) % (uint32_t)unknowns;
            s->samples[i].weight[k] = k < KILN_SEAM_SIDE ? 0.25f : -0.25f;
        }
    for (size_t i = 0; i < unknowns; i++) {
        s->area[i] = i % 7 == 0 ? 0.0f : 1.0f + 0.1f * (float)(i % 3);
        for (uint32_t p = 0; p < PLANES; p++) {
            state = state * 1664525u + 1013904223u;
            s->planes[p][i] = p == 4 ? 0.0f : p == 5 ? 2.0f : (float)(state >> 8 & 255u) * (i % 50 == p ? 1e3f : 1.0f);
        }
    }
}

/* Solves every `step`-th plane of a system at a time. */
static void solve(struct kiln_seam_system *s, uint32_t step, int threads)
{
    omp_set_num_threads(threads);
    for (uint32_t p = 0; p < step; p++)
        assert_int_equal(kiln_seam_system_solve(s, p, step, NULL), 0);
}

static void check_same(const struct kiln_seam_system *a, const struct kiln_seam_system *b)
{
    for (uint32_t p = 0; p < a->plane_count; p++)
        assert_memory_equal(a->planes[p], b->planes[p], a->unknown_count * sizeof(float));
}

/* Planes that are solved side by side, by few threads or by many, are what each is alone. */
static void check_threads(size_t unknowns, size_t samples, const int *threads, size_t count)
{
    struct kiln_seam_system *alone = NULL;
    make_system(&alone, unknowns, samples);
    solve(alone, alone->plane_count, 1);
    for (size_t t = 0; t < count; t++)
        for (uint32_t step = 1; step <= 2; step++) {
            struct kiln_seam_system *all = NULL;
            size_t changed = 0;
            make_system(&all, unknowns, samples);
            for (size_t i = 0; i < all->unknown_count; i++)
                changed += all->planes[0][i] != alone->planes[0][i];
            assert_true(changed > samples / 2);
            solve(all, step, threads[t]);
            check_same(all, alone);
            kiln_seam_system_destroy(&all);
        }
    kiln_seam_system_destroy(&alone);
}

static void test_planes_side_by_side(void **state)
{
    (void)state;
    check_threads(300, 200, (const int[]){1, 2, 3, 4, 5, 6, 7, 8, 9}, 9);
}

static void test_large(void **state)
{
    (void)state;
    check_threads(21000, 4000, (const int[]){5, 7}, 2);
    check_threads(140000, 4000, (const int[]){4}, 1);
}

/* Two parts, the first of which has a value that is not finite: it stays, and the other is solved. */
static void test_not_finite(void **state)
{
    (void)state;
    struct kiln_seam_system *s = NULL;
    assert_int_equal(kiln_seam_system_create(&s, 16, 2, 2, NULL), 0);
    for (uint32_t i = 0; i < 2; i++)
        for (uint32_t k = 0; k < KILN_SEAM_ENTRIES; k++) {
            s->samples[i].at[k] = 8 * i + k;
            s->samples[i].weight[k] = k < KILN_SEAM_SIDE ? 0.25f : -0.25f;
        }
    for (uint32_t u = 0; u < 16; u++) {
        s->area[u] = 1.0f;
        s->planes[0][u] = s->planes[1][u] = u % 8 < KILN_SEAM_SIDE ? 1.0f : 2.0f;
    }
    s->planes[0][1] = INFINITY;
    assert_int_equal(kiln_seam_system_solve(s, 0, 1, NULL), 0);
    for (uint32_t u = 0; u < 16; u++) {
        const float was = u == 1 ? INFINITY : u % 8 < KILN_SEAM_SIDE ? 1.0f : 2.0f;
        assert_true((s->planes[0][u] == was) == (u < 8));
        assert_true(fabsf(s->planes[1][u] - 1.5f) < 0.2f); /* both sides have come nearer */
    }
    kiln_seam_system_destroy(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_charts_and_seam), cmocka_unit_test(test_smoothing),
        cmocka_unit_test(test_what_stays),      cmocka_unit_test(test_planes_side_by_side),
        cmocka_unit_test(test_large),           cmocka_unit_test(test_not_finite)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
