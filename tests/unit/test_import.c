/* Tests of the parent process of the confined importer: what it caches and publishes, and its message when the child
 * dies. Needs the kiln program, in the variable KILN. */
#include <setjmp.h> // IWYU pragma: keep
#include <stdarg.h> // IWYU pragma: keep
#include <stddef.h> // IWYU pragma: keep
#include <stdint.h> // IWYU pragma: keep

#include <cmocka.h>

#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/import/import.h"
#include "worker/scene/scene.h"

struct fixture {
    char folder[64], scene[96], output[96], other[96], program[96];
    struct kiln_import_params params;
    struct kiln_import_report report;
    struct kiln_error error;
};

static void put(const char *path, const char *text)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    (void)fputs(text, file);
    (void)fclose(file);
}

static const char *const triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

static int set_up(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    (void)snprintf(f->folder, sizeof f->folder, "/tmp/kiln-test-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    (void)snprintf(f->scene, sizeof f->scene, "%s/scene.obj", f->folder);
    (void)snprintf(f->output, sizeof f->output, "%s/scene.kscene", f->folder);
    (void)snprintf(f->other, sizeof f->other, "%s/other.kscene", f->folder);
    put(f->scene, triangle);
    f->params = (struct kiln_import_params){
        .path = f->scene, .output = f->output, .environment_scale = 1.0, .program = getenv("KILN")};
    *state = f;
    return 0;
}

static size_t files_in(const char *folder, bool remove)
{
    size_t count = 0;
    DIR *directory = opendir(folder);
    assert_non_null(directory);
    for (const struct dirent *entry = readdir(directory); entry != NULL; entry = readdir(directory)) {
        char path[512];
        if (strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0)
            continue;
        (void)snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        count++;
        if (remove)
            (void)unlink(path);
    }
    (void)closedir(directory);
    return count;
}

static int tear_down(void **state)
{
    struct fixture *f = *state;
    (void)files_in(f->folder, true);
    (void)rmdir(f->folder);
    free(f);
    return 0;
}

static int import_now(struct fixture *f)
{
    f->error.message[0] = '\0';
    return kiln_import(&f->params, &f->report, &f->error);
}

static void imported(struct fixture *f, bool cached)
{
    if (import_now(f) != KILN_OK)
        fail_msg("%s", f->error.message);
    assert_int_equal(f->report.cached, cached);
}

static void the_same_again_is_not_read_again(void **state)
{
    struct fixture *f = *state;
    imported(f, false);
    imported(f, true);
    f->params.lightmap_size = 32; /* other settings */
    imported(f, false);
    imported(f, true);
    struct kiln_scene *scene = NULL;
    assert_int_equal(kiln_scene_open(&scene, f->output, NULL), KILN_OK);
    assert_int_equal(scene->objects[0].lightmap_width, 32);
    kiln_scene_close(&scene);
    f->params.environment = "1,2,3";
    imported(f, false);
    put(f->scene, "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n"); /* another scene of the same name and size */
    imported(f, false);
    imported(f, true);
    assert_int_equal(truncate(f->output, 1000), 0); /* a damaged result is no result */
    imported(f, false);
    assert_int_equal(files_in(f->folder, false), 2); /* nothing is left beside it */
}

static void a_failed_import_leaves_what_was_there(void **state)
{
    struct fixture *f = *state;
    imported(f, false);
    put(f->scene, "v 0 0 0\nf 1 2 3\n");
    assert_int_equal(import_now(f), KILN_BAD_INPUT);
    assert_non_null(strstr(f->error.message, "line 2"));
    struct kiln_scene *scene = NULL;
    assert_int_equal(kiln_scene_open(&scene, f->output, NULL), KILN_OK);
    kiln_scene_close(&scene);
    assert_int_equal(files_in(f->folder, false), 2);
}

static pid_t import_beside(struct fixture *f)
{
    const pid_t process = fork();
    if (process == 0)
        _exit(import_now(f) == KILN_OK ? (f->report.cached ? 1 : 0) : 2);
    assert_true(process > 0);
    return process;
}

static void use_program(struct fixture *f, const char *script)
{
    (void)snprintf(f->program, sizeof f->program, "%s/program", f->folder);
    put(f->program, script);
    assert_int_equal(chmod(f->program, 0700), 0);
    f->params.program = f->program;
}

static void what_a_killed_import_left_is_taken_over(void **state)
{
    struct fixture *f = *state;
    const char *real = f->params.program;
    use_program(f, "#!/bin/sh\necho begun > \"$3\"\nexec sleep 3\n");
    for (int i = 0; i < 2; i++) {
        const pid_t process = import_beside(f);
        const struct timespec moment = {0, 300000000};
        (void)nanosleep(&moment, NULL);
        assert_int_equal(kill(process, SIGKILL), 0);
        assert_int_equal(waitpid(process, NULL, 0), process);
        assert_int_equal(files_in(f->folder, false), 3); /* scene, program, and what is begun */
    }
    f->params.program = real;
    imported(f, false);
    assert_int_equal(files_in(f->folder, false), 3); /* scene, program, result */
}

static void the_second_at_the_same_time_waits(void **state)
{
    struct fixture *f = *state;
    use_program(f, "#!/bin/sh\nsleep 0.3\nexec \"$KILN\" \"$@\"\n");
    for (uint32_t i = 0; i < 3; i++) {
        pid_t process[3];
        int read = 0, cached = 0;
        f->params.lightmap_size = 16u << i;
        for (int k = 0; k < 3; k++)
            process[k] = import_beside(f);
        for (int k = 0; k < 3; k++) {
            int end = -1;
            assert_int_equal(waitpid(process[k], &end, 0), process[k]);
            assert_true(WIFEXITED(end));
            read += WEXITSTATUS(end) == 0;
            cached += WEXITSTATUS(end) == 1;
        }
        assert_int_equal(read, 1);
        assert_int_equal(cached, 2);
        imported(f, true);
        assert_int_equal(files_in(f->folder, false), 3);
    }
}

static void the_childs_death_is_a_sentence(void **state)
{
    struct fixture *f = *state;
    static const struct {
        const char *script, *word;
        int status;
    } cases[] = {{"#!/bin/sh\nkill -SEGV $$\n", "importer died (signal 11", KILN_BAD_INPUT},
                 {"#!/bin/sh\nkill -ABRT $$\n", "importer died (signal 6", KILN_BAD_INPUT},
                 {"#!/bin/sh\nkill -XCPU $$\n", "CPU time", KILN_BAD_INPUT},
                 {"#!/bin/sh\nkill -KILL $$\n", "no memory left", KILN_SYSTEM},
                 {"#!/bin/sh\nkill -HUP $$\n", "ended from outside (signal 1", KILN_STOPPED},
                 {"#!/bin/sh\nkill -TERM $$\n", "ended from outside (signal 15", KILN_STOPPED},
                 {"#!/bin/sh\nkill -USR1 $$\n", "ended from outside (signal 10", KILN_STOPPED},
                 {"#!/bin/sh\nkill -XFSZ $$\n", "ulimit -f", KILN_IO},
                 {"#!/bin/sh\nexit 3\n", "exit status 3", KILN_BAD_INPUT},
                 {"#!/bin/sh\nexit 0\n", "no answer", KILN_BAD_INPUT},
                 {"#!/bin/sh\nprintf '65\\nSCENE: all wrong'\nexit 65\n", "SCENE: all wrong", KILN_BAD_INPUT}};
    char program[96];
    (void)snprintf(program, sizeof program, "%s/program", f->folder);
    f->params.program = program;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        put(program, cases[i].script);
        assert_int_equal(chmod(program, 0700), 0);
        assert_int_equal(import_now(f), cases[i].status);
        if (strstr(f->error.message, cases[i].word) == NULL)
            fail_msg("'%s' does not say '%s'", f->error.message, cases[i].word);
        assert_int_not_equal(access(f->output, F_OK), 0);
    }
    f->params.program = "/nowhere/kiln";
    assert_int_equal(import_now(f), KILN_SYSTEM);
}

static void scene_files_are_taken_as_they_are(void **state)
{
    struct fixture *f = *state;
    imported(f, false);
    f->params.path = f->output;
    f->params.output = f->other;
    imported(f, false);
    struct kiln_scene *scene = NULL;
    assert_int_equal(kiln_scene_open(&scene, f->other, NULL), KILN_OK);
    kiln_scene_close(&scene);
    f->params.lightmap_size = 7; /* what it cannot give is not passed over in silence */
    assert_int_equal(import_now(f), KILN_USAGE);
    f->params.lightmap_size = 0;
    f->params.environment = "1,1,1";
    assert_int_equal(import_now(f), KILN_USAGE);
    f->params.environment = NULL;
    f->params.output = f->output; /* itself */
    imported(f, false);
    assert_int_equal(truncate(f->output, 700), 0);
    assert_int_equal(import_now(f), KILN_BAD_INPUT);
}

static void places_that_do_not_exist(void **state)
{
    struct fixture *f = *state;
    f->params.output = "/nowhere/at/all.kscene";
    assert_int_equal(import_now(f), KILN_CANNOT_CREATE);
    f->params.output = f->output;
    f->params.path = "/nowhere/at/all.glb";
    assert_int_equal(import_now(f), KILN_NO_INPUT);
    f->params.path = "/tmp";
    assert_int_equal(import_now(f), KILN_BAD_INPUT);
}

int main(void)
{
    if (getenv("KILN") == NULL) {
        (void)printf("skipped: the variable KILN does not name the kiln program\n");
        return 77;
    }
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {TEST(the_same_again_is_not_read_again),
                                       TEST(a_failed_import_leaves_what_was_there),
                                       TEST(what_a_killed_import_left_is_taken_over),
                                       TEST(the_second_at_the_same_time_waits),
                                       TEST(the_childs_death_is_a_sentence),
                                       TEST(scene_files_are_taken_as_they_are),
                                       TEST(places_that_do_not_exist)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
