#include "coordinator/bench/trial.h"

#include <hdf5.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/files/publish.h"
#include "coordinator/job/options.h"
#include "worker/base/memory.h"

int kiln_trial_begin(struct kiln_trial *t, const struct kiln_job *job, struct kiln_error *error)
{
    const char *base = getenv("TMPDIR");
    *t = (struct kiln_trial){.job = job, .error = error};
    int status = kiln_child_program(t->program, error);
    if (status == KILN_OK)
        status = kiln_path_join(t->folder, base != NULL && base[0] != '\0' ? base : "/tmp", "kiln-bench-XXXXXX", error);
    if (status == KILN_OK && mkdtemp(t->folder) == NULL) {
        status = kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot make the folder %.500s", t->folder);
        t->folder[0] = '\0';
    }
    if (status == KILN_OK)
        status = kiln_path_join(t->scene, t->folder, "scene.glb", error);
    if (status == KILN_OK)
        status = kiln_path_join(t->result, t->folder, "bake", error);
    return status;
}

static void forget_bake(struct kiln_trial *t)
{
    kiln_remove_tree(t->result);
    json_decref(t->report);
    t->report = NULL;
    kiln_free(&t->points);
    t->point_count = 0;
    t->said[0] = '\0';
}

void kiln_trial_end(struct kiln_trial *t)
{
    forget_bake(t);
    kiln_glb_destroy(&t->glb);
    if (t->folder[0] != '\0')
        kiln_remove_tree(t->folder);
}

/* ---- the scene ---- */

void kiln_trial_scene(struct kiln_trial *t)
{
    kiln_glb_destroy(&t->glb);
    t->quads = 0;
    t->status = kiln_glb_create(&t->glb, t->error);
}

uint32_t kiln_trial_material(struct kiln_trial *t, double albedo, double radiance)
{
    const float a = (float)albedo, l = (float)radiance;
    const struct kiln_glb_material material = {
        .name = "material", .base_color = {a, a, a}, .emission = {l, l, l}, .roughness = 1};
    uint32_t index = 0;
    if (t->status == KILN_OK)
        t->status = kiln_glb_add_material(t->glb, &material, &index, t->error);
    return index;
}

void kiln_trial_mesh(struct kiln_trial *t, const struct kiln_vec3 *corners, const struct kiln_vec2 *layout,
                     size_t count, const uint32_t *indices, size_t index_count, uint32_t material,
                     const struct kiln_glb_placement *placement)
{
    char name[32];
    uint32_t index = 0;
    const struct kiln_glb_primitive primitive = {.material = material, .index_count = index_count};
    (void)snprintf(name, sizeof name, "object%zu", t->quads++);
    const struct kiln_glb_mesh mesh = {.name = name,
                                       .vertex_count = count,
                                       .positions = corners,
                                       .texcoord_0 = layout,
                                       .texcoord_1 = layout,
                                       .indices = indices,
                                       .primitives = &primitive,
                                       .primitive_count = 1};
    if (t->status == KILN_OK)
        t->status = kiln_glb_add_mesh(t->glb, &mesh, &index, t->error);
    if (t->status == KILN_OK)
        t->status = kiln_glb_add_node(t->glb, name, index, placement, t->error);
}

void kiln_trial_quad(struct kiln_trial *t, const struct kiln_dvec3 corner[4], unsigned cut, uint32_t material,
                     const struct kiln_glb_placement *placement)
{
    static const struct kiln_vec2 layout[4] = {{0, 1}, {1, 1}, {1, 0}, {0, 0}};
    static const uint32_t indices[2][6] = {{0, 1, 2, 0, 2, 3}, {1, 2, 3, 1, 3, 0}};
    struct kiln_vec3 at[4];
    for (int i = 0; i < 4; i++)
        at[i] = vec3((float)corner[i].x, (float)corner[i].y, (float)corner[i].z);
    kiln_trial_mesh(t, at, layout, 4, indices[cut % 2], 6, material, placement);
}

void kiln_trial_light(struct kiln_trial *t, double intensity, struct kiln_dvec3 position)
{
    const struct kiln_glb_placement placement = {.translation = {position.x, position.y, position.z}};
    if (t->status == KILN_OK)
        t->status = kiln_glb_add_point(t->glb, "light", (double[3]){1, 1, 1}, intensity, &placement, t->error);
}

/* ---- results ---- */

struct column {
    const char *name;
    hid_t type;
    size_t offset, components;
};

/* Reads a dataset into a member of all points, by a compound of its own. */
static bool read_column(hid_t file, const struct column *column, struct kiln_trial_point *points, size_t count)
{
    bool read = false;
    const size_t size = H5Tget_size(column->type) * column->components;
    unsigned char *values = NULL;
    const hid_t dataset = H5Dopen2(file, column->name, H5P_DEFAULT);
    if (dataset < 0)
        return false;
    const hid_t space = H5Dget_space(dataset);
    if (H5Sget_simple_extent_npoints(space) == (hssize_t)(count * column->components) &&
        kiln_allocate(&values, count, size, "the points of a trial", NULL) == KILN_OK)
        read = H5Dread(dataset, column->type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) >= 0;
    for (size_t i = 0; read && i < count; i++)
        memcpy((unsigned char *)&points[i] + column->offset, values + i * size, size);
    kiln_free(&values);
    (void)H5Sclose(space);
    (void)H5Dclose(dataset);
    return read;
}

static int by_place(const void *a, const void *b)
{
    const struct kiln_trial_point *p = a, *q = b;
    if (p->object != q->object)
        return p->object < q->object ? -1 : 1;
    if (p->texel[1] != q->texel[1])
        return p->texel[1] < q->texel[1] ? -1 : 1;
    return p->texel[0] == q->texel[0] ? 0 : p->texel[0] < q->texel[0] ? -1 : 1;
}

static int read_points(struct kiln_trial *t)
{
    const struct column columns[] = {
        {"points/position", H5T_NATIVE_DOUBLE, offsetof(struct kiln_trial_point, position), 3},
        {"irradiance/direct", H5T_NATIVE_FLOAT, offsetof(struct kiln_trial_point, direct), 3},
        {"irradiance/indirect", H5T_NATIVE_FLOAT, offsetof(struct kiln_trial_point, indirect), 3},
        {"points/normal", H5T_NATIVE_FLOAT, offsetof(struct kiln_trial_point, normal), 3},
        {"points/area", H5T_NATIVE_FLOAT, offsetof(struct kiln_trial_point, area), 1},
        {"points/object", H5T_NATIVE_UINT32, offsetof(struct kiln_trial_point, object), 1},
        {"points/texel", H5T_NATIVE_UINT32, offsetof(struct kiln_trial_point, texel), 2},
        {"points/valid", H5T_NATIVE_UINT8, offsetof(struct kiln_trial_point, valid), 1}};
    char path[KILN_PATH_SIZE];
    int status = kiln_path_join(path, t->result, "kiln.h5", t->error);
    t->point_count = (size_t)json_integer_value(json_object_get(json_object_get(t->report, "points"), "count"));
    if (status == KILN_OK)
        status = kiln_allocate(&t->points, t->point_count, sizeof *t->points, "the points of a trial", t->error);
    if (status != KILN_OK)
        return status;
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    bool read = file >= 0;
    for (size_t i = 0; read && i < sizeof columns / sizeof *columns; i++)
        read = read_column(file, &columns[i], t->points, t->point_count);
    if (file >= 0)
        (void)H5Fclose(file);
    if (!read)
        return kiln_fail(t->error, KILN_IO, "%.500s cannot be read", path);
    qsort(t->points, t->point_count, sizeof *t->points, by_place);
    return KILN_OK;
}

/* ---- the bake ---- */

static void make_command(struct kiln_trial *t, const char *const *options, struct kiln_child *child)
{
    static const char *const own[] = {"output", "resume", "json", "quiet", "verbose", NULL};
    static const char *const always[] = {
        "--no-preview",    "--no-resume", "--samples-probe",  "0",    "--denoise", "none",
        "--lightmap-size", "16",          "--samples-direct", "2048", NULL};
    kiln_child_push(child, t->program);
    kiln_child_push(child, "bake");
    kiln_child_push(child, t->scene);
    kiln_child_push(child, "-o");
    kiln_child_push(child, t->result);
    for (size_t i = 0; always[i] != NULL; i++)
        kiln_child_push(child, always[i]);
    for (size_t i = 0; options[i] != NULL; i++)
        kiln_child_push(child, options[i]);
    kiln_child_push_given(child, t->job, KILN_FOR_BAKE, own);
}

static int run(struct kiln_trial *t, struct kiln_child *child)
{
    char path[KILN_PATH_SIZE];
    const int status = kiln_path_join(path, t->folder, "said", t->error);
    return status == KILN_OK ? kiln_child_run_quietly(child, path, &t->code, t->said, t->error) : status;
}

int kiln_trial_bake(struct kiln_trial *t, const char *const *options)
{
    struct kiln_child child = {.error = t->error};
    int status = t->status;
    forget_bake(t);
    if (status == KILN_OK)
        status = kiln_glb_write(t->glb, t->scene, t->error);
    if (status == KILN_OK) {
        make_command(t, options, &child);
        status = run(t, &child);
    }
    if (status == KILN_OK && t->code == KILN_OK)
        status = kiln_child_report(t->result, &t->report, t->error);
    if (status == KILN_OK && t->code == KILN_OK)
        status = read_points(t);
    kiln_child_clear(&child);
    return status;
}

double kiln_trial_mean(const struct kiln_trial *t, uint32_t object)
{
    double sum = 0.0, area = 0.0;
    for (size_t i = 0; i < t->point_count; i++) {
        const struct kiln_trial_point *p = &t->points[i];
        if (p->object != object || !p->valid)
            continue;
        sum += (double)p->area * ((double)p->direct[1] + (double)p->indirect[1]);
        area += (double)p->area;
    }
    return area > 0.0 ? sum / area : 0.0;
}

bool kiln_trial_says(const struct kiln_trial *t, const char *words)
{
    size_t i;
    json_t *note;
    bool says = strstr(t->said, words) != NULL;
    json_array_foreach(json_object_get(t->report, "notes"), i, note) says =
        says || strstr(json_string_value(note), words) != NULL;
    return says;
}
