/* Which backend `--backend auto` takes: small bakes go to the processors, large ones to a GPU; more threads move the
 * line up; the question counts what a job asks for. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "coordinator/bake/prepare/backend_choice.h"

/* Whether processors are predicted to be quicker with so many triangles, rays and threads. */
static bool processors(uint64_t triangles, double rays, uint64_t threads)
{
    struct kiln_backend_choice choice = {
        .question = {.triangles = triangles, .rays = rays, .threads = threads, .ranks = 1}};
    kiln_backend_predict(&choice);
    assert_true(choice.embree_seconds > 0.0 && choice.vulkan_seconds > 0.0);
    assert_true(choice.processors == (choice.embree_seconds < choice.vulkan_seconds));
    return choice.processors;
}

static void test_small_bakes_stay_on_processors(void **state)
{
    (void)state;
    assert_true(processors(1000, 1e6, 2));
    assert_false(processors(1000, 1e9, 2));
    assert_true(processors(1000, 1e7, 16));
    assert_false(processors(372, 3.7e7, 16));  /* three rooms of 140,000 points: 1.1 s of 16 cores, 0.8 s of an H200 */
    assert_false(processors(262000, 4e9, 16)); /* Sponza at production quality */
    assert_false(processors(4000000, 8e9, 16));
}

static void test_threads_move_the_line(void **state)
{
    (void)state;
    double line[2];
    for (int i = 0; i < 2; i++)
        for (line[i] = 1e5; processors(32, line[i], i == 0 ? 2 : 64);)
            line[i] *= 1.1;
    assert_true(line[1] > 25.0 * line[0] && line[1] < 40.0 * line[0]);
}

static void test_what_a_job_asks_for(void **state)
{
    (void)state;
    struct kiln_object object = {
        .lightmap_width = 100, .lightmap_height = 50, .transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    struct kiln_scene_header header = {.bounds_max = {1.0, 1.0, 1.0}};
    struct kiln_mesh mesh = {.triangle_count = 12, .vertex_count = 2};
    const struct kiln_material grey = {.base_color = {0.5f, 0.5f, 0.5f}};
    const struct kiln_vec3 corners[] = {{0, 0, 0}, {1, 1, 1}};
    const uint32_t materials[12] = {0};
    const struct kiln_scene scene = {.header = &header,
                                     .strings = "",
                                     .materials = &grey,
                                     .material_count = 1,
                                     .positions = corners,
                                     .triangle_materials = materials,
                                     .meshes = &mesh,
                                     .mesh_count = 1,
                                     .objects = &object,
                                     .object_count = 1};
    struct kiln_job job = {.light.bounces = 3,
                           .light.schedule = KILN_SCHEDULE_EQUAL,
                           .light.samples_direct = 10,
                           .light.samples_indirect = 100,
                           .light.samples_bounce = 8};
    const struct kiln_backend_question equal = kiln_backend_ask(&job, &scene, 4, 2);
    assert_true(equal.triangles == 12 && equal.threads == 4 && equal.ranks == 2 && equal.points == 3750);
    assert_true(equal.rays == 3750.0 * (5.0 + 300.0));
    job.light.schedule = KILN_SCHEDULE_LEAN;
    assert_true(kiln_backend_ask(&job, &scene, 4, 2).rays == 3750.0 * (5.0 + 5.0 * 8.0 + 100.0));
    job.light.indirect_scale = 1;
    job.light.final_scale = 2;
    assert_true(kiln_backend_ask(&job, &scene, 4, 2).rays == 3750.0 * (5.0 + 5.0 * 2.0 + 6.25));
    job.light.bounces = 0;
    job.volume.samples = 7;
    job.volume.spacing = 0.5;
    assert_true(kiln_backend_ask(&job, &scene, 4, 2).rays == 3750.0 * 5.0 + 8.0 * 7.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_small_bakes_stay_on_processors),
                                       cmocka_unit_test(test_threads_move_the_line),
                                       cmocka_unit_test(test_what_a_job_asks_for)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
