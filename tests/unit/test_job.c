#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/bake/prepare/materials.h"
#include "coordinator/job/conditions.h"
#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"

static struct kiln_error error;

static int parse(struct kiln_job **job, int count, ...)
{
    char *arguments[24] = {(char *)"kiln"};
    va_list list;
    va_start(list, count);
    for (int i = 0; i < count; i++)
        arguments[i + 1] = va_arg(list, char *);
    va_end(list);
    error.message[0] = '\0';
    return kiln_job_parse(job, count + 1, arguments, &error);
}

/* ---- options that do not count ---- */

enum { WORDS = 32 };

/* A value of the option that is not its default. */
static const char *value_of(const struct kiln_option *option, char room[KILN_OPTION_TEXT])
{
    const char *fallback = option->fallback != NULL ? option->fallback : "";
    for (size_t i = 0; option->choices != NULL; i++)
        if (strcmp(option->choices[i], fallback) != 0 && strcmp(option->choices[i], "none") != 0)
            return option->choices[i];
    if (option->kind < KILN_OPTION_UINT32 || option->kind > KILN_OPTION_DOUBLE)
        return option->kind == KILN_OPTION_POINT ? "1,2,3" : "3";
    const double wanted = option->kind == KILN_OPTION_DOUBLE ? 0.5 : 3.0;
    (void)snprintf(room, KILN_OPTION_TEXT, "%.17g", fmin(fmax(wanted, option->minimum), option->maximum));
    return room;
}

/* Parses the option for the command, with further words: those of a bench begin with its name. */
static int parse_with(struct kiln_job **job, const char *command, const struct kiln_option *option, const char *words)
{
    char room[KILN_OPTION_TEXT], name[64], copy[200], *arguments[WORDS] = {(char *)"kiln", (char *)(uintptr_t)command};
    int count = 2;
    const bool bench = strcmp(command, "bench") == 0;
    (void)snprintf(copy, sizeof copy, "%s", words);
    char *rest = NULL, *word = strtok_r(copy, " ", &rest);
    if (bench) {
        arguments[count++] = word;
        word = strtok_r(NULL, " ", &rest);
    }
    arguments[count++] = (char *)"room.glb";
    (void)snprintf(name, sizeof name, "--%s", option->name);
    arguments[count++] = name;
    if (option->kind != KILN_OPTION_FLAG)
        arguments[count++] = (char *)(uintptr_t)value_of(option, room);
    for (; word != NULL; word = strtok_r(NULL, " ", &rest))
        arguments[count++] = word;
    error.message[0] = '\0';
    return kiln_job_parse(job, count, arguments, &error);
}

/* Returns the text printed about options that do not count. Release with free. */
static char *idle_of(const struct kiln_job *job)
{
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    kiln_job_print_idle(job, stream);
    (void)fclose(stream);
    return text;
}

static void assert_counts(const struct kiln_option *option)
{
    const struct kiln_condition *when = option->when;
    struct kiln_job *job = NULL;
    if (parse_with(&job, when->command, option, when->with) != KILN_OK)
        fail_msg("--%s with '%s': %s", option->name, when->with, error.message);
    char *text = idle_of(job);
    if (text[0] != '\0')
        fail_msg("--%s with '%s': %s", option->name, when->with, text);
    free(text);
    kiln_job_destroy(&job);
}

static void assert_refused_or_noted(const struct kiln_option *option)
{
    const struct kiln_condition *when = option->when;
    struct kiln_job *job = NULL;
    char wanted[80];
    (void)snprintf(wanted, sizeof wanted, "--%s ", option->name);
    const int status = parse_with(&job, when->command, option, when->without);
    if (status != KILN_OK) {
        assert_int_equal(status, KILN_USAGE);
        assert_non_null(strstr(error.message, option->name));
        return;
    }
    char *text = idle_of(job);
    if (strstr(text, wanted) == NULL || strstr(text, when->otherwise) == NULL)
        fail_msg("--%s with '%s' is ignored in silence", option->name, when->without);
    free(text);
    kiln_job_destroy(&job);
}

/* Every row of the table: where its condition holds it is not refused and nothing is said, else one of the two. */
static void test_options_that_do_not_count(void **state)
{
    (void)state;
    size_t conditions = 0;
    for (size_t i = 0; i < kiln_option_count; i++) {
        const struct kiln_option *option = &kiln_options[i];
        if (option->when == NULL)
            continue;
        assert_counts(option);
        assert_refused_or_noted(option);
        conditions++;
    }
    assert_true(conditions > 70);
}

/* Nothing is said about values of presets or defaults, nor about options that switch off what is off anyway. */
static void test_presets_are_not_told(void **state)
{
    (void)state;
    for (size_t q = 0; q < kiln_quality_count; q++) {
        struct kiln_job *job = NULL;
        assert_int_equal(parse(&job, 9, "bake", "room.glb", "--quality", kiln_qualities[q].name, "--materials",
                               "diffuse", "--backend", "embree", "--no-preview"),
                         KILN_OK);
        char *text = idle_of(job);
        assert_string_equal(text, "");
        free(text);
        kiln_job_destroy(&job);
    }
    struct kiln_job *job = NULL;
    assert_int_equal(parse(&job, 10, "bake", "room.glb", "--materials", "diffuse", "--caustics", "none", "--schedule",
                           "equal", "--indirect-scale", "1"),
                     KILN_OK);
    char *text = idle_of(job);
    assert_string_equal(text, "");
    free(text);
    kiln_job_destroy(&job);
}

/* Whether two options may have one place in the struct: those of one name, kind and default for different commands. */
static bool may_share(const struct kiln_option *a, const struct kiln_option *b)
{
    return strcmp(a->name, b->name) == 0 && a->kind == b->kind && a->fallback != NULL && b->fallback != NULL &&
           strcmp(a->fallback, b->fallback) == 0 && (a->commands & b->commands) == 0;
}

/* A second value belongs to one option of the same commands, has a default to go back to, and is on no screen. */
static void assert_second(const struct kiln_option *option)
{
    if (option->second_of == NULL)
        return;
    const struct kiln_option *first = kiln_option_find_for(option->second_of, option->commands);
    assert_non_null(first);
    assert_int_equal(first->commands, option->commands);
    assert_ptr_equal(kiln_option_second(first), option);
    assert_null(first->second_of);
    assert_true(option->fallback != NULL && option->value != NULL && option->when != NULL && option->common == 0);
}

/* Every option: named once, helped, placed inside the struct, its default within its own range. */
static void test_table(void **state)
{
    (void)state;
    for (size_t i = 0; i < kiln_option_count; i++) {
        const struct kiln_option *option = &kiln_options[i];
        assert_true(strlen(option->name) > 1 &&
                    strspn(option->name, "abcdefghijklmnopqrstuvwxyz-") == strlen(option->name));
        assert_true(strlen(option->help) > 5 && strlen(option->help) < 100 && strchr(option->help, '\n') == NULL);
        for (uint32_t bit = 1; bit != 0; bit <<= 1) /* one of that name for each command */
            assert_true((option->commands & bit) == 0 || kiln_option_find_for(option->name, bit) == option);
        assert_true(option->commands != 0 && option->offset < sizeof(struct kiln_job));
        const bool number = option->kind >= KILN_OPTION_UINT32 && option->kind <= KILN_OPTION_DOUBLE;
        assert_true(!number || (option->minimum < option->maximum && option->value != NULL));
        assert_int_equal(option->choices != NULL, option->kind >= KILN_OPTION_CHOICE);
        assert_true(strncmp(option->name, "no-", 3) != 0);
        for (size_t j = 0; j < i; j++)
            assert_true(kiln_options[j].offset != option->offset || may_share(&kiln_options[j], option));
        for (size_t j = 0; option->former != NULL && j < kiln_option_count; j++)
            assert_string_not_equal(kiln_options[j].name, option->former);
        assert_int_equal(option->common & ~option->commands, 0);
        assert_second(option);
    }
    struct kiln_job *job = NULL;
    for (size_t i = 0; i < kiln_command_count; i++) {
        assert_int_equal(kiln_commands[i].output != NULL,
                         (kiln_option_find("output")->commands & kiln_commands[i].bit) != 0);
        const char *const words[] = {"1", "2", "3", "4"};
        char *arguments[8] = {(char *)"kiln", (char *)kiln_commands[i].name};
        for (size_t j = 0; j < kiln_commands[i].minimum; j++)
            arguments[2 + j] = (char *)words[j];
        /* defaults parse */
        assert_int_equal(kiln_job_parse(&job, 2 + (int)kiln_commands[i].minimum, arguments, &error), KILN_OK);
        kiln_job_destroy(&job);
    }
}

static void test_defaults(void **state)
{
    (void)state;
    struct kiln_job *job = NULL;
    assert_int_equal(parse(&job, 2, "bake", "some/where/room.v2.glb"), KILN_OK);
    assert_string_equal(job->command, "bake");
    assert_string_equal(job->scene.file, "some/where/room.v2.glb");
    assert_string_equal(job->output, "room.v2-bake");
    assert_string_equal(job->machine.backend, "auto");
    assert_string_equal(job->light.method, "cells");
    assert_string_equal(job->light.quality, "preview");
    assert_null(job->scene.environment);
    assert_null(job->machine.instruction_set);
    assert_true(job->machine.device == -1 && job->machine.device_memory == 0 && job->machine.verify_fraction == 0);
    assert_true(job->scene.environment_scale == 1.0 && job->machine.threads == 0 && job->light.bounces == -1 &&
                job->light.tail);
    assert_true(job->lightmaps.stitch && job->preview && !job->lightmaps.half && !job->lightmaps.error_map &&
                !job->json);
    assert_true(job->light.samples_direct == 64 && job->light.samples_bounce == 8 &&
                job->light.samples_indirect == 128 && job->volume.samples == 64);
    assert_true(job->lightmaps.most == 4096 && job->lightmaps.size == 0 && job->lightmaps.texels_per_metre == 0 &&
                job->ranks.cell_size == 0);
    assert_int_equal(job->light.schedule, KILN_SCHEDULE_LEAN);
    assert_false(job->ranks.partition_objects);
    kiln_job_destroy(&job);
    kiln_job_destroy(&job); /* NULL is accepted */
    assert_null(job);
}

static void test_forms(void **state)
{
    (void)state;
    struct kiln_job *job = NULL;
    assert_int_equal(parse(&job, 20, "bake", "--threads=3", "a.glb", "--bounces", "4", "--no-stitch", "--half", "-o",
                           "out", "--seed", "18446744073709551615", "--cell-size", "1.5e-3", "--partition", "objects",
                           "--schedule=equal", "--error-map=true", "--preview=false", "--samples-direct", "1e3"),
                     KILN_OK);
    assert_true(job->machine.threads == 3 && job->light.bounces == 4 && !job->lightmaps.stitch && job->lightmaps.half &&
                job->light.seed == UINT64_MAX);
    assert_true(job->ranks.cell_size == 1.5e-3 && job->ranks.partition_objects &&
                job->light.schedule == KILN_SCHEDULE_EQUAL);
    assert_true(job->lightmaps.error_map && !job->preview && job->light.samples_direct == 1000);
    assert_false(job->light.tail); /* a number of bounces was given */
    assert_string_equal(job->output, "out");
    kiln_job_destroy(&job);
    assert_int_equal(parse(&job, 6, "bake", "a.glb", "--bounces", "4", "--tail", "--threads=auto"), KILN_OK);
    assert_true(job->light.tail && job->machine.threads == 0);
    kiln_job_destroy(&job);
    assert_int_equal(parse(&job, 4, "bake", "a.glb", "--bounces", "all"), KILN_OK);
    assert_true(job->light.tail && job->light.bounces == -1);
    kiln_job_destroy(&job);
    assert_int_equal(parse(&job, 5, "probe", "dir", "-1", "-.5", "2"), KILN_OK);
    assert_int_equal(job->argument_count, 4);
    assert_string_equal(job->arguments[2], "-.5");
    kiln_job_destroy(&job);
    assert_int_equal(parse(&job, 2, "info", "--devices"), KILN_OK); /* the one command line without the scene */
    assert_true(job->machine.devices && job->scene.file == NULL && job->argument_count == 0);
    kiln_job_destroy(&job);
    assert_int_equal(parse(&job, 3, "info", "--devices", "a.glb"), KILN_USAGE);
    assert_int_equal(parse(&job, 10, "bake", "a.glb", "--backend", "vulkan", "--device", "2", "--device-memory", "0.25",
                           "--verify-fraction", "0.01"),
                     KILN_OK);
    assert_true(job->machine.device == 2 && job->machine.device_memory == 0.25 && job->machine.verify_fraction == 0.01);
    kiln_job_destroy(&job);
    assert_int_equal(parse(&job, 3, "info", "--", "--odd.glb"), KILN_OK);
    assert_string_equal(job->scene.file, "--odd.glb");
    kiln_job_destroy(&job);
}

static void test_quality_gives_way(void **state)
{
    (void)state;
    struct kiln_job *job = NULL;
    assert_int_equal(parse(&job, 6, "bake", "a.glb", "--samples-bounce", "5", "--quality", "reference"), KILN_OK);
    assert_true(job->light.samples_direct == 1024 && job->light.samples_bounce == 5 &&
                job->light.samples_indirect == 4096);
    kiln_job_destroy(&job);
}

static void write_job(const char *path, const char *text)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_true(fputs(text, file) >= 0);
    assert_int_equal(fclose(file), 0);
}

/* Defaults, then --quality wherever it stands, then the job file, then the command line. */
static void test_order(void **state)
{
    (void)state;
    char folder[] = "/tmp/kiln_test_job_XXXXXX", path[64], expected[80];
    assert_non_null(mkdtemp(folder));
    (void)snprintf(path, sizeof path, "%s/job.yaml", folder);
    write_job(path, "scene: sub/a.glb # relative\noutput: /absolute\nquality: draft\nsamples-direct: 5\nseed: "
                    "9\nenvironment: sky.hdr\n"
                    "bounces: all\nstitch: false\n");
    struct kiln_job *job = NULL;
    assert_int_equal(parse(&job, 2, "bake", path), KILN_OK);
    (void)snprintf(expected, sizeof expected, "%s/sub/a.glb", folder);
    assert_string_equal(job->scene.file, expected);
    (void)snprintf(expected, sizeof expected, "%s/sky.hdr", folder);
    assert_string_equal(job->scene.environment, expected);
    assert_string_equal(job->output, "/absolute");
    assert_true(job->light.samples_direct == 5 && job->light.samples_bounce == 4 && job->light.seed == 9 &&
                !job->lightmaps.stitch && job->light.tail);
    kiln_job_destroy(&job);
    assert_int_equal(parse(&job, 9, "bake", path, "--quality", "production", "--seed", "1", "-o", "here", "--stitch"),
                     KILN_OK);
    assert_true(job->light.samples_direct == 5 && job->light.samples_bounce == 16 && job->volume.samples == 256 &&
                job->light.seed == 1 && job->lightmaps.stitch);
    assert_string_equal(job->output, "here");
    assert_string_equal(job->light.quality, "production");
    kiln_job_destroy(&job);
    write_job(path, "scene: a.glb\nquality: high\n");
    assert_int_equal(parse(&job, 2, "bake", path), KILN_BAD_INPUT);
    assert_non_null(strstr(error.message, "job.yaml:2: quality: "));
    assert_null(job);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(rmdir(folder), 0);
}

/* Returns the text that kiln prints about former names of options. Release with free. */
static char *renamed_text(const struct kiln_job *job)
{
    char *text = NULL;
    size_t size = 0;
    FILE *stream = open_memstream(&text, &size);
    assert_non_null(stream);
    kiln_job_print_renamed(job, stream);
    assert_int_equal(fclose(stream), 0);
    return text;
}

/* Former names of options work, on the command line and in a job file, and the present name is printed. */
static void test_former_names(void **state)
{
    (void)state;
    struct kiln_job *job = NULL;
    assert_int_equal(parse(&job, 6, "bake", "a.glb", "--no-give-away", "--share-ranks=2", "--verify-share", "0.5"),
                     KILN_OK);
    assert_true(!job->ranks.work_stealing && job->ranks.shared_memory_ranks == 2 &&
                job->machine.verify_fraction == 0.5);
    char *text = renamed_text(job);
    assert_non_null(strstr(text, "the option give-away is now called work-stealing"));
    assert_non_null(strstr(text, "the option share-ranks is now called shared-memory-ranks"));
    assert_non_null(strstr(text, "the option verify-share is now called verify-fraction"));
    free(text);
    kiln_job_destroy(&job);
    assert_int_equal(parse(&job, 3, "bake", "a.glb", "--no-work-stealing"), KILN_OK);
    assert_false(job->ranks.work_stealing);
    assert_string_equal(text = renamed_text(job), "");
    free(text);
    kiln_job_destroy(&job);

    char folder[] = "/tmp/kiln_test_job_XXXXXX", path[64];
    assert_non_null(mkdtemp(folder));
    (void)snprintf(path, sizeof path, "%s/job.yaml", folder);
    write_job(path, "scene: a.glb\ngive-away: false\n");
    assert_int_equal(parse(&job, 2, "bake", path), KILN_OK);
    assert_false(job->ranks.work_stealing);
    assert_non_null(strstr(text = renamed_text(job), "give-away is now called work-stealing"));
    free(text);
    kiln_job_destroy(&job);
    write_job(path, "scene: a.glb\ngive-away: false\nwork-stealing: true\n");
    assert_int_equal(parse(&job, 2, "bake", path), KILN_BAD_INPUT); /* the same key twice */
    assert_int_equal(unlink(path), 0);
    assert_int_equal(rmdir(folder), 0);
}

/* A value given behind a colon goes with the value before it; one given by its former name stays. */
static void test_second_values(void **state)
{
    (void)state;
    enum { FOUR = 2, EIGHT = 3, SIXTEEN = 4 }; /* logarithms of windows */
    static const char *const lines[][4] = {
        {"--undersample", "mipmap:8"},
        {"--undersample=mipmap:8", NULL},
        {"--undersample", "mipmap:8", "--undersample", "stride"},
        {"--sampling-window", "8", "--undersample", "stride"},
        {"--undersample", "stride:16", "--sampling-window", "8"},
        {"--sampling-window", "8", "--undersample", "stride:16"},
    };
    static const int windows[] = {EIGHT, EIGHT, FOUR, EIGHT, EIGHT, SIXTEEN};
    for (size_t i = 0; i < sizeof windows / sizeof *windows; i++) {
        struct kiln_job *job = NULL;
        int count = 4;
        for (size_t k = 0; k < 4 && lines[i][k] != NULL; k++)
            count++;
        assert_int_equal(parse(&job, count, "bake", "a.glb", "--method", "radiosity", lines[i][0], lines[i][1],
                               lines[i][2], lines[i][3]),
                         KILN_OK);
        assert_int_equal(job->light.patches.window, windows[i]);
        char room[KILN_OPTION_TEXT];
        const bool given = i != 2;
        const char *text = kiln_option_argument(job, kiln_option_find("undersample"), room);
        assert_int_equal(strchr(text, ':') != NULL, given);
        kiln_job_destroy(&job);
    }
}

static void test_refusals(void **state)
{
    (void)state;
    static const struct {
        const char *first, *second, *sentence;
        int status;
    } cases[] = {
        {"--threads", "4097", "--threads: 4097 is out of range; it must be a whole number from 1 to 4096, or auto",
         KILN_USAGE},
        {"--threads", "99999999999999999999", "is out of range", KILN_USAGE},
        {"--threads", "-1", "is out of range", KILN_USAGE},
        {"--threads", " 1", "is not a whole number", KILN_USAGE},
        {"--threads", "", "is not a whole number", KILN_USAGE},
        {"--threads", "1e-1", "is not a whole number", KILN_USAGE},
        {"--bounces", "10001", "from 0 to 10000, or all", KILN_USAGE},
        {"--environment-scale", "infinity", "is not a number", KILN_USAGE},
        {"--environment-scale", "1,5", "is not a number", KILN_USAGE},
        {"--environment", "1,2,3,4", "neither none", KILN_USAGE},
        {"--environment", "1,2,x", "neither none", KILN_USAGE},
        {"--backend", "optix", "auto, embree, vulkan", KILN_NO_DEVICE},
        {"--verify-fraction", "1.5", "from 0 to 1", KILN_USAGE},
        {"--instruction-set", "neon", "sse2, sse4.2", KILN_NO_DEVICE},
        {"--method", "paths", "there is: cells, radiosity, path, bdpt, vcm", KILN_USAGE},
        {"--mis", "optimal", "--mis: 'optimal' is no more since kiln 0.2.0", KILN_USAGE},
        {"--mis", "optimal", "give --mis balance", KILN_USAGE},
        {"--connections", "1", "--connections is no more since kiln 0.2.0: leave it out", KILN_USAGE},
        {"--mis", "best", "there is: balance, power, uniform", KILN_USAGE},
        {"--qualtiy", "draft", "nearest one is --quality", KILN_USAGE},
        {"--camera", "main", "it belongs to view", KILN_USAGE},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct kiln_job *job = NULL;
        assert_int_equal(parse(&job, 4, "bake", "a.glb", cases[i].first, cases[i].second), cases[i].status);
        if (strstr(error.message, cases[i].sentence) == NULL)
            fail_msg("%s %s: %s", cases[i].first, cases[i].second, error.message);
        assert_null(job);
    }
}

/* --method vcm merges without --caustics merge, and the radius stays in the job, which says what a bake is. */
static void test_merge_radius(void **state)
{
    (void)state;
    static const struct {
        const char *method, *radius;
        int status;
        double taken; /* m */
    } cases[] = {{"vcm", "0.25", KILN_OK, 0.25},  {"vcm", "auto", KILN_OK, 0.0},    {"vcm", "texel", KILN_OK, 0.0},
                 {"bdpt", "0.25", KILN_USAGE, 0}, {"path", "texel", KILN_USAGE, 0}, {"cells", "0.25", KILN_OK, 0.0}};
    const struct kiln_scene diffuse = {0};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct kiln_job *job = NULL;
        assert_int_equal(
            parse(&job, 6, "bake", "a.glb", "--method", cases[i].method, "--merge-radius", cases[i].radius),
            cases[i].status);
        if (cases[i].status == KILN_OK) {
            assert_true(job->light.paths.radius == cases[i].taken);
            kiln_materials_settle(job, &diffuse);
            assert_true(job->light.merge_radius == cases[i].taken && job->light.radius_alpha == 0.0);
        } else {
            assert_non_null(strstr(error.message, "merges nothing"));
            assert_non_null(strstr(error.message, i < 5 ? "give --method vcm" : "give --caustics merge"));
        }
        kiln_job_destroy(&job);
    }
}

/* Options about how light paths land are for the method that has such paths. */
static void test_paths_of_references(void **state)
{
    (void)state;
    static const char *const methods[] = {"path", "bdpt", "vcm"};
    static const char *const options[][2] = {
        {"--photons", "1000"}, {"--iterations", "4"}, {"--radius-alpha", "0.5"}, {"--mis", "power"}};
    for (size_t i = 0; i < 3; i++)
        for (size_t j = 0; j < 4; j++) {
            struct kiln_job *job = NULL;
            assert_int_equal(parse(&job, 6, "bake", "a.glb", "--method", methods[i], options[j][0], options[j][1]),
                             KILN_USAGE);
            assert_non_null(strstr(error.message, options[j][0]));
            assert_non_null(strstr(error.message, "is for --method cells"));
            assert_null(job);
        }
}

static void test_edit_distance(void **state)
{
    (void)state;
    assert_int_equal(kiln_edit_distance("", ""), 0);
    assert_int_equal(kiln_edit_distance("abc", ""), 3);
    assert_int_equal(kiln_edit_distance("kitten", "sitting"), 3);
    assert_int_equal(kiln_edit_distance("abcd", "acbd"), 1); /* a swap */
    assert_int_equal(kiln_edit_distance("sunday", "saturday"), 3);
    char longer[5001];
    memset(longer, 'x', 5000);
    longer[5000] = '\0';
    assert_true(kiln_edit_distance(longer, "bake") >= 4); /* no overflow */
    assert_string_equal(kiln_command_nearest("bke"), "bake");
    assert_null(kiln_command_nearest("export-everything"));
    assert_null(kiln_command_nearest("foo"));
    assert_string_equal(kiln_command_nearest("gen"), "generate"); /* how it begins */
    assert_string_equal(kiln_option_nearest("cel-size", KILN_FOR_BAKE), "cell-size");
    assert_string_equal(kiln_option_nearest("texels", KILN_FOR_BAKE), "texels-per-metre");
    assert_null(kiln_option_nearest("tile-size", KILN_FOR_BAKE));
    assert_null(kiln_option_nearest("cell-size", KILN_FOR_GENERATE)); /* not one of this command's */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_table),
        cmocka_unit_test(test_options_that_do_not_count),
        cmocka_unit_test(test_presets_are_not_told),
        cmocka_unit_test(test_defaults),
        cmocka_unit_test(test_forms),
        cmocka_unit_test(test_quality_gives_way),
        cmocka_unit_test(test_order),
        cmocka_unit_test(test_refusals),
        cmocka_unit_test(test_edit_distance),
        cmocka_unit_test(test_former_names),
        cmocka_unit_test(test_second_values),
        cmocka_unit_test(test_merge_radius),
        cmocka_unit_test(test_paths_of_references),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
