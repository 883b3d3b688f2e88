#include "coordinator/mpi/agree.h"
#include "coordinator/output/kiln_h5_points_private.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"
#include "worker/base/thread.h"

enum { TAG_SIZES = 41, TAG_ADDRESSES = 42 };

/* ---- datasets ---- */

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

static int make_datasets(struct kiln_points_writer *w, struct kiln_error *error)
{
    const uint64_t points = w->result->surface->point_count;
    int status = KILN_OK;
    for (size_t c = 0; status == KILN_OK && c < w->columns.count; c++) {
        const struct kiln_column *info = points_column(w, c);
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
            status = kiln_h5_failed(w->h5, "close the dataset", points_column(w, c)->name, error);
        w->datasets[c] = H5I_INVALID_HID;
    }
    return status;
}

/* ---- places ---- */

/* Rank 0. Gives places to the parts of `chunks` chunks from number `first` on, in the order of the file. */
static int place_parts(struct kiln_points_writer *w, uint64_t first, uint64_t chunks, const uint32_t *sizes,
                       uint64_t *addresses, struct kiln_error *error)
{
    int status = KILN_OK;
    for (uint64_t part = 0; status == KILN_OK && part < chunks * w->columns.count; part++) {
        const size_t column = part % w->columns.count;
        const hsize_t at[2] = {(first + part / w->columns.count) * w->chunk_rows, 0};
        status = kiln_h5_place(w->h5, w->datasets[column], points_column(w, column)->name, at, sizes[part],
                               &addresses[part], error);
    }
    return status;
}

/* Rank 0. Receives the sizes of another rank's parts, and sends back their places, even after a failure. */
static int place_for(struct kiln_points_writer *w, int rank, int status, struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    const uint64_t parts = points_parts(w, rank);
    if (parts == 0)
        return status;
    if (MPI_Recv(w->their_sizes, (int)parts, MPI_UINT32_T, rank, TAG_SIZES, comm, MPI_STATUS_IGNORE) != MPI_SUCCESS)
        return points_mpi_failed(error);
    if (status == KILN_OK)
        status = place_parts(w, points_first_chunk(w, rank), parts / w->columns.count, w->their_sizes,
                             w->their_addresses, error);
    return MPI_Send(w->their_addresses, (int)parts, MPI_UINT64_T, rank, TAG_ADDRESSES, comm) == MPI_SUCCESS
               ? status
               : points_mpi_failed(error);
}

/* Rank 0. Reserves places for all ranks in their order, so that places do not depend on the number of ranks. */
static int place_for_all(struct kiln_points_writer *w, struct kiln_error *error)
{
    int status = place_parts(w, 0, points_first_chunk(w, 1), w->sizes, w->addresses, error);
    for (int r = 1; r < w->ranks; r++)
        status = place_for(w, r, status, error);
    return status;
}

static int ask_places(struct kiln_points_writer *w, struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    const int parts = (int)points_parts(w, w->rank);
    if (parts > 0 &&
        (MPI_Send(w->sizes, parts, MPI_UINT32_T, 0, TAG_SIZES, comm) != MPI_SUCCESS ||
         MPI_Recv(w->addresses, parts, MPI_UINT64_T, 0, TAG_ADDRESSES, comm, MPI_STATUS_IGNORE) != MPI_SUCCESS))
        return points_mpi_failed(error);
    return KILN_OK;
}

/* ---- writing ---- */

/* A batch that a thread writes while the next one is packed. There is only one such thread: the system lets one at a
 * time write to a file, and waiting threads would take processors away from packing. */
struct writing {
    struct kiln_points_writer *w;
    int descriptor;
    const char *path;
    const uint8_t *packed;
    uint64_t part; /* the first of the batch */
    size_t slots;
    pthread_t thread;
    bool runs;
    int status;
    struct kiln_error error;
};

/* Writes the batch's parts, which were kept, packed ahead, or are in their slots. */
static void *write_parts(void *context)
{
    struct writing *b = context;
    struct kiln_points_writer *w = b->w;
    b->status = KILN_OK;
    for (size_t slot = 0; b->status == KILN_OK && slot < b->slots; slot++) {
        const uint64_t part = b->part + slot;
        size_t size = 0;
        const void *bytes = w->kept[part] != NULL ? w->kept[part] : points_ahead_part(w, part, &size);
        b->status = kiln_write_all(b->descriptor, bytes != NULL ? bytes : b->packed + points_slot(w, slot),
                                   w->sizes[part], w->addresses[part], b->path, &b->error);
        kiln_free(&w->kept[part]);
    }
    if (b->status == KILN_OK && b->slots > 0) {
        const uint64_t last = b->part + b->slots - 1;
        kiln_begin_sync(b->descriptor, w->addresses[b->part], w->addresses[last] + w->sizes[last]);
    }
    return NULL;
}

/* Waits until the batch is written; its error, unless there is one already. */
static int end_writing(struct writing *b, int status, struct kiln_error *error)
{
    if (b->runs)
        (void)pthread_join(b->thread, NULL);
    b->runs = false;
    return status == KILN_OK && b->status != KILN_OK ? kiln_fail(error, b->status, "%s", b->error.message) : status;
}

/* Waits for the previous batch, and starts writing the present one. */
static int begin_writing(struct writing *b, struct kiln_error *error)
{
    struct kiln_points_writer *w = b->w;
    const int status = end_writing(b, KILN_OK, error);
    if (status != KILN_OK)
        return status;
    uint8_t *const packed = w->packed;
    w->packed = w->spare;
    w->spare = packed;
    b->packed = packed;
    b->part = points_part(w, 0);
    b->slots = w->count * w->columns.count;
    b->runs = kiln_thread_start(&b->thread, write_parts, b);
    if (!b->runs)
        (void)write_parts(b);
    return KILN_OK;
}

static int pack_next(struct kiln_points_writer *w, struct kiln_error *error)
{
    return kiln_stop_asked(w->result->stop) ? kiln_give_up(error) : points_pack(w, error);
}

/* Writes the points if there is a single rank, which knows the next place in the file at once. */
static int write_alone(struct kiln_points_writer *w, struct writing *writing, struct kiln_error *error)
{
    int status = KILN_OK;
    for (uint64_t pass = 0; points_batch(w, pass); pass++) {
        const uint64_t part = points_part(w, 0);
        KILN_TRY(pack_next(w, error));
        KILN_TRY(place_parts(w, w->first, w->count, w->sizes + part, w->addresses + part, error));
        KILN_TRY(begin_writing(writing, error));
    }
end:
    return status;
}

static int write_together(struct kiln_points_writer *w, struct writing *writing, struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    int status = KILN_OK;
    for (uint64_t pass = 0; status == KILN_OK && points_batch(w, pass); pass++)
        status = pack_next(w, error);
    status = kiln_agree(comm, status, error);
    if (status == KILN_OK)
        status = kiln_agree(comm, w->rank == 0 ? place_for_all(w, error) : ask_places(w, error), error);
    for (uint64_t pass = 0; status == KILN_OK && points_batch(w, pass); pass++) {
        status = pack_next(w, error);
        if (status == KILN_OK)
            status = begin_writing(writing, error);
    }
    return status;
}

int kiln_points_write(struct kiln_points_writer *w, struct kiln_h5 *h5, int descriptor, const char *path,
                      struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    w->h5 = h5;
    int status = points_share_borders(w, error);
    if (status == KILN_OK)
        status = kiln_agree(comm, w->rank == 0 ? make_datasets(w, error) : KILN_OK, error);
    struct writing writing = {.w = w, .descriptor = descriptor, .path = path};
    if (status == KILN_OK)
        status = w->ranks == 1 ? write_alone(w, &writing, error) : write_together(w, &writing, error);
    status = end_writing(&writing, status, error);
    if (w->rank == 0)
        status = close_datasets(w, status, error);
    return kiln_agree(comm, status, error);
}
