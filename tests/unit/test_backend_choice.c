/* Choice of `--backend auto`: small bakes go to the processors, large ones to a GPU; more threads and kernels
 * that are not kept move the line up; the question counts what a job asks for. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include <math.h>

#include "coordinator/bake/prepare/backend_choice.h"
#include "coordinator/bake/reckon/kernels_kept.h"
#include "coordinator/bake/reckon/rounds_expected.h"
#include "coordinator/job/job_private.h"

/* A diffuse bake with `rays` gather rays in a final gather, a hundred a point. */
static struct kiln_backend_choice choice_of(double triangles, double rays, double threads, double kernels)
{
    struct kiln_backend_choice choice = {
        .question = {.work = {.triangles = triangles, .points = rays / 100.0, .denoises = true},
                     .threads = threads,
                     .ranks = 1.0,
                     .kernels = kernels}};
    choice.question.work.light[KILN_WORK_FINAL] = (struct kiln_work_rays){rays, rays / 100.0, 1.0};
    kiln_backend_predict(&choice);
    const double embree = choice.reckoned[KILN_RECKON_EMBREE].total, vulkan = choice.reckoned[KILN_RECKON_VULKAN].total;
    assert_true(embree > 0.0 && vulkan > 0.0 && choice.processors == (embree < vulkan));
    return choice;
}

static bool processors(double triangles, double rays, double threads)
{
    return choice_of(triangles, rays, threads, 0.0).processors;
}

static void test_small_bakes_stay_on_processors(void **state)
{
    (void)state;
    assert_true(processors(1000, 1e5, 2));
    assert_false(processors(1000, 1e8, 2));
    assert_true(processors(1000, 1e6, 16));
    assert_false(processors(262000, 4e9, 16)); /* Sponza at production quality */
    assert_false(processors(4000000, 8e9, 16));
}

static void test_threads_move_the_line(void **state)
{
    (void)state;
    double line[2];
    for (int i = 0; i < 2; i++)
        for (line[i] = 1e4; processors(32, line[i], i == 0 ? 2 : 64);)
            line[i] *= 1.1;
    assert_true(line[1] > 2.0 * line[0]);
}

/* A bake of some seconds on 16 threads goes to a GPU that has its kernels, and not to one that makes them first. */
static void test_kernels_move_the_line(void **state)
{
    (void)state;
    assert_false(choice_of(270000, 3e7, 16, 0).processors);
    assert_true(choice_of(270000, 3e7, 16, 36).processors);
    assert_true(choice_of(270000, 3e7, 16, 36).reckoned[KILN_RECKON_VULKAN].seconds[KILN_RECKON_kernels] > 0.0);
    assert_true(choice_of(270000, 3e7, 16, 36).reckoned[KILN_RECKON_EMBREE].seconds[KILN_RECKON_kernels] == 0.0);
}

static struct kiln_work work_of(const struct kiln_job *job, const struct kiln_scene *scene)
{
    const struct kiln_backend_known known = {.threads = 4, .ranks = 2, .import = -1.0};
    struct kiln_backend_choice choice = {.asked = true};
    struct kiln_error error;
    assert_int_equal(kiln_backend_ask(&choice, job, scene, &known, &error), KILN_OK);
    assert_true(choice.question.threads == 4.0 && choice.question.ranks == 2.0);
    return choice.question.work;
}

static double samples(const struct kiln_work *work, enum kiln_work_kind kind) { return work->light[kind].samples; }

static const struct kiln_environment dark = {.kind = KILN_ENVIRONMENT_NONE};
static const uint32_t triangles[36] = {0, 1, 1}, materials[12];
static const struct kiln_vec3 corners[] = {{0, 0, 0}, {1, 1, 1}};

/* A scene of one object, three quarters of whose lightmap the layout covers. */
static struct kiln_scene one_object(const struct kiln_environment *environment)
{
    static const struct kiln_object object = {
        .lightmap_width = 100, .lightmap_height = 50, .transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    static const struct kiln_scene_header header = {.bounds_max = {1.0, 1.0, 1.0}};
    static const struct kiln_mesh mesh = {.triangle_count = 12, .vertex_count = 2, .uv_area = 0.75};
    static const struct kiln_material grey = {.base_color = {0.5f, 0.5f, 0.5f}, .base_color_texture = KILN_NONE};
    return (struct kiln_scene){.header = &header,
                               .strings = "",
                               .materials = &grey,
                               .material_count = 1,
                               .environment = environment,
                               .positions = corners,
                               .triangles = triangles,
                               .triangle_materials = materials,
                               .meshes = &mesh,
                               .mesh_count = 1,
                               .objects = &object,
                               .object_count = 1};
}

static void test_what_a_job_asks_for(void **state)
{
    (void)state;
    const struct kiln_scene scene = one_object(&dark);
    char none[] = "none";
    struct kiln_job job = {.machine.kernel_cache = none,
                           .light.bounces = 3,
                           .light.schedule = KILN_SCHEDULE_EQUAL,
                           .light.samples_direct = 10,
                           .light.samples_indirect = 100,
                           .light.samples_bounce = 8,
                           .light.radiance.range = INFINITY};
    struct kiln_work work = work_of(&job, &scene);
    const double points = work.points; /* the 3,750 texels that the layout covers, and some at its borders */
    assert_true(points > 3750.0 && points < 5000.0);
    assert_true(work.triangles == 12.0 && work.texels == 5000.0 && work.gloss == 0.0 && work.far == 0.0);
    assert_true(samples(&work, KILN_WORK_DIRECT) == points * 10.0);
    assert_true(samples(&work, KILN_WORK_BOUNCE) + samples(&work, KILN_WORK_FINAL) == points * 300.0);
    job.light.schedule =
        KILN_SCHEDULE_LEAN; /* two bounces, with 3 and 1.5 times as many as given, and the last gather */
    work = work_of(&job, &scene);
    assert_true(samples(&work, KILN_WORK_BOUNCE) == points * 36.0 && samples(&work, KILN_WORK_FINAL) == points * 100.0);
    job.light.indirect_scale = 1;
    job.light.final_scale = 2;
    work = work_of(&job, &scene);
    assert_true(samples(&work, KILN_WORK_BOUNCE) == points * 9.0 && samples(&work, KILN_WORK_FINAL) == points * 6.25);
    job.light.bounces = 0;
    job.volume.samples = 7;
    job.volume.spacing = 0.5;
    work = work_of(&job, &scene);
    assert_true(work.probes == 8.0 && work.probe_samples == 56.0 && samples(&work, KILN_WORK_FINAL) == 0.0);
}

/* A bake on a device leaves a mark beside its kernels, and the next of its kind expects to find them all. */
static void test_kernels_that_are_kept(void **state)
{
    (void)state;
    char folder[] = "/tmp/kiln-test-XXXXXX", none[] = "none", command[64];
    const struct kiln_material grey = {.base_color_texture = KILN_NONE};
    const struct kiln_scene scene = {.materials = &grey, .material_count = 1, .environment = &dark};
    const struct kiln_integrate_settings settings = {.caustics = KILN_CAUSTICS_NONE};
    assert_non_null(mkdtemp(folder));
    struct kiln_job job = {.machine.kernel_cache = folder, .volume.samples = 8}, other = job, uncached = job;
    other.volume.samples = 0;
    uncached.machine.kernel_cache = none;
    assert_true(kiln_kernels_missing(&job, &settings, &scene) > 0.0);
    kiln_kernels_mark(&job, &settings, &scene);
    kiln_kernels_mark(&uncached, &settings, &scene);
    assert_true(kiln_kernels_missing(&job, &settings, &scene) == 0.0);
    assert_true(kiln_kernels_missing(&other, &settings, &scene) > 0.0);
    assert_true(kiln_kernels_missing(&uncached, &settings, &scene) > 0.0);
    (void)snprintf(command, sizeof command, "rm -r %s", folder);
    assert_int_equal(system(command), 0);
}

/* A ground whose rays meet nothing lies far off the detail; a wall beside it does not. Backs have points of their own.
 */
static void test_what_a_scene_has(void **state)
{
    (void)state;
    enum { DETAIL = 200 }; /* triangles of the detail */
    static uint32_t all[3 * (DETAIL + 1)], of[DETAIL + 1];
    struct kiln_vec3 places[3 * (DETAIL + 1)];
    struct kiln_object objects[2] = {{.lightmap_width = 100, .lightmap_height = 100},
                                     {.lightmap_width = 100, .lightmap_height = 100}};
    const struct kiln_mesh meshes[] = {
        {.vertex_count = 3 * DETAIL, .triangle_count = DETAIL, .uv_area = 1.0},
        {.vertex_first = 3 * DETAIL, .vertex_count = 3, .triangle_first = DETAIL, .triangle_count = 1, .uv_area = 1.0}};
    struct kiln_scene_header header = {.bounds_max = {1.0, 1.0, 1.0}};
    struct kiln_material grey = {.base_color = {0.5f, 0.5f, 0.5f}, .base_color_texture = KILN_NONE};
    const struct kiln_scene scene = {.header = &header,
                                     .strings = "",
                                     .materials = &grey,
                                     .material_count = 1,
                                     .environment = &dark,
                                     .positions = places,
                                     .triangles = all,
                                     .triangle_materials = of,
                                     .meshes = meshes,
                                     .mesh_count = 2,
                                     .objects = objects,
                                     .object_count = 2};
    char none[] = "none";
    struct kiln_job job = {
        .machine.kernel_cache = none, .light.samples_direct = 4, .light.radiance.range = (double)INFINITY};
    for (int o = 0; o < 2; o++) {
        objects[o].mesh = (uint32_t)o;
        for (int a = 0; a < 3; a++)
            objects[o].transform[5 * a] = 1.0;
    }
    for (uint32_t i = 0; i < 3 * DETAIL; i++) {
        all[i] = i;
        places[i] = vec3((float)(i % 7), (float)(i % 5), (float)(i % 3));
    }
    for (uint32_t i = 0; i < 3; i++) {
        all[3 * DETAIL + i] = i;
        places[3 * DETAIL + i] = vec3(i == 1 ? 1e4f : -1e4f, 0.0f, i == 2 ? 1e4f : -1e4f);
    }
    struct kiln_work work = work_of(&job, &scene);
    const double points = work.points;
    assert_true(work.far > 0.49 && work.far < 0.51 && points == 2e4);
    objects[1].transform[0] = objects[1].transform[10] = 1e-3; /* 20 m wide, which is near */
    assert_true(work_of(&job, &scene).far < 0.3);
    grey.double_sided = 1;
    assert_true(work_of(&job, &scene).points == 1.25 * points);
    job.lightmaps.both_sides = true;
    assert_true(work_of(&job, &scene).points == 2.0 * points);
    grey.emission[0] = 1.0f;
    assert_true(work_of(&job, &scene).lamps == 0.5 * (DETAIL + 1));
}

/* An error that is asked for sets the samples; a coarse one is reached by the first round. */
static void test_errors_set_the_samples(void **state)
{
    (void)state;
    const double asked[] = {0.2, 0.08, 0.03, 0.005};
    struct kiln_foretold before = {.rounds = 1, .samples = 1.0};
    for (size_t i = 0; i < sizeof asked / sizeof *asked; i++) {
        const struct kiln_foretold rounds = kiln_rounds_expected(asked[i], true);
        assert_true(rounds.samples >= before.samples && rounds.rounds >= before.rounds && rounds.tried == 0);
        assert_true(rounds.limited || rounds.error <= 1.001 * asked[i]);
        before = rounds;
    }
    const struct kiln_foretold plain = kiln_rounds_expected(0.2, false);
    assert_true(plain.samples == 1.0 && plain.rounds == 1 && plain.error == KILN_ROUNDS_ERROR_PLAIN);
    assert_true(before.limited && before.error > 0.005);
}

/* Light from afar is taken for hard where its rounds are not known, and what a trial has told is taken instead. */
static void test_rounds_of_a_bake(void **state)
{
    (void)state;
    struct kiln_environment sky = dark;
    const struct kiln_scene scene = one_object(&sky);
    char none[] = "none";
    static bool nothing[4096];
    struct kiln_job_owned owned = {.given = nothing};
    struct kiln_job job = {.strings = &owned,
                           .machine.kernel_cache = none,
                           .light.bounces = 3,
                           .light.published_error = 0.05,
                           .light.samples_direct = 10,
                           .light.samples_indirect = 100,
                           .light.samples_bounce = 8,
                           .light.radiance.range = INFINITY};
    const struct kiln_work plain = work_of(&job, &scene);
    sky.kind = KILN_ENVIRONMENT_CONSTANT;
    const struct kiln_work hard = work_of(&job, &scene);
    assert_true(plain.rounds.rounds > 1 && hard.rounds.samples > 10.0 * plain.rounds.samples);
    assert_true(samples(&hard, KILN_WORK_FINAL) > 10.0 * samples(&plain, KILN_WORK_FINAL));
    assert_true(samples(&hard, KILN_WORK_BOUNCE) == samples(&plain, KILN_WORK_BOUNCE));
    const struct kiln_foretold foretold = {.tried = 9, .rounds = 3, .samples = 7.0, .error = 0.05};
    const struct kiln_backend_known known = {.threads = 4, .ranks = 2, .import = -1.0, .foretold = &foretold};
    struct kiln_backend_choice choice = {.asked = true};
    assert_int_equal(kiln_backend_ask(&choice, &job, &scene, &known, NULL), KILN_OK);
    const double first = samples(&hard, KILN_WORK_FINAL) / hard.rounds.samples;
    assert_true(fabs(samples(&choice.question.work, KILN_WORK_FINAL) - 7.0 * first) < 1e-6 * first);
    assert_true(choice.question.work.rounds.rounds == 3);
}

/* Measured seconds take the place of reckoned ones, and the total stays the sum. */
static void test_the_total_is_the_sum(void **state)
{
    (void)state;
    struct kiln_reckoned reckoned = choice_of(1000, 1e7, 4, 0).reckoned[KILN_RECKON_EMBREE];
    kiln_reckon_put(&reckoned, kiln_reckon_phase_of("validity"), 2.5);
    double sum = 0.0;
    for (size_t i = 0; i < KILN_RECKON_PHASES; i++)
        sum += reckoned.seconds[i];
    assert_true(reckoned.seconds[KILN_RECKON_validity] == 2.5);
    assert_float_equal(reckoned.total, sum, 1e-9);
    assert_true(kiln_reckon_phase_of("ambient occlusion") == KILN_RECKON_quantities);
    assert_string_equal(kiln_reckon_phase_name(KILN_RECKON_h5), "kiln.h5");
    assert_true(kiln_reckon_light(&reckoned) == reckoned.seconds[KILN_RECKON_final]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_small_bakes_stay_on_processors),
                                       cmocka_unit_test(test_threads_move_the_line),
                                       cmocka_unit_test(test_kernels_move_the_line),
                                       cmocka_unit_test(test_what_a_job_asks_for),
                                       cmocka_unit_test(test_kernels_that_are_kept),
                                       cmocka_unit_test(test_what_a_scene_has),
                                       cmocka_unit_test(test_errors_set_the_samples),
                                       cmocka_unit_test(test_rounds_of_a_bake),
                                       cmocka_unit_test(test_the_total_is_the_sum)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
