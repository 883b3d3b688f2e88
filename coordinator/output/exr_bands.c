#include "coordinator/output/exr_bands.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "coordinator/files/publish.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/exr_private.h"
#include "coordinator/output/exr_strips.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

enum { PLACE = 8, HEADER = 8 }; /* bytes of a strip in the table, and of its row and size before it */

struct band {
    MPI_Comm communicator;
    int rank;
    const struct kiln_image *image;
    uint32_t first_row, strips; /* strips: of this band */
    struct kiln_exr_strip *packed;
    struct kiln_publish place;
    int descriptor;
    bool there;            /* this rank has created the file */
    uint64_t table, begin; /* position of the whole file's table, and of this band's strips */
};

static uint32_t strips_of(uint32_t rows) { return (rows + KILN_EXR_ROWS - 1) / KILN_EXR_ROWS; }

static void put_number(uint8_t *bytes, uint64_t number, int size)
{
    for (int i = 0; i < size; i++)
        bytes[i] = (uint8_t)(number >> (8 * i)); /* OpenEXR is little-endian */
}

/* ---- packing ---- */

static int pack_all(struct band *b, struct kiln_error *error)
{
    int status = kiln_allocate(&b->packed, b->strips, sizeof *b->packed, "a lightmap's strips", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 1)
    for (uint32_t s = 0; s < b->strips; s++) {
        struct kiln_error mine = {{0}};
        const int result = kiln_exr_strip_pack(b->image, s * KILN_EXR_ROWS, &b->packed[s], &mine);
        if (result == KILN_OK)
            continue;
#pragma omp critical(kiln_pack_band)
        status = kiln_fail(error, result, "%s", mine.message);
    }
    return status;
}

/* Finds where this band's strips go. */
static int place_strips(struct band *b, uint64_t strips_of_all, struct kiln_error *error)
{
    uint64_t size = 0, before = 0;
    for (uint32_t s = 0; s < b->strips; s++)
        size += HEADER + b->packed[s].size;
    if (MPI_Exscan(&size, &before, 1, MPI_UINT64_T, MPI_SUM, b->communicator) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI failed while a lightmap was written by all ranks");
    b->begin = b->table + PLACE * strips_of_all + (b->rank == 0 ? 0 : before);
    return KILN_OK;
}

/* ---- the file ---- */

/* The first rank creates the file, with its header. */
static int create_file(struct band *b, const char *directory, const char *name, const uint8_t *header, size_t size,
                       struct kiln_error *error)
{
    int status = kiln_publish_begin(&b->place, directory, name, error);
    if (status == KILN_OK)
        status = kiln_publish_open(&b->place, &b->descriptor, error);
    b->there = status == KILN_OK;
    return status == KILN_OK ? kiln_write_all(b->descriptor, header, size, 0, b->place.temporary, error) : status;
}

/* Writes the strips one after the other, and their entries in the table. */
static int write_strips(const struct band *b, struct kiln_error *error)
{
    uint64_t at = b->begin;
    uint8_t *places = NULL;
    int status = kiln_allocate(&places, b->strips, PLACE, "a lightmap's table of strips", error);
    for (uint32_t s = 0; s < b->strips && status == KILN_OK; s++) {
        uint8_t header[HEADER];
        put_number(places + (size_t)s * PLACE, at, PLACE);
        put_number(header, b->first_row + (uint64_t)s * KILN_EXR_ROWS, 4);
        put_number(header + 4, b->packed[s].size, 4);
        status = kiln_write_all(b->descriptor, header, HEADER, at, b->place.temporary, error);
        if (status == KILN_OK)
            status = kiln_write_all(b->descriptor, b->packed[s].bytes, b->packed[s].size, at + HEADER,
                                    b->place.temporary, error);
        at += HEADER + b->packed[s].size;
    }
    if (status == KILN_OK)
        status = kiln_write_all(b->descriptor, places, (size_t)b->strips * PLACE,
                                b->table + (uint64_t)b->first_row / KILN_EXR_ROWS * PLACE, b->place.temporary, error);
    kiln_free(&places);
    return status;
}

/* Whether the strip reads back with the hash that it was packed with. */
static bool same_strip(const struct band *b, uint32_t strip, uint64_t at)
{
    const size_t size = b->packed[strip].size;
    uint8_t *bytes = b->packed[strip].bytes; /* of no more use */
    size_t done = 0;
    memset(bytes, 0, size);
    while (done < size) {
        const ssize_t got = pread(b->descriptor, bytes + done, size - done, (off_t)(at + done));
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return false;
        done += (size_t)got;
    }
    return XXH3_64bits(bytes, size) == b->packed[strip].hash;
}

static int read_back(const struct band *b, struct kiln_error *error)
{
    uint64_t at = b->begin;
    for (uint32_t s = 0; s < b->strips; s++) {
        if (!same_strip(b, s, at + HEADER))
            return kiln_fail(error, KILN_IO, "'%s' does not read back as it was written: row %u and the following",
                             b->place.temporary, b->first_row + s * KILN_EXR_ROWS);
        at += HEADER + b->packed[s].size;
    }
    return KILN_OK;
}

/* Each rank syncs what it has written. */
static int end_part(struct band *b, struct kiln_error *error)
{
    int status = read_back(b, error);
    if (status == KILN_OK && kiln_fsync(b->descriptor) != 0)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be synced to disk", b->place.temporary);
    if (kiln_close(b->descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be closed", b->place.temporary);
    b->descriptor = -1;
    return status;
}

static int write_file(struct band *b, const char *directory, const char *name, const uint8_t *header, size_t size,
                      uint64_t strips, struct kiln_error *error)
{
    int status = b->rank == 0 ? create_file(b, directory, name, header, size, error) : KILN_OK;
    if ((status = kiln_agree(b->communicator, status, error)) != KILN_OK)
        return status;
    if ((status = place_strips(b, strips, error)) == KILN_OK && b->rank != 0 && b->strips > 0)
        status = kiln_publish_join(&b->place, directory, name, &b->descriptor, error);
    if (status == KILN_OK && b->strips > 0)
        status = write_strips(b, error);
    if (status == KILN_OK && b->descriptor >= 0)
        status = end_part(b, error);
    status = kiln_agree(b->communicator, status, error);
    if (status == KILN_OK && b->rank == 0) {
        b->there = false; /* kiln_publish_finish removes it if it cannot be published */
        status = kiln_publish_finish(&b->place, error);
    }
    return kiln_agree(b->communicator, status, error);
}

static void end_band(struct band *b)
{
    if (b->descriptor >= 0)
        (void)close(b->descriptor);
    if (b->there)
        kiln_publish_abandon(&b->place);
    kiln_publish_close(&b->place);
    for (uint32_t s = 0; b->packed != NULL && s < b->strips; s++)
        kiln_free(&b->packed[s].bytes);
    kiln_free(&b->packed);
}

int kiln_exr_write_bands(MPI_Comm communicator, const char *directory, const char *name, const struct kiln_image *image,
                         uint32_t first_row, uint32_t height, const struct kiln_exr_attribute *attributes,
                         size_t attribute_count, bool fails, struct kiln_error *error)
{
    struct band b = {.communicator = communicator,
                     .image = image,
                     .first_row = first_row,
                     .strips = strips_of(image->height),
                     .place = {.folder = {.descriptor = -1}, .stream = -1, .scratch = -1},
                     .descriptor = -1};
    uint8_t *header = NULL;
    size_t size = 0;
    if (MPI_Comm_rank(communicator, &b.rank) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI cannot give the rank number");
    int status;
    KILN_TRY(image->height > 0 ? exr_check_image(name, image, error) : KILN_OK);
    KILN_TRY(exr_make_header(name, image, height, attributes, attribute_count, &header, &size, error));
    KILN_TRY(fails ? kiln_fail(error, KILN_SYSTEM, "KILN_FAILING_PACKER wants packing to fail here")
                   : pack_all(&b, error));
end:
    b.table = size;
    status = kiln_agree(communicator, status, error);
    if (status == KILN_OK)
        status = write_file(&b, directory, name, header, size, strips_of(height), error);
    end_band(&b);
    kiln_free(&header);
    return status;
}
