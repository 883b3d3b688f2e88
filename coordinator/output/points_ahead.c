#include "coordinator/output/points_ahead.h"

#include <errno.h>
#include <omp.h>
#include <stdatomic.h>
#include <string.h>
#include <time.h>
#include <xxhash.h>

#include "coordinator/output/chunk.h"
#include "coordinator/output/columns.h"
#include "worker/base/memory.h"
#include "worker/base/thread.h"

enum { THREADS_MOST = 4, THREADS_SHARE = 4 };

struct part {
    void *bytes;
    size_t size;
    uint64_t hash; /* hash of the direct light in its rows, as packed */
};

/* Stages of packing: surface first, then direct light once there is some. */
enum stage { OF_SURFACE, OF_DIRECT, STAGES };

struct kiln_points_ahead {
    struct kiln_bake_result result;
    struct kiln_columns columns; /* of both stages */
    uint64_t first, count;       /* chunks that lie within the own points */
    struct part *parts;          /* chunk by chunk, count x columns.count */
    atomic_bool *done[STAGES];   /* one per chunk: all its parts are there */
    _Atomic uint64_t next[STAGES], bytes, nanoseconds;
    _Atomic uint64_t begin, end;   /* ns of CLOCK_MONOTONIC; 0: none yet */
    atomic_bool leave, has_direct; /* leave: threads are to end; has_direct: direct light is there */
    pthread_mutex_t lock;          /* of changes of these */
    pthread_cond_t news;           /* one of them has changed */
    uint64_t start;
    pthread_t threads[THREADS_MOST];
    uint32_t thread_count; /* that run */
};

static uint64_t now(clockid_t clock)
{
    struct timespec time = {0, 0};
    (void)clock_gettime(clock, &time);
    return (uint64_t)time.tv_sec * 1000000000u + (uint64_t)time.tv_nsec;
}

/* ---- one chunk ---- */

/* Buffers of a thread. */
struct room {
    struct kiln_column_values rows;
    uint8_t *shuffled, *packed;
};

static int make_room(const struct kiln_points_ahead *a, struct room *room)
{
    size_t most = 0;
    for (size_t c = 0; c < a->columns.count; c++) {
        const size_t bytes = KILN_H5_CHUNK_ROWS * kiln_column_row(&a->columns.column[c]);
        most = bytes > most ? bytes : most;
    }
    int status;
    KILN_TRY(kiln_column_values_allocate(&room->rows, &a->columns, KILN_H5_CHUNK_ROWS, NULL));
    KILN_TRY(kiln_allocate(&room->shuffled, most, 1, "points to write", NULL));
    KILN_TRY(kiln_allocate(&room->packed, kiln_chunk_bound(most), 1, "packed points", NULL));
end:
    return status;
}

static void leave_room(struct room *room)
{
    kiln_column_values_free(&room->rows);
    kiln_free(&room->shuffled);
    kiln_free(&room->packed);
}

static enum stage stage_of(const struct kiln_column *column) { return column->of_direct ? OF_DIRECT : OF_SURFACE; }

static int pack_column(struct kiln_points_ahead *a, uint64_t index, size_t c, const struct room *room)
{
    const struct kiln_column *column = &a->columns.column[c];
    struct part *part = &a->parts[index * a->columns.count + c];
    if (column->of_direct)
        part->hash = XXH3_64bits(room->rows.column[c], KILN_H5_CHUNK_ROWS * kiln_column_row(column));
    int status =
        kiln_chunk_pack(room->rows.column[c], (size_t)KILN_H5_CHUNK_ROWS * column->components,
                        kiln_column_value(column), column->noisy, room->shuffled, room->packed, &part->size, NULL);
    if (status == KILN_OK)
        status = kiln_allocate(&part->bytes, part->size, 1, "packed points", NULL);
    if (status == KILN_OK) {
        memcpy(part->bytes, room->packed, part->size);
        atomic_fetch_add(&a->bytes, part->size);
    }
    return status;
}

static int pack_chunk(struct kiln_points_ahead *a, enum stage stage, uint64_t index, struct room *room)
{
    const uint64_t first = (a->first + index) * KILN_H5_CHUNK_ROWS;
    struct kiln_column_values wanted = room->rows;
    int status = KILN_OK;
    for (size_t c = 0; c < a->columns.count; c++)
        if (stage_of(&a->columns.column[c]) != stage)
            wanted.column[c] = NULL;
    kiln_column_values_fill(&wanted, &a->columns, &a->result, (struct kiln_global_point){first},
                            (struct kiln_global_point){first + KILN_H5_CHUNK_ROWS});
    for (size_t c = 0; status == KILN_OK && c < a->columns.count; c++)
        if (wanted.column[c] != NULL)
            status = pack_column(a, index, c, room);
    return status;
}

/* ---- threads ---- */

static int pack_stage(struct kiln_points_ahead *a, enum stage stage, struct room *room)
{
    int status = KILN_OK;
    while (status == KILN_OK && !a->leave && a->bytes < KILN_POINTS_AHEAD_MOST) {
        uint64_t none = 0;
        const uint64_t index = atomic_fetch_add(&a->next[stage], 1), begin = now(CLOCK_MONOTONIC);
        if (index >= a->count)
            break;
        (void)atomic_compare_exchange_strong(&a->begin, &none, begin);
        status = pack_chunk(a, stage, index, room);
        a->done[stage][index] = status == KILN_OK;
        a->end = now(CLOCK_MONOTONIC);
    }
    return status;
}

static void wait_for_direct(struct kiln_points_ahead *a)
{
    (void)pthread_mutex_lock(&a->lock);
    while (!a->has_direct && !a->leave)
        (void)pthread_cond_wait(&a->news, &a->lock);
    (void)pthread_mutex_unlock(&a->lock);
}

/* Thread function. If it runs out of memory it ends, and the writer packs what is missing. */
static void *pack_chunks(void *context)
{
    struct kiln_points_ahead *a = context;
    struct room room = {.shuffled = NULL};
    kiln_thread_give_way();
    omp_set_num_threads(1); /* of this thread alone */
    int status;
    KILN_TRY(make_room(a, &room));
    KILN_TRY(pack_stage(a, OF_SURFACE, &room));
    wait_for_direct(a);
    (void)pack_stage(a, OF_DIRECT, &room);
end:
    leave_room(&room);
    atomic_fetch_add(&a->nanoseconds, now(CLOCK_THREAD_CPUTIME_ID));
    return NULL;
}

static void start_threads(struct kiln_points_ahead *a, uint32_t wanted)
{
    while (a->thread_count < wanted && kiln_thread_start(&a->threads[a->thread_count], pack_chunks, a))
        a->thread_count++;
}

/* ---- start and end ---- */

/* Finds the chunks all of whose points are the rank's own, and the columns that depend on no light, or on direct light
 * only. */
static void survey(struct kiln_points_ahead *a)
{
    const struct kiln_surface *s = a->result.surface;
    const uint64_t begin = s->first.at, end = begin + s->count, rows = KILN_H5_CHUNK_ROWS;
    struct kiln_columns all;
    a->first = (begin + rows - 1) / rows;
    a->count = end / rows > a->first ? end / rows - a->first : 0;
    kiln_columns_of(&all, &a->result);
    for (size_t c = 0; c < all.count; c++)
        if (all.column[c].early || all.column[c].of_direct)
            a->columns.column[a->columns.count++] = all.column[c];
}

void kiln_points_ahead_start(struct kiln_points_ahead **ahead, const struct kiln_bake_result *result, uint32_t threads)
{
    const uint32_t share = threads / THREADS_SHARE, wanted = share < 1 ? 1 : share;
    struct kiln_points_ahead *a = NULL;
    *ahead = NULL;
    if (kiln_allocate(&a, 1, sizeof *a, "points to write", NULL) != KILN_OK)
        return;
    a->result = *result;
    (void)pthread_mutex_init(&a->lock, NULL);
    (void)pthread_cond_init(&a->news, NULL);
    survey(a);
    a->start = now(CLOCK_MONOTONIC);
    int status;
    KILN_TRY(a->count > 0 ? KILN_OK : KILN_BAD_INPUT);
    KILN_TRY(kiln_allocate(&a->parts, a->count * a->columns.count, sizeof *a->parts, "packed points", NULL));
    for (int i = 0; i < STAGES; i++)
        KILN_TRY(kiln_allocate(&a->done[i], a->count, sizeof *a->done[i], "packed points", NULL));
end:
    if (status == KILN_OK) {
        start_threads(a, wanted < THREADS_MOST ? wanted : THREADS_MOST);
        *ahead = a;
    } else {
        kiln_points_ahead_destroy(&a);
    }
}

/* Sets what threads wait for. */
static void tell(struct kiln_points_ahead *a, atomic_bool *what)
{
    (void)pthread_mutex_lock(&a->lock);
    *what = true;
    (void)pthread_cond_broadcast(&a->news);
    (void)pthread_mutex_unlock(&a->lock);
}

void kiln_points_ahead_direct(struct kiln_points_ahead *a)
{
    if (a != NULL)
        tell(a, &a->has_direct);
}

void kiln_points_ahead_stop(struct kiln_points_ahead *a)
{
    if (a == NULL)
        return;
    tell(a, &a->leave);
    while (a->thread_count > 0)
        (void)pthread_join(a->threads[--a->thread_count], NULL);
}

void kiln_points_ahead_drop(struct kiln_points_ahead *a)
{
    if (a == NULL)
        return;
    kiln_points_ahead_stop(a);
    for (uint64_t i = 0; a->parts != NULL && i < a->count * a->columns.count; i++)
        kiln_free(&a->parts[i].bytes);
}

void kiln_points_ahead_destroy(struct kiln_points_ahead **ahead)
{
    struct kiln_points_ahead *a = *ahead;
    if (a == NULL)
        return;
    kiln_points_ahead_drop(a);
    kiln_free(&a->parts);
    for (int i = 0; i < STAGES; i++)
        kiln_free(&a->done[i]);
    (void)pthread_cond_destroy(&a->news);
    (void)pthread_mutex_destroy(&a->lock);
    kiln_free(ahead);
}

/* ---- what there is ---- */

static const struct part *find(const struct kiln_points_ahead *a, enum stage stage, uint64_t chunk, const char *column)
{
    if (a == NULL || chunk < a->first || chunk - a->first >= a->count || !a->done[stage][chunk - a->first])
        return NULL;
    const size_t c = kiln_columns_find(&a->columns, column);
    return c < a->columns.count ? &a->parts[(chunk - a->first) * a->columns.count + c] : NULL;
}

const void *kiln_points_ahead_find(const struct kiln_points_ahead *a, uint64_t chunk, const char *column, size_t *bytes)
{
    const struct part *part = find(a, OF_SURFACE, chunk, column);
    if (part == NULL)
        return NULL;
    *bytes = part->size;
    return part->bytes;
}

const void *kiln_points_ahead_find_direct(const struct kiln_points_ahead *a, uint64_t chunk, const char *column,
                                          const void *rows, size_t size, size_t *bytes)
{
    const struct part *part = find(a, OF_DIRECT, chunk, column);
    if (part == NULL || part->hash != XXH3_64bits(rows, size))
        return NULL;
    *bytes = part->size;
    return part->bytes;
}

void kiln_points_ahead_report(const struct kiln_points_ahead *a, struct kiln_points_ahead_report *report)
{
    *report = (struct kiln_points_ahead_report){0};
    if (a == NULL)
        return;
    report->of = a->count;
    for (uint64_t i = 0; i < a->count; i++) {
        report->chunks += a->done[OF_SURFACE][i];
        report->direct += a->done[OF_DIRECT][i];
    }
    report->bytes = a->bytes;
    report->processor = 1e-9 * (double)a->nanoseconds;
    if (a->begin != 0) {
        report->begin = 1e-9 * (double)(a->begin - a->start);
        report->end = 1e-9 * (double)(a->end - a->start);
    }
}
