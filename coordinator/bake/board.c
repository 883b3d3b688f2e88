#include "coordinator/bake/board.h"

#include <assert.h>

_Static_assert(ATOMIC_LLONG_LOCK_FREE == 2, "a lock would be one process's own");

static uint64_t word_of(struct kiln_range range)
{
    return (uint64_t)range.first | (uint64_t)(range.first + range.count) << 32;
}

void kiln_board_begin(struct kiln_board *board)
{
    assert(board->away == 0);
    board->left = 0;
    board->returned = 0;
}

void kiln_board_open(struct kiln_board *board, struct kiln_range range)
{
    assert(range.first + range.count <= UINT32_MAX);
    board->left = word_of(range);
}

struct kiln_range kiln_board_left(const struct kiln_board *board)
{
    const uint64_t word = board->left;
    const size_t first = word & UINT32_MAX, end = word >> 32;
    return (struct kiln_range){first, end - first};
}

bool kiln_board_take(struct kiln_board *board, struct kiln_range seen, size_t count)
{
    uint64_t before = word_of(seen);
    return atomic_compare_exchange_strong(&board->left, &before,
                                          word_of((struct kiln_range){seen.first + count, seen.count - count}));
}

bool kiln_board_take_away(struct kiln_board *board, struct kiln_range seen, size_t count, uint64_t points)
{
    uint64_t before = word_of(seen);
    board->away += points; /* first: who sees the range shorter sees this too */
    if (atomic_compare_exchange_strong(&board->left, &before,
                                       word_of((struct kiln_range){seen.first, seen.count - count})))
        return true;
    board->away -= points;
    return false;
}

void kiln_board_return(struct kiln_board *board, uint64_t points)
{
    board->returned += points; /* first: when nothing is away all is returned */
    board->away -= points;
}

uint64_t kiln_board_away(const struct kiln_board *board) { return board->away; }
uint64_t kiln_board_returned(const struct kiln_board *board) { return board->returned; }

void kiln_board_set_speed(struct kiln_board *board, double points_a_second)
{
    board->speed = points_a_second < 1.0 ? 1 : points_a_second > 1e18 ? (uint64_t)1e18 : (uint64_t)points_a_second;
}

double kiln_board_speed(const struct kiln_board *board)
{
    const uint64_t speed = board->speed;
    return speed > 0 ? (double)speed : 1.0;
}
