#include "coordinator/output/kiln_h5_points.h"

#include <math.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/output/chunk.h"
#include "worker/base/memory.h"

/* Number of chunks in a batch, which a rank compresses and sends together: 28 MB uncompressed. */
enum { BATCH = 16, PARTS = BATCH * KILN_COLUMNS_MAX };
enum { WIDE_ROW = 1024 }; /* bytes of a row from which on a batch has fewer chunks */
enum { TAG_ROWS = 40, TAG_SIZES = 41, TAG_PACKED = 42 };

/* The dataset that is read back completely. */
#define TOTAL "/irradiance/total"

/* A batch: compressed chunks with consecutive numbers, column by column. */
struct batch {
    uint64_t first, count; /* chunks */
    uint64_t bytes[PARTS];
};

struct kiln_points_writer {
    const struct kiln_bake_result *result;
    const struct kiln_points_ahead *ahead; /* NULL: none */
    struct kiln_h5 *h5;                    /* rank 0 */
    int rank, ranks;
    uint64_t chunk_rows, at_once; /* at_once: chunks of a batch at most */
    uint64_t *starts;             /* global index of the first point of each rank; ranks + 1 entries */
    struct kiln_columns columns;
    size_t total; /* index of the column TOTAL */
    hid_t datasets[KILN_COLUMNS_MAX];
    struct kiln_rows rows, tail; /* rows of the batch; rows of the last own chunk that come from later ranks */
    uint8_t *shuffled, *packed;  /* both have one slot for each part */
    struct batch batch;
};

static hid_t h5_type(const struct kiln_column *column)
{
    switch (column->type) {
    case KILN_DOUBLE:
        return H5T_NATIVE_DOUBLE;
    case KILN_FLOAT:
        return H5T_NATIVE_FLOAT;
    case KILN_UINT32:
        return H5T_NATIVE_UINT32;
    default:
        return H5T_NATIVE_UINT8;
    }
}

static const struct kiln_column *column_at(const struct kiln_points_writer *w, size_t column)
{
    return &w->columns.column[column];
}

/* ---- owners of chunks ---- */

static uint64_t round_up(uint64_t point, uint64_t rows) { return (point + rows - 1) / rows; }

static uint64_t first_chunk(const struct kiln_points_writer *w, int rank)
{
    return round_up(w->starts[rank], w->chunk_rows);
}

static uint64_t minimum(uint64_t a, uint64_t b) { return a < b ? a : b; }

/* End of the rank's points that lie in a chunk of an earlier rank. */
static uint64_t head_end(const struct kiln_points_writer *w, int rank)
{
    return minimum(first_chunk(w, rank) * w->chunk_rows, w->starts[rank + 1]);
}

static void batch_of(const struct kiln_points_writer *w, int rank, uint64_t pass, uint64_t *first, uint64_t *count)
{
    const uint64_t end = first_chunk(w, rank + 1);
    *first = minimum(first_chunk(w, rank) + pass * w->at_once, end);
    *count = minimum(end - *first, w->at_once);
}

static uint64_t count_passes(const struct kiln_points_writer *w)
{
    uint64_t most = 0;
    for (int r = 0; r < w->ranks; r++) {
        const uint64_t chunks = first_chunk(w, r + 1) - first_chunk(w, r);
        most = chunks > most ? chunks : most;
    }
    return round_up(most, w->at_once);
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

/* Offset of `column` in a chunk's slots, if each column has room for its largest compressed size. */
static size_t place_in_chunk(const struct kiln_points_writer *w, size_t column)
{
    size_t bytes = 0;
    for (size_t c = 0; c < column; c++)
        bytes += kiln_chunk_bound(w->chunk_rows * kiln_column_row(column_at(w, c)));
    return bytes;
}

static size_t place_of(const struct kiln_points_writer *w, size_t part)
{
    const size_t columns = w->columns.count;
    return part / columns * place_in_chunk(w, columns) + place_in_chunk(w, part % columns);
}

/* ---- rows of other ranks ---- */

/* Copies `count` rows between columns and a message, which holds one column after the other. */
static void move_rows(const struct kiln_rows *rows, const struct kiln_columns *columns, uint64_t at, uint64_t count,
                      uint8_t *message, bool out)
{
    for (size_t c = 0; c < columns->count; c++) {
        const size_t row = kiln_column_row(&columns->column[c]), bytes = count * row;
        uint8_t *column = (uint8_t *)rows->column[c] + at * row;
        memcpy(out ? message : column, out ? column : message, bytes);
        message += bytes;
    }
}

static int mpi_failed(struct kiln_error *error)
{
    return kiln_fail(error, KILN_RANK_LOST, "MPI failed while points were sent to the rank that writes 'kiln.h5'");
}

/* The message is in `w->packed`, which has room for more rows than a chunk. */
static int send_head(struct kiln_points_writer *w, struct kiln_error *error)
{
    const uint64_t first = w->starts[w->rank], last = head_end(w, w->rank);
    if (first == last)
        return KILN_OK;
    kiln_rows_fill(&w->rows, &w->columns, w->result, (struct kiln_global_point){first},
                   (struct kiln_global_point){last});
    move_rows(&w->rows, &w->columns, 0, last - first, w->packed, true);
    const int sent = MPI_Send(w->packed, (int)((last - first) * kiln_columns_row(&w->columns)), MPI_BYTE,
                              owner_of(w, first), TAG_ROWS, w->result->communicator);
    return sent == MPI_SUCCESS ? KILN_OK : mpi_failed(error);
}

static int receive_tail(struct kiln_points_writer *w, struct kiln_error *error)
{
    for (int r = w->rank + 1; r < w->ranks; r++) {
        const uint64_t first = w->starts[r], count = head_end(w, r) - first;
        if (count == 0 || owner_of(w, first) != w->rank)
            continue;
        if (MPI_Recv(w->packed, (int)(count * kiln_columns_row(&w->columns)), MPI_BYTE, r, TAG_ROWS,
                     w->result->communicator, MPI_STATUS_IGNORE) != MPI_SUCCESS)
            return mpi_failed(error);
        move_rows(&w->tail, &w->columns, first % w->chunk_rows, count, w->packed, false);
    }
    return KILN_OK;
}

/* A rank first sends to an earlier one and then receives from later ones, which prevents deadlock. */
static int share_borders(struct kiln_points_writer *w, struct kiln_error *error)
{
    int status = send_head(w, error);
    if (status == KILN_OK)
        status = receive_tail(w, error);
    return kiln_agree(w->result->communicator, status, error);
}

/* ---- compression ---- */

/* Whether the column of the batch was packed ahead. */
static bool is_ahead(const struct kiln_points_writer *w, size_t column)
{
    size_t bytes = 0;
    bool all = column_at(w, column)->early;
    for (uint64_t chunk = 0; all && chunk < w->batch.count; chunk++)
        all = kiln_points_ahead_find(w->ahead, w->batch.first + chunk, column_at(w, column)->name, &bytes) != NULL;
    return all;
}

/* Fills in the rows of a batch that are still to be packed; rows beyond the last point pad the last chunk of the file.
 */
static void fill_batch(struct kiln_points_writer *w)
{
    struct kiln_rows wanted = w->rows;
    for (size_t c = 0; c < w->columns.count; c++)
        if (is_ahead(w, c))
            wanted.column[c] = NULL;
    const uint64_t own_end = w->starts[w->rank + 1], first = w->batch.first * w->chunk_rows,
                   last = first + w->batch.count * w->chunk_rows;
    const uint64_t own = minimum(own_end, last) - first;
    kiln_rows_fill(&wanted, &w->columns, w->result, (struct kiln_global_point){first},
                   (struct kiln_global_point){first + own});
    for (size_t c = 0; c < w->columns.count && own_end < last; c++) {
        const size_t row = kiln_column_row(column_at(w, c));
        memcpy((uint8_t *)w->rows.column[c] + own * row, (uint8_t *)w->tail.column[c] + own_end % w->chunk_rows * row,
               (last - own_end) * row);
    }
}

static int pack_part(struct kiln_points_writer *w, size_t part, struct kiln_error *error)
{
    const size_t at = part % w->columns.count, chunk = part / w->columns.count, place = place_of(w, part);
    const struct kiln_column *column = column_at(w, at);
    const uint8_t *values = (const uint8_t *)w->rows.column[at] + chunk * w->chunk_rows * kiln_column_row(column);
    size_t bytes = 0;
    const void *there = kiln_points_ahead_find(w->ahead, w->batch.first + chunk, column->name, &bytes);
    if (there != NULL) {
        memcpy(w->packed + place, there, bytes);
        w->batch.bytes[part] = bytes;
        return KILN_OK;
    }
    const int status = kiln_chunk_pack(values, w->chunk_rows * column->components, kiln_column_value(column),
                                       column->noisy, w->shuffled + place, w->packed + place, &bytes, error);
    w->batch.bytes[part] = bytes;
    return status;
}

/* Moves the compressed parts from their slots together. Returns their total size. */
static size_t close_up(struct kiln_points_writer *w)
{
    size_t at = 0;
    for (size_t part = 0; part < w->batch.count * w->columns.count; part++) {
        memmove(w->packed + at, w->packed + place_of(w, part), w->batch.bytes[part]);
        at += w->batch.bytes[part];
    }
    return at;
}

static int pack_batch(struct kiln_points_writer *w, uint64_t pass, struct kiln_error *error)
{
    int status = KILN_OK;
    batch_of(w, w->rank, pass, &w->batch.first, &w->batch.count);
    if (w->batch.count == 0)
        return KILN_OK;
    fill_batch(w);
#pragma omp parallel for schedule(dynamic, 1)
    for (size_t part = 0; part < w->batch.count * w->columns.count; part++) {
        struct kiln_error mine = {{0}};
        const int result = pack_part(w, part, &mine);
#pragma omp critical(kiln_pack_batch)
        if (result != KILN_OK)
            status = kiln_fail(error, result, "%s", mine.message);
    }
    return status;
}

/* ---- writing ---- */

static int make_datasets(struct kiln_points_writer *w, struct kiln_error *error)
{
    const uint64_t points = w->result->surface->point_count;
    int status = KILN_OK;
    for (size_t c = 0; status == KILN_OK && c < w->columns.count; c++) {
        const struct kiln_column *info = column_at(w, c);
        const struct kiln_field *field = w->result->fields->entry[info->field].field;
        const struct kiln_h5_dataset what = {.name = info->name,
                                             .type = h5_type(info),
                                             .rank = info->components > 1 ? 2 : 1,
                                             .size = {points, info->components},
                                             .units = info->units != NULL ? info->units
                                                                          : kiln_field_unit(field, w->result->units),
                                             .chunk = {points == 0 ? 0 : w->chunk_rows, info->components},
                                             .description = info->description};
        status = kiln_h5_make(w->h5, &what, &w->datasets[c], error);
    }
    return status;
}

static int close_datasets(struct kiln_points_writer *w, int status, struct kiln_error *error)
{
    for (size_t c = 0; c < w->columns.count; c++) {
        if (w->datasets[c] >= 0 && H5Dclose(w->datasets[c]) < 0 && status == KILN_OK)
            status = kiln_h5_failed(w->h5, "close the dataset", column_at(w, c)->name, error);
        w->datasets[c] = H5I_INVALID_HID;
    }
    return status;
}

static int write_batch(struct kiln_points_writer *w, struct kiln_error *error)
{
    const uint8_t *from = w->packed;
    for (size_t part = 0; part < w->batch.count * w->columns.count; part++) {
        const size_t column = part % w->columns.count;
        const hsize_t offset[2] = {(w->batch.first + part / w->columns.count) * w->chunk_rows, 0};
        if (H5Dwrite_chunk(w->datasets[column], H5P_DEFAULT, 0, offset, w->batch.bytes[part], from) < 0)
            return kiln_h5_failed(w->h5, "write", column_at(w, column)->name, error);
        from += w->batch.bytes[part];
    }
    return KILN_OK;
}

/* Of a message with the sizes of a batch's parts. */
static int batch_bytes(const struct kiln_points_writer *w, uint64_t chunks)
{
    return (int)(offsetof(struct batch, bytes) + chunks * w->columns.count * sizeof *w->batch.bytes);
}

static int send_batch(struct kiln_points_writer *w, size_t bytes, struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    if (w->batch.count > 0 &&
        (MPI_Send(&w->batch, batch_bytes(w, w->batch.count), MPI_BYTE, 0, TAG_SIZES, comm) != MPI_SUCCESS ||
         MPI_Send(w->packed, (int)bytes, MPI_BYTE, 0, TAG_PACKED, comm) != MPI_SUCCESS))
        return mpi_failed(error);
    return KILN_OK;
}

/* Rank 0 receives the batches of all other ranks in this pass, even after a failure, since they have been sent already.
 */
static int write_pass(struct kiln_points_writer *w, uint64_t pass, struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    int status = write_batch(w, error);
    for (int r = 1; r < w->ranks; r++) {
        uint64_t first, count, bytes = 0;
        batch_of(w, r, pass, &first, &count);
        if (count == 0)
            continue;
        if (MPI_Recv(&w->batch, batch_bytes(w, count), MPI_BYTE, r, TAG_SIZES, comm, MPI_STATUS_IGNORE) != MPI_SUCCESS)
            return mpi_failed(error);
        for (size_t part = 0; part < count * w->columns.count; part++)
            bytes += w->batch.bytes[part];
        if (MPI_Recv(w->packed, (int)bytes, MPI_BYTE, r, TAG_PACKED, comm, MPI_STATUS_IGNORE) != MPI_SUCCESS)
            return mpi_failed(error);
        if (status == KILN_OK)
            status = write_batch(w, error);
    }
    return status;
}

int kiln_points_write(struct kiln_points_writer *w, struct kiln_h5 *h5, struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    const uint64_t passes = count_passes(w);
    w->h5 = h5;
    int status = share_borders(w, error);
    if (status == KILN_OK)
        status = kiln_agree(comm, w->rank == 0 ? make_datasets(w, error) : KILN_OK, error);
    int own = KILN_OK; /* the other ranks learn of a failed write of rank 0 one pass later */
    for (uint64_t pass = 0; status == KILN_OK && pass < passes; pass++) {
        if (own == KILN_OK)
            own = kiln_stop_asked(w->result->stop) ? kiln_give_up(error) : pack_batch(w, pass, error);
        status = kiln_agree(comm, own, error);
        if (status != KILN_OK)
            break;
        const size_t bytes = close_up(w);
        own = w->rank == 0 ? write_pass(w, pass, error) : send_batch(w, bytes, error);
    }
    if (w->rank == 0)
        own = close_datasets(w, own, error);
    return status == KILN_OK ? kiln_agree(comm, own, error) : status;
}

/* ---- reading back ---- */

static bool has_extent(hid_t dataset, const struct kiln_column *column, uint64_t points)
{
    const hid_t space = dataset < 0 ? H5I_INVALID_HID : H5Dget_space(dataset);
    hsize_t size[KILN_H5_RANK_MAX] = {0};
    const bool right = space >= 0 && H5Sget_simple_extent_dims(space, size, NULL) == (column->components > 1 ? 2 : 1) &&
                       size[0] == points;
    if (space >= 0)
        (void)H5Sclose(space);
    return right;
}

static bool has_extents(hid_t file, const struct kiln_columns *columns, uint64_t points)
{
    bool right = true;
    for (size_t c = 0; right && c < columns->count; c++) {
        const hid_t dataset = H5Dopen2(file, columns->column[c].name, H5P_DEFAULT);
        right = has_extent(dataset, &columns->column[c], points);
        if (dataset >= 0)
            (void)H5Dclose(dataset);
    }
    return right;
}

/* Reads the compressed chunks of /irradiance/total in the batch into the slots of their parts. */
static bool read_packed(struct kiln_points_writer *w, hid_t dataset)
{
    const size_t room = kiln_chunk_bound(w->chunk_rows * kiln_column_row(column_at(w, w->total)));
    bool good = true;
    for (uint64_t chunk = 0; good && chunk < w->batch.count; chunk++) {
        const size_t part = chunk * w->columns.count + w->total;
        const hsize_t offset[2] = {(w->batch.first + chunk) * w->chunk_rows, 0};
        hsize_t bytes = 0;
        uint32_t skipped = 0;
        good = H5Dget_chunk_storage_size(dataset, offset, &bytes) >= 0 && bytes <= room &&
               H5Dread_chunk(dataset, H5P_DEFAULT, offset, &skipped, w->packed + place_of(w, part)) >= 0 &&
               skipped == 0;
        w->batch.bytes[part] = bytes;
    }
    return good;
}

static bool same_total(const struct kiln_points_writer *w, struct kiln_global_point point, const float found[3])
{
    const struct kiln_surface *s = w->result->surface;
    float expected[KILN_FIELD_COMPONENTS_MAX];
    bool same = true;
    if (point.at >= s->first.at + s->count)
        memcpy(expected, (const float *)w->tail.column[w->total] + 3 * (point.at % w->chunk_rows),
               3 * sizeof *expected);
    else
        kiln_column_floats(column_at(w, w->total), w->result, kiln_own_of_global(s, point), expected);
    for (uint64_t c = 0; c < 3; c++)
        same = same && (found[c] == expected[c] || (isnan(expected[c]) && isnan(found[c])));
    return same;
}

static bool same_chunk(struct kiln_points_writer *w, uint64_t chunk)
{
    const size_t part = chunk * w->columns.count + w->total, place = place_of(w, part);
    const uint64_t first = (w->batch.first + chunk) * w->chunk_rows,
                   last = minimum(first + w->chunk_rows, w->result->surface->point_count);
    float *found = (float *)w->rows.column[w->total] + 3 * chunk * w->chunk_rows;
    if (kiln_chunk_unpack(w->packed + place, w->batch.bytes[part], 3 * w->chunk_rows, sizeof(float),
                          w->shuffled + place, found, NULL) != KILN_OK)
        return false;
    for (uint64_t point = first; point < last; point++)
        if (!same_total(w, (struct kiln_global_point){point}, found + 3 * (point - first)))
            return false;
    return true;
}

static bool same_totals(struct kiln_points_writer *w, hid_t dataset)
{
    bool same = dataset >= 0;
    for (uint64_t pass = 0; same && !kiln_stop_asked(w->result->stop); pass++) {
        batch_of(w, w->rank, pass, &w->batch.first, &w->batch.count);
        if (w->batch.count == 0)
            return true;
        same = read_packed(w, dataset);
#pragma omp parallel for schedule(dynamic, 1) reduction(&& : same)
        for (uint64_t chunk = 0; chunk < w->batch.count; chunk++)
            same = same && same_chunk(w, chunk);
    }
    return false;
}

int kiln_points_check(struct kiln_points_writer *w, const struct kiln_publish *place, struct kiln_error *error)
{
    const char *path = place->temporary;
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    const hid_t file = H5Fopen(place->opens, H5F_ACC_RDONLY, H5P_DEFAULT);
    int status = file < 0 ? kiln_fail(error, KILN_IO, "'%s' cannot be opened as HDF5", path) : KILN_OK;
    if (status == KILN_OK && !has_extents(file, &w->columns, w->result->surface->point_count))
        status = kiln_fail(error, KILN_IO, "'%s' does not contain all points", path);
    const hid_t dataset = status == KILN_OK ? H5Dopen2(file, TOTAL, H5P_DEFAULT) : H5I_INVALID_HID;
    if (status == KILN_OK && !same_totals(w, dataset))
        status = kiln_stop_asked(w->result->stop)
                     ? kiln_give_up(error)
                     : kiln_fail(error, KILN_IO, "'%s': %s does not read back as it was written", path, TOTAL);
    if (dataset >= 0)
        (void)H5Dclose(dataset);
    if (file >= 0)
        (void)H5Fclose(file);
    return kiln_agree(w->result->communicator, status, error);
}

uint64_t kiln_points_largest(const struct kiln_field_set *fields, uint64_t points)
{
    const uint64_t held =
        points < KILN_H5_CHUNK_ROWS ? points : round_up(points, KILN_H5_CHUNK_ROWS) * KILN_H5_CHUNK_ROWS;
    struct kiln_columns columns;
    kiln_columns_make(&columns, fields, true, true);
    return held * (kiln_columns_row(&columns) + 1) + (held / KILN_H5_CHUNK_ROWS + 1) * columns.count * 256;
}

/* ---- the writer ---- */

static int learn_starts(struct kiln_points_writer *w, struct kiln_error *error)
{
    const struct kiln_surface *s = w->result->surface;
    int status = kiln_allocate(&w->starts, (size_t)w->ranks + 1, sizeof *w->starts, "the ranks' first points", error);
    status = kiln_agree(w->result->communicator, status, error);
    if (status != KILN_OK)
        return status;
    if (MPI_Allgather(&s->first.at, 1, MPI_UINT64_T, w->starts, 1, MPI_UINT64_T, w->result->communicator) !=
        MPI_SUCCESS)
        return mpi_failed(error);
    w->starts[w->ranks] = s->point_count;
    if (w->starts[w->rank + 1] != s->first.at + s->count)
        status = kiln_fail(error, KILN_BUG,
                           "rank %d: its %llu points from %llu on are not followed by those of the next rank", w->rank,
                           (unsigned long long)s->count, (unsigned long long)s->first.at);
    return kiln_agree(w->result->communicator, status, error);
}

static int allocate(struct kiln_points_writer *w, struct kiln_error *error)
{
    const uint64_t own = minimum(first_chunk(w, w->rank + 1) - first_chunk(w, w->rank), w->at_once);
    const uint64_t held = w->rank == 0 ? minimum(first_chunk(w, w->ranks), w->at_once) : own;
    /* a rank without chunks needs one slot for the rows that it sends */
    const size_t chunks = own > 0 ? own : 1, places = place_in_chunk(w, w->columns.count);
    int status = kiln_rows_allocate(&w->rows, &w->columns, chunks * w->chunk_rows, error);
    if (status == KILN_OK)
        status = kiln_rows_allocate(&w->tail, &w->columns, w->chunk_rows, error);
    if (status == KILN_OK)
        status = kiln_allocate(&w->shuffled, chunks * places, 1, "points to write", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w->packed, (held > chunks ? held : chunks) * places, 1, "packed points", error);
    return status;
}

int kiln_points_writer_create(struct kiln_points_writer **writer, const struct kiln_bake_result *result,
                              const struct kiln_points_ahead *ahead, struct kiln_error *error)
{
    int status =
        kiln_agree(result->communicator, kiln_allocate(writer, 1, sizeof **writer, "points to write", error), error);
    if (status == KILN_OK) {
        struct kiln_points_writer *w = *writer;
        w->result = result;
        w->ahead = ahead;
        kiln_columns_of(&w->columns, result);
        w->total = kiln_columns_find(&w->columns, TOTAL);
        w->chunk_rows = minimum(result->surface->point_count, KILN_H5_CHUNK_ROWS);
        w->chunk_rows = w->chunk_rows == 0 ? 1 : w->chunk_rows;
        w->at_once = minimum(BATCH, 1 + BATCH * WIDE_ROW / (kiln_columns_row(&w->columns) + 1));
        for (size_t c = 0; c < w->columns.count; c++)
            w->datasets[c] = H5I_INVALID_HID;
        if (w->total == w->columns.count)
            status = kiln_fail(error, KILN_BUG, "this bake has no field for the dataset %s", TOTAL);
        if (MPI_Comm_rank(result->communicator, &w->rank) != MPI_SUCCESS ||
            MPI_Comm_size(result->communicator, &w->ranks) != MPI_SUCCESS)
            status = mpi_failed(error);
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
    kiln_rows_free(&w->rows);
    kiln_rows_free(&w->tail);
    kiln_free(&w->starts);
    kiln_free(&w->shuffled);
    kiln_free(&w->packed);
    kiln_free(writer);
}
