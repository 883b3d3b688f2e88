#include "coordinator/mpi/work_queue.h"

#include <assert.h>

_Static_assert(ATOMIC_LLONG_LOCK_FREE == 2, "an atomic that needs a lock does not work between processes");

static uint64_t word_of(struct kiln_range range)
{
    return (uint64_t)range.first | (uint64_t)(range.first + range.count) << 32;
}

void kiln_work_queue_begin(struct kiln_work_queue *queue)
{
    assert(queue->away == 0);
    queue->left = 0;
    queue->returned = 0;
}

void kiln_work_queue_open(struct kiln_work_queue *queue, struct kiln_range range)
{
    assert(range.first + range.count <= UINT32_MAX);
    queue->left = word_of(range);
}

struct kiln_range kiln_work_queue_left(const struct kiln_work_queue *queue)
{
    const uint64_t word = queue->left;
    const size_t first = word & UINT32_MAX, end = word >> 32;
    return (struct kiln_range){first, end - first};
}

bool kiln_work_queue_take(struct kiln_work_queue *queue, struct kiln_range seen, size_t count)
{
    uint64_t before = word_of(seen);
    return atomic_compare_exchange_strong(&queue->left, &before,
                                          word_of((struct kiln_range){seen.first + count, seen.count - count}));
}

bool kiln_work_queue_steal(struct kiln_work_queue *queue, struct kiln_range seen, size_t count, uint64_t points)
{
    uint64_t before = word_of(seen);
    /* set before the range shrinks, so that any rank that sees the shorter range also sees these points */
    queue->away += points;
    if (atomic_compare_exchange_strong(&queue->left, &before,
                                       word_of((struct kiln_range){seen.first, seen.count - count})))
        return true;
    queue->away -= points;
    return false;
}

void kiln_work_queue_return(struct kiln_work_queue *queue, uint64_t points)
{
    queue->returned += points; /* before `away` falls: when nothing is away, all points have been counted as returned */
    queue->away -= points;
}

uint64_t kiln_work_queue_away(const struct kiln_work_queue *queue) { return queue->away; }
uint64_t kiln_work_queue_returned(const struct kiln_work_queue *queue) { return queue->returned; }

void kiln_work_queue_set_speed(struct kiln_work_queue *queue, double points_a_second)
{
    queue->speed = points_a_second < 1.0 ? 1 : points_a_second > 1e18 ? (uint64_t)1e18 : (uint64_t)points_a_second;
}

double kiln_work_queue_speed(const struct kiln_work_queue *queue)
{
    const uint64_t speed = queue->speed;
    return speed > 0 ? (double)speed : 1.0;
}
