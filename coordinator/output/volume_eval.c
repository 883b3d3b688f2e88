#include "coordinator/output/volume_eval.h"

#include <hdf5.h>
#include <math.h>
#include <stddef.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/output/h5_file.h"
#include "coordinator/files/plain_file.h"
#include "worker/base/memory.h"
#include "worker/sampling/harmonics.h"

enum { ARRAYS = 9, OCCLUDERS = 3 * KILN_OCCLUDER_DIRECTIONS };
enum { VALUES = sizeof(struct kiln_volume_probe) / sizeof(float) };

/* The arrays of the file, in the order of struct kiln_volume_probe. */
static const struct {
    const char *name;
    int components;
} arrays[ARRAYS] = {{"irradiance_sh", 27},  {"irradiance_posx", 3}, {"irradiance_negx", 3},
                    {"irradiance_posy", 3}, {"irradiance_negy", 3}, {"irradiance_posz", 3},
                    {"irradiance_negz", 3}, {"validity", 1},        {"mean_distance", 1}};

/* SEES_MARGIN: a plane hides places that lie behind it by more than this share of its distance. SEES_LEAST: weight of a
 * probe that does not see a place, so that a place that no probe sees gets the light of all. */
static const double SEES_MARGIN = 0.01, SEES_LEAST = 1e-6;

struct kiln_volume {
    char *path;
    int own; /* descriptor to close with the volume; -1: it belongs to the caller */
    struct kiln_h5_file *file;
    hid_t datasets[ARRAYS], occluders, offset; /* occluders and offset are invalid in files of older kiln versions */
    uint64_t size[3];
    double origin[3], spacing[3];
};

static int not_a_volume(const char *path, const char *what, struct kiln_error *error)
{
    return kiln_fail(error, KILN_BAD_INPUT, "'%s' is not an irradiance volume of kiln, or is damaged: %s", path, what);
}

static bool read_attribute(hid_t file, const char *name, hid_t type, hsize_t count, void *values)
{
    const hid_t attribute = H5Aopen_by_name(file, "/VTKHDF", name, H5P_DEFAULT, H5P_DEFAULT);
    const hid_t space = attribute < 0 ? H5I_INVALID_HID : H5Aget_space(attribute),
                stored = attribute < 0 ? H5I_INVALID_HID : H5Aget_type(attribute);
    const bool plain = stored >= 0 && (H5Tget_class(stored) == H5T_INTEGER || H5Tget_class(stored) == H5T_FLOAT) &&
                       H5Tget_size(stored) <= 8;
    const bool good = plain && space >= 0 && H5Sget_simple_extent_npoints(space) == (hssize_t)count &&
                      H5Aread(attribute, type, values) >= 0;
    if (stored >= 0)
        (void)H5Tclose(stored);
    if (space >= 0)
        (void)H5Sclose(space);
    if (attribute >= 0)
        (void)H5Aclose(attribute);
    return good;
}

static int read_grid(struct kiln_volume *v, struct kiln_error *error)
{
    int64_t extent[6];
    const hid_t file = kiln_h5_file_id(v->file);
    if (!read_attribute(file, "WholeExtent", H5T_NATIVE_INT64, 6, extent) ||
        !read_attribute(file, "Origin", H5T_NATIVE_DOUBLE, 3, v->origin) ||
        !read_attribute(file, "Spacing", H5T_NATIVE_DOUBLE, 3, v->spacing))
        return not_a_volume(v->path, "the grid's attributes are missing", error);
    for (int i = 0; i < 3; i++) {
        if (extent[2 * i] != 0 || extent[2 * i + 1] < 0 || extent[2 * i + 1] >= INT64_MAX || !(v->spacing[i] > 0.0) ||
            !isfinite(v->spacing[i]) || !isfinite(v->origin[i]))
            return not_a_volume(v->path, "the extent of the grid is invalid", error);
        v->size[i] = (uint64_t)extent[2 * i + 1] + 1;
    }
    return KILN_OK;
}

static int open_array(const struct kiln_volume *v, const char *array, int components, hid_t *dataset,
                      struct kiln_error *error)
{
    char name[64] = "/VTKHDF/PointData/";
    strcat(name, array);
    *dataset = H5Dopen2(kiln_h5_file_id(v->file), name, H5P_DEFAULT);
    const hid_t space = *dataset < 0 ? H5I_INVALID_HID : H5Dget_space(*dataset);
    hsize_t size[8] = {0};
    const int rank =
        space < 0 || H5Sget_simple_extent_ndims(space) > 4 ? -1 : H5Sget_simple_extent_dims(space, size, NULL);
    if (space >= 0)
        (void)H5Sclose(space);
    if (rank != (components > 1 ? 4 : 3) || size[0] != v->size[2] || size[1] != v->size[1] || size[2] != v->size[0] ||
        (rank == 4 && size[3] != (hsize_t)components))
        return not_a_volume(v->path, array, error);
    return KILN_OK;
}

int kiln_volume_open_file(struct kiln_volume **volume, int descriptor, const char *path, struct kiln_error *error)
{
    int status = kiln_allocate(volume, 1, sizeof **volume, "an irradiance volume", error);
    if (status != KILN_OK)
        return status;
    struct kiln_volume *v = *volume;
    v->own = -1;
    for (int a = 0; a < ARRAYS; a++)
        v->datasets[a] = H5I_INVALID_HID;
    v->occluders = v->offset = H5I_INVALID_HID;
    if ((status = kiln_allocate(&v->path, strlen(path) + 1, 1, "a path", error)) == KILN_OK) {
        memcpy(v->path, path, strlen(path) + 1);
        status = kiln_h5_file_open(&v->file, descriptor, v->path, error);
    }
    KILN_TRY(status);
    KILN_TRY(read_grid(v, error));
    for (int a = 0; a < ARRAYS; a++)
        KILN_TRY(open_array(v, arrays[a].name, arrays[a].components, &v->datasets[a], error));
    if (H5Lexists(kiln_h5_file_id(v->file), "/VTKHDF/PointData/occluders", H5P_DEFAULT) > 0)
        KILN_TRY(open_array(v, "occluders", OCCLUDERS, &v->occluders, error));
    if (H5Lexists(kiln_h5_file_id(v->file), "/VTKHDF/PointData/offset", H5P_DEFAULT) > 0)
        KILN_TRY(open_array(v, "offset", 3, &v->offset, error));
end:
    if (status != KILN_OK)
        kiln_volume_close(volume);
    return status;
}

int kiln_volume_open(struct kiln_volume **volume, const char *path, struct kiln_error *error)
{
    int descriptor;
    *volume = NULL;
    int status = kiln_open_plain(path, &descriptor, error);
    if (status != KILN_OK)
        return status;
    status = kiln_volume_open_file(volume, descriptor, path, error);
    if (status == KILN_OK)
        (*volume)->own = descriptor;
    else
        (void)close(descriptor);
    return status;
}

void kiln_volume_close(struct kiln_volume **volume)
{
    struct kiln_volume *v = *volume;
    if (v == NULL)
        return;
    for (int a = 0; a < ARRAYS; a++)
        if (v->datasets[a] >= 0)
            (void)H5Dclose(v->datasets[a]);
    if (v->occluders >= 0)
        (void)H5Dclose(v->occluders);
    if (v->offset >= 0)
        (void)H5Dclose(v->offset);
    kiln_h5_file_close(&v->file);
    if (v->own >= 0)
        (void)close(v->own);
    kiln_free(&v->path);
    kiln_free(volume);
}

static bool read_values(hid_t dataset, const uint64_t at[3], int components, float *values)
{
    const hsize_t start[4] = {at[2], at[1], at[0], 0}, size[4] = {1, 1, 1, (hsize_t)components},
                  count = (hsize_t)components;
    const hid_t space = H5Dget_space(dataset), memory = H5Screate_simple(1, &count, NULL);
    const bool good = space >= 0 && memory >= 0 &&
                      H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, size, NULL) >= 0 &&
                      H5Dread(dataset, H5T_NATIVE_FLOAT, memory, space, H5P_DEFAULT, values) >= 0;
    if (space >= 0)
        (void)H5Sclose(space);
    if (memory >= 0)
        (void)H5Sclose(memory);
    return good;
}

_Static_assert(VALUES == 27 + 18 + 2, "the arrays fill struct kiln_volume_probe");

static int unreadable(const struct kiln_volume *v, const char *array, const uint64_t at[3], struct kiln_error *error)
{
    return kiln_fail(error, KILN_IO, "'%s': %s of probe (%llu, %llu, %llu) cannot be read", v->path, array,
                     (unsigned long long)at[0], (unsigned long long)at[1], (unsigned long long)at[2]);
}

int kiln_volume_read(const struct kiln_volume *v, const uint64_t at[3], struct kiln_volume_probe *probe,
                     struct kiln_probe_surroundings *around, struct kiln_error *error)
{
    float values[VALUES], *next = values;
    for (int a = 0; a < ARRAYS; a++) {
        if (!read_values(v->datasets[a], at, arrays[a].components, next))
            return unreadable(v, arrays[a].name, at, error);
        next += arrays[a].components;
    }
    memcpy(probe, values, sizeof values);
    memset(around, 0, sizeof *around);
    if (v->occluders >= 0 && !read_values(v->occluders, at, OCCLUDERS, around->occluders.planes[0]))
        return unreadable(v, "occluders", at, error);
    if (v->offset >= 0 && !read_values(v->offset, at, 3, around->offset))
        return unreadable(v, "offset", at, error);
    return KILN_OK;
}

float kiln_volume_trust(float validity)
{
    const float trust = 4.0f * (validity - 0.5f);
    return trust < 0.0f ? 0.0f : trust > 1.0f ? 1.0f : trust;
}

int kiln_volume_corners(const uint64_t size[3], const double origin[3], const double spacing[3],
                        const double position[3], uint64_t at[8][3], double weight[8], bool *outside)
{
    uint64_t low[3];
    double part[3];
    bool beyond = false;
    for (int i = 0; i < 3; i++) {
        const double place = (position[i] - origin[i]) / spacing[i], last = (double)(size[i] - 1);
        const double slack =
            1e-9 * (last + 1.0); /* tolerance for rounding, so that a point on the boundary is inside */
        beyond = beyond || !(place >= -slack && place <= last + slack);
        const double inside = !(place > 0.0) ? 0.0 : place > last ? last : place;
        low[i] = (uint64_t)inside;
        if (low[i] + 1 >= size[i])
            low[i] = size[i] < 2 ? 0 : size[i] - 2;
        part[i] = inside - (double)low[i];
    }
    int count = 0;
    for (int k = 0; k < 8; k++) {
        double w = 1.0;
        for (int i = 0; i < 3; i++)
            w *= (k >> i & 1) != 0 ? part[i] : 1.0 - part[i];
        if (!(w > 0.0))
            continue;
        for (int i = 0; i < 3; i++)
            at[count][i] = low[i] + (uint64_t)(k >> i & 1);
        weight[count++] = w;
    }
    if (outside != NULL)
        *outside = beyond;
    return count;
}

/* Interpolates between planes in one octant: those for the directions e1, e1 + e2, e1 + e2 + e3, where e1, e2, e3 are
 * the axes on which v is largest, middle and least. v is their sum with weights |v1|-|v2|, |v2|-|v3|, |v3|. */
double kiln_volume_sees(const struct kiln_probe_occluders *occluders, const double v[3])
{
    int axis[3] = {0, 1, 2};
    for (int i = 1; i < 3; i++) /* by falling size */
        for (int k = i; k > 0 && fabs(v[axis[k]]) > fabs(v[axis[k - 1]]); k--) {
            const int swapped = axis[k];
            axis[k] = axis[k - 1];
            axis[k - 1] = swapped;
        }
    double direction[3] = {0}, between = 0.0, behind = 0.0;
    for (int i = 0; i < 3; i++) {
        direction[axis[i]] = v[axis[i]] < 0.0 ? -1.0 : 1.0;
        const float *g =
            occluders->planes[(int)(direction[0] + 1.0 + 3.0 * (direction[1] + 1.0) + 9.0 * (direction[2] + 1.0))];
        double along = 0.0, at_v = 0.0;
        for (int a = 0; a < 3; a++) {
            along += (double)g[a] * direction[a];
            at_v += (double)g[a] * v[a];
        }
        between += (fabs(v[axis[i]]) - (i < 2 ? fabs(v[axis[i + 1]]) : 0.0)) * along;
        behind = fmax(behind, at_v);
    }
    return fmin(fmax((1.0 + SEES_MARGIN - fmin(between, behind)) / SEES_MARGIN, 0.0), 1.0);
}

int kiln_volume_light(const struct kiln_volume *v, const double position[3], struct kiln_volume_probe *light,
                      struct kiln_volume_place *place, struct kiln_error *error)
{
    uint64_t at[8][3];
    double weight[8], sum[VALUES] = {0}, total = 0.0, trusted = 0.0, seeing = 0.0;
    const int count = kiln_volume_corners(v->size, v->origin, v->spacing, position, at, weight, &place->outside);
    for (int k = 0; k < count; k++) {
        struct kiln_volume_probe probe;
        struct kiln_probe_surroundings around;
        float values[VALUES];
        double from[3];
        const int status = kiln_volume_read(v, at[k], &probe, &around, error);
        if (status != KILN_OK)
            return status;
        memcpy(values, &probe, sizeof values);
        for (int i = 0; i < 3; i++)
            from[i] = position[i] - (v->origin[i] + v->spacing[i] * (double)at[k][i] + (double)around.offset[i]);
        const double trust = weight[k] * (double)kiln_volume_trust(probe.validity),
                     sees = kiln_volume_sees(&around.occluders, from), w = trust * fmax(sees, SEES_LEAST);
        trusted += trust;
        seeing += trust * sees;
        total += w;
        for (int i = 0; i < VALUES; i++)
            sum[i] += w * (double)values[i];
    }
    if (!(total > 0.0))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "'%s': no probe around (%g, %g, %g) can be trusted, they all lie inside or behind geometry: "
                         "choose another point "
                         "or bake with a smaller --probe-spacing",
                         v->path, position[0], position[1], position[2]);
    float values[VALUES];
    for (int i = 0; i < VALUES; i++) {
        values[i] = (float)(sum[i] / total);
        if (!isfinite(values[i]))
            return kiln_fail(error, KILN_BAD_INPUT,
                             "'%s': a probe around (%g, %g, %g) has a value that is not a number; bake again", v->path,
                             position[0], position[1], position[2]);
    }
    memcpy(light, values, sizeof values);
    place->seen = seeing / trusted;
    return KILN_OK;
}

void kiln_volume_irradiance(const struct kiln_volume_probe *light, const double normal[3], double irradiance[3])
{
    double y[KILN_HARMONICS];
    kiln_harmonics(dvec3(normal[0], normal[1], normal[2]), y);
    for (int c = 0; c < 3; c++) {
        irradiance[c] = 0.0;
        for (int i = 0; i < KILN_HARMONICS; i++)
            irradiance[c] += (double)light->harmonics[i][c] * y[i];
        irradiance[c] = fmax(irradiance[c], 0.0);
    }
}
