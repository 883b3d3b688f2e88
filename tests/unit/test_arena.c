/* Tests of arenas: what they own is as memory.h makes it, growing and freeing early leave the others whole, a failure
 * leaves what there is, and a release frees all. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <malloc.h>
#include <string.h>
#include <sys/resource.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

/* Arrays that an arena owns. */
static size_t length(const struct kiln_arena *arena)
{
    size_t count = 0;
    for (void *array = arena->last; array != NULL; array = *kiln_memory_link(array))
        count++;
    return count;
}

static size_t bytes_in_use(void)
{
    const struct mallinfo2 info = mallinfo2();
    return info.uordblks + info.hblkhd;
}

static void test_allocate(void **state)
{
    (void)state;
    struct kiln_arena arena = {0};
    unsigned char *zeroes, *bare, *none;
    assert_int_equal(kiln_arena_allocate(&arena, &zeroes, 1000, 1, "a test", NULL), KILN_OK);
    assert_int_equal(kiln_arena_allocate_bare(&arena, &bare, 1000, 1, "a test", NULL), KILN_OK);
    assert_int_equal(kiln_arena_allocate(&arena, &none, 0, 1, "a test", NULL), KILN_OK);
    memset(bare, 0xff, 1000);
    for (size_t i = 0; i < 1000; i++)
        assert_int_equal(zeroes[i], 0);
    assert_int_equal((uintptr_t)zeroes % 64, 0);
    assert_int_equal((uintptr_t)bare % 64, 0);
    assert_non_null(none);
    assert_int_equal(length(&arena), 3);
    kiln_arena_release(&arena);
    assert_null(arena.last);
    kiln_arena_release(&arena);
}

/* The last one comes first, and a grown array keeps its place. */
static void test_order(void **state)
{
    (void)state;
    struct kiln_arena arena = {0};
    int *arrays[4] = {NULL};
    size_t capacity = 0;
    assert_int_equal(kiln_arena_allocate(&arena, &arrays[0], 1, sizeof(int), "a test", NULL), KILN_OK);
    assert_int_equal(kiln_arena_grow(&arena, &arrays[1], &capacity, 1, sizeof(int), "a test", NULL), KILN_OK);
    assert_int_equal(kiln_arena_allocate(&arena, &arrays[2], 1, sizeof(int), "a test", NULL), KILN_OK);
    assert_int_equal(kiln_arena_allocate_bare(&arena, &arrays[3], 1, sizeof(int), "a test", NULL), KILN_OK);
    assert_int_equal(kiln_arena_grow(&arena, &arrays[1], &capacity, 100000, sizeof(int), "a test", NULL), KILN_OK);
    void *array = arena.last;
    for (int i = 3; i >= 0; i--, array = *kiln_memory_link(array))
        assert_ptr_equal(array, arrays[i]);
    assert_null(array);
    int *first = arrays[0];
    kiln_arena_free(&arena, &arrays[2]);
    assert_null(arrays[2]);
    kiln_arena_free(&arena, &arrays[2]);
    kiln_arena_free(&arena, &arrays[0]);
    assert_int_equal(length(&arena), 2);
    assert_ptr_equal(arena.last, arrays[3]);
    assert_ptr_equal(*kiln_memory_link(arrays[3]), arrays[1]);
    assert_int_equal(kiln_arena_allocate(&arena, &first, 1, sizeof(int), "a test", NULL), KILN_OK);
    assert_ptr_equal(arena.last, first);
    kiln_arena_release(&arena);
}

static void test_growth(void **state)
{
    (void)state;
    enum { COUNT = 100000 };
    struct kiln_arena arena = {0};
    uint32_t *a = NULL, *b = NULL;
    size_t for_a = 0, for_b = 0;
    for (uint32_t i = 0; i < COUNT; i++) {
        assert_int_equal(kiln_arena_grow(&arena, &a, &for_a, i + 1, sizeof *a, "a test", NULL), KILN_OK);
        assert_int_equal(kiln_arena_grow(&arena, &b, &for_b, i + 1, sizeof *b, "a test", NULL), KILN_OK);
        a[i] = i;
        b[i] = ~i;
    }
    assert_int_equal(length(&arena), 2);
    for (uint32_t i = 0; i < COUNT; i++)
        assert_true(a[i] == i && b[i] == ~i);
    kiln_arena_release(&arena);
}

/* A limit of 1 GiB of address space. Returns the one before. */
static struct rlimit limit_memory(void)
{
    struct rlimit before;
    assert_int_equal(getrlimit(RLIMIT_AS, &before), 0);
    struct rlimit limit = before;
    limit.rlim_cur = (rlim_t)1 << 30;
    assert_int_equal(setrlimit(RLIMIT_AS, &limit), 0);
    return before;
}

static void test_failure(void **state)
{
    (void)state;
    const size_t much = (size_t)1 << 31;
    struct kiln_arena arena = {0};
    struct kiln_error own = {{0}}, other = {{0}};
    unsigned char *kept = NULL, *array = NULL, *grown = NULL;
    size_t capacity = 0;
    assert_int_equal(kiln_arena_allocate(&arena, &kept, 100, 1, "a test", NULL), KILN_OK);
    assert_int_equal(kiln_arena_grow(&arena, &grown, &capacity, 100, 1, "a test", NULL), KILN_OK);
    memset(grown, 7, 100);
    const unsigned char *before = grown;
    const size_t room = capacity;
    struct rlimit limit = limit_memory();
    assert_int_equal(kiln_arena_allocate(&arena, &array, much, 1, "a test", &own), KILN_SYSTEM);
    assert_int_equal(kiln_allocate(&array, much, 1, "a test", &other), KILN_SYSTEM);
    assert_string_equal(own.message, other.message);
    assert_null(array);
    assert_int_equal(kiln_arena_allocate_bare(&arena, &array, SIZE_MAX / 2, 4, "a test", &own), KILN_SYSTEM);
    assert_int_equal(kiln_allocate_bare(&array, SIZE_MAX / 2, 4, "a test", &other), KILN_SYSTEM);
    assert_string_equal(own.message, other.message);
    assert_int_equal(kiln_arena_grow(&arena, &grown, &capacity, much, 1, "a test", &own), KILN_SYSTEM);
    assert_int_equal(setrlimit(RLIMIT_AS, &limit), 0);
    assert_ptr_equal(grown, before);
    assert_int_equal(capacity, room);
    assert_int_equal(grown[99], 7);
    assert_int_equal(length(&arena), 2);
    kiln_arena_release(&arena);
    assert_null(arena.last);
}

/* An object that stands in its own arena, many of them: nothing stays behind. */
static void test_release(void **state)
{
    (void)state;
    struct object {
        struct kiln_arena arena;
        double *values;
    };
    const size_t before = bytes_in_use();
    for (int i = 0; i < 100; i++) {
        struct kiln_arena arena = {0};
        struct object *object;
        assert_int_equal(kiln_arena_allocate(&arena, &object, 1, sizeof *object, "a test", NULL), KILN_OK);
        object->arena = arena;
        for (int k = 0; k < 20; k++)
            assert_int_equal(
                kiln_arena_allocate(&object->arena, &object->values, (size_t)1 << k, sizeof(double), "a test", NULL),
                KILN_OK);
        kiln_arena_release(&object->arena);
    }
    assert_true(bytes_in_use() <= before + (1 << 20)); /* the C library keeps small blocks for later */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_allocate), cmocka_unit_test(test_order),   cmocka_unit_test(test_growth),
        cmocka_unit_test(test_failure),  cmocka_unit_test(test_release),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
