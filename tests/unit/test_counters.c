/* Counters over child processes. The processor's own are not everywhere, so the kernel's are counted. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <errno.h>
#include <linux/perf_event.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/bench/counters.h"

static double processor_seconds(void)
{
    struct timespec time;
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static void in_child(double seconds)
{
    const pid_t child = fork();
    if (child == 0) {
        while (processor_seconds() < seconds)
            continue;
        _exit(0);
    }
    assert_int_equal(waitpid(child, NULL, 0), child);
}

/* A child of a child counts too, as the ranks that mpirun starts. */
static void in_grandchild(double seconds)
{
    const pid_t child = fork();
    if (child == 0) {
        in_child(seconds);
        _exit(0);
    }
    assert_int_equal(waitpid(child, NULL, 0), child);
}

static void test_children_are_counted(void **state)
{
    (void)state;
    static const struct kiln_counter clock = {"task_clock", PERF_TYPE_SOFTWARE, PERF_COUNT_SW_TASK_CLOCK};
    struct kiln_counters counters;
    double first[KILN_COUNTERS], second[KILN_COUNTERS];
    kiln_counters_open(&counters, &clock, 1);
    if (counters.why == EACCES || counters.why == EPERM || counters.why == ENOSYS) {
        kiln_counters_close(&counters);
        skip();
    }
    assert_int_equal(counters.why, 0);
    in_child(0.05);
    kiln_counters_read(&counters, first);
    in_grandchild(0.1);
    kiln_counters_read(&counters, second);
    kiln_counters_close(&counters);
    assert_true(first[0] > 0.045e9 && first[0] < 0.095e9); /* ns */
    assert_true(second[0] - first[0] > 0.095e9 && second[0] - first[0] < 0.2e9);
    for (int i = 1; i < KILN_COUNTERS; i++)
        assert_true(isnan(first[i]));
}

static void test_what_cannot_be_counted(void **state)
{
    (void)state;
    static const struct kiln_counter none = {"none", PERF_TYPE_SOFTWARE, 0xffff};
    struct kiln_counters counters;
    double values[KILN_COUNTERS];
    kiln_counters_open(&counters, &none, 1);
    assert_int_not_equal(counters.why, 0);
    kiln_counters_read(&counters, values);
    kiln_counters_close(&counters);
    assert_true(isnan(values[0]));
    assert_non_null(strstr(kiln_counters_remedy(EACCES), "kernel.perf_event_paranoid"));
    assert_non_null(strstr(kiln_counters_remedy(ENOENT), "virtual machine"));
    assert_non_null(strstr(kiln_counters_remedy(ENOSYS), "container"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_children_are_counted),
                                       cmocka_unit_test(test_what_cannot_be_counted)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
