#include <math.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/job/options.h"
#include "coordinator/output/h5.h"
#include "coordinator/output/output.h"
#include "coordinator/files/publish.h"
#include "coordinator/output/volume_eval.h"
#include "worker/base/memory.h"
#include "worker/sampling/harmonics.h"

enum { CHUNK_SIDE = 16 };

struct volume_writer {
    struct kiln_h5 h5;
    const struct kiln_bake_result *result;
    const struct kiln_volume_result *volume;
    float *values; /* own probes x components of one array */
};

/* Adds a box of probes to the selection of the dataset. */
static bool add_box(hid_t space, const hsize_t start[4], const hsize_t size[4], bool first)
{
    return H5Sselect_hyperslab(space, first ? H5S_SELECT_SET : H5S_SELECT_OR, start, NULL, size, NULL) >= 0;
}

/* Selects a range of probes in z-major order, which consists of at most five boxes: part of a row, rows, planes, rows,
 * part of a row. */
static bool select_range(hid_t space, const uint64_t size[3], uint64_t first, uint64_t count, hsize_t components)
{
    const uint64_t row = size[0], plane = size[0] * size[1], end = first + count;
    if (count == 0)
        return H5Sselect_none(space) >= 0;
    bool good = true;
    for (uint64_t at = first, step; good && at < end; at += step) {
        const hsize_t start[4] = {at / plane, at / row % size[1], at % row, 0};
        hsize_t box[4] = {1, 1, 1, components};
        if (at % plane == 0 && end - at >= plane) {
            box[0] = (end - at) / plane;
            box[1] = size[1];
            box[2] = row;
        } else if (at % row == 0 && end - at >= row) {
            const uint64_t left = size[1] - start[1], rows = (end - at) / row;
            box[1] = rows < left ? rows : left;
            box[2] = row;
        } else {
            box[2] = row - start[2] < end - at ? row - start[2] : end - at;
        }
        good = add_box(space, start, box, at == first);
        step = box[0] * box[1] * box[2];
    }
    return good;
}

/* `values`: own probes x components. */
static int write_array(struct volume_writer *w, const char *name, const float *values, uint64_t components,
                       const char *units, const char *description, struct kiln_error *error)
{
    const uint64_t *size = w->volume->size;
    struct kiln_h5_dataset what = {.name = name,
                                   .type = H5T_NATIVE_FLOAT,
                                   .rank = components > 1 ? 4 : 3,
                                   .size = {size[2], size[1], size[0], components},
                                   .units = units,
                                   .description = description,
                                   .chunk = {0, 0, 0, components}};
    for (int i = 0; i < 3; i++)
        what.chunk[i] = what.size[i] < CHUNK_SIDE ? what.size[i] : CHUNK_SIDE;
    hid_t dataset = H5I_INVALID_HID;
    int status = kiln_h5_make(&w->h5, &what, &dataset, error);
    if (status != KILN_OK)
        return status;
    const hsize_t count = w->volume->count * components, room = count > 0 ? count : 1;
    const hid_t space = H5Dget_space(dataset), memory = H5Screate_simple(1, &room, NULL);
    if (space < 0 || memory < 0 || !select_range(space, size, w->volume->first, w->volume->count, components) ||
        (count == 0 && H5Sselect_none(memory) < 0))
        status = kiln_h5_failed(&w->h5, "select a part of", name, error);
    status = kiln_agree(w->h5.communicator, status, error);
    if (status == KILN_OK && H5Dwrite(dataset, H5T_NATIVE_FLOAT, memory, space, w->h5.transfer, values) < 0)
        status = kiln_h5_failed(&w->h5, "write", name, error);
    const bool kept_memory = memory >= 0 && H5Sclose(memory) < 0, kept_space = space >= 0 && H5Sclose(space) < 0,
               kept_dataset = H5Dclose(dataset) < 0;
    if ((kept_memory || kept_space || kept_dataset) && status == KILN_OK)
        status = kiln_h5_failed(&w->h5, "close the dataset", name, error);
    return kiln_agree(w->h5.communicator, status, error);
}

static int check_finite(const struct volume_writer *w, const float *values, uint64_t components, const char *name,
                        struct kiln_error *error)
{
    for (uint64_t i = 0; i < w->volume->count * components; i++)
        if (!isfinite(values[i]))
            return kiln_fail(error, KILN_BUG, "probe %llu of the volume: %s is not a finite number",
                             (unsigned long long)(w->volume->first + i / components), name);
    return KILN_OK;
}

/* Irradiance coefficient of a probe. */
static float coefficient_of(const struct kiln_volume_result *v, uint64_t probe, int i, int c)
{
    const float radiance = v->probes[probe].radiance[i][c];
    return v->of_irradiance ? radiance : (float)(kiln_harmonics_cosine(i) * (double)radiance);
}

static int write_harmonics(struct volume_writer *w, struct kiln_error *error)
{
    for (uint64_t p = 0; p < w->volume->count; p++)
        for (int i = 0; i < KILN_HARMONICS; i++)
            for (int c = 0; c < 3; c++)
                w->values[27 * p + 3 * (uint64_t)i + (uint64_t)c] = coefficient_of(w->volume, p, i, c);
    const int status = kiln_agree(w->h5.communicator, check_finite(w, w->values, 27, "its light", error), error);
    if (status != KILN_OK)
        return status;
    return write_array(
        w, "/VTKHDF/PointData/irradiance_sh", w->values, 27, w->result->units->irradiance,
        "spherical harmonics of irradiance, component 3 i + channel (linear RGB): E(n) = sum over i of c_i Y_i(n) for "
        "unit "
        "normal n; real orthonormal Y_00 Y_1-1 Y_10 Y_11 Y_2-2 Y_2-1 Y_20 Y_21 Y_22 in x, y, z as in Ramamoorthi and "
        "Hanrahan 2001; the cosine is folded in (pi, 2 pi / 3, pi / 4)",
        error);
}

static int write_axes(struct volume_writer *w, struct kiln_error *error)
{
    static const char *const names[6] = {"/VTKHDF/PointData/irradiance_posx", "/VTKHDF/PointData/irradiance_negx",
                                         "/VTKHDF/PointData/irradiance_posy", "/VTKHDF/PointData/irradiance_negy",
                                         "/VTKHDF/PointData/irradiance_posz", "/VTKHDF/PointData/irradiance_negz"};
    int status = KILN_OK;
    for (int a = 0; status == KILN_OK && a < 6; a++) {
        for (uint64_t p = 0; p < w->volume->count; p++)
            memcpy(w->values + 3 * p, w->volume->probes[p].irradiance_axes[a], 3 * sizeof(float));
        status = kiln_agree(w->h5.communicator, check_finite(w, w->values, 3, "its light along an axis", error), error);
        if (status == KILN_OK)
            status = write_array(w, names[a], w->values, 3, w->result->units->irradiance,
                                 "irradiance on a face looking along this axis, linear RGB, estimated directly", error);
    }
    return status;
}

/* Writes for each group the light of all its probes, in one array. */
static int write_groups(struct volume_writer *w, struct kiln_error *error)
{
    enum { SH = 27, ALL = SH + 18 };
    const struct kiln_volume_result *v = w->volume;
    int status;
    KILN_TRY(v->group_count > 0 ? kiln_h5_group(&w->h5, "/groups", error) : KILN_OK);
    for (size_t g = 0; g < v->group_count; g++) {
        char name[KILN_OPTION_TEXT];
        (void)snprintf(name, sizeof name, "/groups/%s", v->group_names[g]);
        for (uint64_t p = 0; p < v->count; p++) {
            const struct kiln_probe_group *of = &v->groups[p * v->group_count + g];
            float *to = w->values + ALL * p;
            for (int i = 0; i < KILN_HARMONICS; i++)
                for (int c = 0; c < 3; c++)
                    to[3 * i + c] = (float)(kiln_harmonics_cosine(i) * (double)of->radiance[i][c]);
            memcpy(to + SH, of->irradiance_axes, sizeof of->irradiance_axes);
        }
        KILN_TRY(kiln_agree(w->h5.communicator, check_finite(w, w->values, ALL, "the light of a group", error), error));
        KILN_TRY(write_array(w, name, w->values, ALL, w->result->units->irradiance,
                             "light of a group of lights: components 0 to 26 as irradiance_sh, then red, green and "
                             "blue of irradiance_posx, negx, posy, negy, posz and negz; groups add up to these",
                             error));
    }
end:
    return status;
}

static int write_scalars(struct volume_writer *w, struct kiln_error *error)
{
    for (uint64_t p = 0; p < w->volume->count; p++)
        w->values[p] = 1.0f - w->volume->probes[p].back_share;
    int status = write_array(
        w, "/VTKHDF/PointData/validity", w->values, 1, "1",
        "share of directions in which no back face is met first: near 0 inside geometry, where a probe is of no use",
        error);
    for (uint64_t p = 0; p < w->volume->count; p++)
        w->values[p] = w->volume->probes[p].mean_distance;
    if (status == KILN_OK)
        status = write_array(
            w, "/VTKHDF/PointData/mean_distance", w->values, 1, "m",
            "mean distance to what is met, over all directions; the scene's diagonal stands in where nothing is",
            error);
    return status;
}

static int write_places(struct volume_writer *w, struct kiln_error *error)
{
    for (uint64_t p = 0; p < w->volume->count; p++)
        memcpy(w->values + 3 * p, w->volume->places[p].offset, 3 * sizeof(float));
    int status = write_array(w, "/VTKHDF/PointData/offset", w->values, 3, "m",
                             "how far from its place in the grid the probe's light was gathered, x y z: probes inside "
                             "geometry are moved out of it",
                             error);
    for (uint64_t p = 0; p < w->volume->count; p++)
        w->values[p] = (float)w->volume->places[p].state;
    if (status == KILN_OK)
        status = write_array(w, "/VTKHDF/PointData/state", w->values, 1, "1",
                             "0: the probe is in its place; 1: moved out of geometry by `offset`; 2: inside geometry, "
                             "and filled with the light of the nearest probes that are not; 3: inside geometry, and no "
                             "such probe is near",
                             error);
    return status;
}

static int write_occluders(struct volume_writer *w, struct kiln_error *error)
{
    enum { COMPONENTS = 3 * KILN_OCCLUDER_DIRECTIONS };
    const float *values = w->volume->count > 0 ? w->volume->occluders[0].planes[0] : NULL;
    const int status =
        kiln_agree(w->h5.communicator, check_finite(w, values, COMPONENTS, "what is around it", error), error);
    if (status != KILN_OK)
        return status;
    return write_array(
        w, "/VTKHDF/PointData/occluders", values, COMPONENTS, "1/m",
        "planes of the first surfaces around, component 3 ((dx + 1) + 3 (dy + 1) + 9 (dz + 1)) + axis for the "
        "directions dx dy dz of -1 0 1: unit normal away from the probe / distance of the plane; a place v, m from the "
        "probe, lies behind where g . v > 1; 0: nothing is there. How to tell what the probe sees: "
        "jobs/recipes/README.md",
        error);
}

static int write_header(struct volume_writer *w, const struct kiln_output_params *params, struct kiln_error *error)
{
    const int64_t version[2] = {1, 0};
    const double direction[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    int64_t extent[6] = {0};
    const int32_t own_version = 1;
    for (int i = 0; i < 3; i++)
        extent[2 * i + 1] = (int64_t)w->volume->size[i] - 1;
    struct kiln_h5 *h5 = &w->h5;
    const hid_t type = H5Tcopy(H5T_C_S1);
    int status;
    KILN_TRY(type < 0 || H5Tset_size(type, 9) < 0 || H5Tset_strpad(type, H5T_STR_NULLPAD) < 0
                 ? kiln_h5_failed(h5, "describe", "Type", error)
                 : kiln_h5_group(h5, "/VTKHDF", error));
    KILN_TRY(kiln_h5_attribute(h5, "/VTKHDF", "Version", H5T_NATIVE_INT64, version, 2, error));
    KILN_TRY(kiln_h5_attribute(h5, "/VTKHDF", "Type", type, "ImageData", 1, error));
    KILN_TRY(kiln_h5_attribute(h5, "/VTKHDF", "WholeExtent", H5T_NATIVE_INT64, extent, 6, error));
    KILN_TRY(kiln_h5_attribute(h5, "/VTKHDF", "Origin", H5T_NATIVE_DOUBLE, w->volume->origin, 3, error));
    KILN_TRY(kiln_h5_attribute(h5, "/VTKHDF", "Spacing", H5T_NATIVE_DOUBLE, w->volume->spacing, 3, error));
    KILN_TRY(kiln_h5_attribute(h5, "/VTKHDF", "Direction", H5T_NATIVE_DOUBLE, direction, 9, error));
    KILN_TRY(kiln_h5_group(h5, "/VTKHDF/PointData", error));
    KILN_TRY(kiln_h5_attribute_text(h5, "/", "format", "kiln volume", error));
    KILN_TRY(kiln_h5_attribute(h5, "/", "format_version", H5T_NATIVE_INT32, &own_version, 1, error));
    KILN_TRY(kiln_h5_attribute_text(h5, "/", "kiln_version", KILN_VERSION, error));
    KILN_TRY(kiln_h5_attribute_text(h5, "/", "provenance",
                                    params->provenance_json == NULL ? "{}" : params->provenance_json, error));
end:
    if (type >= 0 && H5Tclose(type) < 0 && status == KILN_OK)
        status = kiln_h5_failed(h5, "release", "Type", error);
    return kiln_agree(h5->communicator, status, error);
}

/* Reads the first and the last own probe back, with the reader that kiln probe uses. */
static int read_back(const struct volume_writer *w, const struct kiln_publish *place, struct kiln_error *error)
{
    struct kiln_error why = {""};
    const char *path = place->temporary;
    const struct kiln_volume_result *v = w->volume;
    struct kiln_volume *volume = NULL;
    int status = kiln_volume_open(&volume, place->opens, &why);
    for (uint64_t k = 0; status == KILN_OK && v->count > 0 && k < 2; k++) {
        const uint64_t own = k == 0 ? 0 : v->count - 1, index = v->first + own;
        const uint64_t at[3] = {index % v->size[0], index / v->size[0] % v->size[1], index / (v->size[0] * v->size[1])};
        struct kiln_volume_probe probe;
        struct kiln_probe_surroundings around;
        status = kiln_volume_read(volume, at, &probe, &around, &why);
        if (status == KILN_OK && (memcmp(&around.occluders, &v->occluders[own], sizeof around.occluders) != 0 ||
                                  memcmp(around.offset, v->places[own].offset, sizeof around.offset) != 0))
            status = kiln_fail(&why, KILN_IO, "what is around probe %llu", (unsigned long long)index);
        for (int c = 0; status == KILN_OK && c < 3; c++)
            if (probe.harmonics[8][c] != coefficient_of(v, own, 8, c) ||
                probe.axes[5][c] != v->probes[own].irradiance_axes[5][c] ||
                probe.mean_distance != v->probes[own].mean_distance)
                status = kiln_fail(&why, KILN_IO, "probe %llu", (unsigned long long)index);
    }
    kiln_volume_close(&volume);
    if (status == KILN_OK)
        return KILN_OK;
    /* we have just written the file, so bad content is an I/O error */
    return kiln_fail(error, status == KILN_BAD_INPUT ? KILN_IO : status,
                     "'%s' does not read back as it was written: %s", path, why.message);
}

/* Assumes that nothing can be compressed; chunks at the boundary of the grid have full size. */
uint64_t kiln_volume_space(const struct kiln_volume_result *volume)
{
    uint64_t probes = 1;
    for (int i = 0; i < 3; i++) {
        const uint64_t side = volume->size[i] < CHUNK_SIDE ? volume->size[i] : CHUNK_SIDE;
        probes *= side == 0 ? 0 : (volume->size[i] + side - 1) / side * side;
    }
    return probes * (27 + 18 + 6 + 3 * KILN_OCCLUDER_DIRECTIONS) * sizeof(float) +
           volume->group_count * (probes * (27 + 18) * sizeof(float) + 4096) + (1 << 17);
}

int kiln_write_volume(const struct kiln_bake_result *result, const struct kiln_volume_result *volume,
                      const struct kiln_output_params *params, struct kiln_error *error)
{
    struct kiln_publish place;
    struct volume_writer w = {.result = result, .volume = volume};
    int rank = 0;
    if (MPI_Comm_rank(result->communicator, &rank) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI cannot give the rank number");
    int status = kiln_publish_begin(&place, params->directory, "volume.hdf", error);
    if (status == KILN_OK && rank == 0)
        kiln_publish_sweep(&place);
    if (status == KILN_OK && rank == 0)
        status = kiln_require_space(params->directory, kiln_volume_space(volume), error);
    if (status == KILN_OK)
        status = kiln_allocate(&w.values, volume->count, (27 + 18) * sizeof(float), "the volume's values", error);
    status = kiln_agree(result->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_h5_create(&w.h5, result->communicator, &place, error);
    else
        rank = -1; /* there is no file to remove */
    if (status == KILN_OK) {
        status = write_header(&w, params, error);
        if (status == KILN_OK)
            status = write_harmonics(&w, error);
        if (status == KILN_OK)
            status = write_axes(&w, error);
        if (status == KILN_OK)
            status = write_groups(&w, error);
        if (status == KILN_OK)
            status = write_scalars(&w, error);
        if (status == KILN_OK)
            status = write_places(&w, error);
        if (status == KILN_OK)
            status = write_occluders(&w, error);
        status = kiln_agree(result->communicator, kiln_h5_close(&w.h5, status, error), error);
    }
    if (status == KILN_OK)
        status = kiln_agree(result->communicator, read_back(&w, &place, error), error);
    if (rank == 0 && status != KILN_OK)
        kiln_publish_abandon(&place);
    if (status == KILN_OK)
        status = kiln_agree(result->communicator, rank == 0 ? kiln_publish_finish(&place, error) : KILN_OK, error);
    kiln_publish_close(&place);
    kiln_free(&w.values);
    return status;
}
