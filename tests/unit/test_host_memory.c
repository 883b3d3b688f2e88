/* Tests of the memory that a host lets its processes take: limits of control groups of both versions. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/run/host_memory.h"

enum { MACHINE = 1000 };

static char folder[] = "/tmp/kiln-host-memory-XXXXXX";

static void make(const char *name)
{
    char path[256];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    (void)mkdir(path, 0700);
}

static void put(const char *name, const char *text)
{
    char path[256];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_true(fputs(text, file) >= 0);
    assert_int_equal(fclose(file), 0);
}

static uint64_t found(const char *groups)
{
    char path[256];
    put("groups", groups);
    (void)snprintf(path, sizeof path, "%s/groups", folder);
    return kiln_host_memory_of(MACHINE, path, folder);
}

static void test_limits(void **state)
{
    (void)state;
    assert_non_null(mkdtemp(folder));
    make("job");
    make("job/step");
    make("memory");
    make("memory/job");
    assert_int_equal(found("0::/job/step\n"), MACHINE); /* no limits at all */
    put("job/step/memory.max", "max\n");
    assert_int_equal(found("0::/job/step\n"), MACHINE);
    put("job/memory.max", "700\n"); /* that of a group above counts */
    assert_int_equal(found("0::/job/step\n"), 700);
    put("job/step/memory.max", "600\n");
    assert_int_equal(found("0::/job/step\n"), 600);
    assert_int_equal(found("0::/\n"), MACHINE);
    put("memory.max", "500\n"); /* a container, whose topmost group has no other name within it */
    assert_int_equal(found("0::/\n"), 500);
    assert_int_equal(found("0::/not/here\n"), 500);
    put("memory/job/memory.limit_in_bytes", "400\n"); /* the first version */
    assert_int_equal(found("4:memory:/job\n3:cpu:/job/step\n"), 400);
    assert_int_equal(found("4:cpuset:/job\n"), MACHINE);
    put("memory/job/memory.limit_in_bytes", "9223372036854771712\n"); /* its word for none */
    assert_int_equal(found("4:memory:/job\n"), MACHINE);
    assert_int_equal(kiln_host_memory_of(MACHINE, "/not/here", folder), MACHINE);
    assert_true(kiln_host_memory() > 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_limits)};
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    static const char *const left[] = {"groups",
                                       "job/step/memory.max",
                                       "job/memory.max",
                                       "memory.max",
                                       "memory/job/memory.limit_in_bytes",
                                       "job/step",
                                       "job",
                                       "memory/job",
                                       "memory",
                                       ""};
    for (size_t i = 0; i < sizeof left / sizeof *left; i++) {
        char path[256];
        (void)snprintf(path, sizeof path, "%s/%s", folder, left[i]);
        (void)remove(path);
    }
    return failed;
}
