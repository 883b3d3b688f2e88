/* Tests of fault injection: valid and invalid values in the environment, and which rank each fault affects. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "coordinator/job/faults.h"

static const char *const names[] = {"KILN_SLOW_RANK", "KILN_HALT_RANK",    "KILN_FAILING_PACKER", "KILN_LOCKS",
                                    "KILN_GPU_FAULT", "KILN_VULKAN_GUARD", "KILN_DIVIDE_FROM",    "KILN_HOLD",
                                    "KILN_DOUBLES",   "KILN_TRAVERSAL",    "KILN_EXCHANGE_LIMIT", "KILN_DISPATCH_TIME"};

static int clear(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        assert_int_equal(unsetenv(names[i]), 0);
    return 0;
}

static void none(void **state)
{
    struct kiln_faults faults;
    const struct kiln_faults zero = {0};
    (void)state;
    assert_int_equal(kiln_faults_read(&faults, NULL), KILN_OK);
    assert_memory_equal(&faults, &zero, sizeof faults);
    assert_true(kiln_faults_slowness(&faults, 0) == 1.0);
    assert_null(kiln_faults_halt(&faults, 0));
    assert_false(kiln_faults_packer_fails(&faults, 0));
    assert_false(kiln_faults_packer_fails(NULL, 0));
}

static void all(void **state)
{
    static const char *const values[] = {"1:4.5", "2:MPI's end", "3",    "none",  "lost:3:5",   "before",
                                         "64",    "/tmp/held",   "none", "eight", "2147483648", "12.5"};
    struct kiln_faults faults;
    (void)state;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        assert_int_equal(setenv(names[i], values[i], 1), 0);
    assert_int_equal(kiln_faults_read(&faults, NULL), KILN_OK);
    assert_true(kiln_faults_slowness(&faults, 1) == 4.5);
    assert_true(kiln_faults_slowness(&faults, 2) == 1.0);
    assert_string_equal(kiln_faults_halt(&faults, 2), "MPI's end");
    assert_null(kiln_faults_halt(&faults, 1));
    assert_true(kiln_faults_packer_fails(&faults, 3));
    assert_false(kiln_faults_packer_fails(&faults, 0));
    assert_true(faults.no_locks);
    assert_true(faults.divide_from == 64);
    assert_string_equal(faults.hold, "/tmp/held");
    assert_true(faults.device.floats);
    assert_true(faults.exchange_limit == 1ull << 31 && faults.dispatch_time == 12.5);
    assert_int_equal(faults.traversal, KILN_TRAVERSE_EIGHT);
    assert_true(faults.device.kind == KILN_DEVICE_FAULT_LOST && faults.device.at == 3 && faults.device.every == 5);
    assert_true(faults.device.guard == KILN_GUARD_BEFORE);
    assert_int_equal(setenv("KILN_GPU_FAULT", "memory:17", 1), 0);
    assert_int_equal(setenv("KILN_VULKAN_GUARD", "0", 1), 0);
    assert_int_equal(kiln_faults_read(&faults, NULL), KILN_OK);
    assert_true(faults.device.kind == KILN_DEVICE_FAULT_MEMORY && faults.device.at == 17 && faults.device.every == 0);
    assert_true(faults.device.guard == KILN_GUARD_NONE);
}

static void refused(void **state)
{
    static const struct {
        size_t name;
        const char *value;
    } cases[] = {{0, "slow"},      {0, "1:0.5"},        {0, "1:2x"},    {0, "1:nan"},  {1, "1"},
                 {1, "1:"},        {1, "one:a"},        {2, "two"},     {2, "2x"},     {3, "some"},
                 {4, "lost"},      {4, "lost:"},        {4, "lost:0"},  {4, "slow:3"}, {4, "memory:3:"},
                 {4, "memory:3x"}, {4, "memory:3:4:5"}, {5, "between"}, {6, "0"},      {6, "64x"},
                 {10, "0"},        {10, "2147483649"},  {10, "-1"},     {10, "auto"},  {11, "0.5"},
                 {11, "60001"},    {11, "nan"},         {11, "5ms"}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct kiln_faults faults;
        struct kiln_error error = {{0}};
        (void)clear(NULL);
        assert_int_equal(setenv(names[cases[i].name], cases[i].value, 1), 0);
        assert_int_equal(kiln_faults_read(&faults, &error), KILN_USAGE);
        assert_non_null(strstr(error.message, names[cases[i].name]));
        assert_non_null(strstr(error.message, cases[i].value));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test_setup(none, clear), cmocka_unit_test_setup(all, clear),
                                       cmocka_unit_test_setup(refused, clear)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
