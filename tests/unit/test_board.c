/* Several threads take from one board: every fragment is taken once, and all is returned. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/bake/board.h"

enum { FRAGMENTS = 100000, THREADS = 4 };

static void from_both_ends(void **state)
{
    (void)state;
    struct kiln_board board;
    memset(&board, 0, sizeof board);
    uint8_t *taken = calloc(FRAGMENTS, 1);
    assert_non_null(taken);
    kiln_board_begin(&board);
    assert_int_equal(kiln_board_left(&board).count, 0);
    kiln_board_open(&board, (struct kiln_range){0, FRAGMENTS});
    uint64_t lent = 0;
#pragma omp parallel num_threads(THREADS) reduction(+ : lent)
    {
        const bool owner = omp_get_thread_num() == 0;
        for (struct kiln_range left = kiln_board_left(&board); left.count > 0; left = kiln_board_left(&board)) {
            const size_t count = left.count < 7 ? left.count : 1 + left.count % 7;
            if (owner ? !kiln_board_take(&board, left, count) : !kiln_board_take_away(&board, left, count, count))
                continue;
            const size_t first = owner ? left.first : left.first + left.count - count;
            for (size_t i = first; i < first + count; i++)
#pragma omp atomic
                taken[i]++;
            if (!owner)
                kiln_board_return(&board, count);
            lent += owner ? 0 : count;
        }
    }
    for (size_t i = 0; i < FRAGMENTS; i++)
        assert_int_equal(taken[i], 1);
    assert_int_equal(kiln_board_away(&board), 0);
    assert_int_equal(kiln_board_returned(&board), lent);
    free(taken);
}

static void what_was_seen_must_still_be_so(void **state)
{
    (void)state;
    struct kiln_board board;
    memset(&board, 0, sizeof board);
    kiln_board_open(&board, (struct kiln_range){10, 10});
    const struct kiln_range seen = kiln_board_left(&board);
    assert_true(kiln_board_take_away(&board, seen, 3, 30));
    assert_false(kiln_board_take(&board, seen, 1));
    assert_false(kiln_board_take_away(&board, seen, 1, 5));
    assert_int_equal(kiln_board_away(&board), 30);
    const struct kiln_range left = kiln_board_left(&board);
    assert_int_equal(left.first, 10);
    assert_int_equal(left.count, 7);
    assert_true(kiln_board_take(&board, left, 7));
    assert_int_equal(kiln_board_left(&board).count, 0);
    kiln_board_return(&board, 30);
    assert_int_equal(kiln_board_away(&board), 0);
    assert_int_equal(kiln_board_returned(&board), 30);
}

static void speed_is_never_nothing(void **state)
{
    (void)state;
    struct kiln_board board;
    memset(&board, 0, sizeof board);
    assert_true(kiln_board_speed(&board) >= 1.0);
    kiln_board_set_speed(&board, 1234.0);
    assert_true(kiln_board_speed(&board) == 1234.0);
    kiln_board_set_speed(&board, 0.0);
    assert_true(kiln_board_speed(&board) >= 1.0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(from_both_ends),
                                       cmocka_unit_test(what_was_seen_must_still_be_so),
                                       cmocka_unit_test(speed_is_never_nothing)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
