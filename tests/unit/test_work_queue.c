/* Tests of the work-stealing queue: several threads take from one queue; each tile run is taken once, and all stolen
 * work is returned. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/mpi/work_queue.h"

enum { TILE_RUNS = 100000, THREADS = 4 };

struct taker {
    pthread_t thread;
    struct kiln_work_queue *queue;
    _Atomic uint8_t *taken; /* a tile run: how many times it was taken */
    bool owner;
    uint64_t stolen;
};

static void *take_all(void *data)
{
    struct taker *t = data;
    for (struct kiln_range left = kiln_work_queue_left(t->queue); left.count > 0;
         left = kiln_work_queue_left(t->queue)) {
        const size_t count = left.count < 7 ? left.count : 1 + left.count % 7;
        if (t->owner ? !kiln_work_queue_take(t->queue, left, count)
                     : !kiln_work_queue_steal(t->queue, left, count, count))
            continue;
        const size_t first = t->owner ? left.first : left.first + left.count - count;
        for (size_t i = first; i < first + count; i++)
            t->taken[i]++;
        if (t->owner)
            continue;
        kiln_work_queue_return(t->queue, count);
        t->stolen += count;
    }
    return NULL;
}

static void from_both_ends(void **state)
{
    (void)state;
    struct kiln_work_queue queue;
    struct taker takers[THREADS];
    memset(&queue, 0, sizeof queue);
    _Atomic uint8_t *taken = calloc(TILE_RUNS, sizeof *taken);
    assert_non_null(taken);
    kiln_work_queue_begin(&queue);
    assert_int_equal(kiln_work_queue_left(&queue).count, 0);
    kiln_work_queue_open(&queue, (struct kiln_range){0, TILE_RUNS});
    for (int i = 0; i < THREADS; i++) {
        takers[i] = (struct taker){.queue = &queue, .taken = taken, .owner = i == 0};
        assert_int_equal(pthread_create(&takers[i].thread, NULL, take_all, &takers[i]), 0);
    }
    uint64_t stolen = 0;
    for (int i = 0; i < THREADS; i++) {
        assert_int_equal(pthread_join(takers[i].thread, NULL), 0);
        stolen += takers[i].stolen;
    }
    for (size_t i = 0; i < TILE_RUNS; i++)
        assert_int_equal(taken[i], 1);
    assert_int_equal(kiln_work_queue_away(&queue), 0);
    assert_int_equal(kiln_work_queue_returned(&queue), stolen);
    free((void *)taken);
}

static void what_was_seen_must_still_be_so(void **state)
{
    (void)state;
    struct kiln_work_queue queue;
    memset(&queue, 0, sizeof queue);
    kiln_work_queue_open(&queue, (struct kiln_range){10, 10});
    const struct kiln_range seen = kiln_work_queue_left(&queue);
    assert_true(kiln_work_queue_steal(&queue, seen, 3, 30));
    assert_false(kiln_work_queue_take(&queue, seen, 1));
    assert_false(kiln_work_queue_steal(&queue, seen, 1, 5));
    assert_int_equal(kiln_work_queue_away(&queue), 30);
    const struct kiln_range left = kiln_work_queue_left(&queue);
    assert_int_equal(left.first, 10);
    assert_int_equal(left.count, 7);
    assert_true(kiln_work_queue_take(&queue, left, 7));
    assert_int_equal(kiln_work_queue_left(&queue).count, 0);
    kiln_work_queue_return(&queue, 30);
    assert_int_equal(kiln_work_queue_away(&queue), 0);
    assert_int_equal(kiln_work_queue_returned(&queue), 30);
}

static void speed_is_never_nothing(void **state)
{
    (void)state;
    struct kiln_work_queue queue;
    memset(&queue, 0, sizeof queue);
    assert_true(kiln_work_queue_speed(&queue) >= 1.0);
    kiln_work_queue_set_speed(&queue, 1234.0);
    assert_true(kiln_work_queue_speed(&queue) == 1234.0);
    kiln_work_queue_set_speed(&queue, 0.0);
    assert_true(kiln_work_queue_speed(&queue) >= 1.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(from_both_ends),
                                       cmocka_unit_test(what_was_seen_must_still_be_so),
                                       cmocka_unit_test(speed_is_never_nothing)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
