/* Map stages: a table is walked in order, what a stage reads is made and sent only when it is wanted, and is right. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <mpi.h>
#include <string.h>

#include "coordinator/output/map/charts/chart_graphs.h"
#include "coordinator/output/map/write/stages.h"
#include "coordinator/output/map/write/texel_gather.h"
#include "tests/common/synthetic.h"

enum { WIDTH = 40, HEIGHT = 32 };

static bool never(const struct kiln_output_params *params) { return params == NULL; }

static bool if_stitched(const struct kiln_output_params *params) { return params->stitch; }

static int look(struct kiln_map_work *work, struct kiln_error *error)
{
    (void)error;
    work->report->valid = 10 * work->report->valid + (work->graph != NULL ? 1 : 0) + (work->nearest != NULL ? 2 : 0);
    return KILN_OK;
}

static int give_up(struct kiln_map_work *work, struct kiln_error *error)
{
    return kiln_fail(error, KILN_BUG, "lightmap %u fails", work->object);
}

static const struct kiln_map_stage plain = {.name = "plain", .run = look},
                                   charts = {.name = "charts", .features = KILN_MAP_CHARTS, .run = look},
                                   nearest = {.name = "nearest", .features = KILN_MAP_NEAREST, .run = look},
                                   failing = {.name = "failing", .run = give_up},
                                   skipped = {.name = "skipped",
                                              .wanted = never,
                                              .features = KILN_MAP_POSITION,
                                              .fields = {"nothing"},
                                              .run = give_up},
                                   lost = {.name = "lost", .fields = {"nothing"}, .run = give_up},
                                   guided = {.name = "guided",
                                             .wanted = if_stitched,
                                             .features = KILN_MAP_POSITION | KILN_MAP_NORMAL,
                                             .fields = {"albedo", "error"},
                                             .run = look};

static void runs_in_order_what_is_wanted(void **state)
{
    (void)state;
    struct synthetic s;
    assert_int_equal(synthetic_create(&s, WIDTH, HEIGHT, 0, 1, NULL), KILN_OK);
    const struct kiln_bake_result result = synthetic_result(&s, MPI_COMM_SELF);
    const struct kiln_output_params params = {.stitch = true};
    struct kiln_lightmap_report report = {0};
    struct kiln_error error = {{0}};
    struct kiln_chart_graphs *graphs = NULL;
    assert_int_equal(kiln_chart_graphs_create(&graphs, &s.scene, NULL), KILN_OK);
    struct kiln_map_work work = {
        .result = &result, .params = &params, .object = 1, .graphs = graphs, .report = &report};
    const struct kiln_map_stage *const some[] = {&plain, &skipped, &charts, &plain, &nearest, &guided, NULL},
                                       *const short_one[] = {&plain, &nearest, &failing, &charts, NULL};
    assert_int_equal(kiln_map_create(&work.map, WIDTH, HEIGHT / 2 + 1, &kiln_map_light, NULL), KILN_OK);
    work.map->chart[5] = 3; /* the last triangle, of the second chart */
    assert_int_equal(kiln_map_stages_run(some, &work, &error), KILN_OK);
    assert_int_equal(report.valid, 1133); /* 0, 1, 1, 3, 3: made when the first asks, and kept */
    assert_true(work.map->chart[5] == 1 && work.map->chart[4] == KILN_NONE);
    assert_true(work.graph == NULL && work.nearest == NULL);
    report.valid = 0;
    assert_int_equal(kiln_map_stages_run(short_one, &work, &error), KILN_BUG);
    assert_string_equal(error.message, "lightmap 1 fails");
    assert_int_equal(report.valid, 2);
    assert_null(work.nearest);
    kiln_map_destroy(&work.map);
    kiln_chart_graphs_destroy(&graphs);
}

/* Objects of one mesh and size have one graph, which stays for the next for a while; others have their own. */
static void graphs_are_shared(void **state)
{
    (void)state;
    enum { SIZES = KILN_CHART_GRAPHS_IDLE + 4, TAKES = 8 };
    struct synthetic s;
    struct kiln_chart_graphs *graphs = NULL;
    const struct kiln_chart_graph *graph[SIZES][TAKES] = {{NULL}};
    int failed = 0;
    assert_int_equal(synthetic_create(&s, WIDTH, HEIGHT, 0, 1, NULL), KILN_OK);
    assert_int_equal(kiln_chart_graphs_create(&graphs, &s.scene, NULL), KILN_OK);
#pragma omp parallel for num_threads(TAKES) reduction(+ : failed) schedule(static, 1) collapse(2)
    for (uint32_t k = 0; k < SIZES; k++)
        for (uint32_t i = 0; i < TAKES; i++)
            failed += kiln_chart_graphs_take(graphs, 0, WIDTH + k, HEIGHT, &graph[k][i], NULL) != KILN_OK;
    assert_int_equal(failed, 0);
    for (uint32_t k = 0; k < SIZES; k++)
        for (uint32_t i = 0; i < TAKES; i++)
            assert_true(graph[k][i] == graph[k][0] && (k == 0 || graph[k][i] != graph[k - 1][0]));
    const struct kiln_chart_graph *const last = graph[SIZES - 1][0];
    for (uint32_t k = 0; k < SIZES; k++)
        for (uint32_t i = 0; i < TAKES; i++)
            kiln_chart_graphs_give_back(graphs, &graph[k][i]);
    assert_null(graph[0][0]);
    assert_int_equal(kiln_chart_graphs_take(graphs, 0, WIDTH + SIZES - 1, HEIGHT, &graph[0][0], NULL), KILN_OK);
    assert_ptr_equal(graph[0][0], last); /* it was kept; the first was not, and is made again */
    assert_int_equal(kiln_chart_graphs_take(graphs, 0, WIDTH, HEIGHT, &graph[0][1], NULL), KILN_OK);
    assert_int_equal(graph[0][1]->chart_count, 2);
    assert_true(graph[0][1]->borders[0].texel[1][0] <= (float)WIDTH);
    for (uint32_t i = 0; i < 2; i++)
        kiln_chart_graphs_give_back(graphs, &graph[0][i]);
    kiln_chart_graphs_destroy(&graphs);
}

/* The graphs of a mesh go with the last use that was announced. */
static void graphs_go_with_their_last_use(void **state)
{
    (void)state;
    struct synthetic s;
    struct kiln_chart_graphs *graphs = NULL;
    const struct kiln_chart_graph *graph[2] = {NULL, NULL};
    assert_int_equal(synthetic_create(&s, WIDTH, HEIGHT, 0, 1, NULL), KILN_OK);
    assert_int_equal(kiln_chart_graphs_create(&graphs, &s.scene, NULL), KILN_OK);
    for (int i = 0; i < 3; i++)
        kiln_chart_graphs_expect(graphs, 0);
    assert_int_equal(kiln_chart_graphs_take(graphs, 0, WIDTH, HEIGHT, &graph[0], NULL), KILN_OK);
    kiln_chart_graphs_give_back(graphs, &graph[0]);
    assert_int_equal(kiln_chart_graphs_held(graphs), 1);
    assert_int_equal(kiln_chart_graphs_take(graphs, 0, WIDTH, HEIGHT, &graph[0], NULL), KILN_OK);
    assert_int_equal(kiln_chart_graphs_take(graphs, 0, WIDTH + 1, HEIGHT, &graph[1], NULL), KILN_OK);
    kiln_chart_graphs_give_back(graphs, &graph[0]);
    assert_int_equal(kiln_chart_graphs_held(graphs), 2);
    kiln_chart_graphs_give_back(graphs, &graph[1]);
    assert_int_equal(kiln_chart_graphs_held(graphs), 0);
    kiln_chart_graphs_destroy(&graphs);
}

static void planes_only_for_those_that_read_them(void **state)
{
    (void)state;
    struct kiln_field_set fields;
    struct kiln_layers layers;
    struct kiln_error error = {{0}};
    struct kiln_output_params params = {.stitch = false};
    const struct kiln_map_stage *const some[] = {&plain, &skipped, &guided, &guided, NULL}, *const bad[] = {&lost,
                                                                                                            NULL};
    kiln_field_set_choose(&fields, &(struct kiln_job){.lightmaps.error_map = false});
    assert_int_equal(kiln_layers_make(&layers, &fields, &error), KILN_OK);
    assert_int_equal(kiln_map_stages_layers(kiln_map_stages, &params, &layers, &fields, &error), KILN_OK);
    assert_int_equal(kiln_map_stages_layers(some, &params, &layers, &fields, &error), KILN_OK);
    assert_memory_equal(&layers.planes, &kiln_map_light, sizeof layers.planes);
    assert_int_equal(kiln_map_stages_layers(bad, &params, &layers, &fields, &error), KILN_BUG);
    assert_non_null(strstr(error.message, "'nothing'"));
    params.stitch = true;
    assert_int_equal(kiln_map_stages_layers(some, &params, &layers, &fields, &error), KILN_OK);
    assert_int_equal(layers.planes.count, KILN_MAP_PLANES + 9); /* once, though two stages read them */
    assert_int_equal(kiln_layers_plane(&layers, kiln_field_set_find(&fields, "albedo")), KILN_MAP_PLANES);
    assert_int_equal(kiln_layers_plane(&layers, kiln_field_set_find(&fields, "error")), KILN_MAP_ERROR);
    assert_int_equal(kiln_layers_plane(&layers, kiln_field_set_find(&fields, "area")), KILN_MAP_PLANES_MAX);
    assert_true(layers.reads[2][0] == KILN_MAP_PLANES && layers.reads[2][1] == KILN_MAP_ERROR);
    assert_int_equal(layers.reads[2][KILN_MAP_IF_ANY], KILN_MAP_PLANES_MAX);
    assert_true(layers.position == KILN_MAP_PLANES + 3 && layers.normal == KILN_MAP_PLANES + 6);
}

/* An object of which a fifth is margin; four parts, each with noise of its own for each texel, of variance 1, and with
 * `shared` added or taken off everywhere. Returns what the stage finds that neighbours share. */
static float find_shared(float shared)
{
    struct kiln_field_set fields;
    struct kiln_layers layers;
    struct kiln_lightmap_report report = {0};
    const struct kiln_output_params params = {.parts = true};
    const struct kiln_map_stage *const stages[] = {&kiln_map_stage_mean_error, NULL};
    uint64_t random = 1;
    kiln_field_set_choose(&fields, &(struct kiln_job){.lightmaps.error_map = true});
    const struct kiln_bake_result result = {.fields = &fields};
    struct kiln_map_work work = {.result = &result, .params = &params, .layers = &layers, .report = &report};
    assert_int_equal(kiln_layers_make(&layers, &fields, NULL), KILN_OK);
    assert_int_equal(kiln_map_stages_layers(stages, &params, &layers, &fields, NULL), KILN_OK);
    assert_int_equal(kiln_map_create(&work.map, 70, 65, &layers.planes, NULL), KILN_OK);
    float **parts = work.map->planes + kiln_layers_plane(&layers, kiln_field_set_find(&fields, "parts"));
    for (size_t i = 0; i < kiln_map_texels(work.map); i++) {
        work.map->state[i] = i % 5 == 0 ? KILN_TEXEL_MARGIN : KILN_TEXEL_VALID;
        work.map->area[i] = 1.0f;
        for (int k = 0; k < KILN_PARTS; k++) {
            random = random * 6364136223846793005u + 1442695040888963407u;
            const float even = (float)(random >> 40) * 0x1p-24f - 0.5f;
            parts[k][i] = 10.0f + even * 3.4641016f + (k % 2 == 0 ? shared : -shared);
        }
    }
    assert_int_equal(kiln_map_stages_run(stages, &work, NULL), KILN_OK);
    kiln_map_destroy(&work.map);
    return work.shared;
}

/* The variance of the mean is 1/4 of texels' own noise, and 1/3 of the square of what is shared. */
static void finds_what_neighbours_share(void **state)
{
    (void)state;
    const float none = find_shared(0.0f), quarter = find_shared(0.5f), half = find_shared(0.8660254f);
    print_message("neighbours share %.3f, %.3f and %.3f\n", (double)none, (double)quarter, (double)half);
    assert_true(none >= 0.0f && none < 0.02f);
    assert_true(quarter > 0.23f && quarter < 0.27f);
    assert_true(half > 0.48f && half < 0.52f);
}

/* Points that the round brings. */
struct arrived {
    const struct kiln_layers *layers;
    uint64_t points, wrong;
};

/* The first object lies at z = 0 between x = 0 and 2, the second is mirrored and 3 m further up. */
static void check_point(void *context, const struct kiln_texel_record *record)
{
    struct arrived *arrived = context;
    const float *position = record->values + arrived->layers->position,
                *normal = record->values + arrived->layers->normal, *albedo = record->values + KILN_MAP_PLANES;
    const float along = record->map == 0 ? position[0] : -position[0],
                up = position[1] - (record->map == 0 ? -2.0f : 1.0f); /* the centre is at y = 2 */
    const float u = ((float)record->x + 0.5f) / WIDTH,
                v = ((float)record->y + 0.5f) / (record->map == 0 ? HEIGHT : HEIGHT / 2 + 1);
    const bool right_square = u > 0.48f;
    const float expected = right_square ? 1.0f + (v - 0.17f) / 0.7f : (u - 0.06f) / 0.35f;
    const bool right = fabsf(along - expected) < 0.09f && up > -1e-6f && up < 1.0f + 1e-6f &&
                       fabsf(position[2]) < 1e-6f && fabsf(fabsf(normal[2]) - 1.0f) < 1e-6f &&
                       fabsf(normal[0]) + fabsf(normal[1]) < 1e-6f && albedo[0] == 32768 / 65535.0f &&
                       albedo[2] == albedo[0];
#pragma omp critical(check_point)
    {
        arrived->points++;
        arrived->wrong += !right;
    }
}

static void features_arrive_with_the_texels(void **state)
{
    (void)state;
    struct synthetic s;
    struct kiln_layers layers;
    struct kiln_assignment *assignment = NULL;
    struct kiln_texel_gather *gather = NULL;
    struct kiln_error error = {{0}};
    const struct kiln_output_params params = {.stitch = true};
    const struct kiln_map_stage *const some[] = {&guided, NULL};
    assert_int_equal(synthetic_create(&s, WIDTH, HEIGHT, 0, 1, NULL), KILN_OK);
    const struct kiln_bake_result result = synthetic_result(&s, MPI_COMM_SELF);
    assert_int_equal(kiln_layers_make(&layers, &s.fields, &error), KILN_OK);
    assert_int_equal(kiln_map_stages_layers(some, &params, &layers, &s.fields, &error), KILN_OK);
    assert_int_equal(kiln_assignment_create(&assignment, s.surface.lightmaps, 2, 1, 1u << 20, UINT64_MAX, &error),
                     KILN_OK);
    assert_int_equal(kiln_texel_gather_create(&gather, &result, assignment, &layers, NULL, 0, &error), KILN_OK);
    struct arrived arrived = {.layers = &layers};
    assert_int_equal(kiln_texel_gather_round(gather, 0, check_point, &arrived, &error), KILN_OK);
    assert_int_equal(arrived.points, s.surface.point_count);
    assert_int_equal(arrived.wrong, 0);
    kiln_texel_gather_destroy(&gather);
    kiln_assignment_destroy(&assignment);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(runs_in_order_what_is_wanted),  cmocka_unit_test(graphs_are_shared),
        cmocka_unit_test(graphs_go_with_their_last_use), cmocka_unit_test(planes_only_for_those_that_read_them),
        cmocka_unit_test(finds_what_neighbours_share),   cmocka_unit_test(features_arrive_with_the_texels)};
    if (MPI_Init(&argc, &argv) != MPI_SUCCESS)
        return 1;
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    (void)MPI_Finalize();
    return failed;
}
