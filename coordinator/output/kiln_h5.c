#include <math.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/cli/agree.h"
#include "coordinator/output/h5.h"
#include "coordinator/output/output.h"
#include "coordinator/output/points.h"
#include "coordinator/output/provenance.h"
#include "coordinator/output/publish.h"
#include "worker/base/memory.h"

/* Rows of a chunk, and rows a rank writes at a time (a multiple of it, 27 MB in all). */
enum { CHUNK_ROWS = 1 << 14, PASS_ROWS = 1 << 18 };

enum field {
    FIELD_POSITION,
    FIELD_NORMAL,
    FIELD_OBJECT,
    FIELD_TEXEL,
    FIELD_AREA,
    FIELD_ALBEDO,
    FIELD_VALID,
    FIELD_CELL,
    FIELD_DIRECT,
    FIELD_INDIRECT,
    FIELD_TOTAL,
    FIELD_ERROR,
    FIELD_COUNT
};

struct field_info {
    const char *name;
    enum { DOUBLE, FLOAT, UINT32, UINT8 } type;
    hsize_t columns;
    const char *units, *description;
};

static const struct field_info fields[FIELD_COUNT] = {
    [FIELD_POSITION] = {"/points/position", DOUBLE, 3, "m", "world position of the centroid of the part of the surface in the texel"},
    [FIELD_NORMAL] = {"/points/normal", FLOAT, 3, "1", "unit shading normal there, world"},
    [FIELD_OBJECT] = {"/points/object", UINT32, 1, "1", "index into /objects"},
    [FIELD_TEXEL] = {"/points/texel", UINT32, 2, "texel", "x and y in the object's lightmap, from the top left, v = 0 at the top"},
    [FIELD_AREA] = {"/points/area", FLOAT, 1, "m2", "surface in the texel"},
    [FIELD_ALBEDO] = {"/points/albedo", FLOAT, 3, "1", "mean diffuse albedo, linear RGB"},
    [FIELD_VALID] = {"/points/valid", UINT8, 1, "1", "1 where light could be gathered; elsewhere /irradiance is 0 and lightmaps are filled from neighbours"},
    [FIELD_CELL] = {"/points/cell", UINT32, 1, "1", "index into /cells"},
    [FIELD_DIRECT] = {"/irradiance/direct", FLOAT, 3, "W m-2", "from lights, about the shading normal, linear RGB, as gathered: not filled and seams not smoothed (the lightmaps are)"},
    [FIELD_INDIRECT] = {"/irradiance/indirect", FLOAT, 3, "W m-2", "from other surfaces, about the shading normal, linear RGB, as gathered: not filled and seams not smoothed (the lightmaps are)"},
    [FIELD_TOTAL] = {"/irradiance/total", FLOAT, 3, "W m-2", "direct + indirect, as gathered: not filled and seams not smoothed (the lightmaps are)"},
    [FIELD_ERROR] = {"/irradiance/error", FLOAT, 1, "W m-2", "standard error of the luminance of total"},
};

static hid_t h5_type(const struct field_info *field)
{
    switch (field->type) {
    case DOUBLE:
        return H5T_NATIVE_DOUBLE;
    case FLOAT:
        return H5T_NATIVE_FLOAT;
    case UINT32:
        return H5T_NATIVE_UINT32;
    default:
        return H5T_NATIVE_UINT8;
    }
}

static size_t value_size(const struct field_info *field)
{
    return field->type == DOUBLE ? sizeof(double) : field->type == UINT8 ? 1 : sizeof(float);
}

struct points_writer {
    struct kiln_h5 h5;
    const struct kiln_bake_result *result;
    hid_t datasets[FIELD_COUNT];
    void *block[FIELD_COUNT];
    size_t fragment;  /* the next own fragment to describe */
    uint64_t passes;  /* the largest of all ranks */
};

/* ---- one block of own points ---- */

static void put_floats(void *block, uint64_t row, const float *values, int count)
{
    memcpy((float *)block + row * (uint64_t)count, values, (size_t)count * sizeof(float));
}

static void put_point(struct points_writer *w, uint64_t row, uint64_t own, const struct kiln_fragment *fragment,
                      const struct kiln_point_detail *detail)
{
    const struct kiln_surface *s = w->result->surface;
    const bool valid = kiln_point_valid(s, own);
    float albedo[3], light[3][3] = {{0}}, error = 0.0f;
    for (uint64_t c = 0; c < 3; c++) {
        albedo[c] = (float)s->albedo[3 * own + c] / 65535.0f;
        if (!valid)
            continue;
        light[0][c] = w->result->direct[3 * own + c];
        light[1][c] = w->result->indirect[3 * own + c];
        light[2][c] = light[0][c] + light[1][c];
        error = kiln_error_unpack(w->result->error[own]);
    }
    memcpy((double *)w->block[FIELD_POSITION] + 3 * row, detail->position, sizeof detail->position);
    put_floats(w->block[FIELD_NORMAL], row, detail->normal, 3);
    ((uint32_t *)w->block[FIELD_OBJECT])[row] = fragment->object;
    ((uint32_t *)w->block[FIELD_TEXEL])[2 * row] = detail->x;
    ((uint32_t *)w->block[FIELD_TEXEL])[2 * row + 1] = detail->y;
    put_floats(w->block[FIELD_AREA], row, &s->area[own], 1);
    put_floats(w->block[FIELD_ALBEDO], row, albedo, 3);
    ((uint8_t *)w->block[FIELD_VALID])[row] = valid;
    ((uint32_t *)w->block[FIELD_CELL])[row] = fragment->cell;
    put_floats(w->block[FIELD_DIRECT], row, light[0], 3);
    put_floats(w->block[FIELD_INDIRECT], row, light[1], 3);
    put_floats(w->block[FIELD_TOTAL], row, light[2], 3);
    put_floats(w->block[FIELD_ERROR], row, &error, 1);
}

/* Global points [first, last), all own. A fragment on the border is described in both blocks. */
static void fill_block(struct points_writer *w, uint64_t first, uint64_t last)
{
    const struct kiln_surface *s = w->result->surface;
    struct kiln_point_detail details[KILN_TILE_TEXELS];
    while (w->fragment < s->fragment_count && s->fragments[w->fragment].first < last) {
        const struct kiln_fragment *fragment = &s->fragments[w->fragment];
        const uint32_t count = kiln_fragment_details(w->result, w->fragment, details);
        for (uint32_t i = 0; i < count; i++) {
            const uint64_t point = fragment->first + i;
            if (point >= first && point < last)
                put_point(w, point - first, point - s->first, fragment, &details[i]);
        }
        if (fragment->first + count > last)
            return;
        w->fragment++;
    }
}

/* Pass `pass` of this rank: between multiples of the chunk, so that only chunks at a rank's border are written twice. */
static void pass_range(const struct kiln_surface *s, uint64_t pass, uint64_t *first, uint64_t *last)
{
    const uint64_t start = s->first / CHUNK_ROWS * CHUNK_ROWS + pass * PASS_ROWS, end = s->first + s->count;
    *first = start < s->first ? s->first : start < end ? start : end;
    *last = start + PASS_ROWS < end ? start + PASS_ROWS : end;
    if (*last < *first)
        *last = *first;
}

/* ---- the file ---- */

static int make_points(struct points_writer *w, struct kiln_error *error)
{
    const uint64_t points = w->result->surface->point_count;
    for (int f = 0; f < FIELD_COUNT; f++) {
        const struct kiln_h5_dataset what = {.name = fields[f].name, .type = h5_type(&fields[f]), .rank = fields[f].columns > 1 ? 2 : 1,
                                             .size = {points, fields[f].columns}, .units = fields[f].units,
                                             .chunk = {points < CHUNK_ROWS ? points : CHUNK_ROWS, fields[f].columns},
                                             .description = fields[f].description};
        const int status = kiln_h5_make(&w->h5, &what, &w->datasets[f], error);
        if (status != KILN_OK)
            return status;
    }
    return KILN_OK;
}

static int count_passes(struct points_writer *w, struct kiln_error *error)
{
    const struct kiln_surface *s = w->result->surface;
    uint64_t passes = s->count == 0 ? 0 : (s->first % CHUNK_ROWS + s->count + PASS_ROWS - 1) / PASS_ROWS;
    if (MPI_Allreduce(&passes, &w->passes, 1, MPI_UINT64_T, MPI_MAX, w->result->communicator) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI failed while '%s' was written", w->h5.path);
    const size_t rows = s->count < PASS_ROWS ? s->count : PASS_ROWS;
    int status = KILN_OK;
    for (int f = 0; status == KILN_OK && f < FIELD_COUNT; f++)
        status = kiln_allocate(&w->block[f], rows * fields[f].columns, value_size(&fields[f]), "points to write", error);
    return kiln_agree(w->result->communicator, status, error);
}

static int write_points(struct points_writer *w, struct kiln_error *error)
{
    int status = make_points(w, error);
    if (status == KILN_OK)
        status = count_passes(w, error);
    for (uint64_t pass = 0; status == KILN_OK && pass < w->passes; pass++) {
        uint64_t first, last;
        pass_range(w->result->surface, pass, &first, &last);
        fill_block(w, first, last);
        for (int f = 0; status == KILN_OK && f < FIELD_COUNT; f++)
            status = kiln_h5_write_rows(&w->h5, w->datasets[f], fields[f].name, h5_type(&fields[f]), first, last - first, w->block[f], error);
    }
    for (int f = 0; f < FIELD_COUNT; f++)
        if (w->datasets[f] >= 0 && H5Dclose(w->datasets[f]) < 0 && status == KILN_OK)
            status = kiln_h5_failed(&w->h5, "close the dataset", fields[f].name, error);
    return kiln_agree(w->result->communicator, status, error);
}

/* Names as one table of fixed-length strings, which every HDF5 reads. */
static int write_names(struct kiln_h5 *h5, const struct kiln_scene *scene, struct kiln_error *error)
{
    size_t length = 1;
    char *table = NULL;
    for (size_t i = 0; i < scene->object_count; i++) {
        const size_t own = strlen(kiln_scene_string(scene, scene->objects[i].name));
        length = own > length ? own : length;
    }
    int status = kiln_allocate(&table, scene->object_count, length, "object names", error);
    if ((status = kiln_agree(h5->communicator, status, error)) != KILN_OK)
        return status;
    for (size_t i = 0; i < scene->object_count; i++) {
        const char *name = kiln_scene_string(scene, scene->objects[i].name);
        memcpy(table + i * length, name, strlen(name));
    }
    const hid_t type = H5Tcopy(H5T_C_S1);
    if (type < 0 || H5Tset_size(type, length) < 0 || H5Tset_strpad(type, H5T_STR_NULLPAD) < 0 || H5Tset_cset(type, H5T_CSET_UTF8) < 0)
        status = kiln_h5_failed(h5, "describe", "/objects/name", error);
    const struct kiln_h5_dataset what = {.name = "/objects/name", .type = type, .rank = 1, .size = {scene->object_count}, .units = "1",
                                         .description = "the object's name; its lightmap is lightmaps/NAME.exr"};
    if (status == KILN_OK)
        status = kiln_h5_small(h5, &what, table, error);
    if (type >= 0 && H5Tclose(type) < 0 && status == KILN_OK)
        status = kiln_h5_failed(h5, "release the type of", "/objects/name", error);
    kiln_free(&table);
    return status;
}

static int write_objects(struct kiln_h5 *h5, const struct kiln_scene *scene, struct kiln_error *error)
{
    uint32_t *meshes = NULL, *sizes = NULL;
    int status = kiln_allocate(&meshes, scene->object_count, sizeof *meshes, "objects", error);
    if (status == KILN_OK)
        status = kiln_allocate(&sizes, scene->object_count, 2 * sizeof *sizes, "objects", error);
    for (size_t i = 0; status == KILN_OK && i < scene->object_count; i++) {
        meshes[i] = scene->objects[i].mesh;
        sizes[2 * i] = scene->objects[i].lightmap_width;
        sizes[2 * i + 1] = scene->objects[i].lightmap_height;
    }
    const struct kiln_h5_dataset mesh = {.name = "/objects/mesh", .type = H5T_NATIVE_UINT32, .rank = 1, .size = {scene->object_count},
                                         .units = "1", .description = "index of the object's mesh; objects of one mesh are instances"};
    const struct kiln_h5_dataset size = {.name = "/objects/lightmap", .type = H5T_NATIVE_UINT32, .rank = 2,
                                         .size = {scene->object_count, 2}, .units = "texel", .description = "width and height of the lightmap"};
    status = kiln_agree(h5->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_h5_small(h5, &mesh, meshes, error);
    if (status == KILN_OK)
        status = kiln_h5_small(h5, &size, sizes, error);
    kiln_free(&meshes);
    kiln_free(&sizes);
    return status == KILN_OK ? write_names(h5, scene, error) : status;
}

/* Sums an array of any length over the ranks, in place. */
static int sum_over_ranks(MPI_Comm communicator, uint64_t *values, uint64_t count, struct kiln_error *error)
{
    for (uint64_t first = 0; first < count; first += 1u << 24) {
        const uint64_t left = count - first;
        if (MPI_Allreduce(MPI_IN_PLACE, values + first, (int)(left < 1u << 24 ? left : 1u << 24), MPI_UINT64_T, MPI_SUM, communicator) !=
            MPI_SUCCESS)
            return kiln_fail(error, KILN_RANK_LOST, "MPI failed while the points of cells were counted");
    }
    return KILN_OK;
}

static int write_cells(struct kiln_h5 *h5, const struct kiln_surface *s, struct kiln_error *error)
{
    uint64_t *points = NULL;
    int status = kiln_agree(h5->communicator, kiln_allocate(&points, s->cell_count, sizeof *points, "points of cells", error), error);
    if (status != KILN_OK)
        return status;
    for (size_t f = 0; f < s->fragment_count; f++)
        points[s->fragments[f].cell] += s->fragments[f].count;
    const struct kiln_h5_dataset counts = {.name = "/cells/points", .type = H5T_NATIVE_UINT64, .rank = 1, .size = {s->cell_count},
                                           .units = "1", .description = "surface points in each occupied cell, in Morton order of cells"};
    const struct kiln_h5_dataset first = {.name = "/cells/first", .type = H5T_NATIVE_UINT64, .rank = 1, .size = {s->cell_count},
                                          .units = "1", .description = "index of the cell's first point in /points"};
    status = sum_over_ranks(h5->communicator, points, s->cell_count, error);
    if (status == KILN_OK)
        status = kiln_h5_small(h5, &counts, points, error);
    if (status == KILN_OK && s->cell_first != NULL) /* points are in the order of objects otherwise: a cell's are not together */
        status = kiln_h5_small(h5, &first, s->cell_first, error);
    kiln_free(&points);
    return status;
}

static int write_attributes(struct kiln_h5 *h5, const struct kiln_bake_result *result, const struct kiln_output_params *params,
                            struct kiln_error *error)
{
    const int32_t version = 1;
    const char *provenance = params->provenance_json == NULL ? "{}" : params->provenance_json;
    int64_t seed;
    const bool has_seed = kiln_provenance_seed(params->provenance_json, &seed);
    int status = kiln_h5_attribute_text(h5, "/", "format", "kiln bake", error);
    if (status == KILN_OK)
        status = kiln_h5_attribute(h5, "/", "format_version", H5T_NATIVE_INT32, &version, 1, error);
    if (status == KILN_OK)
        status = kiln_h5_attribute_text(h5, "/", "kiln_version", KILN_VERSION, error);
    if (status == KILN_OK)
        status = kiln_h5_attribute_text(h5, "/", "provenance", provenance, error);
    if (status == KILN_OK && has_seed)
        status = kiln_h5_attribute(h5, "/", "seed", H5T_NATIVE_INT64, &seed, 1, error);
    if (status == KILN_OK)
        status = kiln_h5_attribute(h5, "/", "centre", H5T_NATIVE_DOUBLE, result->scene->header->centre, 3, error);
    return kiln_agree(result->communicator, status, error);
}

static int write_all(struct points_writer *w, const struct kiln_output_params *params, struct kiln_error *error)
{
    static const char *const groups[] = {"/points", "/irradiance", "/objects", "/cells"};
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < sizeof groups / sizeof *groups; i++)
        status = kiln_h5_group(&w->h5, groups[i], error);
    status = kiln_agree(w->result->communicator, status, error);
    if (status == KILN_OK)
        status = write_attributes(&w->h5, w->result, params, error);
    if (status == KILN_OK)
        status = write_objects(&w->h5, w->result->scene, error);
    if (status == KILN_OK)
        status = write_cells(&w->h5, w->result->surface, error);
    if (status == KILN_OK)
        status = write_points(w, error);
    return status;
}

/* ---- reading back ---- */

static int check_extent(const struct points_writer *w, struct kiln_error *error)
{
    for (int f = 0; f < FIELD_COUNT; f++) {
        const hid_t dataset = H5Dopen2(w->h5.file, fields[f].name, H5P_DEFAULT);
        const hid_t space = dataset < 0 ? H5I_INVALID_HID : H5Dget_space(dataset);
        hsize_t size[KILN_H5_RANK_MAX] = {0};
        const bool right = space >= 0 && H5Sget_simple_extent_dims(space, size, NULL) == (fields[f].columns > 1 ? 2 : 1) &&
                           size[0] == w->result->surface->point_count;
        if (space >= 0)
            (void)H5Sclose(space);
        if (dataset >= 0)
            (void)H5Dclose(dataset);
        if (!right)
            return kiln_h5_failed(&w->h5, "read back", fields[f].name, error);
    }
    return KILN_OK;
}

/* The whole of /irradiance/total must be what it was made from; the block is this rank's own from the last pass on. */
static int check_total(struct points_writer *w, struct kiln_error *error)
{
    const struct kiln_surface *s = w->result->surface;
    const char *name = fields[FIELD_TOTAL].name;
    const hid_t dataset = H5Dopen2(w->h5.file, name, H5P_DEFAULT);
    int status = kiln_agree(w->result->communicator, dataset < 0 ? kiln_h5_failed(&w->h5, "open", name, error) : KILN_OK, error);
    for (uint64_t pass = 0; status == KILN_OK && pass < w->passes; pass++) {
        uint64_t first, last;
        float *found = w->block[FIELD_TOTAL];
        pass_range(s, pass, &first, &last);
        status = kiln_h5_read_rows(&w->h5, dataset, name, H5T_NATIVE_FLOAT, first, last - first, found, error);
        bool same = true;
        for (uint64_t i = 3 * (first - s->first); status == KILN_OK && i < 3 * (last - s->first); i++, found++) {
            const float expected = !kiln_point_valid(s, i / 3) ? 0.0f : w->result->direct[i] + w->result->indirect[i];
            same = same && (*found == expected || (isnan(expected) && isnan(*found)));
        }
        if (status == KILN_OK)
            status = kiln_agree(w->result->communicator,
                                same ? KILN_OK : kiln_fail(error, KILN_IO, "'%s': %s does not read back as it was written", w->h5.path, name), error);
    }
    if (dataset >= 0)
        (void)H5Dclose(dataset);
    return status;
}

static int read_back(struct points_writer *w, const char *path, struct kiln_error *error)
{
    int status = kiln_h5_open(&w->h5, w->result->communicator, path, error);
    if (status != KILN_OK)
        return status;
    status = kiln_agree(w->result->communicator, check_extent(w, error), error);
    if (status == KILN_OK)
        status = check_total(w, error);
    return kiln_h5_close(&w->h5, status, error);
}

/* What the file takes if nothing in it could be compressed. */
static uint64_t largest_size(const struct kiln_bake_result *result)
{
    uint64_t row = 0;
    for (int f = 0; f < FIELD_COUNT; f++)
        row += fields[f].columns * value_size(&fields[f]);
    const uint64_t rows = (result->surface->point_count + CHUNK_ROWS - 1) / CHUNK_ROWS * CHUNK_ROWS;
    const uint64_t held = result->surface->point_count < CHUNK_ROWS ? result->surface->point_count : rows;
    return held * row + result->scene->object_count * 300 + result->surface->cell_count * 16 + (1 << 17);
}

int kiln_write_h5(const struct kiln_bake_result *result, const struct kiln_output_params *params, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], temporary[KILN_PATH_SIZE];
    struct points_writer w = {.result = result};
    for (int f = 0; f < FIELD_COUNT; f++)
        w.datasets[f] = H5I_INVALID_HID;
    int rank = 0;
    if (MPI_Comm_rank(result->communicator, &rank) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI does not tell this rank's number");
    int status = kiln_path_join(path, params->directory, "kiln.h5", error);
    if (status == KILN_OK) /* every rank needs the name; removing a left-over twice does no harm before the agreement */
        status = kiln_publish_name(temporary, path, error);
    if (status == KILN_OK && rank == 0)
        status = kiln_require_space(params->directory, largest_size(result), error);
    status = kiln_agree(result->communicator, status, error);
    if (status != KILN_OK)
        return status;
    status = kiln_h5_create(&w.h5, result->communicator, temporary, error);
    if (status == KILN_OK) {
        status = write_all(&w, params, error);
        status = kiln_agree(result->communicator, kiln_h5_close(&w.h5, status, error), error);
    }
    if (status == KILN_OK)
        status = kiln_agree(result->communicator, read_back(&w, temporary, error), error);
    for (int f = 0; f < FIELD_COUNT; f++)
        kiln_free(&w.block[f]);
    if (rank == 0 && status != KILN_OK)
        kiln_publish_abandon(temporary);
    if (status == KILN_OK)
        status = kiln_agree(result->communicator, rank == 0 ? kiln_publish_finish(temporary, path, error) : KILN_OK, error);
    return status;
}
