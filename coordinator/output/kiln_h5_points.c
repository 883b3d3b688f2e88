#include "coordinator/output/kiln_h5_points.h"

#include <omp.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/output/chunk.h"
#include "coordinator/output/kiln_h5_points_private.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

/* Number of chunks in a batch, which a rank compresses together: 28 MB uncompressed. */
enum { BATCH = 16 };
enum { WIDE_ROW = 1024 }; /* row size from which on a batch has fewer chunks, bytes */
enum { TAG_ROWS = 40 };

/* ---- owners of chunks ---- */

static uint64_t round_up(uint64_t point, uint64_t rows) { return (point + rows - 1) / rows; }

uint64_t points_first_chunk(const struct kiln_points_writer *w, int rank)
{
    return round_up(w->starts[rank], w->chunk_rows);
}

uint64_t points_parts(const struct kiln_points_writer *w, int rank)
{
    return (points_first_chunk(w, rank + 1) - points_first_chunk(w, rank)) * w->columns.count;
}

/* Returns the end of the rank's points that belong to a chunk of an earlier rank. */
static uint64_t head_end(const struct kiln_points_writer *w, int rank)
{
    return points_minimum(points_first_chunk(w, rank) * w->chunk_rows, w->starts[rank + 1]);
}

bool points_batch(struct kiln_points_writer *w, uint64_t pass)
{
    const uint64_t end = points_first_chunk(w, w->rank + 1);
    w->first = points_minimum(points_first_chunk(w, w->rank) + pass * w->at_once, end);
    w->count = points_minimum(end - w->first, w->at_once);
    return w->count > 0;
}

/* The rank that owns the first point of the chunk that contains `point`. */
static int owner_of(const struct kiln_points_writer *w, uint64_t point)
{
    const uint64_t begin = point / w->chunk_rows * w->chunk_rows;
    int rank = 0;
    while (w->starts[rank + 1] <= begin)
        rank++;
    return rank;
}

/* Returns the offset of `column` among the slots of a chunk, in which each column has room for its largest compressed
 * size. */
static size_t place_in_chunk(const struct kiln_points_writer *w, size_t column)
{
    size_t bytes = 0;
    for (size_t c = 0; c < column; c++)
        bytes += kiln_chunk_bound(w->chunk_rows * kiln_column_row(points_column(w, c)));
    return bytes;
}

size_t points_slot(const struct kiln_points_writer *w, size_t slot)
{
    const size_t columns = w->columns.count;
    return slot / columns * place_in_chunk(w, columns) + place_in_chunk(w, slot % columns);
}

uint64_t points_part(const struct kiln_points_writer *w, size_t slot)
{
    return (w->first - points_first_chunk(w, w->rank)) * w->columns.count + slot;
}

uint8_t *points_shuffled(const struct kiln_points_writer *w)
{
    return w->shuffled + (size_t)omp_get_thread_num() * w->shuffled_bytes;
}

/* ---- rows of other ranks ---- */

/* Copies `count` rows between columns and a message, which holds one column after the other. */
static void move_rows(const struct kiln_column_values *rows, const struct kiln_columns *columns, uint64_t at,
                      uint64_t count, uint8_t *message, bool out)
{
    for (size_t c = 0; c < columns->count; c++) {
        const size_t row = kiln_column_row(&columns->column[c]), bytes = count * row;
        uint8_t *column = (uint8_t *)rows->column[c] + at * row;
        memcpy(out ? message : column, out ? column : message, bytes);
        message += bytes;
    }
}

int points_mpi_failed(struct kiln_error *error)
{
    return kiln_fail(error, KILN_RANK_LOST, "MPI failed while the ranks shared the writing of 'kiln.h5'");
}

/* The message is in `w->packed`, which has room for more rows than a chunk. */
static int send_head(struct kiln_points_writer *w, struct kiln_error *error)
{
    const uint64_t first = w->starts[w->rank], last = head_end(w, w->rank);
    if (first == last)
        return KILN_OK;
    kiln_column_values_fill(&w->rows, &w->columns, w->result, (struct kiln_global_point){first},
                            (struct kiln_global_point){last});
    move_rows(&w->rows, &w->columns, 0, last - first, w->packed, true);
    const int sent = MPI_Send(w->packed, (int)((last - first) * kiln_columns_row(&w->columns)), MPI_BYTE,
                              owner_of(w, first), TAG_ROWS, w->result->communicator);
    return sent == MPI_SUCCESS ? KILN_OK : points_mpi_failed(error);
}

static int receive_tail(struct kiln_points_writer *w, struct kiln_error *error)
{
    for (int r = w->rank + 1; r < w->ranks; r++) {
        const uint64_t first = w->starts[r], count = head_end(w, r) - first;
        if (count == 0 || owner_of(w, first) != w->rank)
            continue;
        if (MPI_Recv(w->packed, (int)(count * kiln_columns_row(&w->columns)), MPI_BYTE, r, TAG_ROWS,
                     w->result->communicator, MPI_STATUS_IGNORE) != MPI_SUCCESS)
            return points_mpi_failed(error);
        move_rows(&w->tail, &w->columns, first % w->chunk_rows, count, w->packed, false);
    }
    return KILN_OK;
}

int points_share_borders(struct kiln_points_writer *w, struct kiln_error *error)
{
    int status = send_head(w, error);
    if (status == KILN_OK)
        status = receive_tail(w, error);
    return kiln_agree(w->result->communicator, status, error);
}

/* ---- compression ---- */

const void *points_ahead_part(const struct kiln_points_writer *w, uint64_t part, size_t *bytes)
{
    const uint64_t columns = w->columns.count, chunk = points_first_chunk(w, w->rank) + part / columns;
    const struct kiln_column *column = points_column(w, part % columns);
    return column->early ? kiln_points_ahead_find(w->ahead, chunk, column->name, bytes) : NULL;
}

/* Whether the column of the batch is there already, packed. */
static bool is_there(const struct kiln_points_writer *w, size_t column)
{
    size_t bytes = 0;
    bool all = true;
    for (size_t slot = column; all && slot < w->count * w->columns.count; slot += w->columns.count)
        all = w->kept[points_part(w, slot)] != NULL || points_ahead_part(w, points_part(w, slot), &bytes) != NULL;
    return all;
}

/* Fills in the rows of a batch that are still to be packed; rows beyond the last point pad the last chunk of the file.
 */
static void fill_batch(struct kiln_points_writer *w)
{
    struct kiln_column_values wanted = w->rows;
    bool none = true;
    for (size_t c = 0; c < w->columns.count; c++)
        if (is_there(w, c))
            wanted.column[c] = NULL;
        else
            none = false;
    const uint64_t own_end = w->starts[w->rank + 1], first = w->first * w->chunk_rows,
                   last = first + w->count * w->chunk_rows;
    const uint64_t own = points_minimum(own_end, last) - first;
    if (none)
        return;
    kiln_column_values_fill(&wanted, &w->columns, w->result, (struct kiln_global_point){first},
                            (struct kiln_global_point){first + own});
    for (size_t c = 0; c < w->columns.count && own_end < last; c++) {
        const size_t row = kiln_column_row(points_column(w, c));
        memcpy((uint8_t *)w->rows.column[c] + own * row, (uint8_t *)w->tail.column[c] + own_end % w->chunk_rows * row,
               (last - own_end) * row);
    }
}

/* Keeps a slot's packed bytes, if there is room. */
static void keep(struct kiln_points_writer *w, size_t slot, size_t bytes)
{
    const uint64_t part = points_part(w, slot);
    uint64_t now;
#pragma omp atomic capture
    now = w->kept_bytes += bytes;
    if (w->ranks > 1 && now <= w->kept_most &&
        kiln_allocate(&w->kept[part], bytes, 1, "packed points", NULL) == KILN_OK)
        memcpy(w->kept[part], w->packed + points_slot(w, slot), bytes);
}

/* Copies a chunk of direct light that was packed ahead, provided that its rows are unchanged. */
static bool take_direct(const struct kiln_points_writer *w, uint64_t part, const void *rows, uint8_t *packed,
                        size_t *bytes)
{
    const uint64_t columns = w->columns.count, chunk = points_first_chunk(w, w->rank) + part / columns;
    const struct kiln_column *column = points_column(w, part % columns);
    if (!column->of_direct || w->chunk_rows != KILN_H5_CHUNK_ROWS)
        return false;
    const void *from = kiln_points_ahead_find_direct(w->ahead, chunk, column->name, rows,
                                                     w->chunk_rows * kiln_column_row(column), bytes);
    if (from != NULL)
        memcpy(packed, from, *bytes);
    return from != NULL;
}

static int pack_slot(struct kiln_points_writer *w, size_t slot, struct kiln_error *error)
{
    const size_t at = slot % w->columns.count, chunk = slot / w->columns.count, place = points_slot(w, slot);
    const struct kiln_column *column = points_column(w, at);
    const uint8_t *values = (const uint8_t *)w->rows.column[at] + chunk * w->chunk_rows * kiln_column_row(column);
    const uint64_t part = points_part(w, slot);
    size_t bytes = 0;
    if (w->kept[part] != NULL)
        return KILN_OK;
    int status = KILN_OK;
    if (points_ahead_part(w, part, &bytes) == NULL && !take_direct(w, part, values, w->packed + place, &bytes)) {
        status = kiln_chunk_pack(values, w->chunk_rows * column->components, kiln_column_value(column), column->noisy,
                                 points_shuffled(w), w->packed + place, &bytes, error);
        keep(w, slot, bytes);
    }
    if (status == KILN_OK && w->sizes[part] != 0 && w->sizes[part] != bytes)
        return kiln_fail(error, KILN_BUG, "a chunk of %s has %zu bytes, and had %u when it was packed before",
                         column->name, bytes, w->sizes[part]);
    w->sizes[part] = (uint32_t)bytes;
    return status;
}

int points_pack(struct kiln_points_writer *w, struct kiln_error *error)
{
    int status = KILN_OK;
    fill_batch(w);
#pragma omp parallel for schedule(dynamic, 1) num_threads(w->threads)
    for (size_t slot = 0; slot < w->count * w->columns.count; slot++) {
        struct kiln_error mine = {{0}};
        const int result = pack_slot(w, slot, &mine);
#pragma omp critical(kiln_pack_batch)
        if (result != KILN_OK)
            status = kiln_fail(error, result, "%s", mine.message);
    }
    return status;
}

uint64_t kiln_points_largest(const struct kiln_field_set *fields, uint64_t points)
{
    const uint64_t held =
        points < KILN_H5_CHUNK_ROWS ? points : round_up(points, KILN_H5_CHUNK_ROWS) * KILN_H5_CHUNK_ROWS;
    struct kiln_columns columns;
    kiln_columns_make(&columns, fields, true, true, true);
    return held * (kiln_columns_row(&columns) + 1) + (held / KILN_H5_CHUNK_ROWS + 1) * columns.count * 256;
}

/* ---- the writer ---- */

static int learn_starts(struct kiln_points_writer *w, struct kiln_error *error)
{
    const struct kiln_surface *s = w->result->surface;
    int status = kiln_arena_allocate(&w->arena, &w->starts, (size_t)w->ranks + 1, sizeof *w->starts,
                                     "the ranks' first points", error);
    status = kiln_agree(w->result->communicator, status, error);
    if (status != KILN_OK)
        return status;
    if (MPI_Allgather(&s->first.at, 1, MPI_UINT64_T, w->starts, 1, MPI_UINT64_T, w->result->communicator) !=
        MPI_SUCCESS)
        return points_mpi_failed(error);
    w->starts[w->ranks] = s->point_count;
    if (w->starts[w->rank + 1] != s->first.at + s->count)
        status = kiln_fail(error, KILN_BUG,
                           "rank %d: its %llu points from %llu on are not followed by those of the next rank", w->rank,
                           (unsigned long long)s->count, (unsigned long long)s->first.at);
    return kiln_agree(w->result->communicator, status, error);
}

/* Returns the largest number of parts of any rank except rank 0. */
static uint64_t most_parts(const struct kiln_points_writer *w)
{
    uint64_t most = 0;
    for (int r = 1; r < w->ranks; r++) {
        const uint64_t parts = points_parts(w, r);
        most = parts > most ? parts : most;
    }
    return most;
}

static int allocate(struct kiln_points_writer *w, struct kiln_error *error)
{
    const uint64_t parts = points_parts(w, w->rank), own = points_minimum(parts / w->columns.count, w->at_once);
    /* a rank without chunks needs one slot for the rows that it sends */
    const size_t chunks = own > 0 ? own : 1, places = place_in_chunk(w, w->columns.count);
    int status = kiln_column_values_allocate(&w->rows, &w->columns, chunks * w->chunk_rows, error);
    if (status == KILN_OK)
        status = kiln_column_values_allocate(&w->tail, &w->columns, w->chunk_rows, error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&w->arena, &w->shuffled, (size_t)w->threads * w->shuffled_bytes, 1,
                                     "points to write", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w->packed, chunks * places, 1, "packed points", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w->spare, chunks * places, 1, "packed points", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&w->arena, &w->sizes, parts, sizeof *w->sizes, "packed points", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&w->arena, &w->addresses, parts, sizeof *w->addresses, "packed points", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&w->arena, &w->kept, parts, sizeof *w->kept, "packed points", error);
    const uint64_t theirs = w->rank == 0 ? most_parts(w) : 0;
    if (status == KILN_OK)
        status = kiln_arena_allocate(&w->arena, &w->their_sizes, theirs, sizeof *w->their_sizes,
                                     "sizes of packed points", error);
    return status == KILN_OK ? kiln_arena_allocate(&w->arena, &w->their_addresses, theirs, sizeof *w->their_addresses,
                                                   "places of packed points", error)
                             : status;
}

int kiln_points_writer_create(struct kiln_points_writer **writer, const struct kiln_bake_result *result,
                              const struct kiln_output_params *params, struct kiln_error *error)
{
    int status =
        kiln_agree(result->communicator, kiln_allocate(writer, 1, sizeof **writer, "points to write", error), error);
    if (status == KILN_OK) {
        struct kiln_points_writer *w = *writer;
        w->result = result;
        w->ahead = params->ahead;
        w->kept_most = params->kept > 0 ? params->kept : KILN_POINTS_KEPT_MOST;
        kiln_columns_of(&w->columns, result);
        w->total = kiln_columns_find(&w->columns, POINTS_TOTAL);
        w->chunk_rows = points_minimum(result->surface->point_count, KILN_H5_CHUNK_ROWS);
        w->chunk_rows = w->chunk_rows == 0 ? 1 : w->chunk_rows;
        w->at_once = points_minimum(BATCH, 1 + BATCH * WIDE_ROW / (kiln_columns_row(&w->columns) + 1));
        w->threads = omp_get_max_threads();
        for (size_t c = 0; c < w->columns.count; c++) {
            const size_t bytes = w->chunk_rows * kiln_column_row(points_column(w, c));
            w->shuffled_bytes = bytes > w->shuffled_bytes ? bytes : w->shuffled_bytes;
            w->datasets[c] = H5I_INVALID_HID;
        }
        if (w->total == w->columns.count)
            status = kiln_fail(error, KILN_BUG, "this bake has no field for the dataset %s", POINTS_TOTAL);
        if (MPI_Comm_rank(result->communicator, &w->rank) != MPI_SUCCESS ||
            MPI_Comm_size(result->communicator, &w->ranks) != MPI_SUCCESS)
            status = points_mpi_failed(error);
        if (status == KILN_OK)
            status = learn_starts(w, error);
        if (status == KILN_OK)
            status = kiln_agree(result->communicator, allocate(w, error), error);
    }
    if (status != KILN_OK)
        kiln_points_writer_destroy(writer);
    return status;
}

void kiln_points_writer_destroy(struct kiln_points_writer **writer)
{
    struct kiln_points_writer *w = *writer;
    if (w == NULL)
        return;
    for (uint64_t part = 0; w->kept != NULL && part < points_parts(w, w->rank); part++)
        kiln_free(&w->kept[part]);
    kiln_column_values_free(&w->rows);
    kiln_column_values_free(&w->tail);
    kiln_arena_release(&w->arena);
    kiln_free(&w->packed);
    kiln_free(&w->spare);
    kiln_free(writer);
}
