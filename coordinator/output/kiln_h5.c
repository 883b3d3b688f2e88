#include <stdio.h>
#include <string.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/output/h5.h"
#include "coordinator/output/kiln_h5_points.h"
#include "coordinator/output/kiln_h5_sight.h"
#include "coordinator/output/output.h"
#include "coordinator/output/provenance.h"
#include "coordinator/files/publish.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

enum { GROUP_NAME = 64 }; /* longer than any group's name */

/* Writes the names as a table of fixed-length strings, which every HDF5 library can read. */
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
    if (type < 0 || H5Tset_size(type, length) < 0 || H5Tset_strpad(type, H5T_STR_NULLPAD) < 0 ||
        H5Tset_cset(type, H5T_CSET_UTF8) < 0)
        status = kiln_h5_failed(h5, "describe", "/objects/name", error);
    const struct kiln_h5_dataset what = {.name = "/objects/name",
                                         .type = type,
                                         .rank = 1,
                                         .size = {scene->object_count},
                                         .units = "1",
                                         .description = "the object's name; its lightmap is lightmaps/NAME.exr"};
    if (status == KILN_OK)
        status = kiln_h5_small(h5, &what, table, error);
    if (type >= 0 && H5Tclose(type) < 0 && status == KILN_OK)
        status = kiln_h5_failed(h5, "release the type of", "/objects/name", error);
    kiln_free(&table);
    return status;
}

static int write_objects(struct kiln_h5 *h5, const struct kiln_scene *scene, bool lightmaps, struct kiln_error *error)
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
    const struct kiln_h5_dataset mesh = {.name = "/objects/mesh",
                                         .type = H5T_NATIVE_UINT32,
                                         .rank = 1,
                                         .size = {scene->object_count},
                                         .units = "1",
                                         .description =
                                             "index of the object's mesh; objects of one mesh are instances"};
    const struct kiln_h5_dataset size = {.name = "/objects/lightmap",
                                         .type = H5T_NATIVE_UINT32,
                                         .rank = 2,
                                         .size = {scene->object_count, 2},
                                         .units = "texel",
                                         .description = "width and height of the lightmap"};
    status = kiln_agree(h5->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_h5_small(h5, &mesh, meshes, error);
    if (status == KILN_OK && lightmaps)
        status = kiln_h5_small(h5, &size, sizes, error);
    kiln_free(&meshes);
    kiln_free(&sizes);
    return status == KILN_OK ? write_names(h5, scene, error) : status;
}

/* Sums an array of any length over the ranks, in place. Collective. */
static int sum_over_ranks(MPI_Comm communicator, uint64_t *values, uint64_t count, struct kiln_error *error)
{
    for (uint64_t first = 0; first < count; first += 1u << 24) {
        const uint64_t left = count - first;
        if (MPI_Allreduce(MPI_IN_PLACE, values + first, (int)(left < 1u << 24 ? left : 1u << 24), MPI_UINT64_T, MPI_SUM,
                          communicator) != MPI_SUCCESS)
            return kiln_fail(error, KILN_RANK_LOST, "MPI failed while the points of cells were counted");
    }
    return KILN_OK;
}

/* Collective. Counts the points of each cell over all ranks. */
static int count_cells(const struct kiln_bake_result *result, uint64_t **points, struct kiln_error *error)
{
    const struct kiln_surface *s = result->surface;
    int status = kiln_agree(result->communicator,
                            kiln_allocate(points, s->cell_count, sizeof **points, "points of cells", error), error);
    if (status != KILN_OK)
        return status;
    for (size_t f = 0; f < s->tile_run_count; f++)
        (*points)[s->tile_runs[f].cell] += s->tile_runs[f].count;
    return sum_over_ranks(result->communicator, *points, s->cell_count, error);
}

static int write_cells(struct kiln_h5 *h5, const struct kiln_surface *s, const uint64_t *points,
                       struct kiln_error *error)
{
    const struct kiln_h5_dataset counts = {.name = "/cells/points",
                                           .type = H5T_NATIVE_UINT64,
                                           .rank = 1,
                                           .size = {s->cell_count},
                                           .units = "1",
                                           .description =
                                               "surface points in each occupied cell, in Morton order of cells"};
    const struct kiln_h5_dataset first = {.name = "/cells/first",
                                          .type = H5T_NATIVE_UINT64,
                                          .rank = 1,
                                          .size = {s->cell_count},
                                          .units = "1",
                                          .description = "index of the cell's first point in /points"};
    int status = kiln_h5_small(h5, &counts, points, error);
    /* otherwise points are in the order of objects, and those of a cell are not contiguous */
    if (status == KILN_OK && s->cell_first != NULL)
        status = kiln_h5_small(h5, &first, s->cell_first, error);
    return status;
}

/* Positions of vertices in the world, m. */
static int write_vertex_positions(struct kiln_h5 *h5, const struct kiln_scene *scene,
                                  const struct kiln_vertex_light *vertices, struct kiln_error *error)
{
    const uint64_t count = vertices->first[vertices->object_count];
    float *positions = NULL;
    int status;
    KILN_TRY(kiln_allocate(&positions, count, 3 * sizeof *positions, "positions of vertices", error));
    for (size_t o = 0; o < vertices->object_count; o++) {
        const struct kiln_object *object = &scene->objects[o];
        const struct kiln_vec3 *from = scene->positions + scene->meshes[object->mesh].vertex_first;
        for (uint64_t v = vertices->first[o]; v < vertices->first[o + 1]; v++, from++)
            for (int a = 0; a < 3; a++) {
                const double *m = object->transform + 4 * a;
                positions[3 * v + (uint64_t)a] =
                    (float)(m[0] * (double)from->x + m[1] * (double)from->y + m[2] * (double)from->z + m[3]);
            }
    }
    const struct kiln_h5_dataset what = {.name = "/vertices/position",
                                         .type = H5T_NATIVE_FLOAT,
                                         .rank = 2,
                                         .size = {count, 3},
                                         .units = "m",
                                         .description = "in the world"};
    KILN_TRY(kiln_h5_small(h5, &what, positions, error));
end:
    kiln_free(&positions);
    return status;
}

static int write_vertices(struct kiln_h5 *h5, const struct kiln_bake_result *result,
                          const struct kiln_vertex_light *vertices, struct kiln_error *error)
{
    const struct kiln_h5_dataset irradiance = {
        .name = "/vertices/irradiance",
        .type = H5T_NATIVE_FLOAT,
        .rank = 2,
        .size = {vertices->first[vertices->object_count], 3},
        .units = result->units->irradiance,
        .description = "at the vertices of all objects, one object after the other, linear RGB: interpolated over "
                       "triangles it is nearest to that of /points, by least squares"};
    const struct kiln_h5_dataset first = {.name = "/vertices/first",
                                          .type = H5T_NATIVE_UINT64,
                                          .rank = 1,
                                          .size = {vertices->object_count + 1},
                                          .units = "1",
                                          .description = "where each object's vertices begin, and where the last end"};
    const struct kiln_h5_dataset off = {.name = "/vertices/error",
                                        .type = H5T_NATIVE_FLOAT,
                                        .rank = 1,
                                        .size = {vertices->object_count},
                                        .units = "1",
                                        .description =
                                            "of each object: root mean square difference between interpolated light "
                                            "and that of /points, over the mean light (luminance)"};
    int status;
    KILN_TRY(kiln_h5_group(h5, "/vertices", error));
    KILN_TRY(kiln_h5_small(h5, &irradiance, vertices->irradiance, error));
    KILN_TRY(kiln_h5_small(h5, &first, vertices->first, error));
    KILN_TRY(kiln_h5_small(h5, &off, vertices->error, error));
    KILN_TRY(write_vertex_positions(h5, result->scene, vertices, error));
end:
    return status;
}

/* Writes how octree leaves lie in the world. */
static int write_leaves(struct kiln_h5 *h5, const struct kiln_bake_result *result, struct kiln_error *error)
{
    const struct kiln_geometry *g = result->geometry;
    const double *centre = result->scene->header->centre;
    const double origin[3] = {g->leaf_origin.x + centre[0], g->leaf_origin.y + centre[1], g->leaf_origin.z + centre[2]};
    int status;
    KILN_TRY(kiln_h5_attribute_text(h5, "/", "store", "octree", error));
    KILN_TRY(kiln_h5_attribute(h5, "/", "leaf_size", H5T_NATIVE_DOUBLE, &g->leaf_size, 1, error));
    KILN_TRY(kiln_h5_attribute(h5, "/", "leaf_origin", H5T_NATIVE_DOUBLE, origin, 3, error));
end:
    return status;
}

static int write_attributes(struct kiln_h5 *h5, const struct kiln_bake_result *result,
                            const struct kiln_output_params *params, struct kiln_error *error)
{
    const int32_t version = 1;
    const char *provenance = params->provenance_json == NULL ? "{}" : params->provenance_json;
    int64_t seed;
    const bool has_seed = kiln_provenance_seed(params->provenance_json, &seed);
    int status;
    KILN_TRY(kiln_h5_attribute_text(h5, "/", "format", "kiln bake", error));
    KILN_TRY(kiln_h5_attribute(h5, "/", "format_version", H5T_NATIVE_INT32, &version, 1, error));
    KILN_TRY(kiln_h5_attribute_text(h5, "/", "kiln_version", KILN_VERSION, error));
    KILN_TRY(kiln_h5_attribute_text(h5, "/", "provenance", provenance, error));
    if (has_seed)
        KILN_TRY(kiln_h5_attribute(h5, "/", "seed", H5T_NATIVE_INT64, &seed, 1, error));
    KILN_TRY(kiln_h5_attribute(h5, "/", "centre", H5T_NATIVE_DOUBLE, result->scene->header->centre, 3, error));
end:
    return status;
}

/* Creates the groups that contain the fields' datasets, each once, and those of every file. */
static int make_groups(struct kiln_h5 *h5, const struct kiln_field_set *fields, struct kiln_error *error)
{
    static const char *const always[] = {"/points", "/irradiance", "/objects", "/cells"};
    enum { ALWAYS = sizeof always / sizeof *always };
    char names[ALWAYS + KILN_FIELDS_MAX][GROUP_NAME];
    size_t count = 0;
    int status = KILN_OK;
    for (; count < ALWAYS; count++) {
        (void)snprintf(names[count], sizeof *names, "%s", always[count]);
        KILN_TRY(kiln_h5_group(h5, names[count], error));
    }
    for (size_t i = 0; i < fields->count; i++) {
        const char *name = fields->entry[i].field->dataset;
        size_t found = 0;
        if (name == NULL)
            continue;
        (void)snprintf(names[count], sizeof *names, "%.*s", (int)(strrchr(name, '/') - name), name);
        while (strcmp(names[found], names[count]) != 0)
            found++;
        if (found == count)
            KILN_TRY(kiln_h5_group(h5, names[count++], error));
    }
end:
    return status;
}

/* Rank 0 only. Writes everything except the points. */
static int write_small(struct kiln_h5 *h5, const struct kiln_bake_result *result,
                       const struct kiln_output_params *params, const uint64_t *cell_points,
                       const struct kiln_h5_sight *sight, struct kiln_error *error)
{
    int status;
    KILN_TRY(make_groups(h5, result->fields, error));
    KILN_TRY(write_attributes(h5, result, params, error));
    if (result->surface->bricks != NULL)
        KILN_TRY(write_leaves(h5, result, error));
    KILN_TRY(write_objects(h5, result->scene, result->surface->bricks == NULL, error));
    KILN_TRY(write_cells(h5, result->surface, cell_points, error));
    if (params->vertices != NULL)
        KILN_TRY(write_vertices(h5, result, params->vertices, error));
    KILN_TRY(kiln_h5_sight_write(h5, sight, result, error));
end:
    return status;
}

/* A rank's access to the file under its temporary name. */
struct access {
    struct kiln_publish place;
    int rank, descriptor;
};

/* Rank 0 creates the file and writes everything except the points. */
static int begin_file(struct kiln_h5 *h5, const struct kiln_bake_result *result,
                      const struct kiln_output_params *params, struct access *access, struct kiln_error *error)
{
    uint64_t *cell_points = NULL;
    struct kiln_h5_sight sight = {0};
    int status;
    KILN_TRY(count_cells(result, &cell_points, error));
    KILN_TRY(kiln_h5_sight_gather(&sight, result, error));
    if (access->rank == 0) {
        KILN_TRY(kiln_h5_lay_out(h5, &access->place, error));
        KILN_TRY(write_small(h5, result, params, cell_points, &sight, error));
    }
end:
    kiln_free(&cell_points);
    kiln_h5_sight_release(&sight);
    return kiln_agree(result->communicator, status, error);
}

/* Opens, on the other ranks, the file that rank 0 has created. */
static int join_file(struct kiln_h5 *h5, const char *directory, struct access *access, struct kiln_error *error)
{
    if (access->rank == 0) {
        access->descriptor = h5->descriptor;
        return KILN_OK;
    }
    return kiln_publish_join(&access->place, directory, "kiln.h5", &access->descriptor, error);
}

/* Closes a rank's access. Rank 0 has synced the file on closing it; the others sync what they have written. */
static int leave_file(struct access *access, struct kiln_error *error)
{
    int status = KILN_OK;
    if (access->rank == 0 || access->descriptor < 0)
        return status;
    if (kiln_fsync(access->descriptor) != 0)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be synced to disk", access->place.temporary);
    if (kiln_close(access->descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be closed", access->place.temporary);
    access->descriptor = -1;
    return status;
}

static int write_file(struct kiln_points_writer *writer, const struct kiln_bake_result *result,
                      const struct kiln_output_params *params, struct access *access, struct kiln_error *error)
{
    struct kiln_h5 h5 = KILN_H5_NONE;
    int status = begin_file(&h5, result, params, access, error);
    if (status == KILN_OK)
        status = kiln_agree(result->communicator, join_file(&h5, params->directory, access, error), error);
    if (status == KILN_OK)
        status = kiln_points_write(writer, access->rank == 0 ? &h5 : NULL, access->descriptor, access->place.temporary,
                                   error);
    if (access->rank == 0)
        status = kiln_h5_close(&h5, status, error);
    struct kiln_error own = {{0}};
    const int left = leave_file(access, &own);
    if (status == KILN_OK && left != KILN_OK)
        status = kiln_fail(error, left, "%s", own.message);
    return kiln_agree(result->communicator, status, error);
}

/* Prepares the place of the file on rank 0, before the file is created. */
static int make_place(struct access *access, const char *directory, uint64_t space, struct kiln_error *error)
{
    const int status = kiln_publish_begin(&access->place, directory, "kiln.h5", error);
    if (status != KILN_OK)
        return status;
    kiln_publish_sweep(&access->place);
    return kiln_require_space(directory, space, error);
}

/* Upper bound of the file's size, as if nothing were compressible. */
uint64_t kiln_h5_space(const struct kiln_scene *scene, const struct kiln_surface *surface,
                       const struct kiln_field_set *fields)
{
    return kiln_points_largest(fields, surface->point_count) + scene->object_count * 300 + surface->cell_count * 16 +
           (1 << 17);
}

size_t kiln_h5_columns(const struct kiln_field_set *fields)
{
    struct kiln_columns columns;
    kiln_columns_make(&columns, fields, false, false, false);
    return columns.count;
}

static uint64_t vertices_space(const struct kiln_vertex_light *v)
{
    return v != NULL ? v->first[v->object_count] * 24 + v->object_count * 12 + (1 << 14) : 0;
}

int kiln_write_h5(const struct kiln_bake_result *result, const struct kiln_output_params *params,
                  struct kiln_error *error)
{
    struct access access = {.place = {.folder = {.descriptor = -1}, .stream = -1, .scratch = -1}, .descriptor = -1};
    struct kiln_points_writer *writer = NULL;
    if (MPI_Comm_rank(result->communicator, &access.rank) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI does not tell this rank's number");
    const uint64_t space = kiln_h5_space(result->scene, result->surface, result->fields) + kiln_h5_sight_space(result) +
                           vertices_space(params->vertices);
    int status;
    KILN_TRY(kiln_agree(result->communicator,
                        access.rank == 0 ? make_place(&access, params->directory, space, error) : KILN_OK, error));
    KILN_TRY(kiln_points_writer_create(&writer, result, params, error));
    KILN_TRY(write_file(writer, result, params, &access, error));
    KILN_TRY(kiln_points_check(writer, &access.place, error));
end:
    kiln_points_writer_destroy(&writer);
    if (access.rank == 0 && status != KILN_OK)
        kiln_publish_abandon(&access.place);
    if (status == KILN_OK)
        status = kiln_agree(result->communicator,
                            access.rank == 0 ? kiln_publish_finish(&access.place, error) : KILN_OK, error);
    kiln_publish_close(&access.place);
    return status;
}
