#include <math.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/output/chunk.h"
#include "coordinator/output/kiln_h5_points_private.h"

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
    bool good = true;
    for (uint64_t chunk = 0; good && chunk < w->count; chunk++) {
        const size_t slot = chunk * w->columns.count + w->total;
        const hsize_t offset[2] = {(w->first + chunk) * w->chunk_rows, 0};
        hsize_t bytes = 0;
        uint32_t skipped = 0;
        good = H5Dget_chunk_storage_size(dataset, offset, &bytes) >= 0 && bytes == w->sizes[points_part(w, slot)] &&
               H5Dread_chunk(dataset, H5P_DEFAULT, offset, &skipped, w->packed + points_slot(w, slot)) >= 0 &&
               skipped == 0;
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
        kiln_column_floats(points_column(w, w->total), w->result, kiln_own_of_global(s, point), 1, expected);
    for (uint64_t c = 0; c < 3; c++)
        same = same && (found[c] == expected[c] || (isnan(expected[c]) && isnan(found[c])));
    return same;
}

static bool same_chunk(struct kiln_points_writer *w, uint64_t chunk)
{
    const size_t slot = chunk * w->columns.count + w->total, place = points_slot(w, slot);
    const uint64_t first = (w->first + chunk) * w->chunk_rows,
                   last = points_minimum(first + w->chunk_rows, w->result->surface->point_count);
    float *found = (float *)w->rows.column[w->total] + 3 * chunk * w->chunk_rows;
    if (kiln_chunk_unpack(w->packed + place, w->sizes[points_part(w, slot)], 3 * w->chunk_rows, sizeof(float),
                          points_shuffled(w), found, NULL) != KILN_OK)
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
        if (!points_batch(w, pass))
            return true;
        same = read_packed(w, dataset);
#pragma omp parallel for schedule(dynamic, 1) num_threads(w->threads) reduction(&& : same)
        for (uint64_t chunk = 0; chunk < w->count; chunk++)
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
    const hid_t dataset = status == KILN_OK ? H5Dopen2(file, POINTS_TOTAL, H5P_DEFAULT) : H5I_INVALID_HID;
    if (status == KILN_OK && !same_totals(w, dataset))
        status = kiln_stop_asked(w->result->stop)
                     ? kiln_give_up(error)
                     : kiln_fail(error, KILN_IO, "'%s': %s does not read back as it was written", path, POINTS_TOTAL);
    if (dataset >= 0)
        (void)H5Dclose(dataset);
    if (file >= 0)
        (void)H5Fclose(file);
    return kiln_agree(w->result->communicator, status, error);
}
