/* Tests of borders between charts: to which chart a margin texel is assigned, and the distance of charts on a layout.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "coordinator/layout/padding.h"
#include "coordinator/layout/unwrap.h"
#include "coordinator/output/map/charts/borders.h"
#include "coordinator/output/map/charts/dilate.h"
#include "coordinator/output/map/charts/nearest.h"
#include "tests/common/synthetic.h"

enum { SIDE = 16, HALF = SIDE / 2, TEXELS = SIDE * SIDE };

/* Two squares of a layout side by side: chart 0 from x = 2 to `left`, chart 1 from `right` to 14, both from y = 3 to
 * 13, in texels. */
static void two_charts(struct synthetic *s, float left, float right)
{
    const float x[2][2] = {{2.0f, left}, {right, 14.0f}};
    synthetic_scene(s, SIDE, SIDE);
    for (int c = 0; c < 2; c++)
        for (int k = 0; k < 4; k++)
            s->texcoords[4 * c + k] = (struct kiln_vec2){x[c][k == 1 || k == 2] / SIDE, (k >= 2 ? 13.0f : 3.0f) / SIDE};
}

/* Chart 0 has light 1, chart 1 has `bright`. */
static struct kiln_map *make_map(const struct synthetic *s, float bright)
{
    struct kiln_map *map = NULL;
    assert_int_equal(kiln_map_create(&map, SIDE, SIDE, &kiln_map_light, NULL), 0);
    for (uint32_t i = 0; i < TEXELS; i++) {
        double area[2] = {0, 0};
        for (uint32_t t = 0; t < 4; t++)
            area[t / 2] += synthetic_area(s, 0, t, i % SIDE, i / SIDE);
        if (!(area[0] + area[1] > 0.0))
            continue;
        map->state[i] = KILN_TEXEL_VALID;
        map->chart[i] = area[1] > area[0];
        for (int c = 0; c < 3; c++)
            map->planes[KILN_MAP_DIRECT + c][i] = area[1] > area[0] ? bright : 1.0f;
    }
    return map;
}

/* The values in the margin of row 8 after dilation, and the report. */
static struct kiln_border_report dilate(float left, float right, float bright, float row[SIDE])
{
    struct synthetic s;
    struct kiln_chart_graph *graph = NULL;
    struct kiln_border_report report;
    uint32_t nearest[TEXELS];
    two_charts(&s, left, right);
    struct kiln_map *map = make_map(&s, bright);
    assert_int_equal(kiln_chart_graph_create(&graph, &s.scene, 0, SIDE, SIDE, NULL), 0);
    assert_int_equal(graph->chart_count, 2);
    assert_int_equal(graph->border_count, 8); /* the diagonals are inside */
    assert_int_equal(kiln_nearest_texels(map->state, KILN_TEXEL_FILLED, SIDE, SIDE, nearest, NULL), 0);
    assert_int_equal(kiln_borders_assign(map, graph, nearest, &report, NULL), 0);
    (void)kiln_map_dilate(map, nearest, NULL, NULL);
    memcpy(row, map->planes[KILN_MAP_DIRECT] + HALF * SIDE, SIDE * sizeof *row);
    assert_true(fabs(report.length - (2.0 * (left - 2.0 + 10.0) + 2.0 * (14.0 - right + 10.0))) < 1e-3);
    kiln_map_destroy(&map);
    kiln_chart_graph_destroy(&graph);
    return report;
}

static void test_the_reader_has_it(void **state)
{
    (void)state;
    float row[SIDE];
    /* column 7 lies between: chart 0 ends in the left half of its last texel and does not read it, chart 1 begins in
     * the left half and does */
    struct kiln_border_report report = dilate(6.3f, 8.2f, 9.0f, row);
    assert_true(row[6] == 1.0f && row[7] == 9.0f && row[8] == 9.0f);
    assert_true(report.contested == 0 && report.foreign == 0 && report.length_disturbed == 0.0);
    /* the other way round; the nearest texel to the left would have it either way */
    report = dilate(6.8f, 8.7f, 9.0f, row);
    assert_true(row[7] == 1.0f && row[8] == 9.0f);
    assert_true(report.contested == 0 && report.length_disturbed == 0.0);
    /* no chart reads it, and both are equally near: it keeps its assignment */
    report = dilate(6.3f, 8.7f, 9.0f, row);
    assert_true(row[7] == 1.0f);
    assert_true(report.contested == 0 && report.length_disturbed == 0.0);
}

static void test_both_read_it(void **state)
{
    (void)state;
    float row[SIDE];
    /* both read column 7 alike: relative to what it should be, light 9 on the dark chart is worse than 1 on the bright
     * one */
    struct kiln_border_report report = dilate(6.9f, 8.1f, 9.0f, row);
    assert_true(row[7] == 1.0f);
    assert_in_range(report.contested, 8, 12);
    assert_true(report.foreign == 0 && report.length_disturbed > 9.0 && report.length_disturbed < 12.0);
    report = dilate(6.9f, 8.1f, 0.25f, row);
    assert_true(row[7] == 0.25f);
    /* with equal light the chart that reads more gets it */
    (void)dilate(6.55f, 8.1f, 1.05f, row);
    assert_true(row[7] == 1.05f);
    (void)dilate(6.9f, 8.45f, 1.05f, row);
    assert_true(row[7] == 1.0f);
}

static void test_texels_of_charts_stay(void **state)
{
    (void)state;
    float row[SIDE];
    const struct kiln_border_report report = dilate(6.9f, 7.1f, 9.0f, row); /* no margin between */
    assert_true(row[6] == 1.0f && row[7] == 9.0f);
    assert_in_range(report.foreign, 20, 24); /* both columns of ten rows, and no more than the corners' */
    assert_int_equal(report.contested, 4);   /* beyond the corners of the gap */
}

/* Single triangles, each a chart, crowded into 4 x 4 texels, of which every second has a chart: claims looked at for
 * each triangle. */
static double looked_at(uint32_t triangles)
{
    struct synthetic s;
    synthetic_scene(&s, SIDE, SIDE);
    struct kiln_vec3 *positions = calloc(3 * triangles, sizeof *positions);
    struct kiln_vec3 *normals = calloc(3 * triangles, sizeof *normals);
    struct kiln_vec2 *uv = calloc(3 * triangles, sizeof *uv);
    uint32_t *corners = calloc(3 * triangles, sizeof *corners);
    const float side = 4.0f / sqrtf((float)triangles);
    const uint32_t row = (uint32_t)ceilf(sqrtf((float)triangles));
    for (uint32_t i = 0; i < 3 * triangles; i++) {
        const float x = 6.0f + side * ((float)(i / 3 % row) + (i % 3 == 1 ? 0.8f : 0.1f)),
                    y = 6.0f + side * ((float)(i / 3 / row) + (i % 3 == 2 ? 0.8f : 0.1f));
        positions[i] = vec3((float)i, y, 0);
        normals[i] = vec3(0, 0, 1);
        uv[i] = (struct kiln_vec2){x / SIDE, y / SIDE};
        corners[i] = i;
    }
    s.mesh.vertex_count = 3 * triangles;
    s.mesh.triangle_count = triangles;
    s.scene.positions = positions;
    s.scene.normals = normals;
    s.scene.texcoord_lightmap = uv;
    s.scene.triangles = corners;
    struct kiln_chart_graph *graph = NULL;
    struct kiln_map *map = NULL;
    struct kiln_border_report report;
    uint32_t nearest[TEXELS];
    assert_int_equal(kiln_map_create(&map, SIDE, SIDE, &kiln_map_light, NULL), 0);
    for (uint32_t i = 6; i < 10; i++)
        for (uint32_t k = 6 + i % 2; k < 10; k += 2) {
            map->state[SIDE * i + k] = KILN_TEXEL_VALID;
            map->chart[SIDE * i + k] = (triangles - 1) * (4 * (i - 6) + k - 6) / 16;
            map->planes[KILN_MAP_DIRECT][SIDE * i + k] = (float)(i + k);
        }
    assert_int_equal(kiln_chart_graph_create(&graph, &s.scene, 0, SIDE, SIDE, NULL), 0);
    assert_int_equal(graph->chart_count, triangles);
    assert_int_equal(kiln_nearest_texels(map->state, KILN_TEXEL_FILLED, SIDE, SIDE, nearest, NULL), 0);
    assert_int_equal(kiln_borders_assign(map, graph, nearest, &report, NULL), 0);
    assert_true(report.contested >= 8 && report.foreign > triangles); /* each reads four texels or two */
    kiln_map_destroy(&map);
    kiln_chart_graph_destroy(&graph);
    free(positions);
    free(normals);
    free(uv);
    free(corners);
    return (double)report.looked_at / triangles;
}

static void test_many_charts_in_a_texel(void **state)
{
    (void)state;
    const double few = looked_at(1000), many = looked_at(16000);
    assert_true(few > 10.0 && many < 2.0 * few);
}

/* ---- distances ---- */

static struct kiln_padding padding_of(const struct synthetic *s, double width, double height)
{
    struct kiln_padding padding;
    assert_int_equal(
        kiln_padding_measure(&padding, s->positions, s->texcoords, 8, &s->triangles[0][0], 4, width, height, NULL), 0);
    return padding;
}

static void test_distance(void **state)
{
    (void)state;
    struct synthetic s;
    two_charts(&s, 6.0f, 7.0f); /* a texel apart along 10 texels of either, and around the corners */
    struct kiln_padding padding = padding_of(&s, SIDE, SIDE);
    assert_true(padding.charts == 2 && padding.close_charts == 2);
    assert_true(fabs(padding.border - (28.0 + 34.0)) < 1.0);
    /* one more texel on each of the four sides that lead away */
    assert_true(padding.close >= 20.0 && padding.close <= 25.0);
    assert_true(kiln_padding_factor(&padding, 0.5) == 1.0);
    const double factor = kiln_padding_factor(&padding, 0.0);
    assert_true(factor >= 2.0 && factor < 2.0 * 1.1);
    padding = padding_of(&s, factor * SIDE, factor * SIDE); /* and that does it */
    assert_true(padding.close == 0.0 && padding.charts == 2 && kiln_padding_factor(&padding, 0.0) == 1.0);
    padding = padding_of(&s, 2.0 * SIDE, SIDE / 2.0); /* only the distance across counts, which is two again */
    assert_true(padding.close == 0.0);
    two_charts(&s, 6.0f, 6.002f); /* they touch */
    padding = padding_of(&s, SIDE, SIDE);
    assert_true(isinf(kiln_padding_factor(&padding, 0.01)));
}

/* Against trying every pair, with charts of many triangles anywhere: fans on random places of a layout. */
static void test_distance_of_many(void **state)
{
    (void)state;
    enum { FANS = 60, CORNERS = 3 * FANS };
    static struct kiln_vec3 positions[CORNERS];
    static struct kiln_vec2 uv[CORNERS];
    static uint32_t triangles[CORNERS];
    uint64_t random = 7;
    for (uint32_t i = 0; i < CORNERS; i++) {
        random = random * 6364136223846793005ull + 1442695040888963407ull;
        const float a = (float)(random >> 40) / 16777216.0f;
        random = random * 6364136223846793005ull + 1442695040888963407ull;
        const float b = (float)(random >> 40) / 16777216.0f;
        const uint32_t first = i - i % 3;
        positions[i] = vec3((float)i, a, b);
        uv[i] = i == first ? (struct kiln_vec2){0.9f * a, 0.9f * b}
                           : (struct kiln_vec2){uv[first].x + 0.1f * a, uv[first].y + 0.1f * b};
        triangles[i] = i;
    }
    struct kiln_padding padding;
    assert_int_equal(kiln_padding_measure(&padding, positions, uv, CORNERS, triangles, FANS, 64.0, 48.0, NULL), 0);
    double border = 0.0, close = 0.0;
    enum { STEPS = 256 };
    for (uint32_t e = 0; e < CORNERS; e++) {
        const struct kiln_vec2 a = uv[e], b = uv[e - e % 3 + (e + 1) % 3];
        const double length = hypot(64.0 * (double)(b.x - a.x), 48.0 * (double)(b.y - a.y));
        border += length;
        for (int i = 0; i < 32; i++) {
            const float t = ((float)i + 0.5f) / 32.0f;
            const double p[2] = {64.0 * (double)(a.x + t * (b.x - a.x)), 48.0 * (double)(a.y + t * (b.y - a.y))};
            double nearest = INFINITY;
            for (uint32_t f = 0; f < CORNERS && nearest >= 2.0; f++) {
                if (f / 3 == e / 3)
                    continue;
                const struct kiln_vec2 c = uv[f], d = uv[f - f % 3 + (f + 1) % 3];
                for (int k = 0; k <= STEPS; k++) {
                    const float r = (float)k / STEPS;
                    nearest = fmin(nearest, fmax(fabs(64.0 * (double)(c.x + r * (d.x - c.x)) - p[0]),
                                                 fabs(48.0 * (double)(c.y + r * (d.y - c.y)) - p[1])));
                }
            }
            close += nearest < 2.0 ? length / 32.0 : 0.0;
        }
    }
    assert_int_equal(padding.charts, FANS);
    assert_true(fabs(padding.border / border - 1.0) < 0.01);
    assert_true(close > 0.2 * border && close < 0.95 * border);
    assert_true(fabs(padding.close - close) < 0.02 * border);
}

/* ---- packing again ---- */

static void test_repack(void **state)
{
    (void)state;
    struct synthetic s;
    struct kiln_unwrapped *u = NULL;
    const struct kiln_unwrap_params params = {.texels_per_metre = 20.0, .padding = 2, .max = 4096};
    const double metres[2] = {2.0, 1.0};
    two_charts(&s, 6.0f, 6.002f);
    assert_int_equal(kiln_repack(&u, s.positions, s.texcoords, 8, &s.triangles[0][0], 4, metres, &params, NULL), 0);
    assert_int_equal(u->chart_count, 2);
    assert_int_equal(u->vertex_count, 8);
    assert_int_equal(u->cells, 1);
    struct kiln_vec3 positions[8];
    for (int i = 0; i < 8; i++)
        positions[i] = s.positions[u->source[i]];
    struct kiln_padding padding;
    assert_int_equal(kiln_padding_measure(&padding, positions, u->uv, 8, u->triangles, 4, u->width, u->height, NULL),
                     0);
    assert_true(padding.charts == 2 && padding.close == 0.0);
    /* each as large as it was: x 4 or 8 of 16 of 2 m, y 10 of 16 of 1 m, 20 texels a metre; turned or not */
    for (uint32_t c = 0; c < 2; c++) {
        double side[2];
        for (uint32_t k = 0; k < 2; k++) {
            const struct kiln_vec2 a = u->uv[u->triangles[6 * c + k]], b = u->uv[u->triangles[6 * c + k + 1]];
            side[k] = hypot((double)(b.x - a.x) * u->width, (double)(b.y - a.y) * u->height);
        }
        const double wanted[2] = {c == 0 ? 10.0 : 20.0, 12.5};
        assert_true(fabs(side[0] / wanted[0] - 1.0) < 0.13 && fabs(side[1] / wanted[1] - 1.0) < 0.13);
        const struct kiln_vec2 a = u->uv[u->triangles[6 * c]], b = u->uv[u->triangles[6 * c + 1]],
                               d = u->uv[u->triangles[6 * c + 2]];
        assert_true((b.x - a.x) * (d.y - a.y) - (b.y - a.y) * (d.x - a.x) > 0.0f); /* not mirrored */
    }
    kiln_unwrapped_destroy(&u);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_the_reader_has_it),
                                       cmocka_unit_test(test_both_read_it),
                                       cmocka_unit_test(test_texels_of_charts_stay),
                                       cmocka_unit_test(test_many_charts_in_a_texel),
                                       cmocka_unit_test(test_distance),
                                       cmocka_unit_test(test_distance_of_many),
                                       cmocka_unit_test(test_repack)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
